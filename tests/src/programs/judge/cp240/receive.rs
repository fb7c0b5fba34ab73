//! FC 1 and FC 11.

use ob1_cpu::Cpu;
use ob1_time::Instant;

use super::{Bench240, sent};
use crate::programs::cp240::{Partner240, Protocol};
use crate::programs::judge::Verdict;
use crate::programs::record::Call;

/// Places of the parameters of FC 1 in a record [S0 L985].
pub(super) const ANZ: usize = 3;
pub(super) const EMFR: usize = 4;
pub(super) const PAFE: usize = 10;
/// Calls that a block of 12 bytes may take, with the words of the handshake [S0 L1866].
const CALLS_A_BLOCK: u64 = 5;

/// What has come.
#[derive(Debug, Default)]
pub(super) struct Reception {
    /// How often each telegram of the partner was given to the program.
    given: Vec<u32>,
    last: Option<usize>,
    /// `ready` when the last one was given.
    given_at: u64,
    /// Calls that could take something: EMFR 0, PAFE 0.
    ready: u64,
    /// For each telegram of the partner: the calls when its acknowledgement was seen.
    acknowledged: Vec<Option<u64>>,
    /// PAFE of the last call, and when that was.
    pafe: u32,
    called: Option<Instant>,
}

/// A call.
pub(super) fn called(judge: &mut Bench240, call: &Call, cpu: &Cpu, partner: &Partner240, verdict: &mut Verdict) {
    let (before, after) = (&call.before, &call.after);
    let now = call.at;
    let facts = &judge.facts;
    let (db, bytes) = facts.receiver.block;
    let telegrams = sent(partner);
    let reception = &mut judge.reception;
    reception.given.resize(telegrams.len(), 0);
    reception.acknowledged.resize(telegrams.len(), None);
    for (seen, sent) in reception.acknowledged.iter_mut().zip(telegrams) {
        if seen.is_none() && sent.acknowledged.is_some_and(|at| at <= now) {
            *seen = Some(reception.ready);
        }
    }
    if after[PAFE] > 3 || bytes > 0 && after[PAFE] == 1 {
        verdict.broken("fc1-pafe", now, format!("PAFE is {}: DB {db} of {bytes} bytes [S0 L1001]", after[PAFE]));
    }
    // The cause has not gone: the block is as it was, and the telegram stays in the CP, unless it was reset since then.
    let previous = reception.called.replace(now).unwrap_or(now);
    let since = judge.seen.last_break().saturating_add(super::MARGIN) > previous;
    if before[PAFE] == 2 && after[PAFE] == 0 && reception.pafe == 2 && after[EMFR] == 0 && !since {
        verdict.broken("fc1-pafe", now, format!("PAFE 2 is taken back, DB {db} still has {bytes} bytes [S0 L999]"));
    }
    reception.pafe = after[PAFE];
    if before[EMFR] == 1 {
        // "Not until setting back EMFR in the user application new data can be received" [S0 L997].
        if after[EMFR] == 0 || after[ANZ] != before[ANZ] {
            verdict.broken("fc1-hold", now, format!("EMFR was 1, and FC 1 changed it or ANZ: {before:X?} {after:X?}"));
        }
        return;
    }
    reception.ready += u64::from(after[PAFE] == 0);
    if after[EMFR] == 0 {
        return;
    }
    verdict.received();
    reception.given_at = reception.ready;
    let from = facts.receiver.abd as usize;
    let len = after[ANZ] as usize;
    let Some(data) = cpu.data_block(db).and_then(|data| data.get(from..from + len)) else {
        verdict.broken("fc1-whole", now, format!("EMFR with {len} bytes, DB {db} has {bytes} [S0 L968]"));
        return;
    };
    if facts.echo {
        return;
    }
    let found = telegrams.iter().rposition(|sent| sent.data == data && sent.begun <= now);
    let Some(found) = found else {
        let noisy = now <= judge.seen.strict || is_spoilt(judge, data, partner);
        // Without a check character the rest of a telegram whose beginning was broken off cannot be told from a
        // telegram: with 3964 any STX in it begins one. And each further STX that crosses a late DLE is data.
        let double = facts.protocol == Protocol::P3964
            && telegrams.iter().any(|sent| {
                data.strip_suffix(&sent.data[..])
                    .is_some_and(|stx| !stx.is_empty() && stx.iter().all(|byte| *byte == 2))
            });
        // Nor with 3964R where the check character of the rest happens to be that of the whole. [S0 L1637, L1647]
        let torn = telegrams.iter().any(|sent| {
            let end = sent.acknowledged.unwrap_or(now);
            sent.data.windows(len.max(1)).any(|part| part == data)
                && judge.seen.broken(sent.begun, end)
                && is_check_equal(partner, data, &sent.data)
        });
        if !noisy && !torn && !double {
            let text = format!("{len} bytes that the partner did not send: {:02X?} [S0 L981]", &data[..len.min(24)]);
            verdict.broken("fc1-whole", now, text);
        }
        return;
    };
    reception.given[found] += 1;
    if reception.given[found] > telegrams[found].attempts.max(1) {
        verdict.broken("fc1-twice", now, format!("telegram {found} came {} times", reception.given[found]));
    }
    if reception.last.is_some_and(|last| last > found) {
        verdict.broken("fc1-order", now, format!("telegram {found} came after a later one"));
    }
    reception.last = reception.last.max(Some(found));
}

