//! Operating states: what a command does, the three kinds of start-up, STOP, memory reset.

use ob1_model::{Event, Point};
use ob1_time::Span;

use crate::interrupts::Diagnoses;
use crate::machine::Watchdog;
use crate::standstill::Standstill;
use crate::timers::{Counter, Timer};
use crate::{Clock, Command, Cpu, Family, ObInfo, OperatingState};

/// How the CPU goes from STOP to RUN.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Start {
    Warm,
    /// A warm restart that keeps all data blocks.
    Keep,
    Hot,
    Cold,
}

impl Start {
    const fn text(self) -> &'static str {
        match self {
            Start::Warm => "warm restart",
            Start::Keep => "warm restart, all data blocks kept",
            Start::Hot => "hot restart",
            Start::Cold => "cold restart",
        }
    }

    /// OB10x_STRTUP: a manual request.
    const fn request(self) -> u8 {
        match self {
            Start::Warm | Start::Keep => 0x81,
            Start::Hot => 0x83,
            Start::Cold => 0x85,
        }
    }

    /// "Startup just completed" in OB10x_STRT_INFO: by a command of a link.
    const fn completed(self) -> u8 {
        match self {
            Start::Warm | Start::Keep => 0x04,
            Start::Hot => 0x0C,
            Start::Cold => 0x08,
        }
    }

    /// OB1_SCAN_1 of the first cycle after it.
    const fn first_scan(self) -> u8 {
        match self {
            Start::Warm | Start::Keep => 1,
            Start::Hot => 2,
            Start::Cold => 4,
        }
    }
}

impl Cpu {
    /// Treats memory as left by a RUN before, so that a hot restart can continue from it, as after a power failure of a
    /// CPU with a battery.
    pub fn assume_run(&mut self) {
        self.has_run = true;
    }

    pub(crate) fn obey(&mut self, command: Command, clock: &mut dyn Clock) {
        let running = self.state == OperatingState::Run;
        match command {
            Command::Run if running => {}
            Command::Run | Command::Warm => self.start_up(Start::Warm, clock),
            Command::Keep => self.start_up(Start::Keep, clock),
            Command::Cold => self.start_up(Start::Cold, clock),
            Command::Hot if self.machine.config.family == Family::S7_300 => {
                self.diagnose(Event::STARTUP, 0, "refused: an S7-300 has no hot restart");
            }
            Command::Hot if !self.has_run => self.diagnose(Event::STARTUP, 0, "refused: there is no RUN to continue"),
            Command::Hot => self.start_up(Start::Hot, clock),
            Command::Stop if running => {
                self.diagnose(Event::STOP_OPERATOR, 0, "");
                self.enter_stop();
            }
            Command::Stop => {}
            Command::Reset => {
                if running {
                    self.enter_stop();
                }
                self.clear(Start::Cold);
                self.machine.force.clear();
                self.machine.enable_outputs(false);
                self.has_run = false;
                self.diagnose(Event::MEMORY_RESET, 0, "");
            }
        }
    }

    /// Everything that is not retentive becomes as after loading; on a cold restart the rest too.
    fn clear(&mut self, kind: Start) {
        let m = &mut self.machine;
        match kind {
            Start::Hot => return,
            Start::Cold => {
                m.memory.clear_areas(&[]);
                m.memory.reload_dbs(&[]);
                m.memory.delete_made();
                m.timers.fill(Timer::default());
                m.counters.fill(Counter::default());
            }
            Start::Warm => {
                m.keep.clear_areas(&mut m.memory, &mut m.timers, &mut m.counters);
                m.keep.reload_dbs(&mut m.memory);
            }
            Start::Keep => m.keep.clear_areas(&mut m.memory, &mut m.timers, &mut m.counters),
        }
        for native in &self.blocks.natives {
            native.block.reset();
        }
        let m = &mut self.machine;
        let time = m.alarm_time();
        m.alarms.table.restart(kind == Start::Cold, time);
        m.alarms.send();
    }

