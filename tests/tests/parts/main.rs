//! What crosses two crates and needs no station.

mod compare;
mod foreign;
mod fuzz_corpus;
mod handling_interfaces;
mod mbus_records;
mod modbus_master_32;
mod protocol_model;
mod siege;
mod tcm120;
