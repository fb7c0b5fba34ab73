//! FB 65 SEND_RECV (CP040_COM): both directions in one block. [S3 "Overview"] (docs/cp040-registers.md)

use ob1_sdk::{Abort, Block, Cx, Kind, Param, interface};

use crate::module::{Module, Outcome};
use crate::order::{Named, Orders, Told};
use crate::state::CpState;

interface! {
    /// Parameters and instance data of FB 65.
    pub(crate) mod com {
        /// A rising edge sends.
        in     REQ_SEND: Bool;
        /// 1: telegrams are fetched.
        in     EN_RECV: Bool;
        /// A rising edge resets the CP.
        in     RESET: Bool;
        /// Logical address of the CP's inputs.
        in     ADDR_IN: Int;
        /// Logical address of its outputs.
        in     ADDR_OUT: Int;
        /// Data block with the telegram to send.
        in     DB_NO_SEND: Int;
        /// First byte in it.
        in     DBB_NO_SEND: Int;
        /// Bytes to send, 1 to 1024.
        in     LEN_SEND: Int;
        /// Data block for what is received.
        in     DB_NO_RECV: Int;
        /// First byte in it.
        in     DBB_NO_RECV: Int;
        /// Bytes the CP occupies in each direction, 8 to 60.
        in     IO_SIZE: Word;
        /// Bytes received; valid with NDR_RECV.
        out    LEN_RECV: Int;
        /// For one call: the job ended without error.
        out    DONE_SEND: Bool;
        /// For one call: the job failed.
        out    ERROR_SEND: Bool;
        /// The error; 8181h while a job runs.
        out    STATUS_SEND: Word;
        /// For one call: a telegram was stored.
        out    NDR_RECV: Bool;
        /// For one call: an error occurred.
        out    ERROR_RECV: Bool;
        /// The error; 8181h while a telegram is being received.
        out    STATUS_RECV: Word;
        /// Byte 0 of the outputs.
        in_out CONTROL: Byte;
        static REQ_BEFORE: Bool;
        static RESET_BEFORE: Bool;
        static BUSY: Bool;
        static REQUEST: Bool;
        static RESETS: Bool;
        static SINCE: DWord;
        static ABSENT: DWord;
        static TOLD: Word;
        static PLACE: DWord;
        static SEND_DB: Int;
        static SEND_BYTE: Int;
        static SEND_LENGTH: Int;
    }
}

const ORDERS: Orders = Orders {
    req_before: com::REQ_BEFORE,
    r_before: com::RESET_BEFORE,
    busy: com::BUSY,
    request: com::REQUEST,
    reset: com::RESETS,
    since: com::SINCE,
};

const NAMED: Named = Named { db: com::SEND_DB, byte: com::SEND_BYTE, length: com::SEND_LENGTH };

const TOLD: Told = Told { status: com::TOLD, place: com::PLACE, since: com::ABSENT };

/// FB 65 SEND_RECV: sends and receives in one call.
pub(crate) struct Com;

impl Block for Com {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = 65;
    const NAME: &'static str = "CP040_COM";
    const PARAMS: &'static [Param] = com::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let (req, reset) = (cx.get(com::REQ_SEND)?, cx.get(com::RESET)?);
        let order = ORDERS.look(cx, req, reset)?;
        let order = NAMED.of_the_edge(cx, order, [com::DB_NO_SEND, com::DBB_NO_SEND, com::LEN_SEND])?;
        let (input, output, io_size) = (cx.get(com::ADDR_IN)?, cx.get(com::ADDR_OUT)?, cx.get(com::IO_SIZE)?);
        let (enabled, db, byte) = (cx.get(com::EN_RECV)?, cx.get(com::DB_NO_RECV)?, cx.get(com::DBB_NO_RECV)?);
        let (sent, resetting, received) = match Module::open(cx, input, output, io_size)? {
            Ok(module) => {
                let resetting = module.state.is_resetting(order.instance);
                let sent = module.send(cx, order)?;
                // A reset ended in this call: the inputs were read before its end.
                let received = if order.busy && sent.is_done() {
                    Outcome::Nothing
                } else {
                    module.receive(cx, enabled, db, byte)?
                };
                cx.set(com::CONTROL, module.state.byte0())?;
                (sent, resetting, received)
            }
            Err(outcome) => (outcome, false, if enabled { outcome } else { Outcome::Nothing }),
        };
        let sent = ORDERS.settle(cx, &order, sent, resetting)?;
        let received = TOLD.once(cx, received, db, byte)?;
        cx.set(com::DONE_SEND, sent.is_done())?;
        cx.set(com::ERROR_SEND, sent.is_error())?;
        cx.set(com::STATUS_SEND, sent.status())?;
        cx.set(com::NDR_RECV, received.is_done())?;
        cx.set(com::ERROR_RECV, received.is_error())?;
        cx.set(com::STATUS_RECV, received.status())?;
        if let Some(length) = received.length() {
            cx.set(com::LEN_RECV, length)?;
        }
        cx.set_br(!sent.is_error() && !received.is_error())
    }
}
