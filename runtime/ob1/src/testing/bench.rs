//! A CPU on the bench: modules over memory of this process, virtual time, one scan at a time.

use std::sync::Arc;

use ob1_backplane::io_layout::IO_AREA_BYTES;
use ob1_backplane::{IoField, IoImage};
use ob1_cpu::{Attention, Cell, Clock, Command, Cpu, CpuConfig, OperatingState, Width};
use ob1_ir::Program;
use ob1_model::Area;

use super::cells::Set;
use crate::check::dummy;
use crate::virtual_clock::VirtualClock;
use ob1_access::Item;
use ob1_record::{Pace, Stage};
use ob1_station::assembly;
use ob1_station::io::{ProcessIo, Stimulus};
use ob1_station::program::Loaded;
use ob1_station_file::EngineChoice;
use ob1_station_file::finding::Finding;
use ob1_station_file::{Absent, ModuleConfig, ModuleKind};
use ob1_time::{Instant, Span};

/// Statements that take no time in one scan: those of an ordinary program, so that timers run out to the millisecond.
const FREE: u64 = 1_000_000;
/// What each further one takes, so that an endless loop meets the watchdog.
const PER_STATEMENT: Span = Span::from_nanos(100);
/// Statements in one scan after which it is given up, whatever the watchdog says.
const GIVE_UP: u64 = 1_000_000_000;

/// Process image of sources without a station, in bytes each way; what lies beyond is reached as `PEW` and `PAW`.
const BARE_IMAGE_BYTES: u32 = 1024;

/// Process I/O of sources without a station: as much as there can be.
pub(crate) fn bare_modules() -> Vec<ModuleConfig> {
    let bytes = IO_AREA_BYTES as u16;
    let module = |name: &str, kind| ModuleConfig {
        name: name.into(),
        input_address: 0,
        output_address: 0,
        absent: Absent::Zero,
        substitute: Vec::new(),
        driver: None,
        kind,
    };
    vec![
        module("inputs", ModuleKind::Inputs { bytes, analog: false }),
        module("outputs", ModuleKind::Outputs { bytes, analog: false }),
    ]
}

/// Virtual time of a bench.
#[derive(Debug)]
struct BenchClock {
    time: VirtualClock,
    scan: u64,
    /// What each statement takes in a replay.
    price: Option<Span>,
    /// Time that passes after the next look: in a replay, from the start of a scan to its OB 1.
    after_look: Span,
    attention: Attention,
}

impl Clock for BenchClock {
    fn now(&mut self) -> Instant {
        let now = self.time.now();
        self.time.advance_to(now.saturating_add(std::mem::take(&mut self.after_look)));
        now
    }

    fn executed(&mut self, statements: u64) {
        let before = self.scan;
        self.scan = before.saturating_add(statements);
        match self.price {
            Some(price) => self.time.advance_to(self.time.time().saturating_add(price.times(statements))),
            None => self.time.executed(self.scan.saturating_sub(before.max(FREE))),
        }
        if self.scan > GIVE_UP {
            self.attention.halt();
        }
    }

    fn statements_in(&self, time: Span) -> Option<u64> {
        if let Some(price) = self.price {
            return Some(if price.is_zero() { u64::MAX } else { time.div_ceil(price) });
        }
        let free = FREE.saturating_sub(self.scan);
        Some(self.time.statements_in(time)?.saturating_add(free))
    }

    fn wait(&mut self, deadline: Instant) {
        self.time.wait(deadline);
    }
}

/// A CPU on the bench.
pub(crate) struct Bench {
    pub(crate) cpu: Cpu,
    clock: BenchClock,
    io: ProcessIo,
    field: IoField,
    /// The process inputs, as they were set.
    process: [u8; IO_AREA_BYTES],
    /// Bytes of them that modules cover.
    inputs: Vec<std::ops::Range<u32>>,
    /// When the next scan or interrupt is due.
    pub(super) due: Instant,
    /// The time the test has reached: that of the last scan, or what `run` was to reach.
    pub(crate) now: Instant,
    pub(crate) scans: u64,
}

