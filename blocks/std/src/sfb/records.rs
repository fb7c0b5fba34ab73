//! SFB 52 RDREC, SFB 53 WRREC, SFB 54 RALRM: records and alarms of modules. Modules answer at once, so that BUSY stays
//! 0. ["DPV1 SFBs According to PNO AK 1131"]

use crate::call::{Call, read_error, write_error};
use crate::declare::params;
use crate::row::Row;
use crate::{Done, Refused};

params!(RdRec {
    Input { REQ: BOOL, ID: DWORD, INDEX: INT, MLEN: INT }
    Output { VALID: BOOL, BUSY: BOOL, ERROR: BOOL, STATUS: DWORD, LEN: INT }
    InOut { RECORD: ANY }
});
params!(WrRec {
    Input { REQ: BOOL, ID: DWORD, INDEX: INT, LEN: INT }
    Output { DONE: BOOL, BUSY: BOOL, ERROR: BOOL, STATUS: DWORD }
    InOut { RECORD: ANY }
});
params!(Ralrm {
    Input { MODE: INT, F_ID: DWORD, MLEN: INT }
    Output { NEW: BOOL, STATUS: DWORD, ID: DWORD, LEN: INT }
    InOut { TINFO: ANY, AINFO: ANY }
});

pub(super) const ROWS: &[Row] = &[
    Row::sfb::<RdRec>(52, "RDREC", rdrec).note("answers in the same call"),
    Row::sfb::<WrRec>(53, "WRREC", wrrec).note("answers in the same call"),
    Row::sfb::<Ralrm>(54, "RALRM", ralrm),
];

/// Function number of an error that is not the module's own.
const LOCAL: u32 = 0xC0;
/// Function numbers of errors a module answers with, by direction.
const READ: u32 = 0xDE;
const WRITE: u32 = 0xDF;

/// STATUS: function number, 80h, code, 0.
const fn status(function: u32, code: u16) -> u32 {
    function << 24 | (code as u32) << 8
}

/// The logical address in an ID: bit 15 is set for an output.
const fn address(id: u32) -> u32 {
    id & 0x7FFF
}

/// STATUS of a module's refusal; `access` is the code of one that does not answer.
const fn refusal(refused: Refused, function: u32, access: u16) -> u32 {
    match refused {
        Refused::NoModule => status(LOCAL, 0x8090),
        Refused::NoRecord => status(function, 0x80B0),
        Refused::Outside => status(function, 0x80B1),
        Refused::Busy => status(LOCAL, 0x80C0),
        _ => status(function, access),
    }
}

fn rdrec(call: &mut Call<'_>) -> Done {
    let result = if call.bool(RdRec::REQ) { read(call).map(Some) } else { Ok(None) };
    call.set_bool(RdRec::VALID, matches!(result, Ok(Some(_))));
    call.set_bool(RdRec::ERROR, result.is_err());
    call.set_bool(RdRec::BUSY, false);
    call.set(RdRec::STATUS, result.err().unwrap_or(0));
    if let Ok(Some(len)) = result {
        call.set_int(RdRec::LEN, len as i16);
    }
    call.br(result.is_ok())
}

fn read(call: &mut Call<'_>) -> Result<usize, u32> {
    let (target, room) = call.record(RdRec::RECORD).map_err(|code| status(LOCAL, code))?;
    // MLEN 0: the length of RECORD.
    let limit = usize::try_from(call.int(RdRec::MLEN)).map_err(|_| status(LOCAL, 0x80B1))?;
    if limit > room {
        return Err(status(LOCAL, 0x80B1));
    }
    let index = u8::try_from(call.int(RdRec::INDEX)).map_err(|_| status(READ, 0x80B0))?;
    let mut buffer = [0; 256];
    let buffer = &mut buffer[..if limit == 0 { room } else { limit }];
    let at = address(call.raw(RdRec::ID));
    let len = call.cx.record_read(at, index, buffer).map_err(|e| refusal(e, READ, 0x80A0))?;
    call.write_at(&target, 0, &buffer[..len]).map_err(|e| status(LOCAL, write_error(10, e)))?;
    Ok(len)
}

