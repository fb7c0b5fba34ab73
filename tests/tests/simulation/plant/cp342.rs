//! A PROFIBUS on a CP 342-5, in virtual time: handling blocks of the plugin, the module, the master, slaves.

use std::path::Path;

use ob1_cpu::{Cell, Command, Cpu, Module, ModuleSlot, Width};
use ob1_fakes::dp_slave::SlaveConfig;
use ob1_line::sim::FaultRates;
use ob1_station::{assembly, program};
use ob1_station_file::{self, ModuleKind, Station};
use ob1_tests::sim::MS;
use ob1_tests::sim::clock::VirtualClock;
use ob1_time::{Instant, Span};

use super::bus::SimulatedBus;
use super::device::{BYTES, Device};
use super::field::Field;
use super::{DP_BAUD, GSD};

/// Addresses of the slaves.
pub(crate) const STATIONS: [u8; 2] = [5, 6];

/// A call in the program, with the names of its two flags for success and error.
pub(crate) struct Call {
    pub(crate) block: &'static str,
    pub(crate) flag: &'static str,
    /// Its inputs, and its outputs except the flags and STATUS.
    pub(crate) parameters: String,
}

/// The result of a call: done or new data, error, STATUS.
pub(crate) type End = (bool, bool, u16);

/// OB 1 with these calls one after the other, each with four bytes in DB 2. They use DB 1 and DB 3.
fn program_text(calls: &[Call]) -> String {
    let blocks: String = (1..=3)
        .map(|n| {
            format!("DATA_BLOCK DB {n}\nSTRUCT\n  bytes : ARRAY [0..399] OF BYTE;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n")
        })
        .collect();
    let calls = calls.iter().enumerate().map(|(n, Call { block, flag, parameters })| {
        let at = 4 * n;
        format!(
            "  CALL {block} (\n    {parameters},\n    {flag} := DB2.DBX {at}.0,\n    ERROR := DB2.DBX {at}.1,\n    \
             STATUS := DB2.DBW {});\n",
            at + 2
        )
    });
    format!("{blocks}ORGANIZATION_BLOCK OB 1\nBEGIN\n{}END_ORGANIZATION_BLOCK\n", calls.collect::<String>())
}

fn station(folder: &Path, calls: &[Call]) -> Station {
    std::fs::write(folder.join("four.gsd"), GSD).expect("writable");
    std::fs::write(folder.join("press.awl"), program_text(calls)).expect("writable");
    let mut text = format!(
        "[station]\nname = \"press\"\n[cpu]\nmin_cycle = \"10ms\"\n[program]\nsources = [\"press.awl\"]\n\
         mnemonics = \"de\"\n[[plugin]]\npath = \"ob1_cp342\"\n[[simulated_line]]\nname = \"wires\"\nduplex = \"half\"\n\
         [[bus]]\nname = \"profi\"\ntype = \"dp\"\nline = \"sim:wires\"\nbaud = {DP_BAUD}\nhsa = 4\nwatchdog = \"200ms\"\n"
    );
    for (n, station) in STATIONS.into_iter().enumerate() {
        // In the areas of the CP the second slave is first.
        let at = BYTES * (1 - n);
        text += &format!(
            "[[module]]\ntype = \"coupler\"\nname = \"s{n}\"\nbus = \"profi\"\nstation = {station}\ngsd = \"four.gsd\"\n\
             slots = [{{ slot = 1, module = \"4 in 4 out\", inputs = \"EB {at}\", outputs = \"AB {at}\" }}]\n"
        );
    }
    text += "[[module]]\ntype = \"cp342-5\"\nname = \"cp\"\nbus = \"profi\"\naddress = 256\n";
    ob1_station_file::parse(&text, "press.toml", folder).unwrap_or_else(|findings| panic!("{findings:#?}"))
}

pub(crate) struct Plant {
    now: Instant,
    due: Instant,
    pub(crate) cpu: Cpu,
    pub(crate) bus: SimulatedBus,
}

