//! The time of an idle scan, and the additional time of idle handling blocks.

use std::sync::Arc;
use std::time::Duration;

use ob1_backplane::{CpSide, CpuSide, Segment};
use ob1_cpu::engine::Factory;
use ob1_cpu::{AccountsConfig, Clock, Command, Cpu, CpuConfig, Module, ModuleSlot, ScanRecord, Sums};
use ob1_host::module::{AlwaysThere, CpModule, CpSettings};
use ob1_host::plugin::Plugin;
use ob1_rt::ThreadLook;
use ob1_stl::{Library, Options, Source};
use ob1_time::{Instant, Span};
use ob1_timing::LateSender;

use super::peer::Failure;
use super::{Figure, in_turns, time_per_call};

const ROUNDS: usize = 21;
const ROUND: Duration = Duration::from_millis(40);
/// FC 0 + FC 1 pairs in one OB 1: the time of a pair is the difference to an empty OB 1, divided by this.
const PAIRS: usize = 50;

/// Parameters of a pair are 23; an even number.
const PARAMS: usize = 24;
/// The most a pair may take, as text and as a multiple of [`BarePair`].
const PAIR_AIM: (&str, f64) = ("<= 2.5 x", 2.5);

/// One `FC 0` and one `FC 1`, called as in the manual, with nothing to do.
pub(super) const PAIR: &str = "
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
        aim: ("<= 1.5 x", sent <= 1.5 * look),
    })
}

/// The time of an idle pair of handling blocks, compared with the least that any block with as many parameters needs.
///
/// # Errors
/// If the plugin does not exist or the CPU cannot be built.
pub fn idle_pair() -> Result<Figure, Failure> {
    let plugin = cp240()?;
    let mut without = Station::build("", Some(&plugin))?;
    let mut with = Station::build(&PAIR.repeat(PAIRS), Some(&plugin))?;
    let mut bare = BarePair::new()?;
    let (pair, floor) = in_turns(
        ROUNDS,
        || Ok((time_per_call(ROUND, || with.cycle()) - time_per_call(ROUND, || without.cycle())) / PAIRS as f64),
        || Ok(time_per_call(ROUND, || bare.call())),
    )?;
    Ok(Figure {
        what: "idle FC 0 + FC 1".into(),
        value: pair,
        unit: "ns",
        floor: Some(("their parameters moved, registers read", floor)),
        aim: (PAIR_AIM.0, pair <= PAIR_AIM.1 * floor),
    })
}

/// The handling blocks of the CP 240.
pub(super) fn cp240() -> Result<Arc<Plugin>, Failure> {
    let folder = std::env::var_os("OB1_PLUGIN_DIR").ok_or("OB1_PLUGIN_DIR is not set; run: cargo xtask bench")?;
    Ok(Plugin::load(&std::path::Path::new(&folder).join("libob1_cp240.so"))?)
}

/// What a pair of blocks needs at least: each parameter is taken or given through a function pointer, as a plugin does
/// it, and each block reads the registers.
struct BarePair {
    memory: [u8; 2 * PARAMS],
    side: CpuSide,
    registers: [u8; 16],
    get: Get,
    set: Set,
}

type Get = extern "C" fn(&[u8; 2 * PARAMS], usize) -> u32;
type Set = extern "C" fn(&mut [u8; 2 * PARAMS], usize, u32);

impl BarePair {
    fn new() -> Result<Self, Failure> {
        extern "C" fn get(memory: &[u8; 2 * PARAMS], at: usize) -> u32 {
            memory.get(at..at + 2).map_or(0, |from| u32::from(u16::from_be_bytes([from[0], from[1]])))
        }
        extern "C" fn set(memory: &mut [u8; 2 * PARAMS], at: usize, value: u32) {
            if let Some(into) = memory.get_mut(at..at + 2) {
                into.copy_from_slice(&(value as u16).to_be_bytes());
            }
        }
        let segment = Segment::heap();
        let side = CpuSide::create(&segment, 16)?;
        let (get, set) = std::hint::black_box((get as Get, set as Set));
        Ok(Self { memory: [0; 2 * PARAMS], side, registers: [0; 16], get, set })
    }

    fn call(&mut self) {
        for block in 0..2 {
            let _ = std::hint::black_box(self.side.read_inputs(&mut self.registers));
            let of_block = block * PARAMS..(block + 1) * PARAMS;
            // As many are inputs as are not.
            for at in of_block.step_by(4) {
                let value = (self.get)(&self.memory, at);
                (self.set)(&mut self.memory, at + 2, value);
            }
        }
    }
}

/// A CPU in RUN with one CP at address 256, cycled directly.
pub(super) struct Station<C = ob1_rt::MonotonicClock> {
    cpu: Cpu,
    clock: C,
    _cp: Option<CpSide>,
}

impl Station {
    /// Without measuring the times of plugin blocks: this benchmark measures the handling blocks and not the clock.
    fn build(statements: &str, plugin: Option<&Arc<Plugin>>) -> Result<Self, Failure> {
        Self::build_with(statements, plugin, AccountsConfig { blocks: false, ..AccountsConfig::default() })
    }

    fn build_with(statements: &str, plugin: Option<&Arc<Plugin>>, accounts: AccountsConfig) -> Result<Self, Failure> {
        Self::build_on(ob1_cpu::engine::REFERENCE, statements, "", plugin, accounts, ob1_rt::MonotonicClock::start())
    }
}

impl<C: Clock> Station<C> {
    /// On an engine, and with further blocks.
    pub(super) fn build_on(
        engine: &dyn Factory,
        statements: &str,
        more: &str,
        plugin: Option<&Arc<Plugin>>,
        accounts: AccountsConfig,
        clock: C,
    ) -> Result<Self, Failure> {
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
             {more}ORGANIZATION_BLOCK OB 1\nBEGIN\n{statements}\nEND_ORGANIZATION_BLOCK\n"
        );
        let sources = [Source::new("bench", text.into_bytes())];
        let output = ob1_stl::compile(&sources, &library, &Options::default());
        if !output.is_good() {
            return Err(ob1_stl::render_all(&output.diagnostics, &sources).into());
        }
        let config = CpuConfig { watchdog: Span::ZERO, accounts, memory_bytes: 2048, ..CpuConfig::default() };
        let mut cpu = Cpu::new(config, &output.program, natives, modules, engine)
            .map_err(|errors| errors.iter().map(|e| format!("{e}\n")).collect::<String>())?;
        cpu.request(Command::Run);
        let mut station = Self { cpu, clock, _cp: cp };
        station.cycle();
        Ok(station)
    }

    /// A CPU in STOP is fast.
    ///
    /// # Errors
    /// If it is not in RUN after a further scan.
    pub(super) fn runs(&mut self) -> Result<(), Failure> {
        self.cycle();
        super::machine_code::running(&self.cpu)
    }

    pub(super) fn cycle(&mut self) {
        let _: Instant = self.cpu.cycle(&mut self.clock).next_deadline;
    }
}
