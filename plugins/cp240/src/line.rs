//! FC 8 STEUERBIT: reads the modem lines, switches RTS and DTR [S0 "STUEBIT (FC 8)"].
//!
//! "STATUS returns the actual status of the modem lines" [S0 L1043]: every call with START = 0 reads them; STATUS and
//! DELTA_STATUS come from the last answer of the CP. A call with START = 1 switches the lines selected by the masks;
//! the following calls wait for the answer, which resets START. Both are line commands (`docs/cp240-registers.md`).

use ob1_sdk::{Abort, Block, Cx, Kind, Param, interface};

use crate::module::Module;
use crate::registers::{Count, LINE, LINE_DTR, LINE_RTS, LINE_SET_DTR, LINE_SET_RTS, TX, Words, tx_count};
use crate::state::CpState;

interface! {
    /// The parameters, in the manual's order.
    pub(crate) mod line {
        /// Logical address of the CP.
        in     ADR: Int;
        /// New state of RTS.
        in     RTS: Bool;
        /// New state of DTR.
        in     DTR: Bool;
        /// 1: set RTS.
        in     MASKE_RTS | MASK_RTS: Bool;
        /// 1: set DTR.
        in     MASKE_DTR | MASK_DTR: Bool;
        /// Bits 5 RTS, 4 DTR, 3 CD, 2 RI, 1 DSR, 0 CTS.
        out    STATUS: Byte;
        /// Bits 3 to 0: which of CD, RI, DSR, CTS have changed since the last access.
        out    DELTA_STATUS: Byte;
        /// 1 starts the access; the block resets it when the access has ended.
        in_out START: Bool;
        /// The access is running.
        in_out AUFTRAG_LAEU: Bool;
        /// Always 0.
        out    RET_VAL: Word;
    }
}

/// What a call does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// Nothing, or nothing yet.
    Wait,
    /// Give the command.
    Command,
    /// The answer has arrived: clear the command.
    Done {
        /// STATUS.
        status: u8,
        /// DELTA_STATUS.
        delta: u8,
    },
    /// The CP was reset or restarted and the command is lost: the next call gives it again.
    Lost,
}

/// `running`: the command was given; `held`: the CP has not restarted since. `sends`: FC 0 has a job; "this block must
/// not be called as long as a transmit command is running" [S0 L1035], so it waits instead.
pub(crate) fn step(words: Words, running: bool, held: bool, sends: bool) -> Step {
    if running {
        return match tx_count(words.tx_echo) {
            _ if !held || words.not_ready() => Step::Lost,
            Count::Line { status, delta } => Step::Done { status, delta },
            _ => Step::Wait,
        };
    }
    let free = !words.not_ready() && !sends && words.tx_echo == 0;
    if free { Step::Command } else { Step::Wait }
}

/// The word of a command.
pub(crate) fn command(rts: bool, dtr: bool, set_rts: bool, set_dtr: bool) -> u16 {
    let bits = [(rts, LINE_RTS), (dtr, LINE_DTR), (set_rts, LINE_SET_RTS), (set_dtr, LINE_SET_DTR)];
    bits.into_iter().filter(|(on, _)| *on).fold(LINE, |word, (_, bit)| word | bit)
}

/// FC 8.
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
        if !module.state.lines_known.get() {
            return Ok(());
        }
        cx.set(line::STATUS, module.state.lines.get())?;
        cx.set(line::DELTA_STATUS, module.state.lines_changed.get())
    }
}

fn advance(cx: &mut Cx<'_, CpState>, module: &Module<'_>, words: Words) -> Result<(), Abort> {
    let state = module.state;
    let (start, switches) = (cx.get(line::START)?, cx.get(line::AUFTRAG_LAEU)?);
    let running = switches || state.reads.get();
    let sends = state.send.holds(&module.info) || state.rk512.uses_tx();
    match step(words, running, state.line.holds(&module.info), sends) {
        Step::Command if module.info.present => {
            let word = if start {
                command(cx.get(line::RTS)?, cx.get(line::DTR)?, cx.get(line::MASKE_RTS)?, cx.get(line::MASKE_DTR)?)
            } else {
                LINE
            };
            if module.write(cx, TX, &word.to_be_bytes())? {
                state.line.take(&module.info);
                state.reads.set(!start);
                cx.set(line::AUFTRAG_LAEU, start)?;
            }
            Ok(())
        }
        Step::Command | Step::Wait => Ok(()),
        Step::Done { status, delta } => {
            if !module.write(cx, TX, &[0, 0])? {
                return Ok(());
            }
            state.line.release();
            state.lines_known.set(true);
            state.lines.set(status);
            state.lines_changed.set(delta);
            if state.reads.replace(false) {
                return Ok(());
            }
            cx.set(line::START, false)?;
            cx.set(line::AUFTRAG_LAEU, false)
        }
        Step::Lost => {
            state.line.release();
            // A restarted CP must not take the old command for a new one; a start-up waits for its acknowledgement in
            // the same word.
            if !words.not_ready() && !module.write(cx, TX, &[0, 0])? {
                return Ok(());
            }
            state.reads.set(false);
            cx.set(line::AUFTRAG_LAEU, false)
        }
    }
}
