//! Waiting times after wrong passwords: a machine that is handed the time.

use std::collections::BTreeMap;
use std::time::Duration;

/// The first wait; each further one is twice as long.
const FIRST: Duration = Duration::from_millis(500);
/// The longest wait.
const LONGEST: Duration = Duration::from_secs(60);
/// After this time without an attempt the count restarts.
const FORGET: Duration = Duration::from_secs(15 * 60);
/// Maximum of remembered keys: the one due to be forgotten first is replaced by a new one.
const REMEMBERED: usize = 4096;

#[derive(Clone, Copy, Debug)]
struct Tries {
    failed: u32,
    last: Duration,
    until: Duration,
}

/// Waits after wrong passwords, for each key (a name from an address, an address).
#[derive(Debug, Default)]
pub struct BackOff {
    tries: BTreeMap<String, Tries>,
    /// Number of wrong passwords without a wait.
    free: u32,
}

impl BackOff {
    /// The waits begin after this many wrong passwords.
    #[must_use]
    pub const fn after(free: u32) -> Self {
        Self { tries: BTreeMap::new(), free }
    }

    /// How long this key still has to wait.
    #[must_use]
    pub fn wait(&self, key: &str, now: Duration) -> Duration {
        self.tries.get(key).map_or(Duration::ZERO, |tries| tries.until.saturating_sub(now))
    }

    /// A wrong password.
    pub fn failed(&mut self, key: &str, now: Duration) {
        self.tries.retain(|_, tries| now.saturating_sub(tries.last) < FORGET);
        if self.tries.len() >= REMEMBERED
            && !self.tries.contains_key(key)
            && let Some(oldest) = self.tries.iter().min_by_key(|(_, tries)| tries.last).map(|(key, _)| key.clone())
        {
            self.tries.remove(&oldest);
        }
        let new = Tries { failed: 0, last: now, until: now };
        let tries = self.tries.entry(key.to_owned()).or_insert(new);
        (tries.failed, tries.last) = (tries.failed.saturating_add(1), now);
        if let Some(times) = tries.failed.checked_sub(self.free + 1) {
            tries.until = now + FIRST.saturating_mul(1 << times.min(16)).min(LONGEST);
        }
    }

    /// The right password.
    pub fn passed(&mut self, key: &str) {
        self.tries.remove(key);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_double_up_to_a_bound_and_end_with_the_right_password() {
        let mut back_off = BackOff::after(1);
        let mut now = Duration::ZERO;
        let mut waits = Vec::new();
        for _ in 0..12 {
            back_off.failed("anna", now);
            let wait = back_off.wait("anna", now);
            waits.push(wait.as_millis());
            now += wait;
            assert_eq!(back_off.wait("anna", now), Duration::ZERO);
        }
        assert_eq!(waits, [0, 500, 1000, 2000, 4000, 8000, 16_000, 32_000, 60_000, 60_000, 60_000, 60_000]);
        assert_eq!(back_off.wait("bert", now), Duration::ZERO);
        back_off.failed("anna", now);
        back_off.passed("anna");
        assert_eq!(back_off.wait("anna", now), Duration::ZERO);
    }

    #[test]
    fn it_remembers_a_bounded_number_and_forgets() {
        let mut back_off = BackOff::after(0);
        for number in 0..2 * REMEMBERED as u64 {
            back_off.failed(&number.to_string(), Duration::from_millis(number));
        }
        assert_eq!(back_off.tries.len(), REMEMBERED);
        assert_eq!(back_off.wait("0", Duration::ZERO), Duration::ZERO, "the oldest have gone");
        back_off.failed("new", Duration::from_secs(3600));
        assert_eq!(back_off.tries.len(), 1);
    }
}
