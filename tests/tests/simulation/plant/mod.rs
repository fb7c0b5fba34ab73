//! A station with three buses in virtual time. All tested parts are real: the CPU, the bus modules, their images, the
//! pumps and masters of the processes. The devices, wires and connections and the life cycle of the processes are
//! simulated.

pub(crate) mod bus;
// Only one of the tests with a plant uses this.
#[allow(dead_code)]
pub(crate) mod cp342;
pub(crate) mod device;
mod field;
mod judge;

use std::path::Path;

use ob1_cpu::{BusPlace, Command, Cpu, Module, ModuleSlot};
use ob1_fakes::dp_slave::SlaveConfig;
use ob1_host::bus::Station as OnBus;
use ob1_line::sim::{FaultRates, SplitMix64};
use ob1_station::{assembly, program};
use ob1_station_file::{self, ModuleKind, Station};
use ob1_tests::sim::clock::VirtualClock;
use ob1_tests::sim::{MS, SECOND};
use ob1_time::{Instant, Span};

use bus::SimulatedBus;
use device::{BYTES, Device};
use field::Field;
use judge::Judge;
pub(crate) use judge::Told;

/// Number for each bus: slaves, couplers on wires, couplers on connections.
const DEVICES: [usize; 3] = [3, 2, 2];
const COUNT: usize = DEVICES[0] + DEVICES[1] + DEVICES[2];
const DP_BAUD: u32 = 93_750;
const RTU_BAUD: u32 = 57_600;
/// Watchdog time of every device.
const WATCHDOG: Span = Span::from_millis(200);
/// Cycle time, selected by the seed.
const CYCLES: [Span; 2] = [Span::from_millis(40), Span::from_millis(10)];
/// A coupler is lost after this time without an answer; a slave earlier.
const LOST_AFTER: Span = Span::from_millis(400);
/// End of the faults; after it everything must recover without help.
const TROUBLE: Instant = Instant::from_secs(3);
const END: Instant = Instant::from_secs(6);

/// Time for the restart of a process.
const START: Span = Span::from_millis(100);

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

/// Position of the counters of OB 86 and OB 82 in DB 1.
const COUNTS: usize = 60;
/// DB 2 has eight bytes for each call of OB 86, starting with call 1: event, then station and bus.
const CALL: usize = 8;

/// OB 1 stores the inputs, and writes to every device its number and a rising counter.
fn program_text() -> String {
    let (mut read, mut drive) = (String::new(), String::new());
    for n in 0..COUNT {
        let at = BYTES * n;
        read += &format!("  L ED {at};\n  T DB1.DBD {at};\n");
        drive += &format!("  L MD 0;\n  L DW#16#{n:X}000000;\n  OD;\n  T AD {at};\n");
    }
    let counts = |ob: u8, at: usize, then: &str| {
        format!(
            "ORGANIZATION_BLOCK OB {ob}\nVAR_TEMP\n  info : ARRAY [0..19] OF BYTE;\nEND_VAR\nBEGIN\n  L DB1.DBW {at};\n\
             \x20 + 1;\n  T DB1.DBW {at};\n{then}END_ORGANIZATION_BLOCK\n"
        )
    };
    let keep = "  SLD 6;\n  LAR1;\n  AUF DB 2;\n  L LW 0;\n  T DBW [AR1, P#0.0];\n  L LD 8;\n  T DBD [AR1, P#2.0];\n";
    format!(
        "DATA_BLOCK DB 1\nSTRUCT\n  bytes : ARRAY [0..63] OF BYTE;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n\
         DATA_BLOCK DB 2\nSTRUCT\n  bytes : ARRAY [0..4095] OF BYTE;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n\
         ORGANIZATION_BLOCK OB 1\nBEGIN\n{read}  L MD 0;\n  +1;\n  T MD 0;\n{drive}END_ORGANIZATION_BLOCK\n{}{}",
        counts(86, COUNTS, keep),
        counts(82, COUNTS + 2, "")
    )
}

