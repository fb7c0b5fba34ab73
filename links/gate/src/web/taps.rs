//! What goes over the lines of the CPs, live: each driver has a tap, a socket in the folder of the running station.

use std::io;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::time::Duration;

use ob1_access::door::Document;
use ob1_protocols::trace::record::{Kind, Record};
use rustix::io::Errno;
use rustix::net::{AddressFamily, RecvFlags, SocketAddrUnix, SocketFlags, SocketType, connect, recv, socket_with};
use serde_json::{Value, json};
use tokio::io::unix::AsyncFd;
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::sleep;

use super::Page;

/// Longest record a driver sends.
const RECORD: usize = 8192;
/// A driver that is gone is looked for again.
const AGAIN: Duration = Duration::from_secs(1);
/// Records that wait for the page; what comes meanwhile stays with the driver, which counts what it drops.
const WAITING: usize = 64;

/// All taps of a station. Dropping it lets go of them.
pub(super) struct Taps {
    heard: mpsc::Receiver<Value>,
    _tasks: JoinSet<()>,
}

/// The taps, where this link may show them.
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

/// The CPs.
async fn names(page: &Page) -> Vec<String> {
    let text = page.station.document(Document::Status, AGAIN).await;
    let status: Value = text.ok().and_then(|text| serde_json::from_slice(&text).ok()).unwrap_or_default();
    let modules = status["modules"].as_array().map(Vec::as_slice).unwrap_or_default();
    let cps = modules.iter().filter(|module| !module["driver"].is_null());
    cps.filter_map(|module| module["name"].as_str().map(str::to_owned)).collect()
}

/// The next thing that is heard.
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
        // Whoever listened is gone when nothing can be sent any more.
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

/// Until the driver ends (`Some`), or nobody listens any more.
async fn hear(tap: &AsyncFd<OwnedFd>, cp: &str, to: &mpsc::Sender<Value>) -> Option<()> {
    let mut buffer = vec![0; RECORD];
    let mut unix = 0;
    loop {
        match recv(tap.get_ref(), buffer.as_mut_slice(), RecvFlags::DONTWAIT) {
            Ok((0, _)) | Err(Errno::CONNRESET) => return Some(()),
            Ok((length, _)) => {
                // A newer driver may have kinds nobody here knows.
                let Some(record) = Record::read(buffer.get(..length).unwrap_or_default()) else { continue };
                if let Some(told) = told(&record, cp, &mut unix) {
                    to.send(told).await.ok()?;
                }
            }
            Err(Errno::AGAIN | Errno::INTR) => match tap.readable().await {
                Ok(mut ready) => ready.clear_ready(),
                Err(_) => return Some(()),
            },
            Err(_) => return Some(()),
        }
    }
}

/// A record for the page. `unix` is the time of 1970 at the driver's 0, in nanoseconds.
fn told(record: &Record<'_>, cp: &str, unix: &mut u64) -> Option<Value> {
    let ms = unix.saturating_add(record.time) / 1_000_000;
    let text = || String::from_utf8_lossy(record.data).into_owned();
    let hex = || record.data.iter().map(|byte| format!("{byte:02X}")).collect::<String>();
    Some(match record.kind {
        Kind::Hello => {
            let hello: Value = serde_json::from_slice(record.data).ok()?;
            *unix = hello["unix_ns"].as_u64().unwrap_or(0);
            return None;
        }
        Kind::Out => json!({ "cp": cp, "ms": ms, "way": "out", "hex": hex() }),
        Kind::In => json!({ "cp": cp, "ms": ms, "way": "in", "hex": hex() }),
        Kind::Fault => json!({ "cp": cp, "ms": ms, "way": "fault", "text": hex() }),
        Kind::Gone | Kind::Note => json!({ "cp": cp, "ms": ms, "way": "note", "text": text() }),
        Kind::Up => json!({ "cp": cp, "ms": ms, "way": "note", "text": "up" }),
        Kind::Lost => json!({ "cp": cp, "ms": ms, "way": "lost", "text": "" }),
        Kind::Done | Kind::Modem | Kind::TakenBack => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_have_the_time_of_the_wall() {
        let mut unix = 0;
        let record = |kind, data| Record { time: 5_000_000, kind, data };
        assert_eq!(told(&record(Kind::Hello, br#"{"unix_ns":1000000000}"#), "cp", &mut unix), None);
        let out = told(&record(Kind::Out, &[2, 0x41]), "cp", &mut unix);
        assert_eq!(out, Some(json!({ "cp": "cp", "ms": 1005, "way": "out", "hex": "0241" })));
        assert_eq!(told(&record(Kind::Hello, b"{"), "cp", &mut unix), None);
        assert_eq!(told(&record(Kind::Done, &[]), "cp", &mut unix), None);
    }
}
