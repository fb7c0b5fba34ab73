//! Passwords of a link's clients: how long a try waits before it is looked at, so that guessing takes years and nobody
//! is locked out.
//!
//! A try waits by the failures of its own address, alone: the tries of one address wait side by side, those of another
//! do not wait for them. So whoever has the password gets in after [`LONGEST`] at most, whatever strangers do, even
//! from the same address. A machine that is handed the time.

use std::collections::BTreeMap;
use std::net::{IpAddr, SocketAddr};

use ob1_access::door::Ticket;
use ob1_access::partner::network;
use ob1_time::{Instant, Span};

/// The wait after the first wrong password; each further one is twice as long.
const FIRST: Span = Span::from_millis(250);
/// The longest wait: clients commonly give an answer three seconds. Where guessers have all places, the engineer first
/// waits as long for the end of one of their tries, and gets in within five seconds.
pub(crate) const LONGEST: Span = Span::from_millis(2250);
/// Failures of an address are forgotten one by one. The right password ends none of them: whoever shares the address
/// would be free to guess after each honest login.
const FORGET: Span = Span::from_secs(60);
/// Failures beyond these make no difference.
const FAILURES: u32 = 12;
/// Tries of one address that wait at the same time; beyond that they are refused.
const WAITING: usize = 32;
/// Addresses that are remembered; the one that was quiet for longest is forgotten for another.
const ADDRESSES: usize = 4096;

/// The failures of an address.
#[derive(Clone, Copy, Debug)]
struct Failures {
    count: u32,
    /// The last one, or the last that was forgotten.
    last: Instant,
}

/// A try that waits.
#[derive(Debug)]
struct Try {
    address: Option<IpAddr>,
    client: u32,
    ticket: Ticket,
    password: String,
    due: Instant,
}

/// The tries of a link.
#[derive(Debug, Default)]
pub(crate) struct Logins {
    addresses: BTreeMap<Option<IpAddr>, Failures>,
    waiting: Vec<Try>,
}

/// Whose try it is; `None`: a partner without an address.
fn address(partner: &str) -> Option<IpAddr> {
    partner.parse::<SocketAddr>().ok().map(|partner| network(partner.ip()))
}

impl Logins {
    /// A try; false: too many of its address wait already.
    pub(crate) fn begin(&mut self, partner: &str, client: u32, ticket: Ticket, password: String, now: Instant) -> bool {
        let address = address(partner);
        let waiting = self.waiting.iter().filter(|other| other.address == address).count();
        if waiting >= WAITING {
            return false;
        }
        let failures = self.addresses.get_mut(&address).map_or(0, |failures| failures.now(now));
        // Those that wait count: otherwise many at once would be as quick as the first.
        let doubled = (failures + waiting as u32).min(FAILURES);
        let wait = doubled.checked_sub(1).map_or(Span::ZERO, |times| FIRST.times(1 << times).min(LONGEST));
        self.waiting.push(Try { address, client, ticket, password, due: now.saturating_add(wait) });
        true
    }

    /// A try whose wait is over: client, ticket, password.
    pub(crate) fn due(&mut self, now: Instant) -> Option<(u32, Ticket, String)> {
        let index = self.waiting.iter().position(|waits| now >= waits.due)?;
        let Try { client, ticket, password, .. } = self.waiting.remove(index);
        Some((client, ticket, password))
    }

    /// The password was wrong.
    pub(crate) fn failed(&mut self, partner: &str, now: Instant) {
        let address = address(partner);
        if self.addresses.len() >= ADDRESSES && !self.addresses.contains_key(&address) {
            let quiet = self.addresses.iter().min_by_key(|(_, failures)| failures.last).map(|(name, _)| *name);
            quiet.map(|name| self.addresses.remove(&name));
        }
        let failures = self.addresses.entry(address).or_insert(Failures { count: 0, last: now });
        let count = failures.now(now);
        *failures = Failures { count: (count + 1).min(FAILURES), last: now };
    }

    /// The client is gone.
    pub(crate) fn gone(&mut self, client: u32) {
        self.waiting.retain(|waits| waits.client != client);
    }

    /// The process of the link is gone, with all its clients. What their addresses have done stays.
    pub(crate) fn clear(&mut self) {
        self.waiting.clear();
    }

