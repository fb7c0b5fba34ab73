//! USEND and URCV, BSEND and BRCV: FB 8, 9, 12, 13 of an S7-300, SFB 8, 9, 12, 13 of an S7-400.

use ob1_sdk::{Abort, Block, Cx, Kind, Param};
use ob1_words::boxes::{BSEND_MAX, BSEND_MAX_300, Service, status};

use ob1_any::Span;

use crate::area::Spans;
use crate::job::{End, cancel};
use crate::partner::{Outputs, Sender, both, kind, lengths, memory, module_of, owner, receive};
use crate::state::CpState;

both! {
    /// USEND.
    mod usend, usend4 = SFB 8 {
        /// A rising edge starts a job.
        in     REQ: Bool;
        /// The connection.
        in     ID: Word;
        /// Identifies the URCV of the partner.
        in     R_ID: DWord;
        /// For one call: the data have been sent.
        out    DONE: Bool;
        /// For one call: the data could not be sent.
        out    ERROR: Bool;
        /// The error; 11: REQ came while a job was running, 25: the job is running.
        out    STATUS: Word;
    }
    in_out { SD_1: Any; }
    in_out { SD_1: Any; SD_2: Any; SD_3: Any; SD_4: Any; }
}

/// FB 8, SFB 8.
pub(crate) struct Usend<const FOUR: bool>;

impl<const FOUR: bool> Block for Usend<FOUR> {
    const KIND: Kind = kind(FOUR);
    const NUMBER: u16 = 8;
    const NAME: &'static str = "USEND";
    const PARAMS: &'static [Param] = if FOUR { usend4::PARAMS } else { usend::PARAMS };
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let areas: &[_] = if FOUR { &[usend4::SD_1, usend4::SD_2, usend4::SD_3, usend4::SD_4] } else { &[usend::SD_1] };
        let outputs = Outputs { end: usend::DONE, error: usend::ERROR, status: usend::STATUS };
        let at = (cx.get(usend::ID)?, cx.get(usend::R_ID)?);
        let sender = Sender { req: usend::REQ, memory: memory!(FOUR, usend, usend4), outputs };
        sender.call(cx, Service::Usend, at, |cx, wanted| {
            let Some(spans) = Spans::of(cx, areas)? else { return Ok(Err(status::AREA)) };
            wanted.source = spans;
            Ok(lengths(wanted, &spans))
        })?;
        Ok(())
    }
}

both! {
    /// URCV.
    mod urcv, urcv4 = SFB 9 {
        /// 1: data are accepted.
        in     EN_R: Bool;
        /// The connection.
        in     ID: Word;
        /// Identifies the USEND of the partner.
        in     R_ID: DWord;
        /// For one call: new data have been stored.
        out    NDR: Bool;
        /// For one call: the data could not be stored.
        out    ERROR: Bool;
        /// The error.
        out    STATUS: Word;
    }
    in_out { RD_1: Any; }
    in_out { RD_1: Any; RD_2: Any; RD_3: Any; RD_4: Any; }
}

/// FB 9, SFB 9.
pub(crate) struct Urcv<const FOUR: bool>;

impl<const FOUR: bool> Block for Urcv<FOUR> {
    const KIND: Kind = kind(FOUR);
    const NUMBER: u16 = 9;
    const NAME: &'static str = "URCV";
    const PARAMS: &'static [Param] = if FOUR { urcv4::PARAMS } else { urcv::PARAMS };
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        memory!(FOUR, urcv, urcv4).note(cx)?;
        let areas: &[_] = if FOUR { &[urcv4::RD_1, urcv4::RD_2, urcv4::RD_3, urcv4::RD_4] } else { &[urcv::RD_1] };
        let outputs = Outputs { end: urcv::NDR, error: urcv::ERROR, status: urcv::STATUS };
        let at = (cx.get(urcv::EN_R)?, cx.get(urcv::ID)?, cx.get(urcv::R_ID)?);
        let spans = Spans::of(cx, areas)?;
        receive(cx, Service::Urcv, at, spans, &outputs).map(drop)
    }
}

