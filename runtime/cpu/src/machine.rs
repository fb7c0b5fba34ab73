//! The CPU's state while it runs, and the context through which engine and native blocks reach it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use ob1_model::{BlockId, BlockKind, Event, FaultKind};
use ob1_std::services::ErrorFilter;

use crate::accounts::Trace;
use crate::engine::{Callee, Engine, Entry, Frame, Interrupted, Signatures};
use crate::events::Diagnoses;
use crate::interrupts::Interrupts;
use crate::log::{LogLine, LogWriter};
use crate::obs::ObRecords;
use crate::retentive::Keep;
use crate::services::ServiceState;
use crate::timers::{Counter, Timer};
use crate::wall::Wall;
use crate::whereabouts::Whereabouts;
use crate::{Abort, Clock, CpuConfig, DiagBuffer, DiagEntry, IoError, Memory, Modules, Nanos, ObInfo, ShortText};

/// Statements after which the engine looks at the clock at its next safe point, at the latest.
const STATEMENTS_PER_LOOK: u32 = 1000;
/// Fewest statements between two looks at a clock whose pace is only guessed at.
const FEWEST_STATEMENTS: u64 = 16;

/// Flags that other threads may set; the scan looks at them at safe points.
#[derive(Clone, Debug, Default)]
pub struct Interrupt {
    due: Arc<AtomicBool>,
    halt: Arc<AtomicBool>,
}

impl Interrupt {
    /// Makes the program look at the clock and the watchdog at its next safe point.
    pub fn attend(&self) {
        self.due.store(true, Ordering::Release);
    }

    /// Sends the CPU to STOP at the next safe point, as an operator's STOP does, even out of an endless loop.
    pub fn halt(&self) {
        self.halt.store(true, Ordering::Release);
        self.due.store(true, Ordering::Release);
    }

    #[inline]
    pub(crate) fn is_due(&self) -> bool {
        self.due.load(Ordering::Relaxed)
    }

    fn take_due(&self) {
        self.due.store(false, Ordering::Relaxed);
    }

    pub(crate) fn take_halt(&self) -> bool {
        self.halt.load(Ordering::Acquire) && self.halt.swap(false, Ordering::AcqRel)
    }
}

/// A statement, as the engine numbers them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Caller {
    pub(crate) block: u32,
    pub(crate) statement: u32,
}

/// Cycle monitoring.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Watchdog {
    /// When the running cycle is too long; `None`: not monitored.
    pub(crate) expires: Option<Nanos>,
    /// It has expired once in this cycle.
    pub(crate) excess: bool,
}

/// Everything that changes while the program runs.
pub(crate) struct Machine {
    pub(crate) config: CpuConfig,
    pub(crate) memory: Memory,
    pub(crate) timers: Box<[Timer]>,
    pub(crate) counters: Box<[Counter]>,
    pub(crate) modules: Modules,
    pub(crate) diag: DiagBuffer,
    pub(crate) trace: Trace,
    pub(crate) log: LogWriter,
    pub(crate) interrupt: Interrupt,
    /// The CPU's own time: moves at safe points and cycle control points.
    pub(crate) now: Nanos,
    /// Statements the clock knows of.
    pub(crate) statements: u64,
    /// Statements it does not know of yet.
    pub(crate) pending: u32,
    /// So many of them, and a safe point looks at the clock: at most [`STATEMENTS_PER_LOOK`], fewer when something is
    /// due before.
    pub(crate) look_after: u32,
    /// Nanoseconds that 1024 statements have taken between the last looks.
    pub(crate) pace: u64,
    pub(crate) watchdog: Watchdog,
    /// A block asked for STOP or a fault led to it: every safe point aborts.
    pub(crate) stopping: bool,
    /// References to actual parameters, a stack.
    pub(crate) refs: Box<[u32]>,
    pub(crate) refs_top: u32,
    /// Bytes of stack the thread needs that runs the CPU.
    pub(crate) stack: usize,
    /// Callers of the running block, the outermost first. Never grows beyond its capacity.
    pub(crate) frames: Vec<Frame>,
    pub(crate) scratch_top: u32,
    pub(crate) local_top: u32,
    /// Blocks nested in the running organization block.
    pub(crate) depth: u8,
    pub(crate) ob: ObInfo,
    /// The organization block that gives the running class: `ob`, but where that is OB 121 or OB 122.
    pub(crate) class_ob: u16,
    /// The date behind `now`.
    pub(crate) wall: Wall,
    /// When the last start-up began.
    pub(crate) started: Nanos,
    /// Where the scan is, for others.
    pub(crate) whereabouts: Arc<Whereabouts>,
    /// Bit n: OB n has begun and not ended.
    pub(crate) active: u128,
    /// The OB for a synchronous error that runs is aborted, and the block it was called for goes on.
    pub(crate) aborted: bool,
    /// Diagnostic interrupts that wait for the end of the OB that runs in their class.
    pub(crate) diagnoses: Diagnoses,
    /// Time the running organization block was interrupted by others.
    pub(crate) inside: Nanos,
    pub(crate) interrupts: Interrupts,
    pub(crate) obs: ObRecords,
    pub(crate) services: ServiceState,
    /// When the running cycle began.
    pub(crate) cycle_start: Nanos,
    /// When it went to STOP.
    pub(crate) stopped_at: Nanos,
    /// What is retentive.
    pub(crate) keep: Keep,
    /// Who called the native block that runs.
    pub(crate) native_caller: Option<Caller>,
    /// Registers for the error organization block that is about to begin.
    pub(crate) interrupted: Option<Interrupted>,
    /// What SFC 44 has given to the block that an error has interrupted.
    pub(crate) substitute: Option<u32>,
    /// The statement at which the engine last came to a safe point that was due.
    pub(crate) at: Option<Caller>,
}

