//! SFC 79 SET, SFC 80 RSET: bits of the peripheral outputs. ["Processing Bit Fields"]

use ob1_model::{Area, BitAddr, FaultKind};

use crate::Refused;
use crate::call::{Call, Code, write_error};
use crate::copy::parameter_error;
use crate::declare::params;
use crate::row::Row;

params!(SetBits { Input { N: INT } Return { RET_VAL: INT } Output { SA: POINTER } });

const NOTE: &str =
    "whole bytes are written at once; a byte of which only some bits are concerned must lie in the process image";

pub(super) const ROWS: &[Row] = &[
    Row::coded::<SetBits>(79, "SET", |call| bits(call, true)).note(NOTE),
    Row::coded::<SetBits>(80, "RSET", |call| bits(call, false)).note(NOTE),
];

fn bits(call: &mut Call<'_>, value: bool) -> Code {
    let mut pointer = [0; 6];
    let wrong = parameter_error(3, FaultKind::AreaWrite);
    call.cx.read(2, 0, &mut pointer).map_err(|_| wrong)?;
    if Area::from_pointer_code(pointer[2]) != Some(Area::Peripheral) {
        return Err(wrong);
    }
    let count = u32::try_from(call.int(SetBits::N)).map_err(|_| parameter_error(1, FaultKind::AreaLengthWrite))?;
    let first = u32::from_be_bytes([0, pointer[3], pointer[4], pointer[5]]) & 0x7_FFFF;
    let end = first + count;
    let mut bit = first;
    while bit < end {
        let (byte, low) = (bit / 8, BitAddr(bit).bit());
        let here = (end - bit).min(8 - u32::from(low));
        let mask = (((1u16 << here) - 1) as u8) << low;
        let mut now = [0];
        if mask != 0xFF {
            call.cx.pointer_read(Area::Output, 0, byte, &mut now).map_err(|e| write_error(3, e))?;
        }
        let new = if value { now[0] | mask } else { now[0] & !mask };
        call.cx.io_write(byte, &[new]).map_err(|_| write_error(3, Refused::Outside))?;
        bit += here;
    }
    Ok(0)
}

#[cfg(test)]
mod tests {
    use ob1_model::Area;

    use crate::tests::Fake;

    #[test]
    fn sets_and_resets() {
        for (key, n, first, image, result, code) in [
            ("SYSTEM:SFC79", 12i16, 8 + 6, [0x01, 0, 0], [0xC1, 0xFF, 0x03], 0),
            ("SYSTEM:SFC80", 3, 8, [0x0F, 0, 0], [0x08, 0, 0], 0),
            ("SYSTEM:SFC79", 0, 8, [0, 0, 0], [0, 0, 0], 0),
            ("SYSTEM:SFC79", -1, 8, [0, 0, 0], [0, 0, 0], 0x8123),
            ("SYSTEM:SFC79", 1, 8 * 400, [0, 0, 0], [0, 0, 0], 0x8323),
            ("SYSTEM:SFC79", 8, 8 * 600, [0, 0, 0], [0, 0, 0], 0x8323),
        ] {
            let at = u32::to_be_bytes(first);
            let mut fake = Fake::new(key).with("N", n.to_be_bytes()).with("SA", [0, 0, 0x80, at[1], at[2], at[3]]);
            fake = fake.with("RET_VAL", [9; 2]);
            fake.area(Area::Output, 0)[1..4].copy_from_slice(&image);
            fake.run();
            assert_eq!(
                (&fake.io[1][1..4], fake.value("RET_VAL"), fake.br),
                (&result[..], code, code == 0),
                "{key} {n} {first}"
            );
        }
        let mut fake =
            Fake::new("SYSTEM:SFC79").with("N", [0, 1]).with("SA", [0, 0, 0x83, 0, 0, 0]).with("RET_VAL", [0; 2]);
        fake.run();
        assert_eq!(fake.value("RET_VAL"), 0x8325, "bit memory is not meant");
    }
}
