//! The records that a CP's tap writes for each event on its line: one record per message, or with its length in front
//! in a file.
//!
//! A record is the time (8 bytes, nanoseconds since the start of the driver), the kind (1 byte) and its data. A file is
//! [`MAGIC`], the version (2 bytes) and records, each preceded by its length (2 bytes) and the number of its CP (1
//! byte). All numbers are little-endian. A stream and a file begin with a [`Kind::Hello`]; a further one means that the
//! CP has got other parameters.

use crate::{Instant, LineFault};

/// The first bytes of a recording.
pub const MAGIC: [u8; 8] = *b"OB1TRACE";
/// Version of the records.
pub const VERSION: u16 = 1;
/// Bytes before the data of a record.
pub const HEAD: usize = 9;

/// The kind of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// The identity of the CP: JSON text with `version`, `station`, `name`, `line`, `parameters` (16 numbers),
    /// `unix_ns` (the time at 0).
    Hello = 0,
    /// Characters handed to the line.
    Out = 1,
    /// Characters received from the line.
    In = 2,
    /// Everything handed to the line has been sent.
    Done = 3,
    /// A character that could not be read: 1 parity, 2 framing, 3 overrun, 4 break.
    Fault = 4,
    /// The line is gone: why, as text.
    Gone = 5,
    /// The line is up.
    Up = 6,
    /// New state of the modem lines, as [`ModemLines::bits`](crate::ModemLines::bits).
    Modem = 7,
    /// The number of records (8 bytes) lost before this one because nobody fetched them.
    Lost = 8,
    /// A message of the CP, as text.
    Note = 9,
    /// The number of characters (4 bytes) handed to the line and then taken back.
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

/// A record as read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record<'a> {
    /// When, by the clock of the driver.
    pub time: Instant,
    /// What happened; it gives `data` their form.
    pub kind: Kind,
    /// What belongs to the kind; empty for some.
    pub data: &'a [u8],
}

impl<'a> Record<'a> {
    /// Reads a record; `None`: it is not a record of this version.
    pub fn read(bytes: &'a [u8]) -> Option<Self> {
        let (time, rest) = bytes.split_first_chunk::<8>()?;
        let (kind, data) = rest.split_first()?;
        let kind = Kind::ALL.into_iter().find(|known| *known as u8 == *kind)?;
        Some(Self { time: Instant::from_nanos(u64::from_le_bytes(*time)), kind, data })
    }

    /// Its first bytes; the data follow.
    pub fn head(time: Instant, kind: Kind) -> [u8; HEAD] {
        let mut head = [0; HEAD];
        head[..8].copy_from_slice(&time.nanos().to_le_bytes());
        head[8] = kind as u8;
        head
    }
}

/// The byte of a [`Kind::Fault`]. A line that goes down or comes up has records of its own.
pub const fn number_of(fault: LineFault) -> u8 {
    match fault {
        LineFault::Parity => 1,
        LineFault::Framing => 2,
        LineFault::Overrun => 3,
        LineFault::Break | LineFault::Gone | LineFault::Back => 4,
    }
}

/// The fault of such a byte.
pub const fn fault_of(number: u8) -> LineFault {
    match number {
        1 => LineFault::Parity,
        2 => LineFault::Framing,
        3 => LineFault::Overrun,
        _ => LineFault::Break,
    }
}
