//! The contract between a protocol and its caller: inputs, outputs, time.

pub use ob1_serial::{Instant, LineFault, LineInput, ModemLines, Span, Wire};

use crate::modbus::failure::Failure;

/// The span of one millisecond.
pub const MS: Span = Span::MILLISECOND;

/// The span of one second.
pub const SECOND: Span = Span::SECOND;

/// Longest telegram of the CP 240, bytes of user data: its send and receive buffers hold 1024 bytes. [S0 "Properties"]
pub const TELEGRAM_MAX: usize = 1024;

/// The earliest of these times; [`Instant::NEVER`] counts as none. Asked after each character.
pub(crate) fn earliest<const N: usize>(times: [Option<Instant>; N]) -> Option<Instant> {
    let first = times.into_iter().fold(Instant::NEVER, |first, time| first.min(time.unwrap_or(Instant::NEVER)));
    (first != Instant::NEVER).then_some(first)
}

/// A serial protocol.
///
/// Laws for the caller:
/// * `now` never goes backwards.
/// * When the returned deadline is reached, call with [`Input::Tick`]. A call before it is harmless. An input that
///   arrives at or after the deadline, without a tick before it, counts as in time: a late caller causes no false
///   time-outs.
/// * `None` means: only an input can change anything.
/// * When [`Sink::room`] grows (the CPU has taken a telegram), call with [`Input::Tick`].
///
/// The work of one step is bounded by the bytes handed in plus one telegram.
pub trait Machine {
    /// Takes one input at time `now`; returns the next deadline.
    ///
    /// The very first step must be a [`Input::Tick`]: some CPs put a character on the line when they start.
    fn step(&mut self, now: Instant, input: Input<'_>, out: &mut dyn Sink) -> Option<Instant>;

    /// Whether an order is running, that is, accepted and not yet answered by [`Sink::sent`].
    fn busy(&self) -> bool;

    /// Whether the running order waits because the partner has stopped this side by flow control.
    fn is_stopped(&self) -> bool {
        false
    }
}

/// What happened. `O`: the orders that the CPU can give this protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input<'a, O = Order<'a>> {
    /// Time has passed, or the receive buffer has become free; nothing else.
    Tick,
    /// Something happened on the line.
    Line(LineInput<'a>),
    /// The CPU gives an order.
    Order(O),
}

impl<'a> Input<'a> {
    /// The same input for a protocol with orders of its own: `abort` is its [`Order::Abort`]. A telegram to send is not
    /// among its orders and becomes a tick.
    pub fn with_orders<O>(self, abort: O) -> Input<'a, O> {
        match self {
            Self::Tick | Self::Order(Order::Send(_)) => Input::Tick,
            Self::Line(line) => Input::Line(line),
            Self::Order(Order::Abort) => Input::Order(abort),
        }
    }
}

/// An order of the CPU; one send at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order<'a> {
    /// Send this telegram. The machine copies it. Its end is reported by [`Sink::sent`], exactly once per order.
    ///
    /// While an order is running a second one is answered at once with [`SendError::Busy`]; the first continues.
    Send(&'a [u8]),
    /// Drop the running order (if any: [`Sink::sent`] with [`SendError::Aborted`]) and the telegram being received, and
    /// go back to idle. Used for the RESET of the CPU and for new parameters.
    Abort,
}

/// Where a machine puts its results, besides output to the line. Called only inside [`Machine::step`].
pub trait Sink: Wire {
    /// Maximum length of a received telegram now, in bytes; 0: no receive buffer is free.
    fn room(&self) -> usize;

    /// A telegram is complete and, if the protocol acknowledges, acknowledged. Never longer than [`Sink::room`] was
    /// just before, never empty.
    fn deliver(&mut self, telegram: &[u8]);

    /// ASCII-fragmented: the next part of a telegram, at most 12 bytes and never longer than [`Sink::room`] was just
    /// before. Empty only when a telegram ends or breaks off after parts that have been handed over.
    fn part(&mut self, bytes: &[u8], part: Part) {
        let _ = part;
        if !bytes.is_empty() {
            self.deliver(bytes);
        }
    }

    /// The running order has ended, or a second one was refused as [`SendError::Busy`].
    fn sent(&mut self, outcome: Result<(), SendError>);

    /// Something worth the LED `ER`, a diagnostic entry or a line of the trace.
    fn report(&mut self, event: Event);

    /// Sets the baud rate from now on, in both directions (M-Bus: each telegram names its own).
    fn baud(&mut self, baud: u32) {
        let _ = baud;
    }
}

/// What follows a part of a telegram.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Part {
    /// More of it, or its end.
    More,
    /// Nothing: the telegram is complete.
    Last,
    /// Nothing: the rest is lost.
    Broken,
}

/// Why an order failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SendError {
    /// The partner did not answer within QVZ (ASCII: did not release the flow control).
    AckDelay,
    /// The partner refused (NAK) until the permitted repetitions were used up.
    Repetitions,
    /// The partner's answer was invalid, or the line broke off, until the repetitions were used up.
    Frame,
    /// The telegram is longer than the machine's buffer; nothing was sent.
    TooLong,
    /// Modbus master: it is no request, or one that cannot be a broadcast; nothing was sent.
    NoRequest,
    /// ASCII with end characters: none in the telegram, or no room to append them; nothing was sent. (CP 341)
    NoEnd,
    /// Automatic use of the secondary signals: DSR or CTS is OFF. (CP 341)
    Signals,
    /// Dropped by the owner with [`Order::Abort`].
    Aborted,
    /// Another order is running; this one was not taken.
    Busy,
}

