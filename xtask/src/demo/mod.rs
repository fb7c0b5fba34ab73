//! `cargo xtask demo`: runs the two stations of `examples/two-stations` in two processes, watches them, and evaluates
//! the result at the end.
//!
//! Both run in a folder of their own below the target directory, connected by a null modem: A's driver creates a pty,
//! B's opens it as a serial device. With `--dirty` they are at a simulated line that inverts bits.
//!
//! At the end A stops sending new telegrams, the current telegram is completed, the ledgers (DB 20 of each station) are
//! read, then both get the signal that Ctrl-C sends.

mod ledger;
mod station;
mod table;

use std::fs;
use std::io::{IsTerminal as _, Write as _};
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::cargo::{self, Profile, cargo};
use crate::failure::{Failure, Outcome, step};
use crate::shell;
use ledger::{LedgerA, LedgerB};
use station::Station;

/// Folder of the example.
const EXAMPLE: &str = "examples/two-stations";
/// Maximum time until the first telegram, and until the stations are idle at the end. Normally both are short.
const PATIENCE: Duration = Duration::from_secs(20);
/// Time between two lines of a log.
const TOLD: Duration = Duration::from_secs(5);
/// Time between two checks.
const LOOK: Duration = Duration::from_millis(500);

/// The options of the command line.
#[derive(Debug, PartialEq, Eq)]
struct Wish {
    time: Duration,
    dirty: bool,
}

/// `cargo xtask demo [--for 20s] [--dirty]`
///
/// # Errors
/// If it cannot be built, a station ends unexpectedly, no telegram is transferred, or one was wrong or lost.
pub(crate) fn run(args: &[String]) -> Outcome {
    let wish = parse(args)?;
    let packages = ["build", "--package", "ob1", "--package", "ob1-cp", "--package", "ob1-cp240"];
    shell::run(cargo(&packages).args(Profile::Demo.flags()))?;
    let binaries = Profile::Demo.folder()?;
    let folder = stage(wish.dirty)?;
    let mut a = Station::start("A", &folder, "station-a.toml", &binaries, wish.time + 3 * PATIENCE)?;
    let mut b = Station::start("B", &folder, "station-b.toml", &binaries, wish.time + 3 * PATIENCE)?;
    watch(&mut a, &mut b, wish.time)?;
    let (ledger_a, ledger_b) = settle(&mut a, &mut b)?;
    // B first, because A's driver owns the line.
    let report_b = b.stop(PATIENCE)?;
    let report_a = a.stop(PATIENCE)?;

    println!();
    table::print(&ledger_a, &ledger_b, &report_a, &report_b);
    match table::verdict(&ledger_a, &ledger_b) {
        Ok(sentence) => {
            println!("verdict   {sentence}");
            Ok(())
        }
        Err(sentence) => Err(step(format!("verdict: {sentence}"))),
    }
}

fn parse(args: &[String]) -> Outcome<Wish> {
    let mut wish = Wish { time: Duration::from_secs(20), dirty: false };
    let mut args = args.iter();
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--dirty" => wish.dirty = true,
            "--for" => {
                let text = args.next().ok_or_else(|| Failure::Usage("--for wants a time, e.g. 20s".into()))?;
                wish.time = duration(text).ok_or_else(|| Failure::Usage(format!("`{text}` is no time: 20s, 2m")))?;
            }
            other => return Err(Failure::Usage(format!("demo knows no `{other}`"))),
        }
    }
    Ok(wish)
}

/// `20s`, `2m`; a bare number is seconds.
pub(crate) fn duration(text: &str) -> Option<Duration> {
    let (number, unit) = match text.strip_suffix('m') {
        Some(minutes) => (minutes, 60),
        None => (text.strip_suffix('s').unwrap_or(text), 1),
    };
    number.parse::<u64>().ok().filter(|number| *number > 0)?.checked_mul(unit).map(Duration::from_secs)
}

/// The line in the station files, and with `--dirty`: one bit of about one character in 2,000 is inverted, which the
/// block check of 3964R, an exclusive or, detects. Some telegrams of 250 bytes need two attempts, few need three.
const LINES: [&str; 2] = ["\"pty:null-modem.pty\"", "\"serial:null-modem.pty\""];
const DIRTY_LINE: &str = "\"sim:cable\"";
const CABLE: &str = "\n[[simulated_line]]\nname = \"cable\"\nshared = true\nfaults = { flip = 500 }\n";

