//! A bus of the station: the process with its masters while it is running, and the field.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};

use ob1_backplane::{BusMemory, BusSize, CpSide, CpuSide, Segment};
use ob1_coupler::gpio::{GpioConfig, GpioMaster, Pins};
use ob1_coupler::{BusConfig, Input, MasterInput};
use ob1_host::bus::Bus;
use ob1_host::module::{DriverLink, Life};
use ob1_host::supervisor::{Exit, Report};
use ob1_io::{Master, Pump};
use ob1_station_file::Bus as BusOfFile;
use ob1_time::Instant;

use super::field::Field;

#[derive(Default)]
struct Process {
    running: AtomicBool,
    attempts: AtomicU32,
    reports: Mutex<VecDeque<Report>>,
}

struct Link(Arc<Process>);

impl DriverLink for Link {
    fn ring(&mut self) {}
    fn is_running(&self) -> bool {
        self.0.running.load(Ordering::Relaxed)
    }
    fn next_report(&mut self) -> Option<Report> {
        self.0.reports.lock().expect("not poisoned").pop_front()
    }
    fn life(&self) -> Life {
        Life { attempts: self.0.attempts.load(Ordering::Relaxed), incidents: 0 }
    }
}

/// A GPIO chip of the machine, which survives the process that uses its lines.
#[derive(Default)]
pub(crate) struct Chip {
    pub(crate) inputs: Vec<bool>,
    pub(crate) outputs: Vec<bool>,
    pub(crate) gone: bool,
    /// Its lines are in use.
    pub(crate) taken: bool,
    pub(crate) opened: u32,
}

pub(crate) type SharedChip = Rc<RefCell<Chip>>;

/// The lines of a chip in use by a process. When the process dies, the kernel releases them without changing their
/// values.
struct Lines(SharedChip);

impl Lines {
    fn open(chip: &SharedChip, config: &GpioConfig) -> Result<Box<dyn Pins>, String> {
        let mut known = chip.borrow_mut();
        if known.gone || known.taken {
            return Err(if known.gone { "it is not there" } else { "somebody has its lines" }.to_owned());
        }
        (known.taken, known.opened) = (true, known.opened + 1);
        known.outputs = vec![false; config.outputs.len()];
        Ok(Box::new(Self(Rc::clone(chip))))
    }
}

impl Pins for Lines {
    fn read(&mut self, inputs: &mut [bool]) -> Result<(), String> {
        let chip = self.0.borrow();
        inputs.copy_from_slice(&chip.inputs);
        if chip.gone { Err("it is gone".to_owned()) } else { Ok(()) }
    }

    fn write(&mut self, outputs: &[bool]) -> Result<(), String> {
        let mut chip = self.0.borrow_mut();
        if chip.gone {
            return Err("it is gone".to_owned());
        }
        chip.outputs = outputs.to_vec();
        Ok(())
    }
}

impl Drop for Lines {
    fn drop(&mut self) {
        self.0.borrow_mut().taken = false;
    }
}

/// The running process.
struct Alive {
    pump: Pump,
    masters: Vec<(Master, Instant)>,
    chips: Vec<(GpioMaster, Instant, SharedChip)>,
}

impl Alive {
    /// Like the process: handles each chip when it is due, or when the outputs have changed.
    fn chips(&mut self, now: Instant) {
        let Self { pump, chips, .. } = self;
        let changed = !chips.is_empty() && pump.look_at_scan(now);
        for (master, deadline, chip) in chips.iter_mut().filter(|(_, deadline, _)| changed || now >= *deadline) {
            *deadline = master.step(now, &mut pump.image, &mut |config| Lines::open(chip, config));
        }
        pump.show(now);
    }

    fn ask(&mut self, line: usize, now: Instant, input: MasterInput<'_>) -> (Vec<u8>, bool) {
        let mut out = Vec::new();
        let (master, deadline) = &mut self.masters[line];
        *deadline = master.step(now, input, &mut self.pump.image, &mut out);
        self.pump.show(now);
        (out, master.wants_reconnect())
    }
}

pub(crate) struct SimulatedBus {
    process: Arc<Process>,
    segment: Segment,
    memory: BusMemory,
    size: BusSize,
    config: BusConfig,
    alive: Option<Alive>,
    /// Start of the next process.
    begins: Instant,
    pub(crate) fields: Vec<Field>,
    /// The chips of its GPIO lines.
    pub(crate) chips: Vec<SharedChip>,
    pub(crate) kills: u32,
}

