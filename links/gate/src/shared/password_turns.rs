//! Whose password is checked next: a machine that is handed the time.
//!
//! Nobody is kept out by the wrong passwords of others. Each attempt waits for its turn, a moment longer after wrong
//! passwords for the same name from the same address, or for many names from there, but never for ever: who knows the
//! password may come from the address of who guesses it (a proxy, this machine), and may be the one who is guessed.
//! A browser that has logged in before is known by a cookie and waits for nobody's wrong passwords but its own.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::time::Duration;

use ob1_access::partner::network;

/// The wait after a wrong password; after each further one it is twice as long,
const FIRST: Duration = Duration::from_millis(250);
/// up to this.
const LONGEST: Duration = Duration::from_secs(2);
/// Between two passwords that are checked for a name from an address, or for an address, once they wait: however many
/// connections guess, so fast they are, and who waits behind 24 of them waits less than three seconds.
const GAP: Duration = Duration::from_millis(100);
/// Wrong passwords of an address, for any name, before it waits.
const FREE_OF_ADDRESS: u32 = 10;
/// By how much a known browser is served before strangers who came earlier.
const AHEAD: Duration = Duration::from_secs(2);
/// After this time without an attempt the count restarts.
const FORGET: Duration = Duration::from_secs(15 * 60);
/// Maximum of remembered keys: the one due to be forgotten first is replaced by a new one.
const REMEMBERED: usize = 4096;
/// Attempts that wait at a time.
const WAITING: usize = 64;

/// Where an attempt to log in comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Source {
    /// The address of the client, if it is known.
    pub(crate) address: Option<IpAddr>,
    /// The text of [`Users::device`](crate::shared::Users::device) that it brings.
    pub(crate) device: Option<String>,
}

impl Source {
    /// A client that is known by its address alone.
    #[must_use]
    pub(crate) const fn address(address: IpAddr) -> Self {
        Self { address: Some(address), device: None }
    }

    /// A client of which nothing is known.
    #[must_use]
    pub(crate) const fn unknown() -> Self {
        Self { address: None, device: None }
    }
}

/// The keys under which the wrong passwords of an attempt count, and those that each has free.
#[derive(Clone, Debug)]
pub(crate) struct Keys {
    counted: Vec<(String, u32)>,
    /// With whom it shares its places.
    share: String,
    known: bool,
}

impl Keys {
    /// `device` is the number of a known browser.
    pub(crate) fn of(user: &str, source: &Source, device: Option<&str>) -> Self {
        let own = |key: String, known| Self { counted: vec![(key.clone(), 0)], share: key, known };
        match (device, source.address) {
            (Some(device), _) => own(format!("device\n{device}"), true),
            // Whoever guesses for one name keeps no other waiting.
            (None, None) => own(format!("{user}\n-"), false),
            (None, Some(address)) => {
                let share = network(address).to_string();
                let counted = vec![(format!("{user}\n{share}"), 0), (share.clone(), FREE_OF_ADDRESS)];
                Self { counted, share, known: false }
            }
        }
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Tries {
    failed: u32,
    last: Duration,
    /// When the last attempt of those that wait is due.
    due: Duration,
}

#[derive(Debug)]
struct Waiting {
    number: u64,
    share: String,
    due: Duration,
    /// Of those that are due, the smallest is next.
    order: (Duration, u64),
}

/// What an attempt does next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Next {
    /// It is its turn, until [`Turns::done`].
    Now,
    /// It asks again then.
    At(Duration),
    /// It asks again when another is done.
    Later,
    /// Others have taken its place.
    Gone,
}

/// All attempts of a link.
#[derive(Debug, Default)]
pub(crate) struct Turns {
    tries: BTreeMap<String, Tries>,
    waiting: Vec<Waiting>,
    last: u64,
    /// A password is being checked.
    busy: bool,
}

impl Turns {
    /// One more waits; returns its number. With too many the address that has most of them loses the one that is due
    /// last, which may be this one.
    pub(crate) fn enter(&mut self, keys: &Keys, now: Duration) -> u64 {
        let mut due = now;
        for (key, free) in &keys.counted {
            let Some(tries) = self.tries.get(key) else { continue };
            if let Some(times) = tries.failed.checked_sub(free + 1) {
                due = due.max(now + FIRST.saturating_mul(1 << times.min(16)).min(LONGEST)).max(tries.due + GAP);
            }
        }
        for (key, _) in &keys.counted {
            if let Some(tries) = self.tries.get_mut(key) {
                tries.due = due;
            }
        }
        self.last += 1;
        let number = self.last;
        let order = if keys.known { due } else { due + AHEAD };
        self.waiting.push(Waiting { number, share: keys.share.clone(), due, order: (order, number) });
        if self.waiting.len() > WAITING {
            let places = |share: &str| self.waiting.iter().filter(|other| other.share == share).count();
            let victim = self.waiting.iter().max_by_key(|one| (places(&one.share), one.due, one.number));
            if let Some(number) = victim.map(|victim| victim.number) {
                self.leave(number);
            }
        }
        number
    }

