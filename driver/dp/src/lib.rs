//! PROFIBUS DP.
//!
//! * [`master`]: the master of one line, as a machine in virtual time. The stack is `profirust`; what it lacks or gets
//!   wrong is made good around it.
//! * [`wires`]: what the stack sees of a line. Nothing reaches it but whole telegrams that answer what was asked.
//! * [`slave`]: a DP slave as a machine, for tests and simulated plants.
//! * [`gsd`]: from a GSD file and the modules in a slave's slots to its configuration and parameters.
//! * [`scan`]: who is on a line.
#![forbid(unsafe_code)]

pub mod gsd;
pub mod master;
pub mod scan;
pub mod slave;
mod stack;
mod times;
pub mod wires;

pub use master::Master;
pub use slave::Slave;
pub use times::baud_rate;
