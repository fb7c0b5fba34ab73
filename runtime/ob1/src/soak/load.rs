//! What a station is put under while it is judged: load generators with a seed, named in the report.
//!
//! They are threads of the soak's process, with the ordinary priority, and end with it. The station is another process: what they
//! allocate and write is not in its accounts.

use std::fs::{self, File, OpenOptions};
use std::io::{Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;

use serde::{Deserialize, Serialize};

use super::budget::bytes;

/// Most threads of a kind.
const THREADS: u64 = 64;
/// Most driver kills a minute: a driver needs about a second to be back.
const KILLS: u64 = 60;
/// Bytes written and flushed at once.
const BLOCK: usize = 256 * 1024;
/// A file of the I/O load begins anew after so many blocks.
const BLOCKS: u64 = 64;

/// What was asked for: `cpu=2,memory=64MiB,io=1,driver-kill=10/min`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Load {
    /// As it was written.
    pub text: String,
    cpu: u64,
    memory: u64,
    io: u64,
    /// Driver kills a minute.
    pub(super) kills: u64,
    /// Of a million characters on simulated lines, so many suffer.
    pub(super) line_faults: u64,
}

impl FromStr for Load {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut load = Self { text: text.to_owned(), ..Self::default() };
        for part in text.split(',').map(str::trim).filter(|part| !part.is_empty()) {
            let (name, amount) =
                part.split_once('=').ok_or_else(|| format!("\"{part}\" has no amount; write cpu=2"))?;
            let number = |most: u64, text: &str| {
                let number = text.trim().parse::<u64>().ok().filter(|n| (1..=most).contains(n));
                number.ok_or_else(|| format!("\"{part}\": the amount is a number from 1 to {most}"))
            };
            match name.trim() {
                "cpu" => load.cpu = number(THREADS, amount)?,
                "io" => load.io = number(THREADS, amount)?,
                "memory" => {
                    let size = bytes(amount.trim()).filter(|size| *size >= 1 << 20);
                    load.memory =
                        size.ok_or_else(|| format!("\"{part}\": write it like memory=64MiB, at least 1MiB"))?;
                }
                "driver-kill" => {
                    let rate = amount.trim().strip_suffix("/min");
                    load.kills = number(KILLS, rate.ok_or_else(|| format!("\"{part}\": write driver-kill=10/min"))?)?;
                }
                "line-faults" => load.line_faults = number(1_000_000, amount)?,
                other => {
                    return Err(format!("\"{other}\" is no load; there are cpu, memory, io, driver-kill, line-faults"));
                }
            }
        }
        Ok(load)
    }
}

impl Load {
    /// Refuses what would bring the machine down rather than load it, and what this station has not got.
    pub(super) fn check(&self, simulated_lines: usize) -> Result<(), String> {
        if self.line_faults > 0 && simulated_lines == 0 {
            return Err(
                "line faults need a simulated line ([[simulated_line]] in the station file): on others they are real"
                    .into(),
            );
        }
        let Some(free) = available_memory() else { return Ok(()) };
        if self.memory > free / 2 {
            let (asked, free) = (self.memory >> 20, free >> 20);
            return Err(format!(
                "memory load of {asked} MiB: only {free} MiB are available, and half of that is the most"
            ));
        }
        Ok(())
    }
}

fn available_memory() -> Option<u64> {
    let text = fs::read_to_string("/proc/meminfo").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

/// The load in the report.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LoadReport {
    /// As on the command line.
    pub spec: String,
    /// Of all generators.
    pub seed: u64,
    /// Slices of 100,000 turns the CPU load has done.
    pub cpu_slices: u64,
    /// Pages the memory load has written.
    pub memory_pages: u64,
    /// Blocks of 256 KiB the I/O load has written and flushed.
    pub io_blocks: u64,
    /// The I/O load could not write.
    pub io_errors: u64,
    /// Drivers killed.
    pub driver_kills: u64,
    /// Of a million characters on simulated lines, so many suffered.
    #[serde(default)]
    pub line_faults: u64,
}

