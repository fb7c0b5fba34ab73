//! Program status: jobs that watch one pass through a block.
//!
//! A job is armed at the cycle control point, and goes back from there when its pass was made; in between, the engine
//! runs its block with the probe ([`crate::engine::Engine::watch`]), and everything else as always. A job comes as a
//! box with room for its answer, so that the scan allocates nothing.

use ob1_model::{BlockId, BlockKind, PASS_JOBS, PASS_STATEMENTS, PASS_WAIT, Pass, PassEnd, PassLine, PassOrder};
use ob1_time::{Instant, Span};

use crate::engine::{Caller, Regs, Watched};
use crate::exchange::Job;
use crate::machine::Machine;
use crate::{Cpu, CpuConfig};

/// The shortest time between two passes of one job's place.
const REST: Span = Span::from_millis(100);
/// What `test_load` allows at least: of a cycle without a minimum time that takes microseconds, a part is nothing.
const LEAST_LOAD: Span = Span::from_micros(100);
/// What a statement of a watched pass is reckoned to take longer, at most: run by the reference in place of machine
/// code, and recorded.
const STATEMENT: Span = Span::from_nanos(100);
/// How long a block counts as watched after a pass: whoever watches it live asks four times a second.
const RECENT: Span = Span::from_millis(500);
/// Stands for: no statement.
const NONE: u32 = u32::MAX;

/// How far a job is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Stage {
    /// It waits to be armed.
    #[default]
    Waiting,
    /// The engine counts what a pass executes, before it runs one without machine code.
    Weighing,
    /// The next pass that fits is watched.
    Armed,
    /// It has its answer.
    Done,
}

/// A job, with room for its answer.
#[derive(Debug)]
pub struct PassJob {
    id: u64,
    order: PassOrder,
    pass: Pass,
    /// The place of its link.
    pub(crate) link: usize,
    stage: Stage,
    since: Instant,
    /// Indexes in the plan.
    block: Option<u32>,
    from: Option<u32>,
    /// How many calls of `from` are under way, and in which organization block.
    inside: u32,
    inside_ob: u16,
    /// The statement that runs now.
    last: u32,
    /// Statements of the pass so far, and how many it may have.
    ran: u32,
    limit: u32,
    /// What a pass executes, as counted.
    weight: u64,
}

impl PassJob {
    /// A job with the link's own number.
    #[must_use]
    pub fn new(id: u64, order: PassOrder) -> Self {
        let count = order.count.min(PASS_STATEMENTS as u32);
        let order = PassOrder { count, wait: order.wait.min(PASS_WAIT), ..order };
        let lines = vec![PassLine::default(); count as usize];
        let before = if order.before { lines.clone() } else { Vec::new() };
        let pass = Pass { lines, before, ..Pass::default() };
        Self {
            id,
            order,
            pass,
            link: 0,
            stage: Stage::Waiting,
            since: Instant::START,
            block: None,
            from: None,
            inside: 0,
            inside_ob: 0,
            last: NONE,
            ran: 0,
            limit: 0,
            weight: 0,
        }
    }

    /// The number it was given.
    #[must_use]
    pub const fn id(&self) -> u64 {
        self.id
    }

    /// What was asked: which block, under which conditions.
    #[must_use]
    pub const fn order(&self) -> &PassOrder {
        &self.order
    }

    /// The answer so far: the pass with its lines.
    #[must_use]
    pub const fn pass(&self) -> &Pass {
        &self.pass
    }

    /// The answer alone, for whoever has asked.
    #[must_use]
    pub fn into_pass(self) -> Pass {
        self.pass
    }

    /// It has ended like this.
    pub(crate) fn ended(&mut self, end: PassEnd) {
        self.stage = Stage::Done;
        self.pass.end = end;
    }

    /// The pass under way begins and ends here; `at`: the statement that comes next.
    fn record(&mut self, next: u32, r: &Regs) {
        let statement = std::mem::replace(&mut self.last, next);
        let place = |statement: u32| statement.wrapping_sub(self.order.first) as usize;
        if self.pass.cut == 0
            && let Some(line) = self.pass.before.get_mut(place(next))
        {
            *line = seen(line.times, r);
        }
        if statement == NONE || self.pass.cut != 0 {
            return;
        }
        self.ran += 1;
        let Some(line) = self.pass.lines.get_mut(place(statement)) else { return };
        *line = seen(line.times, r);
        if self.ran >= self.limit {
            self.pass.cut = self.ran;
        }
    }
}

/// The registers once more.
fn seen(times: u32, r: &Regs) -> PassLine {
    PassLine {
        times: times.saturating_add(1),
        status: r.status_word() as u16,
        accus: [r.a1, r.a2],
        addresses: [r.ar1, r.ar2],
        blocks: [r.db.number, r.di.number],
    }
}