/// What runs: blocks by number, and who executes them.
pub(crate) struct Blocks {
    pub(crate) engine: Box<dyn Engine>,
    pub(crate) natives: Vec<crate::native::Native>,
    /// Sorted by id.
    pub(crate) callees: Vec<(BlockId, Callee)>,
    pub(crate) signatures: Signatures,
    /// The same flags as the machine's.
    pub(crate) interrupt: Interrupt,
}

impl Blocks {
    /// The organization block of this number, if it is loaded.
    pub(crate) fn ob(&self, number: u16) -> Option<Callee> {
        self.find(BlockId::new(BlockKind::Ob, number))
    }

    /// The loaded block of this id. Not on the path of calls by number, which load time resolves.
    pub(crate) fn find(&self, id: BlockId) -> Option<Callee> {
        self.callees.binary_search_by_key(&id, |(id, _)| *id).ok().map(|i| self.callees[i].1)
    }
}

/// A run of an organization block: the machine, the blocks and the clock.
pub(crate) struct Context<'a> {
    pub(crate) machine: &'a mut Machine,
    pub(crate) blocks: &'a Blocks,
    pub(crate) clock: &'a mut dyn Clock,
}

impl Context<'_> {
    /// Time goes on: tells the clock of the statements executed and asks it.
    pub(crate) fn look(&mut self) {
        let machine = &mut *self.machine;
        let pending = u64::from(std::mem::take(&mut machine.pending));
        let before = machine.now;
        machine.statements += pending;
        self.clock.executed(pending);
        machine.now = machine.now.max(self.clock.now());
        if pending >= FEWEST_STATEMENTS {
            machine.pace = (machine.now - before).saturating_mul(1024) / pending;
        }
        let due = machine.interrupts.next_due().min(machine.watchdog.expires.unwrap_or(Nanos::MAX));
        let time = due.saturating_sub(machine.now);
        // A due time is seen at the first safe point behind it where statements are charged, else within some
        // statements of it.
        let statements = match self.clock.statements_in(time) {
            Some(statements) => statements.max(1),
            None => (time.saturating_mul(1024) / machine.pace.max(1)).max(FEWEST_STATEMENTS),
        };
        machine.look_after = statements.min(u64::from(STATEMENTS_PER_LOOK)) as u32;
    }

    /// A safe point that is due: time, operator's STOP, cycle monitoring, interrupts of higher classes.
    #[cold]
    pub(crate) fn attend(&mut self) -> Result<(), Abort> {
        loop {
            self.machine.interrupt.take_due();
            self.look();
            let at = self.machine.at.take();
            let machine = &mut *self.machine;
            machine.trace.safe_point(machine.now, at.or(machine.native_caller));
            if self.machine.stopping {
                return Err(Abort);
            }
            if self.machine.interrupt.take_halt() {
                self.entry(Event::STOP_OPERATOR, 0, "");
                self.machine.stopping = true;
                return Err(Abort);
            }
            if self.machine.watchdog.expires.is_some_and(|expires| self.machine.now >= expires) {
                self.cycle_exceeded()?;
            }
            // One at a time: interrupts that come faster than they are served must not hide halt and watchdog.
            if !self.machine.interrupts.wants(self.machine.now) || !self.interrupt()? {
                return Ok(());
            }
        }
    }

    /// Time passes inside the scan; what is due meanwhile is served.
    pub(crate) fn wait(&mut self, time: Nanos) -> Result<(), Abort> {
        self.look();
        let deadline = self.machine.now.saturating_add(time);
        while self.machine.now < deadline {
            let watchdog = self.machine.watchdog.expires.unwrap_or(deadline);
            self.clock.wait(deadline.min(watchdog).min(self.machine.interrupts.next_due()));
            self.attend()?;
        }
        Ok(())
    }

    /// The common parts of start information: event class and identifier, priority class, number, date.
    pub(crate) fn start_info(&self, class: u8, id: u8, priority: u8, number: u8) -> [u8; 20] {
        let mut start = [0; 20];
        start[..4].copy_from_slice(&[class, id, priority, number]);
        start[12..].copy_from_slice(&self.machine.wall.bytes(self.machine.now));
        start
    }

    /// Runs an organization block, nested in whatever runs.
    pub(crate) fn run_ob(&mut self, callee: Callee, info: ObInfo) -> Result<(), Abort> {
        let machine = &mut *self.machine;
        let Some(at) = machine.memory.local.locate(machine.local_top, 20) else {
            self.stop(Event(FaultKind::NestingDepth.number()), u32::from(info.number), "no local data left");
            return Err(Abort);
        };
        if machine.config.ob_start_info {
            machine.memory.bytes[at as usize..at as usize + 20].copy_from_slice(&info.start);
        }
        self.look();
        let machine = &mut *self.machine;
        let began = machine.now;
        let outer_inside = std::mem::take(&mut machine.inside);
        // The OBs for synchronous errors belong to the class they interrupt, and so do its masks and its run time.
        let synchronous = matches!(info.number, 121 | 122);
        let (filter, outer_class) = (machine.services.filter, machine.class_ob);
        if !synchronous {
            machine.services.filter = ErrorFilter::default();
            machine.class_ob = info.number;
            if let Some(record) = machine.obs.of(outer_class) {
                record.pause(began, outer_inside);
            }
            if let Some(record) = machine.obs.of(info.number) {
                record.begin(began);
            }
        }
        let outer = std::mem::replace(&mut machine.ob, info);
        let active = machine.active;
        machine.active |= 1 << (info.number & 127);
        machine.whereabouts.enter(info.number);
        let caller = machine.native_caller.take();
        let depth = std::mem::take(&mut machine.depth);
        let tops = (machine.local_top, machine.refs_top, machine.scratch_top, machine.frames.len());
        let result = match callee {
            Callee::Code(block) => self.blocks.engine.call(block, &Entry::default(), self),
            Callee::Native(index) => crate::native::call(index, &Entry::default(), self).map(|_| ()),
        };
        self.look();
        let machine = &mut *self.machine;
        let whole = machine.now - began;
        let inside = machine.inside;
        machine.inside = outer_inside + if synchronous { inside } else { whole };
        let own = whole.saturating_sub(inside);
        machine.trace.ob_ran(info.number, own);
        if let Some(record) = machine.obs.of(info.number) {
            record.ran(own, whole);
        }
        if !synchronous {
            machine.services.filter = filter;
            machine.class_ob = outer_class;
            if info.number < 80 {
                machine.services.locks.end_delays();
            }
        }
        (machine.ob, machine.active) = (outer, active);
        machine.whereabouts.enter(outer.number);
        machine.native_caller = caller;
        machine.depth = depth;
        (machine.local_top, machine.refs_top, machine.scratch_top) = (tops.0, tops.1, tops.2);
        machine.frames.truncate(tops.3);
        result
    }

    /// Starts the cycle monitoring anew, as at the beginning of a cycle.
    pub(crate) fn retrigger_watchdog(&mut self) {
        let machine = &mut *self.machine;
        machine.watchdog.excess = false;
        machine.watchdog.expires =
            (machine.config.watchdog > 0).then(|| machine.now.saturating_add(machine.config.watchdog));
    }

    /// Enters `event` and marks the CPU for STOP.
    pub(crate) fn stop(&mut self, event: Event, data: u32, text: &str) {
        self.entry(event, data, text);
        self.machine.stopping = true;
    }

    /// An entry without a statement.
    pub(crate) fn entry(&mut self, event: Event, data: u32, text: &str) {
        self.machine.diag.push(DiagEntry {
            number: 0,
            time: self.machine.now,
            event,
            site: None,
            accus: [0; 2],
            data,
            text: ShortText::new(text),
        });
    }
}

