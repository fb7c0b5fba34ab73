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

use crate::clock::unix_now;

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
pub struct Audit {
    link: Arc<str>,
    file: Option<Arc<Mutex<Out>>>,
    refusals: Arc<Mutex<Refusals>>,
}

/// How many refusals may still be logged.
#[derive(Debug)]
struct Refusals {
    free: u32,
    since: Option<Instant>,
    /// Number of refusals not logged.
    left_out: u64,
}

impl Default for Refusals {
    fn default() -> Self {
        Self { free: REFUSALS, since: None, left_out: 0 }
    }
}

impl Refusals {
    /// Whether one more is logged; returns how many before it were not.
    fn take(&mut self, now: Instant) -> Option<u64> {
        let since = *self.since.get_or_insert(now);
        let more = now.saturating_duration_since(since).as_millis() / ONE_MORE.as_millis();
        if more > 0 {
            self.free = self.free.saturating_add(u32::try_from(more).unwrap_or(u32::MAX)).min(REFUSALS);
            self.since = Some(now);
        }
        match self.free.checked_sub(1) {
            Some(free) => {
                self.free = free;
                Some(std::mem::take(&mut self.left_out))
            }
            None => {
                self.left_out += 1;
                None
            }
        }
    }
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
    pub fn open(link: &str, path: &Path) -> io::Result<Self> {
        let file = OpenOptions::new().append(true).create(true).mode(0o600).open(path)?;
        let out = Out { file, left: Vec::new() };
        Ok(Self { link: link.into(), file: Some(Arc::new(Mutex::new(out))), refusals: Arc::default() })
    }

    /// The log of a link that only reads and has no users: nothing is ever written.
    #[must_use]
    pub fn none(link: &str) -> Self {
        Self { link: link.into(), file: None, refusals: Arc::default() }
    }

    /// Whether the next line can be written, as far as can be known.
    ///
    /// # Errors
    /// Why the last line could not be written.
    pub fn ready(&self) -> io::Result<()> {
        let Some(file) = &self.file else { return Err(io::Error::other("there is none")) };
        file.lock().unwrap_or_else(PoisonError::into_inner).flush()
    }

    /// Logs that something was refused. Of very many per second some are only counted; the next line states their
    /// number.
    pub fn refused(&self, user: &str, client: &str, what: &str, why: &str) {
        let left_out = self.refusals.lock().unwrap_or_else(PoisonError::into_inner).take(Instant::now());
        // A refused action need not be logged: the disk may be full.
        let _ = match left_out {
            None => Ok(()),
            Some(0) => self.note(user, client, what, &format!("refused: {why}")),
            Some(count) => {
                self.note(user, client, what, &format!("refused: {why} ({count} refusals before it are not written)"))
            }
        };
    }

    /// Writes a line. A line that cannot be written is kept and retried before the next.
    ///
    /// # Errors
    /// The system's error.
    pub fn note(&self, user: &str, client: &str, what: &str, outcome: &str) -> io::Result<()> {
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
        let mut refusals = Refusals::default();
        let begin = Instant::now();
        let written = (0..10_000).filter(|_| refusals.take(begin).is_some()).count();
        assert_eq!(written, REFUSALS as usize);
        assert_eq!(refusals.take(begin + ONE_MORE / 2), None);
        assert_eq!(refusals.take(begin + ONE_MORE), Some(10_000 - u64::from(REFUSALS) + 1));
        assert_eq!(refusals.take(begin + ONE_MORE), None);
        assert_eq!(refusals.take(begin + ONE_MORE * 1_000_000), Some(1));
        assert_eq!(refusals.free, REFUSALS - 1, "no more than at first");
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.audit");
        let audit = Audit::open("page", &path).expect("a file");
        (0..2000).for_each(|_| audit.refused("-", "urn:client", "write MW10 = 1", "not allowed"));
        let lines = std::fs::read_to_string(&path).expect("a file").lines().count();
        assert!((REFUSALS as usize..2000).contains(&lines), "{lines}");
    }

    /// A full disk: a line that could not be written is kept, and the log is not ready until it has been written.
    #[test]
    fn a_line_that_finds_no_place_is_not_lost() {
        let full = OpenOptions::new().append(true).open("/dev/full").expect("a device");
        let out = Out { file: full, left: Vec::new() };
        let audit = Audit { link: "page".into(), file: Some(Arc::new(Mutex::new(out))), refusals: Arc::default() };
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
