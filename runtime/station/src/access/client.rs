//! The other end of the socket: what `get`, `set`, `ctl` and `run` itself use.

use std::io::{self, BufRead as _, BufReader, Write as _};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::Value;

use super::protocol::{Op, Request, Response};
use crate::exit::Exit;
use crate::rundir;

/// How long a station may take to answer. Its socket thread answers even if the CPU hangs; this is for a process that
/// was stopped.
const ANSWER_TIME: Duration = Duration::from_secs(60);

/// Why a station gave no answer.
#[derive(Debug, thiserror::Error)]
pub enum AccessError {
    /// It does not run.
    #[error(
        "the station \"{name}\" does not run (no socket in {})\n  = start it with `ob1 run`, and name it by its station \
         file or its name; one that runs as another user (a service: ob1) answers that user: sudo -u USER ob1 ...",
        .searched.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(", ")
    )]
    NotRunning {
        /// Name of the station.
        name: String,
        /// Where its directory could be.
        searched: Vec<PathBuf>,
    },
    /// What should be its file does not say its name.
    #[error(
        "{}: {why}\n  = name a station by its station file, such as press/station.toml, or by its name, such as press",
        .file.display()
    )]
    NoName {
        /// The file that was named.
        file: PathBuf,
        /// What is wrong with it.
        why: String,
    },
    /// It is there, and has not answered in time.
    #[error(
        "the station did not answer within {} s: its process is stopped (SIGSTOP, a debugger) or gets no time\n  = \
         look at it with `ps`, and let it go on: kill -CONT PID",
        ANSWER_TIME.as_secs()
    )]
    Silent,
    /// The connection broke, or its answer is not one.
    #[error("the station does not answer: {0}")]
    Io(#[source] io::Error),
    /// The station refused, for this reason.
    #[error("{0}")]
    Refused(String),
}

/// A connection to a running station.
#[derive(Debug)]
pub struct Client {
    reader: BufReader<UnixStream>,
}

impl Client {
    /// Connects to a station by its name or its station file.
    ///
    /// # Errors
    /// [`AccessError::NoName`]: the file does not say its name; [`AccessError::NotRunning`]: nobody answers there.
    pub fn to_station(station: &str) -> Result<Self, AccessError> {
        let name = name_of(station)?;
        let not_running = || AccessError::NotRunning { name: name.clone(), searched: rundir::bases() };
        let dir = rundir::find(&name).ok_or_else(not_running)?;
        Self::to_socket(&dir.join(rundir::SOCKET)).map_err(|_| not_running())
    }

    /// Connects to a socket.
    ///
    /// # Errors
    /// Nobody listens there (`NotFound`, `ConnectionRefused`), or it is another user's.
    pub fn to_socket(socket: &Path) -> io::Result<Self> {
        let stream = UnixStream::connect(socket)?;
        stream.set_read_timeout(Some(ANSWER_TIME))?;
        stream.set_write_timeout(Some(ANSWER_TIME))?;
        Ok(Self { reader: BufReader::new(stream) })
    }

    /// Asks and waits for the answer.
    ///
    /// # Errors
    /// [`AccessError::Refused`] with the station's words, or what broke the connection.
    pub fn ask(&mut self, op: Op) -> Result<Response, AccessError> {
        let mut line = serde_json::to_vec(&Request { id: Value::Null, op }).map_err(io::Error::from)?;
        line.push(b'\n');
        self.reader.get_mut().write_all(&line)?;
        let mut answer = String::new();
        if self.reader.read_line(&mut answer)? == 0 {
            return Err(io::Error::from(io::ErrorKind::UnexpectedEof).into());
        }
        let response: Response = serde_json::from_str(&answer).map_err(io::Error::from)?;
        match response.error {
            Some(error) if !response.ok => Err(AccessError::Refused(error)),
            _ => Ok(response),
        }
    }
}

impl From<io::Error> for AccessError {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            // What a time limit of a socket ends with.
            io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut => Self::Silent,
            _ => Self::Io(error),
        }
    }
}

impl AccessError {
    /// The exit code of a command that ends with this error.
    #[must_use]
    pub const fn exit(&self) -> Exit {
        match self {
            Self::NotRunning { .. } => Exit::Running,
            Self::NoName { .. } => Exit::Rejected,
            Self::Silent | Self::Io(_) | Self::Refused(_) => Exit::Refused,
        }
    }
}

/// The name in a station file, or the argument itself when it is a name.
fn name_of(station: &str) -> Result<String, AccessError> {
    // No name has a slash or a dot.
    if !station.contains(['/', '.']) {
        return Ok(station.to_owned());
    }
    let path = Path::new(station);
    match ob1_station_file::load(path) {
        Ok(station) => Ok(station.name),
        // A file that has changed under a running station: its name is enough.
        Err(_) => name_in(path).map_err(|why| AccessError::NoName { file: path.to_owned(), why }),
    }
}

fn name_in(path: &Path) -> Result<String, String> {
    let text =
        ob1_process::files::read_text(path).map_err(|error| format!("the station file cannot be read: {error}"))?;
    let table = text.parse::<toml::Table>().ok();
    let name = table.and_then(|table| Some(table.get("station")?.get("name")?.as_str()?.to_owned()));
    name.ok_or_else(|| "this is not a station file: it has no name in [station]".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A station that is there and says nothing is told from one that is gone.
    #[test]
    fn a_station_that_is_silent_is_told_as_such() {
        let folder = tempfile::tempdir().expect("a directory");
        let socket = folder.path().join("socket");
        let listener = std::os::unix::net::UnixListener::bind(&socket).expect("a socket");
        let mut client = Client::to_socket(&socket).expect("it waits to be accepted");
        client.reader.get_ref().set_read_timeout(Some(Duration::from_millis(1))).expect("a time");
        let silent = client.ask(Op::Status).expect_err("nobody answers");
        assert!(matches!(silent, AccessError::Silent) && silent.exit() == Exit::Refused, "{silent:?}");
        assert!(silent.to_string().starts_with("the station did not answer within 60 s: "), "{silent}");
        drop(listener);
        assert!(matches!(client.ask(Op::Status), Err(AccessError::Io(_))));
    }

    #[test]
    fn a_station_has_its_name_or_that_of_its_file() {
        let folder = tempfile::tempdir().expect("a directory");
        let path = folder.path().join("s.toml");
        let file = path.display().to_string();
        assert_eq!(name_of("press-3").expect("a name"), "press-3");
        // One key is wrong: the name is there.
        std::fs::write(&path, "[station]\nname = \"press\"\n[cpu]\nmin_cyle = \"1ms\"\n").expect("writable");
        assert_eq!(name_of(&file).expect("a name"), "press");
        std::fs::write(&path, "").expect("writable");
        let nothing = name_of(&file).expect_err("no name").to_string();
        assert!(nothing.starts_with(&format!("{file}: this is not a station file")), "{nothing}");
        for (wrong, why) in
            [(".", "Is a directory"), ("there-is-no.toml", "No such file"), ("../no.awl", "No such file")]
        {
            let said = name_of(wrong).expect_err("no name").to_string();
            assert!(said.starts_with(&format!("{wrong}: the station file cannot be read: {why}")), "{said}");
        }
    }
}
