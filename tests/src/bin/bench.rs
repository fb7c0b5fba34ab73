//! `cargo xtask bench [NAME...]`: the figures of the README, each beside its floor.

use std::path::Path;
use std::process::ExitCode;

use ob1_tests::bench::peer::{Failure, answer_pipe};
use ob1_tests::bench::{backplane, compile, driver, line, memory, modbus, scan, stl};

const HELP: &str = "usage: cargo xtask bench [NAME...]
  names: scan, pair, backplane, driver, memory, line, compile (default: all of these)
         stl: the engine beside awlsim (installed into .venv), alone; about a minute
         modbus: RTU transactions over a pty beside libmodbus and pymodbus (in .venv)

Exit status: 0 every aim met, 1 an aim missed, 2 it could not be measured.";

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let done = match args.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["--peer", role, path] => answer(role, Path::new(path)).map(|()| true),
        ["stl"] => stl::measure(),
        ref names if names.iter().all(|name| NAMES.contains(name) || *name == "modbus") => measure(names),
        _ => Err(HELP.into()),
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(failure) => {
            eprintln!("bench: {failure}");
            ExitCode::from(2)
        }
    }
}

const NAMES: [&str; 7] = ["scan", "pair", "backplane", "driver", "memory", "line", "compile"];

fn answer(role: &str, path: &Path) -> Result<(), Failure> {
    match role {
        "registers" => backplane::answer_registers(path),
        "word" => backplane::answer_word(path),
        "pipe" => answer_pipe(path),
        _ => Err(format!("no such role: {role}").into()),
    }
}

/// Prints the table; true when every aim was met.
fn measure(names: &[&str]) -> Result<bool, Failure> {
    println!("medians; a figure and its floor are measured in turns in the same run");
    let mut met = true;
    for name in if names.is_empty() { &NAMES } else { names } {
        let figures = match *name {
            "scan" => vec![scan::empty()?],
            "pair" => vec![scan::idle_pair()?],
            "backplane" => vec![backplane::measure()?],
            "driver" => vec![driver::measure()?],
            "line" => line::measure()?,
            "compile" => compile::measure()?.into(),
            "modbus" => modbus::measure()?,
            _ => memory::measure()?.into(),
        };
        for figure in figures {
            println!("{}", figure.line());
            met &= figure.aim.1;
        }
    }
    Ok(met)
}
