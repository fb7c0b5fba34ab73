//! `cargo xtask programs`: programs drawn at random around the handling blocks, many seeds.

use std::collections::BTreeMap;
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use ob1_tests::part::{Part, Tally};
use ob1_tests::programs::{Outcome, SUBJECTS, Subject};

const HELP: &str = "\
cargo xtask programs [CP...] [--seeds N] [--from SEED] [--jobs J] [--rules]
cargo xtask programs CP --seed SEED [--log] [--text]

Programs drawn at random around the handling blocks of each CP (all: one after the other), in virtual time, under a
judge written from the manuals.

  --seeds N     so many programs for each CP (default 200), beginning at --from (default 1)
  --seed SEED   this one alone
  --jobs J      threads (default: all cores)
  --part I/N    the part I of N of the seeds, for a batch engine
  --json        the last line is the result as JSON, for cargo xtask collect
  --rules       at the end: how many programs violate each rule, with the first seeds
  --log         print what happened in --seed
  --text        print its station file and its program

Exit status: 0 passed, 1 a seed failed (printed with the command that replays it), 2 usage.";

struct Args {
    subjects: Vec<&'static Subject>,
    first: u64,
    count: u64,
    jobs: usize,
    rules: bool,
    log: bool,
    text: bool,
    part: Part,
    json: bool,
}

fn main() -> ExitCode {
    match parse(std::env::args().skip(1)) {
        Ok(Some(args)) => {
            let names: Vec<&str> = args.subjects.iter().map(|subject| subject.name).collect();
            let options = format!("{} --seeds {} --from {}", names.join(" "), args.count, args.first);
            let mut tally = Tally::new("programs", &options, args.part);
            args.subjects.iter().for_each(|subject| run(subject, &args, &mut tally));
            if args.json {
                println!("{}", tally.line());
            }
            if tally.failed.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
        }
        Ok(None) => {
            println!("{HELP}");
            ExitCode::SUCCESS
        }
        Err(message) => {
            eprintln!("programs: {message}\n\n{HELP}");
            ExitCode::from(2)
        }
    }
}

fn parse(mut args: impl Iterator<Item = String>) -> Result<Option<Args>, String> {
    let jobs = std::thread::available_parallelism().map_or(1, usize::from);
    let subjects = Vec::new();
    let (part, json) = (Part::WHOLE, false);
    let mut parsed = Args { subjects, first: 1, count: 200, jobs, rules: false, log: false, text: false, part, json };
    while let Some(flag) = args.next() {
        let mut number = || args.next().and_then(|v| v.parse::<u64>().ok()).ok_or(format!("{flag} needs a number"));
        match flag.as_str() {
            "--seeds" => parsed.count = number()?,
            "--from" => parsed.first = number()?,
            "--seed" => (parsed.first, parsed.count) = (number()?, 1),
            "--jobs" => parsed.jobs = number()?.clamp(1, 64) as usize,
            "--part" => parsed.part = args.next().ok_or("--part needs I/N")?.parse()?,
            "--json" => parsed.json = true,
            "--rules" => parsed.rules = true,
            "--log" => parsed.log = true,
            "--text" => parsed.text = true,
            "--help" | "-h" => return Ok(None),
            name => {
                let found = SUBJECTS.iter().find(|subject| subject.name == name);
                parsed.subjects.push(found.ok_or(format!("unknown: {flag}"))?);
            }
        }
    }
    if parsed.subjects.is_empty() {
        parsed.subjects = SUBJECTS.iter().collect();
    }
    Ok(Some(parsed))
}

/// Programs that violate a rule: their number, and the first seeds.
type Rules = BTreeMap<&'static str, (u64, Vec<u64>)>;

struct Sums<'a> {
    tally: &'a mut Tally,
    counts: [u64; 4],
    calls: u64,
    failed: u64,
    rules: Rules,
}

