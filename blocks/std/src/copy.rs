//! SFC 20 BLKMOV and SFC 21 FILL: which bytes go where, as a plan; and the error codes of parameters.

use ob1_model::{Area, FaultKind};

use crate::{AnyPointer, AnyType};

/// The general error code 8xyyh of a system function: `x` the parameter's number, `yy` the low byte of the error's
/// event.
pub const fn parameter_error(parameter: u16, fault: FaultKind) -> u16 {
    0x8000 | (parameter & 15) << 8 | fault.number() & 0xFF
}

/// One side of a copy: what a parameter names, and of a STRING how many characters it may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Side {
    /// The pointer that the parameter gives.
    pub any: AnyPointer,
    /// The first byte of a STRING, its maximum length; anything for another type.
    pub max: u8,
}

/// The errors of a side that is read and of one that is written.
struct Errors {
    parameter: u16,
    area: FaultKind,
    length: FaultKind,
    alignment: FaultKind,
}

const SOURCE: Errors = Errors {
    parameter: 1,
    area: FaultKind::AreaRead,
    length: FaultKind::AreaLengthRead,
    alignment: FaultKind::AlignmentRead,
};
const TARGET: Errors = Errors {
    parameter: 3,
    area: FaultKind::AreaWrite,
    length: FaultKind::AreaLengthWrite,
    alignment: FaultKind::AlignmentWrite,
};

/// Bytes a parameter names, or its error. A STRING is named whole: its two length bytes and all it may hold.
fn bytes_of(side: Option<Side>, errors: &Errors) -> Result<(AnyPointer, u32), u16> {
    let wrong = |kind| parameter_error(errors.parameter, kind);
    let Side { any, max } = side.ok_or(wrong(errors.area))?;
    if any.ty == AnyType::Nil || any.area == Area::Peripheral {
        return Err(wrong(errors.area));
    }
    if any.area == Area::Db && any.db == 0 {
        return Err(wrong(FaultKind::DbNotLoaded));
    }
    if any.at.bit() != 0 {
        return Err(wrong(errors.alignment));
    }
    let bytes = if any.ty == AnyType::String { Some(u32::from(max) + 2) } else { any.bytes() };
    let bytes = bytes.filter(|bytes| *bytes > 0).ok_or(wrong(errors.length))?;
    Ok((any, bytes))
}

/// A copy: `bytes` bytes of the pattern of `period` bytes at `source`, repeated as often as needed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Where the bytes come from.
    pub source: AnyPointer,
    /// Where the bytes go.
    pub target: AnyPointer,
    /// How many bytes are written.
    pub bytes: u32,
    /// Bytes of the source after which it begins again.
    pub period: u32,
}

/// BLKMOV: as many bytes as both sides have. Parameter 1 is SRCBLK, 3 is DSTBLK.
///
/// # Errors
/// The code for RET_VAL.
pub fn block_move(source: Option<Side>, target: Option<Side>) -> Result<Plan, u16> {
    let (source, from) = bytes_of(source, &SOURCE)?;
    let (target, to) = bytes_of(target, &TARGET)?;
    Ok(Plan { source, target, bytes: from.min(to), period: from })
}

/// FILL: the target is filled with repetitions of the source, the last one cut off. Parameter 1 is BVAL, 3 is BLK.
///
/// # Errors
/// The code for RET_VAL.
pub fn fill(source: Option<Side>, target: Option<Side>) -> Result<Plan, u16> {
    let (source, from) = bytes_of(source, &SOURCE)?;
    let (target, to) = bytes_of(target, &TARGET)?;
    Ok(Plan { source, target, bytes: to, period: from })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_model::BitAddr;

    fn any(ty: AnyType, count: u16, area: Area) -> Option<Side> {
        Some(Side { any: AnyPointer { ty, count, db: u16::from(area == Area::Db), area, at: BitAddr(80) }, max: 10 })
    }

    #[test]
    fn the_smaller_side_decides_a_move_and_the_target_a_fill() {
        let (words, bytes) = (any(AnyType::Word, 4, Area::Memory), any(AnyType::Byte, 5, Area::Db));
        assert_eq!(block_move(words, bytes).map(|p| (p.bytes, p.period)), Ok((5, 8)));
        assert_eq!(block_move(bytes, words).map(|p| (p.bytes, p.period)), Ok((5, 5)));
        assert_eq!(fill(bytes, words).map(|p| (p.bytes, p.period)), Ok((8, 5)));
    }

    #[test]
    fn what_is_no_memory_is_named_by_parameter() {
        let words = any(AnyType::Word, 4, Area::Memory);
        assert_eq!(block_move(None, words), Err(0x8124));
        assert_eq!(block_move(words, any(AnyType::Bool, 3, Area::Memory)), Err(0x8323));
        assert_eq!(block_move(any(AnyType::Bool, 3, Area::Memory), words), Err(0x8122));
        assert_eq!(block_move(words, any(AnyType::Byte, 0, Area::Memory)), Err(0x8323));
        assert_eq!(block_move(words, any(AnyType::Nil, 1, Area::Memory)), Err(0x8325));
        assert_eq!(fill(any(AnyType::Byte, 1, Area::Peripheral), words), Err(0x8124));
        let odd =
            |side: Option<Side>| side.map(|side| Side { any: AnyPointer { at: BitAddr(81), ..side.any }, ..side });
        assert_eq!((block_move(odd(words), words), block_move(words, odd(words))), (Err(0x8128), Err(0x8329)));
        let no_db = any(AnyType::Byte, 1, Area::Db).map(|side| Side { any: AnyPointer { db: 0, ..side.any }, ..side });
        assert_eq!((fill(no_db, words), fill(words, no_db)), (Err(0x813A), Err(0x833A)));
    }

    #[test]
    fn a_string_is_named_whole() {
        let (string, bytes) = (any(AnyType::String, 1, Area::Memory), any(AnyType::Byte, 20, Area::Memory));
        assert_eq!(block_move(string, bytes).map(|p| p.bytes), Ok(12));
        assert_eq!(fill(bytes, string).map(|p| (p.bytes, p.period)), Ok((12, 20)));
    }
}
