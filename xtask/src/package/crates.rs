//! The crates that a plugin in Rust needs, as created by `cargo package`: they build without this workspace.

use std::path::PathBuf;
use std::process::Command;

use super::stage::Stage;
use crate::cargo::{self, cargo};
use crate::failure::{Outcome, step};
use crate::shell;

/// The sdk and its dependency. `ob1 new plugin --language rust` looks for the first one.
const CRATES: [&str; 2] = ["ob1-sdk", "ob1-abi"];

/// Packs the crates, builds them from the archives with cargo, and unpacks them into `usr/share/ob1/crates`.
pub(super) fn into(stage: &mut Stage, version: &str) -> Outcome {
    let packed = pack()?;
    let below = cargo::target_dir()?.join("dist/crates");
    let _ = std::fs::remove_dir_all(&below);
    std::fs::create_dir_all(&below).map_err(|why| step(format!("{}: {why}", below.display())))?;
    for name in CRATES {
        let file = packed.join(format!("{name}-{version}.crate"));
        shell::run(
            Command::new("tar").args(["--extract", "--gzip", "--directory"]).arg(&below).arg("--file").arg(file),
        )?;
        let folder = below.join(format!("{name}-{version}"));
        // Files that only the registry and git need.
        for left_out in ["Cargo.toml.orig", "Cargo.lock", ".cargo_vcs_info.json", "tests", "clippy.toml"] {
            let path = folder.join(left_out);
            let _ = if path.is_dir() { std::fs::remove_dir_all(&path) } else { std::fs::remove_file(&path) };
        }
        let to = format!("usr/share/ob1/crates/{name}");
        stage.folder(&folder, &to)?;
        let manifest = folder.join("Cargo.toml");
        let text = std::fs::read_to_string(&manifest).map_err(|why| step(format!("{}: {why}", manifest.display())))?;
        stage.put(&format!("{to}/Cargo.toml"), side_by_side(&text).as_bytes(), 0o644)?;
    }
    Ok(())
}

/// `cargo package` of both: cargo builds each from its archive only. Returns the folder of the archives.
fn pack() -> Outcome<PathBuf> {
    let mut command = cargo(&["package", "--allow-dirty", "--quiet"]);
    command.args(CRATES.iter().flat_map(|name| ["-p", name]));
    shell::run(&mut command)?;
    Ok(cargo::target_dir()?.join("package"))
}

/// The manifest with the paths of our crates, which are in neighbouring folders.
fn side_by_side(manifest: &str) -> String {
    let mut text = String::with_capacity(manifest.len());
    for line in manifest.lines() {
        text.push_str(line);
        text.push('\n');
        let ours = line.strip_prefix("[dependencies.").and_then(|rest| rest.strip_suffix(']'));
        if let Some(name) = ours.filter(|name| CRATES.contains(name)) {
            text.push_str(&format!("path = \"../{name}\"\n"));
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::side_by_side;

    #[test]
    fn only_our_crates_get_a_path() {
        let manifest =
            "[package]\nname = \"ob1-sdk\"\n\n[dependencies.ob1-abi]\nversion = \"0.1.0\"\n\n[dependencies.libc]\n";
        let expected = "[package]\nname = \"ob1-sdk\"\n\n[dependencies.ob1-abi]\npath = \"../ob1-abi\"\nversion = \"0.1.0\"\n\n\
            [dependencies.libc]\n";
        assert_eq!(side_by_side(manifest), expected);
    }
}
