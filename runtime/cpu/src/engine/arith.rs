//! Arithmetic and comparison: results and condition codes as pure functions of the accumulators.
//!
//! Condition codes: "Evaluating the Bits of the Status Word" with integer and floating-point functions, STL reference.
//! `cc` holds CC1, CC0 and OV at their places in the status word; the caller also sets OS from OV.

use ob1_ir::{AccuOp, Compare, MathFn};

use super::regs::{CC0, CC1, OV};

/// CC1 for positive, CC0 for negative.
#[inline]
pub(crate) const fn sign_cc(value: i64) -> u32 {
    (((value > 0) as u32) * CC1) | (((value < 0) as u32) * CC0)
}

/// The low word of `accu` replaced.
#[inline]
pub(crate) const fn low_word(accu: u32, low: u16) -> u32 {
    accu & 0xFFFF_0000 | low as u32
}

/// `+I -I *I /I`: ACCU2-L with ACCU1-L. Returns ACCU1 and the condition codes.
#[inline]
pub fn int(op: AccuOp, a2: u32, a1: u32) -> (u32, u32) {
    let (x, y) = (i32::from(a2 as i16), i32::from(a1 as i16));
    match op {
        // If a sum overflows, the codes follow from its low 16 bits.
        AccuOp::Add => sum16(a1, x + y),
        AccuOp::Sub => sum16(a1, x - y),
        AccuOp::Mul => {
            let product = x * y;
            let overflow = product != i32::from(product as i16);
            (product as u32, sign_cc(i64::from(product)) | (u32::from(overflow) * OV))
        }
        AccuOp::Div | AccuOp::Mod => {
            if y == 0 {
                return (a1, CC1 | CC0 | OV);
            }
            let (quotient, rest) = (x / y, x % y);
            let overflow = quotient > i32::from(i16::MAX);
            (
                (rest as u32) << 16 | u32::from(quotient as u16),
                sign_cc(i64::from(quotient)) | (u32::from(overflow) * OV),
            )
        }
    }
}

#[inline]
fn sum16(a1: u32, sum: i32) -> (u32, u32) {
    let kept = sum as i16;
    let overflow = i32::from(kept) != sum;
    (low_word(a1, kept as u16), sign_cc(i64::from(kept)) | (u32::from(overflow) * OV))
}

/// `+D -D *D /D MOD`.
#[inline]
pub fn dint(op: AccuOp, a2: u32, a1: u32) -> (u32, u32) {
    let (x, y) = (a2 as i32, a1 as i32);
    match op {
        AccuOp::Add => sum32(x.overflowing_add(y)),
        AccuOp::Sub => sum32(x.overflowing_sub(y)),
        AccuOp::Mul => {
            let product = i64::from(x) * i64::from(y);
            let overflow = product != i64::from(product as i32);
            (product as u32, sign_cc(product) | (u32::from(overflow) * OV))
        }
        AccuOp::Div => {
            if y == 0 {
                return (a1, CC1 | CC0 | OV);
            }
            let quotient = i64::from(x) / i64::from(y);
            let overflow = quotient > i64::from(i32::MAX);
            (quotient as u32, sign_cc(quotient) | (u32::from(overflow) * OV))
        }
        AccuOp::Mod => {
            if y == 0 {
                return (a1, CC1 | CC0 | OV);
            }
            let rest = x.wrapping_rem(y);
            (rest as u32, sign_cc(i64::from(rest)))
        }
    }
}

#[inline]
const fn sum32((kept, overflow): (i32, bool)) -> (u32, u32) {
    (kept as u32, sign_cc(kept as i64) | ((overflow as u32) * OV))
}

/// `+R -R *R /R`.
#[inline]
pub fn real(op: AccuOp, a2: u32, a1: u32) -> (u32, u32) {
    let (x, y) = (f32::from_bits(a2), f32::from_bits(a1));
    let result = match op {
        AccuOp::Add => x + y,
        AccuOp::Sub => x - y,
        AccuOp::Mul => x * y,
        AccuOp::Div | AccuOp::Mod => x / y,
    };
    with_real_cc(result)
}

/// The bits of a floating-point result and its condition codes.
#[inline]
fn with_real_cc(result: f32) -> (u32, u32) {
    let bits = result.to_bits();
    let exponent = (bits >> 23) & 0xFF;
    let sign = if bits >> 31 == 0 { CC1 } else { CC0 };
    if exponent != 0 && exponent != 0xFF {
        return (bits, sign);
    }
    special(bits, sign)
}

/// Zero, denormalised, infinite and NaN. A NaN result always has the same bits, because processors differ there.
#[cold]
fn special(bits: u32, sign: u32) -> (u32, u32) {
    match ((bits >> 23) & 0xFF, bits & 0x007F_FFFF) {
        (0, 0) => (bits, 0),
        // Underflow: a denormalised number counts as 0.
        (0, _) => (bits, OV),
        (_, 0) => (bits, sign | OV),
        _ => (0x7FFF_FFFF, CC1 | CC0 | OV),
    }
}

/// The answer of a comparison from the condition codes of ACCU2 against ACCU1.
#[inline]
const fn holds(compare: Compare, less: bool, equal: bool) -> bool {
    match compare {
        Compare::Equal => equal,
        Compare::NotEqual => !equal,
        Compare::Greater => !less && !equal,
        Compare::Less => less,
        Compare::GreaterEqual => !less,
        Compare::LessEqual => less || equal,
    }
}

/// `==I ... <=I`: RLO and condition codes.
#[inline]
pub fn compare_int(compare: Compare, a2: u32, a1: u32) -> (bool, u32) {
    let (x, y) = (a2 as i16, a1 as i16);
    (holds(compare, x < y, x == y), (u32::from(x > y) * CC1) | (u32::from(x < y) * CC0))
}

/// `==D ... <=D`, with ACCU2 on the left.
#[inline]
pub fn compare_dint(compare: Compare, a2: u32, a1: u32) -> (bool, u32) {
    let (x, y) = (a2 as i32, a1 as i32);
    (holds(compare, x < y, x == y), (u32::from(x > y) * CC1) | (u32::from(x < y) * CC0))
}

/// `==R ... <=R`. With a NaN no comparison holds, the codes say "unordered", and OV and OS are set.
#[inline]
pub fn compare_real(compare: Compare, a2: u32, a1: u32) -> (bool, u32) {
    let (x, y) = (f32::from_bits(a2), f32::from_bits(a1));
    if x.is_nan() || y.is_nan() {
        return (false, CC1 | CC0 | OV);
    }
    (holds(compare, x < y, x == y), (u32::from(x > y) * CC1) | (u32::from(x < y) * CC0))
}

/// `SQR SQRT LN EXP SIN ...` of ACCU1.
pub fn math(function: MathFn, a1: u32) -> (u32, u32) {
    let x = f32::from_bits(a1);
    let result = match function {
        MathFn::Sqr => x * x,
        MathFn::Sqrt => x.sqrt(),
        MathFn::Ln => f64::from(x).ln() as f32,
        MathFn::Exp => f64::from(x).exp() as f32,
        MathFn::Sin => f64::from(x).sin() as f32,
        MathFn::Cos => f64::from(x).cos() as f32,
        MathFn::Tan => f64::from(x).tan() as f32,
        MathFn::Asin => f64::from(x).asin() as f32,
        MathFn::Acos => f64::from(x).acos() as f32,
        MathFn::Atan => f64::from(x).atan() as f32,
    };
    with_real_cc(result)
}
