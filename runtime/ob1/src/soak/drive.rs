//! A soak from its start to its report: the station's process, the clock, the signals, the checkpoints.

use std::fs::{self, File};
use std::io;
use std::path::Path;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use super::budget::Budget;
use super::files::Files;
use super::judge::{judge, too_short};
use super::load::{Generators, Kills};
use super::measure::{Measurement, Reading, ledgers};
use super::report::{Report, Role, SOAK_SCHEMA};
use super::station::{Station, exit_text, resident};
use super::text;
use super::verdict::Ended;
use super::{SoakArgs, budget};
use ob1_station::access::protocol::{GrantStatus, Op, Status};
use ob1_station::run::console::LiveLine;
use ob1_station::run::signals::Signals;

/// Between two checks of signals, the station's process and the driver kills.
const TICK: Duration = Duration::from_millis(50);
/// Between two live lines.
const LIVE: Duration = Duration::from_secs(1);
/// Time between two checkpoints.
const CHECKPOINT: Duration = Duration::from_secs(60);
/// Intervals of the time series, if they are not shorter than [`SHORTEST`] then: enough for a slope, few enough to draw
/// one in no time.
const INTERVALS: u32 = 480;
const SHORTEST: Duration = Duration::from_secs(1);
/// Longest warm-up without `--warm-up`.
const WARM_UP: Duration = Duration::from_secs(10);
/// A station that is not in RUN after this time will not get there.
const START: Duration = Duration::from_secs(120);

/// Runs a soak. The error is what to print.
pub(super) fn drive(file: &Path, time: Duration, args: &SoakArgs) -> Result<Report, String> {
    let system = |what: &str, error: io::Error| format!("ob1: {what}: {error}\n");
    let station = ob1_station_file::load(file)
        .map_err(|findings| findings.iter().map(|finding| format!("{finding}\n")).collect::<String>())?;
    args.load.check(station.simulated_lines.len()).map_err(|why| format!("ob1: {why}\n"))?;
    let signals = Signals::catch().map_err(|e| system("signals", e))?;
    let files = Files::new(args.report.as_deref(), &station.name);
    let log = File::create(files.path("log")).map_err(|e| system(&files.path("log").display().to_string(), e))?;
    let more = match args.load.line_faults {
        0 => Vec::new(),
        faults => vec![format!("--line-faults={faults}"), format!("--line-seed={}", args.seed)],
    };
    let process = Station::start(file, &more, log).map_err(|e| system("the station", e))?;
    let generators = Generators::start(&args.load, args.seed, &files.folder()).map_err(|e| system("the load", e))?;
    let mut soak = Soak {
        args,
        time,
        signals,
        station: process,
        generators,
        kills: Kills::new(&args.load, args.seed),
        cells: cells(args),
        line: LiveLine::new(args.quiet),
        files,
    };
    if !args.quiet {
        let span = ob1_time::Span::from_nanos(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX));
        let short = args.budget.iter().filter_map(|budget| too_short(budget, span, station.cpu.min_cycle));
        short.for_each(|told| err!("ob1: {told}"));
    }
    let affinity = &station.realtime.affinity;
    let facts = ob1_rt::system_facts(affinity).iter().map(GrantStatus::from).collect();
    soak.until_run()?;
    soak.measure(facts)
}

/// All cells that are read, with their roles: those of the ledger, those of the budget, those requested.
fn cells(args: &SoakArgs) -> Vec<(String, Role)> {
    let mut cells: Vec<(String, Role)> = Vec::new();
    let of_budget = args.budget.iter().filter_map(|budget| match &budget.what {
        budget::What::Cell(name) => Some(name),
        _ => None,
    });
    let own = of_budget.chain(&args.cells).map(|name| (name, Role::Own));
    let ledger = args.doubled.iter().map(|name| (name, Role::Doubled));
    for (name, role) in ledger.chain(args.wrong.iter().map(|name| (name, Role::Wrong))).chain(own) {
        if cells.iter().all(|(known, _)| known != name) {
            cells.push((name.clone(), role));
        }
    }
    cells
}

