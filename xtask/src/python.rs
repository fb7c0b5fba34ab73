//! What the foreign partners run under: a virtual environment of the checkout with what they need pinned, and beside it
//! the packages that cannot lie in it.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::failure::{Outcome, step};
use crate::{cargo, needs, shell};

/// What the partners need, one pinned package a line; comments and empty lines do not count.
const REQUIREMENTS: &str = "tests/peers/requirements.txt";
/// Packages in a folder of their own, because the environment has another version of them.
const NATIVE: &str = "tests/peers/requirements-native.txt";
/// Packages for Node.js.
const NODE: &str = "tests/peers/package.json";
/// Copy of the requirements the environment was made for; when it differs the environment is made anew.
const STAMP: &str = "ob1-requirements.txt";

/// The interpreter of `.venv`, made first if it is missing or was made for other requirements.
///
/// # Errors
/// When Python, its `venv` module or a package cannot be had: the partners are part of the tests, so the run fails.
pub(crate) fn interpreter() -> Outcome<PathBuf> {
    let root = cargo::root();
    let venv = root.join(".venv");
    let python = venv.join("bin/python");
    let read = |path: &str| fs::read_to_string(root.join(path)).map_err(|why| step(format!("{path}: {why}")));
    let listed = read(REQUIREMENTS)?;
    let wanted = [listed.clone(), read(NATIVE)?, read(NODE)?].concat();
    if fs::read_to_string(venv.join(STAMP)).is_ok_and(|made_for| made_for == wanted) && runs(&python) {
        return Ok(python);
    }
    needs::satisfy(&[needs::PYTHON, needs::NODE])?;
    let needs_pip = packages(&listed).next().is_some();
    let mut make = Command::new("python3");
    make.args(["-m", "venv", "--clear"]).args((!needs_pip).then_some("--without-pip")).arg(&venv);
    shell::run(&mut make)?;
    if needs_pip {
        let mut install = Command::new(&python);
        install
            .args(["-m", "pip", "install", "--disable-pip-version-check", "--quiet", "-r"])
            .arg(root.join(REQUIREMENTS));
        shell::run(&mut install)?;
        let mut beside = Command::new(&python);
        beside.args(["-m", "pip", "install", "--disable-pip-version-check", "--quiet", "--target"]).arg(native());
        shell::run(beside.arg("-r").arg(root.join(NATIVE)))?;
    }
    let node = venv.join("node");
    fs::create_dir_all(&node).map_err(|why| step(format!("{}: {why}", node.display())))?;
    fs::copy(root.join(NODE), node.join("package.json")).map_err(|why| step(format!("{NODE}: {why}")))?;
    shell::run(
        Command::new("npm").args(["install", "--no-audit", "--no-fund", "--loglevel=error"]).current_dir(&node),
    )?;
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
    shell::works(Command::new(python).args(["-c", "import sys; sys.exit(sys.version_info < (3, 8))"]))
}

fn packages(requirements: &str) -> impl Iterator<Item = &str> {
    requirements.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'))
}

#[cfg(test)]
mod tests {
    use super::packages;

    #[test]
    fn comments_are_no_packages() {
        assert_eq!(packages("# none\n\n  \n").count(), 0);
        assert_eq!(packages("# one\npyserial==3.5\n").collect::<Vec<_>>(), ["pyserial==3.5"]);
    }
}
