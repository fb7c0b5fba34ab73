//! The one place where the command prints: what was asked for on standard output, everything else on standard error.
//!
//! Nothing here panics. If the reader of standard output closes it (`| head`), nothing more is printed and the command
//! ends as usual. Any other failure to write it (a full disk) is reported and has an exit code of its own. Standard
//! error goes through [`ob1_process::log`], which a running station does not wait for.

use std::fmt;
use std::io::{self, Write as _};
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::mpsc;
use std::time::Duration;

pub use ob1_process::log::Severity;

use crate::exit::Exit;

/// How long the last words of a process may hold up its end.
const LAST_WORDS: Duration = Duration::from_millis(500);

/// State of standard output.
#[derive(Debug)]
enum Stdout {
    Open,
    /// The reader is gone.
    Closed,
    Failed(io::Error),
}

static STDOUT: Mutex<Stdout> = Mutex::new(Stdout::Open);

/// A line on standard output.
#[macro_export]
macro_rules! say {
    () => { $crate::out::print(format_args!("\n")) };
    ($($text:tt)*) => { $crate::out::print(format_args!("{}\n", format_args!($($text)*))) };
}

/// Text on standard output.
#[macro_export]
macro_rules! says {
    ($($text:tt)*) => { $crate::out::print(format_args!($($text)*)) };
}

/// A line on standard error that says what is wrong.
#[macro_export]
macro_rules! err {
    ($($text:tt)*) => {
        $crate::out::tell($crate::out::Severity::Error, format_args!("{}\n", format_args!($($text)*)))
    };
}

/// A line on standard error that says how it goes.
#[macro_export]
macro_rules! note {
    ($($text:tt)*) => {
        $crate::out::tell($crate::out::Severity::Info, format_args!("{}\n", format_args!($($text)*)))
    };
}

/// Text on standard error that says what is wrong.
#[macro_export]
macro_rules! errs {
    ($($text:tt)*) => { $crate::out::tell($crate::out::Severity::Error, format_args!($($text)*)) };
}

fn with_stdout(work: impl FnOnce(&mut io::StdoutLock<'_>) -> io::Result<()>) {
    let Ok(mut state) = STDOUT.lock() else { return };
    if !matches!(*state, Stdout::Open) {
        return;
    }
    match work(&mut io::stdout().lock()) {
        Ok(()) => {}
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => *state = Stdout::Closed,
        Err(error) => *state = Stdout::Failed(error),
    }
}

/// Text on standard output; what [`say`](crate::say) does.
pub fn print(text: fmt::Arguments<'_>) {
    with_stdout(|out| out.write_fmt(text));
}

/// Flushes the buffer; for output that somebody watches.
pub fn flush() {
    with_stdout(|out| out.flush());
}

/// Nobody reads standard output any more: an endless command may end.
pub fn is_over() -> bool {
    STDOUT.lock().is_ok_and(|state| !matches!(*state, Stdout::Open))
}

/// Prints on standard output at the end of a run, and waits only a while for its reader.
pub fn print_at_the_end(text: String) {
    let (done, printed) = mpsc::channel();
    let printing = ob1_rt::spawn("ob1-print", move || {
        says!("{text}");
        flush();
        let _ = done.send(());
    });
    if printing.is_ok() {
        let _ = printed.recv_timeout(LAST_WORDS);
    }
}

/// Text on standard error, through [`ob1_process::log`]; what [`err`](crate::err) and [`note`](crate::note) do.
pub fn tell(severity: Severity, text: fmt::Arguments<'_>) {
    ob1_process::log::write(severity, text.to_string().as_bytes());
}

/// The last thing a command does: what is still in buffers is written, and the exit code says whether it was.
pub fn finish(exit: ExitCode) -> ExitCode {
    // Its printing may still wait for the reader.
    if let Ok(mut state) = STDOUT.try_lock() {
        if matches!(*state, Stdout::Open) {
            match io::stdout().lock().flush() {
                Err(error) if error.kind() != io::ErrorKind::BrokenPipe => *state = Stdout::Failed(error),
                _ => {}
            }
        }
        if let Stdout::Failed(error) = &*state {
            tell(Severity::Error, format_args!("ob1: standard output: {error}\n"));
            ob1_process::log::flush(LAST_WORDS);
            return if exit == Exit::Ok.into() { Exit::System.into() } else { exit };
        }
    }
    ob1_process::log::flush(LAST_WORDS);
    exit
}
