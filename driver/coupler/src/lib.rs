//! Couplers on Modbus: remote inputs and outputs that a station reads and writes as its own.
//!
//! * [`config`]: the configuration of a bus; the runtime writes it, the process of the bus reads it.
//! * [`dp`]: the same for PROFIBUS DP, whose master is the crate `ob1-dp`.
//! * [`profile`]: the set-up of couplers of known makes (watchdogs).
//! * [`plan`]: ranges of registers and bits merged into as few requests as possible.
//! * [`image`]: the inputs and outputs of a bus, and the state of its couplers.
//! * [`line`]: the master of one line or connection, as a machine in virtual time. Function codes, check sums and
//!   frames are those of `ob1-protocols`.
#![forbid(unsafe_code)]

mod codec;
pub mod config;
mod coupler;
pub mod dp;
pub mod gpio;
pub mod image;
pub mod line;
pub mod nanos;
pub mod plan;
pub mod profile;
mod wire;

pub use config::{BusConfig, CouplerConfig, DpConfig, DpSlave, LineConfig, Order, Proof, Range, Serial, Setup, Table};
pub use image::{Image, Refusal, State, Status};
pub use line::LineMaster;
pub use ob1_protocols::{Input, LineFault, LineInput};
pub use profile::Profile;
pub use wire::MasterInput;
