//! Holds the SCL compiler against Siemens' own: every source of the sample releases compiles, and each block gives the
//! same as the machine code beside it. `cargo xtask oscat` says how; `docs/scl.md` has the figures.
#![allow(clippy::print_stdout, reason = "its output")]
#![allow(missing_docs, unreachable_pub, reason = "a program")]

mod exceptions;
mod judge;
mod samples;
mod speed;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use ob1_model::{BlockId, BlockKind};
use ob1_stl::{Options, Severity, Source};

use exceptions::Exceptions;
use judge::{Pair, Verdict};
use samples::Release;

const USAGE: &str = "usage: oscat [--release 3.11] [--calls 1000] [--block NAME] [--show] [--compile] [--speed]";
/// Where the archive lies when nothing else is said: beside the checkout.
const BESIDE: &str = "../oscat-libs-archive/OSCAT_BASIC_LIB/ARCHIVE";
/// The releases whose blocks are called when nothing else is said; those before 3.11 have the option of the OK flag.
const JUDGED: [&str; 4] = ["260", "274", "301", "311"];
/// Calls of a block on the list of exceptions: so many are needed to see that it differs.
const OF_EXCEPTIONS: u32 = 10_000;

struct Wish {
    /// Digits of a release; all: each compiles, the usual ones are called.
    release: Option<String>,
    calls: u32,
    block: Option<String>,
    /// Shows the statements of both.
    show: bool,
    /// Measures native code instead.
    speed: bool,
}

fn wish() -> Option<Wish> {
    let mut wish = Wish { release: None, calls: 1000, block: None, show: false, speed: false };
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--release" => wish.release = Some(args.next()?.chars().filter(char::is_ascii_digit).collect()),
            "--calls" => wish.calls = args.next()?.parse().ok()?,
            "--block" => wish.block = Some(args.next()?),
            "--show" => wish.show = true,
            "--speed" => wish.speed = true,
            "--compile" => wish.calls = 0,
            _ => return None,
        }
    }
    Some(wish)
}

fn main() -> ExitCode {
    let Some(wish) = wish() else {
        println!("{USAGE}");
        return ExitCode::from(2);
    };
    let named = std::env::var_os("OB1_STEP7_PROJECTS").map(PathBuf::from);
    let folder = named.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(BESIDE));
    let archives = samples::archives(&folder);
    if archives.is_empty() {
        println!("skipped: the samples lie neither in OB1_STEP7_PROJECTS nor beside the checkout ({BESIDE})");
        return ExitCode::SUCCESS;
    }
    let mut exceptions = Exceptions::read();
    let mut distinct: BTreeSet<Vec<u8>> = BTreeSet::new();
    let (mut good, mut failures) = (0, 0);
    for path in archives {
        let digits = samples::digits(&path);
        if wish.release.as_ref().is_some_and(|wanted| *wanted != digits) {
            continue;
        }
        let called = wish.calls > 0 && (wish.release.is_some() || JUDGED.contains(&digits.as_str()));
        for release in samples::read(&path) {
            let (program, compiled, wrong) = compile(&release, &mut exceptions, &mut distinct);
            good += compiled;
            failures += wrong;
            if wish.speed {
                measure(&release, &program, &wish);
            } else if called {
                failures += equality(&release, &program, &wish, &mut exceptions);
            }
        }
    }
    println!("distinct sources: {good} of {} compile", distinct.len());
    if wish.block.is_none() {
        failures += exceptions.check();
    }
    if failures == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Compiles the sources of a release as one program. Gives it, how many sources not seen before are good, and how many
/// failures there are.
fn compile(
    release: &Release,
    exceptions: &mut Exceptions,
    distinct: &mut BTreeSet<Vec<u8>>,
) -> (ob1_ir::Program, usize, usize) {
    let mut sources: Vec<Source> = release.scl.iter().map(|(_, s)| s.clone()).collect();
    let count = sources.len();
    sources.extend(release.rest.iter().cloned());
    let began = std::time::Instant::now();
    let (output, bad) = one_program(release, &sources, true);
    let took = began.elapsed().as_secs_f64();
    let lines: usize = sources.iter().map(|s| s.bytes.iter().filter(|b| **b == b'\n').count()).sum();
    let (mut good, mut failures) = (0, 0);
    let mut judge = |source: &Source, is_bad: bool| {
        let known = exceptions.source(&source.name, &release.digits, is_bad);
        failures += usize::from(is_bad && !known);
        if is_bad && !known {
            println!("  {} does not compile", source.name);
        }
        let text = source.bytes.strip_prefix(ob1_project::OK_FLAG.as_bytes()).unwrap_or(&source.bytes);
        if distinct.insert(text.to_vec()) {
            good += usize::from(!is_bad);
        }
    };
    for (at, (_, source)) in release.scl.iter().enumerate() {
        judge(source, bad.contains(&at));
    }
    // A block has a second source: it takes the place of the first.
    for (first, source) in &release.second {
        let mut other = sources.clone();
        other[*first] = source.clone();
        judge(source, one_program(release, &other, false).1.contains(first));
    }
    let (ours, theirs) = (output.program.blocks.len(), release.reference.blocks.len());
    let wrong = bad.iter().filter(|at| **at < count).count();
    let all = count + release.second.len();
    println!("{}: {all} SCL sources, {wrong} with errors; {ours} of {theirs} blocks", release.name);
    println!("  {lines} lines in {:.1} ms, {:.0} a second", took * 1e3, lines as f64 / took);
    let external = |id| release.library.get(id).map(|b| &b.interface);
    // Where a source does not compile, others lack its block.
    for program in [&release.reference, &output.program].into_iter().take(if bad.is_empty() { 2 } else { 1 }) {
        let Err(defects) = ob1_ir::verify(program, &external) else { continue };
        failures += 1;
        for defect in defects.iter().take(20) {
            println!("  defect: {defect}");
        }
    }
    (output.program, good, failures)
}

