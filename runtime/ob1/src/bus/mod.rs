//! `ob1 bus watch`: the couplers and slaves of a running station, live. `ob1 bus scan`: who is on a PROFIBUS, beside
//! what the station file says; the station does not run meanwhile, for one process owns a line.

pub(crate) mod text;
mod watch;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use clap::{Args, Subcommand};
use ob1_station::access::client::AccessError;
use ob1_station::drivers;
use ob1_station_file::{self, Bus, Line};
use serde_json::Value;

use crate::exit::{Exit, told};

/// Look at the buses of a station
///
/// `watch` shows the couplers and slaves of a running station live: their state, their diagnosis, their inputs and
/// outputs. `scan` asks a PROFIBUS who is on it, while the station does not run.
#[derive(Clone, Debug, Args)]
#[command(after_help = "Examples:\n  ob1 bus watch press.toml\n  ob1 bus scan station.toml")]
pub struct BusArgs {
    #[command(subcommand)]
    action: BusAction,
}

#[derive(Clone, Debug, Subcommand)]
enum BusAction {
    /// Show the couplers and slaves of a running station, live
    Watch(watch::WatchArgs),
    /// Ask who is on a PROFIBUS
    ///
    /// Every address is asked for its diagnosis; slaves that exchange data with another master continue to do so. The
    /// station does not run meanwhile.
    Scan(ScanArgs),
}

#[derive(Clone, Debug, Args)]
#[command(after_help = "Examples:\n  ob1 bus scan station.toml\n  ob1 bus scan station.toml --bus profi --json")]
struct ScanArgs {
    /// The station file
    station: PathBuf,
    /// Its bus, where it has more than one of type "dp"
    #[arg(long, value_name = "NAME")]
    bus: Option<String>,
    /// As JSON
    #[arg(long)]
    json: bool,
}

/// A slave that answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Found {
    ident: u16,
    master: Option<u8>,
}

/// What the station file says of an address.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Wanted {
    name: String,
    ident: u16,
}

/// Runs `ob1 bus`, and says how it ended.
pub(crate) fn run(args: &BusArgs) -> Exit {
    match &args.action {
        BusAction::Watch(args) => told(watch::watch(args), AccessError::exit),
        BusAction::Scan(args) => scan(args),
    }
}

/// Asks every address, and prints who answers.
fn scan(options: &ScanArgs) -> Exit {
    let station = match ob1_station_file::load(&options.station) {
        Ok(station) => station,
        Err(findings) => {
            findings.iter().for_each(|finding| err!("{finding}"));
            return Exit::Rejected;
        }
    };
    let is_dp = |bus: &&Bus| bus.config.lines.iter().any(|line| line.dp.is_some());
    let mut all = station.buses.iter().filter(is_dp);
    let bus = match &options.bus {
        Some(name) => all.find(|bus| bus.name == *name),
        None => all.next().filter(|_| all.next().is_none()),
    };
    let Some(bus) = bus else {
        let names: Vec<&str> = station.buses.iter().filter(is_dp).map(|bus| bus.name.as_str()).collect();
        let remedy = if names.is_empty() {
            "the station has no bus of type \"dp\"".to_owned()
        } else {
            format!("--bus {}", names.join(" | "))
        };
        err!("ob1: which bus of type \"dp\"?\n  = {remedy}");
        return Exit::Usage;
    };
    if bus.lines.iter().any(|line| matches!(line, Line::Sim(_))) {
        err!("ob1: {} is on a simulated line, which is there only while its station runs", bus.name);
        return Exit::Usage;
    }
    let found = match ask(bus) {
        Ok(found) => found,
        Err(why) => {
            err!("ob1: bus {}: {why}\n  = a running station keeps the line to itself: end the station first", bus.name);
            return Exit::System;
        }
    };
    let slaves = bus.config.lines.iter().flat_map(|line| &line.dp).flat_map(|dp| &dp.slaves);
    let wanted = slaves.map(|slave| (slave.station, Wanted { name: slave.name.clone(), ident: slave.ident })).collect();
    if options.json {
        return crate::remote::print_json(&as_json(&found, &wanted));
    }
    says!("{}", table(&found, &wanted));
    Exit::Ok
}

