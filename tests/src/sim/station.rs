//! A station without processes: the real CPU with the real plugins, over heap segments.

use std::fmt::Write as _;
use std::path::Path;

use ob1_cpu::{Clock, Command, Cpu, Module, ModuleSlot};
use ob1_host::module::{CpModule, CpSettings};
use ob1_line::sim::SplitMix64;
use ob1_station::{assembly, program};
use ob1_station_file::{self, EngineChoice, Station};
use ob1_time::{Instant, Span};

use super::driver::Driver;

/// A simulated station.
#[derive(Debug)]
pub struct SimStation {
    /// Its name.
    pub name: String,
    /// Its CPU.
    pub cpu: Cpu,
    /// Indices of its drivers in the list of the simulation.
    pub drivers: Vec<usize>,
    /// Time of its next cycle.
    pub due: Instant,
    /// Number of the last logged diagnostic entry.
    logged: u64,
}

/// Finds the end of a cable for a module by the name of the line.
pub type Plug<'a> = dyn FnMut(&str) -> Result<(usize, ob1_fakes::sim_line::End), String> + 'a;

impl SimStation {
    /// Builds a station from its file; `plug` finds the cable of a line, `drivers` gets the drivers.
    ///
    /// # Errors
    /// The error in the files, as text.
    pub fn build(
        path: &Path,
        plug: &mut Plug<'_>,
        drivers: &mut Vec<Driver>,
        rng: &mut SplitMix64,
    ) -> Result<Self, String> {
        Self::build_with(path, plug, drivers, rng, &|_| {})
    }

    /// The same; `spoil` may change the configuration of the drivers to values that no station file can contain.
    ///
    /// # Errors
    /// The error in the files, as text.
    pub fn build_with(
        path: &Path,
        plug: &mut Plug<'_>,
        drivers: &mut Vec<Driver>,
        rng: &mut SplitMix64,
        spoil: &dyn Fn(&mut CpSettings),
    ) -> Result<Self, String> {
        let station = ob1_station_file::load(path).map_err(|findings| texts(&findings))?;
        let loaded = program::load(&station).map_err(|failure| texts(&Vec::from(failure)))?;
        let mut own = Vec::new();
        let modules = modules(&station, plug, drivers, &mut own, rng, spoil)?;
        let seen: Vec<_> = station.modules.iter().map(assembly::plugin_module).collect();
        let natives = loaded.native_blocks(&seen).map_err(|failure| texts(&Vec::from(failure)))?;
        let mut cpu = Cpu::new(
            station.cpu.clone(),
            &loaded.program,
            natives,
            modules,
            ob1_station::engine::factory(engine(station.engine)),
        )
        .map_err(|errors| errors.iter().map(|e| format!("{e}\n")).collect::<String>())?;
        cpu.request(Command::Run);
        Ok(Self { name: station.name, cpu, drivers: own, due: Instant::START, logged: 0 })
    }

    /// One cycle, starting at `now`.
    pub fn cycle(&mut self, now: Instant, clock: &mut dyn Clock) {
        let end = self.cpu.cycle(clock);
        self.due = end.next_deadline.max(now + Span::from_nanos(1));
    }

    /// Writes new entries of the diagnostic buffer to the log.
    pub fn tell(&mut self, now: Instant, log: &mut String) {
        let new = self.cpu.diagnostics().take_while(|entry| entry.number > self.logged).count();
        for back in (0..new).rev() {
            if let Some(entry) = self.cpu.diagnostics().nth(back) {
                // Writing into a String cannot fail.
                let _ = writeln!(log, "{:>12} {} {entry}", now.micros(), self.name);
                self.logged = entry.number;
            }
        }
    }

    /// The engine that runs its program.
    #[must_use]
    pub fn engine(&self) -> &'static str {
        self.cpu.engine()
    }

    /// A double word of a data block; 0 if it does not exist.
    #[must_use]
    pub fn ledger(&self, db: u16, byte: usize) -> u32 {
        self.cpu.data_block(db).and_then(|bytes| ob1_model::cells::dword(bytes, byte)).unwrap_or(0)
    }
}

/// A station that chooses for itself would soon run machine code; in virtual time there is no process that makes it.
fn engine(choice: EngineChoice) -> EngineChoice {
    if choice == EngineChoice::Auto { EngineChoice::Native } else { choice }
}

type Modules = Vec<(ModuleSlot, Box<dyn Module>)>;

fn modules(
    station: &Station,
    plug: &mut Plug<'_>,
    drivers: &mut Vec<Driver>,
    own: &mut Vec<usize>,
    rng: &mut SplitMix64,
    spoil: &dyn Fn(&mut CpSettings),
) -> Result<Modules, String> {
    let mut modules: Modules = Vec::new();
    for config in &station.modules {
        let Some(line) = config.kind.line() else {
            return Err(format!("{}: the simulation has no process I/O", config.name));
        };
        let (cable, end) = plug(&line.to_string())?;
        let (driver, side, link) =
            Driver::new(cable, end, rng.next_u64(), config.input_bytes().into()).map_err(|e| e.to_string())?;
        own.push(drivers.len());
        drivers.push(driver);
        let mut settings = assembly::cp_settings(&station.name, config, None).ok_or("a CP without settings")?;
        spoil(&mut settings);
        let module = CpModule::new(side, Box::new(link), settings).map_err(|e| e.to_string())?;
        let slot = ModuleSlot {
            name: config.name.clone(),
            bus: None,
            input_address: config.input_address,
            output_address: config.output_address,
        };
        modules.push((slot, Box::new(module)));
    }
    Ok(modules)
}

pub(crate) fn texts(findings: &[ob1_station_file::finding::Finding]) -> String {
    findings.iter().map(|finding| finding.text.as_str()).collect()
}
