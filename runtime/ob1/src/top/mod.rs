//! `ob1 top`: a running station, live (docs/top.md). A screen on a terminal, lines of text elsewhere.
//!
//! Everything is asked through the station's socket; its figures come from copies of the accounts, so that the scan
//! is not disturbed by readers. What is shown is a pure function of the answers ([`data`], [`plain`], [`screen`]), and
//! what keys do is too ([`keys`]).

mod data;
mod keys;
mod live;
mod plain;
mod screen;
mod source;
mod watch;

use std::io::{self, IsTerminal as _};

use clap::Args;
use ob1_time::Span;

use crate::exit::{Exit, told};
use ob1_station::access::client::AccessError;

/// Show a running station, live
///
/// Pages for the scan (times, histograms, late scans), the CPs (LEDs, orders, telegrams), the diagnostic buffer, a
/// variable table, in which values can be modified after a confirmation, the buses, the links, and the statements of a
/// block while they run. Without a terminal, or with
/// --plain, it prints text. It does not disturb the scan.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 top press.toml\n  ob1 top press --watch M1.0,DB10.DBW20:anzw,MW10:hex\n  ob1 top press --plain --count 1 \
    | less\n\nMore: docs/top.md."
)]
pub struct TopArgs {
    /// A running station: its name or its file
    pub station: String,
    /// The variable table: NAME, or NAME:hex, NAME:bin, NAME:anzw (the indicator word of a handling block, in words),
    /// NAME:status (STATUS of P_SND_RK and P_RCV_RK, in words)
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub watch: Vec<String>,
    /// Time between two looks
    #[arg(long, value_name = "TIME", default_value = "1s", value_parser = ob1_station_file::parse_duration)]
    pub every: Span,
    /// End after so many looks
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub count: Option<u64>,
    /// Text instead of a screen
    #[arg(long)]
    pub plain: bool,
}

/// Why `ob1 top` could not go on.
#[derive(Debug, thiserror::Error)]
enum TopError {
    #[error(transparent)]
    Access(#[from] AccessError),
    #[error("the terminal: {0}")]
    Terminal(#[from] io::Error),
}

/// Shows a station until `q`, the wanted count, or the station's end.
pub fn top(args: &TopArgs) -> Exit {
    let plain = args.plain || !io::stdout().is_terminal() || !io::stdin().is_terminal();
    let done = if plain { live::plain(args) } else { live::screen(args) };
    told(done.map(|()| Exit::Ok), |error| match error {
        TopError::Access(error) => error.exit(),
        TopError::Terminal(_) => Exit::System,
    })
}
