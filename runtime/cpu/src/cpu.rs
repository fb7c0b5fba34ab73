//! A CPU seen from outside: commands, figures, cells, links. Its cycle is in [`crate::cycle`], its start-up in
//! [`crate::startup`].

use std::sync::Arc;

use ob1_model::Event;
use ob1_time::Instant;

use crate::alarms::AlarmClient;
use crate::cells;
use crate::context::Blocks;
use crate::engine::{Engine, Plan};
use crate::exchange::{Exchange, Link};
use crate::machine::{Attention, Machine};
use crate::natives::Running;
use crate::{
    Accounts, Cell, CellError, Command, DiagEntry, InterruptError, LogReader, ModuleSlot, ModuleStatus, OperatingState,
    RecordingClient, ScanPosition, ScanRecord, ScanStatistics, ShortText, Sums, Width, Window,
};

/// A CPU with its program, modules and native blocks.
pub struct Cpu {
    pub(crate) machine: Machine,
    pub(crate) blocks: Blocks,
    pub(crate) exchange: Exchange,
    alarms: Option<AlarmClient>,
    log: Option<LogReader>,
    pub(crate) state: OperatingState,
    /// When the running or next cycle was or is due.
    pub(crate) due: Instant,
    pub(crate) last_start: Option<Instant>,
    /// Milliseconds of the last, shortest and longest cycle, for OB 1's start information.
    pub(crate) cycle_ms: [u16; 3],
    /// OB1_SCAN_1 of the next cycle.
    pub(crate) first_scan: u8,
    /// It has been in RUN since load or memory reset.
    pub(crate) has_run: bool,
    /// The event that led to STOP.
    pub(crate) stop_event: u16,
}

impl std::fmt::Debug for Cpu {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Cpu").field("state", &self.state).field("now", &self.machine.hot.now).finish_non_exhaustive()
    }
}

impl Cpu {
    pub(crate) fn assemble(machine: Machine, blocks: Blocks, alarms: AlarmClient, log: LogReader) -> Self {
        Self {
            machine,
            blocks,
            exchange: Exchange::default(),
            alarms: Some(alarms),
            log: Some(log),
            state: OperatingState::Stop,
            due: Instant::START,
            last_start: None,
            cycle_ms: [0; 3],
            first_scan: 1,
            has_run: false,
            stop_event: 0,
        }
    }

    /// The end of the alarms for the broker; there is one.
    pub fn alarm_client(&mut self) -> Option<AlarmClient> {
        self.alarms.take()
    }

    /// A link that reads and writes at the cycle control point, and the window its snapshots go to; there are
    /// [`crate::LINKS`].
    pub fn link(&mut self, window: Box<dyn Window>) -> Option<Link> {
        self.exchange.link(window)
    }

    /// Begins recordings; there is one.
    pub fn recording_client(&mut self) -> Option<RecordingClient> {
        self.exchange.recordings.client()
    }

    /// The reading end of the log; there is one.
    pub fn log_reader(&mut self) -> Option<LogReader> {
        self.log.take()
    }

    /// What is loaded, as engines run it.
    #[must_use]
    pub fn plan(&self) -> &Arc<Plan> {
        &self.blocks.plan
    }

