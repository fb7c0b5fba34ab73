//! `cargo xtask siege [WHAT...] [--rounds N] [--minutes M]`: long stress tests. `cargo xtask test` runs each of them
//! for a short time.
//!
//! A siege is a test whose number of rounds or minutes comes from the environment; a failing round prints its seed. A
//! siege that runs for minutes also checks its figures against limits.

use crate::campaign::Campaign;
use crate::cargo::{self, Profile, cargo};
use crate::failure::{Failure, Outcome};
use crate::tally::{count, is_closing_line};
use crate::{needs, pick, python, shell};

/// The sieges: the name, which is also that of the test; the test binary, with the module of the test if it has one;
/// the default length.
const SIEGES: &[Siege] = &[
    siege("kill", "process::siege", Long::Rounds(1_000)),
    siege("bus", "process::remote_io", Long::Rounds(200)),
    siege("bus_dp", "process::profibus", Long::Rounds(200)),
    siege("socket", "process::siege", Long::Rounds(100_000)),
    siege("load_kill", "process::load_siege", Long::Rounds(1_000)),
    siege("change_kill", "process::load", Long::Rounds(1_000)),
    siege("s7_kill", "process::s7_siege", Long::Rounds(100)),
    siege("alarm_kill", "process::s7_alarms", Long::Rounds(100)),
    siege("s7_sessions", "process::s7_siege", Long::Rounds(1_000_000)),
    siege("s7_torn", "process::s7_siege", Long::Rounds(10_000_000)),
    siege("s7_simulation", "simulation::cp343", Long::Rounds(1_000_000)),
    siege("gate_http", "process::gate_siege", Long::Minutes(10.0)),
    siege("gate_opcua", "process::gate_siege", Long::Minutes(10.0)),
    siege("gate_mqtt", "process::gate_siege", Long::Minutes(10.0)),
    siege("gate_greed", "process::gate_siege", Long::Minutes(60.0)),
    siege("gate_broker", "process::gate_siege", Long::Rounds(100)),
    siege("honest", "process::strangers", Long::Minutes(2.0)),
    siege("logs", "process::strangers", Long::Minutes(2.0)),
    siege("browsers", "process::browser", Long::Rounds(50)),
    siege("segment", "parts::siege", Long::Rounds(1_000_000)),
    siege("input", "parts::siege", Long::Rounds(100_000)),
    siege("cut", "parts::siege", Long::Rounds(1_000)),
    Siege { package: "ob1-station", ..siege("writer", "process_retentive", Long::Rounds(1_000)) },
];

/// What `cargo xtask bench gate` measures: also tests, whose figures are checked against limits when they run for
/// minutes.
const LOADS: &[Siege] = &[
    siege("gate_items", "process::gate_load", Long::Minutes(2.0)),
    siege("gate_browsers", "process::gate_load", Long::Minutes(5.0)),
    siege("gate_flows", "process::gate_load", Long::Minutes(2.0)),
    siege("gate_paint", "process::gate_load", Long::Minutes(0.5)),
];

struct Siege {
    name: &'static str,
    package: &'static str,
    /// Where the test is: `BINARY` or `BINARY::MODULE`.
    file: &'static str,
    long: Long,
}

impl Siege {
    /// The test binary, and the full name of the test in it.
    fn test(&self) -> (&'static str, String) {
        match self.file.split_once("::") {
            Some((binary, module)) => (binary, format!("{module}::{}", self.name)),
            None => (self.file, self.name.to_owned()),
        }
    }
}

/// The default length of a siege.
#[derive(Clone, Copy)]
enum Long {
    Rounds(u64),
    Minutes(f64),
}

const fn siege(name: &'static str, file: &'static str, long: Long) -> Siege {
    Siege { name, package: "ob1-tests", file, long }
}

/// # Errors
/// If something cannot be built, or a round fails.
pub(crate) fn run(args: &[String]) -> Outcome {
    let (campaign, args) = Campaign::take("siege", args)?;
    let number = |text: &str| text.parse::<u64>().ok().filter(|&number| number > 0);
    // Either option, at any position.
    let at = args.iter().position(|arg| arg == "--minutes").unwrap_or(args.len());
    let (option, behind) = args[at..].split_at(2.min(args.len() - at));
    let (_, minutes) = pick::names_and_option(option, "siege", "--minutes", MINUTES, minutes)?;
    let rest = [&args[..at], behind].concat();
    let (names, rounds) = pick::names_and_option(&rest, "siege", "--rounds", "a number, e.g. 1000", number)?;
    // Without names, an option selects the sieges it applies to.
    let meant = |siege: &&Siege| match siege.long {
        Long::Rounds(_) => minutes.is_none() || !names.is_empty(),
        Long::Minutes(_) => rounds.is_none() || !names.is_empty(),
    };
    let known = SIEGES.iter().filter(meant).map(|siege| siege.name.to_owned()).collect();
    let names = pick::some_or_all(names.clone(), known, "siege")?;
    let sieges: Vec<&Siege> = names.iter().filter_map(|name| SIEGES.iter().find(|siege| siege.name == name)).collect();
    lay(campaign, &sieges, rounds, minutes)
}

