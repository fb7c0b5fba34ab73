//! SFC 22 CREAT_DB, SFC 23 DEL_DB, SFC 24 TEST_DB, SFC 82 CREA_DBL, SFC 83 READ_DBL, SFC 84 WRIT_DBL. They end in the
//! same call, so that BUSY stays 0. ["Copy and Block Functions"]

use ob1_model::Area;

use crate::call::{Call, Code, read_error, write_error};
use crate::declare::params;
use crate::row::Row;
use crate::services::{CreateError, DataBlocks, DbRequest, DeleteError, LoadError};
use crate::{AnyPointer, Refused};

params!(CreatDb {
    Input { LOW_LIMIT: WORD, UP_LIMIT: WORD, COUNT: WORD }
    Return { RET_VAL: INT }
    Output { DB_NUMBER: WORD }
});
params!(DelDb { Input { DB_NUMBER: WORD } Return { RET_VAL: INT } });
params!(TestDb { Input { DB_NUMBER: WORD } Return { RET_VAL: INT } Output { DB_LENGTH: WORD, WRITE_PROT: BOOL } });
params!(CreaDbl {
    Input { REQ: BOOL, LOW_LIMIT: WORD, UP_LIMIT: WORD, COUNT: WORD, ATTRIB: BYTE, SRCBLK: ANY }
    Return { RET_VAL: INT }
    Output { BUSY: BOOL, DB_NUM: WORD }
});
params!(Dbl { Input { REQ: BOOL, SRCBLK: ANY } Return { RET_VAL: INT } Output { BUSY: BOOL, DSTBLK: ANY } });

pub(super) const ROWS: &[Row] = &[
    Row::coded::<CreatDb>(22, "CREAT_DB", creat_db),
    Row::coded::<DelDb>(23, "DEL_DB", |call| {
        let number = call.word(DelDb::DB_NUMBER);
        call.cx.services().delete(number).map(|()| 0).map_err(missing)
    }),
    Row::coded::<TestDb>(24, "TEST_DB", test_db),
    Row::asked::<CreaDbl>(82, "CREA_DBL", crea_dbl).note(
        "answers in the same call; the bytes of the data block are its load values too, except with NON_RETAIN, which \
         takes twice the room; UNLINKED is refused",
    ),
    Row::asked::<Dbl>(83, "READ_DBL", |call| dbl(call, read_dbl)).note("answers in the same call"),
    Row::asked::<Dbl>(84, "WRIT_DBL", |call| dbl(call, writ_dbl)).note("answers in the same call"),
];

/// Bytes copied at a time.
const CHUNK: u32 = 256;
/// Not possible now; a later call may succeed.
const NOT_NOW: u16 = 0x8092;

fn create(blocks: &mut dyn DataBlocks, request: &DbRequest) -> Result<u16, u16> {
    if request.low == 0 || request.low > request.high {
        return Err(0x80A1);
    }
    if request.bytes == 0 || !request.bytes.is_multiple_of(2) {
        return Err(0x80A2);
    }
    blocks.create(request).map_err(|error| match error {
        CreateError::Numbers => 0x80A1,
        CreateError::Length => 0x80A2,
        CreateError::NoneFree => 0x80B1,
        CreateError::NoMemory => 0x80B2,
        CreateError::NotNow => NOT_NOW,
    })
}

fn creat_db(call: &mut Call<'_>) -> Code {
    let (low, high) = (call.word(CreatDb::LOW_LIMIT), call.word(CreatDb::UP_LIMIT));
    let bytes = call.word(CreatDb::COUNT);
    let request = DbRequest { low, high, bytes, unlinked: false, read_only: false, non_retain: false };
    let number = create(call.cx.services(), &request)?;
    call.set(CreatDb::DB_NUMBER, u32::from(number));
    Ok(0)
}

const fn missing(error: DeleteError) -> u16 {
    match error {
        DeleteError::Number => 0x80A1,
        DeleteError::Missing => 0x80B1,
        DeleteError::Fixed => 0x80B3,
        DeleteError::NotNow => NOT_NOW,
    }
}

fn test_db(call: &mut Call<'_>) -> Code {
    let number = call.word(TestDb::DB_NUMBER);
    let info = call.cx.services().info(number).map_err(missing)?;
    call.set(TestDb::DB_LENGTH, u32::from(info.bytes));
    call.set_bool(TestDb::WRITE_PROT, info.read_only);
    if info.unlinked { Err(0x80B2) } else { Ok(0) }
}

