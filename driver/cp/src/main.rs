//! `ob1-cp`: one process is one CP 240. It attaches to a segment, takes parameters and line from it, and ends with its
//! standard input.

// Everything goes through one place that neither panics nor waits for ever.
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod config;
mod fence;
mod hub;
mod port;
mod process;
mod tap;

use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use clap::Parser;
use ob1_backplane::{CpSide, Segment, handover};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use tracing::{error, info, warn};
use tracing_subscriber::EnvFilter;

use process::{End, Process};

/// How long what is still to be logged may hold up the end.
const LAST_WORDS: Duration = Duration::from_millis(200);

const HELP: &str = "\
The line and the module type come with the parameters through the segment; the runtime writes them.
Standard input is the doorbell: a byte says that the output registers have changed, end of file ends the driver.
SIGINT and SIGHUP are ignored (the runtime decides); SIGTERM ends the driver in order.

Exit codes:
  0  end of file on standard input, or SIGTERM
  1  the segment cannot be opened or is none
  2  wrong arguments
  3  waiting failed (standard input is unusable)

The runtime hands the segment over by a socket as standard output (SCM_RIGHTS); --segment is for those it does not.

Environment:
  OB1_LOG    what to log on standard error: error, warn, info (default), debug (telegrams), trace (bytes)
  OB1_FENCE  what the driver may do, as JSON (docs/security.md); without it all its user may";

/// The driver of a CP 240.
#[derive(Debug, Parser)]
#[command(name = "ob1-cp", version, after_help = HELP)]
struct Arguments {
    /// The segment of the back plane, for instance /proc/PID/fd/N.
    #[arg(long, value_name = "PATH", required_unless_present = "self_test")]
    segment: Option<PathBuf>,

    /// Try what is forbidden behind the fence (OB1_FENCE), and say what was refused.
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
    ob1_log::flush(LAST_WORDS);
    exit
}

fn run(arguments: &Arguments) -> ExitCode {
    // Before anything is opened, and before there is a thread.
    let fenced = fence::raise();
    // Without the thread the log is written at once: a driver with a log that can make it wait is better than none.
    let _ = ob1_log::start();
    ob1_log::tell_panics();
    let filter = EnvFilter::try_from_env("OB1_LOG").unwrap_or_else(|_| EnvFilter::new("info"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(|| ob1_log::Log)
        .with_ansi(ob1_log::is_terminal())
        .with_target(false)
        .init();
    let _span = tracing::info_span!("cp", name = arguments.name).entered();

    match fenced {
        Ok(refused) => refused.iter().for_each(|(what, why)| warn!("not confined, {what}: {why}")),
        Err(why) => {
            error!("{why}");
            return ExitCode::from(2);
        }
    }
    if arguments.self_test {
        return ExitCode::from(u8::from(!fence::self_test()));
    }

    // Ctrl-C on a terminal reaches the whole group; the runtime is asked, and it ends us by closing standard input.
    let ignored = Arc::new(AtomicBool::new(false));
    let terminate = Arc::new(AtomicBool::new(false));
    for (signal, flag) in [(SIGINT, &ignored), (SIGHUP, &ignored), (SIGTERM, &terminate)] {
        if let Err(error) = signal_hook::flag::register(signal, Arc::clone(flag)) {
            error!("signal {signal}: {error}");
        }
    }

    let path = arguments.segment.as_deref().unwrap_or(Path::new(""));
    let segment = match handed_over().map_or_else(|| Segment::open(path), Segment::received) {
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
        Ok(End::Closed) => {
            info!("standard input is closed: end");
            ExitCode::SUCCESS
        }
        Ok(End::Terminated) => {
            info!("terminated");
            ExitCode::SUCCESS
        }
        Err(error) => {
            error!("waiting failed: {error}");
            ExitCode::from(3)
        }
    }
}

/// The segment's descriptor, where the runtime has put it: into a socket that is our standard output.
fn handed_over() -> Option<OwnedFd> {
    let (_, descriptors) = handover::receive(rustix::stdio::stdout(), &mut [0]).ok()??;
    descriptors.into_iter().next()
}
