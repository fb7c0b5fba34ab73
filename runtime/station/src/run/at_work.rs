//! A station at work: its threads and processes, from their start to their orderly end.

use std::os::fd::OwnedFd;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use ob1_access::door::Door;
use ob1_access::settings::GateKind;
use ob1_access::{Allowed, Right};
use ob1_broker::{Broker, FeedEnd, Handle, LinkConfig, RunningBroker};
use ob1_cpu::{Attention, Cpu, LogReader, OperatingState, Running};
use ob1_host::driver::{HandOver, RunningFleet};
use ob1_rt::MonotonicClock;
use ob1_socket::handover;
use ob1_time::Span;

use super::console::LiveLine;
use super::failure::Failure;
use super::hung_block::Monitor;
use super::journal::Journal;
use super::last_words;
use super::listening::listen;
use super::options::Options;
use super::reason_log::ReasonLog;
use super::report::{Ended, Report};
use super::scan::{Scan, ScanState};
use super::signals::Signals;
use crate::access::facts::StationFacts;
use crate::access::server::Server;
use crate::assembly::{self, Assembly};
use crate::compiling::Compiling;
use crate::download::Downloading;
use crate::drivers::find_program;
use crate::exit::Exit;
use crate::guardian::Guardian;
use crate::io::ProcessIo;
use crate::links::{LinkSpec, Links};
use crate::posture;
use crate::recording::Recordings;
use crate::retentive;
use crate::retentive::keeper::{Keeper, ScanEnd};
use crate::retentive::store::StoreError;
use crate::rundir::{RunDir, RunDirError};
use crate::view::StationView;
use ob1_station_file::{LinkSettings, Station, StationLink};
use ob1_timing::Observer;

/// Time between two checks of the scan and the clock.
const TICK: Duration = Duration::from_millis(20);
/// Ticks between two live lines.
const LIVE_TICKS: u64 = 25;
/// Ticks between two looks whether the runtime directory is still there, and what the CPs wait for.
const SECOND_TICKS: u64 = 50;
/// How long the CPU gets to go to STOP, beyond two cycles.
const STOP_TIME: Span = Span::from_secs(3);
/// Between two looks at it. Looks are counted, not time: a process that stood still meanwhile is not taken for a block
/// that does not return.
const LOOK: Span = Span::MILLISECOND;

/// A station at work. The fields are dropped in this order: a user of something before the thing itself.
pub(super) struct AtWork {
    view: StationView,
    scan: Arc<ScanState>,
    attention: Attention,
    log: Option<LogReader>,
    journal: Journal,
    block: Arc<Running>,
    io: Option<ProcessIo>,
    min_cycle: Span,
    thread: Option<JoinHandle<Result<(), String>>>,
    monitor: Option<Monitor>,
    /// Has machine code made in a process of its own.
    compiling: Option<Compiling>,
    observer: Option<Observer>,
    keeper: Option<Keeper>,
    server: Option<Server>,
    recordings: Option<Recordings>,
    broker: Option<RunningBroker>,
    links: Option<Links>,
    fleet: Option<RunningFleet>,
    rundir: RunDir,
    /// What is wrong with it has been reported.
    rundir_told: bool,
    _guardian: Guardian,
    clock: MonotonicClock,
    fence: bool,
    /// Keeps idle cores awake as long as it is held.
    _awake: Option<std::fs::File>,
}

