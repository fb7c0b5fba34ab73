//! SFB 31 NOTIFY_8P, SFB 33 ALARM, SFB 34 ALARM_8, SFB 35 ALARM_8P, SFB 36 NOTIFY, SFB 37 AR_SEND. ["Generating
//! Block-Related Messages"]
//!
//! The signals of the last call are in the instance; what is kept of a message number is in the CPU's table
//! ([`crate::services::AlarmTable`]).

use ob1_model::{ALARM_VALUE_BYTES, ALARM_VALUES, AlarmKind, AlarmValues};

use crate::Done;
use crate::alarm_value::{Value, take};
use crate::call::Call;
use crate::declare::{At, params};
use crate::row::Row;
use crate::services::{NoPlaceFor, Reported};

params!(Notify8p {
    Input {
        SIG_1: BOOL, SIG_2: BOOL, SIG_3: BOOL, SIG_4: BOOL, SIG_5: BOOL, SIG_6: BOOL, SIG_7: BOOL, SIG_8: BOOL,
        ID: WORD = [0xEE, 0xEE], EV_ID: DWORD, SEVERITY: WORD = [0, 64],
    }
    Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD }
    InOut {
        SD_1: ANY, SD_2: ANY, SD_3: ANY, SD_4: ANY, SD_5: ANY, SD_6: ANY, SD_7: ANY, SD_8: ANY, SD_9: ANY, SD_10: ANY,
    }
    Static { NUMBER: DWORD, PLACE: WORD, LAST: BYTE, WAITS: BOOL }
});
params!(Notify {
    Input { SIG: BOOL, ID: WORD = [0xEE, 0xEE], EV_ID: DWORD, SEVERITY: WORD = [0, 64] }
    Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD }
    InOut {
        SD_1: ANY, SD_2: ANY, SD_3: ANY, SD_4: ANY, SD_5: ANY, SD_6: ANY, SD_7: ANY, SD_8: ANY, SD_9: ANY, SD_10: ANY,
    }
    Static { NUMBER: DWORD, PLACE: WORD, LAST: BYTE, WAITS: BOOL }
});
params!(Alarm {
    Input { EN_R: BOOL, SIG: BOOL, ID: WORD = [0xEE, 0xEE], EV_ID: DWORD, SEVERITY: WORD = [0, 64] }
    Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD, ACK_DN: BOOL, ACK_UP: BOOL }
    InOut {
        SD_1: ANY, SD_2: ANY, SD_3: ANY, SD_4: ANY, SD_5: ANY, SD_6: ANY, SD_7: ANY, SD_8: ANY, SD_9: ANY, SD_10: ANY,
    }
    Static { NUMBER: DWORD, PLACE: WORD, LAST: BYTE, WAITS: BOOL }
});
params!(Alarm8 {
    Input {
        EN_R: BOOL,
        SIG_1: BOOL, SIG_2: BOOL, SIG_3: BOOL, SIG_4: BOOL, SIG_5: BOOL, SIG_6: BOOL, SIG_7: BOOL, SIG_8: BOOL,
        ID: WORD = [0xEE, 0xEE], EV_ID: DWORD, SEVERITY: WORD = [0, 64],
    }
    Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD, ACK_STATE: WORD = [0xFF, 0xFF] }
    Static { NUMBER: DWORD, PLACE: WORD, LAST: BYTE, WAITS: BOOL }
});
params!(Alarm8p {
    Input {
        EN_R: BOOL,
        SIG_1: BOOL, SIG_2: BOOL, SIG_3: BOOL, SIG_4: BOOL, SIG_5: BOOL, SIG_6: BOOL, SIG_7: BOOL, SIG_8: BOOL,
        ID: WORD = [0xEE, 0xEE], EV_ID: DWORD, SEVERITY: WORD = [0, 64],
    }
    Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD, ACK_STATE: WORD = [0xFF, 0xFF] }
    InOut {
        SD_1: ANY, SD_2: ANY, SD_3: ANY, SD_4: ANY, SD_5: ANY, SD_6: ANY, SD_7: ANY, SD_8: ANY, SD_9: ANY, SD_10: ANY,
    }
    Static { NUMBER: DWORD, PLACE: WORD, LAST: BYTE, WAITS: BOOL }
});
params!(ArSend {
    Input { REQ: BOOL, R: BOOL, ID: WORD = [0xEE, 0xEE], AR_ID: DWORD }
    Output { DONE: BOOL, ERROR: BOOL, STATUS: WORD }
    InOut { SD_1: ANY, LEN: WORD }
    Static { LAST: BOOL }
});

