//! A whole station with an Ethernet CP: station file, compiler, CPU, plugin, back plane, broker.

use std::path::Path;
use std::time::Instant;

use ob1_backplane::{CpuSide, Segment};
use ob1_broker::{Broker, feed};
use ob1_cpu::{Command, Cpu, Module, Nanos, OperatingState};
use ob1_host::module::CpModule;
use ob1_station::{assembly, program, station_file};
use ob1_tests::sim::clock::VirtualClock;
use ob1_tests::sim::facts::Bare;
use ob1_tests::sim::life::Life;

use super::process::Process;
use super::program as text;

pub(crate) struct Station {
    pub(crate) cpu: Cpu,
    pub(crate) broker: Broker,
    pub(crate) process: Process,
    pub(crate) due: Nanos,
}

impl Station {
    pub(crate) fn new(me: usize, folder: &Path, seed: u64, base: Instant) -> Self {
        let file = text::file(me);
        let station = station_file::parse(&file, "coupled.toml", folder).unwrap_or_else(|f| panic!("{f:#?}\n{file}"));
        std::fs::write(folder.join(format!("{}.awl", station.name)), text::source(me)).expect("room for a file");
        let needs = "this test needs the plugins that `cargo xtask test` builds; run: cargo xtask test";
        let loaded = program::load(&station).unwrap_or_else(|failure| panic!("{:#?}\n{needs}", failure.findings()));
        let config = &station.modules[0];
        let settings = assembly::cp_settings(&station.name, config, None).expect("a CP");
        let segment = Segment::heap_with_boxes();
        let mut side = CpuSide::create(&segment, usize::from(config.input_bytes())).expect("a segment");
        side.write_params(&settings.parameters, &settings.json).expect("it fits");
        let (life, driver) = Life::new(side.monitor().clone(), seed);
        let module: Box<dyn Module> = Box::new(CpModule::new(side, Box::new(driver), settings).expect("it fits"));
        let natives = loaded.native_blocks(&assembly::plugin_modules(&station)).expect("blocks");
        let modules = vec![(assembly::slot(config), module)];
        let mut cpu = Cpu::new(station.cpu.clone(), &loaded.program, natives, modules, station.engine.factory())
            .unwrap_or_else(|errors| panic!("{errors:?}"));
        let link = &station.links[0];
        let links = vec![assembly::link_config(link, link.config.clone(), Vec::new())];
        let broker = Broker::new(&mut cpu, links, feed().1, Box::new(Bare)).expect("a broker");
        cpu.request(Command::Run);
        Self { cpu, broker, process: Process::new(me, segment, life, base), due: 0 }
    }

    /// One cycle.
    pub(crate) fn cycle(&mut self, now: Nanos) {
        let end = self.cpu.cycle(&mut VirtualClock(now));
        self.due = end.next_deadline.max(now + 1);
        self.broker.step(now);
        self.process.listen(now);
    }

    pub(crate) fn runs(&self) -> bool {
        self.cpu.state() == OperatingState::Run
    }

    /// A double word of a data block.
    pub(crate) fn cell(&self, db: u16, byte: usize) -> u32 {
        let bytes = self.cpu.data_block(db).and_then(|bytes| bytes.get(byte..)?.first_chunk());
        u32::from_be_bytes(*bytes.unwrap_or_else(|| panic!("DB{db}.DBD {byte}")))
    }

    /// A word of a data block.
    pub(crate) fn word(&self, db: u16, byte: usize) -> u16 {
        (self.cell(db, byte) >> 16) as u16
    }
}
