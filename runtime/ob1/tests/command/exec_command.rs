//! `ob1 exec`: its contract, through the binary.

use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::Value;

struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    /// With one source, `p.awl`.
    fn new(source: &str) -> Self {
        let bench = Self { folder: tempfile::tempdir().expect("a directory") };
        bench.write("p.awl", source);
        bench
    }

    fn path(&self) -> &Path {
        self.folder.path()
    }

    fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path().join(name), text).expect("writable");
    }

    fn exec(&self, args: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_ob1"));
        command.args(["exec", "p.awl"]).args(args).current_dir(self.path()).stdin(Stdio::null());
        command.output().expect("ob1 starts")
    }

    /// The exit code and the first bytes of bit memory; no bytes where none were dumped.
    fn memory(&self, len: usize, args: &[&str]) -> (Option<i32>, Vec<u8>) {
        let _ = std::fs::remove_file(self.path().join("m.bin"));
        let output = self.exec(&[&["--dump", &format!("M:0:{len}:m.bin")], args].concat());
        (output.status.code(), std::fs::read(self.path().join("m.bin")).unwrap_or_default())
    }

    fn stats(&self, args: &[&str]) -> Value {
        self.exec(&[&["--stats", "s.json"], args].concat());
        serde_json::from_slice(&std::fs::read(self.path().join("s.json")).expect("figures")).expect("JSON")
    }
}

fn ob(number: u16, code: &str) -> String {
    format!(
        "ORGANIZATION_BLOCK OB {number}\nVAR_TEMP\n START_INFO : ARRAY [1..20] OF BYTE;\nEND_VAR\nBEGIN\nNETWORK\n{code}\n\
         END_ORGANIZATION_BLOCK\n"
    )
}

fn fails(output: &Output, code: i32, part: &str) {
    assert_eq!(output.status.code(), Some(code), "{output:?}");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(stderr.contains(part), "{part} is not in {stderr}");
}

const COUNT: &str = "L MW 0; L 1; +I; T MW 0;";
const COUNT_TO_5: &str = "L MW 0; L 1; +I; T MW 0; L 5; <I; SPB end; CALL SFC 46; end: NOP 0;";

#[test]
fn a_program_that_stops_itself() {
    let bench = Bench::new(&ob(1, COUNT_TO_5));
    assert_eq!(bench.memory(3, &[]), (Some(0), vec![0, 5, 0]));
    assert_eq!(bench.memory(2, &["--engine", "plain"]), (Some(0), vec![0, 5]));
    assert_eq!(bench.memory(2, &["--real-time", "--min-cycle", "0ms"]), (Some(0), vec![0, 5]));
    let stats = bench.stats(&[]);
    // The fifth scan ends in the middle, and counts.
    assert_eq!((stats["schema"].clone(), stats["scans"].clone()), (1.into(), 5.into()));
    assert_eq!((stats["exit"].clone(), stats["ended"].clone()), (0.into(), "stopped".into()));
    assert!(stats["statements"].as_u64() > Some(40) && stats["cpu_seconds"].as_f64() > Some(0.0), "{stats}");
    assert!(stats["statements_per_second"].as_f64() > Some(0.0) && stats["wall_seconds"].as_f64() > Some(0.0));
}

#[test]
fn the_limit_counts_virtual_time() {
    let bench = Bench::new(&ob(1, COUNT));
    assert_eq!(bench.memory(2, &["--limit", "1s"]), (Some(3), vec![3, 232]));
    assert_eq!(bench.memory(2, &["--limit", "1s", "--min-cycle", "10ms"]), (Some(3), vec![0, 100]));
    // Five statements a scan with the block's end.
    assert_eq!(
        bench.memory(2, &["--limit", "1ms", "--min-cycle", "0ms", "--ns-per-statement", "1000"]),
        (Some(3), vec![0, 200])
    );
    let stats = bench.stats(&["--limit", "60s"]);
    assert_eq!((stats["exit"].clone(), stats["scans"].clone()), (3.into(), 60_000.into()));
    assert_eq!(stats["plc_seconds"], 60.0);
    // Real time, too, if requested.
    assert_eq!(bench.exec(&["--limit", "5ms", "--real-time"]).status.code(), Some(3));
}

#[test]
fn a_fault_shows_its_entry_and_leaves_the_dump() {
    let bench = Bench::new(&ob(1, "L 7; T MB 0; L MW 9999; T MB 1;"));
    let output = bench.exec(&["--dump", "M:0:2:m.bin", "--stats", "s.json"]);
    fails(&output, 11, "4562h");
    fails(&output, 11, "OB 1");
    fails(&output, 11, "line 7");
    assert_eq!(std::fs::read(bench.path().join("m.bin")).ok(), Some(vec![7, 0]));
    assert!(std::fs::read_to_string(bench.path().join("s.json")).is_ok_and(|s| s.contains("\"fault\"")));
}

