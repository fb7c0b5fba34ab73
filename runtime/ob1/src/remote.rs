//! `ob1 get`, `set`, `ctl`: questions to a running station.

use std::collections::BTreeMap;

use clap::builder::PossibleValue;
use clap::{Args, ValueEnum};
use ob1_access::Form;
use ob1_model::Command;
use serde_json::Value;

use crate::exit::Exit;
use ob1_station::access::client::Client;
use ob1_station::access::protocol::{Op, Response, RetentiveStatus, Status, Times};
use ob1_station::timing::text;
use ob1_station::view::EVENTS_LOST;

/// Read cells of a running station
#[derive(Debug, Args)]
#[command(after_help = "Names: M1.0 MB1 MW10 MD4, E/I and A/Q likewise, PEW256, DB10.DBX0.0 DB10.DBW20, T2, Z3,\n\
    components of data blocks (DB20.DONE) and symbols.\n\nExample:\n  ob1 get station-a.toml M1.0 DB20.DONE --json")]
pub struct GetArgs {
    /// A running station: its name or its file
    pub station: String,
    /// Names of cells
    #[arg(required = true)]
    pub items: Vec<String>,
    /// As a JSON array of {item, type, value, hex}
    #[arg(long)]
    pub json: bool,
}

/// Write cells of a running station
#[derive(Debug, Args)]
#[command(
    after_help = "Values: 1, 0, true, -5, 16#1A, W#16#1A, L#-5, 2#1010, 1.5.\nAn input of a di or ai module keeps its value; \
    an input of a CP lasts until the next process image.\n\nExample:\n  ob1 set station-a.toml M1.0=1 DB10.DBW20=16#1234"
)]
pub struct SetArgs {
    /// A running station: its name or its file
    pub station: String,
    /// NAME=VALUE
    #[arg(required = true, value_name = "NAME=VALUE", value_parser = assignment)]
    pub items: Vec<(String, String)>,
}

fn assignment(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.trim().is_empty() => Ok((name.trim().to_owned(), value.trim().to_owned())),
        _ => Err("not an assignment; write NAME=VALUE, such as M1.0=1".to_owned()),
    }
}

/// Operate a running station
#[derive(Debug, Args)]
#[command(
    after_help = "Every change from STOP to RUN sends the parameters to all CPs again.\n\nExamples:\n  ob1 ctl press stop\n  ob1 ctl \
    press.toml warm"
)]
pub struct CtlArgs {
    /// A running station: its name or its file
    pub station: String,
    /// What to do
    pub action: Action,
    /// Answers of status, timing and recorder as JSON
    #[arg(long)]
    pub json: bool,
}

/// What `ob1 ctl` does.
#[derive(Clone, Copy, Debug)]
pub enum Action {
    /// Changes the operating state.
    Command(Command),
    /// Prints state and figures.
    Status,
    /// Prints the accounts of every scan.
    Timing,
    /// Prints the flight recorder.
    Recorder,
}

impl ValueEnum for Action {
    fn value_variants<'a>() -> &'a [Self] {
        const ALL: [Action; 9] = [
            Action::Command(Command::Run),
            Action::Command(Command::Stop),
            Action::Command(Command::Warm),
            Action::Command(Command::Cold),
            Action::Command(Command::Hot),
            Action::Command(Command::Reset),
            Action::Status,
            Action::Timing,
            Action::Recorder,
        ];
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        let (word, help) = match self {
            Self::Command(command) => (
                command.word(),
                match command {
                    Command::Run => "STOP to RUN by a warm restart; nothing in RUN",
                    Command::Stop => "To STOP: outputs off",
                    Command::Warm => "Warm restart: OB 100; M, T, Z cleared, data blocks kept",
                    Command::Cold => "Cold restart: OB 102 or OB 100; data blocks get their load values",
                    Command::Hot => "Hot restart: OB 101; everything keeps its value (S7-400 only)",
                    Command::Reset => "Memory reset: STOP, everything as after loading",
                },
            ),
            Self::Status => ("status", "State, scan statistics, modules"),
            Self::Timing => (
                "timing",
                "The accounts of every scan: distributions of times, late scans and their causes (docs/timing.md)",
            ),
            Self::Recorder => ("recorder", "The flight recorder: the scans up to the worst overrun, or up to now"),
        };
        Some(PossibleValue::new(word).help(help))
    }
}

pub(crate) fn ask(station: &str, op: Op) -> Result<Response, Exit> {
    Client::to_station(station).and_then(|mut client| client.ask(op)).map_err(|error| {
        err!("ob1: {error}");
        error.exit()
    })
}

/// Prints values of cells.
#[must_use]
pub fn get(args: GetArgs) -> Exit {
    let values = match ask(&args.station, Op::Get { items: args.items }) {
        Ok(response) => response.values.unwrap_or_default(),
        Err(exit) => return exit,
    };
    if args.json {
        return print_json(&values);
    }
    let width = values.iter().map(|v| v.item.chars().count()).max().unwrap_or(0);
    for value in &values {
        let hex = if value.type_name == "BOOL" { String::new() } else { format!("  16#{}", value.hex) };
        let shown = Form::Plain.show(&value.value, &value.hex);
        say!("{:<width$}  {shown:>12}{hex}", value.item);
    }
    Exit::Ok
}

