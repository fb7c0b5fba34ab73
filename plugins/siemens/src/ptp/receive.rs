//! The receiving blocks P_RCV and P_RCV_RK: telegrams of the partner, with RK 512 its SEND and FETCH.
//! [TIA help "PtP data link CP 341"]
//!
//! A job of LEN bytes takes one call to accept it, LEN/32 calls, rounded up, for its data, and one that reports the
//! end: at least three. A FETCH passes its first piece in the call that accepts it. The start-up coordination takes one
//! call before. [CP 341 manual 09/2008, p. 178]

use ob1_sdk::types::{Bool, Bytes, Int, Word};
use ob1_sdk::{Abort, Area, Cx, Formal, In, Out, Static};

use ob1_words::channels::{Block, Channel, Command, NO_FLAG, Offered, PIECE, Refusal, State, pieces};

use crate::outputs::Outputs;

use super::channel::{self, LEN_MAX, Unreachable, next_start};
use super::send::{ABORTED, ABSENCE_MS, CP_RESTARTED, fault_of};
use super::state::{CpState, JOB_MS, WAITING_MS, called};
use super::target::Target;

/// STATUS: RD_REC failed; RET_VAL is in SFCERR. (docs/cp341-events.md)
const READ_FAILED: u16 = 0x1E0E;

/// The phase of the job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(crate) enum Phase {
    /// There is no start-up coordination with the CP yet.
    #[default]
    Off,
    /// The start-up coordination has been requested.
    Starting,
    /// EN_R = 0: nothing is accepted.
    Rest,
    /// Waits for a telegram or a job of the partner.
    Waiting,
    /// Data are being received.
    Taking,
    /// Data are being passed to the CP for the partner.
    Giving,
    /// The block waits for the CP to end the job.
    Finishing,
}

impl Phase {
    fn of(number: u8) -> Self {
        match number {
            1 => Self::Starting,
            2 => Self::Rest,
            3 => Self::Waiting,
            4 => Self::Taking,
            5 => Self::Giving,
            6 => Self::Finishing,
            _ => Self::Off,
        }
    }

    fn has_job(self) -> bool {
        matches!(self, Self::Taking | Self::Giving | Self::Finishing)
    }
}

/// The state of the block between two calls.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(crate) struct Memory {
    pub(crate) phase: Phase,
    /// The channel could not be read at the last call; reported only once.
    unreachable: bool,
    /// R at the last call.
    reset: bool,
    /// LADDR of the start number.
    laddr: i16,
    /// Another instance has the channel: its calls so far, when this one was called last.
    rival: Option<u16>,
    /// The CP does not answer, since this time (ms, the low 32 bits).
    absent_since: Option<u32>,
    pub(crate) start: u16,
    pub(crate) job: u16,
    /// Number of the next piece, as the CP counts.
    pub(crate) piece: u16,
    pub(crate) len: u16,
    /// Area letter of the header; 0: a telegram without one.
    letter: u8,
    /// Location of the data: data block, first byte (timer, counter).
    number: u16,
    offset: u16,
    /// Coordination flag, byte and bit.
    flag: (u16, u16),
}

impl Memory {
    fn of(bytes: &[u8; 34]) -> Self {
        let word = |at: usize| u16::from_be_bytes([bytes[at], bytes[at + 1]]);
        Self {
            phase: Phase::of(bytes[0]),
            unreachable: bytes[1] & 1 != 0,
            reset: bytes[1] & 2 != 0,
            laddr: word(20) as i16,
            rival: (bytes[1] & 4 != 0).then_some(word(22)),
            absent_since: (bytes[1] & 8 != 0).then_some(u32::from(word(24)) << 16 | u32::from(word(26))),
            start: word(2),
            job: word(4),
            piece: word(6),
            len: word(8),
            letter: bytes[10],
            number: word(12),
            offset: word(14),
            flag: (word(16), word(18)),
        }
    }

    fn bytes(&self) -> [u8; 34] {
        let mut bytes = [0; 34];
        let bits = [self.unreachable, self.reset, self.rival.is_some(), self.absent_since.is_some()];
        bytes[0] = self.phase as u8;
        bytes[1] = bits.into_iter().rev().fold(0, |byte, bit| byte << 1 | u8::from(bit));
        let (letter, since) = (u16::from(self.letter) << 8, self.absent_since.unwrap_or(0));
        let words = [self.start, self.job, self.piece, self.len, letter, self.number, self.offset];
        let rest = [self.laddr as u16, self.rival.unwrap_or(0), (since >> 16) as u16, since as u16];
        let words = words.into_iter().chain([self.flag.0, self.flag.1]).chain(rest);
        for (place, word) in bytes[2..].chunks_exact_mut(2).zip(words) {
            place.copy_from_slice(&word.to_be_bytes());
        }
        bytes
    }

