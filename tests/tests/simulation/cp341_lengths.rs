//! Two whole CP 341 stations in virtual time, all boundary lengths, and random ones: 3964R, RK 512 SEND to D and X,
//! FETCH of every area up to its limit and one beyond it, odd offsets and lengths, coordination flag. For each job the
//! whole data blocks on both sides and the outputs of both blocks are compared. [TIA help "PtP data link CP 341"]
//!
//! Both stations have the same program, controlled by the test. DB 60 has the parameters of P_SND_RK, DB 61 the outputs
//! of P_RCV_RK. DB 10 has the data to send, DB 12 the fetched data; the partner accesses DB 31 (512 bytes), DB 32 and
//! DB 40 (for telegrams without header and for DX).

use std::fs;

use ob1_cpu::{Cell, Width};
use ob1_line::sim::SplitMix64;
use ob1_model::Area;
use ob1_tests::sim::station::SimStation;
use ob1_tests::sim::{self, SECOND, Scenario};

use crate::common::cp341::{INSTANCES, data_block};

/// Boundary lengths: words, pieces of 32 bytes to the CPU, telegrams of 128 bytes, the range of a byte, the maximum.
const BOUNDARIES: [i32; 21] =
    [1, 2, 3, 31, 32, 33, 127, 128, 129, 130, 254, 255, 256, 257, 258, 1023, 1024, 1025, 4094, 4095, 4096];

/// Random jobs for each direction.
const RANDOM_JOBS: usize = 40;

const PROGRAM: &str = r"
ORGANIZATION_BLOCK OB 1
VAR_TEMP
  INFO : ARRAY [1..20] OF BYTE;
END_VAR
BEGIN
CALL SFC 20 (SRCBLK := P#DB62.DBX 0.0 BYTE 128, RET_VAL := DB60.DBW 30, DSTBLK := P#E 0.0 BYTE 128);
CALL FB 7, DB 7
  EN_R := TRUE
  R := FALSE
  LADDR := 256
  DB_NO := 40
  DBB_NO := 0
  L_TYP := DB61.DBB 2
  L_NO := DB61.DBW 4
  L_OFFSET := DB61.DBW 6
  L_CF_BYT := DB61.DBW 8
  L_CF_BIT := DB61.DBW 10
  NDR := DB61.DBX 0.0
  ERROR := DB61.DBX 0.1
  LEN := DB61.DBW 12
  STATUS := DB61.DBW 14
CALL FB 8, DB 8
  SF := DB60.DBB 0
  REQ := DB60.DBX 2.0
  R := FALSE
  LADDR := 256
  DB_NO := DB60.DBW 4
  DBB_NO := DB60.DBW 6
  LEN := DB60.DBW 8
  R_CPU_NO := 1
  R_TYP := DB60.DBB 1
  R_NO := DB60.DBW 10
  R_OFFSET := DB60.DBW 12
  R_CF_BYT := DB60.DBW 14
  R_CF_BIT := DB60.DBW 16
  DONE := DB60.DBX 20.0
  ERROR := DB60.DBX 20.1
  STATUS := DB60.DBW 22
      U     DB60.DBX 24.0;          // the data have been used
      R     M 200.7;
      R     DB60.DBX 24.0;
END_ORGANIZATION_BLOCK

ORGANIZATION_BLOCK OB 100
VAR_TEMP
  INFO : ARRAY [1..20] OF BYTE;
END_VAR
BEGIN
      L     C#123;
      SET;
      S     Z 3;
      L     C#999;
      S     Z 255;
      L     S5T#2H;
      SE    T 5;
END_ORGANIZATION_BLOCK
";

/// Data blocks and their bytes.
const BLOCKS: [(u16, usize); 8] =
    [(10, 4200), (12, 4200), (31, 512), (32, 4096), (40, 4096), (60, 32), (61, 16), (62, 128)];

/// A job of P_SND_RK.
#[derive(Clone, Copy, Debug)]
struct Job {
    sf: char,
    r_typ: char,
    dbb_no: i32,
    len: i32,
    r_no: i32,
    r_offset: i32,
    cf: (i32, i32),
    /// The partner's program resets the flag of an earlier job first.
    releases: bool,
    /// STATUS (0: DONE).
    status: u16,
    report: Report,
}

/// A report of P_RCV_RK: NDR with (L_TYP, L_NO, L_OFFSET, LEN), or ERROR with STATUS.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Report {
    Ndr(char, u16, u16, u16),
    Error(u16),
}

