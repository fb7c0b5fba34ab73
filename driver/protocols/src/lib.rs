//! Serial protocols as sans-IO machines: no clock, no descriptor, no shared memory, no allocation.
//!
//! A machine is told what happened ([`Input`]) and when, and answers through a [`Sink`]: what to send, which telegram
//! is complete, how an order ended, what went wrong. It returns the time at which it must be called again.
//! Configuration and the list of (time, input) determine everything, so a field log is a test.
//!
//! * [`machine`]: the contract all protocols share.
//! * [`ascii`]: bare characters, telegrams end with a pause, with end characters or after a number of characters.
//! * [`esp2`]: EnOcean's transceiver TCM 120.
//! * [`mbus`]: M-Bus master.
//! * [`s3964`]: 3964 and 3964R.
//! * [`modbus`]: Modbus RTU and ASCII, master and slave.
//! * [`modbus_master_32`]: loadable driver of the CP 341, Modbus ASCII master with 32-bit registers.
//! * [`profibus`]: telegrams of PROFIBUS and the diagnosis of a DP slave.
//! * [`rk512`]: RK 512 on top of either.
//! * [`signals`]: automatic use of the RS 232C secondary signals.
//! * [`stx_etx`]: telegrams between start and end characters.
//! * [`trace`]: a line as an observer reads it, for all of them.
#![no_std]
#![forbid(unsafe_code)]

pub mod ascii;
mod duplex;
pub mod esp2;
mod flow;
pub mod machine;
pub mod mbus;
pub mod modbus;
pub mod modbus_master_32;
mod output;
pub mod profibus;
pub mod rk512;
pub mod s3964;
pub mod signals;
pub mod stx_etx;
pub mod trace;
mod words;

pub use ascii::Ascii;
pub use esp2::Esp2;
pub use machine::{
    Event, Input, Instant, LineFault, LineInput, MS, Machine, ModemLines, Order, Part, Phase, SECOND, SendError, Sink,
    Span, TELEGRAM_MAX, What, Wire,
};
pub use mbus::MBus;
pub use ob1_serial::{LineSettings, Parity, StopBits};
pub use rk512::Rk512;
pub use s3964::S3964;
pub use stx_etx::StxEtx;