/// A telegram came on the bad line and was read later. "An XOR function over the entire data" [S0 L1647] does not see
/// 00h that a bad line has doubled, or two equal characters: the CP acknowledges what is left.
fn is_spoilt(judge: &Bench240, data: &[u8], partner: &Partner240) -> bool {
    let from = judge.reception.last.unwrap_or(0);
    let mut telegrams = sent(partner).iter().skip(from);
    telegrams.any(|sent| sent.begun <= judge.seen.strict && is_check_equal(partner, data, &sent.data))
}

/// The receiver cannot tell these apart by their check characters.
fn is_check_equal(partner: &Partner240, one: &[u8], other: &[u8]) -> bool {
    match partner {
        Partner240::Procedure(line, _) if line.checked => line.block(one).last() == line.block(other).last(),
        _ => true,
    }
}

/// The run ends: what the CP has acknowledged was given to the program, if it was called often enough since then.
pub(super) fn end(judge: &mut Bench240, now: Instant, partner: &Partner240, verdict: &mut Verdict) {
    let telegrams = sent(partner);
    let facts = &judge.facts;
    let procedure = matches!(facts.protocol, Protocol::P3964 | Protocol::P3964R);
    if !procedure || facts.receiver.calls == 0 || facts.receiver.block.1 == 0 {
        return;
    }
    let mut bytes = 0;
    for (index, seen) in judge.reception.acknowledged.iter().enumerate() {
        let sent = &telegrams[index];
        let Some(seen) = seen else { continue };
        if judge.reception.given[index] > 0 {
            continue;
        }
        bytes += sent.data.len() as u64 / 12 + 2;
        let fits = sent.data.len() as u64 + u64::from(facts.receiver.abd) <= u64::from(facts.receiver.block.1);
        // Those before it came first, as long as none behind it was given.
        let behind = judge.reception.last.is_some_and(|last| last > index);
        let since = if behind { *seen } else { (*seen).max(judge.reception.given_at) };
        let calls = judge.reception.ready - since;
        if !fits {
            // It stays in the CP, and all others behind it.
            return;
        }
        if calls > CALLS_A_BLOCK * bytes + 40 && !judge.seen.broken(sent.begun, now) && sent.begun > judge.seen.strict {
            let text =
                format!("telegram {index}, acknowledged at {:?}, was never given to the program", sent.acknowledged);
            verdict.broken("fc1-lost", now, text);
        }
    }
}
