//! A driver without a process: the real segment (on the heap), the real supervisor machine, the real pump and firmware;
//! only the start and end of the process are virtual.

use ob1_backplane::{CpSide, CpuSide, Segment};
use ob1_cp::CpPump;
use ob1_fakes::sim_line::End;
use ob1_time::{Instant, Span};

use super::cable::Cable;
use super::life::{Life, Link, Turn};

/// A virtual driver.
pub struct Driver {
    /// The cable it is connected to, and the end.
    pub cable: usize,
    /// See `cable`.
    pub end: End,
    segment: Segment,
    monitor: ob1_backplane::Monitor,
    pump: Option<CpPump>,
    life: Life,
    /// Next time at which the pump must be polled.
    pump_due: Instant,
    kills: u64,
    ups: u64,
}

impl Driver {
    /// A driver for a new segment of this many register bytes, with the CPU's end of it and the link for the module.
    ///
    /// # Errors
    /// If the segment cannot be created.
    pub fn new(
        cable: usize,
        end: End,
        seed: u64,
        io_bytes: usize,
    ) -> Result<(Self, CpuSide, Link), ob1_backplane::SegmentError> {
        let segment = Segment::heap();
        let side = CpuSide::create(&segment, io_bytes)?;
        let (life, link) = Life::new(side.monitor().clone(), seed);
        let monitor = side.monitor().clone();
        let driver =
            Self { cable, end, monitor, segment, pump: None, life, pump_due: Instant::NEVER, kills: 0, ups: 0 };
        Ok((driver, side, link))
    }

    /// Next time at which it must be called.
    #[must_use]
    pub fn next_event(&self) -> Instant {
        self.life.next_event().min(self.pump_due)
    }

    /// Number of driver processes killed so far.
    #[must_use]
    pub fn kills(&self) -> u64 {
        self.kills
    }

    /// Number of driver processes started so far.
    #[must_use]
    pub fn ups(&self) -> u64 {
        self.ups
    }

    /// The counters in the segment, which survive the driver.
    #[must_use]
    pub fn counters(&self) -> ob1_backplane::Counters {
        self.monitor.counters()
    }

    /// Does everything that is due by `now`.
    pub fn advance(&mut self, now: Instant, cable: &mut Cable) {
        while let Some(turn) = self.life.advance(now) {
            match turn {
                Turn::Begins => {
                    if let Ok(side) = CpSide::attach(&self.segment) {
                        self.pump = Some(CpPump::new(side));
                        self.pump_due = now;
                        self.ups += 1;
                    }
                }
                Turn::Killed => drop(self.kill(now, cable)),
            }
        }
        if now >= self.pump_due {
            self.poll(now, cable);
        }
    }

    /// To be called after a cycle of its CPU: the driver wakes a little after the doorbell was rung.
    pub fn listen(&mut self, now: Instant) {
        if let Some(heard) = self.life.heard(now, self.pump.is_some()) {
            self.pump_due = self.pump_due.min(heard);
        }
    }

    /// Passes an event of its line.
    pub fn line_event(&mut self, now: Instant, input: ob1_firmware::LineInput<'_>, cable: &mut Cable) {
        if let Some(pump) = &mut self.pump {
            pump.awake();
            pump.line_event(now, input, &mut cable.end(self.end));
            self.poll(now, cable);
        }
    }

    /// `kill -9`, one time in three while it writes its registers. False if there is nothing to kill.
    pub fn kill(&mut self, now: Instant, cable: &mut Cable) -> bool {
        if self.pump.take().is_none() {
            return false;
        }
        self.kills += 1;
        cable.orphan(self.end, now);
        self.pump_due = Instant::NEVER;
        if self.life.dies_writing() {
            let field = ob1_backplane::layout::FIELDS.iter().find(|f| f.name == "inputs.sequence");
            if let Some(offset) = field.map(|f| f.offset)
                && let Some(sequence) = self.segment.peek(offset)
            {
                self.segment.poke(offset, sequence | 1);
            }
        }
        self.life.died(now);
        true
    }

    /// Polls until the pump may sleep, like the process.
    fn poll(&mut self, now: Instant, cable: &mut Cable) {
        let Some(pump) = &mut self.pump else { return };
        pump.awake();
        loop {
            self.pump_due = pump.poll(now, &mut cable.end(self.end)).max(now + Span::from_nanos(1));
            if pump.prepare_sleep() {
                return;
            }
        }
    }
}

impl std::fmt::Debug for Driver {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Driver").field("end", &self.end).field("kills", &self.kills).finish_non_exhaustive()
    }
}
