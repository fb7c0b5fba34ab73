//! The outputs that blocks of Siemens tell the end of a job with.

use ob1_sdk::types::{Bool, Word};
use ob1_sdk::{Abort, Cx, Formal, Out};

/// Where a block has them.
#[derive(Clone, Copy, Debug)]
pub struct Outputs {
    /// DONE of a block that sends, NDR of one that receives.
    pub end: Formal<Bool, Out>,
    /// ERROR.
    pub error: Formal<Bool, Out>,
    /// STATUS.
    pub status: Formal<Word, Out>,
}

impl Outputs {
    /// Sets the outputs of a call, and BR: done, or an error, or neither with another STATUS.
    ///
    /// # Errors
    /// [`Abort`] of a host function: the call ends at once.
    pub fn set<M>(&self, cx: &mut Cx<'_, M>, done: bool, failed: Option<u16>, other: u16) -> Result<(), Abort> {
        cx.set(self.end, done && failed.is_none())?;
        cx.set(self.error, failed.is_some())?;
        cx.set(self.status, failed.unwrap_or(other))?;
        cx.set_br(failed.is_none())
    }
}
