//! A file that may not grow any more (`ulimit -f`, systemd's `LimitFSIZE`).

/// From here on a write beyond the limit is an error, as on a full disk. Without this the kernel ends the process with
/// SIGXFSZ: a log that has reached its limit would switch the PLC off. Processes started from this one inherit it.
pub fn survive_file_limit() {
    // SAFETY: to ignore a signal installs no code.
    unsafe { libc::signal(libc::SIGXFSZ, libc::SIG_IGN) };
}
