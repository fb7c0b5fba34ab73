//! FC 0.

use ob1_time::{Instant, Span};

use super::{Bench240, HELD, Patience, RECOVERY, SELDOM, line_time};
use crate::programs::cp240::{Partner240, Protocol, Role};
use crate::programs::judge::Verdict;
use crate::programs::partner::{Manners, Taken, number, telegram};
use crate::programs::record::Call;
use crate::programs::text::Site;

/// Places of the parameters of FC 0 in a record [S0 L939].
pub(super) const ABD: usize = 2;
pub(super) const FRG: usize = 4;
pub(super) const FEHLER_KOM: usize = 10;
pub(super) const PAFE: usize = 11;
/// Behind the parameters: ANZ.
pub(super) const LENGTH: usize = 12;

/// What the telegram of another FC 0 may take.
const OTHERS: Span = Span::from_millis(1_500);
/// Bytes of the longest telegram. [S0 L1827]
const LONGEST: u64 = 1024;

/// A job of FC 0.
#[derive(Debug, Default)]
pub(super) struct Job {
    /// Number of the telegram that the program has given last.
    number: u32,
    order: Option<Order>,
    /// The longest ANZ, and the longest time between two calls.
    longest: u32,
    gap: Span,
    called: Option<Instant>,
    /// Orders that have ended, for the rule that nothing is taken twice.
    past: Vec<(u32, Instant)>,
}

/// An order: FRG is 1.
#[derive(Debug)]
struct Order {
    number: u32,
    given: Instant,
    site: usize,
    /// The least ANZ since then, and the most: the job that runs has that of one of its calls.
    anz: u32,
    most: u32,
    /// ANZ or the data block was changed while it ran.
    changed: bool,
    pafe: bool,
    /// It was not called for so long that FC 8 may have taken its turn.
    rested: bool,
    patience: Patience,
    late: bool,
}

/// The program gives an order.
pub(super) fn fed(judge: &mut Bench240, index: usize, call: &Call, partner: &Partner240, verdict: &mut Verdict) {
    // FRG was 0: an order that is still open has ended outside of FC 0, by FC 9 or a start.
    vanished(judge, index, call.at, call.after[1] == 1, partner, verdict);
    judge.senders[index].number = number(&call.after[0].to_be_bytes()).unwrap_or(0);
}

fn vanished(
    judge: &mut Bench240,
    index: usize,
    now: Instant,
    error: bool,
    partner: &Partner240,
    verdict: &mut Verdict,
) {
    let Some(order) = judge.senders[index].order.take() else { return };
    // A start of the CPU clears bit memory: the program begins again and knows of no order.
    if judge.seen.starts.iter().any(|at| *at >= order.given) {
        judge.senders[index].past.push((order.number, order.given));
        return;
    }
    ended(judge, index, &order, now, error, partner, verdict);
}

/// A call of FC 0.
pub(super) fn called(
    judge: &mut Bench240,
    index: usize,
    call: &Call,
    site: &Site,
    partner: &Partner240,
    verdict: &mut Verdict,
) {
    let (before, after) = (&call.before, &call.after);
    let now = call.at;
    let job = &mut judge.senders[index];
    let last = job.called.replace(now).unwrap_or(now);
    job.gap = job.gap.max((now - last).min(SELDOM));
    if before[FRG] == 0 {
        vanished(judge, index, now, before[FEHLER_KOM] == 1, partner, verdict);
        if before != after {
            verdict.broken("fc0-idle", now, format!("FRG is 0, but FC 0 changed something: {before:X?} {after:X?}"));
        }
        return;
    }
    let which = usize::from(call.site != first_site(judge, index));
    let (_, bytes) = judge.facts.senders[index].blocks[which.min(judge.facts.senders[index].blocks.len() - 1)];
    let anz = after[LENGTH];
    let expected = pafe(bytes, if before[ABD] > 0 { before[ABD] } else { judge.facts.senders[index].abd }, anz);
    judge.senders[index].longest = judge.senders[index].longest.max(anz);
    let others = others(judge, index, now, partner);
    let number = judge.senders[index].number;
    let new = judge.senders[index].order.is_none();
    if new {
        verdict.given();
    }
    let order = judge.senders[index].order.get_or_insert_with(|| Order {
        number,
        given: now,
        site: call.site,
        anz,
        most: anz,
        changed: false,
        pafe: false,
        rested: false,
        patience: Patience::new(now),
        late: false,
    });
    let _ = site;
    order.rested |= now - order.patience.last >= HELD && judge.facts.roles.contains(&Role::Modem);
    order.changed |= order.anz != anz || order.site != call.site;
    order.anz = order.anz.min(anz);
    order.most = order.most.max(anz);
    // While a job runs whose parameters were changed, the manual says nothing of PAFE.
    if after[PAFE] > 3 || !order.changed && (1..=1024).contains(&anz) && after[PAFE] != expected {
        let text = format!("PAFE is {}, not {expected}: DB of {bytes} bytes, ANZ {anz} [S0 L964]", after[PAFE]);
        verdict.broken("fc0-pafe", now, text);
    }
    order.patience.called(now);
    if after[PAFE] != 0 {
        // A stated reason stands; when it is gone the time begins.
        order.pafe = true;
        order.patience = Patience::new(now);
    }
    if judge.seen.last_break() >= order.patience.begun() {
        order.patience = Patience::new(now);
    }
    if after[FRG] == 1 {
        let good = order.given > judge.seen.strict && is_good(partner);
        let calls = calls(order.most);
        let line = line_time(&judge.facts, u64::from(order.most), partner, order.given, good);
        let unheard = judge.seen.unheard;
        if !unheard
            && order.patience.is_over(line + others + judge.seen.given_up(order.given, now), calls)
            && !order.late
        {
            order.late = true;
            let text =
                format!("order {} of {anz} bytes, given at {}: FRG stays 1 [S0 L960]", order.number, order.given);
            verdict.broken("fc0-live", now, text);
        }
        return;
    }
    if let Some(order) = judge.senders[index].order.take() {
        ended(judge, index, &order, now, after[FEHLER_KOM] == 1, partner, verdict);
    }
}