/// ATTRIB: bit 0 UNLINKED, bit 1 READ_ONLY, bit 2 NON_RETAIN. SRCBLK gives the first bytes; the rest is 0.
fn crea_dbl(call: &mut Call<'_>) -> Code {
    let attributes = call.byte(CreaDbl::ATTRIB);
    if attributes > 7 {
        return Err(0x80A3);
    }
    let request = DbRequest {
        low: call.word(CreaDbl::LOW_LIMIT),
        high: call.word(CreaDbl::UP_LIMIT),
        bytes: call.word(CreaDbl::COUNT),
        unlinked: attributes & 1 != 0,
        read_only: attributes & 2 != 0,
        non_retain: attributes & 4 != 0,
    };
    let source = call.any(CreaDbl::SRCBLK);
    let number = create(call.cx.services(), &request)?;
    call.set(CreaDbl::DB_NUM, u32::from(number));
    let Some((source, bytes)) = source.and_then(|any| Some((any, any.bytes()?))) else { return Ok(0) };
    in_pieces(bytes.min(u32::from(request.bytes)), |done, piece| {
        call.read_at(&source, done, piece).map_err(|e| read_error(6, e))?;
        call.cx.services().load_write(number, done, piece).map_err(|e| load_error(e, 6))?;
        if !request.unlinked && !request.read_only {
            call.cx.pointer_write(Area::Db, number, done, piece).map_err(|e| write_error(6, e))?;
        }
        Ok(())
    })?;
    Ok(0)
}

/// Bytes from 0 on, one piece after the other.
fn in_pieces(bytes: u32, mut each: impl FnMut(u32, &mut [u8]) -> Result<(), u16>) -> Result<(), u16> {
    let mut buffer = [0; CHUNK as usize];
    (0..bytes).step_by(CHUNK as usize).try_for_each(|at| each(at, &mut buffer[..(bytes - at).min(CHUNK) as usize]))
}

const fn load_error(error: LoadError, parameter: u32) -> u16 {
    match error {
        LoadError::Missing => 0x80B1,
        LoadError::Outside => 0x8022 | (parameter as u16) << 8,
        LoadError::Protected => 0x80B3,
    }
}

