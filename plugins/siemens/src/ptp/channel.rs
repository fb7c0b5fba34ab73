//! A channel as its block sees it: 64 bytes to the CP, 64 bytes from it, as data records. `docs/cp341-channels.md`

use ob1_sdk::{Abort, Cx, Refused};
use ob1_words::channels::{BLOCK_BYTES, Block, Channel};

use super::state::CpState;

/// Longest job of all blocks, in bytes. [TIA help "PtP data link CP 341"]
pub const LEN_MAX: u16 = 4096;

/// The reason why a channel cannot be used, as RET_VAL of SFC 58/59. (docs/cp341-events.md)
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Unreachable(pub(crate) u16);

impl Unreachable {
    /// There is no module at this address.
    const NO_MODULE: Self = Self(0x8090);
    /// A module of another type, without channels.
    const NO_RECORD: Self = Self(0x80B0);
    /// The CP does not answer.
    pub(crate) const ABSENT: Self = Self(0x80A0);
    /// Another instance has the channel.
    pub(crate) const IN_USE: Self = Self(0x80C3);

    fn reading(refused: Refused) -> Self {
        Self::of(refused, Self::ABSENT, Self(0x80C0))
    }

    fn writing(refused: Refused) -> Self {
        Self::of(refused, Self(0x80A1), Self(0x80C1))
    }

    const fn of(refused: Refused, absent: Self, other: Self) -> Self {
        match refused {
            Refused::NoModule => Self::NO_MODULE,
            Refused::NoRecord => Self::NO_RECORD,
            Refused::Absent => absent,
            _ => other,
        }
    }

    /// Waiting for the channel is useless.
    pub(crate) fn is_hopeless(self) -> bool {
        self == Self::NO_MODULE || self == Self::NO_RECORD
    }
}

/// Reads the block that the CP shows.
pub(crate) fn read(
    cx: &mut Cx<'_, CpState>,
    laddr: i16,
    channel: Channel,
) -> Result<Result<Block, Unreachable>, Abort> {
    let mut block = [0; BLOCK_BYTES];
    Ok(match cx.record_read(address(laddr), channel.record(), &mut block)? {
        Ok(BLOCK_BYTES) => Ok(Block(block)),
        Ok(_) => Err(Unreachable::NO_RECORD),
        Err(refused) => Err(Unreachable::reading(refused)),
    })
}

/// Shows the CP a block.
pub(crate) fn write(
    cx: &mut Cx<'_, CpState>,
    laddr: i16,
    channel: Channel,
    block: &Block,
) -> Result<Result<(), Unreachable>, Abort> {
    Ok(cx.record_write(address(laddr), channel.record(), &block.0)?.map_err(Unreachable::writing))
}

/// LADDR is an INT; addresses go up to 65535.
pub fn address(laddr: i16) -> u32 {
    u32::from(laddr as u16)
}

/// A start number that differs from the one that the CP acknowledged last, and from the one in use.
pub(crate) fn next_start(acknowledged: u16, in_use: u16) -> u16 {
    let mut number = acknowledged.wrapping_add(1);
    while number == 0 || number == in_use {
        number = number.wrapping_add(1);
    }
    number
}
