//! The automaton of a block that receives: `P_RCV_RK`, `P_RCV`, FB 61, the receiving half of FB 65.

use ob1_time::{Instant, Span};

use super::numbers::Number;
use super::rule::{Findings as _, Rule};
use crate::programs::judge::Verdict;

/// What the manual says of one block.
#[derive(Clone, Copy, Debug)]
pub struct Manual {
    /// Its name, for findings.
    pub block: &'static str,
    /// STATUS while telegrams come in, beside 0.
    pub busy: u16,
    /// Bytes that one call moves at most.
    pub portion: u32,
    /// STATUS of a reception that R or `EN_R` has ended.
    pub aborted: Option<u16>,
    /// R blocks the block while it is on; otherwise it acts on its edge. [TIA help "PtP data link CP 341"]
    pub blocks: bool,
    /// Calls, and time, within which R is answered.
    pub answers: (u32, Span),
    /// What a STATUS means at this block with this protocol; `None`: it does not occur.
    pub number: fn(u16) -> Option<Number>,
}

/// One call: the inputs before, the outputs after.
#[derive(Clone, Copy, Debug)]
pub struct ReceiveCall {
    /// When.
    pub at: Instant,
    /// `EN_R`.
    pub enable: bool,
    /// R.
    pub reset: bool,
    /// NDR.
    pub ndr: bool,
    /// ERROR.
    pub error: bool,
    /// STATUS.
    pub status: u16,
    /// LEN.
    pub len: i32,
}

/// What a call has reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Report {
    /// A telegram of this length.
    Telegram(i32),
    /// An error.
    Error(u16),
    /// A reset was answered.
    Reset,
}

/// Calls after which a reception that `EN_R` has ended is reported.
const TOLD_IN: u32 = 4;

/// The automaton of one instance.
#[derive(Debug)]
pub struct Receiver {
    manual: Manual,
    enable: bool,
    reset: bool,
    /// R has come and was not answered: when, and calls since then.
    owed: Option<(Instant, u32)>,
    /// `EN_R` has gone in this many calls before: a reception may have been broken off.
    disabled: Option<u32>,
    /// Calls since the last telegram.
    calls: u32,
    /// Errors have a cause until then.
    excused_until: Instant,
    /// Faults of the line that were not reported.
    faults: u32,
}

/// Framing, parity, overrun; BREAK; parity and framing at a CP 340 with ASCII. (docs/cp341-events.md)
const CHARACTER: [u16; 4] = [0x080C, 0x080D, 0x0810, 0x0811];

impl Receiver {
    /// A new instance.
    #[must_use]
    pub fn new(manual: Manual) -> Self {
        let excused_until = Instant::START;
        Self { manual, enable: false, reset: false, owed: None, disabled: None, calls: 0, excused_until, faults: 0 }
    }

    /// Something has happened that may fail receptions until `until`.
    pub fn disturbed(&mut self, until: Instant) {
        self.excused_until = self.excused_until.max(until);
    }

    /// At `at` the partner has given up a block that the CP had refused. If that had a cause, its report has one until
    /// `until`.
    pub fn given_up(&mut self, at: Instant, until: Instant) {
        if at < self.excused_until {
            self.disturbed(until);
        }
    }

    /// A fault of the line. Its error comes when the telegram that it has hit is over
    /// [TIA help "Configuration for point-to-point links"], and behind those before it, each a portion in a call:
    /// however late, but once.
    pub fn fault(&mut self) {
        self.faults += 1;
    }

    /// A start-up of the CPU.
    pub fn restarted(&mut self, until: Instant) {
        self.disturbed(until);
        self.owed = None;
    }

    /// Takes a call.
    pub fn call(&mut self, call: &ReceiveCall, findings: &mut Verdict) -> Option<Report> {
        self.outputs(call, findings);
        self.calls = self.calls.saturating_add(1);
        if call.reset && !self.reset {
            self.owed = Some((call.at, 0));
        }
        self.disabled = match (self.enable, call.enable, self.disabled) {
            (true, false, _) => Some(0),
            (_, _, Some(calls)) if calls < TOLD_IN => Some(calls + 1),
            _ => None,
        };
        self.enable = call.enable;
        self.reset = call.reset;
        match (call.ndr, call.error) {
            (true, _) => self.taken(call, findings),
            (_, true) => self.failed(call, findings),
            _ => {
                self.silent(call, findings);
                None
            }
        }
    }

