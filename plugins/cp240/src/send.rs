//! FC 0 SEND: the data output from the CPU to the CP [S0 "SEND (FC 0)"].

use ob1_sdk::{Abort, Area, Block, Cx, Kind, Param, interface};

use crate::module::Module;
use crate::registers::{AREA, BLOCK_BYTES, Count, FAILED, Pafe, TELEGRAM_MAX, TX, Words, tx_count};
use crate::state::CpState;

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
    /// FRG is set and no job is running. An old count is cleared first: CP and CPU both start from 0.
    pub(crate) fn start(self, anz: u16, words: Words) -> (Self, Step) {
        match tx_count(words.tx_echo) {
            _ if words.not_ready() => (self, Step::Wait),
            Count::Bytes(0) => {
                let job = Job { anz_int: anz, senden_laeuft: true, ..Job::default() };
                job.next_block()
            }
            Count::Bytes(_) => (self, Step::Word(0)),
            Count::Failed(_) => (self, Step::Word(FAILED)),
            Count::Line { .. } | Count::System | Count::Nonsense => (self, Step::Wait),
        }
    }

    /// A job is running, and the CP has not restarted since.
    pub(crate) fn go_on(self, words: Words) -> (Self, Step) {
        if words.not_ready() {
            return (self, self.lost(words));
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

    /// The CP has restarted since the job began. The count is cleared, unless a start-up waits for its acknowledgement
    /// in the same word.
    pub(crate) fn lost(self, words: Words) -> Step {
        Step::Failed((!words.not_ready()).then_some(0))
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

/// FC 0.
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
    let job = load(cx)?;
    if job.senden_laeuft {
        let (next, step) =
            if module.state.send.holds(&module.info) { job.go_on(words) } else { (job, job.lost(words)) };
        return act(cx, &module, job, next, step);
    }
    let anz = cx.get(send::ANZ)?;
    let bytes = match telegram_bytes(anz) {
        Ok(bytes) => bytes,
        Err(refusal) => return end(cx, &module, refusal == Refusal::TooLong).map(|()| Pafe::Ok),
    };
    let (db, abd) = (cx.get(send::_DB)?, cx.get(send::ABD)?);
    let db_len = cx.len(Area::Db(db));
    let pafe = Pafe::check(db_len, module.offset(cx, abd)?, bytes)?;
    // While the process of the CP is down, or a line command of FC 8 is running, FRG waits.
    if pafe != Pafe::Ok || !module.info.present || module.state.line.holds(&module.info) {
        return Ok(pafe);
    }
    let (next, step) = job.start(anz, words);
    if next.senden_laeuft {
        module.state.send.take(&module.info);
    }
    act(cx, &module, job, next, step)
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
        Step::Done => return end(cx, module, false).map(|()| Pafe::Ok),
        Step::Failed(word) => {
            if let Some(word) = word
                && !module.write(cx, TX, &word.to_be_bytes())?
            {
                return Ok(Pafe::Ok);
            }
            return end(cx, module, true).map(|()| Pafe::Ok);
        }
    }
    if job != before {
        store(cx, job)?;
    }
    Ok(Pafe::Ok)
}

/// Resets FRG. `failed`: the telegram was not acknowledged.
fn end(cx: &mut Cx<'_, CpState>, module: &Module<'_>, failed: bool) -> Result<(), Abort> {
    module.state.send.release();
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