/// Copies bytes between the memories: call, from, to, how many.
type Copy = fn(&mut Call<'_>, &AnyPointer, &AnyPointer, u32) -> Result<(), u16>;

/// The shorter side decides.
fn dbl(call: &mut Call<'_>, copy: Copy) -> Code {
    let ends = |any: Option<AnyPointer>| any.and_then(|any| Some((any, any.bytes()?)));
    let Some((from, have)) = ends(call.any(Dbl::SRCBLK)) else { return Err(read_error(2, Refused::NoParam)) };
    let Some((to, room)) = ends(call.any(Dbl::DSTBLK)) else { return Err(write_error(5, Refused::NoParam)) };
    copy(call, &from, &to, have.min(room))?;
    Ok(0)
}

/// Initial values from the load memory into the work memory.
fn read_dbl(call: &mut Call<'_>, from: &AnyPointer, to: &AnyPointer, bytes: u32) -> Result<(), u16> {
    in_pieces(bytes, |done, piece| {
        let read = call.cx.services().load_read(from.db, from.at.byte() + done, piece);
        read.map_err(|e| load_error(e, 2))?;
        call.write_at(to, done, piece).map_err(|e| write_error(5, e))
    })
}

/// Actual values from the work memory into the load memory.
fn writ_dbl(call: &mut Call<'_>, from: &AnyPointer, to: &AnyPointer, bytes: u32) -> Result<(), u16> {
    in_pieces(bytes, |done, piece| {
        call.read_at(from, done, piece).map_err(|e| read_error(2, e))?;
        let written = call.cx.services().load_write(to.db, to.at.byte() + done, piece);
        written.map_err(|e| load_error(e, 5))
    })
}

#[cfg(test)]
mod tests {
    use crate::services::{CreateError, DbInfo};
    use crate::tests::{Fake, any};

    #[test]
    fn creating() {
        for (low, high, bytes, error, number, code) in [
            (50u16, 60u16, 100u16, None, 51, 0),
            (0, 60, 100, None, 0, 0x80A1),
            (60, 50, 100, None, 0, 0x80A1),
            (50, 60, 0, None, 0, 0x80A2),
            (50, 60, 101, None, 0, 0x80A2),
            (50, 50, 100, None, 0, 0x80B1),
            (50, 60, 100, Some(CreateError::NoMemory), 0, 0x80B2),
            (50, 60, 100, Some(CreateError::Numbers), 0, 0x80A1),
            (50, 60, 100, Some(CreateError::Length), 0, 0x80A2),
            (50, 60, 100, Some(CreateError::NotNow), 0, 0x8092),
        ] {
            let mut fake = Fake::new("SYSTEM:SFC22").with("LOW_LIMIT", low.to_be_bytes());
            fake = fake.with("UP_LIMIT", high.to_be_bytes()).with("COUNT", bytes.to_be_bytes());
            fake = fake.with("RET_VAL", [9; 2]).with("DB_NUMBER", [0; 2]);
            fake.station.blocks.insert(50, DbInfo::default());
            fake.station.create = error;
            fake.run();
            let result = (fake.value("DB_NUMBER"), fake.value("RET_VAL"), fake.br);
            assert_eq!(result, (number, code, code == 0), "{low} {high} {bytes} {error:?}");
        }
    }

    #[test]
    fn deleting_and_testing() {
        for (number, code) in [(7u16, 0), (8, 0x80B1), (0, 0x80A1)] {
            let mut fake = Fake::new("SYSTEM:SFC23").with("DB_NUMBER", number.to_be_bytes()).with("RET_VAL", [9; 2]);
            fake.station.blocks.insert(7, DbInfo::default());
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.station.blocks.is_empty()), (code, code == 0));
        }
        for (number, code, len, protected) in
            [(7u16, 0, 20, 1), (8, 0x80B2, 4, 0), (9, 0x80B1, 0, 0), (101, 0x80A1, 0, 0)]
        {
            let mut fake = Fake::new("SYSTEM:SFC24").with("DB_NUMBER", number.to_be_bytes()).with("RET_VAL", [9; 2]);
            fake = fake.with("DB_LENGTH", [0; 2]).with("WRITE_PROT", [0]);
            fake.station.blocks.insert(7, DbInfo { bytes: 20, read_only: true, unlinked: false });
            fake.station.blocks.insert(8, DbInfo { bytes: 4, read_only: false, unlinked: true });
            fake.run();
            let result = (fake.value("RET_VAL"), fake.value("DB_LENGTH"), fake.value("WRITE_PROT"));
            assert_eq!(result, (code, len, protected), "{number}");
        }
    }

    #[test]
    fn load_memory() {
        let mut fake = Fake::new("SYSTEM:SFC82").with("REQ", [1]).with("LOW_LIMIT", [0, 10]).with("UP_LIMIT", [0, 10]);
        fake = fake.with("COUNT", [0, 8]).with("ATTRIB", [4]).with("SRCBLK", any(2, 4, 20));
        fake = fake.with("RET_VAL", [9; 2]).with("BUSY", [1]).with("DB_NUM", [0; 2]);
        fake.memory(20, &[1, 2, 3, 4]);
        fake.station.load.insert(10, vec![0; 8]);
        fake.run();
        assert_eq!((fake.value("RET_VAL"), fake.value("BUSY"), fake.value("DB_NUM")), (0, 0, 10));
        assert_eq!(fake.station.load[&10], [1, 2, 3, 4, 0, 0, 0, 0]);
        assert_eq!(fake.area(ob1_model::Area::Db, 10)[..5], [1, 2, 3, 4, 0]);
        assert!(fake.station.created[0].non_retain);
        fake.set("ATTRIB", &[8]);
        fake.run();
        assert_eq!(fake.value("RET_VAL"), 0x80A3);
        fake.set("REQ", &[0]);
        fake.run();
        assert_eq!((fake.value("RET_VAL"), fake.br), (0x7000, true));

        let mut db = any(2, 4, 0);
        (db[5], db[6]) = (33, 0x84);
        for (key, from, to, code) in [
            ("SYSTEM:SFC83", db, any(2, 3, 20), 0),
            ("SYSTEM:SFC84", any(2, 3, 40), db, 0),
            ("SYSTEM:SFC83", any(2, 3, 40), db, 0x80B1),
            ("SYSTEM:SFC84", any(2, 3, 254), db, 0x8222),
        ] {
            let mut fake = Fake::new(key).with("REQ", [1]).with("SRCBLK", from).with("DSTBLK", to);
            fake = fake.with("RET_VAL", [9; 2]).with("BUSY", [1]);
            fake.memory(40, &[9, 9, 9]);
            fake.station.load.insert(33, vec![5, 6, 7, 8]);
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.value("BUSY")), (code, 0), "{key}");
            assert_eq!(fake.memory_at(20, 4) == [5, 6, 7, 0], key == "SYSTEM:SFC83" && code == 0);
            assert_eq!(fake.station.load[&33] == [9, 9, 9, 8], key == "SYSTEM:SFC84" && code == 0);
        }
    }
}
