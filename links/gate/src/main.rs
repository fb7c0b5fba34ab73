//! `ob1-gate`: the links of a station for people and fleets. One process serves the web page, the metrics, OPC UA and
//! MQTT of one station; it is the only one with an async runtime, and it reaches the CPU only through the broker.

#![deny(clippy::print_stdout, clippy::print_stderr)]

mod http;
mod metrics;
mod mqtt;
mod opcua;
mod prepare;
mod serve;
mod shared;
mod user;
mod web;

use std::os::fd::AsFd as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::{Parser, Subcommand};
use ob1_access::door::DoorError;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;
use tracing::{error, info};

const HELP: &str = "\
The runtime starts it for the [[link]]s with type = \"web\", \"metrics\", \"opcua\" and \"mqtt\". Over its standard input come
the sockets of the broker; everything else comes through them. SIGINT and SIGHUP are ignored (the runtime decides).

Users of a link stand in a file of mode 0600:
  ob1-gate user add press.users anna --rights operate      asks for the password
  ob1-gate user list press.users
  ob1-gate user remove press.users anna

Exit codes:
  0  the station has closed the door, or SIGTERM
  1  the door, a file of users, a certificate or the audit log cannot be used
  2  wrong arguments

Environment:
  OB1_LOG    what to log on standard error: error, warn, info (default), debug (connections), trace";

/// The links of a station for people and fleets.
#[derive(Debug, Parser)]
#[command(name = "ob1-gate", version, after_help = HELP)]
struct Arguments {
    /// Name for the log.
    #[arg(long, default_value = "ob1-gate")]
    name: String,
    #[command(subcommand)]
    what: Option<What>,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Users of a link: adds, removes and lists them.
    User {
        #[command(subcommand)]
        what: UserCommand,
    },
}

/// What to do with a file of users.
#[derive(Debug, Subcommand)]
pub(crate) enum UserCommand {
    /// Adds a user, or gives one another password. The password comes from the terminal, or a line of standard input.
    Add {
        /// The file; made when it is not there.
        file: PathBuf,
        /// The name.
        name: String,
        /// read, write (values) or operate (operating state, clock).
        #[arg(long, default_value = "read")]
        rights: String,
    },
    /// Removes a user.
    Remove {
        /// The file.
        file: PathBuf,
        /// The name.
        name: String,
    },
    /// Lists users and their rights.
    List {
        /// The file.
        file: PathBuf,
    },
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let exit = match arguments.what {
        Some(What::User { what }) => user::run(&what),
        None => run(&arguments.name),
    };
    ob1_process::log::flush(ob1_process::log::LAST_WORDS);
    exit
}

/// What is meant for the station is for the runtime, which ends us by closing the doors: that leaves time for the last
/// words of a link. SIGTERM ends at once.
fn signals() {
    let ignored = Arc::new(AtomicBool::new(false));
    let registered = [
        (SIGINT, flag::register(SIGINT, Arc::clone(&ignored))),
        (SIGHUP, flag::register(SIGHUP, ignored)),
        (SIGTERM, flag::register_conditional_shutdown(SIGTERM, 0, Arc::new(AtomicBool::new(true)))),
    ];
    for (signal, outcome) in registered {
        if let Err(why) = outcome {
            error!("signal {signal}: {why}");
        }
    }
}

fn run(name: &str) -> ExitCode {
    // Before anything is opened, and before there is a thread.
    ob1_process::close_inherited();
    // The runtime has said what is wrong with OB1_LOG.
    let _ = ob1_process::log::subscribe("info", ob1_process::log::Lines::Sparing);
    // Of the highest level: a filter that lets only warnings through keeps the name before them.
    let _span = tracing::error_span!("gate", name).entered();
    signals();
    let input = rustix::stdio::stdin().as_fd().try_clone_to_owned().map_err(DoorError::from);
    let prepared = input.and_then(|input| prepare::doors(&input)).map_err(|error| match error {
        DoorError::Closed => String::new(),
        other => other.to_string(),
    });
    // Needed files are opened first; then the process confines itself, still without a thread.
    let served = prepared.and_then(prepare::links).and_then(|(links, memory)| {
        let _ = ob1_process::log::start();
        ob1_process::log::tell_panics();
        serve::run(links, memory)
    });
    match served {
        Ok(()) => {
            info!("the station has closed the connection: end");
            ExitCode::SUCCESS
        }
        Err(why) if why.is_empty() => ExitCode::SUCCESS,
        Err(why) => {
            error!("{why}");
            ExitCode::from(1)
        }
    }
}