/// The process of the bus does it: it owns the line, and knows how.
fn ask(bus: &Bus) -> Result<BTreeMap<u8, Found>, String> {
    let program = drivers::find_driver("ob1-io", "OB1_IO")?;
    let text = serde_json::to_string(&bus.config).map_err(|error| error.to_string())?;
    let mut command = Command::new(&program);
    command.args(["--scan", "--name", &bus.name, "--bus", &text]).stdin(Stdio::null()).stderr(Stdio::inherit());
    let output = command.output().map_err(|error| format!("{}: {error}", program.display()))?;
    if !output.status.success() {
        return Err("the line cannot be used".into());
    }
    let text = String::from_utf8_lossy(&output.stdout);
    Ok(text.lines().filter_map(|line| serde_json::from_str(line).ok()).filter_map(|value| slave(&value)).collect())
}

fn slave(value: &Value) -> Option<(u8, Found)> {
    let number = |key: &str| value[key].as_u64();
    let master = number("master").and_then(|master| u8::try_from(master).ok());
    Some((u8::try_from(number("station")?).ok()?, Found { ident: u16::try_from(number("ident")?).ok()?, master }))
}

/// What is to be said of an address: its ident, the name, words.
fn row(found: Option<&Found>, wanted: Option<&Wanted>) -> (String, String, String) {
    let ident = found.map_or_else(|| "-".to_owned(), |found| format!("{:04X}h", found.ident));
    let name = wanted.map_or_else(|| "-".to_owned(), |wanted| wanted.name.clone());
    let words = match (found, wanted) {
        (None, _) => "does not answer".to_owned(),
        (Some(_), None) => "is not in the station file".to_owned(),
        (Some(found), Some(wanted)) if found.ident != wanted.ident => {
            format!("is another device: its GSD file is of {:04X}h", wanted.ident)
        }
        (Some(Found { master: Some(master), .. }), Some(_)) => format!("belongs to master {master}"),
        (Some(_), Some(_)) => String::new(),
    };
    (ident, name, words)
}

fn addresses(found: &BTreeMap<u8, Found>, wanted: &BTreeMap<u8, Wanted>) -> Vec<u8> {
    let mut all: Vec<u8> = found.keys().chain(wanted.keys()).copied().collect();
    all.sort_unstable();
    all.dedup();
    all
}

fn table(found: &BTreeMap<u8, Found>, wanted: &BTreeMap<u8, Wanted>) -> String {
    let mut text = String::from("station  ident  name\n");
    for station in addresses(found, wanted) {
        let (ident, name, words) = row(found.get(&station), wanted.get(&station));
        text.push_str(format!("{station:>7}  {ident:<5}  {name:<20}  {words}").trim_end());
        text.push('\n');
    }
    text
}

fn as_json(found: &BTreeMap<u8, Found>, wanted: &BTreeMap<u8, Wanted>) -> Value {
    let one = |station: u8| {
        let (found, wanted) = (found.get(&station), wanted.get(&station));
        serde_json::json!({
            "station": station,
            "ident": found.map(|found| found.ident),
            "master": found.and_then(|found| found.master),
            "name": wanted.map(|wanted| &wanted.name),
            "says": row(found, wanted).2,
        })
    };
    addresses(found, wanted).into_iter().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_answers_beside_who_should() {
        let found = |ident, master| Found { ident, master };
        let wanted = |name: &str, ident| Wanted { name: name.into(), ident };
        let found = BTreeMap::from([
            (3, found(0x801D, None)),
            (4, found(0x806A, None)),
            (5, found(1, Some(1))),
            (9, found(2, None)),
        ]);
        let wanted = BTreeMap::from([
            (3, wanted("rack", 0x801D)),
            (4, wanted("drive", 0x80B0)),
            (5, wanted("valves", 1)),
            (7, wanted("scale", 3)),
        ]);
        let text = "station  ident  name\n\
                    \u{20}     3  801Dh  rack\n\
                    \u{20}     4  806Ah  drive                 is another device: its GSD file is of 80B0h\n\
                    \u{20}     5  0001h  valves                belongs to master 1\n\
                    \u{20}     7  -      scale                 does not answer\n\
                    \u{20}     9  0002h  -                     is not in the station file\n";
        assert_eq!(table(&found, &wanted), text);
        assert_eq!(slave(&serde_json::json!({ "station": 300, "ident": 1 })), None);
    }
}
