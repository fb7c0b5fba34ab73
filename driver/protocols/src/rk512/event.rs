//! Faults, with the error number for the partner and the event number for the own side.

use super::codec::Malformed;
use crate::machine::{self, SendError};

/// Error numbers of a reaction (REATEL). (docs/cp341-events.md)
pub mod code {
    /// All is well: the order goes on or has ended.
    pub const OK: u8 = 0x00;
    /// The area cannot be accessed.
    pub const NO_ACCESS: u8 = 0x0A;
    /// Coordination flag or CPU number not allowed.
    pub const FLAG: u8 = 0x0C;
    /// First or fourth byte wrong: no such area.
    pub const AREA: u8 = 0x10;
    /// The request type is not supported.
    pub const TYPE: u8 = 0x12;
    /// DB missing or too short, number, start or length not allowed.
    pub const RANGE: u8 = 0x14;
    /// Third byte wrong: no such command.
    pub const COMMAND: u8 = 0x16;
    /// The station is in STOP, or no program there takes the order.
    pub const STOP: u8 = 0x2A;
    /// Locked by the coordination flag. [S0 "Coordination flags"]
    pub const LOCKED: u8 = 0x32;
    /// The telegram's length does not match the length in its header.
    pub const LENGTH: u8 = 0x34;
    /// Telegrams out of order.
    pub const SEQUENCE: u8 = 0x36;
}

/// Why an order of the partner is refused. (docs/cp341-events.md)
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Refusal {
    /// 1st byte neither 00h nor FFh, or 2nd not 00h.
    FirstByte,
    /// 3rd byte none of A, O, E.
    Command,
    /// 3rd byte of a follow-on telegram differs from the first telegram's.
    FollowCommand,
    /// 4th byte wrong, or not allowed with this command.
    Area,
    /// 4th byte of a follow-on telegram differs.
    FollowArea,
    /// DB number not allowed.
    DbNumber,
    /// The header says length 0.
    Length,
    /// Longer than the CP's buffer.
    TooLong,
    /// Coordination flag not allowed.
    Flag,
    /// CPU number not allowed.
    Cpu,
    /// First telegram of a SEND whose data do not match the header: fewer, more, none, or more than 128 bytes.
    SendLength,
    /// Follow-on telegram of a SEND whose data do not match the announced length: fewer or more than are missing, none,
    /// or more than 128 bytes.
    FollowLength,
    /// A FETCH brings data.
    FetchData,
    /// No program takes it: the CPU is in STOP, or does not answer in time.
    Mode,
    /// A follow-on telegram instead of a first one, or the other way round, or before our reaction.
    Sequence,
    /// Shorter than 4 bytes, or than the 10 of a header.
    Short,
}

impl Refusal {
    /// All refusals, each once.
    pub const ALL: [Self; 16] = [
        Self::FirstByte,
        Self::Command,
        Self::FollowCommand,
        Self::Area,
        Self::FollowArea,
        Self::DbNumber,
        Self::Length,
        Self::TooLong,
        Self::Flag,
        Self::Cpu,
        Self::SendLength,
        Self::FollowLength,
        Self::FetchData,
        Self::Mode,
        Self::Sequence,
        Self::Short,
    ];

    /// Event number here and error number in the reaction. (docs/cp341-events.md)
    const fn numbers(self) -> (u16, u8) {
        match self {
            Self::FirstByte => (0x0601, code::AREA),
            Self::Command => (0x0602, code::COMMAND),
            Self::FollowCommand => (0x0603, code::COMMAND),
            Self::Area => (0x0604, code::AREA),
            Self::FollowArea => (0x0605, code::AREA),
            Self::DbNumber => (0x0606, code::RANGE),
            Self::Length | Self::TooLong => (0x0608, code::RANGE),
            Self::Flag => (0x0609, code::FLAG),
            Self::Cpu => (0x060A, code::FLAG),
            Self::SendLength => (0x060B, code::LENGTH),
            Self::FollowLength => (0x0611, code::LENGTH),
            Self::FetchData => (0x060C, code::LENGTH),
            Self::Mode => (0x060D, code::STOP),
            Self::Sequence => (0x060E, code::SEQUENCE),
            Self::Short => (0x0610, code::LENGTH),
        }
    }

    /// Event number, class 6. (docs/cp341-events.md)
    pub const fn number(self) -> u16 {
        self.numbers().0
    }

    /// Error number in the reaction.
    pub const fn code(self) -> u8 {
        self.numbers().1
    }
}

impl From<Malformed> for Refusal {
    fn from(malformed: Malformed) -> Self {
        match malformed {
            Malformed::Short => Self::Short,
            Malformed::FirstBytes | Malformed::ReactionBytes => Self::FirstByte,
            Malformed::CommandLetter => Self::Command,
            Malformed::AreaLetter => Self::Area,
        }
    }
}

/// The fault of a reaction of the partner. (docs/cp341-events.md)
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BadReaction {
    /// Without an order, before our telegram was sent, or to another kind of telegram than ours.
    Sequence,
    /// Its first bytes are wrong, or it is too short.
    Structure,
    /// Too many or too few data.
    Data,
    /// Data in the reaction to a SEND.
    SendData,
}