    /// What this attempt does.
    pub(crate) fn next(&mut self, number: u64, now: Duration) -> Next {
        let Some(at) = self.waiting.iter().position(|one| one.number == number) else { return Next::Gone };
        let due = self.waiting.iter().filter(|one| one.due <= now);
        let first = due.min_by_key(|one| one.order).map(|one| one.number);
        match self.waiting.get(at) {
            Some(mine) if mine.due > now => Next::At(mine.due),
            _ if self.busy || first != Some(number) => Next::Later,
            _ => {
                self.waiting.swap_remove(at);
                self.busy = true;
                Next::Now
            }
        }
    }

    /// This attempt waits no longer.
    pub(crate) fn leave(&mut self, number: u64) {
        self.waiting.retain(|one| one.number != number);
    }

    /// The turn is over.
    pub(crate) const fn done(&mut self) {
        self.busy = false;
    }

    /// Counts a password that was checked.
    pub(crate) fn count(&mut self, keys: &Keys, is_right: bool, now: Duration) {
        if is_right {
            // A right password of somebody does not make guesses for other names from there free.
            if let Some((key, _)) = keys.counted.first() {
                self.tries.remove(key);
            }
            return;
        }
        self.tries.retain(|_, tries| now.saturating_sub(tries.last) < FORGET);
        for (key, _) in &keys.counted {
            if self.tries.len() >= REMEMBERED
                && !self.tries.contains_key(key)
                && let Some(oldest) = self.tries.iter().min_by_key(|(_, tries)| tries.last).map(|(key, _)| key.clone())
            {
                self.tries.remove(&oldest);
            }
            let tries = self.tries.entry(key.clone()).or_default();
            (tries.failed, tries.last) = (tries.failed.saturating_add(1), now);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    fn keys(user: &str, address: &str) -> Keys {
        Keys::of(user, &Source::address(address.parse().expect("an address")), None)
    }

    /// Checks take `check` each; each guesser tries again as soon as it has an answer. How long those who know their
    /// password wait: one comes every 500 ms.
    fn longest(guess: impl Fn(u64) -> Keys, guessers: usize, honest: &Keys, check: Duration) -> Duration {
        let (mut turns, mut now, mut count) = (Turns::default(), Duration::ZERO, 0);
        let mut guesses: Vec<Option<(u64, Keys)>> = vec![None; guessers];
        let (mut waiting, mut since, mut worst) = (None, Duration::ZERO, Duration::ZERO);
        while now < Duration::from_secs(15) {
            for place in &mut guesses {
                if place.is_none() {
                    let keys = guess(count);
                    count += 1;
                    *place = Some((turns.enter(&keys, now), keys));
                }
            }
            if waiting.is_none() && now >= since + 500 * MS {
                (waiting, since) = (Some(turns.enter(honest, now)), now);
            }
            let mut went = false;
            if let Some(number) = waiting {
                worst = worst.max(now - since);
                match turns.next(number, now) {
                    Next::Gone => return Duration::MAX,
                    Next::Now => {
                        now += check;
                        turns.count(honest, true, now);
                        (waiting, went) = (None, true);
                    }
                    Next::At(_) | Next::Later => {}
                }
            }
            for place in &mut guesses {
                let Some((number, keys)) = place else { continue };
                match turns.next(*number, now) {
                    Next::Now => {
                        now += check;
                        turns.count(keys, false, now);
                        (*place, went) = (None, true);
                    }
                    Next::Gone => *place = None,
                    Next::At(_) | Next::Later => {}
                }
                if went {
                    break;
                }
            }
            turns.done();
            now += if went { Duration::ZERO } else { 5 * MS };
        }
        worst
    }

    #[test]
    fn a_right_password_comes_in_whoever_guesses() {
        let at = |number: u64| format!("192.0.2.{}", number % 250);
        let honest = keys("anna", "127.0.0.1");
        let known = Keys::of("anna", &Source::address("127.0.0.1".parse().expect("an address")), Some("7"));
        for (check, guessers) in [(30 * MS, 1), (30 * MS, 24), (90 * MS, 24)] {
            let waits = [
                longest(|number| keys(&format!("u{number}"), "127.0.0.1"), guessers, &honest, check),
                longest(|number| keys(&format!("u{number}"), &at(number)), guessers, &honest, check),
                longest(|number| keys("anna", &at(number)), guessers, &honest, check),
                longest(|_| keys("anna", "127.0.0.1"), guessers, &honest, check),
                longest(|_| keys("anna", "127.0.0.1"), guessers, &known, check),
            ];
            assert!(waits.iter().all(|wait| *wait < Duration::from_secs(5)), "{guessers}: {waits:?}");
            assert!(waits[4] <= 3 * check, "a known browser waits for nobody: {waits:?}");
        }
        // Twice as many as there are places, of one address: the others have theirs.
        let one = longest(|number| keys(&format!("u{number}"), "192.0.2.1"), 2 * WAITING, &honest, 30 * MS);
        assert!(one < Duration::from_secs(5), "{one:?}");
    }

    #[test]
    fn whoever_guesses_waits() {
        let (mut turns, anna) = (Turns::default(), keys("anna", "::1"));
        let mut now = Duration::ZERO;
        let mut waits = Vec::new();
        for _ in 0..6 {
            let number = turns.enter(&anna, now);
            let next = turns.next(number, now);
            waits.push(if let Next::At(due) = next { (due - now).as_millis() } else { 0 });
            if let Next::At(due) = next {
                now = due;
                assert_eq!(turns.next(number, now), Next::Now);
            }
            turns.done();
            turns.count(&anna, false, now);
        }
        assert_eq!(waits, [0, 250, 500, 1000, 2000, 2000]);
        // Many connections are no faster than one check in each gap.
        let numbers: Vec<_> = (0..20).map(|_| turns.enter(&anna, now)).collect();
        let dues: Vec<_> = numbers.iter().map(|number| turns.next(*number, now)).collect();
        assert!(matches!((dues[0], dues[19]), (Next::At(a), Next::At(b)) if b >= a + GAP * 19), "{dues:?}");
        // Another name there, and the same name elsewhere, do not wait.
        for (user, address) in [("bert", "::1"), ("anna", "192.0.2.1")] {
            let number = turns.enter(&keys(user, address), now);
            assert_eq!(turns.next(number, now), Next::Now, "{user}");
            turns.done();
        }
        turns.count(&anna, true, now);
        let number = turns.enter(&anna, now);
        assert_eq!(turns.next(number, now), Next::Now);
    }

    #[test]
    fn one_at_a_time_in_the_order_in_which_they_are_due() {
        let mut turns = Turns::default();
        let [a, b, c] = ["a", "b", "c"].map(|user| turns.enter(&keys(user, "::1"), MS));
        assert_eq!([turns.next(b, MS), turns.next(a, MS), turns.next(b, MS)], [Next::Later, Next::Now, Next::Later]);
        turns.done();
        turns.leave(b);
        assert_eq!([turns.next(b, MS), turns.next(c, MS)], [Next::Gone, Next::Now]);
    }

    #[test]
    fn it_remembers_a_bounded_number_and_forgets() {
        let mut turns = Turns::default();
        for number in 0..2 * REMEMBERED as u64 {
            turns.count(&keys(&number.to_string(), "::1"), false, MS * number as u32);
        }
        assert_eq!(turns.tries.len(), REMEMBERED);
        assert!(!turns.tries.contains_key("0\n::"), "the oldest have gone");
        turns.count(&keys("new", "::1"), false, Duration::from_secs(3600));
        assert_eq!(turns.tries.len(), 2);
    }

    #[test]
    fn who_has_a_network_does_not_have_many_addresses() {
        let of = |text: &str| network(text.parse().expect("an address")).to_string();
        assert_eq!(of("2001:db8:1:2:3:4:5:6"), "2001:db8:1:2::");
        assert_eq!(of("::ffff:192.0.2.7"), "192.0.2.7");
        assert_eq!(of("192.0.2.7"), "192.0.2.7");
    }
}
