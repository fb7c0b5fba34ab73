//! S5 timers and counters.

use ob1_model::TimerKind;
use ob1_sdk::abi::{CallContext, Status, TimerInfo};

use super::edge::{BAD_ARGUMENT, put, sized, with};

pub(super) unsafe extern "C" fn run(call: *mut CallContext, number: u16, kind: u8, rlo: u8, s5time: u16) -> Status {
    // SAFETY: see the head of `host_table`; the same holds for every block of this file.
    unsafe {
        with(call, |frame| {
            let kind = TimerKind::from_repr(kind).ok_or(BAD_ARGUMENT)?;
            Ok(frame.cx.timer_run(number, kind, rlo != 0, s5time)?)
        })
    }
}

pub(super) unsafe extern "C" fn reset(call: *mut CallContext, number: u16) -> Status {
    // SAFETY: as above.
    unsafe { with(call, |frame| Ok(frame.cx.timer_reset(number)?)) }
}

pub(super) unsafe extern "C" fn get(call: *mut CallContext, number: u16, info: *mut TimerInfo) -> Status {
    // SAFETY: as above.
    unsafe {
        with(call, |frame| {
            sized(info)?;
            let timer = frame.cx.timer_get(number)?;
            let (output, running) = (u8::from(timer.output), u8::from(timer.running));
            put(info, TimerInfo { size: (*info).size, output, running, remaining: timer.remaining })
        })
    }
}

pub(super) unsafe extern "C" fn counter_get(call: *mut CallContext, number: u16, value: *mut u16) -> Status {
    // SAFETY: as above.
    unsafe { with(call, |frame| put(value, frame.cx.counter_get(number)?)) }
}

pub(super) unsafe extern "C" fn counter_set(call: *mut CallContext, number: u16, value: u16) -> Status {
    // SAFETY: as above.
    unsafe { with(call, |frame| Ok(frame.cx.counter_set(number, value)?)) }
}
