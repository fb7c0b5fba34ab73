//! SFC 9 EN_MSG, SFC 10 DIS_MSG, SFC 17 ALARM_SQ, SFC 18 ALARM_S, SFC 19 ALARM_SC, SFC 105 READ_SI, SFC 106 DEL_SI,
//! SFC 107 ALARM_DQ, SFC 108 ALARM_D. ["Generating Block-Related Messages"]

use ob1_model::{AlarmKind, AlarmState, AlarmValues};

use crate::alarm_value::{Value, take};
use crate::call::{Call, Code, write_error};
use crate::declare::{Params, params};
use crate::row::Row;
use crate::services::{AlarmCall, AlarmError, AlarmLock};

params!(AlarmS { Input { SIG: BOOL, ID: WORD, EV_ID: DWORD, SD: ANY } Return { RET_VAL: INT } });
params!(AlarmD { Input { SIG: BOOL, ID: WORD, EV_ID: DWORD, CMP_ID: DWORD, SD: ANY } Return { RET_VAL: INT } });
params!(AlarmSc { Input { EV_ID: DWORD } Return { RET_VAL: INT } Output { STATE: BOOL, Q_STATE: BOOL } });
params!(LockMsg {
    Input { REQ: BOOL, MODE: BYTE, MESGN: DWORD }
    Return { RET_VAL: INT }
    Output { BUSY: BOOL }
});
params!(ReadSi {
    Input { MODE: INT, SI_ID: DWORD }
    Return { RET_VAL: INT }
    Output { N_SI: INT, SYS_INST: ANY }
});
params!(DelSi { Input { MODE: INT, SI_ID: DWORD } Return { RET_VAL: INT } });

pub(super) const ROWS: &[Row] = &[
    Row::asked::<LockMsg>(9, "EN_MSG", |call| lock(call, false)).note("ends in the same call"),
    Row::asked::<LockMsg>(10, "DIS_MSG", |call| lock(call, true)).note("ends in the same call"),
    Row::coded::<AlarmS>(17, "ALARM_SQ", |call| alarm_s(call, AlarmKind::AlarmSq)),
    Row::coded::<AlarmS>(18, "ALARM_S", |call| alarm_s(call, AlarmKind::AlarmS)),
    Row::coded::<AlarmSc>(19, "ALARM_SC", alarm_sc),
    Row::coded::<ReadSi>(105, "READ_SI", read_si),
    Row::coded::<DelSi>(106, "DEL_SI", del_si),
    Row::coded::<AlarmD>(107, "ALARM_DQ", |call| alarm_d(call, AlarmKind::AlarmDq)),
    Row::coded::<AlarmD>(108, "ALARM_D", |call| alarm_d(call, AlarmKind::AlarmD)),
];

/// Longest associated value of a message of these functions, in bytes.
const VALUE: usize = 12;
/// EV_ID 0.
const BAD_NUMBER: u16 = 0x8081;

fn alarm_s(call: &mut Call<'_>, kind: AlarmKind) -> Code {
    let (signal, id) = (call.bool(AlarmS::SIG), call.raw(AlarmS::EV_ID));
    if id == 0 { Err(BAD_NUMBER) } else { alarm(call, AlarmS::SD, (kind, id, 0), signal) }
}

fn alarm_d(call: &mut Call<'_>, kind: AlarmKind) -> Code {
    let (signal, id, component) = (call.bool(AlarmD::SIG), call.raw(AlarmD::EV_ID), call.raw(AlarmD::CMP_ID));
    match (id, component) {
        (0, _) => Err(BAD_NUMBER),
        (_, 0) => Err(0x8089),
        _ => alarm(call, AlarmD::SD, (kind, id, component), signal),
    }
}

/// Sends a message with the associated value `sd` names.
fn alarm(call: &mut Call<'_>, sd: impl Params, (kind, id, component): (AlarmKind, u32, u32), signal: bool) -> Code {
    // A value that is too long or cannot be read is left out; the message is sent.
    let mut values = AlarmValues::default();
    let is_good = matches!(take(call, sd, VALUE, &mut values), Value::None | Value::Taken);
    let messages = call.cx.services();
    let time = messages.alarm_time();
    let sent = messages.alarms().call(AlarmCall { kind, id, component, signal, values: &values }, time);
    messages.send_alarms();
    match sent {
        Ok(_) if !is_good => Ok(0x0001),
        Ok(true) => Ok(0x0002),
        Ok(false) => Ok(0),
        Err(error) => Err(match error {
            AlarmError::NoResources => 0x8082,
            AlarmError::Overflow => 0x8083,
            AlarmError::NoChange => 0x8084,
            AlarmError::NoDisplay => 0x8085,
            AlarmError::FirstIsZero => 0x8087,
            AlarmError::Taken => 0x8088,
        }),
    }
}

