//! The start of a station with a large program: from the start of its process to the first scan, and to machine code.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use super::peer::Failure;
use super::{Figure, compile, median};

const STATEMENTS: usize = 100_000;
const ROUNDS: usize = 9;
/// What the log says when OB 1 begins, and when machine code does.
const MARKS: [&str; 2] = ["RUN: 4302h", "machine code: "];
/// Milliseconds to each of them.
const AIMS_MS: [f64; 2] = [100.0, 1000.0];
const GUARD: Duration = Duration::from_secs(60);

/// Starts the station again and again, in turns with the same executable that only says its version.
///
/// # Errors
/// If the station does not start.
pub fn measure() -> Result<[Figure; 2], Failure> {
    let folder = std::env::temp_dir().join(format!("ob1-bench-start-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let station = compile::station(&folder, STATEMENTS)?;
    let binaries = std::env::var_os("OB1_BIN_DIR").ok_or("OB1_BIN_DIR is not set; run: cargo xtask bench")?;
    let ob1 = Path::new(&binaries).join("ob1");
    let (mut runs, mut codes, mut bare) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..ROUNDS {
        let [run, code] = start(&ob1, &station)?;
        runs.push(run);
        codes.push(code);
        let began = Instant::now();
        Command::new(&ob1).arg("--version").stdout(Stdio::null()).status()?;
        bare.push(began.elapsed().as_secs_f64() * 1e3);
    }
    std::fs::remove_dir_all(&folder)?;
    let floor = ("a process that says its version", median(&mut bare));
    let figure = |what: &'static str, mut times: Vec<f64>, aim, most| {
        let value = median(&mut times);
        Figure { what: what.into(), value, unit: "ms", floor: Some(floor), aim: (aim, value <= most) }
    };
    Ok([
        figure("start of 100,000 statements to the first scan", runs, "<= 100 ms", AIMS_MS[0]),
        figure("start of 100,000 statements to machine code", codes, "<= 1000 ms", AIMS_MS[1]),
    ])
}

/// Milliseconds from the start of the process to each mark in its log.
fn start(ob1: &Path, station: &Path) -> Result<[f64; 2], Failure> {
    let began = Instant::now();
    let mut process = Command::new(ob1).arg("run").arg(station).stdout(Stdio::null()).stderr(Stdio::piped()).spawn()?;
    let log = BufReader::new(process.stderr.take().ok_or("no log")?);
    let (said, heard) = mpsc::channel();
    let reader = std::thread::spawn(move || {
        for line in log.lines().map_while(Result::ok) {
            let _ = said.send((line, began.elapsed()));
        }
    });
    let times = MARKS.map(|mark| {
        while let Ok((line, at)) = heard.recv_timeout(GUARD) {
            if line.contains(mark) {
                return Ok(at.as_secs_f64() * 1e3);
            }
        }
        Err(format!("the log does not say {mark:?}"))
    });
    process.kill()?;
    process.wait()?;
    let _ = reader.join();
    let [run, code] = times;
    Ok([run?, code?])
}
