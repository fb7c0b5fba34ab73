//! FC 0 SEND: the data output from the CPU to the CP [S0 "SEND (FC 0)"].

use ob1_sdk::{Abort, Area, Block, Cx, Kind, Param, interface};

use crate::module::Module;
use crate::pafe::Pafe;
use crate::registers::{AREA, BLOCK_BYTES, Count, FAILED, TELEGRAM_MAX, TX, Words, tx_count};
use crate::state::CpState;
use crate::turn::{Key, Role};
use crate::tx::{Handed, acquire};

interface! {
    /// The parameters, in the manual's order.
    pub(crate) mod send {
        /// Logical address of the CP.
        in     ADR: Int;
        /// Data block with the telegram.
        in     _DB: BlockDb;
        /// First byte of the telegram in it. The tables say "data word", the examples count bytes; the block counts
        /// bytes (ours).
        in     ABD | ADB: Word;
        /// Bytes to send; `OR 4000h` for the Modbus output area [S0 L2311].
        in     ANZ: Word;
        /// 1 starts the transfer; the block sets it to 0 when the transfer has ended.
        in_out FRG: Bool;
        /// Bytes the CP has taken.
        in_out GESE: Word;
        /// ANZ of the running job.
        in_out ANZ_INT: Word;
        /// The CP has the whole telegram and transmits it.
        in_out ENDE_KOMM | ENDE_KOM: Bool;
        /// The last block is in the registers.
        in_out LETZTER_BLOCK: Bool;
        /// A job is running.
        in_out SENDEN_LAEUFT: Bool;
        /// The last job failed; stays until the next one starts.
        in_out FEHLER_KOM | FEHL_KOM: Bool;
        /// 1 data block not present, 2 too short, 3 number outside the valid range; returns to 0 automatically.
        out    PAFE: Byte;
    }
}

/// The state of a job between two calls, as the program keeps it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Job {
    pub(crate) gese: u16,
    pub(crate) anz_int: u16,
    pub(crate) ende_kom: bool,
    pub(crate) letzter_block: bool,
    pub(crate) senden_laeuft: bool,
    pub(crate) fehler_kom: bool,
}

/// What a call does with the registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// Nothing: the CP has to act.
    Wait,
    /// Write `len` bytes of the telegram, beginning at byte `from`, and the count word.
    Block { from: u16, len: u16, word: u16 },
    /// Write only the count word.
    Word(u16),
    /// The telegram has been acknowledged: reset FRG.
    Done,
    /// The job has failed: reset FRG; the word, if any, withdraws the order.
    Failed(Option<u16>),
}

/// The reason why no job can start with this ANZ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// 0 bytes: there is nothing to do, the job ends without error.
    Empty,
    /// More than the CP's buffer holds: it would refuse with 17h.
    TooLong,
}

/// Bytes of a telegram, from ANZ or ANZ_INT without the option bit.
pub(crate) fn telegram_bytes(anz: u16) -> Result<u16, Refusal> {
    match anz & !AREA {
        0 => Err(Refusal::Empty),
        bytes if bytes <= TELEGRAM_MAX => Ok(bytes),
        _ => Err(Refusal::TooLong),
    }
}

impl Job {
    /// FRG is set, no job is running and `TX` is free: CP and CPU both start from 0.
    pub(crate) fn start(anz: u16) -> (Self, Step) {
        Job { anz_int: anz, senden_laeuft: true, ..Job::default() }.next_block()
    }

    /// The control words of the job: they must be those of the claim.
    fn progress(self) -> u32 {
        u32::from(self.gese) << 16 | u32::from(self.anz_int)
    }

