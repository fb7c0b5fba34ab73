//! The operating system of the CPU: states, cycle control, start-up and STOP.

use ob1_model::{BlockId, BlockKind, Event};

use crate::cells;
use crate::machine::{Blocks, Context, Interrupt, Machine, Watchdog};
use crate::port::AccessPort;
use crate::timers::{Counter, Timer};
use crate::{
    AccessClient, Answer, Ask, Cell, CellWidth, Clock, Command, CycleEnd, DiagEntry, LogReader, ModuleCounters,
    ModuleEvent, ModuleSlot, ModuleStatus, Nanos, ObInfo, OperatingState, PortError, ScanStatistics, ShortText,
};

/// Time between two looks at access port and modules in STOP.
const STOP_CYCLE: Nanos = 10_000_000;
/// Events taken from one module in one scan.
const EVENTS_PER_SCAN: usize = 8;
/// Half periods of the clock memory's bits 0 to 7 in milliseconds: 10, 5, 2.5, 2, 1.25, 1, 0.625 and 0.5 Hz.
const CLOCK_HALF_MS: [u64; 8] = [50, 100, 200, 250, 400, 500, 800, 1000];

/// A CPU with its program, modules and native blocks.
pub struct Cpu {
    machine: Machine,
    blocks: Blocks,
    port: AccessPort,
    client: Option<AccessClient>,
    log: Option<LogReader>,
    state: OperatingState,
    wanted: Option<Command>,
    /// When the running or next cycle was or is due.
    due: Nanos,
    last_start: Option<Nanos>,
    /// Milliseconds of the last, shortest and longest cycle, for OB 1's start information.
    cycle_ms: [u16; 3],
    first_scan: bool,
}

impl std::fmt::Debug for Cpu {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Cpu").field("state", &self.state).field("now", &self.machine.now).finish_non_exhaustive()
    }
}

impl Cpu {
    pub(crate) fn assemble(
        machine: Machine,
        blocks: Blocks,
        port: AccessPort,
        client: AccessClient,
        log: LogReader,
    ) -> Self {
        Self {
            machine,
            blocks,
            port,
            client: Some(client),
            log: Some(log),
            state: OperatingState::Stop,
            wanted: None,
            due: 0,
            last_start: None,
            cycle_ms: [0; 3],
            first_scan: true,
        }
    }

    /// The client end of the access port; there is one.
    pub fn access_client(&mut self) -> Option<AccessClient> {
        self.client.take()
    }

    /// The reading end of the log; there is one.
    pub fn log_reader(&mut self) -> Option<LogReader> {
        self.log.take()
    }

    /// Flags for other threads: look at the watchdog, or stop.
    #[must_use]
    pub fn interrupt(&self) -> Interrupt {
        self.machine.interrupt.clone()
    }

    /// Asks for a change of state; the next [`Cpu::cycle`] makes it.
    pub fn request(&mut self, command: Command) {
        self.wanted = Some(command);
    }

    /// The operating state.
    #[must_use]
    pub fn state(&self) -> OperatingState {
        self.state
    }

    /// The CPU's own time.
    #[must_use]
    pub fn now(&self) -> Nanos {
        self.machine.now
    }

    /// The diagnostic buffer, newest first.
    pub fn diagnostics(&self) -> impl Iterator<Item = &DiagEntry> {
        self.machine.diag.iter()
    }

    /// Enters an event from outside the program: a driver's supervisor, the command.
    pub fn diagnose(&mut self, event: Event, data: u32, text: &str) {
        let entry = DiagEntry {
            number: 0,
            time: self.machine.now,
            event,
            site: None,
            accus: [0; 2],
            data,
            text: ShortText::new(text),
        };
        self.machine.diag.push(entry);
    }

    /// The scan statistics.
    #[must_use]
    pub fn statistics(&self) -> ScanStatistics {
        self.machine.statistics.snapshot(self.machine.statements + u64::from(self.machine.pending))
    }

    /// Number of modules.
    #[must_use]
    pub fn module_count(&self) -> usize {
        self.machine.modules.list.len()
    }

