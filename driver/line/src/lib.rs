//! Serial lines of a CP: a serial device, a pty, TCP, and the simulated line.
//!
//! A line is described by a [`LineSpec`] (`serial:/dev/ttyUSB0`, `pty:PATH`, `tcp:HOST:PORT`, `tcp-listen:[ADDR:]PORT`)
//! and opened as a [`RealLine`]. From then on it is one non-blocking object that never ends the process: a device that
//! vanishes or a peer that closes is reported as [`LineEvent::Gone`], and the line recovers by itself.
//!
//! The crate reads no clock. The owner of the line passes in the time, polls the descriptors of [`RealLine::poll_fds`]
//! no longer than until [`RealLine::deadline`], and then takes events until there are none left.

// Two ioctls that no crate wraps (see `sys`), and the borrowed descriptor of a serial port.
#![allow(unsafe_code)]

mod echo;
pub mod hub;
mod line;
mod link;
mod parmrk;
mod real;
pub mod sim;
mod spec;
mod supported_frames;
mod sys;
mod wire;

pub use line::{ECHOES, Instant, LineEvent, LineFault, LineInput, ModemLines, PollFds, SILENT, Span};
pub use link::RETRY;
pub use parmrk::{Decoded, Mark, ParmrkDecoder};
pub use real::RealLine;
pub use spec::{LineSpec, SpecError};
pub use supported_frames::{Flow, LineSettings, Parity, SettingsError, StopBits, Warning};