fn station(folder: &Path, cycle: Span) -> Station {
    std::fs::write(folder.join("four.gsd"), GSD).expect("writable");
    std::fs::write(folder.join("press.awl"), program_text()).expect("writable");
    let (ms, cycle) = (WATCHDOG / MS, cycle / MS);
    let mut text = format!(
        "[station]\nname = \"press\"\n[cpu]\nmin_cycle = \"{cycle}ms\"\n[program]\nsources = [\"press.awl\"]\n\
         [[simulated_line]]\nname = \"wires\"\nduplex = \"half\"\n[[simulated_line]]\nname = \"pair\"\nduplex = \"half\"\n\
         [[bus]]\nname = \"profi\"\ntype = \"dp\"\nline = \"sim:wires\"\nbaud = {DP_BAUD}\nhsa = 4\nwatchdog = \"{ms}ms\"\n\
         [[bus]]\nname = \"rtu\"\ntype = \"modbus-rtu\"\nline = \"sim:pair\"\nbaud = {RTU_BAUD}\ntimeout = \"50ms\"\n\
         [[bus]]\nname = \"net\"\ntype = \"modbus-tcp\"\ntimeout = \"50ms\"\n"
    );
    let mut n = 0;
    for (kind, count) in DEVICES.into_iter().enumerate() {
        for k in 0..count {
            let at = BYTES * n;
            text += &format!("[[module]]\ntype = \"coupler\"\nname = \"s{n}\"\non_loss = \"substitute\"\n");
            text += &match kind {
                0 => format!(
                    "bus = \"profi\"\nstation = {}\ngsd = \"four.gsd\"\nslots = [{{ slot = 1, module = \"4 in 4 out\", \
                     inputs = \"EB {at}\", outputs = \"AB {at}\", substitute = [238, 238, 238, 238] }}]\n",
                    k + 5
                ),
                _ => format!(
                    "{}\ninputs = [{{ at = \"EB {at}\", from = \"input:0\", registers = 2, substitute = [238, 238, 238, 238] \
                     }}]\noutputs = [{{ at = \"AB {at}\", to = \"holding:0\", registers = 2 }}]\nprofile = \"wago-750\"\n\
                     watchdog = \"{ms}ms\"\nlost_after = \"{}ms\"\nperiod = \"20ms\"\n",
                    match kind {
                        1 => format!("bus = \"rtu\"\nunit = {}", k + 1),
                        _ => format!("bus = \"net\"\nline = \"tcp:127.0.0.1:{}\"", 502 + k),
                    },
                    LOST_AFTER / MS
                ),
            };
            n += 1;
        }
    }
    ob1_station_file::parse(&text, "press.toml", folder).unwrap_or_else(|findings| panic!("{findings:#?}"))
}

struct World {
    now: Instant,
    rng: SplitMix64,
    cpu: Cpu,
    due: Instant,
    buses: Vec<SimulatedBus>,
    trouble: Instant,
    judge: Judge,
}

impl World {
    fn new(seed: u64, folder: &Path) -> Self {
        Self::with(seed, folder, true)
    }

    /// `noisy`: on bad wires.
    fn with(seed: u64, folder: &Path, noisy: bool) -> Self {
        let mut rng = SplitMix64::new(seed);
        // During a long cycle a slave can be lost, parametrised and exchange data again.
        let cycle = CYCLES[(seed % 2) as usize];
        let station = station(folder, cycle);
        let loaded = program::load(&station).unwrap_or_else(|failure| panic!("{failure:?}"));
        let mut fields = fields(&station, &mut rng, noisy);
        let places = station.buses.iter().flat_map(|bus| {
            let place = |at: &OnBus| [at.diagnostic.to_be_bytes(), [bus.rules.number, at.number]].concat();
            bus.stations.iter().map(move |at| u32::from_be_bytes(place(at).try_into().expect("four")))
        });
        let judge = Judge::new(seed, cycle, places.collect());
        let made = station.buses.iter().zip(fields.drain(..));
        let (buses, hosts): (Vec<_>, Vec<_>) =
            made.map(|(bus, fields)| SimulatedBus::new(bus, fields, Instant::from_millis(5))).unzip();
        let mut modules: Vec<(ModuleSlot, Box<dyn Module>)> = Vec::new();
        for config in &station.modules {
            let ModuleKind::Remote { bus, module } = &config.kind else { panic!("all are on a bus") };
            let of = &station.buses[*bus];
            let place =
                BusPlace { master: of.rules.number, station: of.stations[module.station].number, slot: module.slot };
            let slot = ModuleSlot { bus: Some(place), ..assembly::slot(config) };
            modules.push((slot, hosts[*bus].module(module.clone())));
        }
        let natives = loaded.native_blocks(&[]).unwrap_or_else(|failure| panic!("{failure:?}"));
        let mut cpu = Cpu::new(
            station.cpu.clone(),
            &loaded.program,
            natives,
            modules,
            ob1_station::engine::factory(station.engine),
        )
        .expect("a CPU");
        cpu.request(Command::Run);
        let trouble = Instant::from_millis(500) + rng.span_below(500 * MS);
        Self { now: Instant::START, rng, cpu, due: Instant::START, buses, trouble, judge }
    }

    fn devices(&mut self) -> Vec<&mut Device> {
        self.buses.iter_mut().flat_map(|bus| &mut bus.fields).flat_map(Field::devices).collect()
    }

    fn kill(&mut self, bus: usize, begins: Instant) {
        self.buses[bus].kill(self.now, begins);
        self.judge.killed(bus);
    }

