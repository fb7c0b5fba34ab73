//! A CPU that follows another one: it takes over the memory of a twin with the same program, or timers of which only
//! the time is known.

use ob1_model::TimerKind;

use crate::Cpu;

impl Cpu {
    /// Takes over both process images, bit memory, data blocks, timers and counters of a CPU with the same program and
    /// the same time. False: it has another one, and nothing was taken.
    pub fn take_memory_of(&mut self, twin: &Self) -> bool {
        let (mine, its) = (&mut self.machine, &twin.machine);
        let same = mine.memory.dbs == its.memory.dbs
            && mine.memory.bytes.len() == its.memory.bytes.len()
            && mine.timers.len() == its.timers.len()
            && mine.counters.len() == its.counters.len();
        if same {
            mine.memory.bytes.copy_from_slice(&its.memory.bytes);
            mine.timers.copy_from_slice(&its.timers);
            mine.counters.copy_from_slice(&its.counters);
        }
        same
    }

    /// A timer becomes one that shows this time (S5TIME) elsewhere: with a rest it runs, and the statement that has
    /// started it is not a new edge; without one it is as after a reset, see [`Cpu::elapse_timer`].
    pub fn adopt_timer(&mut self, number: u16, kind: TimerKind, time: u16) {
        let now = self.machine.hot.now;
        let Some(timer) = self.machine.timers.get_mut(usize::from(number)) else { return };
        *timer = crate::timers::Timer { kind, ..crate::timers::Timer::default() };
        if time & 0x0FFF != 0 {
            timer.running = timer.preset(time, now);
            timer.start_rlo = kind != TimerKind::OffDelay;
        }
    }

    /// If the timer runs, its time is over now: it was started by a statement whose edge was long ago.
    pub fn elapse_timer(&mut self, number: u16) {
        let now = self.machine.hot.now;
        if let Some(timer) = self.machine.timers.get_mut(usize::from(number)).filter(|timer| timer.running) {
            timer.end = now;
            timer.settle(now);
        }
    }
}
