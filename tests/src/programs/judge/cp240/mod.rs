//! The judge of the CP 240's handling blocks, written from the manual [S0] and, where the manual leaves the outcome of
//! a job to "internal use", from the page for users (docs/cp240-blocks.md).
//!
//! | rule | what the manual says |
//! |---|---|
//! | `fc0-idle` | "When FRG = 0 at call of the block, it is left immediately" [S0 L960] |
//! | `fc0-pafe`, `fc1-pafe`, `rk-pafe` | PAFE is 0 to 3, and says 1 or 2 when it is so [S0 L962-970] |
//! | `fc0-live`, `rk-live` | "After the transmission the FRG is set back again" [S0 L960]; ANZW bit 2 or 3 [S0 L1199] |
//! | `fc0-false-done`, `rk-false-done` | "order ready without errors" means at the partner [S0 L1312] |
//! | `fc0-twice`, `rk-twice` | "are transferred once" [S0 L960] |
//! | `fc0-false-error`, `rk-false-error` | a telegram that the partner has acknowledged is not an error |
//! | `fc0-no-reason`, `rk-no-reason` | a good partner on a good line: an order does not fail |
//! | `fc1-whole`, `fc1-twice`, `fc1-order`, `fc1-lost` | "a new telegram has been read completely" [S0 L981] |
//! | `fc1-hold` | while EMFR is set nothing is taken over [S0 L981] |
//! | `fc8-*` | START ends, RET_VAL is 0 [S0 L1049-1055] |
//! | `fc9-*` | ANL and RESET are set back [S0 L1085-1091] |
//! | `rk-anzw` | bits 1 to 3 exclude each other [S0 L1307-1320] |
//! | `rk-pafe-anzw` | bit 2 is deleted "when the according order is triggered for a second time" [S0 L1315] |
//! | `rk-reset` | "If bit 3 is set with 00h the CP had to reinitialize the connection" [S0 L1297] |
//! | `fc4-*` | FC 4 deals with the partner's orders [S0 L1241]; PAFE stands until its cause is gone [S0 L1262] |
//! | `xoff` | the partner's XOFF stops the CP [S0 L2007] |

mod modem;
mod receive;
mod rk512;
mod send;
mod serve;
#[cfg(test)]
mod tests;

use ob1_cpu::{Cell, Cpu, OperatingState, Width};
use ob1_firmware::LineFault;
use ob1_time::{Instant, Span};

use super::{Judge, Scan, Verdict};
use crate::programs::cp240::{Facts, Partner240, Role, serve as served};
use crate::programs::partner::{Sent, pattern};
use crate::programs::run::Deed;
use crate::sim::MS;

/// A place that is called less often than this counts as if it were not called: no promise of a time.
const SELDOM: Span = Span::from_millis(80);
/// What no time of the manual covers: the process of the CP wakes up, its answers come in the next scan.
const MARGIN: Span = Span::from_millis(150);

/// Until a CP whose process was killed works again.
const RESTART: Span = Span::from_millis(700);
/// A block that is no longer called may lose its turn to another one after this time, and its job ends with an error
/// (docs/cp240-blocks.md).
const HELD: Span = Span::from_secs(2);
/// It certainly has lost what it has begun after this time.
const GIVEN_UP: Span = Span::from_millis(2_100);
/// After the last fault of the line both sides may still wait for something that was lost.
const RECOVERY: Span = Span::from_millis(700);
/// Characters that may still come after the partner's XOFF: what a UART already has.
const AFTER_XOFF: usize = 20;

/// The judge.
#[derive(Debug)]
pub struct Bench240 {
    pub(super) facts: Facts,
    pub(super) seen: Seen,
    senders: Vec<send::Job>,
    fetches: Vec<rk512::Job>,
    reception: receive::Reception,
    modem: modem::Modem,
    synchron: modem::Synchron,
    serve: serve::Serve,
}

/// What is known of the run so far.
#[derive(Clone, Debug, Default)]
pub(super) struct Seen {
    /// From and to: resets, STOP to RUN, a driver that was killed, a line that is gone.
    pub(super) breaks: Vec<(Instant, Instant)>,
    /// RESET and start-ups that FC 9 has carried out.
    pub(super) resets: Vec<Instant>,
    /// RUN after STOP.
    pub(super) starts: Vec<Instant>,
    /// When each place of a block that sends was called last.
    pub(super) called: Vec<Option<Instant>>,
    /// When one of them was called again after a while.
    pub(super) back: Vec<Instant>,
    /// The partner stops the CP, and a bad line may lose its XON.
    pub(super) unheard: bool,
    /// The line is good from here on.
    pub(super) strict: Instant,
    /// Number of the next telegram.
    pub(super) next: u32,
    /// RUN after STOP: bit memory is empty.
    pub(super) empty: bool,
}

