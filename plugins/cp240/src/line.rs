//! FC 8 STEUERBIT: reads the modem lines, switches RTS and DTR [S0 "STUEBIT (FC 8)"].
//!
//! "STATUS returns the actual status of the modem lines" [S0 L1043]: every call with START = 0 reads them; STATUS and
//! DELTA_STATUS come from the last answer of the CP. A call with START = 1 switches the lines selected by the masks;
//! the following calls wait for the answer, which resets START. Both are line commands (`docs/cp240-registers.md`).

use ob1_sdk::{Abort, Block, Cx, Kind, Param, interface};

use crate::module::Module;
use crate::registers::{LINE, LINE_DTR, LINE_RTS, LINE_SET_DTR, LINE_SET_RTS, TX, Words};
use crate::state::CpState;
use crate::tx::{LINES, Line as Answer, acquire, give, settle};

interface! {
    /// The parameters, in the manual's order.
    pub(crate) mod line {
        /// Logical address of the CP.
        in     ADR: Int;
        /// New state of RTS.
        in     RTS: Bool;
        /// New state of DTR.
        in     DTR: Bool;
        /// 1: RTS takes the state of the parameter RTS.
        in     MASKE_RTS | MASK_RTS: Bool;
        /// 1: DTR takes the state of the parameter DTR.
        in     MASKE_DTR | MASK_DTR: Bool;
        /// Bits 5 RTS, 4 DTR, 3 CD, 2 RI, 1 DSR, 0 CTS.
        out    STATUS: Byte;
        /// Bits 3 to 0: which of CD, RI, DSR, CTS have changed since the last access.
        out    DELTA_STATUS: Byte;
        /// 1 starts the access; the block resets it when the access has ended.
        in_out START: Bool;
        /// The access is running.
        in_out AUFTRAG_LAEU: Bool;
        /// Always 0: the manual names no error.
        out    RET_VAL: Word;
    }
}

/// The word of a command.
pub(crate) fn command(rts: bool, dtr: bool, set_rts: bool, set_dtr: bool) -> u16 {
    let bits = [(rts, LINE_RTS), (dtr, LINE_DTR), (set_rts, LINE_SET_RTS), (set_dtr, LINE_SET_DTR)];
    bits.into_iter().filter(|(on, _)| *on).fold(LINE, |word, (_, bit)| word | bit)
}

pub(crate) struct Line;

impl Block for Line {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = 8;
    const NAME: &'static str = "STEUERBIT";
    const PARAMS: &'static [Param] = line::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        cx.set(line::RET_VAL, 0)?;
        let adr = cx.get(line::ADR)?;
        let Some((module, words)) = Module::words(cx, adr)? else { return Ok(()) };
        advance(cx, &module, words)?;
        let tx = &module.state.tx;
        if !tx.lines_known.get() {
            return Ok(());
        }
        cx.set(line::STATUS, tx.lines.get())?;
        cx.set(line::DELTA_STATUS, tx.lines_changed.get())
    }
}

fn advance(cx: &mut Cx<'_, CpState>, module: &Module<'_>, words: Words) -> Result<(), Abort> {
    let (tx, now) = (&module.state.tx, cx.now());
    let answer = settle(cx, module, words, now)?;
    if cx.get(line::AUFTRAG_LAEU)? {
        return switching(cx, module, words, answer);
    }
    if answer != Answer::None || module.is_closed(words) || !module.info.present {
        return Ok(());
    }
    // "This block must not be called as long as a transmit command is running" [S0 L1035]: it waits instead.
    if cx.get(line::START)? {
        if !acquire(cx, module, words, LINES, now)? {
            return Ok(());
        }
        let word = command(cx.get(line::RTS)?, cx.get(line::DTR)?, cx.get(line::MASKE_RTS)?, cx.get(line::MASKE_DTR)?);
        if give(cx, module, word, true, now)? {
            tx.turn.claim.release();
            cx.set(line::AUFTRAG_LAEU, true)?;
        }
        return Ok(());
    }
    // A reading gives way to every job. It is done in between, by the next block that gets TX.
    if !tx.turn.is_free(LINES, &module.info, now) {
        tx.wanted.set(true);
        return Ok(());
    }
    if acquire(cx, module, words, LINES, now)? {
        give(cx, module, LINE, false, now)?;
    }
    tx.turn.claim.release();
    Ok(())
}

/// The lines are being switched. A command that the CP has forgotten is given again by the next call.
fn switching(cx: &mut Cx<'_, CpState>, module: &Module<'_>, words: Words, answer: Answer) -> Result<(), Abort> {
    let tx = &module.state.tx;
    if answer == Answer::Waits {
        return Ok(());
    }
    if tx.switched.take() {
        cx.set(line::START, false)?;
        return cx.set(line::AUFTRAG_LAEU, false);
    }
    // A restarted CP must not take the old command for a new one; a start-up waits for its acknowledgement in the same
    // word.
    if !module.is_closed(words) && tx.is_unused(&module.info) && !module.write(cx, TX, &[0, 0])? {
        return Ok(());
    }
    cx.set(line::AUFTRAG_LAEU, false)
}
