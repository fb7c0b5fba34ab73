//! Virtual time: statements take some, nothing else does, and nobody waits.

use ob1_cpu::{Clock, Nanos};

/// A clock that moves by the statements executed and by what it is told to let pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VirtualClock {
    now: Nanos,
    ns_per_statement: u64,
}

impl VirtualClock {
    /// A clock that shows 0; `ns_per_statement` is charged for each statement.
    #[must_use]
    pub const fn new(ns_per_statement: u64) -> Self {
        Self { now: 0, ns_per_statement }
    }

    /// The time now.
    #[must_use]
    pub const fn time(&self) -> Nanos {
        self.now
    }

    /// Lets time pass until `deadline`; nothing happens when that is past.
    pub fn advance_to(&mut self, deadline: Nanos) {
        self.now = self.now.max(deadline);
    }
}

impl Clock for VirtualClock {
    fn now(&mut self) -> Nanos {
        self.now
    }

    fn executed(&mut self, statements: u64) {
        self.now = self.now.saturating_add(statements.saturating_mul(self.ns_per_statement));
    }

    fn statements_in(&self, time: Nanos) -> Option<u64> {
        Some(if self.ns_per_statement == 0 { u64::MAX } else { time.div_ceil(self.ns_per_statement) })
    }

    fn wait(&mut self, deadline: Nanos) {
        self.advance_to(deadline);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_moves_by_statements_and_by_hand_and_never_back() {
        let mut clock = VirtualClock::new(100);
        clock.executed(5);
        assert_eq!(clock.now(), 500);
        clock.advance_to(2000);
        clock.advance_to(1000);
        assert_eq!(clock.now(), 2000);
        clock.executed(u64::MAX);
        assert_eq!(clock.now(), u64::MAX);
    }
}
