//! FB 8 P_SND_RK: sends data of a DB, or fetches data of the partner into a DB (RK 512).
//! [TIA help "PtP data link CP 341"]

use ob1_sdk::{Abort, Block, Cx, Kind, Param, interface};
use ob1_siemens::ptp::CpState;
use ob1_siemens::ptp::channel::LEN_MAX;
use ob1_siemens::ptp::send::{self, Data, Job, Params, Source};
use ob1_words::channels::Job as Order;

interface! {
    /// The parameters, in the manual's order; the instance has 62 bytes.
    pub(crate) mod snd {
        /// 'S' send, 'F' fetch.
        in     SF: Char = b'S';
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
        /// Bytes, 1 to 4096.
        in     LEN: Int;
        /// Partner's CPU number, 0 to 4.
        in     R_CPU_NO: Int = 1;
        /// Area in the partner.
        in     R_TYP: Char;
        /// Data block in the partner.
        in     R_NO: Int;
        /// First byte, timer or counter in the partner.
        in     R_OFFSET: Int;
        /// Byte of the coordination flag in the partner; 255: none.
        in     R_CF_BYT: Int = 255;
        /// Bit of the coordination flag.
        in     R_CF_BIT: Int;
        /// For one call: the job ended without error.
        out    DONE: Bool;
        /// For one call: the job ended with an error.
        out    ERROR: Bool;
        /// Event class and number while ERROR is 1.
        out    STATUS: Word;
        /// RET_VAL of WR_REC after 1E0Fh.
        static SFCERR: Word;
        /// The state between two calls.
        static MEMORY: Bytes<34>;
    }
}

const SOURCE: Source = Source { db_no: snd::DB_NO, dbb_no: snd::DBB_NO, len: snd::LEN, longest: LEN_MAX as i16 };

impl Job for SendRk {
    const PARAMS: Params = ob1_siemens::send_params!(snd);

    fn check(cx: &mut Cx<'_, CpState>) -> Result<Result<(), u16>, Abort> {
        SOURCE.check(cx)
    }

    fn begin(cx: &mut Cx<'_, CpState>) -> Result<Result<Data, u16>, Abort> {
        SOURCE.data(cx).map(Ok)
    }

    fn order(cx: &mut Cx<'_, CpState>) -> Result<Order, Abort> {
        Ok(Order {
            sf: cx.get(snd::SF)?,
            r_typ: cx.get(snd::R_TYP)?,
            len: cx.get(snd::LEN)?,
            r_cpu_no: cx.get(snd::R_CPU_NO)?,
            r_no: cx.get(snd::R_NO)?,
            r_offset: cx.get(snd::R_OFFSET)?,
            r_cf_byt: cx.get(snd::R_CF_BYT)?,
            r_cf_bit: cx.get(snd::R_CF_BIT)?,
        })
    }

    fn has_data(order: &Order) -> bool {
        order.sf == Order::SEND
    }
}

pub(crate) struct SendRk;

impl Block for SendRk {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = 8;
    const NAME: &'static str = "P_SND_RK";
    const PARAMS: &'static [Param] = snd::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        send::call::<Self>(cx)
    }
}