    /// What outlasts a job.
    fn kept(&self) -> Self {
        Self { start: self.start, reset: self.reset, laddr: self.laddr, ..Self::default() }
    }

    /// Whether this is the next piece of the job. A CP that shows or asks for more than the job has is not followed.
    fn is_next(&self, piece: u16) -> bool {
        piece == self.piece && piece < pieces(usize::from(self.len))
    }

    /// Location of the data.
    fn target(&self) -> Option<Target> {
        match self.letter {
            // Without a header, and for a DX: DB_NO and DBB_NO.
            0 | b'X' => Some(Target::Bytes(Area::Db(self.number), u32::from(self.offset))),
            letter => Target::of(letter, self.number, self.offset),
        }
    }
}

/// The end of a job: NDR, or a STATUS.
type End = Option<Result<(), u16>>;

/// The parameters that all these blocks have.
#[derive(Clone, Copy, Debug)]
pub struct Params {
    /// 1: data and jobs of the partner are accepted.
    pub en_r: Formal<Bool, In>,
    /// 1 aborts the job and disables the block.
    pub r: Formal<Bool, In>,
    /// Logical base address of the CP.
    pub laddr: Formal<Int, In>,
    /// Data block for the data; with RK 512 for data to a DX.
    pub db_no: Formal<Int, In>,
    /// First byte in it.
    pub dbb_no: Formal<Int, In>,
    /// NDR, ERROR and STATUS: for one call the end of the job, with an error event class and number.
    pub outputs: Outputs,
    /// Bytes of the telegram, while NDR is 1.
    pub len: Formal<Int, Out>,
    /// RET_VAL of the record transfer.
    pub sfcerr: Static<Word>,
    /// The state between two calls.
    pub memory: Static<Bytes<34>>,
}

/// The [`Params`](super::receive::Params) of a block, collected by their names.
#[macro_export]
macro_rules! receive_params {
    ($block:ident) => {
        $crate::ptp::receive::Params {
            en_r: $block::EN_R,
            r: $block::R,
            laddr: $block::LADDR,
            db_no: $block::DB_NO,
            dbb_no: $block::DBB_NO,
            outputs: $crate::outputs::Outputs { end: $block::NDR, error: $block::ERROR, status: $block::STATUS },
            len: $block::LEN,
            sfcerr: $block::SFCERR,
            memory: $block::MEMORY,
        }
    };
}

/// The received telegram or job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Received {
    /// Length of the telegram or job in bytes.
    pub len: u16,
    /// Area letter of the header; 0: a telegram without one.
    pub letter: u8,
    /// Location of the data: data block, first byte (timer, counter).
    pub number: u16,
    /// First byte, timer or counter.
    pub offset: u16,
    /// Coordination flag, byte and bit; byte 255: none.
    pub flag: (u16, u16),
}

/// One call of the block: sets NDR with the result, or ERROR with a STATUS, or neither, and BR. The outputs are valid
/// for this call only. [TIA help "PtP data link CP 341"]
///
/// # Errors
/// [`Abort`] of a host function: the call ends at once.
pub fn call(cx: &mut Cx<'_, CpState>, params: &Params) -> Result<Option<Received>, Abort> {
    let end = job(cx, params)?;
    let failed = end.and_then(Result::err).filter(|status| *status != 0);
    let received = end.and_then(Result::ok);
    cx.set(params.len, received.map_or(0, |received| received.len as i16))?;
    params.outputs.set(cx, received.is_some(), failed, 0)?;
    Ok(received)
}

fn job(cx: &mut Cx<'_, CpState>, params: &Params) -> Result<Option<Result<Received, u16>>, Abort> {
    let mut bytes = [0; 34];
    if cx.load_bytes(params.memory, 0, &mut bytes)?.is_err() {
        // The instance is too short: the same event as for a statement that reads it.
        cx.raise_fault(0x2522, 0)?;
        return Ok(None);
    }
    let before = Memory::of(&bytes);
    let mut memory = before;
    let end = run(cx, params, &mut memory)?;
    if memory != before {
        let _same_bytes_as_above = cx.store_bytes(params.memory, 0, &memory.bytes())?;
    }
    let Memory { len, letter, number, offset, flag, .. } = memory;
    Ok(end.map(|outcome| outcome.map(|()| Received { len, letter, number, offset, flag })))
}

