//! What a serial line is, in words: the character frame, the modem lines, what can go wrong. Parameters, protocols,
//! firmware and the lines themselves mean the same by them.
#![no_std]
#![forbid(unsafe_code)]

mod settings;
mod signals;
mod wire;

pub use settings::{Flow, LineSettings, Parity, StopBits};
pub use signals::{LineFault, ModemLines};
pub use wire::{LineInput, Wire};

/// Nanoseconds: since the start of the CP, or of a time. Virtual in tests and simulations, monotonic in the driver
/// process.
pub type Nanos = u64;
