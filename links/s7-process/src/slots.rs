//! Which callers get a connection when there are not enough.
//!
//! One connection is always kept free for a programming device: the engineer gets in, whatever the panels do. When none
//! is free, one is closed for the new one: a silent one, first those that never sent a request, then the one silent for
//! longest; one that has guessed at the password; one of the address that has most, if the caller's has fewer. So a
//! host that calls often cannot keep the others out.

use std::net::IpAddr;
use std::time::Duration;

use ob1_s7::iso::Resource;

/// A connection that never sent a request may be closed after this time,
const NEVER: Duration = Duration::from_millis(500);
/// and one that did after this time.
const SILENT: Duration = Duration::from_secs(30);

/// A connection that is served.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Occupant {
    pub(crate) number: u32,
    pub(crate) address: IpAddr,
    pub(crate) resource: Resource,
    /// It has sent a request.
    pub(crate) works: bool,
    /// It waits for an answer, messages or cyclic data, so its silence means nothing.
    pub(crate) waits: bool,
    /// It has given a wrong password, and not the right one since.
    pub(crate) guesses: bool,
    /// How long nothing has come from it.
    pub(crate) silent: Duration,
}

impl Occupant {
    fn can_go(&self) -> bool {
        // A next try is no reason to stay: otherwise whoever guesses keeps his place by guessing.
        self.guesses || !self.waits && self.silent >= if self.works { SILENT } else { NEVER }
    }
}

/// What happens to a new connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// There is room for it.
    Free,
    /// There is room when this one is closed.
    InsteadOf(u32),
    /// There is no room.
    Full,
}

/// How many of them this address has.
pub(crate) fn of(address: IpAddr, others: &[Occupant]) -> usize {
    others.iter().filter(|other| other.address == address).count()
}