/// The places of jobs.
#[derive(Debug, Default)]
pub(crate) struct Watching {
    jobs: [Option<Box<PassJob>>; PASS_JOBS],
    /// For each place: the run of a block that is being watched; 0: none.
    runs: [u32; PASS_JOBS],
    /// For each place: when the next job of it may be armed.
    rest: [Instant; PASS_JOBS],
    /// For each place: the block of its last job, and until when it counts as watched.
    recent: [(Option<BlockId>, Instant); PASS_JOBS],
    /// What the engine has been told.
    watched: Watched,
    /// The newest number of a run of a block.
    run: u32,
}

impl Watching {
    /// There is something to do at the cycle control point.
    pub(crate) fn is_busy(&self) -> bool {
        self.jobs.iter().any(Option::is_some)
    }

    /// Takes a job, or gives it back.
    pub(crate) fn take(&mut self, mut job: Box<PassJob>, now: Instant) -> Option<Box<PassJob>> {
        let Some(place) = self.jobs.iter_mut().find(|place| place.is_none()) else {
            job.ended(PassEnd::Full);
            return Some(job);
        };
        job.since = now;
        *place = Some(job);
        None
    }

    /// Whether a job is about this block, or was about it a moment ago: whoever watches it asks again and again.
    pub(crate) fn watches(&self, block: BlockId, now: Instant) -> bool {
        let jobs = self.jobs.iter().flatten().any(|job| job.order.block == block);
        jobs || self.recent.iter().any(|(was, until)| *was == Some(block) && now < *until)
    }

    /// Nobody waits for this job any more: it goes back at once.
    pub(crate) fn forget(&mut self, link: usize, id: u64) {
        let jobs = self.jobs.iter_mut().flatten();
        jobs.filter(|job| (job.link, job.id) == (link, id)).for_each(|job| job.ended(PassEnd::NotCalled));
    }

    /// A number that no other run of a block has.
    pub(crate) fn new_run(&mut self) -> u32 {
        self.run = self.run.wrapping_add(1).max(1);
        self.run
    }

    /// Every block runs statement by statement, as the engine has been told.
    #[inline]
    pub(crate) const fn every(&self) -> bool {
        self.watched.every
    }

    /// What the engine is to be told.
    fn wanted(&self) -> Watched {
        let mut watched = Watched::default();
        for (place, job) in self.jobs.iter().enumerate() {
            let Some(job) = job.as_ref().filter(|job| matches!(job.stage, Stage::Weighing | Stage::Armed)) else {
                continue;
            };
            watched.blocks[place] = job.block;
            watched.callers[place] = job.from;
        }
        watched
    }

    /// Statement `next` of a run comes; the one before has left these registers.
    #[inline]
    pub(crate) fn step(&mut self, run: u32, next: u32, r: &Regs) {
        for (watched, job) in self.runs.iter().zip(&mut self.jobs) {
            if *watched == run
                && let Some(job) = job
            {
                job.record(next, r);
            }
        }
    }

    /// A run of a block ends.
    pub(crate) fn end(&mut self, run: u32, r: &Regs, now: Instant) {
        for (watched, job) in self.runs.iter_mut().zip(&mut self.jobs) {
            if *watched == run
                && let Some(job) = job
            {
                *watched = 0;
                job.record(NONE, r);
                job.pass.time = now.nanos();
                job.ended(PassEnd::Whole);
            }
        }
    }
}

/// A block that an engine enters while there are jobs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entering {
    /// Its index among the blocks of the plan.
    pub(crate) block: u32,
    /// The block that calls it, and where; `None`: an organization block.
    pub(crate) caller: Option<Caller>,
    /// The number of this run.
    pub(crate) run: u32,
    /// A watched block is a part of its machine code.
    pub(crate) contains: bool,
}

impl Machine {
    /// A block is entered: whether this run must be without machine code.
    pub(crate) fn enter_watched(&mut self, entering: &Entering, caller: Option<BlockId>, r: &Regs) -> bool {
        let ob = self.ob.number;
        let mut probed = false;
        let Watching { jobs, runs, .. } = &mut self.watching;
        for (run, job) in runs.iter_mut().zip(jobs) {
            let Some(job) = job else { continue };
            if job.from == Some(entering.block) {
                if job.inside == 0 {
                    job.inside_ob = ob;
                }
                job.inside += 1;
            }
            if job.stage != Stage::Armed || *run != 0 {
                continue;
            }
            if job.block != Some(entering.block) {
                probed |= entering.contains;
                continue;
            }
            let called = match job.order.from {
                None => true,
                Some(from) if from.kind == BlockKind::Ob => from.number == ob,
                Some(_) => job.inside > 0 && job.inside_ob == ob,
            };
            let db = if job.order.block.kind.has_instance() { r.di.number } else { r.db.number };
            if called && (job.order.db == 0 || job.order.db == db) {
                *run = entering.run;
                job.pass.ob = ob;
                job.pass.caller = caller.zip(entering.caller.map(|caller| caller.statement));
                job.last = NONE;
                probed = true;
            }
        }
        probed
    }

