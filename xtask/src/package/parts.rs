//! The parts of the workspace that are packed. cargo lists them, so new programs and plugins are included
//! automatically.

use serde_json::Value;

use crate::cargo::{self, list};
use crate::failure::{Outcome, step};

/// Folders of the workspace whose programs a user runs.
const PROGRAMS: [&str; 3] = ["runtime/", "driver/", "links/"];
/// The folder whose libraries are plugins.
const PLUGINS: &str = "plugins/";

/// A program of the workspace that is packed.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Program {
    pub(super) name: String,
    package: String,
    /// The description of its package.
    pub(super) about: String,
}

/// Programs and plugins, sorted.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Parts {
    pub(super) version: String,
    pub(super) programs: Vec<Program>,
    /// File names of the plugins: `libob1_cp240.so`.
    pub(super) plugins: Vec<String>,
    packages: Vec<String>,
}

impl Parts {
    pub(super) fn of_workspace() -> Outcome<Self> {
        let root = cargo::root().to_string_lossy().into_owned();
        let parts = Self::of(&cargo::members()?, &root);
        if parts.programs.iter().any(|program| program.name == "ob1") && !parts.plugins.is_empty() {
            return Ok(parts);
        }
        Err(step("the workspace has no ob1 or no plugins; are the folders in xtask/src/package/parts.rs right?"))
    }

    fn of(metadata: &Value, root: &str) -> Self {
        let mut parts =
            Self { version: String::new(), programs: Vec::new(), plugins: Vec::new(), packages: Vec::new() };
        for package in list(&metadata["packages"]) {
            let text = |key: &str| package[key].as_str().unwrap_or_default().to_owned();
            let manifest = text("manifest_path");
            let place = manifest.strip_prefix(root).unwrap_or_default().trim_start_matches('/');
            let before = parts.programs.len() + parts.plugins.len();
            for target in list(&package["targets"]) {
                let name = target["name"].as_str().unwrap_or_default();
                let is = |kind: &str| list(&target["kind"]).iter().any(|is| is == kind);
                if is("bin") && PROGRAMS.iter().any(|folder| place.starts_with(folder)) {
                    let about = text("description");
                    parts.programs.push(Program { name: name.to_owned(), package: text("name"), about });
                }
                if is("cdylib") && place.starts_with(PLUGINS) {
                    parts.plugins.push(format!("lib{}.so", name.replace('-', "_")));
                }
            }
            if parts.programs.len() + parts.plugins.len() > before {
                parts.packages.push(text("name"));
            }
            if text("name") == "ob1" {
                parts.version = text("version");
            }
        }
        parts.programs.sort_by(|a, b| a.name.cmp(&b.name));
        parts.plugins.sort();
        parts.packages.sort();
        parts
    }

    /// `-p NAME` for all packages.
    pub(super) fn flags(&self) -> impl Iterator<Item = &str> {
        self.packages.iter().flat_map(|name| ["-p", name.as_str()])
    }

    /// `-p NAME` for the package of `ob1`.
    pub(super) fn command(&self) -> [&str; 2] {
        let ob1 = self.programs.iter().find(|program| program.name == "ob1");
        ["-p", ob1.map_or("ob1", |program| program.package.as_str())]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn programs_and_plugins_are_found_by_their_folders() {
        let package = |name: &str, folder: &str, kind: &str| {
            json!({ "name": name, "version": "1.2.3", "description": "what it is", "manifest_path":
                format!("/src/{folder}/Cargo.toml"), "targets": [{ "name": name, "kind": [kind] }] })
        };
        let metadata = json!({ "packages": [
            package("ob1", "runtime/ob1", "bin"),
            package("ob1-gate", "links/gate", "bin"),
            package("ob1-model", "blocks/model", "lib"),
            package("ob1-cp240", "plugins/cp240", "cdylib"),
            package("ob1-sdk", "plugins/sdk", "lib"),
            package("example", "examples/rust-ob1", "cdylib"),
            package("xtask", "xtask", "bin"),
        ] });
        let parts = Parts::of(&metadata, "/src");
        let names: Vec<&str> = parts.programs.iter().map(|program| program.name.as_str()).collect();
        assert_eq!(
            (names.as_slice(), parts.plugins.as_slice()),
            (&["ob1", "ob1-gate"][..], &["libob1_cp240.so".into()][..])
        );
        assert_eq!(parts.flags().collect::<Vec<_>>(), ["-p", "ob1", "-p", "ob1-cp240", "-p", "ob1-gate"]);
        assert_eq!((parts.version.as_str(), parts.command()), ("1.2.3", ["-p", "ob1"]));
    }

    #[test]
    fn this_workspace_has_its_processes_and_handling_blocks() {
        let parts = Parts::of_workspace().expect("cargo answers");
        for name in ["ob1", "ob1-cp", "ob1-io", "ob1-s7"] {
            assert!(parts.programs.iter().any(|program| program.name == name && !program.about.is_empty()), "{name}");
        }
        for name in ["libob1_cp240.so", "libob1_cp040.so", "libob1_cp340.so", "libob1_cp341.so"] {
            assert!(parts.plugins.iter().any(|plugin| plugin == name), "{name}");
        }
    }
}
