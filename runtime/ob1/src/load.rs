//! `ob1 load STATION`: the program follows its sources while the CPU stays in RUN, or goes back to the version before.

use std::io;

use clap::Args;
use ob1_station::access::client::{AccessError, Client};
use ob1_station::access::protocol::Op;
use ob1_station::download::{LoadOrder, LoadStatus};
use ob1_stl::Library;

use crate::ctl::{agrees, answer};
use crate::diff;
use crate::exit::Exit;

/// Load the sources of a running station as they are now, without a STOP
///
/// The station compiles its sources, and shows what differs from the program that runs and which values of data blocks
/// would be lost. After a yes the new program takes over whole, between two scans; the CPU stays in RUN. Data blocks
/// keep each component that has the same name and type, wherever it lies; start values are for the next cold restart.
/// Blocks that were downloaded give way to the sources. The station file itself (modules, links, sizes, plugins) is
/// read at a start only.
#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 load press.toml --check\n  ob1 load press.toml\n  ob1 load press --yes --json\n  \
    ob1 load press --back\n\nExit codes: 0 loaded (--check: there is a difference), 1 nothing to load, 5 the station \
    does not run,\n8 refused: by you, by the sources (told with their errors), or because program status watches a \
    block that changes.\n\nMore: docs/online.md."
)]
pub struct LoadArgs {
    /// A running station: its name or its file
    pub(crate) station: String,
    /// The program before the last change, of ob1 load or of a download
    #[arg(long)]
    pub(crate) back: bool,
    /// Do not ask
    #[arg(long)]
    pub(crate) yes: bool,
    /// Only show what would change
    #[arg(long, conflicts_with = "yes")]
    pub(crate) check: bool,
    /// As JSON: loaded, changed [{block, what}], lost; takes --yes or --check
    #[arg(long)]
    pub(crate) json: bool,
}

fn ask(client: &mut Client, order: LoadOrder) -> Result<LoadStatus, AccessError> {
    let told = client.ask(Op::Load(order))?.load;
    told.map(|told| *told).ok_or_else(|| AccessError::Refused("the station cannot load".to_owned()))
}

fn refused(why: &str) -> AccessError {
    AccessError::Refused(why.to_owned())
}

/// Loads; prints what there is to print.
pub fn load(args: &LoadArgs) -> Result<Exit, AccessError> {
    if args.json && !args.yes && !args.check {
        return Err(refused("--json does not ask: add --yes or --check"));
    }
    let mut client = Client::to_station(&args.station)?;
    let order = LoadOrder { back: args.back, check: true, texts: !args.json, ..LoadOrder::default() };
    let told = ask(&mut client, order)?;
    let nothing = told.changed.is_empty();
    if args.json && (args.check || nothing) {
        say!("{}", serde_json::to_string(&told).map_err(io::Error::from)?);
    } else if !args.json {
        show(args, &told)?;
    }
    if nothing || args.check {
        return Ok(if nothing { Exit::Usage } else { Exit::Ok });
    }
    if !args.yes && !is_wanted()? {
        return Err(refused("nothing was loaded"));
    }
    let order = LoadOrder { back: args.back, expect: Some(told.fingerprint), ..LoadOrder::default() };
    let done = ask(&mut client, order)?;
    if args.json {
        say!("{}", serde_json::to_string(&done).map_err(io::Error::from)?);
    } else {
        say!("loaded");
        if let Some(why) = done.not_kept {
            say!("  = the next start takes the sources as they are: {why}");
        }
    }
    Ok(Exit::Ok)
}

fn show(args: &LoadArgs, told: &LoadStatus) -> Result<(), AccessError> {
    if told.changed.is_empty() {
        say!("nothing to load: the station runs what {} say", if args.back { "it ran before" } else { "its sources" });
        return Ok(());
    }
    if let Some([now, next, library]) = &told.texts {
        let read = |text: &str| ob1_ir::parse(text).map_err(|error| refused(&error.to_string()));
        let mut blocks = Library::new();
        for block in read(library)?.blocks {
            blocks.insert(block.id, block.name.as_deref().unwrap_or_default(), block.interface);
        }
        let after = if args.back { "the version before" } else { "its sources" };
        diff::show_between((read(now)?, read(next)?), &blocks, ["the program that runs", after]);
    }
    if !told.lost.is_empty() {
        say!("values that are lost:");
        told.lost.iter().for_each(|lost| say!("  {lost}"));
    }
    Ok(())
}

/// The answer of whoever sits there.
fn is_wanted() -> Result<bool, AccessError> {
    let given = answer("load it (y/n)?");
    let given =
        given.ok_or_else(|| refused("nobody is there to ask\n  = --yes loads without asking, --check only shows"))?;
    Ok(agrees(&given))
}