struct Soak<'a> {
    args: &'a SoakArgs,
    time: Duration,
    signals: Signals,
    /// Ended before the generators: they are there as long as it runs.
    station: Station,
    generators: Generators,
    kills: Option<Kills>,
    cells: Vec<(String, Role)>,
    line: LiveLine,
    files: Files,
}

impl Soak<'_> {
    /// Waits until the station is in RUN.
    fn until_run(&mut self) -> Result<(), String> {
        let begin = Instant::now();
        loop {
            if let Some(status) = self.station.ended() {
                let log = self.files.path("log");
                let said = fs::read_to_string(&log).unwrap_or_default();
                let _ = fs::remove_file(log);
                return Err(format!("{said}ob1: the station has ended before it was in RUN, {}\n", exit_text(status)));
            }
            if self.status().is_some_and(|status| status.state == "RUN") {
                return Ok(());
            }
            if self.signals.wait(TICK) {
                return Err("ob1: interrupted before the station was in RUN\n".into());
            }
            if begin.elapsed() >= START {
                return Err(format!(
                    "ob1: the station is not in RUN after {} s: see its diagnostic buffer\n",
                    START.as_secs()
                ));
            }
        }
    }

    fn measure(&mut self, facts: Vec<GrantStatus>) -> Result<Report, String> {
        let wanted = self.time;
        let warm_up = self.args.warm_up.map_or((wanted / 10).min(WARM_UP), Duration::from);
        let begin = Instant::now();
        while begin.elapsed() < warm_up {
            if self.signals.wait(TICK.min(warm_up.saturating_sub(begin.elapsed()))) {
                return Err("ob1: interrupted while the station warmed up: nothing has been measured\n".into());
            }
            if let Some(status) = self.station.ended() {
                return Err(format!("ob1: the station has ended while it warmed up, {}\n", exit_text(status)));
            }
        }
        let refused = |why| format!("ob1: {why}\n");
        // Once to touch what an answer needs, so that it does not look like a leak.
        self.read(Duration::ZERO).map_err(refused)?;
        self.station.try_ask(Op::ResetStatistics).map_err(|e| refused(e.to_string()))?;
        let began_unix_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs());
        let begin = Instant::now();
        let first = self.read(Duration::ZERO).map_err(refused)?;
        let interval = (wanted / INTERVALS).max(SHORTEST);
        let report = Report {
            schema: SOAK_SCHEMA,
            version: env!("CARGO_PKG_VERSION").into(),
            station: first.status.station.clone(),
            host: rustix::system::uname().nodename().to_string_lossy().into_owned(),
            began_unix_s,
            wanted_ns: wanted.as_nanos() as u64,
            warm_up_ns: warm_up.as_nanos() as u64,
            interval_ns: interval.as_nanos() as u64,
            posture: first.status.posture.iter().cloned().chain(facts).collect(),
            ..Report::default()
        };
        let mut measurement = Measurement::begin(report, &first, &self.cells);
        let ended = self.watch(&mut measurement, begin, interval)?;
        self.end(measurement, begin.elapsed(), ended)
    }

    /// Until the end, whatever it is.
    fn watch(&mut self, measurement: &mut Measurement, begin: Instant, interval: Duration) -> Result<Ended, String> {
        let wanted = self.time;
        let (mut next_live, mut next_interval, mut next_checkpoint) = (LIVE, interval, Duration::ZERO);
        loop {
            let elapsed = begin.elapsed();
            if elapsed >= wanted {
                return Ok(Ended::Time);
            }
            if self.signals.wait(TICK.min(wanted - elapsed)) {
                return Ok(Ended::Interrupted);
            }
            if self.station.ended().is_some() {
                return Ok(Ended::ProcessGone);
            }
            let elapsed = begin.elapsed();
            if elapsed >= next_live {
                next_live = elapsed + LIVE;
                if let Some(ended) = self.live(measurement, elapsed) {
                    return Ok(ended);
                }
            }
            if elapsed >= next_interval && elapsed < wanted {
                // The schedule stays, so that a slow answer does not make the intervals drift.
                next_interval += interval * (((elapsed - next_interval).as_nanos() / interval.as_nanos()) as u32 + 1);
                if let Ok(reading) = self.read(elapsed) {
                    measurement.interval(reading);
                }
            }
            if elapsed >= next_checkpoint {
                next_checkpoint = elapsed + CHECKPOINT;
                self.write(&mut measurement.report, &self.args.budget)?;
                if !self.args.quiet && !self.line.is_on() {
                    let report = &measurement.report;
                    if let Some(timing) = &report.timing {
                        note!("{}", text::live(report.wanted_ns, elapsed.as_nanos() as u64, timing, &report.telegrams));
                    }
                }
            }
        }
    }

    /// Live figures and driver kills; the end, when the CPU is not in RUN any more.
    fn live(&mut self, measurement: &Measurement, elapsed: Duration) -> Option<Ended> {
        let status = self.status()?;
        if status.state != "RUN" {
            return Some(Ended::CpuStopped);
        }
        let drivers: Vec<u32> = status.modules.iter().filter_map(|module| Some(module.driver.as_ref()?.pid)).collect();
        let due = self.kills.as_mut().and_then(|kills| kills.due(elapsed.as_nanos() as u64, drivers.len()));
        if let Some(pid) = due.and_then(|which| drivers.get(which))
            && self.station.kill_driver(*pid)
        {
            self.generators.kills += 1;
        }
        if self.line.is_on() {
            let timing = self.station.ask(Op::Timing { histograms: false })?.timing?;
            let report = &measurement.report;
            let telegrams = ledgers(measurement.first(), &status);
            self.line.show(&text::live(report.wanted_ns, elapsed.as_nanos() as u64, &timing, &telegrams));
        }
        None
    }

    /// The last reading, the orderly end, the verdict.
    fn end(&mut self, mut measurement: Measurement, elapsed: Duration, ended: Ended) -> Result<Report, String> {
        self.line.wipe();
        if let Ok(reading) = self.read(elapsed) {
            measurement.finish(reading);
        }
        let mut report = measurement.report;
        report.ended = ended;
        report.diagnostics = self.diagnostics();
        let exit = self.station.stop();
        if let (Ended::ProcessGone, Some(exit)) = (ended, exit) {
            let log = self.files.path("log").display().to_string();
            report.end = format!("{}; what it said is in {log}", exit_text(exit));
        }
        self.write(&mut report, &self.args.budget)?;
        if !self.args.quiet {
            note!("report: {}", self.files.path("html").display());
        }
        Ok(report)
    }

    /// Judges what there is and writes it.
    fn write(&self, report: &mut Report, budget: &[Budget]) -> Result<(), String> {
        report.load = (!self.args.load.text.is_empty()).then(|| self.generators.report());
        judge(report, budget);
        self.files.write(report).map_err(|e| format!("ob1: {}: {e}\n", self.files.path("json").display()))
    }

    fn status(&mut self) -> Option<Status> {
        self.station.ask(Op::Status)?.status
    }

    fn diagnostics(&mut self) -> Vec<ob1_station::access::protocol::Diagnostic> {
        self.station.ask(Op::Diag { count: 100 }).and_then(|answer| answer.diagnostics).unwrap_or_default()
    }

    fn read(&mut self, time: Duration) -> Result<Reading, String> {
        let nothing = || "the answer does not contain what was asked for".to_owned();
        let mut ask = |op| self.station.try_ask(op).map_err(|error| error.to_string());
        let cells = if self.cells.is_empty() {
            Vec::new()
        } else {
            let items = self.cells.iter().map(|(name, _)| name.clone()).collect();
            let values = ask(Op::Get { items })?.values.ok_or_else(nothing)?;
            let number = |value: &serde_json::Value| value.as_f64().or_else(|| value.as_bool().map(f64::from));
            values.iter().map(|cell| number(&cell.value).unwrap_or(f64::NAN)).collect()
        };
        let status = ask(Op::Status)?.status.ok_or_else(nothing)?;
        let timing = *ask(Op::Timing { histograms: true })?.timing.ok_or_else(nothing)?;
        let (rss_bytes, fds) = self.station.resources();
        let drivers = status.modules.iter().filter_map(|module| module.driver.as_ref());
        let drivers_rss_bytes = drivers.map(|driver| resident(driver.pid)).sum();
        Ok(Reading { time_ns: time.as_nanos() as u64, timing, status, cells, rss_bytes, fds, drivers_rss_bytes })
    }
}
