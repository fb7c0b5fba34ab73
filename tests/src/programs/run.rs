//! One program in the whole-station simulation, in virtual time, with its partner, its faults and its judge.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use ob1_cpu::{Cell, Command, OperatingState, Width};
use ob1_firmware::LineFault;
use ob1_line::sim::FaultRates;
use ob1_time::{Instant, Span};

use crate::sim::device::{Bench, Device};

use super::judge::{Judge, Scan, Verdict};
use super::record::{self, Call};
use super::text::Site;

/// What happens to a station from outside.
#[derive(Clone, Debug, PartialEq)]
pub enum Deed {
    /// Somebody writes a cell between two cycles.
    Write(Cell, Width, u32),
    /// The mode selector: STOP.
    Stop,
    /// And RUN.
    Run,
    /// `kill -9` of the driver.
    Kill,
    /// The line reports this.
    Line(LineFault),
    /// The partner is told; what the number means is its own.
    Partner(u32),
}

/// A partner on the line that can be told something.
pub trait Partner: Device {
    /// Something of the plan ([`Deed::Partner`]) happens now; returns the next deadline, as [`Device::hear`].
    fn told(&mut self, now: Instant, what: u32, out: &mut Vec<u8>) -> Option<Instant>;
}

/// A partner, with what passes on its line.
struct Tap<P> {
    partner: P,
    log: Option<String>,
}

impl<P> Tap<P> {
    fn note(&mut self, now: Instant, what: &str, bytes: &[u8]) {
        if let Some(log) = &mut self.log
            && !bytes.is_empty()
        {
            let _ = writeln!(log, "{:>10} {what} {bytes:02X?}", now.micros());
        }
    }
}

impl<P: Device> Device for Tap<P> {
    fn hear(&mut self, now: Instant, bytes: &[u8], out: &mut Vec<u8>) -> Option<Instant> {
        self.note(now, "to partner", bytes);
        let from = out.len();
        let next = self.partner.hear(now, bytes, out);
        self.note(now, "from partner", &out[from..]);
        next
    }

    fn is_shorted(&self) -> bool {
        self.partner.is_shorted()
    }
}

/// All that is drawn from a seed.
#[derive(Debug)]
pub struct Case<P> {
    /// Program, in German mnemonics.
    pub text: String,
    /// Places in the program, by their number.
    pub sites: Vec<Site>,
    /// Station file; its program is `program.awl`.
    pub station: String,
    /// The partner.
    pub partner: P,
    /// What happens when, in order.
    pub plan: Vec<(Instant, Deed)>,
    /// Faults of the line, until `calm`.
    pub rates: FaultRates,
    /// Time after which the line has no faults.
    pub calm: Instant,
    /// Virtual time.
    pub duration: Span,
    /// Seed of the line and of the processes.
    pub seed: u64,
}

/// What a run has shown.
#[derive(Debug, Default)]
pub struct Outcome {
    /// Violated rules.
    pub verdict: Verdict,
    /// Number of calls of handling blocks.
    pub calls: u64,
    /// Number of scans.
    pub scans: u64,
    /// Everything that happened, if it was asked for.
    pub log: String,
}

/// Runs a case in `folder` (its files are written there) under a judge.
///
/// # Errors
/// The station cannot be built: a mistake of the generator.
pub fn run<P: Partner, J: Judge<P>>(case: Case<P>, judge: &mut J, folder: &Path, log: bool) -> Result<Outcome, String> {
    let path = write(folder, &case)?;
    let Case { sites, partner, plan, rates, calm, duration, seed, .. } = case;
    let partner = Tap { partner, log: log.then(String::new) };
    let mut bench = Bench::build_until(&path, partner, rates, calm, seed)?;
    let end = bench.now + duration;
    let mut outcome = Outcome::default();
    let mut calls: Vec<Call> = Vec::new();
    let mut plan = plan.into_iter().peekable();
    let mut stopped = false;
    let mut shown = String::new();
    while bench.now < end && !(plan.peek().is_none() && judge.is_over(bench.now)) {
        let due = plan.peek().map_or(end, |(at, _)| *at).min(end);
        if due > bench.now {
            let mut broken = None;
            // The judge looks after each scan; `until` ends with it, because it needs the partner, too.
            if bench.until(due - bench.now, |_| true) {
                let now = bench.now;
                let state = bench.station.cpu.state();
                outcome.scans += 1;
                if let Err(what) = record::take(&mut bench.station.cpu, &sites, now, &mut calls) {
                    broken = Some(what);
                }
                outcome.calls += calls.len() as u64;
                if let Some(wire) = &mut bench.device.log {
                    outcome.log += wire;
                    wire.clear();
                }
                if log {
                    tell(&mut outcome.log, &sites, &calls, &mut shown);
                }
                let scan = Scan { now, calls: &calls, sites: &sites, state };
                judge.scan(&scan, &mut bench.station.cpu, &mut bench.device.partner, &mut outcome.verdict);
                if state == OperatingState::Stop && !stopped {
                    outcome.verdict.broken("stop", now, format!("the CPU has stopped\n{}", bench.log()));
                    break;
                }
            }
            if let Some(what) = broken {
                outcome.verdict.broken("record", bench.now, what);
                break;
            }
            continue;
        }
        let Some((_, deed)) = plan.next() else { break };
        if log {
            let _ = writeln!(outcome.log, "{:>10} {deed:?}", bench.now.micros());
        }
        judge.deed(bench.now, &deed);
        match deed {
            Deed::Write(cell, width, value) => {
                let done = bench.station.cpu.write(cell, width, value);
                done.map_err(|error| format!("{cell:?}: {error:?}"))?;
            }
            Deed::Stop => {
                stopped = true;
                bench.station.cpu.request(Command::Stop);
            }
            Deed::Run => {
                bench.station.cpu.request(Command::Run);
                stopped = false;
            }
            Deed::Kill => bench.kill_driver(),
            Deed::Line(fault) => bench.fault(fault),
            Deed::Partner(what) => bench.meanwhile(|tap, now, out| {
                let next = tap.partner.told(now, what, out);
                tap.note(now, "from partner", out);
                next
            }),
        }
    }
    judge.end(bench.now, &mut bench.device.partner, &mut outcome.verdict);
    if log {
        outcome.log += bench.log();
    }
    Ok(outcome)
}

fn write<P>(folder: &Path, case: &Case<P>) -> Result<PathBuf, String> {
    let path = folder.join("station.toml");
    let put = |path: &Path, text: &str| std::fs::write(path, text).map_err(|e| format!("{}: {e}", path.display()));
    put(&folder.join("program.awl"), &case.text)?;
    put(&path, &case.station)?;
    Ok(path)
}

/// Writes the calls that changed something.
fn tell(log: &mut String, sites: &[Site], calls: &[Call], last: &mut String) {
    for call in calls {
        let site = &sites[call.site];
        let names = site.block.map_or(&[][..], |block| block.parameters);
        let mut line = format!("{} {}", call.site, site.block.map_or("mark", |block| block.id));
        for (index, after) in call.after.iter().enumerate() {
            let name = names.get(index).map_or("+", |(name, _)| *name);
            if site.values().nth(index).flatten().is_none() {
                continue;
            }
            let before = call.before.get(index).unwrap_or(after);
            let _ = if before == after {
                write!(line, " {name} {after:X}")
            } else {
                write!(line, " {name} {before:X}->{after:X}")
            };
        }
        if line != *last {
            let _ = writeln!(log, "{:>10} {line}", call.at.micros());
            *last = line;
        }
    }
}
