//! From a station and its program to a CPU with its modules: segments, drivers, process I/O.

mod bus;

use std::ffi::OsString;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use ob1_backplane::{CpuSide, IoImage, Segment};
use ob1_broker::LinkConfig;
use ob1_cpu::{BusPlace, Cpu, CpuConfig, Family, Module, ModuleSlot, Running, Surroundings};
use ob1_host::driver::{DriverCommand, Fleet};
use ob1_host::module::{CpModule, CpSettings};
use ob1_host::plugin::{PluginModule, STATION, Setting};
use ob1_host::supervisor::Times;
use ob1_ir::Program;
use ob1_params::{CpKind, Interface, Value};
use ob1_rt::MonotonicClock;
use ob1_stl::Library;
use serde_json::json;

use crate::access::protocol::Listens;
use crate::compiling::Request;
use crate::confinement;
use crate::download::{self, Changes, Downloading};
use crate::drivers::{DriverSettings, find_program};
use crate::engine::{InUse, factory};
use crate::forced::{self, Forces};
use crate::io::{Panel, ProcessIo, Stimulus};
use crate::missing_blocks::Unserved;
use crate::program::{self, LoadFailure, Loaded};
use crate::program_facts::Known;
use crate::retentive::health::Health;
use crate::simulated;
use crate::view::{ModuleView, StationView};
use crate::wall_clock::date_now;
use bus::AddedBus;
use ob1_station_file::{
    AbdUnit, Absent, EngineChoice, Line, LinkKind, LinkSettings, ModuleConfig, ModuleKind, Partner, SimulatedLine,
    Station, StationLink,
};
use ob1_timing::Timings;

/// Organization blocks beyond those of the sources for which there is stack, where blocks can be downloaded.
const SPARE_OBS: u8 = 8;

/// A station, ready to run in this process.
#[derive(Debug)]
pub struct Assembly {
    /// The CPU, in STOP.
    pub cpu: Cpu,
    /// What other threads may look at.
    pub view: StationView,
    /// The drivers, not started yet.
    pub fleet: Fleet,
    /// The process I/O, when there is any.
    pub io: Option<ProcessIo>,
    /// What tools may open: name in the runtime directory and `/proc/PID/fd/N`.
    pub links: Vec<(String, PathBuf)>,
    /// Which native block runs.
    pub running: Arc<Running>,
    /// What is to be compiled in a process of its own, if the station file leaves the choice of the engine to us.
    pub compile: Option<Request>,
    /// What it takes to change the program.
    pub download: Downloading,
}

/// Why a station cannot be assembled.
#[derive(Debug)]
pub enum AssemblyError {
    /// The program, the plugins or the stimulus were rejected.
    Load(LoadFailure),
    /// The system refused memory or descriptors.
    System(String),
}

/// Where the modules of a station lie.
#[must_use]
pub fn slot(config: &ModuleConfig) -> ModuleSlot {
    let (input_address, output_address) = (config.input_address, config.output_address);
    ModuleSlot { name: config.name.clone(), input_address, output_address, bus: None }
}

/// A module as the plugins see it: where it lies, and its settings for them (`docs/plugins.md`).
#[must_use]
pub fn plugin_module(config: &ModuleConfig) -> PluginModule {
    let mut module = PluginModule::at(config.input_address);
    if let ModuleKind::Cp240 { abd, params, .. } = &config.kind {
        let unit = match abd {
            AbdUnit::Byte => "byte",
            AbdUnit::Word => "word",
        };
        module.settings.insert("abd".into(), Setting::Text(unit.into()));
        module.settings.insert("protocol".into(), Setting::Text(params.protocol_name().into()));
    }
    module
}