impl BadReaction {
    /// Event number, class 10.
    pub const fn number(self) -> u16 {
        match self {
            Self::Sequence => 0x0A01,
            Self::Structure => 0x0A02,
            Self::Data => 0x0A03,
            Self::SendData => 0x0A04,
        }
    }
}

/// Why an own order failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum OrderError {
    /// A telegram could not be sent.
    Line(SendError),
    /// The partner refuses, with this error number. (docs/cp341-events.md)
    Rejected(u8),
    /// The partner refuses with 14h: an area other than a data block is missing or too short.
    NoArea,
    /// No reaction within the monitoring time.
    NoReaction,
    /// No reaction within BWZ, and the telegram has been sent DBL times.
    BwzExceeded,
    /// The reaction is not valid, or not the one to this order.
    BadReaction(BadReaction),
    /// Longer than the buffer; nothing was sent.
    TooLong,
    /// Without data, or its data do not match its header; nothing was sent.
    Invalid,
    /// Dropped by the owner with [`Order::Abort`](super::Order::Abort).
    Aborted,
    /// Another order is running; this one was not taken.
    Busy,
}

impl OrderError {
    /// The byte for the indicator word of the CP 240: the CP's error or the partner's error number.
    /// [S0 "Content and structure of the indicator word ANZW"]
    pub fn code(self) -> u8 {
        match self {
            Self::Line(error) => error.code(),
            Self::Rejected(code) => code,
            Self::NoArea => code::RANGE,
            Self::NoReaction => 0x07, // "The message was not acknowledged within the acknowledgement delay time."
            Self::BwzExceeded => 0x0A, // "The number of block repetitions .. was exceeded."
            Self::BadReaction(_) | Self::Invalid => 0x0C,
            Self::TooLong => 0x17,
            Self::Aborted | Self::Busy => 0x00,
        }
    }

    /// Event number: classes 5, 9 and 10 (those of the line have been reported before). (docs/cp341-events.md)
    pub const fn number(self) -> Option<u16> {
        Some(match self {
            Self::Line(_) => 0x051A,
            Self::Rejected(code) => rejected(code),
            // The error number is the same for each area; whoever has asked knows which one. (docs/cp341-events.md)
            Self::NoArea => 0x0902,
            Self::NoReaction | Self::BwzExceeded => 0x0A05,
            Self::BadReaction(bad) => bad.number(),
            Self::TooLong | Self::Invalid => 0x0517,
            Self::Aborted => 0x0501,
            Self::Busy => return None,
        })
    }
}

/// Event number of an error number the partner has sent. (docs/cp341-events.md)
const fn rejected(number: u8) -> u16 {
    match number {
        code::NO_ACCESS => 0x0905,
        code::FLAG => 0x0902,
        code::AREA => 0x090B,
        code::TYPE => 0x0904,
        code::RANGE => 0x0903,
        code::COMMAND => 0x090A,
        code::STOP => 0x090D,
        code::LOCKED => 0x0909,
        code::LENGTH => 0x090C,
        code::SEQUENCE => 0x0908,
        _ => 0x090E,
    }
}

/// Why an answer to the partner was no longer wanted, or did not arrive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum AnswerError {
    /// The order was refused in the meantime: the CPU has not answered in time ([`Refusal::Mode`]), or the partner sent
    /// something else before it had the whole answer.
    Withdrawn(Refusal),
    /// The partner did not fetch the rest, or broke the order of telegrams.
    Abandoned,
    /// The reaction could not be sent.
    Line(SendError),
    /// Dropped by the owner with [`Order::Abort`](super::Order::Abort).
    Aborted,
}

/// An occurrence, for the diagnostic buffer and STATUS.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// An occurrence of the 3964(R) below.
    Line(machine::Event),
    /// An order of the partner was refused.
    Refused(Refusal),
    /// The CPU refused an order of the partner with this error number.
    RefusedByCpu(u8),
    /// A telegram of the partner was repeated and recognised as the same.
    Repeated,
    /// The partner did not continue its order.
    Abandoned,
    /// Our reaction could not be sent.
    ReactionNotSent(SendError),
    /// A reaction that belongs to no order, or is not valid.
    BadReaction(BadReaction),
    /// BWZ ran out, our telegram is sent again: the n-th repetition.
    Repetition(u16),
    /// Our order has failed.
    Failed(OrderError),
}

impl Event {
    /// Event number in classes 5 to 10; `None` if they have no number for it. (docs/cp341-events.md)
    pub fn number(self) -> Option<u16> {
        match self {
            Self::Line(event) => event.number(),
            Self::Refused(refusal) => Some(refusal.number()),
            Self::RefusedByCpu(number) => Some(match number {
                code::LOCKED => 0x060F,
                code::RANGE => 0x0607,
                code::AREA => 0x0604,
                code::FLAG => 0x0609,
                code::STOP => 0x060D,
                _ => 0x0301,
            }),
            Self::Abandoned => Some(Refusal::Sequence.number()),
            Self::ReactionNotSent(_) => Some(0x0612),
            Self::BadReaction(bad) => Some(bad.number()),
            Self::Failed(error) => error.number(),
            Self::Repeated | Self::Repetition(_) => None,
        }
    }
}
