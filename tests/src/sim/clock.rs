//! Time that is advanced explicitly.

use ob1_cpu::Clock;
use ob1_time::{Instant, Span};

/// Time of a statement on a simulated CPU: that of a mid-range S7-300.
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

/// The clock of a CPU whose scan is long: each look at it, which is one before and one after each call of a handling
/// block, takes time, and the plant continues.
#[derive(Debug)]
pub struct LongScan<M> {
    /// The time.
    pub clock: VirtualClock,
    /// What a look takes.
    pub call: Span,
    /// The plant continues from the first instant until the second.
    pub meanwhile: M,
}

impl<M: FnMut(Instant, Instant)> Clock for LongScan<M> {
    fn now(&mut self) -> Instant {
        let from = self.clock.0;
        self.clock.0 += self.call;
        (self.meanwhile)(from, self.clock.0);
        self.clock.0
    }

    fn executed(&mut self, statements: u64) {
        self.clock.executed(statements);
    }

    fn statements_in(&self, time: Span) -> Option<u64> {
        self.clock.statements_in(time)
    }

    fn wait(&mut self, deadline: Instant) {
        self.clock.wait(deadline);
    }
}
