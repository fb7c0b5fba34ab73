//! The CP 340 in virtual time: the pair of `examples/cp340-pair`; CP 340 with CP 340 and with CP 341, all boundary
//! lengths in both directions, over 3964(R) and ASCII, compared byte by byte; aborts by R and EN_R; the receive buffer;
//! errors of the partner. (docs/cp341-events.md), [CP 340 manual 04/2011]

use std::fs;

use ob1_cpu::{Cell, Width};
use ob1_tests::sim::device::{Bench, Device};
use ob1_tests::sim::station::SimStation;
use ob1_tests::sim::{self, MS, SECOND, Scenario};
use ob1_time::{Instant, Span};

use crate::common::cp341::data_block;
use crate::common::pair::{self, run};

// ---- the example ----

#[test]
fn the_pair_loses_nothing_on_a_good_line() {
    let folder = pair::example("cp340-pair");
    let outcome = pair::loses_nothing(Scenario::demo(&folder, 7), 30 * SECOND, &pair::FAULTS);
    assert!(outcome.verdict.get("good") > 50, "{}", outcome.verdict);
}

/// Bad lines, characters in bursts, killed drivers: each job ends exactly once, no wrong data are accepted.
#[test]
fn the_pair_on_bad_lines() {
    for seed in 1..=3 {
        let outcome = run(&Scenario::demo(&pair::example("cp340-pair"), seed));
        assert!(outcome.verdict.broken.is_empty(), "seed {seed}\n{}", outcome.verdict);
    }
}

#[test]
fn the_same_seed_gives_the_same_log() {
    pair::assert_repeats(&pair::example("cp340-pair"));
}

// ---- two stations, every length ----

/// Both blocks of a CP 340 (FB 2, FB 3) or a CP 341 (FB 7, FB 8): DB 60 has the parameters of P_SEND, DB 61 those of
/// P_RCV. DB 10 has the data to send, DB 40 the received data.
fn program(kind: &str) -> String {
    let (receive, send) = if kind == "cp340" { (2, 3) } else { (7, 8) };
    // P_RESET: DBX 6.0 is REQ, DBB 7 counts DONE.
    let reset = "CALL FB 12, DB 12\n  REQ := DB60.DBX 6.0\n  LADDR := 256\n  DONE := DB60.DBX 6.2\n  ERROR := DB60.DBX 6.3\n      \
                 U     DB60.DBX 6.2;\n      SPBN  end;\n      L     DB60.DBB 7;\n      L     1;\n      +I;\n      T     DB60.DBB 7;\nend:  NOP   0;\n";
    let reset = if kind == "cp340" { reset } else { "" };
    let code = format!(
        "ORGANIZATION_BLOCK OB 1\nVAR_TEMP\n  INFO : ARRAY [1..20] OF BYTE;\nEND_VAR\nBEGIN\n\
         CALL FB {receive}, DB 7\n  EN_R := DB61.DBX 1.0\n  R := DB61.DBX 1.1\n  LADDR := 256\n  DB_NO := 40\n  \
         DBB_NO := 3\n  NDR := DB61.DBX 0.0\n  ERROR := DB61.DBX 0.1\n  LEN := DB61.DBW 2\n  STATUS := DB61.DBW 4\n\
         CALL FB {send}, DB 8\n  REQ := DB60.DBX 0.0\n  R := DB60.DBX 0.1\n  LADDR := 256\n  DB_NO := 10\n  \
         DBB_NO := 1\n  LEN := DB60.DBW 2\n  DONE := DB60.DBX 1.0\n  ERROR := DB60.DBX 1.1\n  STATUS := DB60.DBW 4\n\
         {reset}END_ORGANIZATION_BLOCK\n\n\
         ORGANIZATION_BLOCK OB 82\nVAR_TEMP\n  INFO : ARRAY [1..20] OF BYTE;\nEND_VAR\nBEGIN\n      \
         L     LD 8;\n      T     DB61.DBD 8;\nEND_ORGANIZATION_BLOCK\n\n"
    );
    let instances = [(7, receive), (8, send), (12, 12)].into_iter().take(if kind == "cp340" { 3 } else { 2 });
    let instances = instances.map(|(db, fb)| format!("DATA_BLOCK DB {db}\nFB {fb}\nBEGIN\nEND_DATA_BLOCK\n"));
    let instances: Vec<String> = instances.collect();
    let blocks = [(10, 4200), (40, 4200), (60, 8), (61, 12)].map(|(db, bytes)| data_block(db, bytes));
    [code, instances.concat(), blocks.concat()].concat()
}

