//! Compares two engines: the reference engine runs for real, and what comes from outside is recorded (safe points,
//! errors, native blocks, peripheral bytes); then the other engine runs the same organization block from the same state
//! and is given the same answers. The first difference stops the CPU and is reported in the log.
//!
//! Each organization block is a run of its own, including those that interrupt another. Each run allocates memory and
//! takes more than twice the time: this mode is for checking an engine.

mod difference;
mod question;
mod state;
mod tape;

use std::cell::Cell;
use std::sync::Arc;

use ob1_arena::Arena;
use ob1_model::Event;

use super::plan::Plan;
use super::{Engine, Entry, Factory, REFERENCE, Watched};
use crate::Abort;
use crate::context::Context;
use difference::Difference;
pub(crate) use question::Question;
use state::State;
pub(crate) use tape::{Answer, Tape};

/// Makes an engine that compares another one with the reference engine.
#[derive(Clone, Copy)]
pub struct Both(
    /// Makes the other engine.
    pub &'static dyn Factory,
);

impl std::fmt::Debug for Both {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Both")
    }
}

impl Factory for Both {
    fn engine(&self, plan: &Arc<Plan>) -> Result<Box<dyn Engine>, String> {
        Ok(Box::new(Two { reference: REFERENCE.engine(plan)?, other: self.0.engine(plan)?, alone: Cell::new(false) }))
    }

    fn arena(&self, bytes: usize) -> Arena {
        self.0.arena(bytes)
    }

    fn stack_per_block(&self) -> usize {
        self.0.stack_per_block()
    }
}

struct Two {
    reference: Box<dyn Engine>,
    other: Box<dyn Engine>,
    /// There are breakpoints or forced values: what happens meanwhile could not be played back.
    alone: Cell<bool>,
}

impl Engine for Two {
    fn name(&self) -> &'static str {
        "both"
    }

    fn plan(&self) -> &Arc<Plan> {
        self.reference.plan()
    }

    /// The run that counts is that of the reference.
    fn watch(&self, watched: &Watched) {
        self.alone.set(watched.every);
        self.reference.watch(watched);
    }

    fn call(&self, block: u32, entry: &Entry, cx: &mut Context<'_>) -> Result<(), Abort> {
        if self.alone.get() {
            return self.reference.call(block, entry, cx);
        }
        let before = State::of(cx.machine);
        cx.machine.tape = Some(Box::new(Tape::recording(&before)));
        let ran = self.reference.call(block, entry, cx);
        let Some(mut tape) = cx.machine.tape.take() else { return ran };
        tape.recorded(cx.machine);
        let real = State::of(cx.machine);

        before.restore(cx.machine);
        tape.play_back(&before, cx.machine);
        cx.machine.tape = Some(tape);
        let played = self.other.call(block, entry, cx);
        let difference = cx.machine.tape.take().and_then(|tape| tape.ended(cx.machine, &real, ran, played));
        real.restore(cx.machine);
        match difference {
            None => ran,
            Some(difference) => Err(self.tell(block, &difference, cx)),
        }
    }
}

impl Two {
    /// The dump in the log, an entry in the diagnostic buffer, STOP.
    #[cold]
    fn tell(&self, block: u32, difference: &Difference, cx: &mut Context<'_>) -> Abort {
        let plan = Arc::clone(self.plan());
        let id = plan.blocks.get(block as usize).map(|block| block.id);
        let site = |at: Option<_>| at.and_then(|at| plan.site(at));
        let said = |site: Option<ob1_model::Site>| site.map_or("its beginning".into(), |site| site.to_string());
        let (from, to) = (site(difference.from), site(difference.to));
        let ob = cx.machine.ob.number;
        let summary = difference.text(&plan, cx.machine);
        let called = id.map_or_else(String::new, |id| id.to_string());
        for line in [
            format!("{} and {} differ in OB {ob}, {called}: {summary}", self.other.name(), self.reference.name()),
            format!("between {} and {}, safe point or call {}", said(from), said(to), difference.events),
            format!("the program: {} blocks, {} accumulators", plan.blocks.len(), plan.accumulators),
        ] {
            cx.machine.log(1, &line);
        }
        cx.stop_at(Event::ENGINES_DIFFER, to.or(from), u32::from(ob), &summary);
        Abort
    }
}