fn run(cx: &mut Cx<'_, CpState>, params: &Params, memory: &mut Memory) -> Result<End, Abort> {
    let (enabled, reset, laddr) = (cx.get(params.en_r)?, cx.get(params.r)?, cx.get(params.laddr)?);
    let takes = enabled && !reset;
    let resets = reset && !memory.reset;
    memory.reset = reset;
    let Ok(state) = cx.module_state(channel::address(laddr))? else {
        let had_job = memory.phase.has_job();
        memory.phase = Phase::Off;
        return unreachable(cx, params, memory, takes || resets || had_job, Unreachable(0x8090));
    };
    let (instance, now_ms) = called(cx)?;
    let end = match own(cx, params, memory, laddr, state, takes, (instance, now_ms))? {
        Some(end) => end,
        None => run_job(cx, params, memory, laddr, state, takes, now_ms)?,
    };
    let keeps = match memory.phase {
        phase if phase.has_job() => JOB_MS,
        _ if takes => WAITING_MS,
        _ => 0,
    };
    state.receive.keep(instance, now_ms, keeps);
    if resets && end.is_none() {
        // "NDR and ERROR/STATUS are also output on reset, with LEN = 0". [TIA help "PtP data link CP 341"]
        (memory.len, memory.letter, memory.number, memory.offset, memory.flag) = (0, 0, 0, 0, (NO_FLAG, 0));
        return Ok(Some(Ok(())));
    }
    Ok(end)
}

/// Makes the channel the instance's own. If it cannot be, or a job is cancelled by that, returns how the call ends.
fn own(
    cx: &mut Cx<'_, CpState>,
    params: &Params,
    memory: &mut Memory,
    laddr: i16,
    state: &CpState,
    takes: bool,
    (instance, now_ms): (u64, u64),
) -> Result<Option<End>, Abort> {
    let claim = &state.receive;
    if claim.is_of(instance, memory.start) && memory.laddr == laddr {
        return Ok(None);
    }
    // The first call since the start-up of the CPU, or another instance has taken the channel: a job from before is
    // cancelled. [TIA help "Configuration for point-to-point links"]
    let cancelled = memory.phase.has_job();
    let Memory { reset, unreachable: told, rival, .. } = *memory;
    *memory = Memory { reset, ..Memory::default() };
    let has = claim.is_unused_but_by(instance) || takes && claim.is_abandoned(now_ms);
    if has {
        (memory.start, memory.laddr) = (claim.take(instance), laddr);
    }
    if cancelled {
        return Ok(Some(Some(Err(ABORTED))));
    }
    if has || !takes {
        return Ok(if has { None } else { Some(None) });
    }
    let calls = claim.calls.get();
    (memory.unreachable, memory.rival) = (told, Some(calls));
    // An error only if both are called: a program may go over from one to the other.
    let both = rival.is_some_and(|before| before != calls);
    unreachable(cx, params, memory, both, Unreachable::IN_USE).map(Some)
}

/// One call of the instance that has the channel.
fn run_job(
    cx: &mut Cx<'_, CpState>,
    params: &Params,
    memory: &mut Memory,
    laddr: i16,
    state: &CpState,
    takes: bool,
    now_ms: u64,
) -> Result<End, Abort> {
    let cp = match channel::read(cx, laddr, Channel::Receive)? {
        Ok(cp) => cp,
        Err(why) => {
            let had_job = memory.phase.has_job();
            memory.phase = Phase::Off;
            if had_job {
                return Ok(Some(Err(CP_RESTARTED)));
            }
            let since = *memory.absent_since.get_or_insert(now_ms as u32);
            let is_starting = why == Unreachable::ABSENT && (now_ms as u32).wrapping_sub(since) < ABSENCE_MS;
            return unreachable(cx, params, memory, takes && !is_starting, why);
        }
    };
    (memory.unreachable, memory.absent_since) = (false, None);
    let reset = memory.reset;
    let mut block = Call { cx, params, memory, laddr, state, cp };
    block.step(takes, reset)
}

/// The permanent error of RD_REC: reported once, and only while the block is enabled.
fn unreachable(
    cx: &mut Cx<'_, CpState>,
    params: &Params,
    memory: &mut Memory,
    takes: bool,
    why: Unreachable,
) -> Result<End, Abort> {
    if !takes || memory.unreachable {
        return Ok(None);
    }
    memory.unreachable = true;
    cx.store(params.sfcerr, why.0)?;
    Ok(Some(Err(READ_FAILED)))
}

