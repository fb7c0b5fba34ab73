//! SFC 17 ALARM_SQ, SFC 18 ALARM_S, SFC 19 ALARM_SC, SFC 52 WR_USMSG, SFC 105 READ_SI, SFC 106 DEL_SI, SFC 107
//! ALARM_DQ, SFC 108 ALARM_D. ["Generating Block-Related Messages", "Diagnostics"]

use crate::call::{Call, read_error, write_error};
use crate::declare::{Params, params};
use crate::row::Row;
use crate::services::{Alarm, AlarmError, InUse, MessageError};
use crate::{AnyPointer, AnyType, Done, Interrupted};

params!(AlarmS { Input { SIG: BOOL, ID: WORD, EV_ID: DWORD, SD: ANY } Return { RET_VAL: INT } });
params!(AlarmD { Input { SIG: BOOL, ID: WORD, EV_ID: DWORD, CMP_ID: DWORD, SD: ANY } Return { RET_VAL: INT } });
params!(AlarmSc { Input { EV_ID: DWORD } Return { RET_VAL: INT } Output { STATE: BOOL, Q_STATE: BOOL } });
params!(ReadSi { Input { MODE: INT } Return { RET_VAL: INT } Output { N_SI: INT } InOut { SYS_INST: ANY } });
params!(DelSi { Input { MODE: INT } Return { RET_VAL: INT } InOut { SYS_INST: ANY } });
params!(WrUsMsg { Input { SEND: BOOL, EVENTN: WORD, INFO1: ANY, INFO2: ANY } Return { RET_VAL: INT } });

pub(super) const ROWS: &[Row] = &[
    Row::sfc::<AlarmS>(17, "ALARM_SQ", |call| alarm_s(call, 17)),
    Row::sfc::<AlarmS>(18, "ALARM_S", |call| alarm_s(call, 18)),
    Row::sfc::<AlarmSc>(19, "ALARM_SC", alarm_sc),
    Row::sfc::<WrUsMsg>(52, "WR_USMSG", wr_usmsg).note("event classes 8, 9, A, B"),
    Row::sfc::<ReadSi>(105, "READ_SI", read_si),
    Row::sfc::<DelSi>(106, "DEL_SI", del_si),
    Row::sfc::<AlarmD>(107, "ALARM_DQ", |call| alarm_d(call, 107)),
    Row::sfc::<AlarmD>(108, "ALARM_D", |call| alarm_d(call, 108)),
];

/// Longest associated value of an alarm message, in bytes.
const VALUE: usize = 12;

fn alarm_s(call: &mut Call<'_>, sfc: u16) -> Done {
    let (signal, id) = (call.bool(AlarmS::SIG), call.raw(AlarmS::EV_ID));
    let code = alarm(call, AlarmS::SD, Alarm { sfc, id, component: 0, signal, acknowledge: sfc == 17, value: &[] })?;
    call.end(AlarmS::RET_VAL, code)
}

fn alarm_d(call: &mut Call<'_>, sfc: u16) -> Done {
    let (signal, id, component) = (call.bool(AlarmD::SIG), call.raw(AlarmD::EV_ID), call.raw(AlarmD::CMP_ID));
    let code = alarm(call, AlarmD::SD, Alarm { sfc, id, component, signal, acknowledge: sfc == 107, value: &[] })?;
    call.end(AlarmD::RET_VAL, code)
}

/// Sends a message with the associated value `sd` names; returns RET_VAL.
fn alarm(call: &mut Call<'_>, sd: impl Params, message: Alarm<'_>) -> Result<u16, Interrupted> {
    if message.id == 0 {
        return Ok(0x8081);
    }
    // A value that is too long or cannot be read is left out; the message is sent.
    let mut value = [0; VALUE];
    let (len, good) = match call.any(sd).map(|any| (any, any.bytes())) {
        None => (0, true),
        Some((any, Some(bytes @ 0..=12))) => {
            let len = bytes as usize;
            let read = call.read_at(&any, 0, &mut value[..len]).is_ok();
            (if read { len } else { 0 }, read)
        }
        Some(_) => (0, false),
    };
    let messages = call.cx.messages();
    Ok(match messages.alarm(Alarm { value: &value[..len], ..message }) {
        Ok(()) if good => 0,
        Ok(()) => 0x0001,
        Err(AlarmError::NoResources) => 0x8082,
        Err(AlarmError::Waiting) => 0x8083,
        Err(AlarmError::NoChange) => 0x8084,
        Err(AlarmError::NoLogon) => 0x8085,
        Err(AlarmError::FirstIsZero) => 0x8087,
    })
}

