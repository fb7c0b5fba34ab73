//! `ob1 record`: signals of a running station at every scan, with what happened meanwhile (docs/record.md).

mod csv;
mod lines;
mod live;
mod perfetto;
mod proto;
mod sink;

use std::fs::File;
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};

use clap::Args;
use ob1_record::{Entry, Event, FormatError, Order, Reader};
use ob1_time::Span;

use crate::exit::{Exit, told};
use crate::testing::replay::test_file;
use crate::trace::TraceError;
use ob1_station::access::client::AccessError;
use sink::Sink;

/// Record signals at every scan, and what happens meanwhile: for Perfetto, as a table, or to be replayed
///
/// Values are those of the cycle control point of each scan. Recording does not slow the scan down noticeably; rows
/// that
/// are not taken in time are lost, and counted. The ending of the file says its form: .pftrace is for
/// https://ui.perfetto.dev, .csv a table, .ob1trace the recording itself, which all others can be made of.
#[derive(Clone, Debug, Default, Args)]
#[command(
    after_help = "Examples:\n  ob1 record press.toml --signals \"Motor,MW10,DB10.level\" --for 10s --out run.pftrace\n  \
    ob1 record press.toml --signals Motor --trigger \"Motor rising\" --before 1s --for 5s --repeat 10 --out motor.ob1trace\n  \
    ob1 record press.toml --trigger late --before 200ms --for 200ms --repeat 0 --out late.pftrace\n  \
    ob1 record --from motor.ob1trace --out motor.csv\n  ob1 record --from motor.ob1trace --to-test motor.test.toml --program press.toml\n\n\
    Triggers: CONDITION rising, CONDITION falling (\"Motor and DB10.level > 50 rising\"), late, diag, diag 4562h, order-error.\n\n\
    Exit codes: 0 recorded, 1 a signal or trigger is wrong, 2 no station file or recording, 5 the station does not run,\n\
    6 a file cannot be read or written, 8 the station does not answer."
)]
pub struct RecordArgs {
    /// A running station: its name or its file
    #[arg(required_unless_present = "from", conflicts_with = "from")]
    pub station: Option<String>,
    /// The signals, by commas: M1.0, MW10, DB10.level, symbols
    #[arg(long, value_name = "NAMES", conflicts_with = "from")]
    pub signals: Vec<String>,
    /// What begins the recording; without it, it begins at once
    #[arg(long, value_name = "CONDITION", conflicts_with = "from")]
    pub trigger: Option<String>,
    /// Begin so long before the trigger
    #[arg(long, value_name = "TIME", value_parser = ob1_station_file::parse_duration, requires = "trigger")]
    pub before: Option<Span>,
    /// Record for so long, after each trigger; without it until Ctrl-C
    #[arg(long = "for", value_name = "TIME", value_parser = ob1_station_file::parse_duration, conflicts_with = "from")]
    pub time: Option<Span>,
    /// Record after so many triggers; 0: until Ctrl-C
    #[arg(long, value_name = "N", requires = "trigger", default_value_t = 1)]
    pub repeat: u64,
    /// Leave the telegrams of the lines out
    #[arg(long, conflicts_with = "from")]
    pub no_lines: bool,
    /// Read a recording instead of a running station
    #[arg(long, value_name = "FILE")]
    pub from: Option<PathBuf>,
    /// Write this file: .pftrace, .csv or .ob1trace
    #[arg(long, value_name = "FILE", required_unless_present = "from")]
    pub out: Option<PathBuf>,
    /// Write a test that replays the recording with a program (docs/testing.md)
    #[arg(long, value_name = "NAME.test.toml", requires_all = ["from", "program"])]
    pub to_test: Option<PathBuf>,
    /// The station file or the source that the test is for
    #[arg(long, value_name = "FILE", requires = "to_test")]
    pub program: Option<PathBuf>,
    /// Print nothing
    #[arg(long, short)]
    pub quiet: bool,
}

