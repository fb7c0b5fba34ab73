//! PROFIBUS DP.
//!
//! * [`master`]: the master of one line, as a machine in virtual time. The stack is `profirust`; the code around it
//!   compensates for what it lacks or does wrong.
//! * [`wires`]: the line for the stack. Only whole telegrams that answer its requests reach it.
//! * [`gsd`]: converts a GSD file and the modules in a slave's slots to its configuration and parameters.
//! * [`scan`]: the stations on a line.
#![forbid(unsafe_code)]

pub mod gsd;
pub mod master;
pub mod scan;
mod stack;
mod times;
pub mod wires;

pub use master::Master;
pub use times::baud_rate;
