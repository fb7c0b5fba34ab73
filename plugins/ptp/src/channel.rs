//! A channel as its block sees it: 64 bytes to the CP, 64 bytes from it, as data records. `docs/cp341-channels.md`

use ob1_sdk::{Abort, Cx, Refused};

use crate::state::CpState;

/// User data in a block. [reference 1.0]
pub(crate) const PIECE: u16 = 32;

const BYTES: usize = 64;

/// Longest job of any of them, bytes. [reference 1.1]
pub const LEN_MAX: u16 = 4096;
const DATA: usize = 32;

/// Records of the channels.
pub(crate) const SEND: u8 = 0x80;
pub(crate) const RECEIVE: u8 = 0x81;

/// Commands (byte 0 of what the CPU shows).
pub(crate) const START: u8 = 1;
pub(crate) const REST: u8 = 2;
pub(crate) const WAIT: u8 = 3;
pub(crate) const JOB: u8 = 4;
pub(crate) const REFUSE: u8 = 5;

/// Pieces of so many bytes.
pub(crate) const fn pieces(bytes: u16) -> u16 {
    bytes.div_ceil(PIECE)
}

/// What the CP shows (byte 0).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum State {
    /// No start number acknowledged, or a state this block does not know.
    Off,
    Ready,
    Collecting,
    Running,
    Giving,
    Done,
    Failed,
    Offered,
}

/// A block of the CP.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FromCp(pub(crate) [u8; BYTES]);

impl FromCp {
    pub(crate) fn state(&self) -> State {
        match self.0[0] {
            1 => State::Ready,
            2 => State::Collecting,
            3 => State::Running,
            4 => State::Giving,
            5 => State::Done,
            6 => State::Failed,
            7 => State::Offered,
            _ => State::Off,
        }
    }

    pub(crate) fn word(&self, at: usize) -> u16 {
        u16::from_be_bytes([self.0[at], self.0[at + 1]])
    }

    /// Start number the CP has acknowledged; 0: none.
    pub(crate) fn start(&self) -> u16 {
        self.word(2)
    }

    pub(crate) fn job(&self) -> u16 {
        self.word(4)
    }

    /// Pieces the CP has, or the piece in `data`.
    pub(crate) fn piece(&self) -> u16 {
        self.word(6)
    }

    pub(crate) fn status(&self) -> u16 {
        self.word(8)
    }

    /// Bytes, at most what a job can have.
    pub(crate) fn len(&self) -> u16 {
        self.word(10).min(LEN_MAX)
    }

    pub(crate) fn data(&self) -> &[u8] {
        &self.0[DATA..]
    }
}

/// A block of the CPU, in the making.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ToCp(pub [u8; BYTES]);

impl ToCp {
    pub(crate) fn new(command: u8, start: u16, job: u16) -> Self {
        let mut block = Self([0; BYTES]);
        block.0[0] = command;
        block.set(2, start).set(4, job);
        block
    }

    /// Sets a word.
    pub fn set(&mut self, at: usize, word: u16) -> &mut Self {
        self.0[at..at + 2].copy_from_slice(&word.to_be_bytes());
        self
    }

    pub(crate) fn piece(&mut self, piece: u16) -> &mut Self {
        self.set(6, piece)
    }

    pub(crate) fn data(&mut self, len: usize) -> &mut [u8] {
        &mut self.0[DATA..DATA + len.min(BYTES - DATA)]
    }
}

/// Why a channel cannot be used, as RET_VAL of SFC 58/59. [reference 3.14]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Unreachable(pub(crate) u16);

impl Unreachable {
    fn reading(refused: Refused) -> Self {
        Self(match refused {
            Refused::NoModule => 0x8090,
            Refused::Absent => 0x80A0,
            Refused::NoRecord => 0x80B0,
            _ => 0x80C0,
        })
    }

    fn writing(refused: Refused) -> Self {
        Self(match refused {
            Refused::NoModule => 0x8090,
            Refused::Absent => 0x80A1,
            Refused::NoRecord => 0x80B0,
            _ => 0x80C1,
        })
    }
}

/// Reads what the CP shows.
pub(crate) fn read(cx: &mut Cx<'_, CpState>, laddr: i16, record: u8) -> Result<Result<FromCp, Unreachable>, Abort> {
    let mut block = [0; BYTES];
    Ok(match cx.record_read(address(laddr), record, &mut block)? {
        Ok(BYTES) => Ok(FromCp(block)),
        // A module of another kind: it has no channels.
        Ok(_) => Err(Unreachable(0x80B0)),
        Err(refused) => Err(Unreachable::reading(refused)),
    })
}

/// Shows the CP a block.
pub(crate) fn write(
    cx: &mut Cx<'_, CpState>,
    laddr: i16,
    record: u8,
    block: &ToCp,
) -> Result<Result<(), Unreachable>, Abort> {
    Ok(cx.record_write(address(laddr), record, &block.0)?.map_err(Unreachable::writing))
}

/// LADDR is an INT; addresses reach 65535.
#[must_use]
pub fn address(laddr: i16) -> u32 {
    u32::from(laddr as u16)
}

/// A start number that is not the one the CP has acknowledged last, nor the one in use.
pub(crate) fn next_start(acknowledged: u16, in_use: u16) -> u16 {
    let mut number = acknowledged.wrapping_add(1);
    while number == 0 || number == in_use {
        number = number.wrapping_add(1);
    }
    number
}