/// On a full disk an earlier file stays as it was, and no empty one is made.
#[test]
fn what_cannot_be_written_leaves_what_was_there() {
    let bench = Bench::new(&ob(1, COUNT_TO_5));
    bench.write("s.json", "earlier");
    let script = format!(
        "trap '' XFSZ; ulimit -f 0; exec {} exec p.awl --stats s.json --dump M:0:2:m.bin",
        env!("CARGO_BIN_EXE_ob1")
    );
    let output = Command::new("sh").args(["-c", &script]).current_dir(bench.path()).output().expect("a shell");
    fails(&output, 6, "s.json: ");
    fails(&output, 6, "m.bin: ");
    assert_eq!(std::fs::read_to_string(bench.path().join("s.json")).ok().as_deref(), Some("earlier"));
    let mut left: Vec<_> = std::fs::read_dir(bench.path()).expect("there").flatten().map(|e| e.file_name()).collect();
    left.sort();
    assert_eq!(left, ["p.awl", "s.json"]);
    // What is no file is not replaced by one.
    let piped = bench.exec(&["--stats", "/dev/stdout", "--quiet"]);
    assert!(String::from_utf8_lossy(&piped.stdout).contains("\"schema\""), "{piped:?}");
}

#[test]
fn loops_without_end_are_ended() {
    let bench = Bench::new(&ob(1, "m: NOP 0; SPA m;"));
    fails(&bench.exec(&[]), 11, "4568h");
    assert_eq!(bench.exec(&["--watchdog", "0ms", "--limit", "1s"]).status.code(), Some(3));
    bench.write("p.awl", &ob(1, "m: CALL SFC 43; SPA m;"));
    assert_eq!(bench.exec(&["--limit", "1s"]).status.code(), Some(3));
    assert_eq!(bench.exec(&["--limit", "5ms", "--watchdog", "5ms", "--real-time"]).status.code(), Some(3));
}

#[test]
fn what_is_rejected_has_its_own_code() {
    let bench = Bench::new("ORGANIZATION_BLOCK OB 1\nBEGIN\nNETWORK\n  SPRNG x;\nEND_ORGANIZATION_BLOCK\n");
    let output = bench.exec(&["--dump", "M:0:1:m.bin"]);
    fails(&output, 10, "p.awl:4");
    assert!(!bench.path().join("m.bin").exists());
    bench.write("p.awl", &ob(1, "CALL FC 77;"));
    fails(&bench.exec(&[]), 10, "FC 77");
    bench.write("p.awl", &ob(1, "U \"lamp\"; = M 0.0;"));
    fails(&bench.exec(&[]), 10, "lamp");
    fails(&bench.exec(&["--symbols", "none.sdf"]), 10, "none.sdf");
    bench.write("s.sdf", "\"lamp                    \",\"M       0.1\",\"BOOL      \",\"\"\n");
    assert_eq!(bench.exec(&["--symbols", "s.sdf", "--limit", "5ms"]).status.code(), Some(3));
}

#[test]
fn mnemonics_are_found_or_named() {
    let bench = Bench::new(&ob(1, "SET; S M 0.0; AN M 0.1; JC end; NOP 0; end: CALL SFC 46;"));
    assert_eq!(bench.memory(1, &[]), (Some(0), vec![1]));
    assert_eq!(bench.memory(1, &["--mnemonics", "en"]), (Some(0), vec![1]));
    assert_eq!(bench.exec(&["--mnemonics", "de"]).status.code(), Some(10));
}

#[test]
fn peripheral_bytes_are_the_process_image() {
    let bench = Bench::new(&ob(1, "L W#16#1234; T EW 20; L PEW 20; T MW 0; T PAW 30; L AW 30; T MW 2; CALL SFC 46;"));
    assert_eq!(bench.memory(4, &[]), (Some(0), vec![0x12, 0x34, 0x12, 0x34]));
    fails(&bench.exec(&["--inputs", "16"]), 11, "OB 1");
    fails(&bench.exec(&["--outputs", "16"]), 11, "OB 1");
}

#[test]
fn the_start_ob_runs_once() {
    let source = [ob(100, "L MB 0; L 1; +I; T MB 0;"), ob(102, "L MB 1; L 1; +I; T MB 1;"), ob(1, COUNT_MB4)].concat();
    let bench = Bench::new(&source);
    assert_eq!(bench.memory(5, &["--limit", "3ms"]), (Some(3), vec![1, 0, 0, 0, 3]));
    assert_eq!(bench.memory(5, &["--limit", "3ms", "--start", "cold"]), (Some(3), vec![0, 1, 0, 0, 3]));
}

