//! The loop of the process: wait for the doorbell, the lines or a time; hand what has happened to the masters; publish
//! the image.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use ob1_backplane::{BusMemory, BusProcessSide, BusSize, Counter, CpSide, DriverState};
use ob1_coupler::config::Parity;
use ob1_coupler::{BusConfig, Image, Input, LineConfig, LineFault, LineInput, LineMaster, MasterInput};
use ob1_line::{LineEvent, LineSettings, LineSpec, Nanos, PollFds, RealLine, StopBits};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use tracing::{info, warn};

use crate::told::Told;

/// Time between two beats; an image is published at least as often.
const HEARTBEAT: Nanos = 50_000_000;
/// At the end the couplers get so long to take their outputs off.
const LAST_OUTPUTS: Nanos = 500_000_000;
/// Events of a line in one pass: then the heart beats, and the others have their turn.
const EVENTS: u32 = 32;
/// Received bytes handed over at a time.
const BUFFER: usize = 512;

/// A line, and who is on it.
struct Line {
    spec: LineSpec,
    settings: LineSettings,
    real: RealLine,
    master: LineMaster,
    deadline: Nanos,
    /// Whether it was up when it was last told of it.
    up: bool,
}

/// The process.
pub(crate) struct Process {
    start: Instant,
    segment: CpSide,
    side: BusProcessSide,
    lines: Vec<Line>,
    image: Image,
    told: Told,
    /// The generation of the image that was published last.
    published: u64,
    next_beat: Nanos,
    /// The scan's last sign of life, and since when there was none.
    scan: (u64, Nanos),
    alive: bool,
    scan_timeout: Nanos,
    /// What the CPU has said of the outputs.
    wanted: bool,
    terminate: Arc<AtomicBool>,
    log_lost: u64,
}

impl Process {
    pub(crate) fn new(
        config: &BusConfig,
        segment: CpSide,
        memory: &BusMemory,
        size: BusSize,
        terminate: Arc<AtomicBool>,
    ) -> io::Result<Self> {
        let mut lines = Vec::new();
        let mut first = 0;
        for line in &config.lines {
            lines.push(Line::new(line, first, config.input_bytes)?);
            first += line.couplers.len();
        }
        Ok(Self {
            start: Instant::now(),
            segment,
            side: BusProcessSide::new(memory, size),
            lines,
            image: Image::new(config),
            told: Told::new(config),
            published: 0,
            next_beat: 0,
            scan: (0, 0),
            alive: true,
            scan_timeout: config.scan_timeout,
            wanted: false,
            terminate,
            log_lost: 0,
        })
    }

    fn now(&self) -> Nanos {
        u64::try_from(self.start.elapsed().as_nanos()).unwrap_or(Nanos::MAX)
    }

    /// Until standard input closes, or SIGTERM.
    pub(crate) fn run(&mut self) -> io::Result<()> {
        self.publish();
        self.segment.set_state(DriverState::Ready);
        loop {
            let seen = self.segment.changes();
            let more = self.pass(true);
            let asleep = self.segment.prepare_sleep(seen);
            let timeout = if more || !asleep { 0 } else { self.deadline().saturating_sub(self.now()) };
            let ready = self.wait(timeout, true)?;
            self.segment.awake();
            if self.terminate.load(Ordering::Relaxed) || ready && ob1_child::doorbell_closed()? {
                return self.end();
            }
        }
    }

    /// One look at everything; whether a line may have more to tell. `beats`: the scan decides about the outputs.
    fn pass(&mut self, beats: bool) -> bool {
        let now = self.now();
        let lost = ob1_log::lost();
        self.segment.count(Counter::LogLost, lost - std::mem::replace(&mut self.log_lost, lost));
        let changed = beats && self.look_at_scan(now);
        let mut more = false;
        for line in &mut self.lines {
            more |= line.events(now, &mut self.image);
            if changed || now >= line.deadline {
                line.step(now, Input::Tick, &mut self.image);
            }
        }
        self.told.look(&self.image);
        if now >= self.next_beat {
            self.segment.beat();
            self.next_beat = now + HEARTBEAT;
            self.publish();
        } else if self.image.generation != self.published {
            self.publish();
        }
        more
    }

    /// What the scan wants of the outputs, and whether it is alive; whether anything is another than before.
    fn look_at_scan(&mut self, now: Nanos) -> bool {
        let mut changed = false;
        if let Some(driven) = self.side.take(&mut self.image.outputs) {
            (self.wanted, changed) = (driven, true);
        }
        let beats = self.segment.cpu_heartbeat();
        if beats != self.scan.0 {
            self.scan = (beats, now);
        }
        let alive = now.saturating_sub(self.scan.1) < self.scan_timeout;
        if self.wanted && alive != std::mem::replace(&mut self.alive, alive) {
            if alive {
                info!("the scan gives a sign of life again: outputs on");
            } else {
                warn!("the scan gives no sign of life: outputs off");
            }
        }
        let driven = self.wanted && alive;
        if driven != self.image.driven {
            (self.image.driven, changed) = (driven, true);
        }
        changed
    }

    fn publish(&mut self) {
        self.published = self.image.generation;
        self.side.publish(self.image.status.iter().map(|status| status.to_words()), &self.image.inputs);
    }

    fn deadline(&self) -> Nanos {
        let line = |line: &Line| line.deadline.min(line.real.deadline().unwrap_or(Nanos::MAX));
        self.lines.iter().map(line).fold(self.next_beat, Nanos::min)
    }

