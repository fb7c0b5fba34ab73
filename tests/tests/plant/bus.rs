//! A bus of the station: the process with its masters while it lives, and the field.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};

use ob1_backplane::{BusMemory, BusSize, CpSide, CpuSide, Segment};
use ob1_coupler::{BusConfig, Input, MasterInput};
use ob1_host::bus::Bus;
use ob1_host::module::{DriverLink, Life};
use ob1_host::supervisor::{Exit, Report};
use ob1_io::{Master, Pump};
use ob1_station::station_file::Bus as BusOfFile;
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

/// The process while it lives.
struct Alive {
    pump: Pump,
    masters: Vec<(Master, Instant)>,
}

impl Alive {
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
    /// When the next process begins.
    begins: Instant,
    pub(crate) fields: Vec<Field>,
    pub(crate) kills: u32,
}

impl SimulatedBus {
    /// With what the CPU sees of it.
    pub(crate) fn new(bus: &BusOfFile, fields: Vec<Field>, begins: Instant) -> (Self, Bus) {
        let (segment, memory) = (Segment::heap(), BusMemory::heap());
        let side = CpuSide::create(&segment, 8).expect("a segment");
        let (inputs, outputs) = (bus.config.input_bytes, bus.config.output_bytes);
        let size = BusSize::new(bus.stations.len(), inputs, outputs).expect("it fits");
        let process = Arc::new(Process::default());
        let link = Box::new(Link(Arc::clone(&process)));
        let host = Bus::new(side, link, &memory, size, outputs, bus.stations.clone(), bus.rules);
        let config = bus.config.clone();
        (Self { process, segment, memory, size, config, alive: None, begins, fields, kills: 0 }, host)
    }

    pub(crate) fn next(&self) -> Instant {
        let masters = self.alive.iter().flat_map(|alive| alive.masters.iter().map(|(_, deadline)| *deadline));
        let pump = self.alive.as_ref().map(|alive| alive.pump.deadline());
        let fields = self.fields.iter().map(Field::next);
        masters.chain(pump).chain(fields).fold(self.begins, Instant::min)
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
            alive.pump.show(now);
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
        let masters = self.config.lines.iter().map(|line| {
            let master = Master::new(line, first, self.config.input_bytes, now).expect("bus parameters");
            first += line.stations().count();
            (master, now)
        });
        let alive = self.alive.insert(Alive { masters: masters.collect(), pump });
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

    /// The end of a scan rings.
    pub(crate) fn ring(&mut self, now: Instant) {
        let Some(alive) = &mut self.alive else { return };
        if alive.pump.look_at_scan(now) {
            for (line, field) in self.fields.iter_mut().enumerate() {
                field.tell(now, Input::Tick, &mut |input: MasterInput<'_>| alive.ask(line, now, input));
            }
        }
    }
}