#[test]
fn a_hot_start_runs_ob_101_alone() {
    let source = [ob(100, "L 1; T MB 0;"), ob(102, "L 1; T MB 1;"), ob(101, "L 1; T MB 2;"), ob(1, COUNT_MB4)].concat();
    let bench = Bench::new(&source);
    assert_eq!(bench.memory(5, &["--limit", "3ms", "--start", "hot"]), (Some(3), vec![0, 0, 1, 0, 3]));
    // Without the OB the cycle begins at once, as with the others.
    bench.write("p.awl", &ob(1, COUNT_MB4));
    assert_eq!(bench.memory(5, &["--limit", "3ms", "--start", "hot"]), (Some(3), vec![0, 0, 0, 0, 3]));
}

#[test]
fn start_information_is_there_or_not() {
    // Event class and number, priority, OB number of OB 1 in its second cycle.
    let bench = Bench::new(&ob(1, "L LD 0; T MD 0; L MB 4; +1; T MB 4; L 2; <I; SPB end; CALL SFC 46; end: NOP 0;"));
    assert_eq!(bench.memory(4, &[]), (Some(0), vec![0x11, 3, 1, 1]));
    assert_eq!(bench.memory(4, &["--ob-start-info", "on"]), (Some(0), vec![0x11, 3, 1, 1]));
    assert_eq!(bench.memory(4, &["--ob-start-info", "off"]), (Some(0), vec![0; 4]));
}

/// The names of the figures are part of the contract.
#[test]
fn the_figures_have_these_names() {
    let bench = Bench::new(&ob(1, COUNT));
    let stats = bench.stats(&["--limit", "10ms"]);
    let keys: Vec<&str> = stats.as_object().expect("an object").keys().map(String::as_str).collect();
    let names = [
        "cpu_seconds",
        "ended",
        "engine",
        "exit",
        "plc_seconds",
        "scans",
        "schema",
        "statements",
        "statements_per_second",
        "wall_seconds",
    ];
    assert_eq!(keys, names);
    assert_eq!((stats["scans"].as_u64(), stats["statements"].as_u64()), (Some(10), Some(50)));
}

#[test]
fn a_run_that_lasts_gets_machine_code_meanwhile_and_a_short_one_none() {
    let bench = Bench::new(&ob(1, COUNT));
    let run = |limit: u64| {
        let stats = bench.stats(&["--engine", "auto", "--limit", &format!("{limit}s"), "--dump", "M:0:2:m.bin"]);
        assert_eq!((stats["exit"].clone(), stats["scans"].as_u64()), (3.into(), Some(limit * 1000)));
        // Every scan has counted once, whatever engine ran it.
        let memory = std::fs::read(bench.path().join("m.bin")).expect("the dump");
        assert_eq!(memory, ((limit * 1000) as u16).to_be_bytes());
        stats["engine"].as_str().expect("a name").to_owned()
    };
    // It ends before the clock is read.
    assert_eq!(bench.stats(&["--engine", "auto", "--limit", "10ms"])["engine"], "reference");
    // How much virtual time passes before the code is made depends on the machine.
    assert!((8..17).any(|n| run(1 << n) == "native"), "it runs on the reference engine to the end");
}

const COUNT_MB4: &str = "L MB 4; L 1; +I; T MB 4;";

#[test]
fn the_cpu_is_as_wanted() {
    let bench = Bench::new(&ob(1, "L 1; L 2; L 3; L 4; +I; +I; +I; T MW 0; CALL SFC 46;"));
    assert_eq!(bench.memory(2, &["--accumulators", "2"]).0, Some(0));
    bench.write("p.awl", &ob(1, "U M 9.5; SPB on; BEA; on: CALL SFC 46;"));
    // 1 Hz is bit 5 of the clock memory.
    assert_eq!(bench.exec(&["--clock-memory", "9", "--limit", "2s"]).status.code(), Some(0));
    assert_eq!(bench.exec(&["--clock-memory", "9", "--limit", "100ms"]).status.code(), Some(3));
    bench.write("p.awl", &ob(1, "L MB 3000; CALL SFC 46;"));
    assert_eq!(bench.exec(&["--bit-memory", "3001"]).status.code(), Some(0));
    assert_eq!(bench.exec(&["--bit-memory", "3000"]).status.code(), Some(11));
}

