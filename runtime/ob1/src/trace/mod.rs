//! `ob1 trace`: what goes over the lines of a running station, or went over them when it was recorded.

mod pcapng;
mod print;
mod recording;
mod s7;
mod source;

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use clap::Args;
use ob1_serial::tap_record::Record;
use ob1_time::Span;

use crate::exit::{Exit, told};
use ob1_station::access::client::AccessError;
use ob1_station::out;

pub use pcapng::Pcapng;
pub use print::Printer;
pub use recording::{Recorder, RecordingError, read};
pub(crate) use s7::Link;
pub(crate) use source::{News, Taps};

/// The longest recording that is read, in bytes.
const LONGEST: u64 = 1 << 30;

/// Show what goes over the lines of a running station, or of a recording
///
/// Each telegram and each control character with its time (seconds since the driver's start), its direction (> from the
/// CP, < to it), its meaning and its user data. Listening does not slow the CP down: what is not fetched in time is
/// lost, and counted.
#[derive(Debug, Default, Args)]
#[command(
    after_help = "Examples:\n  ob1 trace press.toml\n  ob1 trace press.toml scale --raw\n  ob1 trace press --record line.trace --quiet --for 10min\n  \
    ob1 trace --from line.trace\n  ob1 trace --from line.trace --pcapng line.pcapng       Modbus RTU, for Wireshark (docs/trace.md)\n\n\
    Exit codes: 0 ended, 1 no such CP, link or bus, 2 no station file or recording, 5 the station does not run,\n\
    6 a file cannot be read or written, 8 the station does not answer."
)]
pub struct TraceArgs {
    /// A running station: its name or its file
    #[arg(required_unless_present = "from", conflicts_with = "from")]
    pub station: Option<String>,
    /// One of its CPs or S7 links, or the line of a bus (field.bus); without it all of them
    pub cp: Option<String>,
    /// Read a recording instead of a running station
    #[arg(long, value_name = "FILE", conflicts_with = "record")]
    pub from: Option<PathBuf>,
    /// Record into this file
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    /// Write the frames of Modbus RTU and the telegrams of S7 links into this file
    #[arg(long, value_name = "FILE")]
    pub pcapng: Option<PathBuf>,
    /// Show the characters as they were on the line instead of the user data
    #[arg(long)]
    pub raw: bool,
    /// Print nothing
    #[arg(long, short)]
    pub quiet: bool,
    /// End after this time: 10s, 8h
    #[arg(long = "for", value_name = "TIME", value_parser = ob1_station_file::parse_duration)]
    pub time: Option<Span>,
}

/// Why a trace ended badly.
#[derive(Debug, thiserror::Error)]
pub enum TraceError {
    /// The station does not run, or refuses.
    #[error(transparent)]
    Access(#[from] AccessError),
    /// The station has just ended.
    #[error("{0}")]
    Nobody(String),
    /// The station runs, and has no such CP.
    #[error("{0}")]
    NoLine(String),
    /// The recording cannot be understood.
    #[error("{}: {error}", .path.display())]
    Recording {
        /// Path of the recording.
        path: PathBuf,
        /// What is wrong with it.
        error: RecordingError,
    },
    /// A file would be overwritten by what is made of it, or by something else.
    #[error("{} is named twice: give each option a file of its own", .0.display())]
    Twice(PathBuf),
    /// A file cannot be read or written.
    #[error("{}: {error}", .path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// What the system says.
        error: io::Error,
    },
    /// Waiting or printing failed.
    #[error("{0}")]
    Io(#[from] io::Error),
}

/// Traces until its end.
pub fn trace(args: &TraceArgs) -> Exit {
    told(run(args).map(|()| Exit::Ok), |error| match error {
        TraceError::Access(error) => error.exit(),
        TraceError::Nobody(_) => Exit::Running,
        TraceError::Twice(_) | TraceError::NoLine(_) => Exit::Usage,
        TraceError::Recording { .. } => Exit::Rejected,
        TraceError::File { .. } | TraceError::Io(_) => Exit::System,
    })
}

/// Where records go: to standard output, to a recording, to Wireshark.
struct Sinks {
    printer: Printer,
    recorder: Option<Recorder<File>>,
    pcapng: Option<Pcapng<File>>,
    quiet: bool,
}

impl Sinks {
    fn open(args: &TraceArgs) -> Result<Self, TraceError> {
        let create =
            |path: &PathBuf| File::create(path).map_err(|error| TraceError::File { path: path.clone(), error });
        let recorder = args.record.as_ref().map(|path| Ok::<_, TraceError>(Recorder::new(create(path)?)?));
        let pcapng = args.pcapng.as_ref().map(|path| Ok::<_, TraceError>(Pcapng::new(create(path)?)?));
        Ok(Self {
            printer: Printer::new(args.raw),
            recorder: recorder.transpose()?,
            pcapng: pcapng.transpose()?,
            quiet: args.quiet,
        })
    }

