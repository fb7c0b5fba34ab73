//! FB 61 RECEIVE. [S3 "Overview"], [reference 8.3]

use ob1_sdk::{Abort, Block, Cx, Kind, Param, interface};

use crate::module::{self, Module, Order, Outcome};
use crate::state::CpState;

interface! {
    /// The parameters.
    pub(crate) mod receive {
        /// 1: telegrams are fetched.
        in     EN_R: Bool;
        /// A rising edge resets the CP.
        in     R: Bool;
        /// Logical address of the CP.
        in     LADDR: Int;
        /// Data block for the telegram.
        in     DB_NO: Int;
        /// First byte in it.
        in     DBB_NO: Int;
        /// Bytes the CP occupies in each direction, 8 to 60.
        in     IO_SIZE: Word;
        /// For one call: a telegram was stored.
        out    NDR: Bool;
        /// For one call: an error occurred.
        out    ERROR: Bool;
        /// The error; 8181h while a telegram is being received.
        out    STATUS: Word;
        /// Bytes received; valid with NDR.
        out    LEN: Int;
        /// Byte 0 of the outputs; SEND and RECEIVE use the same byte.
        in_out CONTROL: Byte;
        static R_BEFORE: Bool;
        static BUSY: Bool;
    }
}

/// FB 61.
pub(crate) struct Receive;

impl Block for Receive {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = 61;
    const NAME: &'static str = "RECEIVE";
    const PARAMS: &'static [Param] = receive::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let (laddr, io_size) = (cx.get(receive::LADDR)?, cx.get(receive::IO_SIZE)?);
        let outcome = match Module::open(cx, laddr, laddr, io_size)? {
            Ok(module) => {
                let outcome = call(cx, &module)?;
                cx.set(receive::CONTROL, module.state.byte0())?;
                outcome
            }
            // There is no request that could get lost.
            Err(Outcome::Later) => Outcome::Nothing,
            Err(outcome) => outcome,
        };
        cx.set(receive::NDR, outcome.is_done())?;
        cx.set(receive::ERROR, outcome.is_error())?;
        cx.set(receive::STATUS, outcome.status())?;
        if let Outcome::Done(length) = outcome {
            cx.set(receive::LEN, length as i16)?;
        }
        cx.set_br(!outcome.is_error())
    }
}

fn call(cx: &mut Cx<'_, CpState>, module: &Module<'_>) -> Result<Outcome, Abort> {
    let (reset, busy) = (cx.get(receive::R)?, cx.load(receive::BUSY)?);
    let begins = reset && !cx.load(receive::R_BEFORE)?;
    cx.store(receive::R_BEFORE, reset)?;
    if begins || busy {
        let instance = module::instance(cx)?;
        let order = Order { request: false, reset: begins, instance, busy, db: 0, byte: 0, length: 0 };
        let outcome = module.send(cx, order)?;
        cx.store(receive::BUSY, outcome == Outcome::Running)?;
        return Ok(outcome);
    }
    let (enabled, db, byte) = (cx.get(receive::EN_R)?, cx.get(receive::DB_NO)?, cx.get(receive::DBB_NO)?);
    module.receive(cx, enabled, db, byte)
}
