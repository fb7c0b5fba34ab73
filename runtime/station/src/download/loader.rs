//! The thread that makes a program of downloaded blocks, and hands it to the scan.
//!
//! The scan takes it between two cycles through a ring, and gives the program before it back through another ring one
//! whole cycle later: the snapshot of that cycle shows the new program. It allocates, frees and waits for nothing.
//!
//! Nobody waits for a compiler either: if the choice of the engine is left to us, a program that comes in STOP begins
//! on the reference engine, as at a start. Machine code follows from a process of its own once no more blocks come.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ob1_access::door::Refusal;
use ob1_broker::{Change, Changed};
use ob1_cpu::engine::Plan;
use ob1_cpu::{Cpu, LoadError, Successor, Surroundings, Watches, lost_values};
use ob1_ir::Program;
use ob1_model::{BlockId, BlockKind};
use ob1_stl::Library;
use rtrb::{Consumer, Producer, RingBuffer};

use super::changes::{Changes, block, has, is_system_data};
use super::file;
use super::order::{LoadOrder, LoadStatus, Loading, Loads};
use crate::compiling::{Compiling, EngineSender, Request, Successors};
use crate::engine::{InUse, factory, factory_in_run};
use crate::program;
use crate::program_facts::{Known, KnownProgram};
use ob1_station_file::EngineChoice;
use ob1_station_file::finding::{Finding, Level};

/// Programs under way to the scan.
const UNDER_WAY: usize = 2;
/// How long the scan may take to take one over, beyond two cycles.
const PATIENCE: Duration = Duration::from_secs(3);
/// Pause between two looks at the way back.
const LOOK: Duration = Duration::from_millis(1);
/// Machine code is made when no block has come for this long: a program is loaded block by block.
const QUIET: Duration = Duration::from_millis(500);
/// States of a program on its way: it waits, the scan has it, nobody waits for it any more.
const WAITS: u8 = 0;
const TAKEN: u8 = 1;
const GIVEN_UP: u8 = 2;

/// A program on its way to the scan and back.
#[derive(Debug)]
struct OnItsWay {
    successor: Successor,
    /// Where its machine code will come from; after it took over, the same of the program before.
    engines: Option<Successors>,
    state: Arc<AtomicU8>,
    outcome: Result<(), Watches>,
}

/// The scan's end: it takes programs over, and gives the old ones back.
#[derive(Debug)]
pub struct Newcomers {
    come: Consumer<Box<OnItsWay>>,
    gone: Producer<Box<OnItsWay>>,
    /// It has taken over; its answer leaves after a whole cycle.
    held: Option<Box<OnItsWay>>,
}

impl Newcomers {
    /// Between two cycles: lets a program that has come take over, and returns the name of the engine that runs it
    /// then. `engines` are those that come for the running program.
    pub fn take_over(&mut self, cpu: &mut Cpu, engines: &mut Option<Successors>) -> Option<&'static str> {
        if let Some(held) = self.held.take() {
            // There is room for all that are under way.
            let _ = self.gone.push(held);
        }
        let mut next = self.come.pop().ok()?;
        let mine = next.state.compare_exchange(WAITS, TAKEN, Ordering::AcqRel, Ordering::Acquire).is_ok();
        if mine {
            ob1_native::synchronise();
            next.outcome = cpu.succeed(&mut next.successor);
        }
        let took = mine && next.outcome.is_ok();
        if took && next.engines.is_some() {
            std::mem::swap(engines, &mut next.engines);
        }
        self.held = Some(next);
        took.then(|| cpu.engine())
    }
}

/// What the thread is started with.
pub struct Downloading {
    /// What programs are loaded into.
    pub around: Surroundings,
    /// The program of the sources.
    pub sources: Arc<Program>,
    /// The one that runs.
    pub now: Arc<Program>,
    /// The changes that turn the one into the other.
    pub changes: Changes,
    /// Where that is kept; none: it is lost at the end.
    pub path: Option<PathBuf>,
    /// The file of the station, which names its sources; none: they are not read again.
    pub station: Option<PathBuf>,
    /// The blocks that are not of the program.
    pub library: Arc<Library>,
    /// What others see of the program.
    pub known: Known,
    /// The engine that the station file asks for.
    pub engine: EngineChoice,
    /// Which engine runs, for readers outside the scan.
    pub in_use: Arc<InUse>,
    /// What is compiled in a process of its own, if the choice of the engine is left to us.
    pub compile: Option<Request>,
    /// Bytes of stack the scan has.
    pub stack: usize,
    /// Time of two cycles: so long an answer of the scan takes at least.
    pub cycles: Duration,
}

