//! `cargo xtask test`: every test of the project.
//!
//! `cargo test` alone builds neither the plugins (cdylibs) nor the binaries of other crates, nor installs the foreign
//! partners. This verb installs the packages of the partners (`needs.rs`), builds everything else in the profile of the
//! tests and passes its location:
//!
//! | Variable          | Meaning                                                        |
//! |-------------------|----------------------------------------------------------------|
//! | `OB1_UNDER_XTASK` | `1`: this verb started the test                                |
//! | `OB1_PLUGIN_DIR`  | folder of `libob1_cp240.so` and the example plugins            |
//! | `OB1_BIN_DIR`     | folder of `ob1` and `ob1-cp`                                   |
//! | `OB1_PYTHON`      | interpreter for `tests/peers`, with their packages             |
//! | `OB1_SNAP7_NATIVE`| folder of the python-snap7 that brings the C++ library         |
//! | `NODE_PATH`       | packages for the partners that run under Node.js               |

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::cargo::{self, Profile, cargo};
use crate::failure::{Failure, Outcome, step};
use crate::{loom_miri, needs, python, shell};

/// Tests that start real processes are in test binaries with this prefix; they run one after the other.
const SERIAL_PREFIX: &str = "process";

/// The options of the command line.
#[derive(Debug, PartialEq, Eq)]
struct Wish {
    profile: Profile,
    /// Runs only tests whose name contains it, without loom and the doc tests.
    filter: Option<String>,
}

/// `cargo xtask test [--release] [FILTER]`
///
/// # Errors
/// If anything cannot be built or installed, any test fails, or a runner ran no test.
pub(crate) fn run(args: &[String]) -> Outcome {
    let wish = parse(args)?;
    // Missing packages are installed or reported before anything is built.
    needs::satisfy(&[
        needs::PYTHON,
        needs::NODE,
        needs::MBPOLL,
        needs::LIBMODBUS,
        needs::BROWSER,
        needs::PROMETHEUS,
        needs::MOSQUITTO,
        needs::TSHARK,
    ])?;
    let python = python::interpreter()?;
    shell::run(cargo(cargo::TESTS).args(wish.profile.flags()))?;
    let folder = wish.profile.folder()?;
    let surroundings = |command: &mut Command| {
        command
            .env("OB1_UNDER_XTASK", "1")
            .env("OB1_PLUGIN_DIR", &folder)
            .env("OB1_BIN_DIR", &folder)
            .env("OB1_PYTHON", &python)
            .env("OB1_SNAP7_NATIVE", python::native())
            .env("NODE_PATH", python::node_modules());
    };

    let mut summary = Vec::new();
    summary.push(("partners", self_tests(&python)?));
    let mut closing = Vec::new();
    for mut command in test_commands(&wish)? {
        surroundings(&mut command);
        closing.extend(shell::watch(&mut command, is_closing_line)?);
    }
    summary.push(("tests", count(&closing, "tests")?));
    if wish.filter.is_none() {
        let mut doc = cargo(&["test", "--workspace", "--doc"]);
        doc.args(wish.profile.flags());
        surroundings(&mut doc);
        let tally = Tally::of(&shell::watch(&mut doc, is_closing_line)?);
        summary.push(("doc tests", tally.to_string()));
        summary.push(("loom", loom_miri::loom()?));
    }

    println!();
    for line in closing.iter().filter(|line| line.contains("Summary [")) {
        println!("{line}");
    }
    for (what, result) in &summary {
        println!("{what:<10} {result}");
    }
    if wish.filter.is_some() {
        println!("{:<10} left out, because a filter was given", "the rest");
    }
    println!("all tests passed");
    Ok(())
}

/// A faulty partner proves nothing: each script of `tests/peers` is first tested against itself.
fn self_tests(python: &Path) -> Outcome<String> {
    let folder = cargo::root().join("tests/peers");
    let entries = std::fs::read_dir(&folder).map_err(|why| step(format!("{}: {why}", folder.display())))?;
    let mut scripts: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    scripts.retain(|path| path.extension().is_some_and(|end| end == "py"));
    scripts.sort();
    for script in &scripts {
        shell::run(Command::new(python).arg(script).arg("--selftest"))?;
    }
    Ok(format!("{} passed their self-tests", scripts.len()))
}

fn parse(args: &[String]) -> Outcome<Wish> {
    let mut wish = Wish { profile: Profile::Debug, filter: None };
    for arg in args {
        match arg.as_str() {
            "--release" => wish.profile = Profile::Release,
            flag if flag.starts_with('-') => return Err(Failure::Usage(format!("test knows no `{flag}`"))),
            _ if wish.filter.is_some() => return Err(Failure::Usage("test takes one filter".into())),
            filter => wish.filter = Some(filter.to_owned()),
        }
    }
    Ok(wish)
}

