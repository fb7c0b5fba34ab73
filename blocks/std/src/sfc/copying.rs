//! SFC 20 BLKMOV, SFC 21 FILL, SFC 81 UBLKMOV. ["Copy and Block Functions"]

use crate::call::{Call, Code, read_error, write_error};
use crate::copy::{self, Plan, Side};
use crate::declare::{Params, params};
use crate::row::Row;
use crate::text::Text;
use crate::{AnyType, Refused};

params!(BlkMov { Input { SRCBLK: ANY } Return { RET_VAL: INT } Output { DSTBLK: ANY } });
params!(Fill { Input { BVAL: ANY } Return { RET_VAL: INT } Output { BLK: ANY } });

pub(super) const ROWS: &[Row] = &[
    Row::coded::<BlkMov>(20, "BLKMOV", block_move)
        .note("a STRING is moved whole, and the target keeps its maximum length"),
    Row::coded::<Fill>(21, "FILL", |call| copied(call, Fill::BVAL, Fill::BLK, copy::fill)),
    Row::coded::<BlkMov>(81, "UBLKMOV", block_move).note("as BLKMOV, which is not interrupted either"),
];

/// Bytes copied at a time.
const CHUNK: u32 = 256;

/// What is copied for a source and a target.
type Planner = fn(Option<Side>, Option<Side>) -> Result<Plan, u16>;

fn block_move(call: &mut Call<'_>) -> Code {
    copied(call, BlkMov::SRCBLK, BlkMov::DSTBLK, copy::block_move)
}

fn copied<P: Params>(call: &mut Call<'_>, source: P, target: P, plan: Planner) -> Code {
    let from = side(call, source).map_err(|e| read_error(1, e))?;
    let to = side(call, target).map_err(|e| write_error(3, e))?;
    let plan = plan(from, to)?;
    match (plan.source.ty, plan.target.ty) {
        (AnyType::String, AnyType::String) => assign(call, &plan)?,
        _ => carry_out(call, &plan)?,
    }
    Ok(0)
}

/// A pointer, and of a STRING its maximum length.
fn side<P: Params>(call: &mut Call<'_>, p: P) -> Result<Option<Side>, Refused> {
    let Some(any) = call.any(p) else { return Ok(None) };
    let mut max = [0];
    if any.ty == AnyType::String && any.at.bit() == 0 {
        call.read_at(&any, 0, &mut max)?;
    }
    Ok(Some(Side { any, max: max[0] }))
}

/// From one STRING to another: the characters, as many as the target may hold. Its maximum length stays.
fn assign(call: &mut Call<'_>, plan: &Plan) -> Result<(), u16> {
    let mut lengths = [0; 2];
    call.read_at(&plan.source, 0, &mut lengths).map_err(|e| read_error(1, e))?;
    let room = plan.bytes.saturating_sub(2).min(Text::MAX as u32) as u8;
    let mut text = Text::with_len([lengths[0].min(room), lengths[1]]);
    call.read_at(&plan.source, 2, text.as_mut_slice()).map_err(|e| read_error(1, e))?;
    call.write_at(&plan.target, 1, &[text.as_slice().len() as u8]).map_err(|e| write_error(3, e))?;
    call.write_at(&plan.target, 2, text.as_slice()).map_err(|e| write_error(3, e))
}

/// Copies piece by piece.
fn carry_out(call: &mut Call<'_>, plan: &Plan) -> Result<(), u16> {
    let mut buffer = [0; CHUNK as usize];
    let mut done = 0;
    while done < plan.bytes {
        let phase = done % plan.period;
        let len = (plan.bytes - done).min(plan.period - phase).min(CHUNK);
        let piece = &mut buffer[..len as usize];
        call.read_at(&plan.source, phase, piece).map_err(|e| read_error(1, e))?;
        call.write_at(&plan.target, done, piece).map_err(|e| write_error(3, e))?;
        done += len;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::tests::{Fake, any};

    #[test]
    fn moves_and_fills() {
        for (key, names, from, to, result, code) in [
            ("SYSTEM:SFC20", ["SRCBLK", "DSTBLK"], any(2, 3, 0), any(2, 5, 100), [1, 2, 3, 0, 0], 0),
            ("SYSTEM:SFC81", ["SRCBLK", "DSTBLK"], any(4, 2, 0), any(2, 3, 100), [1, 2, 3, 0, 0], 0),
            ("SYSTEM:SFC21", ["BVAL", "BLK"], any(2, 2, 0), any(2, 5, 100), [1, 2, 1, 2, 1], 0),
            ("SYSTEM:SFC20", ["SRCBLK", "DSTBLK"], any(2, 8, 250), any(2, 8, 100), [0; 5], 0x8122),
            ("SYSTEM:SFC20", ["SRCBLK", "DSTBLK"], any(2, 8, 0), any(2, 8, 250), [0; 5], 0x8323),
            ("SYSTEM:SFC21", ["BVAL", "BLK"], any(1, 3, 0), any(2, 8, 100), [0; 5], 0x8122),
        ] {
            let mut fake = Fake::new(key).with(names[0], from).with(names[1], to).with("RET_VAL", [9; 2]);
            fake.memory(0, &[1, 2, 3, 4]);
            fake.run();
            assert_eq!(
                (fake.memory_at(100, 5), fake.value("RET_VAL"), fake.br),
                (&result[..], code, code == 0),
                "{key}"
            );
        }
    }

    #[test]
    fn data_blocks() {
        let mut from = any(2, 4, 0);
        from[5] = 10;
        from[6] = 0x84;
        let mut fake = Fake::new("SYSTEM:BLKMOV").with("SRCBLK", from).with("DSTBLK", any(2, 4, 8));
        fake = fake.with("RET_VAL", [0; 2]);
        fake.area(ob1_model::Area::Db, 10)[..4].copy_from_slice(&[4, 3, 2, 1]);
        fake.run();
        assert_eq!(fake.memory_at(8, 4), [4, 3, 2, 1]);
        from[5] = 11;
        fake.set("SRCBLK", &from);
        fake.run();
        assert_eq!((fake.value("RET_VAL"), fake.br), (0x813A, false));
    }

    #[test]
    fn a_string_keeps_its_maximum_length() {
        for (max, kept) in [(8u8, "hello"), (3, "hel"), (0, "")] {
            let mut fake = Fake::new("SYSTEM:SFC20").with("SRCBLK", any(0x13, 1, 0)).with("DSTBLK", any(0x13, 1, 100));
            fake = fake.with("RET_VAL", [9; 2]);
            fake.memory(0, &[10, 5, b'h', b'e', b'l', b'l', b'o', b'x', b'x', b'x', b'x', b'x']);
            fake.memory(100, &[max, 0, b'.', b'.', b'.', b'.', b'.', b'.', b'.', b'.']);
            fake.run();
            let mut wanted = [max, kept.len() as u8, b'.', b'.', b'.', b'.', b'.', b'.'];
            wanted[2..2 + kept.len()].copy_from_slice(kept.as_bytes());
            assert_eq!((fake.memory_at(100, 8), fake.value("RET_VAL")), (&wanted[..], 0), "maximum {max}");
        }
    }
}
