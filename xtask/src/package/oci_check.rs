//! `cargo xtask package --oci --check`: the image, run rootless by podman.
//!
//! Station A of the demo runs in the container; station B, its partner, runs outside, and both are connected by a
//! pseudo terminal that the container gets as a device. podman runs as a user without rights: as ours, or, for root, as
//! one that is made for the check.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use super::oci::{self, Image};
use super::parts::Parts;
use super::podman::Podman;
use super::{Site, digest};
use crate::cargo;
use crate::failure::{Outcome, step};
use crate::{needs, shell};

/// What the issue of a container asks for.
const SLOWEST_START: Duration = Duration::from_secs(3);
/// Bytes of the image as a registry has it.
const LARGEST: u64 = 60_000_000;
/// Telegrams that have to come back before the kill, and after it.
const TELEGRAMS: u64 = 50;
const STARTS: usize = 3;
const PATIENCE: Duration = Duration::from_secs(60);
/// Runs of each kind beside each other, and how long each lasts.
const PAIRS: usize = 5;
const RUN: &str = "4s";
pub(super) fn run(site: &Site, parts: &Parts, image: &Image) -> Outcome {
    needs::satisfy(&[needs::PODMAN])?;
    let passed = |what: &str| println!("ok  {what}");
    let before = digest(&image.oci)?;
    let after = digest(&oci::build(site, parts)?.oci)?;
    if before != after {
        return Err(step(format!("made twice, not the same: {before}, then {after}")));
    }
    passed("made twice, the same to the byte");
    let bytes = std::fs::metadata(&image.oci).map_err(|why| step(format!("{}: {why}", image.oci.display())))?.len();
    if bytes > LARGEST {
        return Err(step(format!("{bytes} bytes; {LARGEST} are allowed")));
    }
    passed(&format!("{:.1} MB as it is sent, {:.1} MB of files", bytes as f64 / 1e6, image.kib as f64 * 1.024e-3));
    let engine = Engine::new(site, image)?;
    let mut started = engine.start()?;
    // A machine that is busy with others gets another chance, and a third.
    for _ in 1..STARTS {
        if started > SLOWEST_START {
            engine.podman(&["rm", "--force", "--time", "5", CONTAINER])?;
            started = engine.start()?;
        }
    }
    if started > SLOWEST_START {
        return Err(step(format!("RUN after {started:?}; {SLOWEST_START:?} are allowed")));
    }
    passed(&format!("in RUN {:.2} s after podman run, rootless, with a read-only root", started.as_secs_f64()));
    engine.podman(&["healthcheck", "run", CONTAINER])?;
    passed("its health check says so, too");
    engine.telegrams()?;
    passed(&format!("{TELEGRAMS} telegrams there and back over a pseudo terminal"));
    let kept = killed_and_back(&engine)?;
    passed(&kept);
    engine.writes_to_its_volume()?;
    passed("nothing is written outside of its volume");
    let stopped = Instant::now();
    engine.podman(&["stop", "--time", "10", CONTAINER])?;
    let code = engine.podman(&["inspect", "--format", "{{.State.ExitCode}}", CONTAINER])?;
    if code.trim() != "0" {
        return Err(step(format!("podman stop: exit code {}", code.trim())));
    }
    passed(&format!("SIGTERM ends it in order, in {:.1} s", stopped.elapsed().as_secs_f64()));
    passed(&engine.wake_up(site)?);
    Ok(())
}

/// The short form for the tests: it starts, is killed and back with its values, and writes to its volume alone. Where
/// this machine runs no containers without rights, or cannot make an image, the text says so.
pub(super) fn short(site: &Site, parts: &Parts) -> Outcome<String> {
    let possible = needs::satisfy(&[needs::BUILDAH, needs::PODMAN])
        .and_then(|()| oci::probe(site))
        .and_then(|probe| Podman::new()?.probe(&probe));
    if let Err(why) = possible {
        return Ok(format!("SKIPPED, this machine runs no containers without rights: {}", last_line(&why.to_string())));
    }
    let image = oci::build(site, parts)?;
    let engine = Engine::new(site, &image)?;
    let started = engine.start()?;
    let kept = killed_and_back(&engine)?;
    engine.writes_to_its_volume()?;
    Ok(format!("in RUN {:.2} s after podman run without rights; {kept}; nothing else written", started.as_secs_f64()))
}

/// The reason: tools say what they do before it.
fn last_line(text: &str) -> &str {
    text.lines().map(str::trim).rfind(|line| !line.is_empty()).unwrap_or_default()
}

const CONTAINER: &str = "ob1-check";

