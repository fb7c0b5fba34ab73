//! `cargo xtask ci` and `cargo xtask fmt`.

use std::process::Command;

use crate::cargo::{self, cargo};
use crate::failure::{Failure, Outcome};
use crate::shell;

/// `cargo xtask ci`: runs `.ci/run`, the only place where the steps are defined.
///
/// # Errors
/// If a step fails.
pub(crate) fn ci(args: &[String]) -> Outcome {
    none(args, "ci")?;
    shell::run(Command::new(cargo::root().join(".ci/run")).current_dir(cargo::root()))
}

/// `cargo xtask fmt`: formats the workspace.
///
/// # Errors
/// If rustfmt finds something it cannot parse.
pub(crate) fn fmt(args: &[String]) -> Outcome {
    none(args, "fmt")?;
    shell::run(&mut cargo(&["fmt", "--all"]))
}

fn none(args: &[String], verb: &str) -> Outcome {
    if args.is_empty() { Ok(()) } else { Err(Failure::Usage(format!("{verb} takes no arguments"))) }
}
