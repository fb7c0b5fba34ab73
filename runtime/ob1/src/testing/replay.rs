//! A recording that drives a program on the bench, and what came out otherwise than recorded.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use ob1_cpu::CpuConfig;
use ob1_record::{Replay, Replayed};
use ob1_time::Span;

use super::bench::{Bench, bare_modules};
use ob1_station::program::Loaded;

/// A recording, and which of its signals are what.
#[derive(Clone, Debug, Default)]
pub(crate) struct Recorded {
    /// The file of the recording.
    pub(crate) path: PathBuf,
    /// Signals besides the inputs that are given to the program.
    pub(crate) drive: Vec<String>,
    /// The signals that are compared, if not all others.
    pub(crate) compare: Option<Vec<String>>,
}

impl Recorded {
    /// Opens the recording.
    ///
    /// # Errors
    /// It cannot be read, or has no such signal: why, in one sentence.
    pub(crate) fn open(&self) -> Result<Replay<BufReader<File>>, String> {
        let told = |error: &dyn std::fmt::Display| format!("{}: {error}", self.path.display());
        let file = File::open(&self.path).map_err(|error| told(&error))?;
        Replay::new(BufReader::new(file), &self.drive, self.compare.as_deref()).map_err(|error| told(&error))
    }
}

/// The configuration of a CPU that runs as the recorded one did.
pub(super) fn configured(config: CpuConfig, min_cycle_ns: u64) -> CpuConfig {
    CpuConfig { min_cycle: Span::from_nanos(min_cycle_ns), ..config }
}

/// Replays a recording with a program without a station.
///
/// # Errors
/// The program cannot be loaded, or the recording not be replayed, in words.
pub(crate) fn replay_program(config: CpuConfig, loaded: &Loaded, recorded: &Recorded) -> Result<Replayed, String> {
    let replay = recorded.open()?;
    let config = configured(config, replay.head().min_cycle_ns);
    let bench = Bench::new("replay", config, &bare_modules(), loaded);
    let mut bench = bench.map_err(|findings| findings.iter().map(|f| format!("{f}\n")).collect::<String>())?;
    replay.run(&mut bench).map_err(|error| format!("{}: {error}", recorded.path.display()))
}

/// What a replay has shown, line by line: first why it ended early, then each signal that differs.
pub(crate) fn told(replayed: &Replayed) -> Vec<String> {
    let ended = replayed.ended.iter().map(|why| format!("the replay ended early: {why}"));
    let mut lines: Vec<String> = ended.chain(replayed.differences.iter().map(ob1_record::Differences::text)).collect();
    if !lines.is_empty() && !replayed.not_set.is_empty() {
        lines.push(format!("not set at its beginning, because nothing sets them: {}", replayed.not_set.join(", ")));
    }
    lines
}