/// What the documentation says of each of them.
const NOTE: &str = "the statics are ours";

pub(super) const ROWS: &[Row] = &[
    Row::sfb::<Notify8p>(31, "NOTIFY_8P", |call| alarm(call, &NOTIFY_8P)).note(NOTE),
    Row::sfb::<Alarm>(33, "ALARM", |call| alarm(call, &ALARM)).note(NOTE),
    Row::sfb::<Alarm8>(34, "ALARM_8", |call| alarm(call, &ALARM_8)).note(NOTE),
    Row::sfb::<Alarm8p>(35, "ALARM_8P", |call| alarm(call, &ALARM_8P)).note(NOTE),
    Row::sfb::<Notify>(36, "NOTIFY", |call| alarm(call, &NOTIFY)).note(NOTE),
    Row::sfb::<ArSend>(37, "AR_SEND", ar_send).note("no display can name an archive: STATUS 1"),
];

/// STATUS, decimal as in the manual.
const NO_DISPLAY: u16 = 1;
const BAD_NUMBER: u16 = 4;
const LOST: u16 = 11;
const TAKEN: u16 = 18;
const NO_ROOM: u16 = 20;
const LOCKED: u16 = 21;
const BAD_VALUE: u16 = 22;
const UNDER_WAY: u16 = 25;
/// The lowest weight of an event.
const LOWEST_SEVERITY: u16 = 127;

/// Where a block has its parameters.
struct Face {
    kind: AlarmKind,
    /// SIG or SIG_1.
    signals: At,
    number: At,
    severity: At,
    /// DONE; ERROR and STATUS follow.
    done: At,
    /// EN_R, and the outputs of the acknowledgements: ACK_STATE, or ACK_DN in front of ACK_UP.
    acknowledged: Option<(At, At)>,
    /// SD_1, if it has values.
    values: Option<At>,
    /// The first static.
    statics: At,
}

macro_rules! face {
    ($name:ident: $params:ident, $kind:ident, $signals:ident $(, acknowledged $ack:ident)? $(, values $value:ident)?) => {
        const $name: Face = Face {
            kind: AlarmKind::$kind,
            signals: At($params::$signals as u32),
            number: At($params::EV_ID as u32),
            severity: At($params::SEVERITY as u32),
            done: At($params::DONE as u32),
            acknowledged: face!(@acknowledged $params $($ack)?),
            values: face!(@values $params $($value)?),
            statics: At($params::NUMBER as u32),
        };
    };
    (@acknowledged $params:ident) => { None };
    (@acknowledged $params:ident $ack:ident) => { Some((At($params::EN_R as u32), At($params::$ack as u32))) };
    (@values $params:ident) => { None };
    (@values $params:ident $value:ident) => { Some(At($params::$value as u32)) };
}

face!(NOTIFY_8P: Notify8p, Notify8p, SIG_1, values SD_1);
face!(ALARM: Alarm, Alarm, SIG, acknowledged ACK_DN, values SD_1);
face!(ALARM_8: Alarm8, Alarm8, SIG_1, acknowledged ACK_STATE);
face!(ALARM_8P: Alarm8p, Alarm8p, SIG_1, acknowledged ACK_STATE, values SD_1);
face!(NOTIFY: Notify, Notify, SIG, values SD_1);

impl Face {
    /// The static so many behind the first.
    const fn fixed(&self, index: u32) -> At {
        At(self.statics.0 + index)
    }

    fn signals(&self, call: &mut Call<'_>) -> u8 {
        let count = self.kind.signals().count_ones();
        (0..count).fold(0, |signals, bit| signals | u8::from(call.bool(At(self.signals.0 + bit))) << bit)
    }

    /// The associated values, and the worst that is to be said of them.
    fn values(&self, call: &mut Call<'_>) -> (AlarmValues, Value) {
        let (mut values, mut worst) = (AlarmValues::default(), Value::None);
        let Some(first) = self.values else { return (values, worst) };
        for index in 0..ALARM_VALUES as u32 {
            match take(call, At(first.0 + index), ALARM_VALUE_BYTES, &mut values) {
                Value::None | Value::Taken => {}
                Value::Bad if worst == Value::NoPointer => {}
                bad => worst = bad,
            }
        }
        (values, worst)
    }

    fn end(&self, call: &mut Call<'_>, done: bool, error: bool, status: u16) -> Done {
        call.set_bool(self.done, done);
        call.set_bool(At(self.done.0 + 1), error);
        call.set(At(self.done.0 + 2), u32::from(status));
        call.br(!error)
    }
}