/// One call and its channel.
struct Call<'a, 'c> {
    cx: &'a mut Cx<'c, CpState>,
    params: &'a Params,
    memory: &'a mut Memory,
    laddr: i16,
    state: &'a CpState,
    cp: Block,
}

impl Call<'_, '_> {
    fn step(&mut self, takes: bool, reset: bool) -> Result<End, Abort> {
        let known = self.memory.start != 0 && self.cp.start() == self.memory.start;
        let had_job = self.memory.phase.has_job();
        match self.memory.phase {
            Phase::Off => {
                self.begin(takes)?;
                return Ok(None);
            }
            Phase::Starting if !known => return Ok(None),
            Phase::Starting => {
                self.memory.phase = Phase::Waiting;
                self.show(Command::Wait)?;
            }
            // The CP has restarted: all its jobs are lost.
            _ if !known => {
                self.memory.phase = Phase::Off;
                self.begin(takes)?;
                return Ok(had_job.then_some(Err(CP_RESTARTED)));
            }
            _ => {}
        }
        if !takes {
            // "The aborted job ends with an error"; R resets the block to its initial state.
            if had_job && reset {
                self.begin(false)?;
            } else if self.memory.phase != Phase::Rest {
                self.memory.phase = Phase::Rest;
                let block = self.shown(Command::Rest);
                self.write(&if had_job { block.dropping() } else { block })?;
            }
            return Ok(had_job.then_some(Err(ABORTED)));
        }
        match self.memory.phase {
            Phase::Rest => {
                self.memory.phase = Phase::Waiting;
                self.show(Command::Wait)?;
                Ok(None)
            }
            Phase::Waiting => self.wait(),
            _ if self.cp.job() != self.memory.job => Ok(None),
            Phase::Taking => self.take(),
            Phase::Giving => self.give_more(),
            _ => self.finish(),
        }
    }

    /// Requests the start-up coordination with a new number.
    fn begin(&mut self, takes: bool) -> Result<(), Abort> {
        let start = next_start(self.cp.start(), self.memory.start);
        *self.memory = Memory { phase: Phase::Starting, start, ..self.memory.kept() };
        self.state.receive.start.set(start);
        self.write(&Block::of_cpu(Command::Start, start, 0).with_takes(takes))
    }

    fn shown(&self, command: Command) -> Block {
        Block::of_cpu(command, self.memory.start, self.memory.job).with_piece(self.memory.piece)
    }

    fn show(&mut self, command: Command) -> Result<(), Abort> {
        self.write(&self.shown(command))
    }

    fn write(&mut self, block: &Block) -> Result<(), Abort> {
        // If the CP has failed since it was read, the next call detects this.
        let _told = channel::write(self.cx, self.laddr, Channel::Receive, block)?;
        Ok(())
    }

    /// Checks whether the CP offers something.
    fn wait(&mut self) -> Result<End, Abort> {
        if self.cp.job() == self.memory.job {
            return Ok(None);
        }
        match self.cp.state() {
            State::Failed => {
                self.memory.job = self.cp.job();
                self.show(Command::Wait)?;
                Ok(Some(Err(self.cp.status())))
            }
            State::Offered => self.accept(),
            _ => Ok(None),
        }
    }

    /// Checks the header, and accepts or refuses the job.
    fn accept(&mut self) -> Result<End, Abort> {
        let header = self.cp.header();
        let (is_fetch, letter) = (header.kind == Offered::Provide, header.letter);
        *self.memory = Memory {
            phase: Phase::Taking,
            job: self.cp.job(),
            len: self.cp.len().min(LEN_MAX),
            letter,
            number: header.number,
            offset: header.offset,
            flag: header.flag,
            ..self.memory.kept()
        };
        if letter == 0 {
            self.memory.flag = (NO_FLAG, 0);
        }
        if letter == 0 || letter == b'X' && !is_fetch {
            self.memory.number = self.cx.get(self.params.db_no)? as u16;
            self.memory.offset = self.cx.get(self.params.dbb_no)? as u16;
        }
        if self.locked()? {
            return self.refuse(Refusal::Locked);
        }
        let target = if is_fetch && letter == b'X' { None } else { self.memory.target() };
        let Some(target) = target else { return self.refuse(Refusal::Area) };
        match target.check(self.cx, self.memory.len)? {
            Ok(()) => {}
            // The program has named the data block: "wrong parameters can drive the CPU into STOP".
            Err(refusal) if letter == 0 || letter == b'X' => {
                let (db, at) = (self.memory.number, u32::from(self.memory.offset));
                let refused = if refusal == Refusal::Db { ob1_sdk::Refused::NoDb } else { ob1_sdk::Refused::Outside };
                let (event, about) = fault_of(refused, db, at, true);
                self.cx.raise_fault(event, about)?;
                return self.refuse(Refusal::Reset);
            }
            Err(refusal) => return self.refuse(refusal),
        }
        if is_fetch {
            self.memory.phase = Phase::Giving;
            return self.give();
        }
        self.show(Command::Job)?;
        Ok(None)
    }

