//! HOLD: breakpoints and single step.
//!
//! While there are breakpoints, every block runs statement by statement. Before a statement at which the CPU is to hold
//! the scan thread stays where it is: it serves links, keeps the outputs in their safe state, and the
//! CPU's one notion of time stands still, for timers, cycle monitoring and time-driven organization blocks. The date
//! goes on. ("Programming with STEP 7", 21.3 and 27.1)

use ob1_model::{
    BREAKPOINTS, BlockId, Breakpoint, DebugAnswer, DebugEnd, DebugOrder, Event, Held, HeldBlock, PASS_WAIT, Point,
    Resume,
};
use ob1_time::{Instant, Span};

use crate::context::{Blocks, Context};
use crate::engine::{Caller, Regs};
use crate::exchange::{Exchange, Job};
use crate::machine::Machine;
use crate::stacks::{self, DEEPEST};
use crate::watching::Entering;
use crate::{Abort, Clock, Command, Cpu, DiagBuffer, ObInfo, OperatingState, ShortText};

/// Time between two looks at links.
const LOOK: Span = Span::from_millis(5);
/// Orders at one cycle control point.
const JOBS: usize = 4;

/// Is told, in HOLD too, what those need that report the CPU's state.
pub type Follower = Box<dyn FnMut(OperatingState, &DiagBuffer) + Send>;

/// An order, with room for its answer.
#[derive(Debug)]
pub struct DebugJob {
    id: u64,
    order: DebugOrder,
    answer: DebugAnswer,
    /// The place of its link.
    pub(crate) link: usize,
    until: Instant,
}

impl DebugJob {
    /// An order with the link's own number.
    #[must_use]
    pub fn new(id: u64, order: DebugOrder) -> Self {
        let answer = DebugAnswer { end: DebugEnd::Runs, held: stacks::room() };
        Self { id, order, answer, link: 0, until: Instant::NEVER }
    }

    /// The number it was given.
    #[must_use]
    pub const fn id(&self) -> u64 {
        self.id
    }

    /// The answer, once the job has come back.
    #[must_use]
    pub fn into_answer(self) -> DebugAnswer {
        self.answer
    }
}

/// A block that runs.
#[derive(Clone, Copy, Debug)]
struct Running {
    run: u32,
    block: u32,
    /// As it is shown; the statement is the next, the registers are those at its entry.
    shown: HeldBlock,
}

/// The state of breakpoints.
#[derive(Debug, Default)]
pub(crate) struct Debugging {
    breakpoints: [Option<(u32, u32)>; BREAKPOINTS],
    /// It holds also before the next statement of a block that is nested no deeper than this.
    step: Option<usize>,
    /// It has left HOLD for a step.
    steps: bool,
    /// The blocks that run, the outermost first, while there are breakpoints.
    stack: Vec<Running>,
    /// The order that waits for a hold.
    waiting: Option<Box<DebugJob>>,
    /// What has been asked and not looked at.
    jobs: [Option<Box<DebugJob>>; JOBS],
    /// What a CPU in HOLD has been told.
    told: Option<Told>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Told {
    GoOn(Resume),
    End,
}

impl Debugging {
    /// With room for the blocks that run.
    pub(crate) fn new() -> Self {
        Self { stack: Vec::with_capacity(DEEPEST), ..Self::default() }
    }

    /// There is something to hold at.
    pub(crate) fn is_armed(&self) -> bool {
        self.step.is_some() || self.breakpoints.iter().any(Option::is_some)
    }

    /// Another program takes over: no breakpoints.
    pub(crate) fn forget(&mut self) {
        (self.breakpoints, self.step) = ([None; BREAKPOINTS], None);
    }

    /// There is something to do at the cycle control point.
    pub(crate) fn is_busy(&self) -> bool {
        self.waiting.is_some() || !self.stack.is_empty() || self.jobs.iter().any(Option::is_some)
    }

    /// Takes an order, or gives it back.
    pub(crate) fn take(&mut self, job: Box<DebugJob>) -> Option<Box<DebugJob>> {
        match self.jobs.iter_mut().find(|place| place.is_none()) {
            Some(place) => *place = Some(job),
            None => return Some(job),
        }
        None
    }

    /// A block is entered that runs statement by statement.
    pub(crate) fn entered(&mut self, entering: &Entering, id: BlockId, ob: &ObInfo, r: &Regs) {
        if self.stack.len() < self.stack.capacity() {
            let &Entering { run, block, .. } = entering;
            let shown = stacks::entry(id, 0, [r.db.number, r.di.number], ob);
            self.stack.push(Running { run, block, shown });
        }
    }

    pub(crate) fn left(&mut self, run: u32) {
        if let Some(at) = self.stack.iter().rposition(|running| running.run == run) {
            self.stack.truncate(at);
        }
    }

