//! Standard error for a process that must not wait for it.
//!
//! The reader of a log may be slow, stop reading or end, and a disk may be full. So only one thread writes to standard
//! error, fed by a bounded queue: [`write`] neither waits nor fails nor panics, and what could not be written is
//! counted in [`lost`]. Before [`start`] everything is written at once, without the thread.
//!
//! Lines that others cause have a bound ([`Lines::Sparing`], [`Limit`]); what was left out is counted.
//!
//! To the journal of systemd each line has its [`Severity`] in front, so that `journalctl -p` finds it.

mod limit;

use std::ffi::OsStr;
use std::fs::File;
use std::io::{self, IsTerminal as _, Write as _};
use std::os::fd::AsFd as _;
use std::os::unix::fs::MetadataExt as _;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::Builder;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, poll};
use tracing::{Level, Metadata};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::fmt::MakeWriter;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

pub use limit::Limit;
use limit::{Sparing, tell_left_out};

/// How long what is still to be written may hold up the end of a process.
pub const LAST_WORDS: Duration = Duration::from_millis(200);
/// The target of lines that are all written, also with [`Lines::Sparing`]: they have a bound of their own.
pub const ALL: &str = "ob1_all";
/// Between the first line that is left out and the one that says how many were.
const LEFT_OUT: Duration = Duration::from_secs(1);
/// Texts that wait to be written.
const QUEUE: usize = 1024;
/// Stack of the thread, in bytes: it may be locked into memory.
const STACK: usize = 64 * 1024;
/// Wipes the line of the cursor.
const WIPE: &[u8] = b"\r\x1b[K";
/// Between two checks of what still waits.
const LOOK: Duration = Duration::from_millis(1);

/// How bad a line is: the numbers of syslog, which the journal knows (sd-daemon(3)).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// Something does not work.
    Error = 3,
    /// It works, but somebody should look.
    Warning = 4,
    /// What happens in normal operation.
    Info = 6,
    /// For whoever looks for a fault.
    Debug = 7,
}

impl Severity {
    fn of(level: Level) -> Self {
        match level {
            Level::ERROR => Self::Error,
            Level::WARN => Self::Warning,
            Level::INFO => Self::Info,
            _ => Self::Debug,
        }
    }
}

enum Message {
    /// Whole lines, each with its end.
    Text(Vec<u8>),
    /// The line below them, in place of the one before; empty: none.
    Live(Vec<u8>),
    /// Lines are being left out: their number is due.
    LeftOut,
}

/// Which lines [`subscribe`] writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lines {
    /// All of the level: what happens here, nobody else causes.
    All,
    /// Others cause lines: of each place in the code some, and the number of those left out.
    Sparing,
}

static SENDER: OnceLock<SyncSender<Message>> = OnceLock::new();
/// Texts that were lost.
static LOST: AtomicU64 = AtomicU64::new(0);
/// Texts that are on their way.
static WAITING: AtomicU64 = AtomicU64::new(0);

/// Starts the thread that writes. A second call changes nothing.
///
/// # Errors
/// No thread or no descriptor is left; then everything is written at once, as before.
pub fn start() -> io::Result<()> {
    start_with(&SENDER, |file, messages| {
        let thread = Builder::new().name("ob1-log".into()).stack_size(STACK);
        let (up, is_up) = sync_channel(0);
        thread.spawn(move || {
            // A thread that begins to run, and one that waits for the first time, needs the lock that a library holds
            // while it is loaded, perhaps for ever: that is done with when this function returns.
            let _ = messages.recv_timeout(Duration::from_millis(1));
            let _ = up.send(());
            write_all(file, &messages);
        })?;
        let _ = is_up.recv();
        Ok(())
    })
}

fn start_with(
    place: &OnceLock<SyncSender<Message>>,
    spawn: impl FnOnce(File, Receiver<Message>) -> io::Result<()>,
) -> io::Result<()> {
    if place.get().is_some() {
        return Ok(());
    }
    // Found out here, not by the first line that somebody in a hurry writes.
    let _ = is_journal();
    // A descriptor of its own, so that the lock of `std::io::stderr` is not held while the reader is waited for.
    let file = File::from(io::stderr().as_fd().try_clone_to_owned()?);
    let (sender, messages) = sync_channel(QUEUE);
    spawn(file, messages)?;
    // Only now: without the thread nobody would take what is sent. The thread of a second call ends with its sender.
    let _ = place.set(sender);
    Ok(())
}