    /// The coordination flag is checked before any data are transferred. [TIA help "PtP data link CP 341"]
    fn locked(&mut self) -> Result<bool, Abort> {
        let (byte, bit) = self.memory.flag;
        if byte == NO_FLAG {
            return Ok(false);
        }
        // If the bit memory does not have this byte, the flag is not set.
        Ok(self.cx.bit(Area::Memory, u32::from(byte), bit as u8)?.unwrap_or(false))
    }

    fn refuse(&mut self, refusal: Refusal) -> Result<End, Abort> {
        let block = Block::of_cpu(Command::Refuse, self.memory.start, self.memory.job).with_refusal(refusal);
        // The CP ends the job with the STATUS for this reason.
        self.memory.phase = Phase::Finishing;
        self.write(&block)?;
        Ok(None)
    }

    /// The next piece of data of the partner.
    fn take(&mut self) -> Result<End, Abort> {
        match self.cp.state() {
            State::Failed => return self.end(Err(self.cp.status())),
            State::Giving if self.memory.is_next(self.cp.piece()) => {}
            _ => return Ok(None),
        }
        let from = self.memory.piece * PIECE;
        let len = usize::from(self.memory.len.saturating_sub(from).min(PIECE));
        let data = self.cp;
        let Some(target) = self.memory.target() else { return self.refuse(Refusal::Area) };
        if target.write(self.cx, from, &data.data()[..len])?.is_err() {
            // The data block was deleted, shortened or write-protected after the header was checked.
            return self.refuse(Refusal::Range);
        }
        self.memory.piece += 1;
        if self.memory.piece >= pieces(usize::from(self.memory.len)) {
            self.memory.phase = Phase::Finishing;
        }
        self.show(Command::Job)?;
        Ok(None)
    }

    /// The next piece of data for the partner.
    fn give_more(&mut self) -> Result<End, Abort> {
        match self.cp.state() {
            State::Failed => self.end(Err(self.cp.status())),
            State::Collecting if self.memory.is_next(self.cp.piece()) => self.give(),
            // The CP has all data.
            State::Running | State::Done => {
                self.memory.phase = Phase::Finishing;
                Ok(None)
            }
            _ => Ok(None),
        }
    }

    fn give(&mut self) -> Result<End, Abort> {
        let from = self.memory.piece * PIECE;
        let len = usize::from(self.memory.len.saturating_sub(from).min(PIECE));
        let mut block = Block::of_cpu(Command::Job, self.memory.start, self.memory.job).with_piece(self.memory.piece);
        let Some(target) = self.memory.target() else { return self.refuse(Refusal::Area) };
        if let Err(refusal) = target.read(self.cx, from, block.data_mut(len))? {
            return self.refuse(refusal);
        }
        self.write(&block)?;
        self.memory.piece += 1;
        Ok(None)
    }

    fn finish(&mut self) -> Result<End, Abort> {
        match self.cp.state() {
            State::Failed => self.end(Err(self.cp.status())),
            State::Done => {
                let (byte, bit) = self.memory.flag;
                if byte != NO_FLAG {
                    // The program resets the flag when it has used the data. [TIA help "PtP data link CP 341"]
                    let _without_such_a_byte = self.cx.set_bit(Area::Memory, u32::from(byte), bit as u8, true)?;
                }
                self.end(Ok(()))
            }
            _ => Ok(None),
        }
    }

    /// The job has ended, the block waits for the next one.
    fn end(&mut self, outcome: Result<(), u16>) -> Result<End, Abort> {
        self.memory.phase = Phase::Waiting;
        self.show(Command::Wait)?;
        Ok(Some(outcome))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The segment is not trusted: a CP that asks for one piece after the other gets no more than the job has.
    #[test]
    fn a_cp_that_asks_without_end() {
        let mut memory = Memory { phase: Phase::Giving, len: 100, ..Memory::default() };
        for piece in 0..4 {
            memory.piece = piece;
            assert!(memory.is_next(piece) && !memory.is_next(piece + 1));
        }
        memory.piece = 4;
        assert!(!memory.is_next(4), "100 bytes are four pieces");
        assert!(!Memory { piece: u16::MAX, ..memory }.is_next(u16::MAX));
    }
}