    /// Nothing takes this trace any more.
    fn is_over(&self) -> bool {
        out::is_over() && self.recorder.is_none() && self.pcapng.is_none()
    }

    fn take(&mut self, cp: u8, record: &Record<'_>) -> io::Result<()> {
        if let Some(recorder) = &mut self.recorder {
            recorder.write(cp, record)?;
        }
        if let Some(pcapng) = &mut self.pcapng {
            pcapng.take(cp, record)?;
        }
        self.printer.take(cp, record);
        self.show();
        Ok(())
    }

    fn show(&mut self) {
        let text = self.printer.text();
        if !self.quiet && !text.is_empty() {
            says!("{text}");
            out::flush();
        }
    }

    fn finish(&mut self) -> io::Result<()> {
        if let Some(pcapng) = &mut self.pcapng {
            pcapng.finish()?;
        }
        self.printer.finish();
        self.show();
        Ok(())
    }
}

/// Whether two paths lead to one file.
fn same(one: &Path, other: &Path) -> bool {
    one == other || one.canonicalize().is_ok_and(|one| other.canonicalize().is_ok_and(|other| one == other))
}

fn run(args: &TraceArgs) -> Result<(), TraceError> {
    let named = [&args.from, &args.record, &args.pcapng].map(Option::as_ref);
    let pairs = [(named[0], named[2]), (named[1], named[2])];
    if let Some(path) = pairs.into_iter().find_map(|(one, other)| one.filter(|one| other.is_some_and(|o| same(one, o))))
    {
        return Err(TraceError::Twice(path.clone()));
    }
    let read_whole = |path: &PathBuf| {
        ob1_process::files::read(path, LONGEST).map_err(|error| TraceError::File { path: path.clone(), error })
    };
    // Before a file is begun.
    let recording = args.from.as_ref().map(|path| read_whole(path).map(|bytes| (path, bytes))).transpose()?;
    let mut sinks = Sinks::open(args)?;
    match (&recording, &args.station) {
        (Some((path, bytes)), _) => {
            let refused = |error| TraceError::Recording { path: (*path).clone(), error };
            for entry in read(bytes).map_err(refused)? {
                let Ok((cp, record)) = entry else {
                    // What is whole is shown, what was still open too.
                    sinks.finish()?;
                    return entry.map(drop).map_err(refused);
                };
                sinks.take(cp, &record)?;
                if sinks.is_over() {
                    return Ok(());
                }
            }
        }
        (None, Some(station)) => source::live(station, args, &mut sinks)?,
        (None, None) => return Err(TraceError::Nobody("name a running station, or a recording with --from".into())),
    }
    sinks.finish()?;
    if let Some(pcapng) = &sinks.pcapng
        && pcapng.frames() == 0
    {
        err!(
            "ob1: no frame of Modbus RTU and no telegram of S7: nothing in this trace that Wireshark can read (it has no link type for PROFIBUS)"
        );
    }
    Ok(())
}
