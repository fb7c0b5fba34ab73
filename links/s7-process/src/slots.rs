//! Which callers get a connection when there are not enough.
//!
//! One connection is always kept free for a programming device: the engineer gets in, whatever the panels do. When none
//! is free, a silent one is closed for the new one: first those that never sent a request, then the one silent for
//! longest.

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
    pub(crate) resource: Resource,
    /// It has sent a request.
    pub(crate) works: bool,
    /// It waits for an answer, messages or cyclic data, so its silence means nothing.
    pub(crate) waits: bool,
    /// How long nothing has come from it.
    pub(crate) silent: Duration,
}

impl Occupant {
    fn can_go(&self) -> bool {
        !self.waits && self.silent >= if self.works { SILENT } else { NEVER }
    }
}

/// What happens to a new connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// There is room.
    Free,
    /// There is room when this one is closed.
    InsteadOf(u32),
    /// There is no room.
    Full,
}

/// Whether a new connection for `resource` is accepted.
pub(crate) fn admit(clients: usize, resource: Resource, others: &[Occupant]) -> Verdict {
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
    let candidates =
        others.iter().filter(|other| other.can_go() && (is_pg(resource) || !is_pg(other.resource) || !share_taken));
    candidates.max_by_key(|other| (!other.works, other.silent)).map_or(Verdict::Full, |o| Verdict::InsteadOf(o.number))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn occupant(number: u32, resource: Resource, works: bool, silent_ms: u64) -> Occupant {
        Occupant { number, resource, works, waits: false, silent: Duration::from_millis(silent_ms) }
    }

    #[test]
    fn one_is_kept_for_a_programming_device() {
        let panels: Vec<_> = (0..3).map(|n| occupant(n, Resource::Op, true, 10)).collect();
        assert_eq!(admit(4, Resource::Op, &panels[..2]), Verdict::Free);
        assert_eq!(admit(4, Resource::Op, &panels), Verdict::Full);
        assert_eq!(admit(4, Resource::Basic, &panels), Verdict::Full);
        assert_eq!(admit(4, Resource::Pg, &panels), Verdict::Free);
        let with_pg = [&panels[..], &[occupant(9, Resource::Pg, true, 10)]].concat();
        assert_eq!(admit(4, Resource::Pg, &with_pg), Verdict::Full);
        assert_eq!(admit(1, Resource::Op, &[]), Verdict::Free);
    }

    #[test]
    fn the_silent_ones_go_first_those_who_never_asked() {
        let mut others = vec![
            occupant(1, Resource::Op, true, 50_000),
            occupant(2, Resource::Op, false, 700),
            occupant(3, Resource::Op, true, 90_000),
        ];
        assert_eq!(admit(4, Resource::Op, &others), Verdict::InsteadOf(2));
        others[1].waits = true;
        assert_eq!(admit(4, Resource::Op, &others), Verdict::InsteadOf(3));
        others[2].silent = SILENT - Duration::from_millis(1);
        others[0].silent = Duration::ZERO;
        assert_eq!(admit(4, Resource::Op, &others), Verdict::Full);
        // A panel does not replace the engineer; an engineer may replace the longest silent connection.
        others.push(occupant(4, Resource::Pg, true, 90_000));
        assert_eq!(admit(4, Resource::Op, &others), Verdict::Full);
        assert_eq!(admit(4, Resource::Pg, &others), Verdict::InsteadOf(4));
    }

    /// A thousand silent connections never keep out a working one for long.
    #[test]
    fn a_flood_of_silent_ones_keeps_nobody_out() {
        let silent: Vec<_> = (0..15).map(|n| occupant(n, Resource::Op, false, 500 + u64::from(n))).collect();
        assert_eq!(admit(16, Resource::Op, &silent), Verdict::InsteadOf(14));
    }
}
