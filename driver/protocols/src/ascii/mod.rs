//! ASCII: bare characters; nothing is acknowledged, nothing checked. A telegram ends when the line falls silent, and
//! at a CP 341 also with end characters or after a number of characters.
//!
//! [S0 "ASCII"], [S0 "ASCII-fragmented"], [S0 "Parameter description"],
//! [TIA help "Configuration for point-to-point links"]. Sending and receiving are independent of each other (full
//! duplex). An order is done when ZNA has run out after the last bit.
//!
//! Flow control: XON/XOFF or RTS/CTS. The partner's XOFF (CTS OFF) stops the output; an order that waits longer than
//! [`Config::flow_wait`] fails. This side stops the partner while no receive buffer is free. In XON/XOFF mode the two
//! characters never belong to a telegram.
//!
//! Features of a CP 341 that a CP 240 does not have are configuration: the other criteria, the pause between telegrams,
//! the automatic use of the RS 232C secondary signals.

mod receive;

use crate::duplex::Duplex;
pub use crate::flow::{Flow, XOFF, XON};
use crate::machine::{Span, TELEGRAM_MAX};
pub use crate::output::Flags;
use crate::output::{Extent, Rules};
use crate::signals::Times;
pub use receive::Receive;

/// Bytes in a block of ASCII-fragmented: one exchange over the back plane carries as many.
pub const FRAGMENT: usize = 12;

/// What ends a received telegram. [TIA help "Configuration for point-to-point links"]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Criterion {
    /// A silence of ZVZ.
    Silence,
    /// ZVZ; each 12 bytes are passed on as they come, the rest with the end. [S0 "ASCII-fragmented"]
    Fragments,
    /// One or two end characters; they belong to the telegram.
    Characters {
        /// The end characters, one or two.
        end: Flags,
        /// How they affect a telegram that is sent.
        sending: Sending,
    },
    /// This number of characters.
    Length(usize),
}

/// Which part of a telegram is sent when telegrams end with end characters.
/// [TIA help "Configuration for point-to-point links"]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sending {
    /// Everything up to and including the first end characters; without them the order fails.
    Through,
    /// Everything, whatever it contains.
    Whole,
    /// Everything, followed by the end characters; the order fails when the buffer does not hold both.
    Appended,
}

/// Configuration of [`Ascii`]. Times in nanoseconds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Config {
    /// What ends a telegram.
    pub criterion: Criterion,
    /// Who may stop the sender, and how.
    pub flow: Flow,
    /// ZNA: from the last bit of a telegram to the end of its order.
    pub zna: Span,
    /// From the last bit of a telegram to the first of the next. The order ends before this pause. (CP 341)
    pub pause: Span,
    /// ZVZ: silence that ends a telegram; 0: two character times.
    pub zvz: Span,
    /// Time of one character on the line.
    pub char_time: Span,
    /// Longest time that an order waits for XON or CTS; 0: forever. The manual names none; 20 s as the reference does
    /// for the CP 341.
    pub flow_wait: Span,
    /// Automatic use of the secondary signals; not together with [`Flow::Hardware`]. [S4 L803]
    pub signals: Option<Times>,
}

impl Config {
    /// Nothing set: no times, no flow control, telegrams end with silence. The defaults of the parameters are in
    /// `ob1-params`.
    pub const fn unset(char_time: Span) -> Self {
        Self {
            criterion: Criterion::Silence,
            flow: Flow::None,
            zna: Span::ZERO,
            pause: Span::ZERO,
            zvz: Span::ZERO,
            char_time,
            flow_wait: Span::from_secs(20),
            signals: None,
        }
    }

    /// [S0 "Character delay time (ZVZ)"]: 0: about double character time.
    fn zvz(&self) -> Span {
        if self.zvz.is_zero() { 2 * self.char_time } else { self.zvz }
    }

    fn rules(&self) -> Rules {
        let (extent, end) = match self.criterion {
            Criterion::Characters { end, sending: Sending::Through } => (Extent::Through(end), Flags::NONE),
            Criterion::Characters { end, sending: Sending::Appended } => (Extent::Appended, end),
            _ => (Extent::Whole, Flags::NONE),
        };
        Rules {
            start: Flags::NONE,
            end,
            flow: self.flow,
            zna: self.zna,
            char_time: self.char_time,
            flow_wait: self.flow_wait,
            extent,
            pause: self.pause,
            signals: self.signals,
        }
    }
}

/// The ASCII procedure with a send and a receive buffer of `N` bytes each.
pub type Ascii<const N: usize = TELEGRAM_MAX> = Duplex<Receive<N>, N>;

impl<const N: usize> Ascii<N> {
    /// A machine before its first step.
    pub fn new(config: &Config) -> Self {
        Duplex::of(config.rules(), Receive::new(config.criterion, config.zvz()))
    }
}
