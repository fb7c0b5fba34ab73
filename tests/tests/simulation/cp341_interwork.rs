//! CP 341, CP 340 and CP 240 on one line, in virtual time: 3964R and RK 512, each in the active role.

use ob1_time::Span;
use std::fs;
use std::path::{Path, PathBuf};

use ob1_line::sim::FaultRates;
use ob1_tests::sim::{self, Outcome, SECOND, Scenario};

fn examples() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples")
}

fn text(file: &str) -> String {
    fs::read_to_string(examples().join(file)).unwrap_or_else(|error| panic!("{file}: {error}"))
}

/// Station A of an example with a station B defined here.
fn run(example: &str, sources: &[(&str, String)], module: &str, duration: Span, faults: FaultRates) -> Outcome {
    let a = text(&format!("{example}/station-a.toml"));
    run_with(example, &a, sources, ["cp341", module], duration, faults)
}

/// The same with another station file for A, and another type of CP in B.
fn run_with(
    example: &str,
    station_a: &str,
    sources: &[(&str, String)],
    [kind, module]: [&str; 2],
    duration: Span,
    faults: FaultRates,
) -> Outcome {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, text) in sources {
        fs::write(folder.path().join(name), text).expect("a source");
    }
    fs::write(folder.path().join("a.awl"), text(&format!("{example}/a.awl"))).expect("station A");
    fs::write(folder.path().join("station-a.toml"), station_a).expect("station A");
    let b = format!(
        "[station]\nname = \"b\"\n[cpu]\nmin_cycle = \"1ms\"\nwatchdog = \"150ms\"\n[program]\nsources = [\"b.awl\"]\nmnemonics = \"de\"\n\
         [[plugin]]\npath = \"ob1_{kind}\"\n[[module]]\ntype = \"{kind}\"\nname = \"cp\"\n{module}\n"
    );
    fs::write(folder.path().join("station-b.toml"), b).expect("station B");
    let scenario = Scenario { faults, kill_every: Span::ZERO, duration, ..Scenario::demo(folder.path(), 3) };
    sim::run(&scenario).unwrap_or_else(|message| panic!("{message}\nrun: cargo xtask test"))
}

/// The first network of `examples/cp341-pair/b.awl`: sends back every telegram.
fn echo() -> String {
    let pair = text("cp341-pair/b.awl");
    let (before, rest) = pair.split_once("NETWORK\nTITLE = RK 512").expect("the network of RK 512");
    let (_, behind) = rest.split_once("END_ORGANIZATION_BLOCK").expect("the end of OB 1");
    let echo = format!("{before}END_ORGANIZATION_BLOCK{behind}");
    // For telegrams of up to 250 bytes.
    echo.replace("ARRAY [0..121] OF WORD", "ARRAY [0..2047] OF WORD")
}

const S3964R: &str = "address = 272\nline = \"serial:null-modem.pty\"\n\
                      params = { protocol = \"3964r\", BAUD parity = \"none\", priority = \"low\" }";

#[test]
fn a_cp_240_and_a_cp_341_over_3964r() {
    let baud = text("two-stations/station-a.toml");
    let baud = baud.split_once("baud = ").and_then(|(_, rest)| rest.split_once(',')).expect("the rate of A").0;
    let module = S3964R.replace("BAUD", &format!("baud = {baud},"));
    for (faults, seconds) in [(FaultRates::NONE, 20), (FaultRates::all(100), 40)] {
        let outcome = run("two-stations", &[("b.awl", echo())], &module, seconds * SECOND, faults);
        assert_eq!(outcome.verdict.broken, Vec::<String>::new(), "{}", outcome.log);
        assert!(outcome.verdict.get("good") > 50, "{}", outcome.verdict);
        if faults == FaultRates::NONE {
            for column in ["error", "aborted", "wrong", "doubled", "late", "lost"] {
                assert_eq!(outcome.verdict.get(column), 0, "{column}\n{}\n{}", outcome.verdict, outcome.log);
            }
        }
    }
}