/// Whether a new connection for `resource` of this address is accepted.
pub(crate) fn admit(clients: usize, resource: Resource, address: IpAddr, others: &[Occupant]) -> Verdict {
    let is_pg = |resource| resource == Resource::Pg;
    let not_pg = others.iter().filter(|other| !is_pg(other.resource)).count();
    // A link for one client reserves nothing, otherwise only a programming device could connect.
    let kept = usize::from(clients > 1);
    let all_taken = others.len() >= clients;
    let share_taken = !is_pg(resource) && not_pg + kept >= clients;
    if !all_taken && !share_taken {
        return Verdict::Free;
    }
    // A caller limited to the shared part replaces a connection there.
    let candidates: Vec<_> =
        others.iter().filter(|other| is_pg(resource) || !is_pg(other.resource) || !share_taken).copied().collect();
    let silent = candidates.iter().filter(|other| other.can_go());
    let silent = silent.max_by_key(|other| (!other.works, other.guesses, other.silent));
    // Two fewer: otherwise both would replace each other's again and again.
    let own = of(address, &candidates) + 2;
    let shared = candidates.iter().filter(|other| of(other.address, &candidates) >= own);
    let shared = shared.max_by_key(|other| (of(other.address, &candidates), other.guesses, other.silent));
    silent.or(shared).map_or(Verdict::Full, |other| Verdict::InsteadOf(other.number))
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use super::*;

    fn at(host: u8) -> IpAddr {
        Ipv4Addr::new(10, 0, 0, host).into()
    }

    /// Each at an address of its own.
    fn occupant(number: u32, resource: Resource, works: bool, silent_ms: u64) -> Occupant {
        let (address, silent) = (at(number as u8), Duration::from_millis(silent_ms));
        Occupant { number, address, resource, works, waits: false, guesses: false, silent }
    }

    /// A caller from another address.
    fn call(clients: usize, resource: Resource, others: &[Occupant]) -> Verdict {
        admit(clients, resource, at(200), others)
    }

    #[test]
    fn one_is_kept_for_a_programming_device() {
        let panels: Vec<_> = (0..3).map(|n| occupant(n, Resource::Op, true, 10)).collect();
        assert_eq!(call(4, Resource::Op, &panels[..2]), Verdict::Free);
        assert_eq!(call(4, Resource::Op, &panels), Verdict::Full);
        assert_eq!(call(4, Resource::Basic, &panels), Verdict::Full);
        assert_eq!(call(4, Resource::Pg, &panels), Verdict::Free);
        let with_pg = [&panels[..], &[occupant(9, Resource::Pg, true, 10)]].concat();
        assert_eq!(call(4, Resource::Pg, &with_pg), Verdict::Full);
        assert_eq!(call(1, Resource::Op, &[]), Verdict::Free);
    }

    #[test]
    fn the_silent_ones_go_first_those_who_never_asked() {
        let mut others = vec![
            occupant(1, Resource::Op, true, 50_000),
            occupant(2, Resource::Op, false, 700),
            occupant(3, Resource::Op, true, 90_000),
        ];
        assert_eq!(call(4, Resource::Op, &others), Verdict::InsteadOf(2));
        others[1].waits = true;
        assert_eq!(call(4, Resource::Op, &others), Verdict::InsteadOf(3));
        others[2].silent = SILENT - Duration::from_millis(1);
        others[0].silent = Duration::ZERO;
        assert_eq!(call(4, Resource::Op, &others), Verdict::Full);
        // A panel does not replace the engineer; an engineer may replace the longest silent connection.
        others.push(occupant(4, Resource::Pg, true, 90_000));
        assert_eq!(call(4, Resource::Op, &others), Verdict::Full);
        assert_eq!(call(4, Resource::Pg, &others), Verdict::InsteadOf(4));
    }

    /// A thousand silent connections never keep out a working one for long.
    #[test]
    fn a_flood_of_silent_ones_keeps_nobody_out() {
        let silent: Vec<_> = (0..15).map(|n| occupant(n, Resource::Op, false, 500 + u64::from(n))).collect();
        assert_eq!(call(16, Resource::Op, &silent), Verdict::InsteadOf(14));
    }

    /// Whoever reads five times a second on all connections there are, does not keep the others out; they do not drive
    /// each other out either.
    #[test]
    fn one_host_does_not_keep_the_others_out() {
        let host = |number| Occupant { address: at(1), ..occupant(number, Resource::Pg, true, number.into()) };
        let mut others: Vec<_> = (0..16).map(host).collect();
        assert_eq!(admit(16, Resource::Pg, at(1), &others), Verdict::Full, "its own calls");
        // A panel takes the place of one of them; the kept place is a programming device's.
        for panel in 100..107 {
            let Verdict::InsteadOf(number) = admit(16, Resource::Op, at(100), &others) else { panic!("{others:?}") };
            others.retain(|other| other.number != number);
            others.push(Occupant { address: at(100), ..occupant(panel, Resource::Op, true, 0) });
        }
        assert_eq!((of(at(1), &others), of(at(100), &others)), (9, 7));
        for panel in 107..109 {
            let verdict = admit(16, Resource::Op, at(100), &others);
            others.retain(|other| verdict != Verdict::InsteadOf(other.number));
            others.push(Occupant { address: at(100), ..occupant(panel, Resource::Op, true, 0) });
            others.truncate(16);
        }
        for address in [at(1), at(100)] {
            assert_eq!(admit(16, Resource::Pg, address, &others), Verdict::Full, "{address}: as many as the other");
        }
    }

    #[test]
    fn whoever_guesses_makes_room() {
        let mut others: Vec<_> = (0..16).map(|n| occupant(n, Resource::Pg, true, 10)).collect();
        others[5].guesses = true;
        assert_eq!(call(16, Resource::Op, &others), Verdict::InsteadOf(5));
        others[5].waits = true;
        assert_eq!(call(16, Resource::Op, &others), Verdict::InsteadOf(5), "also while it tries again");
        others[5].guesses = false;
        assert_eq!(call(16, Resource::Op, &others), Verdict::Full, "its first try");
    }
}