/// One command with nextest; without it two, so that the tests with real processes have a separate run.
fn test_commands(wish: &Wish) -> Outcome<Vec<Command>> {
    let filter = wish.filter.as_deref();
    if shell::works(&mut cargo(&["nextest", "--version"])) {
        let mut nextest = cargo(&["nextest", "run", "--workspace"]);
        nextest.args(wish.profile.flags()).args(filter);
        return Ok(vec![nextest]);
    }
    let mut parallel = cargo(&["test", "--workspace", "--no-fail-fast", "--lib", "--bins", "--examples"]);
    let mut serial = cargo(&["test", "--workspace", "--no-fail-fast"]);
    let mut some_serial = false;
    for name in integration_tests()? {
        if name.starts_with(SERIAL_PREFIX) {
            serial.args(["--test", &name]);
            some_serial = true;
        } else {
            parallel.args(["--test", &name]);
        }
    }
    parallel.args(wish.profile.flags()).args(filter);
    serial.args(wish.profile.flags()).args(filter).args(["--", "--test-threads=1"]);
    Ok(if some_serial { vec![parallel, serial] } else { vec![parallel] })
}

/// Names of the integration test binaries of all members.
fn integration_tests() -> Outcome<Vec<String>> {
    let metadata = cargo::members()?;
    let targets = cargo::list(&metadata["packages"]).iter().flat_map(|package| cargo::list(&package["targets"]));
    let tests = targets.filter(|target| cargo::list(&target["kind"]).iter().any(|kind| kind == "test"));
    let mut names: Vec<String> = tests.filter_map(|target| Some(target["name"].as_str()?.to_owned())).collect();
    names.sort();
    names.dedup();
    Ok(names)
}

/// The last line of a runner: libtest's `test result:` or nextest's `Summary [...]`.
pub(crate) fn is_closing_line(line: &str) -> bool {
    line.starts_with("test result: ") || line.trim_start().starts_with("Summary [")
}

/// The number of tests that ran, summed over closing lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Tally {
    pub(crate) passed: u64,
    pub(crate) left_out: u64,
}

impl Tally {
    /// Reads closing lines of libtest (`3 passed; 0 failed; 1 ignored; ...`) and nextest (`3 passed, 1 skipped`).
    pub(crate) fn of(lines: &[String]) -> Self {
        let mut tally = Self::default();
        for line in lines {
            let mut before = 0;
            for word in line.split([' ', ';', ',']) {
                match word {
                    "passed" => tally.passed += before,
                    "ignored" | "skipped" => tally.left_out += before,
                    _ => {}
                }
                before = word.parse().unwrap_or(0);
            }
        }
        tally
    }
}

impl std::fmt::Display for Tally {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} passed", self.passed)?;
        if self.left_out > 0 { write!(f, ", {} left out", self.left_out) } else { Ok(()) }
    }
}

/// The count as text; a run without any test is an error.
pub(crate) fn count(closing: &[String], what: &str) -> Outcome<String> {
    let tally = Tally::of(closing);
    if tally.passed == 0 {
        return Err(step(format!("{what}: no test ran")));
    }
    Ok(tally.to_string())
}

/// For [`loom_miri`]: a separate target directory.
pub(crate) fn own_target(name: &str) -> Outcome<PathBuf> {
    Ok(cargo::target_dir()?.join(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Vec<String> {
        text.split_whitespace().map(str::to_owned).collect()
    }

    #[test]
    fn a_filter_and_a_profile() {
        let wish = parse(&words("--release seqlock")).expect("both are known");
        assert_eq!(wish, Wish { profile: Profile::Release, filter: Some("seqlock".into()) });
        assert!(matches!(parse(&words("--relase")), Err(Failure::Usage(_))));
        assert!(matches!(parse(&words("a b")), Err(Failure::Usage(_))));
    }

    #[test]
    fn both_runners_are_understood() {
        let lines = [
            "test result: ok. 5 passed; 0 failed; 1 ignored; 0 measured; 0 filtered out; finished in 0.00s".to_owned(),
            "     Summary [   1.234s] 12 tests run: 12 passed (1 slow), 3 skipped".to_owned(),
        ];
        assert!(lines.iter().all(|line| is_closing_line(line)));
        assert_eq!(Tally::of(&lines), Tally { passed: 17, left_out: 4 });
        assert!(!is_closing_line("test a_summary ... ok"));
    }

    #[test]
    fn no_test_at_all_is_a_failure() {
        assert!(count(&["test result: ok. 0 passed; 0 failed".to_owned()], "loom").is_err());
        assert_eq!(
            count(&["test result: ok. 2 passed; 0 failed".to_owned()], "loom").ok().as_deref(),
            Some("2 passed")
        );
    }
}
