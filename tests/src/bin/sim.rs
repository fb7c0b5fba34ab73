//! `cargo xtask sim`: the whole-station simulation, many seeds.

use std::io::Write as _;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use ob1_tests::part::{Part, Tally};
use ob1_tests::sim::{self, SECOND, Scenario};

const HELP: &str = "\
cargo xtask sim [--seeds N] [--from SEED] [--minutes M] [--jobs J]
cargo xtask sim --seed SEED [--minutes M] [--log] [--wire]

Both stations of examples/two-stations in one thread in virtual time, with line faults and driver kills drawn from the seed.

  --seeds N     so many seeds (default 100), beginning at --from (default 1)
  --seed SEED   this one alone
  --minutes M   virtual minutes for each (default 1)
  --jobs J      threads, one simulation each (default: all cores)
  --part I/N    the part I of N of the seeds, for a batch engine
  --json        the last line is the result as JSON, for cargo xtask collect
  --log         print the event log of --seed
  --wire        with every character that arrives

Exit status: 0 passed, 1 a seed failed (printed with the command that replays it), 2 usage.";

struct Args {
    first: u64,
    count: u64,
    minutes: u64,
    jobs: usize,
    log: bool,
    wire: bool,
    part: Part,
    json: bool,
}

fn main() -> ExitCode {
    match parse(std::env::args().skip(1)) {
        Ok(Some(args)) => run(&args),
        Ok(None) => {
            println!("{HELP}");
            ExitCode::SUCCESS
        }
        Err(message) => {
            eprintln!("sim: {message}\n\n{HELP}");
            ExitCode::from(2)
        }
    }
}

fn parse(mut args: impl Iterator<Item = String>) -> Result<Option<Args>, String> {
    let jobs = std::thread::available_parallelism().map_or(1, usize::from);
    let mut parsed =
        Args { first: 1, count: 100, minutes: 1, jobs, log: false, wire: false, part: Part::WHOLE, json: false };
    while let Some(flag) = args.next() {
        let mut number = || args.next().and_then(|v| v.parse::<u64>().ok()).ok_or(format!("{flag} needs a number"));
        match flag.as_str() {
            "--seeds" => parsed.count = number()?,
            "--from" => parsed.first = number()?,
            "--seed" => (parsed.first, parsed.count) = (number()?, 1),
            "--minutes" => parsed.minutes = number()?.max(1),
            "--jobs" => parsed.jobs = number()?.clamp(1, 64) as usize,
            "--part" => parsed.part = args.next().ok_or("--part needs I/N")?.parse()?,
            "--json" => parsed.json = true,
            "--log" => parsed.log = true,
            "--wire" => (parsed.log, parsed.wire) = (true, true),
            "--help" | "-h" => return Ok(None),
            _ => return Err(format!("unknown: {flag}")),
        }
    }
    Ok(Some(parsed))
}

fn scenario(args: &Args, seed: u64) -> Scenario {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/two-stations");
    Scenario { duration: args.minutes * 60 * SECOND, wire: args.wire, ..Scenario::demo(&folder, seed) }
}

fn run(args: &Args) -> ExitCode {
    let options = format!("--seeds {} --from {} --minutes {}", args.count, args.first, args.minutes);
    let tally = Mutex::new(Tally::new("sim", &options, args.part));
    let enter = |seed: u64, shown: Result<&str, &str>| {
        tally.lock().unwrap_or_else(|e| e.into_inner()).enter(&format!("seed {seed}"), shown);
    };
    let (first, count) = args.part.slice(args.first, args.count);
    let start = Instant::now();
    let next = AtomicU64::new(first);
    let (good, kills) = (AtomicU64::new(0), AtomicU64::new(0));
    std::thread::scope(|scope| {
        for _ in 0..args.jobs.min(count.max(1) as usize) {
            scope.spawn(|| {
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed >= first + count {
                        return;
                    }
                    match sim::run(&scenario(args, seed)) {
                        Ok(outcome) => {
                            good.fetch_add(outcome.verdict.get("good"), Ordering::Relaxed);
                            kills.fetch_add(outcome.kills, Ordering::Relaxed);
                            if args.log {
                                // A closed pipe (`| head`) is not an error.
                                let _ = std::io::stdout().write_all(outcome.log.as_bytes());
                            }
                            if outcome.verdict.broken.is_empty() {
                                enter(seed, Ok(&outcome.log));
                            } else {
                                enter(seed, Err(&outcome.verdict.to_string()));
                                eprintln!("seed {seed} FAILED\n{}", outcome.verdict);
                                eprintln!("replay: cargo xtask sim --seed {seed} --minutes {} --log", args.minutes);
                            }
                        }
                        Err(message) => {
                            enter(seed, Err(&message));
                            eprintln!("seed {seed}: {message}");
                        }
                    }
                }
            });
        }
    });
    let wall = start.elapsed().as_secs_f64();
    let simulated = (count * args.minutes * 60) as f64;
    let mut tally = tally.into_inner().unwrap_or_else(|e| e.into_inner());
    let failed = tally.failed.len() as u64;
    let (good, kills) = (good.into_inner(), kills.into_inner());
    tally.count("telegrams came back right", good);
    tally.count("drivers killed", kills);
    println!(
        "{count} seeds of {} simulated minute(s), both stations: {good} telegrams came back right, {kills} drivers killed, \
         {failed} seeds failed",
        args.minutes
    );
    println!(
        "{:.1} s on {} thread(s): {:.0} simulated seconds per second in all, {:.0} per thread",
        wall,
        args.jobs,
        simulated / wall,
        simulated / wall / args.jobs.min(count as usize).max(1) as f64
    );
    println!("{} passed, {failed} failed", count - failed);
    if args.json {
        println!("{}", tally.line());
    }
    if failed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
