//! `ob1 run`: builds a station, runs it, and removes all it has made.

mod at_work;
pub mod console;
mod failure;
pub(crate) mod hung_block;
mod journal;
mod last_words;
mod listening;
mod options;
mod reason_log;
mod report;
mod scan;
pub mod signals;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use ob1_rt::MonotonicClock;

use crate::assembly::{self, AssemblyError};
use crate::drivers::{self, DriverSettings};
use crate::exit::Exit;
use crate::guardian::{Guarded, Guardian, Patience};
use crate::look;
use crate::out;
use crate::posture;
use crate::program;
use crate::rundir::{self, RunDir, RunDirError};
use ob1_station_file::finding::{Finding, Level};
use ob1_station_file::{self, Station};

use at_work::AtWork;
use failure::Failure;
pub use options::Options;
pub use report::{Ended, REPORT_SCHEMA, Report};
use signals::Signals;

/// Runs a station until its end; prints what there is to print.
#[must_use]
pub fn run(options: &Options) -> Exit {
    match try_run(options) {
        Ok(exit) => exit,
        Err(Failure(exit, text)) => {
            errs!("{text}");
            exit
        }
    }
}

fn try_run(options: &Options) -> Result<Exit, Failure> {
    // A driver of somebody else does not close what it inherits; this process keeps what it was given.
    ob1_process::keep_inherited();
    // Before there is a thread.
    if let Some(name) = ob1_station_file::user_of(&options.station) {
        become_user(&name)?;
    }
    console::start_log(options.quiet);
    let signals = Signals::catch().map_err(|e| Failure::system("signals", &e))?;
    if options.lifeline {
        signals.and_end_of_stdin().map_err(|e| Failure::system("standard input", &e))?;
    }
    if let Some(path) = &options.report {
        Report::try_path(path).map_err(|e| no_report(path, &e))?;
    }
    let (mut station, warnings) = look::load(&options.station).map_err(|f| Failure::of_findings(Exit::Rejected, &f))?;
    if options.line_faults > 0 {
        for line in &mut station.simulated_lines {
            line.disturb(options.line_faults, options.line_seed);
        }
    }
    if let Some(finding) = posture::starves(&station, &ob1_rt::isolated_cores(), &options.station.display().to_string())
    {
        return Err(Failure::of_findings(Exit::Rejected, &[finding]));
    }
    let starting = signals.end_at_once().map_err(|e| Failure::system("signals", &e))?;
    let loaded = program::load(&station).map_err(|f| Failure::of_load(&f))?;
    drop(starting);
    // Lints are for `check`. That nothing will be executed is always reported.
    let told = |f: &&Finding| f.level != Level::Lint && (!options.quiet || f.code == program::NO_OB1);
    for finding in loaded.findings.iter().chain(&warnings).filter(told) {
        out::tell(finding.level.severity(), format_args!("{finding}\n"));
    }
    let rundir = RunDir::claim(&station.name).map_err(|error| {
        let exit = if matches!(error, RunDirError::Running { .. }) { Exit::Running } else { Exit::System };
        Failure(exit, format!("ob1: {error}\n"))
    })?;
    let clock = MonotonicClock::start();
    let drivers = driver_settings(&station, options.quiet)?;
    let assembly = assembly::assemble(&station, &loaded, &drivers, rundir.path(), clock);
    let assembly = assembly.map_err(|error| match error {
        AssemblyError::Load(failure) => Failure::of_load(&failure),
        AssemblyError::System(text) => Failure(Exit::System, format!("ob1: {text}\n")),
    })?;
    let _exit = exit_is_a_fault(&assembly);
    let patience = Patience::of(station.cpu.watchdog, station.cpu.min_cycle);
    let (path, published) = (rundir.path().to_owned(), assembly::published(&station));
    let guardian = Guarded::of_this_process(path, published, patience, assembly.io.as_ref()).and_then(Guardian::start);
    let guardian = guardian.map_err(|e| Failure::system("the guardian", &e))?;
    tracing::info!("station {}, process {}", station.name, std::process::id());
    let mut station_at_work = AtWork::start(guardian, &station, assembly, rundir, clock, options)?;
    let ended = station_at_work.watch(&signals, options);
    let (report, exit) = station_at_work.stop(ended)?;
    if !options.quiet {
        out::print_at_the_end(report.summary());
    }
    if let Some(path) = &options.report {
        report.write(path).map_err(|e| no_report(path, &e))?;
    }
    Ok(exit)
}

fn no_report(path: &Path, error: &std::io::Error) -> Failure {
    Failure::system(&format!("the report {}", path.display()), error)
}

/// The runtime of a station with `[station] user` gives up what root has.
fn become_user(name: &str) -> Result<(), Failure> {
    let user = ob1_process::User::find(name).and_then(|user| {
        if user.is_us() {
            return Ok(());
        }
        rundir::prepare_for(&user);
        user.become_it()
    });
    user.map_err(|why| {
        let remedy = "name a user of this system, and start as root or as that user";
        Failure(Exit::System, format!("ob1: [station] user = \"{name}\": {why}\n  = {remedy}\n"))
    })
}

/// Until this is dropped, a call of `exit()` or `_exit()` is taken for a plugin's.
fn exit_is_a_fault(assembly: &assembly::Assembly) -> ob1_rt::ExitGuard {
    let (running, io) = (Arc::clone(&assembly.running), assembly.io.clone());
    ob1_rt::ExitGuard::raise(move |way| {
        if let Some(io) = &io {
            io.switch_off();
        }
        let who = running.block().map_or_else(|| "a plugin".to_owned(), |block| format!("native block {block}"));
        err!("\nob1: {who} has called {way}; outputs are off, the station ends");
        err!("  = a block returns, or logs an error and lets the CPU stop; it never ends the process");
        ob1_process::log::flush(ob1_process::log::LAST_WORDS);
        Exit::EndedByPlugin as u8
    })
}

fn driver_settings(station: &Station, quiet: bool) -> Result<DriverSettings, Failure> {
    let find = |wanted: bool, name: &str, variable: &str| match wanted {
        true => drivers::find_driver(name, variable).map_err(|text| Failure(Exit::System, format!("ob1: {text}\n"))),
        false => Ok(PathBuf::new()),
    };
    let has_cps = station.modules.iter().any(|m| m.kind.line().is_some()) || !station.simulated_lines.is_empty();
    let program = find(has_cps, "ob1-cp", "OB1_CP")?;
    let io = find(!station.buses.is_empty(), "ob1-io", "OB1_IO")?;
    let env = if quiet && drivers::set_variable("OB1_LOG").is_none() {
        vec![("OB1_LOG".into(), "warn".into())]
    } else {
        Vec::new()
    };
    Ok(DriverSettings { program, io, env })
}
