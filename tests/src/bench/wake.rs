//! Our wake-up latency compared with cyclictest: same interval, priority and settings, in triples (ours, cyclictest,
//! cyclictest) of changing order, which also shows the variation between two runs of cyclictest. The three runs of a
//! triple are interleaved in slices, so that a disturbance of the machine affects all of them. The machine may be
//! shared, so the maximum is not checked.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::median;
use super::peer::Failure;

/// SCHED_FIFO priority of both.
const PRIORITY: u8 = 80;
/// Upper end of the histograms in nanoseconds, for cyclictest and for our measurement.
const LONGEST: u64 = 1_000_000;
/// Intervals in microseconds, and whether the 99.9th percentile is checked.
const INTERVALS: [(u64, bool); 2] = [(1000, false), (250, true)];
/// Maximum ratio of our 99th and 99.9th percentile to those of cyclictest.
const LIMITS: [f64; 2] = [1.15, 1.5];
/// Minimum triples and seconds for a meaningful comparison.
const ENOUGH: (usize, u64) = (9, 15);
/// Seconds of a slice.
const SLICE: u64 = 3;

/// The extent of the measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Triples at each interval.
    pub triples: usize,
    /// Seconds of each run, in whole slices.
    pub seconds: u64,
}

impl Default for Plan {
    fn default() -> Self {
        Self { triples: ENOUGH.0, seconds: ENOUGH.1 }
    }
}

/// The result of a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// Within the limit.
    Passed,
    /// Beyond the limit but within the noise, or measured too briefly: run longer.
    Inconclusive,
    /// Beyond the limit and beyond the noise.
    Failed,
}

/// Wake-up latencies in nanoseconds: value and count, ascending.
type Latencies = Vec<(u64, u64)>;

/// Adds the values of a slice.
fn add(run: &mut BTreeMap<u64, u64>, slice: &Latencies) {
    for (value, count) in slice {
        *run.entry(*value).or_default() += count;
    }
}

fn percentile(latencies: &Latencies, share: f64) -> f64 {
    let all: u64 = latencies.iter().map(|(_, count)| count).sum();
    let wanted = (share * all as f64).ceil() as u64;
    let mut seen = 0;
    for (value, count) in latencies {
        seen += count;
        if seen >= wanted {
            return (*value).min(LONGEST) as f64;
        }
    }
    0.0
}

/// The ratios of one percentile: ours to the geometric mean of the two cyclictest runs, and these two to each other.
#[derive(Debug, Default)]
pub(super) struct Ratios {
    ours: Vec<f64>,
    noise: Vec<f64>,
    /// Triples in which one of the three is beyond the histogram: these cannot be compared.
    censored: usize,
}

impl Ratios {
    pub(super) fn enter(&mut self, ours: f64, others: [f64; 2]) {
        self.censored += usize::from([ours, others[0], others[1]].iter().any(|value| *value >= LONGEST as f64));
        let [a, b] = others.map(|value| value.max(1.0));
        self.ours.push(ours.max(1.0) / (a * b).sqrt());
        self.noise.push(a.max(b) / a.min(b));
    }

    /// The summary of all ratios.
    pub(super) fn figures(&self) -> Figures {
        let mut noise = self.noise.clone();
        noise.sort_by(f64::total_cmp);
        let noise = noise.get((noise.len() * 3) / 4).or(noise.last()).copied().unwrap_or(1.0);
        let mut ours = self.ours.clone();
        let ratio = median(&mut ours);
        let at_most = ours.len().checked_sub(sign_test_rank(ours.len())).and_then(|at| ours.get(at)).copied();
        Figures { ratio, at_most: at_most.unwrap_or(f64::INFINITY), noise }
    }
}

/// Ratios of one percentile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Figures {
    /// Median of the ratio of ours to cyclictest.
    pub(super) ratio: f64,
    /// The upper end of the median's 95 % interval; infinite with less than six ratios.
    pub(super) at_most: f64,
    /// Upper quartile of the ratio of the two cyclictest runs.
    pub(super) noise: f64,
}

