//! FC 11 ASCII_FRAGMENT: takes a telegram out of the CP in blocks of up to 12 bytes as they come
//! [S0 "ASCII_FRAGMENT"].
//!
//! The blocks go one behind the other to `_DB` from `ABD` on; GEEM says how many bytes of the telegram stand there.
//! "When the output EMFR is set, a new telegram has been read completely. The length of the read telegram is stored in
//! ANZ." [S0 L1099] With the protocol ASCII-fragmented the CP hands a block on before it knows how long the telegram
//! will be: a bit of the count says that more follows (docs/cp240-registers.md). With another protocol the counts say
//! it, as at FC 1. (decision 20)

use ob1_sdk::{Abort, Area, Block, Cx, Kind, Param, interface};

use crate::registers::{AREA, BLOCK_BYTES, BROKEN_OFF, Count, MORE, Module, Pafe, REGISTER_BYTES, Words, rx_count};
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
        /// Bytes received: the whole telegram.
        out    ANZ: Word;
        /// 1: a telegram is there. The program sets it back; until then no further one is taken.
        in_out EMFR: Bool;
        /// Bytes of the telegram stored so far.
        in_out GEEM: Word;
        /// The count of the block stored last; 0 while the next one is waited for.
        in_out ANZ_INT: Word;
        /// A job is running.
        in_out EMPF_LAEUFT | EMP_LAEUFT: Bool;
        /// The telegram is complete.
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
    /// Store `len` bytes (none: it is only the word that the telegram is complete) at `to`, then echo the count.
    Take { to: u16, len: u16, count: u16 },
    /// The block is with the CP too: echo 0, the next one may come.
    Next,
    /// A word that belongs to nothing here: echo it.
    Skip(u16),
    /// Both sides at 0.
    Finish,
    /// The rest of the telegram is lost: the job is over with an error, this is echoed.
    Lost(u16),
    /// The job is over with an error, the echo goes back to 0.
    Failed,
}

/// `RX`, sorted.
enum Shown {
    Nothing,
    /// A block: its count, and whether it is the last.
    Block {
        bytes: u16,
        last: bool,
    },
    /// The telegram is complete, without another byte.
    End,
    /// Its rest is lost.
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

impl Job {
    /// The CP shows `rx`; `emfr` keeps the next telegram back.
    pub(crate) fn step(self, rx: u16, emfr: bool) -> (Self, Step) {
        let Some(shown) = Shown::of(rx) else { return (self, Step::Wait) };
        if !self.empf_laeuft {
            return match shown {
                Shown::Block { .. } if emfr => (self, Step::Wait),
                Shown::Block { bytes, last } => Job::default().take(rx, bytes, last),
                // Of a telegram whose job has failed.
                Shown::End | Shown::Broken => (self, Step::Skip(MORE)),
                Shown::Nothing => (self, Step::Wait),
            };
        }
        if rx != 0 && rx == self.anz_int {
            return (self, Step::Wait); // The CP has not looked yet.
        }
        if self.letzter_block {
            return (self, Step::Finish);
        }
        match (self.anz_int, shown) {
            (0, Shown::Nothing) => (self, Step::Wait),
            (0, Shown::Block { bytes, last }) if bytes <= BLOCK_BYTES => self.take(rx, bytes, last),
            (0, Shown::End) => self.take(rx, 0, true),
            (0, Shown::Broken) => (self, Step::Lost(MORE)),
            (before, Shown::Nothing) if before & MORE != 0 => (Job { anz_int: 0, ..self }, Step::Next),
            // A telegram whose length the CP knows: 30, 18, 6.
            (before, Shown::Block { bytes, last }) if before.checked_sub(BLOCK_BYTES) == Some(rx) => {
                self.take(rx, bytes, last)
            }
            _ => (self, Step::Failed),
        }
    }

    fn take(self, count: u16, bytes: u16, last: bool) -> (Self, Step) {
        let len = bytes.min(BLOCK_BYTES);
        let job = Job {
            geem: self.geem.saturating_add(len),
            anz_int: count,
            empf_laeuft: true,
            letzter_block: last,
            fehler_empf: false,
        };
        (job, Step::Take { to: self.geem, len, count })
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
    let echo = |cx: &mut Cx<'_, CpState>, word: u16| module.write(cx, 0, &word.to_be_bytes());
    match step {
        Step::Wait => {}
        Step::Take { to, len, count } => return take(cx, &module, next, to, &block[..usize::from(len)], count),
        Step::Next => {
            if echo(cx, 0)? {
                store(cx, next)?;
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
                module.state.discard.set(true);
                end(cx, &module, true)?;
            }
        }
    }
    Ok(Pafe::Ok)
}

/// Stores a block behind those before it, then echoes its count. A block that does not fit waits in the CP until it
/// does (ours). With the last one the telegram is the program's.
fn take(
    cx: &mut Cx<'_, CpState>,
    module: &Module<'_>,
    job: Job,
    to: u16,
    block: &[u8],
    count: u16,
) -> Result<Pafe, Abort> {
    let (db, abd) = (cx.get(fragment::_DB)?, cx.get(fragment::ABD)?);
    let begin = settings::offset(cx, module, abd)? + u32::from(to);
    if !block.is_empty()
        && let Err(refused) = cx.write(Area::Db(db), begin, block)?
    {
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
    if job.letzter_block {
        cx.set(fragment::ANZ, job.geem)?;
        cx.set(fragment::EMFR, true)?;
    }
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
