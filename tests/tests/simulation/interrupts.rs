//! Events of a CP besides its registers, through all layers in virtual time: diagnostic interrupts of a bad line (OB
//! 82), and an absent CP with `absent = "fault"` in the station file (OB 86, OB 85 at the process image, OB 122 at an
//! access).
//!
//! Station A of the demo, with additional organization blocks that count in DB 90.

use ob1_time::Span;
use std::fs;
use std::path::Path;

use ob1_line::sim::FaultRates;
use ob1_tests::sim::{self, Outcome, SECOND, Scenario};

/// The counters in DB 90, with the layout of [`INTERRUPTS`].
mod count {
    pub(crate) const DIAGNOSIS_COMES: usize = 0;
    pub(crate) const DIAGNOSIS_GOES: usize = 4;
    pub(crate) const IMAGE_ERRORS: usize = 8;
    pub(crate) const STATION_LOST: usize = 12;
    pub(crate) const STATION_BACK: usize = 16;
    pub(crate) const ACCESS_ERRORS: usize = 20;
    /// The four bytes of the last incoming diagnostic interrupt.
    pub(crate) const DIAGNOSIS: usize = 24;
    /// Logical address in the last start information of OB 82, high word; of OB 122, low word.
    pub(crate) const ADDRESSES: usize = 28;
}

const INTERRUPTS: &str = r"
DATA_BLOCK DB 90
STRUCT
  COUNT : ARRAY [0..5] OF DINT;
  DIAGNOSIS : DWORD;
  MDL_ADDR : WORD;
  MEM_ADDR : WORD;
END_STRUCT;
BEGIN
END_DATA_BLOCK

ORGANIZATION_BLOCK OB 82
VAR_TEMP
  INFO : ARRAY [1..20] OF BYTE;
END_VAR
BEGIN
      L     LW 6;
      T     DB90.DBW 28;
      L     LB 0;
      L     B#16#39;
      ==I;
      SPBN  goes;
      L     LD 8;
      T     DB90.DBD 24;
      L     DB90.DBD 0;
      +     L#1;
      T     DB90.DBD 0;
      BEA;
goes: L     DB90.DBD 4;
      +     L#1;
      T     DB90.DBD 4;
END_ORGANIZATION_BLOCK

ORGANIZATION_BLOCK OB 85
VAR_TEMP
  INFO : ARRAY [1..20] OF BYTE;
END_VAR
BEGIN
      L     DB90.DBD 8;
      +     L#1;
      T     DB90.DBD 8;
END_ORGANIZATION_BLOCK

ORGANIZATION_BLOCK OB 86
VAR_TEMP
  INFO : ARRAY [1..20] OF BYTE;
END_VAR
BEGIN
      L     LB 0;
      L     B#16#39;
      ==I;
      SPBN  back;
      L     DB90.DBD 12;
      +     L#1;
      T     DB90.DBD 12;
      BEA;
back: L     DB90.DBD 16;
      +     L#1;
      T     DB90.DBD 16;
END_ORGANIZATION_BLOCK

ORGANIZATION_BLOCK OB 122
VAR_TEMP
  INFO : ARRAY [1..20] OF BYTE;
END_VAR
BEGIN
      L     LW 6;
      T     DB90.DBW 30;
      L     DB90.DBD 20;
      +     L#1;
      T     DB90.DBD 20;
END_ORGANIZATION_BLOCK
";

/// The demo's stations, with an additional key for A's module, and with `address` instead of 0.
fn stations(key: &str, address: u16) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let demo = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/two-stations");
    let read = |name: &str| fs::read_to_string(demo.join(name)).expect("the demo");
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).expect("a file");
    let station = read("station-a.toml");
    let module = format!("address = {address}\n{key}\n");
    // A CPU of the 400 family reports image errors at each transfer; one of the 300 family reads 0 silently.
    let changed = station
        .replace("watchdog = \"150ms\"\n", "watchdog = \"150ms\"\nfamily = 400\n")
        .replace("sources = [\"a.awl\"]", "sources = [\"a.awl\", \"interrupts.awl\"]")
        .replace("address = 0\n", &module);
    assert!(changed.contains("interrupts.awl") && changed.contains("family") && changed.contains(key), "{changed}");
    write("station-a.toml", &changed);
    let program = read("a.awl");
    assert_eq!(program.matches("ADR        :=0 ").count(), 3);
    write("a.awl", &program.replace("ADR        :=0 ", &format!("ADR        :={address} ")));
    write("interrupts.awl", INTERRUPTS);
    for name in ["station-b.toml", "b.awl"] {
        write(name, &read(name));
    }
    folder
}

