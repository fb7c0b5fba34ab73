//! The interface between a handling block and its CP: sizes, codes and layouts of the data that one side shows the
//! other. Each is defined once, here, and used by the plugins and the firmware.
//!
//! There are no state machines here: they are in `plugins/cp240`, `plugins/slio` and `plugins/ptp`, and in
//! `driver/firmware`.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod any;
pub mod boxes;
pub mod channels;
mod codes;
pub mod cp040;
pub mod cp240;
pub mod cp341_events;
pub mod cp342;
mod leds;
mod reason;

pub use leds::Leds;
pub use reason::{Reason, Why};