/// All modules as the plugins see them, and the station as a whole: which CP has which connection.
#[must_use]
pub fn plugin_modules(station: &Station) -> Vec<PluginModule> {
    let mut whole = PluginModule::at(STATION);
    let family = if station.cpu.family == Family::S7_400 { 400 } else { 300 };
    whole.settings.insert("family".into(), Setting::Int(family));
    for link in &station.links {
        let Some(module) = station.modules.iter().find(|module| link.cp.as_ref() == Some(&module.name)) else {
            continue;
        };
        for connection in link.connections() {
            let address = Setting::Int(i64::from(module.input_address));
            whole.settings.insert(format!("connection.{}", connection.id), address);
        }
    }
    station.modules.iter().map(plugin_module).chain([whole]).collect()
}

/// What the broker knows of a link, and tells its process: the `settings`.
#[must_use]
pub fn link_config(link: &StationLink, settings: &LinkSettings, listeners: Vec<OwnedFd>) -> LinkConfig {
    LinkConfig {
        name: link.name.clone(),
        rights: link.rights,
        allowed: link.allowed.clone(),
        password: link.password.clone(),
        password_rights: link.password_rights,
        config: settings.json(),
        listeners,
    }
}

/// The configuration of a CP of the station: parameter bytes, and the configuration of its driver as JSON. `None` for
/// process I/O.
///
/// With the runtime directory of a station that runs, and its simulated lines, also where its line is and where it can
/// be listened to.
#[must_use]
pub fn cp_settings(
    station: &str,
    config: &ModuleConfig,
    place: Option<(&Path, &[SimulatedLine])>,
) -> Option<CpSettings> {
    let row = config.kind.cp()?.row();
    let (parameters, line, diagnostics) = match &config.kind {
        ModuleKind::Cp240 { bytes, line, diagnostics, .. } | ModuleKind::Cp040 { bytes, line, diagnostics, .. } => {
            (*bytes, line, diagnostics)
        }
        ModuleKind::Keyed { line, diagnostics, .. } => ([0; 16], line, diagnostics),
        ModuleKind::Ethernet { .. } => {
            let json = json!({ "module": row.name, "station": station, "name": config.name });
            return Some(CpSettings {
                json: json.to_string().into_bytes(),
                absent_is_fault: config.absent == Absent::Fault,
                boxes: row.has_boxes,
                ..CpSettings::default()
            });
        }
        ModuleKind::Inputs { .. }
        | ModuleKind::Outputs { .. }
        | ModuleKind::DpMaster { .. }
        | ModuleKind::Remote { .. } => return None,
    };
    let mut text = line.to_string();
    let mut json = json!({ "module": row.name, "station": station, "name": config.name });
    if let ModuleKind::Cp240 { params, .. } = &config.kind
        && params.interface != Interface::Rs232
    {
        json["params"]["interface"] = params.interface.name().into();
    }
    if let ModuleKind::Keyed { params, .. } = &config.kind {
        for (key, value) in params.to_keys() {
            json["params"][*key] = match value {
                Value::Int(number) => json!(number),
                Value::Str(text) => json!(text),
            };
        }
    }
    if let Some((rundir, lines)) = place {
        if let Line::Sim(name) = line
            && let Some(line) = lines.iter().find(|line| line.name == *name)
        {
            text = format!("sim:{}", simulated::socket(rundir, line).display());
        }
        json["trace"] = json!(rundir.join(format!("{}.trace", config.name)));
    }
    json["line"] = text.into();
    if *diagnostics {
        json["diagnostics"] = true.into();
    }
    Some(CpSettings {
        parameters,
        json: json.to_string().into_bytes(),
        absent_is_fault: config.absent == Absent::Fault,
        channels: row.has_channels,
        takes_parameters: row.kind == CpKind::Cp040,
        boxes: row.has_boxes,
        diagnostics: *diagnostics,
    })
}