fn run(folder: &tempfile::TempDir, faults: FaultRates, kill_every: Span) -> Outcome {
    let scenario = Scenario {
        faults,
        kill_every,
        duration: 40 * SECOND,
        coalesce: Span::ZERO,
        ..Scenario::demo(folder.path(), 3)
    };
    let outcome = sim::run(&scenario).unwrap_or_else(|message| {
        panic!("{message}\nThis test needs the plugins that `cargo xtask test` builds; run: cargo xtask test")
    });
    assert_eq!(outcome.verdict.broken, Vec::<String>::new(), "{}", outcome.log);
    outcome
}

fn cell(outcome: &Outcome, byte: usize) -> u32 {
    outcome.stations[0].ledger(90, byte)
}

#[test]
fn what_lights_er_raises_ob_82() {
    let framing = FaultRates { framing: 100, ..FaultRates::NONE };
    let outcome = run(&stations("diagnostics = true", 0), framing, Span::ZERO);
    let (comes, goes) = (cell(&outcome, count::DIAGNOSIS_COMES), cell(&outcome, count::DIAGNOSIS_GOES));
    // ER stays on for 4 s and the line is good in the last part of the run: each incoming error has become outgoing.
    assert!(comes > 0 && comes == goes, "{comes} came, {goes} went\n{}", outcome.log);
    assert_eq!(cell(&outcome, count::DIAGNOSIS), 0x050C_0200, "{}", outcome.log);
    assert_eq!(cell(&outcome, count::ADDRESSES) >> 16, 0, "the module's address");
}

#[test]
fn without_the_switch_there_is_no_ob_82() {
    let framing = FaultRates { framing: 100, ..FaultRates::NONE };
    let outcome = run(&stations("diagnostics = false", 0), framing, Span::ZERO);
    assert_eq!(cell(&outcome, count::DIAGNOSIS_COMES), 0, "{}", outcome.log);
    assert!(outcome.verdict.get("good") > 0, "{}", outcome.verdict);
}

#[test]
fn a_cp_that_is_gone_is_an_image_error_inside_the_process_image() {
    let outcome = run(&stations("absent = \"fault\"", 0), FaultRates::NONE, 3 * SECOND);
    let (lost, back) = (cell(&outcome, count::STATION_LOST), cell(&outcome, count::STATION_BACK));
    assert!(outcome.kills > 0 && lost > 0, "{} killed\n{}", outcome.kills, outcome.log);
    assert!(back == lost || back == lost + 1, "{lost} lost, {back} back");
    assert!(cell(&outcome, count::IMAGE_ERRORS) >= lost, "OB 85 at each transfer\n{}", outcome.log);
}

#[test]
fn a_cp_that_is_gone_is_an_access_error_behind_the_process_image() {
    let outcome = run(&stations("absent = \"fault\"", 1024), FaultRates::NONE, 3 * SECOND);
    let lost = cell(&outcome, count::STATION_LOST);
    assert!(outcome.kills > 0 && lost > 0, "{} killed\n{}", outcome.kills, outcome.log);
    assert!(cell(&outcome, count::ACCESS_ERRORS) >= lost, "{}", outcome.log);
    assert_eq!(cell(&outcome, count::ADDRESSES) & 0xFFFF, 1024, "the address that was read");
    assert_eq!(cell(&outcome, count::IMAGE_ERRORS), 0, "{}", outcome.log);
}

#[test]
fn by_default_a_cp_that_is_gone_reads_zero() {
    let outcome = run(&stations("absent = \"zero\"", 1024), FaultRates::NONE, 3 * SECOND);
    assert!(outcome.kills > 0, "{}", outcome.log);
    assert_eq!((cell(&outcome, count::ACCESS_ERRORS), cell(&outcome, count::IMAGE_ERRORS)), (0, 0), "{}", outcome.log);
}
