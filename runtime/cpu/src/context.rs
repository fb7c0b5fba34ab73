//! What runs, and the context through which engines, native blocks and organization blocks reach it: time, safe points.

use std::sync::Arc;

use ob1_model::{BlockId, BlockKind, Event, Site};
use ob1_time::{Instant, Span};

use crate::engine::{Callee, Engine, Plan};
use crate::exchange::Exchange;
use crate::machine::{Attention, Machine};
use crate::natives::{Native, Running};
use crate::{Abort, Clock, ShortText};

/// Statements after which the engine reads the clock at its next safe point, at the latest.
const STATEMENTS_PER_LOOK: u32 = 1000;
/// Fewest statements between two readings of a clock whose pace is only estimated.
const FEWEST_STATEMENTS: u64 = 16;

/// The loaded blocks by number, and the engine that runs them.
pub(crate) struct Blocks {
    pub(crate) engine: Box<dyn Engine>,
    pub(crate) plan: Arc<Plan>,
    pub(crate) natives: Vec<Native>,
    pub(crate) running: Arc<Running>,
    /// The same flags as the machine's.
    pub(crate) attention: Attention,
}

impl Blocks {
    /// The organization block of this number, if it is loaded.
    pub(crate) fn ob(&self, number: u16) -> Option<Callee> {
        self.find(BlockId::new(BlockKind::Ob, number))
    }

    /// The loaded block of this id. Not on the path of calls by number, which load time resolves.
    pub(crate) fn find(&self, id: BlockId) -> Option<Callee> {
        self.plan.signatures.find(id).map(|signature| signature.callee)
    }

    /// The block of statements of this id, by its index in the plan.
    pub(crate) fn code(&self, id: BlockId) -> Option<u32> {
        match self.find(id) {
            Some(Callee::Code(block)) => Some(block),
            _ => None,
        }
    }
}

/// A run of an organization block: the machine, the blocks and the clock. The functions that engines may use are in
/// [`crate::engine`].
pub struct Context<'a> {
    pub(crate) machine: &'a mut Machine,
    pub(crate) blocks: &'a Blocks,
    pub(crate) clock: &'a mut dyn Clock,
    pub(crate) exchange: &'a mut Exchange,
}

impl std::fmt::Debug for Context<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Context").field("now", &self.machine.hot.now).field("ob", &self.machine.ob.number).finish()
    }
}

impl Context<'_> {
    /// Brings the time up to date: tells the clock how many statements were executed, then reads it.
    pub(crate) fn look(&mut self) {
        let machine = &mut *self.machine;
        let pending = u64::from(std::mem::take(&mut machine.hot.pending));
        let before = machine.hot.now;
        machine.statements += pending;
        self.clock.executed(pending);
        machine.hot.now = machine.hot.now.max(machine.time(self.clock));
        if pending >= FEWEST_STATEMENTS {
            machine.pace = (machine.hot.now - before).times(1024) / pending;
        }
        let due = machine.interrupts.next_due().min(machine.watchdog.expires.unwrap_or(Instant::NEVER));
        let time = due.since(machine.hot.now);
        // With a clock that charges statements, a due time is seen at the first safe point after it, otherwise within
        // some statements of it.
        let statements = match self.clock.statements_in(time) {
            Some(statements) => statements.max(1),
            None => (time.times(1024) / machine.pace.max(Span::from_nanos(1))).max(FEWEST_STATEMENTS),
        };
        machine.hot.look_after = statements.min(u64::from(STATEMENTS_PER_LOOK)) as u32;
    }

    /// A safe point that is due: time, operator's STOP, cycle monitoring, interrupts of higher classes.
    #[cold]
    pub(crate) fn attend(&mut self) -> Result<(), Abort> {
        self.machine.attention.take_due();
        self.look();
        self.attend_now()
    }

    /// The same when the clock has just been read.
    pub(crate) fn attend_now(&mut self) -> Result<(), Abort> {
        loop {
            let at = self.machine.at.take();
            let machine = &mut *self.machine;
            let at = at.or(machine.native_caller);
            machine.trace.safe_point(machine.hot.now, at);
            if self.machine.hot.stopping {
                return Err(Abort);
            }
            if self.machine.attention.take_halt() {
                self.machine.enter(Event::STOP_OPERATOR, None, 0, ShortText::default());
                self.machine.hot.stopping = true;
                return Err(Abort);
            }
            if self.machine.watchdog.expires.is_some_and(|expires| self.machine.hot.now >= expires) {
                self.cycle_exceeded()?;
            }
            if self.machine.hot.now >= self.machine.standstill.look_at {
                self.stand_still(at)?;
            }
            // One at a time: interrupts that come faster than they are served must not hide halt and watchdog.
            if !self.machine.interrupts.wants(self.machine.hot.now) || !self.interrupt()? {
                return Ok(());
            }
            self.machine.attention.take_due();
            self.look();
        }
    }

    /// Time passes inside the scan; what is due meanwhile is served.
    pub(crate) fn wait(&mut self, time: Span) -> Result<(), Abort> {
        self.look();
        let deadline = self.machine.hot.now.saturating_add(time);
        while self.machine.hot.now < deadline {
            let watchdog = self.machine.watchdog.expires.unwrap_or(deadline);
            let due = deadline.min(watchdog).min(self.machine.interrupts.next_due());
            self.clock.wait(due.saturating_add(self.machine.held));
            self.attend()?;
        }
        Ok(())
    }

    /// The common parts of start information: event class and identifier, priority class, number, date.
    pub(crate) fn start_info(&self, class: u8, id: u8, priority: u8, number: u8) -> [u8; 20] {
        let mut start = [0; 20];
        start[..4].copy_from_slice(&[class, id, priority, number]);
        start[12..].copy_from_slice(&self.machine.shown.bytes(self.machine.wall, self.machine.hot.now));
        start
    }

    /// Restarts the cycle monitoring, as at the beginning of a cycle.
    pub(crate) fn retrigger_watchdog(&mut self) {
        let machine = &mut *self.machine;
        machine.watchdog.excess = false;
        machine.watchdog.expires =
            (!machine.config.watchdog.is_zero()).then(|| machine.hot.now.saturating_add(machine.config.watchdog));
    }

    /// Enters `event` and marks the CPU for STOP.
    pub(crate) fn stop(&mut self, event: Event, data: u32, text: &str) {
        self.stop_at(event, None, data, text);
    }

    /// The same with a statement.
    pub(crate) fn stop_at(&mut self, event: Event, site: Option<Site>, data: u32, text: &str) {
        self.machine.enter(event, site, data, ShortText::new(text));
        self.machine.hot.stopping = true;
    }
}
