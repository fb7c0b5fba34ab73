//! Common parts of a station's driver processes: their confinement, the log, signals, descriptors from the runtime, the
//! doorbell, and listeners to their lines.

#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod fence;
pub mod tap;

use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use ob1_backplane::handover;
use ob1_line::Span;
use rustix::event::{PollFd, Timespec, poll};
use rustix::io::Errno;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use tracing::error;

/// Starts the log, after the fence because it has a thread.
pub fn start_log() {
    // Without the thread the log is written at once: a driver whose log can delay it is better than none.
    let _ = ob1_log::start();
    ob1_log::tell_panics();
    // The runtime has said what is wrong with OB1_LOG.
    let _ = ob1_log::subscribe("info", ob1_log::Lines::Sparing);
}

/// Ctrl-C on a terminal reaches the whole group; the runtime handles it, and ends us by closing standard input. The
/// returned flag is set by SIGTERM.
#[must_use]
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
#[must_use]
pub fn handed_over() -> Vec<OwnedFd> {
    match handover::receive(rustix::stdio::stdout(), &mut [0]) {
        Ok(Some((_, descriptors))) => descriptors,
        Ok(None) | Err(_) => Vec::new(),
    }
}

/// Waits until one of the descriptors is ready, or this long; a signal ends it early.
///
/// # Errors
/// The system's error.
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
/// The system's error.
pub fn doorbell_closed() -> Result<bool, Errno> {
    let mut rings = [0; 64];
    match rustix::io::read(rustix::stdio::stdin(), &mut rings) {
        Ok(0) => Ok(true),
        Ok(_) | Err(Errno::AGAIN | Errno::INTR) => Ok(false),
        Err(error) => Err(error),
    }
}
