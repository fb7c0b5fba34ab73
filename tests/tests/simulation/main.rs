//! Whole stations in virtual time.

#[path = "../common/mod.rs"]
mod common;

mod buses;
mod coupled;
mod cp040;
mod cp240;
mod cp240_blocks;
mod cp240_order_of_calls;
mod cp240_orders;
mod cp240_reset;
mod cp240_rk512;
mod cp340;
mod cp340_printer;
mod cp341;
mod cp341_calls;
mod cp341_interwork;
mod cp341_jobs;
mod cp341_lengths;
mod cp341_modbus;
mod cp341_status;
mod cp341_status_site;
mod cp342;
mod cp343;
mod diagnosis;
mod enocean;
mod gpio;
mod handling_check;
mod interrupts;
mod long_scans;
mod mbus;
mod mbus_library;
mod plant;
mod programs;
mod rk512;
