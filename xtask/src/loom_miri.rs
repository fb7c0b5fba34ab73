//! Runs loom for the back plane (every order of its memory accesses) and Miri for the crates with unsafe code
//! (undefined behaviour).
//!
//! Each has a target directory of its own, because their flags would otherwise invalidate the usual artifacts.

use std::process::Command;

use crate::cargo::{self, cargo, own_target};
use crate::failure::{Failure, Outcome, step};
use crate::shell;
use crate::tally::{count, is_closing_line};

/// The crate with the shared memory.
const CRATE: &str = "ob1-backplane";

/// The crates with unsafe code that Miri can run. It cannot run system calls, shared memory, loaded libraries and
/// machine code of our own: `ob1-rt`, `ob1-line`, `ob1-host` and `ob1-native`.
const MIRI_CRATES: &[&str] = &[CRATE, "ob1-sdk", "ob1-arena"];

/// Runs the loom model tests; returns the line for the summary.
pub(crate) fn loom() -> Outcome<String> {
    let mut command = cargo(&["test", "--package", CRATE, "--release", "--test", "loom"]);
    // Optimised, because loom checks many thousand interleavings.
    command.arg("--target-dir").arg(own_target("loom")?).env("RUSTFLAGS", "--cfg loom");
    count(&shell::watch(&mut command, is_closing_line)?, "loom")
}

/// `cargo xtask miri`: the unit tests of the crates with unsafe code under Miri. It needs a nightly toolchain with this
/// component, so it is not part of the tests.
///
/// # Errors
/// If the component is missing, or a test fails.
pub(crate) fn miri(args: &[String]) -> Outcome {
    if !args.is_empty() {
        return Err(Failure::Usage("miri takes no arguments".into()));
    }
    if !shell::works(&mut nightly(&["miri", "--version"])) {
        return Err(step("Miri is not here: rustup toolchain install nightly --component miri --component rust-src"));
    }
    let mut command = nightly(&["miri", "test", "--no-fail-fast", "--lib"]);
    command.args(MIRI_CRATES.iter().flat_map(|name| ["--package", name]));
    command.arg("--target-dir").arg(own_target("miri")?);
    let closing = shell::watch(&mut command, is_closing_line)?;
    println!("miri: {}", count(&closing, "miri")?);
    Ok(())
}

/// `cargo ARGS` of the nightly toolchain, in the checkout.
fn nightly(args: &[&str]) -> Command {
    let mut command = Command::new("rustup");
    command.args(["run", "nightly", "cargo"]).args(args).env_remove("CARGO").current_dir(cargo::root());
    command
}
