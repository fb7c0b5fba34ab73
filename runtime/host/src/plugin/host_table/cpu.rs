//! Calling blocks, time, faults, diagnosis, log.

use std::ffi::c_void;
use std::ptr;

use ob1_cpu::NativeArg;
use ob1_model::{BlockId, BlockKind, Event, FaultKind};
use ob1_sdk::abi::{
    CallArg, CallContext, EXTENSION_SETTINGS, KIND_FB, KIND_FC, KIND_SFB, KIND_SFC, LOG_ERROR, LOG_INFO, ObInfo,
    Status, Text,
};

use super::edge::{BAD_ARGUMENT, NotOk, area, bytes, put, sized, with};
use super::settings::SETTINGS;
use crate::plugin::text::given;

/// Arguments a call can have.
const ARGS_MAX: usize = 64;
/// Bytes of diagnostic data an interrupt carries.
const DIAGNOSTIC_MAX: u32 = 16;

pub(super) unsafe extern "C" fn call_block(
    call: *mut CallContext,
    kind: u8,
    number: u16,
    instance_db: u16,
    args: *const CallArg,
    arg_count: u32,
) -> Status {
    // SAFETY: see the head of `host_table`; the same holds for every block of this file.
    unsafe {
        with(call, |frame| {
            let kind = match kind {
                KIND_FB => BlockKind::Fb,
                KIND_FC => BlockKind::Fc,
                KIND_SFB => BlockKind::Sfb,
                KIND_SFC => BlockKind::Sfc,
                _ => return Err(BAD_ARGUMENT),
            };
            let mut native = [NativeArg::Open; ARGS_MAX];
            let native = native.get_mut(..arg_count as usize).ok_or(BAD_ARGUMENT)?;
            if arg_count > 0 && (args.is_null() || !args.is_aligned()) {
                return Err(BAD_ARGUMENT);
            }
            for (i, slot) in native.iter_mut().enumerate() {
                *slot = argument(&*args.add(i))?;
            }
            Ok(frame.cx.call_block(BlockId::new(kind, number), instance_db, native)?)
        })
    }
}

fn argument(arg: &CallArg) -> Result<NativeArg, NotOk> {
    Ok(match arg.kind {
        0 => NativeArg::Open,
        1 => NativeArg::Value(arg.value),
        2 => NativeArg::Operand(area(arg.area, arg.db)?, arg.bit_address),
        _ => return Err(BAD_ARGUMENT),
    })
}

pub(super) unsafe extern "C" fn now(call: *mut CallContext, nanos: *mut u64) -> Status {
    // SAFETY: as above.
    unsafe { with(call, |frame| put(nanos, frame.cx.now().nanos())) }
}

pub(super) unsafe extern "C" fn ob_info(call: *mut CallContext, info: *mut ObInfo) -> Status {
    // SAFETY: as above.
    unsafe {
        with(call, |frame| {
            sized(info)?;
            let ob = frame.cx.ob_info();
            let (size, number, priority) = ((*info).size, ob.number, ob.priority);
            put(info, ObInfo { size, number, priority, reserved: 0, start: ob.start })
        })
    }
}

pub(super) unsafe extern "C" fn attend(call: *mut CallContext) -> Status {
    // SAFETY: as above.
    unsafe { with(call, |frame| Ok(frame.cx.attend()?)) }
}

pub(super) unsafe extern "C" fn raise_fault(call: *mut CallContext, event: u16, number: u32) -> Status {
    // SAFETY: as above.
    unsafe {
        with(call, |frame| {
            let kind = FaultKind::from_number(event).ok_or(BAD_ARGUMENT)?;
            Ok(frame.cx.raise_fault(kind, number)?)
        })
    }
}

pub(super) unsafe extern "C" fn diagnostic_interrupt(
    call: *mut CallContext,
    address: u32,
    data: *const u8,
    len: u32,
) -> Status {
    // SAFETY: as above.
    unsafe {
        with(call, |frame| {
            if len > DIAGNOSTIC_MAX {
                return Err(BAD_ARGUMENT);
            }
            Ok(frame.cx.diagnostic_interrupt(address, bytes(data, len)?)?)
        })
    }
}

pub(super) unsafe extern "C" fn diag_entry(call: *mut CallContext, number: u16, text: Text) -> Status {
    // SAFETY: as above.
    unsafe {
        with(call, |frame| {
            frame.cx.diag_entry(number, given(text).ok_or(BAD_ARGUMENT)?);
            Ok(())
        })
    }
}

pub(super) unsafe extern "C" fn stop(call: *mut CallContext, text: Text) -> Status {
    // SAFETY: as above.
    unsafe {
        with(call, |frame| {
            let text = given(text).unwrap_or("a text that is a null pointer");
            Err(frame.cx.stop(Event::PLUGIN_STOP, text).into())
        })
    }
}

pub(super) unsafe extern "C" fn log(call: *mut CallContext, level: u8, text: Text) -> Status {
    // SAFETY: as above.
    unsafe {
        with(call, |frame| {
            if !(LOG_ERROR..=LOG_INFO).contains(&level) {
                return Err(BAD_ARGUMENT);
            }
            frame.cx.log(level, given(text).ok_or(BAD_ARGUMENT)?);
            Ok(())
        })
    }
}

/// The extensions by name; null for an unknown name.
pub(super) unsafe extern "C" fn extension(_call: *mut CallContext, name: Text) -> *const c_void {
    // SAFETY: see the head of `host_table`.
    match unsafe { given(name) } {
        Some(EXTENSION_SETTINGS) => ptr::from_ref(&SETTINGS).cast(),
        _ => ptr::null(),
    }
}
