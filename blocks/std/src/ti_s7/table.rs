//! FC 84 ATT, FC 85 FIFO, FC 87 LIFO: tables of words that fill and empty; FC 86 TBL_FIND, FC 88 TBL, FC 89 TBL_WRD,
//! FC 91 WRD_TBL: tables of any element. ["Table Functions"]

use ob1_model::BlockKind::Fc;

use super::place::{Element, Place};
use crate::Done;
use crate::call::{Call, Code};
use crate::declare::params;
use crate::row::{Origin, Row};

params!(Att { Input { DATA: WORD, TABLE: POINTER } });
params!(Take { Input { TABLE: POINTER } Return { RET_VAL: WORD } });
params!(TblFind {
    Input { SRC: POINTER, PATRN: POINTER, CMD: BYTE, E_TYPE: BYTE }
    Return { RET_VAL: WORD }
    InOut { INDX: WORD }
});
params!(Tbl { Input { SRC: POINTER, CMD: BYTE, E_TYPE: BYTE } Return { RET_VAL: WORD } });
params!(TblWrd {
    Input { SRC: POINTER, DEST: POINTER, E_TYPE: BYTE }
    Return { RET_VAL: WORD }
    Output { Q: BOOL }
    InOut { INDX: WORD }
});
params!(WrdTbl {
    Input { SRC: POINTER, TABLE: POINTER, CMD: BYTE, E_TYPE: BYTE }
    Return { RET_VAL: WORD }
    Output { Q: BOOL }
    InOut { INDX: WORD }
});

pub(super) const ROWS: &[Row] = &[
    Row::new::<Att>(Origin::TiS7, Fc, 84, "ATT", att),
    Row::new::<Take>(Origin::TiS7, Fc, 85, "FIFO", |call| take(call, true)),
    Row::ti::<TblFind>(Fc, 86, "TBL_FIND", tbl_find),
    Row::new::<Take>(Origin::TiS7, Fc, 87, "LIFO", |call| take(call, false)),
    Row::ti::<Tbl>(Fc, 88, "TBL", tbl),
    Row::ti::<TblWrd>(Fc, 89, "TBL_WRD", tbl_wrd),
    Row::ti::<WrdTbl>(Fc, 91, "WRD_TBL", wrd_tbl),
];

/// The index is 0, or beyond the table (FC 86).
const INDEX: u16 = 0x0007;
/// Nothing found (FC 86), a wrong command or type (FC 88, 89, 91).
const NOTHING: u16 = 0x0008;
/// A wrong command or type (FC 86), the index is beyond the table (FC 89, 91).
const BEYOND: u16 = 0x0009;

/// A table of words that fills: its size, how many words there are, then the words.
fn att(call: &mut Call<'_>) -> Done {
    let data = call.word(Att::DATA).to_be_bytes();
    let done = Place::of(call, Att::TABLE).and_then(|table| {
        let (size, used) = (table.word(call, 0).ok()?, table.word(call, 2).ok()?);
        if used >= size {
            return None;
        }
        table.write(call, 4 + 2 * u32::from(used), &data).ok()?;
        table.write(call, 2, &(used + 1).to_be_bytes()).ok()
    });
    call.br(done.is_some())
}

/// Takes the oldest word, and those after it move up; or takes the newest.
fn take(call: &mut Call<'_>, oldest: bool) -> Done {
    let taken = Place::of(call, Take::TABLE).and_then(|table| {
        let used = u32::from(table.word(call, 2).ok()?);
        let last = used.checked_sub(1)?;
        let word = table.word(call, if oldest { 4 } else { 4 + 2 * last }).ok()?;
        if oldest {
            for i in 0..last {
                let next = table.word(call, 4 + 2 * (i + 1)).ok()?;
                table.write(call, 4 + 2 * i, &next.to_be_bytes()).ok()?;
            }
        }
        table.write(call, 2, &(last as u16).to_be_bytes()).ok()?;
        Some(word)
    });
    if let Some(word) = taken {
        call.set(Take::RET_VAL, u32::from(word));
    }
    call.br(taken.is_some())
}

