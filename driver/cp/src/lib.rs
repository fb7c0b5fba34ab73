//! The driver of a CP: it connects a segment of the back plane, the firmware and a line.
//!
//! [`CpPump`] is pure: time is handed in, the line is a [`LinePort`]. The process `ob1-cp` drives it with the clock, a
//! doorbell and a real line; the simulation of a whole station drives the same type in virtual time, over a heap
//! segment, with one end of the simulated line.

mod keys;
mod line_port;
mod module;
mod plug;
mod presence;
mod pump;
mod times;
mod translate;

pub use keys::{CpType, KeyedParameters};
pub use line_port::{LinePort, Refused};
pub use presence::{ARRIVAL, Change, Presence};
pub use pump::{CpPump, HEARTBEAT};
pub use translate::{EventCode, LINE_TEXT_RECORD};
