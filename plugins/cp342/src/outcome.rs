//! The outcome of a call.

use ob1_sdk::{Abort, Cx, Refused};
use ob1_siemens::any::status as memory;
use ob1_siemens::outputs::Outputs;
use ob1_words::cp342::{HEAD_BYTES, RECEIVE, status};

/// Data are not exchanged yet.
const STARTING: u16 = 0x8180;
/// The DP service has not been started.
const NOT_STARTED: u16 = 0x8183;
/// The length does not match the area.
pub(crate) const AREA: u16 = 0x80B1;
/// The module is busy.
const BUSY: u16 = 0x80C1;

/// The outcome of a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// Done without error; STATUS is 0.
    Done,
    /// Nothing to do, and no error; with STATUS.
    Nothing(u16),
    /// Failed, with this STATUS.
    Error(u16),
}

impl Outcome {
    /// Sets the outputs of the block.
    pub(crate) fn set(self, cx: &mut Cx<'_, ()>, outputs: Outputs) -> Result<(), Abort> {
        match self {
            Self::Done => outputs.set(cx, true, None, 0),
            Self::Nothing(status) => outputs.set(cx, false, None, status),
            Self::Error(status) => outputs.set(cx, false, Some(status), 0),
        }
    }
}

/// The outcome for a refusal of the module.
pub(crate) fn of_module(refused: Refused) -> Outcome {
    Outcome::Error(match refused {
        Refused::NoModule => memory::NO_MODULE,
        Refused::Absent => NOT_STARTED,
        Refused::Outside => AREA,
        Refused::Busy => BUSY,
        _ => status::UNKNOWN,
    })
}

/// The outcome for memory of the program that cannot be read or written; `outside` is the STATUS for an area that
/// exceeds it.
pub(crate) fn of_memory(refused: Refused, outside: u16) -> Outcome {
    Outcome::Error(memory::of_memory(refused, outside))
}

/// DPSTATUS of a CP that exchanges data; otherwise the outcome of the call.
pub(crate) fn exchanging(cx: &mut Cx<'_, ()>, address: u16) -> Result<Result<u8, Outcome>, Abort> {
    let mut head = [0; HEAD_BYTES];
    Ok(match cx.record_read(u32::from(address), RECEIVE, &mut head)? {
        Ok(HEAD_BYTES) if head[0] == 0 => Err(Outcome::Nothing(STARTING)),
        Ok(HEAD_BYTES) => Ok(head[1]),
        Ok(_) => Err(Outcome::Error(status::UNKNOWN)),
        Err(refused) => Err(of_module(refused)),
    })
}
