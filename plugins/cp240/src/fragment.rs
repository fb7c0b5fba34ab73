//! FC 11 ASCII_FRAGMENT: takes a telegram out of the CP in blocks of up to 12 bytes as they come
//! [S0 "ASCII_FRAGMENT"].
//!
//! The blocks are stored one after the other in `_DB` from `ABD` on; GEEM is the number of bytes stored so far. "When
//! the output EMFR is set, a new telegram has been read completely. The length of the read telegram is stored in ANZ."
//! [S0 L1099] With the protocol ASCII-fragmented the CP passes on a block before it knows the length of the telegram: a
//! bit of the count says that more follows (docs/cp240-registers.md). With other protocols the counts say this, as for
//! FC 1. (decision 20)

use ob1_sdk::{Abort, Block, Cx, Kind, Param};

use crate::module::Module;
use crate::pafe::Pafe;
use crate::reception::{Job, Turn, end, hand_over, keep, put, reception, turn};
use crate::registers::{AREA, BLOCK_BYTES, BROKEN_OFF, Count, MORE, rx_count};
use crate::state::CpState;
use crate::turn::{Key, Role};

/// What a call does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// Nothing: the CP or the program has to act.
    Wait,
    /// Store `len` bytes at `to`, then echo the count. `len` 0: the count only says that the telegram is complete.
    Take { to: u16, len: u16, count: u16 },
    /// The CP has seen the echo: echo 0, the next block may follow.
    Next,
    /// A count that belongs to no job: echo it.
    Skip(u16),
    /// Both sides at 0.
    Finish,
    /// The rest of the telegram is lost: the job ends with an error, and this word is echoed.
    Lost(u16),
    /// The job ends with an error, the echo returns to 0.
    Failed,
}

/// The meaning of the count word in `RX`.
enum Shown {
    Nothing,
    /// A block of the telegram; `last` if nothing follows it.
    Block {
        bytes: u16,
        last: bool,
    },
    /// The telegram is complete without further bytes.
    End,
    /// The rest of the telegram is lost.
    Broken,
}

impl Shown {
    fn of(rx: u16) -> Option<Self> {
        let (more, rest) = (rx & MORE != 0, rx & !MORE);
        let bytes = match rx_count(rest) {
            _ if rx == BROKEN_OFF => return Some(Self::Broken),
            Count::Bytes(bytes) if rx & AREA == 0 => bytes,
            _ => return None,
        };
        Some(match (bytes, more) {
            (0, false) => Self::Nothing,
            (0, true) => Self::End,
            (1..=BLOCK_BYTES, more) => Self::Block { bytes, last: !more },
            (_, true) => return None,
            (bytes, false) => Self::Block { bytes, last: false },
        })
    }
}

/// One step: the CP shows `rx`; while `emfr` is set, the next telegram is not accepted.
pub(crate) fn step(job: Job, rx: u16, emfr: bool) -> (Job, Step) {
    let Some(shown) = Shown::of(rx) else { return (job, Step::Wait) };
    if !job.empf_laeuft {
        return match shown {
            Shown::Block { .. } if emfr => (job, Step::Wait),
            Shown::Block { bytes, last } => taken(Job::default(), rx, bytes, last),
            // Belongs to a telegram whose job has failed.
            Shown::End | Shown::Broken => (job, Step::Skip(MORE)),
            Shown::Nothing => (job, Step::Wait),
        };
    }
    if rx != 0 && rx == job.anz_int {
        return (job, Step::Wait); // The CP has not seen it yet.
    }
    if job.letzter_block {
        return (job, Step::Finish);
    }
    match (job.anz_int, shown) {
        (0, Shown::Nothing) => (job, Step::Wait),
        (0, Shown::Block { bytes, last }) if bytes <= BLOCK_BYTES => taken(job, rx, bytes, last),
        (0, Shown::End) => taken(job, rx, 0, true),
        (0, Shown::Broken) => (job, Step::Lost(MORE)),
        (before, Shown::Nothing) if before & MORE != 0 => (Job { anz_int: 0, ..job }, Step::Next),
        // A telegram of known length: counts 30, 18, 6.
        (before, Shown::Block { bytes, last }) if before.checked_sub(BLOCK_BYTES) == Some(rx) => {
            taken(job, rx, bytes, last)
        }
        _ => (job, Step::Failed),
    }
}