/// A station with one CP; `more` is TOML after its parameters.
fn station_file(name: &str, kind: &str, line: &str, params: &str, more: &str) -> String {
    format!(
        "[station]\nname = \"{name}\"\n[cpu]\nmin_cycle = \"1ms\"\nwatchdog = \"500ms\"\n\
         [program]\nsources = [\"{name}.awl\"]\nmnemonics = \"de\"\n[[plugin]]\npath = \"ob1_{kind}\"\n\
         [[module]]\ntype = \"{kind}\"\nname = \"cp\"\naddress = 256\nline = \"{line}\"\n\
         params = {{ {params} }}\n{more}\n"
    )
}

fn put(station: &mut SimStation, db: u16, byte: u32, width: Width, value: i32) {
    let value = if width == Width::Byte { value & 0xFF } else { value & 0xFFFF };
    station.cpu.write(Cell::Db(db, 8 * byte), width, value as u32).expect("a cell of the program");
}

fn block(station: &SimStation, db: u16) -> &[u8] {
    station.cpu.data_block(db).expect("a data block of the program")
}

fn word(block: &[u8], at: usize) -> u16 {
    u16::from_be_bytes([block[at], block[at + 1]])
}

/// The content of DB 10 for this job: all values, including control characters.
fn filling(job: usize) -> Vec<u8> {
    (0..4200).map(|at| (at * 7 + job * 31 + at / 256) as u8).collect()
}

/// A job: sender, LEN, STATUS (0: DONE, and the other side has the telegram).
type Job = (usize, i32, u16);

#[derive(Default)]
struct Operator {
    jobs: Vec<Job>,
    at: usize,
    has_begun: bool,
    end: Option<u16>,
    report: Option<u16>,
    cycles: usize,
}

impl Operator {
    fn is_done(&self) -> bool {
        self.at == self.jobs.len()
    }

    fn look(&mut self, place: usize, station: &mut SimStation) {
        put(station, 61, 1, Width::Byte, 1);
        let Some(&(sender, len, status)) = self.jobs.get(self.at) else { return };
        if place == sender {
            self.look_sender(station, len);
        } else if self.has_begun {
            self.look_receiver(station, len);
        }
        if self.end == Some(status) && (status != 0 || self.report.is_some()) {
            *self = Self { jobs: std::mem::take(&mut self.jobs), at: self.at + 1, ..Self::default() };
        }
    }

    fn look_sender(&mut self, station: &mut SimStation, len: i32) {
        if !self.has_begun {
            for (at, byte) in (0..).zip(filling(self.at)) {
                put(station, 10, at, Width::Byte, byte.into());
            }
            put(station, 60, 2, Width::Word, len);
            put(station, 60, 0, Width::Byte, 1);
            self.has_begun = true;
            return;
        }
        put(station, 60, 0, Width::Byte, 0);
        self.cycles += 1;
        assert!(self.cycles < 40_000, "job {} does not end: {:?}", self.at, self.jobs[self.at]);
        let (flags, status) = (block(station, 60)[1], word(block(station, 60), 4));
        assert_eq!(status != 0, flags == 0b10, "STATUS goes with ERROR");
        if flags != 0 {
            assert!(self.end.is_none(), "job {} ends twice", self.at);
            assert_eq!(status, self.jobs[self.at].2, "job {}: {:?}", self.at, self.jobs[self.at]);
            self.end = Some(status);
        }
    }

