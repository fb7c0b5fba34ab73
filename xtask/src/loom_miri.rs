//! The two searching runs over the back plane: loom (every order of its memory accesses) and Miri (undefined
//! behaviour).
//!
//! Each has a target directory of its own, because their flags would otherwise throw the usual artifacts away.

use crate::cargo::cargo;
use crate::failure::Outcome;
use crate::shell;
use crate::test::{count, is_closing_line, own_target};

/// The crate with the shared memory in it.
const CRATE: &str = "ob1-backplane";

/// Runs the loom model tests; returns the line for the summary.
pub(crate) fn loom() -> Outcome<String> {
    let mut command = cargo(&["test", "--package", CRATE, "--release", "--test", "loom"]);
    // Optimised: loom walks through many thousand interleavings.
    command.arg("--target-dir").arg(own_target("loom")?).env("RUSTFLAGS", "--cfg loom");
    count(&shell::watch(&mut command, is_closing_line)?, "loom")
}

/// Runs the back plane's tests under Miri where the component is installed; returns the line for the summary.
pub(crate) fn miri() -> Outcome<String> {
    if !shell::works(&mut cargo(&["miri", "--version"])) {
        return Ok("skipped (component not installed)".to_owned());
    }
    let mut command = cargo(&["miri", "test", "--package", CRATE, "--lib"]);
    command.arg("--target-dir").arg(own_target("miri")?);
    count(&shell::watch(&mut command, is_closing_line)?, "miri")
}
