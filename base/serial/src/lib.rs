//! The terms of a serial line: the character frame, the modem lines, faults. Parameters, protocols, firmware and the
//! lines themselves share them.
#![no_std]
#![forbid(unsafe_code)]

mod character_frame;
mod rates;
mod signals;
pub mod tap_record;
mod wire;

pub use character_frame::{Flow, LineSettings, Parity, StopBits};
pub use ob1_time::{Instant, Span};
pub use rates::FaultRates;
pub use signals::{LineFault, ModemLines};
pub use wire::{LineInput, Wire};
