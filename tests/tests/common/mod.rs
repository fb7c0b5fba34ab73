//! What the tests with real processes have in common: a place of its own for each, stations that run there, partners,
//! and waits that end when the thing itself has happened.
//!
//! Time appears here as a guard only: a wait that is not over after [`GUARD`] has failed, however busy the machine.

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
pub(crate) mod site;
pub(crate) mod station;
pub(crate) mod steps;
pub(crate) mod terminal;
pub(crate) mod wire;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// After this a wait has failed. Far beyond anything a test needs on a busy machine.
const GUARD: Duration = Duration::from_secs(90);

/// Ends a wait that has failed.
pub(crate) struct Guard(Instant);

impl Guard {
    /// Begins to wait.
    pub(crate) fn begin() -> Self {
        Self(Instant::now() + GUARD)
    }

    /// The wait has failed.
    pub(crate) fn is_over(&self) -> bool {
        Instant::now() >= self.0
    }
}

/// What `cargo xtask test` says about the surroundings; without it a test cannot know which binaries are meant.
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

/// Where the plugins are.
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
