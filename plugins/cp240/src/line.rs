//! FC 8 STEUERBIT: reads the modem lines, switches RTS and DTR [S0 "STUEBIT (FC 8)"].
//!
//! A call with START = 1 gives a line command (`docs/cp240-registers.md`); calls that follow wait for the answer,
//! which brings STATUS and DELTA_STATUS and takes START back. With both masks 0 it only reads.

use ob1_sdk::{Abort, Block, Cx, Kind, Param, interface};

use crate::registers::{Count, Module, TX, Words, tx_count};
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
        /// 1 starts the access; the block sets it back when it is done.
        in_out START: Bool;
        /// The access is under way.
        in_out AUFTRAG_LAEU: Bool;
        /// Always 0.
        out    RET_VAL: Word;
    }
}

/// Bits of a line command.
const COMMAND: u16 = 0x1800;
const RTS_BIT: u16 = 1 << 0;
const DTR_BIT: u16 = 1 << 1;
const SET_RTS_BIT: u16 = 1 << 2;
const SET_DTR_BIT: u16 = 1 << 3;

/// What a call does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// Nothing, or nothing yet.
    Wait,
    /// Give the command.
    Command,
    /// The answer is there: take the command back.
    Done {
        /// STATUS.
        status: u8,
        /// DELTA_STATUS.
        delta: u8,
    },
    /// The CP has been reset or its process was lost: the command goes with it, the next call gives it again.
    Lost,
}

/// `running`: the command was given, to the CP as it is now (`held`). `sends`: FC 0 has a job, and "this block must not
/// be called as long as a transmit command is running" [S0 L1035]: it waits instead.
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
    let bits = [(rts, RTS_BIT), (dtr, DTR_BIT), (set_rts, SET_RTS_BIT), (set_dtr, SET_DTR_BIT)];
    bits.into_iter().filter(|(on, _)| *on).fold(COMMAND, |word, (_, bit)| word | bit)
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
        let (start, running) = (cx.get(line::START)?, cx.get(line::AUFTRAG_LAEU)?);
        if !start && !running {
            return Ok(());
        }
        let adr = cx.get(line::ADR)?;
        let Some((module, words)) = Module::words(cx, adr)? else { return Ok(()) };
        let state = module.state;
        let sends = state.send.holds(&module.info) || state.rk512.uses_tx();
        match step(words, running, state.line.holds(&module.info), sends) {
            Step::Command if module.info.present => {
                let word =
                    command(cx.get(line::RTS)?, cx.get(line::DTR)?, cx.get(line::MASKE_RTS)?, cx.get(line::MASKE_DTR)?);
                if module.write(cx, TX, &word.to_be_bytes())? {
                    state.line.take(&module.info);
                    cx.set(line::AUFTRAG_LAEU, true)?;
                }
                Ok(())
            }
            Step::Command | Step::Wait => Ok(()),
            Step::Done { status, delta } => {
                if module.write(cx, TX, &[0, 0])? {
                    state.line.release();
                    cx.set(line::STATUS, status)?;
                    cx.set(line::DELTA_STATUS, delta)?;
                    cx.set(line::START, false)?;
                    cx.set(line::AUFTRAG_LAEU, false)?;
                }
                Ok(())
            }
            Step::Lost => {
                state.line.release();
                // Another life of the CP must not take the old command for a new one; a start-up waits for its
                // acknowledgement in the same word.
                if !words.not_ready() && !module.write(cx, TX, &[0, 0])? {
                    return Ok(());
                }
                cx.set(line::AUFTRAG_LAEU, false)
            }
        }
    }
}
