//! FC 1 RECEIVE: the data reception from the CP [S0 "RECEIVE (FC 1)"].

use std::cell::Cell;

use ob1_sdk::{Abort, Area, Block, Cx, Kind, Param};

use crate::module::{Module, address, read};
use crate::pafe::Pafe;
use crate::reception::{Job, Reception, Turn, end, hand_over, keep, put, reception, turn};
use crate::registers::{
    AREA, BLOCK_BYTES, BROKEN_OFF, BlockBytes, COUNT_BITS, Count, MORE, OFFSET_BYTES, OUTSIDE, Words, rx_count,
};
use crate::state::CpState;
use crate::turn::{Key, Role};

/// What a call does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// Nothing: the CP or the program has to act.
    Wait,
    /// Store `len` bytes at `to`, then echo the count.
    Take { to: u16, len: u16, count: u16 },
    /// The changed area is not inside the data block: report this to the CP.
    Refuse,
    /// Both sides return to 0: the telegram is finished.
    Finish,
    /// The job ends with an error, the echo returns to 0.
    Failed,
}

impl Job {
    /// No job is running and the program has taken the last telegram.
    pub(crate) fn start(self, rx: u16) -> (Self, Step) {
        match rx_count(rx) {
            Count::Bytes(bytes) if bytes > 0 => Job { anz_int: rx, empf_laeuft: true, ..Job::default() }.take(rx),
            _ => (self, Step::Wait),
        }
    }

    /// A job is running, and the CP has not restarted since. While `emfr` is set, nothing is stored.
    pub(crate) fn go_on(self, rx: u16, emfr: bool) -> (Self, Step) {
        let Some(rest) = self.rest() else { return (self, Step::Failed) };
        let Count::Bytes(count) = rx_count(rx) else { return (self, Step::Wait) };
        let same_kind = (rx ^ self.anz_int) & AREA == 0;
        if self.fehler_empf {
            // Refused: wait until the CP has seen it.
            return (self, if rx == self.anz_int { Step::Wait } else { Step::Finish });
        }
        if self.letzter_block {
            // The telegram is complete; the CP answers the last echo with 0 [S0 L1872].
            let last = ((self.anz_int & !AREA) - 1) % BLOCK_BYTES + 1;
            return (self, if same_kind && count == last { Step::Wait } else { Step::Finish });
        }
        if same_kind && count == rest {
            return if emfr { (self, Step::Wait) } else { self.take(rx) };
        }
        // The CP still shows the count of the previous block.
        let before = same_kind && self.geem > 0 && count == rest + BLOCK_BYTES;
        (self, if before { Step::Wait } else { Step::Failed })
    }

    /// Blocks with the counts 18, 6 are stored, then echoed [S0 L1864-L1876].
    fn take(self, word: u16) -> (Self, Step) {
        let count = word & !AREA;
        let len = count.min(BLOCK_BYTES);
        let job = Job { geem: self.geem + len, letzter_block: count <= BLOCK_BYTES, ..self };
        (job, Step::Take { to: self.geem, len, count: word })
    }

    /// "Writing accesses of the master should not be outside of the reception area otherwise the RECEIVE block
    /// announces a range error." [S0 L2624]
    fn refuse(self) -> (Self, Step) {
        (Job { geem: self.bytes(), letzter_block: true, fehler_empf: true, ..self }, Step::Refuse)
    }

    /// Length of the telegram including the offset before it.
    fn bytes(self) -> u16 {
        self.anz_int & !AREA
    }

    /// Bytes of the offset before the data: only a changed area has one.
    fn offset_bytes(self) -> u16 {
        if self.anz_int & AREA == 0 { 0 } else { OFFSET_BYTES }
    }

    /// Bytes not stored yet; `None` if the values of GEEM and ANZ_INT are impossible.
    fn rest(self) -> Option<u16> {
        let Count::Bytes(bytes) = rx_count(self.anz_int) else { return None };
        let rest = bytes.checked_sub(self.geem)?;
        (bytes > 0 && self.letzter_block == (rest == 0)).then_some(rest)
    }
}

ob1_sdk::state! {
    /// For how many CPs of the station an idle call has something to do: while there is none, it does not look.
    #[derive(Debug, Default)]
    pub(crate) struct Standing {
        modules: Cell<u16>,
    }
}

impl Standing {
    /// After a call for this CP.
    fn note(&self, state: &Reception) {
        let stands = state.outside.get() != 0 || state.is_discarding();
        match (state.stands.replace(stands), stands) {
            (false, true) => self.modules.set(self.modules.get().saturating_add(1)),
            (true, false) => self.modules.set(self.modules.get().saturating_sub(1)),
            _ => {}
        }
    }
}

pub(crate) struct Receive;

impl Block for Receive {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = 1;
    const NAME: &'static str = "RECEIVE";
    const PARAMS: &'static [Param] = reception::PARAMS;
    type State = Standing;
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, standing: &Standing) -> Result<(), Abort> {
        let pafe = run(cx, standing)?;
        cx.set(reception::PAFE, pafe as u8)
    }
}

