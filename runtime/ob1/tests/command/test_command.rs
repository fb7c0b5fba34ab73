//! `ob1 test` through the binary: the examples, what failing looks like, what cannot be used.

use std::path::Path;
use std::process::{Command, Output, Stdio};

const PROGRAM: &str = "\
ORGANIZATION_BLOCK OB 1
VAR_TEMP
  START_INFO : ARRAY [1..20] OF BYTE;
END_VAR
BEGIN
NETWORK
      U     E      0.0;
      L     S5T#2S;
      SE    T      1;
      U     T      1;
      =     A      4.0;
      L     PEW  512;
      T     PAW  520;
      U     M      2.0;
      SPBN  ok;
      AUF   DB    77;
ok:   U     M      2.1;
      SPBN  end;
loop: SPA   loop;
end:  NOP   0;
END_ORGANIZATION_BLOCK

FUNCTION FC 10 : INT
VAR_INPUT
  A : INT;
  R : REAL;
  T : TIMER;
END_VAR
VAR_OUTPUT
  TWICE : REAL;
END_VAR
VAR_IN_OUT
  COUNT : INT;
END_VAR
BEGIN
NETWORK
      L     #R;
      L     2.0;
      *R    ;
      T     #TWICE;
      L     #COUNT;
      +     1;
      T     #COUNT;
      L     #A;
      NEGI  ;
      T     #RET_VAL;
END_FUNCTION

FUNCTION_BLOCK FB 3
VAR_INPUT
  STEP : INT := 5;
END_VAR
VAR_OUTPUT
  SUM : INT;
END_VAR
VAR
  CALLS : INT;
  WORDS : STRING [10] := 'abc';
END_VAR
BEGIN
NETWORK
      L     #SUM;
      L     #STEP;
      +I    ;
      T     #SUM;
      L     #CALLS;
      +     1;
      T     #CALLS;
END_FUNCTION_BLOCK

DATA_BLOCK DB 5
STRUCT
  PLACE : STRUCT
    X : ARRAY [1..3] OF INT := 1, 2, 3;
    NAME : STRING [8] := 'left';
  END_STRUCT;
END_STRUCT;
BEGIN
END_DATA_BLOCK
";

struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    /// With a program and one test file, whose head is there already.
    fn new(tests: &str) -> Self {
        let bench = Self { folder: tempfile::tempdir().expect("a directory") };
        bench.write("p.awl", PROGRAM);
        bench.write("p.test.toml", &format!("sources = [\"p.awl\"]\n{tests}"));
        bench
    }

    fn path(&self) -> &Path {
        self.folder.path()
    }

    fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path().join(name), text).expect("writable");
    }

    fn test(&self, args: &[&str]) -> (Option<i32>, String) {
        let output = ob1_test(self.path(), args);
        (output.status.code(), String::from_utf8_lossy(&output.stdout).into_owned())
    }

    fn passes(&self, count: usize) {
        let (code, text) = self.test(&[]);
        assert_eq!(code, Some(0), "{text}");
        assert!(text.ends_with(&format!("{count} passed, 0 failed\n")), "{text}");
    }
}

fn ob1_test(folder: &Path, args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ob1"));
    command.arg("test").args(args).current_dir(folder).stdin(Stdio::null()).output().expect("ob1 starts")
}

#[test]
fn the_examples_pass() {
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples");
    let output = ob1_test(&examples, &[]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stdout).contains("23 passed, 0 failed"), "{output:?}");
}