/// Writes cells, given as `NAME=VALUE`.
#[must_use]
pub fn set(args: &SetArgs) -> Exit {
    let mut items = BTreeMap::new();
    for (name, value) in &args.items {
        items.insert(name.clone(), Value::from(value.as_str()));
    }
    ask(&args.station, Op::Set { items }).map_or_else(|exit| exit, |_| Exit::Ok)
}

/// Changes the operating state, or prints what the station says of itself.
#[must_use]
pub fn ctl(args: &CtlArgs) -> Exit {
    let (station, json) = (args.station.as_str(), args.json);
    match args.action {
        Action::Command(command) => ask(station, Op::Command { command }).map_or_else(|exit| exit, |_| Exit::Ok),
        Action::Status => status(station, json),
        Action::Timing => timing(station, json),
        Action::Recorder => recorder(station, json),
    }
}

/// Prints state and figures.
fn status(station: &str, json: bool) -> Exit {
    match ask(station, Op::Status).map(|response| response.status) {
        Ok(Some(status)) if json => print_json(&status),
        Ok(Some(status)) => {
            print_status(&status);
            Exit::Ok
        }
        Ok(None) => Exit::Refused,
        Err(exit) => exit,
    }
}

/// Prints the accounts of every scan.
fn timing(station: &str, json: bool) -> Exit {
    match ask(station, Op::Timing { histograms: json }).map(|response| response.timing) {
        Ok(Some(timing)) if json => print_json(&timing),
        Ok(Some(timing)) => {
            says!("{}", text::timing(&timing));
            Exit::Ok
        }
        Ok(None) => Exit::Refused,
        Err(exit) => exit,
    }
}

/// Prints the flight recorder.
fn recorder(station: &str, json: bool) -> Exit {
    match ask(station, Op::Recorder).map(|response| response.recorder) {
        Ok(Some(recorder)) if json => print_json(&recorder),
        Ok(Some(recorder)) => {
            says!("{}", text::recorder(&recorder));
            Exit::Ok
        }
        Ok(None) => Exit::Refused,
        Err(exit) => exit,
    }
}

fn print_status(status: &Status) {
    say!("{} is in {}, process {}, {:.1} s", status.station, status.state, status.pid, status.runtime_ns as f64 / 1e9);
    say!(
        "engine {}   scans {}   overruns {}   missed deadlines {}   late {}   watchdog {}",
        status.engine,
        status.scans,
        status.overruns,
        status.missed,
        status.late,
        status.watchdogs
    );
    let line = |name: &str, t: &Times| {
        let us = |ns: f64| ns / 1000.0;
        say!(
            "{name:<10} min {:.1}   mean {:.1}   p50 {:.1}   p99 {:.1}   max {:.1} µs",
            us(t.min_ns as f64),
            us(t.mean_ns),
            us(t.p50_ns as f64),
            us(t.p99_ns as f64),
            us(t.max_ns as f64)
        );
    };
    line("cycle", &status.cycle);
    line("wake-up", &status.wake);
    line("execution", &status.execution);
    if let Some(retentive) = &status.retentive {
        say!("{}", retentive_text(retentive));
    }
    if !status.downloads.is_empty() {
        let list: Vec<String> = status.downloads.iter().map(|one| format!("{} {}", one.block, one.what)).collect();
        say!("different from the sources: {}", list.join(", "));
    }
    if let Some(why) = &status.downloads_not_kept {
        say!("the downloaded blocks are lost when the station ends: {why}");
    }
    if status.log_lost > 0 {
        say!("log lines lost {}: standard error of the runtime is full, slow or gone", status.log_lost);
    }
    for grant in &status.posture {
        say!("{grant}");
    }
    for module in &status.modules {
        let present = if module.present { "present" } else { "absent" };
        says!("{} ({} at {}): {present}", module.name, module.type_name, module.address);
        if let Some(driver) = &module.driver {
            let (pid, state, losses) = (driver.pid, &driver.state, driver.losses);
            says!(", driver {pid} {state}, lost {losses}, LEDs {}", module.leds.join(" "));
            if let Some(events) = module.counters.get(EVENTS_LOST).filter(|events| **events > 0) {
                says!(", events lost {events}");
            }
        }
        say!();
    }
}

fn retentive_text(retentive: &RetentiveStatus) -> String {
    let age = retentive.age_ns.map_or_else(
        || "never written by this runtime".to_owned(),
        |age| format!("saved as of {:.1} s ago", age as f64 / 1e9),
    );
    let generation = retentive.generation.map_or_else(String::new, |number| format!(", generation {number}"));
    match &retentive.error {
        Some(error) => format!("retentive memory cannot be written: {error}; {age}{generation}"),
        None => format!("retentive memory {age}{generation}"),
    }
}

pub(crate) fn print_json(value: &impl serde::Serialize) -> Exit {
    match serde_json::to_string_pretty(value) {
        Ok(text) => {
            say!("{text}");
            Exit::Ok
        }
        Err(error) => {
            err!("ob1: {error}");
            Exit::System
        }
    }
}
