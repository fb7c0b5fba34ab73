//! `cargo xtask faults [PROTOCOL...] [--telegrams N]`: the fault runs of `driver/protocols/tests/faults_*.rs`, long.
//!
//! `cargo xtask test` runs them too, shorter. A seed that fails is printed with the command that replays it, and belongs into
//! `driver/protocols/tests/seeds` afterwards.

use std::fs;

use crate::cargo::{self, cargo};
use crate::failure::{Failure, Outcome, step};
use crate::shell;

const FOLDER: &str = "driver/protocols/tests";
const PREFIX: &str = "faults_";
/// Orders that must have ended in each test unless `--telegrams` says otherwise.
const TELEGRAMS: u64 = 100_000;

/// What the command line asked for.
#[derive(Debug, PartialEq, Eq)]
struct Wish {
    protocols: Vec<String>,
    telegrams: u64,
}

/// # Errors
/// When a test cannot be built or a seed fails.
pub(crate) fn run(args: &[String]) -> Outcome {
    let wish = parse(args)?;
    let known = protocols()?;
    if let Some(wrong) = wish.protocols.iter().find(|name| !known.contains(name)) {
        return Err(Failure::Usage(format!("no fault run for `{wrong}`; there are: {}", known.join(", "))));
    }
    let mut test = cargo(&["test", "--release", "--package", "ob1-protocols"]);
    for protocol in if wish.protocols.is_empty() { known } else { wish.protocols } {
        test.args(["--test", &format!("{PREFIX}{protocol}")]);
    }
    shell::run(test.args(["--", "--nocapture"]).env("OB1_TELEGRAMS", wish.telegrams.to_string()))
}

/// The files `faults_*.rs`.
fn protocols() -> Outcome<Vec<String>> {
    let folder = cargo::root().join(FOLDER);
    let entries = fs::read_dir(&folder).map_err(|why| step(format!("{}: {why}", folder.display())))?;
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
    let mut names: Vec<String> =
        paths.filter_map(|path| Some(path.file_stem()?.to_str()?.strip_prefix(PREFIX)?.to_owned())).collect();
    names.sort();
    Ok(names)
}

fn parse(args: &[String]) -> Outcome<Wish> {
    let mut wish = Wish { protocols: Vec::new(), telegrams: TELEGRAMS };
    let mut args = args.iter();
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--telegrams" => {
                let number = args.next().and_then(|text| text.parse().ok()).filter(|&number| number > 0);
                wish.telegrams =
                    number.ok_or_else(|| Failure::Usage("--telegrams wants a number, e.g. 100000".into()))?;
            }
            flag if flag.starts_with('-') => return Err(Failure::Usage(format!("faults knows no `{flag}`"))),
            protocol => wish.protocols.push(protocol.to_owned()),
        }
    }
    Ok(wish)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn protocols_and_a_number() {
        let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
        let wish = parse(&words("modbus --telegrams 500 rk512")).expect("all known");
        assert_eq!(wish, Wish { protocols: vec!["modbus".into(), "rk512".into()], telegrams: 500 });
        for wrong in ["--telegrams", "--telegrams none", "--telegrams 0", "--seed 1"] {
            assert!(matches!(parse(&words(wrong)), Err(Failure::Usage(_))), "{wrong}");
        }
        assert!(protocols().expect("a folder").contains(&"rk512".to_owned()));
        assert!(matches!(run(&words("carrier-pigeon")), Err(Failure::Usage(_))));
    }
}
