//! Jobs of P_SND_RK over RK 512 as a table, between two CP 341 in virtual time: the results of P_SND_RK and of
//! P_RCV_RK. [TIA help "PtP data link CP 341"] (docs/cp341-events.md)
//!
//! Station A gives the jobs in DB 60 one after the other and writes their results to DB 61; station B writes the
//! reports of P_RCV_RK to DB 71.

use ob1_time::Span;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use ob1_tests::sim::station::SimStation;
use ob1_tests::sim::{self, Outcome, SECOND, Scenario};

/// A job: its kind, the location in A, the request to B.
#[derive(Clone, Copy)]
struct Job {
    sf: char,
    r_typ: char,
    db_no: i32,
    dbb_no: i32,
    len: i32,
    r_cpu_no: i32,
    r_no: i32,
    r_offset: i32,
    cf: (i32, i32),
}

const SEND: Job =
    Job { sf: 'S', r_typ: 'D', db_no: 10, dbb_no: 0, len: 10, r_cpu_no: 1, r_no: 31, r_offset: 0, cf: (255, 0) };
const FETCH: Job = Job { sf: 'F', db_no: 12, ..SEND };

/// A report of P_RCV_RK: NDR with (L_TYP, L_NO, L_OFFSET, LEN), ERROR with STATUS, or nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Report {
    Nothing,
    Ndr(char, u16, u16, u16),
    Error(u16),
}

use Report::{Error, Ndr, Nothing};

/// Job, STATUS in A (0: DONE), report in B.
const JOBS: &[(Job, u16, Report)] = &[
    // SEND to DB and DX; odd lengths and offsets.
    (Job { len: 1, ..SEND }, 0, Ndr('D', 31, 0, 2)),
    (Job { r_offset: 7, ..SEND }, 0, Ndr('D', 31, 6, 10)),
    (Job { r_typ: 'X', r_no: 5, len: 33, ..SEND }, 0, Ndr('D', 40, 100, 34)),
    (Job { r_no: 32, len: 4096, ..SEND }, 0, Ndr('D', 32, 0, 4096)),
    (Job { r_cpu_no: 3, ..SEND }, 0, Ndr('D', 31, 0, 10)),
    // FETCH of every area.
    (Job { db_no: 11, r_no: 32, len: 4096, ..FETCH }, 0, Ndr('D', 32, 0, 4096)),
    (Job { r_no: 32, len: 33, ..FETCH }, 0, Ndr('D', 32, 0, 34)),
    (Job { r_typ: 'M', dbb_no: 40, r_offset: 60, len: 3, ..FETCH }, 0, Ndr('M', 0, 60, 3)),
    (Job { r_typ: 'E', dbb_no: 44, r_offset: 0, len: 2, ..FETCH }, 0, Ndr('E', 0, 0, 2)),
    (Job { r_typ: 'A', dbb_no: 46, r_offset: 5, len: 1, ..FETCH }, 0, Ndr('A', 0, 5, 1)),
    (Job { r_typ: 'Z', dbb_no: 48, r_offset: 3, len: 32, ..FETCH }, 0, Ndr('Z', 0, 3, 32)),
    (Job { r_typ: 'T', dbb_no: 80, r_offset: 0, len: 32, ..FETCH }, 0, Ndr('T', 0, 0, 32)),
    // At most 16 timers or counters. A DX cannot be fetched from a CP 341.
    (Job { r_typ: 'Z', r_offset: 3, len: 34, ..FETCH }, 0x0902, Error(0x0607)),
    (Job { r_typ: 'T', len: 34, ..FETCH }, 0x0902, Error(0x0607)),
    (Job { r_typ: 'X', ..FETCH }, 0x090B, Error(0x0604)),
    // DB missing or too short; bit memory beyond its end.
    (Job { r_no: 99, ..SEND }, 0x0903, Error(0x0606)),
    (Job { r_no: 99, ..FETCH }, 0x0903, Error(0x0606)),
    (Job { r_offset: 500, len: 100, ..SEND }, 0x0903, Error(0x0607)),
    (Job { r_offset: 500, len: 100, ..FETCH }, 0x0903, Error(0x0607)),
    (Job { r_typ: 'M', r_offset: 250, len: 100, ..FETCH }, 0x0902, Error(0x0607)),
    // The coordination flag: set by the first job, it locks the second, also a FETCH.
    (Job { cf: (50, 3), ..SEND }, 0, Ndr('D', 31, 0, 10)),
    (Job { cf: (50, 3), ..SEND }, 0x0909, Error(0x060F)),
    (Job { cf: (50, 3), ..FETCH }, 0x0909, Error(0x060F)),
    (Job { cf: (50, 4), ..FETCH }, 0, Ndr('D', 31, 0, 10)),
    // Invalid jobs: refused by P_SND_RK.
    (Job { sf: 's', ..SEND }, 0x0301, Nothing),
    (Job { r_typ: 'd', ..SEND }, 0x0301, Nothing),
    (Job { r_typ: 'M', ..SEND }, 0x0301, Nothing),
    (Job { r_no: 0, ..SEND }, 0x0514, Nothing),
    (Job { r_no: 256, ..SEND }, 0x0514, Nothing),
    (Job { r_offset: 512, ..SEND }, 0x0514, Nothing),
    (Job { r_typ: 'M', r_offset: 256, ..FETCH }, 0x0514, Nothing),
    (Job { cf: (50, 8), ..SEND }, 0x0515, Nothing),
    (Job { cf: (256, 0), ..SEND }, 0x0301, Nothing),
    (Job { r_cpu_no: 5, ..SEND }, 0x0516, Nothing),
    (Job { len: 0, ..SEND }, 0x1E41, Nothing),
    (Job { len: -1, ..SEND }, 0x1E41, Nothing),
    (Job { len: 4097, ..SEND }, 0x1E41, Nothing),
    // Then a valid job succeeds.
    (SEND, 0, Ndr('D', 31, 0, 10)),
];

