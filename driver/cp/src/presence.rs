//! Whether the firmware knows that the line is there: at power-on a line may come a moment later than the CP (a USB
//! adapter, the process of a simulated line), and that is no wire break.

use ob1_firmware::{Instant, Span};

/// A line that has never been there is a wire break after this time (ours).
pub const ARRIVAL: Span = Span::from_secs(5);

/// What the firmware must be told of the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// It has not been there yet.
    NotYet,
    /// It is gone, or does not come.
    Gone,
    /// The line is there, or there again.
    Back,
}

/// What the firmware has been told of the line.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Presence {
    /// Nothing: it counts as there.
    #[default]
    Untold,
    /// The line is there, and the firmware knows it.
    There,
    /// It has not been there yet; it is a wire break at this time.
    NotYet(Instant),
    /// The line is gone or never came: a wire break.
    Gone,
}

impl Presence {
    /// The line cannot be used; returns what the firmware must be told.
    pub fn absent(&mut self, now: Instant) -> Option<Change> {
        match *self {
            Self::Untold => {
                *self = Self::NotYet(now + ARRIVAL);
                Some(Change::NotYet)
            }
            Self::NotYet(until) if now < until => None,
            Self::Gone => None,
            Self::There | Self::NotYet(_) => {
                *self = Self::Gone;
                Some(Change::Gone)
            }
        }
    }

    /// The line can be used; returns what the firmware must be told.
    pub fn present(&mut self) -> Option<Change> {
        let before = std::mem::replace(self, Self::There);
        matches!(before, Self::NotYet(_) | Self::Gone).then_some(Change::Back)
    }

    /// When [`Self::absent`] must be called again.
    pub const fn deadline(&self) -> Option<Instant> {
        match *self {
            Self::NotYet(until) => Some(until),
            Self::Untold | Self::There | Self::Gone => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_that_comes_a_moment_later_was_not_gone() {
        let mut line = Presence::default();
        let start = Instant::from_secs(1);
        assert_eq!(line.absent(start), Some(Change::NotYet));
        assert_eq!(line.absent(start + Span::SECOND), None);
        assert_eq!((line.present(), line.present()), (Some(Change::Back), None));
        assert_eq!(line.deadline(), None);
        assert_eq!(
            (line.absent(start + Span::SECOND), line.absent(start + 2 * Span::SECOND)),
            (Some(Change::Gone), None)
        );
        assert_eq!(line.present(), Some(Change::Back));
    }

    #[test]
    fn a_line_that_never_comes_is_a_wire_break_in_the_end() {
        let mut line = Presence::default();
        assert_eq!(line.absent(Instant::START), Some(Change::NotYet));
        assert_eq!(line.deadline(), Some(Instant::START + ARRIVAL));
        assert_eq!(line.absent(Instant::START + ARRIVAL), Some(Change::Gone));
        assert_eq!((line.absent(Instant::from_secs(99)), line.deadline()), (None, None));
    }

    #[test]
    fn a_line_that_is_there_at_once_needs_no_word() {
        let mut line = Presence::default();
        assert_eq!(line.present(), None);
        assert_eq!(line.absent(Instant::START), Some(Change::Gone));
    }
}
