//! LIMIT, MAX, MIN, SEL: variables of one type, recognized by their ANY pointers. An error leaves the result alone; BR
//! is 0 then.

use std::cmp::Ordering;

use ob1_model::BlockKind::Fc;

use crate::call::{Call, is_invalid};
use crate::declare::{Params, params};
use crate::row::{Origin, Row};
use crate::{AnyPointer, AnyType, Done};

params!(Limit { Input { MN: ANY, IN: ANY, MX: ANY } Return { RET_VAL: ANY } });
params!(Extreme { Input { IN1: ANY, IN2: ANY, IN3: ANY } Return { RET_VAL: ANY } });
params!(Select { Input { G: BOOL, IN0: ANY, IN1: ANY } Return { RET_VAL: ANY } });

pub(super) const ROWS: &[Row] = &[
    Row::new::<Limit>(Origin::Iec, Fc, 22, "LIMIT", limit).note("INT, DINT, REAL"),
    Row::new::<Extreme>(Origin::Iec, Fc, 25, "MAX", |call| extreme(call, Ordering::Greater)).note("INT, DINT, REAL"),
    Row::new::<Extreme>(Origin::Iec, Fc, 27, "MIN", |call| extreme(call, Ordering::Less)).note("INT, DINT, REAL"),
    Row::new::<Select>(Origin::Iec, Fc, 36, "SEL", select).note("every elementary type but BOOL"),
];

/// The bytes of a variable an ANY names.
#[derive(Clone, Copy)]
struct Value {
    ty: AnyType,
    bytes: [u8; 4],
}

/// Bytes of one element of an elementary type.
const fn width(ty: AnyType) -> Option<usize> {
    Some(match ty {
        AnyType::Byte | AnyType::Char => 1,
        AnyType::Word | AnyType::Int | AnyType::Date | AnyType::S5Time => 2,
        AnyType::DWord | AnyType::DInt | AnyType::Real | AnyType::TimeOfDay | AnyType::Time => 4,
        _ => return None,
    })
}

impl Value {
    fn read(call: &mut Call<'_>, any: &AnyPointer) -> Option<Self> {
        let mut bytes = [0; 4];
        call.read_at(any, 0, &mut bytes[..width(any.ty)?]).ok()?;
        Some(Self { ty: any.ty, bytes })
    }

    /// The order of two numbers of one type; `None` for other types and REALs that are not numbers.
    fn order(&self, other: &Self) -> Option<Ordering> {
        let (a, b) = (self.bytes, other.bytes);
        match (self.ty, other.ty) {
            (AnyType::Int, AnyType::Int) => {
                Some(i16::from_be_bytes([a[0], a[1]]).cmp(&i16::from_be_bytes([b[0], b[1]])))
            }
            (AnyType::DInt, AnyType::DInt) => Some(i32::from_be_bytes(a).cmp(&i32::from_be_bytes(b))),
            (AnyType::Real, AnyType::Real) => {
                let (a, b) = (f32::from_be_bytes(a), f32::from_be_bytes(b));
                if is_invalid(a) || is_invalid(b) { None } else { a.partial_cmp(&b) }
            }
            _ => None,
        }
    }
}

/// Reads the variable that an ANY names; `None`: its type is not known.
fn value(call: &mut Call<'_>, p: impl Params) -> Option<Value> {
    let any = call.any(p)?;
    Value::read(call, &any)
}

/// Writes the result where RET_VAL points, if that has the value's type.
fn give(call: &mut Call<'_>, ret_val: impl Params, value: Option<Value>) -> Done {
    let written = match (call.any(ret_val), value) {
        (Some(any), Some(value)) if any.ty == value.ty => {
            let width = width(value.ty).unwrap_or(0);
            call.write_at(&any, 0, &value.bytes[..width]).is_ok()
        }
        _ => false,
    };
    call.br(written)
}

fn limit(call: &mut Call<'_>) -> Done {
    let values = (value(call, Limit::MN), value(call, Limit::IN), value(call, Limit::MX));
    let limited = match values {
        (Some(low), Some(input), Some(high)) => match (low.order(&high), input.order(&low), input.order(&high)) {
            (Some(Ordering::Greater), ..) => None,
            (Some(_), Some(Ordering::Less), Some(_)) => Some(low),
            (Some(_), Some(_), Some(Ordering::Greater)) => Some(high),
            (Some(_), Some(_), Some(_)) => Some(input),
            _ => None,
        },
        _ => None,
    };
    give(call, Limit::RET_VAL, limited)
}