impl Machine {
    /// One of these organization blocks has begun and not ended.
    pub(crate) fn is_active(&self, obs: &[u16]) -> bool {
        obs.iter().any(|ob| self.active >> ob & 1 == 1)
    }

    /// Reads peripheral bytes.
    pub(crate) fn io_read(&mut self, address: u32, into: &mut [u8]) -> Result<(), IoError> {
        if self.config.peripheral_from_image {
            let len = into.len() as u32;
            let at = self.memory.inputs.locate(address, len).ok_or(IoError::NoModule)? as usize;
            into.copy_from_slice(&self.memory.bytes[at..at + into.len()]);
            return Ok(());
        }
        self.modules.read(address, into)
    }

    /// Writes peripheral bytes, and the process image of the outputs where they lie inside it.
    pub(crate) fn io_write(&mut self, address: u32, from: &[u8]) -> Result<(), IoError> {
        if self.config.peripheral_from_image {
            let len = from.len() as u32;
            let at = self.memory.outputs.locate(address, len).ok_or(IoError::NoModule)? as usize;
            self.memory.bytes[at..at + from.len()].copy_from_slice(from);
            return Ok(());
        }
        self.modules.write(address, from)?;
        for (byte, value) in (address..).zip(from) {
            if let Some(at) = self.memory.outputs.locate(byte, 1) {
                self.memory.bytes[at as usize] = *value;
            }
        }
        Ok(())
    }

    /// Copies a log line into the ring.
    pub(crate) fn log(&mut self, level: u8, text: &str) {
        self.log.write(LogLine::new(self.now, level, text));
    }
}
