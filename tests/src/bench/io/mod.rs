//! Remote I/O over Modbus TCP on this machine: 32 couplers with 16 bytes in each direction at a cycle of 10 ms, the
//! time from an input through OB 1 to an output, and requests per second compared with libmodbus' client on the same
//! server.

mod server;

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use ob1_command::statistics::quantile;
use ob1_station::access::client::Client;
use ob1_station::access::protocol::{BusStatus, Op};
use ob1_time::Span;

use super::peer::Failure;
use super::{Figure, median};
use server::Bank;

const COUPLERS: usize = 32;
/// Words of each coupler in each direction: 16 bytes.
const WORDS: usize = 8;
const CYCLE: Duration = Duration::from_millis(10);
/// Ranges of the coupler that is read as fast as possible; they are not adjacent, so each needs its own request.
const RANGES: usize = 60;
/// Number of alternating rounds of ob1 and libmodbus.
const TURNS: usize = 3;
/// Requests of libmodbus in a round.
const REQUESTS: u32 = 20_000;
const GUARD: Duration = Duration::from_secs(90);

/// Measures for about this time.
///
/// # Errors
/// If the station cannot be run, or the partner does not exist.
pub fn measure(seconds: u64) -> Result<Vec<Figure>, Failure> {
    let seconds = Duration::from_secs(seconds.max(1));
    let mut figures = exchange(seconds)?;
    figures.push(requests(seconds)?);
    Ok(figures)
}

fn exchange(time: Duration) -> Result<Vec<Figure>, Failure> {
    let bank = Bank::start(COUPLERS, WORDS)?;
    let station = Station::start("io-32", &many(&bank.ports), "  L EW 0;\n  T AW 0;\n")?;
    let before = station.bus()?;
    let ran = |bus: &BusStatus| ob1_rt::process_state(bus.pid).map(|state| state.ran);
    let (began, used) = (Instant::now(), ran(&before));
    let seen = bank.watch(time)?;
    let (took, after) = (began.elapsed(), station.bus()?);
    let used = ran(&after).zip(used).map_or(Span::ZERO, |(now, before)| now.saturating_sub(before));
    if after.losses != before.losses || after.stations.iter().any(|one| one.losses > 0) {
        return Err("a coupler was lost meanwhile".into());
    }
    let ms = |values: &[u64], part: f64| {
        let mut values: Vec<u64> = values.to_vec();
        values.sort_unstable();
        let buckets: Vec<(u64, u64)> = values.into_iter().map(|value| (value, 1)).collect();
        quantile(&buckets, part) as f64 / 1e6
    };
    let cycle = CYCLE.as_secs_f64() * 1e3;
    let figure =
        |what: &'static str, value: f64, unit, aim| Figure { what: what.into(), value, unit, floor: None, aim };
    let (period, latency) = (ms(&seen.periods, 0.99), ms(&seen.latencies, 0.99) / cycle);
    if seen.periods.is_empty() || seen.latencies.is_empty() {
        return Err("nothing was exchanged".into());
    }
    Ok(vec![
        figure("32 couplers x 16 bytes: period, p50", ms(&seen.periods, 0.5), "ms", ("", true)),
        figure("32 couplers x 16 bytes: period, p99", period, "ms", ("<= 11 ms", period <= 1.1 * cycle)),
        figure("32 couplers x 16 bytes: requests", seen.requests as f64 / took.as_secs_f64(), "/s", ("", true)),
        figure("its process: CPU of one core", used.nanos() as f64 / took.as_nanos() as f64 * 100.0, "%", ("", true)),
        figure("input -> OB 1 -> output, p50", ms(&seen.latencies, 0.5) / cycle, "cyc", ("", true)),
        figure("input -> OB 1 -> output, p99", latency, "cyc", ("<= 2", latency <= 2.0)),
    ])
}

/// Our process and libmodbus' client, one after the other on the same server: one register for each request.
fn requests(time: Duration) -> Result<Figure, Failure> {
    let bank = Bank::start(1, 2 * RANGES)?;
    let port = bank.ports[0];
    let time = (time / TURNS as u32).max(Duration::from_secs(1));
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    for _ in 0..TURNS {
        let station = Station::start("io-fast", &fast(port), "")?;
        ours.push(bank.watch(time)?.requests as f64 / time.as_secs_f64());
        drop(station);
        theirs.push(libmodbus(port)?);
    }
    let (value, floor) = (median(&mut ours), median(&mut theirs));
    Ok(Figure {
        what: "requests a second of one connection".into(),
        value,
        unit: "/s",
        floor: Some(("libmodbus' client", floor)),
        aim: (">= 1 x", value >= floor),
    })
}

