//! Reads a line as an observer: characters of both directions in, telegrams and control characters with their meaning
//! out.
//!
//! Accepts any characters, without clock and allocation. An observer cannot know what a CP has decided; where the line
//! alone leaves it open, [`Meaning`] says what the characters are, not what became of them.

mod mbus;
mod meaning;
mod modbus;
mod profibus;
mod reader;

pub use meaning::{Meaning, Modbus, Names};
pub use reader::{Reader, Unit};

use crate::machine::Span;
use crate::output::Flags;

/// Direction of characters, seen from the observed CP.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Way {
    /// From the CP to its partner.
    Out,
    /// From the partner to the CP.
    In,
}

impl Way {
    /// The opposite direction, in which an answer goes.
    #[must_use]
    pub const fn other(self) -> Self {
        match self {
            Self::Out => Self::In,
            Self::In => Self::Out,
        }
    }
}

/// The protocol of the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dialect {
    /// Bare characters; a pause this long ends a telegram.
    Ascii {
        /// The pause that ends a telegram.
        pause: Span,
    },
    /// Telegrams between start and end characters.
    StxEtx {
        /// Start characters, none to two.
        start: Flags,
        /// End characters, none to two.
        end: Flags,
        /// The pause after which an open telegram is incomplete.
        pause: Span,
    },
    /// 3964 and 3964R, with RK 512 or without.
    S3964 {
        /// With block check character.
        bcc: bool,
        /// With RK 512 on top.
        rk512: bool,
        /// The pause that breaks a block off.
        pause: Span,
    },
    /// Modbus RTU: frames of bytes, separated by silence.
    ModbusRtu {
        /// The CP is the master: what it sends are requests.
        master: bool,
        /// A pause that surely ends a frame.
        pause: Span,
    },
    /// Modbus ASCII: frames of digits between colon and CR LF.
    ModbusAscii {
        /// The CP is the master: what it sends are requests.
        master: bool,
        /// It is the loadable driver of a CP 341: Siemens' names, and registers of 32 bits.
        loadable: bool,
        /// A pause that surely ends a frame.
        pause: Span,
    },
    /// EnOcean, serial protocol version 2.
    EnOcean {
        /// A pause that ends a frame.
        pause: Span,
    },
    /// M-Bus: requests of the CP and answers of the slaves.
    MBus {
        /// A pause that surely ends a frame.
        pause: Span,
    },
    /// Modbus TCP of a master.
    ModbusTcp {
        /// A pause that surely ends a frame.
        pause: Span,
    },
    /// PROFIBUS: telegrams of all stations on the bus.
    Profibus {
        /// A pause that surely ends a telegram.
        pause: Span,
    },
}

impl Dialect {
    const fn pause(&self) -> Span {
        match *self {
            Self::Ascii { pause }
            | Self::StxEtx { pause, .. }
            | Self::S3964 { pause, .. }
            | Self::ModbusRtu { pause, .. }
            | Self::ModbusAscii { pause, .. }
            | Self::EnOcean { pause }
            | Self::MBus { pause }
            | Self::ModbusTcp { pause }
            | Self::Profibus { pause } => pause,
        }
    }
}