use Report::{Error, Ndr};

const JOB: Job = Job {
    sf: 'S',
    r_typ: 'D',
    dbb_no: 0,
    len: 10,
    r_no: 32,
    r_offset: 0,
    cf: (255, 0),
    releases: true,
    status: 0,
    report: Ndr('D', 32, 0, 10),
};

/// Number of bytes in RK 512: words, with a fill byte.
fn even(len: i32) -> u16 {
    (len + len % 2) as u16
}

fn send(r_typ: char, len: i32) -> Job {
    let (r_no, report) = if r_typ == 'X' { (9, Ndr('D', 40, 0, even(len))) } else { (32, Ndr('D', 32, 0, even(len))) };
    Job { r_typ, len, r_no, report, ..JOB }
}

fn fetch(len: i32) -> Job {
    Job { sf: 'F', len, report: Ndr('D', 32, 0, even(len)), ..JOB }
}

/// FETCH of an area; `letter` is the area letter for the partner.
fn area(r_typ: char, letter: char, r_offset: i32, len: i32) -> Job {
    let bytes = if matches!(letter, 'T' | 'Z') { even(len) } else { len as u16 };
    Job { sf: 'F', r_typ, len, r_no: 0, r_offset, report: Ndr(letter, 0, r_offset as u16, bytes), ..JOB }
}

impl Job {
    /// The job fails with this STATUS here and with `there` at the partner's P_RCV_RK.
    fn fails(self, status: u16, there: u16) -> Self {
        Self { status, report: Error(there), ..self }
    }

    fn has_data_in(self, db: u16) -> bool {
        self.status == 0 && self.report == self.at(db)
    }

    /// The report with this data block and otherwise the same values.
    fn at(self, db: u16) -> Report {
        match self.report {
            Ndr(letter, _, offset, len) => Ndr(letter, db, offset, len),
            error => error,
        }
    }
}

/// The content of a data block before a job: different for every job.
fn filling(job: usize, place: usize, db: u16, bytes: usize) -> Vec<u8> {
    let mut rng = SplitMix64::new((job as u64) << 32 | (place as u64) << 16 | u64::from(db));
    (0..bytes).map(|_| rng.next_u64() as u8).collect()
}

/// Bit memory: the same content, but the byte with the coordination flags is 0.
fn memory(job: usize, place: usize) -> Vec<u8> {
    let mut memory = filling(job, place, 1, 256);
    memory[200] = 0;
    memory
}

fn fill(station: &mut SimStation, cell: impl Fn(u32) -> Cell, data: &[u8]) {
    for (at, bytes) in (0..).step_by(4).zip(data.chunks(4)) {
        let value = bytes.iter().fold(0, |value, byte| value << 8 | u32::from(*byte));
        let width = if bytes.len() == 4 { Width::DWord } else { Width::Byte };
        assert!(width == Width::DWord || bytes.len() == 1, "whole double words");
        station.cpu.write(cell(8 * at), width, value).expect("a cell of the program");
    }
}

fn fill_block(station: &mut SimStation, db: u16, data: &[u8]) {
    fill(station, |bit| Cell::Db(db, bit), data);
}

fn block(station: &SimStation, db: u16) -> &[u8] {
    station.cpu.data_block(db).expect("a data block of the program")
}

fn word(station: &SimStation, db: u16, at: usize) -> u16 {
    u16::from_be_bytes([block(station, db)[at], block(station, db)[at + 1]])
}