/// Calls in which a telegram is in the CP: 12 bytes each [S0 L1866], with the words of the handshake.
fn calls(bytes: u32) -> u64 {
    u64::from(bytes) / 12 * 4 + 16
}

/// Others send, too: each waits for its turn, also while the partner stops the telegram of another with XOFF, and while
/// one that is called seldom hands its telegram over, 12 bytes in a call [S0 L1866].
fn others(judge: &Bench240, index: usize, now: Instant, partner: &Partner240) -> Span {
    let facts = &judge.facts;
    if facts.senders.len() < 2 {
        return Span::ZERO;
    }
    let given = judge.senders[index].order.as_ref().map_or(now, |order| order.given);
    let good = given > judge.seen.strict && is_good(partner);
    let line = |bytes: u64| line_time(facts, bytes, partner, given, good);
    let turn = |job: &Job| line(u64::from(job.longest)) + job.gap * calls(job.longest);
    let before = judge.senders.iter().enumerate().filter(|(at, job)| *at != index && job.longest > 0);
    let turns = before.fold(Span::ZERO, |sum, (_, job)| sum + turn(job));
    let least = if matches!(partner, Partner240::Stream(..)) { OTHERS.max(line(LONGEST)) } else { OTHERS };
    least.max(turns)
}

fn first_site(judge: &Bench240, index: usize) -> usize {
    judge.facts.roles.iter().position(|role| *role == Role::Send(index)).unwrap_or(0)
}

/// 1: the block is not there, 2: it is too short [S0 L966-968].
fn pafe(bytes: u32, from: u32, len: u32) -> u32 {
    match bytes {
        0 => 1,
        _ if from + len > bytes.next_multiple_of(2) => 2,
        _ => 0,
    }
}

/// Whether this came whole to the partner, and how often in all.
fn arrived(partner: &Partner240, order: &Order, plain: bool, exact: bool) -> (bool, usize, bool) {
    let len = order.anz as usize;
    let expected = telegram(order.number, len, plain);
    let head = &expected[..4.min(len)];
    match partner {
        Partner240::Procedure(line, _) => {
            // Where DLE came late or twice, STX and NAK that crossed it stand before the telegram, and may cancel out
            // in the check character.
            let late = line.manners != Manners::GOOD;
            let has_head = |taken: &Taken| taken.data.windows(head.len().max(1)).any(|part| part == head);
            let comes = |taken: &Taken| {
                taken.data.starts_with(head) || late && taken.data.ends_with(&expected) || !exact && has_head(taken)
            };
            // "an XOR function over the entire data" [S0 L1647] does not see two characters that a bad line has taken
            // or changed alike: the partner acknowledges what is left.
            let check = |data: &[u8]| line.block(data).last().copied();
            let unseen = |taken: &Taken| !exact && line.checked && check(&taken.data) == check(&expected);
            let comes = |taken: &Taken| comes(taken) || unseen(taken);
            let mine = || line.took.iter().filter(|taken| taken.at >= order.given && comes(taken));
            let whole = mine().any(|taken| taken.data == expected || late || order.changed || !exact);
            (whole, mine().count(), mine().all(|taken| taken.told))
        }
        Partner240::Stream(stream, _) => {
            let from = stream.times.partition_point(|at| *at < order.given);
            let heard = &stream.heard[from.min(stream.heard.len())..];
            let find = |what: &[u8]| heard.windows(what.len().max(1)).filter(|window| *window == what).count();
            (find(if order.changed { head } else { &expected }) > 0, find(head), true)
        }
        Partner240::Rk512(..) => (true, 1, true),
    }
}

