//! The environment of the foreign partners: a virtual environment in the checkout with pinned packages, and in addition
//! the packages that cannot be part of it.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::failure::{Outcome, step};
use crate::{cargo, needs, shell};

/// The packages for the partners with all dependencies and hashes (generated from `requirements.in`).
const REQUIREMENTS: &str = "tests/peers/requirements.txt";
/// Packages in a separate folder, because the environment has another version of them.
const NATIVE: &str = "tests/peers/requirements-native.txt";
/// Packages for Node.js with all dependencies and hashes.
const NODE: [&str; 2] = ["tests/peers/package.json", "tests/peers/package-lock.json"];
/// Copy of the requirements for which the environment was created; if they differ, the environment is created again.
const STAMP: &str = "ob1-requirements.txt";

/// The interpreter of `.venv`, which is created if it is missing or was created for other requirements.
///
/// # Errors
/// If Python, its `venv` module or a package is not available: the partners are part of the tests, so the run fails.
pub(crate) fn interpreter() -> Outcome<PathBuf> {
    let root = cargo::root();
    let venv = root.join(".venv");
    let python = venv.join("bin/python");
    let mut wanted = String::new();
    for path in [REQUIREMENTS, NATIVE].into_iter().chain(NODE) {
        wanted += &fs::read_to_string(root.join(path)).map_err(|why| step(format!("{path}: {why}")))?;
    }
    if fs::read_to_string(venv.join(STAMP)).is_ok_and(|made_for| made_for == wanted) && runs(&python) {
        return Ok(python);
    }
    needs::satisfy(&[needs::PYTHON, needs::NODE])?;
    shell::run(Command::new("python3").args(["-m", "venv", "--clear"]).arg(&venv))?;
    // A package with another hash has not been tested.
    let pip = || {
        let mut pip = Command::new(&python);
        pip.args(["-m", "pip", "install", "--disable-pip-version-check", "--quiet", "--require-hashes"]);
        pip
    };
    shell::run(pip().arg("-r").arg(root.join(REQUIREMENTS)))?;
    shell::run(pip().arg("--target").arg(native()).arg("-r").arg(root.join(NATIVE)))?;
    let node = venv.join("node");
    fs::create_dir_all(&node).map_err(|why| step(format!("{}: {why}", node.display())))?;
    for path in NODE {
        let from = root.join(path);
        let to = node.join(from.file_name().unwrap_or_default());
        fs::copy(from, to).map_err(|why| step(format!("{path}: {why}")))?;
    }
    // Only from the lock file, and without install scripts.
    let mut npm = Command::new("npm");
    npm.args(["ci", "--ignore-scripts", "--no-audit", "--no-fund", "--loglevel=error"]);
    shell::run(npm.current_dir(&node))?;
    fs::write(venv.join(STAMP), wanted).map_err(|why| step(format!(".venv/{STAMP}: {why}")))?;
    Ok(python)
}

/// The folder of the packages that have another version in the environment.
pub(crate) fn native() -> PathBuf {
    cargo::root().join(".venv/native")
}

/// The folder of the packages for Node.js.
pub(crate) fn node_modules() -> PathBuf {
    cargo::root().join(".venv/node/node_modules")
}

fn runs(python: &Path) -> bool {
    shell::works(Command::new(python).args(["-c", "import sys; sys.exit(sys.version_info < (3, 11))"]))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::{NATIVE, NODE, REQUIREMENTS};
    use crate::cargo;

    fn text(path: &str) -> String {
        std::fs::read_to_string(cargo::root().join(path)).expect("a file of the checkout")
    }

    /// `name==version` at the beginning of a line.
    fn pins(text: &str) -> BTreeMap<String, &str> {
        let pins = text.lines().filter(|line| !line.starts_with([' ', '#'])).filter_map(|line| line.split_once("=="));
        pins.filter_map(|(name, rest)| Some((name.to_lowercase(), rest.split_whitespace().next()?))).collect()
    }

    #[test]
    fn what_python_gets_is_what_was_asked_for_and_has_hashes() {
        for path in [REQUIREMENTS, NATIVE] {
            let (wanted, locked) = (text(&path.replace(".txt", ".in")), text(path));
            let locked_pins = pins(&locked);
            assert!(!pins(&wanted).is_empty());
            for (name, version) in pins(&wanted) {
                assert_eq!(locked_pins.get(&name), Some(&version), "{path}: {name} is not as in the .in file");
            }
            for package in locked.split("\n").filter(|line| line.contains("==")) {
                assert!(package.ends_with('\\'), "{path}: {package} has no hash");
            }
            assert!(!locked.contains("://"), "{path} says where its packages come from");
        }
    }

    #[test]
    fn what_node_gets_is_what_was_asked_for_and_has_hashes() {
        let [wanted, locked] = NODE.map(|path| serde_json::from_str::<serde_json::Value>(&text(path)).expect("JSON"));
        let packages = locked["packages"].as_object().expect("packages");
        assert_eq!(packages[""]["dependencies"], wanted["dependencies"]);
        for (name, package) in packages.iter().filter(|(name, _)| !name.is_empty()) {
            assert!(package["integrity"].as_str().is_some_and(|hash| hash.starts_with("sha512-")), "{name}");
            assert!(package["resolved"].is_null(), "{name} says where it comes from");
        }
        for (name, version) in wanted["dependencies"].as_object().expect("packages") {
            assert_eq!(&packages[&format!("node_modules/{name}")]["version"], version, "{name}");
        }
    }
}
