//! A fence: Unix sockets for crates that have no other, without what confines a process.
//!
//! Between the processes of a station: [`handover`] passes descriptors to a child, [`seqpacket`] carries messages
//! between equals. Neither ever waits.
#![forbid(unsafe_code)]

pub mod handover;
pub mod seqpacket;