    /// A job is running, and the CP has not restarted since.
    pub(crate) fn go_on(self, words: Words) -> (Self, Step) {
        if words.not_ready() {
            return (self, Step::Failed(None));
        }
        let Some((posted, last)) = self.counts() else { return (self, Step::Failed(Some(0))) };
        match tx_count(words.tx_echo) {
            Count::Failed(_) => (Job { fehler_kom: true, ..self }, Step::Word(FAILED)),
            Count::Bytes(0) if self.fehler_kom => (self, Step::Failed(Some(0))),
            Count::Bytes(_) if self.fehler_kom => (self, Step::Wait),
            Count::Bytes(0) if self.ende_kom => (self, Step::Done),
            Count::Bytes(echo) if self.ende_kom => self.wait_or_fail(echo == last),
            Count::Bytes(echo) if echo == posted => {
                let gese = self.gese + posted.min(BLOCK_BYTES);
                Job { gese, ..self }.next_block()
            }
            // The CP still shows the echo of the previous block, or 0 before the first.
            Count::Bytes(echo) => {
                let before = if self.gese == 0 { 0 } else { posted + BLOCK_BYTES };
                self.wait_or_fail(echo == before)
            }
            Count::Line { .. } | Count::System | Count::Nonsense => (self, Step::Wait),
        }
    }

    fn wait_or_fail(self, expected: bool) -> (Self, Step) {
        (self, if expected { Step::Wait } else { Step::Failed(Some(0)) })
    }

    /// The count in `TX` and the count of the last block; `None` if the values of GESE and ANZ_INT are impossible.
    fn counts(self) -> Option<(u16, u16)> {
        let bytes = telegram_bytes(self.anz_int).ok()?;
        let posted = bytes.checked_sub(self.gese)?;
        let last = (bytes - 1) % BLOCK_BYTES + 1;
        (self.gese.is_multiple_of(BLOCK_BYTES) || posted == 0).then_some((posted, last))
    }

    /// Counts 30, 18, 6, then 0: the telegram is complete [S0 L1846-L1862].
    fn next_block(self) -> (Self, Step) {
        let rest = (self.anz_int & !AREA).saturating_sub(self.gese);
        if rest == 0 {
            return (Job { ende_kom: true, ..self }, Step::Word(0));
        }
        let (len, option) = (rest.min(BLOCK_BYTES), self.anz_int & AREA);
        (Job { letzter_block: rest <= BLOCK_BYTES, ..self }, Step::Block { from: self.gese, len, word: rest | option })
    }
}

pub(crate) struct Send;

impl Block for Send {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = 0;
    const NAME: &'static str = "SEND";
    const PARAMS: &'static [Param] = send::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        // "When FRG = 0 at call of the block, it is left immediately!" [S0 L962]: PAFE stays what it was.
        if !cx.get(send::FRG)? {
            return Ok(());
        }
        let pafe = run(cx)?;
        cx.set(send::PAFE, pafe as u8)
    }
}

fn run(cx: &mut Cx<'_, CpState>) -> Result<Pafe, Abort> {
    let adr = cx.get(send::ADR)?;
    let Some((module, words)) = Module::words(cx, adr)? else { return Ok(Pafe::Ok) };
    let (job, now) = (load(cx)?, cx.now());
    let (db, abd) = (cx.get(send::_DB)?, cx.get(send::ABD)?);
    let key = Key::area(Role::Send, db, abd);
    module.state.has_own_bits.set(true);
    if job.senden_laeuft {
        let claim = &module.state.tx.turn.claim;
        if !claim.continues(key, job.progress(), &module.info, now) || module.is_closed(words) {
            if let Some(failed) = module.state.tx.outcome(key, job.progress()) {
                return end(cx, failed).map(|()| Pafe::Ok);
            }
            return lost(cx, &module, key, words).map(|()| Pafe::Ok);
        }
        let (next, step) = job.go_on(words);
        return act(cx, &module, job, next, step);
    }
    let anz = cx.get(send::ANZ)?;
    let bytes = match telegram_bytes(anz) {
        Ok(bytes) => bytes,
        Err(refusal) => {
            module.state.tx.turn.leave(key);
            return end(cx, refusal == Refusal::TooLong).map(|()| Pafe::Ok);
        }
    };
    let db_len = cx.len(Area::Db(db));
    let pafe = Pafe::check(db_len, module.offset(cx, abd)?, bytes)?;
    module.tell_pafe(cx, Send::NUMBER, db, pafe)?;
    if pafe != Pafe::Ok {
        module.state.tx.turn.leave(key);
    }
    // While the process of the CP is down, FC 9 is at work or another block has TX, FRG waits. Several FC 0 with data
    // blocks of their own take turns [S0 L2287].
    if pafe != Pafe::Ok || !module.info.present || module.is_closed(words) || !acquire(cx, &module, words, key, now)? {
        return Ok(pafe);
    }
    module.state.tx.begin(key);
    let (next, step) = Job::start(anz);
    act(cx, &module, job, next, step)
}

