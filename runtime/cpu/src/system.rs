//! The system blocks of `ob1-std` as native blocks.

use ob1_model::{Area, BlockId, Event, FaultKind, Interface};
use ob1_std::{AnyPointer, SystemBlock, SystemFunction, copy, ticks};

use crate::{Abort, NativeArea, NativeBlock, NativeContext, NativeError};

/// Bytes copied at a time.
const CHUNK: usize = 256;
/// "STOP by the program".
const STOP_BY_PROGRAM: Event = Event(0x4543);

/// Every system block, ready for [`crate::Cpu::new`].
#[must_use]
pub fn system_blocks() -> Vec<Box<dyn NativeBlock>> {
    ob1_std::library().into_iter().map(|block| Box::new(System(block)) as Box<dyn NativeBlock>).collect()
}

struct System(SystemBlock);

impl NativeBlock for System {
    fn id(&self) -> BlockId {
        self.0.id
    }

    fn name(&self) -> &str {
        self.0.name
    }

    fn interface(&self) -> &Interface {
        &self.0.interface
    }

    fn reset(&self) {}

    fn call(&self, cx: &mut dyn NativeContext) -> Result<(), Abort> {
        match self.0.function {
            SystemFunction::Stop => return Err(cx.stop(STOP_BY_PROGRAM, "")),
            SystemFunction::RetriggerWatchdog => cx.retrigger_watchdog(),
            SystemFunction::TimeTick => {
                let now = cx.now();
                result(cx, 0, ticks::time_tick(now));
            }
            SystemFunction::BlockMove => {
                let code = pointers(cx).and_then(|(source, target)| copy::block_move(source, target));
                carry_out(cx, code);
            }
            SystemFunction::Fill => {
                let code = pointers(cx).and_then(|(source, target)| copy::fill(source, target));
                carry_out(cx, code);
            }
        }
        Ok(())
    }
}

/// Writes RET_VAL. A call without parameters (`UC`) has none.
fn result(cx: &mut dyn NativeContext, index: u32, value: u32) {
    if cx.param_given(index) {
        // RET_VAL is there and an output: this cannot fail.
        let _ = cx.param_set(index, value);
    }
}

/// The ANY pointers of parameters 1 and 3.
fn pointers(cx: &mut dyn NativeContext) -> Result<(Option<AnyPointer>, Option<AnyPointer>), u16> {
    let mut any = |index: u32, error| {
        let mut bytes = [0; 10];
        match cx.param_read(index, 0, &mut bytes) {
            Ok(()) => Ok(AnyPointer::parse(&bytes)),
            Err(_) => Err(copy::parameter_error(index as u16 + 1, error)),
        }
    };
    Ok((any(0, FaultKind::AreaRead)?, any(2, FaultKind::AreaWrite)?))
}

/// Copies piece by piece and leaves the error code in RET_VAL; BR is 0 after an error.
fn carry_out(cx: &mut dyn NativeContext, plan: Result<copy::Plan, u16>) {
    let code = plan.and_then(|plan| run(cx, &plan)).err().unwrap_or(0);
    result(cx, 1, u32::from(code));
    cx.set_br(code == 0);
}

fn run(cx: &mut dyn NativeContext, plan: &copy::Plan) -> Result<(), u16> {
    let (source, from) = place(cx, &plan.source);
    let (target, to) = place(cx, &plan.target);
    let mut buffer = [0; CHUNK];
    let mut done = 0;
    while done < plan.bytes {
        let phase = done % plan.period;
        let len = (plan.bytes - done).min(plan.period - phase).min(CHUNK as u32);
        let piece = &mut buffer[..len as usize];
        cx.area_read(source, from + phase, piece).map_err(|e| error(1, e, FaultKind::AreaLengthRead))?;
        cx.area_write(target, to + done, piece).map_err(|e| error(3, e, FaultKind::AreaLengthWrite))?;
        done += len;
    }
    Ok(())
}

/// The area of an ANY pointer and the byte in it. Local data is the caller's, whichever of its two codes the pointer has.
fn place(cx: &mut dyn NativeContext, any: &AnyPointer) -> (NativeArea, u32) {
    let (db, di) = cx.registers();
    let area = match any.area {
        Area::Input => NativeArea::Input,
        Area::Output => NativeArea::Output,
        Area::Memory | Area::Peripheral => NativeArea::Memory,
        Area::Local | Area::PreviousLocal => NativeArea::CallerLocal,
        Area::Db => NativeArea::Db(if any.db == 0 { db } else { any.db }),
        Area::Di => NativeArea::Db(if any.db == 0 { di } else { any.db }),
    };
    (area, any.at.byte())
}

fn error(parameter: u16, error: NativeError, outside: FaultKind) -> u16 {
    let fault = match error {
        NativeError::NoDb => FaultKind::DbNotLoaded,
        NativeError::DbNumber => FaultKind::DbNumber,
        NativeError::ReadOnly => FaultKind::WriteProtectedDb,
        _ => outside,
    };
    copy::parameter_error(parameter, fault)
}