both! {
    /// BSEND.
    mod bsend, bsend4 = SFB 12 {
        /// A rising edge starts a job.
        in     REQ: Bool;
        /// 1 cancels the job.
        in     R: Bool;
        /// The connection.
        in     ID: Word;
        /// Identifies the BRCV of the partner.
        in     R_ID: DWord;
        /// For one call: the BRCV of the partner has the data.
        out    DONE: Bool;
        /// For one call: the job failed.
        out    ERROR: Bool;
        /// The error; 11: REQ came while a job was running, 25: the job is running.
        out    STATUS: Word;
        /// The data.
        in_out SD_1: Any;
        /// Number of bytes to send; 0: all.
        in_out LEN: Word;
    }
    in_out {}
    in_out {}
}

/// FB 12, SFB 12.
pub(crate) struct Bsend<const FOUR: bool>;

impl<const FOUR: bool> Block for Bsend<FOUR> {
    const KIND: Kind = kind(FOUR);
    const NUMBER: u16 = 12;
    const NAME: &'static str = "BSEND";
    const PARAMS: &'static [Param] = if FOUR { bsend4::PARAMS } else { bsend::PARAMS };
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let outputs = Outputs { end: bsend::DONE, error: bsend::ERROR, status: bsend::STATUS };
        let at = (cx.get(bsend::ID)?, cx.get(bsend::R_ID)?);
        let memory = memory!(FOUR, bsend, bsend4);
        if cx.get(bsend::R)? {
            memory.note(cx)?;
            let req = cx.get(bsend::REQ)?;
            cx.store(memory.req, u8::from(req))?;
            let had_job = match module_of(cx, at.0)? {
                Some(laddr) => {
                    let owner = owner(cx)?;
                    cancel(cx, laddr, owner)?
                }
                None => false,
            };
            return outputs.set(cx, End::Idle, had_job.then_some(status::RESET), 0);
        }
        let most = if FOUR { BSEND_MAX } else { BSEND_MAX_300 } as u32;
        Sender { req: bsend::REQ, memory, outputs }.call(cx, Service::Bsend, at, |cx, wanted| {
            let len = u32::from(cx.get(bsend::LEN)?);
            let Some(span) = Span::of(cx, bsend::SD_1)? else { return Ok(Err(status::AREA)) };
            let len = if len == 0 { span.len } else { len };
            if len > span.len || len > most {
                return Ok(Err(status::AREA));
            }
            wanted.source = span.first(len).into();
            Ok(Ok(()))
        })?;
        Ok(())
    }
}

both! {
    /// BRCV.
    mod brcv, brcv4 = SFB 13 {
        /// 1: data are accepted.
        in     EN_R: Bool;
        /// The connection.
        in     ID: Word;
        /// Identifies the BSEND of the partner.
        in     R_ID: DWord;
        /// For one call: new data have been stored.
        out    NDR: Bool;
        /// For one call: the data could not be stored.
        out    ERROR: Bool;
        /// The error.
        out    STATUS: Word;
        /// Memory for the data.
        in_out RD_1: Any;
        /// Bytes received.
        in_out LEN: Word;
    }
    in_out {}
    in_out {}
}

/// FB 13, SFB 13.
pub(crate) struct Brcv<const FOUR: bool>;

impl<const FOUR: bool> Block for Brcv<FOUR> {
    const KIND: Kind = kind(FOUR);
    const NUMBER: u16 = 13;
    const NAME: &'static str = "BRCV";
    const PARAMS: &'static [Param] = if FOUR { brcv4::PARAMS } else { brcv::PARAMS };
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        memory!(FOUR, brcv, brcv4).note(cx)?;
        let outputs = Outputs { end: brcv::NDR, error: brcv::ERROR, status: brcv::STATUS };
        let at = (cx.get(brcv::EN_R)?, cx.get(brcv::ID)?, cx.get(brcv::R_ID)?);
        let spans = Spans::of(cx, &[brcv::RD_1])?;
        if let Some(len) = receive(cx, Service::Brcv, at, spans, &outputs)? {
            cx.set(brcv::LEN, len as u16)?;
        }
        Ok(())
    }
}
