//! The handling blocks of the CP 340: FB 2 P_RCV, FB 3 P_SEND, FB 4 P_PRINT, FB 12 P_RESET, FC 5 V24_STAT and
//! FC 6 V24_SET.
//!
//! The parts they share with those of the CP 341 are in `ob1-siemens`. A CP 340 has no header and no areas: P_RCV
//! stores each telegram at DB_NO and DBB_NO, P_SEND sends from there.

mod reset;

use ob1_sdk::{Abort, Block, Cx, Kind, Param, interface};
use ob1_siemens::ptp::print::{Name, Print};
use ob1_siemens::ptp::send::{self, Data, Job, LEN_WRONG, Source};
use ob1_siemens::ptp::{CpState, receive};
use ob1_words::channels::Job as Order;

interface! {
    /// The parameters of P_RCV, in the manual's order.
    pub(crate) mod rcv {
        /// 1: telegrams of the partner are accepted.
        in     EN_R: Bool;
        /// 1 aborts the job and disables the block.
        in     R: Bool;
        /// Logical base address of the CP.
        in     LADDR: Int;
        /// Data block for the data.
        in     DB_NO: Int;
        /// First byte in it.
        in     DBB_NO: Int;
        /// For one call: a telegram was received without error.
        out    NDR: Bool;
        /// For one call: the job ended with an error.
        out    ERROR: Bool;
        /// Bytes of the telegram, while NDR is 1.
        out    LEN: Int;
        /// Event class and number while ERROR is 1.
        out    STATUS: Word;
        /// RET_VAL of the record transfer after 1E0Eh.
        static SFCERR: Word;
        /// The state between two calls.
        static MEMORY: Bytes<34>;
    }
}

interface! {
    /// The parameters of P_SEND, in the manual's order.
    pub(crate) mod snd {
        /// A rising edge starts a job.
        in     REQ: Bool;
        /// 1 aborts the job and disables the block.
        in     R: Bool;
        /// Logical base address of the CP.
        in     LADDR: Int;
        /// Data block with the data.
        in     DB_NO: Int;
        /// First byte in it.
        in     DBB_NO: Int;
        /// Bytes, 1 to 1024.
        in     LEN: Int;
        /// For one call: the job ended without error.
        out    DONE: Bool;
        /// For one call: the job ended with an error.
        out    ERROR: Bool;
        /// Event class and number while ERROR is 1.
        out    STATUS: Word;
        /// RET_VAL of the record transfer after 1E0Fh.
        static SFCERR: Word;
        /// The state between two calls.
        static MEMORY: Bytes<34>;
    }
}

const RECEIVE: receive::Params = ob1_siemens::receive_params!(rcv);

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

/// Longest telegram that the CP 340 sends, in bytes.
const LEN_MAX: i16 = 1024;

const SOURCE: Source = Source { db_no: snd::DB_NO, dbb_no: snd::DBB_NO, len: snd::LEN, longest: LEN_MAX };

struct Send;

impl Job for Send {
    const PARAMS: send::Params = ob1_siemens::send_params!(snd);

    fn check(cx: &mut Cx<'_, CpState>) -> Result<Result<(), u16>, Abort> {
        SOURCE.check(cx)
    }

    fn begin(cx: &mut Cx<'_, CpState>) -> Result<Result<Data, u16>, Abort> {
        SOURCE.data(cx).map(Ok)
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
    blocks: [ob1_siemens::ptp::v24::Stat, ob1_siemens::ptp::v24::Set, Receive, Send, Print<Print340>, reset::Reset],
}