/// A test file that replays a recording with the program of a station or of sources.
pub(crate) fn test_file(recording: &Path, program: &Path, folder: &Path, name: &str) -> String {
    let shown = |path: &Path| path.strip_prefix(folder).unwrap_or(path).display().to_string();
    let quoted = |path: &Path| toml::Value::String(shown(path)).to_string();
    let is_station = program.extension().is_some_and(|ending| ending == "toml");
    let program = match is_station {
        true => format!("station = {}", quoted(program)),
        false => format!("sources = [{}]", quoted(program)),
    };
    let name = toml::Value::String(name.to_owned());
    format!(
        "# Written by `ob1 record --to-test`: what was recorded comes again, scan by scan (docs/record.md).\n{program}\n\n\
         [[test]]\nname = {name}\nreplay = {}\n",
        quoted(recording)
    )
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

    use fastrand::Rng;
    use ob1_access::Names;
    use ob1_cpu::Command;
    use ob1_record::{Capture, Head, Order, Replayed, Stage, Writer};
    use ob1_station::program;
    use ob1_station_file::sources::Sources;

    use super::super::bench::bare_config;
    use super::*;

    /// Everything that the random programs know.
    const SIGNALS: [&str; 19] = [
        "IB0", "IB1", "IW2", "QB0", "QB1", "MB0", "MB1", "MB2", "MB3", "MW4", "MW6", "MD8", "DB1.DBW0", "DB1.DBW2",
        "DB1.DBD4", "C1", "T1", "T2", "T3",
    ];

    fn bit(rng: &mut Rng) -> String {
        let area = ["E", "A", "M", "M", "M"][rng.usize(..5)];
        let byte = if area == "M" { rng.u8(..4) } else { rng.u8(..2) };
        format!("{area} {byte}.{}", rng.u8(..8))
    }

    fn own_bit(rng: &mut Rng) -> String {
        let (area, bytes) = if rng.bool() { ("A", 2) } else { ("M", 4) };
        format!("{area} {}.{}", rng.u8(..bytes), rng.u8(..8))
    }

    fn word(rng: &mut Rng) -> &'static str {
        ["MW 4", "MW 6", "DB1.DBW 0", "DB1.DBW 2"][rng.usize(..4)]
    }

    fn network(rng: &mut Rng, timers: bool) -> String {
        let (one, other, to) = (bit(rng), bit(rng), own_bit(rng));
        let (from, into, number) = (word(rng), word(rng), 1 + rng.u8(..3));
        let logic = ["U", "UN", "O", "X"][rng.usize(..4)];
        match rng.u8(..if timers { 8 } else { 6 }) {
            0 => format!("U {one}; {logic} {other}; = {to};"),
            1 => format!("U {one}; {} {to};", ["S", "R"][rng.usize(..2)]),
            2 => format!("U {one}; FP M {}.{}; = {to};", 2 + rng.u8(..2), rng.u8(..8)),
            3 if timers => format!("U {one}; ZV Z 1; U {other}; R Z 1; L Z 1; T {into};"),
            3 => format!("U {one}; UN {other}; R {to}; L Z 1; T {into};"),
            4 => format!("L {from}; L EW 2; {}; T {into};", ["+I", "-I", "XOW", "UW"][rng.usize(..4)]),
            5 => format!("L MD 8; L {}; +D; T MD 8; L DB1.DBD 4; XOD; T DB1.DBD 4;", rng.u8(1..)),
            6 => {
                let kind = ["SE", "SI", "SV", "SS", "SA"][rng.usize(..5)];
                format!("UN {one}; L S5T#{}0MS; {kind} T {number}; U {other}; R T {number};", 1 + rng.u8(..9))
            }
            _ => format!("U T {number}; = {to};"),
        }
    }

    /// `whole`: with timers, edges of counters and cyclic interrupts, which a recording from the middle does not set.
    fn source(rng: &mut Rng, whole: bool) -> String {
        let mut text =
            "DATA_BLOCK DB 1\nSTRUCT a: INT; b: INT; c: DINT; END_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n".to_owned();
        for (ob, networks) in [(100, 1), (1, 12), (35, if whole { 2 } else { 0 })] {
            let _ = writeln!(text, "ORGANIZATION_BLOCK OB {ob}\nBEGIN");
            for _ in 0..networks {
                let _ = writeln!(text, "NETWORK\n{}", network(rng, whole));
            }
            text += "END_ORGANIZATION_BLOCK\n";
        }
        text
    }

    fn compiled(text: &str) -> Loaded {
        let library = program::library(&[], &[]).expect("the standard blocks");
        let sources = [ob1_stl::Source::new("random.awl", text.as_bytes().to_vec())];
        let compiled = program::compile_texts(&sources, &Sources::default(), &library, Vec::new());
        let compiled = compiled.unwrap_or_else(|findings| panic!("{text}\n{findings:?}"));
        Loaded::new(compiled, Vec::new(), &[])
    }

    fn bench(loaded: &Loaded, min_cycle: Span) -> Bench {
        let mut config = bare_config(min_cycle);
        for cyclic in &mut config.cyclic {
            cyclic.period = Span::from_micros(3700);
        }
        Bench::new("station", config, &bare_modules(), loaded).expect("it loads")
    }

    /// A station in virtual time: `scans` of them with random inputs, begun late by chance; recorded from `from` on.
    fn recorded(loaded: &Loaded, rng: &mut Rng, (from, scans): (u64, u64), writes: bool) -> Vec<u8> {
        let min_cycle = Span::from_micros(500 + rng.u64(..4000));
        let mut bench = bench(loaded, min_cycle);
        let mut client = bench.cpu.recording_client().expect("the first");
        let order = Order { signals: SIGNALS.map(str::to_owned).into(), ..Order::default() };
        let settings = order.settle(&Names::new(&loaded.program), min_cycle).expect("signals");
        let (signals, min_cycle_ns) = (settings.signals.clone(), min_cycle.nanos());
        let mut file = Writer::begin(&Head { signals, min_cycle_ns, ..Head::default() });
        let (mut capture, mut rows) = (Capture::new(settings.clone()), None);
        bench.charge(Some(Span::from_nanos(rng.u64(..2000))));
        for scan in 0..scans {
            if scan >= from && rows.is_none() {
                rows = Some(settings.start(&mut client, min_cycle).expect("room"));
            }
            if rng.u8(..3) == 0 {
                let item = Names::default().parse(["EB0", "EB1", "EW2"][rng.usize(..3)]).expect("an input");
                bench.sense(&item, rng.u32(..256)).expect("an input");
            }
            if writes && rng.u8(..4) == 0 {
                // What a link writes between two scans.
                let item = Names::default().parse("MW4").expect("a word");
                Stage::set(&mut bench, &item, rng.u32(..1000)).expect("set");
            }
            if scan == 0 {
                bench.start(Command::Warm);
            } else {
                let late = Span::from_nanos(if rng.u8(..4) == 0 { rng.u64(..1_500_000) } else { 0 });
                loop {
                    let is_scan = bench.due >= bench.cpu.next_due();
                    if is_scan {
                        bench.due = bench.due.saturating_add(late);
                        bench.inputs_take(Span::from_nanos(rng.u64(..50_000)));
                    }
                    if bench.cycle() {
                        break;
                    }
                }
            }
            if let Some(rows) = &mut rows {
                let _ = capture.take(rows, &mut file, &|_| true);
            }
        }
        capture.flush(&mut file);
        file
    }

    fn replayed(file: &[u8], loaded: &Loaded, drive: &[String]) -> Replayed {
        let replay = Replay::new(file, drive, None).expect("a recording");
        let min_cycle = Span::from_nanos(replay.head().min_cycle_ns);
        replay.run(&mut bench(loaded, min_cycle)).expect("rows")
    }

    /// A recording from the start on, replayed, has the same values at every scan: timers, counters, edges, cyclic
    /// interrupts, scans that began late.
    #[test]
    fn a_recording_comes_again_as_it_was() {
        for seed in 0..150 {
            let mut rng = Rng::with_seed(seed);
            let text = source(&mut rng, true);
            let loaded = compiled(&text);
            let file = recorded(&loaded, &mut rng, (0, 120), false);
            let replayed = replayed(&file, &loaded, &[]);
            assert_eq!((told(&replayed), replayed.scans), (vec![], 119), "seed {seed}:\n{text}");
        }
    }

    /// One that began in the middle sets the memory first; what links have written is driven.
    #[test]
    fn a_recording_from_the_middle_sets_the_memory_first() {
        for seed in 0..60 {
            let mut rng = Rng::with_seed(1000 + seed);
            let text = source(&mut rng, false);
            let loaded = compiled(&text);
            let file = recorded(&loaded, &mut rng, (40, 100), true);
            let drive = ["MW4".to_owned()];
            let replayed = replayed(&file, &loaded, &drive);
            assert_eq!((told(&replayed), replayed.scans), (vec![], 59), "seed {seed}:\n{text}");
            assert_eq!((replayed.anew, replayed.not_set), (1, vec![]));
        }
    }

    /// A program with one statement more differs, at the scan where it differs.
    #[test]
    fn another_program_is_told_with_scan_and_value() {
        let text = |count: u32| {
            format!(
                "ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\nL MW 4; L 1; +I; T MW 4; L {count}; ==I; S M 0.0;\n\
                 END_ORGANIZATION_BLOCK\nDATA_BLOCK DB 1\nSTRUCT a: ARRAY[0..3] OF INT; END_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n"
            )
        };
        let file = recorded(&compiled(&text(30)), &mut Rng::with_seed(7), (0, 60), false);
        let other = replayed(&file, &compiled(&text(40)), &[]);
        let [only] = &other.differences[..] else { panic!("{other:?}") };
        assert_eq!((only.item.name.as_str(), only.count, only.first[0].scan), ("MB0", 10, 30));
        assert!(only.text().starts_with("MB0: recorded 1, found 0 after scan 30, "), "{}", only.text());
        assert_eq!(replayed(&file, &compiled(&text(30)), &[]).differences, []);
    }
}
