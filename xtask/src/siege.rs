//! `cargo xtask siege [WHAT...] [--rounds N]`: attacks on what stands, long. `cargo xtask test` runs each of them
//! short.
//!
//! A siege is a test whose number of rounds comes from the environment; a round that fails names its seed.

use crate::cargo::{self, Profile, cargo};
use crate::failure::Outcome;
use crate::{pick, python, shell};

/// A siege: its name, which is that of its test; where it stands; the rounds of a campaign.
const SIEGES: &[Siege] = &[
    Siege { name: "kill", package: "ob1-tests", binary: "process_siege", rounds: 1_000 },
    Siege { name: "bus", package: "ob1-tests", binary: "process_remote_io", rounds: 200 },
    Siege { name: "bus_dp", package: "ob1-tests", binary: "process_profibus", rounds: 200 },
    Siege { name: "socket", package: "ob1-tests", binary: "process_siege", rounds: 100_000 },
    Siege { name: "s7_kill", package: "ob1-tests", binary: "process_s7_siege", rounds: 100 },
    Siege { name: "s7_sessions", package: "ob1-tests", binary: "process_s7_siege", rounds: 1_000_000 },
    Siege { name: "s7_torn", package: "ob1-tests", binary: "process_s7_siege", rounds: 10_000_000 },
    Siege { name: "segment", package: "ob1-tests", binary: "siege", rounds: 1_000_000 },
    Siege { name: "input", package: "ob1-tests", binary: "siege", rounds: 100_000 },
    Siege { name: "cut", package: "ob1-tests", binary: "siege", rounds: 1_000 },
    Siege { name: "writer", package: "ob1-station", binary: "process_retentive", rounds: 1_000 },
];

struct Siege {
    name: &'static str,
    package: &'static str,
    binary: &'static str,
    rounds: u64,
}

/// # Errors
/// When something cannot be built, or a round fails.
pub(crate) fn run(args: &[String]) -> Outcome {
    let number = |text: &str| text.parse::<u64>().ok().filter(|&number| number > 0);
    let (names, rounds) = pick::names_and_option(args, "siege", "--rounds", "a number, e.g. 1000", number)?;
    let known = SIEGES.iter().map(|siege| siege.name.to_owned()).collect();
    let names = pick::some_or_all(names, known, "siege")?;
    let sieges = names.iter().filter_map(|name| SIEGES.iter().find(|siege| siege.name == name));
    let python = python::interpreter()?;
    shell::run(&mut cargo(&["build", "--release", "--workspace"]))?;
    let folder = Profile::Release.folder()?;
    for siege in sieges {
        let mut test = cargo(&["test", "--release", "--package", siege.package, "--test", siege.binary]);
        test.args(["--", "--nocapture", "--test-threads=1", siege.name])
            .env("OB1_SIEGE_ROUNDS", rounds.unwrap_or(siege.rounds).to_string())
            .env("OB1_UNDER_XTASK", "1")
            .env("OB1_PLUGIN_DIR", &folder)
            .env("OB1_BIN_DIR", &folder)
            .env("OB1_PYTHON", &python)
            .current_dir(cargo::root());
        shell::run(&mut test)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::failure::Failure;

    #[test]
    fn only_sieges_that_there_are() {
        let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
        for wrong in ["castle", "kill --rounds none", "--rounds 0", "--seed 1"] {
            assert!(matches!(run(&words(wrong)), Err(Failure::Usage(_))), "{wrong}");
        }
    }

    /// Each siege is a test of its file.
    #[test]
    fn sieges_are_tests() {
        for siege in SIEGES {
            let folder = if siege.package == "ob1-station" { "runtime/station/tests" } else { "tests/tests" };
            let path = cargo::root().join(folder).join(format!("{}.rs", siege.binary));
            let text = std::fs::read_to_string(&path).expect("its file");
            let stands = text.contains(&format!("\nfn {}()", siege.name)) || siege.binary == "process_retentive";
            assert!(stands && (text.contains("rounds(") || text.contains("OB1_SIEGE_ROUNDS")), "{}", siege.name);
        }
    }
}