    /// The statement of a run that comes next: the CPU is to hold before it.
    #[inline]
    fn reaches(&mut self, run: u32, statement: u32) -> bool {
        // An organization block for a fault that was aborted has left blocks behind.
        let Some(depth) = self.stack.iter().rposition(|running| running.run == run) else { return false };
        self.stack.truncate(depth + 1);
        let Some(running) = self.stack.last_mut() else { return false };
        running.shown.statement = statement;
        let here = Some((running.block, statement));
        self.step.is_some_and(|deepest| depth <= deepest) || self.breakpoints.contains(&here)
    }
}

/// Where the program is: the running block's registers.
type Here<'a> = Option<&'a Regs>;

impl Machine {
    /// What has been asked since the last look; `here`: the CPU holds.
    fn serve_debugger(&mut self, blocks: &Blocks, state: OperatingState, here: Here<'_>, exchange: &mut Exchange) {
        let now = self.real();
        for place in 0..JOBS {
            let Some(mut job) = self.debugging.jobs[place].take() else { continue };
            let end = match &job.order {
                DebugOrder::Breakpoints(list) => Some(self.set_breakpoints(list, blocks)),
                DebugOrder::End => {
                    self.debugging.forget();
                    if here.is_some() {
                        self.debugging.told = Some(Told::End);
                    } else if state == OperatingState::Stop {
                        self.enable_outputs(false);
                    }
                    Some(DebugEnd::Done)
                }
                &DebugOrder::Outputs(on) => Some(match (here, state) {
                    (Some(_), _) => DebugEnd::Held,
                    (None, OperatingState::Stop) => {
                        self.enable_outputs(on);
                        DebugEnd::Done
                    }
                    (None, _) => DebugEnd::Runs,
                }),
                &DebugOrder::Stack { level } => Some(match (here, state) {
                    (Some(r), _) => {
                        self.show(&mut job.answer.held, blocks, r, level);
                        DebugEnd::Held
                    }
                    (None, OperatingState::Stop) => {
                        self.show_stopped(level, &mut job.answer.held);
                        DebugEnd::Stopped
                    }
                    (None, _) => DebugEnd::Runs,
                }),
                DebugOrder::Hold { resume: Some(resume), .. } if here.is_some() && self.debugging.told.is_none() => {
                    self.debugging.told = Some(Told::GoOn(*resume));
                    None
                }
                DebugOrder::Hold { .. } if self.debugging.told.is_some() => None,
                DebugOrder::Hold { .. } => match (here, state) {
                    (Some(r), _) => {
                        self.show(&mut job.answer.held, blocks, r, 0);
                        Some(DebugEnd::Held)
                    }
                    (None, OperatingState::Stop) => Some(DebugEnd::Stopped),
                    (None, _) => None,
                },
            };
            match end {
                Some(end) => {
                    job.answer.end = end;
                    exchange.give_back(job.link, Job::Debug(job));
                }
                // It waits for the next hold; who waited before learns how it is now.
                None => {
                    if let DebugOrder::Hold { wait, .. } = job.order {
                        job.until = now.saturating_add(Span::from_nanos(wait.min(PASS_WAIT)));
                    }
                    if let Some(before) = self.debugging.waiting.replace(job) {
                        exchange.give_back(before.link, Job::Debug(before));
                    }
                }
            }
        }
        let told = self.debugging.told.is_some();
        let end = match (here, state) {
            (Some(_), _) if !told => DebugEnd::Held,
            (None, OperatingState::Stop) => DebugEnd::Stopped,
            _ if self.debugging.waiting.as_ref().is_some_and(|job| now >= job.until) => DebugEnd::Runs,
            _ => return,
        };
        if let Some(mut job) = self.debugging.waiting.take() {
            job.answer.end = end;
            if let (DebugEnd::Held, Some(r)) = (end, here) {
                self.show(&mut job.answer.held, blocks, r, 0);
            }
            exchange.give_back(job.link, Job::Debug(job));
        }
    }

    fn set_breakpoints(&mut self, list: &[Breakpoint], blocks: &Blocks) -> DebugEnd {
        let mut found = [None; BREAKPOINTS];
        for (index, breakpoint) in list.iter().enumerate() {
            let refused = DebugEnd::NoStatement(index as u8);
            let Some(place) = found.get_mut(index) else { return refused };
            let Some(block) = blocks.code(breakpoint.block) else { return refused };
            let statements = blocks.plan.blocks.get(block as usize).map_or(0, |block| block.ops.len());
            if breakpoint.statement as usize >= statements {
                return refused;
            }
            *place = Some((block, breakpoint.statement));
        }
        self.debugging.breakpoints = found;
        DebugEnd::Done
    }