fn run(cx: &mut Cx<'_, CpState>, standing: &Standing) -> Result<Pafe, Abort> {
    let adr = cx.get(reception::ADR)?;
    // An idle call ends here: no telegram is offered, no job runs.
    let mut rx = [0; 2];
    let is_idle = !read(cx, address(adr), &mut rx)? || (rx == [0; 2] && !cx.get(reception::EMPF_LAEUFT)?);
    if is_idle && standing.modules.get() == 0 {
        return Ok(Pafe::Ok);
    }
    let Some((module, words, block)) = Module::block(cx, adr)? else { return Ok(Pafe::Ok) };
    let state = &module.state.reception;
    let pafe = match take(cx, &module, words, &block)? {
        Pafe::Ok if state.outside.get() != 0 => range_error(cx, &module)?,
        pafe => pafe,
    };
    standing.note(state);
    Ok(pafe)
}

/// Whether the last changed area still does not fit: "after elimination of the error cause, the byte is set back to 0"
/// [S0 L964].
fn range_error(cx: &mut Cx<'_, CpState>, module: &Module<'_>) -> Result<Pafe, Abort> {
    let state = &module.state.reception;
    let (db, abd) = (cx.get(reception::_DB)?, cx.get(reception::ABD)?);
    let begin = module.offset(cx, abd)? + u32::from(state.offset.get());
    let pafe = Pafe::check(cx.len(Area::Db(db)), begin, state.outside.get())?;
    if pafe == Pafe::Ok {
        state.outside.set(0);
    }
    Ok(pafe)
}

fn take(cx: &mut Cx<'_, CpState>, module: &Module<'_>, mut words: Words, block: &BlockBytes) -> Result<Pafe, Abort> {
    let (emfr, job) = (cx.get(reception::EMFR)?, Job::load(cx)?);
    let (db, abd) = (cx.get(reception::_DB)?, cx.get(reception::ABD)?);
    let key = Key::area(Role::Receive, db, abd);
    match turn(cx, module, job, key, words)? {
        Turn::No => return Ok(Pafe::Ok),
        turn => {
            if words.rx & !COUNT_BITS == MORE {
                // ASCII-fragmented without FC 11: each block is one telegram here, and the word after the last block is
                // only acknowledged.
                if matches!(words.rx, MORE | BROKEN_OFF) {
                    return module.write(cx, 0, &MORE.to_be_bytes()).map(|_| Pafe::Ok);
                }
                words.rx &= COUNT_BITS;
            }
            if turn == Turn::GoOn {
                let (next, step) = job.go_on(words.rx, emfr);
                return act(cx, module, next, step, words.rx, block);
            }
        }
    }
    // "Not until setting back EMFR in the user application new data can be received." [S0 "RECEIVE (FC 1)"]
    if emfr {
        return Ok(Pafe::Ok);
    }
    let (next, step) = job.start(words.rx);
    if step == Step::Wait {
        return Ok(Pafe::Ok);
    }
    let (state, now) = (&module.state.reception, cx.now());
    let db_len = cx.len(Area::Db(db));
    let is_area = next.offset_bytes() > 0;
    state.outside.set(0);
    state.offset.set(if is_area { u16::from_be_bytes([block[0], block[1]]) } else { 0 });
    let begin = module.offset(cx, abd)? + u32::from(state.offset.get());
    let bytes = next.bytes().saturating_sub(next.offset_bytes());
    let pafe = Pafe::check(db_len, begin, bytes)?;
    module.tell_pafe(cx, Receive::NUMBER, db, pafe)?;
    if pafe == Pafe::Short && is_area {
        state.outside.set(bytes);
        state.take(key, &module.info, now);
        let (next, step) = next.refuse();
        return act(cx, module, next, step, words.rx, block).map(|_| pafe);
    }
    // A telegram that does not fit waits in the CP until it fits (ours).
    if pafe != Pafe::Ok {
        return Ok(pafe);
    }
    state.take(key, &module.info, now);
    act(cx, module, next, step, words.rx, block)
}

fn act(
    cx: &mut Cx<'_, CpState>,
    module: &Module<'_>,
    job: Job,
    step: Step,
    rx: u16,
    block: &[u8],
) -> Result<Pafe, Abort> {
    match step {
        Step::Wait => {}
        Step::Take { to, len, count } => {
            let abd = cx.get(reception::ABD)?;
            let head = job.offset_bytes();
            let bytes = block.get(usize::from(head.saturating_sub(to))..usize::from(len)).unwrap_or(&[]);
            let abd = module.offset(cx, abd)?;
            let at = abd + u32::from(module.state.reception.offset.get()) + u32::from(to.saturating_sub(head));
            let db = cx.get(reception::_DB)?;
            if let Err(pafe) = put(cx, db, at, bytes)? {
                return Ok(pafe);
            }
            if !module.write(cx, 0, &count.to_be_bytes())? {
                return Ok(Pafe::Ok);
            }
            keep(cx, module, job)?;
            if job.letzter_block {
                hand_over(cx, job.bytes().saturating_sub(head))?;
            }
        }
        Step::Refuse => {
            if module.write(cx, 0, &OUTSIDE.to_be_bytes())? {
                keep(cx, module, job)?;
            }
        }
        Step::Finish => {
            if module.write(cx, 0, &[0, 0])? {
                end(cx, module, job.fehler_empf)?;
            }
        }
        Step::Failed => {
            if module.write(cx, 0, &[0, 0])? {
                end(cx, module, true)?;
                module.state.reception.fail(rx, job.anz_int);
            }
        }
    }
    Ok(Pafe::Ok)
}