/// The next entry after INDX that equals the pattern (CMD 1), or differs from it (2).
fn tbl_find(call: &mut Call<'_>) -> Code {
    let (command, element) = (call.byte(TblFind::CMD), Element::of(call.byte(TblFind::E_TYPE)));
    let element = element.filter(|_| matches!(command, 1 | 2)).ok_or(BEYOND)?;
    let table = Place::of(call, TblFind::SRC).ok_or(NOTHING)?;
    let pattern = Place::of(call, TblFind::PATRN).ok_or(NOTHING)?;
    let start = u32::from(call.word(TblFind::INDX));
    let size = table.word(call, 0).map_err(|_| NOTHING)?;
    let wanted = element.get(call, pattern, 0).map_err(|_| NOTHING)?;
    if start > u32::from(size) {
        return Err(INDEX);
    }
    for number in start + 1..=u32::from(size) {
        match element.get(call, table, element.entry(number)) {
            Ok(entry) if (entry == wanted) == (command == 1) => {
                call.set(TblFind::INDX, number);
                return Ok(0);
            }
            Ok(_) => {}
            Err(_) => break,
        }
    }
    call.set(TblFind::INDX, u32::from(size) + 1);
    Err(NOTHING)
}

/// CMD: 3 ones complement, 4 clear, 5 negate, 6 square root, of every entry.
fn tbl(call: &mut Call<'_>) -> Code {
    let (command, element) = (call.byte(Tbl::CMD), Element::of(call.byte(Tbl::E_TYPE)));
    let element = element.filter(|element| match command {
        3 => !matches!(element, Element::Byte | Element::Real),
        4 => *element != Element::Byte,
        5 | 6 => matches!(element, Element::Int | Element::DInt | Element::Real),
        _ => false,
    });
    let element = element.ok_or(NOTHING)?;
    let table = Place::of(call, Tbl::SRC).ok_or(NOTHING)?;
    let done = table.word(call, 0).and_then(|size| {
        (1..=u32::from(size)).try_for_each(|number| {
            let at = element.entry(number);
            let old = element.get(call, table, at)?;
            let new = match command {
                3 => !old,
                4 => 0,
                5 if element == Element::Real => old ^ 0x8000_0000,
                5 => old.wrapping_neg(),
                _ => element.bits_of(element.value(old).sqrt()),
            };
            element.put(call, table, at, new)
        })
    });
    done.map_or(Err(NOTHING), |()| Ok(0))
}

/// The entry INDX names and the step to the next: `Err` with RET_VAL. Q tells that another follows.
fn entry(call: &mut Call<'_>, table: Place, index: u16) -> Result<(u32, bool), u16> {
    if index == 0 {
        return Err(INDEX);
    }
    match table.word(call, 0) {
        Ok(size) if index <= size => Ok((u32::from(index), index < size)),
        _ => Err(BEYOND),
    }
}

fn tbl_wrd(call: &mut Call<'_>) -> Code {
    let element = Element::of(call.byte(TblWrd::E_TYPE)).filter(|element| *element != Element::Byte);
    let element = element.ok_or(NOTHING)?;
    let table = Place::of(call, TblWrd::SRC).ok_or(NOTHING)?;
    let to = Place::of(call, TblWrd::DEST).ok_or(NOTHING)?;
    let index = call.word(TblWrd::INDX);
    let (number, more) = entry(call, table, index)?;
    let value = element.get(call, table, element.entry(number)).map_err(|_| BEYOND)?;
    element.put(call, to, 0, value).map_err(|_| NOTHING)?;
    call.set_bool(TblWrd::Q, more);
    call.set(TblWrd::INDX, number + u32::from(more));
    Ok(0)
}

