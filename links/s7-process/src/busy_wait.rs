//! When the process waits awake for the next request of a partner.
//!
//! Falling asleep and waking up take longer than serving a read. A partner on the same machine asks again within
//! microseconds; one over a network, or one that pauses, is waited for asleep.

use std::time::Duration;

/// A partner that asks again within this time is waited for awake, and no longer than this.
pub(crate) const SOON: Duration = Duration::from_micros(50);
/// Requests of one partner in a row, until the others are looked after.
const TURNS: u32 = 16;
/// However often nobody came: so many requests in a row that come soon are enough to wait awake again.
const WARY: u32 = 1024;

/// What the last requests were like.
#[derive(Debug)]
pub(crate) struct BusyWait {
    /// Requests in a row that came soon.
    soon: u32,
    /// As many are needed: twice as many after each wait in vain, half as many after each that was not. So a partner
    /// that needs this core for its next request is not held up.
    needed: u32,
    /// Requests in a row that were waited for awake.
    turns: u32,
}

impl BusyWait {
    pub(crate) const fn new() -> Self {
        Self { soon: 0, needed: 1, turns: 0 }
    }

    /// Whether the next request is waited for awake.
    pub(crate) const fn is_awake(&self) -> bool {
        self.soon >= self.needed && self.turns < TURNS
    }

    /// It has come while it was waited for awake.
    pub(crate) fn came(&mut self) {
        self.turns += 1;
        self.needed = (self.needed / 2).max(1);
    }

    /// It has not come.
    pub(crate) fn missed(&mut self) {
        self.soon = 0;
        self.needed = (self.needed * 2).min(WARY);
    }

    /// The process has slept for so long.
    pub(crate) fn slept(&mut self, time: Duration) {
        self.turns = 0;
        self.soon = if time < SOON { self.soon.saturating_add(1) } else { 0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AT_ONCE: Duration = Duration::from_micros(5);

    #[test]
    fn a_partner_in_haste_is_waited_for_awake_but_not_for_ever() {
        let mut wait = BusyWait::new();
        assert!(!wait.is_awake(), "nobody is in haste before the first request");
        wait.slept(AT_ONCE);
        for _ in 0..TURNS {
            assert!(wait.is_awake());
            wait.came();
        }
        assert!(!wait.is_awake(), "the others get their turn");
        wait.slept(AT_ONCE);
        assert!(wait.is_awake());
        wait.slept(SOON);
        assert!(!wait.is_awake(), "a pause ends it");
    }

    #[test]
    fn who_never_comes_in_time_is_waited_for_less_and_less() {
        let mut wait = BusyWait::new();
        let mut awake = 0;
        for _ in 0..10 * WARY {
            wait.slept(AT_ONCE);
            if wait.is_awake() {
                awake += 1;
                wait.missed();
            }
        }
        assert!((10..30).contains(&awake), "{awake} waits in vain");
        wait.slept(AT_ONCE);
        (0..2 * WARY).for_each(|_| wait.slept(AT_ONCE));
        for _ in 0..10 {
            assert!(wait.is_awake(), "who comes is waited for again");
            wait.came();
        }
        wait.missed();
        wait.slept(AT_ONCE);
        wait.slept(AT_ONCE);
        assert!(wait.is_awake(), "one pause costs little");
    }
}