impl Bench {
    /// Loads `program` with modules in the form of a station's.
    pub(crate) fn new(
        name: &str,
        config: CpuConfig,
        modules: &[ModuleConfig],
        loaded: &Loaded,
    ) -> Result<Self, Vec<Finding>> {
        let seen: Vec<_> = modules.iter().map(ob1_station::assembly::plugin_module).collect();
        let natives = loaded.native_blocks(&seen)?;
        let image = IoImage::heap();
        let field = image.field();
        let io = ProcessIo::new(image, Stimulus::default());
        let slots = modules.iter().filter_map(|m| Some((assembly::slot(m), dummy(&io, name, m)?))).collect();
        let cpu = assembly::load_cpu(config, (loaded, &loaded.program), natives, slots, EngineChoice::Auto)?;
        let clock = BenchClock {
            time: VirtualClock::new(PER_STATEMENT),
            scan: 0,
            price: None,
            after_look: Span::ZERO,
            attention: cpu.attention(),
        };
        let inputs = modules.iter().filter_map(|m| match m.kind {
            ModuleKind::Inputs { .. } | ModuleKind::Remote { .. } => {
                Some(m.input_address..m.input_address + u32::from(m.input_bytes()))
            }
            _ => None,
        });
        Ok(Self {
            cpu,
            clock,
            io,
            field,
            process: [0; IO_AREA_BYTES],
            inputs: inputs.collect(),
            due: Instant::START,
            now: Instant::START,
            scans: 0,
        })
    }

    /// Starts the CPU and runs the first scan, at time 0.
    pub(crate) fn start(&mut self, command: Command) {
        self.cpu.request(command);
        self.cycle();
    }

    /// What is due next: a scan (true), or interrupts by time alone.
    pub(crate) fn cycle(&mut self) -> bool {
        self.clock.scan = 0;
        self.clock.time.advance_to(self.due);
        self.now = self.now.max(self.clock.time.time());
        let end = self.cpu.cycle(&mut self.clock);
        self.due = end.next_deadline;
        let whole = end.whole || end.state != OperatingState::Run;
        self.scans += u64::from(whole);
        whole
    }

    /// One scan, when it is due, with the interrupts before it.
    pub(crate) fn scan(&mut self) {
        while !self.cycle() {}
    }

    /// All scans and interrupts that are due until `time`.
    pub(crate) fn run_until(&mut self, time: Instant) {
        while self.due <= time {
            self.cycle();
        }
        self.now = self.now.max(time);
    }

    /// True when something is due until `time`.
    pub(crate) fn is_due_until(&self, time: Instant) -> bool {
        self.due <= time
    }

    pub(crate) fn state(&self) -> OperatingState {
        self.cpu.state()
    }

    /// Writes a cell. Inputs go to the module that has them, as the process would, else to the process image.
    pub(super) fn set(&mut self, set: &Set) -> Result<(), String> {
        if let Some(bit) = self.module_input(set) {
            self.set_input(bit, set);
        } else if matches!(set.item.cell, Cell::Peripheral(_)) {
            return Err(format!("{}: no process input has this address", set.item.name));
        }
        if let Cell::Peripheral(_) = set.item.cell {
            return Ok(());
        }
        let written = self.cpu.write(set.item.cell, set.item.width, set.value);
        written.map_err(|error| format!("{}: {}", set.item.name, error))
    }

    /// The bit address of an input that a module has.
    fn module_input(&self, set: &Set) -> Option<u32> {
        let (Cell::Area(Area::Input, bit) | Cell::Peripheral(bit)) = set.item.cell else { return None };
        self.inputs.iter().any(|bytes| bytes.contains(&(bit / 8))).then_some(bit)
    }

    fn set_input(&mut self, bit: u32, set: &Set) {
        let byte = (bit / 8) as usize;
        if set.item.width == Width::Bit {
            let mask = 1u8 << (bit % 8);
            let old = self.process.get(byte).copied().unwrap_or_default();
            self.write_input(byte, &[if set.value != 0 { old | mask } else { old & !mask }]);
        } else {
            let bytes = set.value.to_be_bytes();
            let len = usize::from(set.item.width.bits() / 8);
            self.write_input(byte, &bytes[bytes.len() - len..]);
        }
    }