impl AtWork {
    /// Publishes the links, starts the socket, the drivers, the scan and its monitor. If that fails, the guardian goes
    /// last: it cleans up when nobody holds the lock of the runtime directory any more, and is waited for.
    pub(super) fn start(
        guardian: Guardian,
        station: &Station,
        assembly: Assembly,
        mut rundir: RunDir,
        clock: MonotonicClock,
        options: &Options,
    ) -> Result<Self, Failure> {
        let Assembly { mut cpu, view, mut fleet, io, links, running, compile, download } = assembly;
        // First: a folder that cannot be used is reported before anything has been started.
        let (keeper, retentive) = keep(station, &mut cpu, &view)?;
        for (name, target) in links {
            rundir.link(name, &target).map_err(|e| Failure(Exit::System, format!("ob1: {e}\n")))?;
        }
        let (grants, awake) = posture::ask_process(&station.realtime);
        let system = |what: &'static str| move |error: std::io::Error| Failure::system(what, &error);
        let (to_broker, fed) = ob1_broker::feed();
        keep_secret(station)?;
        let listeners = listen(station, rundir.path())?;
        let scan = Arc::new(ScanState::new(cpu.module_count()));
        let runs = {
            let scan = Arc::clone(&scan);
            move || scan.state() != OperatingState::Stop
        };
        let path = std::path::absolute(&options.station).ok();
        let download = Downloading { station: path, ..download }.start(runs);
        let (loader, newcomers) = download.map_err(system("the thread for downloads"))?;
        let _ = view.loads.set(loader.loads());
        let facts = StationFacts::new(view.clone(), station, loader);
        let (broker, door, links) = open_doors(station, &mut cpu, fed, facts, clock, (listeners, &rundir.socket()))
            .map_err(system("the broker"))?;
        let server = Server::start(&rundir.socket(), door, view.clone(), station.cpu.min_cycle)
            .map_err(system("the control socket"))?;
        let recordings = Recordings::start(
            cpu.recording_client(),
            own_door(&broker.handle(), 1 + station.links.len()).map_err(system("a door of the broker"))?,
            &view,
            station,
            rundir.path(),
        );
        let recordings = recordings.map_err(system("recordings"))?;
        for (index, link) in station.links.iter().enumerate() {
            if let Some(cp) = &link.cp {
                fleet.hand_over(cp, door_for_each(broker.handle(), index + 1));
            }
        }
        let fleet = fleet.start(clock).map_err(system("the drivers"))?;
        let (observer, late) =
            Observer::start(view.timings.clone(), station.realtime.affinity.clone()).map_err(system("the observer"))?;
        let (to_run, entries) = ob1_broker::feed();
        let journal = Journal::new(entries);
        let (attention, log, position) = (cpu.attention(), cpu.log_reader(), cpu.position());
        last_words::prepare(io.clone(), Arc::clone(&running), Arc::clone(&position)).map_err(system("signals"))?;
        let compiling = compile.map(|request| Compiling::start(request, cpu.plan(), &view.engine)).transpose();
        let (compiling, successors) = compiling.map_err(system("the thread that compiles"))?.unzip();
        cpu.follow(scan.follower([to_run, to_broker]));
        let thread = Scan {
            cpu,
            clock,
            shared: Arc::clone(&scan),
            realtime: station.realtime.clone(),
            grants,
            posture: Arc::clone(&view.posture),
            limit: options.scans,
            fence: options.fence,
            retentive,
            late,
            guard: io.as_ref().map(|io| io.guard().clone()),
            successors,
            newcomers: Some(newcomers),
            engine: Arc::clone(&view.engine),
        }
        .start()
        .map_err(system("the scan thread"))?;
        let seen = (Arc::clone(&scan), position, Arc::clone(&view.stands));
        let monitor = Monitor::start(seen, Arc::clone(&running), io.clone(), station.cpu.watchdog);
        let monitor = monitor.map_err(system("the monitor"))?;
        Ok(Self {
            view,
            scan,
            attention,
            log,
            journal,
            block: running,
            io,
            min_cycle: station.cpu.min_cycle,
            thread: Some(thread),
            monitor: Some(monitor),
            compiling,
            observer: Some(observer),
            keeper,
            server: Some(server),
            recordings: Some(recordings),
            broker: Some(broker),
            links: Some(links),
            fleet: Some(fleet),
            rundir,
            rundir_told: false,
            _guardian: guardian,
            clock,
            fence: options.fence,
            _awake: awake,
        })
    }

