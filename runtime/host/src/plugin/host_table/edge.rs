//! What all host functions share: the way to the frame, checked pointers, statuses.

use std::panic::{AssertUnwindSafe, catch_unwind};

use ob1_cpu::{Abort, NativeArea, Refused};
use ob1_sdk::abi::{self as abi, CallContext, Status};

use crate::plugin::frame::Frame;

/// A status other than OK.
pub(super) struct NotOk(pub(super) Status);

impl From<Refused> for NotOk {
    #[cold]
    fn from(error: Refused) -> Self {
        Self(match error {
            Refused::Abort => abi::ABORT,
            Refused::NoParam => abi::NO_PARAM,
            Refused::Outside | Refused::NoTimer => abi::OUTSIDE,
            Refused::NoDb => abi::NO_DB,
            Refused::DbNumber => abi::DB_NUMBER,
            Refused::ReadOnly => abi::READ_ONLY,
            Refused::NoModule => abi::NO_MODULE,
            Refused::Absent => abi::ABSENT,
            Refused::Busy => abi::BUSY,
            Refused::NoRecord => abi::NO_RECORD,
            Refused::NoBlock => abi::NO_BLOCK,
        })
    }
}

impl From<Abort> for NotOk {
    fn from(_: Abort) -> Self {
        Self(abi::ABORT)
    }
}

/// An impossible pointer or length.
pub(super) const BAD_ARGUMENT: NotOk = NotOk(abi::BAD_ARGUMENT);

/// Runs a host function's body on the frame of the call.
///
/// # Safety
/// `call` is null or the context of the entry that is running.
#[inline]
pub(super) unsafe fn with(
    call: *mut CallContext,
    body: impl for<'x> FnOnce(&mut Frame<'x>) -> Result<(), NotOk>,
) -> Status {
    // SAFETY: `PluginBlock::call` made the context from its frame and does not touch it while the entry runs; nested
    // calls have frames of their own. The body works for every lifetime, so nothing of it can stay in the frame.
    let Some(frame) = (unsafe { call.cast::<Frame<'_>>().as_mut() }) else { return abi::BAD_ARGUMENT };
    if frame.abort {
        return abi::ABORT;
    }
    match catch_unwind(AssertUnwindSafe(|| body(frame))) {
        Ok(Ok(())) => abi::OK,
        Ok(Err(NotOk(status))) => refuse(frame, status),
        Err(panic) => {
            frame.panic = Some(panic);
            refuse(frame, abi::ABORT)
        }
    }
}

/// Out of line: most calls are not refused, and there are as many copies of [`with`] as functions in the table.
#[cold]
#[inline(never)]
fn refuse(frame: &mut Frame<'_>, status: Status) -> Status {
    frame.abort |= status == abi::ABORT;
    status
}

/// Bytes to copy into.
///
/// # Safety
/// `into` is null or valid for writing `len` bytes until the host function returns.
#[inline]
pub(super) unsafe fn bytes_mut<'a>(into: *mut u8, len: u32) -> Result<&'a mut [u8], NotOk> {
    if len == 0 {
        return Ok(&mut []);
    }
    if into.is_null() || len > i32::MAX as u32 {
        return Err(BAD_ARGUMENT);
    }
    // SAFETY: not null; the rest is the caller's word.
    Ok(unsafe { std::slice::from_raw_parts_mut(into, len as usize) })
}

/// Bytes to copy from.
///
/// # Safety
/// `from` is null or valid for reading `len` bytes until the host function returns.
#[inline]
pub(super) unsafe fn bytes<'a>(from: *const u8, len: u32) -> Result<&'a [u8], NotOk> {
    if len == 0 {
        return Ok(&[]);
    }
    if from.is_null() || len > i32::MAX as u32 {
        return Err(BAD_ARGUMENT);
    }
    // SAFETY: not null; the rest is the caller's word.
    Ok(unsafe { std::slice::from_raw_parts(from, len as usize) })
}

/// Writes a result.
///
/// # Safety
/// `to` is null or valid for writing a `T`.
#[inline]
pub(super) unsafe fn put<T>(to: *mut T, value: T) -> Result<(), NotOk> {
    if to.is_null() || !to.is_aligned() {
        return Err(BAD_ARGUMENT);
    }
    // SAFETY: not null and aligned; the rest is the caller's word.
    unsafe { to.write(value) };
    Ok(())
}

/// Checks the size a caller has set in a struct to be filled; larger ones belong to later minor versions, and their new
/// fields keep what the caller has put there.
///
/// # Safety
/// `to` is null or leads to a struct that begins with its size.
#[inline]
pub(super) unsafe fn sized<T>(to: *mut T) -> Result<(), NotOk> {
    if to.is_null() || !to.is_aligned() {
        return Err(BAD_ARGUMENT);
    }
    // SAFETY: not null, aligned, begins with a u32 by the caller's word.
    if unsafe { to.cast::<u32>().read() as usize } < size_of::<T>() { Err(BAD_ARGUMENT) } else { Ok(()) }
}

/// An area code with its data block.
#[inline]
pub(super) fn area(code: u8, db: u16) -> Result<NativeArea, NotOk> {
    Ok(match code {
        abi::AREA_E => NativeArea::Input,
        abi::AREA_A => NativeArea::Output,
        abi::AREA_M => NativeArea::Memory,
        abi::AREA_DB => NativeArea::Db(db),
        abi::AREA_INSTANCE => NativeArea::Instance,
        abi::AREA_L => NativeArea::CallerLocal,
        _ => return Err(BAD_ARGUMENT),
    })
}
