//! FC 11 ASCII_FRAGMENT: hands each block of up to 12 bytes to the program as it comes [S0 "ASCII_FRAGMENT"].
//!
//! The blocks of a telegram all go to the same place, `_DB` from `ABD` on, each with `EMFR` and its length in `ANZ`;
//! the next one waits in the CP until the program has set `EMFR` back. With the protocol ASCII-fragmented each block is
//! a telegram of its own in the registers; with another protocol the block works too and cuts whole telegrams into
//! blocks.

use ob1_sdk::{Abort, Area, Block, Cx, Kind, Param, interface};

use crate::registers::{BLOCK_BYTES, Count, Module, Pafe, REGISTER_BYTES, Words, rx_count};
use crate::settings;
use crate::state::CpState;

interface! {
    /// The parameters, in the manual's order.
    pub(crate) mod fragment {
        /// Logical address of the CP.
        in     ADR: Int;
        /// Data block for the received bytes.
        in     _DB: BlockDb;
        /// First byte in it (a byte, as at SEND).
        in     ABD | ADB: Word;
        /// Bytes received: those of this block.
        out    ANZ: Word;
        /// 1: a block is there. The program sets it back; until then no further one is taken.
        in_out EMFR: Bool;
        /// Bytes handed over so far of what is being received.
        in_out GEEM: Word;
        /// The count of the block handed over last.
        in_out ANZ_INT: Word;
        /// A job is running.
        in_out EMPF_LAEUFT | EMP_LAEUFT: Bool;
        /// It was the last block.
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
    /// Hand over `len` bytes, then echo the count.
    Take {
        /// Bytes of the block.
        len: u16,
        /// The count to echo.
        count: u16,
    },
    /// Both sides at 0.
    Finish,
    /// The job is over with an error, the echo goes back to 0.
    Failed,
}

impl Job {
    /// The CP shows `rx`; `emfr` keeps a block back.
    pub(crate) fn step(self, rx: u16, emfr: bool) -> (Self, Step) {
        let Count::Bytes(rx) = rx_count(rx) else { return (self, Step::Wait) };
        if !self.empf_laeuft {
            let start = rx > 0 && !emfr;
            return if start { Job::default().take(rx) } else { (self, Step::Wait) };
        }
        if rx == self.anz_int {
            return (self, Step::Wait); // The CP has not looked yet.
        }
        if self.letzter_block {
            return (self, Step::Finish);
        }
        match self.anz_int.checked_sub(BLOCK_BYTES) {
            Some(next) if next == rx && next > 0 && emfr => (self, Step::Wait),
            Some(next) if next == rx && next > 0 => self.take(rx),
            _ => (self, Step::Failed),
        }
    }

    fn take(self, count: u16) -> (Self, Step) {
        let len = count.min(BLOCK_BYTES);
        let job = Job {
            geem: self.geem.saturating_add(len),
            anz_int: count,
            empf_laeuft: true,
            letzter_block: count <= BLOCK_BYTES,
            fehler_empf: false,
        };
        (job, Step::Take { len, count })
    }
}

/// FC 11.
pub(crate) struct Fragment;

impl Block for Fragment {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = 11;
    const NAME: &'static str = "ASCII_FRAGMENT";
    const PARAMS: &'static [Param] = fragment::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let pafe = run(cx)?;
        cx.set(fragment::PAFE, pafe as u8)
    }
}

fn run(cx: &mut Cx<'_, CpState>) -> Result<Pafe, Abort> {
    let adr = cx.get(fragment::ADR)?;
    let Some((module, registers)) = Module::read::<REGISTER_BYTES>(cx, adr)? else { return Ok(Pafe::Ok) };
    let [a, b, c, d, block @ ..] = registers;
    let words = Words::from_bytes([a, b, c, d]);
    let job = load(cx)?;
    let alive = !words.not_ready() && module.info.present;
    if job.empf_laeuft && !(alive && module.state.receive.holds(&module.info)) {
        // The CP is no longer the one the job was started on. A start-up waits for its acknowledgement in the same
        // word.
        if words.not_ready() || module.write(cx, 0, &[0, 0])? {
            end(cx, &module, !job.letzter_block)?;
        }
        return Ok(Pafe::Ok);
    }
    if !alive {
        module.state.discard.set(false);
        return Ok(Pafe::Ok);
    }
    if !job.empf_laeuft && module.state.discard.get() {
        module.state.discard.set(words.rx != 0);
        return Ok(Pafe::Ok);
    }
    let emfr = cx.get(fragment::EMFR)?;
    let (next, step) = job.step(words.rx, emfr);
    match step {
        Step::Wait => Ok(Pafe::Ok),
        Step::Take { len, count } => take(cx, &module, next, &block[..usize::from(len)], count),
        Step::Finish => {
            if module.write(cx, 0, &[0, 0])? {
                end(cx, &module, false)?;
            }
            Ok(Pafe::Ok)
        }
        Step::Failed => {
            if module.write(cx, 0, &[0, 0])? {
                module.state.discard.set(true);
                end(cx, &module, true)?;
            }
            Ok(Pafe::Ok)
        }
    }
}

/// Stores a block, then echoes its count. A block that does not fit waits in the CP until it does (ours).
fn take(cx: &mut Cx<'_, CpState>, module: &Module<'_>, job: Job, block: &[u8], count: u16) -> Result<Pafe, Abort> {
    let (db, abd) = (cx.get(fragment::_DB)?, cx.get(fragment::ABD)?);
    let begin = settings::offset(cx, module, abd)?;
    if let Err(refused) = cx.write(Area::Db(db), begin, block)? {
        return match Pafe::of(refused) {
            Some(pafe) => Ok(pafe),
            None => cx.raise_fault(0x2530, u32::from(db)).map(|()| Pafe::Ok),
        };
    }
    if !module.write(cx, 0, &count.to_be_bytes())? {
        return Ok(Pafe::Ok);
    }
    module.state.receive.take(&module.info);
    store(cx, job)?;
    cx.set(fragment::ANZ, block.len() as u16)?;
    cx.set(fragment::EMFR, true)?;
    Ok(Pafe::Ok)
}

fn end(cx: &mut Cx<'_, CpState>, module: &Module<'_>, failed: bool) -> Result<(), Abort> {
    module.state.receive.release();
    store(cx, Job { fehler_empf: failed, ..Job::default() })
}

fn load(cx: &mut Cx<'_, CpState>) -> Result<Job, Abort> {
    Ok(Job {
        geem: cx.get(fragment::GEEM)?,
        anz_int: cx.get(fragment::ANZ_INT)?,
        empf_laeuft: cx.get(fragment::EMPF_LAEUFT)?,
        letzter_block: cx.get(fragment::LETZTER_BLOCK)?,
        fehler_empf: cx.get(fragment::FEHLER_EMPF)?,
    })
}

fn store(cx: &mut Cx<'_, CpState>, job: Job) -> Result<(), Abort> {
    cx.set(fragment::GEEM, job.geem)?;
    cx.set(fragment::ANZ_INT, job.anz_int)?;
    cx.set(fragment::EMPF_LAEUFT, job.empf_laeuft)?;
    cx.set(fragment::LETZTER_BLOCK, job.letzter_block)?;
    cx.set(fragment::FEHLER_EMPF, job.fehler_empf)
}
