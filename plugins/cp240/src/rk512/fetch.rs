//! FC 2 FETCH_RK512: data from the partner [S0 "FETCH\\_RK512 (FC 2)"].

use ob1_sdk::types::{Byte, Word};
use ob1_sdk::{Abort, Block, Cx, Formal, Kind, Out, Param, interface};

use super::job::{Job, Phase};
use super::order::{Order, Wish, call};
use crate::state::CpState;

interface! {
    /// The parameters, in the manual's order.
    pub(crate) mod fetch {
        /// Logical address of the CP.
        in     ADR: Int;
        /// Data block in the partner, 1 to 255.
        in     QDB: BlockDb;
        /// First data word in it, 0 to 255.
        in     QBDW: Word;
        /// Words to fetch, 1 to 512.
        in     LANG: Int;
        /// Data block for the data in this CPU.
        in     ZDB: BlockDb;
        /// First data word in it.
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
        /// The header is being passed to the CP.
        in_out KOPF_GESE | KOPF_GESENET: Bool;
        /// The CP has the order; the block waits for its result.
        in_out WART_DATEN: Bool;
        /// The data are being received.
        in_out EMPF_LAEUFT: Bool;
        /// The last block has been stored.
        in_out LETZTER_BLOCK: Bool;
        /// The last order failed; stays until the next one.
        in_out FEHL_KOM | FEHLER_KOM: Bool;
    }
}

pub(crate) struct Fetch;

impl Block for Fetch {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = 2;
    const NAME: &'static str = "FETCH_RK512";
    const PARAMS: &'static [Param] = fetch::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        call::<Self>(cx)
    }
}

impl Order for Fetch {
    const NUMBER: u16 = <Self as Block>::NUMBER;
    const COMMAND: u8 = b'E';
    const ANZW: Formal<Word, Out> = fetch::ANZW;
    const PAFE: Formal<Byte, Out> = fetch::PAFE;

    fn wish(cx: &mut Cx<'_, CpState>) -> Result<Wish, Abort> {
        Ok(Wish {
            adr: cx.get(fetch::ADR)?,
            remote: (cx.get(fetch::QDB)?, i32::from(cx.get(fetch::QBDW)?)),
            local: (cx.get(fetch::ZDB)?, i32::from(cx.get(fetch::ZBDW)?)),
            words: cx.get(fetch::LANG)?,
            koor: cx.get(fetch::KOOR)?,
        })
    }

    fn load(cx: &mut Cx<'_, CpState>) -> Result<Job, Abort> {
        let bits = [
            (cx.get(fetch::LETZTER_BLOCK)?, Phase::Closing),
            (cx.get(fetch::EMPF_LAEUFT)?, Phase::Receiving),
            (cx.get(fetch::WART_DATEN)?, Phase::Waiting),
            (cx.get(fetch::KOPF_GESE)?, Phase::Sending),
        ];
        let phase = bits.into_iter().find(|(bit, _)| *bit).map_or(Phase::Idle, |(_, phase)| phase);
        Ok(Job::of(phase, cx.get(fetch::ANZ)?, cx.get(fetch::GESE)?, cx.get(fetch::FEHL_KOM)?))
    }

    fn store(cx: &mut Cx<'_, CpState>, job: Job) -> Result<(), Abort> {
        cx.set(fetch::ANZ, job.anz())?;
        cx.set(fetch::GESE, job.gese)?;
        cx.set(fetch::KOPF_GESE, job.phase != Phase::Idle)?;
        cx.set(fetch::WART_DATEN, matches!(job.phase, Phase::Waiting | Phase::Receiving | Phase::Closing))?;
        cx.set(fetch::EMPF_LAEUFT, matches!(job.phase, Phase::Receiving | Phase::Closing))?;
        cx.set(fetch::LETZTER_BLOCK, job.phase == Phase::Closing)?;
        cx.set(fetch::FEHL_KOM, job.failed)
    }
}
