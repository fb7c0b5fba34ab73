//! What program status costs: a program of 100,000 statements in machine code, without a job and with two jobs of 30
//! statements at 10 Hz. The execution time of each scan is taken; rounds alternate.

use std::sync::atomic::AtomicU64;
use std::time::Instant;

use ob1_cpu::{Command, Cpu, CpuConfig, Job, Link, Mark, OperatingState, PassJob, Window};
use ob1_model::{BlockId, PASS_JOBS, PassEnd, PassOrder};
use ob1_native::{AtLoad, Tier};
use ob1_rt::MonotonicClock;
use ob1_stl::{Library, Options, Source};
use ob1_time::Span;

use super::peer::Failure;
use super::{Figure, compile, median};

const STATEMENTS: usize = 100_000;
/// Watched statements of a job.
const LINES: u32 = 30;
const ROUNDS: usize = 7;
/// Time of a round.
const ROUND: Span = Span::from_secs(3);
/// How much longer the 99th percentile of a scan may be with jobs.
const MOST: f64 = 1.05;

struct NoWindow;

impl Window for NoWindow {
    fn put(&mut self, _: Mark, _: &mut dyn FnMut(&[AtomicU64])) {}
}

struct Bench {
    cpu: Cpu,
    link: Link,
    clock: MonotonicClock,
    /// A small block that runs in each scan.
    block: BlockId,
    /// Jobs at the CPU; those of a round come back in the next one.
    under_way: usize,
}

impl Bench {
    fn new() -> Result<Self, Failure> {
        let (text, symbols) = compile::program(STATEMENTS);
        let options = Options { symbols, ..Options::default() };
        let output = ob1_stl::compile(&[Source::new("generated.awl", text.into_bytes())], &Library::new(), &options);
        let config = CpuConfig { watchdog: Span::ZERO, ..CpuConfig::default() };
        let cpu = Cpu::new(config, &output.program, Vec::new(), Vec::new(), &AtLoad(Tier::Optimised));
        let mut cpu = cpu.map_err(|why| format!("{why:?}"))?;
        let small = cpu.plan().blocks.iter().filter(|block| block.ops.len() > LINES as usize && !block.loops);
        let block = small.min_by_key(|block| block.ops.len()).ok_or("no block is long enough")?.id;
        let link = cpu.link(Box::new(NoWindow)).ok_or("no room for a link")?;
        cpu.request(Command::Run);
        Ok(Self { cpu, link, clock: MonotonicClock::start(), block, under_way: 0 })
    }

    /// The 99th percentile of a scan in nanoseconds, and the passes that were seen.
    fn round(&mut self, watches: bool) -> Result<(f64, usize), Failure> {
        let (mut times, mut passes) = (Vec::new(), 0);
        let began = self.clock.time();
        while self.clock.time().since(began) < ROUND {
            while let Some(returned) = self.link.take() {
                if let Job::Pass(job) = returned {
                    self.under_way -= 1;
                    passes += usize::from(job.pass().end == PassEnd::Whole);
                }
            }
            // The CPU makes no more than ten passes a second for each.
            while watches && self.under_way < PASS_JOBS {
                let wait = Span::from_secs(1).nanos();
                let order =
                    PassOrder { block: self.block, from: None, db: 0, first: 0, count: LINES, wait, before: false };
                self.link.hand(PassJob::new(1, order)).map_err(|why| format!("{why:?}"))?;
                self.under_way += 1;
            }
            let from = Instant::now();
            if self.cpu.cycle(&mut self.clock).state != OperatingState::Run {
                return Err("the CPU is in STOP".into());
            }
            times.push(from.elapsed().as_nanos() as f64);
        }
        times.sort_by(f64::total_cmp);
        Ok((times[times.len() * 99 / 100], passes))
    }
}

/// # Errors
/// The program cannot be made or run.
pub fn measure() -> Result<Vec<Figure>, Failure> {
    let mut bench = Bench::new()?;
    bench.round(false)?;
    let (mut idle, mut again, mut watched, mut passes) = (Vec::new(), Vec::new(), Vec::new(), 0);
    for _ in 0..ROUNDS {
        idle.push(bench.round(false)?.0);
        let (time, seen) = bench.round(true)?;
        watched.push(time);
        passes += seen;
        // Jobs of the round before come back.
        again.push(bench.round(false)?.0);
    }
    let per_second = passes as f64 / ROUNDS as f64 / ROUND.secs() as f64;
    let (idle, again, watched) = (median(&mut idle), median(&mut again), median(&mut watched));
    let figure = |what: &'static str, value, aim| Figure {
        what: what.into(),
        value,
        unit: "ns",
        floor: Some(("no job", idle)),
        aim,
    };
    Ok(vec![
        figure("p99 of a scan, 100,000 statements, no job", again, ("", true)),
        figure(
            "the same, two jobs of 30 statements at 10 Hz",
            watched,
            ("<= 1.05 x", watched <= MOST * idle.max(again)),
        ),
        Figure {
            what: "passes seen a second".into(),
            value: per_second,
            unit: "",
            floor: None,
            aim: (">= 10", per_second >= 10.0),
        },
    ])
}
