//! `ob1 driver test`: plays the CPU's side of the back plane against a driver, whatever it is written in, and names the
//! rules that it breaks. docs/driver.md

mod acts;
mod line;
mod registers;
mod rig;
mod rules;
mod starts;
mod watch;

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::time::Instant;

use clap::{Args, Subcommand};
use ob1_host::driver::DriverCommand;
use ob1_params::CpKind;

use crate::exit::TestExit;
use crate::testing::{Failure, FileReport, Outcome, write_junit};
use acts::{ACTS, Act};
use rig::{Breach, Checked, Rig};
pub use rules::Rule;
use starts::STARTS;

/// Acts of a seed besides its first one.
const ACTS_MOST: usize = 4;
/// Test a driver of your own against the rules of docs/driver.md
#[derive(Clone, Debug, Args)]
pub struct DriverArgs {
    #[command(subcommand)]
    what: What,
}

#[derive(Clone, Debug, Subcommand)]
enum What {
    Test(TestArgs),
}

/// Play the CPU's side against a driver, and name the rules that it breaks
///
/// Each seed starts the driver, lets it work and ends it: orders and telegrams of all lengths, kills and stops at the
/// steps of the handshake, a CPU that dies in the middle of a write, full rings, words without meaning. The driver's
/// line is a pty, whose path it gets as "line": "serial:PATH"; its protocol is ASCII with 115200 8N1 and ZVZ 20 ms.
#[derive(Clone, Debug, Args)]
#[command(
    after_help = "Examples:\n  ob1 driver test ./my-driver\n  ob1 driver test ./my-driver --seeds 50 --junit results.xml\n  \
    ob1 driver test ./my-driver --seed 17          the one seed of a report again\n\n\
    Exit codes: 0 every rule was kept, 1 a rule was broken, 2 the driver cannot be started. docs/driver.md"
)]
struct TestArgs {
    /// The driver: a program that is started as the runtime starts it
    program: PathBuf,
    /// The type of the module; the rules about registers are tested with cp240
    #[arg(long, value_name = "TYPE", default_value = CpKind::Cp240.name(), value_parser = kind)]
    cp: CpKind,
    /// How many seeds; the first ones try every start and every act
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u64).range(1..))]
    seeds: u64,
    /// Only this seed; its steps are printed
    #[arg(long, conflicts_with = "seeds")]
    seed: Option<u64>,
    /// Drivers tested at the same time
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u8).range(1..=64))]
    jobs: u8,
    /// End after this many seeds that broke a rule
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..))]
    breaks: u32,
    /// Write the results as JUnit XML: a test case for each rule
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
}

fn kind(name: &str) -> Result<CpKind, String> {
    let found = CpKind::of_name(name).filter(|kind| !kind.row().has_boxes);
    found.ok_or_else(|| "one of cp240, cp040, cp340, cp341".into())
}

/// A broken rule, where it was found.
#[derive(Debug)]
struct Finding {
    rule: Rule,
    seed: u64,
    step: String,
    found: String,
}

/// What all seeds have found.
#[derive(Debug, Default)]
struct Findings {
    broken: Mutex<Vec<Finding>>,
    refused: Mutex<Option<String>>,
    /// No more is wanted.
    enough: AtomicBool,
    steps: AtomicU64,
    next: AtomicU64,
    seeds: AtomicUsize,
}

/// Runs `ob1 driver`.
///
/// # Errors
/// Why the driver cannot be tested, or a report cannot be written.
pub fn driver(args: &DriverArgs) -> Result<TestExit, String> {
    let What::Test(args) = &args.what;
    let program = args.program.canonicalize().map_err(|error| format!("{}: {error}", args.program.display()))?;
    let begun = Instant::now();
    let findings = Findings::default();
    let range = args.seed.map_or(0..args.seeds, |seed| seed..seed + 1);
    findings.next.store(range.start, Ordering::Relaxed);
    std::thread::scope(|scope| {
        for _ in 0..args.jobs {
            scope.spawn(|| work(&findings, &program, args, range.end));
        }
    });
    report(args, &findings, begun.elapsed().as_secs_f64())
}

/// One worker: seed after seed.
fn work(findings: &Findings, program: &Path, args: &TestArgs, end: u64) {
    let name = "test".to_owned();
    let command = DriverCommand {
        name,
        program: program.into(),
        args: vec!["--name".into(), "test".into()],
        env: Vec::new(),
        descriptors: Vec::new(),
    };
    loop {
        let seed = findings.next.fetch_add(1, Ordering::Relaxed);
        if seed >= end || findings.enough.load(Ordering::Relaxed) {
            return;
        }
        let played = Rig::new(&command, args.cp, seed, &findings.enough).and_then(|mut rig| {
            rig.tells = args.seed.is_some();
            let outcome = play(&mut rig, seed);
            findings.steps.fetch_add(rig.steps, Ordering::Relaxed);
            findings.seeds.fetch_add(1, Ordering::Relaxed);
            match outcome {
                Err(Breach::Rule(rule, found)) => {
                    let mut broken = locked(&findings.broken);
                    broken.push(Finding { rule, seed, step: rig.step.clone(), found });
                    findings.enough.fetch_or(broken.len() >= args.breaks as usize, Ordering::Relaxed);
                    Ok(())
                }
                other => other,
            }
        });
        if let Err(Breach::System(text)) = played {
            *locked(&findings.refused) = Some(text);
            findings.enough.store(true, Ordering::Relaxed);
        }
    }
}

