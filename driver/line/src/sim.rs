//! The simulated line in virtual time: [`SimBus`], with any number of participants.
//!
//! Characters take their real time: start bit, data bits, parity bit and stop bits at the baud rate. The same
//! configuration, seed and calls give the same events to the nanosecond.

mod bus;
mod faults;
mod rng;

pub use bus::{Bursts, BusConfig, BusEvent, Frame, Participant, SimBus};
pub use faults::Fate;
pub use ob1_serial::FaultRates;
pub use rng::SplitMix64;