/// Sends log lines to standard error: those of this level and above, or what `OB1_LOG` says. It needs no thread, but
/// without one what [`Lines::Sparing`] leaves out is told by [`flush`] alone; a second call changes nothing. Returns
/// what is wrong with `OB1_LOG`, whose value does not count then.
pub fn subscribe(level: &str, lines: Lines) -> Option<String> {
    let told = std::env::var_os("OB1_LOG").map(|text| text.to_string_lossy().into_owned());
    let (filter, wrong) = filter(told.as_deref().unwrap_or_default(), level);
    let log = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(Log(Severity::Info))
        .with_ansi(is_coloured(is_terminal()))
        .with_target(false)
        .finish();
    let sparing = (lines == Lines::Sparing).then_some(Sparing { begun: left_out });
    let _ = log.with(sparing).try_init();
    wrong
}

/// The first line is left out: the thread tells how many, a moment later.
fn left_out() {
    if let Some(sender) = SENDER.get() {
        hand_over(sender, Message::LeftOut);
    }
}

/// The filter of this text: a level, or levels of parts of the program (`ob1_station=debug`). Any other word would be
/// the name of a part, and silence all the others.
fn filter(told: &str, level: &str) -> (EnvFilter, Option<String>) {
    if told.is_empty() {
        return (EnvFilter::new(level), None);
    }
    if (told.contains('=') || told.parse::<LevelFilter>().is_ok())
        && let Ok(filter) = EnvFilter::try_new(told)
    {
        return (filter, None);
    }
    let wrong = format!("OB1_LOG={told} says nothing: error, warn, info, debug or trace; until then it is {level}");
    (EnvFilter::new(level), Some(wrong))
}

/// Writes a text of whole lines, or counts it as lost. Never waits once [`start`] has been called.
pub fn write(severity: Severity, text: &[u8]) {
    let text = if is_journal() { marked(severity, text) } else { text.to_vec() };
    if let Some(sender) = SENDER.get() {
        hand_over(sender, Message::Text(text));
    } else if io::stderr().lock().write_all(&text).is_err() {
        LOST.fetch_add(1, Ordering::Relaxed);
    }
}

/// The text with the severity in front of each line: for the journal each line is an entry of its own.
fn marked(severity: Severity, text: &[u8]) -> Vec<u8> {
    let mark = format!("<{}>", severity as u8);
    let mut marked = Vec::with_capacity(text.len() + mark.len());
    for line in text.split_inclusive(|byte| *byte == b'\n') {
        // The journal leaves out an empty line.
        if line != b"\n" {
            marked.extend_from_slice(mark.as_bytes());
        }
        marked.extend_from_slice(line);
    }
    marked
}

/// Whether standard error is the journal of systemd. `JOURNAL_STREAM` names the stream a service was given; whoever
/// has redirected standard error since then, to a file or a pipe, has another one (systemd.exec(5)).
fn is_journal() -> bool {
    static IS_JOURNAL: OnceLock<bool> = OnceLock::new();
    *IS_JOURNAL.get_or_init(|| {
        let Some(told) = std::env::var_os("JOURNAL_STREAM") else { return false };
        let ours = io::stderr().as_fd().try_clone_to_owned().and_then(|fd| File::from(fd).metadata());
        ours.is_ok_and(|ours| names(&told.to_string_lossy(), ours.dev(), ours.ino()))
    })
}

/// Whether `DEVICE:INODE`, in decimal, names this file.
fn names(told: &str, device: u64, inode: u64) -> bool {
    let Some((first, second)) = told.split_once(':') else { return false };
    first.parse::<u64>() == Ok(device) && second.parse::<u64>() == Ok(inode)
}

/// Shows a line below the log, in place of the one before; empty: wipes it. For terminals; left out while texts wait.
pub fn live(line: &str) {
    if let Some(sender) = SENDER.get()
        && (line.is_empty() || WAITING.load(Ordering::Relaxed) == 0)
    {
        hand_over(sender, Message::Live(line.as_bytes().to_vec()));
    }
}

