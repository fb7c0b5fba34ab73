//! FB 61 RECEIVE. [S3 "Overview"] (docs/cp040-registers.md)

use ob1_sdk::{Abort, Block, Cx, Kind, Param, interface};

use crate::module::{Module, Order, Outcome};
use crate::order::{Orders, Told};
use crate::state::CpState;

interface! {
    /// Parameters and instance data of FB 61.
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
        static REQ_BEFORE: Bool;
        static R_BEFORE: Bool;
        static BUSY: Bool;
        static REQUEST: Bool;
        static RESET: Bool;
        static SINCE: DWord;
        static ABSENT: DWord;
        static TOLD: Word;
        static PLACE: DWord;
    }
}

/// Only resets: RECEIVE has no requests.
const ORDERS: Orders = Orders {
    req_before: receive::REQ_BEFORE,
    r_before: receive::R_BEFORE,
    busy: receive::BUSY,
    request: receive::REQUEST,
    reset: receive::RESET,
    since: receive::SINCE,
};

const TOLD: Told = Told { status: receive::TOLD, place: receive::PLACE, since: receive::ABSENT };

/// FB 61 RECEIVE: stores telegrams in a data block.
pub(crate) struct Receive;

impl Block for Receive {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = 61;
    const NAME: &'static str = "RECEIVE";
    const PARAMS: &'static [Param] = receive::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let (enabled, reset) = (cx.get(receive::EN_R)?, cx.get(receive::R)?);
        let order = ORDERS.look(cx, false, reset)?;
        let (laddr, io_size) = (cx.get(receive::LADDR)?, cx.get(receive::IO_SIZE)?);
        let (db, byte) = (cx.get(receive::DB_NO)?, cx.get(receive::DBB_NO)?);
        let outcome = match Module::open(cx, laddr, laddr, io_size)? {
            Ok(module) => {
                let outcome = call(cx, &module, order, enabled, (db, byte))?;
                cx.set(receive::CONTROL, module.state.byte0())?;
                outcome
            }
            Err(_) if order.is_idle() && !enabled => Outcome::Nothing,
            Err(outcome) => outcome,
        };
        let outcome = if order.is_idle() {
            TOLD.once(cx, outcome, db, byte)?
        } else {
            ORDERS.settle(cx, &order, outcome, false)?
        };
        cx.set(receive::NDR, outcome.is_done())?;
        cx.set(receive::ERROR, outcome.is_error())?;
        cx.set(receive::STATUS, outcome.status())?;
        if let Some(length) = outcome.length() {
            cx.set(receive::LEN, length)?;
        }
        cx.set_br(!outcome.is_error())
    }
}

fn call(
    cx: &mut Cx<'_, CpState>,
    module: &Module<'_>,
    order: Order,
    enabled: bool,
    (db, byte): (i16, i16),
) -> Result<Outcome, Abort> {
    if order.is_idle() {
        return module.receive(cx, enabled, db, byte);
    }
    let outcome = module.send(cx, order)?;
    // The telegram that was being received is lost with the reset.
    Ok(if order.reset && module.state.take_cut_off() { Outcome::Lost } else { outcome })
}
