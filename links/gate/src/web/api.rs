//! Requests of the page: login, figures, the cause of a STOP, writes, changes of mode.

use std::fs::OpenOptions;
use std::io::Read as _;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::time::Duration;

use crate::shared::{Client, LoginError, Source, Trouble, Who};
use hyper::StatusCode;
use hyper::body::Bytes;
use hyper::header::{HeaderMap, HeaderValue, SET_COOKIE};
use ob1_access::door::{Answer, Ask, Command, Diagnosis, Document};
use ob1_access::{Right, last_stop};
use ob1_model::{Event, StateChange};
use rustix::fs::OFlags;
use serde::Deserialize;
use serde_json::{Value, json};

use super::Page;
use super::sessions::{self, HOST};
use crate::http::{Call, Reply, plain, query, reply};

/// Within this time concurrent requests share one document.
pub(super) const AGE: Duration = Duration::from_millis(800);
/// How long a browser is known after a login, in seconds.
const KNOWN: u32 = 180 * 24 * 3600;
/// Entries of the diagnostic buffer that are shown.
const ENTRIES: u16 = 100;
/// Longest report shown, in bytes, and the maximum number of reports.
const REPORT: u64 = 1 << 20;
const REPORTS: usize = 200;

pub(super) fn send(value: &Value) -> Reply {
    reply(StatusCode::OK, "application/json", value.to_string())
}

/// An error as text.
pub(super) fn trouble(trouble: &Trouble) -> Reply {
    let status = match trouble {
        Trouble::User => StatusCode::FORBIDDEN,
        Trouble::Gone => StatusCode::SERVICE_UNAVAILABLE,
        Trouble::Refused { why: ob1_access::door::Refusal::Right, .. } => StatusCode::FORBIDDEN,
        _ => StatusCode::CONFLICT,
    };
    plain(status, trouble.to_string())
}

fn right_name(right: Right) -> &'static str {
    match right {
        Right::Read => "read",
        Right::Write => "write",
        Right::Operate => "operate",
    }
}

#[derive(Deserialize)]
struct Login {
    user: String,
    password: String,
}

#[derive(Deserialize)]
struct Write {
    item: String,
    value: Value,
}

#[derive(Deserialize)]
struct Wanted {
    command: String,
}

pub(super) fn body<'b, T: Deserialize<'b>>(headers: Option<&HeaderMap>, bytes: &'b Bytes) -> Option<T> {
    // A form of another site cannot send this type.
    let json = headers.is_none_or(|headers| {
        headers.get("content-type").is_some_and(|kind| kind.as_bytes().starts_with(b"application/json"))
    });
    if json { serde_json::from_slice(bytes).ok() } else { None }
}

/// Adds a cookie for this very host; `age` in seconds, without it until the browser ends.
fn add_cookie(reply: &mut Reply, name: &str, tls: bool, value: &str, age: Option<u32>) {
    let (prefix, secure) = if tls { (HOST, "; Secure") } else { ("", "") };
    let age = age.map_or_else(String::new, |age| format!("; Max-Age={age}"));
    let cookie = format!("{prefix}{name}={value}; Path=/; HttpOnly; SameSite=Strict{secure}{age}");
    if let Ok(cookie) = HeaderValue::from_str(&cookie) {
        reply.headers_mut().append(SET_COOKIE, cookie);
    }
}

pub(super) fn wrong() -> Reply {
    plain(StatusCode::BAD_REQUEST, "this is not a valid request")
}

impl Page {
    pub(super) fn session(&self, call: &Call) -> Reply {
        let welcome = self.station.welcome();
        let client = self.client(call);
        send(&json!({
            "station": welcome.station, "link": welcome.link, "family": welcome.family,
            "users": self.users.is_some(), "reports": self.reports.is_some(),
            "user": client.as_ref().map(|client| client.who().user.clone()),
            "right": client.as_ref().map(|client| right_name(client.right())),
        }))
    }

