//! Time that moves when it is told to.

use ob1_cpu::{Clock, Nanos};

/// What a statement costs a simulated CPU: that of a mid-range S7-300.
pub const NS_PER_STATEMENT: u64 = 100;

/// The clock of one simulated CPU during one cycle.
#[derive(Clone, Copy, Debug)]
pub struct VirtualClock(pub Nanos);

impl Clock for VirtualClock {
    fn now(&mut self) -> Nanos {
        self.0
    }

    fn executed(&mut self, statements: u64) {
        self.0 += statements * NS_PER_STATEMENT;
    }

    fn statements_in(&self, time: Nanos) -> Option<u64> {
        Some(time.div_ceil(NS_PER_STATEMENT))
    }

    fn wait(&mut self, deadline: Nanos) {
        self.0 = self.0.max(deadline);
    }
}
