//! The processes around the stations: gates, mosquitto, Prometheus.

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use ob1_access::door::Door;
use ob1_host::driver::kept_environment;
use ob1_socket::handover;
use ob1_time::Instant;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

use super::super::peer::Failure;
use super::super::stations::{own_kib, pass, ticks};
use super::station::Simulated;

/// So long a process may take to end in order.
const END: Duration = Duration::from_secs(10);
const LOOK: Duration = Duration::from_millis(20);

/// A process that is ended, in order if it can be, when this is dropped.
pub(super) struct Running(Child);

impl Running {
    /// Starts it; what it says goes to a file.
    pub(super) fn start(command: &mut Command, log: &Path) -> Result<Self, Failure> {
        let log = File::create(log)?;
        let name = command.get_program().display().to_string();
        let started = command.stdout(Stdio::null()).stderr(log).spawn();
        Ok(Self(started.map_err(|why| format!("{name}: {why}"))?))
    }

    /// Its time on a core so far, in ticks of 10 ms.
    pub(super) fn ticks(&self) -> Result<u64, Failure> {
        ticks(self.0.id())
    }

    /// The memory it shares with nobody.
    pub(super) fn own_kib(&self) -> Result<u64, Failure> {
        own_kib(self.0.id())
    }

    pub(super) fn has_ended(&mut self) -> Result<bool, Failure> {
        Ok(self.0.try_wait()?.is_some())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let pid = i32::try_from(self.0.id()).ok().and_then(Pid::from_raw);
        if let Ok(None) = self.0.try_wait()
            && let Some(pid) = pid
        {
            let _ = kill_process(pid, Signal::TERM);
        }
        for _ in 0..END.as_millis() / LOOK.as_millis() {
            if !matches!(self.0.try_wait(), Ok(None)) {
                return;
            }
            pass(LOOK);
        }
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A process `ob1-gate` that serves a link of each of these stations: `link` counts the links of the station file.
pub(super) fn gate(
    program: &Path,
    (kind, link): (&str, usize),
    stations: &mut [Simulated],
    now: Instant,
    log: &Path,
) -> Result<Running, Failure> {
    let (over, input) = handover::pair()?;
    let doors = stations.iter_mut().map(|station| station.door(link, now)).collect::<Result<Vec<_>, _>>()?;
    let mut command = Command::new(program);
    command.args(["--name", kind]).env_clear().envs(kept_environment()).env("OB1_LOG", "warn").current_dir("/");
    let running = Running::start(command.stdin(Stdio::from(input)), log)?;
    Door::hand_over(&over, &doors)?;
    Ok(running)
}

/// mosquitto, as it takes many stations: its limits of clients and of waiting messages are lifted for the subscriber.
pub(super) fn mosquitto(folder: &Path, port: u16) -> Result<Running, Failure> {
    let file = folder.join("mosquitto.conf");
    let text = format!(
        "listener {port} 127.0.0.1\nallow_anonymous true\nsys_interval 1\nmax_queued_messages 0\nmax_inflight_messages 0\nuser root\n"
    );
    std::fs::write(&file, text)?;
    let installed = Path::new("/usr/sbin/mosquitto");
    let program = if installed.is_file() { installed } else { Path::new("mosquitto") };
    let mut running = Running::start(Command::new(program).arg("-c").arg(file), &folder.join("mosquitto.log"))?;
    for _ in 0..500 {
        if TcpStream::connect(("127.0.0.1", port)).is_ok() {
            return Ok(running);
        }
        if running.has_ended()? {
            break;
        }
        pass(LOOK);
    }
    Err("mosquitto does not listen".into())
}

/// Prometheus with the example of a fleet.
pub(super) struct Prometheus {
    pub(super) running: Running,
    port: u16,
}

impl Prometheus {
    /// Starts it over the targets in a file.
    pub(super) fn start(folder: &Path, targets: &Path, port: u16, scrape: u64) -> Result<Self, Failure> {
        let example = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples");
        let text = std::fs::read_to_string(format!("{example}/fleet/prometheus.yml"))?
            .replace("/etc/prometheus/ob1/*.json", &targets.display().to_string())
            .replace("../web/alerts.yml", &format!("{example}/web/alerts.yml"))
            .replace("scrape_interval: 15s", &format!("scrape_interval: {scrape}s"));
        let file = folder.join("prometheus.yml");
        std::fs::write(&file, text)?;
        let mut command = Command::new("prometheus");
        command
            .arg(format!("--config.file={}", file.display()))
            .arg(format!("--storage.tsdb.path={}", folder.join("tsdb").display()))
            .arg(format!("--web.listen-address=127.0.0.1:{port}"))
            .arg("--enable-feature=extra-scrape-metrics");
        Ok(Self { running: Running::start(&mut command, &folder.join("prometheus.log"))?, port })
    }

    /// The value of a query; none where nothing is found, or where it does not answer yet.
    pub(super) fn value(&self, query: &str) -> Option<f64> {
        let coded: String = query.bytes().map(|byte| format!("%{byte:02X}")).collect();
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).ok()?;
        write!(stream, "GET /api/v1/query?query={coded} HTTP/1.0\r\n\r\n").ok()?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer).ok()?;
        let (_, body) = answer.split_once("\r\n\r\n")?;
        let found: Value = serde_json::from_str(body).ok()?;
        found["data"]["result"][0]["value"][1].as_str()?.parse().ok()
    }
}