impl Seen {
    /// Something was broken off between these two times.
    pub(super) fn broken(&self, from: Instant, to: Instant) -> bool {
        self.breaks.iter().any(|(begin, end)| *end >= from && *begin <= to)
    }

    /// When the last of them has ended, as far as it is known.
    pub(super) fn last_break(&self) -> Instant {
        self.breaks.iter().map(|(_, end)| *end).max().unwrap_or(Instant::START)
    }

    /// A block that sends is no longer called, and was called after `since`: what it began may stand in the CP's way
    /// until the others give it up. The manual knows no such program; two seconds are ours (docs/cp240-blocks.md).
    pub(super) fn given_up(&self, since: Instant, now: Instant) -> Span {
        let dropped = |at: &Instant| at.saturating_add(GIVEN_UP) > since && at.saturating_add(SELDOM) < now;
        let gone = self.called.iter().flatten().any(dropped) || self.back.iter().any(|at| *at > since);
        if gone { GIVEN_UP } else { Span::ZERO }
    }

    /// A break that takes until `end` or, if that comes, until another of the same cause.
    pub(super) fn breaks(&mut self, from: Instant, end: Instant) {
        self.breaks.push((from, end));
    }

    /// The longest break ends now, or a little later.
    pub(super) fn mends(&mut self, now: Instant, later: Span) {
        for (_, end) in &mut self.breaks {
            if *end == Instant::NEVER {
                *end = now + later;
            }
        }
    }
}

/// How long something has run in which a place was called.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patience {
    begun: Instant,
    last: Instant,
    active: Span,
    gap: Span,
}

impl Patience {
    pub(super) fn new(now: Instant) -> Self {
        Self { begun: now, last: now, active: Span::ZERO, gap: MS }
    }

    /// When it began.
    pub(super) fn begun(&self) -> Instant {
        self.begun
    }

    /// The place is called.
    pub(super) fn called(&mut self, now: Instant) {
        let gap = (now - self.last).min(SELDOM);
        self.active += gap;
        self.gap = self.gap.max(gap);
        self.last = now;
    }

    /// It has been called for longer than `line`, and so many calls.
    pub(super) fn is_over(&self, line: Span, calls: u64) -> bool {
        self.active > line + self.gap * 2 * calls + MARGIN
    }
}

impl Bench240 {
    /// The judge of a case.
    #[must_use]
    pub fn new(facts: Facts) -> Self {
        let bad = facts.calm > Instant::START;
        let strict = if bad { facts.calm + RECOVERY } else { facts.calm };
        let senders = facts.senders.iter().map(|_| send::Job::default()).collect();
        let fetches = facts.senders.iter().map(|_| rk512::Job::default()).collect();
        Self {
            seen: Seen { next: 1, strict, ..Seen::default() },
            senders,
            fetches,
            reception: receive::Reception::default(),
            modem: modem::Modem::default(),
            synchron: modem::Synchron::default(),
            serve: serve::Serve::default(),
            facts,
        }
    }

    /// From here on the line is good, and both sides have forgotten what it was before.
    fn strict(&self) -> Instant {
        self.seen.strict
    }

    /// Fills the data blocks with what both sides know, and gives the numbers of the next telegrams.
    fn prepare(&mut self, cpu: &mut Cpu, fed: &[usize], first: bool) {
        for index in 0..self.facts.senders.len() {
            let sender = &self.facts.senders[index];
            if first {
                for (db, bytes) in &sender.blocks {
                    fill(cpu, *db, sender.abd, *bytes, self.facts.plain);
                }
            }
            if first || self.seen.empty || fed.contains(&index) {
                let letters = u32::from_be_bytes(crate::programs::partner::letters(self.seen.next));
                self.seen.next += 1;
                // The cell exists: the generator has given it.
                let _ = cpu.write(Cell::Area(ob1_model::Area::Memory, 8 * sender.next), Width::DWord, letters);
            }
        }
        self.seen.empty = false;
        if first && !self.facts.served.is_empty() {
            fill(cpu, served::FETCHED, 0, 400, false);
        }
    }
}

fn fill(cpu: &mut Cpu, db: u16, from: u32, bytes: u32, plain: bool) {
    for at in from..bytes {
        // A block that is not there is not filled.
        let _ = cpu.write(Cell::Db(db, 8 * at), Width::Byte, u32::from(pattern((at - from) as usize, plain)));
    }
}