/// The job is none, or no longer: the CP has restarted since it began, FC 9 has reset the CP, or another block has got
/// `TX` because this one was not called. Its count is cleared, unless a start-up waits for its acknowledgement in the
/// same word, or another block uses it.
fn lost(cx: &mut Cx<'_, CpState>, module: &Module<'_>, key: Key, words: Words) -> Result<(), Abort> {
    let tx = &module.state.tx;
    let is_mine = tx.turn.claim.is_of(key);
    let is_free = is_mine || !tx.turn.claim.holds(&module.info);
    let may_clear = is_free && !tx.has_command(&module.info) && !module.is_closed(words);
    if may_clear && !module.write(cx, TX, &[0, 0])? {
        return Ok(());
    }
    if is_mine {
        tx.turn.claim.release();
    } else {
        tx.turn.claim.orphan_told();
    }
    end(cx, true)
}

/// Writes the registers, then the new state of the job.
fn act(cx: &mut Cx<'_, CpState>, module: &Module<'_>, before: Job, job: Job, step: Step) -> Result<Pafe, Abort> {
    match step {
        Step::Wait => {}
        Step::Word(word) => {
            if !module.write(cx, TX, &word.to_be_bytes())? {
                return Ok(Pafe::Ok);
            }
        }
        Step::Block { from, len, word } => {
            let (db, abd) = (cx.get(send::_DB)?, cx.get(send::ABD)?);
            let mut registers = [0; 2 + BLOCK_BYTES as usize];
            let (count, block) = registers.split_at_mut(2);
            count.copy_from_slice(&word.to_be_bytes());
            let at = module.offset(cx, abd)? + u32::from(from);
            if let Err(refused) = cx.read(Area::Db(db), at, &mut block[..usize::from(len)])? {
                return Ok(Pafe::of(refused).unwrap_or(Pafe::Short));
            }
            if !module.write(cx, TX, &registers)? {
                return Ok(Pafe::Ok);
            }
        }
        Step::Done => {
            module.state.tx.turn.claim.release();
            return end(cx, false).map(|()| Pafe::Ok);
        }
        Step::Failed(word) => {
            if let Some(word) = word
                && !module.write(cx, TX, &word.to_be_bytes())?
            {
                return Ok(Pafe::Ok);
            }
            module.state.tx.turn.claim.release();
            return end(cx, true).map(|()| Pafe::Ok);
        }
    }
    if job != before {
        store(cx, job)?;
        let handed = match job {
            Job { fehler_kom: true, .. } => Handed::Failed,
            Job { ende_kom: true, .. } => Handed::Whole,
            _ => Handed::Part,
        };
        module.state.tx.note(job.progress(), handed);
    }
    Ok(Pafe::Ok)
}

/// Resets FRG. `failed`: the telegram was not acknowledged.
fn end(cx: &mut Cx<'_, CpState>, failed: bool) -> Result<(), Abort> {
    store(cx, Job { fehler_kom: failed, ..Job::default() })?;
    cx.set(send::FRG, false)
}

fn load(cx: &mut Cx<'_, CpState>) -> Result<Job, Abort> {
    Ok(Job {
        gese: cx.get(send::GESE)?,
        anz_int: cx.get(send::ANZ_INT)?,
        ende_kom: cx.get(send::ENDE_KOMM)?,
        letzter_block: cx.get(send::LETZTER_BLOCK)?,
        senden_laeuft: cx.get(send::SENDEN_LAEUFT)?,
        fehler_kom: cx.get(send::FEHLER_KOM)?,
    })
}

fn store(cx: &mut Cx<'_, CpState>, job: Job) -> Result<(), Abort> {
    cx.set(send::GESE, job.gese)?;
    cx.set(send::ANZ_INT, job.anz_int)?;
    cx.set(send::ENDE_KOMM, job.ende_kom)?;
    cx.set(send::LETZTER_BLOCK, job.letzter_block)?;
    cx.set(send::SENDEN_LAEUFT, job.senden_laeuft)?;
    cx.set(send::FEHLER_KOM, job.fehler_kom)
}