/// Copies the example, so that the source tree is not changed; returns the folder.
fn stage(dirty: bool) -> Outcome<PathBuf> {
    let folder = cargo::target_dir()?.join("demo-stations");
    let failed = |path: &Path, why: std::io::Error| step(format!("{}: {why}", path.display()));
    if folder.exists() {
        fs::remove_dir_all(&folder).map_err(|why| failed(&folder, why))?;
    }
    fs::create_dir_all(&folder).map_err(|why| failed(&folder, why))?;
    let example = cargo::root().join(EXAMPLE);
    let mut replaced = 0;
    for entry in fs::read_dir(&example).map_err(|why| failed(&example, why))?.flatten() {
        let (from, to) = (entry.path(), folder.join(entry.file_name()));
        if dirty && from.extension().is_some_and(|end| end == "toml") {
            let mut text = fs::read_to_string(&from).map_err(|why| failed(&from, why))?;
            for clean in LINES {
                replaced += text.matches(clean).count();
                text = text.replace(clean, DIRTY_LINE);
            }
            text.push_str(CABLE);
            fs::write(&to, text).map_err(|why| failed(&to, why))?;
        } else {
            fs::copy(&from, &to).map_err(|why| failed(&from, why))?;
        }
    }
    if dirty && replaced != LINES.len() {
        return Err(step(format!("{EXAMPLE}: the station files no longer name the null modem")));
    }
    Ok(folder)
}

/// Shows a live line until the time has elapsed; where nobody sees it move, a line now and then.
fn watch(a: &mut Station, b: &mut Station, time: Duration) -> Outcome {
    let start = Instant::now();
    let mut flowing = false;
    let (moves, mut told) = (std::io::stdout().is_terminal(), Duration::ZERO);
    while start.elapsed() < time {
        sleep(LOOK.min(time));
        a.is_alive()?;
        b.is_alive()?;
        let looks = (a.ledger(&LedgerA::OPERANDS).map(LedgerA::from), b.ledger(&LedgerB::OPERANDS).map(LedgerB::from));
        let (Ok(ledger_a), Ok(ledger_b)) = looks else { continue };
        flowing |= ledger_a.good > 0;
        let line = format!("{:>5.1} s   {}", start.elapsed().as_secs_f64(), table::live(&ledger_a, &ledger_b));
        if moves {
            print!("\r{line}");
            let _ = std::io::stdout().flush();
        } else if start.elapsed() >= told {
            println!("{line}");
            told += TOLD;
        }
        if !flowing && start.elapsed() > PATIENCE {
            return Err(step(format!("no telegram came back within {} s\n{}{}", PATIENCE.as_secs(), a.log(), b.log())));
        }
    }
    if moves {
        println!();
    }
    Ok(())
}

/// Waits for the end of the current telegram, then reads both ledgers.
fn settle(a: &mut Station, b: &mut Station) -> Outcome<(LedgerA, LedgerB)> {
    a.set(&format!("{}=1", ledger::PAUSE))?;
    let start = Instant::now();
    let mut before = None;
    loop {
        let ledger_a = LedgerA::from(a.ledger(&LedgerA::OPERANDS)?);
        let ledger_b = LedgerB::from(b.ledger(&LedgerB::OPERANDS)?);
        // Idle: no station has an order, and nothing has changed since the last check.
        let at_rest = ledger_a.state == 0 && ledger_b.state == 0;
        let both = (ledger_a, ledger_b);
        if at_rest && before.as_ref() == Some(&both) {
            return Ok(both);
        }
        if start.elapsed() > PATIENCE {
            return Err(step("the stations do not come to rest"));
        }
        before = Some(both);
        sleep(LOOK);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_read() {
        assert_eq!(duration("20s"), Some(Duration::from_secs(20)));
        assert_eq!(duration("2m"), Some(Duration::from_secs(120)));
        assert_eq!(duration("7"), Some(Duration::from_secs(7)));
        assert_eq!(duration("0s"), None);
        assert_eq!(duration("soon"), None);
    }

    #[test]
    fn flags_are_read() {
        let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
        let wish = parse(&words("--for 3s --dirty")).ok();
        assert_eq!(wish, Some(Wish { time: Duration::from_secs(3), dirty: true }));
        assert!(matches!(parse(&words("--for")), Err(Failure::Usage(_))));
        assert!(matches!(parse(&words("--fro 3s")), Err(Failure::Usage(_))));
    }
}
