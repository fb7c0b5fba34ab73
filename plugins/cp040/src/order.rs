//! What a block keeps of its orders between two calls, and what it has told the program.

use ob1_sdk::types::{Bool, DWord, Int, Word};
use ob1_sdk::{Abort, Cx, Formal, In, Static};

use crate::module::{Order, Outcome, instance};
use crate::state::{CpState, number};
use crate::status;

/// How long an order waits for a CP that does not answer, because its process may be starting; and how long a job whose
/// block is no longer called keeps the send side. As at the CP 341. (ours)
pub(crate) const PATIENCE_MS: u32 = 10_000;

/// Where an instance keeps its orders.
pub(crate) struct Orders {
    /// REQ and R at the last call.
    pub(crate) req_before: Static<Bool>,
    pub(crate) r_before: Static<Bool>,
    /// An order has begun and has not ended.
    pub(crate) busy: Static<Bool>,
    /// A request and a reset that have not begun.
    pub(crate) request: Static<Bool>,
    pub(crate) reset: Static<Bool>,
    /// The CP has not answered since this time, ms; 0: it answers.
    pub(crate) since: Static<DWord>,
}

impl Orders {
    /// The orders of this call: rising edges, and what still waits.
    pub(crate) fn look(&self, cx: &mut Cx<'_, CpState>, req: bool, r: bool) -> Result<Order, Abort> {
        let waits = cx.load(self.request)?;
        let rises = req && !cx.load(self.req_before)? && !waits;
        let reset = r && !cx.load(self.r_before)? || cx.load(self.reset)?;
        cx.store(self.req_before, req)?;
        cx.store(self.r_before, r)?;
        let (request, busy) = (rises || waits, cx.load(self.busy)?);
        Ok(Order { rises, request, reset, instance: instance(cx)?, busy, db: 0, byte: 0, length: 0 })
    }

    /// Stores what goes on; returns the outcome for the program. `resetting`: this call found a reset of this
    /// instance under way, a request comes after it.
    pub(crate) fn settle(
        &self,
        cx: &mut Cx<'_, CpState>,
        order: &Order,
        outcome: Outcome,
        resetting: bool,
    ) -> Result<Outcome, Abort> {
        let outcome = if order.is_idle() {
            // An order's errors are told with an order.
            match outcome {
                Outcome::Later | Outcome::Error(_) => Outcome::Nothing,
                other => other,
            }
        } else {
            absent(cx, self.since, outcome)?
        };
        if outcome != Outcome::Later {
            cx.store(self.since, 0)?;
        }
        let waits = matches!(outcome, Outcome::Later | Outcome::Queued);
        cx.store(self.request, order.request && (waits || resetting && !order.reset))?;
        cx.store(self.reset, order.reset && waits)?;
        let goes_on = matches!(outcome, Outcome::Running | Outcome::Lost) || waits && order.busy;
        cx.store(self.busy, goes_on)?;
        Ok(outcome)
    }
}

/// Where an instance keeps what a request names.
pub(crate) struct Named {
    pub(crate) db: Static<Int>,
    pub(crate) byte: Static<Int>,
    pub(crate) length: Static<Int>,
}

impl Named {
    /// The order with the DB_NO, DBB_NO and LEN of the call in which REQ has risen: a request that waits keeps them.
    pub(crate) fn of_the_edge(
        &self,
        cx: &mut Cx<'_, CpState>,
        order: Order,
        [db, byte, length]: [Formal<Int, In>; 3],
    ) -> Result<Order, Abort> {
        if order.rises {
            for (to, from) in [(self.db, db), (self.byte, byte), (self.length, length)] {
                let value = cx.get(from)?;
                cx.store(to, value)?;
            }
        }
        if !order.request {
            return Ok(order);
        }
        Ok(Order { db: cx.load(self.db)?, byte: cx.load(self.byte)?, length: cx.load(self.length)?, ..order })
    }
}

/// Where an instance keeps what its receive side has told.
pub(crate) struct Told {
    /// STATUS of the last call; 0: no error.
    pub(crate) status: Static<Word>,
    /// DB_NO and DBB_NO then.
    pub(crate) place: Static<DWord>,
    /// Since when the module does not answer, as in [`Orders`].
    pub(crate) since: Static<DWord>,
}

impl Told {
    /// "ERROR is set for one call": an error that lasts is told when it comes, and again when the program has named
    /// another place for the data. (docs/cp040-registers.md)
    pub(crate) fn once(
        &self,
        cx: &mut Cx<'_, CpState>,
        outcome: Outcome,
        db: i16,
        byte: i16,
    ) -> Result<Outcome, Abort> {
        if outcome != Outcome::Later {
            cx.store(self.since, 0)?;
        }
        let outcome = match absent(cx, self.since, outcome)? {
            // Nobody has asked for anything that waits.
            Outcome::Later => Outcome::Nothing,
            other => other,
        };
        let Outcome::Error(status) = outcome else {
            cx.store(self.status, 0)?;
            return Ok(outcome);
        };
        let place = number(db as u16, byte as u16);
        if cx.load(self.status)? != status || cx.load(self.place)? != place {
            cx.store(self.status, status)?;
            cx.store(self.place, place)?;
            return Ok(outcome);
        }
        Ok(if status::is_of_data_block(status) { Outcome::Running } else { Outcome::Nothing })
    }
}

/// A CP that has not answered for too long is an access error.
fn absent(cx: &mut Cx<'_, CpState>, since: Static<DWord>, outcome: Outcome) -> Result<Outcome, Abort> {
    if outcome != Outcome::Later {
        return Ok(outcome);
    }
    let now_ms = ((cx.now() / 1_000_000) as u32).max(1);
    let begin = match cx.load(since)? {
        0 => now_ms,
        begin => begin,
    };
    cx.store(since, begin)?;
    let is_over = now_ms.wrapping_sub(begin) >= PATIENCE_MS;
    Ok(if is_over { Outcome::Error(status::READ_ACCESS) } else { Outcome::Later })
}