/// State of the signal and of the acknowledgement of a message.
fn alarm_sc(call: &mut Call<'_>) -> Code {
    let id = call.raw(AlarmSc::EV_ID);
    if id == 0 {
        return Err(BAD_NUMBER);
    }
    let found = call.cx.services().alarms().get(id).map(|now| now.state);
    let state = found.filter(|state| state.kind.is_function()).ok_or(0x8082_u16)?;
    call.set_bool(AlarmSc::STATE, state.is_active());
    call.set_bool(AlarmSc::Q_STATE, !state.is_open());
    Ok(0)
}

/// Locks or unlocks messages of the function blocks. MODE: 0 all, 1 all of blocks, 4 the one of MESGN; 2, 3, 5 and 6
/// are about kinds of messages that this CPU does not have.
fn lock(call: &mut Call<'_>, locked: bool) -> Code {
    let (mode, id) = (call.byte(LockMsg::MODE), call.raw(LockMsg::MESGN));
    if mode > 6 {
        return Err(0x8082);
    }
    if mode >= 4 && id == 0 {
        return Err(0x8083);
    }
    let which = match mode {
        0 | 1 => AlarmLock::All,
        4 => AlarmLock::Number(id),
        _ => return Ok(0),
    };
    let messages = call.cx.services();
    let time = messages.alarm_time();
    let is_function = messages.alarms().get(id).is_some_and(|now| now.state.kind.is_function());
    if mode == 4 && is_function {
        return Err(0x8083);
    }
    messages.alarms().lock(which, locked, time);
    messages.send_alarms();
    Ok(0)
}

/// Bytes of one number in SYS_INST: function (WORD), length (BYTE), signal and acknowledgement (bits 0 and 1 of a
/// byte), EV_ID, CMP_ID (DWORD each). ["Structure of the Target Area SYS_INST"]
const SYS_INST: usize = 12;

fn layout(state: &AlarmState) -> [u8; SYS_INST] {
    let mut bytes = [0; SYS_INST];
    bytes[..2].copy_from_slice(&state.kind.number().to_be_bytes());
    bytes[2] = SYS_INST as u8;
    bytes[3] = u8::from(state.is_active()) | u8::from(!state.is_open()) << 1;
    bytes[4..8].copy_from_slice(&state.id.to_be_bytes());
    bytes[8..].copy_from_slice(&state.component.to_be_bytes());
    bytes
}

/// Which numbers are meant: 1 all, 2 that of SI_ID, 3 those of the component SI_ID. Only numbers of SFC 107 and 108
/// count: those of SFC 17 and 18 cannot be managed.
fn selection(mode: i16, given: u32) -> Result<impl Fn(&AlarmState) -> bool, u16> {
    match (mode, given) {
        (2 | 3, 0) => Err(0x8081),
        (1, 1..) => Err(0x8082),
        (1..=3, _) => Ok(move |state: &AlarmState| {
            matches!(state.kind, AlarmKind::AlarmDq | AlarmKind::AlarmD)
                && match mode {
                    2 => state.id == given,
                    3 => state.component == given,
                    _ => true,
                }
        }),
        _ => Err(BAD_MODE),
    }
}

/// MODE is not one of the function's.
const BAD_MODE: u16 = 0x8084;

/// N_SI tells how many numbers are in SYS_INST; RET_VAL is 0001h when there are more than it has room for. MODE 0 goes
/// on after them.
fn read_si(call: &mut Call<'_>) -> Code {
    let (mode, given) = (call.int(ReadSi::MODE), call.raw(ReadSi::SI_ID));
    let reading = call.cx.services().alarms().reading();
    let (mode, after) = match (mode, reading) {
        (0, Some((mode, before, after))) if before == given => (mode, after),
        (0, _) => return Err(0x8083),
        _ => (mode, 0),
    };
    let wanted = selection(mode, given)?;
    let any = call.any(ReadSi::SYS_INST).ok_or(0x8087_u16)?;
    let room = any.bytes().unwrap_or(0) as usize / SYS_INST;
    if room == 0 {
        return Err(0x8086);
    }
    let (mut kept, mut count, mut last) = (0, 0, after);
    while let Some(state) = call.cx.services().alarms().after(last).map(|now| now.state) {
        last = state.id;
        if !wanted(&state) {
            continue;
        }
        count += 1;
        if kept < room {
            let at = (kept * SYS_INST) as u32;
            call.write_at(&any, at, &layout(&state)).map_err(|e| write_error(ReadSi::SYS_INST as u32 + 1, e))?;
            kept += 1;
            call.cx.services().alarms().set_reading((mode, given, last));
        }
    }
    call.set_int(ReadSi::N_SI, kept as i16);
    Ok(u16::from(count > kept))
}

fn del_si(call: &mut Call<'_>) -> Code {
    let wanted = selection(call.int(DelSi::MODE), call.raw(DelSi::SI_ID))?;
    let messages = call.cx.services();
    let time = messages.alarm_time();
    messages.alarms().release(wanted, time);
    messages.send_alarms();
    Ok(0)
}

#[cfg(test)]
mod tests;
