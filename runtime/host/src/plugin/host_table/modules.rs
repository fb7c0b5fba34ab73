//! Modules: registers, records, and the plugin's memory for each.

use std::ffi::c_void;

use ob1_cpu::Refused;
use ob1_sdk::abi::{CallContext, ModuleInfo, Status};

use super::edge::{bytes, bytes_mut, put, sized, with};

pub(super) unsafe extern "C" fn info(call: *mut CallContext, address: u32, info: *mut ModuleInfo) -> Status {
    // SAFETY: see the head of `host_table`; the same holds for every block of this file.
    unsafe {
        with(call, |frame| {
            sized(info)?;
            let (status, registers) = (frame.cx.module_status(address)?, frame.cx.module(address)?);
            let address = u16::try_from(address).map_err(|_| Refused::NoModule)?;
            put(
                info,
                ModuleInfo {
                    size: (*info).size,
                    address,
                    input_bytes: registers.inputs,
                    output_bytes: registers.outputs,
                    present: u8::from(status.present),
                    reserved: 0,
                    generation: status.generation,
                },
            )
        })
    }
}

pub(super) unsafe extern "C" fn state(call: *mut CallContext, address: u32, state: *mut *mut c_void) -> Status {
    // SAFETY: as above.
    unsafe { with(call, |frame| put(state, frame.memory.module(address).ok_or(Refused::NoModule)?)) }
}

pub(super) unsafe extern "C" fn io_read(call: *mut CallContext, address: u32, into: *mut u8, len: u32) -> Status {
    // SAFETY: as above.
    unsafe { with(call, |frame| Ok(frame.cx.io_read(address, bytes_mut(into, len)?)?)) }
}

pub(super) unsafe extern "C" fn io_write(call: *mut CallContext, address: u32, from: *const u8, len: u32) -> Status {
    // SAFETY: as above.
    unsafe { with(call, |frame| Ok(frame.cx.io_write(address, bytes(from, len)?)?)) }
}

pub(super) unsafe extern "C" fn record_read(
    call: *mut CallContext,
    address: u32,
    record: u8,
    into: *mut u8,
    len: u32,
    read: *mut u32,
) -> Status {
    // SAFETY: as above.
    unsafe {
        with(call, |frame| {
            let copied = frame.cx.record_read(address, record, bytes_mut(into, len)?)?;
            put(read, copied as u32)
        })
    }
}

pub(super) unsafe extern "C" fn record_write(
    call: *mut CallContext,
    address: u32,
    record: u8,
    from: *const u8,
    len: u32,
) -> Status {
    // SAFETY: as above.
    unsafe { with(call, |frame| Ok(frame.cx.record_of_block_write(address, record, bytes(from, len)?)?)) }
}
