//! Instructions instead of times. They are exact, so that a change of two percent is seen on any machine, however busy:
//! callgrind counts them in the build of the tests, whose hot crates are optimised, and `tests/counts.txt` has those of
//! the last change that was meant.
//!
//! Callgrind shows every processor with AVX2 as the same one. On a processor without it machine code differs, and with
//! it the counts.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

use ob1_cpu::engine::{Factory, REFERENCE};
use ob1_cpu::{AccountsConfig, Clock};
use ob1_native::{AtLoad, Tier};
use ob1_time::{Instant, Span};

use super::access::Rig;
use super::line;
use super::peer::Failure;
use super::scan::{PAIR, Station, cp240};

/// How far a count may be from that of the file.
const WITHIN: f64 = 0.02;
/// The counts of the last change that was meant.
const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/counts.txt");
/// Copies of a kind of statements in OB 1, and scans that are counted.
const COPIES: usize = 100;
const SCANS: u64 = 20;
/// Each time this function is left callgrind writes what it has counted in it.
const COUNTED: &str = "ob1_tests::bench::counts::counted_part";

/// Blocks that the statements call, and the data block of an instance.
const BLOCKS: &str = "
FUNCTION FC 10 : INT
VAR_INPUT x : INT; y : INT; END_VAR
BEGIN
L #x; L #y; +I; T #RET_VAL;
END_FUNCTION
FUNCTION FC 11 : INT
VAR_INPUT x : INT; END_VAR
VAR_TEMP n : INT; END_VAR
BEGIN
L 1; z: T #n; L #x; T #RET_VAL; L #n; LOOP z;
END_FUNCTION
FUNCTION FC 12 : VOID
VAR_TEMP n : INT; END_VAR
BEGIN
L 1; z: T #n; L P#M 8.0; T MD 0; L P#20.0; T MD 4; L P#40.0; T MD 8; L #n; LOOP z;
END_FUNCTION
DATA_BLOCK DB 12 STRUCT a : ARRAY[0..1999] OF BYTE; END_STRUCT BEGIN END_DATA_BLOCK
FUNCTION_BLOCK FB 10
VAR_INPUT on : BOOL; v : INT; END_VAR
VAR_OUTPUT q : INT; END_VAR
VAR n : INT; e : BOOL; END_VAR
BEGIN
U #on; FP #e; SPBN z1; L #v; T #n; z1: L #n; + 1; T #n; T #q;
END_FUNCTION_BLOCK
DATA_BLOCK DB 20 FB 10
BEGIN
END_DATA_BLOCK
";

/// What OB 1 begins with: machine code cannot know the pointers that a block with a loop makes.
const BEGIN: &str = "CALL FC 12;\n";
/// Kinds of statements: a name, an example, and how many statements that is. `@` is the number of its copy, `@n` the
/// byte that is `n` behind the first of its own.
const KINDS: [(&str, &str, usize); 22] = [
    ("bit logic", "U M @0.0; O M @0.1; UN M @1.2; = M @1.3;", 4),
    ("brackets", "U(; O M @0.0; O M @0.1; ); U M @1.2; = M @1.3;", 6),
    ("set and reset", "U M @0.0; S M @1.0; U M @0.1; R M @1.1;", 4),
    ("edges", "U M @0.0; FP M @2.0; = M @2.1; U M @0.1; FN M @3.2; = M @3.3;", 6),
    ("load and transfer", "L MW @0; T MW @2; L MB @4; T MB @5;", 4),
    ("INT", "L MW @0; L MW @2; +I; L MW @4; -I; T MW @6;", 6),
    ("INT, product", "L MW @0; L MW @2; *I; T MW @6;", 4),
    ("INT, quotient of a constant", "L MW @0; L 7; /I; T MW @6;", 4),
    ("DINT", "L MD @0; L MD @4; +D; L MD @8; *D; T MD @12;", 6),
    ("REAL", "L MD @0; L MD @4; +R; L MD @8; *R; T MD @12;", 6),
    ("square root", "L MD @0; SQRT; T MD @4;", 3),
    ("comparison and jump", "L MW @0; L MW @2; >I; SPB j@; S M @4.0; j@: NOP 0;", 6),
    ("shift and word logic", "L MW @0; SLW 3; L MW @2; UW; T MW @4;", 5),
    ("conversion", "L MW @0; ITD; DTR; RND; T MD @4;", 5),
    ("data block", "L DB12.DBW @0; T DB12.DBW @2; U DB12.DBX @4.0; = DB12.DBX @4.1;", 4),
    ("pointer in memory", "AUF DB 12; L DBW [MD 4]; T DBW [MD 8];", 3),
    ("address register", "LAR1 MD 0; L W [AR1,P#0.0]; T W [AR1,P#2.0]; +AR1 P#2.0;", 4),
    ("timer", "U M @0.0; L S5T#1S; SE T @; U T @; = M @0.1;", 5),
    ("counter", "U M @0.1; ZV Z @; L Z @; T MW @2;", 4),
    ("short FC", "CALL FC 10 (x := MW @0, y := 3, RET_VAL := MW @2);", 1),
    ("FC with a loop", "CALL FC 11 (x := MW @0, RET_VAL := MW @2);", 1),
    ("FB", "CALL FB 10, DB 20 (on := M @0.0, v := MW @2, q := MW @4);", 1),
];

