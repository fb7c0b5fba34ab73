//! `cargo xtask faults [PROTOCOL...] [--telegrams N]`: long runs of the fault tests `faults_*.rs` of the protocol
//! machines.
//!
//! `cargo xtask test` also runs them, but shorter. A failing seed is printed with the command that replays it; add it
//! to `driver/protocols/tests/seeds`.

use crate::campaign::Campaign;
use crate::cargo::cargo;
use crate::failure::Outcome;
use crate::tally::{count, is_closing_line};
use crate::{pick, shell};

const PREFIX: &str = "faults_";
/// Location of the tests: package, test binary, its folder.
const PLACES: [(&str, &str, &str); 2] =
    [("ob1-protocols", "protocols", "driver/protocols/tests/protocols"), ("ob1-dp", "dp", "driver/dp/tests/dp")];
/// Default number of orders that must end in each test, see `--telegrams`.
const TELEGRAMS: u64 = 100_000;

/// The options of the command line.
#[derive(Debug, PartialEq, Eq)]
struct Wish {
    protocols: Vec<String>,
    telegrams: u64,
}

/// # Errors
/// If a test cannot be built or a seed fails.
pub(crate) fn run(args: &[String]) -> Outcome {
    let (mut campaign, args) = Campaign::take("faults", args)?;
    let wish = parse(&args)?;
    let protocols = pick::some_or_all(wish.protocols, protocols()?, "fault run for")?;
    for (package, binary, folder) in PLACES {
        let here = pick::stems(folder, PREFIX)?;
        for protocol in protocols.iter().filter(|protocol| here.contains(protocol)) {
            let mut test = cargo(&["test", "--release", "--package", package, "--test", binary, "--", "--nocapture"]);
            test.arg(format!("{PREFIX}{protocol}::"))
                .env("OB1_PART", campaign.part.to_string())
                .env("OB1_TELEGRAMS", campaign.share(wish.telegrams).max(1).to_string());
            let ran = shell::watch(&mut test, is_closing_line).and_then(|closing| count(&closing, protocol));
            campaign.enter(protocol, ran.map(|count| println!("faults: {protocol}: {count}")))?;
        }
    }
    campaign.end()
}

/// The protocols that have a file `faults_*.rs`, by name.
fn protocols() -> Outcome<Vec<String>> {
    let mut all = Vec::new();
    for (_, _, folder) in PLACES {
        all.extend(pick::stems(folder, PREFIX)?);
    }
    Ok(all)
}

fn parse(args: &[String]) -> Outcome<Wish> {
    let number = |text: &str| text.parse::<u64>().ok().filter(|&number| number > 0);
    let (protocols, telegrams) =
        pick::names_and_option(args, "faults", "--telegrams", "a number, e.g. 100000", number)?;
    Ok(Wish { protocols, telegrams: telegrams.unwrap_or(TELEGRAMS) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::failure::Failure;

    #[test]
    fn protocols_and_a_number() {
        let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
        let wish = parse(&words("modbus --telegrams 500 rk512")).expect("all known");
        assert_eq!(wish, Wish { protocols: vec!["modbus".into(), "rk512".into()], telegrams: 500 });
        for wrong in ["--telegrams", "--telegrams none", "--telegrams 0", "--seed 1"] {
            assert!(matches!(parse(&words(wrong)), Err(Failure::Usage(_))), "{wrong}");
        }
        let known = protocols().expect("two folders");
        assert!(["rk512", "dp"].iter().all(|protocol| known.iter().any(|known| known == protocol)), "{known:?}");
        assert!(matches!(run(&words("carrier-pigeon")), Err(Failure::Usage(_))));
    }
}
