//! A block that gives a job to the CP: P_SEND and P_SND_RK send data of a DB, P_SND_RK also fetches data of the partner
//! into a DB (RK 512), P_PRINT prints. [TIA help "PtP data link CP 341"]
//!
//! A job of LEN bytes takes LEN/32 calls, rounded up, to pass its data, one more to see that the CP has them, and one
//! that reports the end: at least three. The start-up coordination takes one call before.

use ob1_sdk::types::{Bool, Bytes, Int, Word};
use ob1_sdk::{Abort, Area, Cx, Formal, In, Refused, Static};

use ob1_words::channels::{Block, Channel, Command, PIECE, State, pieces};

use crate::outputs::Outputs;

use super::channel::{self, Unreachable, next_start};
use super::state::{CpState, JOB_MS, called};

/// STATUS: job aborted by restart or reset. (docs/cp341-events.md)
pub(crate) const ABORTED: u16 = 0x1E0D;
/// STATUS: WR_REC failed; RET_VAL is in SFCERR. (docs/cp341-events.md)
const WRITE_FAILED: u16 = 0x1E0F;
/// STATUS: the CP has started again. (docs/cp341-events.md)
pub(crate) const CP_RESTARTED: u16 = 0x0501;
/// STATUS: another instance has a job at this CP. (docs/cp341-events.md)
const BUSY: u16 = 0x0522;
/// STATUS: the DB is missing or too short. (docs/cp341-events.md)
pub const DB_WRONG: u16 = 0x0301;
/// STATUS: LEN is 0, negative or more than the CP takes, or a length of P_PRINT. (docs/cp341-events.md)
pub const LEN_WRONG: u16 = 0x1E41;

/// How long a block waits for a CP that does not answer: it may be starting. (ours)
pub(crate) const ABSENCE_MS: u32 = 10_000;

/// The phase of the job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(crate) enum Phase {
    /// There is no start-up coordination with the CP yet.
    #[default]
    Off,
    /// The start-up coordination has been requested.
    Starting,
    Idle,
    /// Data are being passed to the CP.
    Giving,
    /// The CP executes the job.
    Running,
    /// Fetched data are being received.
    Taking,
}

impl Phase {
    fn of(number: u8) -> Self {
        match number {
            1 => Self::Starting,
            2 => Self::Idle,
            3 => Self::Giving,
            4 => Self::Running,
            5 => Self::Taking,
            _ => Self::Off,
        }
    }

    fn has_job(self) -> bool {
        matches!(self, Self::Giving | Self::Running | Self::Taking)
    }
}

/// The state of the block between two calls.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(crate) struct Memory {
    pub(crate) phase: Phase,
    /// REQ at the last call.
    pub(crate) req: bool,
    /// A job waits for the start-up coordination: it "is not lost".
    pub(crate) latched: bool,
    /// R at the last call.
    reset: bool,
    /// LADDR of the job, and of the start number.
    laddr: i16,
    /// A job waits for a CP that does not answer, since this time (ms).
    absent_since: Option<u32>,
    pub(crate) start: u16,
    pub(crate) job: u16,
    /// Number of the next piece for the CP.
    pub(crate) piece: u16,
    data: Data,
}

/// What a call does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Act {
    Wait,
    /// Request the start-up coordination with a new number.
    Start,
    /// Begin the job with its first piece.
    Begin,
    /// Pass the next piece.
    Give,
    /// Store the piece that the CP shows.
    Take,
    Done,
    Failed(u16),
}

impl Memory {
    fn of(bytes: &[u8; 34]) -> Self {
        let word = |at: usize| u16::from_be_bytes([bytes[at], bytes[at + 1]]);
        let since = u32::from(word(14)) << 16 | u32::from(word(16));
        Self {
            phase: Phase::of(bytes[0]),
            req: bytes[1] & 1 != 0,
            latched: bytes[1] & 2 != 0,
            reset: bytes[1] & 8 != 0,
            laddr: word(18) as i16,
            absent_since: (bytes[1] & 4 != 0).then_some(since),
            start: word(2),
            job: word(4),
            piece: word(6),
            data: Data { db: word(8), byte: word(10), len: word(12) },
        }
    }

