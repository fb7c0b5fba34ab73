//! FC 102 DEV, FC 103 CDT, FC 104 TBL_TBL: functions of whole tables. ["Table Functions"]

use ob1_model::BlockKind::Fc;

use super::place::{Element, Place};
use crate::call::{Call, Code};
use crate::declare::{Params, params};
use crate::row::Row;

params!(Dev { Input { TBL: POINTER, OUT: POINTER, E_TYPE: BYTE } Return { RET_VAL: WORD } });
params!(Cdt {
    Input { IN_TBL: POINTER, OUT_TBL: POINTER, IN: POINTER, OUT: POINTER, E_TYPE: BYTE }
    Return { RET_VAL: WORD }
});
params!(TblTbl {
    Input { TBL1: POINTER, TBL2: POINTER, DEST_TBL: POINTER, CMD: BYTE, E_TYPE: BYTE }
    Return { RET_VAL: WORD }
});

pub(super) const ROWS: &[Row] = &[
    Row::ti::<Dev>(Fc, 102, "DEV", dev),
    Row::ti::<Cdt>(Fc, 103, "CDT", cdt),
    Row::ti::<TblTbl>(Fc, 104, "TBL_TBL", tbl_tbl),
];

/// A parameter names memory that cannot be used.
const MEMORY: u16 = 0x0001;
/// The type is not one of the block's.
const TYPE: u16 = 0x0002;
/// The tables have different lengths.
const LENGTHS: u16 = 0x0003;
/// The table is empty.
const EMPTY: u16 = 0x0004;
/// Command and type do not go together.
const MISMATCH: u16 = 0x0005;
/// The command is not one of the block's.
const COMMAND: u16 = 0x0006;
/// No entry is as large as the value.
const TOO_LARGE: u16 = 0x0007;

fn place(call: &mut Call<'_>, p: impl Params) -> Result<Place, u16> {
    Place::of(call, p).ok_or(MEMORY)
}

/// The type of a table's elements: INT, DINT or REAL.
fn number(call: &mut Call<'_>, p: impl Params) -> Result<Element, u16> {
    let element = Element::of(call.byte(p)).ok_or(TYPE)?;
    if matches!(element, Element::Int | Element::DInt | Element::Real) { Ok(element) } else { Err(TYPE) }
}

/// The length of a table, which is not 0.
fn length(call: &mut Call<'_>, table: Place) -> Result<u32, u16> {
    match table.word(call, 0) {
        Ok(0) => Err(EMPTY),
        Ok(length) => Ok(u32::from(length)),
        Err(_) => Err(MEMORY),
    }
}

/// The root of (sum of squares - square of the sum / n) / (n - 1).
fn dev(call: &mut Call<'_>) -> Code {
    let element = number(call, Dev::E_TYPE)?;
    let (table, out) = (place(call, Dev::TBL)?, place(call, Dev::OUT)?);
    let count = length(call, table)?;
    let (mut sum, mut squares) = (0.0, 0.0);
    for number in 1..=count {
        let value = element.value(element.get(call, table, element.entry(number)).map_err(|_| MEMORY)?);
        sum += value;
        squares += value * value;
    }
    let n = f64::from(count);
    let deviation = if count == 1 { 0.0 } else { ((squares - sum * sum / n) / (n - 1.0)).max(0.0).sqrt() };
    element.put(call, out, 0, element.bits_of(deviation)).map_or(Err(MEMORY), |()| Ok(0))
}

/// The entry of the second table that belongs to the first entry of the first which is not smaller than the value.
fn cdt(call: &mut Call<'_>) -> Code {
    let element = number(call, Cdt::E_TYPE)?;
    let (from, to) = (place(call, Cdt::IN_TBL)?, place(call, Cdt::OUT_TBL)?);
    let (input, out) = (place(call, Cdt::IN)?, place(call, Cdt::OUT)?);
    let count = length(call, from)?;
    if length(call, to)? != count {
        return Err(LENGTHS);
    }
    let wanted = element.value(element.get(call, input, 0).map_err(|_| MEMORY)?);
    for number in 1..=count {
        let at = element.entry(number);
        if element.value(element.get(call, from, at).map_err(|_| MEMORY)?) >= wanted {
            let value = element.get(call, to, at).map_err(|_| MEMORY)?;
            return element.put(call, out, 0, value).map_or(Err(MEMORY), |()| Ok(0));
        }
    }
    Err(TOO_LARGE)
}

