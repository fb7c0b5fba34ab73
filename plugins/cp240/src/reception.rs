//! What FC 1 RECEIVE and FC 11 ASCII_FRAGMENT have in common: their parameters, the state of a job between two calls,
//! and the way of a block into the data block.

use std::cell::Cell;

use ob1_sdk::{Abort, Area, Cx, ModuleInfo, interface};

use crate::module::Module;
use crate::pafe::Pafe;
use crate::registers::{AREA, BLOCK_BYTES, BROKEN_OFF, COUNT_BITS, MORE, OUTSIDE, Words};
use crate::state::CpState;
use crate::turn::{Claim, Key};

interface! {
    /// The parameters, in the manual's order; FC 1 and FC 11 have the same.
    pub(crate) mod reception {
        /// Logical address of the CP.
        in     ADR: Int;
        /// Data block for the telegram.
        in     _DB: BlockDb;
        /// First byte of the telegram in it (a byte, as for SEND).
        in     ABD | ADB: Word;
        /// Bytes received: the whole telegram.
        out    ANZ: Word;
        /// 1: a telegram is stored. The program resets the bit; until then no further telegram is accepted.
        in_out EMFR: Bool;
        /// Bytes of the telegram stored so far.
        in_out GEEM: Word;
        /// FC 1: the length of the telegram that is being received. FC 11: the count of the block stored last; 0 while
        /// waiting for the next one.
        in_out ANZ_INT: Word;
        /// A job is running.
        in_out EMPF_LAEUFT | EMP_LAEUFT: Bool;
        /// The last block is stored: the telegram is complete.
        in_out LETZTER_BLOCK: Bool;
        /// The last job failed; stays until the next one starts.
        in_out FEHLER_EMPF | FEHL_EMPF: Bool;
        /// 1 data block not present, 2 too short, 3 number outside the valid range; returns to 0 automatically.
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

impl Job {
    pub(crate) fn load(cx: &mut Cx<'_, CpState>) -> Result<Self, Abort> {
        Ok(Self {
            geem: cx.get(reception::GEEM)?,
            anz_int: cx.get(reception::ANZ_INT)?,
            empf_laeuft: cx.get(reception::EMPF_LAEUFT)?,
            letzter_block: cx.get(reception::LETZTER_BLOCK)?,
            fehler_empf: cx.get(reception::FEHLER_EMPF)?,
        })
    }

    /// The control words of the job: they must be those of the claim.
    fn progress(self) -> u32 {
        u32::from(self.geem) << 16 | u32::from(self.anz_int)
    }

    pub(crate) fn store(self, cx: &mut Cx<'_, CpState>) -> Result<(), Abort> {
        cx.set(reception::GEEM, self.geem)?;
        cx.set(reception::ANZ_INT, self.anz_int)?;
        cx.set(reception::EMPF_LAEUFT, self.empf_laeuft)?;
        cx.set(reception::LETZTER_BLOCK, self.letzter_block)?;
        cx.set(reception::FEHLER_EMPF, self.fehler_empf)
    }
}

ob1_sdk::state! {
    /// What FC 1 and FC 11 store for a module.
    #[derive(Debug, Default)]
    pub(crate) struct Reception {
        /// The block that takes the telegram in `RX`.
        claim: Claim,
        /// When a call with the key of that block, but without its control bits, was last seen.
        without_bits: Cell<u64>,
        /// What is left of a telegram whose job has failed or was abandoned.
        discard: Cell<u8>,
        /// Modbus slave "long": start of the changed area that is being received.
        pub(crate) offset: Cell<u16>,
        /// Modbus slave "long": bytes of the last changed area if it did not fit, otherwise 0.
        pub(crate) outside: Cell<u16>,
        /// FC 1 has something to do even if `RX` is 0 and none of its jobs runs.
        pub(crate) stands: Cell<bool>,
    }
}

/// [`Reception::discard`]: nothing; what stands in `RX`; that, and the parts of ASCII-fragmented that follow.
const NOTHING: u8 = 0;
const SHOWN: u8 = 1;
const PARTS: u8 = 2;

/// Whether the word announces further parts of ASCII-fragmented.
fn more_follows(rx: u16) -> bool {
    rx & MORE != 0 && (1..=BLOCK_BYTES).contains(&(rx & COUNT_BITS))
}

impl Reception {
    /// A block takes the telegram in `RX`.
    pub(crate) fn take(&self, key: Key, info: &ModuleInfo, now: u64) {
        self.claim.take(key, info, now);
    }

    /// Whether the rest of a telegram is being dropped.
    pub(crate) fn is_discarding(&self) -> bool {
        self.discard.get() != NOTHING
    }

    /// FC 9 has synchronised: nothing is being received.
    pub(crate) fn clear(&self) {
        self.claim.clear();
        self.discard.set(NOTHING);
    }

