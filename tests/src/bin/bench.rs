//! `cargo xtask bench [NAME...]`: the figures of `docs/figures.md`, each with its floor.

use std::path::Path;
use std::process::ExitCode;

use ob1_tests::bench::peer::{Failure, answer_pipe};
use ob1_tests::bench::wake::Verdict;
use ob1_tests::bench::{
    Figure, NAMES, access, alarms, backplane, causes, compile, counts, disturb, driver, engines, fleet, io,
    kill_runtime, line, machine_code, memory, record, s7, scan, start, stations, stl, wake, watch, written,
};

const HELP: &str = "usage: cargo xtask bench [NAME...] [--write] [--triples N] [--seconds S]
  names: scan, pair, access, backplane, driver, memory, line, compile, start (default: all of these);
         --write: into docs/figures.md, with command, date and machine
         stl: the engines beside each other, beside C and beside awlsim (installed into .venv), alone; about two minutes
         engines: the same without awlsim
         line, named: also Modbus RTU transactions over a pty beside libmodbus and pymodbus (installed into .venv)
         disturb [--rounds N] [--seconds S]: the execution time of a scan while ob1 top is attached, reports are written, its driver is
         killed ten times a minute; N (9) rounds of five runs of S (6) seconds: 5 minutes
         s7 [--rounds N] [--seconds S]: the S7 link beside a bare TCP echo and snap7's server (installed into .venv), and the
         scan with 64 clients beside it; N (9) rounds, three looks of S (6) seconds at the scan in each: 4 minutes
         counts [--write]: instructions of statements, calls, scans, orders, readings beside those of tests/counts.txt (valgrind)
         alarms: a scan that makes messages, and the broker that tells four displays, beside the same without
         record: a scan with 64 signals recorded, beside the same without; an hour of scans in virtual time
        watch: a scan of 100,000 statements with program status, beside the same without: a minute
         causes [--seconds S]: late scans by cause on a machine that is too busy; three stations of S (60) seconds each
         stations [COUNT CYCLE SECONDS]: 1, 10, 50, 100 stations at 10 and 100 ms, a minute each; or so many at a cycle in ms
         fleet [COUNT SECONDS]: a thousand simulated stations whose values and figures go to mosquitto and Prometheus; a minute is measured
        io [--seconds S]: remote I/O over Modbus TCP, 32 couplers at a cycle of 10 ms; the way of an input to an output; requests a
         second beside libmodbus (its Python script installed into .venv); S (10) seconds each
         kill-runtime [--kills N]: N (200) times SIGKILL to a runtime; how long its outputs stay on: a minute
  scan, named: also our wake-up latency beside cyclictest, N (9) triples of runs of S (15) seconds at two intervals: 15 minutes

Exit status: 0 every aim met, 1 an aim missed, 2 it could not be measured, 3 inconclusive: run longer.";

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let done = match args.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["--peer", "echo", _] => s7::echo().map(|()| true),
        ["--peer", role, path] => answer(role, Path::new(path)).map(|()| true),
        ["stl"] => engines::measure().and_then(|engines| Ok(stl::measure()? && engines)),
        ["engines"] => engines::measure(),
        ["disturb", ref words @ ..] => disturbed(words),
        ["s7", ref words @ ..] => s7_link(words),
        ["counts"] => counts::measure(false),
        ["counts", "--write"] => counts::measure(true),
        ["counts", "--counted"] => counts::counted().map(|()| true),
        ["watch"] => watch::measure().map(|figures| shown(&figures)),
        ["record"] => record::measure().map(|figures| shown(&figures)),
        ["alarms"] => alarms::measure().map(|figures| shown(&figures)),
        ["causes"] => caused(causes::SECONDS),
        ["causes", "--seconds", number] => number.parse().map_err(|_| HELP.into()).and_then(caused),
        ["stations"] => {
            stations::LADDER.iter().try_fold(true, |met, (count, cycle)| Ok(many(*count, *cycle, 60)? && met))
        }
        ["stations", count, cycle, seconds] => match (count.parse(), cycle.parse(), seconds.parse()) {
            (Ok(count), Ok(cycle), Ok(seconds)) => many(count, cycle, seconds),
            _ => Err(HELP.into()),
        },
        ["fleet"] => many_tell(fleet::Plan { stations: 1000, seconds: 60, scrape: 15 }),
        ["fleet", count, seconds] => match (count.parse(), seconds.parse()) {
            (Ok(stations), Ok(seconds)) => {
                many_tell(fleet::Plan { stations, seconds, scrape: (seconds / 4_u64).clamp(1, 15) })
            }
            _ => Err(HELP.into()),
        },
        ["io"] => remote(10),
        ["io", "--seconds", number] => number.parse().map_err(|_| HELP.into()).and_then(remote),
        ["kill-runtime"] => killed(kill_runtime::KILLS),
        ["kill-runtime", "--kills", number] => number.parse().map_err(|_| HELP.into()).and_then(killed),
        ref words => options(words).and_then(|(names, (plan, write))| {
            let met = measure(&names, write)?;
            match names.contains(&"scan").then(|| wake::compare(plan)).transpose()? {
                Some(Verdict::Failed) => Ok(false),
                Some(Verdict::Inconclusive) if met => Err(Inconclusive.into()),
                _ => Ok(met),
            }
        }),
    };
    match done {
        Err(failure) if failure.is::<Inconclusive>() => ExitCode::from(3),
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(failure) => {
            eprintln!("bench: {failure}");
            ExitCode::from(2)
        }
    }
}

/// Prints figures; whether every aim was met.
fn shown(figures: &[Figure]) -> bool {
    figures.iter().for_each(|figure| println!("{}", figure.line()));
    figures.iter().all(|figure| figure.aim.1)
}