/// Loads program, native blocks and modules into a CPU.
///
/// # Errors
/// [`LoadFailure::Rejected`] with everything that does not fit together.
pub fn load_cpu(
    config: CpuConfig,
    (loaded, program): (&Loaded, &Program),
    natives: ob1_cpu::Natives,
    modules: Vec<(ModuleSlot, Box<dyn Module>)>,
    engine: EngineChoice,
) -> Result<Cpu, LoadFailure> {
    Cpu::new(config, program, natives, modules, factory(engine)).map_err(|errors| {
        LoadFailure::Rejected(Unserved::new(&loaded.standard, &loaded.plugins).findings(&errors, program))
    })
}

/// Builds a station with shared segments and real drivers.
///
/// # Errors
/// [`AssemblyError::Load`]: program, plugins or stimulus are rejected; [`AssemblyError::System`]: no memory or
/// descriptors.
pub fn assemble(
    station: &Station,
    loaded: &Loaded,
    drivers: &DriverSettings,
    rundir: &Path,
    clock: MonotonicClock,
) -> Result<Assembly, AssemblyError> {
    let mut building = Building {
        clock,
        station,
        drivers,
        rundir,
        fleet: Fleet::new(),
        buses: Vec::new(),
        io: None,
        links: Vec::new(),
        views: Vec::new(),
        modules: Vec::new(),
    };
    for line in &station.simulated_lines {
        simulated::add(&mut building.fleet, rundir, line, drivers).map_err(AssemblyError::System)?;
    }
    for bus in station.buses.iter().enumerate() {
        let added = bus::add(&mut building.fleet, rundir, bus, station, drivers).map_err(AssemblyError::System)?;
        building.buses.push(added);
    }
    for config in &station.modules {
        building.add(config)?;
    }
    let seen = plugin_modules(station);
    let natives = loaded.native_blocks(&seen).map_err(AssemblyError::Load)?;
    let mut config = station.cpu.clone();
    config.date_at_start = date_now();
    if station.downloads.is_some() {
        config.spare_obs = SPARE_OBS;
    }
    let rules = config.clone();
    let around = Surroundings::new(&config, &natives);
    let library = program::library(&loaded.plugins, &station.program.library)
        .map_err(|findings| AssemblyError::Load(LoadFailure::Rejected(findings)))?;
    let library = Arc::new(library);
    let sources = Arc::clone(&loaded.program);
    let (now, changes) = restored(station, &sources, &library, &around);
    let compiles = station.engine == EngineChoice::Auto;
    let compile = compiles.then(|| Request::new(&config, Arc::clone(&now), &natives));
    let mut cpu =
        load_cpu(config, (loaded, &now), natives, building.modules, station.engine).map_err(AssemblyError::Load)?;
    let forces = forces(station, &mut cpu);
    let known = Known::default();
    let in_use = Arc::new(InUse::default());
    known.set(changes.known(&now, (&sources, &around), &library));
    let download = Downloading {
        around,
        sources,
        now,
        changes,
        path: station.downloads.as_ref().map(|folder| download::path(folder, &station.name)),
        station: None,
        library,
        known: known.clone(),
        engine: station.engine,
        in_use: Arc::clone(&in_use),
        compile: compile.clone(),
        stack: cpu.stack_bytes(),
        cycles: station.cpu.min_cycle.times(2).into(),
    };
    let view = StationView {
        name: station.name.clone(),
        listens: station.links.iter().filter_map(listens).collect(),
        family: station.cpu.family,
        known,
        alarm_texts: Arc::new(station.alarm_texts.clone()),
        engine: in_use,
        stands: Arc::default(),
        modules: building.views,
        buses: building.buses.into_iter().map(|bus| bus.view).collect(),
        panel: building.io.as_ref().and_then(|io| Some(Panel::new(io.field()?, &station.modules))),
        posture: Arc::new(OnceLock::new()),
        forces,
        loads: Arc::new(OnceLock::new()),
        retentive: station.retentive.as_ref().map(|_| Health::default()),
        clock,
        timings: Timings::new(cpu.accounts(), &rules, clock),
    };
    let running = cpu.running();
    view.engine.set(cpu.engine());
    Ok(Assembly {
        cpu,
        view,
        fleet: building.fleet,
        io: building.io,
        links: building.links,
        running,
        compile,
        download,
    })
}

