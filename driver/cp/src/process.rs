//! The loop of the process: wait for the doorbell, the line or a time, pump, wait again.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{self, Duration};

use ob1_backplane::CpSide;
use ob1_cp::{Change, CpPump, HEARTBEAT, Presence};
use ob1_firmware::{Instant, LineFault, LineInput, ModemLines, Span};
use ob1_line::{ECHOES, LineEvent, PollFds, RealLine, SILENT};
use ob1_process::doorbell_closed;
use ob1_serial::tap_record::Kind;
use rustix::event::{PollFd, PollFlags};
use rustix::io::Errno;
use rustix::time::{ClockId, clock_gettime};
use tracing::{info, warn};

use crate::process_line::ProcessLine;

/// Passes without system calls, while the CPU side keeps changing things, before line and doorbell are checked.
const PASSES: u32 = 16;

/// A process that wakes up this much late was held up by the system.
const HELD_UP: Span = Span::from_millis(5);

/// Events of the line in one pass: then come the heartbeat and the CPU. A partner that sends as fast as it is read must
/// not block the driver.
const EVENTS: u32 = 32;

/// Received bytes handed over at a time.
const BUFFER: usize = 256;

/// Why the loop has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ended {
    /// The doorbell is closed: the runtime is gone, or wants the driver to be.
    Closed,
    /// A signal has come.
    Terminated,
}

/// What is ready after a wait.
#[derive(Debug, Default, Clone, Copy)]
struct Ready {
    doorbell: bool,
    line: bool,
    /// A listener wants to connect.
    tap: bool,
}

pub(crate) struct Process {
    pump: CpPump,
    port: ProcessLine,
    start: time::Instant,
    spin: Duration,
    terminate: Arc<AtomicBool>,
    presence: Presence,
    modem: Option<ModemLines>,
    modem_at: Instant,
    /// Lost log lines that are counted in the segment.
    log_lost: u64,
}

impl Process {
    pub(crate) fn new(segment: CpSide, spin: Duration, terminate: Arc<AtomicBool>) -> Self {
        let mut pump = CpPump::new(segment);
        let (now, start) = (clock_gettime(ClockId::Monotonic), time::Instant::now());
        pump.set_origin(now.tv_sec.unsigned_abs() * 1_000_000_000 + now.tv_nsec.unsigned_abs());
        Self {
            pump,
            port: ProcessLine::default(),
            start,
            spin,
            terminate,
            presence: Presence::default(),
            modem: None,
            modem_at: Instant::START,
            log_lost: 0,
        }
    }

    fn now(&self) -> Instant {
        Instant::START + self.start.elapsed().into()
    }

    pub(crate) fn run(&mut self) -> Result<Ended, Errno> {
        let mut passes = 0;
        // Whether the CPU side has changed something since the last wait.
        let mut changed = false;
        loop {
            let now = self.now();
            changed |= self.pump.has_changes();
            self.pump.poll(now, &mut self.port);
            let more = self.line_events(now);
            let lost = ob1_process::log::lost();
            self.pump.count_lost_log(lost - std::mem::replace(&mut self.log_lost, lost));
            // Line events may have moved the deadline, and the pump's own work the registers.
            let deadline = self.pump.poll(now, &mut self.port);
            let line = self.port.line.as_ref().and_then(RealLine::deadline).unwrap_or(Instant::NEVER);

            if changed && self.changes_soon() || !self.pump.prepare_sleep() {
                passes += 1;
                if passes < PASSES {
                    continue;
                }
                self.pump.awake();
            }
            let due = deadline.min(line).min(self.presence.deadline().unwrap_or(Instant::NEVER));
            let timeout = if passes >= PASSES || more { Span::ZERO } else { due.since(self.now()) };
            (passes, changed) = (0, false);
            let ready = self.wait(timeout)?;
            self.pump.awake();
            if self.terminate.load(Ordering::Relaxed) {
                return Ok(Ended::Terminated);
            }
            if ready.tap {
                let now = self.now();
                self.port.tap.admit(now);
            }
            if ready.line
                && let Some(line) = &mut self.port.line
            {
                line.ready();
                // A process that was held up finds expired times, and also the answer that came in time: then the line
                // comes first. Otherwise the times come first: an expired silence has ended the telegram before it.
                let now = self.now();
                if now.since(due) > HELD_UP {
                    self.line_events(now);
                }
            }
            if ready.doorbell {
                // First the work, because the CPU side waits for it. A ring for a later change may be swallowed with
                // this one; `prepare_sleep` then finds that change.
                let now = self.now();
                changed = self.pump.has_changes();
                self.pump.poll(now, &mut self.port);
                if doorbell_closed()? {
                    return Ok(Ended::Closed);
                }
            }
        }
    }

