//! The words between a handling block and its CP: sizes, codes and layouts of what one side shows the other. Each
//! stands here once; the plugins and the firmware both take it from here.
//!
//! No machine is here: what a word makes a side do is that side's business (`plugins/cp240`, `plugins/slio`,
//! `plugins/ptp`; `driver/firmware`).
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod any;
pub mod boxes;
pub mod channels;
pub mod cp040;
pub mod cp240;
pub mod cp342;
mod leds;

pub use leds::Leds;