    pub(super) async fn login(&self, call: &Call) -> Reply {
        let Some(users) = &self.users else { return plain(StatusCode::NOT_FOUND, "this link has no users") };
        let Some(Login { user, password }) = body(Some(&call.headers), &call.body) else { return wrong() };
        let address = call.peer.to_string();
        let device = sessions::device(&call.headers, &self.sessions.device_cookie());
        let source = Source { address: Some(call.peer), device };
        let login = match users.login(&user, &password, &source).await {
            Ok(login) => login,
            Err(why) => {
                self.station.audit().refused(&user, &address, "login", &why.to_string());
                let status = match why {
                    LoginError::Wrong => StatusCode::UNAUTHORIZED,
                    LoginError::Busy => StatusCode::TOO_MANY_REQUESTS,
                };
                return plain(status, why.to_string());
            }
        };
        if let Err(error) = self.station.audit().note(&user, &address, "login", "done") {
            return trouble(&Trouble::Audit(error.to_string()));
        }
        // A previous session ends.
        let _ = self.sessions.close(&call.headers);
        let client = self.station.client(Who { user: login.user, address, right: login.right });
        let right = right_name(client.right());
        let Some(token) = self.sessions.open(client, users.mark(&user)) else {
            return plain(StatusCode::SERVICE_UNAVAILABLE, "no random numbers");
        };
        let mut answer = send(&json!({ "user": user, "right": right }));
        add_cookie(&mut answer, self.sessions.cookie(), call.tls, &token, None);
        if let Some(device) = users.device(&user) {
            add_cookie(&mut answer, &self.sessions.device_cookie(), call.tls, &device, Some(KNOWN));
        }
        answer
    }

    pub(super) fn logout(&self, call: &Call) -> Reply {
        if let Some(client) = self.sessions.close(&call.headers) {
            let who = client.who();
            let _ = self.station.audit().note(&who.user, &who.address, "logout", "done");
        }
        let mut answer = send(&json!({}));
        add_cookie(&mut answer, self.sessions.cookie(), call.tls, "", Some(0));
        answer
    }

    pub(super) async fn document(&self, what: &str) -> Reply {
        let which = match what {
            "status" => Document::Status,
            "timing" => Document::Timing,
            "links" => Document::Links,
            _ => Document::Buffers,
        };
        match self.station.document(which, AGE).await {
            Ok(text) => reply(StatusCode::OK, "application/json", Bytes::copy_from_slice(&text)),
            Err(why) => trouble(&why),
        }
    }

    async fn entries(&self, client: &Client) -> Result<Vec<Diagnosis>, Trouble> {
        match client.ask(Ask::Diagnostics(ENTRIES)).await? {
            Answer::Diagnostics(entries) => Ok(entries),
            _ => Ok(Vec::new()),
        }
    }

    pub(super) async fn diagnostics(&self, client: &Client) -> Reply {
        match self.entries(client).await {
            Ok(entries) => send(&entries.iter().map(entry).collect()),
            Err(why) => trouble(&why),
        }
    }

    /// Why the CPU is or was last in STOP: the newest STOP, the entry right before it, and the stacks.
    pub(super) async fn why(&self, client: &Client) -> Reply {
        match self.entries(client).await {
            Ok(entries) => {
                let mut told = why(&entries);
                told["stack"] = self.stack(client).await;
                send(&told)
            }
            Err(why) => trouble(&why),
        }
    }

    pub(super) async fn write(&self, client: &Client, bytes: &Bytes) -> Reply {
        let Some(Write { item, value }) = body(None, bytes) else { return wrong() };
        let catalog = match self.station.catalog().await {
            Ok(catalog) => catalog,
            Err(why) => return trouble(&why),
        };
        let puts = catalog.names.typed(&item).and_then(|typed| typed.puts_of(&value));
        let puts = match puts {
            Ok(puts) => puts,
            Err(why) => return plain(StatusCode::UNPROCESSABLE_ENTITY, why),
        };
        match client.write(&format!("{} = {value}", item.trim()), puts).await {
            Ok(scan) => send(&json!({ "scan": scan })),
            Err(why) => trouble(&why),
        }
    }

    pub(super) async fn command(&self, client: &Client, bytes: &Bytes) -> Reply {
        let Some(Wanted { command }) = body(None, bytes) else { return wrong() };
        let Some(command) = Command::of_word(&command) else { return wrong() };
        match client.ask(Ask::Command(command)).await {
            Ok(_) => send(&json!({})),
            Err(why) => trouble(&why),
        }
    }