/// `kill-runtime [--kills N]`.
fn killed(kills: usize) -> Result<bool, Failure> {
    let ob1 = std::env::current_exe()?.with_file_name("ob1");
    let found = kill_runtime::campaign(&ob1, kills)?;
    println!("{}", found.line());
    Ok(found.is_kept())
}

/// `io [--seconds S]`.
fn remote(seconds: u64) -> Result<bool, Failure> {
    Ok(shown(&io::measure(seconds)?))
}

/// `stations [COUNT CYCLE SECONDS]`.
fn many(count: usize, cycle: u64, seconds: u64) -> Result<bool, Failure> {
    stations::measure(&std::env::current_exe()?.with_file_name("ob1"), count, cycle, seconds)
}

/// `fleet [COUNT SECONDS]`.
fn many_tell(plan: fleet::Plan) -> Result<bool, Failure> {
    let folder = std::env::current_exe()?;
    fleet::measure(folder.parent().ok_or("no folder")?, plan)
}

/// `causes [--seconds S]`.
fn caused(seconds: u64) -> Result<bool, Failure> {
    causes::measure(&std::env::current_exe()?.with_file_name("ob1"), seconds)
}

/// `[--rounds N] [--seconds S]`.
fn rounds(words: &[&str]) -> Result<(Option<usize>, Option<u64>), Failure> {
    let (mut rounds, mut seconds) = (None, None);
    for pair in words.chunks(2) {
        match pair {
            ["--rounds", number] => rounds = Some(number.parse().map_err(|_| HELP)?),
            ["--seconds", number] => seconds = Some(number.parse().map_err(|_| HELP)?),
            _ => return Err(HELP.into()),
        }
    }
    Ok((rounds, seconds))
}

/// `s7 [--rounds N] [--seconds S]`.
fn s7_link(words: &[&str]) -> Result<bool, Failure> {
    let (rounds, seconds) = rounds(words)?;
    let whole = s7::Plan::default();
    let plan = s7::Plan { rounds: rounds.unwrap_or(whole.rounds), seconds: seconds.unwrap_or(whole.seconds) };
    told(s7::measure(plan)?)
}

/// `disturb [--rounds N] [--seconds S]`.
fn disturbed(words: &[&str]) -> Result<bool, Failure> {
    let (rounds, seconds) = rounds(words)?;
    told(disturb::measure(rounds, seconds)?)
}

fn told(verdict: Verdict) -> Result<bool, Failure> {
    match verdict {
        Verdict::Passed => Ok(true),
        Verdict::Failed => Ok(false),
        Verdict::Inconclusive => Err(Inconclusive.into()),
    }
}

/// The aim was neither met nor missed.
#[derive(Debug, thiserror::Error)]
#[error("inconclusive")]
struct Inconclusive;

/// The names, and the extent of the comparison with cyclictest.
fn options<'a>(words: &[&'a str]) -> Result<(Vec<&'a str>, (wake::Plan, bool)), Failure> {
    let (mut names, mut plan, mut write) = (Vec::new(), wake::Plan::default(), false);
    let mut words = words.iter();
    while let Some(&word) = words.next() {
        match word {
            "--write" => write = true,
            "--triples" => plan.triples = words.next().ok_or(HELP)?.parse()?,
            "--seconds" => plan.seconds = words.next().ok_or(HELP)?.parse()?,
            name if NAMES.contains(&name) => names.push(name),
            _ => return Err(HELP.into()),
        }
    }
    if plan.triples == 0 || plan.seconds == 0 { Err(HELP.into()) } else { Ok((names, (plan, write))) }
}

fn answer(role: &str, path: &Path) -> Result<(), Failure> {
    match role {
        "registers" => backplane::answer_registers(path),
        "timed" => backplane::answer_timed(path),
        "word" => backplane::answer_word(path),
        "asleep" => backplane::answer_asleep(path),
        "eventfd" => backplane::answer_eventfd(path),
        #[cfg(feature = "iceoryx")]
        "iceoryx" => ob1_tests::bench::iceoryx::answer_registers(path),
        #[cfg(feature = "iceoryx")]
        "iceoryx-event" => ob1_tests::bench::iceoryx::answer_event(path),
        "pipe" => answer_pipe(path),
        _ => Err(format!("no such role: {role}").into()),
    }
}

/// Prints the table; true if every aim was met.
fn measure(names: &[&str], write: bool) -> Result<bool, Failure> {
    println!("medians; a figure and its floor are measured in turns in the same run");
    let mut met = true;
    for name in if names.is_empty() { &NAMES } else { names } {
        let figures = match *name {
            "scan" => {
                let mut figures =
                    vec![scan::empty()?, scan::accounts()?, scan::late_scan()?, machine_code::take_over()?];
                figures.extend(machine_code::scan()?);
                figures
            }
            "pair" => vec![scan::idle_pair()?],
            "backplane" => {
                let mut all = vec![backplane::measure()?, backplane::measure_asleep()?];
                all.extend(backplane::measure_times()?);
                #[cfg(feature = "iceoryx")]
                all.extend(ob1_tests::bench::iceoryx::measure()?);
                all
            }
            "driver" => vec![driver::measure()?],
            "line" => line::measure()?,
            "compile" => {
                let mut figures: Vec<_> = compile::measure()?.into();
                figures.extend(machine_code::compiler()?);
                figures
            }
            "access" => access::figures()?,
            "start" => start::measure()?.into(),
            _ => memory::measure()?.into(),
        };
        met &= shown(&figures);
        if write {
            written::write(name, &figures)?;
        }
    }
    Ok(met)
}
