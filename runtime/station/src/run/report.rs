//! What a run leaves: the report for machines, the summary for people.

use std::fmt::Write as _;
use std::io;
use std::path::Path;

use serde::Serialize;

use crate::access::protocol::{Diagnostic, Status, Times};
use crate::exit::Exit;
use ob1_timing::{self, Timing};

/// Version of the report's form: raised when a field changes its meaning or goes.
pub const REPORT_SCHEMA: u32 = 1;

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ended {
    /// Ended by Ctrl-C or SIGTERM.
    Signal,
    /// The time of `--for` is over.
    Time,
    /// The scans of `--scans` are done.
    Scans,
    /// The CPU went to STOP because of a fault.
    Fault,
    /// It stood still, and its guardian has taken the outputs over.
    StoodStill,
}

impl Ended {
    const fn text(self) -> &'static str {
        match self {
            Ended::Signal => "by a signal",
            Ended::Time => "after the requested time",
            Ended::Scans => "after the requested number of scans",
            Ended::Fault => "because the CPU went to STOP",
            Ended::StoodStill => "because it had stood still and its guardian has set the outputs to their safe state",
        }
    }
}

/// What a finished run leaves for machines.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Version of this form, [`REPORT_SCHEMA`].
    pub schema: u32,
    /// Version of the `ob1` that ran.
    pub version: &'static str,
    /// Why the run ended.
    pub ended: Ended,
    /// Exit code of the command.
    pub exit: u8,
    /// The fault that led to STOP, in words.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fault: Option<String>,
    /// The station at its end.
    #[serde(flatten)]
    pub status: Status,
    /// The diagnostic buffer, newest first.
    pub diagnostics: Vec<Diagnostic>,
    /// The accounts of every scan, with the buckets of all distributions.
    pub timing: Timing,
}

impl Report {
    pub(super) fn new(
        ended: Ended,
        exit: Exit,
        fault: Option<String>,
        status: Status,
        diagnostics: Vec<Diagnostic>,
        timing: Timing,
    ) -> Self {
        let version = env!("CARGO_PKG_VERSION");
        Self { schema: REPORT_SCHEMA, version, ended, exit: exit as u8, fault, status, diagnostics, timing }
    }

    /// Whether a report can be written there: asked before a run of hours, not after it.
    ///
    /// # Errors
    /// The file cannot be opened for writing, or not be made there; what the system says.
    pub fn try_path(path: &Path) -> io::Result<()> {
        match std::fs::metadata(path) {
            Ok(there) if there.is_file() || there.is_dir() => {
                std::fs::OpenOptions::new().append(true).open(path).map(drop)
            }
            // To open a pipe can mean to wait.
            Ok(_) => Ok(()),
            // The target of a link is created when the report is written.
            Err(_) if path.is_symlink() => Ok(()),
            Err(_) => {
                drop(std::fs::File::create_new(path)?);
                std::fs::remove_file(path)
            }
        }
    }

    /// Writes the report as JSON.
    ///
    /// # Errors
    /// The file cannot be written; what the system says.
    pub fn write(&self, path: &Path) -> io::Result<()> {
        let mut text = serde_json::to_string_pretty(self)?;
        text.push('\n');
        ob1_process::files::write(path, text.as_bytes())
    }

    /// The summary, as printed at the end of a run.
    #[must_use]
    pub fn summary(&self) -> String {
        let mut out = String::new();
        let s = &self.status;
        let _ = writeln!(out, "station {} ended {}, {:.1} s", s.station, self.ended.text(), s.runtime_ns as f64 / 1e9);
        if let Some(fault) = &self.fault {
            let _ = writeln!(out, "fault: {fault}");
        }
        let _ = writeln!(
            out,
            "scans {}   statements {}   engine {}   overruns {}   watchdog {}   memory {} KiB",
            s.scans, s.statements, s.engine, s.overruns, s.watchdogs, s.memory.peak_kib
        );
        let _ = writeln!(out, "time in µs       min      mean       p50       p99     p99.9       max");
        row(&mut out, "cycle", &s.cycle);
        row(&mut out, "wake-up", &s.wake);
        row(&mut out, "execution", &s.execution);
        out += &ob1_timing::text::late(&self.timing.late);
        for grant in s.posture.iter().filter(|g| g.outcome != "granted") {
            let _ = writeln!(out, "{}: {}", grant.what, grant.detail);
            if let Some(remedy) = &grant.remedy {
                let _ = writeln!(out, "  = {remedy}");
            }
        }
        for module in &s.modules {
            let Some(driver) = &module.driver else { continue };
            let _ = writeln!(
                out,
                "{} ({} at {}): driver up {} times, died {}",
                module.name, module.type_name, module.address, driver.starts, driver.losses
            );
            let counters: Vec<String> =
                module.counters.iter().filter(|(_, n)| **n > 0).map(|(name, n)| format!("{name} {n}")).collect();
            for line in counters.chunks(4) {
                let _ = writeln!(out, "  {}", line.join("   "));
            }
        }
        let _ = writeln!(out, "diagnostic buffer, newest first:");
        for entry in self.diagnostics.iter().take(10) {
            let _ = writeln!(out, "  {:>12.6} s  {}", entry.time_ns as f64 / 1e9, entry.told());
        }
        out
    }
}

fn row(out: &mut String, name: &str, t: &Times) {
    let _ = write!(out, "{name:<10}");
    for nanos in [t.min_ns as f64, t.mean_ns, t.p50_ns as f64, t.p99_ns as f64, t.p999_ns as f64, t.max_ns as f64] {
        let _ = write!(out, "{:>10.1}", nanos / 1000.0);
    }
    out.push('\n');
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_for_the_report_is_tried_and_left_as_it_was() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("old.json"), "old").expect("room");
        std::os::unix::fs::symlink(path("target.json"), path("link.json")).expect("a link");
        for name in ["new.json", "old.json", "link.json", "/dev/full"] {
            Report::try_path(&path(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        }
        for name in ["", "nowhere/x.json", "old.json/x"] {
            Report::try_path(&path(name)).expect_err(name);
        }
        assert_eq!(std::fs::read_to_string(path("old.json")).expect("untouched"), "old");
        assert!(!path("new.json").exists() && !path("target.json").exists() && path("link.json").is_symlink());
    }
}
