//! What crosses two crates and needs no station.

mod compare;
mod fuzz_corpus;
mod handling_interfaces;
mod mbus_records;
mod modbus_master_32;
mod siege;
mod tcm120;
