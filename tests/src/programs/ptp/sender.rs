//! The automaton of a block that sends: P_SND_RK, P_SEND, FB 60, the sending half of FB 65.
//!
//! It sees the parameters of each call before and after, and says which jobs begin and end. What is at the partner is
//! the matter of [`super::post`].

use ob1_time::{Instant, Span};

use super::numbers::Number;
use super::rule::{Findings as _, Rule};
use crate::programs::judge::Verdict;

/// What the manual says of one block.
#[derive(Clone, Copy, Debug)]
pub struct Manual {
    /// Its name, for findings.
    pub block: &'static str,
    /// STATUS while a job runs, beside 0.
    pub busy: u16,
    /// How the data move.
    pub portions: Portions,
    /// STATUS of a job that R has ended; `None`: the reset is answered with DONE alone.
    pub reset: Option<u16>,
    /// R blocks the block while it is on; otherwise it acts on its edge. [TIA help "PtP data link CP 341"]
    pub blocks: bool,
    /// Calls, and time, within which R is answered.
    pub answers: (u32, Span),
    /// What a STATUS means at this block with this protocol; `None`: it does not occur.
    pub number: fn(u16) -> Option<Number>,
    /// A job ends within this time after its data are in the CP and everything works.
    pub bound: Span,
}

/// How many calls a job needs at least.
#[derive(Clone, Copy, Debug)]
pub enum Portions {
    /// 32 bytes in a call, three calls at least. [CP 341 manual 09/2008, p. 178]
    Of32,
    /// Telegrams of IO size - 1 bytes, each with its answer. [S3 "Sending data"]
    Io(u32),
}

impl Portions {
    /// The fewest calls for `len` bytes.
    #[must_use]
    pub fn fewest(self, len: i32) -> u32 {
        let len = u32::try_from(len).unwrap_or(0);
        match self {
            Self::Of32 => len.div_ceil(32).max(1) + 2,
            Self::Io(size) => (len + 3).div_ceil(size.max(2) - 1) + 1,
        }
    }
}

/// One call: the inputs before, the outputs after.
#[derive(Clone, Copy, Debug)]
pub struct SendCall {
    /// When.
    pub at: Instant,
    /// REQ.
    pub req: bool,
    /// R.
    pub reset: bool,
    /// LEN.
    pub len: i32,
    /// DONE.
    pub done: bool,
    /// ERROR.
    pub error: bool,
    /// STATUS.
    pub status: u16,
    /// Its parameters are right.
    pub legal: bool,
}

/// How a job ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// DONE.
    Done,
    /// ERROR with this STATUS.
    Error(u16),
    /// R.
    Reset,
}

/// What a call did to jobs: an end comes before a beginning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Turn {
    /// The running job has ended.
    pub ended: Option<End>,
    /// A job has begun.
    pub began: bool,
    /// A job has begun and ended in this call.
    pub at_once: Option<End>,
    /// Whether the job before this one has begun at all, nobody knows.
    pub ghost: bool,
}

#[derive(Clone, Copy, Debug)]
struct Job {
    began: Instant,
    len: i32,
    calls: u32,
    /// Since everything works and its data had the time to reach the CP.
    clock: Option<Instant>,
    settled: u32,
    /// Calls after the bound.
    late: u32,
    /// It may end with an error.
    excused: bool,
    /// The manual does not say whether the edge counts: it came in the call that ended the job before.
    sure: bool,
    /// A job that is not sure came before: this edge starts one, or that one goes on.
    ghost: bool,
    /// R has come.
    aborting: Option<Instant>,
    told: bool,
}

/// The automaton of one instance.
#[derive(Debug)]
pub struct Sender {
    manual: Manual,
    req: bool,
    reset: bool,
    job: Option<Job>,
    /// R has come and was not answered: when, and calls since then.
    owed: Option<(Instant, u32)>,
    /// An error has ended the job, or a start-up has come: whether the reset still runs, the next call shows.
    settles: bool,
    /// A job began in that very call: whether DONE is that of the reset or ends the job, nobody knows.
    either: bool,
    /// Errors have a cause until then.
    excused_until: Instant,
    /// The first call after a start-up: whether REQ has risen cannot be known.
    is_restart: bool,
}