fn libmodbus(port: u16) -> Result<f64, Failure> {
    let python = std::env::var_os("OB1_PYTHON").ok_or("OB1_PYTHON is not set; run: cargo xtask bench io")?;
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/peers/modbus.py");
    let mut command = Command::new(python);
    command.args([script, "bench", "libmodbus", &format!("127.0.0.1:{port}"), "--address", "255"]);
    let said = command.args(["--count", &REQUESTS.to_string()]).output()?;
    let text = String::from_utf8_lossy(&said.stdout);
    let value: serde_json::Value = serde_json::from_str(&text)
        .map_err(|why| format!("libmodbus: {why}: {text}{}", String::from_utf8_lossy(&said.stderr)))?;
    Ok(f64::from(REQUESTS) / value["seconds"].as_f64().ok_or("no seconds")?)
}

/// All couplers on one bus, each with a connection of its own, read once in a cycle.
fn many(ports: &[u16]) -> String {
    let one = |(n, port): (usize, &u16)| {
        let at = 2 * WORDS * n;
        format!(
            "[[module]]\ntype = \"coupler\"\nbus = \"field\"\nname = \"c{n}\"\nline = \"tcp:127.0.0.1:{port}\"\n\
             inputs = [{{ at = \"EB {at}\", from = \"input:0\", registers = {WORDS} }}]\n\
             outputs = [{{ at = \"AB {at}\", to = \"holding:0\", registers = {WORDS} }}]\nlost_after = \"5s\"\n"
        )
    };
    ports.iter().enumerate().map(one).collect()
}

/// One coupler that is read without a pause.
fn fast(port: u16) -> String {
    let range = |n: usize| format!("{{ at = \"EB {}\", from = \"holding:{}\", registers = 1 }}", 2 * n, 2 * n);
    let ranges: Vec<String> = (0..RANGES).map(range).collect();
    format!(
        "[[module]]\ntype = \"coupler\"\nbus = \"field\"\nname = \"fast\"\nline = \"tcp:127.0.0.1:{port}\"\n\
         inputs = [{}]\nperiod = \"1ms\"\nlost_after = \"5s\"\n",
        ranges.join(", ")
    )
}

/// A station with a bus; it ends when the handle is dropped.
struct Station {
    child: Child,
    folder: PathBuf,
    socket: PathBuf,
}

impl Station {
    /// Starts it and waits until all couplers exchange data.
    fn start(name: &str, modules: &str, statements: &str) -> Result<Self, Failure> {
        let ob1 = std::env::current_exe()?.with_file_name("ob1");
        let folder = std::env::temp_dir().join(format!("ob1-bench-{name}-{}", std::process::id()));
        std::fs::create_dir_all(folder.join("run"))?;
        let calls = "ORGANIZATION_BLOCK OB 86\nBEGIN\nEND_ORGANIZATION_BLOCK\n";
        let awl = format!("ORGANIZATION_BLOCK OB 1\nBEGIN\n{statements}  BE;\nEND_ORGANIZATION_BLOCK\n{calls}");
        std::fs::write(folder.join("io.awl"), awl)?;
        let toml = format!(
            "[station]\nname = \"{name}\"\n[cpu]\nmin_cycle = \"{}ms\"\nwatchdog = \"1s\"\n[program]\n\
             sources = [\"io.awl\"]\n[[bus]]\nname = \"field\"\ntype = \"modbus-tcp\"\n{modules}",
            CYCLE.as_millis()
        );
        std::fs::write(folder.join("io.toml"), toml)?;
        let mut command = Command::new(ob1);
        command.args(["run", "io.toml", "--quiet"]).current_dir(&folder).env("XDG_RUNTIME_DIR", folder.join("run"));
        let child = command.stdin(Stdio::null()).stdout(Stdio::null()).spawn()?;
        let socket = folder.join("run/ob1").join(name).join("control.sock");
        let mut station = Self { child, folder, socket };
        let begun = Instant::now();
        while !station.bus().is_ok_and(|bus| bus.stations.iter().all(|one| one.state == "exchange")) {
            if begun.elapsed() > GUARD || station.child.try_wait()?.is_some() {
                return Err("the station does not exchange".into());
            }
            server::pause(CYCLE)?;
        }
        Ok(station)
    }

    fn bus(&self) -> Result<BusStatus, Failure> {
        let answer = ask(&self.socket)?;
        Ok(answer.into_iter().next().ok_or("no bus")?)
    }
}

fn ask(socket: &Path) -> Result<Vec<BusStatus>, Failure> {
    Ok(Client::to_socket(socket)?.ask(Op::Buses)?.buses.unwrap_or_default())
}

impl Drop for Station {
    fn drop(&mut self) {
        // Ended normally, so that its processes end with it.
        let _ = Command::new("kill").arg("-TERM").arg(self.child.id().to_string()).status();
        let _ = self.child.wait();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}