/// CMD: 7 AND, 8 OR, 9 XOR, 0Ah add, 0Bh subtract, 0Ch multiply, 0Dh divide, entry by entry.
fn tbl_tbl(call: &mut Call<'_>) -> Code {
    let element = Element::of(call.byte(TblTbl::E_TYPE)).filter(|e| *e != Element::Byte).ok_or(TYPE)?;
    let command = call.byte(TblTbl::CMD);
    match command {
        7..=9 if element == Element::Real => return Err(MISMATCH),
        0x0A..=0x0D if !matches!(element, Element::Int | Element::DInt | Element::Real) => return Err(MISMATCH),
        7..=0x0D => {}
        _ => return Err(COMMAND),
    }
    let (one, two, to) = (place(call, TblTbl::TBL1)?, place(call, TblTbl::TBL2)?, place(call, TblTbl::DEST_TBL)?);
    let count = length(call, one)?;
    if length(call, two)? != count || length(call, to)? != count {
        return Err(LENGTHS);
    }
    for number in 1..=count {
        let at = element.entry(number);
        let a = element.get(call, one, at).map_err(|_| MEMORY)?;
        let b = element.get(call, two, at).map_err(|_| MEMORY)?;
        let values = (element.value(a), element.value(b));
        let result = match command {
            7 => a & b,
            8 => a | b,
            9 => a ^ b,
            0x0A => element.bits_of(values.0 + values.1),
            0x0B => element.bits_of(values.0 - values.1),
            0x0C => element.bits_of(values.0 * values.1),
            _ if element == Element::Real => element.bits_of(values.0 / values.1),
            // A division of whole numbers by 0 gives 0 here; it has no fraction.
            _ if values.1 == 0.0 => 0,
            _ => element.bits_of((values.0 / values.1).trunc()),
        };
        element.put(call, to, at, result).map_err(|_| MEMORY)?;
    }
    Ok(0)
}

#[cfg(test)]
mod tests {
    use crate::tests::{Fake, pointer};

    #[test]
    fn the_deviation_of_the_manual() {
        for (ty, count, code) in [(8u8, 5u16, 0), (6, 5, 2), (8, 0, 4), (8, 200, 1)] {
            let mut fake = Fake::new("TI-S7:DEV").with("TBL", pointer(100)).with("OUT", pointer(130));
            fake = fake.with("E_TYPE", [ty]).with("RET_VAL", [9; 2]);
            let values = [2f32, 4.0, 8.0, 16.0, 32.0].map(f32::to_be_bytes).concat();
            fake.memory(100, &[&count.to_be_bytes()[..], &values].concat());
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.br), (code, code == 0), "{ty} {count}");
            if code == 0 {
                let out = f32::from_be_bytes(fake.memory_at(130, 4).try_into().expect("four"));
                assert!((out - 12.198_36).abs() < 1e-4, "{out}");
            }
        }
    }

    #[test]
    fn correlated_tables() {
        for (value, lengths, code, out) in [
            (22i16, [3u16, 3], 0, 300u16),
            (10, [3, 3], 0, 100),
            (-5, [3, 3], 0, 100),
            (31, [3, 3], 7, 9),
            (1, [3, 2], 3, 9),
            (1, [0, 0], 4, 9),
        ] {
            let mut fake = Fake::new("TI-S7:CDT").with("IN_TBL", pointer(0)).with("OUT_TBL", pointer(20));
            fake = fake.with("IN", pointer(40)).with("OUT", pointer(42)).with("E_TYPE", [5]).with("RET_VAL", [9; 2]);
            let words = |words: [u16; 4]| words.map(u16::to_be_bytes).concat();
            fake.memory(0, &words([lengths[0], 10, 20, 30]));
            fake.memory(20, &words([lengths[1], 100, 200, 300]));
            fake.memory(40, &[&value.to_be_bytes()[..], &9u16.to_be_bytes()].concat());
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.memory_at(42, 2)), (code, &out.to_be_bytes()[..]), "{value}");
        }
    }

    #[test]
    fn tables_are_linked() {
        for (command, ty, code, result) in [
            (7u8, 4u8, 0, [0x0011u16, 0x2200]),
            (8, 4, 0, [0x11FF, 0xFF22]),
            (9, 4, 0, [0x11EE, 0xDD22]),
            (0x0A, 5, 0, [0x1210, 0x2122]),
            (0x0B, 5, 0, [0xEFEE, 0xDCDE]),
            (0x0C, 5, 0, [0x7FFF, 0x8000]),
            (0x0D, 5, 0, [0, 0]),
            (0x0A, 4, 5, [0, 0]),
            (7, 8, 5, [0, 0]),
            (6, 4, 6, [0, 0]),
            (7, 2, 2, [0, 0]),
        ] {
            let mut fake = Fake::new("TI-S7:TBL_TBL").with("TBL1", pointer(0)).with("TBL2", pointer(20));
            fake = fake.with("DEST_TBL", pointer(40)).with("CMD", [command]).with("E_TYPE", [ty]);
            fake = fake.with("RET_VAL", [9; 2]);
            for (at, words) in [(0, [2u16, 0x00FF, 0xFF00]), (20, [2, 0x1111, 0x2222]), (40, [2, 0, 0])] {
                fake.memory(at, &words.map(u16::to_be_bytes).concat());
            }
            fake.run();
            assert_eq!(fake.value("RET_VAL"), code, "{command} {ty}");
            assert_eq!(fake.memory_at(42, 4), result.map(u16::to_be_bytes).concat(), "{command} {ty}");
        }
    }
}
