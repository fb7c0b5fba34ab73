//! FB 60 SEND. [S3 "Overview"], [reference 8.3]

use ob1_sdk::{Abort, Block, Cx, Kind, Param, interface};

use crate::module::{self, Module, Order, Outcome};
use crate::state::CpState;

interface! {
    /// The parameters.
    pub(crate) mod send {
        /// A rising edge sends.
        in     REQ: Bool;
        /// A rising edge resets the CP.
        in     R: Bool;
        /// Logical address of the CP.
        in     LADDR: Int;
        /// Data block with the telegram.
        in     DB_NO: Int;
        /// First byte in it.
        in     DBB_NO: Int;
        /// Bytes to send, 1 to 1024.
        in     LEN: Int;
        /// Bytes the CP occupies in each direction, 8 to 60.
        in     IO_SIZE: Word;
        /// For one call: the job ended without error.
        out    DONE: Bool;
        /// For one call: the job failed.
        out    ERROR: Bool;
        /// The error; 8181h while a job runs.
        out    STATUS: Word;
        /// Byte 0 of the outputs; SEND and RECEIVE use the same byte.
        in_out CONTROL: Byte;
        static REQ_BEFORE: Bool;
        static R_BEFORE: Bool;
        static BUSY: Bool;
    }
}

/// FB 60.
pub(crate) struct Send;

impl Block for Send {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = 60;
    const NAME: &'static str = "SEND";
    const PARAMS: &'static [Param] = send::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let (request, reset) = (cx.get(send::REQ)?, cx.get(send::R)?);
        let order = Order {
            request: request && !cx.load(send::REQ_BEFORE)?,
            reset: reset && !cx.load(send::R_BEFORE)?,
            instance: module::instance(cx)?,
            busy: cx.load(send::BUSY)?,
            db: cx.get(send::DB_NO)?,
            byte: cx.get(send::DBB_NO)?,
            length: cx.get(send::LEN)?,
        };
        let (laddr, io_size) = (cx.get(send::LADDR)?, cx.get(send::IO_SIZE)?);
        let outcome = match Module::open(cx, laddr, laddr, io_size)? {
            Ok(module) => {
                let outcome = module.send(cx, order)?;
                cx.set(send::CONTROL, module.state.byte0())?;
                outcome
            }
            Err(outcome) => outcome,
        };
        // An edge that could not be handled yet is kept for the next call.
        if outcome != Outcome::Later {
            cx.store(send::REQ_BEFORE, request)?;
            cx.store(send::R_BEFORE, reset)?;
            cx.store(send::BUSY, outcome == Outcome::Running)?;
        } else if !request {
            cx.store(send::REQ_BEFORE, false)?;
        }
        cx.set(send::DONE, outcome.is_done())?;
        cx.set(send::ERROR, outcome.is_error())?;
        cx.set(send::STATUS, outcome.status())?;
        cx.set_br(!outcome.is_error())
    }
}
