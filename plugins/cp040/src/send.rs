//! FB 60 SEND. [S3 "Overview"] (docs/cp040-registers.md)

use ob1_sdk::{Abort, Block, Cx, Kind, Param, interface};

use crate::module::Module;
use crate::order::{Named, Orders};
use crate::state::CpState;

interface! {
    /// Parameters and instance data of FB 60.
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
        static REQUEST: Bool;
        static RESET: Bool;
        static SINCE: DWord;
        static SEND_DB: Int;
        static SEND_BYTE: Int;
        static SEND_LENGTH: Int;
    }
}

const ORDERS: Orders = Orders {
    req_before: send::REQ_BEFORE,
    r_before: send::R_BEFORE,
    busy: send::BUSY,
    request: send::REQUEST,
    reset: send::RESET,
    since: send::SINCE,
};

const NAMED: Named = Named { db: send::SEND_DB, byte: send::SEND_BYTE, length: send::SEND_LENGTH };

/// FB 60 SEND: sends a telegram of a data block.
pub(crate) struct Send;

impl Block for Send {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = 60;
    const NAME: &'static str = "SEND";
    const PARAMS: &'static [Param] = send::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let (req, reset) = (cx.get(send::REQ)?, cx.get(send::R)?);
        let order = ORDERS.look(cx, req, reset)?;
        let order = NAMED.of_the_edge(cx, order, [send::DB_NO, send::DBB_NO, send::LEN])?;
        let (laddr, io_size) = (cx.get(send::LADDR)?, cx.get(send::IO_SIZE)?);
        let (outcome, resetting) = match Module::open(cx, laddr, laddr, io_size)? {
            Ok(module) => {
                let resetting = module.state.is_resetting(order.instance);
                let outcome = module.send(cx, order)?;
                cx.set(send::CONTROL, module.state.byte0())?;
                (outcome, resetting)
            }
            Err(outcome) => (outcome, false),
        };
        let outcome = ORDERS.settle(cx, &order, outcome, resetting)?;
        cx.set(send::DONE, outcome.is_done())?;
        cx.set(send::ERROR, outcome.is_error())?;
        cx.set(send::STATUS, outcome.status())?;
        cx.set_br(!outcome.is_error())
    }
}
