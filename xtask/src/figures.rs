//! `cargo xtask sim`, `programs`, `bench` and `compare`: release runs of the programs in the tests crate.

use std::path::Path;

use crate::cargo::{Profile, TESTS, cargo};
use crate::failure::Outcome;
use crate::{needs, python, shell, siege};

/// `cargo xtask sim [--debug] [--seeds N] [--seed S] [--minutes M] [-- ...]`: simulates the whole station in virtual
/// time. The program evaluates the options, except `--debug`: it runs the build of the tests, for a machine that has
/// it already.
///
/// # Errors
/// If it cannot be built or a seed fails; the program prints the command that replays the seed.
pub(crate) fn sim(args: &[String]) -> Outcome {
    simulation("sim", &["ob1-cp240", "ob1-tests"], args)
}

/// `cargo xtask programs [CP...] [--debug] [--seeds N] [--seed S --log]`: programs drawn at random around the handling
/// blocks. The program evaluates the options, except `--debug`, as [`sim`].
///
/// # Errors
/// If it cannot be built or a seed fails; the program prints the command that replays the seed.
pub(crate) fn programs(args: &[String]) -> Outcome {
    simulation("programs", &["ob1-cp040", "ob1-cp240", "ob1-cp340", "ob1-cp341", "ob1-tests"], args)
}

/// Builds the program `sim` with its plugin.
///
/// # Errors
/// If it cannot be built.
pub(crate) fn build_sim(profile: Profile) -> Outcome {
    if profile == Profile::Debug {
        return shell::run(&mut cargo(&["build", "-p", "ob1-cp240", "-p", "ob1-tests"]));
    }
    shell::run(&mut cargo(&["build", "--release", "-p", "ob1-cp240", "-p", "ob1-tests"]))
}

/// The SCL compiler against Siemens' own. The program evaluates the options.
///
/// # Errors
/// If it cannot be built, or a source or block differs that is not on the list of exceptions.
pub(crate) fn oscat(args: &[String]) -> Outcome {
    release_run("oscat", &["ob1-tests"], args, None)
}

/// Runs a program that needs only the plugins of `packages`: their release build, or that of the tests.
fn simulation(name: &str, packages: &[&str], args: &[String]) -> Outcome {
    if !args.iter().any(|arg| arg == "--debug") {
        return release_run(name, packages, args, None);
    }
    shell::run(&mut cargo(TESTS))?;
    let rest: Vec<String> = args.iter().filter(|arg| *arg != "--debug").cloned().collect();
    start(name, Profile::Debug, &rest, None)
}

/// `cargo xtask bench`: the figures of `docs/figures.md`, with the lower limit measured in the same run. `stl`, `line`,
/// `io` and `s7` compare with other programs and need the Python of the partners. `gate [items browsers flows paint]
/// [--minutes M]` puts load on the gate.
///
/// # Errors
/// If it cannot be built or run.
pub(crate) fn bench(args: &[String]) -> Outcome {
    if let Some(("gate", rest)) = args.split_first().map(|(name, rest)| (name.as_str(), rest)) {
        return siege::loads(rest);
    }
    if args.first().is_some_and(|name| name == "counts") {
        needs::satisfy(&[needs::VALGRIND])?;
        return simulation("bench", &[], &[args, &["--debug".to_owned()]].concat());
    }
    let beside = ["stl", "line", "io", "s7"];
    let python =
        if args.iter().any(|arg| beside.contains(&arg.as_str())) { Some(python::interpreter()?) } else { None };
    if args.iter().any(|arg| arg == "fleet") {
        needs::satisfy(&[needs::MOSQUITTO, needs::PROMETHEUS])?;
    }
    let packages = ["ob1", "ob1-cp", "ob1-io", "ob1-cp240", "ob1-gate", "ob1-s7-process", "ob1-tests"];
    let mut build = release_build(&packages);
    if args.iter().any(|arg| arg == "backplane") {
        needs::satisfy(&[needs::LIBCLANG])?;
        build.arg("--features=ob1-tests/iceoryx");
    }
    shell::run(&mut build)?;
    start("bench", Profile::Release, args, python.as_deref())
}

/// `cargo xtask compare [--seeds N] [--seed S]`: runs random STL programs on our engine and on awlsim. The program
/// evaluates the options.
///
/// # Errors
/// If it cannot be built, awlsim cannot be installed, or the results of a program differ.
pub(crate) fn compare(args: &[String]) -> Outcome {
    let python = python::interpreter()?;
    release_run("compare", &["ob1-tests"], args, Some(&python))
}

/// Builds these packages with their plugins and binaries, then runs the program `name` of the tests crate.
fn release_run(name: &str, packages: &[&str], args: &[String], python: Option<&Path>) -> Outcome {
    shell::run(&mut release_build(packages))?;
    start(name, Profile::Release, args, python)
}

fn release_build(packages: &[&str]) -> std::process::Command {
    let mut build = cargo(&["build", "--release"]);
    for package in packages {
        build.args(["--package", package]);
    }
    build
}

/// Runs the program `name` of the tests crate, with the plugins and binaries beside it.
fn start(name: &str, profile: Profile, args: &[String], python: Option<&Path>) -> Outcome {
    let folder = profile.folder()?;
    let mut program = std::process::Command::new(folder.join(name));
    program
        .args(args.iter().filter(|arg| *arg != "--"))
        .env("OB1_UNDER_XTASK", "1")
        .env("OB1_PLUGIN_DIR", &folder)
        .env("OB1_BIN_DIR", &folder)
        .env("OB1_SNAP7_NATIVE", python::native())
        .envs(python.map(|python| ("OB1_PYTHON", python)));
    shell::run_program(&mut program)
}
