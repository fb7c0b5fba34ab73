//! Jump conditions, and what jumps do to the status word.

use ob1_ir::{Jump, StatusBit};

use super::regs::{BR, OS, Regs, status_bit};

/// Whether the jump is taken.
pub fn condition(on: Jump, r: &mut Regs) -> bool {
    let flags = r.flags;
    match on {
        Jump::Always => true,
        Jump::IfRlo | Jump::IfRloSaveBr | Jump::IfNotRlo | Jump::IfNotRloSaveBr => {
            let rlo = r.rlo;
            if matches!(on, Jump::IfRloSaveBr | Jump::IfNotRloSaveBr) {
                r.flags = flags & !BR | (u32::from(rlo) * BR);
            }
            r.set_rlo(true);
            rlo == matches!(on, Jump::IfRlo | Jump::IfRloSaveBr)
        }
        Jump::IfBr | Jump::IfNotBr => {
            r.end_chain(true);
            (flags & BR != 0) == (on == Jump::IfBr)
        }
        Jump::IfOverflow => status_bit(flags, StatusBit::Overflow),
        Jump::IfStoredOverflow => {
            r.flags &= !OS;
            flags & OS != 0
        }
        Jump::IfZero => status_bit(flags, StatusBit::Zero),
        Jump::IfNotZero => status_bit(flags, StatusBit::NotZero),
        Jump::IfPositive => status_bit(flags, StatusBit::Positive),
        Jump::IfNegative => status_bit(flags, StatusBit::Negative),
        Jump::IfNotNegative => status_bit(flags, StatusBit::NotNegative),
        Jump::IfNotPositive => status_bit(flags, StatusBit::NotPositive),
        Jump::IfUnordered => status_bit(flags, StatusBit::Unordered),
    }
}
