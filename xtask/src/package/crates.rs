//! The crate that a plugin in Rust needs, as created by `cargo package`: it builds without this workspace.

use std::process::Command;

use super::stage::Stage;
use crate::cargo::{self, cargo};
use crate::failure::{Outcome, step};
use crate::shell;

/// `ob1 new plugin --language rust` looks for it.
const SDK: &str = "ob1-sdk";

/// Packs the crate, builds it from the archive with cargo, and unpacks it into `usr/share/ob1/crates`.
pub(super) fn into(stage: &mut Stage, version: &str) -> Outcome {
    shell::run(&mut cargo(&["package", "--allow-dirty", "--quiet", "--package", SDK]))?;
    let below = cargo::target_dir()?.join("dist/crates");
    let _ = std::fs::remove_dir_all(&below);
    std::fs::create_dir_all(&below).map_err(|why| step(format!("{}: {why}", below.display())))?;
    let file = cargo::target_dir()?.join("package").join(format!("{SDK}-{version}.crate"));
    shell::run(Command::new("tar").args(["--extract", "--gzip", "--directory"]).arg(&below).arg("--file").arg(file))?;
    let folder = below.join(format!("{SDK}-{version}"));
    // Files that only the registry and git need.
    for left_out in ["Cargo.toml.orig", "Cargo.lock", ".cargo_vcs_info.json", "tests", "clippy.toml"] {
        let path = folder.join(left_out);
        let _ = if path.is_dir() { std::fs::remove_dir_all(&path) } else { std::fs::remove_file(&path) };
    }
    stage.folder(&folder, &format!("usr/share/ob1/crates/{SDK}"))
}
