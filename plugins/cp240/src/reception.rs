//! What FC 1 RECEIVE and FC 11 ASCII_FRAGMENT have in common: their parameters, the state of a job between two calls,
//! and the way of a block into the data block.

use ob1_sdk::{Abort, Area, Cx, interface};

use crate::module::Module;
use crate::registers::{Pafe, Words};
use crate::state::CpState;

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

    pub(crate) fn store(self, cx: &mut Cx<'_, CpState>) -> Result<(), Abort> {
        cx.set(reception::GEEM, self.geem)?;
        cx.set(reception::ANZ_INT, self.anz_int)?;
        cx.set(reception::EMPF_LAEUFT, self.empf_laeuft)?;
        cx.set(reception::LETZTER_BLOCK, self.letzter_block)?;
        cx.set(reception::FEHLER_EMPF, self.fehler_empf)
    }
}

/// Whether no job may start: the CP is not synchronised, or what it shows belongs to a telegram whose job has failed.
pub(crate) fn is_closed(module: &Module<'_>, words: Words) -> bool {
    let alive = !words.not_ready() && module.info.present;
    let discards = module.state.discard.get();
    module.state.discard.set(alive && discards && words.rx != 0);
    !alive || discards
}

/// The CP has restarted since the job began, and its data are lost.
pub(crate) fn lost(cx: &mut Cx<'_, CpState>, module: &Module<'_>, words: Words, failed: bool) -> Result<(), Abort> {
    // A start-up waits for its acknowledgement in the same word.
    if words.not_ready() || module.write(cx, 0, &[0, 0])? {
        end(cx, module, failed)?;
    }
    Ok(())
}

/// The job is over: the next one may start.
pub(crate) fn end(cx: &mut Cx<'_, CpState>, module: &Module<'_>, failed: bool) -> Result<(), Abort> {
    module.state.receive.release();
    Job { fehler_empf: failed, ..Job::default() }.store(cx)
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
