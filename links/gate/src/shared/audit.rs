//! Who did what: a line of JSON for each login, write and change, appended to a file of mode 0600.
//!
//! An action that cannot be logged is not carried out. The file is opened before the process confines itself, and is
//! only appended to; log rotation must copy and truncate it (logrotate's `copytruncate`).

use std::fs::{File, OpenOptions};
use std::io::{self, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use ob1_access::audit::line;
use ob1_process::log::Limit;

use crate::shared::clock::unix_now;

/// Longest text of an action, in bytes, so that one line stays one write.
const WHAT: usize = 2000;
/// Longest name of a user or a client, in bytes: strangers choose theirs.
const NAME: usize = 200;
/// Refusals that are logged at once, and the time after which one more may be: clients without rights cannot fill the
/// disk.
const REFUSALS: u32 = 500;
const ONE_MORE: Duration = Duration::from_millis(200);

/// The log of a link. Clones write to the same file.
#[derive(Clone, Debug)]
pub(crate) struct Audit {
    link: Arc<str>,
    file: Option<Arc<Mutex<Out>>>,
    /// How many refusals are logged.
    refusals: Arc<Mutex<Limit>>,
}

#[derive(Debug)]
struct Out {
    file: File,
    /// A line that could not be written yet.
    left: Vec<u8>,
}

impl Audit {
    /// Appends to this file; creates it if necessary.
    ///
    /// # Errors
    /// The system's error.
    pub(crate) fn open(link: &str, path: &Path) -> io::Result<Self> {
        let file = OpenOptions::new().append(true).create(true).mode(0o600).open(path)?;
        let out = Out { file, left: Vec::new() };
        Ok(Self { link: link.into(), file: Some(Arc::new(Mutex::new(out))), refusals: refusals() })
    }

    /// The log of a link that only reads and has no users: nothing is ever written.
    #[must_use]
    pub(crate) fn none(link: &str) -> Self {
        Self { link: link.into(), file: None, refusals: refusals() }
    }

    /// Whether the next line can be written, as far as can be known.
    ///
    /// # Errors
    /// Why the last line could not be written.
    pub(crate) fn ready(&self) -> io::Result<()> {
        let Some(file) = &self.file else { return Err(io::Error::other("there is none")) };
        file.lock().unwrap_or_else(PoisonError::into_inner).flush()
    }

    /// Logs that something was refused. Of very many per second some are only counted; the next line states their
    /// number.
    pub(crate) fn refused(&self, user: &str, client: &str, what: &str, why: &str) {
        let mut refusals = self.refusals.lock().unwrap_or_else(PoisonError::into_inner);
        if !refusals.take(Instant::now()) {
            return;
        }
        let left_out = match refusals.left_out() {
            0 => String::new(),
            count => format!(" ({count} refusals before it are not written)"),
        };
        drop(refusals);
        // A refused action need not be logged: the disk may be full.
        let _ = self.note(user, client, what, &format!("refused: {why}{left_out}"));
    }

    /// Writes a line. A line that cannot be written is kept and retried before the next.
    ///
    /// # Errors
    /// The system's error.
    pub(crate) fn note(&self, user: &str, client: &str, what: &str, outcome: &str) -> io::Result<()> {
        let (user, client, what) = (cut(user, NAME), cut(client, NAME), cut(what, WHAT));
        tracing::info!(link = %self.link, user, client, "{what}: {outcome}");
        let Some(file) = &self.file else { return Ok(()) };
        let line = line(unix_now(), [&*self.link, user, client, what, outcome]);
        let mut out = file.lock().unwrap_or_else(PoisonError::into_inner);
        // While nothing can be written one line is kept: no further action is carried out before it has been written.
        if out.left.len() < 4 * WHAT {
            out.left.extend_from_slice(line.as_bytes());
        }
        let written = out.flush();
        if let Err(error) = &written {
            tracing::error!(link = %self.link, "the audit log cannot be written: {error}; until it can, nothing can be changed");
        }
        written
    }
}

fn refusals() -> Arc<Mutex<Limit>> {
    Arc::new(Mutex::new(Limit::new(REFUSALS, ONE_MORE)))
}

fn cut(text: &str, most: usize) -> &str {
    text.get(..text.floor_char_boundary(most)).unwrap_or(text)
}

impl Out {
    fn flush(&mut self) -> io::Result<()> {
        while !self.left.is_empty() {
            let count = self.file.write(&self.left)?;
            if count == 0 {
                return Err(io::ErrorKind::WriteZero.into());
            }
            self.left.drain(..count);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use std::os::unix::fs::PermissionsExt as _;

    #[test]
    fn a_line_each_whatever_the_text() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.audit");
        let audit = Audit::open("page", &path).expect("a file");
        audit.note("anna", "127.0.0.1", "write \"M1.0\" = 1\n{}", "scan 7").expect("written");
        let long = "ü".repeat(5000);
        audit.note(&long, &long, &long, "refused").expect("written");
        let text = std::fs::read_to_string(&path).expect("a file");
        let lines: Vec<serde_json::Value> =
            text.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
        assert_eq!(lines.len(), 2);
        assert_eq!(
            (&lines[0]["user"], &lines[0]["what"], &lines[0]["outcome"]),
            (&json!("anna"), &json!("write \"M1.0\" = 1\n{}"), &json!("scan 7"))
        );
        for (key, most) in [("what", WHAT), ("user", NAME), ("client", NAME)] {
            assert!(lines[1][key].as_str().is_some_and(|text| text.len() <= most), "{key}");
        }
        assert_eq!(std::fs::metadata(&path).expect("there").permissions().mode() & 0o777, 0o600);
    }

    /// A client without rights that tries all day does not fill the disk, but is still counted.
    #[test]
    fn refusals_without_end_are_counted() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.audit");
        let audit = Audit::open("page", &path).expect("a file");
        (0..2000).for_each(|_| audit.refused("-", "urn:client", "write MW10 = 1", "not allowed"));
        // Some time later.
        audit.refusals.lock().expect("free").take(Instant::now() + 10 * ONE_MORE);
        audit.refused("-", "urn:client", "write MW10 = 1", "not allowed");
        let text = std::fs::read_to_string(&path).expect("a file");
        let lines = text.lines().count();
        assert!((REFUSALS as usize..2000).contains(&lines), "{lines}");
        let counted = text.lines().last().and_then(|line| line.split_once(" refusals before it"));
        let counted = counted.and_then(|(line, _)| line.rsplit_once('(')?.1.parse::<usize>().ok());
        assert!(counted.is_some_and(|count| count > 1000), "{counted:?}");
    }

    /// A full disk: a line that could not be written is kept, and the log is not ready until it has been written.
    #[test]
    fn a_line_that_finds_no_place_is_not_lost() {
        let full = OpenOptions::new().append(true).open("/dev/full").expect("a device");
        let out = Out { file: full, left: Vec::new() };
        let audit = Audit { link: "page".into(), file: Some(Arc::new(Mutex::new(out))), refusals: refusals() };
        assert!(audit.ready().is_ok(), "nobody knows yet");
        assert!(audit.note("anna", "::1", "write MW10 = 1", "scan 7").is_err());
        assert!(audit.ready().is_err());
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.audit");
        let file = OpenOptions::new().append(true).create(true).open(&path).expect("a file");
        audit.file.as_ref().expect("there").lock().expect("free").file = file;
        assert!(audit.ready().is_ok());
        assert!(std::fs::read_to_string(&path).expect("a file").contains("MW10"));
        assert!(Audit::none("figures").ready().is_err(), "without a log nothing is changed");
    }
}
