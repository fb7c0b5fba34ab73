//! FC 9 SYNCHRON_RESET: acknowledges the start-up identifier of the CP, resets it on request [S0 "SYNCHRON_"],
//! [S0 L1057-L1110].

use ob1_sdk::{Abort, Block, Cx, Kind, Param, TimerKind, interface};

use crate::module::Module;
use crate::registers::{NO_PARAMETERS, RESET, STARTUP, SYSTEM, Words};
use crate::settings::Service;
use crate::state::CpState;

interface! {
    /// The parameters, in the manual's order.
    pub(crate) mod synchron {
        /// Logical address of the CP.
        in     ADR: Int;
        /// Timer of the delay; declared as WORD, called with `T2` [S0 L833].
        in     TIMER_NR: TimerOrWord;
        /// 1: start-up running; the program's start-up OB sets it, the block resets it.
        in_out ANL: Bool;
        /// A start-up has been acknowledged, the delay runs.
        in_out NULL: Bool;
        /// 1 resets the CP.
        in_out RESET: Bool;
        /// The byte with the control bits of SEND.
        in_out STEUERB_S: Byte;
        /// The byte with the control bits of RECEIVE.
        in_out STEUERB_R: Byte;
    }
}

/// The delay, S5T#100MS (ours: the manual gives the timer, not the time).
const DELAY: u16 = 0x0010;

/// The bits that keep the state between two calls.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Bits {
    pub(crate) anl: bool,
    pub(crate) null: bool,
    pub(crate) reset: bool,
}

/// What a call does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    /// Nothing to do, or nothing to do yet.
    Wait,
    /// Ask the CP for a start-up.
    RequestReset,
    /// Acknowledge the start-up with this number, and start the delay if it differs from the previous one.
    Acknowledge(u8, StartDelay),
    /// The CP has cleared both directions: do the same.
    Empty,
    /// The CP works: end when the delay has elapsed.
    EndAfterDelay,
}

/// Whether the start-up is a new one.
pub(crate) type StartDelay = bool;

impl Bits {
    /// The table of `docs/cp240-registers.md`. `state` is zeroed at the start-up of the CPU, which shows whether NULL
    /// is an old retentive value.
    ///
    /// The output words are set to 0 as soon as the CP has answered, and stay 0 until the delay has elapsed: so the
    /// first count of FC 0 cannot overwrite them before the CP has seen them.
    pub(crate) fn step(self, words: Words, present: bool, state: &CpState) -> (Self, Step) {
        let start_up = words.start_up();
        let mut bits = self;
        if !bits.anl {
            if start_up.is_none() && !bits.reset {
                return (bits, Step::Wait);
            }
            (bits.anl, bits.null) = (true, false);
        }
        let acknowledged = state.acknowledged.get();
        let waiting = bits.null && acknowledged != 0;
        match start_up {
            Some(number) => {
                bits.null = true;
                (bits, Step::Acknowledge(number, !waiting || number != acknowledged))
            }
            // 0 because the driver is down is not an answer.
            None if waiting && !present => (bits, Step::Wait),
            None if waiting && state.emptied.get() => (bits, Step::EndAfterDelay),
            None if waiting => {
                let empty = words == Words { rx: 0, tx_echo: 0 };
                (bits, if empty { Step::Empty } else { Step::Wait })
            }
            // Without parameters a reset has no effect.
            None if words.rx == NO_PARAMETERS => (bits, Step::Wait),
            None => (bits, Step::RequestReset),
        }
    }
}

pub(crate) struct SynchronReset;

impl Block for SynchronReset {
    const KIND: Kind = Kind::Fc;
    const NUMBER: u16 = 9;
    const NAME: &'static str = "SYNCHRON_RESET";
    const PARAMS: &'static [Param] = synchron::PARAMS;
    type State = ();
    type Module = CpState;

