//! `ob1 ctl`: operating a running station.

use std::io::{BufRead as _, IsTerminal as _};
use std::thread;
use std::time::{Duration, Instant};

use clap::builder::PossibleValue;
use clap::{Args, ValueEnum};
use ob1_access::LastStop;
use ob1_model::{Command, Event, OperatingState};

use crate::exit::Exit;
use crate::remote::{ask, recorder, status, timing};
use ob1_station::access::protocol::{Diagnostic, Op, Status};

/// How long a change to RUN is waited for, until the first scan has ended.
const FIRST_SCAN: Duration = Duration::from_secs(10);
/// Between two looks at the station meanwhile.
const LOOK: Duration = Duration::from_millis(20);
/// Entries of the diagnostic buffer in which the reason of a STOP is looked for.
const ENTRIES: u32 = 100;

/// Operate a running station
#[derive(Debug, Args)]
#[command(
    after_help = "run, warm, cold and hot wait for the first scan; if the CPU falls back to STOP they say why (exit code 3).\n\
    Every change from STOP to RUN sends the parameters to all CPs again.\n\nExamples:\n  ob1 ctl press stop\n  ob1 ctl \
    press.toml warm"
)]
pub struct CtlArgs {
    /// A running station: its name or its file
    pub station: String,
    /// What to do
    pub action: Action,
    /// Without a question whether that is meant
    #[arg(long, short)]
    pub yes: bool,
    /// Answers of status, timing and recorder as JSON
    #[arg(long)]
    pub json: bool,
}

/// What `ob1 ctl` does.
#[derive(Clone, Copy, Debug)]
pub enum Action {
    /// Changes the operating state.
    Command(Command),
    /// Asks which restart is meant.
    Restart,
    /// Says by the exit code whether the station is in RUN.
    Ready,
    /// Prints state and figures.
    Status,
    /// Prints the accounts of every scan.
    Timing,
    /// Prints the flight recorder.
    Recorder,
}