/// Calls in which a result that is there must be seen.
const SEEN_IN: u32 = 8;

impl Sender {
    /// A new instance.
    #[must_use]
    pub fn new(manual: Manual) -> Self {
        let excused_until = Instant::START;
        let (job, owed, settles, either) = (None, None, false, false);
        Self { manual, req: false, reset: false, job, owed, settles, either, excused_until, is_restart: false }
    }

    /// Whether a job runs.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        self.job.is_some_and(|job| job.sure)
    }

    /// When the running job began.
    #[must_use]
    pub fn began(&self) -> Option<Instant> {
        self.job.as_ref().map(|job| job.began)
    }

    /// Whether a job may begin with this call.
    #[must_use]
    pub fn may_begin(&self, req: bool) -> bool {
        req && (!self.req || self.is_restart)
    }

    /// Something has happened that may fail jobs until `until` and delays them.
    pub fn disturbed(&mut self, until: Instant) {
        self.excused_until = self.excused_until.max(until);
        if let Some(job) = &mut self.job {
            job.excused = true;
            job.clock = None;
            job.settled = 0;
            job.late = 0;
        }
    }

    /// The running job may end with an error: its parameters are wrong or were changed.
    pub fn excuse(&mut self) {
        if let Some(job) = &mut self.job {
            job.excused = true;
        }
    }

    /// The line was the partner's: the bound begins again.
    pub fn delayed(&mut self) {
        if let Some(job) = &mut self.job {
            (job.clock, job.settled, job.late) = (None, 0, 0);
        }
    }

    /// A start-up of the CPU: it ends what runs. [TIA help "Configuration for point-to-point links"]
    pub fn restarted(&mut self, until: Instant) {
        self.disturbed(until);
        // Where R acts on its edge, the reset is kept in the instance data and may go on.
        self.settles = !self.manual.blocks && self.owed.is_some();
        if !self.settles {
            self.owed = None;
        }
        self.is_restart = true;
    }

    /// Takes a call.
    pub fn call(&mut self, call: &SendCall, findings: &mut Verdict) -> Turn {
        self.outputs(call, findings);
        let blocked = call.reset && self.manual.blocks;
        let rises = call.req && (!self.req || self.is_restart) && !blocked;
        let sure = call.req && !self.req;
        let resets = call.reset && !self.reset;
        self.req = call.req;
        self.reset = call.reset;
        self.is_restart = false;
        let end = match (call.done, call.error) {
            (true, _) => Some(End::Done),
            (_, true) => Some(End::Error(call.status)),
            _ => None,
        };
        let mut end = end;
        self.either &= self.owed.is_some() && !resets;
        if !self.manual.blocks && self.owed.is_some() && end == Some(End::Done) {
            if let Some(job) = self.job.as_mut().filter(|_| self.either) {
                job.sure = false;
            }
            // The reset itself has ended; a job may have begun meanwhile. (docs/cp040-registers.md)
            (self.owed, end) = (None, None);
        }
        let mut turn = Turn::default();
        // STATUS "job runs" without a job: that is the reset. (docs/cp040-registers.md)
        let settles = std::mem::take(&mut self.settles);
        if settles && end.is_none() && call.status != self.manual.busy {
            self.owed = None;
        }
        if settles && end.is_none() && rises && self.job.is_none() && self.owed.is_some() {
            (self.either, turn.ghost) = (true, true);
        }
        let failed = matches!(end, Some(End::Error(_))) && call.at < self.excused_until;
        if !self.manual.blocks && !resets && self.owed.is_some() && failed {
            if self.job.is_none() && !rises {
                // The reset has ended with an error: a restart of the CP, or another instance's reset.
                // (docs/cp040-registers.md)
                self.owed = None;
                return turn;
            }
            // One error for a job and a reset: it may have ended only the job, and then the reset goes on.
            self.settles = true;
            if self.job.is_none() {
                // Whether an edge in this call counts is open, as at the end of a job.
                self.begin(call, false);
                turn.began = true;
                return turn;
            }
        }
        if resets && !self.manual.blocks && end.is_none() && self.job.take_if(|job| !job.sure).is_some() {
            // No job was there for R to end, or it would have said so: DONE is that of the reset.
            // (docs/cp040-registers.md)
            self.owed = Some((call.at, 0));
            turn.ended = Some(End::Reset);
            if rises {
                // It waits for the reset.
                self.begin(call, sure);
                turn.began = true;
            }
            return turn;
        }
        if self.job.is_some_and(|job| !job.sure) && rises && end.is_none() {
            self.begin(call, true);
            if let Some(job) = &mut self.job {
                job.ghost = true;
            }
            (turn.began, turn.ghost) = (true, true);
            return turn;
        }
        if let Some(since) = self.job.and_then(|job| job.aborting)
            && rises
            && !self.manual.blocks
            && end.is_none()
        {
            // The next job may wait for the reset, or begin only with an edge behind it. (docs/cp040-registers.md)
            self.owed = Some((since, 0));
            (turn.ended, turn.began) = (Some(End::Reset), true);
            self.begin(call, false);
            return turn;
        }
        if let Some(mut job) = self.job.take() {
            if blocked || resets {
                job.aborting = job.aborting.or(Some(call.at));
            }
            turn.ended = self.running(job, call, end, findings);
            if turn.ended.is_some() && rises {
                // An edge in the call that ends the job before: the manual leaves open whether it counts.
                self.begin(call, false);
                turn.began = true;
            }
            return turn;
        }
        if resets {
            self.owed = Some((call.at, 0));
        }
        if rises {
            self.begin(call, sure);
            turn.began = true;
            if let Some(job) = self.job.take() {
                turn.at_once = self.running(job, call, end, findings);
            }
            return turn;
        }
        self.idle(call, end, findings);
        turn
    }

    fn begin(&mut self, call: &SendCall, sure: bool) {
        let excused = call.at < self.excused_until || !call.legal;
        let len = call.len;
        if self.manual.blocks {
            self.owed = None;
        }
        self.job = Some(Job {
            began: call.at,
            len,
            calls: 0,
            clock: None,
            settled: 0,
            late: 0,
            excused,
            sure,
            ghost: false,
            aborting: None,
            told: false,
        });
    }

    /// A job runs: it takes several calls, ignores further edges of REQ, and ends once. (docs/cp341.md)
    fn running(&mut self, mut job: Job, call: &SendCall, end: Option<End>, findings: &mut Verdict) -> Option<End> {
        let Manual { block, number, blocks, .. } = self.manual;
        job.calls += 1;
        job.settled += 1;
        if let Some(since) = job.aborting {
            return self.aborted(job, since, call, end, findings);
        }
        let Some(end) = end else {
            self.waits(&mut job, call, findings);
            self.job = Some(job);
            return None;
        };
        match end {
            End::Done => {
                let fewest = self.manual.portions.fewest(job.len);
                findings.must(
                    job.calls >= fewest || !job.sure || job.ghost || !blocks && job.excused,
                    call.at,
                    Rule::Portions,
                    || format!("{block}: {} bytes were DONE in {} calls, they need {fewest}", job.len, job.calls),
                );
            }
            End::Error(status) => {
                let about_itself = number(status).is_some_and(|number| number == Number::Refused);
                let excused = job.excused || call.at < self.excused_until;
                findings.must(excused, call.at, Rule::ErrorHasCause, || {
                    let kind = if about_itself { "its parameters are right" } else { "nothing was wrong" };
                    format!("{block}: ERROR {status:04X}h, but {kind}")
                });
            }
            End::Reset => {}
        }
        Some(end)
    }

    /// R in a job: the block says that the job has ended. [TIA help "PtP data link CP 341"]
    fn aborted(
        &mut self,
        mut job: Job,
        since: Instant,
        call: &SendCall,
        end: Option<End>,
        findings: &mut Verdict,
    ) -> Option<End> {
        let Manual { block, reset, .. } = self.manual;
        let status = match end {
            None => {
                job.late += 1;
                let late = job.late;
                let (calls, time) = self.manual.answers;
                let over = late >= calls && call.at > since + time;
                let excused = call.at < self.excused_until;
                findings.must(!over || excused || !job.sure, call.at, Rule::ResetIsAnswered, || {
                    format!("{block}: R ends a running job, but {late} calls say nothing")
                });
                if over {
                    return Some(End::Reset);
                }
                self.job = Some(job);
                return None;
            }
            Some(End::Done) if reset.is_some() && job.sure => {
                // The job was at its end when R came.
                return Some(End::Done);
            }
            Some(End::Error(status)) => {
                if !self.manual.blocks {
                    // First the job that was lost, then the reset.
                    self.owed = Some((since, 0));
                }
                Some(status)
            }
            _ => None,
        };
        let right = reset.is_none() || status == reset || !job.sure || job.excused || call.at < self.excused_until;
        findings
            .must(right, call.at, Rule::ResetIsAnswered, || format!("{block}: a job ended by R reports {status:04X?}"));
        Some(End::Reset)
    }

    /// A job goes on: it ends within its bound once everything works.
    fn waits(&mut self, job: &mut Job, call: &SendCall, findings: &mut Verdict) {
        if job.clock.is_none() && job.settled > self.manual.portions.fewest(job.len) + SEEN_IN {
            job.clock = Some(call.at.max(self.excused_until));
        }
        let bound = self.manual.bound;
        if job.clock.is_some_and(|clock| call.at > clock + bound) && job.sure {
            job.late += 1;
            if job.late >= SEEN_IN && !job.told {
                job.told = true;
                let (block, calls) = (self.manual.block, job.calls);
                let ms = bound.millis();
                findings.breaks(
                    call.at,
                    Rule::JobEnds,
                    format!("{block}: no DONE and no ERROR after {calls} calls, {ms} ms after everything worked"),
                );
            }
        }
    }

    /// No job runs: only a reset is answered. [TIA help "PtP data link CP 341"]
    fn idle(&mut self, call: &SendCall, end: Option<End>, findings: &mut Verdict) {
        let block = self.manual.block;
        let excused = call.at < self.excused_until;
        match (self.owed, end) {
            (Some(_), Some(End::Done)) => self.owed = None,
            // A start-up that R has interrupted.
            (Some(_), Some(_)) if excused => {
                if self.manual.blocks {
                    self.owed = None;
                }
            }
            (Some((since, calls)), None) => {
                let calls = calls + 1;
                let (most, time) = self.manual.answers;
                let over = calls >= most && call.at > since + time;
                self.owed = (!over).then_some((since, calls));
                findings.must(!over || excused, call.at, Rule::ResetIsAnswered, || {
                    format!("{block}: R without a job is not answered with DONE")
                });
            }
            (None, None) => {}
            // A reset that a start-up of the CPU has cut off.
            (None, Some(End::Error(_))) if excused && !self.manual.blocks => {}
            (_, Some(end)) => {
                let rule = if call.reset && self.manual.blocks { Rule::ResetBlocks } else { Rule::EndOfAJob };
                findings.breaks(call.at, rule, format!("{block}: {end:X?} without a job"));
            }
        }
    }

    /// The outputs of any call.
    fn outputs(&self, call: &SendCall, findings: &mut Verdict) {
        let Manual { block, busy, number, .. } = self.manual;
        let &SendCall { at, done, error, status, .. } = call;
        findings.must(!(done && error), at, Rule::EndIsOne, || format!("{block}: DONE and ERROR"));
        let fits = if error { status != 0 && status != busy } else { status == 0 || status == busy };
        findings.must(fits, at, Rule::StatusWithError, || {
            format!("{block}: ERROR {}, STATUS {status:04X}h", u8::from(error))
        });
        findings.must(!error || number(status).is_some(), at, Rule::KnownStatus, || {
            format!("{block}: STATUS {status:04X}h is not a number of this block")
        });
    }
}
