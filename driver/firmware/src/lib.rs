//! A whole CP as one sans-IO machine: the CPU's side, buffers, protocol, LEDs, counters. [`Cp240`], [`Cp040`] and
//! [`cp341`].
//!
//! [`Cp240`] depends only on its inputs and their times: it knows no clock, no descriptor and no shared memory. Its
//! owner passes in what happened ([`CpInput`]) and carries out what it requests through a [`CpPort`]. The process
//! `ob1-cp` does that with a back plane and a real line, the simulation with a heap segment and a simulated one, in
//! virtual time.
//!
//! The registers are described in `docs/cp240-registers.md` and `docs/cp040-registers.md`.
#![forbid(unsafe_code)]

mod choose_reason;
mod cp;
mod cp040;
mod cp240;
pub mod cp341;
mod diagnosis;
mod leds;
mod modbus;
mod port;
mod printer;
mod protocol;
mod ring;

pub use choose_reason::{Troubles, Waiting};
pub use cp::of;
pub use cp040::{Cp040, IO_BYTES};
pub use cp240::Cp240;
pub use cp341::Cp341;
pub use diagnosis::{DiagnosticBytes, DiagnosticRecord};
pub use leds::Leds;
pub use ob1_params::LineSettings;
pub use ob1_protocols::modbus_master_32::job::LONG_BIT;
pub use ob1_protocols::{Instant, LineFault, LineInput, ModemLines, Span, Wire, trace};
pub use ob1_words::cp240::Registers;
pub use ob1_words::{Reason, Why};
pub use port::{Counter, Cp, CpEvent, CpInput, CpPort, StartReason};
pub use ring::TELEGRAMS_MAX;
