//! `ob1 roll STATION... --run COMMAND`: a new version or a new program for many stations, one after the other; it stops
//! at the first that does not come back.
//!
//! What renews a station is somebody else's: systemd, a container engine, a copy of the sources. This waits, compares,
//! and knows when to stop.

use std::collections::BTreeMap;
use std::process::Command;
use std::thread;
use std::time::{Duration, Instant};

use clap::Args;
use ob1_model::{Event, OperatingState};
use ob1_time::Span;

use crate::ctl::{self, last_stop};
use crate::exit::Exit;
use crate::remote;
use ob1_station::access::protocol::{Op, Response, Status};

const LOOK: Duration = Duration::from_millis(100);

/// Renew stations one after the other, and stop at the first that does not come back
///
/// For each station: --run renews it ({} is its name). It is back when it is in RUN, stays there for the time of
/// --settle, has restored its retentive memory, and the cells of --values have what they had before. A station that is
/// not back in time is told with the reason; --back brings it back to what it was, and none of those behind it is
/// touched.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 roll press1 press2 press3 --run 'systemctl restart ob1@{}' --values DB10.DBW0,MW100\n  ob1 roll press1 press2 \
    --run 'podman auto-update' --back 'podman tag ob1:old ob1:now && systemctl restart {}'\n  ob1 roll press1 press2 --run 'ob1 load {} --yes' --back 'ob1 \
    load {} --back --yes'\n\nExit codes: 0 all are back, 5 a station did not run before, 8 one did not come back.\n\nMore: docs/fleet.md."
)]
pub struct RollArgs {
    /// The stations of this machine, in their turn
    #[arg(required = true)]
    pub stations: Vec<String>,
    /// The command of the shell that renews a station; {} is its name
    #[arg(long, value_name = "COMMAND")]
    pub run: String,
    /// The command of the shell that makes a station what it was
    #[arg(long, value_name = "COMMAND")]
    pub back: Option<String>,
    /// Cells that keep their values, such as recipes and counters of pieces
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub values: Vec<String>,
    /// How long a station may take until it is in RUN
    #[arg(long, value_name = "TIME", value_parser = ob1_station_file::parse_duration, default_value = "60s")]
    pub within: Span,
    /// How long it has to stay there before the next one is touched
    #[arg(long, value_name = "TIME", value_parser = ob1_station_file::parse_duration, default_value = "5s")]
    pub settle: Span,
}

/// A station before it is renewed.
struct Before {
    status: Status,
    values: BTreeMap<String, String>,
}

/// Runs `ob1 roll`, and says how it ended.
pub fn roll(args: &RollArgs) -> Exit {
    for (done, station) in args.stations.iter().enumerate() {
        let before = match before(station, &args.values) {
            Ok(before) => before,
            Err(why) => {
                err!(
                    "ob1: {station}: {why}; nothing was done to it\n  = {done} of {} are renewed",
                    args.stations.len()
                );
                return Exit::Running;
            }
        };
        match renew(station, args, &before) {
            Ok(now) => say!("{station}: back in RUN; {}", changed(&before.status, &now)),
            Err(why) => {
                err!("ob1: {station} did not come back: {why}");
                bring_back(station, args, &before);
                err!("  = {done} of {} are renewed, the others were not touched", args.stations.len());
                return Exit::Refused;
            }
        }
    }
    say!("{} stations are renewed", args.stations.len());
    Exit::Ok
}

fn ask(station: &str, op: Op) -> Result<Response, String> {
    remote::ask(station, op).map_err(|error| error.to_string())
}

fn look(station: &str) -> Result<Status, String> {
    ctl::look(station).map_err(|error| error.to_string())
}

fn before(station: &str, values: &[String]) -> Result<Before, String> {
    let status = look(station)?;
    if status.state != OperatingState::Run.name() {
        return Err(format!("it is in {}, and would not be back in RUN", status.state));
    }
    Ok(Before { status, values: cells(station, values)? })
}

