//! A cycle that does not end, though the program is alive: its cycle monitoring is off, or is triggered again and again
//! (SFC 43). What links ask is answered at safe points then, so that an operator's STOP is obeyed.

use ob1_model::Event;
use ob1_model::moment::Moment;
use ob1_std::services::WallClock as _;
use ob1_time::{Instant, Span};

use crate::context::{Blocks, Context};
use crate::engine::Caller;
use crate::interrupts::{Hardware, slot_of};
use crate::machine::Machine;
use crate::{Abort, Answer, Ask, CellError, Command, InterruptError, OperatingState, ShortText};

/// After this time in one cycle, or one organization block between two cycles, questions are answered within it.
const SERVED_AFTER: Span = Span::from_secs(1);
/// Time between two looks for questions then.
const LOOK: Span = Span::from_millis(100);
/// After this time it is an event, unless the cycle monitoring allows more.
const TOLD_AFTER: Span = Span::from_secs(3);

/// How long the cycle, or the start-up, has been running.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Standstill {
    /// When questions are answered next within the cycle.
    pub(crate) look_at: Instant,
    began: Instant,
    state: OperatingState,
    told: bool,
}

impl Default for Standstill {
    fn default() -> Self {
        Self { look_at: Instant::NEVER, began: Instant::NEVER, state: OperatingState::Stop, told: false }
    }
}

impl Standstill {
    /// Something begins in this operating state.
    pub(crate) fn watched(now: Instant, state: OperatingState) -> Self {
        Self { look_at: now.saturating_add(SERVED_AFTER), began: now, state, told: false }
    }
}

impl Context<'_> {
    /// The cycle has been running for long: what is asked from outside.
    #[cold]
    pub(crate) fn stand_still(&mut self, at: Option<Caller>) -> Result<(), Abort> {
        let machine = &mut *self.machine;
        let now = machine.hot.now;
        let Standstill { began, state, told, .. } = machine.standstill;
        machine.standstill.look_at = now.saturating_add(LOOK);
        if !told && now - began >= TOLD_AFTER.max(machine.config.watchdog) {
            machine.standstill.told = true;
            let seconds = ((now - began).millis() / 1000) as u32;
            machine.enter(
                Event::CYCLE_STANDS,
                at.and_then(|at| self.blocks.plan.site(at)),
                seconds,
                ShortText::default(),
            );
        }
        self.exchange.questions(machine, self.blocks, state);
        match machine.wanted {
            // Nothing to do for it.
            Some(Command::Run) => machine.wanted = None,
            Some(Command::Stop) => {
                machine.wanted = None;
                self.stop_at(Event::STOP_OPERATOR, None, 0, "");
                return Err(Abort);
            }
            // Obeyed in STOP, where these begin.
            Some(Command::Warm | Command::Keep | Command::Cold | Command::Reset) => {
                self.stop_at(Event::STOP_OPERATOR, None, 0, "restart");
                return Err(Abort);
            }
            Some(Command::Hot) | None => {}
        }
        Ok(())
    }
}

impl Machine {
    /// What a link is answered in this operating state.
    ///
    /// # Errors
    /// Why it is refused; nothing was changed.
    pub(crate) fn answer(&mut self, blocks: &Blocks, state: OperatingState, ask: Ask) -> Result<Answer, CellError> {
        Ok(match ask {
            Ask::Command(command) => {
                self.wanted = Some(command);
                Answer::Done
            }
            Ask::State => Answer::State(state),
            Ask::Diag(back) => Answer::Diag(*self.diag.get(back as usize).ok_or(CellError::NoEntry)?),
            Ask::HardwareInterrupt { ob, address, point } => {
                Answer::Interrupt(self.fire_hardware_interrupt(blocks, state, (ob, address, point)))
            }
            Ask::Clock => Answer::Clock(self.wall.bytes(self.hot.now)),
            Ask::SetClock(bytes) => {
                let moment = Moment::from_bytes(bytes).map_err(|_| CellError::Value)?;
                self.set_moment(moment);
                self.reschedule();
                Answer::Done
            }
            Ask::Note(event, text) => {
                self.enter(event, None, 0, text);
                Answer::Done
            }
            Ask::Force(step) => {
                self.force_step(step)?;
                Answer::Done
            }
            Ask::Module(index) => Answer::Module(self.modules.status(index as usize).ok_or(CellError::NoModule)?),
        })
    }

    /// A hardware interrupt: organization block, address and point.
    pub(crate) fn fire_hardware_interrupt(
        &mut self,
        blocks: &Blocks,
        state: OperatingState,
        (ob, address, point): (u16, u16, u32),
    ) -> Result<(), InterruptError> {
        let slot = slot_of(ob).filter(|_| (40..=47).contains(&ob)).ok_or(InterruptError::NoOb)?;
        blocks.ob(ob).ok_or(InterruptError::NoOb)?;
        if state != OperatingState::Run {
            return Err(InterruptError::NotRunning);
        }
        let request = Hardware { slot: slot as u8, output: false, address, point, at: self.hot.now };
        if self.interrupts.fire(request) { Ok(()) } else { Err(InterruptError::Full) }
    }
}
