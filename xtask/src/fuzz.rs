//! `cargo xtask fuzz [TARGET...] [--each 10m]`: the targets of `fuzz/` under libFuzzer.
//!
//! `cargo fuzz run -s none` needs no nightly toolchain: the address sanitizer would need one, but it finds nothing in
//! safe code. The inputs that a run finds are in `fuzz/work`, which git ignores; every test run replays `fuzz/corpus`.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use crate::campaign::Campaign;
use crate::cargo::{self, cargo};
use crate::demo::duration;
use crate::failure::{Outcome, step};
use crate::{pick, shell};

/// Pinned: a new version may build the targets differently.
const CARGO_FUZZ: &str = "0.13.2";
/// Default time for each target, see `--each`.
const EACH: Duration = Duration::from_secs(60);
/// Longer inputs find little and cost much time.
const LONGEST: &str = "-max_len=8192";
/// Seconds after which an input is a failure: the run time must be linear.
const SLOWEST: &str = "-timeout=10";

/// The options of the command line.
#[derive(Debug, PartialEq, Eq)]
struct Wish {
    targets: Vec<String>,
    each: Duration,
}

/// # Errors
/// If a target cannot be built or an input makes it panic; cargo-fuzz names the file with the input.
pub(crate) fn run(args: &[String]) -> Outcome {
    let (mut campaign, args) = Campaign::take("fuzz", args)?;
    let wish = parse(&args)?;
    let targets = pick::some_or_all(wish.targets, targets()?, "fuzz target")?;
    let tool = install()?;
    for target in targets {
        let work = cargo::root().join("fuzz/work").join(&target);
        let corpus = cargo::root().join("fuzz/corpus").join(&target);
        fs::create_dir_all(&work).map_err(|why| step(format!("{}: {why}", work.display())))?;
        let mut fuzz = Command::new(&tool);
        fuzz.args(["fuzz", "run", "--sanitizer", "none", "--target-dir", "fuzz/target", &target])
            .args([&work, &corpus])
            .args(["--", LONGEST, SLOWEST, "-print_final_stats=1"])
            .arg(format!("-max_total_time={}", campaign.share(wish.each.as_secs()).max(1)))
            // Each part of a campaign draws other inputs; 0 is libFuzzer's choice.
            .arg(format!("-seed={}", if campaign.part.of == 1 { 0 } else { campaign.part.number }))
            .args(dictionary(&target))
            .current_dir(cargo::root());
        campaign.enter(&target, shell::run(&mut fuzz))?;
    }
    campaign.end()
}

/// `fuzz/dictionaries/TARGET.txt`: the keywords of the target's language, if it has a dictionary.
fn dictionary(target: &str) -> Option<String> {
    let path = cargo::root().join("fuzz/dictionaries").join(format!("{target}.txt"));
    path.is_file().then(|| format!("-dict={}", path.display()))
}

/// The files of `fuzz/fuzz_targets`.
fn targets() -> Outcome<Vec<String>> {
    pick::stems("fuzz/fuzz_targets", "")
}

/// cargo-fuzz in the checkout's `.tools`, installed if it is missing.
fn install() -> Outcome<std::path::PathBuf> {
    let tool = cargo::root().join(".tools/bin/cargo-fuzz");
    if !is_pinned(&tool) {
        let build = Path::new(".tools/target");
        let version = format!("={CARGO_FUZZ}");
        let words = ["install", "cargo-fuzz", "--version", &version, "--locked", "--root", ".tools", "--target-dir"];
        shell::run(cargo(&words).arg(build))?;
        // Its artifacts are not needed any more; a failure to remove them does not matter.
        let _ = fs::remove_dir_all(cargo::root().join(build));
    }
    Ok(tool)
}

fn is_pinned(tool: &Path) -> bool {
    let output = Command::new(tool).args(["fuzz", "--version"]).output();
    output.is_ok_and(|output| String::from_utf8_lossy(&output.stdout).trim() == format!("cargo-fuzz {CARGO_FUZZ}"))
}

fn parse(args: &[String]) -> Outcome<Wish> {
    let (targets, each) = pick::names_and_option(args, "fuzz", "--each", "a time, e.g. 10m", duration)?;
    Ok(Wish { targets, each: each.unwrap_or(EACH) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::failure::Failure;

    #[test]
    fn targets_and_a_time() {
        let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
        let wish = parse(&words("stl --each 10m ir")).expect("all known");
        assert_eq!(wish, Wish { targets: vec!["stl".into(), "ir".into()], each: Duration::from_secs(600) });
        assert!(matches!(parse(&words("--each")), Err(Failure::Usage(_))));
        assert!(matches!(parse(&words("--forever")), Err(Failure::Usage(_))));
        assert!(targets().expect("a folder").contains(&"stl".to_owned()));
    }
}
