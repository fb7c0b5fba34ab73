//! FC 1 RECEIVE: the data reception from the CP [S0 "RECEIVE (FC 1)"].

use ob1_sdk::{Abort, Area, Block, Cx, Kind, Param, interface};

use crate::registers::{
    AREA, BLOCK_BYTES, BROKEN_OFF, COUNT_BITS, Count, MORE, Module, OFFSET_BYTES, OUTSIDE, Pafe, REGISTER_BYTES, Words,
    address, read, rx_count,
};
use crate::settings;
use crate::state::CpState;

interface! {
    /// The parameters, in the manual's order.
    pub(crate) mod receive {
        /// Logical address of the CP.
        in     ADR: Int;
        /// Data block for the telegram.
        in     _DB: BlockDb;
        /// First byte of the telegram in it (a byte, as at SEND).
        in     ABD | ADB: Word;
        /// Bytes received.
        out    ANZ: Word;
        /// 1: a telegram is there. The program sets it back; until then no further one is taken.
        in_out EMFR: Bool;
        /// Bytes stored.
        in_out GEEM: Word;
        /// Length of the telegram that is being received.
        in_out ANZ_INT: Word;
        /// A job is running.
        in_out EMPF_LAEUFT | EMP_LAEUFT: Bool;
        /// The last block is stored.
        in_out LETZTER_BLOCK: Bool;
        /// The last job failed; stays until the next one starts.
        in_out FEHLER_EMPF | FEHL_EMPF: Bool;
        /// 1 data block not present, 2 too short, 3 number outside the valid range; back to 0 by itself.
        out    PAFE: Byte;
    }
}

/// The state of a job between two calls, as the program keeps it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Job {
    pub(crate) geem: u16,
    pub(crate) anz_int: u16,
    pub(crate) empf_laeuft: bool,
    pub(crate) letzter_block: bool,
    pub(crate) fehler_empf: bool,
}

/// What a call does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// Nothing: it is the CP's turn, or the program's.
    Wait,
    /// Store `len` bytes at `to`, then echo the count.
    Take { to: u16, len: u16, count: u16 },
    /// The changed area does not lie inside of the data block: tell the CP.
    Refuse,
    /// Both sides at 0: the telegram is finished.
    Finish,
    /// The job is over with an error, the echo goes back to 0.
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

    /// A job is running, on the CP it was started on. `emfr` keeps back what would go into the program's buffer.
    pub(crate) fn go_on(self, rx: u16, emfr: bool) -> (Self, Step) {
        let Some(rest) = self.rest() else { return (self, Step::Failed) };
        let Count::Bytes(count) = rx_count(rx) else { return (self, Step::Wait) };
        let same_kind = (rx ^ self.anz_int) & AREA == 0;
        if self.fehler_empf {
            // Refused: until the CP has seen that.
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
        // Not yet: the count of the block before.
        let before = same_kind && self.geem > 0 && count == rest + BLOCK_BYTES;
        (self, if before { Step::Wait } else { Step::Failed })
    }

    /// Counts 18, 6: stored, then echoed [S0 L1864-L1876].
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

    /// Length of the telegram, an offset before it included.
    fn bytes(self) -> u16 {
        self.anz_int & !AREA
    }

    /// Bytes of the offset before the data: the telegram is a changed area, or it is none.
    fn offset_bytes(self) -> u16 {
        if self.anz_int & AREA == 0 { 0 } else { OFFSET_BYTES }
    }

    /// Bytes not stored yet; `None` when GEEM and ANZ_INT are not ours.
    fn rest(self) -> Option<u16> {
        let Count::Bytes(bytes) = rx_count(self.anz_int) else { return None };
        let rest = bytes.checked_sub(self.geem)?;
        (bytes > 0 && self.letzter_block == (rest == 0)).then_some(rest)
    }
}

/// FC 1.
pub(crate) struct Receive;

impl Block for Receive {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = 1;
    const NAME: &'static str = "RECEIVE";
    const PARAMS: &'static [Param] = receive::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let pafe = run(cx)?;
        cx.set(receive::PAFE, pafe as u8)
    }
}

