//! `cargo xtask bench stl`: the speed of the engine compared with awlsim, for six programs of typical statements.
//!
//! First a check makes sure that both produce the same memory: bit memory, outputs and the data block of the program.
//! Our engine is run by `ob1 exec`, as in any script.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::awlsim::{Awlsim, Failure, SHOWN, STOP, Scratch, Speed};

/// A program: `blocks/stl/tests/data/bench_NAME.awl`, which the golden tests of the compiler also use.
struct Program {
    name: &'static str,
    what: &'static str,
    /// Speed of awlsim's Cython core, its fastest version, on this kind of machine: million statements per second
    /// (2026-11-21, version 0.77.1, OB 1 in process without I/O).
    cython: f64,
    /// Its data block and the number of compared bytes.
    data: Option<(u16, usize)>,
    /// Bytes of bit memory that depend on real time, so they differ between engines.
    real_time: &'static [usize],
}

const PROGRAMS: [Program; 6] = [
    Program { name: "bits", what: "U UN O X ON, brackets, S R, FP", cython: 62.0, data: None, real_time: &[] },
    Program { name: "int", what: "+I -I *I /I +D SLW UW, compare, jump", cython: 56.0, data: None, real_time: &[] },
    Program { name: "real", what: "+ - * / SQRT ABS, compare, RND, DTR", cython: 48.0, data: None, real_time: &[] },
    Program {
        name: "dbind",
        what: "DBW [MD], W [AR1,P#], DBX, DBn.DBW",
        cython: 11.8,
        data: Some((10, 600)),
        real_time: &[],
    },
    Program { name: "calls", what: "FC and FB with parameters", cython: 9.1, data: Some((1, 10)), real_time: &[] },
    // MW 22 is the remaining time of a timer.
    Program { name: "timers", what: "SE SI SV SS SA, ZV ZR, L T, L Z", cython: 40.0, data: None, real_time: &[22, 23] },
];

/// Bytes of bit memory the programs use.
const MEMORY: usize = 256;
/// Calls of a program before its memory is compared.
const CALLS: usize = 3;
/// Our calls of OB 1 in one round: about half a second.
const SCANS: u64 = 6_000;
const ROUNDS: usize = 5;
/// Run time of awlsim in one round; it reports no speed in the first second.
const SECONDS: u32 = 2;
/// All statements divided by all CPU time, in million per second.
const AIM: f64 = 150.0;
/// Attempts at the program with timers: those of awlsim run in real time, so one may expire if the machine stops for
/// 100 ms.
const ATTEMPTS: usize = 5;

/// Prints the table; true if the memory is the same and every aim is met.
///
/// # Errors
/// If one of the two cannot be run.
pub fn measure() -> Result<bool, Failure> {
    let awlsim = Awlsim::find()?;
    let scratch = Scratch::new("bench-stl")?;
    println!("million statements a second, best of {ROUNDS}; memory compared first");
    println!(
        "{:<8} {:<38} {:>10} {:>7} {:>7} {:>9} {:>8}  aim",
        "program", "", "statements", "ob1", "awlsim", "x awlsim", "x Cython"
    );
    let (mut met, mut statements, mut seconds) = (true, 0.0, 0.0);
    for program in &PROGRAMS {
        let source = checkout(&format!("blocks/stl/tests/data/bench_{}.awl", program.name));
        let text = std::fs::read_to_string(&source)?;
        if let Some(difference) = compare(program, &text, &awlsim, &scratch)? {
            println!("{:<8} {difference}: its time is not measured", program.name);
            met = false;
            continue;
        }
        let mut best = Run { statements: 0.0, cpu_seconds: f64::INFINITY };
        let mut other = Speed { per_second: 0.0, per_cycle: 0.0 };
        for _ in 0..ROUNDS {
            let ours = run(&source, &scratch)?;
            best = if ours.cpu_seconds < best.cpu_seconds { ours } else { best };
            let theirs = awlsim.speed(&source, SECONDS)?;
            other = if theirs.per_second > other.per_second { theirs } else { other };
        }
        let speed = best.statements / best.cpu_seconds / 1e6;
        let twice = speed >= 2.0 * program.cython;
        println!(
            "{:<8} {:<38} {:>10.0} {:>7.1} {:>7.2} {:>9.0} {:>8.1}  {}",
            program.name,
            program.what,
            best.statements / SCANS as f64,
            speed,
            other.per_second / 1e6,
            speed * 1e6 / other.per_second,
            speed / program.cython,
            verdict(">= 2 x Cython", twice)
        );
        met &= twice;
        statements += best.statements;
        seconds += best.cpu_seconds;
    }
    let all = statements / seconds / 1e6;
    println!(
        "{:<8} {:<38} {:>10} {all:>7.1} {:>26}  {}",
        "all",
        "statements by CPU time",
        "",
        "",
        verdict(">= 150", all >= AIM)
    );
    println!("Cython: awlsim's figure for its compiled core on this kind of machine, not of this run");
    Ok(met && all >= AIM)
}

fn verdict(aim: &str, met: bool) -> String {
    format!("{aim} {}", if met { "met" } else { "MISSED" })
}

