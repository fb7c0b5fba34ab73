//! What a serial line is, in words: the character frame, the modem lines, what can go wrong. Parameters, protocols,
//! firmware and the lines themselves mean the same by them.
#![no_std]
#![forbid(unsafe_code)]

mod settings;
mod signals;
mod wire;

pub use ob1_time::{Instant, Span};
pub use settings::{Flow, LineSettings, Parity, StopBits};
pub use signals::{LineFault, ModemLines};
pub use wire::{LineInput, Wire};