impl LoadReport {
    /// What has been done.
    #[must_use]
    pub fn done(&self) -> String {
        let mut told = Vec::new();
        for (count, what) in [
            (self.cpu_slices, "slices of computing"),
            (self.memory_pages, "pages written"),
            (self.io_blocks, "blocks flushed"),
            (self.io_errors, "blocks that could not be written"),
            (self.driver_kills, "drivers killed"),
            (self.line_faults, "of a million characters with a fault"),
        ] {
            if count > 0 {
                told.push(format!("{count} {what}"));
            }
        }
        if told.is_empty() { "nothing yet".into() } else { told.join(", ") }
    }
}

#[derive(Debug, Default)]
struct Counts {
    cpu: AtomicU64,
    memory: AtomicU64,
    io: AtomicU64,
    io_errors: AtomicU64,
}

/// The generators at work. Dropping them ends them.
#[derive(Debug)]
pub(super) struct Generators {
    stop: Arc<AtomicBool>,
    counts: Arc<Counts>,
    threads: Vec<JoinHandle<()>>,
    load: Load,
    seed: u64,
    pub(super) kills: u64,
}

impl Generators {
    /// Starts them; files of the I/O load lie in `folder`, without a name.
    pub(super) fn start(load: &Load, seed: u64, folder: &Path) -> std::io::Result<Self> {
        let (stop, counts) = (Arc::new(AtomicBool::new(false)), Arc::new(Counts::default()));
        let mut all = Self { stop, counts, threads: Vec::new(), load: load.clone(), seed, kills: 0 };
        let mut seeds = Random::new(seed);
        for _ in 0..load.cpu {
            let mut random = Random::new(seeds.next());
            all.thread("ob1-load-cpu", move |counts| {
                for _ in 0..100_000 {
                    std::hint::black_box(random.next());
                }
                counts.cpu.fetch_add(1, Ordering::Relaxed);
            })?;
        }
        if load.memory > 0 {
            let mut random = Random::new(seeds.next());
            let mut memory = vec![0u8; load.memory as usize];
            all.thread("ob1-load-memory", move |counts| {
                for _ in 0..1000 {
                    let at = random.below(memory.len() as u64) as usize;
                    if let Some(byte) = memory.get_mut(at) {
                        *byte = byte.wrapping_add(1);
                    }
                }
                counts.memory.fetch_add(1000, Ordering::Relaxed);
            })?;
        }
        for number in 0..load.io {
            let mut random = Random::new(seeds.next());
            let mut file = nameless(folder, number)?;
            let mut block = vec![0u8; BLOCK];
            let mut blocks = 0;
            all.thread("ob1-load-io", move |counts| {
                for bytes in block.chunks_exact_mut(8) {
                    bytes.copy_from_slice(&random.next().to_le_bytes());
                }
                let rewound = if blocks % BLOCKS == 0 { file.seek(SeekFrom::Start(0)).map(drop) } else { Ok(()) };
                blocks += 1;
                match rewound.and_then(|()| file.write_all(&block)).and_then(|()| file.sync_data()) {
                    Ok(()) => counts.io.fetch_add(1, Ordering::Relaxed),
                    Err(_) => counts.io_errors.fetch_add(1, Ordering::Relaxed),
                };
            })?;
        }
        Ok(all)
    }

    fn thread(&mut self, name: &str, mut turn: impl FnMut(&Counts) + Send + 'static) -> std::io::Result<()> {
        let (stop, counts) = (Arc::clone(&self.stop), Arc::clone(&self.counts));
        self.threads.push(ob1_rt::spawn(name, move || {
            while !stop.load(Ordering::Relaxed) {
                turn(&counts);
            }
        })?);
        Ok(())
    }

    pub(super) fn report(&self) -> LoadReport {
        let read = |count: &AtomicU64| count.load(Ordering::Relaxed);
        LoadReport {
            spec: self.load.text.clone(),
            seed: self.seed,
            cpu_slices: read(&self.counts.cpu),
            memory_pages: read(&self.counts.memory),
            io_blocks: read(&self.counts.io),
            io_errors: read(&self.counts.io_errors),
            driver_kills: self.kills,
            line_faults: self.load.line_faults,
        }
    }
}

