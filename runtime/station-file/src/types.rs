//! A station, checked: what `run`, `check` and the simulation build from.

use std::path::{Path, PathBuf};

use ob1_access::alarms::AlarmTexts;
use ob1_access::settings::{CpConnection, GateSettings, S7Settings};
use ob1_coupler::BusConfig;
use ob1_cpu::CpuConfig;
use ob1_host::bus::{BusModuleConfig, DpAreas, Station as BusStation, StationRules};
use ob1_model::BlockId;
use ob1_params::{Cp040, Cp240, Cp341, CpKind};
use ob1_serial::FaultRates;
use ob1_time::Span;

use super::line::Line;
use crate::EngineChoice;
use crate::finding::Spot;
use crate::sources::Sources;
use crate::{RetentiveFile, StationTrace};

/// Registers of a CP 342-5 in the address space, each way; nothing is in them.
const DP_MASTER_BYTES: u16 = 16;

/// The default of `delay_max`.
pub(super) const DELAY_MAX: Span = Span::from_millis(20);

/// A station file after all checks. Paths are relative to the current directory or absolute, no longer to the file.
#[derive(Clone, Debug, PartialEq)]
pub struct Station {
    /// Name of the station, by the rule [`NAME_RULE`](super::NAME_RULE).
    pub name: String,
    /// Sizes and rules of the CPU.
    pub cpu: CpuConfig,
    /// The engine that runs its program.
    pub engine: EngineChoice,
    /// What is asked of the operating system for the scan thread.
    pub realtime: Realtime,
    /// The program: sources and symbol tables in the order of the file.
    pub program: Sources,
    /// Plugins, in the order of the file.
    pub plugins: Vec<Plugin>,
    /// Where retentive memory is written; none: it does not outlast the runtime.
    pub retentive: Option<RetentiveFile>,
    /// Where it keeps what outlasts it.
    pub state: PathBuf,
    /// Where blocks are kept that were downloaded; none: no link may change the program.
    pub downloads: Option<PathBuf>,
    /// Modules, in the order of the file.
    pub modules: Vec<ModuleConfig>,
    /// Buses with remote modules, in the order of the file.
    pub buses: Vec<Bus>,
    /// Simulated lines, in the order of the file.
    pub simulated_lines: Vec<SimulatedLine>,
    /// Links into the CPU, in the order of the file.
    pub links: Vec<StationLink>,
    /// What it records by itself, in the order of the file.
    pub traces: Vec<StationTrace>,
    /// A file of timed process inputs, and the place that names it.
    pub stimulus: Option<(PathBuf, Spot)>,
    /// The table of alarm texts, and the place that names it.
    pub alarms: Option<(PathBuf, Spot)>,
    /// Its texts, when the files beside the station file have been looked at.
    pub alarm_texts: AlarmTexts,
}

/// The kinds of link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkKind {
    /// S7 communication, served by `ob1-s7`.
    S7,
    /// The web page, served by `ob1-gate` like all that follow.
    Web,
    /// Figures for Prometheus, read by its own protocol.
    Metrics,
    /// An OPC UA server.
    OpcUa,
    /// A client of an MQTT broker.
    Mqtt,
}

impl LinkKind {
    /// Its word in the station file.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::S7 => "s7",
            Self::Web => "web",
            Self::Metrics => "metrics",
            Self::OpcUa => "opcua",
            Self::Mqtt => "mqtt",
        }
    }

    /// The program that serves it.
    #[must_use]
    pub const fn program(self) -> &'static str {
        match self {
            Self::S7 => "ob1-s7",
            Self::Web | Self::Metrics | Self::OpcUa | Self::Mqtt => "ob1-gate",
        }
    }

    /// One process serves all links of a station that have this program.
    #[must_use]
    pub const fn shares_its_process(self) -> bool {
        !matches!(self, Self::S7)
    }
}

/// A link into the CPU: a process that listens on the network.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StationLink {
    /// Name of the link.
    pub name: String,
    /// Which language it speaks, and to whom.
    pub kind: LinkKind,
    /// Where it listens, if it does.
    pub listen: Option<std::net::SocketAddr>,
    /// What its clients may do.
    pub rights: ob1_access::Right,
    /// Which cells they may touch.
    pub allowed: ob1_access::Allowed,
    /// With this password a client may do more.
    pub password: Option<String>,
    /// The rights with this password.
    pub password_rights: ob1_access::Right,
    /// What its process is told.
    pub settings: LinkSettings,
    /// Files that nobody but the user of the station may read.
    pub secrets: Vec<PathBuf>,
    /// Where the runtime records what partners do, for a link whose process cannot.
    pub audit: Option<PathBuf>,
    /// Its process is this CP 343 too.
    pub cp: Option<String>,
}

/// What the process of a link is told.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LinkSettings {
    /// `ob1-s7`, for one link.
    S7(S7Settings),
    /// `ob1-gate`, for each of its links.
    Gate(Box<GateSettings>),
}