    fn bytes(&self) -> [u8; 34] {
        let mut bytes = [0; 34];
        bytes[0] = self.phase as u8;
        let bits = [self.req, self.latched, self.absent_since.is_some(), self.reset];
        bytes[1] = bits.into_iter().rev().fold(0, |byte, bit| byte << 1 | u8::from(bit));
        let since = self.absent_since.unwrap_or(0);
        let Data { db, byte, len } = self.data;
        let (high, low, laddr) = ((since >> 16) as u16, since as u16, self.laddr as u16);
        let words = [self.start, self.job, self.piece, db, byte, len, high, low, laddr];
        for (place, word) in bytes[2..].chunks_exact_mut(2).zip(words) {
            place.copy_from_slice(&word.to_be_bytes());
        }
        bytes
    }

    /// A job runs or waits.
    fn has_work(&self) -> bool {
        self.phase.has_job() || self.latched
    }

    /// Forgets everything but the inputs of this call.
    fn renew(&mut self) {
        *self = Self { req: self.req, reset: self.reset, ..Self::default() };
    }

    /// One call while R is 0; `cp` is the block that the CP shows.
    pub(crate) fn step(&mut self, cp: &Block) -> Act {
        let known = self.start != 0 && cp.start() == self.start;
        match self.phase {
            Phase::Off => Act::Start,
            Phase::Starting if known => {
                self.phase = Phase::Idle;
                self.step(cp)
            }
            Phase::Starting => Act::Wait,
            // The CP has restarted: all its jobs are lost.
            _ if !known => {
                let had_job = self.phase.has_job();
                self.phase = Phase::Off;
                if had_job { Act::Failed(CP_RESTARTED) } else { Act::Start }
            }
            Phase::Idle if self.latched => Act::Begin,
            Phase::Idle => Act::Wait,
            _ if cp.job() != self.job => Act::Wait,
            Phase::Giving => match cp.state() {
                State::Collecting if cp.piece() == self.piece => Act::Give,
                // The CP has all data, or refuses the job: the next call reports how the job ends.
                State::Running | State::Giving | State::Done | State::Failed => {
                    (self.phase, self.piece) = (Phase::Running, 0);
                    Act::Wait
                }
                _ => Act::Wait,
            },
            Phase::Running | Phase::Taking => match cp.state() {
                State::Done => Act::Done,
                State::Failed => Act::Failed(cp.status()),
                // A CP that shows more pieces than the job has is not followed.
                State::Giving if cp.piece() == self.piece && self.piece < pieces(usize::from(self.data.len)) => {
                    Act::Take
                }
                _ => Act::Wait,
            },
        }
    }
}

/// The parameters that all these blocks have.
#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// A rising edge starts a job.
    pub req: Formal<Bool, In>,
    /// 1 aborts the job and disables the block.
    pub r: Formal<Bool, In>,
    /// Logical base address of the CP.
    pub laddr: Formal<Int, In>,
    /// DONE, ERROR and STATUS: for one call the end of the job, with an error event class and number.
    pub outputs: Outputs,
    /// RET_VAL of the record transfer.
    pub sfcerr: Static<Word>,
    /// The state between two calls.
    pub memory: Static<Bytes<34>>,
}

/// The [`Params`](super::send::Params) of a block, collected by their names.
#[macro_export]
macro_rules! send_params {
    ($block:ident) => {
        $crate::ptp::send::Params {
            req: $block::REQ,
            r: $block::R,
            laddr: $block::LADDR,
            outputs: $crate::outputs::Outputs { end: $block::DONE, error: $block::ERROR, status: $block::STATUS },
            sfcerr: $block::SFCERR,
            memory: $block::MEMORY,
        }
    };
}

/// The part in which the blocks differ.
pub trait Job {
    /// Where the block has the parameters that all of them share.
    const PARAMS: Params;

