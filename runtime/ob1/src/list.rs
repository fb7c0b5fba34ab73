//! `ob1 list`: the stations that run on this machine, for people and for Prometheus.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::thread;

use clap::Args;
use ob1_model::OperatingState;
use serde::Serialize;
use serde_json::json;

use crate::ctl::last_stop;
use crate::exit::{Exit, told};
use crate::remote::print_json;
use crate::units::time;
use ob1_station::access::client::Client;
use ob1_station::access::protocol::{Listens, Op, Status};
use ob1_station::rundir;

/// Entries of the diagnostic buffer in which the last STOP is looked for.
const ENTRIES: u32 = 100;
/// Stations that are asked at the same time.
const AT_ONCE: usize = 64;

/// List the stations that run on this machine
///
/// Those of this user; root sees the installed ones, too. Each with its state, its cycle, its late scans, the version
/// of its runtime, the fingerprint of its program, and why it went to STOP last.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 list\n  ob1 list --json\n  ob1 list --prometheus /etc/prometheus/ob1/hall3.json\n\nMore: docs/fleet.md."
)]
pub struct ListArgs {
    /// As a JSON array of {name, state, version, program, pid, running_s, cycle_ns, late, last_stop, listens, ...}
    #[arg(long)]
    pub json: bool,
    /// Write the links of type "metrics" there, for file_sd_configs of Prometheus; "-" prints them
    #[arg(long, value_name = "FILE", conflicts_with = "json")]
    pub prometheus: Option<PathBuf>,
    /// With --prometheus: how this machine is called, where a link listens on all its addresses [default: its name]
    #[arg(long, value_name = "HOST", requires = "prometheus")]
    pub host: Option<String>,
}

#[derive(Debug, Default, Serialize)]
struct Listed {
    name: String,
    /// Empty: it does not answer.
    state: String,
    version: String,
    program: String,
    pid: Option<u32>,
    running_s: Option<u64>,
    min_cycle_ns: u64,
    /// Median, from start to start.
    cycle_ns: u64,
    wake_p99_ns: u64,
    scans: u64,
    late: u64,
    missed: u64,
    /// The newest STOP and its cause, while the diagnostic buffer has it.
    last_stop: Option<Stop>,
    listens: Vec<Listens>,
    folder: String,
}

#[derive(Debug, Serialize)]
struct Stop {
    /// When, in nanoseconds since 1970.
    unix_ns: u64,
    text: String,
    remedy: String,
    /// The station has been in RUN since.
    over: bool,
}

/// Runs `ob1 list`: prints the stations, and says how it ended.
pub fn list(args: &ListArgs) -> Exit {
    let all: Vec<Listed> = rundir::running().chunks(AT_ONCE).flat_map(asked).collect();
    if let Some(file) = &args.prometheus {
        return write_targets(&all, file, args.host.as_deref());
    }
    if args.json {
        return print_json(&all);
    }
    print(&all);
    if all.is_empty() {
        err!("no station runs\n  = ob1 run FILE starts one; looked for in {}", rundir::listed());
    }
    Exit::Ok
}

/// Some stations, asked at the same time: each answers when its cycle ends, and none waits for another.
fn asked(stations: &[(String, PathBuf)]) -> Vec<Listed> {
    let one = |(name, folder): &(String, PathBuf)| {
        let asked = Client::to_socket(&folder.join(rundir::SOCKET)).ok().and_then(ask);
        Listed { name: name.clone(), folder: folder.display().to_string(), ..asked.unwrap_or_default() }
    };
    thread::scope(|scope| {
        let asking = |station| (station, thread::Builder::new().spawn_scoped(scope, move || one(station)).ok());
        let asking: Vec<_> = stations.iter().map(asking).collect();
        let said = |thread: thread::ScopedJoinHandle<'_, Listed>| thread.join().ok();
        // Without a thread it is asked here.
        asking.into_iter().map(|(station, thread)| thread.and_then(said).unwrap_or_else(|| one(station))).collect()
    })
}