    /// Whether a try waits.
    pub(crate) fn wait(&self) -> bool {
        !self.waiting.is_empty()
    }
}

impl Failures {
    /// Those that are not forgotten.
    fn now(&mut self, now: Instant) -> u32 {
        while self.count > 0 && now - self.last >= FORGET {
            (self.count, self.last) = (self.count - 1, self.last.saturating_add(FORGET));
        }
        self.count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Span = Span::MILLISECOND;

    /// Tries of client 1 at `partner`, one after the other, all wrong; the waits in milliseconds.
    fn guesses(logins: &mut Logins, partner: &str, count: usize, now: &mut Instant) -> Vec<u64> {
        let guess = |_| {
            assert!(logins.begin(partner, 1, 7, "guess".into(), *now));
            let mut wait = 0;
            while logins.due(*now).is_none() {
                (*now, wait) = (*now + MS, wait + 1);
            }
            logins.failed(partner, *now);
            wait
        };
        (0..count).map(guess).collect()
    }

    #[test]
    fn the_wait_grows_with_each_failure_of_an_address_and_of_no_other() {
        let (mut logins, mut now) = (Logins::default(), Instant::START);
        let waits = guesses(&mut logins, "10.0.0.5:1000", 7, &mut now);
        assert_eq!(waits, [0, 250, 500, 1000, 2000, 2250, 2250]);
        assert_eq!(guesses(&mut logins, "[::ffff:10.0.0.5]:2000", 1, &mut now), [2250], "another connection");
        assert_eq!(guesses(&mut logins, "10.0.0.6:1000", 1, &mut now), [0], "another address");
        for (partner, wait) in [("[2001:db8::1]:1", 0), ("[2001:db8::2:3]:1", 250), ("[2001:db8:0:1::1]:1", 0)] {
            assert_eq!(guesses(&mut logins, partner, 1, &mut now), [wait], "{partner}");
        }
        now += FORGET.times(6);
        assert_eq!(guesses(&mut logins, "10.0.0.5:1000", 1, &mut now), [500], "8 failures, 6 of them forgotten");
        now += FORGET.times(20);
        assert_eq!(guesses(&mut logins, "10.0.0.5:1000", 1, &mut now), [0]);
    }

    /// Many that guess at once, from one address or from many; somebody with the right password comes at any time.
    #[test]
    fn nobody_waits_longer_than_the_longest_wait() {
        for of_one in [true, false] {
            let (mut logins, mut now) = (Logins::default(), Instant::START);
            let partner = |client: u32| format!("10.0.{}.1:{client}", if of_one { 0 } else { client });
            let (mut tries, mut since) = (0, None);
            for step in 0..60_000_u32 {
                for client in 1..=24 {
                    if !logins.waiting.iter().any(|waits| waits.client == client) {
                        assert!(logins.begin(&partner(client), client, 0, "guess".into(), now));
                    }
                }
                if since.is_none() && step % 997 == 0 {
                    let honest = if of_one { partner(1) } else { "10.1.0.1:1".to_owned() };
                    assert!(logins.begin(&honest, 99, 0, "secret".into(), now));
                    since = Some(now);
                }
                while let Some((client, ..)) = logins.due(now) {
                    if client == 99 {
                        let waited = since.take().map(|since| now - since);
                        assert!(waited <= Some(if of_one { LONGEST } else { Span::ZERO }), "{waited:?}");
                    } else {
                        tries += 1;
                        logins.failed(&partner(client), now);
                    }
                }
                now += MS;
            }
            assert!(tries < 24 * 60 / 2, "{tries} in a minute");
        }
    }

    #[test]
    fn what_is_kept_is_bounded() {
        let (mut logins, mut now) = (Logins::default(), Instant::START);
        let begin = |logins: &mut Logins, client| logins.begin("10.0.0.5:1", client, 0, String::new(), now);
        assert_eq!((0..100).filter(|client| begin(&mut logins, *client)).count(), WAITING);
        logins.gone(5);
        assert!(begin(&mut logins, 5) && logins.wait());
        logins.clear();
        assert!(!logins.wait());
        for number in 0..2 * ADDRESSES as u32 {
            logins.failed(&format!("10.1.{}.{}:1", number >> 8, number & 255), now);
            now += MS;
        }
        assert_eq!(logins.addresses.len(), ADDRESSES);
    }
}
