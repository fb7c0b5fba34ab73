//! The host's side of the byte protocol of a SLIO CP 040, as two pure machines: [`SendJob`] hands a telegram over,
//! [`ReceiveJob`] fetches one. [S3 "Principal communication via back plane bus"], `docs/cp040-registers.md`
//!
//! FB 60, 61 and 65 are these machines with parameters around them. A program in Rust that drives the CP through its
//! peripheral bytes can use them as they are: a call takes byte 0 (and what lies behind it) as read, and answers what
//! to write. A job is a small value; whoever calls keeps it between two calls.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

mod receive;
mod send;
mod wire;

pub use ob1_words::cp040::{ACKNOWLEDGE_SHIFT, IDLE, IO_BYTES, RESET, TELEGRAM_MAX};
pub use receive::{ReceiveJob, ReceiveStep, Received, Take};
pub use send::{Piece, SendJob, SendStep};
pub use wire::fragments;

/// Why a job has ended badly.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Failure {
    /// Host and CP are not where they think: the CP was reset or started anew, or shows what it never should (STATUS
    /// 0202h).
    NotSynchronised,
    /// The CP does not accept the length (`D`).
    Length,
    /// Error in the communication: the partner does not answer, or refuses (`E`).
    Communication,
}