impl LinkSettings {
    /// As its process reads it from the first message of the broker.
    #[must_use]
    pub fn json(&self) -> String {
        let json = match self {
            Self::S7(own) => serde_json::to_string(own),
            Self::Gate(own) => serde_json::to_string(own),
        };
        json.unwrap_or_default()
    }
}

impl StationLink {
    /// The connections of the CP 343 that its process is.
    #[must_use]
    pub fn connections(&self) -> &[CpConnection] {
        match &self.settings {
            LinkSettings::S7(own) => &own.connections,
            LinkSettings::Gate(_) => &[],
        }
    }
}

/// A bus with remote modules: a process, and the lines it owns.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Bus {
    /// Its name, unique in the station.
    pub name: String,
    /// What its stations have in common for the program.
    pub rules: StationRules,
    /// The configuration of the process. The lines in it are texts: those of [`Self::lines`].
    pub config: BusConfig,
    /// Where its lines lead to, in the order of the configuration.
    pub lines: Vec<Line>,
    /// Its couplers for the program, in the order of the configuration.
    pub stations: Vec<BusStation>,
}

/// A simulated line: a process that is the cable, or the two wires, between CPs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SimulatedLine {
    /// Its name, as in `sim:NAME`.
    pub name: String,
    /// Two-wire RS-485: any number of participants, one may speak at a time. Otherwise a cable with two ends.
    pub half_duplex: bool,
    /// Stations of this user that have a shared line of this name are on the same one.
    pub shared: bool,
    /// Determines what goes wrong.
    pub seed: u64,
    /// What goes wrong all the time.
    pub faults: FaultRates,
    /// What goes wrong at times.
    pub bursts: Option<Bursts>,
    /// Who else is on the line.
    pub partner: Partner,
}

impl SimulatedLine {
    /// Adds faults to `rate` of a million characters, in equal parts of each kind, on another course.
    pub fn disturb(&mut self, rate: u32, seed: u64) {
        self.seed ^= seed;
        let FaultRates { flip, lose, double, delay, parity, framing, break_, .. } = &mut self.faults;
        let mut kinds = [flip, lose, double, delay, parity, framing, break_];
        // A character suffers one fault at most.
        let room = 1_000_000 - kinds.iter().map(|kind| **kind).sum::<u32>().min(1_000_000);
        let (rate, count) = (rate.min(room), kinds.len() as u32);
        for (place, kind) in (0..).zip(&mut kinds) {
            **kind += rate / count + u32::from(place < rate % count);
        }
        if self.faults.delay_max.is_zero() {
            self.faults.delay_max = DELAY_MAX;
        }
    }
}

/// Times in which more goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bursts {
    /// Mean time between two.
    pub every: Span,
    /// How long one lasts.
    pub length: Span,
    /// What goes wrong in it.
    pub faults: FaultRates,
}

/// Who is on a simulated line besides the CPs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Partner {
    /// Nobody: the CPs are alone.
    #[default]
    None,
    /// Somebody who sends back every character.
    Echo,
    /// A program that opens this pty.
    Pty(PathBuf),
}

/// What is asked of the operating system for the scan thread.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Realtime {
    /// SCHED_FIFO priority, 1 to 99; none: the ordinary scheduler.
    pub priority: Option<u8>,
    /// Cores the scan thread is bound to; empty: all.
    pub affinity: Vec<usize>,
    /// Lock the memory of the process.
    pub lock_memory: bool,
    /// Time before a deadline that is spent looking at the clock instead of sleeping.
    pub spin: Span,
    /// Keep idle cores from sleeping deeply.
    pub keep_awake: bool,
}

/// A plugin of a station.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plugin {
    /// As written: a path, or a bare name (`ob1_cp240`) that is searched for.
    pub name: String,
    /// The file, when `name` is a path; `None` for a bare name.
    pub path: Option<PathBuf>,
    /// Blocks that get another number: (number in the plugin, number in this station).
    pub blocks: Vec<(BlockId, BlockId)>,
    /// Where the station file names it; `None` for one of the command line.
    pub place: Option<Spot>,
}

impl Plugin {
    /// As the command line names it: a path, or a bare name.
    #[must_use]
    pub fn of_name(name: &str) -> Self {
        let is_path = name.contains('/') || Path::new(name).extension().is_some();
        Self { name: name.to_owned(), path: is_path.then(|| PathBuf::from(name)), blocks: Vec::new(), place: None }
    }
}

/// A module in its place.
#[derive(Clone, Debug, PartialEq)]
pub struct ModuleConfig {
    /// Its name, unique in the station.
    pub name: String,
    /// Logical address of its first input byte.
    pub input_address: u32,
    /// Logical address of its first output byte.
    pub output_address: u32,
    /// How it reads while its driver is down.
    pub absent: Absent,
    /// What its outputs are while the CPU does not drive them; nothing: 0. Of process outputs alone.
    pub substitute: Vec<u8>,
    /// The program that is its driver; none: `ob1-cp`. Of communication processors alone.
    pub driver: Option<PathBuf>,
    /// What it is, with its own parameters.
    pub kind: ModuleKind,
}

