//! Sieges without processes: external data with random damage. Short here; long runs with `cargo xtask siege segment
//! input cut`.

use std::fs::{self, File};
use std::os::unix::fs::FileExt as _;
use std::path::{Path, PathBuf};

use ob1_backplane::{CpuSide, Segment, layout};
use ob1_cpu::Module as _;
use ob1_host::module::{AlwaysThere, CpModule, CpSettings};
use ob1_line::sim::SplitMix64;
use ob1_station::retentive::store::Store;
use ob1_tests::fuzz::TARGETS;
use ob1_tests::siege::{mutate, random, rounds};
use ob1_time::Instant;

/// A driver that writes random data into the segment: the CPU side continues, and each of its calls ends.
#[test]
fn segment() {
    let made = Segment::create_shared_with_boxes().expect("memory");
    let memory = File::options().read(true).write(true).open(made.path().expect("shared")).expect("ours");
    let side = CpuSide::create(&made, 16).expect("16 bytes are allowed");
    let settings = CpSettings { boxes: true, ..CpSettings::default() };
    let mut module = CpModule::new(side, Box::new(AlwaysThere), settings).expect("it fits");
    let mut random = random(0x5E6);
    let rounds = rounds(20_000);
    let (mut events, mut records) = (0, 0);
    for round in 0..rounds {
        for _ in 0..=random.below(3) {
            // Mostly the part that every CP has, because there are many identical boxes.
            let size = if random.below(4) == 0 { made.bytes() } else { layout::SEGMENT_BYTES };
            let at = random.below(size as u64 - 8);
            // Mostly aligned words like the fields; small and extreme values are the relevant ones.
            let at = if random.below(8) == 0 { at } else { at & !3 };
            let value = match random.below(4) {
                0 => random.below(4),
                1 => u64::MAX - random.below(4),
                _ => random.next_u64(),
            };
            let len = [1, 2, 4, 8][random.below(4) as usize];
            memory.write_all_at(&value.to_le_bytes()[..len], at).expect("inside");
        }
        module.begin_scan(Instant::from_millis(round));
        let mut bytes = [0; 16];
        let _ = module.read(random.below(20) as u16, &mut bytes[..random.below(17) as usize]);
        let _ = module.write(random.below(20) as u16, &bytes[..random.below(17) as usize]);
        if round % 16 == 0 {
            module.cpu_state(random.below(2) == 0);
            let mut record = [0; 512];
            for number in (0..3).chain([0x80, 0xBF]) {
                records += u64::from(module.record_read(number, &mut record).is_ok());
                let _ = module.record_write(number, &record[..random.below(513) as usize]);
            }
            let mut entries = 0;
            module.diagnostic_buffer(&mut |_| entries += 1);
            assert!(entries <= 1000, "round {round}: a diagnostic buffer without an end");
        }
        // A limited number of events for each scan, independent of the ring.
        for _ in 0..64 {
            if module.poll_event().is_none() {
                break;
            }
            events += 1;
        }
        let _ = module.status();
        module.end_scan(Instant::from_millis(round));
    }
    println!("{rounds} scans beside a hostile driver: {events} events, {records} records, no panic");
}

/// Sources, symbol tables, station files, tests, traces, whole programs and intermediate code, from the committed
/// inputs and the examples: no damaged input causes a panic.
#[test]
fn input() {
    let rounds = rounds(400);
    for (name, run) in TARGETS {
        let seeds = seeds(name);
        assert!(seeds.len() > 3, "{name} has too few inputs");
        let mut random = random(0x0B1);
        for round in 0..rounds {
            let pick = |random: &mut SplitMix64| &seeds[random.below(seeds.len() as u64) as usize];
            let (one, other) = (pick(&mut random), pick(&mut random));
            let input = mutate(&mut random, one, other);
            let _kept = Kept { name, round, input: &input };
            run(&input);
        }
        println!("{name}: {rounds} mutations, no panic");
    }
}

/// Stores the input of a target that panics.
struct Kept<'a> {
    name: &'a str,
    round: u64,
    input: &'a [u8],
}

impl Drop for Kept<'_> {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            return;
        }
        let path = std::env::temp_dir().join(format!("ob1-siege-{}-{}", self.name, self.round));
        let _ = fs::write(&path, self.input);
        eprintln!("the input that did it: {}", path.display());
    }
}

/// The committed inputs of a target, and suitable files of the examples.
fn seeds(name: &str) -> Vec<Vec<u8>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut files = files_below(&root.join("fuzz/corpus").join(name));
    let ending = match name {
        "stl" | "exec" => "awl",
        "station" => "toml",
        "symbols" => "sdf",
        "testfile" => "test.toml",
        _ => "",
    };
    let examples = files_below(&root.join("examples"));
    files.extend(examples.into_iter().filter(|path| path.to_string_lossy().ends_with(&format!(".{ending}"))));
    files.sort();
    files.iter().map(|path| fs::read(path).expect("a file")).collect()
}

fn files_below(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).unwrap_or_else(|why| panic!("{}: {why}", folder.display())) {
        let path = entry.expect("an entry").path();
        if path.is_dir() { files.extend(files_below(&path)) } else { files.push(path) }
    }
    files
}

/// Retentive files damaged at every kind of offset: header, length, checksum, content, end. The result is the newest
/// intact generation; the damaged one is reported.
#[test]
fn cut() {
    const STATION: &str = "damaged";
    let rounds = rounds(200);
    let mut random = random(0xC07);
    let mut older = 0;
    for round in 0..rounds {
        let folder = tempfile::tempdir().expect("a directory");
        let image = |number: u64| (0..200 + number * 50).map(|i| (i * 7 + number) as u8).collect::<Vec<_>>();
        let (mut store, _) = Store::open(folder.path(), STATION).expect("writable");
        for number in 1..=3 {
            store.write(&image(number)).expect("writable");
        }
        drop(store);
        // The two generations, without the lock file of the writer.
        let mut files = files_below(folder.path());
        files.retain(|path| path.extension().is_some_and(|end| end == "a" || end == "b"));
        let victim = &files[random.below(files.len() as u64) as usize];
        let mut bytes = fs::read(victim).expect("readable");
        let len = bytes.len() as u64;
        let at = match round % 6 {
            0 => random.below(8),
            1 => 8 + random.below(12),
            2 => 20 + random.below(8),
            3 => 28 + random.below(len - 28),
            4 => len - 1,
            _ => random.below(len),
        } as usize;
        let before = bytes.clone();
        match random.below(4) {
            0 => bytes.truncate(at),
            1 => bytes[at] ^= 1 << random.below(8),
            2 => bytes[at..].fill(0),
            _ => bytes.extend_from_within(at..),
        }
        let damaged = bytes != before;
        fs::write(victim, &bytes).expect("writable");
        let (_, found) = Store::open(folder.path(), STATION).expect("readable");
        let newest = found.generations.first().unwrap_or_else(|| panic!("round {round}: nothing is left"));
        let which = [3, 2].into_iter().find(|number| newest.image == image(*number));
        let which = which.unwrap_or_else(|| panic!("round {round}, offset {at}: neither generation came back"));
        older += u64::from(which == 2);
        assert_eq!(found.refused.len(), usize::from(damaged), "round {round}, offset {at}: {:?}", found.refused);
    }
    assert!(older > 0 && older < rounds, "{older} of {rounds}");
    println!("{rounds} damaged files: {older} times the older generation came back, nothing torn");
}
