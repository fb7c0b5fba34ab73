//! A whole station with an Ethernet CP: station file, compiler, CPU, plugin, back plane, broker.

use std::path::Path;
use std::time;

use ob1_backplane::{CpuSide, Segment};
use ob1_broker::{Broker, feed};
use ob1_cpu::{Command, Cpu, Module, OperatingState};
use ob1_host::module::CpModule;
use ob1_station::{assembly, program};
use ob1_tests::sim::clock::{LongScan, VirtualClock};
use ob1_tests::sim::facts::Bare;
use ob1_tests::sim::life::Life;
use ob1_time::{Instant, Span};

use super::net::Net;
use super::process::Process;
use super::program as text;

pub(crate) struct Station {
    pub(crate) cpu: Cpu,
    pub(crate) broker: Broker,
    pub(crate) process: Process,
    pub(crate) due: Instant,
}

impl Station {
    pub(crate) fn new(me: usize, folder: &Path, seed: u64, base: time::Instant, late: Span) -> Self {
        let file = text::file(me);
        let station =
            ob1_station_file::parse(&file, "coupled.toml", folder).unwrap_or_else(|f| panic!("{f:#?}\n{file}"));
        std::fs::write(folder.join(format!("{}.awl", station.name)), text::source(me)).expect("room for a file");
        let needs = "this test needs the plugins that `cargo xtask test` builds; run: cargo xtask test";
        let loaded = program::load(&station).unwrap_or_else(|failure| panic!("{failure:#?}\n{needs}"));
        let config = &station.modules[0];
        let settings = assembly::cp_settings(&station.name, config, None).expect("a CP");
        let segment = Segment::heap_with_boxes();
        let mut side = CpuSide::create(&segment, usize::from(config.input_bytes())).expect("a segment");
        side.write_params(&settings.parameters, &settings.json).expect("it fits");
        let (life, driver) = Life::new(side.monitor().clone(), seed);
        let module: Box<dyn Module> = Box::new(CpModule::new(side, Box::new(driver), settings).expect("it fits"));
        let natives = loaded.native_blocks(&assembly::plugin_modules(&station)).expect("blocks");
        let modules = vec![(assembly::slot(config), module)];
        let mut cpu = Cpu::new(
            station.cpu.clone(),
            &loaded.program,
            natives,
            modules,
            ob1_station::engine::factory(station.engine),
        )
        .unwrap_or_else(|errors| panic!("{errors:?}"));
        let link = &station.links[0];
        let links = vec![assembly::link_config(link, &link.settings, Vec::new())];
        let broker = Broker::new(&mut cpu, links, feed().1, Box::new(Bare)).expect("a broker");
        cpu.request(Command::Run);
        Self { cpu, broker, process: Process::new(me, segment, life, base, late), due: Instant::START }
    }

    /// One cycle, in which `call` passes before and after each call of a handling block; returns its end.
    pub(crate) fn cycle(&mut self, now: Instant, call: Span, net: &mut Net) -> Instant {
        let meanwhile = |mut from: Instant, until: Instant| {
            if from == until {
                return;
            }
            loop {
                let next = self.process.next(from, net);
                if next > until {
                    break;
                }
                from = from.max(next);
                self.process.advance(from, &mut self.broker, net);
            }
        };
        let mut scan = LongScan { clock: VirtualClock(now), call, meanwhile };
        let end = self.cpu.cycle(&mut scan);
        let now = if call.is_zero() { now } else { scan.clock.0 };
        self.due = end.next_deadline.max(now + Span::from_nanos(1));
        self.broker.step(now);
        self.process.listen(now);
        now
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