    /// Checks that exactly the telegram was received, and nothing else was changed.
    fn look_receiver(&mut self, station: &mut SimStation, len: i32) {
        let flags = block(station, 61)[0];
        if flags == 0 {
            return;
        }
        let job = self.at;
        assert_eq!((flags, self.report), (1, None), "job {job}: STATUS {:04X}", word(block(station, 61), 4));
        let received = word(block(station, 61), 2);
        assert_eq!(i32::from(received), len, "LEN of job {job}");
        let target = block(station, 40).to_vec();
        let len = len as usize;
        assert!(target[3..3 + len] == filling(job)[1..1 + len], "the telegram of job {job}");
        assert!(
            target[..3].iter().chain(&target[3 + len..]).all(|byte| *byte == 0),
            "beside the telegram of job {job}"
        );
        for at in 0..target.len() as u32 {
            put(station, 40, at, Width::Byte, 0);
        }
        self.report = Some(received);
    }
}

/// Two stations with a CP of these types on a cable; executes the jobs one after the other.
fn exchange(kinds: [&str; 2], params: [&str; 2], jobs: Vec<Job>) {
    let folder = tempfile::tempdir().expect("a folder");
    let places = [("a", "pty:cable"), ("b", "serial:cable")];
    for (((name, line), kind), params) in places.into_iter().zip(kinds).zip(params) {
        fs::write(folder.path().join(format!("{name}.awl")), program(kind)).expect("the program");
        let file = station_file(name, kind, line, params, "");
        fs::write(folder.path().join(format!("station-{name}.toml")), file).expect("a station file");
    }
    let duration = 900 * SECOND;
    let scenario = Scenario::demo(folder.path(), 1).undisturbed(duration);
    let mut operator = Operator { jobs, ..Operator::default() };
    let outcome = sim::run_with(&scenario, |place, station| {
        operator.look(place, station);
        !operator.is_done()
    });
    let outcome = outcome.unwrap_or_else(|message| panic!("{message}\nrun: cargo xtask test"));
    assert!(operator.is_done(), "job {} has not ended\n{}", operator.at, outcome.log);
}

/// Limits of words, pieces of 32 bytes, the range of a byte, the longest telegram of a CP 340.
const BOUNDARIES: [i32; 14] = [1, 2, 31, 32, 33, 63, 64, 65, 255, 256, 257, 991, 1023, 1024];

/// All of them in both directions, and invalid lengths.
fn all_lengths(limits: [(i32, u16); 2]) -> Vec<Job> {
    let good = BOUNDARIES.iter().flat_map(|len| [(0, *len, 0), (1, *len, 0)]);
    let wrong = (0..2).flat_map(|sender| {
        let (most, status) = limits[sender];
        [0, -1, most + 1, i32::from(i16::MAX), i32::from(i16::MIN)].map(|len| (sender, len, status))
    });
    good.chain(wrong).chain([(0, 10, 0), (1, 10, 0)]).collect()
}

const OF_340: (i32, u16) = (1024, 0x1E41);
const OF_341: (i32, u16) = (4096, 0x1E41);

#[test]
fn every_length_between_two_cp_340_over_3964r() {
    let params = |priority| format!("protocol = \"3964r\", baud = 19200, priority = \"{priority}\"");
    exchange(["cp340"; 2], [&params("high"), &params("low")], all_lengths([OF_340; 2]));
}

#[test]
fn every_length_between_a_cp_340_and_a_cp_341_over_3964() {
    let params = |priority| format!("protocol = \"3964\", baud = 19200, priority = \"{priority}\"");
    exchange(["cp340", "cp341"], [&params("low"), &params("high")], all_lengths([OF_340, OF_341]));
}

#[test]
fn every_length_between_a_cp_341_and_a_cp_340_over_ascii() {
    let params = "protocol = \"ascii\", baud = 19200, zvz_ms = 30";
    exchange(["cp341", "cp340"], [params; 2], all_lengths([OF_341, OF_340]));
}