/// State of the signal and of the acknowledgement of a message.
fn alarm_sc(call: &mut Call<'_>) -> Done {
    let id = call.raw(AlarmSc::EV_ID);
    let messages = call.cx.messages();
    let mut found = None;
    messages.in_use(&mut |number| found = if number.id == id { Some(number) } else { found });
    let code = match found {
        _ if id == 0 => 0x8081,
        None => 0x8082,
        Some(number) => {
            call.set_bool(AlarmSc::STATE, number.signal);
            call.set_bool(AlarmSc::Q_STATE, number.acknowledged);
            0
        }
    };
    call.end(AlarmSc::RET_VAL, code)
}

/// Bytes of one number in SYS_INST: function (WORD), length (BYTE), signal and acknowledgement (bits 0 and 1 of a
/// byte), EV_ID, CMP_ID (DWORD each).
const SYS_INST: usize = 12;

fn layout(number: InUse) -> [u8; SYS_INST] {
    let mut bytes = [0; SYS_INST];
    bytes[..2].copy_from_slice(&number.sfc.to_be_bytes());
    bytes[2] = SYS_INST as u8;
    bytes[3] = u8::from(number.signal) | u8::from(number.acknowledged) << 1;
    bytes[4..8].copy_from_slice(&number.id.to_be_bytes());
    bytes[8..].copy_from_slice(&number.component.to_be_bytes());
    bytes
}

/// Which numbers a MODE means: 1 all, 2 the one whose EV_ID is in SYS_INST, 3 those with its CMP_ID. Only numbers
/// of SFC 107 and 108 count: those of SFC 17 and 18 are the configuration's.
fn selection(mode: i16, given: [u8; SYS_INST]) -> Option<impl Fn(InUse) -> bool> {
    let long = |at: usize| given[at..at + 4].iter().fold(0, |value: u32, byte| value << 8 | u32::from(*byte));
    let (id, component) = (long(4), long(8));
    (1..=3).contains(&mode).then_some(move |number: InUse| {
        matches!(number.sfc, 107 | 108)
            && match mode {
                2 => number.id == id,
                3 => number.component == component,
                _ => true,
            }
    })
}

/// N_SI tells how many numbers are in SYS_INST; RET_VAL is 0001h when there are more than it has room for.
fn read_si(call: &mut Call<'_>) -> Done {
    let code = match resources(call, ReadSi::SYS_INST) {
        Ok((any, room, given)) => match selection(call.int(ReadSi::MODE), given) {
            Some(wanted) => {
                let messages = call.cx.messages();
                let mut list = [[0; SYS_INST]; MOST];
                let mut count = 0;
                messages.in_use(&mut |number| {
                    if wanted(number) {
                        if let Some(place) = list.get_mut(count) {
                            *place = layout(number);
                        }
                        count += 1;
                    }
                });
                let kept = count.min(room).min(MOST);
                let written = (0..kept)
                    .try_for_each(|i| call.write_at(&any, (i * SYS_INST) as u32, &list[i]))
                    .map_err(|e| write_error(ReadSi::SYS_INST as u32 + 1, e));
                call.set_int(ReadSi::N_SI, kept as i16);
                match written {
                    Ok(()) if count > kept => 0x0001,
                    Ok(()) => 0,
                    Err(code) => code,
                }
            }
            None => BAD_MODE,
        },
        Err(code) => code,
    };
    call.end(ReadSi::RET_VAL, code)
}

fn del_si(call: &mut Call<'_>) -> Done {
    // MODE 1 needs no SYS_INST.
    let mode = call.int(DelSi::MODE);
    let given = if mode == 1 { Ok([0; SYS_INST]) } else { resources(call, DelSi::SYS_INST).map(|(_, _, given)| given) };
    let code = match given.map(|given| selection(mode, given)) {
        Ok(Some(wanted)) => {
            let messages = call.cx.messages();
            messages.release(&wanted);
            0
        }
        Ok(None) => BAD_MODE,
        Err(code) => code,
    };
    call.end(DelSi::RET_VAL, code)
}

/// MODE is not one of the function's.
const BAD_MODE: u16 = 0x8081;
/// SYS_INST is shorter than one number.
const TOO_SHORT: u16 = 0x8082;
/// Numbers that READ_SI gives at most.
const MOST: usize = 64;

/// SYS_INST: where it lies, for how many numbers it has room, and what is in its first.
fn resources(call: &mut Call<'_>, p: impl Params) -> Result<(AnyPointer, usize, [u8; SYS_INST]), u16> {
    let any = call.any(p).ok_or(TOO_SHORT)?;
    let room = any.bytes().unwrap_or(0) as usize / SYS_INST;
    if room == 0 {
        return Err(TOO_SHORT);
    }
    let mut given = [0; SYS_INST];
    call.read_at(&any, 0, &mut given).map_err(|e| read_error(p.index() + 1, e))?;
    Ok((any, room, given))
}