#[test]
fn data_blocks_are_dumped_too() {
    let source = ob(1, "L 258; T DB5.DBW 2; CALL SFC 46;");
    let db = "DATA_BLOCK DB 5\nSTRUCT\n A : INT := 3;\n B : INT;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n";
    let bench = Bench::new(&(db.to_owned() + &source));
    assert_eq!(bench.exec(&["--dump", "DB5:0:4:d.bin", "--dump", "M:0:1:m.bin"]).status.code(), Some(0));
    assert_eq!(std::fs::read(bench.path().join("d.bin")).ok(), Some(vec![0, 3, 1, 2]));
    assert_eq!(std::fs::read(bench.path().join("m.bin")).ok(), Some(vec![0]));
}

#[test]
fn what_cannot_be_is_refused_before_anything_runs() {
    let bench = Bench::new(&ob(1, COUNT));
    for (args, part) in [
        (&["--dump", "M:0:99999:m.bin"][..], "has 2048 bytes"),
        (&["--dump", "DB1:0:1:m.bin"], "not loaded"),
        (&["--dump", "M:0"], "AREA:FROM:LEN:FILE"),
        (&["--clock-memory", "5000"], "outside"),
        (&["--accumulators", "3"], "2 or 4"),
        (&["--engine", "warp"], "reference"),
        (&["--virtual-time", "--real-time"], "cannot be used with"),
        (&["--min-cycle", "1"], "unit"),
    ] {
        fails(&bench.exec(args), 1, part);
    }
    fails(&bench.exec(&["--limit", "2ms", "--dump", "M:0:1:no/such/m.bin"]), 6, "no/such/m.bin");
}

#[test]
fn standard_blocks_by_number() {
    let call = |block: &str| ob(1, &format!("L 5; T MW 0; CALL {block} (STR := DB5.S, RET_VAL := MW 2); CALL SFC 46;"));
    let db = "DATA_BLOCK DB 5\nSTRUCT\n S : STRING [20] := 'seven';\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n";
    // LEN, FC 21 of the IEC functions.
    let call = |block: &str| call(block).replace("STR :=", "S :=");
    let bench = Bench::new(&(db.to_owned() + &call("FC 121")));
    fails(&bench.exec(&[]), 10, "FC 121");
    assert_eq!(bench.memory(4, &["--library", "FC121=IEC:FC21"]), (Some(0), vec![0, 5, 0, 5]));
    bench.write("p.awl", &(db.to_owned() + &call("FC 21")));
    assert_eq!(bench.memory(4, &["--library", "FC4=IEC:FC4,FC21=IEC:LEN"]), (Some(0), vec![0, 5, 0, 5]));
    assert_eq!(bench.memory(4, &["--library", "IEC"]), (Some(0), vec![0, 5, 0, 5]));
    fails(&bench.exec(&["--library", "FC21=IEC:FC999"]), 1, "no standard block");
    fails(&bench.exec(&["--library", "FC21=IEC:FC21,FC21=IEC:FC4"]), 1, "FC 21 would be both IEC:FC21 and IEC:FC4");
}

#[test]
fn blocks_that_are_not_there_are_named() {
    for (code, args, parts) in [
        // A block of STEP 7 that we lack, and a number STEP 7 does not use.
        ("CALL SFC 25;", &[][..], &["S0602", "SFC 25 COMPRESS is a block of STEP 7 that this CPU does not have"][..]),
        ("CALL SFC 16;", &[], &["S0602", "SFC 16: 1 use in 1 file"]),
        ("CALL SFB 12, DB 5;", &[], &["S0602", "SFB 12 BSEND"]),
        // Numbers of libraries: all blocks that have it by default.
        ("CALL FC 5;", &[], &["S0602", "IEC:FC5 DI_STRNG", "CP341:FC5 V24_STAT", "--library FC5=IEC:FC5"]),
        // Of them those that have the parameters of the call.
        (
            "CALL FC 2 (IN1 := DB1.a, IN2 := DB1.b, RET_VAL := DB1.c);",
            &[],
            &["S0602", "of this number (IEC:FC2 CONCAT): [library] \"FC 2\" = \"IEC:FC2\""],
        ),
        ("CALL FC 2 (ADR := 256);", &[], &["S0602", "CP240:FC2 FETCH_RK512): [library] \"FC 2\" = \"CP240:FC2\""]),
        // Declared, but nobody serves it.
        (
            "CALL FC 6 (LADDR := 256, RTS := M 0.0, DTR := M 0.1);",
            &["--library", "CP341"],
            &["L020", "OB 1, network 1, line 7 calls FC 6 V24_SET (CP341:FC6)", "p.awl:7"],
        ),
        (
            "CALL FB 8, DB 50 (LADDR := 256);",
            &["--library", "CP341"],
            &["L020", "FB 8 P_SND_RK (CP341:FB8), which is declared only"],
        ),
        ("CALL FC 106 (LADDR := 256);", &["--library", "FC106=CP341:FC6"], &["S0608", "RTS"]),
    ] {
        let output = Bench::new(&ob(1, code)).exec(args);
        for part in parts {
            fails(&output, 10, part);
        }
        assert!(!String::from_utf8_lossy(&output.stderr).contains("L006"), "{output:?}");
    }
}

