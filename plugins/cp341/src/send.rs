//! FB 8 P_SND_RK: sends data of a DB, or fetches data of the partner into a DB (RK 512). [reference 1.1, 1.2]
//!
//! A job of LEN bytes takes LEN/32 calls, rounded up, to hand over its data, one more to see that the CP has them, and
//! one that tells the end: at least three. The start-up coordination takes one call before. [reference 1.0]

use ob1_sdk::{Abort, Area, Block, Cx, Kind, Param, Refused, interface};

use crate::channel::{self, FromCp, JOB, PIECE, REST, SEND, START, State, ToCp, Unreachable, next_start, pieces};
use crate::state::CpState;

/// Longest job, bytes.
pub(crate) const LEN_MAX: u16 = 4096;

/// STATUS: job aborted by restart or reset. [reference 3.14]
pub(crate) const ABORTED: u16 = 0x1E0D;
/// STATUS: WR_REC failed; RET_VAL is in SFCERR. [reference 3.14]
const WRITE_FAILED: u16 = 0x1E0F;
/// STATUS: LEN is not 1 to 4096. [reference 3.14]
const LEN_WRONG: u16 = 0x1E41;
/// STATUS: the CP has started again. [reference 3.7]
pub(crate) const CP_RESTARTED: u16 = 0x0501;
/// STATUS: the DB is missing or too short. [reference 3.5]
const DB_WRONG: u16 = 0x0301;

/// How long a job waits for a CP that does not answer: it may be starting. (ours)
const ABSENCE_MS: u32 = 10_000;

interface! {
    /// The parameters, in the manual's order; the instance has 62 bytes.
    pub(crate) mod snd {
        /// 'S' send, 'F' fetch.
        in     SF: Char = b'S';
        /// A rising edge starts a job.
        in     REQ: Bool;
        /// 1 aborts the job and blocks the block.
        in     R: Bool;
        /// Logical base address of the CP.
        in     LADDR: Int;
        /// Data block of the data.
        in     DB_NO: Int;
        /// First byte in it.
        in     DBB_NO: Int;
        /// Bytes, 1 to 4096.
        in     LEN: Int;
        /// Partner's CPU number, 0 to 4.
        in     R_CPU_NO: Int = 1;
        /// Area in the partner.
        in     R_TYP: Char;
        /// Data block in the partner.
        in     R_NO: Int;
        /// First byte, timer or counter in the partner.
        in     R_OFFSET: Int;
        /// Byte of the coordination flag in the partner; 255: none.
        in     R_CF_BYT: Int = 255;
        /// Bit of the coordination flag.
        in     R_CF_BIT: Int;
        /// The job has ended without error: for one call.
        out    DONE: Bool;
        /// It has ended with an error: for one call.
        out    ERROR: Bool;
        /// Event class and number while ERROR is 1.
        out    STATUS: Word;
        /// RET_VAL of WR_REC after 1E0Fh.
        static SFCERR: Word;
        /// Between two calls.
        static MEMORY: Bytes<34>;
    }
}

/// Where the job is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(crate) enum Phase {
    /// The CP does not know the block yet.
    #[default]
    Off,
    /// It has been asked for the start-up coordination.
    Starting,
    Idle,
    /// Data go to the CP.
    Giving,
    /// The CP has the job.
    Running,
    /// Fetched data come.
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

/// What the block remembers between two calls.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(crate) struct Memory {
    pub(crate) phase: Phase,
    /// REQ at the last call.
    pub(crate) req: bool,
    /// A job waits for the start-up coordination: it "is not lost".
    pub(crate) latched: bool,
    /// A job waits for a CP that does not answer, since this time (ms).
    absent_since: Option<u32>,
    pub(crate) start: u16,
    pub(crate) job: u16,
    /// Next piece.
    pub(crate) piece: u16,
    db: u16,
    byte: u16,
    pub(crate) len: u16,
}

/// What a call does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Act {
    Wait,
    /// Ask for the start-up coordination with this number.
    Start,
    /// Begin the job with its first piece.
    Begin,
    /// Give the next piece.
    Give,
    /// Take the piece the CP shows.
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
            absent_since: (bytes[1] & 4 != 0).then_some(since),
            start: word(2),
            job: word(4),
            piece: word(6),
            db: word(8),
            byte: word(10),
            len: word(12),
        }
    }

    fn bytes(&self) -> [u8; 34] {
        let mut bytes = [0; 34];
        bytes[0] = self.phase as u8;
        bytes[1] = u8::from(self.req) | u8::from(self.latched) << 1 | u8::from(self.absent_since.is_some()) << 2;
        let since = self.absent_since.unwrap_or(0);
        let words =
            [self.start, self.job, self.piece, self.db, self.byte, self.len, (since >> 16) as u16, since as u16];
        for (place, word) in bytes[2..].chunks_exact_mut(2).zip(words) {
            place.copy_from_slice(&word.to_be_bytes());
        }
        bytes
    }

    /// A call while R is 0; `cp`: what the CP shows.
    pub(crate) fn step(&mut self, cp: &FromCp) -> Act {
        let known = self.start != 0 && cp.start() == self.start;
        match self.phase {
            Phase::Off => Act::Start,
            Phase::Starting if known => {
                self.phase = Phase::Idle;
                self.step(cp)
            }
            Phase::Starting => Act::Wait,
            // The CP has started again: everything it had is gone.
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
                // It has all, or does not want it: how the job ends is told by the next call.
                State::Running | State::Giving | State::Done | State::Failed => {
                    (self.phase, self.piece) = (Phase::Running, 0);
                    Act::Wait
                }
                _ => Act::Wait,
            },
            Phase::Running | Phase::Taking => match cp.state() {
                State::Done => Act::Done,
                State::Failed => Act::Failed(cp.status()),
                State::Giving if cp.piece() == self.piece => Act::Take,
                _ => Act::Wait,
            },
        }
    }
}

