//! Shifts and rotates. The bit shifted out last goes to CC1; CC0 and OV become 0. A count of 0 changes nothing.

use ob1_ir::Shift;

use super::arith::low_word;
use super::regs::CC1;

/// ACCU1 after the shift and its condition codes; `None` when the count is 0.
#[inline]
pub fn shift(kind: Shift, a1: u32, count: u8) -> Option<(u32, u32)> {
    if count == 0 {
        return None;
    }
    let n = u32::from(count);
    let word = a1 & 0xFFFF;
    let (result, out) = match kind {
        Shift::LeftWord => {
            let wide = u64::from(word) << n.min(17);
            (low_word(a1, wide as u16), wide >> 16 & 1)
        }
        Shift::RightWord => {
            let n = n.min(17);
            (low_word(a1, (word >> n) as u16), u64::from(word >> (n - 1) & 1))
        }
        Shift::RightInt => {
            let n = n.min(16);
            let value = i32::from(word as i16);
            (low_word(a1, (value >> n) as u16), (value >> (n - 1) & 1) as u64)
        }
        Shift::LeftDWord => {
            let wide = u64::from(a1) << n.min(33);
            (wide as u32, wide >> 32 & 1)
        }
        Shift::RightDWord => {
            let n = n.min(33);
            ((u64::from(a1) >> n) as u32, u64::from(a1) >> (n - 1) & 1)
        }
        Shift::RightDInt => {
            let n = n.min(32);
            let value = i64::from(a1 as i32);
            ((value >> n) as u32, (value >> (n - 1) & 1) as u64)
        }
        Shift::RotateLeft => {
            let result = a1.rotate_left(n % 32);
            (result, u64::from(result & 1))
        }
        Shift::RotateRight => {
            let result = a1.rotate_right(n % 32);
            (result, u64::from(result >> 31))
        }
    };
    Some((result, out as u32 * CC1))
}
