//! What a run writes on stderr while it runs: log lines, and below them one live line when stderr is a terminal.

use tracing_subscriber::EnvFilter;

/// Sends log lines to stderr: warnings with `quiet`, else information too, or what `OB1_LOG` says. From here on nothing
/// waits for who reads them.
pub fn start_log(quiet: bool) {
    // Without the thread the log is written at once.
    let _ = ob1_log::start();
    let level = if quiet { "warn" } else { "info" };
    let filter = EnvFilter::try_from_env("OB1_LOG").unwrap_or_else(|_| EnvFilter::new(level));
    // Fails when a log is there already, as in a test.
    let _ = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(|| ob1_log::Log)
        .with_target(false)
        .with_ansi(ob1_log::is_terminal())
        .try_init();
}

/// The live line; nothing when stderr is no terminal.
#[derive(Debug)]
pub struct LiveLine {
    on: bool,
}

impl LiveLine {
    /// A line on this terminal, unless `quiet` is wanted.
    pub fn new(quiet: bool) -> Self {
        let on = !quiet && ob1_log::is_terminal();
        if on {
            let _ = ob1_log::start();
        }
        Self { on }
    }

    /// Whether there is a terminal to show it on.
    pub fn is_on(&self) -> bool {
        self.on
    }

    /// Replaces the line.
    pub fn show(&self, text: &str) {
        if self.on {
            ob1_log::live(text);
        }
    }

    /// Takes the line away.
    pub fn wipe(&self) {
        if self.on {
            ob1_log::live("");
        }
    }
}
