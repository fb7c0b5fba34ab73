//! `cargo xtask aarch64`: runs the tests of the native engine and random programs as AArch64 code under the user-mode
//! emulation of QEMU. It is not part of the tests, because all dependencies must first be compiled for that processor.

use std::process::Command;

use crate::cargo::{cargo, own_target};
use crate::failure::{Failure, Outcome, step};
use crate::needs::{self, AARCH64_GCC, QEMU_USER};
use crate::shell;
use crate::tally::{count, is_closing_line};

const TARGET: &str = "aarch64-unknown-linux-gnu";
const LINKER: &str = "aarch64-linux-gnu-gcc";
/// The emulator, with the folder of Debian's libraries for that processor.
const RUNNER: &str = "qemu-aarch64 -L /usr/aarch64-linux-gnu";
/// Default number of random programs. The emulator runs at a tenth of the speed.
const PROGRAMS: &str = "200";

/// Runs the tests, then a number of random programs on both engines.
///
/// # Errors
/// The compiler, the emulator or Rust's library for the processor is missing, or a test fails.
pub(crate) fn run(args: &[String]) -> Outcome {
    let programs = match args {
        [] => PROGRAMS,
        [number] if number.parse::<u64>().is_ok() => number,
        _ => return Err(Failure::Usage("aarch64 takes a number of random programs".into())),
    };
    needs::satisfy(&[AARCH64_GCC, QEMU_USER])?;
    if !has_library() {
        return Err(step(format!("Rust's library for AArch64 is not here: rustup target add {TARGET}")));
    }
    // Random programs come last, fewer than in the tests.
    let closing = shell::watch(&mut emulated(&["test", "--lib", "--test", "image"])?, is_closing_line)?;
    println!("aarch64: {}", count(&closing, "aarch64")?);
    let mut compare = emulated(&["run", "--example", "compare"])?;
    let said = shell::read(compare.args(["--", programs]))?;
    let last = said.lines().last().unwrap_or_default();
    println!("aarch64: {last}");
    if last.starts_with(&format!("{programs} programs")) && last.ends_with(" 0 differences") {
        Ok(())
    } else {
        Err(step(format!("aarch64: the engines differ:\n{said}")))
    }
}

fn has_library() -> bool {
    // Run in the checkout, which selects the toolchain.
    let mut command = Command::new("rustc");
    command.args(["--print", "target-libdir", "--target", TARGET]).current_dir(crate::cargo::root());
    shell::read(&mut command).is_ok_and(|folder| std::path::Path::new(folder.trim()).is_dir())
}

/// `cargo ARGS` of the native engine, built for the processor and run by the emulator.
fn emulated(args: &[&str]) -> Outcome<Command> {
    let mut command = cargo(args);
    command.args(["--quiet", "--package", "ob1-native", "--target", TARGET]);
    command.arg("--target-dir").arg(own_target("aarch64")?);
    let of = |what: &str| format!("CARGO_TARGET_{}_{what}", TARGET.replace('-', "_").to_uppercase());
    command.env(of("LINKER"), LINKER).env(of("RUNNER"), RUNNER);
    Ok(command)
}
