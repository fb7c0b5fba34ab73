//! A station on PROFIBUS in virtual time: the real CPU, bus modules, images, master and stack; slaves and wires are
//! simulated, and so is the life of the process of the bus. A hundred seeds with characters that cannot be read, slaves
//! that lose their power for a moment or longer and report faults, and a process that is killed.
//!
//! For each scan: an input is what its slave has sensed, or the substitute; from the scan in which OB 86 says that the
//! slave is lost, to that in which it says that it is back, it is the substitute. OB 86 runs once for each of these.
//! Outputs are off when a master has been gone for as long as the watchdog says.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};

use ob1_backplane::{BusMemory, BusSize, CpSide, CpuSide, Segment};
use ob1_coupler::{BusConfig, Input, LineFault, LineInput, MasterInput};
use ob1_cpu::{BusPlace, Command, Cpu, Module, ModuleSlot, Nanos, OperatingState};
use ob1_dp::Slave;
use ob1_dp::slave::SlaveConfig;
use ob1_host::bus::Bus;
use ob1_host::module::{DriverLink, Life};
use ob1_host::supervisor::{Exit, Report};
use ob1_io::{Master, Pump};
use ob1_line::sim::{BusConfig as WiresConfig, BusEvent, FaultRates, Frame, Participant, SimBus, SplitMix64};
use ob1_line::{LineSettings, Parity};
use ob1_model::Event;
use ob1_station::station_file::{self, ModuleKind, Station};
use ob1_station::{assembly, program};
use ob1_tests::sim::clock::VirtualClock;
use ob1_tests::sim::{MS, SECOND};

const SLAVES: usize = 3;
const BAUD: u32 = 93_750;
const WATCHDOG: Nanos = 200 * MS;
const SUBSTITUTE: [u8; 4] = [0xEE; 4];
/// Something goes wrong until here; then everything must come back by itself.
const TROUBLE: Nanos = 3 * SECOND;
const END: Nanos = 5 * SECOND;

const PROGRAM: &str = "
DATA_BLOCK DB 1
STRUCT
  bytes : ARRAY [0..63] OF BYTE;
END_STRUCT
BEGIN
END_DATA_BLOCK
ORGANIZATION_BLOCK OB 1
BEGIN
  L ED 0;
  T DB1.DBD 0;
  L ED 4;
  T DB1.DBD 4;
  L ED 8;
  T DB1.DBD 8;
  L MD 0;
  +1;
  T MD 0;
  T AD 0;
  T AD 4;
  T AD 8;
END_ORGANIZATION_BLOCK
ORGANIZATION_BLOCK OB 86
BEGIN
  L DB1.DBW 20;
  + 1;
  T DB1.DBW 20;
END_ORGANIZATION_BLOCK
ORGANIZATION_BLOCK OB 82
BEGIN
  L DB1.DBW 22;
  + 1;
  T DB1.DBW 22;
END_ORGANIZATION_BLOCK
";

/// Four bytes in, four bytes out, compact.
const GSD: &str = "#Profibus_DP
GSD_Revision = 1
Vendor_Name = \"ob1\"
Model_Name = \"Four\"
Ident_Number = 0x7F04
93.75_supp = 1
MaxTsdr_93.75 = 60
Modular_Station = 0
Max_Diag_Data_Len = 16
Max_Input_Len = 4
Max_Output_Len = 4
User_Prm_Data_Len = 1
User_Prm_Data = 0x01
Module = \"4 in 4 out\" 0x33
EndModule
";

fn station(folder: &Path) -> Station {
    std::fs::write(folder.join("four.gsd"), GSD).expect("writable");
    std::fs::write(folder.join("press.awl"), PROGRAM).expect("writable");
    let mut text = format!(
        "[station]\nname = \"press\"\n[cpu]\nmin_cycle = \"10ms\"\n[program]\nsources = [\"press.awl\"]\n\
         [[simulated_line]]\nname = \"wires\"\nduplex = \"half\"\n\
         [[bus]]\nname = \"profi\"\ntype = \"dp\"\nline = \"sim:wires\"\nbaud = {BAUD}\nhsa = 4\nwatchdog = \"{}ms\"\n",
        WATCHDOG / MS
    );
    for n in 0..SLAVES {
        text += &format!(
            "[[module]]\ntype = \"coupler\"\nbus = \"profi\"\nname = \"s{n}\"\nstation = {}\ngsd = \"four.gsd\"\n\
             on_loss = \"substitute\"\nslots = [{{ slot = 1, module = \"4 in 4 out\", inputs = \"EB {}\", outputs = \"AB {}\", \
             substitute = [238, 238, 238, 238] }}]\n",
            n + 5,
            4 * n,
            4 * n
        );
    }
    station_file::parse(&text, "press.toml", folder).unwrap_or_else(|findings| panic!("{findings:#?}"))
}

