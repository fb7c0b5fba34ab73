//! Common parts of the tests with real processes: a folder for each test, stations that run there, partners, and waits
//! that end with the awaited event.
//!
//! Times are used only as a limit: a wait that has not ended after [`GUARD`] has failed, even on a busy machine. A
//! machine that stands still uses up nothing of it.

// Each test binary uses a part of it.
#![allow(dead_code)]

pub(crate) mod browser;
pub(crate) mod cp341;
pub(crate) mod diagnosis;
pub(crate) mod fleet;
pub(crate) mod gate;
pub(crate) mod kills;
pub(crate) mod ledger;
pub(crate) mod meters;
pub(crate) mod native;
pub(crate) mod pair;
pub(crate) mod peer;
pub(crate) mod processes;
pub(crate) mod s7;
pub(crate) mod s7_tests;
pub(crate) mod site;
pub(crate) mod station;
pub(crate) mod steps;
pub(crate) mod terminal;
pub(crate) mod wire;

use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::time::Instant;

use ob1_time::{Span, WatchedTime};

/// A wait fails after this time, which is much longer than needed on a busy machine.
const GUARD: Span = Span::from_secs(90);
/// How much of the time between two checks of a wait counts.
const GAP: Span = Span::SECOND;

/// The time limit of a wait.
pub(crate) struct Guard {
    begun: Instant,
    watched: Cell<WatchedTime>,
}

impl Guard {
    /// Starts a wait.
    pub(crate) fn begin() -> Self {
        Self { begun: Instant::now(), watched: Cell::new(WatchedTime::new(ob1_time::Instant::START, GAP)) }
    }

    /// Whether the wait has failed.
    pub(crate) fn is_over(&self) -> bool {
        let mut watched = self.watched.get();
        let time = watched.look(ob1_time::Instant::START + self.begun.elapsed().into());
        self.watched.set(watched);
        time.since_start() >= GUARD
    }
}

/// A path from `cargo xtask test`; without it a test does not know which binaries to use.
fn told(variable: &str) -> PathBuf {
    match std::env::var_os(variable) {
        Some(value) => PathBuf::from(value),
        None => panic!(
            "{variable} is not set: this test needs binaries that plain cargo does not build; run: cargo xtask test"
        ),
    }
}

/// A program of the project.
pub(crate) fn program(name: &str) -> PathBuf {
    let path = told("OB1_BIN_DIR").join(name);
    assert!(path.is_file(), "{} is not there; run: cargo xtask test", path.display());
    path
}

/// The folder of the plugins.
pub(crate) fn plugin_dir() -> PathBuf {
    told("OB1_PLUGIN_DIR")
}

/// The interpreter of the partners.
pub(crate) fn python() -> PathBuf {
    told("OB1_PYTHON")
}

/// A path in the checkout.
pub(crate) fn checkout(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}