/// Runs the seeds of one CP.
fn run(subject: &Subject, args: &Args, tally: &mut Tally) {
    let start = Instant::now();
    let (first, count) = args.part.slice(args.first, args.count);
    let next = AtomicU64::new(first);
    let sums = Mutex::new(Sums { tally, counts: [0; 4], calls: 0, failed: 0, rules: Rules::new() });
    let jobs = args.jobs.min(count.max(1) as usize);
    std::thread::scope(|scope| {
        for job in 0..jobs {
            let (next, sums) = (&next, &sums);
            scope.spawn(move || {
                let folder = std::env::temp_dir().join(format!("ob1-programs-{}-{job}", std::process::id()));
                if let Err(error) = std::fs::create_dir_all(&folder) {
                    eprintln!("{}: {error}", folder.display());
                    return;
                }
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed >= first + count {
                        break;
                    }
                    let result = (subject.run)(seed, &folder, args.log);
                    if args.text {
                        for name in ["station.toml", "program.awl"] {
                            println!("{}", std::fs::read_to_string(folder.join(name)).unwrap_or_default());
                        }
                    }
                    account(subject, args, seed, result, &mut sums.lock().unwrap_or_else(|e| e.into_inner()));
                }
                // A folder of the system's temporary files may stay.
                let _ = std::fs::remove_dir_all(&folder);
            });
        }
    });
    let sums = sums.into_inner().unwrap_or_else(|e| e.into_inner());
    let wall = start.elapsed().as_secs_f64();
    let [given, done, failed, received] = sums.counts;
    println!(
        "{}: {count} programs, {} calls; {given} orders: {done} done, {failed} ended with error; {received} telegrams received",
        subject.name, sums.calls
    );
    println!(
        "{:.1} s on {jobs} thread(s): {:.0} programs per second, {:.1} ms of a core for each",
        wall,
        count as f64 / wall,
        wall * jobs as f64 * 1000.0 / count.max(1) as f64
    );
    if args.rules {
        for (rule, (count, seeds)) in &sums.rules {
            println!("{count:>7} {rule}: seeds {seeds:?}");
        }
    }
    println!("{} passed, {} failed", count - sums.failed, sums.failed);
}

fn account(subject: &Subject, args: &Args, seed: u64, result: Result<Outcome, String>, sums: &mut Sums<'_>) {
    let replay = || eprintln!("replay: cargo xtask programs {} --seed {seed} --log", subject.name);
    let (shown, why) = match &result {
        Ok(outcome) => {
            let findings = outcome.verdict.findings.iter().map(|finding| format!("{finding}\n")).collect();
            (format!("{} {} {:?}", outcome.calls, outcome.scans, outcome.verdict), findings)
        }
        Err(message) => (String::new(), message.clone()),
    };
    let shown = if why.is_empty() { Ok(shown.as_str()) } else { Err(why.as_str()) };
    sums.tally.enter(&format!("{} seed {seed}", subject.name), shown);
    match result {
        Ok(outcome) => {
            for (sum, count) in sums.counts.iter_mut().zip(outcome.verdict.counts) {
                *sum += count;
            }
            sums.calls += outcome.calls;
            if args.log {
                print!("{}", outcome.log);
            }
            if outcome.verdict.findings.is_empty() {
                return;
            }
            sums.failed += 1;
            let mut rules: Vec<&'static str> = outcome.verdict.findings.iter().map(|f| f.rule).collect();
            rules.dedup();
            for rule in rules {
                let (count, seeds) = sums.rules.entry(rule).or_default();
                *count += 1;
                if seeds.len() < 8 {
                    seeds.push(seed);
                }
            }
            if sums.failed <= 20 {
                eprintln!("{} seed {seed} FAILED", subject.name);
                for finding in &outcome.verdict.findings {
                    eprintln!("  {finding}");
                }
                replay();
            }
        }
        Err(message) => {
            sums.failed += 1;
            let (count, seeds) = sums.rules.entry("cannot be built").or_default();
            *count += 1;
            if seeds.len() < 8 {
                seeds.push(seed);
            }
            if sums.failed <= 20 {
                eprintln!("{} seed {seed}: {message}", subject.name);
                replay();
            }
        }
    }
}