fn hand_over(sender: &SyncSender<Message>, message: Message) {
    let counts = matches!(message, Message::Text(_));
    WAITING.fetch_add(1, Ordering::Relaxed);
    if sender.try_send(message).is_err() {
        WAITING.fetch_sub(1, Ordering::Relaxed);
        LOST.fetch_add(u64::from(counts), Ordering::Relaxed);
    }
}

/// Texts that could not be written so far: the reader is gone or too slow, or the disk is full.
pub fn lost() -> u64 {
    LOST.load(Ordering::Relaxed)
}

/// Waits until everything is written, but not longer than `patience`; for the end of a process.
pub fn flush(patience: Duration) {
    tell_left_out();
    let end = Instant::now() + patience;
    while WAITING.load(Ordering::Relaxed) > 0 && Instant::now() < end {
        std::thread::sleep(LOOK);
    }
}

/// A writer of log lines of this severity, and the maker of one for each line.
#[derive(Clone, Copy, Debug)]
struct Log(Severity);

impl<'a> MakeWriter<'a> for Log {
    type Writer = Self;

    fn make_writer(&'a self) -> Self::Writer {
        *self
    }

    fn make_writer_for(&'a self, line: &Metadata<'_>) -> Self::Writer {
        Self(Severity::of(*line.level()))
    }
}

