//! `cargo xtask test`: every test of the project. `--quick`: those that need nothing but the Rust toolchain and a C
//! compiler: no foreign program, no browser, no real process.
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
use crate::tally::{Tally, count, is_closing_line};
use crate::{loom_miri, needs, package, python, shell};

/// Tests that start real processes are in test binaries with this prefix; they run one after the other.
const SERIAL_PREFIX: &str = "process";

/// The options of the command line.
#[derive(Debug, PartialEq, Eq)]
struct Wish {
    profile: Profile,
    /// Only what needs no foreign program, without loom and the doc tests.
    quick: bool,
    /// Runs only tests whose name contains it, without loom and the doc tests.
    filter: Option<String>,
}

/// `cargo xtask test [--quick] [--release] [FILTER]`
///
/// # Errors
/// If anything cannot be built or installed, any test fails, or a runner ran no test.
pub(crate) fn run(args: &[String]) -> Outcome {
    let wish = parse(args)?;
    let python = if wish.quick { None } else { Some(partners()?) };
    shell::run(cargo(cargo::TESTS).args(wish.profile.flags()))?;
    let folder = wish.profile.folder()?;
    let surroundings = |command: &mut Command| {
        command.env("OB1_UNDER_XTASK", "1").env("OB1_PLUGIN_DIR", &folder).env("OB1_BIN_DIR", &folder);
        if let Some(python) = &python {
            command
                .env("OB1_PYTHON", python)
                .env("OB1_SNAP7_NATIVE", python::native())
                .env("NODE_PATH", python::node_modules());
        }
    };

    let mut summary = Vec::new();
    if let Some(python) = &python {
        summary.push(("partners", self_tests(python, &surroundings)?));
    }
    let mut closing = Vec::new();
    for mut command in test_commands(&wish)? {
        surroundings(&mut command);
        closing.extend(shell::watch(&mut command, is_closing_line)?);
    }
    summary.push(("tests", count(&closing, "tests")?));
    if wish.filter.is_none() && !wish.quick {
        let mut doc = cargo(&["test", "--workspace", "--doc"]);
        doc.args(wish.profile.flags());
        surroundings(&mut doc);
        let tally = Tally::of(&shell::watch(&mut doc, is_closing_line)?);
        summary.push(("doc tests", tally.to_string()));
        summary.push(("loom", loom_miri::loom()?));
        summary.push(("image", package::image_of(wish.profile)?));
    }

    println!();
    for line in closing.iter().filter(|line| line.contains("Summary [")) {
        println!("{line}");
    }
    for (what, result) in &summary {
        println!("{what:<10} {result}");
    }
    match (wish.quick, wish.filter.is_some()) {
        (true, _) => println!("{:<10} left out: real processes, foreign partners, doc tests, loom", "the rest"),
        (false, true) => println!("{:<10} left out, because a filter was given", "the rest"),
        (false, false) => {}
    }
    println!("{}", if wish.quick { "the quick tests passed" } else { "all tests passed" });
    Ok(())
}

/// Installs the foreign partners; returns the interpreter that runs them. Missing packages are installed or reported
/// before anything is built.
fn partners() -> Outcome<PathBuf> {
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
    python::interpreter()
}

/// A faulty partner proves nothing: each script of `tests/peers` is first tested against itself.
fn self_tests(python: &Path, surroundings: &dyn Fn(&mut Command)) -> Outcome<String> {
    let folder = cargo::root().join("tests/peers");
    let entries = std::fs::read_dir(&folder).map_err(|why| step(format!("{}: {why}", folder.display())))?;
    let mut scripts: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    scripts.retain(|path| path.extension().is_some_and(|end| end == "py"));
    scripts.sort();
    for script in &scripts {
        let mut test = Command::new(python);
        test.arg(script).arg("--selftest");
        surroundings(&mut test);
        shell::run(&mut test)?;
    }
    Ok(format!("{} passed their self-tests", scripts.len()))
}

fn parse(args: &[String]) -> Outcome<Wish> {
    let mut wish = Wish { profile: Profile::Debug, quick: false, filter: None };
    for arg in args {
        match arg.as_str() {
            "--quick" => wish.quick = true,
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
        if wish.quick {
            nextest.args(["-E", &format!("not binary(/^{SERIAL_PREFIX}/)")]);
        }
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
    Ok(if some_serial && !wish.quick { vec![parallel, serial] } else { vec![parallel] })
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

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Vec<String> {
        text.split_whitespace().map(str::to_owned).collect()
    }

    #[test]
    fn a_filter_and_a_profile() {
        let wish = parse(&words("--release seqlock")).expect("both are known");
        assert_eq!(wish, Wish { profile: Profile::Release, quick: false, filter: Some("seqlock".into()) });
        assert!(parse(&words("--quick")).is_ok_and(|wish| wish.quick));
        assert!(matches!(parse(&words("--relase")), Err(Failure::Usage(_))));
        assert!(matches!(parse(&words("a b")), Err(Failure::Usage(_))));
    }
}
