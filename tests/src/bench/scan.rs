//! The time of an idle scan, and the additional time of idle handling blocks.

use std::sync::Arc;
use std::time::Duration;

use ob1_backplane::{CpSide, CpuSide, Segment};
use ob1_cpu::{AccountsConfig, Clock, Command, Cpu, CpuConfig, Module, ModuleSlot, ScanRecord, Sums};
use ob1_host::module::{AlwaysThere, CpModule, CpSettings};
use ob1_host::plugin::Plugin;
use ob1_rt::ThreadLook;
use ob1_station::timing::LateSender;
use ob1_stl::{Library, Options, Source};
use ob1_time::{Instant, Span};

use super::peer::Failure;
use super::{Figure, in_turns, time_per_call};

const ROUNDS: usize = 21;
const ROUND: Duration = Duration::from_millis(40);
/// FC 0 + FC 1 pairs in one OB 1: the time of a pair is the difference to an empty OB 1, divided by this.
const PAIRS: usize = 50;

/// One `FC 0` and one `FC 1`, called as in the manual, with nothing to do.
const PAIR: &str = "
CALL FC 1 (ADR := 256, _DB := DB11, ABD := W#16#14, ANZ := MW10, EMFR := M1.0, PAFE := MB12, GEEM := MW100,
  ANZ_INT := MW102, empf_laeuft := M1.1, letzter_block := M1.2, fehl_empf := M1.3);
CALL FC 0 (ADR := 256, _DB := DB10, ABD := W#16#14, ANZ := MW14, FRG := M2.0, PAFE := MB16, GESE := MW104,
  ANZ_INT := MW106, ende_kom := M2.1, letzter_block := M2.2, senden_laeuft := M2.3, fehler_kom := M2.4);
";

/// The time of an empty scan, compared with the two clock readings that every scan needs.
///
/// # Errors
/// If the CPU cannot be built.
pub fn empty() -> Result<Figure, Failure> {
    let mut cpu = Station::build("", None)?;
    let mut clock = ob1_rt::MonotonicClock::start();
    let (scan, clocks) = in_turns(
        ROUNDS,
        || Ok(time_per_call(ROUND, || cpu.cycle())),
        || {
            Ok(time_per_call(ROUND, || {
                std::hint::black_box((clock.now(), clock.now()));
            }))
        },
    )?;
    Ok(Figure {
        what: "empty scan".into(),
        value: scan,
        unit: "ns",
        floor: Some(("two readings of the clock", clocks)),
        aim: ("<= 1000 ns", scan <= 1000.0),
    })
}

/// The additional time of the accounts in an empty scan: with and without them.
///
/// # Errors
/// If the CPU cannot be built.
pub fn accounts() -> Result<Figure, Failure> {
    let mut with = Station::build("", None)?;
    let mut without = Station::build_with("", None, AccountsConfig { off: true, ..AccountsConfig::default() })?;
    let (with, without) = in_turns(
        ROUNDS,
        || Ok(time_per_call(ROUND, || with.cycle())),
        || Ok(time_per_call(ROUND, || without.cycle())),
    )?;
    let cost = with - without;
    Ok(Figure {
        what: "accounts of a scan".into(),
        value: cost,
        unit: "ns",
        floor: Some(("an empty scan without them", without)),
        aim: ("<= 1000 ns", cost <= 1000.0),
    })
}

/// The time to pass a late scan to the observer, which includes reading the kernel's counters, compared with that
/// reading alone.
///
/// # Errors
/// If there is no ring.
pub fn late_scan() -> Result<Figure, Failure> {
    let (mut sender, mut late) = LateSender::pair();
    let (record, own) = (ScanRecord::default(), ThreadLook::open());
    let (sent, look) = in_turns(
        ROUNDS,
        || {
            Ok(time_per_call(ROUND, || {
                sender.send(&record, Sums::default());
                late.forget();
            }))
        },
        || {
            Ok(time_per_call(ROUND, || {
                std::hint::black_box(own.times());
            }))
        },
    )?;
    Ok(Figure {
        what: "handing over a late scan".into(),
        value: sent,
        unit: "ns",
        floor: Some(("one look at schedstat", look)),
        aim: ("<= 1000 ns", sent <= 1000.0),
    })
}