/// `kill -9`, and a start: the value that was set is there, and telegrams come back.
fn killed_and_back(engine: &Engine) -> Outcome<String> {
    engine.ob1(&["set", STATION, "MW200=4711"])?;
    // Retentive memory is written each second.
    thread::sleep(Duration::from_secs(3));
    engine.podman(&["kill", "--signal", "KILL", CONTAINER])?;
    engine.podman(&["wait", CONTAINER])?;
    engine.podman(&["start", CONTAINER])?;
    engine.until("RUN after the kill", |engine| engine.ob1(&["ctl", STATION, "ready"]).is_ok().then_some(()))?;
    let value = engine.ob1(&["get", STATION, "MW200"])?;
    if !value.contains("4711") {
        return Err(step(format!("the value is lost: {value}")));
    }
    engine.telegrams()?;
    Ok(format!("killed and back with its values; {TELEGRAMS} more telegrams"))
}

/// The station file in the container.
const STATION: &str = "/etc/ob1/station.toml";

/// The image under podman, and its partner outside.
struct Engine {
    podman: Podman,
    image: String,
    partner: Child,
    ob1: PathBuf,
}

impl Engine {
    fn new(site: &Site, image: &Image) -> Outcome<Self> {
        let podman = Podman::new()?;
        stations(&podman.folder)?;
        let partner = partner(site, &podman.folder)?;
        let engine = Self { podman, image: image.name.clone(), partner, ob1: site.built.join("ob1") };
        engine.until("the partner has its line", |engine| engine.line().ok())?;
        engine.podman(&["load", "--quiet", "--input", &image.docker.display().to_string()])?;
        Ok(engine)
    }

    fn podman(&self, args: &[&str]) -> Outcome<String> {
        self.podman.run(args)
    }

    /// `ob1` in the container.
    fn ob1(&self, args: &[&str]) -> Outcome<String> {
        self.podman(&[&["exec", CONTAINER, "/usr/bin/ob1"], args].concat())
    }

    /// The pseudo terminal of the partner.
    fn line(&self) -> Outcome<String> {
        let link = self.podman.folder.join("outside/null-modem.pty");
        let path = std::fs::canonicalize(&link).map_err(|why| step(format!("{}: {why}", link.display())))?;
        // The user of the container opens it.
        let mode = std::os::unix::fs::PermissionsExt::from_mode(0o666);
        std::fs::set_permissions(&path, mode).map_err(|why| step(format!("{}: {why}", path.display())))?;
        Ok(path.display().to_string())
    }

    /// Starts the container; how long it took until the station was in RUN.
    fn start(&self) -> Outcome<Duration> {
        let device = format!("--device={}:/dev/ttyOB1", self.line()?);
        let options = self.podman.options(&[device]);
        let mut args = vec!["run", "--detach", "--name", CONTAINER];
        args.extend(options.iter().map(String::as_str));
        args.push(&self.image);
        let begin = Instant::now();
        self.podman(&args)?;
        self.until("RUN", |engine| engine.ob1(&["ctl", STATION, "ready"]).is_ok().then_some(()))?;
        Ok(begin.elapsed())
    }

    fn writes_to_its_volume(&self) -> Outcome {
        let written = self.podman(&["diff", CONTAINER])?;
        // Where something is mounted or handed in, podman makes the place for it.
        let own = |line: &&str| {
            !["/run", "/tmp", "/etc", "/dev", "/proc", "/sys", "/var"].iter().any(|at| line[2..].starts_with(at))
        };
        match written.lines().filter(|line| line.len() > 2).find(own) {
            Some(line) => Err(step(format!("written outside of its volume: {line}"))),
            None => Ok(()),
        }
    }

    /// Telegrams that have come back right, as the program counts them.
    fn good(&self) -> Option<u64> {
        self.ob1(&["get", STATION, "DB20.GOOD"]).ok()?.split_whitespace().nth(1)?.parse().ok()
    }

    /// Waits until so many more telegrams have come back right.
    fn telegrams(&self) -> Outcome {
        let before = self.until("the program counts", Self::good)?;
        self.until("telegrams come back", |engine| (engine.good()? >= before + TELEGRAMS).then_some(()))
    }

    fn until<T>(&self, what: &str, look: impl Fn(&Self) -> Option<T>) -> Outcome<T> {
        let begin = Instant::now();
        loop {
            if let Some(found) = look(self) {
                return Ok(found);
            }
            if begin.elapsed() > PATIENCE {
                let log = self.podman(&["logs", CONTAINER]).unwrap_or_default();
                return Err(step(format!("{what}: not after {} s\n{log}", PATIENCE.as_secs())));
            }
            thread::sleep(Duration::from_millis(20));
        }
    }

