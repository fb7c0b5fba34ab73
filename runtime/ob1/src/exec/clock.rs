//! The clock of `ob1 exec`: virtual or real, with the limits of both.

use std::time::{Duration, Instant};

use ob1_cpu::{Clock, Interrupt, Nanos};
use ob1_rt::MonotonicClock;

use super::ExecArgs;
use crate::virtual_clock::VirtualClock;

/// Where time is virtual, a run also ends after so many seconds of real time.
pub(super) const WALL_LIMIT_S: u64 = 120;
/// Looks of the CPU at its clock (every 1000 statements, and at the end of a cycle) between two looks at real time.
const LOOKS: u32 = 64;

#[derive(Debug)]
enum Time {
    Virtual(VirtualClock),
    Real(MonotonicClock),
}

/// A clock that ends the run. The limit is looked at between two cycles; a cycle that does not end is halted when it is over by the
/// cycle monitoring time, or when real time is up.
#[derive(Debug)]
pub(super) struct ExecClock {
    time: Time,
    limit: Nanos,
    halt_at: Nanos,
    wall: Option<Instant>,
    looks: u32,
    wall_over: bool,
    halted: bool,
    interrupt: Interrupt,
}

impl ExecClock {
    pub(super) fn new(args: &ExecArgs, interrupt: Interrupt) -> Self {
        let limit = args.limit.as_nanos() as u64;
        let time = if args.real_time {
            Time::Real(MonotonicClock::start())
        } else {
            Time::Virtual(VirtualClock::new(args.ns_per_statement))
        };
        let wall = (!args.real_time).then(|| Instant::now() + Duration::from_secs(WALL_LIMIT_S));
        let halt_at = limit.saturating_add(args.watchdog.as_nanos() as u64);
        Self { time, limit, halt_at, wall, looks: 0, wall_over: false, halted: false, interrupt }
    }

    /// The next cycle is due then; time is let pass, or waited for.
    pub(super) fn wait_until(&mut self, deadline: Nanos) {
        match &mut self.time {
            Time::Virtual(clock) => clock.advance_to(deadline),
            Time::Real(clock) => clock.sleep_until(deadline.min(self.limit)),
        }
    }

    /// A limit is reached.
    pub(super) fn is_over(&mut self) -> bool {
        self.wall_over || self.now() >= self.limit
    }

    /// Real time was up first.
    pub(super) fn wall_is_over(&self) -> bool {
        self.wall_over
    }

    /// A cycle was halted.
    pub(super) fn has_halted(&self) -> bool {
        self.halted
    }

    fn look_at_limits(&mut self) {
        self.looks += 1;
        if self.looks >= LOOKS {
            self.looks = 0;
            self.wall_over = self.wall_over || self.wall.is_some_and(|end| Instant::now() >= end);
        }
        if !self.halted && (self.wall_over || self.now() >= self.halt_at) {
            self.halted = true;
            self.interrupt.halt();
        }
    }
}

impl Clock for ExecClock {
    fn now(&mut self) -> Nanos {
        match &mut self.time {
            Time::Virtual(clock) => clock.now(),
            Time::Real(clock) => clock.now(),
        }
    }

    fn executed(&mut self, statements: u64) {
        if let Time::Virtual(clock) = &mut self.time {
            clock.executed(statements);
        }
        self.look_at_limits();
    }

    fn statements_in(&self, time: Nanos) -> Option<u64> {
        match &self.time {
            Time::Virtual(clock) => clock.statements_in(time),
            Time::Real(_) => None,
        }
    }

    fn wait(&mut self, deadline: Nanos) {
        if let Time::Virtual(clock) = &mut self.time {
            clock.wait(deadline);
        }
        self.look_at_limits();
    }
}
