//! FC 3 SEND_RK512: data to the partner [S0 "SEND\\_RK512"].

use ob1_sdk::types::{Byte, Word};
use ob1_sdk::{Abort, Block, Cx, Formal, Kind, Out, Param, interface};

use super::job::{Job, Phase};
use super::order::{Order, Wish, call};
use crate::state::CpState;

interface! {
    /// The parameters, in the manual's order.
    pub(crate) mod send {
        /// Logical address of the CP.
        in     ADR: Int;
        /// Data block with the data in this CPU.
        in     QDB: BlockDb;
        /// First data word in it.
        in     QBDW: Word;
        /// Words to send, 1 to 512.
        in     LANG: Int;
        /// Data block in the partner, 1 to 255.
        in     ZDB: BlockDb;
        /// First data word in it, 0 to 255.
        in     ZBDW: Int;
        /// Coordination flag: byte and bit, `W#16#0604` is M 6.4 in the partner; FFFFh: none.
        in     KOOR: Word;
        /// Indicator word: state of the order, and its error code.
        out    ANZW: Word;
        /// 1 data block not present, 2 too short, 3 number outside the valid range; returns to 0 automatically.
        out    PAFE: Byte;
        /// Mark of the order (bits 11 to 15) and length of the telegram in bytes.
        in_out ANZ: Word;
        /// Bytes of the telegram transferred so far.
        in_out GESE: Word;
        /// The CP has the header.
        in_out KOPF_GESENET | KOPF_GESE: Bool;
        /// The first block is in the registers.
        in_out ERSTER_BLOCK: Bool;
        /// Header and data are being passed to the CP.
        in_out SENDEN_LAEUFT: Bool;
        /// The CP has the order; the block waits for its result.
        in_out SENDEN_FERTIG: Bool;
        /// The last block has been transferred.
        in_out LETZTER_BLOCK: Bool;
        /// The last order failed; stays until the next one.
        in_out FEHLER: Bool;
    }
}

pub(crate) struct SendRk;

impl Block for SendRk {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = 3;
    const NAME: &'static str = "SEND_RK512";
    const PARAMS: &'static [Param] = send::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        call::<Self>(cx)
    }
}

impl Order for SendRk {
    const NUMBER: u16 = <Self as Block>::NUMBER;
    const COMMAND: u8 = b'A';
    const ANZW: Formal<Word, Out> = send::ANZW;
    const PAFE: Formal<Byte, Out> = send::PAFE;

    fn wish(cx: &mut Cx<'_, CpState>) -> Result<Wish, Abort> {
        Ok(Wish {
            adr: cx.get(send::ADR)?,
            remote: (cx.get(send::ZDB)?, i32::from(cx.get(send::ZBDW)?)),
            local: (cx.get(send::QDB)?, i32::from(cx.get(send::QBDW)?)),
            words: cx.get(send::LANG)?,
            koor: cx.get(send::KOOR)?,
        })
    }

    fn load(cx: &mut Cx<'_, CpState>) -> Result<Job, Abort> {
        let (sending, taken) = (cx.get(send::SENDEN_LAEUFT)?, cx.get(send::SENDEN_FERTIG)?);
        let last = cx.get(send::LETZTER_BLOCK)?;
        let phase = match (sending, taken, last) {
            (true, false, _) => Phase::Sending,
            (true, true, _) => Phase::Receiving,
            (false, true, false) => Phase::Waiting,
            (false, true, true) => Phase::Closing,
            (false, false, _) => Phase::Idle,
        };
        Ok(Job::of(phase, cx.get(send::ANZ)?, cx.get(send::GESE)?, cx.get(send::FEHLER)?))
    }

    fn store(cx: &mut Cx<'_, CpState>, job: Job) -> Result<(), Abort> {
        let sending = job.phase == Phase::Sending;
        let last = job.phase == Phase::Closing || sending && job.total - job.gese.min(job.total) <= 12;
        cx.set(send::ANZ, job.anz())?;
        cx.set(send::GESE, job.gese)?;
        cx.set(send::KOPF_GESENET, job.phase != Phase::Idle && !(sending && job.gese == 0))?;
        cx.set(send::ERSTER_BLOCK, sending && job.gese == 0)?;
        cx.set(send::SENDEN_LAEUFT, matches!(job.phase, Phase::Sending | Phase::Receiving))?;
        cx.set(send::SENDEN_FERTIG, matches!(job.phase, Phase::Waiting | Phase::Receiving | Phase::Closing))?;
        cx.set(send::LETZTER_BLOCK, last)?;
        cx.set(send::FEHLER, job.failed)
    }
}
