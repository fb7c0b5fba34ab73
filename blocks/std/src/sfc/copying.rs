//! SFC 20 BLKMOV, SFC 21 FILL, SFC 81 UBLKMOV. ["Copy and Block Functions"]

use crate::call::{Call, read_error, write_error};
use crate::copy::{self, Plan};
use crate::declare::{Params, params};
use crate::row::Row;
use crate::{AnyPointer, Done};

params!(BlkMov { Input { SRCBLK: ANY } Return { RET_VAL: INT } Output { DSTBLK: ANY } });
params!(Fill { Input { BVAL: ANY } Return { RET_VAL: INT } Output { BLK: ANY } });

pub(super) const ROWS: &[Row] = &[
    Row::sfc::<BlkMov>(20, "BLKMOV", block_move),
    Row::sfc::<Fill>(21, "FILL", |call| run(call, Fill::BVAL, Fill::RET_VAL, Fill::BLK, copy::fill)),
    Row::sfc::<BlkMov>(81, "UBLKMOV", block_move).note("as BLKMOV, which is not interrupted either"),
];

/// Bytes copied at a time.
const CHUNK: u32 = 256;

/// What is copied for a source and a target.
type Planner = fn(Option<AnyPointer>, Option<AnyPointer>) -> Result<Plan, u16>;

fn block_move(call: &mut Call<'_>) -> Done {
    run(call, BlkMov::SRCBLK, BlkMov::RET_VAL, BlkMov::DSTBLK, copy::block_move)
}

fn run<P: Params>(call: &mut Call<'_>, source: P, ret_val: P, target: P, plan: Planner) -> Done {
    let (from, to) = (call.any(source), call.any(target));
    let code = plan(from, to).and_then(|plan| carry_out(call, &plan)).err().unwrap_or(0);
    call.end(ret_val, code)
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
    use crate::testing::{Fake, any};

    #[test]
    fn moves_and_fills() {
        for (key, names, from, to, result, code) in [
            ("SYSTEM:SFC20", ["SRCBLK", "DSTBLK"], any(2, 3, 0), any(2, 5, 100), [1, 2, 3, 0, 0], 0),
            ("SYSTEM:SFC81", ["SRCBLK", "DSTBLK"], any(4, 2, 0), any(2, 3, 100), [1, 2, 3, 0, 0], 0),
            ("SYSTEM:SFC21", ["BVAL", "BLK"], any(2, 2, 0), any(2, 5, 100), [1, 2, 1, 2, 1], 0),
            ("SYSTEM:SFC20", ["SRCBLK", "DSTBLK"], any(2, 8, 250), any(2, 8, 100), [0; 5], 0x8122),
            ("SYSTEM:SFC20", ["SRCBLK", "DSTBLK"], any(2, 8, 0), any(2, 8, 250), [0; 5], 0x8323),
            ("SYSTEM:SFC21", ["BVAL", "BLK"], any(1, 3, 0), any(2, 8, 100), [0; 5], 0x8124),
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
}
