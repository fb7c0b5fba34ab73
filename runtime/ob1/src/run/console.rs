//! What a run writes on stderr while it runs: log lines, and below them one live line when stderr is a terminal.

use std::io::{self, IsTerminal as _, Write as _};
use std::sync::atomic::{AtomicBool, Ordering};

use tracing_subscriber::EnvFilter;

/// A live line stands on the terminal and has to be wiped before anything else is written.
static LIVE: AtomicBool = AtomicBool::new(false);
const WIPE: &[u8] = b"\r\x1b[K";

/// stderr, wiping the live line first.
struct Stderr;

impl io::Write for Stderr {
    fn write(&mut self, text: &[u8]) -> io::Result<usize> {
        let mut stderr = io::stderr().lock();
        if LIVE.swap(false, Ordering::Relaxed) {
            stderr.write_all(WIPE)?;
        }
        stderr.write(text)
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stderr().flush()
    }
}

/// Sends log lines to stderr: warnings with `quiet`, else information too, or what `OB1_LOG` says.
pub(super) fn start_log(quiet: bool) {
    let level = if quiet { "warn" } else { "info" };
    let filter = EnvFilter::try_from_env("OB1_LOG").unwrap_or_else(|_| EnvFilter::new(level));
    // Fails when a log is there already, as in a test.
    let _ = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(|| Stderr)
        .with_target(false)
        .with_ansi(io::stderr().is_terminal())
        .try_init();
}

/// The live line; nothing when stderr is no terminal.
#[derive(Debug)]
pub(crate) struct LiveLine {
    on: bool,
}

impl LiveLine {
    pub(crate) fn new(quiet: bool) -> Self {
        Self { on: !quiet && io::stderr().is_terminal() }
    }

    pub(crate) fn is_on(&self) -> bool {
        self.on
    }

    pub(crate) fn show(&self, text: &str) {
        if self.on {
            let mut stderr = io::stderr().lock();
            LIVE.store(true, Ordering::Relaxed);
            let _ =
                stderr.write_all(WIPE).and_then(|()| stderr.write_all(text.as_bytes())).and_then(|()| stderr.flush());
        }
    }

    pub(crate) fn wipe(&self) {
        if self.on && LIVE.swap(false, Ordering::Relaxed) {
            let _ = io::stderr().lock().write_all(WIPE);
        }
    }
}