impl SendError {
    /// The CP's error code for the CPU. [S0 "Content and structure of the indicator word ANZW"]
    ///
    /// 07h acknowledgement delay, 0Ah repetitions exceeded, 0Ch frame error, 17h too long, 00h re-initialised.
    pub fn code(self) -> u8 {
        match self {
            Self::AckDelay | Self::Signals => 0x07,
            Self::Repetitions => 0x0A,
            Self::Frame | Self::NoRequest => 0x0C,
            Self::TooLong | Self::NoEnd => 0x17,
            Self::Aborted | Self::Busy => 0x00,
        }
    }
}

impl From<Failure> for SendError {
    /// Without an answer as if not acknowledged, otherwise a frame error.
    fn from(failure: Failure) -> Self {
        match failure {
            Failure::NoData => Self::AckDelay,
            _ => Self::Frame,
        }
    }
}

/// An occurrence: what the machine was doing, and what happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Event {
    /// What the machine was doing.
    pub phase: Phase,
    /// What happened while it did.
    pub what: What,
}

/// What a machine is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Nothing: neither an order nor a telegram.
    Idle,
    /// Setting up a connection: STX is out, the answer is awaited.
    Connect,
    /// Characters of a telegram are being sent.
    Output,
    /// The telegram has been sent, its acknowledgement is awaited.
    Acknowledge,
    /// A telegram is being received.
    Receive,
}

/// What happened in a [`Phase`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// A character that has no meaning here.
    Unexpected(u8),
    /// The partner sent NAK.
    Nak,
    /// The partner did not answer within QVZ, or did not release the flow control in time.
    AckDelay,
    /// Both partners wanted to send at the same time; `yielded` tells whether this side gave way.
    Conflict {
        /// This side has low priority and receives first.
        yielded: bool,
    },
    /// The n-th repetition begins (1 = the first).
    Repetition(u16),
    /// All permitted repetitions are used up; the order fails.
    Exhausted,
    /// ZVZ ran out within a telegram.
    CharacterDelay,
    /// DLE was followed by a character that is neither DLE nor ETX.
    BadDle(u8),
    /// The block check character differs.
    BadCheck {
        /// Computed from what came in.
        computed: u8,
        /// The block check character that came in.
        received: u8,
    },
    /// No receive buffer is free, or the telegram is longer than what is free of it.
    NoBuffer,
    /// A telegram is longer than the longest that the buffer can hold.
    TooLong,
    /// A telegram began before the previous one had ended, which is lost.
    Restarted,
    /// A telegram without user data; acknowledged, not delivered.
    Empty,
    /// A telegram was refused for the n-th time; its repetition is awaited (CP 341).
    Refused(u16),
    /// The partner did not repeat a refused telegram in time (CP 341).
    NoRepetition,
    /// The partner repeats a telegram more often than permitted (CP 341).
    OneMoreRepetition,
    /// A fault of the line itself.
    Line(LineFault),
    /// Automatic use of the secondary signals: DSR or CTS is OFF. (CP 341)
    Signals,
    /// Modbus: no valid telegram.
    Modbus(Failure),
}

impl Event {
    /// Number in the event classes 7 (send) and 8 (receive) of the 3964(R) and ASCII driver; `None` if they have no
    /// number for it. (docs/cp341-events.md)
    pub fn number(self) -> Option<u16> {
        use Phase::{Acknowledge, Connect, Output};
        const DLE: u8 = 0x10;
        Some(match (self.what, self.phase) {
            (What::Repetition(1), _) => 0x0701,
            (What::Unexpected(_) | What::Nak, Connect) => 0x0702,
            (What::AckDelay, Connect) => 0x0703,
            // A DLE that comes too early is meant for the end of the telegram.
            (What::Unexpected(DLE), Output) => 0x0706,
            (What::Unexpected(_), Output) => 0x0704,
            (What::Nak, Output) => 0x0705,
            (What::Unexpected(_) | What::Nak, Acknowledge) => 0x0706,
            (What::AckDelay, Acknowledge) => 0x0707,
            (What::AckDelay, _) => 0x0708,
            (What::Exhausted, Connect) => 0x0709,
            // The fault of the telegram has been reported; giving it up has no number.
            (What::Exhausted, Phase::Receive) => return None,
            (What::Exhausted, _) => 0x070A,
            (What::Refused(1), _) => 0x0801,
            (What::Unexpected(_), _) => 0x0802,
            (What::BadDle(_), _) => 0x0805,
            (What::CharacterDelay | What::Restarted, _) => 0x0806,
            (What::BadCheck { .. }, _) => 0x0808,
            (What::NoBuffer, _) => 0x080A,
            (What::Line(LineFault::Parity | LineFault::Framing | LineFault::Overrun), _) => 0x080C,
            (What::Line(LineFault::Break), _) => 0x080D,
            (What::NoRepetition | What::OneMoreRepetition, _) => 0x0815,
            (What::TooLong, _) => 0x0816,
            (What::Signals, _) => 0x0818,
            _ => return None,
        })
    }

    /// Whether the LED `ER` lights for 4 s: open circuit, overflow, parity and framing errors. [S0 "LEDs"]
    pub fn lights_er(self) -> bool {
        match self.what {
            What::NoBuffer | What::TooLong => true,
            What::Line(fault) => fault != LineFault::Back,
            _ => false,
        }
    }
}
