//! Engines: what executes a block. The reference engine defines what every statement means.

mod arith;
mod call;
mod code;
mod convert;
mod lower;
mod lower_call;
mod raw;
mod regs;
mod resolve;
mod run;
mod shift;
mod slow;

use ob1_model::Site;

use crate::machine::Caller;
use crate::memory::Db;
use crate::{Abort, Context};

pub(crate) use call::Frame;
pub(crate) use lower::{Constants, Lowering, Signature, Signatures, lower, writes_param};
pub(crate) use lower_call::collect;
pub(crate) use raw::RAW;
pub(crate) use regs::Interrupted;
pub(crate) use run::Reference;

/// A loaded block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Callee {
    /// Statements, by index.
    Code(u32),
    /// A native block, by index.
    Native(u32),
}

/// What a block finds when it is entered.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Entry {
    /// Where the references to its actual parameters begin in the stack of references.
    pub(crate) refs: u32,
    /// Bit n: parameter n was supplied.
    pub(crate) given: u64,
    /// The DB register.
    pub(crate) db: Db,
    /// The DI register: the instance of an FB.
    pub(crate) di: Db,
    /// Address register 2: where the instance begins in it.
    pub(crate) ar2: u32,
    /// The caller's local data.
    pub(crate) previous_local: u32,
    /// Bytes of them.
    pub(crate) previous_local_len: u32,
}

/// What executes blocks of statements. A fast engine takes this one's place later.
pub(crate) trait Engine: Send {
    /// Runs a block to its end or until the CPU goes to STOP.
    fn call(&self, block: u32, entry: &Entry, cx: &mut Context<'_>) -> Result<(), Abort>;

    /// Where a statement stands in the source.
    fn site(&self, caller: Caller) -> Option<Site>;
}
