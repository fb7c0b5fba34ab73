//! Serial protocols as sans-IO machines: no clock, no descriptor, no shared memory, no allocation.
//!
//! A machine is told what happened ([`Input`]) and when, and answers through a [`Sink`]: what to put on the line,
//! which telegram is complete, how an order ended, what went wrong. Its return value is the time at which it wants to
//! be called again. Configuration plus the list of (time, input) determines everything, so a field log is a test.
//!
//! * [`machine`]: the contract all protocols share.
#![no_std]
#![forbid(unsafe_code)]

pub mod machine;

pub use machine::{
    Event, Input, LineFault, MS, Machine, ModemLines, Nanos, Order, Phase, SECOND, SendError, Sink, TELEGRAM_MAX, What,
};