fn ended(
    judge: &mut Bench240,
    index: usize,
    order: &Order,
    now: Instant,
    error: bool,
    partner: &Partner240,
    verdict: &mut Verdict,
) {
    let facts = &judge.facts;
    let (whole, times, told) = arrived(partner, order, facts.plain, order.given > judge.strict());
    let calm = order.given > judge.strict();
    let broken = judge.seen.broken(order.given, now);
    let label = format!("order {} of {} bytes, given at {}", order.number, order.anz, order.given);
    // What a bad line does to telegrams without a check cannot be seen; letters need four bytes.
    // Without a check character a second STX that crosses a late DLE is data.
    let late = matches!(partner, Partner240::Procedure(line, _) if !line.checked && line.manners != Manners::GOOD);
    let exact = (calm || facts.protocol == Protocol::P3964R) && order.anz >= 4 && order.number > 0 && !late;
    if error {
        verdict.failed();
        let good = (1..=1024).contains(&order.anz) && calm && !broken && !order.changed && !order.pafe;
        let alone = facts.senders.len() == 1;
        if good && alone && exact && facts.protocol.acknowledges() && whole && told {
            verdict.broken("fc0-false-error", now, format!("{label}: an error, but the partner has acknowledged it"));
        } else if good && alone && !order.rested && is_good(partner) && !is_crossed(partner, order) {
            verdict.broken("fc0-no-reason", now, format!("{label}: an error, with a good partner and line"));
        }
    } else {
        verdict.done();
        if order.anz > 1024 {
            verdict.broken("fc0-false-done", now, format!("{label}: the send buffer has 1024 bytes [S0 L1823]"));
        } else if order.anz > 0 && exact && !whole && (calm || !is_taken_for(judge, order, partner)) {
            verdict.broken("fc0-false-done", now, format!("{label}: done, but it did not arrive whole [S0 L960]"));
        }
    }
    if exact && times > 1 && told && calm && is_good(partner) {
        verdict.broken("fc0-twice", now, format!("{label}: the partner got it {times} times [S0 L960]"));
    }
    judge.senders[index].past.push((order.number, order.given));
}

/// The partner has given up a telegram of its own: "after which a NAK is transmitted" [S0 L1633]. Where this NAK
/// crosses the STX of the CP, it counts as the answer to it [S0 L1631], and both sides need a while until they are at
/// rest.
fn is_crossed(partner: &Partner240, order: &Order) -> bool {
    let Partner240::Procedure(line, _) = partner else { return false };
    line.gave_up.is_some_and(|at| at.saturating_add(RECOVERY) > order.given)
}

/// On a bad line that was late, the partner has acknowledged an order before this one only now, and no DLE says which
/// telegram it means: the CP waits for "a character other than DLE" [S0 L1633]. Nor does it say whether it is for a
/// telegram or for STX [S0 L1631]; what the partner takes for one may be 02h in the rest of a telegram before, or this
/// one's check character, behind a NAK that was lost. Then it has agreed twice and does not have the telegram.
fn is_taken_for(judge: &Bench240, order: &Order, partner: &Partner240) -> bool {
    let Partner240::Procedure(line, _) = partner else { return false };
    if line.agreed.iter().filter(|at| **at >= order.given).count() > 1 {
        return true;
    }
    let is_before = |of: u32| judge.senders.iter().flat_map(|job| &job.past).any(|(number, _)| *number == of);
    let late = line.took.iter().filter(|taken| taken.at >= order.given);
    late.filter_map(|taken| number(&taken.data)).any(|of| of != order.number && is_before(of))
}

/// The partner does what it should.
pub(super) fn is_good(partner: &Partner240) -> bool {
    match partner {
        Partner240::Procedure(line, _) => line.manners == Manners::GOOD,
        Partner240::Rk512(rk, _) => rk.is_good(),
        Partner240::Stream(..) => true,
    }
}

/// The run ends: nothing that was given once came twice, whenever.
pub(super) fn end(judge: &mut Bench240, now: Instant, partner: &Partner240, verdict: &mut Verdict) {
    let Partner240::Procedure(line, _) = partner else { return };
    for (order, given) in judge.senders.iter().flat_map(|job| &job.past) {
        let mine: Vec<_> = line.took.iter().filter(|taken| number(&taken.data) == Some(*order)).collect();
        if mine.len() > 1 && is_good(partner) && *given > judge.strict() && *order > 0 {
            verdict.broken("fc0-twice", now, format!("order {order}, given at {given}: it came {} times", mine.len()));
        }
    }
}