/// `cargo xtask bench gate [NAME...] [--minutes M]`
///
/// # Errors
/// If something cannot be built, or a figure exceeds its limit.
pub(crate) fn loads(args: &[String]) -> Outcome {
    let (campaign, args) = Campaign::take("bench gate", args)?;
    let (names, minutes) = pick::names_and_option(&args, "bench gate", "--minutes", MINUTES, minutes)?;
    let known = LOADS.iter().map(|load| load.name.trim_start_matches("gate_").to_owned()).collect();
    let names = pick::some_or_all(names, known, "load of the gate")?;
    let wanted = |load: &&Siege| names.iter().any(|name| load.name.strip_prefix("gate_") == Some(name));
    lay(campaign, &LOADS.iter().filter(wanted).collect::<Vec<_>>(), None, minutes)
}

const MINUTES: &str = "a number of minutes, e.g. 10 or 0.5";

fn minutes(text: &str) -> Option<f64> {
    text.parse::<f64>().ok().filter(|&minutes| minutes > 0.0 && minutes.is_finite())
}

/// Builds everything, and runs these sieges for the given or the default length.
fn lay(mut campaign: Campaign, sieges: &[&Siege], rounds: Option<u64>, minutes: Option<f64>) -> Outcome {
    let counted = |siege: &&&Siege| matches!(siege.long, Long::Rounds(_));
    if let Some(siege) = sieges.iter().find(|siege| minutes.is_some() && counted(siege)) {
        return Err(Failure::Usage(format!("{} is counted in rounds: --rounds", siege.name)));
    }
    if let Some(siege) = sieges.iter().find(|siege| rounds.is_some() && !counted(siege)) {
        return Err(Failure::Usage(format!("{} is counted in minutes: --minutes", siege.name)));
    }
    needs::satisfy(&[needs::BROWSER, needs::MOSQUITTO])?;
    let python = python::interpreter()?;
    shell::run(&mut cargo(&["build", "--release", "--workspace"]))?;
    let folder = Profile::Release.folder()?;
    for siege in sieges {
        let (binary, test) = siege.test();
        let mut command = cargo(&["test", "--release", "--package", siege.package, "--test", binary]);
        let (variable, long) = match siege.long {
            Long::Rounds(usual) => ("OB1_SIEGE_ROUNDS", campaign.share(rounds.unwrap_or(usual)).max(1).to_string()),
            Long::Minutes(usual) => {
                ("OB1_SIEGE_MINUTES", (minutes.unwrap_or(usual) / campaign.part.of as f64).to_string())
            }
        };
        command
            .args(["--", "--nocapture", "--test-threads=1", "--exact", &test])
            .env(variable, long)
            .env("OB1_PART", campaign.part.to_string())
            .env("OB1_UNDER_XTASK", "1")
            .env("OB1_PLUGIN_DIR", &folder)
            .env("OB1_BIN_DIR", &folder)
            .env("OB1_PYTHON", &python)
            .env("NODE_PATH", python::node_modules())
            .current_dir(cargo::root());
        // A name that no test has would pass. (A test that is a program of its own runs in any case.)
        let ended = if siege.file.contains("::") {
            let closing = shell::watch(&mut command, is_closing_line);
            closing.and_then(|closing| count(&closing, siege.name)).map(drop)
        } else {
            shell::run(&mut command)
        };
        campaign.enter(siege.name, ended)?;
    }
    campaign.end()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::failure::Failure;

    #[test]
    fn only_sieges_that_there_are() {
        let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
        for wrong in [
            "castle",
            "kill --rounds none",
            "--rounds 0",
            "--seed 1",
            "gate_http --minutes",
            "gate_http --minutes -1",
            "gate_http --minutes 0",
            "gate_http --minutes 1 --seed 1",
            "gate_http --rounds 5",
            "--minutes 5 kill",
        ] {
            assert!(matches!(run(&words(wrong)), Err(Failure::Usage(_))), "{wrong}");
        }
        for wrong in ["http", "items --rounds 1", "--minutes nan"] {
            assert!(matches!(loads(&words(wrong)), Err(Failure::Usage(_))), "{wrong}");
        }
    }

    /// Each siege is a test of its file.
    #[test]
    fn sieges_are_tests() {
        for siege in SIEGES.iter().chain(LOADS) {
            let folder = if siege.package == "ob1-station" { "runtime/station/tests" } else { "tests/tests" };
            let path = cargo::root().join(folder).join(siege.file.replace("::", "/"));
            let text = std::fs::read_to_string(path.with_extension("rs"))
                .or_else(|_| std::fs::read_to_string(path.join("mod.rs")))
                .expect("its file");
            let stands = text.contains(&format!("\nfn {}()", siege.name)) || siege.file == "process_retentive";
            let long = match siege.long {
                Long::Rounds(_) => text.contains("rounds(") || text.contains("OB1_SIEGE_ROUNDS"),
                Long::Minutes(_) => text.contains("Span::of("),
            };
            assert!(stands && long, "{}", siege.name);
        }
    }
}
