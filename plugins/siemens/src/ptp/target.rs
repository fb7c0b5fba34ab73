//! The location where P_RCV_RK stores or reads data. [TIA help "PtP data link CP 341"]

use ob1_sdk::{Abort, Area, Cx, Refused};

use ob1_words::channels::Refusal;

use super::state::CpState;

/// Maximum number of bytes of timers and counters that a partner can fetch from a CP 341.
/// [TIA help "PtP data link CP 341"]
const TIMERS_MAX: u16 = 32;

/// A location in the CPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Target {
    /// Bytes of an area, from this one on.
    Bytes(Area, u32),
    /// Timers, from this number on.
    Timers(u16),
    /// Counters, from this number on.
    Counters(u16),
}

impl Target {
    /// The location for a letter in the header of the partner; `None` for areas a CP 341 does not have (DX) and unknown
    /// letters.
    pub(crate) fn of(letter: u8, number: u16, offset: u16) -> Option<Self> {
        let offset_bytes = u32::from(offset);
        Some(match letter {
            b'D' => Self::Bytes(Area::Db(number), offset_bytes),
            b'M' => Self::Bytes(Area::Memory, offset_bytes),
            b'E' => Self::Bytes(Area::Input, offset_bytes),
            b'A' => Self::Bytes(Area::Output, offset_bytes),
            b'T' => Self::Timers(offset),
            b'Z' => Self::Counters(offset),
            _ => return None,
        })
    }

    /// Whether the area contains this many bytes.
    pub(crate) fn check(self, cx: &mut Cx<'_, CpState>, len: u16) -> Result<Result<(), Refusal>, Abort> {
        Ok(match self {
            Self::Bytes(area, at) => match cx.len(area)? {
                Ok(there) if at + u32::from(len) <= there => Ok(()),
                Ok(_) => Err(Refusal::Range),
                Err(refused) => Err(refusal(refused)),
            },
            Self::Timers(_) | Self::Counters(_) if len > TIMERS_MAX => Err(Refusal::Range),
            Self::Timers(first) => match cx.timer(last(first, len))? {
                Ok(_) => Ok(()),
                Err(_) => Err(Refusal::Range),
            },
            Self::Counters(first) => match cx.counter(last(first, len))? {
                Ok(_) => Ok(()),
                Err(_) => Err(Refusal::Range),
            },
        })
    }

    /// Reads a piece that begins at byte `from`.
    pub(crate) fn read(
        self,
        cx: &mut Cx<'_, CpState>,
        from: u16,
        into: &mut [u8],
    ) -> Result<Result<(), Refusal>, Abort> {
        match self {
            Self::Bytes(area, at) => Ok(cx.read(area, at + u32::from(from), into)?.map_err(refusal)),
            Self::Timers(first) | Self::Counters(first) => {
                for (n, word) in into.chunks_mut(2).enumerate() {
                    let number = first + from / 2 + n as u16;
                    let value = match self {
                        // In the format of the CPU: remaining time as S5TIME, count as BCD.
                        Self::Timers(_) => cx.timer(number)?.map(|timer| timer.remaining),
                        _ => cx.counter_bcd(number)?,
                    };
                    let Ok(value) = value else { return Ok(Err(Refusal::Range)) };
                    word.copy_from_slice(&value.to_be_bytes()[..word.len()]);
                }
                Ok(Ok(()))
            }
        }
    }

    /// Writes a piece that begins at byte `from`.
    pub(crate) fn write(self, cx: &mut Cx<'_, CpState>, from: u16, data: &[u8]) -> Result<Result<(), Refused>, Abort> {
        match self {
            Self::Bytes(area, at) => cx.write(area, at + u32::from(from), data),
            // Timers and counters cannot be written.
            Self::Timers(_) | Self::Counters(_) => Ok(Err(Refused::Outside)),
        }
    }
}

/// The last timer or counter in this many bytes.
const fn last(first: u16, len: u16) -> u16 {
    first + len.div_ceil(2).saturating_sub(1)
}

fn refusal(refused: Refused) -> Refusal {
    match refused {
        Refused::NoDb | Refused::DbNumber => Refusal::Db,
        _ => Refusal::Range,
    }
}
