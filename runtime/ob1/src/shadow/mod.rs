//! `ob1 shadow`: a station runs beside the rack that it is to replace, on the rack's inputs, and what both make of them
//! is compared. Nothing is written to the rack, and the outputs of the station lead nowhere. docs/shadow.md

mod judge;
mod place;
mod rack;
mod recording;
mod replica;
mod report;
mod subject;
#[cfg(test)]
mod tests;

use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

use clap::Args;
use ob1_time::Span;

use crate::exit::{DiffExit, told};
use crate::import::{CpuArgs, Unit};
use judge::Judge;
use rack::{Rack as _, S7Rack};
use recording::Recording;
use report::Report;
use subject::Subject;

/// Time until the rack is called again after it was lost.
const AGAIN: Duration = Duration::from_secs(2);

/// Run a station beside the rack that it is to replace, and compare
///
/// Reads the inputs of a running S7-300 or S7-400 over S7 communication, runs the station's program on them, and
/// compares its outputs with those of the rack. Nothing is written to the rack; the station's outputs lead nowhere, its
/// drivers are not started. A difference is told with the statement where it begins.
#[derive(Clone, Debug, Args)]
#[command(after_help = "Examples:\n  ob1 shadow press/station.toml --rack 192.168.0.10\n  \
    ob1 shadow press/station.toml --rack 192.168.0.10 --for 7d --report press.json\n  \
    ob1 shadow press/station.toml --rack 192.168.0.10 --compare MW10,DB5.LEVEL\n\n\
    Exit codes: 0 equal, 1 differences, 2 nothing could be compared.\n\nMore: docs/shadow.md.")]
pub struct ShadowArgs {
    /// The station file
    #[arg(value_name = "STATION")]
    pub station: PathBuf,
    /// The rack: name or address of its CPU, HOST or HOST:PORT
    #[arg(long, value_name = "HOST")]
    pub rack: String,
    /// The slot of its CPU: 2 in an S7-300, 3 or another in an S7-400
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u8).range(0..=31))]
    pub rack_slot: u8,
    /// The number of the rack
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u8).range(0..=7))]
    pub rack_number: u8,
    /// The password of its CPU, where reading needs one
    #[arg(long)]
    pub rack_password: Option<String>,
    /// Cells and symbols that are compared besides the outputs
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub compare: Vec<String>,
    /// Time between two readings; the rack may need longer
    #[arg(long, value_name = "TIME", default_value = "50ms", value_parser = ob1_station_file::parse_duration)]
    pub every: Span,
    /// How long, in days too; without it until Ctrl-C
    #[arg(long = "for", value_name = "TIME", value_parser = ob1_station_file::parse_run)]
    pub time: Option<Span>,
    /// Write the report as JSON, anew with each difference and at the end
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Keep all readings in a recording, for `ob1 exec --replay` and `ob1 test`
    #[arg(long, value_name = "FILE")]
    pub recording: Option<PathBuf>,
}

/// Compares; prints what there is to print.
pub fn shadow(args: &ShadowArgs) -> DiffExit {
    let done = ob1_rt::with_stack(ob1_cpu::MOST_STACK_BYTES, || run(args));
    told(done.map_err(|error| format!("a thread for the program: {error}")).flatten(), |_| DiffExit::Nothing)
}

fn run(args: &ShadowArgs) -> Result<DiffExit, String> {
    let ended = ob1_rt::ended_by_signal().map_err(|error| format!("signals: {error}"))?;
    let subject = Subject::load(&args.station, &args.compare)?;
    let unit = Unit { rack: args.rack_number, slot: args.rack_slot, password: args.rack_password.clone() };
    let cpu = CpuArgs { host: args.rack.clone(), unit };
    let mut rack = S7Rack::new(cpu.clone(), &subject);
    let date = rack.date()?;
    let mut judge = Judge::new(&subject, date)?;
    let mut report = Report::new(&subject, &args.rack);
    let (bytes, telegrams) = rack.cost(&judge.wanted())?;
    say!("{}: {} cells compared; a reading is {bytes} bytes in {telegrams} telegrams", args.rack, report.cells());
    subject.left_out.iter().for_each(|left| say!("not compared: {left}"));
    let mut recording = match &args.recording {
        Some(path) => Some(Recording::begin(path, &subject)?),
        None => None,
    };
    let end = args.time.map(|time| rack.now().saturating_add(time));
    let (mut is_lost, mut halted) = (false, None);
    while !ended.load(Ordering::SeqCst) && end.is_none_or(|end| rack.now() < end) {
        let due = rack.now().saturating_add(args.every);
        let found = match rack.look(&judge.wanted()) {
            Ok(Some(look)) => {
                recording.as_mut().map_or(Ok(()), |recording| recording.take(&look))?;
                judge.take(look, &mut rack)
            }
            Ok(None) => {
                judge.stopped();
                Ok(Vec::new())
            }
            Err(text) => Err(text),
        };
        match found {
            Ok(found) => {
                is_lost = false;
                for difference in found {
                    says!("{}", report.add(difference, &cpu));
                    report.write(args.report.as_deref(), &judge)?;
                }
                halted = judge.halted();
                if halted.is_some() {
                    break;
                }
                std::thread::sleep(Duration::from_nanos(due.since(rack.now()).nanos()));
            }
            Err(text) => {
                if !std::mem::replace(&mut is_lost, true) {
                    err!("ob1: {text}; it is tried again");
                }
                std::thread::sleep(AGAIN);
            }
        }
    }
    recording.as_mut().map_or(Ok(()), Recording::flush)?;
    report.write(args.report.as_deref(), &judge)?;
    says!("{}", report.text(&judge));
    match halted {
        Some(why) => Err(format!("the station has left RUN: {why}")),
        None => Ok(report.exit(&judge)),
    }
}