impl Figures {
    /// Compares the ratio with its limit and the noise.
    pub(super) fn judge(self, limit: f64, enough: bool) -> Verdict {
        match () {
            () if !enough => Verdict::Inconclusive,
            () if self.ratio > limit.max(self.noise) => Verdict::Failed,
            () if self.ratio > limit => Verdict::Inconclusive,
            () => Verdict::Passed,
        }
    }
}

/// The largest rank, counted from either end, whose value bounds the median of this many values with 97.5 %: the sign
/// test. 0: none.
fn sign_test_rank(values: usize) -> usize {
    let (mut share, mut beyond) = (0.5_f64.powi(i32::try_from(values).unwrap_or(i32::MAX)), 0.0);
    for rank in 0..values {
        // The probability that exactly `rank` values are below.
        beyond += share;
        if beyond > 0.025 {
            return rank;
        }
        share *= (values - rank) as f64 / (rank + 1) as f64;
    }
    0
}

/// Measures and prints; returns the worst verdict.
///
/// # Errors
/// If one of the two cannot be run.
pub fn compare(plan: Plan) -> Result<Verdict, Failure> {
    let cyclictest = cyclictest()?;
    let core = std::thread::available_parallelism().map_or(0, |n| n.get() - 1);
    let folder = std::env::temp_dir().join(format!("ob1-bench-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let bench = Bench { cyclictest, folder: folder.clone(), core, slices: plan.seconds.div_ceil(SLICE) };
    let enough = plan.triples >= ENOUGH.0 && plan.seconds >= ENOUGH.1;
    println!(
        "wake-up latency beside cyclictest: {} triples of {} s in slices of {SLICE} s, SCHED_FIFO {PRIORITY} on core {core}; µs",
        plan.triples, plan.seconds
    );
    let mut worst = Verdict::Passed;
    for (interval, judged) in INTERVALS {
        let verdicts = bench.interval(interval, plan.triples, enough)?;
        worst = worst.max(verdicts[0]);
        if judged {
            worst = worst.max(verdicts[1]);
        }
    }
    let _ = std::fs::remove_dir_all(folder);
    match worst {
        Verdict::Passed => println!("passed"),
        Verdict::Failed => println!("failed"),
        Verdict::Inconclusive if enough => println!("inconclusive: the machine is too noisy for this; run longer"),
        Verdict::Inconclusive => println!(
            "inconclusive: a verdict needs --triples {} --seconds {} at least, or a quieter machine",
            ENOUGH.0, ENOUGH.1
        ),
    }
    Ok(worst)
}

struct Bench {
    cyclictest: PathBuf,
    folder: PathBuf,
    core: usize,
    /// Slices of a run.
    slices: u64,
}

impl Bench {
    fn interval(&self, interval: u64, triples: usize, enough: bool) -> Result<[Verdict; 2], Failure> {
        println!(
            "interval {interval} µs      ours: p50      p99    p99.9   cyclictest: p50      p99    p99.9   again: p50      p99    p99.9"
        );
        let mut ratios = [Ratios::default(), Ratios::default()];
        for triple in 0..triples {
            let mut runs: [BTreeMap<u64, u64>; 3] = Default::default();
            for slice in 0..usize::try_from(self.slices)? {
                // Our run is first, second and third in turn.
                for place in 0..3 {
                    let who = (place + triple + slice) % 3;
                    let latencies = if who == 0 { self.ours(interval)? } else { self.theirs(interval)? };
                    add(&mut runs[who], &latencies);
                }
            }
            let [ours, a, b] = runs.map(|run| run.into_iter().collect::<Latencies>());
            let mut line = format!("{:<14}", format!("triple {}", triple + 1));
            for run in [&ours, &a, &b] {
                let [p50, p99, p999] = [0.5, 0.99, 0.999].map(|share| percentile(run, share) / 1000.0);
                let _ = write!(line, "  {p50:>11.2} {p99:>8.2} {p999:>8.2}");
            }
            println!("{line}");
            for (ratios, share) in ratios.iter_mut().zip([0.99, 0.999]) {
                ratios.enter(percentile(&ours, share), [percentile(&a, share), percentile(&b, share)]);
            }
        }
        let mut verdicts = [Verdict::Passed; 2];
        for (i, name) in ["p99", "p99.9"].into_iter().enumerate() {
            let figures = ratios[i].figures();
            let enough = enough && ratios[i].censored * 3 <= triples;
            verdicts[i] = figures.judge(LIMITS[i], enough);
            let judged = i == 0 || INTERVALS.contains(&(interval, true));
            let verdict = if judged { format!("{:?}", verdicts[i]).to_lowercase() } else { "not judged here".into() };
            println!(
                "  {name:<6} x {:.3} of cyclictest, with 97.5 % at most {:.3} (aim {:.2}); cyclictest against itself, upper quartile, x {:.3}: {verdict}",
                figures.ratio, figures.at_most, LIMITS[i], figures.noise
            );
        }
        Ok(verdicts)
    }

    /// A station with an empty OB 1: one value for each scan, from its deadline to its start.
    fn ours(&self, interval: u64) -> Result<Latencies, Failure> {
        let (station, report) = (self.folder.join("station.toml"), self.folder.join("report.json"));
        let pid = std::process::id();
        let text = format!(
            "[station]\nname = \"bench-{pid}\"\n[cpu]\nmin_cycle = \"{interval}us\"\nmissed = \"skip\"\n[cpu.realtime]\n\
             priority = {PRIORITY}\naffinity = [{}]\nlock_memory = true\nkeep_awake = true\n[program]\nsources = [\"empty.awl\"]\n",
            self.core
        );
        std::fs::write(&station, text)?;
        std::fs::write(self.folder.join("empty.awl"), "ORGANIZATION_BLOCK OB 1\nBEGIN\nEND_ORGANIZATION_BLOCK\n")?;
        let bin = std::env::var_os("OB1_BIN_DIR").ok_or("OB1_BIN_DIR is not set; run: cargo xtask bench scan")?;
        let mut command = Command::new(Path::new(&bin).join("ob1"));
        command.arg("run").arg(&station).args(["--quiet", "--for", &format!("{SLICE}s"), "--report"]).arg(&report);
        ended_well(command.stdin(Stdio::null()))?;
        let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&report)?)?;
        let refused = report["posture"].as_array().is_some_and(|all| all.iter().any(|g| g["outcome"] == "refused"));
        if refused {
            return Err("the posture was refused: run it as root, as cyclictest has to be".into());
        }
        let buckets = report["timing"]["wake"]["buckets"].as_array().ok_or("a report without buckets")?;
        let pair = |bucket: &serde_json::Value| Some((bucket[0].as_u64()?, bucket[1].as_u64()?));
        Ok(buckets.iter().filter_map(pair).collect())
    }

    /// cyclictest with the same settings: memory locked, timer slack of a real-time thread, `/dev/cpu_dma_latency` at
    /// 0.
    fn theirs(&self, interval: u64) -> Result<Latencies, Failure> {
        let file = self.folder.join("histogram");
        let mut command = Command::new(&self.cyclictest);
        command
            .args(["--mlockall", "--threads=1", "--quiet", "--nsecs"])
            .arg(format!("--priority={PRIORITY}"))
            .arg(format!("--interval={interval}"))
            .arg(format!("--affinity={}", self.core))
            .arg(format!("--duration={SLICE}"))
            .arg(format!("--histogram={LONGEST}"))
            .arg(format!("--histfile={}", file.display()))
            .stdout(Stdio::null());
        ended_well(&mut command)?;
        Ok(histogram(&std::fs::read_to_string(&file)?))
    }
}