impl Drop for Generators {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

/// A file that goes with its last descriptor, however this process ends.
fn nameless(folder: &Path, number: u64) -> std::io::Result<File> {
    let path: PathBuf = folder.join(format!(".ob1-load-{}-{number}", std::process::id()));
    let file = OpenOptions::new().create_new(true).write(true).open(&path)?;
    fs::remove_file(&path)?;
    Ok(file)
}

/// Moments of driver kills and whom they meet, from a seed: half to one and a half of the mean apart.
#[derive(Debug)]
pub(super) struct Kills {
    random: Random,
    mean_ns: u64,
    next_ns: u64,
}

impl Kills {
    /// None without kills.
    pub(super) fn new(load: &Load, seed: u64) -> Option<Self> {
        let mean_ns = 60_000_000_000u64.checked_div(load.kills)?;
        let mut kills = Self { random: Random::new(!seed), mean_ns, next_ns: 0 };
        kills.plan();
        Some(kills)
    }

    fn plan(&mut self) {
        self.next_ns += self.mean_ns / 2 + self.random.below(self.mean_ns);
    }

    /// Which of so many drivers is due.
    pub(super) fn due(&mut self, now_ns: u64, drivers: usize) -> Option<usize> {
        if now_ns < self.next_ns || drivers == 0 {
            return None;
        }
        while self.next_ns <= now_ns {
            self.plan();
        }
        Some(self.random.below(drivers as u64) as usize)
    }
}

/// SplitMix64.
#[derive(Debug)]
struct Random(u64);

impl Random {
    const fn new(seed: u64) -> Self {
        Self(seed)
    }

    const fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Less than `end`, which is not 0.
    const fn below(&mut self, end: u64) -> u64 {
        ((self.next() as u128 * end as u128) >> 64) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loads_are_read_and_bounded() {
        let load: Load = "cpu=2, memory=64MiB,io=1,driver-kill=10/min".parse().expect("right");
        assert_eq!((load.cpu, load.memory, load.io, load.kills), (2, 64 << 20, 1, 10));
        assert!(load.check(0).is_ok());
        for (wrong, hint) in [
            ("cpu", "cpu=2"),
            ("cpu=0", "from 1 to 64"),
            ("cpu=65", "from 1 to 64"),
            ("memory=1KiB", "64MiB"),
            ("driver-kill=10", "10/min"),
            ("driver-kill=61/min", "from 1 to 60"),
            ("line-faults=1000001", "from 1 to 1000000"),
            ("network=1", "driver-kill"),
        ] {
            let error = wrong.parse::<Load>().expect_err(wrong);
            assert!(error.contains(hint), "{error}");
        }
        let all_of_it: Load = "memory=1000000GiB".parse().expect("right");
        assert!(all_of_it.check(0).is_err());
        let faults: Load = "line-faults=500".parse().expect("right");
        assert!(faults.check(1).is_ok() && faults.check(0).is_err());
    }

    #[test]
    fn generators_work_and_end() {
        let folder = std::env::temp_dir();
        let load: Load = "cpu=1,memory=1MiB,io=1".parse().expect("right");
        let generators = Generators::start(&load, 7, &folder).expect("room");
        let worked = |r: &LoadReport| r.cpu_slices > 0 && r.memory_pages > 0 && r.io_blocks > 0;
        while !worked(&generators.report()) {
            assert_eq!(generators.report().io_errors, 0);
            std::thread::yield_now();
        }
        drop(generators);
        let left = fs::read_dir(&folder).expect("a folder").flatten();
        let ours = format!(".ob1-load-{}-", std::process::id());
        assert_eq!(left.filter(|f| f.file_name().to_string_lossy().starts_with(&ours)).count(), 0);
    }

    #[test]
    fn kills_come_by_the_seed() {
        let load: Load = "driver-kill=60/min".parse().expect("right");
        let moments = |seed| {
            let mut kills = Kills::new(&load, seed).expect("kills");
            (0..600_000u64).filter_map(|ms| Some((ms, kills.due(ms * 1_000_000, 2)?))).collect::<Vec<_>>()
        };
        let kills = moments(1);
        assert_eq!(kills, moments(1));
        assert_ne!(kills, moments(2));
        assert!((540..=660).contains(&kills.len()) && kills.iter().any(|k| k.1 == 1), "{}", kills.len());
        assert!(Kills::new(&Load::default(), 1).is_none());
    }
}