fn extreme(call: &mut Call<'_>, wanted: Ordering) -> Done {
    let further = |a: Value, b: Value| b.order(&a).map(|order| if order == wanted { b } else { a });
    let values = (value(call, Extreme::IN1), value(call, Extreme::IN2), value(call, Extreme::IN3));
    let result = match values {
        (Some(a), Some(b), Some(c)) => further(a, b).and_then(|best| further(best, c)),
        _ => None,
    };
    give(call, Extreme::RET_VAL, result)
}

fn select(call: &mut Call<'_>) -> Done {
    let (zero, one) = (value(call, Select::IN0), value(call, Select::IN1));
    let result = match (zero, one) {
        (Some(zero), Some(one)) if zero.ty == one.ty => Some(if call.bool(Select::G) { one } else { zero }),
        _ => None,
    };
    give(call, Select::RET_VAL, result)
}

#[cfg(test)]
mod tests {
    use crate::tests::{Fake, any};

    const INT: u8 = 5;
    const WORD: u8 = 4;
    const DINT: u8 = 7;
    const REAL: u8 = 8;

    fn number(ty: u8, value: f32) -> Vec<u8> {
        match ty {
            DINT => (value as i32).to_be_bytes().to_vec(),
            REAL => value.to_be_bytes().to_vec(),
            _ => (value as i16).to_be_bytes().to_vec(),
        }
    }

    /// Runs with inputs at MB 0, 4, 8 and the result at MB 12; the result's bytes when it was written.
    fn run(key: &str, names: [&str; 3], ty: [u8; 4], inputs: [f32; 3]) -> (Vec<u8>, bool) {
        let mut fake = Fake::new(key);
        for (i, (name, input)) in names.iter().zip(inputs).enumerate() {
            fake.memory(4 * i, &number(ty[i], input));
            fake = fake.with(name, any(ty[i], 1, 4 * i as u32));
        }
        fake.memory(12, &[0x55; 4]);
        fake = fake.with("RET_VAL", any(ty[3], 1, 12));
        fake.run();
        (fake.memory_at(12, number(ty[3], 0.0).len()).to_vec(), fake.br)
    }

    #[test]
    fn limits_and_extremes() {
        for ty in [INT, DINT, REAL] {
            for (inputs, result) in [([1., 5., 9.], 5.), ([1., -3., 9.], 1.), ([1., 10., 9.], 9.)] {
                let names = ["MN", "IN", "MX"];
                assert_eq!(run("IEC:LIMIT", names, [ty; 4], inputs), (number(ty, result), true), "{ty} {inputs:?}");
            }
            let names = ["IN1", "IN2", "IN3"];
            for (inputs, max, min) in [([1., 5., -9.], 5., -9.), ([7., 7., 3.], 7., 3.), ([1., 2., 3.], 3., 1.)] {
                assert_eq!(run("IEC:MAX", names, [ty; 4], inputs), (number(ty, max), true), "{ty} {inputs:?}");
                assert_eq!(run("IEC:MIN", names, [ty; 4], inputs), (number(ty, min), true), "{ty} {inputs:?}");
            }
        }
    }

    #[test]
    fn errors_leave_the_result_alone() {
        let names = ["MN", "IN", "MX"];
        let untouched = |len| (vec![0x55; len], false);
        assert_eq!(run("IEC:LIMIT", names, [INT; 4], [9., 5., 1.]), untouched(2), "limits crossed");
        assert_eq!(run("IEC:LIMIT", names, [INT, DINT, INT, INT], [1., 5., 9.]), untouched(2), "types differ");
        assert_eq!(run("IEC:LIMIT", names, [INT, INT, INT, REAL], [1., 5., 9.]), untouched(4), "type of the result");
        assert_eq!(run("IEC:LIMIT", names, [WORD; 4], [1., 5., 9.]), untouched(2), "no number");
        assert_eq!(run("IEC:LIMIT", names, [REAL; 4], [1., f32::NAN, 9.]), untouched(4));
        assert_eq!(run("IEC:MAX", ["IN1", "IN2", "IN3"], [REAL; 4], [1., 2., f32::INFINITY]), untouched(4));
    }

    #[test]
    fn one_of_two() {
        for (g, result) in [(0, 0x1234u16), (1, 0xABCD)] {
            let mut fake =
                Fake::new("IEC:SEL").with("G", [g]).with("IN0", any(WORD, 1, 0)).with("IN1", any(WORD, 1, 2));
            fake = fake.with("RET_VAL", any(WORD, 1, 4));
            fake.memory(0, &[0x12, 0x34, 0xAB, 0xCD]);
            fake.run();
            assert_eq!((fake.memory_at(4, 2), fake.br), (&result.to_be_bytes()[..], true));
        }
    }
}