    /// The slot and state of a module, by its place in the list given at load.
    #[must_use]
    pub fn module(&self, index: usize) -> Option<(&ModuleSlot, ModuleStatus)> {
        Some((&self.machine.modules.list.get(index)?.slot, self.machine.modules.status(index)?))
    }

    /// A module's counters. Not for the scan path.
    pub fn module_counters(&self, index: usize, each: ModuleCounters<'_>) {
        if let Some(plugged) = self.machine.modules.list.get(index) {
            plugged.module.counters(each);
        }
    }

    /// Reads a cell, between two cycles.
    ///
    /// # Errors
    /// The cell does not exist.
    pub fn read(&mut self, cell: Cell, width: CellWidth) -> Result<u32, PortError> {
        cells::read(&mut self.machine, cell, width)
    }

    /// Writes a cell, between two cycles.
    ///
    /// # Errors
    /// The cell does not exist, cannot be written, or does not hold the value.
    pub fn write(&mut self, cell: Cell, width: CellWidth, value: u32) -> Result<(), PortError> {
        cells::write(&mut self.machine, cell, width, value)
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
        self.machine.memory.bytes.get(db.at as usize..(db.at + db.len) as usize)
    }

    /// Bytes [`Cpu::snapshot_into`] needs.
    #[must_use]
    pub fn snapshot_len(&self) -> usize {
        self.machine.memory.snapshot_len()
    }

    /// Copies bit memory, then all data blocks in ascending order (each padded to a multiple of eight bytes), as they are between two
    /// cycles. `false`, and nothing copied, when `into` has another length. Allocates nothing.
    #[must_use]
    pub fn snapshot_into(&self, into: &mut [u8]) -> bool {
        self.machine.memory.snapshot_into(into)
    }

    /// One whole cycle: access port, events of the modules, process image of the inputs, OB 1, process image of the outputs,
    /// statistics. In STOP only access port and modules are served. The caller sleeps until the deadline it is given.
    pub fn cycle(&mut self, clock: &mut dyn Clock) -> CycleEnd {
        self.machine.now = self.machine.now.max(clock.now());
        self.serve_port();
        if self.machine.interrupt.take_halt() {
            self.wanted = Some(Command::Stop);
        }
        if let Some(command) = self.wanted.take() {
            self.obey(command, clock);
        }
        match self.state {
            // After a start-up the first cycle begins now: OB 100 is not part of it.
            OperatingState::Run => self.run_cycle(self.machine.now, clock),
            _ => self.stop_cycle(clock),
        }
    }

    fn run_cycle(&mut self, start: Nanos, clock: &mut dyn Clock) -> CycleEnd {
        let planned = if self.due <= start { self.due } else { start };
        if let Some(last) = self.last_start.replace(start) {
            let time = start - last;
            self.machine.statistics.record_cycle(time);
            let ms = (time / 1_000_000).min(32_767) as u16;
            let [_, least, most] = self.cycle_ms;
            let least = if self.machine.statistics.scans <= 1 { ms } else { least.min(ms) };
            self.cycle_ms = [ms, least, most.max(ms)];
        }
        self.machine.watchdog = Watchdog {
            expires: (self.machine.config.watchdog > 0).then(|| start + self.machine.config.watchdog),
            excess: false,
        };
        self.machine.modules.begin_scan(start);
        let ran = self.module_events(clock).and_then(|()| {
            self.clock_memory();
            let m = &mut self.machine;
            m.modules.read_image(&mut m.memory);
            self.ob1(clock)
        });
        // A cycle too long is noticed at its end too, when the last stretch had no safe point.
        let ran = ran.and_then(|()| {
            let mut cx = Context { machine: &mut self.machine, blocks: &self.blocks, clock };
            cx.attend()
        });
        self.machine.watchdog.expires = None;
        if ran.is_err() || self.machine.stopping {
            self.enter_stop();
            return self.stop_cycle(clock);
        }
        let m = &mut self.machine;
        m.modules.write_image(&m.memory);
        m.modules.end_scan(m.now);
        m.now = m.now.max(clock.now());
        m.statistics.scans += 1;
        m.statistics.record_execution(m.now - start);
        let min = m.config.min_cycle;
        self.due = planned + min;
        if self.due < m.now {
            m.statistics.overruns += u64::from(min > 0);
            self.due = m.now;
        }
        CycleEnd { next_deadline: self.due, state: self.state }
    }

