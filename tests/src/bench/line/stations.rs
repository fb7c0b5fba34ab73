//! User data end to end: two whole stations in the simulation, FC 0 on one side, FC 1 on the other, a scan of 1 ms.

use std::path::{Path, PathBuf};

use ob1_line::sim::FaultRates;
use ob1_protocols::SECOND;
use ob1_time::Span;

use super::super::peer::Failure;
use super::queue::PAYLOAD;
use crate::sim::{self, Scenario};

/// Bytes of user data per second over 3964R: telegrams of [`PAYLOAD`] bytes, one after the other.
///
/// # Errors
/// If the stations cannot be built.
pub(super) fn end_to_end(baud: u32) -> Result<f64, Failure> {
    let folder = std::env::temp_dir().join(format!("ob1-bench-line-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let done = |duration: Span| -> Result<u32, Failure> {
        let stations = write_stations(&folder, baud)?;
        let scenario = Scenario {
            stations,
            seed: 1,
            duration,
            faults: FaultRates::NONE,
            coalesce: Span::ZERO,
            kill_every: Span::ZERO,
            call: Span::ZERO,
            wire: false,
        };
        let outcome = sim::run(&scenario)?;
        outcome.stations.iter().map(|station| station.ledger(20, 0)).max().ok_or_else(|| "no station".into())
    };
    // The start-up is not included.
    let (first, second) = (20 * SECOND, 120 * SECOND);
    let telegrams = done(second)?.saturating_sub(done(first)?);
    std::fs::remove_dir_all(&folder)?;
    Ok(f64::from(telegrams) * PAYLOAD as f64 * SECOND.nanos() as f64 / (second - first).nanos() as f64)
}

fn write_stations(folder: &Path, baud: u32) -> Result<Vec<PathBuf>, Failure> {
    let mut stations = Vec::new();
    for (name, program, line, priority) in [
        ("bench-sender", include_str!("sender.awl"), "pty:bench.pty", "high"),
        ("bench-receiver", include_str!("receiver.awl"), "serial:bench.pty", "low"),
    ] {
        std::fs::write(folder.join(format!("{name}.awl")), program)?;
        let text = format!(
            "[station]\nname = \"{name}\"\n[cpu]\nmin_cycle = \"1ms\"\n[program]\nsources = [\"{name}.awl\"]\n[[plugin]]\npath = \
             \"ob1_cp240\"\n[[module]]\ntype = \"cp240\"\nname = \"cp\"\naddress = 0\nline = \"{line}\"\nparams = {{ protocol = \"3964r\", \
             baud = {baud}, priority = \"{priority}\" }}\n"
        );
        let path = folder.join(format!("{name}.toml"));
        std::fs::write(&path, text)?;
        stations.push(path);
    }
    Ok(stations)
}
