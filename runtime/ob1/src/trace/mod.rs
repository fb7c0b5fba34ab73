//! `ob1 trace`: what goes over the lines of a running station, or went over them when it was recorded.

mod pcapng;
mod print;
mod recording;
mod s7;
mod source;

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use ob1_protocols::trace::record::Record;

use crate::exit::Exit;
use ob1_station::{files, out};

pub use pcapng::Pcapng;
pub use print::Printer;
pub use recording::{Recorder, RecordingError, read};
pub(crate) use source::Taps;

/// The longest recording that is read, in bytes.
const LONGEST: u64 = 1 << 30;

/// What the command line asks for.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// A running station, by its name or its file; or the first word is missing and `from` is there.
    pub station: Option<String>,
    /// One of its CPs or lines of buses; all of them without.
    pub cp: Option<String>,
    /// A recording to read instead.
    pub from: Option<PathBuf>,
    /// Where to record.
    pub record: Option<PathBuf>,
    /// Where to write frames for Wireshark.
    pub pcapng: Option<PathBuf>,
    /// Print the characters as they were on the line instead of the user data.
    pub raw: bool,
    /// Print nothing.
    pub quiet: bool,
    /// End after this time.
    pub time: Option<Duration>,
}

/// Why a trace ended badly.
#[derive(Debug, thiserror::Error)]
pub enum TraceError {
    /// The station does not run, or has no such CP.
    #[error("{0}")]
    Nobody(String),
    /// The recording cannot be understood.
    #[error("{}: {error}", .path.display())]
    Recording {
        /// Which.
        path: PathBuf,
        /// Why.
        error: RecordingError,
    },
    /// A file would be overwritten by what is made of it, or by something else.
    #[error("{} is named twice: give each option a file of its own", .0.display())]
    Twice(PathBuf),
    /// A file cannot be read or written.
    #[error("{}: {error}", .path.display())]
    File {
        /// Which.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// Waiting or printing failed.
    #[error("{0}")]
    Io(#[from] io::Error),
}

/// Traces until its end.
#[must_use]
pub fn trace(options: &Options) -> Exit {
    match run(options) {
        Ok(()) => Exit::Ok,
        Err(error) => {
            err!("ob1: {error}");
            match error {
                TraceError::Nobody(_) => Exit::Running,
                TraceError::Twice(_) => Exit::Usage,
                TraceError::Recording { .. } => Exit::Rejected,
                TraceError::File { .. } | TraceError::Io(_) => Exit::System,
            }
        }
    }
}

/// Where records go: to standard output, to a recording, to Wireshark.
struct Sinks {
    printer: Printer,
    recorder: Option<Recorder<File>>,
    pcapng: Option<Pcapng<File>>,
    quiet: bool,
}

impl Sinks {
    fn open(options: &Options) -> Result<Self, TraceError> {
        let create =
            |path: &PathBuf| File::create(path).map_err(|error| TraceError::File { path: path.clone(), error });
        let recorder = options.record.as_ref().map(|path| Ok::<_, TraceError>(Recorder::new(create(path)?)?));
        let pcapng = options.pcapng.as_ref().map(|path| Ok::<_, TraceError>(Pcapng::new(create(path)?)?));
        Ok(Self {
            printer: Printer::new(options.raw),
            recorder: recorder.transpose()?,
            pcapng: pcapng.transpose()?,
            quiet: options.quiet,
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

fn run(options: &Options) -> Result<(), TraceError> {
    let named = [&options.from, &options.record, &options.pcapng].map(Option::as_ref);
    let pairs = [(named[0], named[2]), (named[1], named[2])];
    if let Some(path) = pairs.into_iter().find_map(|(one, other)| one.filter(|one| other.is_some_and(|o| same(one, o))))
    {
        return Err(TraceError::Twice(path.clone()));
    }
    let read_whole =
        |path: &PathBuf| files::read(path, LONGEST).map_err(|error| TraceError::File { path: path.clone(), error });
    // Before a file is begun.
    let recording = options.from.as_ref().map(|path| read_whole(path).map(|bytes| (path, bytes))).transpose()?;
    let mut sinks = Sinks::open(options)?;
    match (&recording, &options.station) {
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
        (None, Some(station)) => source::live(station, options, &mut sinks)?,
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