fn put(station: &mut SimStation, at: u32, width: Width, value: i32) {
    let value = if width == Width::Word { u32::from(value as u16) } else { value as u32 };
    station.cpu.write(Cell::Db(60, 8 * at), width, value).expect("DB 60");
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Phase {
    /// The data of the partner must be prepared.
    Prepare,
    Begin,
    Running,
}

/// Jobs of one station for the other.
#[derive(Debug)]
struct Direction {
    active: usize,
    jobs: Vec<Job>,
    at: usize,
    phase: Phase,
    /// The result of the current job.
    end: Option<u16>,
    report: Option<Report>,
    /// The expected content of DB 12: for a FETCH of an area, the values of the partner.
    fetched: Vec<u8>,
    cycles: u32,
}

impl Direction {
    fn new(active: usize, jobs: Vec<Job>) -> Self {
        Self { active, jobs, at: 0, phase: Phase::Prepare, end: None, report: None, fetched: Vec::new(), cycles: 0 }
    }

    fn is_done(&self) -> bool {
        self.at == self.jobs.len()
    }

    fn look(&mut self, place: usize, station: &mut SimStation) {
        if self.is_done() {
            return;
        }
        if place != self.active {
            return self.look_passive(station);
        }
        self.look_active(station);
        if let (Some(end), Some(report)) = (self.end, self.report) {
            let job = self.jobs[self.at];
            assert_eq!((end, report), (job.status, job.report), "{end:04X}h, job {}: {job:?}", self.at);
            self.check_active(station, job);
            (self.at, self.phase, self.end, self.report) = (self.at + 1, Phase::Prepare, None, None);
        }
    }

    fn look_active(&mut self, station: &mut SimStation) {
        let job = self.jobs[self.at];
        match self.phase {
            Phase::Prepare => {}
            Phase::Begin => {
                for db in [10, 12] {
                    fill_block(station, db, &filling(self.at, self.active, db, 4200));
                }
                put(station, 0, Width::Byte, job.sf as i32);
                put(station, 1, Width::Byte, job.r_typ as i32);
                let db = if job.sf == 'S' { 10 } else { 12 };
                let words = [db, job.dbb_no, job.len, job.r_no, job.r_offset, job.cf.0, job.cf.1];
                for (at, value) in (4..).step_by(2).zip(words) {
                    put(station, at, Width::Word, value);
                }
                put(station, 2, Width::Byte, 1);
                (self.phase, self.cycles) = (Phase::Running, 0);
            }
            Phase::Running => {
                put(station, 2, Width::Byte, 0);
                self.cycles += 1;
                assert!(self.cycles < 30_000, "job {} does not end: {job:?}", self.at);
                let (flags, status) = (block(station, 60)[20], word(station, 60, 22));
                assert_eq!(status != 0, flags == 0b10, "STATUS goes with ERROR");
                if flags != 0 {
                    assert!(self.end.is_none() && (flags == 0b01 || flags == 0b10), "one end: {job:?}");
                    self.end = Some(status);
                }
            }
        }
    }

    /// Checks that DB 12 has exactly the fetched data, and that DB 10 is unchanged.
    fn check_active(&self, station: &SimStation, job: Job) {
        let mut expected = filling(self.at, self.active, 12, 4200);
        if job.sf == 'F' && job.status == 0 {
            let (from, len) = (job.dbb_no as usize, job.len as usize);
            expected[from..from + len].copy_from_slice(&self.fetched[..len]);
        }
        assert!(block(station, 12) == expected, "DB 12 after job {}: {job:?}", self.at);
        assert!(block(station, 10) == filling(self.at, self.active, 10, 4200), "DB 10 after job {}: {job:?}", self.at);
    }

    fn look_passive(&mut self, station: &mut SimStation) {
        let (job, passive) = (self.jobs[self.at], 1 - self.active);
        if self.phase == Phase::Prepare {
            for (db, bytes) in [(31, 512), (32, 4096), (40, 4096), (62, 128)] {
                fill_block(station, db, &filling(self.at, passive, db, bytes));
            }
            if job.cf.0 == 255 {
                fill(station, |bit| Cell::Area(Area::Memory, bit), &memory(self.at, passive));
            }
            fill(station, |bit| Cell::Area(Area::Output, bit), &filling(self.at, passive, 2, 128));
            put(station, 24, Width::Byte, i32::from(job.releases));
            self.phase = Phase::Begin;
            return;
        }
        let flags = block(station, 61)[0];
        let (len, status) = (word(station, 61, 12), word(station, 61, 14));
        assert_eq!(status != 0, flags == 0b10, "STATUS goes with ERROR");
        let report = match flags {
            0 => return,
            0b01 => Ndr(char::from(block(station, 61)[2]), word(station, 61, 4), word(station, 61, 6), len),
            _ => Error(status),
        };
        assert!(self.report.is_none(), "job {}: a second report, {report:?}, after {:?}", self.at, self.report);
        self.report = Some(report);
        if flags == 0b01 {
            let flag = (i32::from(word(station, 61, 8)), i32::from(word(station, 61, 10)));
            assert_eq!(flag, job.cf, "the flag of job {}", self.at);
        } else {
            assert_eq!(len, 0, "LEN without NDR");
        }
        self.check_passive(station, job);
    }

    /// Checks that the target has the sent data with the fill byte, and that nothing else has changed; notes the
    /// fetched data for the other side.
    fn check_passive(&mut self, station: &mut SimStation, job: Job) {
        let (passive, offset) = (1 - self.active, (job.r_offset & !1) as usize);
        let source = filling(self.at, self.active, 10, 4200);
        for (db, bytes) in [(31, 512), (32, 4096), (40, 4096)] {
            let mut expected = filling(self.at, passive, db, bytes);
            let is_without_header = self.report == Some(Ndr('\0', 0, 0, job.len as u16)) && db == 40;
            if job.sf == 'S' && (job.has_data_in(db) || is_without_header) {
                let (from, len) = (job.dbb_no as usize, job.len as usize);
                let to = if db == 40 { 0 } else { offset };
                expected[to..to + len].copy_from_slice(&source[from..from + len]);
                if !is_without_header && len % 2 == 1 {
                    expected[to + len] = 0;
                }
            }
            assert!(block(station, db) == expected, "DB {db} after job {}: {job:?}", self.at);
        }
        if job.sf == 'F' && job.status == 0 {
            let len = usize::from(even(job.len));
            let at = job.r_offset as usize;
            let mut words = |cell: fn(u16) -> Cell| -> Vec<u8> {
                (at..at + len / 2)
                    .flat_map(|n| station.cpu.read(cell(n as u16), Width::Word).expect("it is there").to_be_bytes())
                    .collect::<Vec<u8>>()
                    .chunks(4)
                    .flat_map(|value| [value[2], value[3]])
                    .collect()
            };
            self.fetched = match job.report {
                Ndr('T', ..) => words(Cell::Timer),
                // A counter value is three decimal digits.
                Ndr('Z', ..) => {
                    let counts = words(Cell::Counter);
                    let bcd = |n: u16| u16::from_str_radix(&n.to_string(), 16).expect("digits");
                    counts.chunks(2).flat_map(|c| bcd(u16::from_be_bytes([c[0], c[1]])).to_be_bytes()).collect()
                }
                Ndr('M', ..) => memory(self.at, passive)[at..].to_vec(),
                Ndr('A', ..) => filling(self.at, passive, 2, 128)[at..].to_vec(),
                Ndr('E', ..) => filling(self.at, passive, 62, 128)[at..].to_vec(),
                Ndr(_, db, ..) => filling(self.at, passive, db, block(station, db).len())[offset..].to_vec(),
                Error(_) => Vec::new(),
            };
        }
    }
}

/// Runs the jobs of both stations.
fn run(protocol: &str, jobs: [Vec<Job>; 2]) {
    run_at("1ms", protocol, jobs);
}

/// The same with another minimum cycle time of station B.
fn run_at(cycle: &str, protocol: &str, jobs: [Vec<Job>; 2]) {
    let folder = tempfile::tempdir().expect("a folder");
    let blocks = BLOCKS.map(|(db, bytes)| data_block(db, bytes)).concat();
    let program = [PROGRAM, INSTANCES, &blocks].concat();
    fs::write(folder.path().join("program.awl"), program).expect("the program");
    for (name, line, priority, cycle) in [("a", "pty:cable", "high", "1ms"), ("b", "serial:cable", "low", cycle)] {
        let file = format!(
            "[station]\nname = \"{name}\"\n[cpu]\nmin_cycle = \"{cycle}\"\nwatchdog = \"500ms\"\n\
             [program]\nsources = [\"program.awl\"]\nmnemonics = \"de\"\n[[plugin]]\npath = \"ob1_cp341\"\n\
             [[module]]\ntype = \"cp341\"\nname = \"cp\"\naddress = 256\nline = \"{line}\"\n\
             params = {{ protocol = \"{protocol}\", baud = 115200, priority = \"{priority}\" }}\n"
        );
        fs::write(folder.path().join(format!("station-{name}.toml")), file).expect("a station file");
    }
    let duration = 600 * SECOND;
    let scenario = Scenario::demo(folder.path(), 1).undisturbed(duration);
    let [of_a, of_b] = jobs;
    let mut directions = [Direction::new(0, of_a), Direction::new(1, of_b)];
    let outcome = sim::run_with(&scenario, |place, station| {
        directions.iter_mut().for_each(|direction| direction.look(place, station));
        !directions.iter().all(Direction::is_done)
    });
    let outcome = outcome.unwrap_or_else(|message| panic!("{message}\nrun: cargo xtask test"));
    for direction in &directions {
        assert!(direction.is_done(), "job {} has not ended\n{}", direction.at, outcome.log);
    }
}

/// A telegram without header.
fn telegram(len: i32) -> Job {
    Job { len, report: Ndr('\0', 0, 0, len as u16), ..JOB }
}

#[test]
fn every_boundary_over_3964r() {
    run("3964r", [BOUNDARIES.map(telegram).to_vec(), BOUNDARIES.map(telegram).to_vec()]);
}

#[test]
fn every_boundary_as_send_to_d() {
    run("3964r-rk512", [BOUNDARIES.map(|len| send('D', len)).to_vec(), vec![]]);
}

#[test]
fn every_boundary_as_send_to_x() {
    run("3964r-rk512", [BOUNDARIES.map(|len| send('X', len)).to_vec(), vec![]]);
}

#[test]
fn every_boundary_as_fetch_of_d() {
    run("3964-rk512", [BOUNDARIES.map(fetch).to_vec(), vec![]]);
}

/// A CPU with a cycle of 100 ms needs 13 s for 4096 bytes: it is slow, but the transfer is not aborted after 10 s as if
/// the CPU took nothing. [TIA help "PtP data link CP 341"]
#[test]
fn a_slow_cpu_is_waited_for() {
    run_at("100ms", "3964r-rk512", [vec![send('D', 4096), fetch(4096)], vec![]]);
}

/// Both stations at the same time, random lengths and offsets.
#[test]
fn random_jobs_in_both_directions() {
    let jobs = |seed: u64, protocol: &str| -> Vec<Job> {
        let mut rng = SplitMix64::new(seed);
        let mut below = move |n: u64| rng.below(n) as i32;
        let mut any = || {
            let (len, dbb_no, word) = (1 + below(4096), below(100), below(200));
            // Most are short, because long ones take much time.
            let len = if below(4) > 0 { 1 + len % 300 } else { len };
            if protocol == "3964r" {
                return Job { dbb_no, ..telegram(len) };
            }
            let fits = |job: Job| {
                let len = len.min(4094 - 2 * word);
                let report = Ndr('D', 32, 2 * word as u16, even(len));
                // An odd offset is rounded down.
                Job { dbb_no, len, r_offset: 2 * word + word % 2, report, ..job }
            };
            match below(4) {
                0 => Job { dbb_no, ..send('X', len) },
                1 => fits(fetch(len)),
                2 => {
                    let (at, letter) = (below(100), ['M', 'E', 'A'][below(3) as usize]);
                    Job { dbb_no, ..area(letter, letter, at, 1 + below(28)) }
                }
                _ => fits(send('D', len)),
            }
        };
        (0..RANDOM_JOBS).map(|_| any()).collect()
    };
    for (seed, protocol) in [(1, "3964r"), (3, "3964r-rk512"), (5, "3964r-rk512")] {
        run(protocol, [jobs(seed, protocol), jobs(seed + 1, protocol)]);
    }
}

/// Up to the limit of each area, and one beyond it: bit memory has 256 bytes here, inputs and outputs 128, timers and
/// counters 256, of which a CP 341 gives 16. [TIA help "PtP data link CP 341"]
#[test]
fn every_area_to_its_limit_and_beyond() {
    let mut jobs = Vec::new();
    for (r_typ, letter, bytes) in
        [('M', 'M', 256), ('E', 'E', 128), ('I', 'E', 128), ('A', 'A', 128), ('Q', 'A', 128), ('O', 'A', 128)]
    {
        let last = bytes - 1;
        for (at, len) in [(0, 1), (1, 3), (0, bytes), (1, last), (last, 1), (last - 1, 2)] {
            jobs.push(area(r_typ, letter, at, len));
        }
        for (at, len) in [(0, bytes + 1), (1, bytes), (last, 2), (0, 4096)] {
            jobs.push(area(r_typ, letter, at, len).fails(0x0902, 0x0607));
        }
    }
    for (r_typ, letter) in [('Z', 'Z'), ('C', 'Z'), ('T', 'T')] {
        for (at, len) in [(0, 1), (0, 2), (3, 3), (0, 32), (240, 32), (255, 2), (240, 31)] {
            jobs.push(area(r_typ, letter, at, len));
        }
        for (at, len) in [(0, 33), (0, 34), (241, 32), (255, 4), (0, 512)] {
            jobs.push(area(r_typ, letter, at, len).fails(0x0902, 0x0607));
        }
    }
    // A valid address in a header that the area does not have.
    jobs.push(area('E', 'E', 128, 1).fails(0x0902, 0x0607));
    jobs.push(area('A', 'A', 255, 1).fails(0x0902, 0x0607));
    for len in [1, 2, 4096] {
        jobs.push(Job { r_typ: 'X', r_no: 32, ..fetch(len) }.fails(0x090B, 0x0604));
    }
    run("3964r-rk512", [jobs, vec![]]);
}

/// Odd offsets and lengths; a data block to its end and beyond it, and a missing one; the coordination flag.
#[test]
fn places_and_flags() {
    let d31 = |job: Job, r_offset: i32, len: i32| {
        let report = Ndr('D', 31, (r_offset & !1) as u16, even(len));
        Job { r_no: 31, r_offset, len, report, ..job }
    };
    let flag = |job: Job| Job { cf: (200, 7), ..job };
    let jobs = vec![
        d31(JOB, 7, 5),
        d31(JOB, 7, 6),
        Job { dbb_no: 3, ..d31(JOB, 0, 9) },
        d31(fetch(1), 9, 7),
        Job { dbb_no: 5, ..d31(fetch(1), 11, 33) },
        // To the end of the data block: 512 bytes.
        d31(JOB, 0, 512),
        d31(JOB, 0, 511),
        d31(JOB, 510, 2),
        d31(JOB, 510, 1),
        d31(fetch(1), 510, 2),
        d31(fetch(1), 1, 511),
        d31(JOB, 0, 513).fails(0x0903, 0x0607),
        d31(JOB, 510, 3).fails(0x0903, 0x0607),
        d31(fetch(1), 0, 514).fails(0x0903, 0x0607),
        d31(fetch(1), 508, 5).fails(0x0903, 0x0607),
        Job { r_no: 99, ..JOB }.fails(0x0903, 0x0606),
        Job { r_no: 99, len: 4096, ..JOB }.fails(0x0903, 0x0606),
        Job { r_no: 255, ..fetch(1) }.fails(0x0903, 0x0606),
        // The flag is set by the first job, and reset by the partner's program or not.
        flag(JOB),
        Job { releases: false, ..flag(JOB) }.fails(0x0909, 0x060F),
        Job { releases: false, ..flag(send('X', 300)) }.fails(0x0909, 0x060F),
        Job { releases: false, ..flag(fetch(300)) }.fails(0x0909, 0x060F),
        flag(fetch(300)),
        Job { releases: false, ..flag(JOB) }.fails(0x0909, 0x060F),
        flag(send('X', 300)),
        Job { releases: false, ..flag(send('X', 300)) }.fails(0x0909, 0x060F),
        // Another flag is another lock.
        Job { releases: false, cf: (200, 6), ..JOB },
        flag(JOB),
    ];
    run("3964r-rk512", [jobs, vec![]]);
}
