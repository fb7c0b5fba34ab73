//! `ob1 restart STATION`: a restart of the CPU, with its sources as they are now where their values are to be kept.

use clap::Args;
use ob1_model::Command;
use ob1_station::access::client::AccessError;

use crate::ctl;
use crate::exit::Exit;
use crate::load::{self, LoadArgs};

/// Restart the CPU of a running station: warm, cold, or with all values of its data blocks
///
/// A warm restart clears what is not retentive and runs OB 100; a cold one gives every data block its load values. With
/// --keep the sources are loaded as they are now, as ob1 load does it: it shows what differs and which values are lost,
/// and asks. Then the CPU makes a warm restart in which every data block keeps its values, also those that [retentive]
/// does not name.
#[derive(Clone, Debug, Args)]
#[command(after_help = "Examples:\n  ob1 restart press\n  ob1 restart press --cold\n  ob1 restart press --keep\n  \
    ob1 restart press --keep --yes\n\nExit codes: 0 the first scan has ended, 3 it fell back to STOP (told why), 5 the station does not run, 8 refused: by you or by the \
    sources.\n\nMore: docs/online.md.")]
pub struct RestartArgs {
    /// A running station: its name or its file
    station: String,
    /// A cold restart: OB 102 or OB 100, data blocks get their load values
    #[arg(long)]
    cold: bool,
    /// Load the sources as they are now, and keep the values of all data blocks
    #[arg(long, conflicts_with = "cold")]
    keep: bool,
    /// With --keep: do not ask
    #[arg(long, requires = "keep")]
    yes: bool,
}

/// Runs `ob1 restart`, and says how it ended.
pub fn restart(args: &RestartArgs) -> Result<Exit, AccessError> {
    let command = match (args.cold, args.keep) {
        (true, _) => Command::Cold,
        (_, true) => Command::Keep,
        _ => Command::Warm,
    };
    if args.keep {
        let load = LoadArgs { station: args.station.clone(), back: false, yes: args.yes, check: false, json: false };
        load::load(&load)?;
    }
    ctl::change(&args.station, command)
}