fn ended_well(command: &mut Command) -> Result<(), Failure> {
    let name = command.get_program().to_string_lossy().into_owned();
    let output = command.stderr(Stdio::piped()).output().map_err(|error| format!("{name}: {error}"))?;
    if output.status.success() {
        return Ok(());
    }
    Err(format!("{name} ended with {}: {}", output.status, String::from_utf8_lossy(&output.stderr)).into())
}

/// Parses lines of value and count.
fn histogram(text: &str) -> Latencies {
    let mut latencies: Latencies = text
        .lines()
        .filter(|line| !line.starts_with('#'))
        .filter_map(|line| {
            let mut figures = line.split_whitespace().map(str::parse::<u64>);
            Some((figures.next()?.ok()?, figures.next()?.ok()?))
        })
        .filter(|(_, count)| *count > 0)
        .collect();
    let beyond = text.lines().find_map(|line| line.strip_prefix("# Histogram Overflows:")?.trim().parse().ok());
    latencies.extend(beyond.filter(|count| *count > 0).map(|count| (LONGEST, count)));
    latencies
}

/// cyclictest, installed with the package manager if allowed.
fn cyclictest() -> Result<PathBuf, Failure> {
    let find = || {
        let path = std::env::var_os("PATH").unwrap_or_default();
        let mut folders: Vec<PathBuf> = std::env::split_paths(&path).collect();
        folders.extend(["/usr/bin", "/usr/sbin", "/usr/local/bin"].map(PathBuf::from));
        folders.into_iter().map(|folder| folder.join("cyclictest")).find(|program| program.is_file())
    };
    if let Some(program) = find() {
        return Ok(program);
    }
    println!("cyclictest is not there: apt-get install rt-tests");
    let _ = Command::new("apt-get").args(["install", "--yes", "--quiet", "rt-tests"]).stdout(Stdio::null()).status();
    find().ok_or_else(|| "cyclictest is not there; as root: apt-get install rt-tests".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_histogram_is_read_with_what_lies_beyond() {
        let text =
            "# Histogram\n000000 000000\n001500 000090\n002000 000009\n# Total: 000100\n# Histogram Overflows: 00001\n";
        let read = histogram(text);
        assert_eq!(read, [(1500, 90), (2000, 9), (LONGEST, 1)]);
        assert_eq!(
            [0.5, 0.9, 0.91, 0.99, 0.999].map(|share| percentile(&read, share)),
            [1500.0, 1500.0, 2000.0, 2000.0, 1e6]
        );
        assert_eq!(percentile(&Vec::new(), 0.5), 0.0);
    }

    #[test]
    fn slices_are_added() {
        let mut run = BTreeMap::new();
        add(&mut run, &vec![(10, 1), (20, 2)]);
        add(&mut run, &vec![(15, 3), (20, 4)]);
        assert_eq!(run.into_iter().collect::<Latencies>(), [(10, 1), (15, 3), (20, 6)]);
    }

    #[test]
    fn the_median_lies_between_ranks_of_the_sign_test() {
        // Tables of the sign test, 5 % two-sided.
        for (values, rank) in [(0, 0), (5, 0), (6, 1), (8, 1), (9, 2), (11, 2), (12, 3), (15, 4), (20, 6), (25, 8)] {
            assert_eq!(sign_test_rank(values), rank, "{values}");
        }
        let mut ratios = Ratios::default();
        for ours in [7.0, 1.0, 2.0, 3.0, 9.0, 8.0, 4.0, 6.0, 5.0] {
            ratios.enter(ours, [1.0, 1.0]);
        }
        assert_eq!(ratios.figures(), Figures { ratio: 5.0, at_most: 8.0, noise: 1.0 });
    }

    #[test]
    fn failed_is_beyond_limit_and_noise_passed_is_within_the_limit() {
        use Verdict::*;
        for (ratio, at_most, noise, enough, verdict) in [
            (1.0, 1.1, 1.05, true, Passed),
            (1.15, 1.2, 6.0, true, Passed),
            (1.2, 1.3, 1.3, true, Inconclusive),
            (1.4, 1.5, 1.3, true, Failed),
            (1.2, 1.3, 1.05, true, Failed),
            (1.0, 1.1, 1.05, false, Inconclusive),
            (9.0, 9.1, 1.05, false, Inconclusive),
        ] {
            assert_eq!(Figures { ratio, at_most, noise }.judge(1.15, enough), verdict, "{ratio} {at_most} {noise}");
        }
        let mut ratios = Ratios::default();
        for (ours, others) in [(10.0, [10.0, 10.0]), (20.0, [10.0, 40.0]), (40.0, [10.0, 10.0])] {
            ratios.enter(ours, others);
        }
        assert_eq!(ratios.figures(), Figures { ratio: 1.0, at_most: f64::INFINITY, noise: 4.0 });
        assert_eq!(ratios.censored, 0);
        ratios.enter(10.0, [10.0, LONGEST as f64]);
        assert_eq!(ratios.censored, 1);
    }
}