    /// Checks the parameters at the edge of REQ; with an inner error the job ends at once with this STATUS.
    ///
    /// # Errors
    /// [`Abort`] of a host function: the call ends at once.
    fn check(cx: &mut Cx<'_, CpState>) -> Result<Result<(), u16>, Abort>;

    /// The location and length of the data of a job that starts now.
    ///
    /// # Errors
    /// [`Abort`] of a host function: the call ends at once.
    fn begin(cx: &mut Cx<'_, CpState>) -> Result<Result<Data, u16>, Abort>;

    /// The job for the CP; its length comes from [`begin`](Self::begin).
    ///
    /// # Errors
    /// [`Abort`] of a host function: the call ends at once.
    fn order(cx: &mut Cx<'_, CpState>) -> Result<ob1_words::channels::Job, Abort>;

    /// Whether the CPU passes data with the job.
    fn has_data(_: &ob1_words::channels::Job) -> bool {
        true
    }

    /// Reads a piece of the data that begins at byte `from`.
    ///
    /// # Errors
    /// [`Abort`] of a host function: the call ends at once.
    fn read(cx: &mut Cx<'_, CpState>, data: Data, from: u16, into: &mut [u8]) -> Result<Result<(), u16>, Abort> {
        let at = u32::from(data.byte) + u32::from(from);
        match cx.read(Area::Db(data.db), at, into)? {
            Ok(()) => Ok(Ok(())),
            Err(refused) => wrong_db(cx, refused, data.db, at, false).map(Err),
        }
    }
}

/// The parameters that say where the data of a job are: DB_NO, DBB_NO and LEN.
#[derive(Clone, Copy, Debug)]
pub struct Source {
    /// DB_NO: number of the data block.
    pub db_no: Formal<Int, In>,
    /// DBB_NO: first byte in it.
    pub dbb_no: Formal<Int, In>,
    /// LEN: bytes to send; 1 to `longest` is possible.
    pub len: Formal<Int, In>,
    /// The longest LEN that the CP takes.
    pub longest: i16,
}

impl Source {
    /// Whether LEN is possible; the STATUS if it is not.
    ///
    /// # Errors
    /// [`Abort`] of a host function: the call ends at once.
    pub fn check(&self, cx: &mut Cx<'_, CpState>) -> Result<Result<(), u16>, Abort> {
        let is_possible = (1..=self.longest).contains(&cx.get(self.len)?);
        Ok(if is_possible { Ok(()) } else { Err(LEN_WRONG) })
    }

    /// What the parameters say now.
    ///
    /// # Errors
    /// [`Abort`] of a host function: the call ends at once.
    pub fn data(&self, cx: &mut Cx<'_, CpState>) -> Result<Data, Abort> {
        let (db, byte) = (cx.get(self.db_no)? as u16, cx.get(self.dbb_no)? as u16);
        Ok(Data { db, byte, len: cx.get(self.len)? as u16 })
    }
}

/// Location and length of the data of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Data {
    /// Number of the data block.
    pub db: u16,
    /// First byte in it.
    pub byte: u16,
    /// Length of the data in bytes.
    pub len: u16,
}

/// One call of the block: sets DONE, or ERROR with a STATUS, or neither, and BR. The outputs are valid for this call
/// only. SFCERR and the state between two calls are in the instance. [TIA help "PtP data link CP 341"]
///
/// # Errors
/// [`Abort`] of a host function: the call ends at once.
pub fn call<J: Job>(cx: &mut Cx<'_, CpState>) -> Result<(), Abort> {
    let end = job::<J>(cx)?;
    let failed = end.and_then(Result::err).filter(|status| *status != 0);
    J::PARAMS.outputs.set(cx, end == Some(Ok(())), failed, 0)
}

fn job<J: Job>(cx: &mut Cx<'_, CpState>) -> Result<End, Abort> {
    let mut bytes = [0; 34];
    if cx.load_bytes(J::PARAMS.memory, 0, &mut bytes)?.is_err() {
        // The instance is too short: the same event as for a statement that reads it.
        cx.raise_fault(0x2522, 0)?;
        return Ok(None);
    }
    let before = Memory::of(&bytes);
    let mut memory = before;
    let end = run::<J>(cx, &mut memory)?;
    if memory != before {
        let _same_bytes_as_above = cx.store_bytes(J::PARAMS.memory, 0, &memory.bytes())?;
    }
    Ok(end)
}

/// The end of a job in this call: without error, or with a STATUS.
type End = Option<Result<(), u16>>;

fn run<J: Job>(cx: &mut Cx<'_, CpState>, memory: &mut Memory) -> Result<End, Abort> {
    let (req, reset, laddr) = (cx.get(J::PARAMS.req)?, cx.get(J::PARAMS.r)?, cx.get(J::PARAMS.laddr)?);
    let (edge, resets) = (req && !memory.req && !reset, reset && !memory.reset);
    (memory.req, memory.reset) = (req, reset);
    let Ok(state) = cx.module_state(channel::address(laddr))? else {
        if !(edge || resets || memory.has_work()) {
            return Ok(None);
        }
        memory.renew();
        return unreachable::<J>(cx, Unreachable(0x8090)).map(Some);
    };
    let (instance, now_ms) = called(cx)?;
    let end = match own(memory, laddr, state, edge, (instance, now_ms)) {
        Some(end) if memory.latched => latch::<J>(cx, memory)?.map_or(end, |()| end),
        Some(end) => end,
        None => run_job::<J>(cx, memory, laddr, state, edge)?,
    };
    state.send.keep(instance, now_ms, if memory.has_work() { JOB_MS } else { 0 });
    // "DONE and ERROR/STATUS are also output for a RESET": with an error if it has ended a job.
    Ok(end.or(resets.then_some(Ok(()))))
}

/// Makes the channel the instance's own. If it cannot be, or a job is cancelled by that, returns how the call ends.
fn own(memory: &mut Memory, laddr: i16, state: &CpState, edge: bool, (instance, now_ms): (u64, u64)) -> Option<End> {
    let claim = &state.send;
    if claim.is_of(instance, memory.start) && memory.laddr == laddr {
        return None;
    }
    // The first call since the start-up of the CPU, or another instance has taken the channel: a job from before is
    // cancelled. [TIA help "Configuration for point-to-point links"]
    let cancelled = memory.has_work();
    memory.renew();
    if !claim.is_unused_but_by(instance) {
        if cancelled {
            // An edge in this call counts in the next one.
            memory.req &= !edge;
            return Some(Some(Err(ABORTED)));
        }
        if !edge {
            return Some(None);
        }
        if !claim.is_abandoned(now_ms) {
            return Some(Some(Err(BUSY)));
        }
    }
    (memory.start, memory.laddr) = (claim.take(instance), laddr);
    if cancelled {
        memory.latched = edge;
        return Some(Some(Err(ABORTED)));
    }
    None
}

/// The edge of REQ: the job has the data that the parameters name now, however long it waits for the CP. [S4 L1598]
fn latch<J: Job>(cx: &mut Cx<'_, CpState>, memory: &mut Memory) -> Result<Result<(), u16>, Abort> {
    memory.latched = false;
    let begun = J::check(cx)?.map_or_else(|status| Ok(Err(status)), |()| J::begin(cx))?;
    Ok(begun.map(|data| (memory.data, memory.latched) = (data, true)))
}

/// One call of the instance that has the channel.
fn run_job<J: Job>(
    cx: &mut Cx<'_, CpState>,
    memory: &mut Memory,
    laddr: i16,
    state: &CpState,
    edge: bool,
) -> Result<End, Abort> {
    if memory.reset {
        return reset_block(cx, memory, laddr, state);
    }
    let latched = if edge && !memory.has_work() { latch::<J>(cx, memory)? } else { Ok(()) };
    if let Err(status) = latched {
        return Ok(Some(Err(status)));
    }
    let cp = match channel::read(cx, laddr, Channel::Send)? {
        Ok(cp) => cp,
        Err(why) => return absent::<J>(cx, memory, why),
    };
    memory.absent_since = None;
    let done = match memory.step(&cp) {
        Act::Wait => Ok(Ok(())),
        Act::Start => ask(cx, memory, laddr, state, &cp)?,
        Act::Begin => {
            memory.latched = false;
            memory.job = if memory.job == u16::MAX { 1 } else { memory.job + 1 };
            (memory.phase, memory.piece) = (Phase::Giving, 0);
            give::<J>(cx, memory, laddr)?
        }
        Act::Give => give::<J>(cx, memory, laddr)?,
        Act::Take => take(cx, memory, laddr, &cp)?,
        Act::Done => return rest(cx, memory, laddr).map(|()| Some(Ok(()))),
        Act::Failed(status) => {
            if memory.phase.has_job() {
                rest(cx, memory, laddr)?;
            }
            return Ok(Some(Err(status)));
        }
    };
    match done {
        Ok(Ok(())) => Ok(None),
        Ok(Err(why)) => {
            memory.phase = Phase::Off;
            unreachable::<J>(cx, why).map(Some)
        }
        Err(Wrong(status)) => {
            // The CP is executing the job: cancel it there.
            let reset = ask(cx, memory, laddr, state, &cp)?;
            if !matches!(reset, Ok(Ok(()))) {
                memory.phase = Phase::Off;
            }
            Ok(Some(Err(status)))
        }
    }
}

/// The job cannot have its data: the data block is missing or too short, and the program continued after OB 121.
struct Wrong(u16);

type Done = Result<Result<(), Unreachable>, Wrong>;

/// R = 1: the block returns to its initial state; a job that the CP has completely is still executed.
fn reset_block(cx: &mut Cx<'_, CpState>, memory: &mut Memory, laddr: i16, state: &CpState) -> Result<End, Abort> {
    let aborted = memory.has_work();
    (memory.latched, memory.absent_since) = (false, None);
    if let Ok(cp) = channel::read(cx, laddr, Channel::Send)? {
        match memory.phase {
            Phase::Starting if memory.start != 0 && cp.start() == memory.start => memory.phase = Phase::Idle,
            Phase::Off | Phase::Giving | Phase::Running | Phase::Taking => {
                if !matches!(ask(cx, memory, laddr, state, &cp)?, Ok(Ok(()))) {
                    memory.phase = Phase::Off;
                }
            }
            Phase::Starting | Phase::Idle => {}
        }
    } else {
        memory.phase = Phase::Off;
    }
    Ok(aborted.then_some(Err(ABORTED)))
}

/// The CP does not answer: a running job is lost, a waiting job waits for a limited time.
fn absent<J: Job>(cx: &mut Cx<'_, CpState>, memory: &mut Memory, why: Unreachable) -> Result<End, Abort> {
    let had_job = memory.phase.has_job();
    memory.phase = Phase::Off;
    if had_job {
        return Ok(Some(Err(CP_RESTARTED)));
    }
    if !memory.latched {
        memory.absent_since = None;
        return Ok(None);
    }
    let now = (cx.now() / 1_000_000) as u32;
    let since = *memory.absent_since.get_or_insert(now);
    if !why.is_hopeless() && now.wrapping_sub(since) < ABSENCE_MS {
        return Ok(None);
    }
    (memory.latched, memory.absent_since) = (false, None);
    unreachable::<J>(cx, why).map(Some)
}

fn unreachable<J: Job>(cx: &mut Cx<'_, CpState>, why: Unreachable) -> Result<Result<(), u16>, Abort> {
    cx.store(J::PARAMS.sfcerr, why.0)?;
    Ok(Err(WRITE_FAILED))
}

/// Requests the start-up coordination with a new number.
fn ask(cx: &mut Cx<'_, CpState>, memory: &mut Memory, laddr: i16, state: &CpState, cp: &Block) -> Result<Done, Abort> {
    memory.start = next_start(cp.start(), memory.start);
    state.send.start.set(memory.start);
    (memory.phase, memory.job) = (Phase::Starting, 0);
    Ok(Ok(channel::write(cx, laddr, Channel::Send, &Block::of_cpu(Command::Start, memory.start, 0))?))
}

/// The job has ended: the CP may delete it.
fn rest(cx: &mut Cx<'_, CpState>, memory: &mut Memory, laddr: i16) -> Result<(), Abort> {
    memory.phase = Phase::Idle;
    // If the CP is gone, its job is gone too.
    let _told = channel::write(cx, laddr, Channel::Send, &Block::of_cpu(Command::Rest, memory.start, memory.job))?;
    Ok(())
}

/// Passes the next piece; a FETCH has none.
fn give<J: Job>(cx: &mut Cx<'_, CpState>, memory: &mut Memory, laddr: i16) -> Result<Done, Abort> {
    let order = J::order(cx)?;
    let mut block =
        Block::of_cpu(Command::Job, memory.start, memory.job).with_piece(memory.piece).with_len(memory.data.len);
    block.set_order(&order);
    let from = memory.piece * PIECE;
    let len = usize::from(memory.data.len.saturating_sub(from).min(PIECE));
    // SF is evaluated only when the job begins: after that the CP requests pieces only for a SEND.
    if (J::has_data(&order) || memory.piece > 0)
        && let Err(status) = J::read(cx, memory.data, from, block.data_mut(len))?
    {
        return Ok(Err(Wrong(status)));
    }
    if memory.piece < pieces(usize::from(memory.data.len)) {
        memory.piece += 1;
    }
    Ok(Ok(channel::write(cx, laddr, Channel::Send, &block)?))
}

/// Stores a piece of fetched data.
fn take(cx: &mut Cx<'_, CpState>, memory: &mut Memory, laddr: i16, cp: &Block) -> Result<Done, Abort> {
    memory.phase = Phase::Taking;
    let from = memory.piece * PIECE;
    let Data { db, byte, len } = memory.data;
    let len = usize::from(cp.len().min(len).saturating_sub(from).min(PIECE));
    let at = u32::from(byte) + u32::from(from);
    if let Err(refused) = cx.write(Area::Db(db), at, &cp.data()[..len])? {
        return wrong_db(cx, refused, db, at, true).map(|status| Err(Wrong(status)));
    }
    memory.piece += 1;
    let block = Block::of_cpu(Command::Job, memory.start, memory.job).with_piece(memory.piece);
    Ok(Ok(channel::write(cx, laddr, Channel::Send, &block)?))
}

/// "Wrong parameters can drive the CPU into STOP": causes the same events as a statement with this operand.
/// [TIA help "PtP data link CP 341"] If the program continues after OB 121, the job ends with this STATUS.
pub(crate) fn wrong_db(
    cx: &mut Cx<'_, CpState>,
    refused: Refused,
    db: u16,
    at: u32,
    writing: bool,
) -> Result<u16, Abort> {
    let (event, number) = fault_of(refused, db, at, writing);
    cx.raise_fault(event, number)?;
    Ok(DB_WRONG)
}

/// The event of a statement whose operand is not accessible, and its additional information.
pub(crate) fn fault_of(refused: Refused, db: u16, at: u32, writing: bool) -> (u16, u32) {
    match refused {
        Refused::NoDb | Refused::DbNumber => (0x253A, u32::from(db)),
        Refused::ReadOnly => (0x2531, u32::from(db)),
        _ if writing => (0x2523, at),
        _ => (0x2522, at),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The segment is not trusted: a CP that shows one piece after the other has no effect beyond the job's length.
    #[test]
    fn a_cp_that_gives_without_end() {
        let data = Data { db: 10, byte: 0, len: 100 };
        let mut memory = Memory { phase: Phase::Running, start: 7, job: 3, data, ..Memory::default() };
        let shown = |piece| Block::of_cp(State::Giving, 7, 3).with_piece(piece);
        for piece in 0..4 {
            assert_eq!(memory.step(&shown(piece)), Act::Take);
            (memory.phase, memory.piece) = (Phase::Taking, piece + 1);
        }
        assert_eq!(memory.step(&shown(4)), Act::Wait, "100 bytes are four pieces");
        assert_eq!(memory.step(&Block::of_cp(State::Done, 7, 3)), Act::Done);
    }
}
