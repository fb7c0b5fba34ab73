//! `ob1 top`: a running station, live (docs/top.md). A screen on a terminal, lines of text elsewhere.
//!
//! Everything is asked through the station's socket; its figures come from copies of the accounts, so that the scan
//! does not notice who looks. What is shown is a pure function of the answers ([`data`], [`plain`], [`screen`]), and
//! what keys do is too ([`keys`]).

mod data;
mod keys;
mod live;
mod plain;
mod screen;
mod source;
mod watch;

use std::io::{self, IsTerminal as _};
use std::time::Duration;

use crate::exit::Exit;
use ob1_station::access::client::AccessError;

/// What the command line asks for.
#[derive(Clone, Debug)]
pub struct Options {
    /// A running station, by its name or its file.
    pub station: String,
    /// Text instead of a screen.
    pub plain: bool,
    /// Time between two looks.
    pub every: Duration,
    /// End after so many looks.
    pub count: Option<u64>,
    /// The variable table: `NAME` or `NAME:hex`, `:bin`, `:anzw`, `:status`.
    pub watch: Vec<String>,
}

/// Why it ended.
#[derive(Debug, thiserror::Error)]
enum TopError {
    #[error(transparent)]
    Access(#[from] AccessError),
    #[error("the terminal: {0}")]
    Terminal(#[from] io::Error),
}

/// Shows a station until `q`, the wanted count, or the station's end.
#[must_use]
pub fn top(options: &Options) -> Exit {
    let plain = options.plain || !io::stdout().is_terminal() || !io::stdin().is_terminal();
    let done = if plain { live::plain(options) } else { live::screen(options) };
    match done {
        Ok(()) => Exit::Ok,
        Err(error) => {
            err!("ob1: {error}");
            match error {
                TopError::Access(AccessError::NotRunning { .. }) => Exit::Running,
                TopError::Access(_) => Exit::Refused,
                TopError::Terminal(_) => Exit::System,
            }
        }
    }
}
