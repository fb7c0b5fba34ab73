//! Virtual time: statements take some, nothing else does, and nobody waits.

use ob1_cpu::Clock;
use ob1_time::{Instant, Span};

/// A clock that moves by the statements executed and by the times that it is ordered to let pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VirtualClock {
    now: Instant,
    per_statement: Span,
}

impl VirtualClock {
    /// A clock that shows 0; `per_statement` is charged for each statement.
    pub const fn new(per_statement: Span) -> Self {
        Self { now: Instant::START, per_statement }
    }

    /// The virtual time now.
    pub const fn time(&self) -> Instant {
        self.now
    }

    /// Lets time pass until `deadline`; nothing happens when that is past.
    pub fn advance_to(&mut self, deadline: Instant) {
        self.now = self.now.max(deadline);
    }
}

impl Clock for VirtualClock {
    fn now(&mut self) -> Instant {
        self.now
    }

    fn executed(&mut self, statements: u64) {
        self.now = self.now.saturating_add(self.per_statement.times(statements));
    }

    fn statements_in(&self, time: Span) -> Option<u64> {
        Some(if self.per_statement.is_zero() { u64::MAX } else { time.div_ceil(self.per_statement) })
    }

    fn wait(&mut self, deadline: Instant) {
        self.advance_to(deadline);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_moves_by_statements_and_by_hand_and_never_back() {
        let mut clock = VirtualClock::new(Span::from_nanos(100));
        clock.executed(5);
        assert_eq!(clock.now(), Instant::from_nanos(500));
        clock.advance_to(Instant::from_nanos(2000));
        clock.advance_to(Instant::from_nanos(1000));
        assert_eq!(clock.now(), Instant::from_nanos(2000));
        clock.executed(u64::MAX);
        assert_eq!(clock.now(), Instant::NEVER);
    }
}