impl SimulatedBus {
    /// Creates it, and the part for the CPU.
    pub(crate) fn new(bus: &BusOfFile, fields: Vec<Field>, begins: Instant) -> (Self, Bus) {
        let (segment, memory) = (Segment::heap(), BusMemory::heap());
        let side = CpuSide::create(&segment, 8).expect("a segment");
        let (inputs, outputs) = (bus.config.input_bytes, bus.config.output_bytes);
        let size = BusSize::new(bus.stations.len(), inputs, outputs).expect("it fits");
        let process = Arc::new(Process::default());
        let link = Box::new(Link(Arc::clone(&process)));
        let host = Bus::new(side, link, &memory, size, outputs, bus.stations.clone(), bus.rules);
        let config = bus.config.clone();
        (
            Self { process, segment, memory, size, config, alive: None, begins, fields, chips: Vec::new(), kills: 0 },
            host,
        )
    }

    pub(crate) fn next(&self) -> Instant {
        let masters = self.alive.iter().flat_map(|alive| alive.masters.iter().map(|(_, deadline)| *deadline));
        let chips = self.alive.iter().flat_map(|alive| alive.chips.iter().map(|(_, deadline, _)| *deadline));
        let pump = self.alive.as_ref().map(|alive| alive.pump.deadline());
        let fields = self.fields.iter().map(Field::next);
        masters.chain(chips).chain(pump).chain(fields).fold(self.begins, Instant::min)
    }

    pub(crate) fn advance(&mut self, now: Instant) {
        let Self { alive, fields, .. } = self;
        for (line, field) in fields.iter_mut().enumerate() {
            let mut ask =
                |input: MasterInput<'_>| alive.as_mut().map_or_else(Default::default, |a| a.ask(line, now, input));
            field.advance(now, &mut ask);
        }
        for (line, field) in fields.iter_mut().enumerate() {
            if let Some(alive) = alive.as_mut().filter(|alive| now >= alive.masters[line].1) {
                field.tell(now, Input::Tick, &mut |input: MasterInput<'_>| alive.ask(line, now, input));
            }
        }
        if let Some(alive) = alive {
            alive.chips(now);
        }
        if now >= self.begins {
            self.begin(now);
        }
    }

    fn begin(&mut self, now: Instant) {
        self.begins = Instant::NEVER;
        let attempts = self.process.attempts.fetch_add(1, Ordering::Relaxed) + 1;
        let segment = CpSide::attach(&self.segment).expect("a segment");
        let mut pump = Pump::new(&self.config, segment, &self.memory, self.size, now);
        pump.look_at_scan(now);
        let mut first = 0;
        let (mut masters, mut chips) = (Vec::new(), Vec::new());
        for line in &self.config.lines {
            if let Some(gpio) = &line.gpio {
                chips.push((GpioMaster::new(gpio, first), now, Rc::clone(&self.chips[chips.len()])));
            } else {
                let master = Master::new(line, first, self.config.input_bytes, now).expect("bus parameters");
                masters.push((master, now));
            }
            first += line.stations().count();
        }
        let alive = self.alive.insert(Alive { masters, chips, pump });
        self.process.running.store(true, Ordering::Relaxed);
        self.process.reports.lock().expect("not poisoned").push_back(Report::Up(attempts));
        for (line, field) in self.fields.iter_mut().enumerate() {
            field.begin(now, &mut |input: MasterInput<'_>| alive.ask(line, now, input));
        }
    }

    pub(crate) fn is_alive(&self) -> bool {
        self.alive.is_some()
    }

    pub(crate) fn kill(&mut self, now: Instant, begins: Instant) {
        self.alive = None;
        self.kills += 1;
        self.begins = begins;
        self.fields.iter_mut().for_each(|field| field.end(now));
        self.process.running.store(false, Ordering::Relaxed);
        self.process.reports.lock().expect("not poisoned").push_back(Report::Lost(Exit::Signal(9)));
    }

    /// Rings the doorbell at the end of a scan.
    pub(crate) fn ring(&mut self, now: Instant) {
        let Some(alive) = &mut self.alive else { return };
        if !alive.chips.is_empty() {
            alive.chips(now);
        } else if alive.pump.look_at_scan(now) {
            for (line, field) in self.fields.iter_mut().enumerate() {
                field.tell(now, Input::Tick, &mut |input: MasterInput<'_>| alive.ask(line, now, input));
            }
        }
    }
}
