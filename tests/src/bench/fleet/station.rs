//! A station of the fleet: its CPU in virtual time, its broker with the documents of the product, and its doors.

use std::net::TcpListener;
use std::os::fd::OwnedFd;
use std::path::Path;

use ob1_access::door::{BlockFact, Diagnosis, Document, Door, State};
use ob1_access::{Put, Right};
use ob1_broker::{Broker, DriverState, Facts, Feed, LinkConfig, LinkState, feed};
use ob1_cpu::{Command, Cpu, DiagEntry};
use ob1_model::{BlockId, cells};
use ob1_rt::MonotonicClock;
use ob1_socket::handover;
use ob1_station::access::server::Server;
use ob1_station::assembly::{self, AssemblyError};
use ob1_station::drivers::DriverSettings;
use ob1_station::program::Loaded;
use ob1_station::rundir;
use ob1_station::view::StationView;
use ob1_station_file::{LinkKind, Station};
use ob1_time::{Instant, Span};

use super::super::peer::Failure;
use crate::sim::clock::VirtualClock;

/// The broker looks at its links at the end of a cycle, and this long after it.
const LOOK: Span = Span::from_millis(50);
/// The control socket is the first link of the broker.
const CONTROL: usize = 0;

/// See [the module](self).
#[derive(Debug)]
pub(super) struct Simulated {
    pub(super) name: String,
    cpu: Cpu,
    broker: Broker,
    feed: Feed,
    view: StationView,
    min_cycle: Span,
    due: Instant,
    look: Instant,
    /// While somebody may ask it.
    server: Option<Server>,
}

impl Simulated {
    /// Builds the station of a file; `listener` is that of its figures, `begins` its first cycle.
    pub(super) fn new(
        station: &Station,
        loaded: &Loaded,
        clock: MonotonicClock,
        listener: TcpListener,
        begins: Instant,
    ) -> Result<Self, Failure> {
        let drivers = DriverSettings { program: "".into(), io: "".into(), env: Vec::new() };
        let built =
            assembly::assemble(station, loaded, &drivers, Path::new(""), clock).map_err(|error| match error {
                AssemblyError::Load(failure) => crate::sim::station::texts(&Vec::from(failure)),
                AssemblyError::System(why) => why,
            })?;
        let (mut cpu, view) = (built.cpu, built.view);
        let mut listener = Some(OwnedFd::from(listener));
        let control = LinkConfig { rights: Right::Operate, ..LinkConfig::default() };
        let links = station.links.iter().map(|link| {
            let sockets = if link.kind == LinkKind::Metrics { listener.take() } else { None };
            assembly::link_config(link, &link.settings, sockets.into_iter().collect())
        });
        let links = std::iter::once(control).chain(links).collect();
        let (feed, end) = feed();
        let config = &station.cpu;
        let facts = Told {
            view: view.clone(),
            areas: [config.input_bytes, config.output_bytes, config.memory_bytes],
            timers_and_counters: [config.timers, config.counters],
            min_cycle: config.min_cycle,
        };
        let broker = Broker::new(&mut cpu, links, end, Box::new(facts))?;
        cpu.request(Command::Run);
        let (name, min_cycle) = (station.name.clone(), config.min_cycle);
        Ok(Self { name, cpu, broker, feed, view, min_cycle, due: begins, look: begins, server: None })
    }

    /// Everything that is due; each cycle begins exactly when it is. Without `scans` the CPU stands still.
    pub(super) fn turn(&mut self, now: Instant, scans: bool) {
        while scans && self.due <= now {
            let end = self.cpu.cycle(&mut VirtualClock(self.due));
            self.feed.follow(self.cpu.diagnostic_buffer());
            self.due = end.next_deadline.max(self.due + Span::from_nanos(1));
            self.look = now;
        }
        if self.look <= now {
            self.broker.step(now);
            self.look = now + LOOK;
        }
    }

    /// The other end of a link of the station file, for the process that serves it.
    pub(super) fn door(&mut self, link: usize, now: Instant) -> Result<OwnedFd, Failure> {
        self.connect(link + 1, now)
    }

    fn connect(&mut self, link: usize, now: Instant) -> Result<OwnedFd, Failure> {
        let (ours, theirs) = handover::pair()?;
        self.broker.connect(link, ours, now);
        Ok(theirs)
    }

    /// Opens its control socket below this folder, as a running station has it.
    pub(super) fn listen(&mut self, run: &Path, now: Instant) -> Result<(), Failure> {
        let folder = run.join("ob1").join(&self.name);
        std::fs::create_dir_all(&folder)?;
        let door = Door::new(self.connect(CONTROL, now)?)?;
        self.server = Some(Server::start(&folder.join(rundir::SOCKET), door, self.view.clone(), self.min_cycle)?);
        Ok(())
    }

    /// Nobody asks any more.
    pub(super) fn hush(&mut self) {
        self.server = None;
    }

    /// What two of its values are: `DB10.parts` and `DB10.level`.
    pub(super) fn values(&self) -> Option<[i64; 2]> {
        let block = self.cpu.data_block(10)?;
        let (parts, level) = (cells::dword(block, 0)?, cells::word(block, 8)?);
        Some([i64::from(parts as i32), i64::from(level as i16)])
    }
}

/// What the broker is told of a station without modules: the documents are those of the product.
#[derive(Debug)]
struct Told {
    view: StationView,
    areas: [u32; 3],
    timers_and_counters: [u16; 2],
    min_cycle: Span,
}

impl Facts for Told {
    fn name(&self) -> &str {
        &self.view.name
    }
    fn family(&self) -> u16 {
        300
    }
    fn areas(&self) -> [u32; 3] {
        self.areas
    }
    fn timers_and_counters(&self) -> [u16; 2] {
        self.timers_and_counters
    }
    fn min_cycle(&self) -> Span {
        self.min_cycle
    }
    fn modules(&self) -> u32 {
        0
    }
    fn drivers(&self) -> Vec<DriverState> {
        Vec::new()
    }
    fn diagnosis(&self, entry: &DiagEntry) -> Diagnosis {
        self.view.diagnosis(entry)
    }
    fn blocks(&self) -> Vec<BlockFact> {
        self.view.known.get().blocks.clone()
    }
    fn block(&self, _: BlockId) -> Option<Box<[u8]>> {
        None
    }
    fn document(&self, which: Document, state: State, present: &[bool], links: &[LinkState]) -> Box<[u8]> {
        self.view.document(which, state, present, links)
    }
    fn take_input(&self, _: &Put) -> bool {
        false
    }
}
