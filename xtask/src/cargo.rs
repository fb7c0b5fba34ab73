//! Calls cargo: where the checkout is, where artifacts are, which crate depends on which.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use crate::failure::{Outcome, step};
use crate::shell;

/// Root of the checkout: the folder above this crate.
pub(crate) fn root() -> &'static Path {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.parent().unwrap_or(here)
}

/// `cargo ARGS`, in the checkout. The variables that `cargo run` has set for xtask are removed: otherwise build scripts
/// that read them would build again each time.
pub(crate) fn cargo(args: &[&str]) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    for (key, _) in std::env::vars_os() {
        let name = key.to_string_lossy();
        if name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_") || name == "CARGO_PRIMARY_PACKAGE" {
            command.env_remove(&key);
        }
    }
    command.args(args).current_dir(root());
    command
}

/// The complete `cargo metadata`: packages and the graph resolved for this machine (crates for other systems are not
/// downloaded).
pub(crate) fn metadata() -> Outcome<Value> {
    let version = shell::read(Command::new("rustc").arg("-vV").current_dir(root()))?;
    let host =
        version.lines().find_map(|line| line.strip_prefix("host: ")).ok_or_else(|| step("rustc names no host"))?;
    ask(&["--filter-platform", host])
}

/// `cargo metadata` of the members, without their dependencies.
pub(crate) fn members() -> Outcome<Value> {
    ask(&["--no-deps"])
}

fn ask(flags: &[&str]) -> Outcome<Value> {
    let text = shell::read(cargo(&["metadata", "--quiet", "--format-version", "1"]).args(flags))?;
    serde_json::from_str(&text).map_err(|why| step(format!("cargo metadata: {why}")))
}

/// The folder that contains `debug` and `release`.
pub(crate) fn target_dir() -> Outcome<PathBuf> {
    let text = shell::read(&mut cargo(&["metadata", "--format-version", "1", "--no-deps"]))?;
    let metadata: Value = serde_json::from_str(&text).map_err(|why| step(format!("cargo metadata: {why}")))?;
    let folder =
        metadata["target_directory"].as_str().ok_or_else(|| step("cargo metadata names no target directory"))?;
    Ok(PathBuf::from(folder))
}

/// A target directory of its own, for what would invalidate the usual artifacts.
pub(crate) fn own_target(name: &str) -> Outcome<PathBuf> {
    Ok(target_dir()?.join(name))
}

/// Builds everything that the tests need. Cargo chooses the features of a dependency by all packages of a command: any
/// other choice of packages would build the large ones once more.
pub(crate) const TESTS: &[&str] = &["build", "--workspace", "--all-targets"];

/// The build profile: its folder below the target directory, and its flag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Profile {
    Debug,
    /// Builds quickly, and is fast enough for the demo.
    Demo,
    Release,
}

impl Profile {
    /// The folder of its artifacts.
    pub(crate) fn folder(self) -> Outcome<PathBuf> {
        Ok(target_dir()?.join(match self {
            Self::Debug => "debug",
            Self::Demo => "demo",
            Self::Release => "release",
        }))
    }

    /// The flags for cargo.
    pub(crate) fn flags(self) -> &'static [&'static str] {
        match self {
            Self::Debug => &[],
            Self::Demo => &["--profile", "demo"],
            Self::Release => &["--release"],
        }
    }
}

/// The elements of a JSON array; empty for anything else.
pub(crate) fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}
