//! `ob1 force STATION E0.0=1`: values that stand against the program and the modules.

use clap::Args;
use ob1_station::access::client::{AccessError, Client};
use ob1_station::access::protocol::Op;

use crate::exit::Exit;
use crate::remote::{assigned, assignment};

/// Force cells of a running station, or show what is forced
///
/// As on the rack. Family 300: up to ten inputs and outputs of the process image, set after the inputs are read and
/// before the outputs are written; within its scan the program can overwrite them. Family 400: up to 256, bit memory
/// and peripheral cells, too; every read sees the value and no write has an effect. Forced values outlast commands,
/// STOP, restarts and power failures; --off or a memory reset ends them. Without a cell it shows what is forced.
#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 force press.toml E0.0=1 QW4=16#00FF\n  ob1 force press\n  ob1 force press --off\n\nExit codes: 0 done, \
    5 the station does not run, 8 refused.\n\nMore: docs/online.md."
)]
pub struct ForceArgs {
    /// A running station: its name or its file
    station: String,
    /// NAME=VALUE: I E Q A with bit, B, W, D; family 400: M, PI (PE), PQ (PA), too
    #[arg(value_name = "NAME=VALUE", value_parser = assignment)]
    items: Vec<(String, String)>,
    /// First end what is forced
    #[arg(long)]
    off: bool,
    /// What is forced then, as a JSON array
    #[arg(long)]
    json: bool,
}

/// Forces; prints what is forced then.
pub fn force(args: &ForceArgs) -> Result<Exit, AccessError> {
    let items = assigned(&args.items);
    let forced = Client::to_station(&args.station)?.ask(Op::Force { items, off: args.off })?.forced.unwrap_or_default();
    if args.json {
        say!("{}", serde_json::json!(forced));
    } else if forced.is_empty() {
        say!("nothing is forced");
    } else {
        forced.iter().for_each(|cell| say!("{cell}"));
    }
    Ok(Exit::Ok)
}
