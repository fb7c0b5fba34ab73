//! What every process of a station does at its start and at its edges: it confines itself, starts its log ([`log`]),
//! takes its signals and the descriptors that the runtime hands over, reads its doorbell, lets others
//! listen to its lines ([`tap`]), and reads and replaces files ([`files`]).
//!
//! A fence: crates that touch neither disk nor sockets by themselves do it here.

#![deny(clippy::print_stdout, clippy::print_stderr)]

#[allow(unsafe_code, reason = "closing the descriptors that nobody has asked for has no safe wrapper")]
mod confine;
pub mod files;
pub mod from_runtime;
pub mod log;
pub mod tap;
#[allow(unsafe_code, reason = "the change of user has no safe wrapper")]
mod user;

use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use ob1_serial::Span;
use ob1_socket::handover;
use rustix::event::{PollFd, Timespec, poll};
use rustix::io::Errno;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use tracing::error;

pub use confine::{Confinement, Network, Refusal, close_inherited, confine, keep_inherited};
pub use user::User;

/// Starts the log, after the fence because it has a thread.
pub fn start_log() {
    // Without the thread the log is written at once: a driver whose log can delay it is better than none.
    let _ = crate::log::start();
    crate::log::tell_panics();
    // The runtime has said what is wrong with OB1_LOG.
    let _ = crate::log::subscribe("info", crate::log::Lines::Sparing);
}

/// Ctrl-C on a terminal reaches the whole group; the runtime handles it, and ends us by closing what it has
/// handed over. The returned flag is set by SIGTERM.
pub fn signals() -> Arc<AtomicBool> {
    let ignored = Arc::new(AtomicBool::new(false));
    let terminate = Arc::new(AtomicBool::new(false));
    for (signal, flag) in [(SIGINT, &ignored), (SIGHUP, &ignored), (SIGTERM, &terminate)] {
        if let Err(error) = signal_hook::flag::register(signal, Arc::clone(flag)) {
            error!("signal {signal}: {error}");
        }
    }
    terminate
}

/// The descriptors that the runtime has sent over the socket that is our standard output, the segment's first.
pub fn handed_over() -> Vec<OwnedFd> {
    match handover::receive(rustix::stdio::stdout(), &mut [0]) {
        Ok(Some((_, descriptors))) => descriptors,
        Ok(None) | Err(_) => Vec::new(),
    }
}

/// Waits until one of the descriptors is ready, or this long; a signal ends it early.
///
/// # Errors
/// What poll(2) refuses with, except EINTR: too many descriptors, or no memory.
pub fn wait(fds: &mut [PollFd<'_>], timeout: Span) -> Result<(), Errno> {
    let timeout = Timespec { tv_sec: timeout.secs() as i64, tv_nsec: timeout.subsec_nanos() as i64 };
    match poll(fds, Some(&timeout)) {
        Ok(_) | Err(Errno::INTR) => Ok(()),
        Err(error) => Err(error),
    }
}

/// Reads the doorbell, which is standard input; true at the end of the file.
///
/// # Errors
/// What read(2) refuses with, except EAGAIN and EINTR: standard input is closed or cannot be read.
pub fn doorbell_closed() -> Result<bool, Errno> {
    let mut rings = [0; 64];
    match rustix::io::read(rustix::stdio::stdin(), &mut rings) {
        Ok(0) => Ok(true),
        Ok(_) | Err(Errno::AGAIN | Errno::INTR) => Ok(false),
        Err(error) => Err(error),
    }
}
