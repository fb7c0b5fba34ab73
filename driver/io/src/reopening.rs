//! When a connection that was given up is opened again, and what is reported of a line in trouble. Pure.

use ob1_line::{Instant, RETRY};

/// Most reports of one trouble: the log stays small even if each reason is worded differently.
const MOST: usize = 16;

/// A device that answers with nonsense is called at most once per [`RETRY`], and each report about it comes once.
#[derive(Debug)]
pub(crate) struct Reopening {
    /// The earliest time of the next opening.
    from: Instant,
    /// What has been reported since a station of the line exchanged data.
    told: Vec<String>,
}

impl Reopening {
    pub(crate) const fn new() -> Self {
        Self { from: Instant::START, told: Vec::new() }
    }

    /// The connection is given up: when it may be opened again.
    pub(crate) fn next(&mut self, now: Instant) -> Instant {
        let at = self.from.max(now);
        self.from = at.saturating_add(RETRY);
        at
    }

    /// Whether this is to be reported: always while a station `exchanges` data, otherwise once.
    pub(crate) fn tells(&mut self, exchanges: bool, what: &str) -> bool {
        if exchanges {
            self.told.clear();
        }
        let new = self.told.len() < MOST && !self.told.iter().any(|told| told == what);
        if new {
            self.told.push(what.to_owned());
        }
        new
    }
}

#[cfg(test)]
mod tests {
    use ob1_line::Span;

    use super::*;

    #[test]
    fn a_connection_is_opened_again_at_once_but_not_again_and_again() {
        let mut reopening = Reopening::new();
        let at = |ms| Instant::START + Span::from_millis(ms);
        assert_eq!(reopening.next(at(7)), at(7));
        assert_eq!(reopening.next(at(9)), at(7) + RETRY);
        assert_eq!(reopening.next(at(7) + RETRY), at(7) + 2 * RETRY);
        assert_eq!(reopening.next(at(9000)), at(9000));
    }

    #[test]
    fn each_report_comes_once_until_something_is_exchanged() {
        let mut reopening = Reopening::new();
        let said: Vec<bool> = ["up", "gone", "up", "gone", "other"].map(|what| reopening.tells(false, what)).to_vec();
        assert_eq!(said, [true, true, false, false, true]);
        assert!((0..2).all(|_| reopening.tells(true, "gone")));
        assert!(!reopening.tells(false, "gone") && reopening.tells(false, "up"));
        assert!((0..100).filter(|n| reopening.tells(false, &n.to_string())).count() < MOST);
    }
}