    /// Waits; whether standard input has something to say.
    fn wait(&mut self, timeout: Nanos, doorbell: bool) -> io::Result<bool> {
        let stdin = rustix::stdio::stdin();
        let mut fds = Vec::with_capacity(1 + 2 * self.lines.len());
        if doorbell {
            fds.push(PollFd::new(&stdin, PollFlags::IN));
        }
        // Which line each descriptor belongs to.
        let mut owners = Vec::with_capacity(fds.capacity());
        for (n, line) in self.lines.iter().enumerate() {
            let mut of_line = PollFds::default();
            line.real.poll_fds(&mut of_line);
            for fd in of_line.into_entries() {
                fds.push(fd);
                owners.push(n);
            }
        }
        let timeout = Timespec { tv_sec: (timeout / 1_000_000_000) as i64, tv_nsec: (timeout % 1_000_000_000) as i64 };
        match poll(&mut fds, Some(&timeout)) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
        let rung = doorbell && fds.first().is_some_and(|fd| !fd.revents().is_empty());
        let ready: Vec<bool> = fds.iter().skip(usize::from(doorbell)).map(|fd| !fd.revents().is_empty()).collect();
        drop(fds);
        for (n, _) in owners.iter().zip(ready).filter(|(_, ready)| *ready) {
            if let Some(line) = self.lines.get_mut(*n) {
                line.real.ready();
            }
        }
        Ok(rung)
    }

    /// The outputs off, as far as the couplers can be reached.
    fn end(&mut self) -> io::Result<()> {
        self.image.driven = false;
        let until = self.now() + LAST_OUTPUTS;
        let mut changed = true;
        loop {
            let now = self.now();
            if std::mem::take(&mut changed) {
                for line in &mut self.lines {
                    line.step(now, Input::Tick, &mut self.image);
                }
            }
            let more = self.pass(false);
            if self.lines.iter().all(|line| line.master.has_told_outputs(&self.image)) {
                return Ok(());
            }
            if now >= until {
                warn!("not every coupler has taken that its outputs are off");
                return Ok(());
            }
            let timeout = if more { 0 } else { self.deadline().min(until).saturating_sub(self.now()) };
            self.wait(timeout, false)?;
        }
    }
}

impl Line {
    fn new(config: &LineConfig, first: usize, input_bytes: usize) -> io::Result<Self> {
        let spec: LineSpec = config.line.parse().map_err(|error| io::Error::other(format!("{error}")))?;
        let settings = settings(config);
        let real = open(&spec, &settings)?;
        let master = LineMaster::new(config, first, input_bytes, 0);
        Ok(Self { spec, settings, real, master, deadline: 0, up: false })
    }

    /// Takes what the line has to tell; true if that may not have been everything.
    fn events(&mut self, now: Nanos, image: &mut Image) -> bool {
        let mut buffer = [0; BUFFER];
        for _ in 0..EVENTS {
            let Some(event) = self.real.next_event(now, &mut buffer) else {
                return false;
            };
            match event {
                LineEvent::Rx(n) => {
                    let bytes = buffer.get(..n).unwrap_or_default();
                    tracing::trace!(rx = ?bytes);
                    self.step(now, Input::Line(LineInput::Rx(bytes)), image);
                }
                LineEvent::TxDone => self.step(now, Input::Line(LineInput::TxDone), image),
                LineEvent::Fault(fault) => self.step(now, Input::Line(LineInput::Fault(fault)), image),
                LineEvent::Up(warnings) => {
                    info!(line = %self.spec, "the line is up");
                    warnings.iter().for_each(|warning| warn!("{warning}"));
                    self.up = true;
                    self.step(now, Input::Line(LineInput::Fault(LineFault::Back)), image);
                }
                LineEvent::Gone(reason) => {
                    warn!(line = %self.spec, "the line is gone: {reason}");
                    self.gone(now, image);
                }
            }
        }
        true
    }

    fn gone(&mut self, now: Nanos, image: &mut Image) {
        if std::mem::take(&mut self.up) {
            self.step(now, Input::Line(LineInput::Fault(LineFault::Gone)), image);
        }
    }

    fn step(&mut self, now: Nanos, input: MasterInput<'_>, image: &mut Image) {
        let mut out = Vec::new();
        self.deadline = self.master.step(now, input, image, &mut out);
        if !out.is_empty() {
            tracing::trace!(tx = ?out);
            // One request at a time: there is always room for it.
            self.real.write(now, &out);
        }
        if self.master.wants_reconnect() {
            warn!(line = %self.spec, "no answer on this connection: it is opened anew");
            self.up = false;
            match open(&self.spec, &self.settings) {
                Ok(real) => self.real = real,
                Err(error) => warn!("{error}"),
            }
            self.step(now, Input::Line(LineInput::Fault(LineFault::Gone)), image);
        }
    }
}

fn open(spec: &LineSpec, settings: &LineSettings) -> io::Result<RealLine> {
    let mut real = RealLine::new(spec);
    real.apply(settings).map_err(|error| io::Error::other(format!("{error}")))?;
    Ok(real)
}

fn settings(config: &LineConfig) -> LineSettings {
    let Some(serial) = &config.serial else {
        // TCP: what it has of a line's times is not looked at.
        return LineSettings { baud: 4_000_000, ..LineSettings::default() };
    };
    LineSettings {
        baud: serial.baud,
        parity: match serial.parity {
            Parity::None => ob1_line::Parity::None,
            Parity::Even => ob1_line::Parity::Even,
            Parity::Odd => ob1_line::Parity::Odd,
        },
        stop_bits: if serial.stop_bits == 2 { StopBits::Two } else { StopBits::One },
        ..LineSettings::default()
    }
}