#[test]
fn fixed_lengths_and_end_characters() {
    let by_length =
        |length| format!("protocol = \"ascii\", end_criterion = \"length\", length = {length}, zvz_ms = 30");
    for length in [1, 240, 1024] {
        exchange(["cp340"; 2], [&by_length(length), &by_length(length)], vec![(0, length, 0), (1, length, 0)]);
    }
    // 1024 bytes plus the end characters are too long, and nothing is sent.
    let by_end = "protocol = \"ascii\", end_criterion = \"end-characters\", end_flag_1 = 13, sending = \"append-end\"";
    exchange(["cp340"; 2], [by_end; 2], vec![(0, 1024, 0x050E)]);
}

// ---- one station and a partner ----

const STX: u8 = 0x02;
const ETX: u8 = 0x03;
const DLE: u8 = 0x10;
const NAK: u8 = 0x15;

/// A partner with given answers.
#[derive(Default)]
struct Partner {
    /// Its answers to STX and to the block.
    answers: [&'static [u8]; 2],
    /// Telegrams it sends, each after a DLE of the CP.
    blocks: Vec<Vec<u8>>,
    heard: Vec<u8>,
}

impl Device for Partner {
    fn hear(&mut self, _: Instant, bytes: &[u8], out: &mut Vec<u8>) -> Option<Instant> {
        for byte in bytes {
            self.heard.push(*byte);
            match self.heard[..] {
                [STX] => out.extend(self.answers[0]),
                // Another attempt to connect.
                [.., STX] if self.answers[0] != [DLE] => {
                    out.extend(self.answers[0]);
                    self.heard.clear();
                }
                [.., DLE, ETX, _] if self.heard.len() > 3 => {
                    out.extend(self.answers[1]);
                    self.heard.clear();
                }
                [.., DLE] if !self.blocks.is_empty() => out.extend(self.blocks.remove(0)),
                [.., NAK] => self.heard.clear(),
                _ => {}
            }
        }
        None
    }
}

/// A block after STX and DLE: 3964R.
fn framed(telegram: &[u8]) -> Vec<u8> {
    let doubled = telegram.iter().flat_map(|byte| if *byte == DLE { vec![DLE; 2] } else { vec![*byte] });
    let mut line: Vec<u8> = doubled.chain([DLE, ETX]).collect();
    line.push(line.iter().fold(0, |check, byte| check ^ byte));
    line
}

struct Site {
    bench: Bench<Partner>,
    ends: Vec<u16>,
    /// LEN, or STATUS.
    reports: Vec<Result<u16, u16>>,
}

impl Site {
    fn new(params: &str, more: &str) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        fs::write(folder.path().join("site.awl"), program("cp340")).expect("the program");
        let path = folder.path().join("station.toml");
        fs::write(&path, station_file("site", "cp340", "pty:partner", params, more)).expect("the station file");
        let bench = Bench::build(&path, Partner::default(), 1);
        let bench = bench.unwrap_or_else(|message| panic!("{message}\nrun: cargo xtask test"));
        let mut site = Self { bench, ends: Vec::new(), reports: Vec::new() };
        for at in 0..1100 {
            site.set(10, at, 0x40 + (at % 64) as u8);
        }
        site.pass(SECOND);
        site.bench.device.heard.clear();
        site
    }

    fn s3964r() -> Self {
        Self::new("protocol = \"3964r\", qvz_ms = 100, zvz_ms = 50, connect_attempts = 2, block_attempts = 2", "")
    }

    fn ascii(more: &str) -> Self {
        Self::new(&format!("protocol = \"ascii\", zvz_ms = 10{more}"), "")
    }

    fn set(&mut self, db: u16, byte: u32, value: u8) {
        put(&mut self.bench.station, db, byte, Width::Byte, value.into());
    }

    fn pass(&mut self, time: Span) {
        let Self { bench, ends, reports } = self;
        bench.until(time, |station| {
            let (send, receive) = (block(station, 60), block(station, 61));
            if send[1] & 3 != 0 {
                ends.push(word(send, 4));
            }
            match receive[0] & 3 {
                0 => {}
                1 => reports.push(Ok(word(receive, 2))),
                _ => reports.push(Err(word(receive, 4))),
            }
            false
        });
    }