impl std::fmt::Debug for Downloading {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Downloading").field("changes", &self.changes.0.len()).finish_non_exhaustive()
    }
}

/// The thread at work: changes go in, their outcomes come out. Dropping it ends the thread.
#[derive(Debug)]
pub(crate) struct Loader {
    orders: Sender<Order>,
    done: Receiver<Changed>,
    thread: Option<JoinHandle<()>>,
}

/// What the thread is to do.
pub(super) enum Order {
    Change(u64, Change),
    Load(Loading),
    End,
}

impl Drop for Loader {
    fn drop(&mut self) {
        let _ = self.orders.send(Order::End);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Loader {
    /// Hands a change over.
    pub(crate) fn change(&self, number: u64, change: Change) -> bool {
        self.orders.send(Order::Change(number, change)).is_ok()
    }

    /// Where others order loads.
    pub(crate) fn loads(&self) -> Loads {
        Loads::new(self.orders.clone())
    }

    /// The outcome of a change, if one has ended.
    pub(crate) fn changed(&self) -> Option<Changed> {
        self.done.try_recv().ok()
    }
}

impl Downloading {
    /// Starts the thread. `runs` says whether the CPU is not in STOP.
    ///
    /// # Errors
    /// What the system says when it has none left.
    pub(crate) fn start(self, runs: impl Fn() -> bool + Send + 'static) -> std::io::Result<(Loader, Newcomers)> {
        let (to_scan, come) = RingBuffer::new(UNDER_WAY);
        let (gone, from_scan) = RingBuffer::new(UNDER_WAY + 1);
        let (orders, taken) = mpsc::channel();
        let (tell, done) = mpsc::channel();
        let thread = ob1_rt::spawn("ob1-download", move || {
            let runs = Box::new(runs);
            let mut work = Work { with: self, to_scan, from_scan, runs, wanted: None, compiling: None, before: None };
            loop {
                let (number, change) = match work.next(&taken) {
                    Ok(Order::Change(number, change)) => (number, change),
                    Ok(Order::Load(loading)) => {
                        // Whoever asked may be gone.
                        let _ = loading.tell.send(work.reload(&loading.order));
                        continue;
                    }
                    Err(RecvTimeoutError::Timeout) => {
                        work.compile();
                        continue;
                    }
                    Ok(Order::End) | Err(RecvTimeoutError::Disconnected) => return,
                };
                let outcome = work.change(change).map_err(|why| {
                    tracing::warn!("a download was refused: {}", why.text);
                    why.why
                });
                if tell.send((number, outcome)).is_err() {
                    return;
                }
            }
        })?;
        Ok((Loader { orders, done, thread: Some(thread) }, Newcomers { come, gone, held: None }))
    }
}

/// OB 1, and those of interrupts, errors and start-ups.
fn is_ever_run(ob: u16) -> bool {
    ob == 1 || (10..=122).contains(&ob)
}

/// Why a change was not made.
struct Refused {
    why: Refusal,
    text: String,
}

impl Refused {
    fn new(why: Refusal, text: impl Into<String>) -> Self {
        Self { why, text: text.into() }
    }
}

struct Work {
    with: Downloading,
    to_scan: Producer<Box<OnItsWay>>,
    from_scan: Consumer<Box<OnItsWay>>,
    runs: Box<dyn Fn() -> bool + Send>,
    /// Machine code that is to be made of the program that runs now.
    wanted: Option<(Arc<Plan>, EngineSender)>,
    /// Where it is being made.
    compiling: Option<Compiling>,
    /// The program before the last change.
    before: Option<Arc<Program>>,
}

impl Work {
    /// The next order; a timeout when it is time to compile.
    fn next(&self, orders: &Receiver<Order>) -> Result<Order, RecvTimeoutError> {
        match self.wanted {
            Some(_) => orders.recv_timeout(QUIET),
            None => orders.recv().map_err(|_| RecvTimeoutError::Disconnected),
        }
    }

    /// Has machine code made for the running program, in a process of its own.
    fn compile(&mut self) {
        let (Some((plan, sender)), Some(request)) = (self.wanted.take(), &self.with.compile) else { return };
        // The program it was made for is gone.
        self.compiling = None;
        match Compiling::giving(request.with(Arc::clone(&self.with.now)), &plan, sender, &self.with.in_use) {
            Ok(compiling) => self.compiling = Some(compiling),
            Err(why) => tracing::warn!("machine code: {why}; the station continues without it"),
        }
    }

    /// Carries out one change, up to the scan's take-over.
    fn change(&mut self, change: Change) -> Result<(), Refused> {
        let with = &self.with;
        let mut changes = with.changes.clone();
        let (mut fresh, mut told) = (Vec::new(), Vec::new());
        let is_system = |id: &BlockId| id.kind == BlockKind::Sdb;
        match change {
            Change::Link(blocks) => {
                for (id, bytes) in blocks {
                    if is_system(&id) {
                        if !is_system_data(id.number, &bytes) {
                            return Err(Refused::new(Refusal::Block, format!("{id}: its head names another block")));
                        }
                        changes.put(id, bytes.into_vec());
                        told.push(id);
                        continue;
                    }
                    block(id, &bytes).map_err(|why| Refused::new(Refusal::Block, format!("{id}: {why}")))?;
                    if id.kind == BlockKind::Ob && !is_ever_run(id.number) {
                        return Err(Refused::new(
                            Refusal::Block,
                            format!("{id}: no CPU runs such an organization block"),
                        ));
                    }
                    changes.put(id, bytes.into_vec());
                    fresh.extend((id.kind == BlockKind::Db).then_some(id.number));
                    told.push(id);
                }
            }
            Change::Delete(ids) => {
                for id in ids {
                    // System data that is gone already: nothing is left to do.
                    if !is_system(&id) && !has(&with.now, id) {
                        return Err(Refused::new(Refusal::NotThere, format!("there is no {id} to delete")));
                    }
                    changes.delete(id);
                    told.push(id);
                }
            }
        }
        if told.iter().any(is_system) && (self.runs)() {
            return Err(Refused::new(Refusal::InRun, "system data cannot be changed in RUN"));
        }
        // A block that is as in the sources is the sources' again, with everything that machine code does not hold.
        changes.forget_same(&with.sources, &with.library);
        let list: Vec<String> = told.iter().map(BlockId::to_string).collect();
        if told.iter().all(is_system) {
            self.with.changes = changes;
            tracing::info!("downloaded or deleted: {}", list.join(", "));
            self.keep();
            return Ok(());
        }
        let next = changes.apply(&with.sources, &with.library, &with.around);
        let next = next.map_err(|whys| Refused::new(Refusal::Block, whys.join("; ")))?;
        self.take(Arc::new(next), fresh)?;
        self.with.changes = changes;
        tracing::info!("downloaded or deleted: {}", list.join(", "));
        self.keep();
        Ok(())
    }

    /// The sources as they are now, or the program before the last change.
    ///
    /// What is loaded from the sources needs no file: it is what the next start finds. So the file of what was
    /// downloaded goes first, and nobody finds it beside sources that it does not belong to.
    fn reload(&mut self, order: &LoadOrder) -> Result<LoadStatus, String> {
        let next = if order.back {
            self.before
                .clone()
                .ok_or("there is no version before this one\n  = the program has not been changed yet")?
        } else {
            Arc::new(self.read_sources()?)
        };
        let with = &self.with;
        let told =
            LoadStatus::new(&with.now, &next, lost_values(&with.now, &next), order.texts.then_some(&*with.library));
        if order.check || told.changed.is_empty() {
            return Ok(told);
        }
        if order.expect.as_ref().is_some_and(|expect| *expect != told.fingerprint) {
            return Err("the sources have changed since the difference was shown\n  = load again".to_owned());
        }
        let mut changes = with.changes.system_data();
        if order.back {
            changes.0.extend(Changes::between(&with.sources, &next, &with.library).0);
        }
        if let Some(path) = with.path.as_ref().filter(|_| !order.back) {
            file::write(path, &changes).map_err(|error| format!("{}: {error}", path.display()))?;
        }
        if let Err(refused) = self.take(Arc::clone(&next), Vec::new()) {
            self.keep();
            return Err(refused.text);
        }
        self.with.changes = changes;
        if !order.back {
            self.with.sources = next;
        }
        let list: Vec<&str> = told.changed.iter().map(|change| change.block.as_str()).collect();
        let what = if order.back { "back to the version before" } else { "loaded from the sources" };
        tracing::info!("{what}: {}", list.join(", "));
        self.keep();
        let not_kept = self.with.known.get().not_kept.clone().filter(|_| order.back);
        Ok(LoadStatus { loaded: true, not_kept, ..told })
    }

    /// The program that the station's sources give now.
    fn read_sources(&self) -> Result<Program, String> {
        let path = self.with.station.as_ref().ok_or("this station has no sources")?;
        let told = |findings: Vec<Finding>| {
            let errors = findings.iter().filter(|finding| finding.level == Level::Error);
            errors.map(ToString::to_string).collect::<String>().trim_end().to_owned()
        };
        let station = ob1_station_file::load(path).map_err(told)?;
        Ok(program::compile(&station.program, &self.with.library).map_err(told)?.program)
    }

    /// Has the scan take a program.
    fn take(&mut self, next: Arc<Program>, fresh: Vec<u16>) -> Result<(), Refused> {
        let successor = self.load(&next, fresh)?;
        // If only values change, the machine code stays right.
        let plan = successor.plan().filter(|_| self.with.compile.is_some()).cloned();
        let (sender, engines) = plan.as_ref().map(|_| EngineSender::pair()).unzip();
        self.hand_over(successor, engines)?;
        if let Some(wanted) = plan.zip(sender) {
            self.wanted = Some(wanted);
        }
        self.before = Some(std::mem::replace(&mut self.with.now, next));
        Ok(())
    }

    /// Writes down how the program differs from its sources, and tells others of it.
    fn keep(&self) {
        let with = &self.with;
        let kept = with.path.as_ref().map_or_else(
            || {
                let lost = || Err("there is no folder for it: [station] state".to_owned());
                if with.changes.is_empty() { Ok(()) } else { lost() }
            },
            |path| file::write(path, &with.changes).map_err(|error| format!("{}: {error}", path.display())),
        );
        if let Err(why) = &kept {
            tracing::error!("the changed blocks are lost when the station ends: {why}");
        }
        let known = with.changes.known(&with.now, (&with.sources, &with.around), &with.library);
        with.known.set(KnownProgram { not_kept: kept.err(), ..known });
    }

    fn load(&self, next: &Program, fresh: Vec<u16>) -> Result<Successor, Refused> {
        let with = &self.with;
        let makes = if (self.runs)() { factory_in_run(with.engine) } else { factory(with.engine) };
        let programs = (&*with.now, next);
        let made = with.around.successor(programs, fresh.clone(), makes, with.stack);
        let made = match made {
            Err(errors)
                if with.engine == EngineChoice::Auto
                    && errors
                        .iter()
                        .any(|error| matches!(error, LoadError::Engine { .. } | LoadError::Stack { .. })) =>
            {
                // The reference engine needs less stack.
                with.around.successor(programs, fresh, factory(with.engine), with.stack)
            }
            made => made,
        };
        made.map_err(|errors| {
            let no_room = |error: &LoadError| {
                matches!(error, LoadError::Stack { .. } | LoadError::Memory { .. } | LoadError::DbTooLarge { .. })
            };
            let why = if errors.iter().any(no_room) { Refusal::Room } else { Refusal::Block };
            let texts: Vec<String> = errors.iter().map(ToString::to_string).collect();
            Refused::new(why, texts.join("; "))
        })
    }

    /// Hands the program to the scan and waits until a whole cycle has gone by with it.
    fn hand_over(&mut self, successor: Successor, engines: Option<Successors>) -> Result<(), Refused> {
        let silent = || Refused::new(Refusal::Silent, "the scan does not take it");
        // Those that were given up.
        while self.from_scan.pop().is_ok() {}
        let state = Arc::new(AtomicU8::new(WAITS));
        let on_its_way = Box::new(OnItsWay { successor, engines, state: Arc::clone(&state), outcome: Ok(()) });
        self.to_scan.push(on_its_way).map_err(|_| silent())?;
        let until = Instant::now() + PATIENCE + self.with.cycles;
        loop {
            while let Ok(back) = self.from_scan.pop() {
                if Arc::ptr_eq(&back.state, &state) {
                    return back.outcome.map_err(|Watches(block)| {
                        let text = format!(
                            "{block} is being watched (ob1 status, or program status of an engineering tool)\n  = end \
                             that first"
                        );
                        Refused::new(Refusal::Watched, text)
                    });
                }
            }
            if self.from_scan.is_abandoned() {
                return Err(silent());
            }
            // Once the scan has it, it comes back with the next cycle.
            let is_late = Instant::now() >= until;
            let given_up = || state.compare_exchange(WAITS, GIVEN_UP, Ordering::AcqRel, Ordering::Acquire).is_ok();
            if is_late && given_up() {
                return Err(silent());
            }
            std::thread::sleep(LOOK);
        }
    }
}

#[cfg(test)]
#[path = "loader_tests.rs"]
mod tests;
