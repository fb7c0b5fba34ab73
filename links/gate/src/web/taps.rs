//! Live traffic on the lines of the CPs: each driver has a tap, a socket in the folder of the running station. Its
//! records are read with the protocol of its CP, as by `ob1 trace`.

use std::io;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::time::{self, Duration};

use ob1_access::door::Document;
use ob1_protocols::Instant;
use ob1_protocols::trace::{Unit, Way};
use ob1_serial::tap_record::{Kind, Record};
use ob1_trace::{Cp, remark, shown};
use rustix::io::Errno;
use rustix::net::{AddressFamily, RecvFlags, SocketAddrUnix, SocketFlags, SocketType, connect, recv, socket_with};
use serde_json::{Value, json};
use tokio::io::unix::AsyncFd;
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};

use super::Page;

/// Longest record a driver sends.
const RECORD: usize = 8192;
/// Time to the next attempt to find a driver that is gone.
const AGAIN: Duration = Duration::from_secs(1);
/// Records that may wait for the page; beyond that they stay with the driver, which counts those it drops.
const WAITING: usize = 64;
/// After this long without records the reader checks for pauses that end telegrams.
const QUIET: Duration = Duration::from_millis(200);

/// All taps of a station. Dropping it closes them.
pub(super) struct Taps {
    heard: mpsc::Receiver<Value>,
    _tasks: JoinSet<()>,
}

/// The taps, if this link may show them.
pub(super) async fn open(page: &Page) -> Option<Taps> {
    let (to, heard) = mpsc::channel(WAITING);
    let mut tasks = JoinSet::new();
    let names = names(page).await;
    for (folder, name) in page.taps.iter().flat_map(|folder| names.iter().map(move |name| (folder, name))) {
        tasks.spawn_local(listen(folder.join(format!("{name}.trace")), name.clone(), to.clone()));
    }
    if tasks.is_empty() {
        let _ = to.send(json!({ "none": true })).await;
    }
    Some(Taps { heard, _tasks: tasks })
}

/// The names of the CPs.
async fn names(page: &Page) -> Vec<String> {
    let text = page.station.document(Document::Status, AGAIN).await;
    let status: Value = text.ok().and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or_default();
    let modules = status["modules"].as_array().map(Vec::as_slice).unwrap_or_default();
    let cps = modules.iter().filter(|module| !module["driver"].is_null());
    cps.filter_map(|module| module["name"].as_str().map(str::to_owned)).collect()
}

/// The next record.
pub(super) async fn next(taps: &mut Option<Taps>) -> Value {
    match taps {
        Some(taps) => match taps.heard.recv().await {
            Some(heard) => heard,
            None => std::future::pending().await,
        },
        None => std::future::pending().await,
    }
}

async fn listen(path: PathBuf, cp: String, to: mpsc::Sender<Value>) {
    loop {
        // If nothing can be sent any more, the listener is gone.
        if let Ok(tap) = tap(&path)
            && hear(&tap, &cp, &to).await.is_none()
        {
            return;
        }
        sleep(AGAIN).await;
    }
}

#[expect(deprecated, reason = "what replaces it is unsafe; an `OwnedFd` stays open as long as it is owned")]
fn tap(path: &Path) -> io::Result<AsyncFd<OwnedFd>> {
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let fd = socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?;
    connect(&fd, &SocketAddrUnix::new(path)?)?;
    AsyncFd::new(fd)
}

/// Runs until the driver ends (`Some`) or nobody listens any more.
async fn hear(tap: &AsyncFd<OwnedFd>, cp: &str, to: &mpsc::Sender<Value>) -> Option<()> {
    let mut buffer = vec![0; RECORD];
    let mut line = Line::new(cp);
    loop {
        match recv(tap.get_ref(), buffer.as_mut_slice(), RecvFlags::DONTWAIT) {
            Ok((0, _)) | Err(Errno::CONNRESET) => return Some(()),
            Ok((length, _)) => {
                // A newer driver may send unknown kinds.
                let Some(record) = Record::read(buffer.get(..length).unwrap_or_default()) else { continue };
                line.take(&record);
            }
            Err(Errno::AGAIN | Errno::INTR) => match timeout(QUIET, tap.readable()).await {
                Ok(Ok(mut ready)) => ready.clear_ready(),
                Ok(Err(_)) => return Some(()),
                Err(_) => line.quiet(),
            },
            Err(_) => return Some(()),
        }
        for told in line.told.drain(..) {
            to.send(told).await.ok()?;
        }
    }
}

