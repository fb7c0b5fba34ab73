//! FC 3 DP_DIAG and FC 4 DP_CTRL: the CP's diagnoses of its slaves, and its mode.

use ob1_sdk::{Abort, Block, Cx, Kind, Param, interface};
use ob1_siemens::any::Span;
use ob1_siemens::any::status::{SOURCE, TARGET};
use ob1_words::cp342::{DIAGNOSIS_LEAST, FIELD_BYTES, JOB, JOB_CONTROL, JOB_DIAG, STATUS_BYTES, dtype, status};

use crate::outcome::{Outcome, exchanging, of_memory, of_module};
use ob1_siemens::outputs::Outputs;

/// The answer to a job: its STATUS, and data bytes.
type Answer = [u8; STATUS_BYTES + FIELD_BYTES];

/// Gives the CP a job; returns the number of data bytes in the answer.
fn job(cx: &mut Cx<'_, ()>, address: u16, wanted: &[u8], answer: &mut Answer) -> Result<Result<usize, Outcome>, Abort> {
    if let Err(outcome) = exchanging(cx, address)? {
        return Ok(Err(outcome));
    }
    let address = u32::from(address);
    if let Err(refused) = cx.record_write(address, JOB, wanted)? {
        return Ok(Err(of_module(refused)));
    }
    Ok(match cx.record_read(address, JOB, answer)? {
        Ok(len) if len >= STATUS_BYTES => match u16::from_be_bytes([answer[0], answer[1]]) {
            0 => Ok(len - STATUS_BYTES),
            status::NOTHING => Err(Outcome::Nothing(status::NOTHING)),
            other => Err(Outcome::Error(other)),
        },
        Ok(_) => Err(Outcome::Error(status::UNKNOWN)),
        Err(refused) => Err(of_module(refused)),
    })
}

interface! {
    /// Parameters of FC 3 DP_DIAG, in the manual's order.
    pub(crate) mod diag {
        /// Module start address of the CP.
        in     CPLADDR: Word;
        /// What to read: 0 station list, 1 diagnostic list, 2 newest diagnosis, 3 an older one, 4 to 6 modes.
        in     DTYPE: Byte;
        /// Address of the slave, for DTYPE 2 and 3.
        in     STATION: Byte;
        /// Memory for the answer, 1 to 240 bytes.
        in     DIAG: Any;
        /// The answer has been stored.
        out    NDR: Bool;
        /// There is no answer.
        out    ERROR: Bool;
        /// The error, or 8182h if there is nothing new.
        out    STATUS: Word;
        /// Bytes of the answer, also if DIAG is shorter.
        out    DIAGLNG: Byte;
    }
}

pub(crate) struct Diagnose;

impl Block for Diagnose {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = 3;
    const NAME: &'static str = "DP_DIAG";
    const PARAMS: &'static [Param] = diag::PARAMS;
    type State = ();
    type Module = ();

    fn call(cx: &mut Cx<'_, ()>, _state: &()) -> Result<(), Abort> {
        let (outcome, len) = diagnose(cx)?;
        cx.set(diag::DIAGLNG, len as u8)?;
        outcome.set(cx, Outputs { end: diag::NDR, error: diag::ERROR, status: diag::STATUS })
    }
}

fn diagnose(cx: &mut Cx<'_, ()>) -> Result<(Outcome, usize), Abort> {
    let (address, wanted, station) = (cx.get(diag::CPLADDR)?, cx.get(diag::DTYPE)?, cx.get(diag::STATION)?);
    let Some(span) = Span::of(cx, diag::DIAG)? else { return Ok((Outcome::Error(status::PARAMETER), 0)) };
    // Checked before the job is given, because reading a diagnosis marks it as read.
    let least = if matches!(wanted, dtype::CURRENT | dtype::OLDER) { DIAGNOSIS_LEAST } else { 1 };
    if (span.len as usize) < least {
        return Ok((Outcome::Error(status::SHORT), 0));
    }
    let mut answer = [0; STATUS_BYTES + FIELD_BYTES];
    let len = match job(cx, address, &[JOB_DIAG, wanted, station], &mut answer)? {
        Ok(len) => len,
        Err(outcome) => return Ok((outcome, 0)),
    };
    let fits = len.min(span.len as usize);
    let bytes = answer.get(STATUS_BYTES..STATUS_BYTES + fits).unwrap_or_default();
    let written = span.write(cx, 0, bytes)?;
    Ok((written.map_or_else(|refused| of_memory(refused, TARGET), |()| Outcome::Done), len))
}

interface! {
    /// Parameters of FC 4 DP_CTRL, in the manual's order.
    pub(crate) mod ctrl {
        /// Module start address of the CP.
        in     CPLADDR: Word;
        /// The job field, 1 to 240 bytes: CTYPE and its parameters.
        in     CONTROL: Any;
        /// The job ended without error.
        out    DONE: Bool;
        /// The job failed; STATUS says why.
        out    ERROR: Bool;
        /// Result of the job; docs/cp342.md lists the numbers.
        out    STATUS: Word;
    }
}

pub(crate) struct Control;

impl Block for Control {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = 4;
    const NAME: &'static str = "DP_CTRL";
    const PARAMS: &'static [Param] = ctrl::PARAMS;
    type State = ();
    type Module = ();

    fn call(cx: &mut Cx<'_, ()>, _state: &()) -> Result<(), Abort> {
        let outcome = control(cx)?;
        outcome.set(cx, Outputs { end: ctrl::DONE, error: ctrl::ERROR, status: ctrl::STATUS })
    }
}

fn control(cx: &mut Cx<'_, ()>) -> Result<Outcome, Abort> {
    let address = cx.get(ctrl::CPLADDR)?;
    let Some(span) = Span::of(cx, ctrl::CONTROL)? else { return Ok(Outcome::Error(status::PARAMETER)) };
    let mut wanted = [JOB_CONTROL; 1 + FIELD_BYTES];
    let Some(wanted) = wanted.get_mut(..1 + span.len as usize) else { return Ok(Outcome::Error(status::PARAMETER)) };
    let Some((_, field)) = wanted.split_first_mut() else { return Ok(Outcome::Error(status::PARAMETER)) };
    if let Err(refused) = span.read(cx, 0, field)? {
        return Ok(of_memory(refused, SOURCE));
    }
    let mut answer = [0; STATUS_BYTES + FIELD_BYTES];
    Ok(job(cx, address, wanted, &mut answer)?.map_or_else(|outcome| outcome, |_| Outcome::Done))
}
