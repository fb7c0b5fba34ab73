//! Back from what STEP 7's compiler makes of a statement to the statement.
//!
//! A `CALL` stands between two `BLD`, whose numbers tell what is called. Within them values that have no address of
//! their own are put into the caller's local data or the instance, then the block is called, then results are copied
//! out. A frame in which anything else happens does not fold and stays as it is.

mod caller;
mod component;
mod frame;
mod function;
mod instance;
mod values;

use ob1_ir::Op;

use crate::block::{Callees, Item};
use crate::statement::Mc7Op;

pub(crate) use caller::Caller;
pub(crate) use component::{Base, component};
pub(crate) use frame::{FRAMES, Frame, frame_length};
pub(crate) use instance::INSTANCE_START;

/// The call a frame stands for, with what our compiler puts before it. `None`: it does not fold.
pub(crate) fn call(open: u8, frame: &[Item], caller: &Caller<'_, '_>, callees: &Callees<'_>) -> Option<Vec<Op>> {
    let (_, kind) = FRAMES.iter().find(|(number, _)| *number == open)?;
    let ops: Vec<&Mc7Op> = frame.iter().map(|item| &item.op).collect();
    let call = match kind {
        Frame::Function(kind) => return function::call(*kind, &ops, caller, callees),
        Frame::DataBlock(kind) => instance::call(*kind, false, &ops, caller, callees),
        Frame::Multi(kind) => instance::call(*kind, true, &ops, caller, callees),
    };
    call.map(|call| vec![Op::Call(Box::new(call))])
}