    /// A block has been left in which `statements` were executed; `own`: those of the block itself, if that is known.
    pub(crate) fn leave_watched(&mut self, entering: &Entering, statements: u64) {
        for job in self.watching.jobs.iter_mut().flatten() {
            if job.from == Some(entering.block) {
                job.inside = job.inside.saturating_sub(1);
            }
            if job.stage == Stage::Weighing {
                if job.block == Some(entering.block) {
                    job.weight = job.weight.max(statements);
                } else if entering.contains {
                    job.weight += statements;
                }
            }
        }
    }

    /// Every block is to run statement by statement.
    pub(crate) fn runs_every(&self) -> bool {
        self.debugging.is_armed() || self.forces_all()
    }

    /// By how many statements a pass may make a scan longer.
    fn pass_limit(&self) -> u32 {
        let CpuConfig { min_cycle, test_load, .. } = self.config;
        let last = &self.trace.last;
        let cycle = min_cycle.max(last.end.since(last.start));
        let load = (cycle.times(u64::from(test_load)) / 100).max(LEAST_LOAD);
        (load.nanos() / STATEMENT.nanos()).min(u64::from(u32::MAX)) as u32
    }
}

impl Cpu {
    /// The cycle control point: jobs that have ended go back, others are armed.
    pub(crate) fn passes(&mut self) {
        let slow = self.blocks.engine.watching();
        let limit = self.machine.pass_limit();
        let now = self.machine.hot.now;
        let Watching { jobs, runs, rest, .. } = &mut self.machine.watching;
        for ((place, run), rest) in jobs.iter_mut().zip(runs).zip(rest) {
            let Some(job) = place else { continue };
            // No block runs now: what was under way has been aborted.
            job.inside = 0;
            if std::mem::take(run) != 0 {
                job.ended(PassEnd::Stopped);
            }
            match job.stage {
                Stage::Waiting if now >= *rest => {
                    job.block = self.blocks.code(job.order.block);
                    let from = job.order.from.filter(|from| from.kind != BlockKind::Ob);
                    job.from = from.and_then(|from| self.blocks.code(from));
                    let Some(block) = job.block.and_then(|at| self.blocks.plan.blocks.get(at as usize)) else {
                        job.ended(PassEnd::NoBlock);
                        continue;
                    };
                    job.pass.statements = block.ops.len() as u32;
                    (job.limit, job.weight) = (limit, 0);
                    job.stage = if slow.weighs { Stage::Weighing } else { Stage::Armed };
                    *rest = now.saturating_add(REST);
                }
                Stage::Weighing if job.weight > u64::from(limit) => {
                    job.pass.cut = job.weight.min(u64::from(u32::MAX)) as u32;
                    job.ended(PassEnd::TooLong);
                }
                Stage::Weighing if job.weight > 0 => job.stage = Stage::Armed,
                // Callers without their machine code are too slow to wait for long.
                Stage::Armed if slow.contained => job.stage = Stage::Waiting,
                _ => {}
            }
            let waited = now.since(job.since).nanos();
            if job.stage != Stage::Done && waited >= job.order.wait {
                job.ended(PassEnd::NotCalled);
            }
        }
        let Watching { jobs, recent, .. } = &mut self.machine.watching;
        for (place, recent) in jobs.iter_mut().zip(recent) {
            if let Some(job) = place.take_if(|job| job.stage == Stage::Done) {
                *recent = (Some(job.order.block), now.saturating_add(RECENT));
                self.exchange.give_back(job.link, Job::Pass(job));
            }
        }
        self.arm();
    }

    /// Tells the engine what is watched, and whether every block must run statement by statement.
    pub(crate) fn arm(&mut self) {
        let mut wanted = self.machine.watching.wanted();
        wanted.every = self.machine.runs_every();
        if wanted != self.machine.watching.watched {
            self.machine.watching.watched = wanted;
            self.blocks.engine.watch(&wanted);
        }
    }

    /// Before another engine or another program takes over: no job is armed. Each waits for the next cycle control
    /// point.
    pub(crate) fn disarm(&mut self) {
        let watching = &mut self.machine.watching;
        if std::mem::take(&mut watching.watched) == Watched::default() {
            return;
        }
        self.blocks.engine.watch(&Watched::default());
        for job in watching.jobs.iter_mut().flatten().filter(|job| job.stage != Stage::Done) {
            job.stage = Stage::Waiting;
        }
        watching.rest = [Instant::START; PASS_JOBS];
    }
}