const A: &str = r"
ORGANIZATION_BLOCK OB 1
VAR_TEMP
  INFO : ARRAY [1..20] OF BYTE;
END_VAR
BEGIN
CALL FC 30
CALL FB 8, DB 8
  SF := MB100
  REQ := M80.0
  R := FALSE
  LADDR := 256
  DB_NO := MW102
  DBB_NO := MW104
  LEN := MW106
  R_CPU_NO := MW108
  R_TYP := MB101
  R_NO := MW110
  R_OFFSET := MW112
  R_CF_BYT := MW114
  R_CF_BIT := MW116
  DONE := M81.1
  ERROR := M81.2
  STATUS := MW94
END_ORGANIZATION_BLOCK

ORGANIZATION_BLOCK OB 100
VAR_TEMP
  INFO : ARRAY [1..20] OF BYTE;
END_VAR
BEGIN
      AUF   DB 10;
      L     2048;
fill: T     MW 120;
      L     1;
      -I;
      SLD   4;
      T     MD 84;
      L     MW 120;
      L     257;
      *I;
      T     DBW [MD 84];
      L     MW 120;
      LOOP  fill;
END_ORGANIZATION_BLOCK

FUNCTION FC 30 : VOID
BEGIN
      U     M 81.0;
      SPBN  idle;
      L     MW 92;
      L     1;
      +I;
      T     MW 92;
      CLR;
      =     M 80.0;
      U     M 81.1;
      O     M 81.2;
      NOT;
      BEB;
      L     MW 90;
      SLD   6;
      T     MD 84;
      AUF   DB 61;
      L     MW 94;
      T     DBW [MD 84];
      L     MD 84;
      L     L#16;
      +D;
      T     MD 84;
      L     MW 92;
      T     DBW [MD 84];
      L     MD 84;
      L     L#16;
      +D;
      T     MD 84;
      L     MB 81;
      T     DBB [MD 84];
      L     MW 90;
      L     1;
      +I;
      T     MW 90;
      CLR;
      =     M 81.0;
      BEA;
idle: L     MW 90;
      L     JOBS;
      >=I;
      BEB;
      L     MW 96;
      L     1;
      +I;
      T     MW 96;
      L     50;
      <I;
      BEB;
      L     MW 90;
      L     144;
      *I;
      T     MD 84;
      AUF   DB 60;
