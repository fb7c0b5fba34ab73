//! Modbus RTU over a pty: transactions per second of the protocol machine, compared with a plain loop, libmodbus and
//! pymodbus, all with the same server. One register is read at 38400 baud, with a silence of 1.75 ms; and again without
//! silence, because libmodbus keeps none.

use std::fs::{File, OpenOptions};
use std::io::{Read as _, Write as _};
use std::os::fd::AsFd as _;
use std::path::PathBuf;
use std::process::Command;
use std::time::{self, Duration};

use ob1_protocols::modbus::{Master, Mode, frame, master};
use ob1_protocols::{Event, Input, LineInput, MS, Machine as _, Order, SendError, Sink, Wire};
use ob1_time::{Instant, Span};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

use super::super::peer::Failure;
use super::super::{Figure, median};

const BAUD: u32 = 38_400;
/// 8N1.
const CHARACTER: Span = Span::from_secs(10).over(BAUD as u64);
const REQUEST: [u8; 6] = [5, 3, 0, 0, 0, 1];
const ANSWER: [u8; 5] = [5, 3, 2, 0x12, 0x34];
const ROUNDS: usize = 7;
/// Transactions of a round with silence.
const SLOW: u32 = 200;
/// Transactions of a round without silence.
const FAST: u32 = 3000;

/// A pty with a server at its other end that answers each request at once, until the pty is closed.
struct Line {
    tty: File,
    path: PathBuf,
}

impl Line {
    fn new() -> Result<Self, Failure> {
        let server = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        grantpt(&server)?;
        unlockpt(&server)?;
        let path = PathBuf::from(ptsname(&server, Vec::new())?.into_string()?);
        let tty = OpenOptions::new().read(true).write(true).open(&path)?;
        let mut raw = tcgetattr(&tty)?;
        raw.make_raw();
        tcsetattr(&tty, OptionalActions::Now, &raw)?;
        let mut server = File::from(server);
        std::thread::spawn(move || {
            let answer = framed(&ANSWER);
            let mut request = [0; 8];
            while server.read_exact(&mut request).is_ok() && server.write_all(&answer).is_ok() {}
        });
        Ok(Self { tty, path })
    }

    /// Waits for characters, at most `timeout`; returns the number received.
    fn wait(&mut self, timeout: Span, buffer: &mut [u8]) -> Result<usize, Failure> {
        let timeout = Timespec::try_from(Duration::from(timeout))?;
        let mut ready = [PollFd::from_borrowed_fd(self.tty.as_fd(), PollFlags::IN)];
        Ok(if poll(&mut ready, Some(&timeout))? == 0 { 0 } else { self.tty.read(buffer)? })
    }
}

fn framed(telegram: &[u8]) -> Vec<u8> {
    let mut frame = [0; ob1_protocols::modbus::FRAME_CHARACTERS];
    let len = Mode::Rtu.encode(telegram, &mut frame).unwrap_or(0);
    frame[..len].to_vec()
}

fn config(silent: bool) -> frame::Config {
    let frame = frame::Config::new(Mode::Rtu, BAUD, CHARACTER).with_bursts(50 * MS);
    if silent { frame } else { frame.without_silence() }
}

/// Write, read, keep the silence: the lower limit. Returns transactions per second.
fn bare(line: &mut Line, silence: Span, count: u32) -> Result<f64, Failure> {
    let (request, answer) = (framed(&REQUEST), framed(&ANSWER));
    let mut buffer = [0; 64];
    let start = time::Instant::now();
    for _ in 0..count {
        line.tty.write_all(&request)?;
        let mut got = 0;
        while got < answer.len() {
            got += line.wait(1_000 * MS, &mut buffer[got..])?;
        }
        if buffer[..got] != answer[..] {
            return Err("the server answers something else".into());
        }
        let end = time::Instant::now() + Duration::from(silence);
        loop {
            let left = end.saturating_duration_since(time::Instant::now());
            if left.is_zero() {
                break;
            }
            line.wait(left.into(), &mut buffer)?;
        }
    }
    Ok(f64::from(count) / start.elapsed().as_secs_f64())
}

/// The output of a step of the machine.
#[derive(Default)]
struct Out {
    frame: Vec<u8>,
    got: bool,
    ended: Option<Result<(), SendError>>,
}

