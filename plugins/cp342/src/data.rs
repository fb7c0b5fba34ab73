//! FC 1 DP_SEND and FC 2 DP_RECV: the outputs and inputs of all slaves as one area each.

use ob1_sdk::{Abort, Block, Cx, Kind, Param, interface};
use ob1_siemens::any::Span;
use ob1_siemens::any::status::{SOURCE, TARGET};
use ob1_words::cp342::{AREA_BYTES, HEAD_BYTES, RECEIVE, SEND, dp_status, mode, status};

use crate::outcome::{AREA, Outcome, exchanging, of_memory, of_module};
use ob1_siemens::outputs::Outputs;

/// DPSTATUS of a CP that does not answer.
const OFFLINE: u8 = mode::OFFLINE << dp_status::MODE_AT;

interface! {
    /// Parameters of FC 1 DP_SEND, in the manual's order.
    pub(crate) mod snd {
        /// Module start address of the CP.
        in     CPLADDR: Word;
        /// The outputs of the slaves, 1 to 2160 bytes: the send area of the CP from its first byte on.
        in     SEND: Any;
        /// The outputs have been passed to the CP.
        out    DONE: Bool;
        /// The outputs have not been passed to the CP.
        out    ERROR: Bool;
        /// The error, or 8180h while the bus starts.
        out    STATUS: Word;
    }
}

pub(crate) struct Send;

impl Block for Send {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = 1;
    const NAME: &'static str = "DP_SEND";
    const PARAMS: &'static [Param] = snd::PARAMS;
    type State = ();
    type Module = ();

    fn call(cx: &mut Cx<'_, ()>, _state: &()) -> Result<(), Abort> {
        let outcome = send(cx)?;
        outcome.set(cx, Outputs { end: snd::DONE, error: snd::ERROR, status: snd::STATUS })
    }
}

fn send(cx: &mut Cx<'_, ()>) -> Result<Outcome, Abort> {
    let address = cx.get(snd::CPLADDR)?;
    if let Err(outcome) = exchanging(cx, address)? {
        return Ok(outcome);
    }
    let Some(span) = Span::of(cx, snd::SEND)? else { return Ok(Outcome::Error(status::PARAMETER)) };
    let mut area = [0; AREA_BYTES];
    let Some(bytes) = area.get_mut(..span.len as usize) else { return Ok(Outcome::Error(AREA)) };
    if let Err(refused) = span.read(cx, 0, bytes)? {
        return Ok(of_memory(refused, SOURCE));
    }
    Ok(cx.record_write(u32::from(address), SEND, bytes)?.map_or_else(of_module, |()| Outcome::Done))
}

interface! {
    /// Parameters of FC 2 DP_RECV, in the manual's order.
    pub(crate) mod rcv {
        /// Module start address of the CP.
        in     CPLADDR: Word;
        /// Memory for the inputs of the slaves, 1 to 2160 bytes: the receive area of the CP from its first byte on.
        in     RECV: Any;
        /// The inputs have been stored.
        out    NDR: Bool;
        /// The inputs could not be stored.
        out    ERROR: Bool;
        /// The error, or 8180h while the bus starts.
        out    STATUS: Word;
        /// State of the slaves; see docs/cp342.md.
        out    DPSTATUS: Byte;
    }
}

pub(crate) struct Receive;

impl Block for Receive {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = 2;
    const NAME: &'static str = "DP_RECV";
    const PARAMS: &'static [Param] = rcv::PARAMS;
    type State = ();
    type Module = ();

    fn call(cx: &mut Cx<'_, ()>, _state: &()) -> Result<(), Abort> {
        let (outcome, dp_status) = receive(cx)?;
        cx.set(rcv::DPSTATUS, dp_status)?;
        outcome.set(cx, Outputs { end: rcv::NDR, error: rcv::ERROR, status: rcv::STATUS })
    }
}

fn receive(cx: &mut Cx<'_, ()>) -> Result<(Outcome, u8), Abort> {
    let address = cx.get(rcv::CPLADDR)?;
    let dp_status = match exchanging(cx, address)? {
        Ok(dp_status) => dp_status,
        Err(outcome) => return Ok((outcome, OFFLINE)),
    };
    let Some(span) = Span::of(cx, rcv::RECV)? else { return Ok((Outcome::Error(status::PARAMETER), dp_status)) };
    let mut record = [0; HEAD_BYTES + AREA_BYTES];
    let outcome = match cx.record_read(u32::from(address), RECEIVE, &mut record)? {
        Err(refused) => of_module(refused),
        Ok(len) => match record.get(HEAD_BYTES..HEAD_BYTES + span.len as usize) {
            Some(bytes) if HEAD_BYTES + bytes.len() <= len => {
                span.write(cx, 0, bytes)?.map_or_else(|refused| of_memory(refused, TARGET), |()| Outcome::Done)
            }
            // Longer than the area of the slaves.
            _ => Outcome::Error(AREA),
        },
    };
    Ok((outcome, dp_status))
}