    /// The name of the engine that runs the program.
    #[must_use]
    pub fn engine(&self) -> &'static str {
        self.blocks.engine.name()
    }

    /// Exchanges the engine, between two calls of [`Cpu::cycle`]; nothing is allocated or freed. Returns the old one.
    ///
    /// # Errors
    /// The new engine was made for another plan than [`Cpu::plan`]; it is returned.
    pub fn exchange_engine(&mut self, engine: Box<dyn Engine>) -> Result<Box<dyn Engine>, Box<dyn Engine>> {
        if !Arc::ptr_eq(engine.plan(), &self.blocks.plan) {
            return Err(engine);
        }
        self.disarm();
        let before = std::mem::replace(&mut self.blocks.engine, engine);
        self.arm();
        Ok(before)
    }

    /// Which native block runs, for a monitor.
    #[must_use]
    pub fn running(&self) -> Arc<Running> {
        Arc::clone(&self.blocks.running)
    }

    /// Flags for other threads: look at the watchdog, or stop.
    #[must_use]
    pub fn attention(&self) -> Attention {
        self.machine.attention.clone()
    }

    /// Bytes of stack that a thread needs to call [`Cpu::cycle`]: for the deepest nesting of organization blocks and
    /// native blocks that is possible with what is loaded.
    #[must_use]
    pub fn stack_bytes(&self) -> usize {
        self.machine.stack
    }

    /// Where the scan is, for other threads and for a signal handler.
    #[must_use]
    pub fn position(&self) -> Arc<ScanPosition> {
        Arc::clone(&self.machine.position)
    }

    /// Asks for a change of state; the next [`Cpu::cycle`] makes it.
    pub fn request(&mut self, command: Command) {
        self.machine.wanted = Some(command);
    }

    /// The operating state at this moment.
    #[must_use]
    pub fn state(&self) -> OperatingState {
        self.state
    }

    /// The CPU's own time.
    #[must_use]
    pub fn now(&self) -> Instant {
        self.machine.hot.now
    }

    /// The diagnostic buffer, newest first.
    pub fn diagnostics(&self) -> impl Iterator<Item = &DiagEntry> {
        self.machine.diag.iter()
    }

    /// The same as it is kept.
    #[must_use]
    pub const fn diagnostic_buffer(&self) -> &crate::DiagBuffer {
        &self.machine.diag
    }

    /// A diagnostic entry, counted back from the newest (0).
    #[must_use]
    pub fn diagnostic(&self, back: usize) -> Option<&DiagEntry> {
        self.machine.diag.get(back)
    }

    /// Enters an event from outside the program: a driver's supervisor, the command.
    pub fn diagnose(&mut self, event: Event, data: u32, text: &str) {
        self.machine.enter(event, None, data, ShortText::new(text));
    }

    /// The scan statistics since load, the running scan's statements included.
    #[must_use]
    pub fn statistics(&self) -> ScanStatistics {
        let statements = self.machine.statements + u64::from(self.machine.hot.pending);
        ScanStatistics { statements, ..self.machine.trace.accounts.figures().statistics() }
    }

    /// The accounts of every scan, for readers outside it.
    #[must_use]
    pub fn accounts(&self) -> Arc<Accounts> {
        Arc::clone(&self.machine.trace.accounts)
    }

    /// The sums over all scans so far.
    #[must_use]
    pub fn sums(&self) -> Sums {
        self.machine.trace.accounts.sums()
    }

    /// When the next cycle is due; interrupts may come before it.
    #[must_use]
    pub fn next_due(&self) -> Instant {
        self.due
    }

    /// The last finished scan.
    #[must_use]
    pub fn last_scan(&self) -> &ScanRecord {
        &self.machine.trace.last
    }

    /// A hardware interrupt for OB 40 to 47, with the address and the point of its start information. It runs in the
    /// next cycle, or at the next call of [`Cpu::cycle`] when that comes before the cycle is due.
    ///
    /// # Errors
    /// The OB does not exist, the CPU is not in RUN, or too many wait.
    pub fn fire_hardware_interrupt(&mut self, ob: u16, address: u16, point: u32) -> Result<(), InterruptError> {
        self.machine.fire_hardware_interrupt(&self.blocks, self.state, (ob, address, point))
    }

    /// Number of modules given at load.
    #[must_use]
    pub fn module_count(&self) -> usize {
        self.machine.modules.list.len()
    }

    /// The slot and state of a module, by its place in the list given at load.
    #[must_use]
    pub fn module(&self, index: usize) -> Option<(&ModuleSlot, ModuleStatus)> {
        Some((&self.machine.modules.list.get(index)?.slot, self.machine.modules.status(index)?))
    }

    /// Reads a cell, between two cycles.
    ///
    /// # Errors
    /// The cell does not exist.
    pub fn read(&mut self, cell: Cell, width: Width) -> Result<u32, CellError> {
        cells::read(&mut self.machine, cell, width)
    }

    /// Writes a cell, between two cycles.
    ///
    /// # Errors
    /// The cell does not exist, cannot be written, or does not hold the value.
    pub fn write(&mut self, cell: Cell, width: Width, value: u32) -> Result<(), CellError> {
        cells::write(&mut self.machine, cell, width, value)?;
        self.machine.put_forced();
        Ok(())
    }

    /// Bytes of bit memory, for dumps.
    #[must_use]
    pub fn bit_memory(&self) -> &[u8] {
        self.machine.memory.slice(self.machine.memory.memory)
    }

    /// A data block's bytes.
    #[must_use]
    pub fn data_block(&self, number: u16) -> Option<&[u8]> {
        let db = self.machine.memory.db(number)?;
        self.machine.memory.bytes.get(db.range().bytes())
    }
}