/// What a station says of itself; none without an answer.
fn ask(mut client: Client) -> Option<Listed> {
    let status: Status = client.ask(Op::Status).ok()?.status?;
    let entries = client.ask(Op::Diag { count: ENTRIES }).ok().and_then(|answer| answer.diagnostics);
    let entries = entries.unwrap_or_default();
    let stop = last_stop(&entries).map(|last| {
        let cause = last.cause.unwrap_or(last.stop);
        Stop { unix_ns: last.stop.unix_ns, text: cause.told(), remedy: cause.remedy.clone(), over: last.over }
    });
    Some(Listed {
        state: status.state,
        version: status.version,
        program: status.program,
        pid: Some(status.pid),
        running_s: Some(status.runtime_ns / 1_000_000_000),
        min_cycle_ns: status.min_cycle_ns,
        cycle_ns: status.cycle.p50_ns,
        wake_p99_ns: status.wake.p99_ns,
        scans: status.scans,
        late: status.late,
        missed: status.missed,
        last_stop: stop,
        listens: status.listens,
        ..Listed::default()
    })
}

fn print(all: &[Listed]) {
    let width = all.iter().map(|one| one.name.chars().count()).max().unwrap_or(0).max(7);
    if !all.is_empty() {
        const HEAD: &str =
            "state        cycle  wake p99       scans    late  missed  version  program   process, seconds";
        say!("{:<width$}  {HEAD}", "station");
    }
    for one in all {
        let (Some(pid), Some(seconds)) = (one.pid, one.running_s) else {
            say!("{:<width$}  does not answer", one.name);
            continue;
        };
        let (cycle, wake) = (time(one.cycle_ns as f64), time(one.wake_p99_ns as f64));
        say!(
            "{:<width$}  {:<8}{cycle:>10}{wake:>10}{:>12}{:>8}{:>8}  {:<9}{:<10}{pid}, {seconds} s",
            one.name,
            one.state,
            one.scans,
            one.late,
            one.missed,
            one.version,
            one.program
        );
        match &one.last_stop {
            Some(stop) if one.state == OperatingState::Stop.name() => {
                say!("{:<width$}  {}\n{:<width$}    = {}", "", stop.text, "", stop.remedy);
            }
            Some(stop) => say!("{:<width$}  last STOP: {}", "", stop.text),
            None => {}
        }
    }
}

/// Targets for `file_sd_configs`. A file is replaced as a whole: Prometheus reads it whenever it changes.
fn write_targets(all: &[Listed], file: &std::path::Path, host: Option<&str>) -> Exit {
    let name = rustix::system::uname().nodename().to_string_lossy().into_owned();
    let host = host.unwrap_or(&name);
    let mut text = serde_json::to_string_pretty(&targets(all, host)).unwrap_or_default();
    text.push('\n');
    if file.as_os_str() == "-" {
        says!("{text}");
        return Exit::Ok;
    }
    let written = ob1_process::files::replace(file, text.as_bytes());
    let remedy = "name a file in a folder that this user may write";
    told(written.map(|()| Exit::Ok).map_err(|why| format!("{}: {why}\n  = {remedy}", file.display())), |_| Exit::System)
}

/// One entry a link. Which version and program run is told by the figures themselves: labels of a target are for what
/// does not change.
fn targets(all: &[Listed], host: &str) -> Vec<serde_json::Value> {
    let links = all.iter().flat_map(|one| one.listens.iter().map(move |link| (one, link)));
    let figures = links.filter(|(_, link)| link.kind == "metrics");
    figures
        .map(|(one, link)| {
            let scheme = if link.tls { "https" } else { "http" };
            json!({ "targets": [reached(link.address, host)],
                "labels": { "station": one.name, "host": host, "__scheme__": scheme } })
        })
        .collect()
}

/// The address that others use.
fn reached(address: SocketAddr, host: &str) -> String {
    match address.ip() {
        ip if ip.is_unspecified() => format!("{host}:{}", address.port()),
        _ => address.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_what_prometheus_reads() {
        let link = |kind: &str, address: &str, tls| Listens {
            kind: kind.into(),
            address: address.parse().expect(address),
            tls,
        };
        let one = Listed {
            name: "press7".into(),
            listens: vec![
                link("web", "0.0.0.0:8080", false),
                link("metrics", "0.0.0.0:9407", true),
                link("metrics", "192.0.2.7:9407", false),
            ],
            ..Listed::default()
        };
        let all = targets(&[one, Listed::default()], "hall3");
        assert_eq!(
            all,
            [
                json!({"targets": ["hall3:9407"], "labels": {"station": "press7", "host": "hall3", "__scheme__": "https"}}),
                json!({"targets": ["192.0.2.7:9407"], "labels": {"station": "press7", "host": "hall3", "__scheme__": "http"}})
            ]
        );
    }
}