/// Compiles sources; gives those with errors, by their index.
fn one_program(release: &Release, sources: &[Source], shown: bool) -> (ob1_stl::Output, BTreeSet<usize>) {
    let mnemonics = ob1_stl::Mnemonics::International;
    let options = Options { symbols: release.symbols.clone(), mnemonics, ..Options::default() };
    let output = ob1_scl::compile(sources, &release.library, &options);
    let mut bad = BTreeSet::new();
    for (at, d) in output.diagnostics.iter().filter(|d| d.severity == Severity::Error).enumerate() {
        bad.extend(d.sources());
        if at < 10 && shown {
            print!("{}", ob1_stl::render(d, &sources[d.source]));
        }
    }
    (output, bad)
}

/// The blocks of a release that are asked for, with the names of their sources.
fn blocks<'r>(release: &'r Release, wish: &'r Wish) -> impl Iterator<Item = (BlockId, &'r Source, &'r str)> {
    let all = release.scl.iter().filter_map(|(id, source)| Some(((*id)?, source)));
    let named = all.map(|(id, source)| (id, source, source.name.trim_end_matches(".scl")));
    let asked = |name: &str| wish.block.as_ref().is_none_or(|only| name.eq_ignore_ascii_case(only));
    named.filter(move |(id, _, name)| id.kind != BlockKind::Db && asked(name))
}

/// Native code of both.
fn measure(release: &Release, ours: &ob1_ir::Program, wish: &Wish) {
    let mut ratios = Vec::new();
    for (id, _, name) in blocks(release, wish) {
        let ratio = Pair::new(&release.reference, ours, id, &release.replaced).ok().and_then(|pair| pair.ratio());
        if let Some(ratio) = ratio {
            ratios.push((ratio, name));
        }
    }
    ratios.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (ratio, name) in ratios.iter().rev().take(10) {
        println!("  {name}: {ratio:.2}");
    }
    let all: Vec<f64> = ratios.iter().map(|r| r.0).collect();
    println!("{}: {} blocks, native code of ours for one of theirs: {:.3}", release.name, all.len(), speed::mean(&all));
}

/// Calls each function and function block of a release. Gives the failures.
fn equality(release: &Release, ours: &ob1_ir::Program, wish: &Wish, exceptions: &mut Exceptions) -> usize {
    let (mut equal, mut listed, mut different, mut left) = (0, 0, 0, 0);
    for (id, source, name) in blocks(release, wish) {
        let reason = exceptions.reason(name, &release.digits);
        let calls = if reason.is_some() { wish.calls.max(OF_EXCEPTIONS) } else { wish.calls };
        let verdict = match Pair::new(&release.reference, ours, id, &release.replaced) {
            Ok(pair) => {
                if wish.show {
                    println!("{}\n{}", source.text(), pair.listing());
                }
                pair.judge(calls)
            }
            Err(why) => Verdict::Left(why),
        };
        let (said, what) = match verdict {
            Verdict::Equal(made) => {
                equal += 1;
                if made < calls {
                    println!("  {id} {name}: endless calls, {made} calls made");
                }
                continue;
            }
            Verdict::Differs(call, what) => (format!("call {call}"), what),
            Verdict::Left(why) if why == judge::NO_MACHINE_CODE => {
                left += 1;
                println!("  {id} {name}: {why}");
                continue;
            }
            Verdict::Left(why) => ("left out".to_owned(), why),
        };
        let is_left = said == "left out";
        left += usize::from(is_left);
        match reason {
            Some(_) => {
                listed += usize::from(!is_left);
                exceptions.seen(name, &release.digits);
            }
            None => different += 1,
        }
        let mark = if reason.is_some() { "listed" } else { "NOT LISTED" };
        println!("  {id} {name}: {said}, {mark}: {what}");
    }
    println!(
        "{}: {equal} equal, {listed} differ as listed, {left} left out, {different} not on the list",
        release.name
    );
    different
}
