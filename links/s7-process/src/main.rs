//! `ob1-s7`: the sockets of S7 communication. It serves panels, SCADA systems and programming devices on behalf of one
//! link of a station, and reaches the CPU only through the broker, whose socket is its standard input.

// All output goes through one place that neither panics nor waits forever.
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod busy_wait;
mod coupler;
mod entries;
mod server;
mod session;
mod slots;
mod sockets;
mod tap;

use std::os::fd::{AsFd, OwnedFd};
use std::process::ExitCode;

use clap::Parser;
use ob1_access::door::{Door, DoorError};
use ob1_backplane::{CpSide, Segment};
use ob1_process::{Confinement, Network};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use tracing::{error, info, warn};

use coupler::Coupler;
use server::Server;

/// How long to wait for the doorbell of a station that ends.
const FAREWELL: Timespec = Timespec { tv_sec: 2, tv_nsec: 0 };
/// Maximum data, in bytes: 128 connections, each with all it can hold.
const MEMORY: u64 = 256 << 20;
/// The link is restarted by itself, the runtime is not: when memory runs out, the link is killed first.
const OOM_SCORE: i16 = 500;

const HELP: &str = "\
The runtime starts it for each [[link]] with type = \"s7\". Standard input is the socket of the broker; everything else,
the listening sockets too, comes through it; of a CP 343 (--cp) standard input is its doorbell. SIGINT and SIGHUP are ignored (the runtime decides); SIGTERM ends it.

Exit codes:
  0  the station has closed the door, or SIGTERM
  1  the door cannot be used
  2  wrong arguments

Environment:
  OB1_LOG    what to log on standard error: error, warn, info (default), debug (connections), trace";

/// The S7 link of a station.
#[derive(Debug, Parser)]
#[command(name = "ob1-s7", version, after_help = HELP)]
struct Arguments {
    /// Name for the log.
    #[arg(long, default_value = "s7")]
    name: String,

    /// Be the Ethernet CP of a station too: standard input is the doorbell of the back plane, standard output hands
    /// over its segment and the door.
    #[arg(long)]
    cp: bool,

    /// Path of the segment, for people: it comes by standard output.
    #[arg(long, hide = true)]
    segment: Option<std::path::PathBuf>,
}

fn main() -> ExitCode {
    let exit = run(&Arguments::parse());
    ob1_process::log::flush(ob1_process::log::LAST_WORDS);
    exit
}

fn run(arguments: &Arguments) -> ExitCode {
    // Before anything is opened, and before there is a thread. Sockets to listen on come through the door.
    ob1_process::close_inherited();
    let refused = ob1_process::confine(&Confinement {
        network: if arguments.cp { Network::Address } else { Network::None },
        memory: MEMORY,
        oom_score: OOM_SCORE,
        ..Confinement::default()
    });
    ob1_process::start_log();
    // Of the highest level: a filter that lets only warnings through keeps the name before them.
    let _span = tracing::error_span!("s7", name = arguments.name).entered();
    refused.iter().for_each(|(what, why)| warn!("not confined, {what}: {why}"));

    let terminate = ob1_process::signals();
    let ends =
        if arguments.cp { back_plane() } else { Ok((rustix::stdio::stdin().as_fd().try_clone_to_owned(), None)) };
    let (door, coupler) = match ends {
        Ok(ends) => ends,
        Err(why) => {
            error!("the back plane: {why}");
            return ExitCode::from(1);
        }
    };
    let door = door.map_err(DoorError::from).and_then(Door::new);
    let served = door.and_then(|door| Server::new(door, terminate, coupler).run());
    if arguments.cp && matches!(served, Err(DoorError::Closed)) {
        // The station ends, and reports it by the doorbell next: a process that ended earlier would be restarted.
        let _ = poll(&mut [PollFd::from_borrowed_fd(rustix::stdio::stdin(), PollFlags::IN)], Some(&FAREWELL));
    }
    match served {
        Ok(()) => {
            info!("terminated");
            ExitCode::SUCCESS
        }
        Err(DoorError::Closed) => {
            info!("the station has closed the connection: end");
            ExitCode::SUCCESS
        }
        Err(error) => {
            error!("{error}");
            ExitCode::from(1)
        }
    }
}

/// The door and the back plane, handed over by the runtime.
fn back_plane() -> Result<(std::io::Result<OwnedFd>, Option<Coupler>), String> {
    let mut descriptors = ob1_process::handed_over().into_iter();
    let (Some(segment), Some(door)) = (descriptors.next(), descriptors.next()) else {
        return Err("the runtime has not handed over a segment and a door".into());
    };
    let side = Segment::received(segment).and_then(|segment| CpSide::attach(&segment));
    let side = side.map_err(|error| error.to_string())?;
    if !side.has_boxes() {
        return Err("the runtime has handed over the segment of a CP without boxes".into());
    }
    Ok((Ok(door), Some(Coupler::new(side))))
}
