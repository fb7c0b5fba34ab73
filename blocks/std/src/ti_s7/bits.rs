//! FC 82 RSET, FC 83 SET: a row of bits. ["Bit Logic Functions"]

use ob1_model::BlockKind::Fc;

use super::place::Place;
use crate::Done;
use crate::call::Call;
use crate::declare::params;
use crate::row::{Origin, Row};

params!(Range { Input { S_BIT: POINTER, N: INT } });

pub(super) const ROWS: &[Row] = &[
    Row::new::<Range>(Origin::TiS7, Fc, 82, "RSET", |call| range(call, false)).note("the MCR is not looked at"),
    Row::new::<Range>(Origin::TiS7, Fc, 83, "SET", |call| range(call, true)).note("the MCR is not looked at"),
];

/// N bits from S_BIT on.
fn range(call: &mut Call<'_>, value: bool) -> Done {
    let count = u32::try_from(call.int(Range::N)).unwrap_or(0);
    let done = Place::of(call, Range::S_BIT).is_some_and(|place| {
        let first = u32::from(place.at.bit());
        (0..(first + count).div_ceil(8)).all(|byte| {
            // Which bits of this byte are concerned.
            let mask = (0..8).filter(|bit| (first..first + count).contains(&(8 * byte + bit)));
            let mask = mask.fold(0u8, |mask, bit| mask | 1 << bit);
            let mut old = [0];
            place.read(call, byte, &mut old).is_ok() && {
                let new = if value { old[0] | mask } else { old[0] & !mask };
                place.write(call, byte, &[new]).is_ok()
            }
        })
    });
    call.br(done)
}

#[cfg(test)]
mod tests {
    use crate::tests::{Fake, pointer};

    #[test]
    fn rows_of_bits() {
        for (key, start, count, before, after) in [
            ("SET", 3u8, 10i16, [0u8, 0, 0], [0xF8, 0x1F, 0]),
            ("RSET", 3, 10, [0xFF, 0xFF, 0xFF], [0x07, 0xE0, 0xFF]),
            ("SET", 0, 0, [0, 0, 0], [0, 0, 0]),
            ("SET", 7, -3, [0, 0, 0], [0, 0, 0]),
        ] {
            let mut place = pointer(10);
            place[5] |= start;
            let mut fake = Fake::new(&format!("TI-S7:{key}")).with("S_BIT", place).with("N", count.to_be_bytes());
            fake.memory(10, &before);
            fake.run();
            assert_eq!((fake.memory_at(10, 3), fake.br), (&after[..], true), "{key} {start} {count}");
        }
        let mut fake = Fake::new("TI-S7:SET").with("S_BIT", pointer(255)).with("N", [0, 9]);
        fake.run();
        assert!(!fake.br);
    }
}
