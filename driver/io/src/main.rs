//! `ob1-io`: the process of a bus. It exchanges inputs and outputs with the couplers or slaves on its lines, and ends
//! with its standard input.

// All output goes through one place that neither panics nor waits forever.
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod bus_log;
mod gpio;
mod line;
mod process;
mod reopening;
mod scan;

use std::process::ExitCode;

use clap::Parser;
use ob1_backplane::{BusMemory, BusSize, CpSide, Segment, SegmentError};
use ob1_coupler::BusConfig;
use ob1_process::from_runtime;
use tracing::{error, info};

use process::Process;

const HELP: &str = "\
The runtime starts it for each [[bus]] of a station, and hands over two descriptors through its standard output: the
segment it is supervised by, and the image of the bus. Standard input is the doorbell: a byte says that the outputs have
changed, end of file ends the process. SIGINT and SIGHUP are ignored (the runtime decides); SIGTERM ends it in order.
Before it ends it sets the outputs of all couplers it reaches to 0.

Exit codes:
  0  end of file on standard input, or SIGTERM
  1  the segment or the image cannot be used
  2  wrong arguments
  3  waiting failed (standard input is unusable); --scan: the line cannot be used

Environment:
  OB1_LOG    what to log on standard error: error, warn, info (default), debug (exchanges), trace (bytes)
  OB1_FENCE  what the process may do, as JSON (docs/security.md); without it everything that its user may do";

/// The process of a bus: Modbus couplers, PROFIBUS DP slaves or GPIO lines.
#[derive(Debug, Parser)]
#[command(name = "ob1-io", version, after_help = HELP)]
struct Arguments {
    /// The segment, as the runtime names it in lists of processes.
    #[arg(long, value_name = "PATH")]
    segment: Option<std::path::PathBuf>,

    /// The bus; the runtime writes this JSON text.
    #[arg(long, value_name = "JSON", value_parser = parse)]
    bus: BusConfig,

    /// Name for the log.
    #[arg(long, default_value = "bus")]
    name: String,

    /// The folder of the sockets by which others may listen to its lines.
    #[arg(long, value_name = "FOLDER")]
    trace: Option<std::path::PathBuf>,

    /// Only list the slaves on a PROFIBUS: a line of JSON for each slave that answers.
    #[arg(long)]
    scan: bool,
}

fn parse(text: &str) -> Result<BusConfig, String> {
    serde_json::from_str(text).map_err(|error| error.to_string())
}

fn main() -> ExitCode {
    // Before anything is opened, and before there is a thread.
    let fenced = from_runtime::confine();
    let exit = run(&Arguments::parse(), &fenced);
    ob1_process::log::flush(ob1_process::log::LAST_WORDS);
    exit
}

fn run(arguments: &Arguments, fenced: &Result<Vec<(&'static str, String)>, String>) -> ExitCode {
    ob1_process::start_log();
    // Of the highest level: a filter that lets only warnings through keeps the name before them.
    let _span = tracing::error_span!("io", name = arguments.name).entered();
    if !from_runtime::tell(fenced) {
        return ExitCode::from(2);
    }
    let bus = &arguments.bus;
    if arguments.scan {
        return match scan::run(bus) {
            Ok(()) => ExitCode::SUCCESS,
            Err(why) => {
                error!("{why}");
                ExitCode::from(3)
            }
        };
    }
    let terminate = ob1_process::signals();
    let Some(size) = BusSize::new(bus.stations().count(), bus.input_bytes, bus.output_bytes) else {
        error!("the bus has more couplers or bytes than an image carries");
        return ExitCode::from(2);
    };
    let (segment, memory) = match ends() {
        Ok(ends) => ends,
        Err(error) => {
            error!("{error}");
            return ExitCode::from(1);
        }
    };
    info!(generation = segment.generation(), couplers = bus.stations().count(), "attached");
    let process = Process::new(bus, segment, &memory, size, terminate, arguments.trace.as_deref())
        .and_then(|mut process| process.run());
    match process {
        Ok(()) => {
            info!("end");
            ExitCode::SUCCESS
        }
        Err(error) => {
            error!("{error}");
            ExitCode::from(3)
        }
    }
}

/// The descriptors handed over: the segment, then the image of the bus.
fn ends() -> Result<(CpSide, BusMemory), SegmentError> {
    let mut descriptors = ob1_process::handed_over().into_iter();
    let (Some(segment), Some(memory)) = (descriptors.next(), descriptors.next()) else {
        return Err(SegmentError::NotSealed);
    };
    Ok((CpSide::attach(&Segment::received(segment)?)?, BusMemory::received(memory)?))
}
