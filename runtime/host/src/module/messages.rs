//! What a driver and its supervisor report, as entries of the diagnostic buffer. Made on the scan thread: no
//! allocation.
//!
//! A CP also reports its start-up, each repetition and each failed order; those are not entered here, where a noisy
//! line would push everything else out of the buffer. The CP itself lists and counts them, and says what it waits for
//! (docs/driver.md, "Events").

use std::fmt;

use ob1_backplane::{EventKind, Fault};
use ob1_cpu::ModuleEvent;
use ob1_model::Event;
use ob1_time::{Instant, Span};

use crate::fixed_text::FixedText;
use crate::supervisor::Report;

/// Numbers of a CP's messages, as `docs/driver.md` lists them.
mod code {
    pub(super) const WORKING: u32 = 2;
    pub(super) const NO_PARAMETERS: u32 = 3;
    pub(super) const LINE_GONE: u32 = 4;
    pub(super) const LINE_UP: u32 = 5;
    pub(super) const CONFIGURATION: u32 = 7;
    pub(super) const SEGMENT: u32 = 8;
    pub(super) const ECHO: u32 = 9;
}

/// Kinds of rule violations by a driver, each entered once in an incident.
const KINDS: usize = 8;
/// The kinds that are no [`Fault`].
const SEEN_BY_THE_CP: usize = 6;
const INTERRUPT_OFF: usize = 7;

/// Entries about line and parameters at once, and the time after which there may be one more: a line that comes and
/// goes all the time must not push everything else out of the buffer. The same for what a station of a bus refuses, or
/// reports of itself.
pub(crate) const STATES: (u32, Span) = (16, Span::from_secs(10));
/// Entries about lost events at once, and the time after which there may be one more.
const LOSSES: (u32, Span) = (1, STATES.1);
/// Diagnostic interrupts at once, and the time after which there may be one more.
pub(crate) const INTERRUPTS: (u32, Span) = (64, Span::from_millis(100));

/// So many at once, and one more each time a period has passed.
#[derive(Debug)]
pub(crate) struct Allowance {
    left: u32,
    full: u32,
    every: Span,
    /// The time up to which it has been filled.
    filled: Instant,
}

impl Allowance {
    pub(crate) const fn new((full, every): (u32, Span)) -> Self {
        Self { left: full, full, every, filled: Instant::START }
    }

    #[inline]
    pub(crate) fn fill(&mut self, now: Instant) {
        if self.left == self.full {
            self.filled = now;
        } else {
            self.refill(now);
        }
    }

    #[cold]
    fn refill(&mut self, now: Instant) {
        let more = now.since(self.filled) / self.every;
        self.filled += more * self.every;
        self.left = u32::try_from(more).map_or(self.full, |more| self.left.saturating_add(more).min(self.full));
        if self.left == self.full {
            self.filled = now;
        }
    }

    /// Whether there is one left.
    pub(crate) const fn is_left(&self) -> bool {
        self.left > 0
    }

    /// Takes one, if there is one left.
    pub(crate) fn take(&mut self) -> bool {
        let taken = self.left > 0;
        self.left -= u32::from(taken);
        taken
    }
}

/// Why a module has no valid parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Refused {
    Byte(u8),
    Configuration,
}

/// Something that comes and goes: its present state, and the one entered last.
#[derive(Debug)]
struct Told<T> {
    is: Option<T>,
    told: Option<T>,
    /// It has come again since it was entered.
    anew: bool,
}

impl<T: Copy + PartialEq> Told<T> {
    const NEVER: Self = Self { is: None, told: None, anew: false };

    fn comes(&mut self, what: T) {
        self.is = Some(what);
        self.anew = true;
    }

    fn goes(&mut self) {
        self.is = None;
        self.anew = false;
    }

    /// The present state, if it has not been entered.
    fn due(&mut self, allowance: &mut Allowance) -> Option<Option<T>> {
        let due = (self.anew || self.is != self.told) && allowance.take();
        due.then(|| {
            self.anew = false;
            self.told = self.is;
            self.is
        })
    }
}

