//! FB 86 PACK: data from many places into a table, and out of it. ["Collect/Distribute Table Data"]

use ob1_model::BitAddr;
use ob1_model::BlockKind::Fb;

use super::place::Place;
use crate::call::{Call, Code};
use crate::declare::params;
use crate::row::Row;
use crate::{AnyPointer, AnyType};

params!(Pack {
    Input { TABLE: POINTER, P_DATA1: ANY, P_DATA2: ANY, P_DATA3: ANY, P_DATA4: ANY, P_DATA5: ANY }
    Output { ERR_CODE: WORD }
    Static { DIR: BOOL }
});

pub(super) const ROWS: &[Row] = &[Row::ti::<Pack>(Fb, 86, "PACK", pack)];

/// A parameter names memory that cannot be used.
const MEMORY: u16 = 0x0001;
/// A type that cannot be packed.
const TYPE: u16 = 0x0002;

/// Bits that one element takes, and the boundary in the table at which it begins.
const fn element(ty: AnyType) -> Option<(u32, u32)> {
    Some(match ty {
        AnyType::Bool => (1, 1),
        AnyType::Byte | AnyType::Char => (8, 8),
        AnyType::Word | AnyType::Int => (16, 16),
        AnyType::DWord | AnyType::DInt | AnyType::Real => (32, 16),
        _ => return None,
    })
}

fn pack(call: &mut Call<'_>) -> Code {
    let table = Place::of(call, Pack::TABLE).ok_or(MEMORY)?;
    let from_table = call.bool(Pack::DIR);
    // The next bit of the table, from its first byte on.
    let mut next = 0;
    for p in [Pack::P_DATA1, Pack::P_DATA2, Pack::P_DATA3, Pack::P_DATA4, Pack::P_DATA5] {
        let Some(any) = call.any(p).filter(|any| any.ty != AnyType::Nil && any.count > 0) else { continue };
        let (bits, boundary) = element(any.ty).ok_or(TYPE)?;
        let data = Place { area: any.area, db: any.db, at: any.at };
        if boundary > 1 {
            let begin = u32::next_multiple_of(next, boundary);
            fill(call, table, next..begin, from_table)?;
            next = begin;
        }
        transfer(call, &any, (data, table, next), from_table)?;
        next += u32::from(any.count) * bits;
    }
    let end = next.next_multiple_of(8);
    fill(call, table, next..end, from_table)?;
    Ok(0)
}

/// Unused bits of the table become 0.
fn fill(call: &mut Call<'_>, table: Place, bits: std::ops::Range<u32>, from_table: bool) -> Result<(), u16> {
    if from_table {
        return Ok(());
    }
    let mut bits = bits;
    bits.try_for_each(|bit| put_bit(call, table, bit, false))
}

fn transfer(
    call: &mut Call<'_>,
    any: &AnyPointer,
    (data, table, next): (Place, Place, u32),
    from_table: bool,
) -> Result<(), u16> {
    if any.ty == AnyType::Bool {
        let first = u32::from(any.at.bit());
        let data = Place { at: BitAddr(data.at.0 & !7), ..data };
        return (0..u32::from(any.count)).try_for_each(|i| {
            let ((from, at), (to, put)) = if from_table {
                ((table, next + i), (data, first + i))
            } else {
                ((data, first + i), (table, next + i))
            };
            let bit = get_bit(call, from, at)?;
            put_bit(call, to, put, bit)
        });
    }
    let bytes = any.bytes().ok_or(MEMORY)?;
    (0..bytes).try_for_each(|i| {
        let ((from, at), (to, put)) =
            if from_table { ((table, next / 8 + i), (data, i)) } else { ((data, i), (table, next / 8 + i)) };
        let mut byte = [0];
        from.read(call, at, &mut byte).map_err(|_| MEMORY)?;
        to.write(call, put, &byte).map_err(|_| MEMORY)
    })
}

fn get_bit(call: &mut Call<'_>, place: Place, bit: u32) -> Result<bool, u16> {
    let mut byte = [0];
    place.read(call, bit / 8, &mut byte).map_err(|_| MEMORY)?;
    Ok(byte[0] >> (bit % 8) & 1 == 1)
}

fn put_bit(call: &mut Call<'_>, place: Place, bit: u32, value: bool) -> Result<(), u16> {
    let mut byte = [0];
    place.read(call, bit / 8, &mut byte).map_err(|_| MEMORY)?;
    let mask = 1 << (bit % 8);
    byte[0] = if value { byte[0] | mask } else { byte[0] & !mask };
    place.write(call, bit / 8, &byte).map_err(|_| MEMORY)
}

#[cfg(test)]
mod tests {
    use crate::tests::{Fake, any, pointer};

    /// The manual's example: two bits, a byte, two bits, a word.
    fn fake() -> Fake {
        let fake = Fake::new("TI-S7:PACK").with("TABLE", pointer(100)).with("P_DATA1", any(1, 2, 20));
        let fake = fake.with("P_DATA2", any(2, 1, 21)).with("P_DATA3", any(1, 2, 30)).with("P_DATA4", any(4, 1, 33));
        assert_eq!((fake.at("ERR_CODE"), fake.at("DIR")), ("56.0".into(), "58.0".into()));
        fake
    }

    #[test]
    fn into_the_table_and_out_of_it() {
        let mut fake = fake();
        fake.memory(20, &[0x03, 0xFF]);
        fake.memory(30, &[0x03, 0, 0, 0xFF, 0xFF]);
        fake.memory(100, &[0xEE; 8]);
        fake.run();
        assert_eq!((fake.memory_at(100, 7), fake.value("ERR_CODE")), (&[3, 0xFF, 3, 0, 0xFF, 0xFF, 0xEE][..], 0));

        fake.memory(20, &[0x80, 0]);
        fake.memory(30, &[0x40, 0, 0, 0, 0]);
        fake.set("DIR", &[1]);
        fake.run();
        assert_eq!((fake.memory_at(20, 2), fake.memory_at(30, 5)), (&[0x83, 0xFF][..], &[0x43, 0, 0, 0xFF, 0xFF][..]));
    }

    #[test]
    fn what_cannot_be_packed() {
        for (data, table, code) in [(any(0x0E, 1, 20), 100, 2), (any(2, 1, 300), 100, 1), (any(2, 9, 20), 252, 1)] {
            let mut fake = fake().with("P_DATA1", data).with("TABLE", pointer(table));
            fake.run();
            assert_eq!((fake.value("ERR_CODE"), fake.br), (code, false));
        }
    }
}
