//! `cargo xtask compare`: random straight-line programs on our engine and on awlsim.

use std::process::ExitCode;

use ob1_tests::awlsim::{Awlsim, Failure, Scratch};
use ob1_tests::compare::program::SNIPPETS;
use ob1_tests::compare::{Verdict, compare, regressions};

const HELP: &str = "usage: cargo xtask compare [--seeds N] [--seed S]
  --seeds N   so many programs (default 100), from --seed on
  --seed S    the first one (default 1)

A program that differs is made smaller and written to tests/compare.
Exit status: 0 all the same, 1 some differ, 2 something could not be run.";

fn main() -> ExitCode {
    match wish().and_then(|(first, count)| run(first, count)) {
        Ok(0) => ExitCode::SUCCESS,
        Ok(_) => ExitCode::FAILURE,
        Err(failure) => {
            eprintln!("compare: {failure}");
            ExitCode::from(2)
        }
    }
}

fn wish() -> Result<(u64, u64), Failure> {
    let (mut first, mut count) = (1, 100);
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let value = args.next().and_then(|value| value.parse().ok());
        match (arg.as_str(), value) {
            ("--seed", Some(value)) => first = value,
            ("--seeds", Some(value)) => count = value,
            _ => return Err(HELP.into()),
        }
    }
    Ok((first, count))
}

/// The number of seeds that differ.
fn run(first: u64, count: u64) -> Result<u64, Failure> {
    let awlsim = Awlsim::find()?;
    let scratch = Scratch::new("compare")?;
    let mut differing = 0;
    for seed in first..first.saturating_add(count) {
        match compare(seed, &awlsim, &scratch).map_err(|why| format!("seed {seed}: {why}"))? {
            Verdict::Same => {}
            Verdict::Differs(difference) => {
                differing += 1;
                let file = regressions().join(format!("seed_{seed}_{}.awl", difference.index));
                std::fs::write(&file, difference.regression())?;
                println!(
                    "seed {seed}, snippet {}: differs\n{}  -> {}",
                    difference.index,
                    difference.text(),
                    file.display()
                );
            }
        }
    }
    println!("{count} programs of {SNIPPETS} snippets compared with awlsim, {differing} differ");
    Ok(differing)
}
