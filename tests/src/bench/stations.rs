//! `cargo xtask bench stations`: many stations on one machine; what each takes, and which are late because of another.
//!
//! Each station is a process of its own, with its guardian, as a unit would start it. Nothing is shared but pages of
//! programs, plugins and libraries.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::peer::Failure;

/// So many stations at a time, and the cycle, in milliseconds.
pub const LADDER: [(usize, u64); 8] =
    [(1, 10), (10, 10), (50, 10), (100, 10), (1, 100), (10, 100), (50, 100), (100, 100)];
/// What a station may take beyond pages that others have, too.
const OWN: u64 = 12 << 10;
/// So long the slowest station may take to its first scans.
const START: Duration = Duration::from_secs(600);

/// Runs so many stations at a cycle, for so many seconds; whether none stopped, and each kept within its memory.
///
/// # Errors
/// If a station does not start, or does not answer.
pub fn measure(ob1: &Path, count: usize, cycle: u64, seconds: u64) -> Result<bool, Failure> {
    let site = Site::new(ob1)?;
    let mut stations = Vec::new();
    for number in 1..=count {
        stations.push(site.start(number, cycle)?);
    }
    let begin = Instant::now();
    while site.listed()?.iter().filter(|one| one["state"] == "RUN" && one["scans"].as_u64() > Some(5)).count() < count {
        if begin.elapsed() > START {
            return Err(format!("not all of {count} stations are in RUN after {} s", START.as_secs()).into());
        }
        pass(Duration::from_millis(200));
    }
    for number in 1..=count {
        site.ask(number, r#"{"op":"reset_statistics"}"#)?;
    }
    let began = (Instant::now(), cpu_ticks(&stations)?);
    pass(Duration::from_secs(seconds));
    let used = cpu_ticks(&stations)?.saturating_sub(began.1);
    let lasted = began.0.elapsed().as_secs_f64();
    let mut timings = Vec::new();
    for number in 1..=count {
        timings.push(site.ask(number, r#"{"op":"timing"}"#)?["timing"].clone());
    }
    let listed = site.listed()?;
    let stopped = count - listed.iter().filter(|one| one["state"] == "RUN").count();
    let memory = stations.iter().map(|station| own_kib(station.id())).collect::<Result<Vec<_>, _>>()?;
    let most = memory.iter().copied().max().unwrap_or(0);
    let sum = |key: &str| timings.iter().filter_map(|timing| timing[key].as_u64()).sum::<u64>();
    let worst = |share: &str| timings.iter().filter_map(|timing| timing["wake"][share].as_u64()).max().unwrap_or(0);
    let late: u64 = timings.iter().filter_map(|timing| timing["late"]["scans"].as_u64()).sum();
    println!(
        "{count:>3} stations at {cycle:>3} ms, {seconds} s: {} scans, {late} late, {} missed, {stopped} in STOP; wake p99 {:.0} µs, worst {:.1} ms; \
         own memory {:.1} MiB (most {:.1}); {:.1} % of a core together",
        sum("scans"),
        sum("missed"),
        worst("p99_ns") as f64 / 1e3,
        worst("max_ns") as f64 / 1e6,
        memory.iter().sum::<u64>() as f64 / memory.len().max(1) as f64 / 1024.0,
        most as f64 / 1024.0,
        // A tick is 10 ms.
        used as f64 / lasted
    );
    causes(&timings);
    Ok(stopped == 0 && most <= OWN)
}

/// The time that is measured passes.
pub(super) fn pass(time: Duration) {
    let (_nobody, says) = std::sync::mpsc::channel::<()>();
    let _ = says.recv_timeout(time);
}

/// The causes of late scans, and whose fault they were: `kernel` names the process that had the core.
fn causes(timings: &[Value]) {
    let mut classes = std::collections::BTreeMap::<String, (u64, u64)>::new();
    let mut others = std::collections::BTreeMap::<String, u64>::new();
    for timing in timings {
        for (class, total) in timing["late"]["classes"].as_object().into_iter().flatten() {
            let of = classes.entry(class.clone()).or_default();
            of.0 += total["scans"].as_u64().unwrap_or(0);
            of.1 += total["time_ns"].as_u64().unwrap_or(0);
        }
        for entry in timing["late"]["worst"].as_array().into_iter().flatten() {
            *others.entry(entry["what"].as_str().unwrap_or_default().to_owned()).or_default() += 1;
        }
    }
    for (class, (scans, time)) in classes {
        println!("      late by {class}: {scans} scans, {:.1} ms together", time as f64 / 1e6);
    }
    let mut others: Vec<(String, u64)> = others.into_iter().collect();
    others.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    for (what, count) in others.into_iter().take(4) {
        println!("      of the longest {count}: {what}");
    }
}

/// A folder of many stations, with a runtime directory of its own.
struct Site {
    ob1: PathBuf,
    folder: PathBuf,
}

impl Site {
    fn new(ob1: &Path) -> Result<Self, Failure> {
        let folder = std::env::temp_dir().join(format!("ob1-bench-stations-{}", std::process::id()));
        std::fs::create_dir_all(folder.join("run"))?;
        std::fs::write(folder.join("plant.awl"), PROGRAM)?;
        Ok(Self { ob1: ob1.to_owned(), folder })
    }

    fn start(&self, number: usize, cycle: u64) -> Result<Station, Failure> {
        let folder = self.folder.join(format!("rack{number}"));
        std::fs::create_dir_all(&folder)?;
        std::fs::write(
            folder.join("station.toml"),
            format!(
                "[station]\nname = \"{{folder}}\"\n\n[cpu]\nmin_cycle = \"{cycle}ms\"\nwatchdog = \"5s\"\n\n\
                 [program]\nsources = [\"../plant.awl\"]\n\n[retentive]\n\n[cpu.realtime]\npriority = 50\n"
            ),
        )?;
        let mut command = self.command();
        command.args(["run", "--quiet"]).arg(folder.join("station.toml")).current_dir(&folder).stdin(Stdio::null());
        let log = std::fs::File::create(folder.join("log"))?;
        Ok(Station(command.stdout(Stdio::null()).stderr(log).spawn()?))
    }

    fn command(&self) -> Command {
        let mut command = Command::new(&self.ob1);
        command.env("XDG_RUNTIME_DIR", self.folder.join("run"));
        command
    }

    fn listed(&self) -> Result<Vec<Value>, Failure> {
        let output = self.command().args(["list", "--json"]).stderr(Stdio::null()).output()?;
        let own = |one: &Value| one["folder"].as_str().is_some_and(|at| Path::new(at).starts_with(&self.folder));
        let all: Vec<Value> = serde_json::from_slice(&output.stdout)?;
        Ok(all.into_iter().filter(own).collect())
    }

    /// Asks a station over its socket, by its own language: no process is started for it.
    fn ask(&self, number: usize, request: &str) -> Result<Value, Failure> {
        use std::io::{BufRead as _, Write as _};
        let socket = self.folder.join(format!("run/ob1/rack{number}/control.sock"));
        let mut stream = std::os::unix::net::UnixStream::connect(socket)?;
        writeln!(stream, "{request}")?;
        let mut line = String::new();
        std::io::BufReader::new(stream).read_line(&mut line)?;
        Ok(serde_json::from_str(&line)?)
    }
}

impl Drop for Site {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

struct Station(Child);

impl Station {
    fn id(&self) -> u32 {
        self.0.id()
    }
}

impl Drop for Station {
    fn drop(&mut self) {
        // In order: a station that is killed leaves its guardian.
        if Command::new("kill").arg("-TERM").arg(self.id().to_string()).status().is_err() {
            let _ = self.0.kill();
        }
        let _ = self.0.wait();
    }
}

/// A conveyor with timers and a recipe: a few hundred statements.
const PROGRAM: &str = include_str!("stations.awl");

/// What a process has that no other has, in KiB: the pages it has written.
pub(super) fn own_kib(pid: u32) -> Result<u64, Failure> {
    let text = std::fs::read_to_string(format!("/proc/{pid}/smaps_rollup"))?;
    let of = |name: &str| -> u64 {
        let lines = text.lines().filter_map(|line| line.strip_prefix(name));
        lines.filter_map(|rest| rest.trim().trim_end_matches("kB").trim().parse::<u64>().ok()).sum()
    };
    // Pages that are private and clean are those of its program, where no other runs it.
    Ok(of("Private_Dirty:"))
}

/// User and system time of all stations, in ticks.
fn cpu_ticks(stations: &[Station]) -> Result<u64, Failure> {
    stations.iter().map(|station| ticks(station.id())).sum()
}

/// User and system time of a process, in ticks.
pub(super) fn ticks(pid: u32) -> Result<u64, Failure> {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat"))?;
    let (_, rest) = stat.rsplit_once(')').ok_or("no name in stat")?;
    let words: Vec<&str> = rest.split_whitespace().collect();
    Ok([11, 12].iter().filter_map(|at| words.get(*at)?.parse::<u64>().ok()).sum())
}
