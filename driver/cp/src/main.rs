//! `ob1-cp`: one process is one CP 240. It attaches to a segment, takes parameters and line from it, and ends with its
//! standard input.

// All output goes through one place that neither panics nor waits forever.
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod config;
mod hub;
mod process;
mod process_line;
mod tap;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use ob1_backplane::{CpSide, Segment};
use ob1_process::from_runtime;
use tracing::{error, info};

use process::{Ended, Process};

const HELP: &str = "\
The line and the module type come with the parameters through the segment; the runtime writes them.
Standard input is the doorbell: a byte says that the output registers have changed, end of file ends the driver.
SIGINT and SIGHUP are ignored (the runtime decides); SIGTERM ends the driver in order.

Exit codes:
  0  end of file on standard input, or SIGTERM
  1  the segment cannot be opened, or is not a segment
  2  wrong arguments
  3  waiting failed (standard input is unusable)

The runtime passes the segment over a socket, which is the standard output (SCM_RIGHTS). --segment is for a driver that
is started by hand.

Environment:
  OB1_LOG    what to log on standard error: error, warn, info (default), debug (telegrams), trace (bytes)
  OB1_FENCE  what the driver may do, as JSON (docs/security.md); without it everything that its user may do";

/// The driver of a communication processor: CP 240, CP 040, CP 340 or CP 341.
#[derive(Debug, Parser)]
#[command(name = "ob1-cp", version, after_help = HELP)]
struct Arguments {
    /// The segment of the back plane, for instance /proc/PID/fd/N.
    #[arg(long, value_name = "PATH", required_unless_present = "self_test")]
    segment: Option<PathBuf>,

    /// Try every operation that the fence (OB1_FENCE) forbids, and list those that were refused.
    #[arg(long = "selftest", id = "self_test", hide = true)]
    self_test: bool,

    /// Be a simulated line instead of a CP; the runtime writes this JSON text (docs/driver.md).
    #[arg(long, value_name = "JSON", value_parser = hub::HubConfig::parse)]
    hub: Option<hub::HubConfig>,

    /// Name for the log.
    #[arg(long, default_value = "cp")]
    name: String,

    /// Microseconds to watch the registers after a change before sleeping; 0 to 1000.
    #[arg(long, value_name = "US", default_value_t = 5, value_parser = clap::value_parser!(u64).range(0..=1000))]
    spin: u64,
}

fn main() -> ExitCode {
    let exit = run(&Arguments::parse());
    ob1_process::log::flush(ob1_process::log::LAST_WORDS);
    exit
}

fn run(arguments: &Arguments) -> ExitCode {
    // Before anything is opened, and before there is a thread.
    let fenced = from_runtime::confine();
    ob1_process::start_log();
    // Of the highest level: a filter that lets only warnings through keeps the name before them.
    let _span = tracing::error_span!("cp", name = arguments.name).entered();

    if !from_runtime::tell(&fenced) {
        return ExitCode::from(2);
    }
    if arguments.self_test {
        return ExitCode::from(u8::from(!from_runtime::self_test()));
    }

    let terminate = ob1_process::signals();
    let path = arguments.segment.as_deref().unwrap_or(Path::new(""));
    let segment =
        match ob1_process::handed_over().into_iter().next().map_or_else(|| Segment::open(path), Segment::received) {
            Ok(segment) => CpSide::attach(&segment),
            Err(error) => Err(error),
        };
    let segment = match segment {
        Ok(segment) => segment,
        Err(error) => {
            error!("{}: {error}", path.display());
            return ExitCode::from(1);
        }
    };
    info!(generation = segment.generation(), "attached");

    let ended = match &arguments.hub {
        Some(config) => hub::run(config, segment, &terminate),
        None => Process::new(segment, Duration::from_micros(arguments.spin), terminate).run().map_err(Into::into),
    };
    match ended {
        Ok(Ended::Closed) => {
            info!("standard input is closed: end");
            ExitCode::SUCCESS
        }
        Ok(Ended::Terminated) => {
            info!("terminated");
            ExitCode::SUCCESS
        }
        Err(error) => {
            error!("waiting failed: {error}");
            ExitCode::from(3)
        }
    }
}