/// The time in which a telegram of `bytes` certainly is on the line or has failed, by the parameters.
pub(super) fn line_time(facts: &Facts, bytes: u64, partner: &Partner240, since: Instant, good: bool) -> Span {
    let t = &facts.times;
    let own = t.char * (2 * bytes + 8);
    if !facts.protocol.acknowledges() {
        let stops = match partner {
            Partner240::Stream(stream, _) => {
                stream.stops.map_or(Span::ZERO, |(after, time)| (time + t.char * 4) * (bytes / after as u64 + 2))
            }
            _ => Span::ZERO,
        };
        return own + t.zna + stops;
    }
    // Each attempt: the STX repetitions [S0 L1627], the block and its acknowledgement [S0 L1631].
    let connect = (t.qvz + 40 * MS) * (u64::from(t.stx) + 1);
    let attempts = u64::from(t.dbl.max(1)) + 1;
    // A good partner on a good line answers the first; but both may have begun at once.
    let mine = if good { own + t.qvz * 2 + 40 * MS } else { (connect + own + t.qvz + 40 * MS) * attempts };
    // What the partner sends in between comes first where its priority is high, and each of its attempts takes a while.
    let theirs: Span = sent(partner)
        .iter()
        .filter(|sent| sent.begun != Instant::NEVER && sent.acknowledged.is_none_or(|at| at >= since))
        .map(|sent| t.char * (2 * sent.data.len() as u64 + 8) * 2 + t.qvz * 3 + t.zvz + 250 * MS)
        .fold(Span::ZERO, |sum, span| sum + span);
    mine + theirs + t.zna
}

/// What the partner has sent.
pub(super) fn sent(partner: &Partner240) -> &[Sent] {
    match partner {
        Partner240::Procedure(line, _) => &line.sent,
        Partner240::Rk512(rk, _) => &rk.line.sent,
        Partner240::Stream(stream, _) => &stream.sent,
    }
}

impl Judge<Partner240> for Bench240 {
    fn scan(&mut self, scan: &Scan<'_>, cpu: &mut Cpu, partner: &mut Partner240, verdict: &mut Verdict) {
        let stops = matches!(partner, Partner240::Stream(stream, _) if stream.stops.is_some());
        self.seen.unheard = stops && self.facts.calm > Instant::START;
        let mut fed = Vec::new();
        let first = self.seen.next == 1;
        if scan.state == OperatingState::Run {
            for call in scan.calls {
                let site = &scan.sites[call.site];
                let role = self.facts.roles[call.site];
                if !matches!(role, Role::Feed(_) | Role::Consume | Role::Receive | Role::Synchron) {
                    self.seen.called.resize(scan.sites.len(), None);
                    let last = self.seen.called[call.site].replace(scan.now);
                    if last.is_some_and(|last| scan.now - last > SELDOM) {
                        self.seen.back.push(scan.now);
                    }
                }
                match role {
                    Role::Feed(index) => {
                        fed.push(index);
                        if self.facts.roles.contains(&Role::Send(index)) {
                            send::fed(self, index, call, partner, verdict);
                        } else {
                            rk512::fed(self, index, call, verdict);
                        }
                    }
                    Role::Send(index) => send::called(self, index, call, site, partner, verdict),
                    Role::SendRk(index) | Role::Fetch(index) => {
                        rk512::called(self, index, call, site, (cpu, partner), verdict);
                    }
                    Role::Receive => receive::called(self, call, cpu, partner, verdict),
                    Role::Consume => {}
                    Role::Modem => modem::called(self, call, verdict),
                    Role::Synchron => modem::synchron(self, call, verdict),
                    Role::Serve => serve::called(self, call, verdict),
                }
            }
        }
        serve::look(self, scan.now, cpu, partner, verdict);
        if let Partner240::Stream(stream, _) = partner
            && stream.after_stop > AFTER_XOFF
            && scan.now > self.strict()
            // A CP that was reset in between has forgotten it.
            && !self.seen.broken(scan.now.saturating_sub(300 * MS), scan.now)
        {
            let text = format!("{} characters after the partner's XOFF [S0 L2007]", stream.after_stop);
            verdict.broken("xoff", scan.now, text);
        }
        self.prepare(cpu, &fed, first);
    }

    fn deed(&mut self, now: Instant, deed: &Deed) {
        match deed {
            Deed::Run => {
                self.seen.mends(now, MARGIN);
                self.seen.starts.push(now);
                self.seen.empty = true;
            }
            Deed::Stop | Deed::Line(LineFault::Gone) => self.seen.breaks(now, Instant::NEVER),
            Deed::Kill => {
                self.seen.breaks(now, now + RESTART);
                self.synchron.killed();
            }
            Deed::Line(LineFault::Back) => self.seen.mends(now, MARGIN),
            Deed::Line(_) | Deed::Write(..) | Deed::Partner(_) => {}
        }
    }

    fn end(&mut self, now: Instant, partner: &mut Partner240, verdict: &mut Verdict) {
        send::end(self, now, partner, verdict);
        receive::end(self, now, partner, verdict);
    }
}