    /// Waits for the end: a signal, the time, the scans, or a fault in a run that has an end.
    pub(super) fn watch(&mut self, signals: &Signals, options: &Options) -> Ended {
        let line = LiveLine::new(options.quiet);
        let bounded = options.time.is_some() || options.scans.is_some();
        let end = options.time.map(|time| self.clock.time().saturating_add(time));
        let (mut ticks, mut posture_is_told) = (0_u64, false);
        let mut reasons = ReasonLog::default();
        let ended = loop {
            self.drain_log();
            self.tell_posture(&mut posture_is_told, &options.station);
            self.journal.take(&self.view);
            self.view.forces.tend();
            if signals.wait(TICK) {
                break Ended::Signal;
            }
            if self.io.as_ref().is_some_and(|io| io.guard().is_taken()) {
                tracing::error!("the station stood still; its guardian has set the outputs to their safe state");
                break Ended::StoodStill;
            }
            if self.thread.as_ref().is_some_and(JoinHandle::is_finished) {
                break Ended::Fault;
            }
            if self.scan.limit_reached() {
                break Ended::Scans;
            }
            if end.is_some_and(|end| self.clock.time() >= end) {
                break Ended::Time;
            }
            let stopped = self.scan.has_started() && self.scan.state() == OperatingState::Stop;
            if bounded && stopped && self.journal.fault().is_some() {
                break Ended::Fault;
            }
            ticks += 1;
            if line.is_on() && ticks.is_multiple_of(LIVE_TICKS) {
                line.show(&self.live());
            }
            if ticks.is_multiple_of(SECOND_TICKS) {
                self.look_after_directory();
                reasons.look(&self.view);
            }
        };
        line.wipe();
        self.tell_posture(&mut posture_is_told, &options.station);
        ended
    }

    /// Reports once what the system refuses the scan, as soon as it is known.
    fn tell_posture(&self, is_told: &mut bool, file: &Path) {
        if !*is_told && let Some(grants) = self.view.posture.get() {
            posture::tell(grants, &file.display().to_string());
            *is_told = true;
        }
    }

    /// Others may have removed the runtime directory or something in it: the station stays within reach of its tools.
    fn look_after_directory(&mut self) {
        let restored = match self.rundir.restore() {
            Ok(false) => {
                self.rundir_told = false;
                return;
            }
            Ok(true) => self.open_socket().map_err(|error| error.to_string()),
            Err(error @ RunDirError::Running { .. }) => Err(format!("another run has taken it: {error}")),
            Err(error) => Err(error.to_string()),
        };
        let path = self.rundir.path().display();
        match restored {
            Ok(()) => tracing::warn!(
                "others have removed {path} or something in it; it is there again: keep it out of what cleans up \
                 (docs/access.md)"
            ),
            Err(why) if !self.rundir_told => {
                tracing::error!("others have removed {path} or something in it, and it cannot be made again: {why}");
                self.rundir_told = true;
            }
            Err(_) => {}
        }
    }

    /// Opens the control socket again where it is missing.
    fn open_socket(&mut self) -> std::io::Result<()> {
        if std::fs::symlink_metadata(self.rundir.socket()).is_ok() {
            return Ok(());
        }
        // Its thread removes the name when it ends.
        drop(self.server.take());
        if let Some(broker) = &self.broker {
            let door = own_door(&broker.handle(), 0)?;
            self.server = Some(Server::start(&self.rundir.socket(), door, self.view.clone(), self.min_cycle)?);
        }
        Ok(())
    }

    /// What blocks have logged.
    fn drain_log(&mut self) {
        while let Some(entry) = self.log.as_mut().and_then(LogReader::take) {
            let (time, text) = (entry.time.since_start().as_secs_f64(), entry.text());
            match entry.level {
                0 | 1 => tracing::error!("block, {time:.6} s: {text}"),
                2 => tracing::warn!("block, {time:.6} s: {text}"),
                _ => tracing::info!("block, {time:.6} s: {text}"),
            }
        }
    }

    fn live(&self) -> String {
        let seconds = self.clock.time().since_start().as_secs_f64();
        let state = self.scan.state().name();
        let mut text = format!("{state:<7} {seconds:8.1} s   {} scans", self.scan.scans());
        for module in &self.view.modules {
            let (Some(monitor), Some(driver)) = (&module.monitor, &module.driver) else { continue };
            let counters = monitor.counters();
            let (sent, received, errors) = (
                counters.get(ob1_backplane::Counter::TelegramsSent),
                counters.get(ob1_backplane::Counter::TelegramsReceived),
                counters.get(ob1_backplane::Counter::SendErrors),
            );
            text += &format!("   {}: {sent} sent, {received} received, {errors} errors", module.name);
            if driver.losses() > 0 {
                text += &format!(", driver died {}", driver.losses());
            }
        }
        text
    }