/// One call: looks for transitions, sends a message of them, and gives the acknowledgements out.
fn alarm(call: &mut Call<'_>, face: &Face) -> Done {
    let [number, place, last, waits] = [0, 1, 2, 3].map(|index| face.fixed(index));
    let owner = call.cx.instance().map_or((0, 0), |instance| (instance.db, instance.offset));
    let (mut id, mut at) = (call.raw(number), call.word(place));
    // ID and EV_ID count at the first call only, and again after a restart, which has emptied the table.
    let is_first = call.cx.services().alarms().registered(at, id, owner).is_none();
    if is_first {
        // At the first call a pointer that is none is an error; later the message is sent without the value.
        id = call.raw(face.number);
        if face.values(call).1 == Value::NoPointer {
            return face.end(call, false, true, BAD_NUMBER);
        }
        at = match call.cx.services().alarms().register(face.kind, id, owner) {
            Ok(place) => place,
            Err(NoPlaceFor::Number) => return face.end(call, false, true, BAD_NUMBER),
            Err(NoPlaceFor::Taken) => return face.end(call, false, true, TAKEN),
            Err(NoPlaceFor::Full) => return face.end(call, false, true, NO_ROOM),
        };
        call.set(number, id);
        call.set(place, u32::from(at));
        call.set(last, 0);
        call.set_bool(waits, false);
    }
    let signals = face.signals(call);
    // The first call of a NOTIFY sends the present state; the others take it that all signals were 0 before.
    let tells_first = is_first && face.kind.acknowledged() == (false, false);
    let (done, error, status) = if signals != call.byte(last) || tells_first {
        let (values, worst) = face.values(call);
        let is_good = worst == Value::None && call.word(face.severity) <= LOWEST_SEVERITY;
        let messages = call.cx.services();
        let time = messages.alarm_time();
        let reported = messages.alarms().report(at, signals, &values, time);
        messages.send_alarms();
        call.set(last, u32::from(signals));
        call.set_bool(waits, matches!(reported, Reported::Sent | Reported::Lost));
        match reported {
            Reported::Lost => (false, false, LOST),
            Reported::Sent if !is_good => (false, false, BAD_VALUE),
            Reported::Sent => (false, false, UNDER_WAY),
            Reported::Locked => (false, true, LOCKED),
            Reported::NoDisplay => (false, true, NO_DISPLAY),
        }
    } else {
        let waited = call.bool(waits);
        let table = call.cx.services().alarms();
        let logged_on = table.displays().want(face.kind.display());
        let (is_locked, waiting) =
            table.registered(at, id, owner).map_or((false, 0), |(s, waiting)| (s.locked, waiting));
        if waited && waiting == 0 {
            call.set_bool(waits, false);
            (true, false, 0)
        } else if is_locked {
            (false, true, LOCKED)
        } else if !logged_on {
            (false, true, NO_DISPLAY)
        } else {
            (false, false, if waited { UNDER_WAY } else { 0 })
        }
    };
    if let Some((enabled, state)) = face.acknowledged
        && (call.bool(enabled) || is_first)
    {
        let table = call.cx.services().alarms();
        let (coming, going) = table.registered(at, id, owner).map_or((0xFF, 0xFF), |(s, _)| (s.coming, s.going));
        if face.kind == AlarmKind::Alarm {
            call.set_bool(state, going & 1 == 1);
            call.set_bool(At(state.0 + 1), coming & 1 == 1);
        } else {
            call.set(state, u32::from(u16::from_be_bytes([going, coming])));
        }
    }
    face.end(call, done, error, status)
}

/// Sends archive data to displays that have named the archive when they logged on; how they do that is not known, so
/// there is none.
fn ar_send(call: &mut Call<'_>) -> Done {
    let (request, last) = (call.bool(ArSend::REQ), call.bool(ArSend::LAST));
    call.set_bool(ArSend::LAST, request);
    call.set_bool(ArSend::DONE, false);
    let status = match request && !last && !call.bool(ArSend::R) {
        false => 0,
        true if call.raw(ArSend::AR_ID) == 0 || call.any(ArSend::SD_1).is_none() => BAD_NUMBER,
        true => NO_DISPLAY,
    };
    call.set_bool(ArSend::ERROR, status != 0);
    call.set(ArSend::STATUS, u32::from(status));
    call.br(status == 0)
}

#[cfg(test)]
mod tests;