/// An example for its copy. Its own bytes of bit memory are behind those of the pointers.
fn copied(example: &str, copy: usize) -> String {
    let mut parts = example.split('@');
    let mut text = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let digits = part.find(|c: char| !c.is_ascii_digit()).unwrap_or(part.len());
        let number = part[..digits].parse::<usize>().map_or(copy, |byte| 16 + 16 * copy + byte);
        let _ = write!(text, "{number}{}", &part[digits..]);
    }
    text
}

/// A clock that moves by 10 us each time it is read: under callgrind that of the system cannot be read everywhere.
struct Steps(Instant);

impl Clock for Steps {
    fn now(&mut self) -> Instant {
        self.0 += Span::from_micros(10);
        self.0
    }

    fn executed(&mut self, _statements: u64) {}
}

type Work = Box<dyn FnOnce() -> Result<(), Failure>>;
/// What is counted: its name, and by how much its count is divided.
type Case = (String, u64, Work);

/// Counts what `work` does: callgrind looks for the name of this function.
#[inline(never)]
fn counted_part(work: Work) -> Result<(), Failure> {
    std::hint::black_box(work)()
}

fn scans(engine: &dyn Factory, statements: &str) -> Result<Work, Failure> {
    let accounts = AccountsConfig { blocks: false, ..AccountsConfig::default() };
    let statements = format!("{BEGIN}{statements}");
    let mut station = Station::build_on(engine, &statements, BLOCKS, None, accounts, Steps(Instant::START))?;
    station.runs()?;
    Ok(counted_scans(move || station.cycle()))
}

fn counted_scans(mut scan: impl FnMut() + 'static) -> Work {
    scan();
    Box::new(move || {
        (0..SCANS).for_each(|_| scan());
        Ok(())
    })
}

fn cases() -> Result<Vec<Case>, Failure> {
    let mut cases = Vec::new();
    for (engine, name) in [(REFERENCE, "reference"), (&AtLoad(Tier::Optimised) as &dyn Factory, "machine code")] {
        cases.push((format!("{name}: scan of next to nothing"), SCANS, scans(engine, "")?));
        for (kind, example, statements) in KINDS {
            let text: String = (0..COPIES).map(|copy| copied(example, copy)).collect();
            let divisor = SCANS * (COPIES * statements) as u64;
            cases.push((format!("{name}: {kind}"), divisor, scans(engine, &text)?));
        }
    }
    let accounts = AccountsConfig { blocks: false, ..AccountsConfig::default() };
    let mut idle = Station::build_on(REFERENCE, PAIR, "", Some(&cp240()?), accounts, Steps(Instant::START))?;
    cases.push(("scan with idle FC 0 and FC 1".into(), SCANS, counted_scans(move || idle.cycle())));
    for (name, orders) in line::orders() {
        cases.push((format!("order of 250 bytes: {name}"), line::ORDERS, Box::new(orders)));
    }
    let mut rig = Rig::new(4, Steps(Instant::START))?;
    cases.push(("scan with a link that reads 1,000 items".into(), SCANS, counted_scans(move || rig.cycle())));
    let mut rig = Rig::new(4, Steps(Instant::START))?;
    cases.push(("reading of 1,000 items by the link".into(), SCANS, counted_scans(move || rig.read())));
    Ok(cases)
}

