//! Time that moves when it is told to.

use ob1_cpu::Clock;
use ob1_time::{Instant, Span};

/// What a statement costs a simulated CPU: that of a mid-range S7-300.
pub const PER_STATEMENT: Span = Span::from_nanos(100);

/// The clock of one simulated CPU during one cycle.
#[derive(Clone, Copy, Debug)]
pub struct VirtualClock(pub Instant);

impl Clock for VirtualClock {
    fn now(&mut self) -> Instant {
        self.0
    }

    fn executed(&mut self, statements: u64) {
        self.0 += statements * PER_STATEMENT;
    }

    fn statements_in(&self, time: Span) -> Option<u64> {
        Some(time.div_ceil(PER_STATEMENT))
    }

    fn wait(&mut self, deadline: Instant) {
        self.0 = self.0.max(deadline);
    }
}
