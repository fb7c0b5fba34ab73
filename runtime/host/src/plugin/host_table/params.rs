//! Actual parameters, and the binary result.

use ob1_cpu::Refused;
use ob1_sdk::abi::{CallContext, Status};

use super::edge::{bytes, bytes_mut, put, with};

pub(super) unsafe extern "C" fn get(call: *mut CallContext, index: u32, value: *mut u32) -> Status {
    // SAFETY: see the head of `host_table`; the same holds for every block of this file.
    unsafe { with(call, |frame| put(value, frame.cx.get(index)?)) }
}

pub(super) unsafe extern "C" fn set(call: *mut CallContext, index: u32, value: u32) -> Status {
    // SAFETY: as above.
    unsafe { with(call, |frame| Ok(frame.cx.set(index, value)?)) }
}

pub(super) unsafe extern "C" fn read(call: *mut CallContext, index: u32, at: u32, into: *mut u8, len: u32) -> Status {
    // SAFETY: as above.
    unsafe { with(call, |frame| Ok(frame.cx.read(index, at, bytes_mut(into, len)?)?)) }
}

pub(super) unsafe extern "C" fn write(
    call: *mut CallContext,
    index: u32,
    at: u32,
    from: *const u8,
    len: u32,
) -> Status {
    // SAFETY: as above.
    unsafe { with(call, |frame| Ok(frame.cx.write(index, at, bytes(from, len)?)?)) }
}

pub(super) unsafe extern "C" fn given(call: *mut CallContext, index: u32) -> Status {
    // SAFETY: as above.
    unsafe { with(call, |frame| if frame.cx.given(index) { Ok(()) } else { Err(Refused::NoParam.into()) }) }
}

pub(super) unsafe extern "C" fn set_br(call: *mut CallContext, br: u8) -> Status {
    // SAFETY: as above.
    unsafe {
        with(call, |frame| {
            frame.cx.set_br(br != 0);
            Ok(())
        })
    }
}