impl ValueEnum for Action {
    fn value_variants<'a>() -> &'a [Self] {
        const ALL: [Action; 12] = [
            Action::Command(Command::Run),
            Action::Command(Command::Stop),
            Action::Command(Command::Warm),
            Action::Command(Command::Keep),
            Action::Command(Command::Cold),
            Action::Command(Command::Hot),
            Action::Command(Command::Reset),
            Action::Restart,
            Action::Ready,
            Action::Status,
            Action::Timing,
            Action::Recorder,
        ];
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        let (word, help) = match self {
            Self::Command(command) => (
                command.name(),
                match command {
                    Command::Run => "STOP to RUN by a warm restart; nothing in RUN",
                    Command::Stop => "To STOP: outputs off",
                    Command::Warm => "Warm restart: OB 100; M, T, Z cleared, data blocks kept",
                    Command::Keep => "Warm restart that keeps all data blocks, whatever [retentive] says",
                    Command::Cold => "Cold restart: OB 102 or OB 100; data blocks get their load values",
                    Command::Hot => "Hot restart: OB 101; everything keeps its value (S7-400 only)",
                    Command::Reset => {
                        "Memory reset, in STOP only: all flags, timers, counters and data blocks lose their values"
                    }
                },
            ),
            Self::Restart => ("restart", "Asks which one: warm keeps the data blocks, cold loads them anew"),
            Self::Ready => {
                ("ready", "Whether it is in RUN and its cycles end, by the exit code: 0, or 3 with the reason")
            }
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

/// Changes the operating state, or prints what the station says of itself.
pub fn ctl(args: &CtlArgs) -> Exit {
    let (station, json) = (args.station.as_str(), args.json);
    match args.action {
        Action::Command(Command::Reset) => reset(station, args.yes),
        Action::Command(command) => change(station, command),
        Action::Restart => match which_restart(station) {
            Some(command) => change(station, command),
            None => Exit::Usage,
        },
        Action::Ready => ready(station).unwrap_or_else(|exit| exit),
        Action::Status => status(station, json),
        Action::Timing => timing(station, json),
        Action::Recorder => recorder(station, json),
    }
}

/// A line from the terminal, in small letters; none without one.
pub(crate) fn answer(question: &str) -> Option<String> {
    if !std::io::stdin().is_terminal() {
        return None;
    }
    err!("{question}");
    let mut line = String::new();
    std::io::stdin().lock().read_line(&mut line).ok()?;
    Some(line.trim().to_lowercase())
}

pub(crate) fn agrees(answer: &str) -> bool {
    matches!(answer, "y" | "yes" | "j" | "ja")
}

fn which_restart(station: &str) -> Option<Command> {
    let told = "warm keeps the data blocks, cold loads them anew";
    match answer(&format!("which restart? {told}: warm or cold?")).as_deref() {
        Some("warm" | "w") => Some(Command::Warm),
        Some("cold" | "c" | "k") => Some(Command::Cold),
        Some(_) => None,
        None => {
            err!("ob1: which restart? {told}\n  = ob1 ctl {station} warm, or ob1 ctl {station} cold");
            None
        }
    }
}

fn look(station: &str) -> Result<Status, Exit> {
    ask(station, Op::Status)?.status.ok_or(Exit::Refused)
}

/// For health checks: alive is not enough.
fn ready(station: &str) -> Result<Exit, Exit> {
    let status = look(station)?;
    if let Some(seconds) = status.stands_s {
        err!("ob1: {station}: a cycle began {seconds} s ago and does not end\n  = ob1 why and ob1 top say more");
        return Ok(Exit::Fault);
    }
    if status.state == OperatingState::Run.name() {
        return Ok(Exit::Ok);
    }
    let why = why_stopped(station, 0).map(|why| format!(": {why}")).unwrap_or_default();
    err!("ob1: {station} is in {}{why}", status.state);
    Ok(Exit::Fault)
}

/// A real CPU resets its memory in STOP only, and wants the switch turned twice.
fn reset(station: &str, yes: bool) -> Exit {
    let state = match look(station) {
        Ok(status) => status.state,
        Err(exit) => return exit,
    };
    if state != OperatingState::Stop.name() {
        err!("ob1: {station} is in {state}: memory reset is refused\n  = first ob1 ctl {station} stop");
        return Exit::Refused;
    }
    let question = "memory reset: all flags, timers, counters and data blocks lose their values. Go on? y";
    if !yes && !answer(question).is_some_and(|answer| agrees(&answer)) {
        err!("ob1: nothing was reset\n  = answer y on a terminal, or add --yes");
        return Exit::Usage;
    }
    ask(station, Op::Command { command: Command::Reset }).map_or_else(|exit| exit, |_| Exit::Ok)
}

/// The number of the newest entry in the diagnostic buffer.
fn newest(station: &str) -> Result<u64, Exit> {
    let entries = ask(station, Op::Diag { count: 1 })?.diagnostics.unwrap_or_default();
    Ok(entries.first().map_or(0, |entry| entry.number))
}

/// Changes the operating state. A change to RUN ends with the first scan, or with the reason why there is none.
pub(crate) fn change(station: &str, command: Command) -> Exit {
    match try_change(station, command) {
        Ok(exit) | Err(exit) => exit,
    }
}

fn try_change(station: &str, command: Command) -> Result<Exit, Exit> {
    let (before, last) = (look(station)?.scans, newest(station)?);
    ask(station, Op::Command { command })?;
    if command == Command::Stop {
        return Ok(Exit::Ok);
    }
    let began = Instant::now();
    while began.elapsed() < FIRST_SCAN {
        let status = look(station)?;
        let is = |state: OperatingState| status.state == state.name();
        if is(OperatingState::Hold) || is(OperatingState::Run) && status.scans > before {
            return Ok(Exit::Ok);
        }
        if is(OperatingState::Stop)
            && let Some(why) = why_stopped(station, last)
        {
            err!("ob1: {why}");
            return Ok(Exit::Fault);
        }
        thread::sleep(LOOK);
    }
    let state = look(station)?.state;
    err!("ob1: {station} is in {state}, and no scan has ended in {} s\n  = ob1 diag {station}", FIRST_SCAN.as_secs());
    Ok(Exit::Refused)
}

/// Why the CPU is in STOP, with the remedy, if an entry with a higher number than `after` says it.
pub(crate) fn why_stopped(station: &str, after: u64) -> Option<String> {
    let entries = ask(station, Op::Diag { count: ENTRIES }).ok()?.diagnostics?;
    stop_of(&entries, after)
}

fn stop_of(entries: &[Diagnostic], after: u64) -> Option<String> {
    let LastStop { stop, cause, .. } = last_stop(entries).filter(|last| !last.over && last.stop.number > after)?;
    let told = cause.unwrap_or(stop);
    let remedy = if told.remedy.is_empty() { String::new() } else { format!("\n  = {}", told.remedy) };
    Some(format!("STOP: {}{remedy}", told.told()))
}

/// The newest STOP among `entries`, newest first.
pub(crate) fn last_stop(entries: &[Diagnostic]) -> Option<LastStop<'_, Diagnostic>> {
    let event = |entry: &Diagnostic| u16::from_str_radix(entry.event.trim_end_matches('h'), 16).unwrap_or_default();
    ob1_access::last_stop(entries, |entry| (entry.number, Event(event(entry))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reason_of_a_stop_is_the_fault_before_it() {
        let entry = |number: u64, event: &str, text: &str, remedy: &str| -> Diagnostic {
            serde_json::from_value(serde_json::json!({ "number": number, "time_ns": 0, "event": event, "text": text,
                "place": "f.awl:6", "remedy": remedy }))
            .expect("an entry")
        };
        let fault = || entry(2, "253Ah", "253Ah data block not loaded", "Load it.");
        let stop = || entry(3, "4562h", "4562h STOP by programming error", "");
        let told = Some("STOP: 253Ah data block not loaded, f.awl:6\n  = Load it.".to_owned());
        assert_eq!(stop_of(&[stop(), fault(), entry(1, "4302h", "RUN", "")], 0), told);
        assert_eq!(stop_of(&[stop(), fault()], 3), None, "an old one");
        assert_eq!(stop_of(&[entry(4, "4302h", "RUN", ""), stop(), fault()], 0), None, "it is over");
        let by_hand = stop_of(&[entry(5, "4304h", "4304h STOP by operator", "")], 4).expect("a STOP");
        assert_eq!(by_hand, "STOP: 4304h STOP by operator, f.awl:6");
    }
}