    fn call(cx: &mut Cx<'_, CpState>, _state: &()) -> Result<(), Abort> {
        let adr = cx.get(synchron::ADR)?;
        let Some((module, words)) = Module::reach(cx, adr)? else { return Ok(()) };
        let words = Words::from_bytes(words);
        let before =
            Bits { anl: cx.get(synchron::ANL)?, null: cx.get(synchron::NULL)?, reset: cx.get(synchron::RESET)? };
        if module.service(cx)? != Service::All {
            return nothing_to_synchronise(cx, &module, before);
        }
        let state = module.state;
        let (bits, step) = before.step(words, module.info.present, state);
        if bits.anl != before.anl {
            cx.set(synchron::ANL, bits.anl)?;
        }
        // What stands there from before the start of the CPU is no job. Later FC 0 ends each of its jobs itself, with
        // FEHLER_KOM: FRG is none of the bits that the manual names [S0 L1090], and if FC 9 cleared it, a telegram that
        // the reset has cut off would count as sent.
        if bits.anl && !state.has_own_bits.replace(true) {
            cx.set(synchron::STEUERB_S, 0)?;
        }
        match step {
            Step::Wait => {}
            Step::RequestReset => {
                module.write(cx, 0, &RESET.to_be_bytes())?;
            }
            Step::Acknowledge(number, start_delay) => {
                let (rx, tx) = (STARTUP.to_be_bytes(), (SYSTEM | u16::from(number)).to_be_bytes());
                if !module.write(cx, 0, &[rx[0], rx[1], tx[0], tx[1]])? || (start_delay && !start_timer(cx)?) {
                    return Ok(());
                }
                state.acknowledged.set(number);
                state.emptied.set(false);
            }
            Step::Empty => state.emptied.set(module.write(cx, 0, &[0; 4])?),
            Step::EndAfterDelay => return end_after_delay(cx, &module),
        }
        if bits.null != before.null {
            cx.set(synchron::NULL, bits.null)?;
        }
        Ok(())
    }
}

/// The manual calls no FC 9 with Modbus [S0 L1409 ff.] and does not say what it would do: the module "is ready"
/// without it [S0 "Commissioning"]. A program that waits for ANL continues at once, and no register is written.
/// (decision 20)
fn nothing_to_synchronise(cx: &mut Cx<'_, CpState>, module: &Module<'_>, bits: Bits) -> Result<(), Abort> {
    module.tell_no_use(cx, "FC 9 was called, but with Modbus there is nothing to synchronise")?;
    if bits != Bits::default() {
        cx.set(synchron::RESET, false)?;
        cx.set(synchron::NULL, false)?;
        cx.set(synchron::ANL, false)?;
    }
    Ok(())
}

fn end_after_delay(cx: &mut Cx<'_, CpState>, module: &Module<'_>) -> Result<(), Abort> {
    let number = cx.get(synchron::TIMER_NR)?;
    let Ok(timer) = cx.timer(number)? else { return timer_fault(cx, number) };
    if !timer.output {
        // If the program resets the timer in between, this only extends the delay.
        return if timer.running { Ok(()) } else { start_timer(cx).map(drop) };
    }
    let _known_above = cx.timer_run(number, TimerKind::OnDelay, false, DELAY)?;
    let state = module.state;
    let runs = state.rk512.is_running();
    state.acknowledged.set(0);
    state.emptied.set(false);
    state.reception.clear();
    state.tx.clear();
    state.rk512.clear();
    // The control bits of an order of RK 512 that the reset has cut off stay: its block ends it with ANZW 0008h
    // [S0 L1297].
    if !runs {
        cx.set(synchron::STEUERB_R, 0)?;
    }
    cx.set(synchron::RESET, false)?;
    cx.set(synchron::NULL, false)?;
    cx.set(synchron::ANL, false)
}

/// Starts the delay with a new edge. False if the timer does not exist and OB 121 has handled it.
fn start_timer(cx: &mut Cx<'_, CpState>) -> Result<bool, Abort> {
    let number = cx.get(synchron::TIMER_NR)?;
    for rlo in [false, true] {
        if cx.timer_run(number, TimerKind::OnDelay, rlo, DELAY)?.is_err() {
            return timer_fault(cx, number).map(|()| false);
        }
    }
    Ok(true)
}

/// The effect of `SE T number` with a timer the CPU does not have: event 2526h, OB 121 or STOP.
fn timer_fault(cx: &mut Cx<'_, CpState>, number: u16) -> Result<(), Abort> {
    cx.raise_fault(0x2526, u32::from(number))
}