    /// The job ends before its telegram: the CP keeps the rest until it is fetched. `before`: ANZ_INT of the job.
    pub(crate) fn fail(&self, rx: u16, before: u16) {
        self.claim.release();
        let parts = more_follows(before) || more_follows(rx);
        self.discard.set(match rx {
            _ if parts => PARTS,
            0 => NOTHING,
            _ => SHOWN,
        });
    }
}

/// What a call may do with `RX`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Turn {
    /// Continue the job that it has.
    GoOn,
    /// Begin a job with the telegram in `RX`.
    Begin,
    /// Leave `RX` alone: it is another block's.
    No,
}

/// Whose turn it is. A telegram belongs to the block that has taken its first bytes: two blocks at one CP never take it
/// twice. If that block is no longer called, its telegram is dropped, and the next one is for the block that asks.
pub(crate) fn turn(
    cx: &mut Cx<'_, CpState>,
    module: &Module<'_>,
    job: Job,
    key: Key,
    words: Words,
) -> Result<Turn, Abort> {
    let (state, info, now) = (&module.state.reception, &module.info, cx.now());
    let (claim, closed) = (&state.claim, module.is_closed(words));
    if job.empf_laeuft {
        if claim.continues(key, job.progress(), info, now) && !closed {
            return Ok(Turn::GoOn);
        }
        return lost(cx, module, job, key, words).map(|()| Turn::No);
    }
    if closed || !info.present {
        state.discard.set(NOTHING);
        return Ok(Turn::No);
    }
    if claim.holds(info) && claim.is_busy() {
        // The owner itself calls without the control bits of its job: the program has reset them.
        let resigned = claim.is_of(key) && claim.seen() < state.without_bits.get();
        if claim.is_of(key) {
            state.without_bits.set(now);
        }
        if claim.is_alive(info, now) && !resigned {
            return Ok(Turn::No);
        }
        let before = claim.progress() as u16;
        claim.abandon();
        state.fail(words.rx, before);
        if before == 0 {
            // FC 11, between two parts.
            state.discard.set(PARTS);
        }
    }
    if state.discard.get() == NOTHING {
        return Ok(Turn::Begin);
    }
    drain(cx, module, words.rx).map(|()| Turn::No)
}

/// Fetches what nobody stores.
fn drain(cx: &mut Cx<'_, CpState>, module: &Module<'_>, rx: u16) -> Result<(), Abort> {
    let discard = &module.state.reception.discard;
    let echo = match rx {
        MORE | BROKEN_OFF => MORE,
        // The master must not be told that the CPU has its data.
        rx if rx & AREA != 0 => OUTSIDE,
        rx => rx,
    };
    if module.write(cx, 0, &echo.to_be_bytes())? {
        discard.set(match (rx, discard.get()) {
            (0, SHOWN) => NOTHING,
            (0, before) => before,
            (rx, _) if more_follows(rx) => PARTS,
            _ => SHOWN,
        });
    }
    Ok(())
}

/// The job is none, or no longer: the CP has restarted since it began, or another block asked while this one was not
/// called. A telegram whose last block is already stored stays valid.
fn lost(cx: &mut Cx<'_, CpState>, module: &Module<'_>, job: Job, key: Key, words: Words) -> Result<(), Abort> {
    let (state, info) = (&module.state.reception, &module.info);
    let is_mine = state.claim.is_of(key);
    // A start-up waits for its acknowledgement in the same word.
    let may_clear = !module.is_closed(words) && (is_mine || !state.claim.holds(info));
    if may_clear && !module.write(cx, 0, &[0, 0])? {
        return Ok(());
    }
    match is_mine {
        true if state.claim.holds(info) => state.fail(words.rx, job.anz_int),
        true => state.claim.release(),
        false => state.claim.orphan_told(),
    }
    Job { fehler_empf: !job.letzter_block || job.fehler_empf, ..Job::default() }.store(cx)
}

/// The job of this block is over: the next one may start.
pub(crate) fn end(cx: &mut Cx<'_, CpState>, module: &Module<'_>, failed: bool) -> Result<(), Abort> {
    module.state.reception.claim.release();
    Job { fehler_empf: failed, ..Job::default() }.store(cx)
}

/// The job goes on with the next call.
pub(crate) fn keep(cx: &mut Cx<'_, CpState>, module: &Module<'_>, job: Job) -> Result<(), Abort> {
    module.state.reception.claim.note(job.progress());
    job.store(cx)
}

/// The telegram is the program's.
pub(crate) fn hand_over(cx: &mut Cx<'_, CpState>, bytes: u16) -> Result<(), Abort> {
    cx.set(reception::ANZ, bytes)?;
    cx.set(reception::EMFR, true)
}

/// Stores bytes of a telegram in the program's data block. The error is the value of PAFE: a block that does not fit
/// waits in the CP until it does (ours).
pub(crate) fn put(cx: &mut Cx<'_, CpState>, db: u16, at: u32, bytes: &[u8]) -> Result<Result<(), Pafe>, Abort> {
    let Err(refused) = cx.write(Area::Db(db), at, bytes)? else { return Ok(Ok(())) };
    match Pafe::of(refused) {
        Some(pafe) => Ok(Err(pafe)),
        None => cx.raise_fault(0x2530, u32::from(db)).map(|()| Err(Pafe::Ok)),
    }
}