/// FB 8.
pub(crate) struct SendRk;

impl Block for SendRk {
    const KIND: Kind = Kind::Fb;
    const NUMBER: u16 = 8;
    const NAME: &'static str = "P_SND_RK";
    const PARAMS: &'static [Param] = snd::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let mut bytes = [0; 34];
        if cx.load_bytes(snd::MEMORY, 0, &mut bytes)?.is_err() {
            // An instance that is too short: as a statement that reads it.
            return cx.raise_fault(0x2522, 0);
        }
        let before = Memory::of(&bytes);
        let mut memory = before;
        let end = run(cx, &mut memory)?;
        if memory != before {
            let _same_bytes_as_above = cx.store_bytes(snd::MEMORY, 0, &memory.bytes())?;
        }
        // Outputs are those of this call alone. [reference 1.2]
        cx.set(snd::DONE, end == Some(Ok(())))?;
        let status = end.and_then(Result::err).unwrap_or(0);
        cx.set(snd::ERROR, status != 0)?;
        cx.set(snd::STATUS, status)?;
        cx.set_br(status == 0)
    }
}

/// How a job has ended in this call: with a STATUS, or without error.
type End = Option<Result<(), u16>>;

fn run(cx: &mut Cx<'_, CpState>, memory: &mut Memory) -> Result<End, Abort> {
    let (req, reset, laddr) = (cx.get(snd::REQ)?, cx.get(snd::R)?, cx.get(snd::LADDR)?);
    let edge = req && !memory.req;
    memory.req = req;
    let state = match cx.module_state(channel::address(laddr))? {
        Ok(state) => state,
        Err(_) if edge && !reset => return unreachable(cx, Unreachable(0x8090)).map(Some),
        Err(_) => return Ok(None),
    };
    if memory.start != state.send.start.get() {
        // The first call since the start-up of the CPU: what was under way before is cancelled. [reference 1.6]
        let cancelled = memory.phase.has_job();
        *memory = Memory { req, ..Memory::default() };
        if cancelled {
            memory.latched = edge && !reset;
            return Ok(Some(Err(ABORTED)));
        }
    }
    if reset {
        return reset_block(cx, memory, laddr, state);
    }
    if edge && !memory.phase.has_job() && !memory.latched {
        let len = cx.get(snd::LEN)?;
        if !(1..=LEN_MAX as i16).contains(&len) {
            return Ok(Some(Err(LEN_WRONG)));
        }
        memory.latched = true;
    }
    let cp = match channel::read(cx, laddr, SEND)? {
        Ok(cp) => cp,
        Err(why) => return absent(cx, memory, why),
    };
    memory.absent_since = None;
    let done = match memory.step(&cp) {
        Act::Wait => Ok(Ok(())),
        Act::Start => ask(cx, memory, laddr, state, &cp)?,
        Act::Begin => {
            memory.latched = false;
            memory.job = if memory.job == u16::MAX { 1 } else { memory.job + 1 };
            memory.db = cx.get(snd::DB_NO)? as u16;
            memory.byte = cx.get(snd::DBB_NO)? as u16;
            memory.len = cx.get(snd::LEN)? as u16;
            (memory.phase, memory.piece) = (Phase::Giving, 0);
            give(cx, memory, laddr)?
        }
        Act::Give => give(cx, memory, laddr)?,
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
            unreachable(cx, why).map(Some)
        }
        Err(Wrong) => {
            // The CP is in the middle of the job: it is told to forget it.
            let reset = ask(cx, memory, laddr, state, &cp)?;
            if !matches!(reset, Ok(Ok(()))) {
                memory.phase = Phase::Off;
            }
            Ok(Some(Err(DB_WRONG)))
        }
    }
}

/// The data block is missing or too short, and OB 121 has let the program go on.
struct Wrong;

type Done = Result<Result<(), Unreachable>, Wrong>;