/// INFO1 is a word, INFO2 a double word, each in the forms the data types have.
fn wr_usmsg(call: &mut Call<'_>) -> Done {
    let code = user_message(call)?;
    call.end(WrUsMsg::RET_VAL, code)
}

fn user_message(call: &mut Call<'_>) -> Result<u16, Interrupted> {
    let (event, send) = (call.word(WrUsMsg::EVENTN), call.bool(WrUsMsg::SEND));
    if !(0x8..=0xB).contains(&(event >> 12)) {
        return Ok(0x8085);
    }
    let (mut info1, mut info2) = ([0; 2], [0; 4]);
    let narrow = [AnyType::Word, AnyType::Int, AnyType::Byte, AnyType::Char];
    let wide =
        [AnyType::DWord, AnyType::DInt, AnyType::Real, AnyType::Time, AnyType::Word, AnyType::Byte, AnyType::Char];
    if let Err(code) = info(call, WrUsMsg::INFO1, &narrow, &mut info1, [0x8083, 0x8086]) {
        return Ok(code);
    }
    if let Err(code) = info(call, WrUsMsg::INFO2, &wide, &mut info2, [0x8084, 0x8087]) {
        return Ok(code);
    }
    let messages = call.cx.messages();
    Ok(match messages.user_message(event, &info1, &info2, send) {
        Ok(()) => 0,
        Err(MessageError::NoStation) => 0x8091,
        Err(MessageError::Full) => 0x8092,
    })
}

/// Reads additional information; an ANY that is NIL gives zeros. `codes`: of the type, of the length.
fn info(call: &mut Call<'_>, p: impl Params, types: &[AnyType], into: &mut [u8], codes: [u16; 2]) -> Result<(), u16> {
    let Some(any) = call.any(p) else { return Err(codes[0]) };
    if any.ty == AnyType::Nil {
        return Ok(());
    }
    if !types.contains(&any.ty) {
        return Err(codes[0]);
    }
    if any.bytes() != Some(into.len() as u32) {
        return Err(codes[1]);
    }
    call.read_at(&any, 0, into).map_err(|e| read_error(p.index() + 1, e))
}

#[cfg(test)]
mod tests {
    use crate::services::{AlarmError, InUse, MessageError};
    use crate::testing::{Fake, any};