fn cells(station: &str, items: &[String]) -> Result<BTreeMap<String, String>, String> {
    if items.is_empty() {
        return Ok(BTreeMap::new());
    }
    let values = ask(station, Op::Get { items: items.to_vec() })?.values.unwrap_or_default();
    Ok(values.into_iter().map(|value| (value.item, value.text)).collect())
}

fn renew(station: &str, args: &RollArgs, before: &Before) -> Result<Status, String> {
    shell(&args.run, station)?;
    let status = until_run(station, args.within.into(), args.settle.into())?;
    // Another process has begun with what the disk had.
    if status.pid != before.status.pid {
        restored(station)?;
    }
    let now = cells(station, &args.values)?;
    let other = before.values.iter().find(|(item, value)| now.get(*item) != Some(value));
    match other {
        None => Ok(status),
        Some((item, was)) => {
            let is = now.get(item).map_or("nothing", String::as_str);
            Err(format!("{item} was {was} and is {is}"))
        }
    }
}

/// `sh -c` with the name of the station in it.
fn shell(command: &str, station: &str) -> Result<(), String> {
    let line = command.replace("{}", station);
    match Command::new("sh").args(["-c", &line]).status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(format!("`{line}` has ended with {status}")),
        Err(error) => Err(format!("`{line}`: {error}")),
    }
}

/// Waits until the station is in RUN, has scanned, and has stayed there.
fn until_run(station: &str, within: Duration, settle: Duration) -> Result<Status, String> {
    let (begin, mut since) = (Instant::now(), None);
    loop {
        let status = look(station);
        let runs = status
            .as_ref()
            .is_ok_and(|now| now.state == OperatingState::Run.name() && now.scans > 0 && now.stands_s.is_none());
        match (status, since) {
            (Ok(status), Some(at)) if runs && Instant::now().duration_since(at) >= settle => return Ok(status),
            (_, Some(_)) if runs => {}
            _ if runs => since = Some(Instant::now()),
            (status, _) => {
                since = None;
                if begin.elapsed() >= within {
                    let state = status.map(|status| format!("it is in {}", status.state));
                    let stop = why_stopped(station).map(|why| format!(": {why}")).unwrap_or_default();
                    return Err(format!("after {} s {}{stop}", within.as_secs(), state.unwrap_or_else(|why| why)));
                }
            }
        }
        thread::sleep(LOOK);
    }
}

fn why_stopped(station: &str) -> Option<String> {
    let entries = ask(station, Op::Diag { count: 100 }).ok()?.diagnostics?;
    let last = last_stop(&entries)?;
    Some(last.cause.unwrap_or(last.stop).told())
}

/// Nothing of its retentive memory was refused.
fn restored(station: &str) -> Result<(), String> {
    let entries = ask(station, Op::Diag { count: 100 })?.diagnostics.unwrap_or_default();
    let lost = [Event::RETENTIVE_REFUSED, Event::RETENTIVE_PARTLY].map(|event| format!("{:04X}h", event.0));
    match entries.iter().find(|entry| lost.contains(&entry.event)) {
        Some(entry) => Err(entry.told()),
        None => Ok(()),
    }
}

fn bring_back(station: &str, args: &RollArgs, before: &Before) {
    let Some(back) = &args.back else {
        err!("  = it stays as it is: no --back was given");
        return;
    };
    let came = shell(back, station).and_then(|()| until_run(station, args.within.into(), args.settle.into()));
    match came {
        Ok(now) => err!("  = it was brought back: {}", changed(&before.status, &now)),
        Err(why) => err!("  = it could not be brought back: {why}"),
    }
}

fn changed(before: &Status, now: &Status) -> String {
    let pair = |was: &str, is: &str| if was == is { is.to_owned() } else { format!("{was} -> {is}") };
    format!("ob1 {}, program {}", pair(&before.version, &now.version), pair(&before.program, &now.program))
}