/// What slave `n` senses when it has been exchanged with so often.
fn sensed(n: usize, exchanges: u64) -> [u8; 4] {
    let k = exchanges as u8;
    [k, n as u8, k ^ 0xA5, !k]
}

fn is_sensed(n: usize, bytes: &[u8]) -> bool {
    bytes == sensed(n, u64::from(bytes[0]))
}

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
    master: Master,
    deadline: Nanos,
}

struct OnLine {
    slave: Slave,
    who: Participant,
    deadline: Nanos,
    off_until: Nanos,
    config: SlaveConfig,
    exchanges: u64,
}

struct World {
    now: Nanos,
    seed: u64,
    rng: SplitMix64,
    cpu: Cpu,
    due: Nanos,
    logged: u64,
    process: Arc<Process>,
    segment: Segment,
    memory: BusMemory,
    size: BusSize,
    config: BusConfig,
    alive: Option<Alive>,
    /// When the process was killed, and when the next one begins.
    killed: Nanos,
    begins: Nanos,
    trouble: Nanos,
    wires: SimBus,
    me: Participant,
    slaves: Vec<OnLine>,
    seen: [bool; SLAVES],
    lost: [bool; SLAVES],
    /// Entries for which OB 86 and OB 82 are to have run.
    told: [u16; 2],
    kills: u32,
}

impl World {
    fn new(seed: u64, folder: &Path) -> Self {
        let mut rng = SplitMix64::new(seed);
        let station = station(folder);
        let loaded = program::load(&station).unwrap_or_else(|failure| panic!("{:?}", failure.findings()));
        let (segment, memory) = (Segment::heap(), BusMemory::heap());
        let side = CpuSide::create(&segment, 8).expect("a segment");
        let bus = &station.buses[0];
        let (inputs, outputs) = (bus.config.input_bytes, bus.config.output_bytes);
        let size = BusSize::new(bus.stations.len(), inputs, outputs).expect("it fits");
        let process = Arc::new(Process::default());
        let link = Box::new(Link(Arc::clone(&process)));
        let host = Bus::new(side, link, &memory, size, outputs, bus.stations.clone(), bus.rules);
        let mut modules: Vec<(ModuleSlot, Box<dyn Module>)> = Vec::new();
        for config in &station.modules {
            let ModuleKind::Remote { module, .. } = &config.kind else { panic!("all are on the bus") };
            let station = bus.stations[module.station].number;
            let place = BusPlace { master: bus.rules.number, station, slot: module.slot };
            modules.push((ModuleSlot { bus: Some(place), ..assembly::slot(config) }, host.module(module.clone())));
        }
        let natives = loaded.native_blocks(&[]).unwrap_or_else(|failure| panic!("{:?}", failure.findings()));
        let mut cpu =
            Cpu::new(station.cpu.clone(), &loaded.program, natives, modules, station.engine.factory()).expect("a CPU");
        cpu.request(Command::Run);
        let settings = LineSettings { baud: BAUD, parity: Parity::Even, ..LineSettings::default() };
        // What goes wrong with the characters; the last part of a run is for coming back, with as many.
        let rate = [0, 50, 300, 1000][rng.below(4) as usize];
        let faults = FaultRates { parity: rate, framing: rate / 2, lose: rate / 2, ..FaultRates::NONE };
        let mut wires = SimBus::new(WiresConfig { faults, ..WiresConfig::new(true) }, rng.next_u64());
        let me = wires.join(Frame::of(&settings));
        let dp = bus.config.lines[0].dp.as_ref().expect("it is DP");
        let slaves = dp.slaves.iter().enumerate().map(|(n, slave)| {
            let config = SlaveConfig {
                baud: BAUD,
                address: slave.station,
                ident: slave.ident,
                config: slave.config.clone(),
                parameters: Some(slave.parameters.clone()),
                inputs: 4,
                outputs: 4,
                delay_bits: 0,
            };
            let mut one = Slave::new(config.clone());
            one.inputs = sensed(n, 0).to_vec();
            let who = wires.join(Frame::of(&settings));
            OnLine { slave: one, who, deadline: Nanos::MAX, off_until: 0, config, exchanges: 0 }
        });
        let slaves = slaves.collect();
        let trouble = 500 * MS + rng.below(500 * MS);
        Self {
            now: 0,
            seed,
            rng,
            cpu,
            due: 0,
            logged: 0,
            process,
            segment,
            memory,
            size,
            config: bus.config.clone(),
            alive: None,
            killed: 0,
            begins: 5 * MS,
            trouble,
            wires,
            me,
            slaves,
            seen: [false; SLAVES],
            lost: [false; SLAVES],
            told: [0; 2],
            kills: 0,
        }
    }

