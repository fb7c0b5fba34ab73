//! Resident memory of the demo's station A and of its driver; and the additional memory for machine code.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use super::Figure;
use super::peer::Failure;

const GUARD: Duration = Duration::from_secs(30);
/// Scans before the measurement, so that all memory in use has been touched.
const SETTLED: u64 = 3000;

/// Runs the measurement: runtime, driver, and what the native engine adds to the runtime.
///
/// # Errors
/// If the station does not start.
pub fn measure() -> Result<[Figure; 3], Failure> {
    let binaries = std::env::var_os("OB1_BIN_DIR").ok_or("OB1_BIN_DIR is not set; run: cargo xtask bench")?;
    let reference = {
        let station = Station::start(Path::new(&binaries), "reference")?;
        station.settle("reference")?;
        resident_kib(station.process.id())?
    };
    let station = Station::start(Path::new(&binaries), "auto")?;
    station.settle("native")?;
    let runtime = resident_kib(station.process.id())?;
    let driver = station.driver()?;
    let driver = resident_kib(driver)?;
    let figure = |what: &'static str, value: u64, aim, most: u64| Figure {
        what: what.into(),
        value: value as f64 / 1024.0,
        unit: "MiB",
        floor: None,
        aim: (aim, value <= most * 1024),
    };
    Ok([
        figure("resident memory, runtime of station A", runtime, "<= 30 MB", 30),
        figure("resident memory, its driver process", driver, "<= 10 MB", 10),
        figure("memory of the runtime, more with machine code", runtime.saturating_sub(reference), "<= 30 MB", 30),
    ])
}

struct Station {
    process: Child,
    ob1: PathBuf,
    folder: PathBuf,
}

impl Station {
    /// Starts station A with locked memory, in its own folder, on this engine.
    fn start(binaries: &Path, engine: &str) -> Result<Self, Failure> {
        let folder = std::env::temp_dir().join(format!("ob1-bench-memory-{}", std::process::id()));
        std::fs::create_dir_all(&folder)?;
        let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/two-stations");
        std::fs::copy(example.join("a.awl"), folder.join("a.awl"))?;
        let text = std::fs::read_to_string(example.join("station-a.toml"))?;
        let text = text.replace("two-stations-a", "bench-memory-a");
        let with_engine = text.replacen("[cpu]\n", &format!("[cpu]\nengine = \"{engine}\"\n"), 1);
        let text = if with_engine == text { format!("{text}\n[cpu]\nengine = \"{engine}\"\n") } else { with_engine };
        std::fs::write(folder.join("station.toml"), format!("{text}\n[cpu.realtime]\nlock_memory = true\n"))?;
        let ob1 = binaries.join("ob1");
        let process = Command::new(&ob1)
            .args(["run", "--quiet"])
            .arg(folder.join("station.toml"))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()?;
        Ok(Self { process, ob1, folder })
    }

    fn status(&self) -> Option<serde_json::Value> {
        let output = Command::new(&self.ob1)
            .arg("ctl")
            .arg(self.folder.join("station.toml"))
            .args(["status", "--json"])
            .stderr(Stdio::null())
            .output()
            .ok()?;
        serde_json::from_slice(&output.stdout).ok()
    }

    /// Waits until it has run for a number of scans on this engine.
    fn settle(&self, engine: &str) -> Result<(), Failure> {
        let start = Instant::now();
        let settled = |status: serde_json::Value| {
            status["scans"].as_u64().is_some_and(|scans| scans >= SETTLED) && status["engine"] == engine
        };
        while !self.status().is_some_and(settled) {
            if start.elapsed() > GUARD {
                return Err(format!("station A does not get to {SETTLED} scans: {:?}", self.status()).into());
            }
        }
        Ok(())
    }

    /// The process ID of its driver.
    fn driver(&self) -> Result<u32, Failure> {
        let own = self.process.id();
        for entry in std::fs::read_dir("/proc")? {
            let Some(pid) = entry?.file_name().to_str().and_then(|name| name.parse::<u32>().ok()) else { continue };
            let Ok(stat) = std::fs::read_to_string(format!("/proc/{pid}/stat")) else { continue };
            // "pid (name) state parent ...": the name may contain anything but ends at the last bracket.
            let Some((name, rest)) = stat.rsplit_once(')') else { continue };
            let parent = rest.split_whitespace().nth(1).and_then(|p| p.parse::<u32>().ok());
            if parent == Some(own) && name.ends_with("(ob1-cp") {
                return Ok(pid);
            }
        }
        Err("station A has no driver process".into())
    }
}

impl Drop for Station {
    fn drop(&mut self) {
        let stopped = Command::new("kill").arg("-TERM").arg(self.process.id().to_string()).status();
        if stopped.is_err() {
            let _ = self.process.kill();
        }
        let _ = self.process.wait();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

fn resident_kib(pid: u32) -> Result<u64, Failure> {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status"))?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).ok_or("no VmRSS")?;
    Ok(line.trim().trim_end_matches("kB").trim().parse()?)
}