/// What a module has to report, and what it has reported.
#[derive(Debug)]
pub(super) struct Messages {
    /// Diagnostic interrupts are enabled.
    diagnostics: bool,
    /// Entries about what a driver may not do.
    garbage: Option<ModuleEvent>,
    /// A diagnostic interrupt; the next ones stay in the segment as long as it is here.
    interrupt: Option<ModuleEvent>,
    interrupts: Allowance,
    /// The line is gone, with the system's error number.
    line: Told<u32>,
    refused: Told<Refused>,
    /// The line gives back what is sent.
    echo: Told<()>,
    states: Allowance,
    /// How many events the ring of the segment had no room for.
    lost: Told<u64>,
    losses: Allowance,
    /// What has been entered in this incident.
    told: [bool; KINDS],
    incident: u32,
}

impl Messages {
    pub(super) const fn new(diagnostics: bool) -> Self {
        Self {
            diagnostics,
            garbage: None,
            interrupt: None,
            interrupts: Allowance::new(INTERRUPTS),
            line: Told::NEVER,
            refused: Told::NEVER,
            echo: Told::NEVER,
            states: Allowance::new(STATES),
            lost: Told::NEVER,
            losses: Allowance::new(LOSSES),
            told: [false; KINDS],
            incident: 0,
        }
    }

    /// A scan begins: the limits of entries for each time are filled up.
    pub(super) fn time(&mut self, now: Instant) {
        self.interrupts.fill(now);
        self.states.fill(now);
        self.losses.fill(now);
    }

    /// The entry that is due.
    pub(super) fn due(&mut self) -> Option<ModuleEvent> {
        if self.garbage.is_some() {
            return self.garbage.take();
        }
        if self.interrupt.is_some() && self.interrupts.take() {
            return self.interrupt.take();
        }
        if let Some(Some(events)) = self.lost.due(&mut self.losses) {
            return Some(text(Event::CP_EVENTS_LOST, format_args!("{events} lost")));
        }
        if let Some(line) = self.line.due(&mut self.states) {
            return Some(match line.map(|errno| (errno, line_gone(errno))) {
                Some((_, Some(why))) => text(Event::CP_ERROR, format_args!("line: {why}")),
                Some((errno, None)) => text(Event::CP_ERROR, format_args!("line gone, os {errno}")),
                None => text(Event::CP_ERROR_GONE, format_args!("line up")),
            });
        }
        if let Some(echo) = self.echo.due(&mut self.states) {
            let event = if echo.is_some() { Event::CP_ERROR } else { Event::CP_ERROR_GONE };
            return Some(text(event, format_args!("line: local echo")));
        }
        let refused = self.refused.due(&mut self.states)?;
        Some(match refused {
            Some(Refused::Byte(number)) => text(Event::CP_ERROR, format_args!("parameter byte {number}")),
            Some(Refused::Configuration) => text(Event::CP_ERROR, format_args!("configuration")),
            None => text(Event::CP_ERROR_GONE, format_args!("parameters")),
        })
    }

    /// Whether an interrupt waits until it is allowed: nothing more is to be taken before that.
    pub(super) const fn is_holding(&self) -> bool {
        self.interrupt.is_some()
    }

    /// The segment's count of lost events.
    #[inline]
    pub(super) fn lost(&mut self, events: u64) {
        if events > self.lost.is.unwrap_or(0) {
            self.lost.comes(events);
        }
    }

    /// An event out of the segment's ring, from a driver of this incident.
    pub(super) fn take(&mut self, event: &ob1_backplane::Event, incident: u32) {
        match event.kind {
            EventKind::DiagnosticIncoming | EventKind::DiagnosticOutgoing if !self.diagnostics => {
                self.enter_once(INTERRUPT_OFF, "interrupt off", incident);
            }
            EventKind::DiagnosticIncoming => self.interrupt = Some(interrupt(Event::CP_ERROR, event.data())),
            EventKind::DiagnosticOutgoing => self.interrupt = Some(interrupt(Event::CP_ERROR_GONE, event.data())),
            EventKind::Message => self.message(event.code, event.data(), incident),
            // No CP of ours has them yet: OB 40 and OB 83 have no port on the CPU.
            EventKind::ProcessInterrupt | EventKind::Removed | EventKind::Inserted => {}
        }
    }

    fn message(&mut self, number: u32, data: &[u8], incident: u32) {
        let first = data.first().copied().unwrap_or(0);
        match number {
            code::LINE_GONE => self.line.comes(data.first_chunk::<4>().map_or(0, |bytes| u32::from_be_bytes(*bytes))),
            code::LINE_UP => self.line.goes(),
            code::NO_PARAMETERS => self.refused.comes(Refused::Byte(first)),
            code::CONFIGURATION => self.refused.comes(Refused::Configuration),
            code::WORKING => self.refused.goes(),
            code::ECHO if first == 0 => self.echo.goes(),
            code::ECHO => self.echo.comes(()),
            code::SEGMENT => self.enter_once(SEEN_BY_THE_CP, "seen by the CP", incident),
            _ => {}
        }
    }