/// The part that runs under callgrind: says the name and the divisor of each count.
///
/// # Errors
/// If a case cannot be built or fails.
pub fn counted() -> Result<(), Failure> {
    for (name, divisor, work) in cases()? {
        println!("{name}\t{divisor}");
        counted_part(work)?;
    }
    Ok(())
}

/// Counts, and compares with the file or writes it. True if no count differs by more than [`WITHIN`].
///
/// # Errors
/// If callgrind or a case fails, or the file lacks a count.
pub fn measure(write: bool) -> Result<bool, Failure> {
    let now = counts()?;
    if write {
        let mut text = String::from("# Instructions, written by `cargo xtask bench counts --write`.\n");
        for (name, count) in &now {
            let _ = writeln!(text, "{count:>12.2}  {name}");
        }
        std::fs::write(FILE, text)?;
        println!("{} counts written", now.len());
        return Ok(true);
    }
    let text = std::fs::read_to_string(FILE)?;
    let pair = |line: &str| line.trim().split_once("  ").and_then(|(n, name)| Some((name.to_owned(), n.parse().ok()?)));
    let before: BTreeMap<String, f64> = text.lines().filter_map(pair).collect();
    let mut same = true;
    for (name, count) in &now {
        let known = *before.get(name).ok_or_else(|| format!("{FILE} has no count of {name:?}: {HOW}"))?;
        let is_near = (count - known).abs() <= known * WITHIN;
        let mark = if is_near { "" } else { "  differs" };
        println!("{count:>12.2}  {name}  ({:+.1} %){mark}", (count / known - 1.0) * 100.0);
        same &= is_near;
    }
    if let Some(gone) = before.keys().find(|name| now.iter().all(|(known, _)| known != *name)) {
        return Err(format!("{gone:?} is in {FILE}, and nothing counts it: {HOW}").into());
    }
    if !same {
        println!("more or fewer instructions than {FILE} says: find out why. If it is meant, {HOW}");
    }
    Ok(same)
}

const HOW: &str = "write the file with `cargo xtask bench counts --write`, and say in the commit why";

/// Each count by its name. Those of statements are without the scan around them.
fn counts() -> Result<Vec<(String, f64)>, Failure> {
    let folder = std::env::temp_dir().join(format!("ob1-counts-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let counts = counts_in(&folder);
    std::fs::remove_dir_all(&folder)?;
    counts
}

fn counts_in(folder: &Path) -> Result<Vec<(String, f64)>, Failure> {
    let out = folder.join("out");
    let output = Command::new("valgrind")
        .args([
            "--tool=callgrind",
            "--quiet",
            &format!("--toggle-collect={COUNTED}"),
            &format!("--dump-after={COUNTED}"),
        ])
        .arg(format!("--callgrind-out-file={}", out.display()))
        .arg(std::env::current_exe()?)
        .args(["counts", "--counted"])
        .output()?;
    if !output.status.success() {
        return Err(format!("callgrind: {}", String::from_utf8_lossy(&output.stderr)).into());
    }
    let said = String::from_utf8(output.stdout)?;
    let mut empty = 0.0;
    let mut counts = Vec::new();
    for (part, line) in said.lines().enumerate() {
        let (name, divisor) = line.split_once('\t').ok_or_else(|| format!("{line:?}"))?;
        let all = summary(&out.with_extension((part + 1).to_string()))?;
        let divisor: f64 = divisor.parse()?;
        if name.ends_with(": scan of next to nothing") {
            empty = all;
        }
        let is_statements = name.contains(": ") && !name.starts_with("order") && all != empty;
        counts.push((name.to_owned(), (all - if is_statements { empty } else { 0.0 }) / divisor));
    }
    Ok(counts)
}

/// The instructions of one of callgrind's files.
fn summary(path: &Path) -> Result<f64, Failure> {
    let text = std::fs::read_to_string(path).map_err(|why| format!("{}: {why}", path.display()))?;
    let line = text.lines().find_map(|line| line.strip_prefix("summary: ").or_else(|| line.strip_prefix("totals: ")));
    Ok(line.ok_or_else(|| format!("{}: no summary", path.display()))?.trim().parse()?)
}