    /// Reports of `ob1 soak`: their names, or one of them.
    pub(super) fn reports(&self, asked: &str) -> Reply {
        let Some(folder) = &self.reports else { return send(&json!([])) };
        let mut names: Vec<String> = std::fs::read_dir(folder)
            .into_iter()
            .flatten()
            .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
            .filter(|name| name.ends_with(".json") && !name.starts_with('.'))
            .collect();
        names.sort();
        names.reverse();
        names.truncate(REPORTS);
        let Some(name) = query(asked, "name") else { return send(&json!(names)) };
        // Only an existing name is accepted, so no path leads out of the folder.
        let Some(name) = names.into_iter().find(|known| *known == name) else {
            return plain(StatusCode::NOT_FOUND, "there is no such report");
        };
        let path = folder.join(name);
        match report(&path) {
            Some(text) => reply(StatusCode::OK, "application/json", text),
            None => plain(StatusCode::CONFLICT, "it cannot be read, or is longer than 1 MiB"),
        }
    }
}

/// A report, if it is a file of at most 1 MiB. A FIFO in its place has no writer: it is not waited for.
fn report(path: &Path) -> Option<Vec<u8>> {
    let nonblock = OFlags::NONBLOCK.bits() as i32;
    let file = OpenOptions::new().read(true).custom_flags(nonblock).open(path).ok()?;
    let fits = file.metadata().is_ok_and(|about| about.is_file() && about.len() <= REPORT);
    let mut text = Vec::new();
    file.take(REPORT).read_to_end(&mut text).ok().filter(|_| fits)?;
    Some(text)
}

/// A DATE_AND_TIME as text.
fn wall(bcd: &[u8; 8]) -> String {
    let [year, month, day, hour, minute, second, ms, rest] = bcd;
    let century = if *year >= 0x90 { 19 } else { 20 };
    format!("{century}{year:02x}-{month:02x}-{day:02x} {hour:02x}:{minute:02x}:{second:02x}.{ms:02x}{:x}", rest >> 4)
}

fn change(entry: &Diagnosis) -> Option<&'static str> {
    Event(entry.event).state_change().map(|change| match change {
        StateChange::Startup => "startup",
        StateChange::Run => "run",
        StateChange::Hold => "hold",
        StateChange::Stop => "stop",
        StateChange::Fault => "fault",
    })
}

/// An entry of the diagnostic buffer.
pub(super) fn entry(entry: &Diagnosis) -> Value {
    json!({
        "number": entry.number, "event": format!("{:04X}h", entry.event), "wall": wall(&entry.wall),
        "text": entry.text, "place": entry.place, "because": entry.because, "remedy": entry.remedy,
        "block": entry.block.map(|block| block.to_string()), "line": entry.line, "change": change(entry),
    })
}

/// The newest STOP of these entries (newest first), its cause, and whether it is over.
fn why(entries: &[Diagnosis]) -> Value {
    let since = entries.iter().find(|entry| change(entry).is_some()).map(|entry| wall(&entry.wall));
    let Some(last) = last_stop(entries, |entry| (entry.number, Event(entry.event))) else {
        return json!({ "since": since, "stop": null, "cause": null, "over": true });
    };
    json!({ "since": since, "stop": entry(last.stop), "cause": last.cause.map(entry), "over": last.over })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cause_is_what_came_right_before_the_stop() {
        let of = |number, event| Diagnosis { number, event, text: format!("entry {number}"), ..Diagnosis::default() };
        let fault = Event::CYCLE_TIME_EXCEEDED.0;
        let entries = |events: &[u16]| -> Vec<Diagnosis> {
            events.iter().enumerate().rev().map(|(at, event)| of(at as u64 + 1, *event)).collect()
        };
        let (run, stop_by_fault) = (0x4302, 0x4562);
        let told = why(&entries(&[run, fault, stop_by_fault]));
        assert_eq!((&told["cause"]["text"], &told["over"]), (&json!("entry 2"), &json!(false)), "{told}");
        let told = why(&entries(&[run, fault, stop_by_fault, 0x1381, run]));
        assert_eq!((&told["stop"]["text"], &told["over"]), (&json!("entry 3"), &json!(true)), "{told}");
        assert_eq!(why(&entries(&[run]))["stop"], Value::Null);
        let told = why(&entries(&[run, stop_by_fault]));
        assert_eq!(told["cause"], Value::Null, "a change of state is no cause");
    }

    #[test]
    fn a_wall_clock_is_shown_as_people_write_it() {
        assert_eq!(wall(&[0x26, 0x11, 0x22, 0x18, 0x05, 0x09, 0x12, 0x31]), "2026-11-22 18:05:09.123");
        assert_eq!(wall(&[0x90, 0x01, 0x01, 0, 0, 0, 0, 0]), "1990-01-01 00:00:00.000");
    }
}
