//! Whether the scan is disturbed: its execution time (without the wake-up) while `ob1 top` is attached, while reports
//! are written, and while its driver is killed ten times a minute, compared with quiet times of the same run.
//!
//! Rounds of five runs in changing order: quiet, quiet again, and the three disturbances. The two quiet runs of a round
//! show the variation of the machine itself. Also checked: every telegram reported as done has arrived at the partner's
//! CP, which is not killed.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use ob1_command::statistics::{quantile, since};
use ob1_station::access::client::Client;
use ob1_station::access::protocol::{Op, Response};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, PidfdFlags, pidfd_open};

use super::peer::Failure;
use super::wake::{Ratios, Verdict};

/// SCHED_FIFO priority of the scan that is measured.
const PRIORITY: u8 = 80;
/// Maximum ratio of a disturbed percentile to the quiet ones, unless these differ more among themselves.
const LIMIT: f64 = 1.10;
/// Minimum rounds and seconds for a meaningful comparison.
const ENOUGH: (usize, u64) = (9, 6);
/// Ten times a minute.
const KILL: Duration = Duration::from_secs(6);
/// Time between two reports, and between two updates of `ob1 top`.
const LOOK: Duration = Duration::from_millis(500);
const GUARD: Duration = Duration::from_secs(60);
/// Number of scans after which all memory in use has been touched.
const SETTLED: u64 = 3000;

/// The disturbance of the scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Beside {
    Nothing,
    Top,
    Report,
    Kill,
}

/// The runs of a round: two quiet ones first.
const RUNS: [(Beside, &str); 5] = [
    (Beside::Nothing, "quiet"),
    (Beside::Nothing, "quiet again"),
    (Beside::Top, "ob1 top attached"),
    (Beside::Report, "reports written"),
    (Beside::Kill, "driver killed 10/min"),
];
/// The percentiles that are checked.
const JUDGED: [(&str, f64); 2] = [("p50", 0.5), ("p99", 0.99)];

/// Measures and prints; returns the worst verdict.
///
/// # Errors
/// If the stations cannot be run, or a telegram reported as done has not arrived.
pub fn measure(rounds: Option<usize>, seconds: Option<u64>) -> Result<Verdict, Failure> {
    let (rounds, seconds) = (rounds.unwrap_or(ENOUGH.0), seconds.unwrap_or(ENOUGH.1));
    let enough = rounds >= ENOUGH.0 && seconds >= ENOUGH.1;
    let site = Site::start()?;
    println!(
        "execution time of a scan, disturbed: {rounds} rounds of five runs of {seconds} s, SCHED_FIFO {PRIORITY}; µs\n{:<10}{}",
        "",
        RUNS.map(|(_, name)| format!("{name:>26}")).concat()
    );
    let mut ratios: [[Ratios; 2]; 3] = Default::default();
    for round in 0..rounds {
        let mut times = [[0.0; 2]; RUNS.len()];
        for place in 0..RUNS.len() {
            let run = (place + round) % RUNS.len();
            let newest = site.run(RUNS[run].0, Duration::from_secs(seconds))?;
            times[run] = JUDGED.map(|(_, share)| quantile(&newest, share) as f64);
        }
        let shown = times.map(|[p50, p99]| format!("{:>26}", format!("{:.2} / {:.2}", p50 / 1000.0, p99 / 1000.0)));
        println!("{:<10}{}", format!("round {}", round + 1), shown.concat());
        for (ratios, disturbed) in ratios.iter_mut().zip(&times[2..]) {
            for (number, ratios) in ratios.iter_mut().enumerate() {
                ratios.enter(disturbed[number], [times[0][number], times[1][number]]);
            }
        }
    }
    let mut worst = Verdict::Passed;
    for ((_, name), ratios) in RUNS[2..].iter().zip(&ratios) {
        for ((percentile, _), ratios) in JUDGED.iter().zip(ratios) {
            let figures = ratios.figures();
            let verdict = figures.judge(LIMIT.max(figures.noise), enough);
            println!(
                "{name:<22} {percentile}  x {:.3}, with 97.5 % at most {:.3}   quiet against itself x {:.3}   {verdict:?}",
                figures.ratio, figures.at_most, figures.noise
            );
            worst = worst.max(verdict);
        }
    }
    site.telegrams()?;
    Ok(worst)
}

/// The two stations of the demo; the first one is measured.
struct Site {
    ob1: PathBuf,
    folder: PathBuf,
    /// Ended in this order.
    stations: [Process; 2],
}

impl Site {
    fn start() -> Result<Self, Failure> {
        let bin = std::env::var_os("OB1_BIN_DIR").ok_or("OB1_BIN_DIR is not set; run: cargo xtask bench disturb")?;
        let ob1 = Path::new(&bin).join("ob1");
        let folder = std::env::temp_dir().join(format!("ob1-bench-disturb-{}", std::process::id()));
        std::fs::create_dir_all(&folder)?;
        let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/two-stations");
        let core = std::thread::available_parallelism().map_or(0, |n| n.get() - 1);
        for (name, realtime) in [
            (
                "a",
                format!(
                    "\n[cpu.realtime]\npriority = {PRIORITY}\naffinity = [{core}]\nlock_memory = true\nkeep_awake = true\n"
                ),
            ),
            ("b", String::new()),
        ] {
            std::fs::copy(example.join(format!("{name}.awl")), folder.join(format!("{name}.awl")))?;
            let text = std::fs::read_to_string(example.join(format!("station-{name}.toml")))?;
            let text = text.replace("two-stations-", "bench-disturb-");
            std::fs::write(folder.join(format!("{name}.toml")), text + &realtime)?;
        }
        let run = |name: &str| Process::start(&ob1, &["run", "--quiet"], Some(&folder.join(format!("{name}.toml"))));
        let site = Self { stations: [run("a")?, run("b")?], ob1, folder };
        let begin = Instant::now();
        while site.ask("a", Op::Status).ok().and_then(|r| r.status).is_none_or(|status| status.scans < SETTLED) {
            if begin.elapsed() > GUARD {
                return Err(format!("station A does not get to {SETTLED} scans").into());
            }
            site.stations[0].lives_for(LOOK)?;
        }
        Ok(site)
    }