    fn ob1(&mut self, clock: &mut dyn Clock) -> Result<(), crate::Abort> {
        let Some(callee) = self.blocks.find(BlockId::new(BlockKind::Ob, 1)) else { return Ok(()) };
        let mut cx = Context { machine: &mut self.machine, blocks: &self.blocks, clock };
        let mut start = cx.start_info(0x11, if self.first_scan { 1 } else { 3 }, 1, 1);
        self.first_scan = false;
        for (i, ms) in self.cycle_ms.into_iter().enumerate() {
            start[6 + 2 * i..8 + 2 * i].copy_from_slice(&ms.to_be_bytes());
        }
        cx.run_ob(callee, ObInfo { number: 1, priority: 1, start })
    }

    /// Serves access port and modules while the program stands still.
    fn stop_cycle(&mut self, clock: &mut dyn Clock) -> CycleEnd {
        let now = self.machine.now;
        self.machine.modules.begin_scan(now);
        // No organization block runs in STOP: this cannot abort.
        let _ = self.module_events(clock);
        let m = &mut self.machine;
        m.modules.read_image(&mut m.memory);
        m.modules.end_scan(now);
        self.due = now + STOP_CYCLE;
        CycleEnd { next_deadline: self.due, state: self.state }
    }

    /// Diagnostic entries and interrupts of the modules.
    fn module_events(&mut self, clock: &mut dyn Clock) -> Result<(), crate::Abort> {
        for index in 0..self.machine.modules.list.len() {
            for _ in 0..EVENTS_PER_SCAN {
                let plugged = &mut self.machine.modules.list[index];
                let Some(event) = plugged.module.poll_event() else { break };
                let address = plugged.slot.input_address;
                let text = event_text(&plugged.slot.name, &event);
                self.machine.diag.push(DiagEntry {
                    number: 0,
                    time: self.machine.now,
                    event: event.event,
                    site: None,
                    accus: [0; 2],
                    data: address,
                    text,
                });
                if event.diagnostic_interrupt && self.state == OperatingState::Run {
                    let data = [event.data[0], event.data[1], event.data[2], event.data[3]];
                    let mut cx = Context { machine: &mut self.machine, blocks: &self.blocks, clock: &mut *clock };
                    cx.diagnostic_interrupt(address, data)?;
                }
            }
        }
        Ok(())
    }

    fn clock_memory(&mut self) {
        let Some(byte) = self.machine.config.clock_memory else { return };
        let ms = self.machine.now / 1_000_000;
        let bits = (0u8..).zip(CLOCK_HALF_MS).fold(0, |bits, (i, half)| bits | (((ms / half) & 1) as u32) << i);
        let at = (self.machine.memory.memory.at + u32::from(byte)) * 8;
        self.machine.memory.write_bits(at, 8, bits);
    }

    fn obey(&mut self, command: Command, clock: &mut dyn Clock) {
        let running = self.state == OperatingState::Run;
        match command {
            Command::Run if running => {}
            Command::Run | Command::Warm => self.start_up(false, clock),
            Command::Cold => self.start_up(true, clock),
            Command::Stop if running => {
                self.diagnose(Event::STOP_OPERATOR, 0, "");
                self.enter_stop();
            }
            Command::Stop => {}
            Command::Reset => {
                if running {
                    self.enter_stop();
                }
                self.clear(true);
                self.diagnose(Event::MEMORY_RESET, 0, "");
            }
        }
    }