fn wrrec(call: &mut Call<'_>) -> Done {
    let result = if call.bool(WrRec::REQ) { write(call).map(|()| true) } else { Ok(false) };
    call.set_bool(WrRec::DONE, result == Ok(true));
    call.set_bool(WrRec::ERROR, result.is_err());
    call.set_bool(WrRec::BUSY, false);
    call.set(WrRec::STATUS, result.err().unwrap_or(0));
    call.br(result.is_ok())
}

fn write(call: &mut Call<'_>) -> Result<(), u32> {
    let (source, room) = call.record(WrRec::RECORD).map_err(|code| status(LOCAL, code))?;
    let len = usize::try_from(call.int(WrRec::LEN)).map_err(|_| status(LOCAL, 0x80B1))?;
    if len > room {
        return Err(status(LOCAL, 0x80B1));
    }
    let index = u8::try_from(call.int(WrRec::INDEX)).map_err(|_| status(WRITE, 0x80B0))?;
    let mut buffer = [0; 256];
    let buffer = &mut buffer[..if len == 0 { room } else { len }];
    call.read_at(&source, 0, buffer).map_err(|e| status(LOCAL, read_error(9, e)))?;
    let at = address(call.raw(WrRec::ID));
    call.cx.record_write(at, index, buffer).map_err(|e| refusal(e, WRITE, 0x80A1))
}

/// MODE 0: who sent the alarm. 1: the alarm, whoever sent it. 2: the alarm if F_ID sent it.
fn ralrm(call: &mut Call<'_>) -> Done {
    let alarm = call.cx.services().alarm();
    let mode = call.int(Ralrm::MODE);
    let asked = call.raw(Ralrm::F_ID);
    call.set_bool(Ralrm::NEW, false);
    let result = match (mode, alarm) {
        (0..=2, None) => Ok(()),
        (2, Some(alarm)) if alarm.address != asked => Ok(()),
        (0, Some(alarm)) => {
            call.set(Ralrm::ID, alarm.address);
            call.set_bool(Ralrm::NEW, true);
            Ok(())
        }
        (1 | 2, Some(alarm)) => {
            call.set(Ralrm::ID, alarm.address);
            call.set_bool(Ralrm::NEW, true);
            information(call, &alarm)
        }
        _ => Err(status(LOCAL, 0x8100)),
    };
    call.set(Ralrm::STATUS, result.err().unwrap_or(0));
    call.br(result.is_ok())
}

