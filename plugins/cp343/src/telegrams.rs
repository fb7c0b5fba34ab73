//! USEND and URCV, BSEND and BRCV: FB 8, 9, 12, 13 of an S7-300, SFB 8, 9, 12, 13 of an S7-400.

use ob1_sdk::{Abort, Cx};
use ob1_words::boxes::{BSEND_MAX, BSEND_MAX_300, Service, status};

use ob1_siemens::any::Span;
use ob1_siemens::outputs::Outputs;

use crate::area::Spans;
use crate::job::cancel;
use crate::partner::{Sender, both, lengths, module_of, owner, receive};
use crate::state::CpState;

both! {
    /// FB 8, SFB 8: USEND.
    Usend = "USEND" 8: mod usend, usend4 {
        /// A rising edge starts a job.
        in     REQ: Bool;
        /// Number of the connection, as the station file gives it.
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

impl<const FOUR: bool> Usend<FOUR> {
    fn run(cx: &mut Cx<'_, CpState>) -> Result<(), Abort> {
        let areas: &[_] = if FOUR { &[usend4::SD_1, usend4::SD_2, usend4::SD_3, usend4::SD_4] } else { &[usend::SD_1] };
        let outputs = Outputs { end: usend::DONE, error: usend::ERROR, status: usend::STATUS };
        let at = (cx.get(usend::ID)?, cx.get(usend::R_ID)?);
        let sender = Sender { req: usend::REQ, memory: Self::MEMORY, outputs };
        sender.call(cx, Service::Usend, at, |cx, wanted| {
            let Some(spans) = Spans::of(cx, areas)? else { return Ok(Err(status::AREA)) };
            wanted.source = spans;
            Ok(lengths(wanted, &spans))
        })?;
        Ok(())
    }
}

both! {
    /// FB 9, SFB 9: URCV.
    Urcv = "URCV" 9: mod urcv, urcv4 {
        /// 1: data are accepted.
        in     EN_R: Bool;
        /// Number of the connection, as the station file gives it.
        in     ID: Word;
        /// Identifies the USEND of the partner.
        in     R_ID: DWord;
        /// For one call: new data have been stored.
        out    NDR: Bool;
        /// For one call: the data could not be stored.
        out    ERROR: Bool;
        /// The error, 0 without one; docs/cp343.md lists the numbers.
        out    STATUS: Word;
    }
    in_out { RD_1: Any; }
    in_out { RD_1: Any; RD_2: Any; RD_3: Any; RD_4: Any; }
}

impl<const FOUR: bool> Urcv<FOUR> {
    fn run(cx: &mut Cx<'_, CpState>) -> Result<(), Abort> {
        Self::MEMORY.note(cx)?;
        let areas: &[_] = if FOUR { &[urcv4::RD_1, urcv4::RD_2, urcv4::RD_3, urcv4::RD_4] } else { &[urcv::RD_1] };
        let outputs = Outputs { end: urcv::NDR, error: urcv::ERROR, status: urcv::STATUS };
        let at = (cx.get(urcv::EN_R)?, cx.get(urcv::ID)?, cx.get(urcv::R_ID)?);
        let spans = Spans::of(cx, areas)?;
        receive(cx, Service::Urcv, at, spans, &outputs).map(drop)
    }
}

both! {
    /// FB 12, SFB 12: BSEND.
    Bsend = "BSEND" 12: mod bsend, bsend4 {
        /// A rising edge starts a job.
        in     REQ: Bool;
        /// 1 cancels the job.
        in     R: Bool;
        /// Number of the connection, as the station file gives it.
        in     ID: Word;
        /// Identifies the BRCV of the partner.
        in     R_ID: DWord;
        /// For one call: the BRCV of the partner has the data.
        out    DONE: Bool;
        /// For one call: the job failed.
        out    ERROR: Bool;
        /// The error; 11: REQ came while a job was running, 25: the job is running.
        out    STATUS: Word;
        /// The data to send.
        in_out SD_1: Any;
        /// Number of bytes to send; 0: all.
        in_out LEN: Word;
    }
    in_out {}
    in_out {}
}

impl<const FOUR: bool> Bsend<FOUR> {
    fn run(cx: &mut Cx<'_, CpState>) -> Result<(), Abort> {
        let outputs = Outputs { end: bsend::DONE, error: bsend::ERROR, status: bsend::STATUS };
        let at = (cx.get(bsend::ID)?, cx.get(bsend::R_ID)?);
        if cx.get(bsend::R)? {
            Self::MEMORY.note(cx)?;
            let req = cx.get(bsend::REQ)?;
            cx.store(Self::MEMORY.req, u8::from(req))?;
            let had_job = match module_of(cx, at.0)? {
                Some(laddr) => {
                    let owner = owner(cx)?;
                    cancel(cx, laddr, owner)?
                }
                None => false,
            };
            return outputs.set(cx, false, had_job.then_some(status::RESET), 0);
        }
        let most = if FOUR { BSEND_MAX } else { BSEND_MAX_300 } as u32;
        Sender { req: bsend::REQ, memory: Self::MEMORY, outputs }.call(cx, Service::Bsend, at, |cx, wanted| {
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
    /// FB 13, SFB 13: BRCV.
    Brcv = "BRCV" 13: mod brcv, brcv4 {
        /// 1: data are accepted.
        in     EN_R: Bool;
        /// Number of the connection, as the station file gives it.
        in     ID: Word;
        /// Identifies the BSEND of the partner.
        in     R_ID: DWord;
        /// For one call: new data have been stored.
        out    NDR: Bool;
        /// For one call: the data could not be stored.
        out    ERROR: Bool;
        /// The error, 0 without one; docs/cp343.md lists the numbers.
        out    STATUS: Word;
        /// Memory for the data.
        in_out RD_1: Any;
        /// Number of bytes received.
        in_out LEN: Word;
    }
    in_out {}
    in_out {}
}

impl<const FOUR: bool> Brcv<FOUR> {
    fn run(cx: &mut Cx<'_, CpState>) -> Result<(), Abort> {
        Self::MEMORY.note(cx)?;
        let outputs = Outputs { end: brcv::NDR, error: brcv::ERROR, status: brcv::STATUS };
        let at = (cx.get(brcv::EN_R)?, cx.get(brcv::ID)?, cx.get(brcv::R_ID)?);
        let spans = Spans::of(cx, &[brcv::RD_1])?;
        if let Some(len) = receive(cx, Service::Brcv, at, spans, &outputs)? {
            cx.set(brcv::LEN, len as u16)?;
        }
        Ok(())
    }
}
