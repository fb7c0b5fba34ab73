//! Stand-ins for the tests of several crates: what the real ones have beside them in a plant. No product needs this.
#![forbid(unsafe_code)]

pub mod cp_port;
pub mod dp_slave;
pub mod sim_line;
pub mod sink;