#[test]
fn several_symbol_tables() {
    let bench = Bench::new(&ob(1, "L \"one\"; T \"two\"; CALL SFC 46;"));
    bench.write("a.sdf", "\"one\",\"MB 8\",\"BYTE\",\"\"\n");
    bench.write("b.seq", "\tMB 1\ttwo\tsecond table\r\n");
    fails(&bench.exec(&["--symbols", "a.sdf"]), 10, "two");
    assert_eq!(bench.memory(2, &["--symbols", "a.sdf", "--symbols", "b.seq"]), (Some(0), vec![0, 0]));
    // A name in two tables is reported; the first one counts.
    bench.write("c.sdf", "\"one\",\"MB 9\",\"BYTE\",\"\"\n\"two\",\"MB 1\",\"BYTE\",\"\"\n");
    bench.write("p.awl", &ob(1, "L 7; T MB 8; L \"ONE\"; T \"two\"; CALL SFC 46;"));
    let words = ["--symbols", "a.sdf", "--symbols", "c.sdf"];
    assert_eq!(bench.memory(2, &words), (Some(0), vec![0, 7]));
    let output = bench.exec(&words);
    fails(&output, 0, "c.sdf:1");
    fails(&output, 0, "S0704");
}

#[test]
fn quiet_leaves_out_warnings_alone() {
    let bench = Bench::new(&ob(1, "CALL SFC 46;"));
    bench.write("s.sdf", "\"one\",\"MW 8\",\"BOOL\",\"\"\n");
    fails(&bench.exec(&["--symbols", "s.sdf"]), 0, "warning");
    for quiet in ["--quiet", "-q"] {
        let output = bench.exec(&["--symbols", "s.sdf", quiet]);
        assert_eq!((output.status.code(), output.stderr.as_slice()), (Some(0), &b""[..]));
    }
    bench.write("p.awl", &ob(1, "L MW 9999; T MB 1;"));
    fails(&bench.exec(&["-q"]), 11, "4562h");
    bench.write("p.awl", &ob(1, "U M;"));
    fails(&bench.exec(&["-q"]), 10, "p.awl:7");
}

/// Options, figures and exit codes of the command are those of the document.
#[test]
fn the_document_names_every_option_and_figure() {
    let text = include_str!("../../../../docs/exec.md");
    let help = Command::new(env!("CARGO_BIN_EXE_ob1")).args(["exec", "--help"]).output().expect("ob1 starts").stdout;
    let help = String::from_utf8(help).expect("UTF-8");
    let options: Vec<&str> = help
        .lines()
        .filter_map(|line| line.trim_start().strip_prefix("--").or(line.split_once(", --").map(|(_, rest)| rest)))
        .map(|rest| rest.split(|c: char| !(c.is_ascii_lowercase() || c == '-')).next().unwrap_or_default())
        .filter(|name| *name != "help")
        .collect();
    assert!(options.len() > 18, "{options:?}");
    for name in options {
        assert!(text.contains(&format!("`--{name}")), "docs/exec.md does not name --{name}");
    }
    let bench = Bench::new(&ob(1, "CALL SFC 46;"));
    for name in bench.stats(&[]).as_object().expect("an object").keys() {
        assert!(text.contains(&format!("`{name}`")), "docs/exec.md does not name the figure {name}");
    }
}

/// A file that cannot be written keeps back no other, and no line says another exit code.
#[test]
fn what_cannot_be_written_is_told_and_the_rest_is_written() {
    let bench = Bench::new(&ob(1, COUNT));
    let dumps = ["--dump", "M:0:2:gone/m.bin", "--dump", "M:0:2:m.bin", "--stats", "gone/s.json", "--limit", "10ms"];
    let output = bench.exec(&dumps);
    fails(&output, 6, "ob1: gone/m.bin: No such file");
    fails(&output, 6, "ob1: gone/s.json: No such file");
    assert!(!String::from_utf8_lossy(&output.stderr).contains("exit code"), "{output:?}");
    assert_eq!(std::fs::read(bench.path().join("m.bin")).expect("a dump").len(), 2);
}