/// The time of an idle pair of handling blocks, compared with a read of the registers, which FC 1 needs.
///
/// # Errors
/// If the plugin does not exist or the CPU cannot be built.
pub fn idle_pair() -> Result<Figure, Failure> {
    let plugin = std::env::var_os("OB1_PLUGIN_DIR").ok_or("OB1_PLUGIN_DIR is not set; run: cargo xtask bench")?;
    let plugin = Plugin::load(&std::path::Path::new(&plugin).join("libob1_cp240.so"))?;
    let mut without = Station::build("", Some(&plugin))?;
    let mut with = Station::build(&PAIR.repeat(PAIRS), Some(&plugin))?;
    let segment = Segment::heap();
    let mut side = CpuSide::create(&segment, 16)?;
    let mut registers = [0u8; 16];

    let (pair, look) = in_turns(
        ROUNDS,
        || Ok((time_per_call(ROUND, || with.cycle()) - time_per_call(ROUND, || without.cycle())) / PAIRS as f64),
        || {
            Ok(time_per_call(ROUND, || {
                let _ = std::hint::black_box(side.read_inputs(&mut registers));
            }))
        },
    )?;
    Ok(Figure {
        what: "idle FC 0 + FC 1".into(),
        value: pair,
        unit: "ns",
        floor: Some(("one read of the registers", look)),
        aim: ("<= 100 ns", pair <= 100.0),
    })
}

/// A CPU in RUN with one CP at address 256, cycled directly.
struct Station {
    cpu: Cpu,
    clock: ob1_rt::MonotonicClock,
    _cp: Option<CpSide>,
}

impl Station {
    /// Without measuring the times of plugin blocks: this benchmark measures the handling blocks and not the clock.
    fn build(statements: &str, plugin: Option<&Arc<Plugin>>) -> Result<Self, Failure> {
        Self::build_with(statements, plugin, AccountsConfig { blocks: false, ..AccountsConfig::default() })
    }

    fn build_with(statements: &str, plugin: Option<&Arc<Plugin>>, accounts: AccountsConfig) -> Result<Self, Failure> {
        let mut library = Library::new();
        let mut natives = ob1_cpu::Natives::default();
        let mut modules: Vec<(ModuleSlot, Box<dyn Module>)> = Vec::new();
        let mut cp = None;
        if let Some(plugin) = plugin {
            for block in &plugin.info().blocks {
                library.insert(block.id, &block.name, block.interface.clone());
            }
            natives = plugin.station(&Default::default(), &[ob1_host::plugin::PluginModule::at(256)])?;
            let segment = Segment::heap();
            let side = CpuSide::create(&segment, 16)?;
            let mut other = CpSide::attach(&segment)?;
            other.set_state(ob1_backplane::DriverState::Ready);
            cp = Some(other);
            let module = CpModule::new(side, Box::new(AlwaysThere), CpSettings::default())?;
            modules.push((ModuleSlot::new("cp", 256), Box::new(module)));
        }
        let text = format!(
            "DATA_BLOCK DB 10\nSTRUCT\n x : ARRAY [0..299] OF BYTE;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n\
             DATA_BLOCK DB 11\nSTRUCT\n x : ARRAY [0..299] OF BYTE;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n\
             ORGANIZATION_BLOCK OB 1\nBEGIN\n{statements}\nEND_ORGANIZATION_BLOCK\n"
        );
        let sources = [Source::new("bench", text.into_bytes())];
        let output = ob1_stl::compile(&sources, &library, &Options::default());
        if !output.is_good() {
            return Err(ob1_stl::render_all(&output.diagnostics, &sources).into());
        }
        let config = CpuConfig { watchdog: Span::ZERO, accounts, ..CpuConfig::default() };
        let mut cpu = Cpu::new(config, &output.program, natives, modules, ob1_cpu::engine::REFERENCE)
            .map_err(|errors| errors.iter().map(|e| format!("{e}\n")).collect::<String>())?;
        cpu.request(Command::Run);
        let mut station = Self { cpu, clock: ob1_rt::MonotonicClock::start(), _cp: cp };
        station.cycle();
        Ok(station)
    }

    fn cycle(&mut self) {
        let _: Instant = self.cpu.cycle(&mut self.clock).next_deadline;
    }
}
