//! The firmware of the CPs on a bench: the registers of a CPU on one side, a line on the other.

mod common;
mod cp040;
mod cp340;
mod cp341;
mod cp341_ascii;
mod cp341_bench;
mod cp341_rk512;
mod cp341_signals;
mod enocean;
mod handshake;
mod mbus;
mod modbus;
mod model;
mod modem;
mod pair;
mod reason;
mod rk512;
mod startup;
mod stx_etx;