/// Why nothing was recorded, or not all.
#[derive(Debug, thiserror::Error)]
pub(crate) enum RecordError {
    #[error(transparent)]
    Access(#[from] AccessError),
    #[error(transparent)]
    Taps(#[from] TraceError),
    #[error("the station has just ended")]
    Ended,
    /// The station does not record that.
    #[error("{0}")]
    Refused(String),
    #[error("{}: give it the ending .pftrace, .csv or .ob1trace", .0.display())]
    Ending(PathBuf),
    #[error("{}: {error}", .path.display())]
    Recording { path: PathBuf, error: FormatError },
    #[error("{}: {error}", .path.display())]
    File { path: PathBuf, error: io::Error },
    #[error("what the station sends cannot be read: {0}")]
    Stream(FormatError),
    #[error("{0}")]
    Io(#[from] io::Error),
}

impl RecordError {
    const fn exit(&self) -> Exit {
        match self {
            Self::Access(error) => error.exit(),
            Self::Taps(TraceError::Access(error)) => error.exit(),
            Self::Ended => Exit::Running,
            Self::Refused(_) | Self::Ending(_) => Exit::Usage,
            Self::Recording { error: FormatError::Io(_), .. } | Self::File { .. } | Self::Io(_) | Self::Taps(_) => {
                Exit::System
            }
            Self::Recording { .. } => Exit::Rejected,
            Self::Stream(_) => Exit::Refused,
        }
    }
}

/// What a recording has held.
#[derive(Debug, Default)]
pub(super) struct Count {
    rows: u64,
    lost: u64,
    parts: u64,
    events: u64,
    end: Option<String>,
}

impl Count {
    pub(super) fn take(&mut self, entry: &Entry) {
        match entry {
            Entry::Row(row) => {
                self.rows += 1;
                self.lost = self.lost.max(row.lost);
            }
            Entry::Event(Event::Part { .. }) => self.parts += 1,
            Entry::Event(Event::End { why, lost, .. }) => {
                self.lost = self.lost.max(*lost);
                self.end = Some(why.clone());
            }
            Entry::Event(_) => self.events += 1,
            Entry::Run(_) | Entry::Line(..) => {}
        }
    }

    fn text(&self, signals: usize) -> String {
        let counted = |count: u64, one: &str| format!("{count} {one}{}", if count == 1 { "" } else { "s" });
        format!(
            "{} of {} in {}, {} lost, {}",
            counted(self.rows, "row"),
            counted(signals as u64, "signal"),
            counted(self.parts, "part"),
            self.lost,
            counted(self.events, "event")
        )
    }
}

/// Records until its end.
pub fn record(args: &RecordArgs) -> Exit {
    told(run(args).map(|()| Exit::Ok), RecordError::exit)
}

impl RecordArgs {
    fn order(&self) -> Order {
        let names = self.signals.iter().flat_map(|names| split(names)).collect();
        Order {
            signals: names,
            trigger: self.trigger.clone().unwrap_or_default(),
            before_ns: self.before.unwrap_or_default().nanos(),
            for_ns: self.time.unwrap_or_default().nanos(),
            repeat: self.repeat,
        }
    }
}

/// Names between commas; a comma in quotes belongs to its name.
fn split(names: &str) -> Vec<String> {
    let (mut list, mut quoted) = (vec![String::new()], false);
    for c in names.chars() {
        quoted ^= c == '"';
        match list.last_mut() {
            Some(name) if c != ',' || quoted => name.push(c),
            _ => list.push(String::new()),
        }
    }
    list.into_iter().map(|name| name.trim().to_owned()).filter(|name| !name.is_empty()).collect()
}

fn run(args: &RecordArgs) -> Result<(), RecordError> {
    let (count, signals, from) = match (&args.station, &args.from) {
        (_, Some(path)) => {
            let (count, signals) = read(path, args.out.as_deref())?;
            if let (Some(test), Some(program)) = (&args.to_test, &args.program) {
                write_test(path, program, test)?;
            }
            (count, signals, path.display().to_string())
        }
        (Some(station), None) => {
            let path = args.out.as_deref().unwrap_or(Path::new("record.ob1trace"));
            let (count, signals) = live::record(station, &args.order(), path, args)?;
            (count, signals, path.display().to_string())
        }
        (None, None) => return Err(RecordError::Refused("name a running station, or a recording with --from".into())),
    };
    if !args.quiet {
        says!("{from}: {}\n", count.text(signals));
    }
    Ok(())
}

/// Writes a test beside which, or below which, the recording and the program lie.
fn write_test(recording: &Path, program: &Path, test: &Path) -> Result<(), RecordError> {
    let file = |path: &Path, error| RecordError::File { path: path.to_owned(), error };
    let whole = |path: &Path| path.canonicalize().map_err(|error| file(path, error));
    let folder = test.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let name = recording.file_stem().unwrap_or_default().to_string_lossy();
    let text = test_file(&whole(recording)?, &whole(program)?, &whole(folder)?, &name);
    ob1_process::files::write(test, text.as_bytes()).map_err(|error| file(test, error))
}

/// Reads a recording, and writes it in another form.
fn read(path: &Path, out: Option<&Path>) -> Result<(Count, usize), RecordError> {
    let file = |error| RecordError::File { path: path.to_owned(), error };
    let bad = |error| RecordError::Recording { path: path.to_owned(), error };
    if ob1_process::files::is_fifo(path) {
        return Err(file(io::Error::new(io::ErrorKind::InvalidInput, ob1_process::files::NO_FILE)));
    }
    let mut reader = Reader::new(BufReader::new(File::open(path).map_err(file)?)).map_err(bad)?;
    let same = |out: &Path| out.canonicalize().is_ok_and(|out| path.canonicalize().is_ok_and(|path| path == out));
    if let Some(out) = out.filter(|out| same(out)) {
        return Err(RecordError::Refused(format!("{} is named twice: give --out a file of its own", out.display())));
    }
    let mut sink = out.map(|out| Sink::open(out, reader.head())).transpose()?;
    let mut count = Count::default();
    let outcome = loop {
        match reader.next_entry() {
            Ok(Some(entry)) => {
                count.take(&entry);
                if let Some(sink) = &mut sink {
                    sink.take(&entry)?;
                }
            }
            Ok(None) => break Ok(()),
            // What is whole is written.
            Err(error) => break Err(bad(error)),
        }
    };
    if let Some(sink) = &mut sink {
        sink.finish()?;
    }
    if reader.is_cut() {
        err!("ob1: {}: cut off after byte {}: the rest is no whole block", path.display(), reader.whole_bytes());
    }
    outcome.map(|()| (count, reader.head().signals.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_between_commas() {
        assert_eq!(split("Motor, MW10,\"a, b\",,DB10.level "), ["Motor", "MW10", "\"a, b\"", "DB10.level"]);
        assert_eq!(split(" "), Vec::<String>::new());
    }
}
