//! The loop of the process: wait for the doorbell, the lines or a time; pass the events to the masters; publish the
//! image.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time;

use ob1_backplane::{BusMemory, BusSize, Counter, CpSide};
use ob1_coupler::{BusConfig, Input};
use ob1_io::Pump;
use ob1_line::{Instant, PollFds, Span};
use rustix::event::{PollFd, PollFlags};
use tracing::warn;

use crate::bus_log::Told;
use crate::gpio::Gpio;
use crate::line::Line;

/// Time for switching off the outputs of the couplers at the end.
const LAST_OUTPUTS: Span = Span::from_millis(500);

/// The process of a bus: its lines and chips, and the image they share.
pub(crate) struct Process {
    start: time::Instant,
    pump: Pump,
    lines: Vec<Line>,
    chips: Vec<Gpio>,
    told: Told,
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
        trace: Option<&Path>,
    ) -> io::Result<Self> {
        let mut lines = Vec::new();
        let mut first = 0;
        let mut chips = Vec::new();
        for line in &config.lines {
            if let Some(gpio) = Gpio::new(line, first) {
                chips.push(gpio);
                first += 1;
                continue;
            }
            let mut opened = Line::new(line, first, config.input_bytes)?;
            if let Some(folder) = trace {
                let name = config.line_name(lines.len());
                opened.open_tap(&folder.join(format!("{name}.trace")), &name, line);
            }
            lines.push(opened);
            first += line.stations().count();
        }
        Ok(Self {
            start: time::Instant::now(),
            pump: Pump::new(config, segment, memory, size, Instant::START),
            lines,
            chips,
            told: Told::new(config),
            terminate,
            log_lost: 0,
        })
    }

    fn now(&self) -> Instant {
        Instant::START + self.start.elapsed().into()
    }

    /// Runs until standard input closes, or until SIGTERM.
    pub(crate) fn run(&mut self) -> io::Result<()> {
        loop {
            let seen = self.pump.segment.changes();
            let more = self.pass(true);
            let asleep = self.pump.segment.prepare_sleep(seen);
            let timeout = if more || !asleep { Span::ZERO } else { self.deadline().since(self.now()) };
            let ready = self.wait(timeout, true)?;
            self.pump.segment.awake();
            if self.terminate.load(Ordering::Relaxed) || ready && ob1_process::doorbell_closed()? {
                return self.end();
            }
        }
    }

    /// One pass over everything; true if a line may have more events. `beats`: the scan decides about the outputs.
    fn pass(&mut self, beats: bool) -> bool {
        let now = self.now();
        let lost = ob1_process::log::lost();
        self.pump.segment.count(Counter::LogLost, lost - std::mem::replace(&mut self.log_lost, lost));
        let changed = beats && self.pump.look_at_scan(now);
        let mut more = false;
        for line in &mut self.lines {
            more |= line.events(now, &mut self.pump.image);
            if changed || now >= line.deadline {
                line.step(now, Input::Tick, &mut self.pump.image);
            }
        }
        for chip in &mut self.chips {
            if changed || now >= chip.deadline {
                chip.step(now, &mut self.pump.image);
            }
        }
        self.told.look(&self.pump.image, time::Instant::now());
        self.pump.show(now);
        more
    }

    fn deadline(&self) -> Instant {
        let line = |line: &Line| line.deadline.min(line.real.deadline().unwrap_or(Instant::NEVER));
        let chips = self.chips.iter().map(|chip| chip.deadline);
        self.lines.iter().map(line).chain(chips).fold(self.pump.deadline(), Instant::min)
    }

    /// Waits; true if standard input is readable.
    fn wait(&mut self, timeout: Span, doorbell: bool) -> io::Result<bool> {
        let stdin = rustix::stdio::stdin();
        let now = self.now();
        let mut fds = Vec::with_capacity(1 + 2 * self.lines.len());
        if doorbell {
            fds.push(PollFd::new(&stdin, PollFlags::IN));
        }
        // The line of each descriptor.
        let mut owners = Vec::with_capacity(fds.capacity());
        for (n, line) in self.lines.iter().enumerate() {
            let mut of_line = PollFds::default();
            line.real.poll_fds(&mut of_line);
            for fd in of_line.into_entries() {
                fds.push(fd);
                owners.push((n, false));
            }
            if let Some(fd) = line.tap.fd(now) {
                fds.push(PollFd::from_borrowed_fd(fd, PollFlags::IN));
                owners.push((n, true));
            }
        }
        ob1_process::wait(&mut fds, timeout)?;
        let rung = doorbell && fds.first().is_some_and(|fd| !fd.revents().is_empty());
        let ready: Vec<bool> = fds.iter().skip(usize::from(doorbell)).map(|fd| !fd.revents().is_empty()).collect();
        drop(fds);
        let now = self.now();
        for ((n, calls), _) in owners.iter().zip(ready).filter(|(_, ready)| *ready) {
            match self.lines.get_mut(*n) {
                Some(line) if *calls => line.tap.admit(now),
                Some(line) => line.real.ready(),
                None => {}
            }
        }
        Ok(rung)
    }

    /// Switches the outputs off, as far as the couplers can be reached.
    fn end(&mut self) -> io::Result<()> {
        self.pump.image.driven = false;
        let until = self.now() + LAST_OUTPUTS;
        let mut changed = true;
        loop {
            let now = self.now();
            if std::mem::take(&mut changed) {
                for line in &mut self.lines {
                    line.step(now, Input::Tick, &mut self.pump.image);
                }
                for chip in &mut self.chips {
                    chip.step(now, &mut self.pump.image);
                }
            }
            let more = self.pass(false);
            if self.lines.iter().all(|line| line.master.has_told_outputs(&self.pump.image))
                && self.chips.iter().all(|chip| chip.master.is_off())
            {
                return Ok(());
            }
            if now >= until {
                warn!("not every coupler has confirmed that its outputs are off");
                return Ok(());
            }
            let timeout = if more { Span::ZERO } else { self.deadline().min(until).since(self.now()) };
            self.wait(timeout, false)?;
        }
    }
}
