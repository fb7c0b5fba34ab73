//! Campaigns over many machines: what `--part` and `--json` mean for a verb whose units are tests, and
//! `cargo xtask collect`. Verbs whose units are seeds hand both to their program.

#[allow(unreachable_pub, reason = "the tests crate compiles this file, too, and has it public")]
pub(crate) mod part;
pub(crate) mod slurm;

use std::fs;

use part::{Collected, Part, Tally};

use crate::failure::{Failure, Outcome, step};

/// A verb under way, whole or a part of it.
pub(crate) struct Campaign {
    pub(crate) part: Part,
    json: bool,
    tally: Tally,
}

impl Campaign {
    /// Takes `--part I/N` and `--json` from the arguments of a verb; returns the others.
    pub(crate) fn take(verb: &str, args: &[String]) -> Outcome<(Self, Vec<String>)> {
        let (mut part, mut json, mut rest) = (Part::WHOLE, false, Vec::new());
        let mut args = args.iter();
        while let Some(arg) = args.next() {
            match arg.as_str() {
                "--json" => json = true,
                "--part" => {
                    let text = args.next().ok_or_else(|| Failure::Usage("--part wants I/N, e.g. 3/20".into()))?;
                    part = text.parse().map_err(Failure::Usage)?;
                }
                _ => rest.push(arg.clone()),
            }
        }
        let tally = Tally::new(verb, &rest.join(" "), part);
        Ok((Self { part, json, tally }, rest))
    }

    /// How much of something this part has.
    pub(crate) fn share(&self, whole: u64) -> u64 {
        self.part.slice(0, whole).1
    }

    /// Enters the end of a test. With `--json` the next one runs though this one failed.
    pub(crate) fn enter(&mut self, name: &str, ended: Outcome) -> Outcome {
        match &ended {
            Ok(()) => self.tally.enter(name, Ok("")),
            Err(failure) => self.tally.enter(name, Err(&failure.to_string())),
        }
        if self.json && !matches!(ended, Err(Failure::Usage(_))) { Ok(()) } else { ended }
    }

    /// The end of the verb.
    pub(crate) fn end(self) -> Outcome {
        if self.json {
            println!("{}", self.tally.line());
        }
        if self.tally.failed.is_empty() { Ok(()) } else { Err(step(self.tally.to_string())) }
    }
}

/// `cargo xtask collect FILE...`: puts the outputs of the parts of a campaign together.
///
/// # Errors
/// A seed failed, or the parts contradict each other (exit code 1); parts are lost (2).
pub(crate) fn collect(args: &[String]) -> Outcome {
    if args.is_empty() || args.iter().any(|arg| arg.starts_with('-')) {
        return Err(Failure::Usage("collect takes the outputs of the parts, written with --json".into()));
    }
    let read = |name: &String| fs::read(name).map_err(|why| step(format!("{name}: {why}")));
    let outputs: Vec<String> =
        args.iter().map(|name| Ok(String::from_utf8_lossy(&read(name)?).into_owned())).collect::<Outcome<_>>()?;
    let collected = part::collect(outputs.iter().map(String::as_str)).map_err(step)?;
    tell(&collected)
}

fn tell(collected: &Collected) -> Outcome {
    let Collected { all, lost, repeated } = collected;
    let list = |numbers: &[u64]| numbers.iter().map(u64::to_string).collect::<Vec<_>>().join(",");
    println!("{all}");
    if !repeated.is_empty() {
        println!("repeated: {} (the same result each time: counted once)", list(repeated));
    }
    if !lost.is_empty() {
        println!("lost: {}", list(lost));
        return Err(Failure::Program(format!("{} parts are lost: no verdict without them", lost.len()), 2));
    }
    println!("{} passed, {} failed", all.done - all.failed.len() as u64, all.failed.len());
    if all.failed.is_empty() { Ok(()) } else { Err(step("the campaign failed")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_anywhere_and_the_rest_stays() {
        let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
        let (campaign, rest) = Campaign::take("siege", &words("kill --part 3/20 --rounds 100 --json")).expect("known");
        assert_eq!(
            (campaign.part, campaign.json, rest),
            (Part { number: 3, of: 20 }, true, words("kill --rounds 100"))
        );
        assert_eq!(campaign.share(100), 5);
        for wrong in ["--part", "--part 0/3", "kill --part 4/3"] {
            assert!(matches!(Campaign::take("siege", &words(wrong)), Err(Failure::Usage(_))), "{wrong}");
        }
    }

    #[test]
    fn with_json_a_failure_is_entered_and_the_next_one_runs() {
        let words = ["--json".to_owned()];
        let (mut campaign, _) = Campaign::take("faults", &words).expect("known");
        assert!(campaign.enter("modbus", Err(step("seed 5 failed"))).is_ok());
        assert!(campaign.enter("rk512", Ok(())).is_ok());
        assert_eq!((campaign.tally.done, campaign.tally.failed["modbus"].as_str()), (2, "seed 5 failed"));
        assert!(campaign.end().is_err());
        let (mut campaign, _) = Campaign::take("faults", &[]).expect("known");
        assert!(campaign.enter("modbus", Err(step("seed 5 failed"))).is_err());
    }
}
