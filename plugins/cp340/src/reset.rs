//! FB 12 P_RESET: empties the receive buffer of the CP 340. [TIA help "PtP data link CP 340", "P_RESET"]
//!
//! The number of the FB is ours. It writes a number to the second byte of the CP's outputs, and the CP answers with the
//! same number in the second byte of the inputs (`docs/cp341-channels.md`): so it does not disturb jobs of the other
//! blocks.

use ob1_sdk::{Abort, Block, Cx, Kind, Param, interface};
use ob1_siemens::ptp::CpState;
use ob1_siemens::ptp::channel::address;
use ob1_words::channels::RESET_AT;

/// STATUS: the CP cannot be written to; RET_VAL of the record transfer is in SFCERR. (docs/cp341-events.md)
const WRITE_FAILED: u16 = 0x1E0F;
/// RET_VAL: no module at LADDR.
const NO_MODULE: u16 = 0x8090;

interface! {
    /// The parameters, in the manual's order.
    pub(crate) mod rst {
        /// A rising edge starts a job.
        in     REQ: Bool;
        /// Logical base address of the CP.
        in     LADDR: Int;
        /// For one call: the job ended without error.
        out    DONE: Bool;
        /// For one call: the job ended with an error.
        out    ERROR: Bool;
        /// Event class and number while ERROR is 1.
        out    STATUS: Word;
        /// RET_VAL of the record transfer after 1E0Fh.
        static SFCERR: Word;
        /// REQ at the last call.
        static EDGE: Bool;
        /// A job is running.
        static BUSY: Bool;
        /// Number of the job, 1 to 255.
        static NUMBER: Byte;
    }
}

pub(crate) struct Reset;

impl Block for Reset {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = 12;
    const NAME: &'static str = "P_RESET";
    const PARAMS: &'static [Param] = rst::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let (req, at) = (cx.get(rst::REQ)?, address(cx.get(rst::LADDR)?) + RESET_AT as u32);
        let edge = req && !cx.load(rst::EDGE)?;
        cx.store(rst::EDGE, req)?;
        let mut answer = [0];
        let is_there = cx.io_read(at, &mut answer)?.is_ok();
        let mut busy = cx.load(rst::BUSY)?;
        if edge && !busy {
            // A number other than the one the CP shows.
            let number = answer[0].checked_add(1).unwrap_or(1);
            cx.store(rst::NUMBER, number)?;
            busy = true;
        }
        let number = cx.load(rst::NUMBER)?;
        // Written again at each call, because a start-up of the CPU clears the outputs.
        let fails = busy && !(is_there && cx.io_write(at, &[number])?.is_ok());
        let done = busy && !fails && !edge && answer[0] == number;
        if fails {
            cx.store(rst::SFCERR, NO_MODULE)?;
        }
        cx.store(rst::BUSY, busy && !done && !fails)?;
        cx.set(rst::DONE, done)?;
        cx.set(rst::ERROR, fails)?;
        cx.set(rst::STATUS, if fails { WRITE_FAILED } else { 0 })?;
        cx.set_br(!fails)
    }
}