fn locked<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// One seed: a start, acts, an end. The first seeds take each start and each act in turn.
fn play(rig: &mut Rig<'_>, seed: u64) -> Checked {
    let is_cp240 = rig.kind == CpKind::Cp240;
    let acts: Vec<&Act> = ACTS.iter().filter(|act| is_cp240 || !act.registers).collect();
    let turn = usize::try_from(seed).unwrap_or(usize::MAX);
    let (name, start) = STARTS[turn % STARTS.len()];
    rig.step(name);
    start(rig)?;
    let more = rig.rng.usize(..=ACTS_MOST);
    let mut played = vec![acts[turn % acts.len()]];
    played.extend((0..more).map(|_| acts[rig.rng.usize(..acts.len())]));
    for act in played {
        rig.step(act.name);
        (act.play)(rig)?;
        rig.events()?;
        if is_cp240 {
            rig.balance()?;
        }
    }
    rig.step("the end");
    if is_cp240 {
        rig.line_is_silent(Rule::Sends)?;
    }
    let by_signal = rig.rng.bool();
    if rig.rng.bool() {
        rig.ring();
    }
    rig.end(if by_signal { Rule::Terminate } else { Rule::EndOfFile })
}

fn report(args: &TestArgs, findings: &Findings, seconds: f64) -> Result<TestExit, String> {
    if let Some(text) = &*locked(&findings.refused) {
        return Err(format!("{}: {text}", args.program.display()));
    }
    let mut broken = locked(&findings.broken);
    broken.sort_by_key(|finding| (finding.rule, finding.seed));
    let tested: Vec<Rule> = Rule::ALL.iter().copied().filter(|rule| is_tested(*rule, args.cp)).collect();
    for (index, finding) in broken.iter().enumerate() {
        if index == 0 || broken[index - 1].rule != finding.rule {
            say!("{} is broken: {}", finding.rule.number(), finding.rule.text());
        }
        say!("  seed {}, {}: {}", finding.seed, finding.step, finding.found);
    }
    let (seeds, steps) = (findings.seeds.load(Ordering::Relaxed), findings.steps.load(Ordering::Relaxed));
    let mut rules: Vec<Rule> = broken.iter().map(|finding| finding.rule).collect();
    rules.dedup();
    let verdict = match rules.len() {
        0 => "all kept".to_owned(),
        n => format!("{n} broken"),
    };
    say!("{} rules, {seeds} seeds, {steps} steps in {seconds:.0} s: {verdict}", tested.len());
    if tested.len() < Rule::ALL.len() {
        say!("The rules about the registers of a CP 240 were not tested: the module is a {}.", args.cp.row().text);
    }
    if let Some(first) = broken.first() {
        say!("Again: ob1 driver test {} --cp {} --seed {}", args.program.display(), args.cp.name(), first.seed);
    }
    if let Some(path) = &args.junit {
        write_junit(path, &[as_tests(args, &tested, &broken, seconds)])?;
    }
    Ok(if broken.is_empty() { TestExit::Passed } else { TestExit::Failed })
}

/// Rules that only the answers of a CP 240 show are not tested with another module.
fn is_tested(rule: Rule, kind: CpKind) -> bool {
    let by_answers = [Rule::Torn, Rule::Restarts, Rule::Announces, Rule::Prompt];
    kind == CpKind::Cp240 || !rule.is_of_cp240() && !by_answers.contains(&rule)
}

/// The verdict as a suite of tests, one for each rule.
fn as_tests(args: &TestArgs, tested: &[Rule], broken: &[Finding], seconds: f64) -> FileReport {
    let outcomes = tested.iter().map(|rule| {
        let of_it = broken.iter().filter(|finding| finding.rule == *rule);
        let failures = of_it.map(|f| Failure { line: None, text: format!("seed {}, {}: {}", f.seed, f.step, f.found) });
        Outcome {
            name: format!("{} {}", rule.number(), rule.text()),
            failures: failures.collect(),
            plc_seconds: 0.0,
            wall_seconds: seconds / tested.len() as f64,
        }
    });
    FileReport { file: args.program.display().to_string(), refused: Vec::new(), outcomes: outcomes.collect() }
}
