//! Stations as real processes: `ob1`, its drivers, its links and their partners.

#[path = "../common/mod.rs"]
mod common;

mod browser;
mod compare;
mod cp341;
mod cp343;
mod diag;
mod engine;
mod enocean;
mod gate;
mod gate_load;
mod gate_siege;
mod guardian;
mod import;
mod kill;
mod load;
mod load_siege;
mod mbus;
mod modbus;
mod modbus_peers;
mod mqtt;
mod opcua;
mod peer;
mod privileges;
mod profibus;
mod program_status;
mod refusals;
mod remote_io;
mod rk512;
mod s7;
mod s7_400;
mod s7_download;
mod s7_siege;
mod s7_tshark;
mod scan;
mod serial_devices;
mod siege;
mod simulated_line;
mod soak;
mod strangers;
mod timing;
mod top;
mod two_stations;