/// What a module that does not answer looks like to the program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Absent {
    /// Its bytes read 0.
    #[default]
    Zero,
    /// An access is a fault (OB 122, OB 85).
    Fault,
}

/// What ABD of the handling blocks counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AbdUnit {
    /// Bytes: ABD 20 is byte 20.
    #[default]
    Byte,
    /// Words: ABD 20 is byte 40.
    Word,
}

/// What a module is.
#[derive(Clone, Debug, PartialEq)]
pub enum ModuleKind {
    /// A CP 240 with its driver process.
    Cp240 {
        /// Its parameters, with its interface; [`Cp240::encode`] gives the other form, without.
        params: Box<Cp240>,
        /// The parameter bytes as sent.
        bytes: [u8; 16],
        /// Where its serial line leads to.
        line: Line,
        /// What ABD of its handling blocks counts.
        abd: AbdUnit,
        /// Errors that light ER raise diagnostic interrupts (OB 82).
        diagnostics: bool,
    },
    /// A CP 040 with its driver process.
    Cp040 {
        /// Its parameters; [`Cp040::encode`] gives the other form.
        params: Box<Cp040>,
        /// The parameter bytes as sent.
        bytes: [u8; 16],
        /// IO size: register bytes each way, 8 to 60.
        io_size: u16,
        /// Where its serial line leads to.
        line: Line,
        /// A wire break and wrong parameters raise diagnostic interrupts (OB 82).
        diagnostics: bool,
    },
    /// A CP whose parameters are keys with its driver process: a CP 341 or a CP 340, as they say.
    Keyed {
        /// Its parameters, checked against their table.
        params: Box<Cp341>,
        /// Where its serial line leads to.
        line: Line,
        /// Errors raise diagnostic interrupts (OB 82).
        diagnostics: bool,
    },
    /// A CP 343: the process of its link.
    Ethernet {
        /// The link; `None`: the only one.
        link: Option<String>,
    },
    /// Process inputs: `di` or `ai`.
    Inputs {
        /// Number of input bytes.
        bytes: u16,
        /// Its channels are words.
        analog: bool,
    },
    /// Process outputs: `do` or `ao`.
    Outputs {
        /// Number of output bytes.
        bytes: u16,
        /// Its channels are words.
        analog: bool,
    },
    /// A CP 342-5: a PROFIBUS whose slaves the program reaches by its handling blocks.
    DpMaster {
        /// Which bus, from 0.
        bus: usize,
        /// Where the data of its slaves lie for the handling blocks.
        areas: DpAreas,
    },
    /// A piece of a coupler.
    Remote {
        /// Which bus, from 0.
        bus: usize,
        /// Which part of it.
        module: BusModuleConfig,
    },
}

impl ModuleKind {
    /// Which communication processor it is; `None` for process I/O.
    #[must_use]
    pub fn cp(&self) -> Option<CpKind> {
        match self {
            Self::Cp240 { .. } => Some(CpKind::Cp240),
            Self::Cp040 { .. } => Some(CpKind::Cp040),
            Self::Keyed { params, .. } => Some(params.kind),
            Self::Ethernet { .. } => Some(CpKind::Cp343),
            Self::Inputs { .. } | Self::Outputs { .. } | Self::Remote { .. } | Self::DpMaster { .. } => None,
        }
    }

    /// Register bytes of a communication processor, each way; 0 for process I/O.
    fn io_bytes(&self) -> u16 {
        match (self, self.cp()) {
            (Self::Cp040 { io_size, .. }, _) => *io_size,
            (Self::DpMaster { .. }, _) => DP_MASTER_BYTES,
            (_, cp) => cp.and_then(|cp| cp.row().io_bytes).unwrap_or(0),
        }
    }

    /// Where the serial line of a communication processor leads to; `None` for process I/O.
    #[must_use]
    pub fn line(&self) -> Option<&Line> {
        match self {
            Self::Cp240 { line, .. } | Self::Cp040 { line, .. } | Self::Keyed { line, .. } => Some(line),
            Self::Ethernet { .. }
            | Self::Inputs { .. }
            | Self::Outputs { .. }
            | Self::DpMaster { .. }
            | Self::Remote { .. } => None,
        }
    }
}

impl ModuleConfig {
    /// Bytes of input registers.
    #[must_use]
    pub fn input_bytes(&self) -> u16 {
        match &self.kind {
            ModuleKind::Inputs { bytes, .. } => *bytes,
            ModuleKind::Remote { module, .. } => module.inputs.1,
            _ => self.kind.io_bytes(),
        }
    }

    /// Bytes of output registers.
    #[must_use]
    pub fn output_bytes(&self) -> u16 {
        match &self.kind {
            ModuleKind::Outputs { bytes, .. } => *bytes,
            ModuleKind::Remote { module, .. } => module.outputs.1,
            _ => self.kind.io_bytes(),
        }
    }
}
