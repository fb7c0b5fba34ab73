//! What a run writes on stderr while it runs: log lines, and below them one live line when stderr is a terminal.

/// Sends log lines to stderr: warnings with `quiet`, else information too, or what `OB1_LOG` says. From here on nothing
/// waits for the reader of stderr.
pub fn start_log(quiet: bool) {
    // Without the thread the log is written at once.
    let _ = ob1_process::log::start();
    if let Some(wrong) = ob1_process::log::subscribe(if quiet { "warn" } else { "info" }, ob1_process::log::Lines::All)
    {
        tracing::warn!("{wrong}");
    }
}

/// The live line; nothing when stderr is no terminal.
#[derive(Debug)]
pub struct LiveLine {
    on: bool,
}

impl LiveLine {
    /// A line on this terminal, unless `quiet` is wanted.
    pub fn new(quiet: bool) -> Self {
        let on = !quiet && ob1_process::log::is_terminal();
        if on {
            let _ = ob1_process::log::start();
        }
        Self { on }
    }

    /// Whether there is a terminal to show it on.
    pub fn is_on(&self) -> bool {
        self.on
    }

    /// Replaces the live line; does nothing without a terminal.
    pub fn show(&self, text: &str) {
        if self.on {
            ob1_process::log::live(text);
        }
    }

    /// Takes the line away.
    pub fn wipe(&self) {
        if self.on {
            ob1_process::log::live("");
        }
    }
}