    /// A byte of the process inputs, as it was written last.
    pub(crate) fn input(&self, byte: usize) -> u8 {
        self.process.get(byte).copied().unwrap_or_default()
    }

    pub(crate) fn write_input(&mut self, byte: usize, data: &[u8]) {
        self.field.write_inputs(byte, data);
        for (cell, value) in self.process.iter_mut().skip(byte).zip(data) {
            *cell = *value;
        }
    }

    /// From here on each statement takes so long; `None`: only very many take any time.
    pub(super) fn charge(&mut self, price: Option<Span>) {
        self.clock.price = price;
    }

    /// From the start of the next scan to its OB 1 it takes so long.
    pub(super) fn inputs_take(&mut self, time: Span) {
        self.clock.after_look = time;
    }

    /// It runs, or what led to STOP, newest first.
    fn in_run(&self) -> Result<(), String> {
        if self.state() == OperatingState::Run {
            return Ok(());
        }
        let entries: Vec<String> = self.cpu.diagnostics().take(2).map(ToString::to_string).collect();
        Err(format!("the CPU is in STOP; {}", entries.join("; ")))
    }

    /// The process side of the I/O image: reads outputs, sets inputs.
    pub(crate) fn field(&self) -> IoField {
        self.field.clone()
    }
}

impl Stage for Bench {
    fn sense(&mut self, item: &Item, bits: u32) -> Result<(), String> {
        let set = Set { item: item.clone(), value: bits };
        match self.module_input(&set) {
            Some(bit) => self.set_input(bit, &set),
            // Without a module the memory is the process.
            None => self.set(&set)?,
        }
        Ok(())
    }

    fn set(&mut self, item: &Item, bits: u32) -> Result<(), String> {
        self.cpu.write(item.cell, item.width, bits).map_err(|error| format!("{}: {error}", item.name))
    }

    fn get(&mut self, item: &Item) -> Option<u32> {
        self.cpu.read(item.cell, item.width).ok()
    }

    fn start(&mut self, at: Instant) -> Result<(), String> {
        self.clock.price = Some(Span::ZERO);
        self.clock.time.advance_to(at);
        // What runs already is ended: a start follows.
        self.cpu.request(Command::Stop);
        self.cpu.change_state(&mut self.clock);
        self.cpu.request(Command::Warm);
        self.cpu.change_state(&mut self.clock);
        self.due = at;
        self.in_run()
    }

    fn scan(&mut self, pace: Pace) -> Result<(), String> {
        self.clock.price = Some(pace.statement);
        loop {
            self.due = pace.start;
            // The first look finds the start of the scan, the next one that of OB 1.
            self.inputs_take(pace.inputs);
            if self.cycle() {
                break;
            }
        }
        self.in_run()
    }

    fn wait(&mut self, until: Instant) -> Result<(), String> {
        while self.due < until.min(self.cpu.next_due()) {
            self.cycle();
        }
        self.clock.time.advance_to(until);
        self.cpu.change_state(&mut self.clock);
        self.in_run()
    }
}

impl std::fmt::Debug for Bench {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Bench").field("cpu", &self.cpu).field("io", &self.io).finish_non_exhaustive()
    }
}

/// The CPU of sources without a station.
pub(crate) fn bare_config(min_cycle: Span) -> CpuConfig {
    let bytes = BARE_IMAGE_BYTES;
    CpuConfig { input_bytes: bytes, output_bytes: bytes, memory_bytes: 2048, min_cycle, ..CpuConfig::default() }
}

/// A program with what its natives come from.
pub(crate) fn loaded(program: Program, of: &Loaded) -> Loaded {
    Loaded {
        program: Arc::new(program),
        plugins: of.plugins.clone(),
        standard: of.standard.clone(),
        findings: Vec::new(),
        numbers: Vec::new(),
        mnemonics: of.mnemonics,
    }
}
