//! The programs of the manuals in `examples/`: they compile against the declared handling blocks, and they do what the
//! manual says when stand-ins of the handling blocks, written in STL, answer at once.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

fn example(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples").join(file)
}

fn ob1(args: &[&str], folder: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ob1"));
    command.args(args).current_dir(folder).stdin(Stdio::null()).output().expect("ob1 starts")
}

/// Runs an example with stand-ins until they stop the CPU; gives the dumps.
fn run(program: &str, symbols: Option<&str>, stand_ins: &str, dumps: &[&str]) -> Vec<Vec<u8>> {
    let folder = tempfile::tempdir().expect("a directory");
    let path = folder.path();
    std::fs::write(path.join("stand-ins.awl"), stand_ins).expect("writable");
    let program = example(program).display().to_string();
    let mut args = vec!["exec".to_owned(), program, "stand-ins.awl".into(), "--limit".into(), "1s".into()];
    args.extend(symbols.into_iter().flat_map(|file| ["--symbols".into(), example(file).display().to_string()]));
    for (number, dump) in dumps.iter().enumerate() {
        args.extend(["--dump".into(), format!("{dump}:{number}.bin")]);
    }
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    let output = ob1(&args, path);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    (0..dumps.len()).map(|number| std::fs::read(path.join(format!("{number}.bin"))).expect("a dump")).collect()
}

#[test]
fn they_compile_against_the_declared_blocks() {
    let symbols = example("enocean-switch/enocean.sdf").display().to_string();
    for (file, more) in [
        ("enocean-switch/enocean.awl", &["--library", "CP240", "--symbols", &symbols][..]),
        ("mbus-meter/mbus.awl", &["--library", "CP240"]),
        ("cp341-modbus-ascii/modbus-ascii.awl", &["--library", "CP341"]),
    ] {
        let path = example(file).display().to_string();
        let output = ob1(&[&["check", &path][..], more].concat(), Path::new("."));
        assert_eq!(output.status.code(), Some(0), "{file}: {output:?}");
        assert!(!String::from_utf8_lossy(&output.stderr).contains("warning S"), "{file}: {output:?}");
        // Each correction of the printed text is marked at its line, and listed in the README.
        let source = std::fs::read_to_string(&path).expect("readable");
        let readme = Path::new(&path).with_file_name("README.md");
        let readme = std::fs::read_to_string(readme).expect("each example has a README");
        let readme = readme.replace('`', "").replace("\\|", "|");
        for print in source.split("[printed: ").skip(1).filter_map(|rest| rest.split(']').next()) {
            let print = print.split(',').next().unwrap_or(print);
            assert!(print == "..." || readme.contains(print), "{file}: the README does not tell of \"{print}\"");
        }
    }
}

/// FC 9 that is ready at once, counts its calls, runs `each`, and stops the CPU in the fourth scan.
fn synchron(each: &str) -> String {
    format!(
        "FUNCTION FC 9 : VOID\nVAR_INPUT\n ADR : INT;\n TIMER_NR : TIMER;\nEND_VAR\nVAR_IN_OUT\n ANL, NULL, RESET : BOOL;\n \
         STEUERB_S, STEUERB_R : BYTE;\nEND_VAR\nBEGIN\nNETWORK\n SET;\n R #ANL;\n L MW 200;\n +1;\n T MW 200;\n L 4;\n <I;\n SPB go;\n \
         CALL SFC 46;\ngo: NOP 0;\n{each}\nEND_FUNCTION\n"
    )
}

const SEND: &str = "FUNCTION FC 0 : VOID
VAR_INPUT
  ADR : INT; _DB : BLOCK_DB; ABD, ANZ : WORD;
END_VAR
VAR_OUTPUT
  PAFE : BYTE;
END_VAR
VAR_IN_OUT
  FRG : BOOL; GESE, ANZ_INT : WORD; ENDE_KOM, LETZTER_BLOCK, SENDEN_LAEUFT, FEHLER_KOM : BOOL;
END_VAR
BEGIN
NETWORK
  SET; R #FRG; L 0; T #PAFE; L #ANZ; T MW 202; L #ADR; T MW 204;
END_FUNCTION
";

/// FC 1 that has received a telegram: `fill` writes it, `len` bytes.
fn receive(fill: &str, len: u16) -> String {
    format!(
        "FUNCTION FC 1 : VOID\nVAR_INPUT\n ADR : INT;\n _DB : BLOCK_DB;\n ABD : WORD;\nEND_VAR\nVAR_OUTPUT\n ANZ : WORD;\n PAFE : BYTE;\nEND_VAR\n\
         VAR_IN_OUT\n EMFR : BOOL;\n GEEM, ANZ_INT : WORD;\n EMPF_LAEUFT, LETZTER_BLOCK, FEHL_EMPF : BOOL;\nEND_VAR\nBEGIN\nNETWORK\n AUF #_DB;\n\
         {fill}\n SET;\n S #EMFR;\n L {len};\n T #ANZ;\n L 0;\n T #PAFE;\nEND_FUNCTION\n"
    )
}

