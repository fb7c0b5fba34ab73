//! What a driver and its supervisor report, as entries of the diagnostic buffer. Made on the scan thread: no
//! allocation.
//!
//! A CP also reports each repetition and each failed order; those are not entered. They are the program's affair
//! (FEHLER_KOM), are counted, and a noisy line would push everything else out of the buffer.

use std::fmt::{self, Write};

use ob1_backplane::{EventKind, Fault};
use ob1_cpu::ModuleEvent;
use ob1_model::Event;

use crate::supervisor::Report;

/// Numbers of a CP's messages, as `docs/driver.md` lists them.
mod code {
    pub(super) const WORKING: u32 = 2;
    pub(super) const NO_PARAMETERS: u32 = 3;
    pub(super) const LINE_GONE: u32 = 4;
    pub(super) const LINE_UP: u32 = 5;
    pub(super) const CONFIGURATION: u32 = 7;
    pub(super) const SEGMENT: u32 = 8;
}

/// Kinds of garbage, each entered once for a driver.
const KINDS: usize = 6;

/// What a module has to tell, and what it has told.
#[derive(Debug, Default)]
pub(super) struct Messages {
    pending: Option<ModuleEvent>,
    line_gone: bool,
    refused: bool,
    /// Kinds of garbage the driver of `generation` has been entered for.
    told: [bool; KINDS],
    generation: u64,
}

impl Messages {
    /// The entry that is due.
    pub(super) fn pending(&mut self) -> Option<ModuleEvent> {
        self.pending.take()
    }

    /// An event out of the segment's ring.
    pub(super) fn take(&mut self, event: &ob1_backplane::Event) {
        match event.kind {
            EventKind::DiagnosticIncoming => self.pending = Some(interrupt(Event::CP_ERROR, event.data())),
            EventKind::DiagnosticOutgoing => self.pending = Some(interrupt(Event::CP_ERROR_GONE, event.data())),
            EventKind::Message => self.message(event.code, event.data()),
            // No CP of ours has them yet: OB 40 and OB 83 have no port on the CPU.
            EventKind::ProcessInterrupt | EventKind::Removed | EventKind::Inserted => {}
        }
    }

    fn message(&mut self, number: u32, data: &[u8]) {
        let first = data.first().copied().unwrap_or(0);
        match number {
            code::LINE_GONE => {
                self.line_gone = true;
                let errno = data.first_chunk::<4>().map_or(0, |bytes| u32::from_be_bytes(*bytes));
                self.pending = Some(text(Event::CP_ERROR, format_args!("{}", Gone(errno))));
            }
            code::LINE_UP if self.line_gone => {
                self.line_gone = false;
                self.pending = Some(text(Event::CP_ERROR_GONE, format_args!("line up")));
            }
            code::NO_PARAMETERS => {
                self.refused = true;
                self.pending = Some(text(Event::CP_ERROR, format_args!("parameter byte {first}")));
            }
            code::CONFIGURATION => {
                self.refused = true;
                self.pending = Some(text(Event::CP_ERROR, format_args!("configuration")));
            }
            code::WORKING if self.refused => {
                self.refused = false;
                self.pending = Some(text(Event::CP_ERROR_GONE, format_args!("parameters")));
            }
            code::SEGMENT => self.pending = Some(text(Event::SEGMENT_GARBAGE, format_args!("seen by the CP"))),
            _ => {}
        }
    }

    /// A fault found in the segment while the driver of `generation` was attached.
    pub(super) fn garbage(&mut self, fault: Fault, generation: u64) {
        if generation != self.generation {
            (self.generation, self.told) = (generation, [false; KINDS]);
        }
        let (kind, name) = match fault {
            Fault::DriverState(_) => (0, "driver state"),
            Fault::CpuState(_) => (1, "CPU state"),
            Fault::EventRing { .. } => (2, "event ring"),
            Fault::Event(_) => (3, "event"),
            Fault::RecordLength(_) => (4, "record length"),
            Fault::ParameterLength(_) => (5, "parameters"),
        };
        if !std::mem::replace(&mut self.told[kind], true) {
            self.pending = Some(text(Event::SEGMENT_GARBAGE, format_args!("{name}")));
        }
    }
}

/// What the supervisor reports.
pub(super) fn of_report(report: Report) -> ModuleEvent {
    match report {
        Report::Up(starts) => text(Event::DRIVER_UP, format_args!("start {starts}")),
        Report::Lost(exit) => text(Event::DRIVER_LOST, format_args!("{exit}")),
        Report::HeldUp(time) => text(Event::DRIVER_HELD_UP, format_args!("{} ms", time / 1_000_000)),
    }
}

fn interrupt(event: Event, from: &[u8]) -> ModuleEvent {
    let mut data = [0; 16];
    let len = from.len().min(data.len());
    data[..len].copy_from_slice(&from[..len]);
    ModuleEvent { event, diagnostic_interrupt: true, data, len: len as u8 }
}

/// Why a line is gone, in the 16 bytes of an entry: the system's number where no word says more.
struct Gone(u32);

impl fmt::Display for Gone {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        use rustix::io::Errno;
        // The number comes out of shared memory, and the system has none beyond these.
        let known = i32::try_from(self.0).ok().filter(|number| (1..4096).contains(number));
        let Some(errno) = known.map(Errno::from_raw_os_error) else {
            return if self.0 == 0 { f.write_str("line: closed") } else { write!(f, "line gone, os {}", self.0) };
        };
        f.write_str(match errno {
            Errno::NOENT => "line: no device",
            Errno::ACCESS | Errno::PERM => "line: no access",
            Errno::BUSY => "line: in use",
            Errno::IO | Errno::NODEV | Errno::NXIO => "line: unplugged",
            Errno::CONNREFUSED => "line: refused",
            Errno::CONNRESET | Errno::PIPE => "line: hung up",
            Errno::TIMEDOUT | Errno::HOSTUNREACH | Errno::NETUNREACH => "line: no answer",
            _ => return write!(f, "line gone, os {}", self.0),
        })
    }
}

/// An entry with a text of at most 16 bytes.
fn text(event: Event, content: fmt::Arguments<'_>) -> ModuleEvent {
    struct Short([u8; 16], usize);
    impl Write for Short {
        fn write_str(&mut self, s: &str) -> fmt::Result {
            let part = &s[..s.floor_char_boundary(self.0.len() - self.1)];
            self.0[self.1..self.1 + part.len()].copy_from_slice(part.as_bytes());
            self.1 += part.len();
            Ok(())
        }
    }
    let mut short = Short([0; 16], 0);
    // Never an error: what does not fit is dropped.
    let _cut = short.write_fmt(content);
    ModuleEvent { event, diagnostic_interrupt: false, data: short.0, len: short.1 as u8 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_number_of_a_driver_is_too_strange_for_a_line_that_is_gone() {
        for (number, text) in
            [(0, "line: closed"), (2, "line: no device"), (5, "line: unplugged"), (4095, "line gone, os 4095")]
        {
            assert_eq!(Gone(number).to_string(), text);
        }
        for number in [4096, i32::MAX as u32, 1 << 31, u32::MAX] {
            assert_eq!(Gone(number).to_string(), format!("line gone, os {number}"));
        }
    }
}