    fn make_trouble(&mut self) {
        self.trouble =
            if self.now < TROUBLE { self.now + 30 * MS + self.rng.span_below(250 * MS) } else { Instant::NEVER };
        if self.now >= TROUBLE {
            return;
        }
        let now = self.now;
        let (what, n, time) = (self.rng.below(6), self.rng.below(COUNT as u64) as usize, self.rng.span_below(500 * MS));
        let bus = self.rng.below(DEVICES.len() as u64) as usize;
        match what {
            0 if self.buses[bus].is_alive() => self.kill(bus, now + 20 * MS + time),
            0 => {}
            1 => self.devices()[n].report(&[0x42, 0x01]),
            2 => self.devices()[n].report(&[]),
            3 => self.devices()[n].cut(now + time),
            // A coupler needs time to start; the restart of a slave is detected even if it is short.
            _ => {
                self.devices()[n].restart(now + if what == 4 && n < DEVICES[0] { Span::ZERO } else { 200 * MS + time });
            }
        }
    }

    fn run(&mut self, until: Instant) {
        while self.now < until {
            let buses = self.buses.iter().map(SimulatedBus::next).fold(Instant::NEVER, Instant::min);
            self.now = self.now.max(buses.min(self.due).min(self.trouble).min(until));
            for bus in &mut self.buses {
                bus.advance(self.now);
            }
            if self.now >= self.trouble {
                self.make_trouble();
            }
            if self.now >= self.due {
                let end = self.cpu.cycle(&mut VirtualClock(self.now));
                self.due = end.next_deadline.max(self.now + Span::from_nanos(1));
                for bus in &mut self.buses {
                    bus.ring(self.now);
                }
                let Self { judge, cpu, buses, .. } = self;
                let alive = [0, 1, 2].map(|bus: usize| buses[bus].is_alive());
                let devices = buses.iter_mut().flat_map(|bus| &mut bus.fields).flat_map(Field::devices);
                judge.look(self.now, cpu, end.state, devices);
                judge.alive(alive);
            }
        }
    }
}

/// The field of each bus of a station.
fn fields(station: &Station, rng: &mut SplitMix64, noisy: bool) -> Vec<Vec<Field>> {
    // Rate of character errors; the last part of a run, for the recovery, has the same rate.
    let rate = if noisy { [0, 50, 300, 1000][rng.below(4) as usize] } else { 0 };
    let readable = FaultRates { parity: rate, framing: rate / 2, lose: rate / 2, ..FaultRates::NONE };
    let damaged = FaultRates { flip: 3 * rate, double: rate, ..readable };
    let dp = station.buses[0].config.lines[0].dp.as_ref().expect("it is DP");
    let slave = |(n, slave): (usize, &ob1_coupler::dp::DpSlave)| {
        let config = SlaveConfig {
            baud: DP_BAUD,
            address: slave.station,
            ident: slave.ident,
            config: slave.config.clone(),
            parameters: Some(slave.parameters.clone()),
            inputs: BYTES,
            outputs: BYTES,
            delay_bits: 0,
        };
        Device::slave(n, config)
    };
    let slaves = dp.slaves.iter().enumerate().map(slave).collect();
    let coupler = |k: usize| Device::coupler(DEVICES[0] + k, (k + 1) as u8);
    let on_wires = (0..DEVICES[1]).map(coupler).collect();
    let connected = (0..DEVICES[2]).map(|k| {
        // On a separate connection the unit is FFh.
        Field::net(rng.next_u64(), Device::coupler(DEVICES[0] + DEVICES[1] + k, 255))
    });
    let connected = connected.collect();
    vec![
        vec![Field::wires(DP_BAUD, readable, rng.next_u64(), slaves)],
        vec![Field::wires(RTU_BAUD, damaged, rng.next_u64(), on_wires)],
        connected,
    ]
}

/// The only fault: all processes are killed at a time given by the seed. Returns the time until all devices have
/// returned.
pub(crate) fn killed(seed: u64, folder: &Path) -> Span {
    let mut world = World::with(seed, folder, false);
    let rest = |world: &mut World, until: Instant| {
        world.trouble = Instant::NEVER;
        world.run(until);
    };
    let killed = Instant::START + SECOND + world.rng.span_below(100 * MS);
    rest(&mut world, killed);
    (0..DEVICES.len()).for_each(|bus| world.kill(bus, killed + START));
    while !world.judge.all_are_back() || world.now < killed + START {
        let until = world.now + 10 * MS;
        assert!(until < END, "seed {seed}: they do not come back");
        rest(&mut world, until);
    }
    world.now - killed
}

/// Runs a seed.
pub(crate) fn run(seed: u64, folder: &Path) -> Told {
    let mut world = World::new(seed, folder);
    world.run(END);
    let kills = world.buses.iter().map(|bus| bus.kills).sum();
    let World { mut judge, mut buses, .. } = world;
    judge.end(kills, buses.iter_mut().flat_map(|bus| &mut bus.fields).flat_map(Field::devices))
}
