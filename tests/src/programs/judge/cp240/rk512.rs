//! FC 3 and FC 2.

use ob1_cpu::Cpu;
use ob1_time::{Instant, Span};

use super::{Bench240, Patience, line_time};
use crate::programs::cp240::{Partner240, Role};
use crate::programs::judge::Verdict;
use crate::programs::partner::rk512::{Order as Arrived, Rk512};
use crate::programs::partner::{number, telegram};
use crate::programs::record::Call;
use crate::programs::text::{Operand, Site};

/// Places of the parameters of FC 2 and FC 3 in a record [S0 L1149, L1205].
pub(super) const LANG: usize = 3;
pub(super) const ANZW: usize = 7;
pub(super) const PAFE: usize = 8;
/// The control bits begin here.
const BITS: usize = 11;
const RUNNING: u32 = 2;
const DONE: u32 = 4;
const ERROR: u32 = 8;
/// "In both cases the procedures will time out after a maximum period of 5s" [S0 L1678].
const REACTION: Span = Span::from_secs(5);
/// After an order without its reaction, or with one that is not valid, each of the next two waits so long before it
/// goes out: a reaction [S0 L1705-1711] has nothing that tells to which order it belongs, so that of the order before
/// must not be taken for theirs. The time is ours (docs/cp240-blocks.md).
const LATE: Span = Span::from_secs(2);
/// How such an order ends: initialised again [S0 L1297], no reaction, BWZ exceeded, an invalid reaction.
const WITHOUT_REACTION: [u32; 4] = [0x00, 0x07, 0x0A, 0x0C];
/// Numbers that the page for users has.
const NUMBERS: &[u32] = &[0, 7, 0x0A, 0x0C, 0x10, 0x12, 0x14, 0x16, 0x17, 0x2A, 0x32, 0x34, 0x36];

/// A job of FC 3 or FC 2.
#[derive(Debug, Default)]
pub(super) struct Job {
    number: u32,
    wanted: bool,
    order: Option<Order>,
    ended: usize,
    /// Orders that the CP had, in the order of their ends: when, and whether a reaction may still come.
    ends: Vec<(Instant, bool)>,
}

#[derive(Debug)]
struct Order {
    number: u32,
    given: Instant,
    site: usize,
    lang: u32,
    changed: bool,
    /// It may end with an error: bits of an order before a start, or not called for two seconds.
    excused: bool,
    pafe: bool,
    /// When it was released.
    ran: Option<Instant>,
    patience: Patience,
    /// Orders of the other block that had ended when it was given.
    ended: usize,
    late: bool,
}

/// The CP has started anew: it waits for the reaction to an order from before, as for one without its reaction.
pub(super) fn synchronised(judge: &mut Bench240, now: Instant) {
    if let Some(job) = judge.fetches.first_mut() {
        job.ends.push((now, true));
    }
}

/// The program gives an order.
pub(super) fn fed(judge: &mut Bench240, index: usize, call: &Call, verdict: &mut Verdict) {
    let job = &mut judge.fetches[index];
    // Its run bit was 0: after a start of the CPU an order may have been forgotten.
    if job.order.take().is_some_and(|order| order.ran.is_some()) {
        job.ends.push((call.at, true));
    }
    job.number = number(&call.after[0].to_be_bytes()).unwrap_or(0);
    job.wanted = true;
    verdict.given();
}

/// How long an order that runs since `ran` waits for the reaction to one of the two before it ([`LATE`]).
fn late(jobs: &[Job], ran: Instant) -> Span {
    let mut before: Vec<_> = jobs.iter().flat_map(|job| &job.ends).filter(|(at, _)| *at <= ran).collect();
    before.sort_by_key(|(at, _)| *at);
    let last = before.last().map_or(Instant::START, |(at, _)| *at);
    let owed = before.iter().rev().take(2).any(|(_, owed)| *owed);
    if owed { LATE.saturating_sub(ran - last) } else { Span::ZERO }
}

/// LANG: recorded, or as it stands in the text.
fn lang(site: &Site, values: &[u32]) -> u32 {
    match &site.operands[LANG] {
        Some(Operand::Fixed(text)) => text.parse().unwrap_or(0),
        _ => values[LANG],
    }
}

