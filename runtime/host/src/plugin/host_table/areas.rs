//! Memory areas, data blocks, the instance.

use ob1_cpu::Refused;
use ob1_sdk::abi::{CallContext, InstanceInfo, Registers, Status};

use super::edge::{area, bytes, bytes_mut, put, sized, with};

pub(super) unsafe extern "C" fn read(
    call: *mut CallContext,
    code: u8,
    db: u16,
    at: u32,
    into: *mut u8,
    len: u32,
) -> Status {
    // SAFETY: see the head of `host_table`; the same holds for every block of this file.
    unsafe { with(call, |frame| Ok(frame.cx.area_read(area(code, db)?, at, bytes_mut(into, len)?)?)) }
}

pub(super) unsafe extern "C" fn write(
    call: *mut CallContext,
    code: u8,
    db: u16,
    at: u32,
    from: *const u8,
    len: u32,
) -> Status {
    // SAFETY: as above.
    unsafe { with(call, |frame| Ok(frame.cx.area_write(area(code, db)?, at, bytes(from, len)?)?)) }
}

pub(super) unsafe extern "C" fn bit_get(
    call: *mut CallContext,
    code: u8,
    db: u16,
    bit_address: u32,
    value: *mut u8,
) -> Status {
    // SAFETY: as above.
    unsafe { with(call, |frame| put(value, u8::from(frame.cx.bit_get(area(code, db)?, bit_address)?))) }
}

pub(super) unsafe extern "C" fn bit_set(
    call: *mut CallContext,
    code: u8,
    db: u16,
    bit_address: u32,
    value: u8,
) -> Status {
    // SAFETY: as above.
    unsafe { with(call, |frame| Ok(frame.cx.bit_set(area(code, db)?, bit_address, value != 0)?)) }
}

pub(super) unsafe extern "C" fn len(call: *mut CallContext, code: u8, db: u16, len: *mut u32) -> Status {
    // SAFETY: as above.
    unsafe { with(call, |frame| put(len, frame.cx.area_len(area(code, db)?)?)) }
}

pub(super) unsafe extern "C" fn instance(call: *mut CallContext, info: *mut InstanceInfo) -> Status {
    // SAFETY: as above.
    unsafe {
        with(call, |frame| {
            sized(info)?;
            let found = frame.cx.instance().ok_or(Refused::NoParam)?;
            let size = (*info).size;
            put(info, InstanceInfo { size, db: found.db, reserved: 0, offset: found.offset, len: found.len })
        })
    }
}

pub(super) unsafe extern "C" fn registers(call: *mut CallContext, registers: *mut Registers) -> Status {
    // SAFETY: as above.
    unsafe {
        with(call, |frame| {
            sized(registers)?;
            let (db, di) = frame.cx.registers();
            put(registers, Registers { size: (*registers).size, db, di })
        })
    }
}
