//! The terms of a serial line: the character frame, the modem lines, faults. Parameters, protocols, firmware and the
//! lines themselves share them.
#![no_std]
#![forbid(unsafe_code)]

mod rates;
pub mod record;
mod settings;
mod signals;
mod wire;

pub use ob1_time::{Instant, Span};
pub use rates::FaultRates;
pub use settings::{Flow, LineSettings, Parity, StopBits};
pub use signals::{LineFault, ModemLines};
pub use wire::{LineInput, Wire};