    /// Gives an edge of REQ and runs for `time`.
    fn send(&mut self, len: u8, time: Span) -> Vec<u16> {
        self.set(60, 3, len);
        self.set(60, 0, 1);
        self.pass(2 * MS);
        self.set(60, 0, 0);
        self.pass(time);
        std::mem::take(&mut self.ends)
    }

    fn says(&mut self, bytes: &[u8]) {
        let bytes = bytes.to_vec();
        self.bench.meanwhile(|_, _, out| {
            out.extend(bytes);
            None
        });
    }

    fn reports(&mut self) -> Vec<Result<u16, u16>> {
        std::mem::take(&mut self.reports)
    }
}

/// Errors on the line have their number in STATUS of P_SEND; the diagnostic buffer has the causes.
#[test]
fn a_job_ends_with_what_the_partner_did() {
    for (answers, status, entries) in [
        ([&[DLE][..], &[DLE][..]], 0, &[][..]),
        ([&[NAK], &[]], 0x0702, &[0x0702, 0x0701, 0x0702, 0x0709][..]),
        ([&[], &[]], 0x0703, &[0x0703, 0x0701, 0x0703, 0x0709]),
        ([&[DLE], &[NAK]], 0x0706, &[0x0706, 0x0701, 0x0706, 0x070A]),
        ([&[DLE], &[]], 0x0707, &[0x0707, 0x0701, 0x0707, 0x070A]),
    ] {
        let mut site = Site::s3964r();
        let before = site.bench.entries().len();
        site.bench.device.answers = answers;
        assert_eq!(site.send(10, 3 * SECOND), [status], "{:04X?}", &site.bench.entries()[before..]);
        assert_eq!(&site.bench.entries()[before..], entries, "{status:04X}");
    }
}

/// R: the job ends with 1E0Dh at once; EN_R = 0 or R during a telegram: 1E0Dh, and the telegram is passed again
/// completely.
#[test]
fn aborts_by_r_and_en_r() {
    let mut site = Site::s3964r();
    site.bench.device.answers = [&[DLE], &[]];
    assert!(site.send(100, 5 * MS).is_empty());
    site.set(60, 0, 0b10);
    site.pass(5 * MS);
    assert_eq!(std::mem::take(&mut site.ends), [0x1E0D]);
    site.set(60, 0, 0);
    site.pass(3 * SECOND);
    assert!(site.ends.is_empty(), "nobody is told of a job that was reset");
    for abort in [0, 0b11] {
        let mut site = Site::ascii("");
        let telegram: Vec<u8> = (0..200).map(|at| at + 1).collect();
        site.set(61, 1, 1);
        site.pass(10 * MS);
        site.says(&telegram);
        // Until data are being transferred.
        for _ in 0..2000 {
            if block(&site.bench.station, 40)[3 + 40] != 0 {
                break;
            }
            site.pass(MS);
        }
        site.set(61, 1, abort);
        site.pass(20 * MS);
        assert_eq!(site.reports(), [Err(0x1E0D)], "abort {abort:02b}");
        site.set(61, 1, 1);
        site.pass(SECOND);
        assert_eq!(site.reports(), [Ok(200)], "abort {abort:02b}");
        assert_eq!(block(&site.bench.station, 40)[3..203], telegram);
    }
}

/// 1024 bytes and no more; telegrams that do not fit are reported, and the oldest are passed first.
#[test]
fn the_receive_buffer_holds_1024_bytes() {
    let mut site = Site::ascii("");
    for length in [1000_usize, 24, 1] {
        site.says(&vec![length as u8; length]);
        site.pass(3 * SECOND);
    }
    let full = site.bench.entries().iter().filter(|entry| **entry == 0x080A).count();
    assert_eq!(full, 1, "{:04X?}", site.bench.entries());
    site.set(61, 1, 1);
    site.pass(SECOND);
    assert_eq!(site.reports(), [Ok(1000), Ok(24)]);
    site.says(&[7; 1025]);
    site.pass(3 * SECOND);
    assert_eq!(site.reports(), [Err(0x050E)], "longer than any telegram");
    site.says(&[7; 1024]);
    site.pass(3 * SECOND);
    assert_eq!(site.reports(), [Ok(1024)]);
}

