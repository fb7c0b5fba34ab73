//! Where the time comes from.

use crate::{Instant, Span};

/// The only source of time of a CPU and of what runs beside it: real or virtual.
pub trait Clock {
    /// The time now. Never goes back.
    fn now(&mut self) -> Instant;

    /// Told at safe points how many statements have been executed since the last time. A virtual clock charges time for
    /// them, so that a loop on a timer ends and the watchdog fires; a real clock ignores it.
    fn executed(&mut self, statements: u64);

    /// How many statements it takes until so much time has passed, for a clock that charges time for statements; `None`
    /// for one whose time runs by itself. So the CPU knows when to ask for the time again.
    fn statements_in(&self, _time: Span) -> Option<u64> {
        None
    }

    /// A block waits inside the scan (SFC 47) until `deadline`, or until something is due before. A virtual clock moves
    /// there. A real one has nothing to do: its time runs by itself, and a scan does not sleep.
    fn wait(&mut self, _deadline: Instant) {}

    /// The program stands still (HOLD): sleeps until `deadline`.
    fn rest(&mut self, deadline: Instant) {
        self.wait(deadline);
    }
}

/// A clock that stands still: for scans whose result has nothing to do with time.
#[derive(Clone, Copy, Debug, Default)]
pub struct Still;

impl Clock for Still {
    fn now(&mut self) -> Instant {
        Instant::START
    }

    fn executed(&mut self, _statements: u64) {}
}