    fn begin(&mut self) {
        self.begins = Nanos::MAX;
        let attempts = self.process.attempts.fetch_add(1, Ordering::Relaxed) + 1;
        let segment = CpSide::attach(&self.segment).expect("a segment");
        let pump = Pump::new(&self.config, segment, &self.memory, self.size, self.now);
        let master = Master::new(&self.config.lines[0], 0, self.config.input_bytes, self.now).expect("bus parameters");
        self.alive = Some(Alive { pump, master, deadline: 0 });
        self.process.running.store(true, Ordering::Relaxed);
        self.process.reports.lock().expect("not poisoned").push_back(Report::Up(attempts));
        self.ask(Input::Line(LineInput::Fault(LineFault::Back)));
    }

    fn kill(&mut self) {
        self.alive = None;
        self.kills += 1;
        (self.killed, self.begins) = (self.now, self.now + 20 * MS + self.rng.below(400 * MS));
        self.wires.take_back(self.me, self.now);
        self.process.running.store(false, Ordering::Relaxed);
        self.process.reports.lock().expect("not poisoned").push_back(Report::Lost(Exit::Signal(9)));
    }

    fn ask(&mut self, input: MasterInput<'_>) {
        let Some(alive) = &mut self.alive else { return };
        let mut out = Vec::new();
        alive.deadline = alive.master.step(self.now, input, &mut alive.pump.image, &mut out);
        alive.pump.show(self.now);
        self.wires.write(self.me, self.now, &out);
    }

    fn tell(&mut self, n: usize, input: MasterInput<'_>) {
        let on = &mut self.slaves[n];
        if self.now < on.off_until {
            on.deadline = Nanos::MAX;
            return;
        }
        let mut out = Vec::new();
        on.deadline = on.slave.step(self.now, input, &mut out);
        if on.slave.exchanges() != on.exchanges {
            on.exchanges = on.slave.exchanges();
            on.slave.inputs = sensed(n, on.exchanges).to_vec();
        }
        let who = on.who;
        self.wires.write(who, self.now, &out);
    }

    fn make_trouble(&mut self) {
        self.trouble = if self.now < TROUBLE { self.now + 50 * MS + self.rng.below(400 * MS) } else { Nanos::MAX };
        if self.now >= TROUBLE {
            return;
        }
        let n = self.rng.below(SLAVES as u64) as usize;
        match self.rng.below(5) {
            0 if self.alive.is_some() => self.kill(),
            1 => self.slaves[n].slave.report(&[0x42, 0x01]),
            2 => self.slaves[n].slave.report(&[]),
            what => {
                // Another slave, as after power on; a moment, or longer.
                let on = &mut self.slaves[n];
                on.slave = Slave::new(on.config.clone());
                (on.exchanges, on.slave.inputs) = (0, sensed(n, 0).to_vec());
                on.off_until = if what == 3 { self.now } else { self.now + MS + self.rng.below(300 * MS) };
                on.deadline = Nanos::MAX;
            }
        }
    }

    fn run(&mut self) {
        let mut buffer = [0; 256];
        while self.now < END {
            let process = self.alive.as_ref().map(|alive| alive.deadline.min(alive.pump.deadline()));
            let slaves = self.slaves.iter().map(|on| on.deadline);
            let times = slaves.chain(process).chain(self.wires.next_event());
            let next = times.chain([self.due, self.begins, self.trouble]).min().unwrap_or(END);
            self.now = self.now.max(next);
            while let Some((who, event)) = self.wires.pop(self.now, &mut buffer) {
                let input = match event {
                    BusEvent::Rx(len) => LineInput::Rx(&buffer[..len]),
                    BusEvent::Fault(fault) => LineInput::Fault(fault),
                    BusEvent::TxDone => LineInput::TxDone,
                    BusEvent::Modem(_) => continue,
                };
                if who == self.me {
                    self.ask(Input::Line(input));
                } else if let Some(n) = self.slaves.iter().position(|on| on.who == who) {
                    self.tell(n, Input::Line(input));
                }
            }
            if self.alive.as_ref().is_some_and(|alive| self.now >= alive.deadline.min(alive.pump.deadline())) {
                self.ask(Input::Tick);
            }
            for n in 0..SLAVES {
                if self.now >= self.slaves[n].deadline {
                    self.tell(n, Input::Tick);
                }
            }
            if self.now >= self.begins {
                self.begin();
            }
            if self.now >= self.trouble {
                self.make_trouble();
            }
            if self.alive.is_none() && self.now > self.killed + WATCHDOG + 5 * MS {
                let on = self.slaves.iter().position(|on| on.slave.outputs != [0; 4]);
                assert_eq!(
                    on,
                    None,
                    "seed {}: outputs of a slave are on {} ms after the kill",
                    self.seed,
                    (self.now - self.killed) / MS
                );
            }
            if self.now >= self.due {
                self.scan();
            }
        }
    }

