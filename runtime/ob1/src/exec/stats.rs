//! `--stats FILE.json`: the figures of a run.

use std::io;
use std::path::Path;
use std::time;

use ob1_cpu::Cpu;
use ob1_time::Instant;
use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;

use crate::exit::ExecExit;

/// Version of the form of the figures: raised when a field changes its meaning or goes.
pub const STATS_SCHEMA: u32 = 1;

/// The figures of a run. Reading and compiling the sources is not part of them.
#[derive(Clone, Debug, Serialize)]
pub struct Stats {
    /// Version of this form, [`STATS_SCHEMA`].
    pub schema: u32,
    /// Exit code of the command.
    pub exit: u8,
    /// How the run ended: `stopped`, `limit` or `fault`.
    pub ended: &'static str,
    /// Name of the engine that ran at the end.
    pub engine: &'static str,
    /// Cycles of OB 1.
    pub scans: u64,
    /// Statements executed in all cycles.
    pub statements: u64,
    /// CPU time of the run.
    pub cpu_seconds: f64,
    /// Real time of the run.
    pub wall_seconds: f64,
    /// Statements executed by CPU time.
    pub statements_per_second: f64,
    /// The CPU's own time at the end, virtual or real.
    pub plc_seconds: f64,
}

impl Stats {
    /// Writes the figures as JSON.
    pub(super) fn write(&self, path: &Path) -> io::Result<()> {
        let mut text = serde_json::to_string_pretty(self)?;
        text.push('\n');
        ob1_process::files::write(path, text.as_bytes())
    }
}

/// Takes the times of a run.
pub(super) struct Meter {
    wall: time::Instant,
    cpu_seconds: f64,
}

impl Meter {
    pub(super) fn start() -> Self {
        Self { wall: time::Instant::now(), cpu_seconds: cpu_seconds() }
    }

    pub(super) fn stop(&self, cpu: &Cpu, now: Instant, exit: ExecExit) -> Stats {
        let (wall_seconds, cpu_seconds) = (self.wall.elapsed().as_secs_f64(), cpu_seconds() - self.cpu_seconds);
        let statistics = cpu.statistics();
        Stats {
            schema: STATS_SCHEMA,
            exit: exit.code(),
            ended: exit.name(),
            engine: cpu.engine(),
            scans: statistics.scans,
            statements: statistics.statements,
            cpu_seconds,
            wall_seconds,
            statements_per_second: if cpu_seconds > 0.0 { statistics.statements as f64 / cpu_seconds } else { 0.0 },
            plc_seconds: now.since_start().as_secs_f64(),
        }
    }
}

/// CPU time of this thread.
fn cpu_seconds() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 / 1e9
}