impl Plant {
    pub(crate) fn new(folder: &Path, calls: &[Call]) -> Self {
        let station = station(folder, calls);
        let loaded = program::load(&station).unwrap_or_else(|failure| panic!("{failure:?}"));
        let dp = station.buses[0].config.lines[0].dp.as_ref().expect("it is DP");
        let slaves = dp.slaves.iter().enumerate().map(|(n, slave)| {
            let (config, parameters) = (slave.config.clone(), Some(slave.parameters.clone()));
            let (address, ident) = (slave.station, slave.ident);
            let config = SlaveConfig {
                baud: DP_BAUD,
                address,
                ident,
                config,
                parameters,
                inputs: BYTES,
                outputs: BYTES,
                delay_bits: 0,
            };
            Device::slave(n, config)
        });
        let field = Field::wires(DP_BAUD, FaultRates::NONE, 1, slaves.collect());
        let (bus, host) = SimulatedBus::new(&station.buses[0], vec![field], Instant::from_millis(5));
        let modules: Vec<(ModuleSlot, Box<dyn Module>)> = station
            .modules
            .iter()
            .map(|config| {
                let ModuleKind::DpMaster { areas, .. } = &config.kind else { panic!("{} has no place", config.name) };
                (assembly::slot(config), host.cp(areas.clone()))
            })
            .collect();
        assert_eq!(modules.len(), 1, "the slaves are behind the CP");
        let natives = loaded.native_blocks(&assembly::plugin_modules(&station));
        let natives = natives.unwrap_or_else(|failure| panic!("{failure:?}"));
        let mut cpu = Cpu::new(
            station.cpu.clone(),
            &loaded.program,
            natives,
            modules,
            ob1_station::engine::factory(station.engine),
        )
        .expect("a CPU");
        cpu.request(Command::Run);
        Self { now: Instant::START, due: Instant::START, cpu, bus }
    }

    pub(crate) fn now(&self) -> Instant {
        self.now
    }

    pub(crate) fn device(&mut self, n: usize) -> &mut Device {
        self.bus.fields[0].devices().into_iter().nth(n).expect("there is such a slave")
    }

    /// Runs one scan.
    pub(crate) fn scan(&mut self) {
        loop {
            self.now = self.bus.next().min(self.due).max(self.now);
            self.bus.advance(self.now);
            if self.now >= self.due {
                let end = self.cpu.cycle(&mut VirtualClock(self.now));
                self.due = end.next_deadline.max(self.now + Span::from_nanos(1));
                self.bus.ring(self.now);
                return;
            }
        }
    }

    pub(crate) fn run(&mut self, time: Span) {
        let until = self.now + time;
        while self.now < until {
            self.scan();
        }
    }

    /// Runs scans until the condition is true.
    pub(crate) fn until(&mut self, what: &str, is_so: impl Fn(&Self) -> bool) {
        let until = self.now + 3000 * MS;
        while !is_so(self) {
            assert!(self.now < until, "{what}: {:?}", self.entries());
            self.scan();
        }
    }

    pub(crate) fn bytes(&self, db: u16, at: usize, len: usize) -> &[u8] {
        &self.cpu.data_block(db).expect("it is there")[at..at + len]
    }

    pub(crate) fn end(&self, call: usize) -> End {
        let bytes = self.bytes(2, 4 * call, 4);
        (bytes[0] & 1 != 0, bytes[0] & 2 != 0, u16::from_be_bytes([bytes[2], bytes[3]]))
    }

    /// Sets bytes of DB 3.
    pub(crate) fn set(&mut self, at: u32, bytes: &[u8]) {
        for (at, byte) in (at..).zip(bytes) {
            self.cpu.write(Cell::Db(3, 8 * at), Width::Byte, u32::from(*byte)).expect("DB 3");
        }
    }

    pub(crate) fn entries(&self) -> Vec<String> {
        let mut all: Vec<String> =
            self.cpu.diagnostics().map(|entry| format!("{:04X} {}", entry.event.0, entry.text.as_str())).collect();
        all.reverse();
        all
    }
}
