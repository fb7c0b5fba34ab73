//! For how many late scans a cause is found on an overloaded machine: a station without real-time rights, with four
//! computing threads and one that writes and flushes.
//!
//! `ob1 soak` runs the stations, creates the load and records the causes; this module reads the result.

use std::path::Path;
use std::process::{Command, Stdio};

use ob1_command::soak::Report;
use ob1_timing::Class;
use ob1_timing::snapshot::LateReport;

use super::peer::Failure;

/// Default run time of each station.
pub const SECONDS: u64 = 60;
/// The load on the machine.
const LOAD: &str = "cpu=4,io=1";
/// Share of the late scans that must have a cause.
const AIM: f64 = 0.95;
/// With fewer late scans the share has no meaning.
const ENOUGH: u64 = 100;

/// Names, intervals, and iterations of the program's loop of three statements.
const STATIONS: [(&str, &str, u32); 3] =
    [("short", "1ms", 200), ("usual", "10ms", 200), ("long-program", "10ms", 60_000)];

/// Runs all stations and prints why their scans were late; true if enough causes are known for all.
///
/// # Errors
/// If a station cannot be run, or had too few late scans.
pub fn measure(ob1: &Path, seconds: u64) -> Result<bool, Failure> {
    println!(
        "late scans by cause: {seconds} s each, default posture, under {LOAD}; aim: {:.0} % explained",
        AIM * 100.0
    );
    let mut met = true;
    for (name, interval, turns) in STATIONS {
        let report = run(ob1, name, interval, turns, seconds)?;
        let timing = report.timing.ok_or_else(|| format!("{name}: the soak has no accounts: {}", report.end))?;
        let late = &timing.late;
        let share = explained(late);
        println!(
            "\n{name}: every {interval}, {} scans, {} late, {:.2} % explained",
            timing.scans,
            late.scans,
            share * 100.0
        );
        for (class, total) in &late.classes {
            let ms = total.worst_ns as f64 / 1e6;
            println!("  {:<28} {:>8}   longest {ms:>8.3} ms", class.name(), total.scans);
        }
        for entry in &late.unexplained {
            println!("    scan {}: {:.3} ms, {}", entry.scan, entry.size_ns as f64 / 1e6, entry.what);
        }
        if late.scans < ENOUGH {
            return Err(format!(
                "only {} late scans: this machine is not busy enough, or the time too short",
                late.scans
            )
            .into());
        }
        met &= share >= AIM;
    }
    println!("\n{}", if met { "aim met" } else { "aim MISSED" });
    Ok(met)
}

/// The share of late scans with a cause. Those too fast one after the other to be examined have none.
fn explained(late: &LateReport) -> f64 {
    let told: u64 = late.classes.values().map(|total| total.scans).sum();
    let unexplained = late.classes.get(&Class::Unexplained).map_or(0, |total| total.scans);
    let all = told + late.lost;
    if all == 0 { 0.0 } else { (told - unexplained) as f64 / all as f64 }
}

fn run(ob1: &Path, name: &str, interval: &str, turns: u32, seconds: u64) -> Result<Report, Failure> {
    let folder = std::env::temp_dir().join(format!("ob1-bench-causes-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let station = format!(
        "[station]\nname = \"causes-{name}\"\n[cpu]\nmin_cycle = \"{interval}\"\nwatchdog = \"5s\"\n\
         [program]\nsources = [\"{name}.awl\"]\n"
    );
    let program = format!(
        "ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\nL W#16#{turns:X};\nturn: T MW 212;\nL MW 212;\nLOOP turn;\n\
         END_ORGANIZATION_BLOCK\n",
    );
    std::fs::write(folder.join(format!("{name}.toml")), station)?;
    std::fs::write(folder.join(format!("{name}.awl")), program)?;
    let base = folder.join(name);
    let time = format!("{seconds}s");
    let told = Command::new(ob1)
        .arg("soak")
        .arg(folder.join(format!("{name}.toml")))
        .args(["--for", &time, "--load", LOAD, "--report"])
        .arg(&base)
        .stdin(Stdio::null())
        .output()?;
    let report = std::fs::read(base.with_extension("json"));
    let _ = std::fs::remove_dir_all(&folder);
    let report = report.map_err(|why| format!("{why}\n{}", String::from_utf8_lossy(&told.stderr)))?;
    Ok(serde_json::from_slice(&report)?)
}