fn checkout(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

/// The output of `ob1 exec --stats` for one round.
#[derive(Clone, Copy, Debug)]
struct Run {
    statements: f64,
    cpu_seconds: f64,
}

fn ob1() -> Result<Command, Failure> {
    let folder = std::env::var_os("OB1_BIN_DIR").ok_or("OB1_BIN_DIR is not set; run: cargo xtask bench stl")?;
    let mut command = Command::new(Path::new(&folder).join("ob1"));
    // Statements take no time: a scan takes exactly its minimum cycle time, independent of the machine.
    command.args([
        "exec",
        "--quiet",
        "--mnemonics",
        "de",
        "--ns-per-statement",
        "0",
        "--min-cycle",
        "1ms",
        "--watchdog",
        "0ms",
    ]);
    Ok(command)
}

fn run(source: &Path, scratch: &Scratch) -> Result<Run, Failure> {
    let stats = scratch.path("stats.json");
    let output = ob1()?.arg(source).args(["--limit", &format!("{SCANS}ms"), "--stats"]).arg(&stats).output()?;
    if output.status.code() != Some(3) {
        return Err(format!("ob1 exec {}: {}", source.display(), String::from_utf8_lossy(&output.stderr)).into());
    }
    let stats: serde_json::Value = serde_json::from_slice(&std::fs::read(stats)?)?;
    let number = |field: &str| stats[field].as_f64().ok_or_else(|| format!("--stats without {field}"));
    let scans = stats["scans"].as_u64();
    if scans != Some(SCANS) {
        return Err(format!("ob1 exec ran {scans:?} scans, not {SCANS}").into());
    }
    Ok(Run { statements: number("statements")?, cpu_seconds: number("cpu_seconds")? })
}

/// Runs the program on both for [`CALLS`] calls. Returns a text if they differ.
fn compare(program: &Program, text: &str, awlsim: &Awlsim, scratch: &Scratch) -> Result<Option<String>, Failure> {
    let mut difference = None;
    for _ in 0..if program.real_time.is_empty() { 1 } else { ATTEMPTS } {
        difference = compare_once(program, text, awlsim, scratch)?;
        if difference.is_none() {
            break;
        }
    }
    Ok(difference)
}

fn compare_once(program: &Program, text: &str, awlsim: &Awlsim, scratch: &Scratch) -> Result<Option<String>, Failure> {
    let (db, bytes) = program.data.unwrap_or_default();
    // With a tenth of the loop iterations awlsim's timers do not expire meanwhile.
    let shorter = text.replacen("L 50;", "L 5;", 1);
    let text = if program.real_time.is_empty() { text } else { &shorter };
    let windows = (SHOWN..MEMORY).step_by(SHOWN).map(|from| Window { db: None, from, len: SHOWN });
    let data = (0..bytes).step_by(SHOWN).map(|from| Window { db: Some(db), from, len: SHOWN.min(bytes - from) });
    for window in windows.chain(data) {
        let source = scratch.write("compare.awl", &once(text, window))?;
        let dump = scratch.path("compare.bin");
        let area = window.db.map_or_else(|| "M".to_owned(), |db| format!("DB{db}"));
        let output = ob1()?
            .arg(&source)
            .args(["--dump", &format!("M:0:{SHOWN}:{}", scratch.path("first.bin").display())])
            .args(["--dump", &format!("{area}:{}:{}:{}", window.from, window.len, dump.display())])
            .output()?;
        if output.status.code() != Some(11) {
            return Err(format!("ob1 exec {}: {}", program.name, String::from_utf8_lossy(&output.stderr)).into());
        }
        let shown = awlsim.run(&source, 2)?;
        let first = std::fs::read(scratch.path("first.bin"))?;
        let rest = std::fs::read(dump)?;
        let ours = first.iter().chain(&rest);
        let theirs = shown.memory.iter().chain(&shown.inputs[..window.len]);
        for (index, (ours, theirs)) in ours.zip(theirs).enumerate() {
            let real_time = index < SHOWN && program.real_time.contains(&index);
            if ours != theirs && !real_time {
                let at = if index < SHOWN {
                    format!("MB {index}")
                } else {
                    format!("{area} byte {}", window.from + index - SHOWN)
                };
                return Ok(Some(format!("{at} differs: ob1 {ours:02X}, awlsim {theirs:02X}")));
            }
        }
    }
    Ok(None)
}

/// A piece of memory that a program copies to where awlsim shows it.
#[derive(Clone, Copy, Debug)]
struct Window {
    db: Option<u16>,
    from: usize,
    len: usize,
}

/// The program as a function that OB 1 calls [`CALLS`] times; then the window is copied to EB 0 and the CPU faults.
fn once(text: &str, window: Window) -> String {
    let body: String = text
        .lines()
        .map(|line| match line.trim() {
            "ORGANIZATION_BLOCK OB 1" => "FUNCTION FC 1000 : VOID\n".to_owned(),
            "END_ORGANIZATION_BLOCK" => "END_FUNCTION\n".to_owned(),
            _ => format!("{line}\n"),
        })
        .collect();
    let mut ob1 = String::from("ORGANIZATION_BLOCK OB 1\nBEGIN\n");
    ob1.push_str(&"CALL FC 1000;\n".repeat(CALLS));
    for byte in 0..window.len {
        let at = window.from + byte;
        ob1.push_str(&match window.db {
            Some(db) => format!("L DB{db}.DBB {at};\nT EB {byte};\n"),
            None => format!("L MB {at};\nT EB {byte};\n"),
        });
    }
    format!("{body}\n{ob1}{STOP}END_ORGANIZATION_BLOCK\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_becomes_a_function_that_is_shown() {
        let text = "ORGANIZATION_BLOCK OB 1\r\nBEGIN\r\nNOP 0;\r\nEND_ORGANIZATION_BLOCK\r\n";
        let once = once(text, Window { db: Some(1), from: 9, len: 1 });
        let expected = format!(
            "FUNCTION FC 1000 : VOID\nBEGIN\nNOP 0;\nEND_FUNCTION\n\nORGANIZATION_BLOCK OB 1\nBEGIN\n{}L DB1.DBB 9;\nT EB 0;\n{STOP}\
             END_ORGANIZATION_BLOCK\n",
            "CALL FC 1000;\n".repeat(CALLS)
        );
        assert_eq!(once, expected);
    }
}