/// The line of a CP as reported by its driver.
struct Line {
    name: String,
    /// `None` before the first hello record.
    cp: Option<Cp>,
    /// The driver's time at its last record, and when it came.
    last: (Instant, time::Instant),
    /// Messages for the page.
    told: Vec<Value>,
}

impl Line {
    fn new(name: &str) -> Self {
        Self { name: name.to_owned(), cp: None, last: (Instant::START, time::Instant::now()), told: Vec::new() }
    }

    fn take(&mut self, record: &Record<'_>) {
        self.last = (record.time, time::Instant::now());
        if record.kind == Kind::Hello {
            // Unfinished units end with the parameters they were sent with.
            self.read(|cp, out| cp.reader.finish(out));
            let unknown = self.cp.is_none();
            match Cp::of_hello(record.data) {
                Some((cp, about)) => {
                    self.cp = Some(cp);
                    if !unknown {
                        self.note(record.time, &about);
                    }
                }
                None => self.note(record.time, "a CP with invalid parameters"),
            }
            return;
        }
        self.read(|cp, out| cp.read(record, out));
        if let Some(words) = remark(record) {
            self.note(record.time, &words);
        }
    }

    /// Nothing has come for a while.
    fn quiet(&mut self) {
        let now = self.last.0.saturating_add(self.last.1.elapsed().into());
        self.read(|cp, out| cp.reader.silence(now, out));
    }

    fn read(&mut self, work: impl FnOnce(&mut Cp, &mut dyn FnMut(Unit<'_>))) {
        let Self { name, cp: Some(cp), told, .. } = self else { return };
        let unix = cp.unix;
        work(cp, &mut |unit| {
            let way = if unit.way == Way::Out { "out" } else { "in" };
            let hex: String =
                shown(&unit, false).unwrap_or_default().iter().map(|byte| format!("{byte:02X}")).collect();
            let ms = unix.saturating_add(unit.begin.nanos()) / 1_000_000;
            told.push(json!({ "cp": name, "ms": ms, "way": way, "what": unit.meaning.to_string(), "hex": hex }));
        });
    }

    fn note(&mut self, time: Instant, what: &str) {
        let ms = self.cp.as_ref().map_or(0, |cp| cp.unix).saturating_add(time.nanos()) / 1_000_000;
        self.told.push(json!({ "cp": self.name, "ms": ms, "way": "note", "what": what, "hex": "" }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn telegrams_are_read_by_the_protocol_and_have_the_time_of_the_wall() {
        let mut line = Line::new("cp");
        let record = |kind, data| Record { time: Instant::from_millis(5), kind, data };
        line.take(&record(Kind::Out, &[2, 0x41]));
        assert!(line.told.is_empty(), "nobody knows yet what is spoken");
        let hello =
            format!("{{\"name\":\"cp\",\"module\":\"cp240\",\"parameters\":{:?},\"unix_ns\":1000000000}}", [0; 16]);
        line.take(&record(Kind::Hello, hello.as_bytes()));
        line.take(&record(Kind::Out, &[2, 0x41]));
        line.take(&record(Kind::Gone, b"unplugged"));
        let told = std::mem::take(&mut line.told);
        assert_eq!(told.len(), 2, "{told:?}");
        assert_eq!((&told[0]["ms"], &told[0]["way"], &told[0]["hex"]), (&json!(1005), &json!("out"), &json!("0241")));
        assert_eq!(told[0]["what"], "telegram, 2 bytes");
        assert_eq!(told[1]["what"], "the line is gone: unplugged");
        line.take(&record(Kind::Hello, b"{"));
        assert_eq!(line.told[0]["what"], "a CP with invalid parameters");
        line.take(&record(Kind::Done, &[]));
    }
}