impl io::Write for Log {
    fn write(&mut self, text: &[u8]) -> io::Result<usize> {
        write(self.0, text);
        Ok(text.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Whether standard error is a terminal.
pub fn is_terminal() -> bool {
    io::stderr().is_terminal()
}

/// Whether a text has colours: only on a terminal, and not where `NO_COLOR` has a value (no-color.org).
pub fn is_coloured(is_terminal: bool) -> bool {
    is_terminal && !forbids_colour(std::env::var_os("NO_COLOR").as_deref())
}

fn forbids_colour(no_color: Option<&OsStr>) -> bool {
    no_color.is_some_and(|value| !value.is_empty())
}

thread_local! {
    /// Panics of this thread are caught, and somebody else tells of them.
    static QUIET: std::cell::Cell<bool> = const { std::cell::Cell::new(false) };
}

/// Runs `work`, which catches the panics of code that is not ours: they are no internal error and leave no message.
pub fn quietly<T>(work: impl FnOnce() -> T) -> T {
    let before = QUIET.replace(true);
    let done = work();
    QUIET.set(before);
    done
}

/// Sends the message of a panic there too: the one of the standard library waits for the reader.
pub fn tell_panics() {
    std::panic::set_hook(Box::new(|panic| {
        if QUIET.get() {
            return;
        }
        let thread = std::thread::current();
        let name = thread.name().unwrap_or("a thread");
        write(Severity::Error, format!("ob1: internal error: {name}: {panic}\n").as_bytes());
    }));
}

/// The thread: only it waits for the reader.
fn write_all(mut file: File, messages: &Receiver<Message>) {
    let mut live = false;
    let mut due: Option<Instant> = None;
    loop {
        let wait = due.map(|due| due.saturating_duration_since(Instant::now()));
        if wait == Some(Duration::ZERO) {
            due = None;
            tell_left_out();
            continue;
        }
        let next = wait.map_or_else(|| messages.recv().map_err(Into::into), |wait| messages.recv_timeout(wait));
        let message = match next {
            Ok(message) => message,
            Err(RecvTimeoutError::Timeout) => continue,
            Err(RecvTimeoutError::Disconnected) => return,
        };
        let bytes: &[u8] = match &message {
            Message::Text(text) | Message::Live(text) => text,
            Message::LeftOut => {
                due.get_or_insert_with(|| Instant::now() + LEFT_OUT);
                WAITING.fetch_sub(1, Ordering::Relaxed);
                continue;
            }
        };
        let done = if std::mem::take(&mut live) { put(&mut file, WIPE) } else { Ok(()) };
        let done = done.and_then(|()| put(&mut file, bytes));
        match message {
            Message::Live(line) => live = !line.is_empty(),
            _ if done.is_err() => drop(LOST.fetch_add(1, Ordering::Relaxed)),
            _ => {}
        }
        WAITING.fetch_sub(1, Ordering::Relaxed);
    }
}

fn put(file: &mut File, mut bytes: &[u8]) -> io::Result<()> {
    while !bytes.is_empty() {
        match file.write(bytes) {
            Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
            Ok(count) => bytes = bytes.get(count..).unwrap_or_default(),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            // Whoever started this process has set the descriptor so.
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                poll(&mut [PollFd::new(&*file, PollFlags::OUT)], None)?;
            }
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;

    use super::*;

    #[test]
    fn what_the_disk_or_the_queue_does_not_take_is_counted() {
        let (sender, messages) = sync_channel(4);
        for text in ["a\n", "b\n"] {
            hand_over(&sender, Message::Text(text.into()));
        }
        drop(sender);
        let before = lost();
        write_all(File::options().write(true).open("/dev/full").expect("there"), &messages);
        assert_eq!(lost() - before, 2);
        // Nor does anybody wait for room in the queue.
        let (sender, _unread) = sync_channel(1);
        let before = lost();
        for text in ["a\n", "b\n", "c\n"] {
            hand_over(&sender, Message::Text(text.into()));
        }
        assert_eq!(lost() - before, 2, "one lies in the queue");
    }

    #[test]
    fn without_the_thread_everything_is_written_at_once() {
        let place = OnceLock::new();
        assert!(start_with(&place, |_, _| Err(io::ErrorKind::WouldBlock.into())).is_err());
        assert!(place.get().is_none(), "nothing is sent to a thread that is not there");
        let mut taken = None;
        let took = start_with(&place, |_, messages| {
            taken = Some(messages);
            Ok(())
        });
        assert!(took.is_ok());
        hand_over(place.get().expect("there"), Message::Live(Vec::new()));
        assert!(taken.expect("the thread's end").try_recv().is_ok());
        WAITING.fetch_sub(1, Ordering::Relaxed);
    }

    #[test]
    fn each_line_for_the_journal_has_its_severity_in_front() {
        for (level, text, marks) in [
            (Level::ERROR, "a\n", "<3>a\n"),
            (Level::WARN, "a\n  = b\n", "<4>a\n<4>  = b\n"),
            (Level::INFO, "\na\n\nb", "\n<6>a\n\n<6>b"),
            (Level::DEBUG, "a\n", "<7>a\n"),
            (Level::TRACE, "", ""),
        ] {
            let marked = marked(Severity::of(level), text.as_bytes());
            assert_eq!(String::from_utf8(marked).expect("text"), marks, "{text:?}");
        }
    }

    #[test]
    fn only_the_stream_that_is_named_is_the_journal() {
        assert!(names("8:1234", 8, 1234));
        for other in ["", "8", "8:", ":1234", "8:1235", "9:1234", "8:1234:1", " 8:1234", "a:b"] {
            assert!(!names(other, 8, 1234), "{other}");
        }
    }

    #[test]
    fn a_word_that_is_no_level_does_not_silence_the_log() {
        let text = |told| {
            let (filter, wrong) = filter(told, "info");
            (filter.to_string(), wrong.is_some())
        };
        for (told, means) in [("", "info"), ("debug", "debug"), ("WARN", "warn"), ("a=debug,warn", "a=debug,warn")] {
            assert_eq!(text(told), (means.to_owned(), false), "{told}");
        }
        for wrong in ["inof", "info warn", "a=loud", "\u{FFFD}"] {
            assert_eq!(text(wrong), ("info".to_owned(), true), "{wrong}");
        }
    }

    #[test]
    fn no_color_with_any_value_forbids_colours() {
        for (value, forbids) in [(None, false), (Some(""), false), (Some("1"), true), (Some("0"), true)] {
            assert_eq!(forbids_colour(value.map(OsStr::new)), forbids, "{value:?}");
        }
        assert!(!is_coloured(false));
    }

    #[test]
    fn a_live_line_is_wiped_before_the_next_text() {
        let (sender, messages) = sync_channel(4);
        for message in [Message::Live("50 %".into()), Message::Text("a\n".into()), Message::Text("b\n".into())] {
            hand_over(&sender, message);
        }
        drop(sender);
        let (mut reader, writer) = io::pipe().expect("descriptors");
        write_all(File::from(std::os::fd::OwnedFd::from(writer)), &messages);
        let mut text = String::new();
        reader.read_to_string(&mut text).expect("text");
        assert_eq!(text, "50 %\r\x1b[Ka\nb\n");
    }
}