    /// Spins briefly after a change: a CPU in the middle of a telegram often answers at once, and a sleep costs more.
    fn changes_soon(&self) -> bool {
        if self.spin.is_zero() {
            return false;
        }
        let end = time::Instant::now() + self.spin;
        loop {
            if self.pump.has_changes() {
                return true;
            }
            if time::Instant::now() >= end {
                return false;
            }
            std::hint::spin_loop();
        }
    }

    fn wait(&self, timeout: Span) -> Result<Ready, Errno> {
        let stdin = rustix::stdio::stdin();
        let mut line = PollFds::default();
        if let Some(real) = &self.port.line {
            real.poll_fds(&mut line);
        }
        let mut fds: Vec<PollFd<'_>> = Vec::with_capacity(4);
        fds.push(PollFd::new(&stdin, PollFlags::IN));
        fds.extend(line.into_entries());
        let lines = fds.len();
        fds.extend(self.port.tap.fd(self.now()).map(|fd| PollFd::from_borrowed_fd(fd, PollFlags::IN)));
        ob1_process::wait(&mut fds, timeout)?;
        Ok(Ready {
            doorbell: fds.first().is_some_and(|fd| !fd.revents().is_empty()),
            line: fds.iter().take(lines).skip(1).any(|fd| !fd.revents().is_empty()),
            tap: fds.iter().skip(lines).any(|fd| !fd.revents().is_empty()),
        })
    }

    /// Takes the events of the line; true if there may be more.
    fn line_events(&mut self, now: Instant) -> bool {
        let mut buffer = [0; BUFFER];
        let mut more = true;
        for _ in 0..EVENTS {
            let Some(line) = &mut self.port.line else { return false };
            let Some(event) = line.next_event(now, &mut buffer) else {
                more = false;
                break;
            };
            match event {
                LineEvent::Input(input) => self.hear(now, input),
                LineEvent::Up(warnings) => {
                    info!("the line is up");
                    self.port.tap.tell(now, Kind::Up, &[]);
                    for warning in warnings {
                        warn!("{warning}");
                    }
                    self.modem = None;
                    self.line_is_up(now);
                }
                LineEvent::Gone(reason) => {
                    let errno = self.port.line.as_ref().and_then(RealLine::errno).unwrap_or(0);
                    warn!(reason, errno, "the line is gone");
                    self.port.tap.tell(now, Kind::Gone, reason.as_bytes());
                    self.pump.line_error(now, errno, &reason);
                    self.line_is_gone(now);
                }
                LineEvent::Echo(on) => {
                    if on {
                        warn!("{ECHOES}");
                    } else {
                        info!("{SILENT}");
                    }
                    self.pump.line_echo(now, on.then_some(ECHOES));
                }
            }
        }
        // A connection that is still being made: nothing may count as sent on it.
        if self.port.line.as_ref().is_some_and(|line| !line.is_up()) {
            self.line_is_gone(now);
        }
        self.sample_modem(now);
        more
    }

    fn hear(&mut self, now: Instant, input: LineInput<'_>) {
        self.port.tap.hear(now, input);
        self.pump.line_event(now, input, &mut self.port);
    }

    fn line_is_gone(&mut self, now: Instant) {
        let change = self.presence.absent(now);
        self.tell(now, change);
    }

    fn line_is_up(&mut self, now: Instant) {
        let change = self.presence.present();
        self.tell(now, change);
    }

    fn tell(&mut self, now: Instant, change: Option<Change>) {
        let fault = match change {
            Some(Change::NotYet) => {
                self.pump.no_line(now, &mut self.port);
                return;
            }
            Some(Change::Gone) => LineFault::Gone,
            Some(Change::Back) => LineFault::Back,
            None => return,
        };
        self.pump.line_event(now, LineInput::Fault(fault), &mut self.port);
    }

    /// Modem lines cannot be polled for; they are sampled with the heartbeat, if there are any.
    fn sample_modem(&mut self, now: Instant) {
        if now < self.modem_at {
            return;
        }
        self.modem_at = now + HEARTBEAT;
        let Some(lines) = self.port.line.as_mut().and_then(RealLine::modem_lines) else { return };
        if self.modem != Some(lines) {
            self.modem = Some(lines);
            self.hear(now, LineInput::Modem(lines));
        }
    }
}