/// A call.
pub(super) fn called(
    judge: &mut Bench240,
    index: usize,
    call: &Call,
    site: &Site,
    (cpu, partner): (&Cpu, &Partner240),
    verdict: &mut Verdict,
) {
    let Partner240::Rk512(rk, _) = partner else { return };
    let (before, after, now) = (&call.before, &call.after, call.at);
    let anzw = after[ANZW];
    let lang = lang(site, after);
    let ready = anzw & (DONE | ERROR);
    if ready == DONE | ERROR || anzw & RUNNING != 0 && ready != 0 || anzw & 0xF1 != 0 {
        verdict.broken("rk-anzw", now, format!("ANZW {anzw:04X}h [S0 L1307]"));
    }
    if anzw & ERROR != 0 && !NUMBERS.contains(&(anzw >> 8)) {
        verdict.broken("rk-anzw", now, format!("ANZW {anzw:04X}h: no such error number [S0 L1295]"));
    }
    if after[PAFE] > 3 {
        verdict.broken("rk-pafe", now, format!("PAFE is {} [S0 L1193]", after[PAFE]));
    }
    let fetches = judge.facts.roles[call.site] == Role::Fetch(index);
    let ended = judge.fetches.iter().map(|job| job.ended).sum();
    let runs = (0..).zip(&judge.fetches).any(|(other, job)| other != index && job.order.is_some());
    let job = &mut judge.fetches[index];
    let wanted = std::mem::take(&mut job.wanted);
    if job.order.is_none() {
        job.order = Some(Order {
            number: job.number,
            given: now,
            site: call.site,
            lang,
            changed: !wanted,
            excused: before[ANZW] & RUNNING != 0 && before[BITS..BITS + 4].iter().any(|bit| *bit != 0),
            pafe: false,
            ran: None,
            patience: Patience::new(now),
            ended,
            late: false,
        });
    }
    let Some(order) = &mut job.order else { return };
    order.changed |= order.lang != lang || order.site != call.site;
    // Another has taken its turn (docs/cp240-blocks.md).
    order.excused |= now - order.patience.last >= super::HELD;
    order.patience.called(now);
    if judge.seen.last_break() >= order.patience.begun() {
        order.patience = Patience::new(now);
    }
    // Blocked by the order of the other block [S0 L1283]; but not by one after the other.
    if runs && order.ran.is_none() && ended - order.ended <= 1 {
        order.patience = Patience::new(now);
    }
    if after[PAFE] != 0 {
        order.pafe = true;
        order.patience = Patience::new(now);
        if anzw & DONE != 0 && order.ran.is_none() {
            let text =
                format!("order {}: PAFE {}, but ANZW {anzw:04X}h says done [S0 L1315]", order.number, after[PAFE]);
            verdict.broken("rk-pafe-anzw", now, text);
            job.order = None;
            return;
        }
    }
    // Bit 1 may also mean that it is blocked [S0 L1283]; "if the control bits are reset" it has not been released.
    if anzw & RUNNING != 0 && after[BITS..BITS + 4].iter().any(|bit| *bit != 0) {
        order.ran.get_or_insert(now);
    }
    if ready == 0 {
        let t = &judge.facts.times;
        let telegrams = u64::from(2 * order.lang.max(lang)) / 118 + 1;
        let good = order.given > judge.seen.strict && rk.is_good();
        let reaction = t.bwz.max(super::MARGIN).min(REACTION);
        let one = line_time(&judge.facts, 138, partner, order.given, good) + reaction;
        let wait = judge.seen.given_up(order.given, now);
        let attempts = if good { 1 } else { (u64::from(t.dbl) + 1) * 2 };
        let calls = u64::from(2 * order.lang.max(lang)) / 12 * 4 + 40;
        let (bound, patience, ran) = (one * telegrams * attempts + wait, order.patience, order.ran.unwrap_or(now));
        if order.late || !patience.is_over(bound, calls) {
            return;
        }
        let text = format!("order {} of {lang} words, given at {}: no end [S0 L1199]", order.number, order.given);
        let late = patience.is_over(bound + late(&judge.fetches, ran), calls);
        if let Some(order) = judge.fetches[index].order.as_mut().filter(|_| late) {
            order.late = true;
            verdict.broken("rk-live", now, text);
        }
        return;
    }
    // Bits that stand from the order before: it has not begun.
    if order.ran.is_none() && before[ANZW] == anzw && after[PAFE] != 0 {
        return;
    }
    let Some(order) = job.order.take() else { return };
    job.ended += 1;
    if order.ran.is_some() {
        job.ends.push((now, anzw & ERROR != 0 && WITHOUT_REACTION.contains(&(anzw >> 8))));
    }
    finished(judge, &order, index, (now, anzw), fetches, (cpu, rk), verdict);
}

/// The station's order as it came to the partner.
fn arrivals<'r>(rk: &'r Rk512, order: &Order, fetches: bool) -> Vec<&'r Arrived> {
    let since = rk.orders.iter().filter(|arrived| arrived.at >= order.given);
    since
        .filter(|arrived| match fetches {
            true => arrived.command == b'E',
            false => arrived.command == b'A' && number(&arrived.data) == Some(order.number),
        })
        .collect()
}