    /// The stacks of an aborted run are empty, nothing waits.
    fn unwind(&mut self) {
        let m = &mut self.machine;
        m.hot.stopping = false;
        m.hot.unwind();
        m.stacks.forget();
        m.inside = Span::ZERO;
        (m.ob, m.class_ob) = (ObInfo::default(), 0);
        m.native_caller = None;
        (m.interrupted, m.substitute) = (None, None);
        (m.active, m.aborted, m.diagnoses) = (0, false, Diagnoses::default());
        m.at = None;
        m.tape = None;
        m.trace.start_up();
        m.interrupts.clear();
        m.services.clear();
        for plugged in &mut m.modules.list {
            plugged.image_error = [false; 2];
        }
    }

    /// STOP to RUN through OB 100 (warm), OB 101 (hot) or OB 102 (cold; OB 100 when it is not loaded).
    fn start_up(&mut self, kind: Start, clock: &mut dyn Clock) {
        if self.state == OperatingState::Run {
            self.diagnose(Event::STOP_OPERATOR, 0, "restart");
            self.enter_stop();
        }
        let stop_event = self.stop_event;
        self.clear(kind);
        self.unwind();
        self.machine.put_forced();
        self.machine.set_times_of_day();
        // Time stood still for the timers that are left.
        let m = &mut self.machine;
        let stood = m.hot.now.since(m.stopped_at);
        m.timers.iter_mut().for_each(|timer| timer.shift(stood));
        m.services.meters_stood(m.stopped_at, m.hot.now, kind == Start::Hot);
        (m.stopped_at, m.started) = (m.hot.now, m.wall.bytes(m.hot.now));
        m.obs.restart();
        self.state = OperatingState::Startup;
        self.diagnose(Event::STARTUP, 0, kind.text());
        self.machine.modules.cpu_state(true);
        self.machine.outputs_disabled = false;
        self.machine.watchdog = Watchdog::default();
        self.machine.standstill = Standstill::watched(self.machine.hot.now, self.state);
        let number = match kind {
            Start::Cold if self.blocks.ob(102).is_some() => 102,
            Start::Warm | Start::Keep | Start::Cold => 100,
            Start::Hot => 101,
        };
        let found = self.blocks.ob(number);
        let mut cx = self.context(clock);
        let mut start = cx.start_info(0x13, kind.request(), 27, number as u8);
        start[6..8].copy_from_slice(&stop_event.to_be_bytes());
        start[9] = kind.completed();
        // Automatic and manual start-up are permitted; the last setting is this start-up.
        (start[10], start[11]) = (0x77, kind.completed());
        cx.machine.services.start_up = start;
        if let Some(callee) = found {
            let ran = cx.run_ob(callee, ObInfo { number, priority: 27, start }).and_then(|()| cx.attend());
            if ran.is_err() || self.machine.hot.stopping {
                self.enter_stop();
                return;
            }
        }
        self.state = OperatingState::Run;
        self.has_run = true;
        // What the start-up has executed says nothing about the scans to come.
        self.blocks.plan.executed.forget();
        if self.blocks.ob(1).is_none() {
            self.diagnose(Event::OB_NOT_LOADED, 1, "OB 1: no program runs in the cycle");
        }
        self.diagnose(Event::RUN, 0, "");
        self.due = self.machine.hot.now;
        self.machine.interrupts.start(self.machine.hot.now);
        self.last_start = None;
        self.cycle_ms = [0; 3];
        self.first_scan = kind.first_scan();
    }

    /// The program stands still, every output is 0.
    pub(crate) fn enter_stop(&mut self) {
        self.point(Point::Stop);
        self.state = OperatingState::Stop;
        self.last_start = None;
        self.stop_event = self.machine.diag.get(0).map_or(0, |entry| entry.event.0);
        self.machine.diag.keep_stop();
        let m = &mut self.machine;
        m.hot.stopping = false;
        m.stopped_at = m.hot.now;
        m.interrupts.stop();
        m.watchdog = Watchdog::default();
        let outputs = m.memory.outputs;
        m.memory.slice_mut(outputs).fill(0);
        m.modules.outputs_off();
        m.modules.cpu_state(false);
        m.outputs_disabled = true;
    }
}
