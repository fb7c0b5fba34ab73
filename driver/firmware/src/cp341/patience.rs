//! How long something waits for P_RCV_RK, and when that is reported. [TIA help "PtP data link CP 341"]

use ob1_protocols::{Instant, Span};

/// "Temporarily": the CPU is slower than this. (ours)
const SLOW: Span = Span::from_secs(1);

/// "Given up after repeated attempts for 10 s." (0409h)
const GIVEN_UP: Span = Span::from_secs(10);

/// Watches one item at a time: the oldest.
#[derive(Debug, Default)]
pub(crate) struct Patience {
    /// Since when the CPU has made no progress, and the number at that time.
    since: Option<(Instant, u32)>,
    /// The next number to report, and after how long.
    next: Option<(Span, u16)>,
}

impl Patience {
    /// `waits` is `None` if nothing waits; otherwise its number changes when the CPU makes progress. With `is_watched`
    /// something else gives up the wait. Returns an event number, each once per wait.
    pub(crate) fn look(&mut self, now: Instant, waits: Option<u32>, is_watched: bool) -> Option<u16> {
        if self.since.map(|(_, moves)| moves) != waits {
            self.since = waits.map(|moves| (now, moves));
            self.next = waits.map(|_| (SLOW, 0x0408));
        }
        let (since, _) = self.since?;
        let (after, number) = self.next.filter(|(after, _)| now >= since + *after)?;
        self.next = (after == SLOW && !is_watched).then_some((GIVEN_UP, 0x0409));
        Some(number)
    }

    /// When [`Patience::look`] is due.
    pub(crate) fn deadline(&self) -> Option<Instant> {
        Some(self.since?.0 + self.next?.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_number_once_and_anew_when_the_cpu_moves() {
        let mut patience = Patience::default();
        let mut told = Vec::new();
        let moves = |ms| {
            if ms < 20_000 {
                Some(0)
            } else if ms < 20_900 {
                Some(1)
            } else {
                None
            }
        };
        for ms in 0..40_000_u64 {
            told.extend(patience.look(Instant::from_millis(ms), moves(ms), false).map(|number| (ms, number)));
        }
        assert_eq!(told, [(1_000, 0x0408), (10_000, 0x0409)]);
        assert_eq!(patience.deadline(), None);
        assert_eq!(patience.look(Instant::from_millis(50_000), Some(1), true), None);
        assert_eq!(patience.deadline(), Some(Instant::from_millis(51_000)));
        assert_eq!(patience.look(Instant::from_millis(51_000), Some(1), true), Some(0x0408));
        assert_eq!((patience.look(Instant::from_millis(70_000), Some(1), true), patience.deadline()), (None, None));
    }
}
