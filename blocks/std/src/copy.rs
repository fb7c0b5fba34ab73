//! SFC 20 BLKMOV and SFC 21 FILL: which bytes go where, as a plan; and the error codes of parameters.

use ob1_model::{Area, FaultKind};

use crate::{AnyPointer, AnyType};

/// The general error code 8xyyh of a system function: `x` the parameter's number, `yy` the low byte of the error's
/// event.
#[must_use]
pub const fn parameter_error(parameter: u16, fault: FaultKind) -> u16 {
    0x8000 | (parameter & 15) << 8 | fault.number() & 0xFF
}

/// Bytes a parameter names, or its area error.
fn bytes_of(any: Option<AnyPointer>, parameter: u16, error: FaultKind) -> Result<(AnyPointer, u32), u16> {
    let wrong = parameter_error(parameter, error);
    let any = any.ok_or(wrong)?;
    let bytes = any.bytes().filter(|bytes| *bytes > 0).ok_or(wrong)?;
    if any.ty == AnyType::Nil || any.area == Area::Peripheral {
        return Err(wrong);
    }
    Ok((any, bytes))
}

/// A copy: `bytes` bytes of the pattern of `period` bytes at `source`, repeated as often as needed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// From here.
    pub source: AnyPointer,
    /// To here.
    pub target: AnyPointer,
    /// Bytes to write.
    pub bytes: u32,
    /// Bytes of the source after which it begins again.
    pub period: u32,
}

/// BLKMOV: as many bytes as both sides have. Parameter 1 is SRCBLK, 3 is DSTBLK.
///
/// # Errors
/// The code for RET_VAL.
pub fn block_move(source: Option<AnyPointer>, target: Option<AnyPointer>) -> Result<Plan, u16> {
    let (source, from) = bytes_of(source, 1, FaultKind::AreaRead)?;
    let (target, to) = bytes_of(target, 3, FaultKind::AreaWrite)?;
    Ok(Plan { source, target, bytes: from.min(to), period: from })
}

/// FILL: the target is filled with repetitions of the source, the last one cut off. Parameter 1 is BVAL, 3 is BLK.
///
/// # Errors
/// The code for RET_VAL.
pub fn fill(source: Option<AnyPointer>, target: Option<AnyPointer>) -> Result<Plan, u16> {
    let (source, from) = bytes_of(source, 1, FaultKind::AreaRead)?;
    let (target, to) = bytes_of(target, 3, FaultKind::AreaWrite)?;
    Ok(Plan { source, target, bytes: to, period: from })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_model::BitAddr;

    fn any(ty: AnyType, count: u16, area: Area) -> Option<AnyPointer> {
        Some(AnyPointer { ty, count, db: 0, area, at: BitAddr(80) })
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
        assert_eq!(block_move(words, any(AnyType::Bool, 3, Area::Memory)), Err(0x8325));
        assert_eq!(block_move(words, any(AnyType::Nil, 1, Area::Memory)), Err(0x8325));
        assert_eq!(fill(any(AnyType::Byte, 1, Area::Peripheral), words), Err(0x8124));
    }
}