/// R = 1: the block goes back to its initial state; what has reached the CP completely is still transmitted.
/// [reference 1.2]
fn reset_block(cx: &mut Cx<'_, CpState>, memory: &mut Memory, laddr: i16, state: &CpState) -> Result<End, Abort> {
    let aborted = memory.phase.has_job() || memory.latched;
    (memory.latched, memory.absent_since) = (false, None);
    if let Ok(cp) = channel::read(cx, laddr, SEND)? {
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

/// The CP does not answer: a job under way is lost, one that waits does so for a while.
fn absent(cx: &mut Cx<'_, CpState>, memory: &mut Memory, why: Unreachable) -> Result<End, Abort> {
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
    // A module that is not there at all will not come.
    let hopeless = why == Unreachable(0x8090) || why == Unreachable(0x80B0);
    if !hopeless && now.wrapping_sub(since) < ABSENCE_MS {
        return Ok(None);
    }
    (memory.latched, memory.absent_since) = (false, None);
    unreachable(cx, why).map(Some)
}

fn unreachable(cx: &mut Cx<'_, CpState>, why: Unreachable) -> Result<Result<(), u16>, Abort> {
    cx.store(snd::SFCERR, why.0)?;
    Ok(Err(WRITE_FAILED))
}

/// Asks for the start-up coordination with a new number.
fn ask(cx: &mut Cx<'_, CpState>, memory: &mut Memory, laddr: i16, state: &CpState, cp: &FromCp) -> Result<Done, Abort> {
    memory.start = next_start(cp.start(), memory.start);
    state.send.start.set(memory.start);
    (memory.phase, memory.job) = (Phase::Starting, 0);
    Ok(Ok(channel::write(cx, laddr, SEND, &ToCp::new(START, memory.start, 0))?))
}

/// The job has ended: the CP may forget it.
fn rest(cx: &mut Cx<'_, CpState>, memory: &mut Memory, laddr: i16) -> Result<(), Abort> {
    memory.phase = Phase::Idle;
    // A CP that is gone by now has forgotten it anyway.
    let _told = channel::write(cx, laddr, SEND, &ToCp::new(REST, memory.start, memory.job))?;
    Ok(())
}

/// The header of the job.
fn header(cx: &mut Cx<'_, CpState>, memory: &Memory) -> Result<ToCp, Abort> {
    let mut block = ToCp::new(JOB, memory.start, memory.job);
    block.0[8] = cx.get(snd::SF)?;
    block.0[9] = cx.get(snd::R_TYP)?;
    block.set(10, memory.len);
    block.set(12, cx.get(snd::R_CPU_NO)? as u16);
    block.set(14, cx.get(snd::R_NO)? as u16);
    block.set(16, cx.get(snd::R_OFFSET)? as u16);
    block.set(18, cx.get(snd::R_CF_BYT)? as u16);
    block.set(20, cx.get(snd::R_CF_BIT)? as u16);
    block.piece(memory.piece);
    Ok(block)
}

/// Gives the next piece; a FETCH has none.
fn give(cx: &mut Cx<'_, CpState>, memory: &mut Memory, laddr: i16) -> Result<Done, Abort> {
    let mut block = header(cx, memory)?;
    let from = memory.piece * PIECE;
    let len = usize::from(memory.len.saturating_sub(from).min(PIECE));
    // SF counts when the job begins: only a SEND is asked for more.
    if block.0[8] == b'S' || memory.piece > 0 {
        let at = u32::from(memory.byte) + u32::from(from);
        if let Err(refused) = cx.read(Area::Db(memory.db), at, block.data(len))? {
            return wrong_db(cx, refused, memory.db, at, false).map(Err);
        }
    }
    if memory.piece < pieces(memory.len) {
        memory.piece += 1;
    }
    Ok(Ok(channel::write(cx, laddr, SEND, &block)?))
}

/// Takes a piece of fetched data.
fn take(cx: &mut Cx<'_, CpState>, memory: &mut Memory, laddr: i16, cp: &FromCp) -> Result<Done, Abort> {
    memory.phase = Phase::Taking;
    let from = memory.piece * PIECE;
    let len = usize::from(cp.len().min(memory.len).saturating_sub(from).min(PIECE));
    let at = u32::from(memory.byte) + u32::from(from);
    if let Err(refused) = cx.write(Area::Db(memory.db), at, &cp.data()[..len])? {
        return wrong_db(cx, refused, memory.db, at, true).map(Err);
    }
    memory.piece += 1;
    let mut block = ToCp::new(JOB, memory.start, memory.job);
    block.piece(memory.piece);
    Ok(Ok(channel::write(cx, laddr, SEND, &block)?))
}

/// "Wrong parameters can drive the CPU into STOP": the same events as for a statement with that operand.
/// [reference 1.0]
fn wrong_db(cx: &mut Cx<'_, CpState>, refused: Refused, db: u16, at: u32, writing: bool) -> Result<Wrong, Abort> {
    let (event, number) = fault_of(refused, db, at, writing);
    cx.raise_fault(event, number)?;
    Ok(Wrong)
}

/// The event of a statement that cannot have its operand, and what it is about.
pub(crate) fn fault_of(refused: Refused, db: u16, at: u32, writing: bool) -> (u16, u32) {
    match refused {
        Refused::NoDb | Refused::DbNumber => (0x253A, u32::from(db)),
        Refused::ReadOnly => (0x2531, u32::from(db)),
        _ if writing => (0x2523, at),
        _ => (0x2522, at),
    }
}