/// CMD: 7 AND, 8 OR, 9 XOR, 0Eh transfer.
fn wrd_tbl(call: &mut Call<'_>) -> Code {
    let command = call.byte(WrdTbl::CMD);
    let element = Element::of(call.byte(WrdTbl::E_TYPE)).filter(|element| match command {
        7..=9 => !matches!(element, Element::Byte | Element::Real),
        0x0E => *element != Element::Byte,
        _ => false,
    });
    let element = element.ok_or(NOTHING)?;
    let from = Place::of(call, WrdTbl::SRC).ok_or(NOTHING)?;
    let table = Place::of(call, WrdTbl::TABLE).ok_or(NOTHING)?;
    let index = call.word(WrdTbl::INDX);
    let (number, more) = entry(call, table, index)?;
    let at = element.entry(number);
    let given = element.get(call, from, 0).map_err(|_| NOTHING)?;
    let old = element.get(call, table, at).map_err(|_| BEYOND)?;
    let new = match command {
        7 => old & given,
        8 => old | given,
        9 => old ^ given,
        _ => given,
    };
    element.put(call, table, at, new).map_err(|_| BEYOND)?;
    call.set_bool(WrdTbl::Q, more);
    call.set(WrdTbl::INDX, number + u32::from(more));
    Ok(0)
}

#[cfg(test)]
mod tests {
    use crate::tests::{Fake, pointer};

    fn words(fake: &Fake, at: usize, count: usize) -> Vec<u16> {
        fake.memory_at(at, 2 * count).chunks(2).map(|word| u16::from_be_bytes([word[0], word[1]])).collect()
    }

