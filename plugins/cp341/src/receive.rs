//! FB 7 P_RCV_RK: receives telegrams of the partner, and with RK 512 serves its SEND and FETCH.
//! [TIA help "PtP data link CP 341"]

use ob1_sdk::{Abort, Block, Cx, Kind, Param, interface};
use ob1_siemens::ptp::CpState;
use ob1_siemens::ptp::receive::{self, Params};

interface! {
    /// The parameters, in the manual's order; the instance has 60 bytes.
    pub(crate) mod rcv {
        /// 1: data and jobs of the partner are accepted.
        in     EN_R: Bool;
        /// 1 aborts the job and disables the block.
        in     R: Bool;
        /// Logical base address of the CP.
        in     LADDR: Int;
        /// Data block for the data; with RK 512 for data to a DX.
        in     DB_NO: Int;
        /// First byte in it.
        in     DBB_NO: Int;
        /// RK 512: area of the job: D, M, E, A, T, Z.
        out    L_TYP: Char;
        /// RK 512: number of the data block.
        out    L_NO: Int;
        /// RK 512: first byte, timer or counter.
        out    L_OFFSET: Int;
        /// RK 512: byte of the coordination flag; 255: none.
        out    L_CF_BYT: Int;
        /// RK 512: bit of the coordination flag.
        out    L_CF_BIT: Int;
        /// For one call: the job ended without error.
        out    NDR: Bool;
        /// For one call: the job ended with an error.
        out    ERROR: Bool;
        /// Bytes of the telegram, while NDR is 1.
        out    LEN: Int;
        /// Event class and number while ERROR is 1.
        out    STATUS: Word;
        /// RET_VAL of RD_REC after 1E0Eh.
        static SFCERR: Word;
        /// The state between two calls.
        static MEMORY: Bytes<34>;
    }
}

const SHARED: Params = ob1_siemens::receive_params!(rcv);

pub(crate) struct ReceiveRk;

impl Block for ReceiveRk {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = 7;
    const NAME: &'static str = "P_RCV_RK";
    const PARAMS: &'static [Param] = rcv::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        if let Some(received) = receive::call(cx, &SHARED)? {
            let has_header = received.letter != 0;
            // The local area: data to a DX are in DB_NO, from DBB_NO on. [TIA help "PtP data link CP 341"]
            cx.set(rcv::L_TYP, if received.letter == b'X' { b'D' } else { received.letter })?;
            cx.set(rcv::L_NO, if has_header { received.number as i16 } else { 0 })?;
            cx.set(rcv::L_OFFSET, if has_header { received.offset as i16 } else { 0 })?;
            cx.set(rcv::L_CF_BYT, received.flag.0 as i16)?;
            cx.set(rcv::L_CF_BIT, received.flag.1 as i16)?;
        }
        Ok(())
    }
}
