//! The interface between a handling block and its CP: sizes, codes and layouts of the data that one side shows the
//! other. Each is defined once, here, and used by the plugins and the firmware.
//!
//! Of state machines there is one, [`slio`]: the byte protocol of the CP 040, which FB 60 and FB 61 speak and the
//! firmware is tested with. All others are in the plugins and in `driver/firmware`.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod any;
pub mod boxes;
pub mod channels;
mod codes;
mod counter;
pub mod cp040;
pub mod cp240;
pub mod cp341_events;
pub mod cp342;
mod leds;
mod reason;
pub mod slio;

pub use counter::Counter;
pub use leds::Leds;
pub use reason::{Reason, Why};