ROWS      SET;
      =     M 81.0;
      =     M 80.0;
      L     0;
      T     MW 92;
      T     MW 96;
END_FUNCTION

DATA_BLOCK DB 8
FB 8
BEGIN
END_DATA_BLOCK
";

const B: &str = r"
ORGANIZATION_BLOCK OB 1
VAR_TEMP
  INFO : ARRAY [1..20] OF BYTE;
END_VAR
BEGIN
CALL FB 7, DB 7
  EN_R := TRUE
  R := FALSE
  LADDR := 256
  DB_NO := 40
  DBB_NO := 100
  L_TYP := MB20
  L_NO := MW22
  L_OFFSET := MW24
  L_CF_BYT := MW26
  L_CF_BIT := MW28
  NDR := M1.0
  ERROR := M1.1
  LEN := MW30
  STATUS := MW32
      O     M 1.0;
      O     M 1.1;
      SPBN  stop;
      L     MW 34;
      L     96;
      *I;
      T     MD 36;
      AUF   DB 71;
      L     MB 1;
      T     DBB [MD 36];
LOG      L     MW 34;
      L     1;
      +I;
      T     MW 34;
stop: L     MW 34;
      L     STOP_AT;
      <I;
      BEB;
      L     MW 44;
      L     1;
      +I;
      T     MW 44;
      L     100;
      >I;
      BEB;
      L     MW 44;
      L     30;
      <I;
      BEB;
      CALL  SFC 46;
END_ORGANIZATION_BLOCK

ORGANIZATION_BLOCK OB 100
VAR_TEMP
  INFO : ARRAY [1..20] OF BYTE;
END_VAR
BEGIN
      L     W#16#1234;
      T     MW 60;
      L     B#16#56;
      T     MB 62;
      L     B#16#A5;
      T     AB 5;
      L     C#123;
      SET;
      S     Z 3;
END_ORGANIZATION_BLOCK

DATA_BLOCK DB 7
FB 7
BEGIN
END_DATA_BLOCK
";

fn data_block(number: u16, bytes: usize) -> String {
    format!(
        "\nDATA_BLOCK DB {number}\nSTRUCT\n  DATA : ARRAY [0..{}] OF BYTE;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n",
        bytes - 1
    )
}

/// DB 60: a row of 9 words for each job.
fn job_table(jobs: &[(Job, u16, Report)]) -> String {
    let mut text = String::from("\nDATA_BLOCK DB 60\nSTRUCT\n");
    for (n, (job, ..)) in jobs.iter().enumerate() {
        let _ = writeln!(text, "  SF{n} : CHAR := '{}';\n  TYP{n} : CHAR := '{}';", job.sf, job.r_typ);
        let ints = [job.db_no, job.dbb_no, job.len, job.r_cpu_no, job.r_no, job.r_offset, job.cf.0, job.cf.1];
        for (i, value) in ints.into_iter().enumerate() {
            let _ = writeln!(text, "  V{n}_{i} : INT := {value};");
        }
    }
    text + "END_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n"
}

/// `L DBW [from]`, `T MW to`, then the next word.
fn copy_words(pointer: u32, from: &[&str], to: &[&str]) -> String {
    let mut text = String::new();
    for (from, to) in from.iter().zip(to) {
        let _ = write!(
            text,
            "      L     {from};\n      T     {to};\n      L     MD {pointer};\n      L     L#16;\n      +D;\n      T     MD {pointer};\n"
        );
    }
    text
}

fn station(name: &str, plugins: &str, module: &str) -> String {
    format!(
        "[station]\nname = \"{name}\"\n[cpu]\nmin_cycle = \"1ms\"\nwatchdog = \"500ms\"\n[program]\nsources = [\"{name}.awl\"]\nmnemonics = \"de\"\n\
         {plugins}\n[[module]]\nname = \"cp\"\naddress = 256\n{module}\n"
    )
}

const CP341: &str = "[[plugin]]\npath = \"ob1_cp341\"";

