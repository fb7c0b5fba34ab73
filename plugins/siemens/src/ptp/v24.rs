//! FC 5 V24_STAT and FC 6 V24_SET: the accompanying signals of the RS 232 interface. [TIA help "PtP data link CP 341"]
//!
//! They have no error output and do not change BR. The CP shows its signals in the first byte of its inputs and takes
//! RTS and DTR from the first byte of its outputs.

use ob1_sdk::{Abort, Block, Cx, Kind, Param, interface};

use ob1_words::channels::v24::{CTS, DCD, DRIVES, DSR, DTR, RI, RTS};

use super::channel::address;
use super::state::CpState;

interface! {
    /// The parameters, in the manual's order.
    pub mod stat {
        /// Logical base address of the CP.
        in     LADDR: Int;
        /// State of the output DTR.
        out    DTR_OUT: Bool;
        /// State of the input DSR.
        out    DSR_IN: Bool;
        /// State of the output RTS.
        out    RTS_OUT: Bool;
        /// State of the input CTS.
        out    CTS_IN: Bool;
        /// State of the input DCD.
        out    DCD_IN: Bool;
        /// State of the input RI.
        out    RI_IN: Bool;
    }
}

interface! {
    /// The parameters, in the manual's order.
    pub mod set {
        /// Logical base address of the CP.
        in     LADDR: Int;
        /// State that the CP gives RTS.
        in     RTS: Bool;
        /// State that the CP gives DTR.
        in     DTR: Bool;
    }
}

/// FC 5 V24_STAT: shows the signals of the CP.
pub struct Stat;

impl Block for Stat {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = 5;
    const NAME: &'static str = "V24_STAT";
    const PARAMS: &'static [Param] = stat::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let (laddr, mut lines) = (cx.get(stat::LADDR)?, [0]);
        // There is no error output: a CP that does not answer has no signal.
        let _there = cx.io_read(address(laddr), &mut lines)?;
        let is_on = |bit: u8| lines[0] & bit != 0;
        cx.set(stat::DTR_OUT, is_on(DTR))?;
        cx.set(stat::DSR_IN, is_on(DSR))?;
        cx.set(stat::RTS_OUT, is_on(RTS))?;
        cx.set(stat::CTS_IN, is_on(CTS))?;
        cx.set(stat::DCD_IN, is_on(DCD))?;
        cx.set(stat::RI_IN, is_on(RI))
    }
}

/// FC 6 V24_SET: sets RTS and DTR of the CP.
pub struct Set;

impl Block for Set {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = 6;
    const NAME: &'static str = "V24_SET";
    const PARAMS: &'static [Param] = set::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let laddr = cx.get(set::LADDR)?;
        let rts = if cx.get(set::RTS)? { RTS } else { 0 };
        let dtr = if cx.get(set::DTR)? { DTR } else { 0 };
        // There is no error output here either.
        let _there = cx.io_write(address(laddr), &[DRIVES | rts | dtr])?;
        Ok(())
    }
}
