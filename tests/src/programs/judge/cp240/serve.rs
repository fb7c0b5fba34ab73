//! FC 4.

use ob1_cpu::Cpu;
use ob1_time::{Instant, Span};

use super::{Bench240, Patience};
use crate::programs::cp240::{Partner240, serve as served};
use crate::programs::judge::Verdict;
use crate::programs::partner::{Manners, pattern};
use crate::programs::record::Call;

/// Places of the parameters of FC 4 in a record [S0 L1243].
pub(super) const ANZW: usize = 1;
pub(super) const PAFE: usize = 2;
const READY: u32 = 0xC;
/// Error number for a telegram whose form is wrong (docs/cp240-blocks.md).
const FORM: u8 = 0x34;
/// How long the CP takes at most to refuse one on a good line: its STX may have to wait for a telegram.
const REFUSED: Span = Span::from_millis(200);

/// What FC 4 does.
#[derive(Debug, Default)]
pub(super) struct Serve {
    last: Option<Instant>,
    /// Longest time without a call, up to now.
    gap: Span,
    seen: usize,
    patience: Option<Patience>,
}

/// A call of FC 4.
pub(super) fn called(judge: &mut Bench240, call: &Call, verdict: &mut Verdict) {
    let (before, after, now) = (&call.before, &call.after, call.at);
    judge.serve.gap = judge.serve.gap.max(judge.serve.last.map_or(Span::ZERO, |last| now - last));
    let previous = judge.serve.last.replace(now).unwrap_or(now);
    if after[PAFE] > 3 {
        verdict.broken("fc4-pafe", now, format!("PAFE is {} [S0 L1262]", after[PAFE]));
    }
    // "after elimination of the error cause, the byte is set back": the order that was wrong is the last one, still.
    let same = before[ANZW] & 2 != 0 || before[ANZW] == after[ANZW];
    let stands = judge.seen.last_break().saturating_add(super::MARGIN) < previous;
    if before[PAFE] != 0 && after[PAFE] == 0 && same && stands {
        verdict.broken("fc4-pafe", now, format!("PAFE {} is taken back, its cause stands [S0 L1262]", before[PAFE]));
    }
    if after[ANZW] & READY == READY || after[ANZW] & 2 != 0 && after[ANZW] & READY != 0 {
        verdict.broken("rk-anzw", now, format!("FC 4: ANZW {:04X}h [S0 L1307]", after[ANZW]));
    }
    if let Some(patience) = &mut judge.serve.patience {
        patience.called(now);
    }
}

/// Looks at the partner's orders after a scan.
pub(super) fn look(judge: &mut Bench240, now: Instant, cpu: &Cpu, partner: &Partner240, verdict: &mut Verdict) {
    let Partner240::Rk512(rk, _) = partner else { return };
    while let Some(request) = rk.requests.get(judge.serve.seen) {
        let Some((error, data, at)) = &request.reaction else { break };
        judge.serve.seen += 1;
        let telegram = &request.telegram;
        let db = u16::from(telegram[4]);
        let bytes = 2 * usize::from(telegram[7]);
        let fits = db == served::FETCHED
            || judge.facts.served.iter().any(|(number, len)| *number == db && *len as usize >= bytes);
        let calm = request.given > judge.strict() && !judge.seen.broken(request.given, *at);
        // Where its acknowledgement was late, a reaction came twice, and counts for the next order.
        let calm = calm && rk.line.manners == Manners::GOOD;
        let label = format!("the partner's order {:02X?}, given at {}", &telegram[..10], request.given);
        match error {
            0 if telegram[2] == b'E' => {
                let expected: Vec<u8> = (0..bytes).map(|at| pattern(at, false)).collect();
                if *data != expected && calm {
                    verdict.broken("fc4-false-done", now, format!("{label}: {:02X?} is not what it asked for", data));
                }
            }
            0 => {
                let there = cpu.data_block(db).is_some_and(|data| data.starts_with(&telegram[10..]));
                // The next order may have come meanwhile.
                let last = judge.serve.seen == rk.requests.len();
                if calm && (!fits || !there && last) {
                    verdict.broken("fc4-false-done", now, format!("{label}: its data are not in DB {db} [S0 L1241]"));
                }
            }
            error => {
                // "These FC serves for to deal with the FETCH and SEND orders" [S0 L1241]: where it is not called,
                // nobody does, and the CP refuses with 2Ah.
                let served = judge.serve.last.is_some_and(|last| judge.serve.gap.max(now - last) < super::SELDOM);
                // A reaction has 4 bytes [S0 L1705-1711]. One of the partner's that has fewer is refused by the CP, in
                // place of the order that it has from it: there is one reaction for both.
                let garbled = *error == FORM && rk.has_garbled(request.given.saturating_sub(REFUSED), *at);
                if fits && calm && served && !garbled {
                    verdict.broken("fc4-refused", now, format!("{label}: refused with {error:02X}h"));
                }
            }
        }
    }
}
