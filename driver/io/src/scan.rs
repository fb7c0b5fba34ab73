//! `ob1-io --scan`: the stations on a PROFIBUS. Nobody else may use the line meanwhile.

use std::io::{self, Write as _};
use std::time;

use ob1_coupler::{BusConfig, Input, LineFault, LineInput, MasterInput};
use ob1_dp::scan::{Found, Scan};
use ob1_line::{Instant, LineEvent, LineSpec, PollFds, RealLine, Span};

use crate::line;

/// Telegrams of two rounds over all addresses: each is asked once, and the token follows.
const TELEGRAMS: u64 = 2 * 2 * 126;
/// A line that is not up by then counts as missing.
const LONGEST: Span = Span::from_secs(60);

/// Prints a line of JSON for each slave that answers.
///
/// # Errors
/// No PROFIBUS in the configuration, a line that cannot be opened or was lost; in words.
pub(crate) fn run(bus: &BusConfig) -> io::Result<()> {
    let config = bus.lines.iter().find(|line| line.dp.is_some()).ok_or_else(|| io::Error::other("no PROFIBUS"))?;
    let dp = config.dp.as_ref().ok_or_else(|| io::Error::other("no PROFIBUS"))?;
    let spec: LineSpec = config.line.parse().map_err(|error| io::Error::other(format!("{error}")))?;
    let mut real = line::open(&spec, &line::settings(config))?;
    let start = time::Instant::now();
    let now = || Instant::START + start.elapsed().into();
    let mut scan = Scan::new(dp, Instant::START).map_err(|why| io::Error::other(why.0))?;
    let mut deadline = Instant::START;
    let mut buffer = [0; 512];
    while scan.sent() < TELEGRAMS {
        if now().since_start() > LONGEST {
            return Err(io::Error::other("the line is never free to send: another master, or a short circuit"));
        }
        while let Some(event) = real.next_event(now(), &mut buffer) {
            let input = match event {
                LineEvent::Input(input) => input,
                LineEvent::Up(_) => LineInput::Fault(LineFault::Back),
                LineEvent::Gone(reason) => return Err(io::Error::other(reason)),
                LineEvent::Echo(_) => continue,
            };
            deadline = step(&mut scan, now(), Input::Line(input), &mut real);
        }
        if now() >= deadline {
            deadline = step(&mut scan, now(), Input::Tick, &mut real);
        }
        wait(&mut real, deadline, now())?;
    }
    let mut out = io::stdout();
    for Found { station, ident, master } in scan.found() {
        writeln!(out, "{}", serde_json::json!({ "station": station, "ident": ident, "master": master }))?;
    }
    out.flush()
}

fn step(scan: &mut Scan, now: Instant, input: MasterInput<'_>, real: &mut RealLine) -> Instant {
    let mut out = Vec::new();
    let deadline = scan.step(now, input, &mut out);
    if !out.is_empty() {
        real.write(now, &out);
    }
    deadline
}

fn wait(real: &mut RealLine, deadline: Instant, now: Instant) -> io::Result<()> {
    let until =
        deadline.min(real.deadline().unwrap_or(Instant::NEVER)).min(Instant::START + LONGEST + Span::from_nanos(1));
    let ready = {
        let mut fds = PollFds::default();
        real.poll_fds(&mut fds);
        let mut fds: Vec<_> = fds.into_entries().collect();
        ob1_process::wait(&mut fds, until.since(now))?;
        fds.iter().any(|fd| !fd.revents().is_empty())
    };
    if ready {
        real.ready();
    }
    Ok(())
}