fn module(line: &str, priority: &str) -> String {
    format!(
        "type = \"cp341\"\nline = \"{line}\"\n\
         params = {{ protocol = \"3964r-rk512\", baud = 115200, priority = \"{priority}\" }}"
    )
}

/// Station A with these jobs.
fn write_a(folder: &Path, jobs: &[(Job, u16, Report)]) {
    let row: Vec<String> = (0..9).map(|n| format!("MW{}", 100 + 2 * n)).collect();
    let row: Vec<&str> = row.iter().map(String::as_str).collect();
    let a = A.replace("ROWS", &copy_words(84, &["DBW [MD 84]"; 9], &row)).replace("JOBS", &jobs.len().to_string());
    let a = a + &job_table(jobs) + &data_block(61, 8 * jobs.len()) + &data_block(10, 4096) + &data_block(11, 4096);
    fs::write(folder.join("a.awl"), a + &data_block(12, 200)).expect("a.awl");
    fs::write(folder.join("station-a.toml"), station("a", CP341, &module("pty:cable", "high")))
        .expect("station-a.toml");
}

fn simulate(folder: &Path, duration: Span) -> Outcome {
    let scenario = Scenario::demo(folder, 1).undisturbed(duration);
    sim::run(&scenario).unwrap_or_else(|message| panic!("{message}\nrun: cargo xtask test"))
}

/// Runs the jobs; B goes to STOP 30 scans after `stop_at` reports.
fn run(jobs: &[(Job, u16, Report)], stop_at: usize, duration: Span) -> Outcome {
    let folder = tempfile::tempdir().expect("a folder");
    write_a(folder.path(), jobs);
    let log = copy_words(36, &["MW20", "MW22", "MW24", "MW30", "MW32", "MW26"], &["DBW [MD 36]"; 6]);
    // The first word of a row is L_TYP with the bits NDR and ERROR before it.
    let log = log.replacen("      L     MW20;", "      L     MB 1;\n      SLW   8;\n      L     MB 20;\n      OW;", 1);
    let b = B.replace("LOG", &log).replace("STOP_AT", &stop_at.to_string());
    let b = b + &data_block(71, 12 * (jobs.len() + 4)) + &data_block(31, 512) + &data_block(32, 4096);
    fs::write(folder.path().join("b.awl"), b + &data_block(40, 300)).expect("b.awl");
    let b = station("b", CP341, &module("serial:cable", "low"));
    fs::write(folder.path().join("station-b.toml"), b).expect("station-b.toml");
    simulate(folder.path(), duration)
}

fn word(station: &SimStation, db: u16, at: usize) -> u16 {
    (station.ledger(db, at & !3) >> if at.is_multiple_of(4) { 16 } else { 0 }) as u16
}

/// STATUS in A (0: DONE) and the number of calls.
fn end_of(a: &SimStation, job: usize) -> Option<(u16, u16)> {
    let flags = a.ledger(61, 8 * job + 4) >> 24;
    let (status, calls) = (word(a, 61, 8 * job), word(a, 61, 8 * job + 2));
    match flags & 0b110 {
        0b010 => (status == 0).then_some((0, calls)),
        0b100 => (status != 0).then_some((status, calls)),
        _ => None,
    }
}

/// The n-th report of P_RCV_RK.
fn report(b: &SimStation, n: usize) -> Report {
    let word = |i: usize| word(b, 71, 12 * n + 2 * i);
    match word(0) >> 8 & 0b11 {
        0b01 => Ndr((word(0) as u8) as char, word(1), word(2), word(3)),
        0b10 => Error(word(4)),
        _ => Nothing,
    }
}