    /// A fault found in the segment in this incident of the driver, as the supervisor counts them: what the segment
    /// says of its driver is part of what is not trusted.
    pub(super) fn garbage(&mut self, fault: Fault, incident: u32) {
        let (kind, name) = match fault {
            Fault::DriverState(_) => (0, "driver state"),
            Fault::CpuState(_) => (1, "CPU state"),
            Fault::EventRing { .. } => (2, "event ring"),
            Fault::Event(_) => (3, "event"),
            Fault::RecordLength(_) => (4, "record length"),
            Fault::ParameterLength(_) => (5, "parameters"),
        };
        self.enter_once(kind, name, incident);
    }

    fn enter_once(&mut self, kind: usize, name: &str, incident: u32) {
        if incident != self.incident {
            (self.incident, self.told) = (incident, [false; KINDS]);
        }
        if !std::mem::replace(&mut self.told[kind], true) {
            self.garbage = Some(text(Event::SEGMENT_GARBAGE, format_args!("{name}")));
        }
    }
}

/// What the supervisor reports.
pub(crate) fn of_report(report: Report) -> ModuleEvent {
    match report {
        Report::Up(starts) => text(Event::DRIVER_UP, format_args!("start {starts}")),
        Report::Lost(exit) => text(Event::DRIVER_LOST, format_args!("{exit}")),
        Report::HeldUp(time) => text(Event::DRIVER_HELD_UP, format_args!("{} ms", time.millis())),
    }
}

fn interrupt(event: Event, from: &[u8]) -> ModuleEvent {
    let mut data = [0; 16];
    let len = from.len().min(data.len());
    data[..len].copy_from_slice(&from[..len]);
    ModuleEvent { event, diagnostic_interrupt: true, data, len: len as u8 }
}

/// Why a line is gone, by the system's error number (0: none); `None` where no short word says more than the number.
pub fn line_gone(errno: u32) -> Option<&'static str> {
    use rustix::io::Errno;
    if errno == 0 {
        return Some("closed");
    }
    // The number comes out of shared memory, and the system has none beyond these.
    let known = i32::try_from(errno).ok().filter(|number| (1..4096).contains(number))?;
    Some(match Errno::from_raw_os_error(known) {
        Errno::NOENT => "no device",
        Errno::ACCESS | Errno::PERM => "no access",
        Errno::BUSY => "in use",
        Errno::IO | Errno::NODEV | Errno::NXIO => "unplugged",
        Errno::CONNREFUSED => "refused",
        Errno::CONNRESET | Errno::PIPE => "hung up",
        Errno::TIMEDOUT | Errno::HOSTUNREACH | Errno::NETUNREACH => "no answer",
        _ => return None,
    })
}

/// An entry with a text of at most 16 bytes.
pub(crate) fn text(event: Event, content: fmt::Arguments<'_>) -> ModuleEvent {
    let text = FixedText::<16>::new(content);
    ModuleEvent { event, diagnostic_interrupt: false, data: text.bytes, len: text.len as u8 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_allowance_fills_with_time_and_never_beyond() {
        let mut allowance = Allowance::new((2, Span::from_nanos(100)));
        assert_eq!([allowance.take(), allowance.take(), allowance.take()], [true, true, false]);
        allowance.fill(Instant::from_nanos(99));
        assert!(!allowance.take());
        allowance.fill(Instant::from_nanos(100));
        assert_eq!([allowance.take(), allowance.take()], [true, false]);
        allowance.fill(Instant::NEVER);
        assert_eq!([allowance.take(), allowance.take(), allowance.take()], [true, true, false]);
    }

    #[test]
    fn no_number_of_a_driver_is_too_strange_for_a_line_that_is_gone() {
        let known = [(0, Some("closed")), (2, Some("no device")), (5, Some("unplugged")), (4095, None)];
        let strange = [4096, i32::MAX as u32, 1 << 31, u32::MAX].map(|number| (number, None));
        for (number, why) in known.into_iter().chain(strange) {
            assert_eq!(line_gone(number), why, "{number}");
        }
    }
}
