//! The driver of a CP 240: what lies between a segment of the back plane, the firmware and a line.
//!
//! [`CpPump`] is pure: time is handed in, the line is a [`LinePort`]. The process `ob1-cp` drives it with the clock, a
//! doorbell and a real line; the simulation of a whole station drives the same type in virtual time, over a heap
//! segment, with one end of the simulated line.

mod keys;
mod pump;
mod translate;

pub use keys::parameters_341;
pub use pump::{CpPump, HEARTBEAT, LinePort, Parameters341, Refused};
pub use translate::{EventCode, LINE_TEXT_RECORD, to_line_settings};