impl Wire for Out {
    fn transmit(&mut self, bytes: &[u8]) {
        self.frame.extend_from_slice(bytes);
    }
}

impl Sink for Out {
    fn room(&self) -> usize {
        1024
    }
    fn deliver(&mut self, telegram: &[u8]) {
        self.got = telegram == ANSWER;
    }
    fn sent(&mut self, outcome: Result<(), SendError>) {
        self.ended = Some(outcome);
    }
    fn report(&mut self, _: Event) {}
}

/// The protocol machine on the same line, orders one after the other. Returns transactions per second.
fn machine(line: &mut Line, silent: bool, count: u32) -> Result<f64, Failure> {
    let mut machine = Master::new(master::Config { frame: config(silent), wait: 1_000 * MS });
    let mut buffer = [0; 64];
    let start = time::Instant::now();
    let now = || Instant::START + start.elapsed().into();
    for _ in 0..count {
        let mut out = Out::default();
        let mut due = machine.step(now(), Input::Order(Order::Send(&REQUEST)), &mut out);
        while out.ended.is_none() {
            if !out.frame.is_empty() {
                line.tty.write_all(&out.frame)?;
                out.frame.clear();
                // A pty takes no time.
                due = machine.step(now(), Input::Line(LineInput::TxDone), &mut out);
            }
            let timeout = due.map_or(1_000 * MS, |due| due.since(now()));
            let got = line.wait(timeout, &mut buffer)?;
            let input = if got == 0 { Input::Tick } else { Input::Line(LineInput::Rx(&buffer[..got])) };
            due = machine.step(now(), input, &mut out);
        }
        if out.ended != Some(Ok(())) || !out.got {
            return Err("a transaction failed".into());
        }
    }
    Ok(f64::from(count) / start.elapsed().as_secs_f64())
}

/// A library as a master, in its own process, which measures itself. Returns transactions per second.
fn library(line: &Line, name: &str, count: u32) -> Result<f64, Failure> {
    let python = std::env::var_os("OB1_PYTHON").ok_or("OB1_PYTHON is not set; run: cargo xtask bench line")?;
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/peers/modbus.py");
    let mut command = Command::new(python);
    command.args([script, "bench", name]).arg(&line.path).args(["--baud", &BAUD.to_string()]);
    let said = command.args(["--count", &count.to_string()]).output()?;
    let text = String::from_utf8_lossy(&said.stdout);
    let value: serde_json::Value = serde_json::from_str(&text)
        .map_err(|why| format!("{name}: {why}: {text}{}", String::from_utf8_lossy(&said.stderr)))?;
    Ok(f64::from(count) / value["seconds"].as_f64().ok_or("no seconds")?)
}

/// The figures.
///
/// # Errors
/// If a pty, a library or an answer is not available.
pub(super) fn measure() -> Result<Vec<Figure>, Failure> {
    let mut line = Line::new()?;
    let silence = config(true).silence;
    let mut rates: [Vec<f64>; 6] = Default::default();
    for _ in 0..ROUNDS {
        let round = [
            machine(&mut line, true, SLOW)?,
            bare(&mut line, silence, SLOW)?,
            library(&line, "pymodbus", SLOW)?,
            machine(&mut line, false, FAST)?,
            library(&line, "libmodbus", FAST)?,
            bare(&mut line, Span::ZERO, FAST)?,
        ];
        for (rates, rate) in rates.iter_mut().zip(round) {
            rates.push(rate);
        }
    }
    let [silent, bare_silent, pymodbus, quick, libmodbus, bare_quick] = rates.map(|mut rates| median(&mut rates));
    let figure = |what, value, floor: (&'static str, f64), aim: &'static str, least: f64| Figure {
        what: std::borrow::Cow::Borrowed(what),
        value,
        unit: "1/s",
        floor: Some(floor),
        aim: (aim, value >= least * floor.1),
    };
    Ok(vec![
        figure("Modbus RTU machine, 1.75 ms silence", silent, ("bare loop, same silence", bare_silent), ">= 0.9", 0.9),
        figure("the same", silent, ("pymodbus", pymodbus), "> 1", 1.0),
        figure("Modbus RTU machine, no silence", quick, ("libmodbus", libmodbus), "level: 0.95", 0.95),
        figure("the same", quick, ("bare loop, no silence", bare_quick), "> 0.8", 0.8),
    ])
}