/// ASCII: a character error discards its telegram. [TIA help "PtP data link CP 340", "STATUS parameter"]
#[test]
fn unreadable_characters_have_their_numbers() {
    use ob1_firmware::LineFault::{Framing, Overrun, Parity};
    for (fault, number) in [(Parity, 0x0810), (Framing, 0x0811), (Overrun, 0x080C)] {
        let mut site = Site::ascii("");
        site.set(61, 1, 1);
        site.pass(10 * MS);
        site.says(b"12");
        site.pass(5 * MS);
        site.bench.fault(fault);
        site.pass(SECOND);
        assert_eq!((site.reports(), site.bench.entries().last()), (vec![Err(number)], Some(&number)));
        site.says(b"345");
        site.pass(SECOND);
        assert_eq!(site.reports(), [Ok(3)], "the next one is whole");
    }
}

/// P_RESET discards waiting telegrams, but not later ones.
#[test]
fn p_reset_empties_the_receive_buffer() {
    let mut site = Site::ascii("");
    for _ in 0..3 {
        site.says(b"12345");
        site.pass(SECOND);
    }
    site.set(60, 6, 1);
    site.pass(SECOND);
    assert_eq!(block(&site.bench.station, 60)[6] & 0b1100, 0, "DONE and ERROR are there for one call");
    assert_eq!(block(&site.bench.station, 60)[7], 1, "DONE was there once");
    site.says(b"678");
    site.pass(SECOND);
    site.set(61, 1, 1);
    site.pass(SECOND);
    assert_eq!(site.reports(), [Ok(3)]);
}

/// 3964R: there is no buffer for a second telegram, or too little of it. 050Eh is for a telegram above 1024 bytes.
#[test]
fn a_full_buffer_over_3964r() {
    for (first, second) in [(1024_usize, 1), (1000, 25)] {
        let mut site = Site::s3964r();
        for length in [first, second] {
            site.bench.device.blocks.push(framed(&vec![b'x'; length]));
            site.says(&[STX]);
            site.pass(3 * SECOND);
        }
        let entries = site.bench.entries();
        assert!(entries.contains(&0x080A) && !entries.contains(&0x050E), "{second} bytes: {entries:04X?}");
        site.set(61, 1, 1);
        site.pass(SECOND);
        assert_eq!(site.reports(), [Ok(first as u16)]);
    }
}

/// "Clear the CP's receive buffer at start-up": yes is the default. [CP 340 manual 04/2011, p. 72]
#[test]
fn a_start_up_empties_the_receive_buffer_or_keeps_it() {
    let kept = vec![Ok(5)];
    for (more, expected) in [("", vec![]), (", clear_buffer = \"yes\"", vec![]), (", clear_buffer = \"no\"", kept)] {
        let mut site = Site::ascii(more);
        site.says(b"12345");
        site.pass(SECOND);
        site.bench.station.cpu.request(ob1_cpu::Command::Stop);
        site.pass(SECOND);
        site.bench.station.cpu.request(ob1_cpu::Command::Run);
        site.pass(SECOND);
        site.set(61, 1, 1);
        site.pass(SECOND);
        assert_eq!(site.reports(), expected, "{more}");
    }
}

/// A wire break raises a diagnostic interrupt with the bytes of the manual. [CP 340 manual 04/2011, p. 143]
#[test]
fn a_wire_break_raises_an_interrupt() {
    let mut site = Site::new("protocol = \"ascii\"", "diagnostics = true");
    site.bench.fault(ob1_firmware::LineFault::Gone);
    site.pass(SECOND);
    assert_eq!(&block(&site.bench.station, 61)[8..12], [0x25, 0x0C, 2, 0]);
    assert!(site.bench.entries().ends_with(&[0x080D]));
    assert_eq!(site.send(5, SECOND), [0x0708], "what is sent into a line that is gone is not done");
}
