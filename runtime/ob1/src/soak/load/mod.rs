//! What a station is put under while it is judged: load generators with a seed, named in the report.
//!
//! They are threads of the soak's process, with the ordinary priority, and end with it. The station is another process:
//! what they allocate and write is not in its accounts.

mod generators;
mod kills;

use std::fs;
use std::str::FromStr;

pub(super) use generators::Generators;
pub(super) use kills::Kills;

use serde::{Deserialize, Serialize};

use super::budget::bytes;

/// Most threads of a kind.
const THREADS: u64 = 64;
/// Most driver kills a minute: a driver needs about a second to be back.
const KILLS: u64 = 60;

/// What was requested: `cpu=2,memory=64MiB,io=1,driver-kill=10/min`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Load {
    /// As it was written.
    pub text: String,
    cpu: u64,
    memory: u64,
    io: u64,
    /// Driver kills a minute.
    kills: u64,
    /// Faults on simulated lines, in characters per million.
    pub(super) line_faults: u64,
}

impl FromStr for Load {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut load = Self { text: text.to_owned(), ..Self::default() };
        for part in text.split(',').map(str::trim).filter(|part| !part.is_empty()) {
            let (name, amount) =
                part.split_once('=').ok_or_else(|| format!("\"{part}\" has no amount; write cpu=2"))?;
            let number = |most: u64, text: &str| {
                let number = text.trim().parse::<u64>().ok().filter(|n| (1..=most).contains(n));
                number.ok_or_else(|| format!("\"{part}\": the amount is a number from 1 to {most}"))
            };
            match name.trim() {
                "cpu" => load.cpu = number(THREADS, amount)?,
                "io" => load.io = number(THREADS, amount)?,
                "memory" => {
                    let size = bytes(amount.trim()).filter(|size| *size >= 1 << 20);
                    load.memory =
                        size.ok_or_else(|| format!("\"{part}\": write it like memory=64MiB, at least 1MiB"))?;
                }
                "driver-kill" => {
                    let rate = amount.trim().strip_suffix("/min");
                    load.kills = number(KILLS, rate.ok_or_else(|| format!("\"{part}\": write driver-kill=10/min"))?)?;
                }
                "line-faults" => load.line_faults = number(1_000_000, amount)?,
                other => {
                    return Err(format!(
                        "\"{other}\" is not a load; there are cpu, memory, io, driver-kill, line-faults"
                    ));
                }
            }
        }
        Ok(load)
    }
}

impl Load {
    /// Refuses what would bring the machine down rather than load it, and what this station has not got.
    pub(super) fn check(&self, simulated_lines: usize) -> Result<(), String> {
        if self.line_faults > 0 && simulated_lines == 0 {
            return Err(
                "line faults need a simulated line ([[simulated_line]] in the station file): on others they are real"
                    .into(),
            );
        }
        let Some(free) = available_memory() else { return Ok(()) };
        if self.memory > free / 2 {
            let (asked, free) = (self.memory >> 20, free >> 20);
            return Err(format!(
                "memory load of {asked} MiB: only {free} MiB are available, and half of that is the most"
            ));
        }
        Ok(())
    }
}

fn available_memory() -> Option<u64> {
    let text = fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

/// The load in the report.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LoadReport {
    /// As on the command line.
    pub spec: String,
    /// The seed of all generators.
    pub seed: u64,
    /// Slices of 100,000 turns the CPU load has done.
    pub cpu_slices: u64,
    /// Pages the memory load has written.
    pub memory_pages: u64,
    /// Blocks of 256 KiB the I/O load has written and flushed.
    pub io_blocks: u64,
    /// The I/O load could not write.
    pub io_errors: u64,
    /// Driver processes that were killed.
    pub driver_kills: u64,
    /// Faults on simulated lines, in characters per million.
    #[serde(default)]
    pub line_faults: u64,
}

impl LoadReport {
    /// What has been done.
    pub fn done(&self) -> String {
        let mut told = Vec::new();
        for (count, what) in [
            (self.cpu_slices, "slices of computing"),
            (self.memory_pages, "pages written"),
            (self.io_blocks, "blocks flushed"),
            (self.io_errors, "blocks that could not be written"),
            (self.driver_kills, "drivers killed"),
            (self.line_faults, "of a million characters with a fault"),
        ] {
            if count > 0 {
                told.push(format!("{count} {what}"));
            }
        }
        if told.is_empty() { "nothing yet".into() } else { told.join(", ") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loads_are_read_and_bounded() {
        let load: Load = "cpu=2, memory=64MiB,io=1,driver-kill=10/min".parse().expect("right");
        assert_eq!((load.cpu, load.memory, load.io, load.kills), (2, 64 << 20, 1, 10));
        assert!(load.check(0).is_ok());
        for (wrong, hint) in [
            ("cpu", "cpu=2"),
            ("cpu=0", "from 1 to 64"),
            ("cpu=65", "from 1 to 64"),
            ("memory=1KiB", "64MiB"),
            ("driver-kill=10", "10/min"),
            ("driver-kill=61/min", "from 1 to 60"),
            ("line-faults=1000001", "from 1 to 1000000"),
            ("network=1", "driver-kill"),
        ] {
            let error = wrong.parse::<Load>().expect_err(wrong);
            assert!(error.contains(hint), "{error}");
        }
        let all_of_it: Load = "memory=1000000GiB".parse().expect("right");
        assert!(all_of_it.check(0).is_err());
        let faults: Load = "line-faults=500".parse().expect("right");
        assert!(faults.check(1).is_ok() && faults.check(0).is_err());
    }
}
