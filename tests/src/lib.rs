//! Tests across crates: the whole-station simulation, the benchmarks, and helpers for the end-to-end tests.

pub mod awlsim;
pub mod bench;
pub mod compare;
pub mod coupler;
#[path = "../../driver/protocols/tests/protocols/defaults/mod.rs"]
mod defaults;
pub mod fuzz;
pub mod meters;
pub mod modbus_slave;
pub mod opcua;
#[path = "../../xtask/src/campaign/part.rs"]
pub mod part;
pub mod programs;
pub mod s7_raw;
pub mod siege;
pub mod sim;
pub mod step7;
pub mod tcm120;
