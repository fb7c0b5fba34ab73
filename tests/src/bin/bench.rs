//! `cargo xtask bench`: the figures of the README, each beside its floor.

use std::path::Path;
use std::process::ExitCode;

use ob1_tests::bench::peer::{Failure, answer_pipe};
use ob1_tests::bench::{backplane, driver, memory, scan};

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let done = match args.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["--peer", role, path] => answer(role, Path::new(path)).map(|()| true),
        [] => measure(),
        _ => Err("usage: cargo xtask bench".into()),
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

fn answer(role: &str, path: &Path) -> Result<(), Failure> {
    match role {
        "registers" => backplane::answer_registers(path),
        "word" => backplane::answer_word(path),
        "pipe" => answer_pipe(path),
        _ => Err(format!("no such role: {role}").into()),
    }
}

/// Prints the table; true when every aim was met.
fn measure() -> Result<bool, Failure> {
    println!("medians; a figure and its floor are measured in turns in the same run");
    let mut met = true;
    let mut print = |figure: ob1_tests::bench::Figure| {
        println!("{}", figure.line());
        met &= figure.aim.1;
    };
    print(scan::empty()?);
    print(scan::idle_pair()?);
    print(backplane::measure()?);
    print(driver::measure()?);
    for figure in memory::measure()? {
        print(figure);
    }
    Ok(met)
}