    fn taken(&mut self, call: &ReceiveCall, findings: &mut Verdict) -> Option<Report> {
        let Manual { block, portion, .. } = self.manual;
        if self.owed.is_some() && call.len == 0 {
            self.owed = None;
            return Some(Report::Reset);
        }
        let excused = call.at < self.excused_until;
        let blocked = call.reset && self.manual.blocks;
        findings.must(!blocked, call.at, Rule::ResetBlocks, || format!("{block}: NDR while R is 1"));
        findings
            .must(call.enable || call.reset, call.at, Rule::EnableBlocks, || format!("{block}: NDR while EN_R is 0"));
        if self.owed.is_some() && !call.reset {
            // R was on for less than the answer takes; the telegram was at its end.
            self.owed = None;
        }
        let fewest = u32::try_from(call.len).unwrap_or(0).div_ceil(portion.max(1));
        let calls = std::mem::take(&mut self.calls);
        findings.must(calls >= fewest || excused, call.at, Rule::Portions, || {
            format!("{block}: {} bytes in {calls} calls, they need {fewest}", call.len)
        });
        Some(Report::Telegram(call.len))
    }

    fn failed(&mut self, call: &ReceiveCall, findings: &mut Verdict) -> Option<Report> {
        let Manual { block, aborted, .. } = self.manual;
        let excused = call.at < self.excused_until;
        if self.owed.is_some() {
            if self.manual.blocks {
                self.owed = None;
            }
            let right = aborted.is_none_or(|aborted| call.status == aborted) || excused;
            findings.must(right, call.at, Rule::ResetIsAnswered, || {
                format!("{block}: R is answered with ERROR {:04X}h", call.status)
            });
            return Some(Report::Reset);
        }
        if self.disabled.take().is_some() && aborted == Some(call.status) {
            return Some(Report::Error(call.status));
        }
        let is_fault = CHARACTER.contains(&call.status) && self.faults > 0;
        self.faults -= u32::from(is_fault);
        // The partner has sent more than there is room for: that is its own cause.
        // [TIA help "Configuration for point-to-point links"]
        findings.must(excused || is_fault || call.status == 0x080A, call.at, Rule::ErrorHasCause, || {
            format!("{block}: ERROR {:04X}h, but nothing was wrong", call.status)
        });
        Some(Report::Error(call.status))
    }

    fn silent(&mut self, call: &ReceiveCall, findings: &mut Verdict) {
        let Some((since, calls)) = self.owed else { return };
        let excused = call.at < self.excused_until;
        let (most, time) = self.manual.answers;
        let over = calls + 1 >= most && call.at > since + time;
        self.owed = (!over).then_some((since, calls + 1));
        findings.must(!over || excused || !self.manual.blocks, call.at, Rule::ResetIsAnswered, || {
            format!("{}: R is answered with neither NDR and LEN 0 nor ERROR", self.manual.block)
        });
    }

    fn outputs(&self, call: &ReceiveCall, findings: &mut Verdict) {
        let Manual { block, busy, number, .. } = self.manual;
        let &ReceiveCall { at, ndr, error, status, .. } = call;
        findings.must(!(ndr && error), at, Rule::EndIsOne, || format!("{block}: NDR and ERROR"));
        let fits = if error { status != 0 && status != busy } else { status == 0 || status == busy };
        findings.must(fits, at, Rule::StatusWithError, || {
            format!("{block}: ERROR {}, STATUS {status:04X}h", u8::from(error))
        });
        findings.must(!error || number(status).is_some(), at, Rule::KnownStatus, || {
            format!("{block}: STATUS {status:04X}h is not a number of this block")
        });
    }
}