    /// Process images, bit memory, timers and counters to 0; data blocks to their load values on `cold`.
    fn clear(&mut self, cold: bool) {
        let m = &mut self.machine;
        m.memory.clear_areas();
        m.timers.fill(Timer::default());
        m.counters.fill(Counter::default());
        if cold {
            m.memory.reload_dbs();
        }
        for native in &self.blocks.natives {
            native.block.reset();
        }
        m.stopping = false;
        (m.refs_top, m.scratch_top, m.local_top, m.depth) = (0, 0, 0, 0);
        m.frames.clear();
        m.ob = ObInfo::default();
        m.native_caller = None;
    }

    /// STOP to RUN through OB 100, or OB 102 on a cold restart when it is loaded.
    fn start_up(&mut self, cold: bool, clock: &mut dyn Clock) {
        if self.state == OperatingState::Run {
            self.diagnose(Event::STOP_OPERATOR, 0, "restart");
            self.enter_stop();
        }
        self.clear(cold);
        self.state = OperatingState::Startup;
        self.diagnose(Event::STARTUP, 0, if cold { "cold restart" } else { "warm restart" });
        self.machine.modules.cpu_state(true);
        self.machine.watchdog = Watchdog::default();
        let cold_ob = cold.then(|| self.blocks.find(BlockId::new(BlockKind::Ob, 102))).flatten();
        let (number, callee) = match cold_ob {
            Some(callee) => (102, Some(callee)),
            None => (100, self.blocks.find(BlockId::new(BlockKind::Ob, 100))),
        };
        if let Some(callee) = callee {
            let mut cx = Context { machine: &mut self.machine, blocks: &self.blocks, clock };
            let start = cx.start_info(0x13, if cold { 0x85 } else { 0x81 }, 27, number as u8);
            let ran = cx.run_ob(callee, ObInfo { number, priority: 27, start }).and_then(|()| cx.attend());
            if ran.is_err() || self.machine.stopping {
                self.enter_stop();
                return;
            }
        }
        self.state = OperatingState::Run;
        self.diagnose(Event::RUN, 0, "");
        self.due = self.machine.now;
        self.last_start = None;
        self.cycle_ms = [0; 3];
        self.first_scan = true;
    }

    /// The program stands still, every output is 0.
    fn enter_stop(&mut self) {
        self.state = OperatingState::Stop;
        self.last_start = None;
        let m = &mut self.machine;
        m.stopping = false;
        m.watchdog = Watchdog::default();
        let outputs = m.memory.outputs;
        m.memory.slice_mut(outputs).fill(0);
        m.modules.outputs_off();
        m.modules.cpu_state(false);
    }

    fn serve_port(&mut self) {
        for _ in 0..self.machine.config.port_items_per_scan.max(1) {
            let Some(request) = self.port.next() else { break };
            let answer = self.answer(request.ask).unwrap_or_else(Answer::Refused);
            self.port.answer(request.id, answer);
        }
    }

    fn answer(&mut self, ask: Ask) -> Result<Answer, PortError> {
        Ok(match ask {
            Ask::Read(cell, width) => Answer::Value(cells::read(&mut self.machine, cell, width)?),
            Ask::Write(cell, width, value) => {
                cells::write(&mut self.machine, cell, width, value)?;
                Answer::Done
            }
            Ask::Command(command) => {
                self.wanted = Some(command);
                Answer::Done
            }
            Ask::State => Answer::State(self.state),
            Ask::Diag(back) => Answer::Diag(*self.machine.diag.get(back as usize).ok_or(PortError::NoEntry)?),
            Ask::Statistics => Answer::Statistics(self.statistics()),
            Ask::ResetStatistics => {
                self.machine.statistics.reset();
                Answer::Done
            }
            Ask::Module(index) => {
                Answer::Module(self.machine.modules.status(index as usize).ok_or(PortError::NoModule)?)
            }
        })
    }
}

/// The module's name, and the event's data where it is text.
fn event_text(name: &str, event: &ModuleEvent) -> ShortText {
    let data = event.data.get(..usize::from(event.len)).unwrap_or(&event.data);
    match std::str::from_utf8(data) {
        Ok(text) if !text.is_empty() && !text.contains(|c: char| c.is_control()) => {
            ShortText::join(&[name, ": ", text])
        }
        _ => ShortText::new(name),
    }
}