/// Where a link is reached.
fn listens(link: &StationLink) -> Option<Listens> {
    let tls = matches!(&link.settings, LinkSettings::Gate(told) if told.tls.is_some());
    Some(Listens { kind: link.kind.word().to_owned(), address: link.listen?, tls })
}

/// Forces what was forced when the station ended.
fn forces(station: &Station, cpu: &mut Cpu) -> Forces {
    let path = forced::path(&station.state, &station.name);
    let cells = forced::read(&path).unwrap_or_else(|why| {
        tracing::error!("{}: nothing is forced: {why}", path.display());
        Vec::new()
    });
    let count = cpu.force(&cells);
    if !cells.is_empty() {
        tracing::warn!("forced as before: {count} of {} cells ({})", cells.len(), path.display());
    }
    Forces::new(path, cells, cpu.forced())
}

/// The program of the sources with what was downloaded, or without it if that is not possible.
fn restored(
    station: &Station,
    sources: &Arc<Program>,
    library: &Library,
    around: &Surroundings,
) -> (Arc<Program>, Changes) {
    let path = station.downloads.as_ref().map(|folder| download::path(folder, &station.name));
    let nothing = || (Arc::clone(sources), Changes::default());
    let Some(path) = path else { return nothing() };
    let program = download::read(&path).and_then(|changes| {
        if changes.is_empty() {
            return Ok(nothing());
        }
        let program = changes.apply(sources, library, around).map_err(|whys| whys.join("; "))?;
        // Loads it on trial: if that fails, the station starts without.
        let tried = around.successor((sources, &program), Vec::new(), ob1_cpu::engine::REFERENCE, usize::MAX);
        tried.map_err(|errors| errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))?;
        Ok((Arc::new(program), changes))
    });
    program.unwrap_or_else(|why| {
        tracing::error!("{}: the downloaded blocks are left out: {why}", path.display());
        tracing::error!("  = the station runs what its sources say; download it again, or remove the file");
        nothing()
    })
}

/// The ptys the drivers of a station publish: to be removed if the runtime is killed.
#[must_use]
pub fn published(station: &Station) -> Vec<PathBuf> {
    station
        .modules
        .iter()
        .filter_map(|module| match module.kind.line() {
            Some(Line::Pty(path)) => Some(path.clone()),
            _ => None,
        })
        .chain(station.simulated_lines.iter().filter_map(|line| match &line.partner {
            Partner::Pty(path) => Some(path.clone()),
            Partner::None | Partner::Echo => None,
        }))
        .collect()
}

struct Building<'a> {
    clock: MonotonicClock,
    station: &'a Station,
    drivers: &'a DriverSettings,
    rundir: &'a Path,
    fleet: Fleet,
    buses: Vec<AddedBus>,
    io: Option<ProcessIo>,
    links: Vec<(String, PathBuf)>,
    views: Vec<ModuleView>,
    modules: Vec<(ModuleSlot, Box<dyn Module>)>,
}

