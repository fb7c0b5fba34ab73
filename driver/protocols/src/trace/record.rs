//! What a CP's tap writes for each thing that happens on its line: one record, by itself in a message, or behind its
//! length in a file.
//!
//! A record is the time (8 bytes, nanoseconds since the start of the driver), the kind (1 byte) and its data. A file is
//! [`MAGIC`], the version (2 bytes) and records, each behind its length (2 bytes) and the number of its CP (1 byte).
//! All numbers are little-endian. A stream and a file begin with a [`Kind::Hello`], and there may be more of them: the
//! CP has got other parameters.

use crate::machine::{Instant, LineFault};

/// The first bytes of a recording.
pub const MAGIC: [u8; 8] = *b"OB1TRACE";
/// Version of the records.
pub const VERSION: u16 = 1;
/// Bytes before the data of a record.
pub const HEAD: usize = 9;

/// What a record tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// Who this is: JSON text with `version`, `station`, `name`, `line`, `parameters` (16 numbers), `unix_ns` (the time
    /// at 0).
    Hello = 0,
    /// Characters handed to the line.
    Out = 1,
    /// Characters received.
    In = 2,
    /// Everything handed to the line has left.
    Done = 3,
    /// A character that could not be read: 1 parity, 2 framing, 3 overrun, 4 break.
    Fault = 4,
    /// The line is gone: why, as text.
    Gone = 5,
    /// The line is there.
    Up = 6,
    /// Modem lines: bit 0 CTS, 1 DSR, 2 RI, 3 CD.
    Modem = 7,
    /// So many records (8 bytes) before this one were lost, because nobody fetched them.
    Lost = 8,
    /// Something the CP has to say, as text.
    Note = 9,
    /// So many characters (4 bytes) of those handed to the line were taken back.
    TakenBack = 10,
}

impl Kind {
    const ALL: [Self; 11] = [
        Self::Hello,
        Self::Out,
        Self::In,
        Self::Done,
        Self::Fault,
        Self::Gone,
        Self::Up,
        Self::Modem,
        Self::Lost,
        Self::Note,
        Self::TakenBack,
    ];
}

/// A record, read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record<'a> {
    /// When, by the clock of the driver.
    pub time: Instant,
    /// What it tells.
    pub kind: Kind,
    /// More of it.
    pub data: &'a [u8],
}

impl<'a> Record<'a> {
    /// Reads a record; `None`: it is not a record of this version.
    #[must_use]
    pub fn read(bytes: &'a [u8]) -> Option<Self> {
        let (time, rest) = bytes.split_first_chunk::<8>()?;
        let (kind, data) = rest.split_first()?;
        let kind = Kind::ALL.into_iter().find(|known| *known as u8 == *kind)?;
        Some(Self { time: Instant::from_nanos(u64::from_le_bytes(*time)), kind, data })
    }

    /// Its first bytes; the data follow.
    #[must_use]
    pub fn head(time: Instant, kind: Kind) -> [u8; HEAD] {
        let mut head = [0; HEAD];
        head[..8].copy_from_slice(&time.nanos().to_le_bytes());
        head[8] = kind as u8;
        head
    }
}

/// The byte of a [`Kind::Fault`]. Lines that go and come have records of their own.
#[must_use]
pub const fn number_of(fault: LineFault) -> u8 {
    match fault {
        LineFault::Parity => 1,
        LineFault::Framing => 2,
        LineFault::Overrun => 3,
        LineFault::Break | LineFault::Gone | LineFault::Back => 4,
    }
}

/// The fault of such a byte.
#[must_use]
pub const fn fault_of(number: u8) -> LineFault {
    match number {
        1 => LineFault::Parity,
        2 => LineFault::Framing,
        3 => LineFault::Overrun,
        _ => LineFault::Break,
    }
}