/// A CP 340 sends back the telegrams of a CP 240: over 3964R and ASCII.
#[test]
fn a_cp_240_and_a_cp_340_over_3964r_and_ascii() {
    let a = text("two-stations/station-a.toml");
    let baud = a.split_once("baud = ").and_then(|(_, rest)| rest.split_once(',')).expect("the rate of A").0;
    let a = a.replace(&format!("baud = {baud}"), "baud = 19200");
    let echo = text("cp340-pair/b.awl").replace("ARRAY [0..121] OF WORD", "ARRAY [0..511] OF WORD");
    let (before, rest) = a.split_once("params = {").expect("parameters of A");
    let (_, behind) = rest.split_once('}').expect("their end");
    let bare = "protocol = \"ascii\", baud = 19200, data_bits = 8, parity = \"none\", zvz_ms = 40";
    let ascii = format!("{before}params = {{ {bare} }}{behind}");
    let b = |params: &str| format!("address = 272\nline = \"serial:null-modem.pty\"\nparams = {{ {params} }}");
    let s3964r = b("protocol = \"3964r\", baud = 19200, parity = \"none\", priority = \"low\"");
    let bare = b(&format!("{bare}, clear_buffer = \"no\""));
    for (a, b, faults) in [(&a, &s3964r, 0), (&a, &s3964r, 100), (&ascii, &bare, 0)] {
        let (sources, faults) = ([("b.awl", echo.clone())], FaultRates::all(faults));
        let outcome = run_with("two-stations", a, &sources, ["cp340", b], 30 * SECOND, faults);
        assert_eq!(outcome.verdict.broken, Vec::<String>::new(), "{}", outcome.log);
        assert!(outcome.verdict.get("good") > 30, "{}", outcome.verdict);
        if faults == FaultRates::all(0) {
            for column in ["error", "aborted", "wrong", "doubled", "late"] {
                assert_eq!(outcome.verdict.get(column), 0, "{column}\n{}\n{}", outcome.verdict, outcome.log);
            }
            // ASCII: a telegram that A sends before B is ready is lost without an error.
            let before_b = u64::from(a == &ascii);
            assert_eq!(outcome.verdict.get("lost"), before_b, "{}\n{}", outcome.verdict, outcome.log);
        }
    }
}

/// A CP 341 that serves the SEND and FETCH of `examples/rk512-pair/a.awl`: P_RCV_RK moves the data, the program passes
/// on the block.
const SERVER: &str = r"
ORGANIZATION_BLOCK OB 1
VAR_TEMP
  INFO : ARRAY [1..20] OF BYTE;
END_VAR
BEGIN
CALL FB 7, DB 7
  EN_R := TRUE
  R := FALSE
  LADDR := 256
  DB_NO := 21
  DBB_NO := 0
  NDR := M1.0
  ERROR := M1.1
      U     M 1.1;
      SPBN  flag;
      L     DB20.DBD 0;
      L     L#1;
      +D;
      T     DB20.DBD 0;
flag: UN    M 6.4;
      BEB;
      L     200;
cpy:  T     MW 46;
      L     1;
      -I;
      SLD   3;
      T     MD 40;
      AUF   DB 21;
      L     DBB [MD 40];
      AUF   DB 22;
      T     DBB [MD 40];
      L     MW 46;
      LOOP  cpy;
      CLR;
      =     M 6.4;
END_ORGANIZATION_BLOCK

DATA_BLOCK DB 7
FB 7
BEGIN
END_DATA_BLOCK

DATA_BLOCK DB 20
STRUCT
  ERRORS : DINT;
END_STRUCT;
BEGIN
END_DATA_BLOCK

DATA_BLOCK DB 21
STRUCT
  DATA : ARRAY [0..99] OF WORD;
END_STRUCT;
BEGIN
END_DATA_BLOCK

DATA_BLOCK DB 22
STRUCT
  DATA : ARRAY [0..99] OF WORD;
END_STRUCT;
BEGIN
END_DATA_BLOCK
";

#[test]
fn a_cp_240_sends_to_and_fetches_from_a_cp_341_over_rk_512() {
    let module = "address = 256\nline = \"serial:null-modem.pty\"\n\
                  params = { protocol = \"3964r-rk512\", baud = 115200, parity = \"none\", priority = \"low\" }";
    let outcome = run("rk512-pair", &[("b.awl", SERVER.into())], module, 20 * SECOND, FaultRates::NONE);
    assert_eq!(outcome.verdict.broken, Vec::<String>::new(), "{}", outcome.log);
    for column in ["error", "aborted", "wrong"] {
        assert_eq!(outcome.verdict.get(column), 0, "{column}\n{}\n{}", outcome.verdict, outcome.log);
    }
    assert!(outcome.verdict.get("good") > 50, "{}", outcome.verdict);
    let b = outcome.stations.iter().find(|station| station.name == "b").expect("station B");
    assert_eq!(b.ledger(20, 0), 0, "errors of P_RCV_RK");
}