    fn ask(&self, station: &str, op: Op) -> Result<Response, Failure> {
        Ok(Client::to_station(&format!("bench-disturb-{station}"))?.ask(op)?)
    }

    fn execution(&self) -> Result<Vec<(u64, u64)>, Failure> {
        let timing = self.ask("a", Op::Timing { histograms: true })?.timing.ok_or("no accounts")?;
        Ok(timing.execution.buckets)
    }

    /// The execution times of a run with this disturbance.
    fn run(&self, beside: Beside, time: Duration) -> Result<Vec<(u64, u64)>, Failure> {
        let every = format!("{}ms", LOOK.as_millis());
        let top = match beside {
            Beside::Top => {
                Some(Process::start(&self.ob1, &["top", "bench-disturb-a", "--plain", "--every", &every], None)?)
            }
            _ => None,
        };
        let before = self.execution()?;
        let begin = Instant::now();
        let mut next_kill = Duration::ZERO;
        while begin.elapsed() < time {
            match beside {
                Beside::Report => self.report()?,
                Beside::Kill if begin.elapsed() >= next_kill => {
                    next_kill += KILL;
                    self.kill()?;
                }
                _ => {}
            }
            self.stations[0].lives_for(LOOK.min(time.saturating_sub(begin.elapsed())))?;
        }
        let after = self.execution()?;
        drop(top);
        Ok(since(&after, &before))
    }

    /// Writes to the disk what a soak reads for its report.
    fn report(&self) -> Result<(), Failure> {
        let status = self.ask("a", Op::Status)?;
        let timing = self.ask("a", Op::Timing { histograms: true })?;
        let recorder = self.ask("a", Op::Recorder)?;
        let text = serde_json::to_vec(&(status, timing, recorder))?;
        Ok(std::fs::write(self.folder.join("report.json"), text)?)
    }

    fn kill(&self) -> Result<(), Failure> {
        let status = self.ask("a", Op::Status)?.status.ok_or("no status")?;
        let pid = status.modules.iter().find_map(|m| m.driver.as_ref()).map_or(0, |driver| driver.pid);
        // 0: the previous one has not restarted yet.
        if pid != 0 {
            Command::new("kill").arg("-KILL").arg(pid.to_string()).stderr(Stdio::null()).status()?;
        }
        Ok(())
    }

    /// Checks that A's program got "done" at most as often as B's CP has received.
    fn telegrams(&self) -> Result<(), Failure> {
        let cells = self.ask("a", Op::Get { items: vec!["DB20.STARTED".into(), "DB20.DONE".into()] })?;
        let cells: Vec<u64> = cells.values.into_iter().flatten().filter_map(|cell| cell.value.as_u64()).collect();
        let [started, done] = cells[..] else { return Err("a ledger without numbers".into()) };
        let status = self.ask("b", Op::Status)?.status.ok_or("no status")?;
        let received = status.modules.first().map_or(0, |m| m.counters.get("telegrams_received").copied().unwrap_or(0));
        println!("telegrams of A: started {started}, done {done}; received by B's CP {received}");
        if done > received {
            return Err(format!("{} telegrams were reported as done and have not arrived", done - received).into());
        }
        Ok(())
    }
}

impl Drop for Site {
    fn drop(&mut self) {
        for station in &mut self.stations {
            station.end();
        }
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// `ob1`, ended by SIGTERM (a shell makes jobs in the background ignore SIGINT).
pub(super) struct Process(Child);

impl Process {
    pub(super) fn start(ob1: &Path, args: &[&str], file: Option<&Path>) -> Result<Self, Failure> {
        let mut command = Command::new(ob1);
        Ok(Self(command.args(args).args(file).stdin(Stdio::null()).stdout(Stdio::null()).spawn()?))
    }

    /// Waits; fails if the process ends during this time.
    pub(super) fn lives_for(&self, time: Duration) -> Result<(), Failure> {
        let pid = i32::try_from(self.0.id()).ok().and_then(Pid::from_raw).ok_or("no process")?;
        let end = pidfd_open(pid, PidfdFlags::empty())?;
        let time = Timespec { tv_sec: time.as_secs() as i64, tv_nsec: i64::from(time.subsec_nanos()) };
        match poll(&mut [PollFd::new(&end, PollFlags::IN)], Some(&time))? {
            0 => Ok(()),
            _ => Err("the station has ended".into()),
        }
    }

    pub(super) fn end(&mut self) {
        if self.0.try_wait().is_ok_and(|ended| ended.is_some()) {
            return;
        }
        let asked = Command::new("kill").arg("-TERM").arg(self.0.id().to_string()).status();
        if !asked.is_ok_and(|status| status.success()) {
            let _ = self.0.kill();
        }
        let _ = self.0.wait();
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.end();
    }
}