    fn put(fake: &mut Fake, at: usize, words: &[u16]) {
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_be_bytes()).collect();
        fake.memory(at, &bytes);
    }

    #[test]
    fn a_table_fills_and_empties() {
        // The manual's examples.
        let mut fake = Fake::new("TI-S7:ATT").with("DATA", [0, 0x24]).with("TABLE", pointer(10));
        put(&mut fake, 10, &[6, 4, 0x12, 0x29, 0x90, 2, 0, 0]);
        fake.run();
        assert_eq!((words(&fake, 10, 8), fake.br), (vec![6, 5, 0x12, 0x29, 0x90, 2, 0x24, 0], true));
        put(&mut fake, 10, &[6, 6]);
        fake.run();
        assert_eq!((words(&fake, 10, 2), fake.br), (vec![6, 6], false), "full");

        for (key, value, left) in [
            ("TI-S7:FIFO", 0x12, vec![6, 4, 0x29, 0x90, 2, 0x24, 0x24]),
            ("TI-S7:LIFO", 0x24, vec![6, 4, 0x12, 0x29, 0x90, 2, 0x24]),
        ] {
            let mut fake = Fake::new(key).with("TABLE", pointer(10)).with("RET_VAL", [0; 2]);
            put(&mut fake, 10, &[6, 5, 0x12, 0x29, 0x90, 2, 0x24]);
            fake.run();
            assert_eq!((fake.value("RET_VAL"), words(&fake, 10, 7), fake.br), (value, left, true), "{key}");
            put(&mut fake, 10, &[6, 0]);
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.br), (value, false), "{key}: empty");
        }
    }

    #[test]
    fn a_value_is_found() {
        for (start, command, ty, pattern, code, index) in [
            (0u16, 1u8, 4u8, 0x5555u16, 0, 3),
            (3, 1, 4, 0x5555, 8, 5),
            (0, 2, 4, 0x1111, 0, 2),
            (4, 1, 4, 0x5555, 8, 5),
            (5, 1, 4, 0x5555, 7, 5),
            (0, 3, 4, 0x5555, 9, 0),
            (0, 1, 3, 0x5555, 9, 0),
        ] {
            let mut fake = Fake::new("TI-S7:TBL_FIND").with("SRC", pointer(0)).with("PATRN", pointer(20));
            fake = fake.with("CMD", [command]).with("E_TYPE", [ty]).with("RET_VAL", [9; 2]);
            fake = fake.with("INDX", start.to_be_bytes());
            put(&mut fake, 0, &[4, 0x1111, 0x3333, 0x5555, 0x7777]);
            put(&mut fake, 20, &[pattern]);
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.value("INDX"), fake.br), (code, index, code == 0), "{start}");
        }
    }

    #[test]
    fn every_entry_is_changed() {
        for (command, ty, entries, code, result) in [
            (4u8, 4u8, vec![0x2000u16, 0x3000], 0, vec![0u16, 0]),
            (3, 4, vec![0x00FF, 0], 0, vec![0xFF00, 0xFFFF]),
            (5, 5, vec![5, 0xFFFF], 0, vec![0xFFFB, 1]),
            (6, 5, vec![16, 10], 0, vec![4, 3]),
            (5, 4, vec![5, 6], 8, vec![5, 6]),
            (3, 8, vec![5, 6], 8, vec![5, 6]),
            (7, 4, vec![5, 6], 8, vec![5, 6]),
            (4, 2, vec![5, 6], 8, vec![5, 6]),
        ] {
            let mut fake = Fake::new("TI-S7:TBL").with("SRC", pointer(0)).with("CMD", [command]);
            fake = fake.with("E_TYPE", [ty]).with("RET_VAL", [9; 2]);
            put(&mut fake, 0, &[2, entries[0], entries[1]]);
            fake.run();
            assert_eq!((fake.value("RET_VAL"), words(&fake, 2, 2)), (code, result), "{command} {ty}");
        }
        let mut fake = Fake::new("TI-S7:TBL").with("SRC", pointer(0)).with("CMD", [6]).with("E_TYPE", [8]);
        fake = fake.with("RET_VAL", [9; 2]);
        put(&mut fake, 0, &[1]);
        fake.memory(2, &2.25f32.to_be_bytes());
        fake.run();
        assert_eq!(fake.memory_at(2, 4), 1.5f32.to_be_bytes());
    }

    #[test]
    fn single_entries() {
        for (index, code, next, q, value) in
            [(1u16, 0, 2, 1, 0x2000u16), (4, 0, 4, 0, 0x5000), (0, 7, 0, 9, 0), (5, 9, 5, 9, 0)]
        {
            let mut fake = Fake::new("TI-S7:TBL_WRD").with("SRC", pointer(0)).with("DEST", pointer(20));
            fake = fake.with("E_TYPE", [4]).with("RET_VAL", [9; 2]).with("Q", [9]).with("INDX", index.to_be_bytes());
            put(&mut fake, 0, &[4, 0x2000, 0x3000, 0x4000, 0x5000]);
            fake.run();
            let result = (fake.value("RET_VAL"), fake.value("INDX"), fake.value("Q"), words(&fake, 20, 1)[0]);
            assert_eq!(result, (code, next, q, value), "{index}");
        }
        // The manual's example: 66665544h OR 11111111h.
        for (command, code, entry) in [
            (8u8, 0, 0x7777_5555u32),
            (7, 0, 0x0000_1100),
            (9, 0, 0x7777_4455),
            (14, 0, 0x1111_1111),
            (1, 8, 0x6666_5544),
        ] {
            let mut fake = Fake::new("TI-S7:WRD_TBL").with("SRC", pointer(40)).with("TABLE", pointer(0));
            fake = fake.with("CMD", [command]).with("E_TYPE", [6]).with("RET_VAL", [9; 2]).with("Q", [9]);
            fake = fake.with("INDX", [0, 2]);
            put(&mut fake, 0, &[3, 0x9999, 0x8877, 0x6666, 0x5544, 0x3333, 0x2222]);
            put(&mut fake, 40, &[0x1111, 0x1111]);
            fake.run();
            assert_eq!(fake.value("RET_VAL"), code);
            assert_eq!(fake.memory_at(6, 4), entry.to_be_bytes(), "{command}");
            assert_eq!(fake.value("INDX"), if code == 0 { 3 } else { 2 });
        }
    }

    #[test]
    fn a_table_outside_memory_is_told() {
        let mut fake = Fake::new("TI-S7:LIFO").with("TABLE", pointer(300)).with("RET_VAL", [0; 2]);
        fake.run();
        assert!(!fake.br);
        // Its length word says more than there is.
        let mut fake = Fake::new("TI-S7:TBL").with("SRC", pointer(250)).with("CMD", [4]).with("E_TYPE", [4]);
        fake = fake.with("RET_VAL", [0; 2]);
        put(&mut fake, 250, &[0xFFFF, 1, 1]);
        fake.run();
        assert_eq!((fake.value("RET_VAL"), fake.br), (8, false));
    }
}
