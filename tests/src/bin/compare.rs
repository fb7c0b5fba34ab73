//! `cargo xtask compare`: random straight-line programs on our engine and on awlsim.

use std::process::ExitCode;

use ob1_tests::awlsim::{Awlsim, Failure, Scratch};
use ob1_tests::compare::program::SNIPPETS;
use ob1_tests::compare::{Verdict, compare, regressions};
use ob1_tests::part::{Part, Tally};

const HELP: &str = "usage: cargo xtask compare [--seeds N] [--seed S]
  --seeds N   so many programs (default 100), from --seed on
  --seed S    the first one (default 1)
  --part I/N  the part I of N of them, for a batch engine
  --json      the last line is the result as JSON, for cargo xtask collect

A program that differs is made smaller and written to tests/compare.
Exit status: 0 all the same, 1 some differ, 2 something could not be run.";

fn main() -> ExitCode {
    match wish().and_then(|wish| run(&wish)) {
        Ok(0) => ExitCode::SUCCESS,
        Ok(_) => ExitCode::FAILURE,
        Err(failure) => {
            eprintln!("compare: {failure}");
            ExitCode::from(2)
        }
    }
}

struct Wish {
    first: u64,
    count: u64,
    part: Part,
    json: bool,
}

fn wish() -> Result<Wish, Failure> {
    let mut wish = Wish { first: 1, count: 100, part: Part::WHOLE, json: false };
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let mut number = || args.next().and_then(|value| value.parse().ok()).ok_or(HELP);
        match arg.as_str() {
            "--seed" => wish.first = number()?,
            "--seeds" => wish.count = number()?,
            "--part" => wish.part = args.next().ok_or(HELP)?.parse()?,
            "--json" => wish.json = true,
            _ => return Err(HELP.into()),
        }
    }
    Ok(wish)
}

/// The number of seeds that differ.
fn run(wish: &Wish) -> Result<usize, Failure> {
    let awlsim = Awlsim::find()?;
    let scratch = Scratch::new("compare")?;
    let options = format!("--seeds {} --seed {}", wish.count, wish.first);
    let mut tally = Tally::new("compare", &options, wish.part);
    let (first, count) = wish.part.slice(wish.first, wish.count);
    for seed in first..first.saturating_add(count) {
        let name = format!("seed {seed}");
        match compare(seed, &awlsim, &scratch).map_err(|why| format!("seed {seed}: {why}"))? {
            Verdict::Same => tally.enter(&name, Ok("")),
            Verdict::Differs(difference) => {
                tally.enter(&name, Err(&format!("snippet {} differs", difference.index)));
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
    println!("{count} programs of {SNIPPETS} snippets compared with awlsim, {} differ", tally.failed.len());
    if wish.json {
        println!("{}", tally.line());
    }
    Ok(tally.failed.len())
}
