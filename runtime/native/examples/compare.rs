//! Random programs on the reference engine and on the native one:
//! `cargo run --release -p ob1-native --example compare -- PROGRAMS [FIRST SEED] [watched|held]`; `watched`: with jobs
//! of program status on the other CPU; `held`: with breakpoints and steps.
#![allow(clippy::disallowed_methods, clippy::print_stdout, reason = "a tool for a desk")]

#[path = "../tests/random/mod.rs"]
mod random;

use ob1_cpu::engine::Factory;
use ob1_native::{AtLoad, Tier};

fn main() {
    let mut numbers = std::env::args().skip(1).filter_map(|arg| arg.parse::<u64>().ok());
    let (programs, first) = (numbers.next().unwrap_or(1000), numbers.next().unwrap_or(1 << 32));
    let (mut loaded, mut differ) = (0u64, 0u64);
    let asked = |word: &str| std::env::args().any(|arg| arg == word);
    let (watched, held) = (asked("watched"), asked("held"));
    for seed in first..first + programs {
        let engines: &[&dyn Factory] = match seed % 5 {
            0 | 1 => &[&AtLoad(Tier::Optimised)],
            2 | 3 => &[&AtLoad(Tier::Fast)],
            _ => &[&AtLoad(Tier::Fast), &random::Mixed, &AtLoad(Tier::Optimised)],
        };
        let compared = match watched {
            false if held => random::compare_held(seed).map(|(runs, _)| runs),
            false => random::compare(seed, 6, engines),
            true => random::compare_watched(seed).map(|(runs, _)| runs),
        };
        match compared {
            Ok(runs) => loaded += u64::from(runs),
            Err(difference) => {
                differ += 1;
                println!("{difference}");
                if differ >= 3 {
                    break;
                }
            }
        }
    }
    println!("{programs} programs, {loaded} of them run, {differ} differences");
}