    /// STOP, last figures, then everything is ended, in order.
    pub(super) fn stop(mut self, ended: Ended) -> Result<(Report, Exit), Failure> {
        let died = self.thread.take_if(|thread| thread.is_finished()).map(JoinHandle::join);
        let died = died.map(|result| match result {
            Ok(Err(text)) => Failure(Exit::System, format!("ob1: {text}\n")),
            _ => Failure(Exit::Fault, "ob1: the scan thread has ended by a panic\n".into()),
        });
        if let Some(failure) = died.or_else(|| self.halt().err()) {
            self.outputs_off();
            self.journal.take(&self.view);
            return Err(failure);
        }
        self.read_journal();
        // Its last look explains what is not explained yet.
        drop(self.observer.take());
        self.journal.take(&self.view);
        let (diagnostics, fault) = (self.journal.diagnostics(&self.view), self.journal.fault());
        let exit = match ended {
            Ended::StoodStill => Exit::StoodStill,
            _ if fault.is_some() => Exit::Fault,
            _ => Exit::Ok,
        };
        let status = self.view.status(self.scan.state(), &self.scan.present());
        let timing = self.view.timings.snapshot(true);
        // The last image comes out of a cycle in STOP.
        drop(self.keeper.take());
        self.scan.finish();
        drop(self.monitor.take());
        drop(self.compiling.take());
        if !self.fence
            && let Some(thread) = self.thread.take()
        {
            let _ = thread.join();
        }
        self.outputs_off();
        self.drain_log();
        drop(self.server.take());
        drop(self.recordings.take());
        // A process that finds its door closed ends by itself.
        if let Some(links) = &mut self.links {
            links.expect_the_end();
        }
        drop(self.broker.take());
        drop(self.links.take());
        if let Some(fleet) = self.fleet.take() {
            fleet.stop();
        }
        Ok((Report::new(ended, exit, fault, status, diagnostics, timing), exit))
    }

    /// Sends the CPU to STOP and waits for it.
    fn halt(&self) -> Result<(), Failure> {
        self.attention.halt();
        let looks = STOP_TIME.saturating_add(self.min_cycle.times(2)) / LOOK;
        for _ in 0..looks {
            if self.scan.state() == OperatingState::Stop {
                return Ok(());
            }
            std::thread::sleep(LOOK.into());
        }
        let block = self.block.block().map_or_else(|| "the program".to_owned(), |b| format!("native block {b}"));
        Err(Failure(Exit::Hung, format!("ob1: {block} does not return; outputs are off\n")))
    }

    /// The CPU does this in STOP; here it is done for a CPU that never got there, and for programs that keep the image
    /// mapped.
    fn outputs_off(&self) {
        if let Some(io) = &self.io {
            io.switch_off();
        }
    }

    /// Takes all entries up to the last cycle, which was in STOP.
    fn read_journal(&mut self) {
        let wanted = self.scan.entries();
        for _ in 0..STOP_TIME / LOOK {
            self.journal.take(&self.view);
            if self.journal.newest() >= wanted {
                return;
            }
            std::thread::sleep(LOOK.into());
        }
    }
}

/// Checks that passwords and keys of links are there, and that nobody else can read them.
fn keep_secret(station: &Station) -> Result<(), Failure> {
    let refused = |link: &StationLink, file: &Path, why: &str, remedy: &str| {
        let (name, file) = (&link.name, file.display());
        Failure(
            Exit::System,
            format!("ob1: link \"{name}\": {file} {why}\n  = {}\n", remedy.replace("FILE", &file.to_string())),
        )
    };
    for link in &station.links {
        for file in &link.secrets {
            match std::fs::metadata(file) {
                Err(error) => {
                    let remedy = if is_of_users(link, file) {
                        "users are made by `ob1-gate user add FILE NAME --rights write`"
                    } else {
                        "correct its name in the station file, or put it there with mode 600 (docs/web.md, docs/mqtt.md)"
                    };
                    return Err(refused(link, file, &format!("cannot be read: {error}"), remedy));
                }
                Ok(about) if about.mode() & 0o077 != 0 => {
                    let why = format!("can be read by others (mode {:03o})", about.mode() & 0o777);
                    return Err(refused(link, file, &why, "chmod 600 FILE"));
                }
                Ok(_) => {}
            }
        }
    }
    Ok(())
}

/// Of the files of a link that nobody else may read, this one holds its users.
fn is_of_users(link: &StationLink, file: &Path) -> bool {
    matches!(&link.settings, LinkSettings::Gate(told) if told.users.as_deref() == Some(file))
}

