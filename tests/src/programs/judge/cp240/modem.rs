//! FC 8 and FC 9.

use ob1_time::{Instant, Span};

use super::{Bench240, Patience};
use crate::programs::judge::Verdict;
use crate::programs::record::Call;

/// Places of the parameters of FC 8 in a record [S0 L1019].
const START: usize = 7;
const RET_VAL: usize = 9;
/// FC 8 may wait as long as a telegram is sent [S0 L1035].
const WHILE_SENDING: Span = Span::from_secs(3);
/// Places of the parameters of FC 9 [S0 L1071].
pub(super) const ANL: usize = 2;
pub(super) const RESET: usize = 4;
/// The idle time of FC 9 and the start of the CP.
const START_UP: Span = Span::from_millis(1_500);

/// FC 8.
#[derive(Debug, Default)]
pub(super) struct Modem {
    since: Option<Patience>,
}

/// A call of FC 8.
pub(super) fn called(judge: &mut Bench240, call: &Call, verdict: &mut Verdict) {
    let (before, after, now) = (&call.before, &call.after, call.at);
    if after[RET_VAL] != 0 {
        verdict.broken("fc8-ret", now, format!("RET_VAL is {:04X}h, not 0 [S0 L1055]", after[RET_VAL]));
    }
    if before[START] == 0 {
        if after[START] == 1 {
            verdict.broken("fc8-start", now, "START was 0, and FC 8 has set it");
        }
        judge.modem.since = None;
        return;
    }
    let broken = judge.seen.last_break();
    let since = judge.modem.since.get_or_insert(Patience::new(now));
    since.called(now);
    if broken >= since.begun() {
        *since = Patience::new(now);
    }
    if after[START] == 0 {
        judge.modem.since = None;
    } else if since.is_over(WHILE_SENDING, 40) && !judge.seen.unheard {
        judge.modem.since = None;
        verdict.broken("fc8-live", now, "START stays 1 [S0 L1049]");
    }
}

/// FC 9.
#[derive(Debug, Default)]
pub(super) struct Synchron {
    since: Option<Patience>,
    /// It was synchronised before, or the process that began it has died.
    again: bool,
}

impl Synchron {
    /// The next synchronisation is with a process that follows another one (docs/cp240-blocks.md).
    pub(super) fn killed(&mut self) {
        self.again = true;
    }
}

/// A call of FC 9.
pub(super) fn synchron(judge: &mut Bench240, call: &Call, verdict: &mut Verdict) {
    let (before, after, now) = (&call.before, &call.after, call.at);
    let busy = |values: &[u32]| values[ANL] == 1 || values[RESET] == 1;
    if !busy(before) && after[RESET] == 1 {
        verdict.broken("fc9-reset", now, "RESET was 0, and FC 9 has set it");
    }
    // FC 9 sets ANL itself when the CP has started anew: a break like a RESET.
    if busy(before) || busy(after) {
        judge.seen.breaks(now, now + super::MARGIN);
    }
    if !busy(before) && busy(after) || before[RESET] == 1 {
        judge.seen.resets.push(now);
    }
    if busy(before) && !busy(after) && std::mem::replace(&mut judge.synchron.again, true) {
        super::rk512::synchronised(judge, now);
    }
    if !busy(after) {
        judge.synchron.since = None;
        return;
    }
    let outside = judge.seen.starts.last().copied().unwrap_or(Instant::START);
    let since = judge.synchron.since.get_or_insert(Patience::new(now));
    since.called(now);
    if outside > since.begun() || before[RESET] == 1 {
        *since = Patience::new(now);
    }
    if since.is_over(START_UP, 20) {
        judge.synchron.since = None;
        verdict.broken("fc9-live", now, "the synchronisation does not end [S0 L1085]");
    }
}