fn taken(before: Job, count: u16, bytes: u16, last: bool) -> (Job, Step) {
    let len = bytes.min(BLOCK_BYTES);
    let job = Job {
        geem: before.geem.saturating_add(len),
        anz_int: count,
        empf_laeuft: true,
        letzter_block: last,
        fehler_empf: false,
    };
    (job, Step::Take { to: before.geem, len, count })
}

pub(crate) struct Fragment;

impl Block for Fragment {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = 11;
    const NAME: &'static str = "ASCII_FRAGMENT";
    const PARAMS: &'static [Param] = reception::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let pafe = run(cx)?;
        cx.set(reception::PAFE, pafe as u8)
    }
}

fn run(cx: &mut Cx<'_, CpState>) -> Result<Pafe, Abort> {
    let adr = cx.get(reception::ADR)?;
    let Some((module, words, block)) = Module::block(cx, adr)? else { return Ok(Pafe::Ok) };
    let mut job = Job::load(cx)?;
    let (db, abd) = (cx.get(reception::_DB)?, cx.get(reception::ABD)?);
    let key = Key::area(Role::Receive, db, abd);
    match turn(cx, &module, job, key, words)? {
        Turn::GoOn => {}
        Turn::No => return Ok(Pafe::Ok),
        // FC 9 has cleared the control bits in the middle of a telegram: nothing of it is left.
        Turn::Begin if job.geem != 0 => {
            job = Job { fehler_empf: true, ..Job::default() };
            job.store(cx)?;
        }
        Turn::Begin => {}
    }
    let emfr = cx.get(reception::EMFR)?;
    let (next, act) = step(job, words.rx, emfr);
    let echo = |cx: &mut Cx<'_, CpState>, word: u16| module.write(cx, 0, &word.to_be_bytes());
    match act {
        Step::Wait => {}
        Step::Take { to, len, count } => return take(cx, &module, key, next, to, &block[..usize::from(len)], count),
        Step::Next => {
            if echo(cx, 0)? {
                keep(cx, &module, next)?;
            }
        }
        Step::Skip(word) => {
            echo(cx, word)?;
        }
        Step::Finish => {
            if echo(cx, 0)? {
                end(cx, &module, false)?;
            }
        }
        Step::Lost(word) => {
            if echo(cx, word)? {
                end(cx, &module, true)?;
            }
        }
        Step::Failed => {
            if echo(cx, 0)? {
                end(cx, &module, true)?;
                module.state.reception.fail(words.rx, job.anz_int);
            }
        }
    }
    Ok(Pafe::Ok)
}

/// Stores a block after the previous ones, then echoes its count. A block that does not fit waits in the CP until it
/// fits (ours). With the last block the telegram is available to the program.
fn take(
    cx: &mut Cx<'_, CpState>,
    module: &Module<'_>,
    key: Key,
    job: Job,
    to: u16,
    block: &[u8],
    count: u16,
) -> Result<Pafe, Abort> {
    let (db, abd, now) = (cx.get(reception::_DB)?, cx.get(reception::ABD)?, cx.now());
    let begin = module.offset(cx, abd)? + u32::from(to);
    let stored = if block.is_empty() { Ok(()) } else { put(cx, db, begin, block)? };
    module.tell_pafe(cx, Fragment::NUMBER, db, stored.err().unwrap_or(Pafe::Ok))?;
    if let Err(pafe) = stored {
        return Ok(pafe);
    }
    if !module.write(cx, 0, &count.to_be_bytes())? {
        return Ok(Pafe::Ok);
    }
    if to == 0 {
        module.state.reception.take(key, &module.info, now);
    }
    keep(cx, module, job)?;
    if job.letzter_block {
        hand_over(cx, job.geem)?;
    }
    Ok(Pafe::Ok)
}
