//! The handling blocks of the CP 340: FB 2 P_RCV, FB 3 P_SEND, FB 4 P_PRINT, FB 12 P_RESET, FC 5 V24_STAT and
//! FC 6 V24_SET.
//!
//! What they share with those of the CP 341 is in `ob1-ptp`. A CP 340 has no header and no areas: P_RCV puts each
//! telegram where DB_NO and DBB_NO say, P_SEND sends from there.

mod reset;

use ob1_ptp::print::{Name, Print};
use ob1_ptp::send::{self, Data, Job};
use ob1_ptp::{CpState, receive};
use ob1_sdk::{Abort, Block, Cx, Kind, Param, interface};
use ob1_words::channels::Job as Order;

interface! {
    /// The parameters of P_RCV, in the manual's order.
    pub(crate) mod rcv {
        /// 1: telegrams of the partner are taken.
        in     EN_R: Bool;
        /// 1 aborts the job and blocks the block.
        in     R: Bool;
        /// Logical base address of the CP.
        in     LADDR: Int;
        /// Data block for the data.
        in     DB_NO: Int;
        /// First byte in it.
        in     DBB_NO: Int;
        /// A telegram has come without error: for one call.
        out    NDR: Bool;
        /// The job has ended with an error: for one call.
        out    ERROR: Bool;
        /// Bytes of the telegram, while NDR is 1.
        out    LEN: Int;
        /// Event class and number while ERROR is 1.
        out    STATUS: Word;
        /// RET_VAL of the record transfer after 1E0Eh.
        static SFCERR: Word;
        /// Between two calls.
        static MEMORY: Bytes<34>;
    }
}

interface! {
    /// The parameters of P_SEND, in the manual's order.
    pub(crate) mod snd {
        /// A rising edge starts a job.
        in     REQ: Bool;
        /// 1 aborts the job and blocks the block.
        in     R: Bool;
        /// Logical base address of the CP.
        in     LADDR: Int;
        /// Data block of the data.
        in     DB_NO: Int;
        /// First byte in it.
        in     DBB_NO: Int;
        /// Bytes, 1 to 1024.
        in     LEN: Int;
        /// The job has ended without error: for one call.
        out    DONE: Bool;
        /// It has ended with an error: for one call.
        out    ERROR: Bool;
        /// Event class and number while ERROR is 1.
        out    STATUS: Word;
        /// RET_VAL of the record transfer after 1E0Fh.
        static SFCERR: Word;
        /// Between two calls.
        static MEMORY: Bytes<34>;
    }
}

const RECEIVE: receive::Params = receive::Params {
    en_r: rcv::EN_R,
    r: rcv::R,
    laddr: rcv::LADDR,
    db_no: rcv::DB_NO,
    dbb_no: rcv::DBB_NO,
    ndr: rcv::NDR,
    error: rcv::ERROR,
    len: rcv::LEN,
    status: rcv::STATUS,
    sfcerr: rcv::SFCERR,
    memory: rcv::MEMORY,
};

/// FB 2.
struct Receive;

impl Block for Receive {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = 2;
    const NAME: &'static str = "P_RCV";
    const PARAMS: &'static [Param] = rcv::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        receive::call(cx, &RECEIVE).map(|_| ())
    }
}

/// Longest telegram, bytes.
const LEN_MAX: i16 = 1024;

/// STATUS: LEN is not 1 to 1024, or a length of P_PRINT. [TIA help "PtP data link CP 340", "STATUS parameter"]
const LEN_WRONG: u16 = 0x1E41;

/// FB 3.
struct Send;

impl Job for Send {
    const PARAMS: send::Params = send::Params {
        req: snd::REQ,
        r: snd::R,
        laddr: snd::LADDR,
        done: snd::DONE,
        error: snd::ERROR,
        status: snd::STATUS,
        sfcerr: snd::SFCERR,
        memory: snd::MEMORY,
    };

    fn check(cx: &mut Cx<'_, CpState>) -> Result<Result<(), u16>, Abort> {
        let is_possible = (1..=LEN_MAX).contains(&cx.get(snd::LEN)?);
        Ok(if is_possible { Ok(()) } else { Err(LEN_WRONG) })
    }

    fn begin(cx: &mut Cx<'_, CpState>) -> Result<Result<Data, u16>, Abort> {
        let (db, byte) = (cx.get(snd::DB_NO)? as u16, cx.get(snd::DBB_NO)? as u16);
        Ok(Ok(Data { db, byte, len: cx.get(snd::LEN)? as u16 }))
    }

    fn order(_: &mut Cx<'_, CpState>) -> Result<Order, Abort> {
        Ok(Order { sf: Order::SEND, ..Order::default() })
    }
}

impl Block for Send {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = 3;
    const NAME: &'static str = "P_SEND";
    const PARAMS: &'static [Param] = snd::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        send::call::<Self>(cx)
    }
}

/// FB 4.
struct Print340;

impl Name for Print340 {
    const NUMBER: u16 = 4;
    const NAME: &'static str = "P_PRINT";
    // [TIA help "PtP data link CP 340", "STATUS parameter"]
    const LENGTH_WRONG: u16 = LEN_WRONG;
}

ob1_sdk::export_plugin! {
    name: "cp340",
    version: env!("CARGO_PKG_VERSION"),
    module_state: CpState,
    blocks: [ob1_ptp::v24::Stat, ob1_ptp::v24::Set, Receive, Send, Print<Print340>, reset::Reset],
}
