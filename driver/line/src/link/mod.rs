//! The differences between the kinds of lines: opening, settings, and the loss of the line.

mod pty;
mod serial;
mod sim;
mod tcp_client;
mod tcp_common;
mod tcp_listener;

use std::io;

use crate::line::{Instant, ModemLines, PollFds, Span};
use crate::spec::LineSpec;
use crate::supported_frames::{LineSettings, Warning};

/// Pause between two attempts to open a line. A TCP client doubles it up to 2 s.
pub const RETRY: Span = Span::from_millis(500);

/// The result of an attempt to open a line.
pub(crate) enum Opened {
    /// It is open; the warnings name settings that it does not have.
    Yes(Vec<Warning>),
    /// Not yet (a connection is being made, or no partner has called yet): try again when a descriptor is ready, or at
    /// the given time.
    Waiting(Option<Instant>),
}

/// How characters get to the partner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Passage {
    /// One after the other, each in its time.
    Wire,
    /// All at once, to a program on this machine.
    Program,
    /// All at once to another machine, which may have a wire behind it.
    Network,
    /// On a simulated line, which keeps the times and reports the end of sending. On two wires nobody hears himself.
    Simulated,
}

/// One kind of line. Everything is non-blocking; an error of `read` or `write` other than "would block" means that the
/// line is gone, and so does reading nothing.
pub(crate) trait Link {
    /// Opens, or continues opening.
    fn open(&mut self, now: Instant, settings: &LineSettings) -> io::Result<Opened>;

    /// Applies changed settings to the open line.
    fn apply(&mut self, settings: &LineSettings) -> io::Result<Vec<Warning>>;

    /// Closes what is open; `open` may follow.
    fn close(&mut self);

    /// The descriptors to wait for, open or waiting.
    fn poll_fds<'a>(&'a self, want_write: bool, fds: &mut PollFds<'a>);

    /// Reads available bytes, with faults still encoded.
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize>;

    /// Writes as many bytes as there is room for.
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize>;

    /// Whether `read` delivers PARMRK sequences.
    fn marks_faults(&self) -> bool {
        false
    }

    /// Whether everything written has been sent; `None`: unknown, compute it.
    fn drained(&mut self) -> Option<bool> {
        None
    }

    /// How its characters get to the partner.
    fn passage(&self) -> Passage;

    /// Drops the unsent bytes of the device; returns their number. A simulated line does not know it.
    fn take_back(&mut self) -> usize {
        0
    }

    /// Whether 1.5 stop bits are possible.
    fn does_odd_stop_bits(&self) -> bool {
        false
    }

    /// Whether bytes without room are dropped instead of waiting, as on a wire without a receiver.
    fn drops_when_full(&self) -> bool {
        false
    }

    /// Other tasks while the line is open (refuse callers).
    fn housekeeping(&mut self) {}

    /// Whether [`Link::look_after`] has something to do.
    fn needs_looks(&self) -> bool {
        false
    }

    /// Now and then while the line is open: makes again what others have removed.
    fn look_after(&mut self) {}

    /// The longest pause between attempts to open.
    fn slowest_retry(&self) -> Span {
        RETRY
    }

    /// The modem lines, if there are any.
    fn modem_lines(&mut self) -> Option<ModemLines> {
        None
    }

    /// Sets RTS and DTR, if there are any.
    fn set_modem_lines(&mut self, _rts: bool, _dtr: bool) {}
}

/// The link of a spec; nothing is opened yet.
pub(crate) fn of(spec: &LineSpec) -> Box<dyn Link> {
    match spec {
        LineSpec::Serial(path) => Box::new(serial::SerialLink::new(path.clone())),
        LineSpec::Pty(path) => Box::new(pty::PtyLink::new(path.clone())),
        LineSpec::Tcp { host, port } => Box::new(tcp_client::ClientLink::new(host.clone(), *port)),
        LineSpec::Sim(path) => Box::new(sim::SimLink::new(path.clone())),
        LineSpec::Listen(address) => Box::new(tcp_listener::ListenerLink::new(*address)),
    }
}

/// The settings that neither a pty nor TCP can apply.
fn not_a_wire(kind: &str, settings: &LineSettings) -> Vec<Warning> {
    let LineSettings { baud, half_duplex, .. } = *settings;
    let plain = LineSettings { baud, half_duplex, ..LineSettings::default() };
    if *settings == plain {
        return Vec::new();
    }
    vec![Warning(format!("{kind} carries 8 bits a character: of {settings} it uses only the baud rate, as timing"))]
}