    fn scan(&mut self) {
        let seed = self.seed;
        let end = self.cpu.cycle(&mut VirtualClock(self.now));
        self.due = end.next_deadline.max(self.now + 1);
        if let Some(alive) = &mut self.alive
            && alive.pump.look_at_scan(self.now)
        {
            self.ask(Input::Tick);
        }
        let new = self.cpu.diagnostics().take_while(|entry| entry.number > self.logged).count();
        let entries: Vec<(u64, Event, String)> = self
            .cpu
            .diagnostics()
            .take(new)
            .map(|entry| (entry.number, entry.event, entry.text.as_str().to_owned()))
            .collect();
        for (number, event, text) in entries.into_iter().rev() {
            self.logged = number;
            let at = format!("seed {seed}, {} ms, {text}", self.now / MS);
            let slave = (0..SLAVES).find(|n| text.starts_with(&format!("s{n}")));
            match event {
                Event::BUS_FAILED => {
                    self.told[0] += 1;
                    for n in 0..SLAVES {
                        self.lost[n] |= self.seen[n];
                    }
                }
                Event::STATION_FAILED => {
                    self.told[0] += 1;
                    let n = slave.expect("of a slave");
                    assert!(!std::mem::replace(&mut self.lost[n], true), "{at}: lost twice");
                    self.seen[n] = true;
                }
                Event::STATION_BACK => {
                    self.told[0] += 1;
                    let n = slave.expect("of a slave");
                    assert!(std::mem::replace(&mut self.lost[n], false), "{at}: back, and was not lost");
                }
                Event::STATION_FAULT | Event::STATION_FAULT_GONE => self.told[1] += 1,
                Event::STATION_REFUSES => panic!("{at}: refuses"),
                _ => {}
            }
        }
        let runs = end.state == OperatingState::Run || self.now < 50 * MS;
        assert!(runs, "seed {seed}, {} ms: {:?}", self.now / MS, end.state);
        let Some(db) = self.cpu.data_block(1) else { panic!("DB 1") };
        for n in 0..SLAVES {
            let bytes = &db[4 * n..4 * n + 4];
            if !self.seen[n] && is_sensed(n, bytes) {
                self.seen[n] = true;
            }
            let fits = if self.lost[n] || !self.seen[n] { bytes == SUBSTITUTE } else { is_sensed(n, bytes) };
            let (lost, ms) = (self.lost[n], self.now / MS);
            assert!(fits, "seed {seed}, {ms} ms: slave {n} reads {bytes:02X?}, lost: {lost}");
        }
        let ran = [20, 22].map(|at| u16::from_be_bytes([db[at], db[at + 1]]));
        assert_eq!(ran, self.told, "seed {seed}, {} ms: OB 86 and OB 82", self.now / MS);
    }
}

/// What a seed comes to: kills, events for OB 86 and OB 82.
fn run(seed: u64, folder: &Path) -> (u32, [u16; 2]) {
    let mut world = World::new(seed, folder);
    world.run();
    assert_eq!(world.lost, [false; SLAVES], "seed {seed}: not all have come back");
    assert!(world.seen.iter().all(|seen| *seen), "seed {seed}");
    let outputs: Vec<&[u8]> = world.slaves.iter().map(|on| &on.slave.outputs[..]).collect();
    assert!(outputs.iter().all(|outputs| **outputs != [0; 4]), "seed {seed}: {outputs:?}");
    (world.kills, world.told)
}

#[test]
fn a_hundred_seeds_of_a_bus_in_trouble() {
    let seeds = std::env::var("OB1_SEEDS").map_or(100, |text| text.parse().expect("a number"));
    let folder = tempfile::tempdir().expect("a folder");
    let mut all = (0, [0_u32; 2]);
    for seed in 1..=seeds {
        let (kills, told) = run(seed, folder.path());
        all.0 += kills;
        all.1[0] += u32::from(told[0]);
        all.1[1] += u32::from(told[1]);
    }
    println!("{seeds} seeds: {} kills, OB 86 {} times, OB 82 {} times", all.0, all.1[0], all.1[1]);
    assert!(all.0 > 50 && all.1[0] > 300 && all.1[1] > 50, "nothing went wrong: {all:?}");
}