#[test]
fn cells_of_every_kind() {
    Bench::new(
        "
[[test]]
name = \"all\"
inputs = { \"E 0.0\" = true, \"PEW 512\" = \"16#1234\" }
[[test.step]]
expect = { \"A 4.0\" = false, \"T 1\" = \"2s\", \"PAW 520\" = \"16#1234\", \"PEB 512\" = 18 }
[[test.step]]
at = \"500ms\"
expect = { \"T 1\" = \"1500ms\" }
[[test.step]]
at = \"2s\"
expect = { \"A 4.0\" = true, \"T 1\" = true, \"EB 0\" = 1, \"AW 4\" = \"16#0100\" }
[[test.step]]
set = { \"DB5.PLACE.X[2]\" = -7, \"Z 3\" = 12, \"E 0.0\" = false }
expect = { \"DB5.PLACE.X[2]\" = -7, \"DB5.DBW 0\" = 1, \"DB5.PLACE.NAME\" = \"left\", \"Z 3\" = 12, \"A 4.0\" = false }
[[test.step]]
scans = 5
expect = { \"Z 3\" = true, \"MD 200\" = { near = 0.4, within = 0.5 } }
",
    )
    .passes(1);
}

#[test]
fn one_block_alone() {
    Bench::new(
        "
[[test]]
name = \"a function\"
call = \"FC 10\"
with = { T = \"T 7\" }
[[test.step]]
set = { A = 5, R = 1.25 }
expect = { TWICE = 2.5, RET_VAL = -5, COUNT = 1 }
[[test.step]]
set = { count = 100 }
scans = 3
expect = { Count = 103, \"A 4.0\" = false }
[[test]]
name = \"a function block keeps what is not set\"
call = \"FB 3\"
[[test.step]]
scans = 2
expect = { SUM = 10, CALLS = 2, WORDS = \"abc\" }
[[test.step]]
set = { STEP = 1 }
expect = { SUM = 11 }
[[test]]
name = \"a system function\"
call = \"SFC 20\"
with = { SRCBLK = \"P#M 0.0 BYTE 2\", DSTBLK = \"P#M 10.0 BYTE 2\" }
[[test.step]]
set = { \"MW 0\" = 1234 }
expect = { \"MW 10\" = 1234, RET_VAL = 0 }
",
    )
    .passes(3);
}

#[test]
fn stop_and_its_reason() {
    Bench::new(
        "
[[test]]
name = \"a fault\"
[[test.step]]
set = { \"M 2.0\" = true }
state = \"STOP\"
diagnostics = [\"4562h\", \"253Ah\"]
[[test.step]]
command = \"warm\"
state = \"RUN\"
[[test]]
name = \"a loop without end\"
[[test.step]]
set = { \"M 2.1\" = true }
state = \"STOP\"
diagnostics = [\"4568h\"]
",
    )
    .passes(2);
}

#[test]
fn what_does_not_hold_is_told_with_its_line() {
    let bench = Bench::new(
        "
[[test]]
name = \"wrong\"
[[test.step]]
set = { \"E 0.0\" = true }
run = \"2s\"
expect = { \"A 4.0\" = true, \"MW 0\" = 3,
           \"DB5.PLACE.NAME\" = \"right\" }
[[test.step]]
expect = { \"MW 0\" = 4 }
[[test]]
name = \"stopped & gone\"
[[test.step]]
set = { \"M 2.0\" = true }
[[test]]
name = \"right\"
[[test.step]]
expect = { \"MW 0\" = 0 }
[[test]]
name = \"late\"
[[test.step]]
run = \"1s\"
[[test.step]]
at = \"500ms\"
[[test]]
name = \"never\"
[[test.step]]
within = \"1s\"
expect = { \"A 4.0\" = true }
",
    );
    let (code, text) = bench.test(&["--junit", "r.xml"]);
    assert_eq!(code, Some(1), "{text}");
    for part in [
        "FAILED p.test.toml: wrong (2.000 s)\n",
        "  p.test.toml:8: A 4.0: expected true, found false (step 1, 2.000 s, scan 201)\n",
        "  p.test.toml:8: MW 0: expected 3 (16#0003), found 0 (16#0000) (step 1, ",
        "  p.test.toml:9: DB5.PLACE.NAME: expected 'right', found 'left' (step 1, ",
        "  p.test.toml:14: the CPU is in STOP; 4562h",
        "ok     p.test.toml: right",
        "  p.test.toml:25: this time has already passed: it is 1.000 s",
        "  p.test.toml:30: A 4.0: expected true, found false (step 1, 1.000 s, scan 101)",
        "1 passed, 4 failed\n",
    ] {
        assert!(text.contains(part), "{part}\nis not in\n{text}");
    }
    assert!(!text.contains("expected 4"), "a test ends with its first failing step: {text}");
    let junit = std::fs::read_to_string(bench.path().join("r.xml")).expect("the report");
    assert!(junit.contains("tests=\"5\" failures=\"4\" errors=\"0\""), "{junit}");
    assert!(junit.contains("stopped &amp; gone"), "{junit}");
    assert_eq!(bench.test(&["--filter", "right"]).0, Some(0));
    assert_eq!(bench.test(&["--filter", "no such test"]).0, Some(2));
    assert_eq!(bench.test(&["missing"]).0, Some(2));
}

#[test]
fn what_cannot_be_used_is_told_before_anything_runs() {
    let step = "\n[[test.step]]\nexpect = { \"MW 0\" = 0 }\n";
    for (text, line, part) in [
        ("[[test]]\nname = \"a\"\n[[test.step]]\nexpct = {}\n", 5, "did you mean `expect`?"),
        ("[[test]]\nname = \"a\"\n", 3, "a test without a step"),
        ("", 1, "there is no test"),
        ("[[test]]\nname = \"a\"\n[[test.step]]\nset = { \"MX 0\" = 1 }\n", 5, "not the name of a cell"),
        ("[[test]]\nname = \"a\"\n[[test.step]]\nset = { \"MB 0\" = 256 }\n", 5, "does not fit"),
        ("[[test]]\nname = \"a\"\ninputs = { \"MB 0\" = 1 }\n[[test.step]]\n", 4, "is not an input"),
        ("[[test]]\nname = \"a\"\n[[test.step]]\nrun = \"1s\"\nscans = 1\n", 6, "given twice"),
        ("[[test]]\nname = \"a\"\n[[test.step]]\nwithin = \"1s\"\n", 4, "waits for nothing"),
        ("[[test]]\nname = \"a\"\n[[test.step]]\ndiagnostics = [\"xyz\"]\n", 5, "not the number of an event"),
        ("[[test]]\nname = \"a\"\ncall = \"FC 99\"\n[[test.step]]\n", 4, "FC 99 is not there"),
        ("[[test]]\nname = \"a\"\ncall = \"FC 10\"\n[[test.step]]\n", 4, "T is a TIMER and needs an actual"),
        (
            "[[test]]\nname = \"a\"\ncall = \"FC 10\"\nwith = { T = \"M 0.0\" }\n[[test.step]]\n",
            4,
            "cannot be called in this way",
        ),
        ("[[test]]\nname = \"a\"\ncall = \"FB 3\"\nwith = { X = \"1\" }\n[[test.step]]\n", 5, "has no parameter X"),
        ("cycle = \"0ms\"\n[[test]]\nname = \"a\"\n[[test.step]]\n", 2, "the cycle time is 0"),
        ("station = \"s.toml\"\n[[test]]\nname = \"a\"\n[[test.step]]\n", 1, "a station and sources"),
    ] {
        let good = format!("[[test]]\nname = \"good\"{step}");
        let (code, output) = Bench::new(&format!("{text}{}", if text.is_empty() { "" } else { &good })).test(&[]);
        assert_eq!(code, Some(2), "{text}\n{output}");
        assert!(output.contains(part), "{part}\nis not in\n{output}");
        assert!(output.contains(&format!("p.test.toml:{line}:")), "line {line}\nis not in\n{output}");
        assert!(output.ends_with("0 passed, 0 failed, 1 file cannot be used\n"), "{output}");
    }
    let bench = Bench::new(&format!("[[test]]\nname = \"good\"{step}"));
    bench.write("p.awl", "nonsense");
    let (code, output) = bench.test(&["--junit", "r.xml"]);
    assert_eq!(code, Some(2), "{output}");
    assert!(output.contains("p.awl:1:1: error S0101"), "{output}");
    let junit = std::fs::read_to_string(bench.path().join("r.xml")).expect("the report");
    assert!(junit.contains("errors=\"1\"") && junit.contains("<error message="), "{junit}");
}

/// A fault in SCL is told with its line.
#[test]
fn a_fault_in_scl_has_its_line() {
    let bench = Bench::new("");
    let scl = "ORGANIZATION_BLOCK OB1\nVAR_TEMP\n    info : ARRAY[0..19] OF BYTE;\n    i : INT;\nEND_VAR\nBEGIN\n    i := 5;\n    \
               DB9.DW[i * 1000] := 16#1;\n    i := 6;\nEND_ORGANIZATION_BLOCK\nDATA_BLOCK DB9\nSTRUCT\n    n : INT;\n\
               END_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n";
    bench.write("p.scl", scl);
    bench.write(
        "p.test.toml",
        "sources = [\"p.scl\"]\n[[test]]\nname = \"beyond\"\n[[test.step]]\nexpect = { \"MW 0\" = 0 }\n",
    );
    let (code, text) = bench.test(&[]);
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains("the CPU is in STOP") && text.contains("line 8"), "{text}");
}
