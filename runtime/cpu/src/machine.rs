//! The CPU's state while it runs, and the context through which engine and native blocks reach it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use ob1_model::{BlockId, BlockKind, Event, Fault, FaultKind, Site};

use crate::calendar::date_and_time;
use crate::engine::{Callee, Engine, Entry, Frame, Signatures};
use crate::log::{LogLine, LogWriter};
use crate::timers::{Counter, Timer};
use crate::{
    Abort, Clock, CpuConfig, DiagBuffer, DiagEntry, IoError, Memory, Modules, Nanos, ObInfo, ShortText, Statistics,
};

/// Statements after which the engine looks at the clock at its next safe point.
pub(crate) const STATEMENTS_PER_LOOK: u32 = 1000;

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
    pub(crate) statistics: Statistics,
    pub(crate) log: LogWriter,
    pub(crate) interrupt: Interrupt,
    /// The CPU's own time: moves at safe points and cycle control points.
    pub(crate) now: Nanos,
    /// Statements the clock knows of.
    pub(crate) statements: u64,
    /// Statements it does not know of yet.
    pub(crate) pending: u32,
    pub(crate) watchdog: Watchdog,
    /// A block asked for STOP or a fault led to it: every safe point aborts.
    pub(crate) stopping: bool,
    /// References to actual parameters, a stack.
    pub(crate) refs: Box<[u32]>,
    pub(crate) refs_top: u32,
    /// Callers of the running block, the outermost first. Never grows beyond its capacity.
    pub(crate) frames: Vec<Frame>,
    pub(crate) scratch_top: u32,
    pub(crate) local_top: u32,
    /// Blocks nested in the running organization block.
    pub(crate) depth: u8,
    pub(crate) ob: ObInfo,
    /// Who called the native block that runs.
    pub(crate) native_caller: Option<Caller>,
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
        machine.statements += u64::from(machine.pending);
        self.clock.executed(u64::from(std::mem::take(&mut machine.pending)));
        machine.now = machine.now.max(self.clock.now());
    }

    /// A safe point that is due: time, operator's STOP, cycle monitoring.
    #[cold]
    pub(crate) fn attend(&mut self) -> Result<(), Abort> {
        self.machine.interrupt.take_due();
        self.look();
        if self.machine.stopping {
            return Err(Abort);
        }
        if self.machine.interrupt.take_halt() {
            self.entry(Event::STOP_OPERATOR, 0, "");
            self.machine.stopping = true;
            return Err(Abort);
        }
        match self.machine.watchdog.expires {
            Some(expires) if self.machine.now >= expires => self.cycle_exceeded(),
            _ => Ok(()),
        }
    }

    /// The watchdog has expired: OB 80 the first time, STOP without it or the second time in one cycle.
    fn cycle_exceeded(&mut self) -> Result<(), Abort> {
        let machine = &mut *self.machine;
        machine.statistics.watchdogs += 1;
        let limit_ms = (machine.config.watchdog / 1_000_000) as u32;
        let second = std::mem::replace(&mut machine.watchdog.excess, true);
        machine.watchdog.expires = Some(machine.now + machine.config.watchdog);
        self.entry(Event::CYCLE_TIME_EXCEEDED, limit_ms, "");
        let ob80 = self.blocks.find(BlockId::new(BlockKind::Ob, 80));
        let (Some(callee), false) = (ob80, second) else {
            self.stop(Event::STOP_TIME_ERROR, limit_ms, if second { "twice in one cycle" } else { "no OB 80" });
            return Err(Abort);
        };
        let mut start = self.start_info(0x35, 0x01, 26, 80);
        start[6..8].copy_from_slice(&(limit_ms.min(0xFFFF) as u16).to_be_bytes());
        (start[8], start[9]) = (0x35, 0x01);
        (start[10], start[11]) = (self.machine.ob.priority, self.machine.ob.number as u8);
        self.run_ob(callee, ObInfo { number: 80, priority: 26, start })
    }

    /// The common parts of start information: event class and identifier, priority class, number, date.
    pub(crate) fn start_info(&self, class: u8, id: u8, priority: u8, number: u8) -> [u8; 20] {
        let mut start = [0; 20];
        start[..4].copy_from_slice(&[class, id, priority, number]);
        start[12..].copy_from_slice(&date_and_time(self.machine.config.date_at_start + self.machine.now));
        start
    }

    /// Runs an organization block, nested in whatever runs.
    pub(crate) fn run_ob(&mut self, callee: Callee, info: ObInfo) -> Result<(), Abort> {
        let machine = &mut *self.machine;
        let Some(at) = machine.memory.local.locate(machine.local_top, 20) else {
            self.stop(Event(FaultKind::NestingDepth.number()), u32::from(info.number), "no local data left");
            return Err(Abort);
        };
        machine.memory.bytes[at as usize..at as usize + 20].copy_from_slice(&info.start);
        let outer = std::mem::replace(&mut machine.ob, info);
        let caller = machine.native_caller.take();
        let depth = std::mem::take(&mut machine.depth);
        let tops = (machine.local_top, machine.refs_top, machine.scratch_top, machine.frames.len());
        let result = match callee {
            Callee::Code(block) => self.blocks.engine.call(block, &Entry::default(), self),
            Callee::Native(index) => crate::native::call(index, &Entry::default(), self).map(|_| ()),
        };
        let machine = &mut *self.machine;
        machine.ob = outer;
        machine.native_caller = caller;
        machine.depth = depth;
        (machine.local_top, machine.refs_top, machine.scratch_top) = (tops.0, tops.1, tops.2);
        machine.frames.truncate(tops.3);
        result
    }

    /// A programming or access error: its OB, or STOP. `Ok`: the program goes on with the next statement.
    #[cold]
    pub(crate) fn fault(&mut self, fault: Fault, site: Option<Site>, accus: [u32; 2]) -> Result<(), Abort> {
        let number = fault.kind.ob();
        let callee = self.blocks.find(BlockId::new(BlockKind::Ob, number));
        let nested = self.machine.ob.number == number;
        self.machine.diag.push(DiagEntry {
            number: 0,
            time: self.machine.now,
            event: fault.kind.into(),
            site,
            accus,
            data: fault.number,
            text: ShortText::default(),
        });
        let (Some(callee), false) = (callee, nested) else {
            let event = if number == 121 { Event(0x4562) } else { Event(0x4563) };
            self.stop(event, u32::from(fault.kind.number()), if nested { "fault in the OB for faults" } else { "" });
            return Err(Abort);
        };
        let [class, id] = fault.kind.number().to_be_bytes();
        let mut start = self.start_info(class, id, self.machine.ob.priority, number as u8);
        let block = site.map_or(BlockId::new(BlockKind::Ob, 0), |s| s.block);
        start[4] = match block.kind {
            BlockKind::Ob => 0x88,
            BlockKind::Db => 0x8A,
            BlockKind::Fc | BlockKind::Sfc => 0x8C,
            BlockKind::Fb | BlockKind::Sfb => 0x8E,
        };
        start[6..8].copy_from_slice(&(fault.number as u16).to_be_bytes());
        start[8..10].copy_from_slice(&block.number.to_be_bytes());
        start[10..12].copy_from_slice(&(site.map_or(0, |s| s.line) as u16).to_be_bytes());
        self.run_ob(callee, ObInfo { number, priority: self.machine.ob.priority, start })
    }

    /// Starts the cycle monitoring anew, as at the beginning of a cycle.
    pub(crate) fn retrigger_watchdog(&mut self) {
        let machine = &mut *self.machine;
        machine.watchdog.excess = false;
        machine.watchdog.expires = (machine.config.watchdog > 0).then(|| machine.now + machine.config.watchdog);
    }

    /// OB 82, when it is loaded, for the module at `address` with the first four bytes of its diagnostic data.
    pub(crate) fn diagnostic_interrupt(&mut self, address: u32, data: [u8; 4]) -> Result<(), Abort> {
        let Some(callee) = self.blocks.find(BlockId::new(BlockKind::Ob, 82)) else { return Ok(()) };
        // Bit 0 of the first byte says that something is wrong with the module: the event comes; else it goes.
        let class = if data[0] & 1 == 1 { 0x39 } else { 0x38 };
        let mut start = self.start_info(class, 0x42, 26, 82);
        start[5] = 0x54;
        start[6..8].copy_from_slice(&(address as u16).to_be_bytes());
        start[8..12].copy_from_slice(&data);
        self.run_ob(callee, ObInfo { number: 82, priority: 26, start })
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