    #[test]
    fn user_messages() {
        for (event, info1, info2, error, code) in [
            (0x9123u16, any(4, 1, 10), any(6, 1, 12), None, 0),
            (0xB000, any(2, 2, 10), any(4, 2, 12), None, 0),
            (0x8000, any(4, 1, 10), any(6, 1, 12), Some(MessageError::NoStation), 0x8091),
            (0x8000, any(4, 1, 10), any(6, 1, 12), Some(MessageError::Full), 0x8092),
            (0x7FFF, any(4, 1, 10), any(6, 1, 12), None, 0x8085),
            (0xC000, any(4, 1, 10), any(6, 1, 12), None, 0x8085),
            (0x8000, any(6, 1, 10), any(6, 1, 12), None, 0x8083),
            (0x8000, any(4, 2, 10), any(6, 1, 12), None, 0x8086),
            (0x8000, any(4, 1, 10), any(5, 1, 12), None, 0x8084),
            (0x8000, any(4, 1, 10), any(6, 2, 12), None, 0x8087),
            (0x8000, any(4, 1, 255), any(6, 1, 12), None, 0x8322),
        ] {
            let mut fake = Fake::new("SYSTEM:SFC52").with("SEND", [1]).with("EVENTN", event.to_be_bytes());
            fake = fake.with("INFO1", info1).with("INFO2", info2).with("RET_VAL", [9; 2]);
            fake.memory(10, &[1, 2, 3, 4, 5, 6]);
            fake.station.message_error = error;
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.br), (code, code == 0), "{event:04X}");
            let entered =
                if code == 0 || error.is_some() { vec![(event, vec![1, 2], vec![3, 4, 5, 6], true)] } else { vec![] };
            assert_eq!(fake.station.messages, entered, "{event:04X}");
        }
    }

    #[test]
    fn alarms() {
        for (key, id, value, error, code, sent) in [
            ("SYSTEM:SFC17", 5u32, any(2, 3, 10), None, 0, Some(vec![1, 2, 3])),
            ("SYSTEM:SFC18", 5, any(2, 13, 10), None, 1, Some(vec![])),
            ("SYSTEM:SFC18", 5, any(2, 3, 10), Some(AlarmError::NoChange), 0x8084, Some(vec![1, 2, 3])),
            ("SYSTEM:SFC17", 5, any(2, 3, 10), Some(AlarmError::FirstIsZero), 0x8087, Some(vec![1, 2, 3])),
            ("SYSTEM:SFC17", 0, any(2, 3, 10), None, 0x8081, None),
        ] {
            let mut fake = Fake::new(key).with("SIG", [1]).with("ID", [0, 0]).with("EV_ID", id.to_be_bytes());
            fake = fake.with("SD", value).with("RET_VAL", [9; 2]);
            fake.memory(10, &[1, 2, 3]);
            fake.station.alarm_error = error;
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.br), (code, code < 0x8000), "{key} {id}");
            let sent = sent.map(|value| (key[10..].parse().expect("a number"), id, true, key == "SYSTEM:SFC17", value));
            assert_eq!(fake.station.alarms, Vec::from_iter(sent), "{key} {id}");
        }
    }

    /// Numbers of the dynamic alarms: read with their states, selected, set free.
    #[test]
    fn numbers_in_use() {
        let number = |sfc, id, component, signal| InUse { sfc, id, component, signal, acknowledged: sfc % 2 == 1 };
        let all = [number(18, 1, 0, true), number(107, 2, 8, true), number(108, 3, 9, false), number(107, 4, 9, true)];
        for (id, code, state, acknowledged) in [(2u32, 0, 1, 1), (3, 0, 0, 0), (5, 0x8082, 7, 7), (0, 0x8081, 7, 7)] {
            let mut fake = Fake::new("SYSTEM:SFC19").with("EV_ID", id.to_be_bytes()).with("RET_VAL", [9; 2]);
            fake = fake.with("STATE", [7]).with("Q_STATE", [7]);
            fake.station.in_use = all.to_vec();
            fake.run();
            assert_eq!(
                (fake.value("RET_VAL"), fake.value("STATE"), fake.value("Q_STATE")),
                (code, state, acknowledged)
            );
        }
        // MODE, room in bytes, what is in SYS_INST; RET_VAL and the EV_IDs that come.
        for (mode, room, id, component, code, ids) in [
            (1i16, 48, 0u32, 0u32, 0, vec![2u32, 3, 4]),
            (1, 35, 0, 0, 1, vec![2, 3]),
            (2, 12, 3, 0, 0, vec![3]),
            (3, 24, 0, 9, 0, vec![3, 4]),
            (3, 12, 0, 7, 0, vec![]),
            (0, 12, 0, 0, 0x8081, vec![]),
            (1, 11, 0, 0, 0x8082, vec![]),
        ] {
            let mut fake = Fake::new("SYSTEM:SFC105").with("MODE", mode.to_be_bytes()).with("RET_VAL", [9; 2]);
            fake = fake.with("N_SI", [0; 2]).with("SYS_INST", any(2, room, 100));
            fake.station.in_use = all.to_vec();
            fake.memory(104, &[id.to_be_bytes(), component.to_be_bytes()].concat());
            fake.run();
            assert_eq!((fake.value("RET_VAL"), fake.value("N_SI")), (code, ids.len() as u32), "{mode} {room}");
            for (i, id) in ids.iter().enumerate() {
                let bytes = fake.memory_at(100 + 12 * i, 12);
                assert_eq!((bytes[2], &bytes[4..8]), (12, &id.to_be_bytes()[..]), "{mode}");
            }
        }
        for (mode, id, code, left) in
            [(1i16, 0u32, 0, vec![1]), (2, 3, 0, vec![1, 2, 4]), (4, 0, 0x8081, vec![1, 2, 3, 4])]
        {
            let mut fake = Fake::new("SYSTEM:SFC106").with("MODE", mode.to_be_bytes()).with("RET_VAL", [9; 2]);
            fake = fake.with("SYS_INST", any(2, 12, 100));
            fake.memory(104, &id.to_be_bytes());
            fake.station.in_use = all.to_vec();
            fake.run();
            assert_eq!(fake.value("RET_VAL"), code, "{mode}");
            assert_eq!(fake.station.in_use.iter().map(|number| number.id).collect::<Vec<_>>(), left);
        }
        for (key, acknowledge) in [("SYSTEM:SFC107", true), ("SYSTEM:SFC108", false)] {
            let mut fake = Fake::new(key).with("SIG", [1]).with("ID", [0, 0]).with("EV_ID", 5u32.to_be_bytes());
            fake = fake.with("CMP_ID", 6u32.to_be_bytes()).with("SD", any(2, 3, 10)).with("RET_VAL", [9; 2]);
            fake.memory(10, &[1, 2, 3]);
            fake.run();
            let sfc = key[10..].parse().expect("a number");
            assert_eq!(
                (fake.value("RET_VAL"), &fake.station.alarms[..]),
                (0, &[(sfc, 5, true, acknowledge, vec![1, 2, 3])][..])
            );
        }
    }
}
