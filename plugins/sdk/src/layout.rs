//! Positions of the variables of an FB in its instance: the STEP 7 layout, computed at compile time.
//!
//! The same rules as the compiler's: sections in the order inputs, outputs, in/outs, statics, each from an even byte;
//! BOOLs fill bits, bytes may be at any address, longer types start at an even byte.

use crate::abi::{SECTION_IN, SECTION_IN_OUT, SECTION_OUT, SECTION_STATIC, ty};

use crate::param::Param;

/// Size and alignment in bits.
const fn extent(param: &Param) -> (u32, u32) {
    match param.0.ty {
        ty::BOOL => (1, 1),
        ty::BYTE | ty::CHAR => (8, 8),
        ty::DWORD | ty::DINT | ty::REAL | ty::TIME | ty::TIME_OF_DAY => (32, 16),
        ty::DATE_AND_TIME => (64, 16),
        ty::STRING => (((param.0.length as u32 + 2) * 8).next_multiple_of(16), 16),
        ty::BYTES => ((param.0.length as u32 * 8).next_multiple_of(16), 16),
        ty::POINTER => (48, 16),
        ty::ANY => (80, 16),
        _ => (16, 16),
    }
}

/// Bit address of declaration `wanted` in the instance.
#[must_use]
pub const fn bit_address(params: &[Param], wanted: usize) -> u32 {
    let (mut bit, mut round) = (0, 0);
    let sections = [SECTION_IN, SECTION_OUT, SECTION_IN_OUT, SECTION_STATIC];
    while round < sections.len() {
        let mut i = 0;
        while i < params.len() {
            if params[i].0.section == sections[round] {
                let (bits, alignment) = extent(&params[i]);
                bit = u32::next_multiple_of(bit, alignment);
                if i == wanted {
                    return bit;
                }
                bit += bits;
            }
            i += 1;
        }
        bit = u32::next_multiple_of(bit, 16);
        round += 1;
    }
    panic!("only inputs, outputs, in/outs and statics lie in the instance")
}