/// The manual's own gap: RK 512 does not number its telegrams. A reaction that comes late or twice may be taken for the
/// next one, and a telegram whose acknowledgement came late is there twice.
fn gap(rk: &Rk512, order: &Order, arrived: &[&Arrived]) -> bool {
    let reaction = |arrived: &Arrived| rk.line.sent.get(arrived.reaction);
    let stale = |earlier: &Arrived| {
        earlier.at < order.given
            && (earlier.unclear
                || reaction(earlier).is_some_and(|sent| sent.acknowledged.is_none_or(|at| at >= order.given)))
    };
    arrived.iter().any(|arrived| arrived.unclear) || rk.orders.iter().any(stale)
}

/// The CP has taken a reaction to an order before this one after it: a reaction tells by nothing to which order it
/// belongs [S0 L1705-1711], so the CP takes it for this one's.
fn is_overtaken(rk: &Rk512, order: &Arrived) -> bool {
    let reaction = |earlier: &Arrived| rk.line.sent.get(earlier.reaction).and_then(|sent| sent.acknowledged);
    rk.orders.iter().any(|earlier| earlier.at < order.at && reaction(earlier).is_some_and(|at| at >= order.at))
}

/// Its reaction was acknowledged in time.
fn is_clear(rk: &Rk512, arrived: &Arrived, bwz: Span) -> bool {
    let reaction = rk.line.sent.get(arrived.reaction).and_then(|sent| sent.acknowledged);
    !arrived.unclear && reaction.is_some_and(|at| at - arrived.at < bwz * 6 / 10)
}

fn finished(
    judge: &Bench240,
    order: &Order,
    index: usize,
    (now, anzw): (Instant, u32),
    fetches: bool,
    (cpu, rk): (&Cpu, &Rk512),
    verdict: &mut Verdict,
) {
    let facts = &judge.facts;
    let calm = order.given > judge.strict();
    let arrived = arrivals(rk, order, fetches);
    let label = format!("order {} of {} words, given at {}", order.number, order.lang, order.given);
    let broken = judge.seen.broken(order.given, now);
    // The number of an order needs two words.
    let possible = (2..=512).contains(&order.lang);
    let clear = arrived.iter().all(|arrived| is_clear(rk, arrived, facts.times.bwz));
    let reset = judge.seen.resets.iter().any(|at| order.ran.is_some_and(|ran| ran < *at));
    if anzw & ERROR != 0 {
        verdict.failed();
        let good = possible && calm && !broken && !order.changed && !order.excused && !order.pafe;
        let has_all = !fetches && arrived.iter().any(|arrived| arrived.done.is_some() && arrived.refused.is_none());
        if good && has_all && clear && !arrived.iter().any(|arrived| is_overtaken(rk, arrived)) {
            verdict.broken("rk-false-error", now, format!("{label}: ANZW {anzw:04X}h, the partner has all data"));
        } else if good && rk.is_good() && anzw >> 8 != 0x2A {
            verdict.broken("rk-no-reason", now, format!("{label}: ANZW {anzw:04X}h, with a good partner and line"));
        }
    } else {
        verdict.done();
        if reset {
            let text = format!("{label}: done, though the connection was initialised again: ANZW 0008h [S0 L1297]");
            verdict.broken("rk-reset", now, text);
        }
        if possible && !order.changed && !fetches {
            let expected = telegram(order.number, 2 * order.lang as usize, false);
            let there = arrived.iter().any(|arrived| arrived.data == expected);
            if calm && !there && !gap(rk, order, &arrived) {
                let text = format!("{label}: done, but the data did not arrive [S0 L1312]");
                verdict.broken("rk-false-done", now, text);
            }
        }
        if possible && !order.changed && fetches {
            fetched(judge, order, index, now, (cpu, rk), &label, verdict);
        }
    }
    if !fetches && calm && arrived.len() > 1 && clear && !order.changed {
        verdict.broken("rk-twice", now, format!("{label}: the partner got it {} times [S0 L1297]", arrived.len()));
    }
}

fn fetched(
    judge: &Bench240,
    order: &Order,
    index: usize,
    now: Instant,
    (cpu, rk): (&Cpu, &Rk512),
    label: &str,
    verdict: &mut Verdict,
) {
    let sender = &judge.facts.senders[index];
    let arrived = arrivals(rk, order, true);
    if gap(rk, order, &arrived) || order.given <= judge.strict() {
        return;
    }
    let first = judge.facts.roles.iter().position(|role| *role == Role::Fetch(index)).unwrap_or(0);
    let (db, _) = sender.blocks[(order.site - first).min(sender.blocks.len() - 1)];
    let from = sender.abd as usize;
    let data = cpu.data_block(db).and_then(|data| data.get(from..from + 2 * order.lang as usize)).unwrap_or_default();
    if !arrived.iter().any(|arrived| arrived.data == data) {
        let text = format!("{label}: done, but DB {db} has other data [S0 L1141]: {:02X?}", &data[..data.len().min(8)]);
        verdict.broken("rk-false-done", now, text);
    }
}
