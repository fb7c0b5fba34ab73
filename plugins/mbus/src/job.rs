//! What the FBs have in common: an edge of REQ starts a job, each step is an order, and its response leads to the next
//! step or to the end.

use ob1_sdk::types::{Bool, Byte, Int, Time, Word};
use ob1_sdk::{Abort, Cx, Formal, In, Out, Static};

use crate::exchange::{Exchange, Progress, Way};
use crate::response::{RESPONSE_MAX, Response, read as meaning};
use crate::status;

/// STEP: no job; SND_NKE, selection or REQ_UD2 has been sent.
const IDLE: u8 = 0;
pub(crate) const RESET: u8 = 1;
pub(crate) const SELECTION: u8 = 2;
pub(crate) const REQUEST: u8 = 3;

/// The variables of the instance; `job_of!` collects them by their names.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Job {
    pub(crate) req: Formal<Bool, In>,
    pub(crate) adr: Formal<Int, In>,
    pub(crate) fc_send: Formal<Int, In>,
    pub(crate) fc_receive: Formal<Int, In>,
    pub(crate) timeout: Formal<Time, In>,
    pub(crate) done: Formal<Bool, Out>,
    pub(crate) busy: Formal<Bool, Out>,
    pub(crate) error: Formal<Bool, Out>,
    pub(crate) status: Formal<Word, Out>,
    pub(crate) count: Formal<Int, Out>,
    pub(crate) last_req: Static<Bool>,
    pub(crate) step: Static<Byte>,
    pub(crate) exchange: Exchange,
}

/// Collects the variables of a block that gives orders.
macro_rules! job_of {
    ($block:ident) => {
        $crate::job::Job {
            req: $block::REQ,
            adr: $block::ADR,
            fc_send: $block::FC_SEND,
            fc_receive: $block::FC_RECEIVE,
            timeout: $block::TIMEOUT,
            done: $block::DONE,
            busy: $block::BUSY,
            error: $block::ERROR,
            status: $block::STATUS,
            count: $block::COUNT,
            last_req: $block::LAST_REQ,
            step: $block::STEP,
            exchange: $crate::exchange::exchange_of!($block),
        }
    };
}
pub(crate) use job_of;

impl Job {
    /// One call of the block: calls `start` on an edge of REQ while no job runs, then continues the order; calls
    /// `responded` with the step when the response arrives, and `end` with the STATUS of a failed order.
    pub(crate) fn call(
        self,
        cx: &mut Cx<'_>,
        start: fn(&mut Cx<'_>) -> Result<(), Abort>,
        responded: fn(&mut Cx<'_>, u8, Response<'_>) -> Result<(), Abort>,
        end: fn(&mut Cx<'_>, u16) -> Result<(), Abort>,
    ) -> Result<(), Abort> {
        let req = cx.get(self.req)?;
        let edge = req && !cx.load(self.last_req)?;
        cx.store(self.last_req, req)?;
        if edge && cx.load(self.step)? == IDLE {
            for bit in [self.done, self.error] {
                cx.set(bit, false)?;
            }
            cx.set(self.status, status::OK)?;
            cx.set(self.count, 0)?;
            cx.set(self.busy, true)?;
            start(cx)?;
        }
        let step = cx.load(self.step)?;
        if step == IDLE {
            return Ok(());
        }
        let way = Way {
            adr: cx.get(self.adr)?,
            fc_send: cx.get(self.fc_send)?,
            fc_receive: cx.get(self.fc_receive)?,
            timeout_ms: cx.get(self.timeout)?,
        };
        match self.exchange.step(cx, way)? {
            Progress::Running => Ok(()),
            Progress::Failed(status) => end(cx, status),
            Progress::Response(len) => {
                let mut buffer = [0; RESPONSE_MAX];
                let response = self.exchange.response(cx, len, &mut buffer)?;
                responded(cx, step, meaning(response))
            }
        }
    }

    /// Gives the order of a step.
    pub(crate) fn order(self, cx: &mut Cx<'_>, step: u8, telegram: &[u8]) -> Result<(), Abort> {
        cx.store(self.step, step)?;
        self.exchange.start(cx, telegram)
    }

    /// Ends the job with STATUS.
    pub(crate) fn end(self, cx: &mut Cx<'_>, status: u16) -> Result<(), Abort> {
        cx.store(self.step, IDLE)?;
        cx.set(self.busy, false)?;
        cx.set(self.done, status == status::OK)?;
        cx.set(self.error, status != status::OK)?;
        cx.set(self.status, status)
    }
}