impl Building<'_> {
    fn add(&mut self, config: &ModuleConfig) -> Result<(), AssemblyError> {
        let mut view = ModuleView::new(config);
        let settings = cp_settings(&self.station.name, config, Some((self.rundir, &self.station.simulated_lines)));
        let module = match (&config.kind, settings) {
            (ModuleKind::DpMaster { bus, areas }, _) => {
                let bus =
                    self.buses.get(*bus).ok_or_else(|| AssemblyError::System(format!("{}: no bus", config.name)))?;
                (view.monitor, view.driver) = (Some(bus.monitor.clone()), Some(Arc::clone(&bus.driver)));
                bus.bus.cp(areas.clone())
            }
            (ModuleKind::Remote { bus, module }, _) => {
                let bus =
                    self.buses.get(*bus).ok_or_else(|| AssemblyError::System(format!("{}: no bus", config.name)))?;
                // One line of figures for each coupler.
                if module.speaks {
                    (view.monitor, view.driver) = (Some(bus.monitor.clone()), Some(Arc::clone(&bus.driver)));
                }
                bus.bus.module(module.clone())
            }
            (_, Some(settings)) => self.cp(config, settings, &mut view)?,
            (_, None) => self.process_io(config)?,
        };
        self.modules.push((ModuleSlot { bus: self.place(config), ..slot(config) }, module));
        self.views.push(view);
        Ok(())
    }

    /// Where a module lies on its bus.
    fn place(&self, config: &ModuleConfig) -> Option<BusPlace> {
        let ModuleKind::Remote { bus, module } = &config.kind else { return None };
        let bus = self.station.buses.get(*bus)?;
        let station = bus.stations.get(module.station)?.number;
        Some(BusPlace { master: bus.rules.number, station, slot: module.slot })
    }

    fn cp(
        &mut self,
        config: &ModuleConfig,
        settings: CpSettings,
        view: &mut ModuleView,
    ) -> Result<Box<dyn Module>, AssemblyError> {
        let system = |error: &dyn std::fmt::Display| AssemblyError::System(format!("module {}: {error}", config.name));
        let made = if settings.boxes { Segment::create_shared_with_boxes() } else { Segment::create_shared() };
        let segment = made.map_err(|e| system(&e))?;
        let mut side = CpuSide::create(&segment, usize::from(config.input_bytes())).map_err(|e| system(&e))?;
        side.set_origin(self.clock.origin().nanos());
        // Before the driver looks: otherwise it would report that it has no parameters.
        side.write_params(&settings.parameters, &settings.json).map_err(|e| system(&e))?;
        if let Some(path) = segment.path() {
            self.links.push((format!("{}.segment", config.name), path));
        }
        let is_link = matches!(config.kind, ModuleKind::Ethernet { .. });
        let program = match &config.driver {
            Some(program) => program.clone(),
            None if is_link => find_program(LinkKind::S7.program()).map_err(|e| system(&e))?,
            None => self.drivers.program.clone(),
        };
        let mut args: Vec<OsString> = vec!["--name".into(), config.name.clone().into()];
        if is_link {
            args.push("--cp".into());
        }
        let command = DriverCommand {
            name: config.name.clone(),
            program,
            args,
            env: self
                .drivers
                .env
                .iter()
                .cloned()
                .chain([confinement::variable([self.rundir], None, config.kind.line())])
                .collect(),
            descriptors: Vec::new(),
        };
        let monitor = side.monitor().clone();
        let port = self.fleet.add(command, segment, monitor.clone(), Times::default()).map_err(|e| system(&e))?;
        view.monitor = Some(monitor);
        view.driver = Some(Arc::clone(&port.status));
        Ok(Box::new(CpModule::new(side, Box::new(port), settings).map_err(|e| system(&e))?))
    }

    fn process_io(&mut self, config: &ModuleConfig) -> Result<Box<dyn Module>, AssemblyError> {
        let leads = self.io.is_none();
        if leads {
            let stimulus = match &self.station.stimulus {
                Some((path, place)) => {
                    Stimulus::load(path, place).map_err(|f| AssemblyError::Load(LoadFailure::Rejected(f)))?
                }
                None => Stimulus::default(),
            };
            let image = IoImage::create_shared().map_err(|e| AssemblyError::System(format!("process I/O: {e}")))?;
            if let Some(path) = image.path() {
                self.links.push((crate::rundir::IO.to_owned(), path));
            }
            self.io = Some(ProcessIo::new(image, stimulus));
        }
        let module = self.io.as_ref().and_then(|io| io.module(config, leads));
        module.ok_or_else(|| AssemblyError::System(format!("module {}: neither CP nor process I/O", config.name)))
    }
}
