//! The host side of the byte protocol of a SLIO CP 040, as two pure state machines: [`SendJob`] passes a telegram to
//! the CP, [`ReceiveJob`] fetches one. [S3 "Principal communication via back plane bus"], `docs/cp040-registers.md`
//!
//! FB 60, 61 and 65 connect these machines with block parameters. A Rust program that accesses the CP through its
//! peripheral bytes can use them directly: a call takes the input bytes and returns what to write. A job is a small
//! value that the caller keeps between two calls.

mod failure;
mod receive;
mod send;
mod wire;

pub use crate::cp040::{ACKNOWLEDGE_SHIFT, IDLE, IO_BYTES, RESET, TELEGRAM_MAX};
pub use failure::Failure;
pub use receive::{ReceiveJob, ReceiveStep, Received, Take};
pub use send::{Piece, SendJob, SendStep};
pub use wire::fragments;