    /// Shows where the program is, with the local data of the block at this place of the stack.
    fn show(&self, held: &mut Held, blocks: &Blocks, r: &Regs, level: u8) {
        held.stack.clear();
        held.stack.extend(self.debugging.stack.iter().rev().map(|running| running.shown));
        if let Some(innermost) = held.stack.first_mut() {
            innermost.blocks = [r.db.number, r.di.number];
        }
        stacks::registers(held, r, &self.ob);
        // Local data of called blocks lie behind those of their callers.
        let bytes = |running: &Running| {
            blocks.plan.blocks.get(running.block as usize).map_or(0, |block| block.local_len as usize)
        };
        let outer = self.debugging.stack.iter().rev().skip(1).take(level.into()).map(bytes);
        let at = outer.fold(r.local.index(), |at, len| at.saturating_sub(len));
        let shown = self.debugging.stack.iter().rev().nth(level.into());
        self.show_local((at, shown.map_or(0, bytes)), &mut held.local);
    }

    /// The time that has passed outside, where it never stood still.
    pub(crate) fn real(&self) -> Instant {
        self.hot.now.saturating_add(self.held)
    }

    /// The CPU's time: the clock without the time spent in HOLD.
    pub(crate) fn time(&self, clock: &mut dyn Clock) -> Instant {
        clock.now().saturating_sub(self.held)
    }
}

impl Cpu {
    /// Tells this of the state and the diagnostic buffer: at each [`Cpu::tell`], and in HOLD.
    pub fn follow(&mut self, follower: Follower) {
        self.machine.followers.push(follower);
    }

    /// Between two cycles: tells the followers.
    pub fn tell(&mut self) {
        self.machine.tell(self.state);
    }

    /// The cycle control point: what was asked about breakpoints.
    pub(crate) fn breakpoints(&mut self) {
        self.machine.debugging.stack.clear();
        self.machine.serve_debugger(&self.blocks, self.state, None, &mut self.exchange);
    }
}

impl Machine {
    fn tell(&mut self, state: OperatingState) {
        for follower in &mut self.followers {
            follower(state, &self.diag);
        }
    }
}

impl Context<'_> {
    /// A statement of a run comes: the CPU holds before it, if that is wanted.
    #[inline]
    pub(crate) fn may_hold(&mut self, run: u32, statement: u32, r: &Regs) -> Result<(), Abort> {
        if self.machine.debugging.reaches(run, statement) { self.hold(r) } else { Ok(()) }
    }

    #[cold]
    fn hold(&mut self, r: &Regs) -> Result<(), Abort> {
        let blocks = self.blocks;
        let machine = &mut *self.machine;
        let running = machine.debugging.stack.last();
        let at = running.map(|running| Caller { block: running.block, statement: running.shown.statement });
        let site = at.and_then(|at| blocks.plan.site(at));
        let accus = [r.a1, r.a2];
        if !machine.debugging.steps {
            machine.enter_with(Event::HOLD, site, accus, (0, ShortText::default()));
        }
        machine.modules.output_disable(true);
        machine.debugging.step = None;
        let (before, mut last) = (machine.held, self.clock.now());
        let told = loop {
            self.exchange.questions(machine, blocks, OperatingState::Hold);
            let halt = machine.attention.take_halt();
            match machine.wanted {
                // A programming device has brought it here, and lets it go.
                Some(Command::Run) => machine.wanted = None,
                Some(Command::Stop) => {
                    machine.wanted = None;
                    break Told::End;
                }
                Some(_) => break Told::End,
                None if halt => break Told::End,
                None => {}
            }
            self.exchange.serve(machine, OperatingState::Hold);
            machine.point(Point::Now, self.exchange);
            machine.serve_debugger(blocks, OperatingState::Hold, Some(r), self.exchange);
            if let Some(told) = machine.debugging.told.take() {
                break told;
            }
            machine.tell(OperatingState::Hold);
            let real = machine.real();
            machine.modules.begin_scan(real);
            machine.modules.end_scan(real);
            self.clock.rest(last.saturating_add(LOOK));
            let now = self.clock.now();
            let passed = now.since(last);
            last = now;
            machine.held = machine.held.saturating_add(passed);
            machine.wall.goes_on(passed);
        };
        let Told::GoOn(resume) = told else {
            machine.debugging.steps = false;
            machine.enter_with(Event::HOLD_STOPPED, site, accus, (0, ShortText::default()));
            machine.hot.stopping = true;
            at.into_iter().for_each(|at| self.abandoned(at, r));
            return Err(Abort);
        };
        let depth = machine.debugging.stack.len().saturating_sub(1);
        machine.debugging.step = match resume {
            Resume::Run => None,
            Resume::Into => Some(usize::MAX),
            Resume::Over => Some(depth),
            Resume::Out => depth.checked_sub(1),
        };
        machine.modules.output_disable(false);
        // Steps from one hold to the next would fill the diagnostic buffer.
        machine.debugging.steps = machine.debugging.step.is_some();
        if !machine.debugging.steps {
            machine.enter_with(Event::HOLD_LEFT, site, accus, (0, ShortText::default()));
        }
        if machine.held > before {
            // Times of day that have passed meanwhile are due.
            machine.reschedule();
        }
        Ok(())
    }
}
