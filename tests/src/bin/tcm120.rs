//! `cargo run -p ob1-tests --bin tcm120 -- TTY`: a TCM 120 on a tty, its radio side on standard input and output.

use std::io::{BufRead as _, Write as _};
use std::os::fd::{AsFd as _, OwnedFd};
use std::process::ExitCode;
use std::time;

use ob1_line::{LineEvent, LineInput, LineSettings, LineSpec, PollFds, RealLine};
use ob1_protocols::esp2::Telegram;
use ob1_tests::tcm120::{Eeprom, Input, Output, Tcm120, script};
use ob1_time::Instant;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

/// A module as in the manual's example: 80h ORed with 67h.
const ID_BASE: u32 = 0xFF80_0080;

fn help() -> String {
    format!(
        "tcm120 LINE [ID_BASE]\n\nA TCM 120, the EnOcean module of the CP 240, on a line: serial:TTY, pty:PATH (creates it), tcp:HOST:PORT,\n\
         tcp-listen:PORT. Its ID base is {ID_BASE:08X} unless another is given. What it sends by radio is printed; what it receives is read\n\
         from standard input, with which it ends:\n\n{}",
        script::WORDS
    )
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let started = match arguments.as_slice() {
        [word] if word == "--help" || word == "-h" => {
            println!("{}", help());
            return ExitCode::SUCCESS;
        }
        [line] => spec(line).map(|spec| (spec, ID_BASE)),
        [line, base] => spec(line).and_then(|spec| Ok((spec, id_base(base)?))),
        _ => Err(help()),
    };
    let (spec, base) = match started {
        Ok(started) => started,
        Err(why) => {
            eprintln!("tcm120: {why}");
            return ExitCode::from(2);
        }
    };
    match run(&spec, Eeprom::new(base)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("tcm120: {why}");
            ExitCode::FAILURE
        }
    }
}

/// Parses a line; paths of devices are relative to the current folder.
fn spec(line: &str) -> Result<LineSpec, String> {
    let text = match line.split_once(':') {
        Some((kind @ ("serial" | "pty"), path)) => {
            let path = std::path::absolute(path).map_err(|why| format!("{path}: {why}"))?;
            format!("{kind}:{}", path.display())
        }
        _ => line.to_owned(),
    };
    text.parse().map_err(|why| format!("{line}: {why}"))
}

fn id_base(text: &str) -> Result<u32, String> {
    u32::from_str_radix(text, 16).map_err(|_| format!("`{text}` is no ID base: eight hexadecimal digits"))
}

/// A separate thread reads lines of standard input; a byte in a pipe wakes the loop.
fn typed() -> std::io::Result<(std::sync::mpsc::Receiver<String>, OwnedFd)> {
    let (sender, lines) = std::sync::mpsc::channel();
    let (bell, rings) = rustix::pipe::pipe()?;
    std::thread::spawn(move || {
        for line in std::io::stdin().lock().lines().map_while(Result::ok) {
            if sender.send(line).is_err() || rustix::io::write(&rings, &[0]).is_err() {
                return;
            }
        }
        drop(sender);
        let _ = rustix::io::write(&rings, &[0]);
    });
    Ok((lines, bell))
}

fn run(spec: &LineSpec, eeprom: Eeprom) -> Result<(), Box<dyn std::error::Error>> {
    let begin = time::Instant::now();
    let now = || Instant::START + begin.elapsed().into();
    let mut line = RealLine::new(spec);
    line.apply(&LineSettings::default())?;
    let mut module = Tcm120::new(eeprom);
    let (typed, bell) = typed()?;
    let mut due = None;
    let mut buffer = [0; 256];
    loop {
        let mut out = Output::default();
        while let Some(event) = line.next_event(now(), &mut buffer) {
            match event {
                LineEvent::Input(LineInput::Rx(bytes)) => due = module.step(now(), Input::Rx(bytes), &mut out),
                // The cable is plugged in later: the module is already on.
                LineEvent::Up(_) => println!("line up"),
                LineEvent::Gone(why) => println!("line gone: {why}"),
                LineEvent::Input(_) | LineEvent::Echo(_) => {}
            }
        }
        loop {
            match typed.try_recv() {
                Ok(text) => match script::line(&text) {
                    Ok(Some(input)) => due = module.step(now(), input, &mut out),
                    Ok(None) => {}
                    Err(why) => eprintln!("tcm120: {why}"),
                },
                Err(std::sync::mpsc::TryRecvError::Empty) => break,
                Err(std::sync::mpsc::TryRecvError::Disconnected) => return Ok(()),
            }
        }
        if due.is_some_and(|due| now() >= due) {
            due = module.step(now(), Input::Tick, &mut out);
        }
        for radio in &out.air {
            println!("{}", Telegram::Transmit(*radio));
        }
        std::io::stdout().flush()?;
        line.write(now(), &out.serial);
        let mut fds = PollFds::default();
        line.poll_fds(&mut fds);
        let mut fds: Vec<PollFd<'_>> = fds.into_entries().collect();
        let on_line = fds.len();
        fds.push(PollFd::from_borrowed_fd(bell.as_fd(), PollFlags::IN));
        let left = due.into_iter().chain(line.deadline()).min().map(|at| at.since(now()));
        let timeout = left.map(|left| Timespec { tv_sec: left.secs() as i64, tv_nsec: left.subsec_nanos() as i64 });
        poll(&mut fds, timeout.as_ref())?;
        let is_ready = |fd: &PollFd<'_>| !fd.revents().is_empty();
        let (on_line, rung) = (fds[..on_line].iter().any(is_ready), fds.last().is_some_and(is_ready));
        drop(fds);
        if on_line {
            line.ready();
        }
        if rung {
            let mut rings = [0; 16];
            rustix::io::read(&bell, &mut rings)?;
        }
    }
}