#[test]
fn every_job_ends_as_the_tables_say() {
    let outcome = run(JOBS, 999, 20 * SECOND);
    let [a, b] = &outcome.stations[..] else { panic!("two stations") };
    let mut reports = 0;
    for (n, (_, status, expected)) in JOBS.iter().enumerate() {
        let (found, calls) = end_of(a, n).unwrap_or_else(|| panic!("job {n} has not ended\n{}", outcome.log));
        assert_eq!(format!("{found:04X}"), format!("{status:04X}"), "job {n}\n{}", outcome.log);
        assert!(calls >= 3 || *status >= 0x1E00, "job {n}: {calls} calls");
        if *expected != Nothing {
            assert_eq!(report(b, reports), *expected, "report {reports}, of job {n}\n{}", outcome.log);
            reports += 1;
        }
    }
    assert_eq!(report(b, reports), Nothing, "nothing else was reported");
    // Checks the data.
    let bytes = |station: &SimStation, db: u16| station.cpu.data_block(db).expect("the data block").to_vec();
    let sent = bytes(a, 10);
    assert_eq!(bytes(b, 32)[..4096], sent[..4096]);
    assert_eq!(bytes(a, 11)[..4096], sent[..4096]);
    assert_eq!(bytes(b, 40)[100..134], [&sent[..33], &[0]].concat());
    let fetched = bytes(a, 12);
    assert_eq!(fetched[40..43], [0x12, 0x34, 0x56], "bit memory");
    assert_eq!((fetched[46], &fetched[48..50]), (0xA5, &[0x01, 0x23][..]), "outputs, counter 3");
}

/// The reverse is tested in `cp341_interwork`.
#[test]
fn a_cp_240_serves_a_cp_341() {
    let folder = tempfile::tempdir().expect("a folder");
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/rk512-pair/b.awl");
    let b = fs::read_to_string(example).expect("the program of the CP 240");
    // It sends no own orders.
    let b = b.replace("PAUSE : BOOL;", "PAUSE : BOOL := TRUE;");
    let jobs = [
        (Job { r_no: 21, len: 200, ..SEND }, 0, Nothing),
        (Job { r_no: 21, len: 200, ..FETCH }, 0, Nothing),
        (Job { r_typ: 'M', r_offset: 6, len: 1, ..FETCH }, 0, Nothing),
        (Job { r_no: 99, ..SEND }, 0x0903, Nothing),
        (Job { r_no: 21, r_offset: 100, len: 102, ..FETCH }, 0x0903, Nothing),
        (Job { r_typ: 'X', r_no: 21, ..FETCH }, 0x090B, Nothing),
        // The CP 240 has a limit of 1024 bytes.
        (Job { r_no: 21, len: 1026, ..SEND }, 0x0903, Nothing),
        (Job { r_no: 21, cf: (6, 4), ..SEND }, 0, Nothing),
    ];
    write_a(folder.path(), &jobs);
    fs::write(folder.path().join("b.awl"), b).expect("b.awl");
    let module = "type = \"cp240\"\nline = \"serial:cable\"\nparams = { protocol = \"3964r-rk512\", baud = 115200, parity = \"even\", \
                  priority = \"low\" }";
    let b = station("b", "[[plugin]]\npath = \"ob1_cp240\"", module);
    fs::write(folder.path().join("station-b.toml"), b).expect("station-b.toml");
    let outcome = simulate(folder.path(), 10 * SECOND);
    let a = &outcome.stations[0];
    for (n, (_, status, _)) in jobs.iter().enumerate() {
        let found = end_of(a, n).map(|(found, _)| format!("{found:04X}"));
        assert_eq!(found, Some(format!("{status:04X}")), "job {n}\n{}", outcome.log);
    }
    let sent = a.cpu.data_block(10).expect("DB 10")[..200].to_vec();
    assert_eq!(outcome.stations[1].cpu.data_block(21).expect("DB 21")[..200], sent);
}

#[test]
fn a_partner_in_stop_answers_2ah() {
    let jobs = [(SEND, 0, Ndr('D', 31, 0, 10)), (SEND, 0x090D, Nothing), (FETCH, 0x090D, Nothing)];
    let outcome = run(&jobs, 1, 5 * SECOND);
    let [a, b] = &outcome.stations[..] else { panic!("two stations") };
    assert_eq!(report(b, 0), jobs[0].2);
    assert_eq!(b.cpu.state(), ob1_cpu::OperatingState::Stop);
    for (n, (_, status, _)) in jobs.iter().enumerate() {
        assert_eq!(end_of(a, n).map(|(found, _)| found), Some(*status), "job {n}\n{}", outcome.log);
    }
}