#[test]
fn the_meter_s_answer_is_copied_to_its_data_block() {
    // The first call of FC 9 gives the order: 2400 baud, meter 1, short frame.
    let order = "UN M 210.0; SPBN no; S M 210.0; L B#16#BB; T MB 100; L B#16#5B; T MB 101; L 1; T MB 102; L 0; T MB 103; T MB 104; \
                 SET; S M 99.0; no: NOP 0;";
    let answer = receive(" L DW#16#08010203; T DBD 0; L B#16#16; T DBB 4;", 5);
    let stand_ins = [synchron(order), SEND.to_owned(), answer].concat();
    let dumps = run("mbus-meter/mbus.awl", None, &stand_ins, &["DB21:0:8", "DB10:0:4", "M:202:4", "M:99:1", "M:106:2"]);
    // One byte more than received is copied (<=I): it is 0 here.
    assert_eq!(dumps[0], [8, 1, 2, 3, 0x16, 0, 0, 0]);
    assert_eq!(dumps[1], [0xBB, 0x5B, 1, 0], "the request");
    assert_eq!(dumps[2], [0, 3, 1, 0], "a short frame has 3 bytes; address 256");
    assert_eq!((dumps[3][0], &dumps[4][..]), (0, &[0, 0][..]), "the order is done and its result is taken");
}

#[test]
fn the_rocker_switches_the_output() {
    let switch = |data: &str, id: &str| {
        let telegram = receive(&format!(" L W#16#{id}; T DBW 8; L B#16#{data}; T DBB 2;"), 11);
        // The output begins at 1; the next call of FC 9, which also sends, sees the scan before it.
        let each = "UN M 210.0; SPBN no; S M 210.0; = A 0.0; no: L AB 0; T MB 212; CALL FC 101;";
        let stand_ins = [synchron(each), SEND.to_owned(), telegram].concat();
        let symbols = Some("enocean-switch/enocean.sdf");
        let dumps = run("enocean-switch/enocean.awl", symbols, &stand_ins, &["M:212:1", "DB10:0:11", "M:202:2"]);
        assert_eq!(dumps[1], [0x6B, 5, 2, 0, 0, 0, 0, 0, 0x32, 0x67, 6], "what FC 101 sends");
        assert_eq!(dumps[2], [0, 11]);
        dumps[0][0]
    };
    assert_eq!(switch("50", "1C7A"), 1, "on");
    assert_eq!(switch("70", "1C7A"), 0, "off");
    assert_eq!(switch("70", "1C7B"), 1, "another switch");
}

#[test]
fn jobs_are_counted() {
    let fb8 = "FUNCTION_BLOCK FB 8
VAR_INPUT
  SF : CHAR := 'S'; REQ, R : BOOL; LADDR, DB_NO, DBB_NO, LEN, R_CPU_NO : INT; R_TYP : CHAR; R_NO, R_OFFSET, R_CF_BYT, R_CF_BIT : INT;
END_VAR
VAR_OUTPUT
  DONE, ERROR : BOOL; STATUS : WORD;
END_VAR
VAR
  EDGE, RUNS : BOOL; JOBS : INT;
END_VAR
BEGIN
NETWORK
  CLR; = #DONE; = #ERROR; L 0; T #STATUS;
  U #RUNS; SPBN idle; R #RUNS; L #JOBS; L 3; ==I; = #ERROR; NOT; = #DONE; U #ERROR; SPBN idle; L W#16#70A; T #STATUS;
idle: U #REQ; FP #EDGE; SPBN end; S #RUNS; L #JOBS; +1; T #JOBS; L #LADDR; T MW 230; L #DB_NO; T MW 232; L #LEN; T MW 234;
end: SAVE;
END_FUNCTION_BLOCK
FUNCTION_BLOCK FB 7
VAR_INPUT
  EN_R, R : BOOL; LADDR, DB_NO, DBB_NO : INT;
END_VAR
VAR_OUTPUT
  L_TYP : CHAR; L_NO, L_OFFSET, L_CF_BYT, L_CF_BIT : INT; NDR, ERROR : BOOL; LEN : INT; STATUS : WORD;
END_VAR
VAR
  CALLS : INT;
END_VAR
BEGIN
NETWORK
  CLR; = #NDR; = #ERROR; L 0; T #STATUS; L #CALLS; +1; T #CALLS; L 2; ==I; U #EN_R; = #NDR; SPBN end; L 12; T #LEN; end: SAVE;
END_FUNCTION_BLOCK
ORGANIZATION_BLOCK OB 35
VAR_TEMP
  INFO : ARRAY [1..20] OF BYTE;
END_VAR
BEGIN
NETWORK
  L MW 220; +1; T MW 220; L 6; <I; SPB go; CALL SFC 46;
go: SET; S M 120.7;
END_ORGANIZATION_BLOCK
";
    let dumps =
        run("cp341-modbus-ascii/modbus-ascii.awl", None, fb8, &["DB40:0:18", "DB41:4:14", "M:230:6", "M:120:1"]);
    // Five jobs, the third of them bad: it counts, and its STATUS is kept.
    assert_eq!(dumps[0][6..10], [0, 4, 0, 1]);
    assert_eq!(dumps[0][10..18], [0, 0x20, 0, 0, 0x07, 0x0A, 0x01, 0x10]);
    // One telegram of 12 bytes.
    assert_eq!(dumps[1][..4], [0, 12, 0, 1]);
    assert_eq!(dumps[2], [0x01, 0x10, 0, 42, 0, 0x20], "address 272, DB 42, 32 bytes");
    assert_eq!(dumps[3], [0], "the trigger is taken back");
}