    /// The wake-up of the same station, outside and inside, in turns: how the runs outside differ among themselves is
    /// the limit.
    fn wake_up(&self, site: &Site) -> Outcome<String> {
        let (mut outside, mut inside) = (Vec::new(), Vec::new());
        for pair in 0..PAIRS {
            outside.push(self.outside(site, &format!("outside-{pair}"))?);
            inside.push(self.inside(&format!("inside-{pair}"))?);
        }
        outside.push(self.outside(site, "outside-last")?);
        let range =
            |values: &[u64]| (values.iter().copied().min().unwrap_or(0), values.iter().copied().max().unwrap_or(0));
        let middle = |values: &[u64]| {
            let mut sorted = values.to_vec();
            sorted.sort_unstable();
            sorted.get(sorted.len() / 2).copied().unwrap_or(0) as f64 / 1e3
        };
        let (low, high) = range(&outside);
        let told = format!(
            "wake-up p99 outside {:.0} µs ({:.0} .. {:.0} in {} runs), inside {:.0} µs",
            middle(&outside),
            low as f64 / 1e3,
            high as f64 / 1e3,
            outside.len(),
            middle(&inside)
        );
        if middle(&inside) * 1e3 <= high as f64 { Ok(told) } else { Err(step(format!("{told}: beyond A/A"))) }
    }

    fn outside(&self, site: &Site, name: &str) -> Outcome<u64> {
        let report = self.podman.folder.join("state").join(name);
        let mut command = Command::new(&self.ob1);
        command
            .args(["run", "--quiet", "--for", RUN, "--report"])
            .arg(&report)
            .arg(self.podman.folder.join("outside/wake.toml"));
        command.env("XDG_RUNTIME_DIR", self.podman.folder.join("outside")).env("OB1_PLUGIN_DIR", &site.built);
        shell::read(&mut command)?;
        wake_p99(&report)
    }

    fn inside(&self, name: &str) -> Outcome<u64> {
        let options = self.podman.options(&[]);
        let report = format!("/var/lib/ob1/{name}");
        let mut args = vec!["run", "--rm"];
        args.extend(options.iter().map(String::as_str));
        args.extend([&self.image, "run", "--quiet", "--for", RUN, "--report", &report, "/etc/ob1/wake.toml"]);
        self.podman(&args)?;
        wake_p99(&self.podman.folder.join("state").join(name))
    }
}

impl Drop for Engine {
    fn drop(&mut self) {
        let _ = Command::new("kill").arg("-TERM").arg(self.partner.id().to_string()).status();
        let _ = self.partner.wait();
    }
}

/// The wake-up in the report of a run, in nanoseconds.
fn wake_p99(report: &Path) -> Outcome<u64> {
    let text = std::fs::read_to_string(report).map_err(|why| step(format!("{}: {why}", report.display())))?;
    let value: serde_json::Value = serde_json::from_str(&text).map_err(|why| step(why.to_string()))?;
    let found = value.pointer("/timing/wake/p99_ns").or_else(|| value.pointer("/status/wake/p99_ns"));
    found.and_then(serde_json::Value::as_u64).ok_or_else(|| step("the report has no wake-up"))
}

/// Station A as the container gets it, the same without a CP for its wake-up, and station B outside.
fn stations(folder: &Path) -> Outcome {
    let example = cargo::root().join("examples/two-stations");
    let read = |name: &str| std::fs::read_to_string(example.join(name)).map_err(|why| step(format!("{name}: {why}")));
    let write =
        |name: &str, text: &str| std::fs::write(folder.join(name), text).map_err(|why| step(format!("{name}: {why}")));
    let kept = "\n[retentive]\nmemory = [\"200..209\"]\n";
    let a = read("station-a.toml")?.replace("pty:null-modem.pty", "serial:/dev/ttyOB1") + kept;
    write("station/station.toml", &a)?;
    write("station/a.awl", &read("a.awl")?)?;
    write("outside/b.awl", &read("b.awl")?)?;
    write("outside/station.toml", &read("station-b.toml")?.replace("serial:null-modem.pty", "pty:null-modem.pty"))?;
    let wake = "[station]\nname = \"wake\"\n\n[cpu]\nmin_cycle = \"1ms\"\nwatchdog = \"1s\"\n\n[program]\nsources = [\"wake.awl\"]\n";
    let empty = "ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\n      L     MW 100;\n      +     1;\n      T     MW 100;\nEND_ORGANIZATION_BLOCK\n";
    for at in ["station", "outside"] {
        write(&format!("{at}/wake.toml"), wake)?;
        write(&format!("{at}/wake.awl"), empty)?;
    }
    Ok(())
}

fn partner(site: &Site, folder: &Path) -> Outcome<Child> {
    let mut command = Command::new(site.built.join("ob1"));
    command.args(["run", "--quiet", "station.toml"]).current_dir(folder.join("outside"));
    command.env("XDG_RUNTIME_DIR", folder.join("outside")).env("OB1_PLUGIN_DIR", &site.built);
    command.stdin(Stdio::null()).stdout(Stdio::null()).spawn().map_err(|why| step(format!("ob1: {why}")))
}