/// TINFO: start information, then eight bytes that are 0 for a module of the central rack 0; AINFO: the alarm's bytes.
/// As much as the targets hold.
fn information(call: &mut Call<'_>, alarm: &crate::services::AlarmInfo) -> Result<(), u32> {
    let mut task = [0; 28];
    task[..20].copy_from_slice(&alarm.start);
    if let Some(target) = call.any(Ralrm::TINFO) {
        let len = target.bytes().unwrap_or(0).min(task.len() as u32) as usize;
        call.write_at(&target, 0, &task[..len]).map_err(|e| status(LOCAL, write_error(8, e)))?;
    }
    let limit = usize::try_from(call.int(Ralrm::MLEN)).map_err(|_| status(LOCAL, 0x80B1))?;
    let len = usize::from(alarm.len).min(alarm.data.len());
    let len = if limit == 0 { len } else { len.min(limit) };
    if let Some(target) = call.any(Ralrm::AINFO) {
        let len = len.min(target.bytes().unwrap_or(0) as usize);
        call.write_at(&target, 0, &alarm.data[..len]).map_err(|e| status(LOCAL, write_error(9, e)))?;
    }
    call.set_int(Ralrm::LEN, len as i16);
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::services::AlarmInfo;
    use crate::tests::{Fake, any};

    #[test]
    fn reads_a_record() {
        for (req, id, index, mlen, room, valid, status, len) in [
            (1, 0x100u32, 5i16, 0i16, 10, 1, 0, 4),
            (1, 0x8100, 5, 4, 10, 1, 0, 4),
            (0, 0x100, 5, 0, 10, 0, 0, 0),
            (1, 0x101, 5, 0, 10, 0, 0xC080_9000, 0),
            (1, 0x100, 6, 0, 10, 0, 0xDE80_B000, 0),
            (1, 0x100, 300, 0, 10, 0, 0xDE80_B000, 0),
            (1, 0x100, 5, 0, 3, 0, 0xDE80_B100, 0),
            (1, 0x100, 5, 11, 10, 0, 0xC080_B100, 0),
        ] {
            let mut fake = Fake::new("SYSTEM:SFB52").with("REQ", [req]).with("ID", id.to_be_bytes());
            fake.records.insert((0x100, 5), vec![1, 2, 3, 4]);
            fake = fake.with("INDEX", index.to_be_bytes()).with("MLEN", mlen.to_be_bytes());
            fake = fake.with("RECORD", any(2, room, 20));
            fake.run();
            let result = (fake.value("VALID"), fake.value("STATUS"), fake.value("LEN"));
            assert_eq!(result, (valid, status, len), "{req} {id:X} {index} {mlen} {room}");
            assert_eq!((fake.value("ERROR"), fake.value("BUSY")), (u32::from(status != 0), 0));
            let bytes: &[u8] = if valid == 1 { &[1, 2, 3, 4] } else { &[0; 4] };
            assert_eq!(fake.memory_at(20, 4), bytes);
        }
    }

    #[test]
    fn writes_a_record() {
        let mut fake =
            Fake::new("SYSTEM:SFB53").with("REQ", [1]).with("ID", 0x100u32.to_be_bytes()).with("INDEX", [0, 7]);
        fake.records.insert((0x100, 7), vec![]);
        fake.memory(20, &[9, 8, 7]);
        fake = fake.with("LEN", [0, 2]).with("RECORD", any(2, 3, 20));
        fake.run();
        assert_eq!((fake.value("DONE"), fake.value("STATUS"), fake.br), (1, 0, true));
        assert_eq!(fake.records[&(0x100, 7)], [9, 8]);
        fake.set("INDEX", &[0, 8]);
        fake.run();
        assert_eq!((fake.value("DONE"), fake.value("ERROR"), fake.value("STATUS")), (0, 1, 0xDF80_B000));
        fake.set("RECORD", &any(4, 3, 20));
        fake.run();
        assert_eq!(fake.value("STATUS"), 0xC080_9200, "words are no bytes");
    }

    #[test]
    fn an_alarm() {
        let mut data = [0; 64];
        data[..3].copy_from_slice(&[7, 8, 9]);
        let alarm = AlarmInfo { address: 0x200, start: [3; 20], data, len: 3 };
        for (mode, asked, present, new, written) in [
            (0, 0u32, true, 1, false),
            (1, 0, true, 1, true),
            (2, 0x200, true, 1, true),
            (2, 0x201, true, 0, false),
            (1, 0, false, 0, false),
        ] {
            let mut fake = Fake::new("SYSTEM:SFB54").with("MODE", [0, mode]).with("F_ID", asked.to_be_bytes());
            fake = fake.with("TINFO", any(2, 24, 0)).with("AINFO", any(2, 10, 40));
            fake.station.alarm = present.then_some(alarm);
            fake.run();
            assert_eq!((fake.value("NEW"), fake.value("STATUS")), (new, 0), "{mode} {asked:X}");
            let (task, bytes): ([u8; 4], [u8; 3]) = if written { ([3, 0, 0, 0], [7, 8, 9]) } else { ([0; 4], [0; 3]) };
            assert_eq!((fake.memory_at(19, 4), fake.memory_at(40, 3)), (&task[..], &bytes[..]), "{mode} {asked:X}");
        }
        let mut fake = Fake::new("SYSTEM:SFB54").with("MODE", [0, 3]);
        fake.run();
        assert_eq!((fake.value("STATUS"), fake.br), (0xC081_0000, false));
    }
}