/// A CP 343 is started as the driver of its module: each process of it gets a door of its own.
fn door_for_each(broker: Handle, link: usize) -> HandOver {
    Box::new(move || {
        let (ours, theirs) = handover::pair()?;
        broker.connect(link, ours);
        Ok(theirs)
    })
}

/// What the process of a link is told. An S7 link has a tap; a page that may show everything learns where the drivers
/// publish what goes over their lines.
fn with_taps(link: &StationLink, control_socket: &Path) -> LinkSettings {
    let mut settings = link.settings.clone();
    match &mut settings {
        LinkSettings::S7(told) => told.tap = true,
        LinkSettings::Gate(told) => match &mut told.own {
            GateKind::Web(told) if link.allowed == Allowed::default() => {
                told.taps = control_socket.parent().map(Path::to_owned);
            }
            _ => {}
        },
    }
    settings
}

/// Starts the broker and the processes of the links; the door is that of the control socket.
fn open_doors(
    station: &Station,
    cpu: &mut Cpu,
    entries: FeedEnd,
    facts: StationFacts,
    clock: MonotonicClock,
    (listeners, control_socket): (Vec<Vec<OwnedFd>>, &Path),
) -> std::io::Result<(RunningBroker, Door, Links)> {
    // Whoever may open the control socket is the user who runs the station.
    let control = LinkConfig { rights: Right::Operate, ..LinkConfig::default() };
    let of = |(link, listeners): (&StationLink, Vec<OwnedFd>)| {
        assembly::link_config(link, &with_taps(link, control_socket), listeners)
    };
    // The last one hears what happens, for recordings.
    let (hearing, all) = (LinkConfig::default(), std::iter::once(control));
    let configs = all.chain(station.links.iter().zip(listeners).map(of)).chain([hearing]).collect();
    let broker = Broker::new(cpu, configs, entries, Box::new(facts))?;
    let mut specs: Vec<LinkSpec> = Vec::with_capacity(station.links.len());
    for (index, (link, beats)) in station.links.iter().zip(broker.beats().into_iter().skip(1)).enumerate() {
        if link.cp.is_some() {
            continue;
        }
        let program = find_program(link.kind.program()).map_err(std::io::Error::other)?;
        let (door, several) = ((index + 1, beats), link.kind.shares_its_process());
        match specs.iter_mut().find(|spec| several && spec.program == program) {
            Some(spec) => spec.doors.push(door),
            None => {
                let name = if several { link.kind.program() } else { &link.name };
                specs.push(LinkSpec { name: name.to_owned(), program, doors: vec![door], several });
            }
        }
    }
    let broker = broker.start(clock)?;
    let links = Links::start(specs, &broker.handle())?;
    let door = own_door(&broker.handle(), 0)?;
    Ok((broker, door, links))
}

/// A door for a part of the runtime itself: the control socket is the first link, recordings are the last.
fn own_door(broker: &Handle, link: usize) -> std::io::Result<Door> {
    let (ours, theirs) = handover::pair()?;
    broker.connect(link, ours);
    Door::new(theirs).map_err(std::io::Error::other)
}

/// Reads retentive memory, and starts writing it, where the station file wants that.
fn keep(station: &Station, cpu: &mut Cpu, view: &StationView) -> Result<(Option<Keeper>, Option<ScanEnd>), Failure> {
    let (Some(file), Some(health)) = (&station.retentive, &view.retentive) else { return Ok((None, None)) };
    let (store, told) = retentive::restore(file, &station.name, cpu).map_err(|error| {
        let (exit, remedy) = match error {
            StoreError::InUse { .. } => (Exit::Running, "end the other one, or give this one another `state` folder"),
            StoreError::Folder { .. } => (Exit::System, "name a folder this user can write to: `state` in [station]"),
        };
        Failure(exit, format!("ob1: {error}\n  = {remedy}\n"))
    })?;
    for text in told {
        tracing::warn!("retentive memory: {text}");
    }
    let started = Keeper::start(store, file.every, cpu.retentive_len(), health.clone());
    let (keeper, scan) = started.map_err(|e| Failure::system("retentive memory", &e))?;
    Ok((Some(keeper), Some(scan)))
}