fn run(cx: &mut Cx<'_, CpState>) -> Result<Pafe, Abort> {
    let adr = cx.get(receive::ADR)?;
    // The idle call ends here: nothing is offered, nothing runs.
    let mut rx = [0; 2];
    if !read(cx, address(adr), &mut rx)? || (rx == [0; 2] && !cx.get(receive::EMPF_LAEUFT)?) {
        return Ok(Pafe::Ok);
    }
    // Count and bytes of one read, so that they belong together.
    let Some((module, registers)) = Module::read::<REGISTER_BYTES>(cx, adr)? else { return Ok(Pafe::Ok) };
    let [a, b, c, d, block @ ..] = registers;
    let mut words = Words::from_bytes([a, b, c, d]);
    if words.rx & !COUNT_BITS == MORE {
        // ASCII-fragmented without FC 11: each block is a telegram here, and nothing comes of the word behind them.
        if matches!(words.rx, MORE | BROKEN_OFF) {
            return module.write(cx, 0, &MORE.to_be_bytes()).map(|_| Pafe::Ok);
        }
        words.rx &= COUNT_BITS;
    }
    let (emfr, job) = (cx.get(receive::EMFR)?, load(cx)?);
    if job.empf_laeuft {
        if words.not_ready() || !module.state.receive.holds(&module.info) {
            return lost(cx, &module, job, words);
        }
        let (next, step) = job.go_on(words.rx, emfr);
        return act(cx, &module, next, step, &block);
    }
    if words.not_ready() || !module.info.present {
        module.state.discard.set(false);
        return Ok(Pafe::Ok);
    }
    if module.state.discard.get() {
        module.state.discard.set(words.rx != 0);
        return Ok(Pafe::Ok);
    }
    // "Not until setting back EMFR in the user application new data can be received." [S0 "RECEIVE (FC 1)"]
    if emfr {
        return Ok(Pafe::Ok);
    }
    let (next, step) = job.start(words.rx);
    if step == Step::Wait {
        return Ok(Pafe::Ok);
    }
    let (db, abd) = (cx.get(receive::_DB)?, cx.get(receive::ABD)?);
    let db_len = cx.len(Area::Db(db));
    let is_area = next.offset_bytes() > 0;
    module.state.offset.set(if is_area { u16::from_be_bytes([block[0], block[1]]) } else { 0 });
    let begin = settings::offset(cx, &module, abd)? + u32::from(module.state.offset.get());
    let pafe = Pafe::check(db_len, begin, next.bytes().saturating_sub(next.offset_bytes()))?;
    if pafe == Pafe::Short && is_area {
        module.state.receive.take(&module.info);
        let (next, step) = next.refuse();
        return act(cx, &module, next, step, &block).map(|_| pafe);
    }
    // A telegram that does not fit waits in the CP until it does (ours).
    if pafe != Pafe::Ok {
        return Ok(pafe);
    }
    module.state.receive.take(&module.info);
    act(cx, &module, next, step, &block)
}

/// The CP is no longer the one the job was started on: what it held is gone. A telegram whose last block is stored is
/// none the worse.
fn lost(cx: &mut Cx<'_, CpState>, module: &Module<'_>, job: Job, words: Words) -> Result<Pafe, Abort> {
    // A start-up waits for its acknowledgement in the same word.
    if !words.not_ready() && !module.write(cx, 0, &[0, 0])? {
        return Ok(Pafe::Ok);
    }
    end(cx, module, !job.letzter_block || job.fehler_empf).map(|()| Pafe::Ok)
}

fn act(cx: &mut Cx<'_, CpState>, module: &Module<'_>, job: Job, step: Step, block: &[u8]) -> Result<Pafe, Abort> {
    match step {
        Step::Wait => {}
        Step::Take { to, len, count } => {
            let (db, abd) = (cx.get(receive::_DB)?, cx.get(receive::ABD)?);
            let head = job.offset_bytes();
            let bytes = block.get(usize::from(head.saturating_sub(to))..usize::from(len)).unwrap_or(&[]);
            let abd = settings::offset(cx, module, abd)?;
            let at = abd + u32::from(module.state.offset.get()) + u32::from(to.saturating_sub(head));
            if let Err(refused) = cx.write(Area::Db(db), at, bytes)? {
                return match Pafe::of(refused) {
                    Some(pafe) => Ok(pafe),
                    None => cx.raise_fault(0x2530, u32::from(db)).map(|()| Pafe::Ok),
                };
            }
            if !module.write(cx, 0, &count.to_be_bytes())? {
                return Ok(Pafe::Ok);
            }
            store(cx, job)?;
            if job.letzter_block {
                cx.set(receive::ANZ, job.bytes().saturating_sub(head))?;
                cx.set(receive::EMFR, true)?;
            }
        }
        Step::Refuse => {
            if module.write(cx, 0, &OUTSIDE.to_be_bytes())? {
                store(cx, job)?;
            }
        }
        Step::Finish => {
            if module.write(cx, 0, &[0, 0])? {
                end(cx, module, job.fehler_empf)?;
            }
        }
        Step::Failed => {
            if module.write(cx, 0, &[0, 0])? {
                module.state.discard.set(true);
                end(cx, module, true)?;
            }
        }
    }
    Ok(Pafe::Ok)
}

fn end(cx: &mut Cx<'_, CpState>, module: &Module<'_>, failed: bool) -> Result<(), Abort> {
    module.state.receive.release();
    store(cx, Job { fehler_empf: failed, ..Job::default() })
}

fn load(cx: &mut Cx<'_, CpState>) -> Result<Job, Abort> {
    Ok(Job {
        geem: cx.get(receive::GEEM)?,
        anz_int: cx.get(receive::ANZ_INT)?,
        empf_laeuft: cx.get(receive::EMPF_LAEUFT)?,
        letzter_block: cx.get(receive::LETZTER_BLOCK)?,
        fehler_empf: cx.get(receive::FEHLER_EMPF)?,
    })
}

fn store(cx: &mut Cx<'_, CpState>, job: Job) -> Result<(), Abort> {
    cx.set(receive::GEEM, job.geem)?;
    cx.set(receive::ANZ_INT, job.anz_int)?;
    cx.set(receive::EMPF_LAEUFT, job.empf_laeuft)?;
    cx.set(receive::LETZTER_BLOCK, job.letzter_block)?;
    cx.set(receive::FEHLER_EMPF, job.fehler_empf)
}
