//! Server-sent events of the page: the station's state, its events, and the values of a variable table.

use std::cell::{Cell, RefCell};
use std::net::IpAddr;
use std::rc::Rc;
use std::time::Duration;

use crate::shared::{Client, Trouble, Watch, network};
use hyper::StatusCode;
use hyper::body::Bytes;
use hyper::header::{CONTENT_TYPE, HeaderValue};
use ob1_access::door::{Document, Event, What};
use ob1_access::{Form, Names, Typed};
use serde_json::{Value, json};
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::{interval, timeout};

use super::api::entry;
use super::ladder::Shown;
use super::{Page, taps};
use crate::http::{Body, Call, Reply, plain, query};

/// Maximum of streams; one address gets at most half of them, so that others can connect too.
const STREAMS: usize = 32;
const OF_ONE: usize = STREAMS / 2;
/// Messages that may wait for a browser; one that takes none for this long is dropped.
const WAITING: usize = 32;
const DEAF: Duration = Duration::from_secs(20);
/// Time between two reads of the station's figures.
const STATUS: Duration = Duration::from_secs(1);
/// Maximum of blocks that a page watches.
const FLOWS: usize = 8;
/// Maximum variables of a table, and the limits of its period in milliseconds.
const ITEMS: usize = 500;
const PERIODS: (u64, u64) = (100, 60_000);

/// The addresses of all streams. Clones share them.
#[derive(Clone, Default)]
pub(super) struct Streams(Rc<RefCell<Vec<IpAddr>>>);

impl Streams {
    /// A place for one more stream; `None`: there is none for this address.
    fn place(&self, peer: IpAddr) -> Option<Counted> {
        let mut all = self.0.borrow_mut();
        if all.len() >= STREAMS || all.iter().filter(|other| **other == peer).count() >= OF_ONE {
            return None;
        }
        all.push(peer);
        Some(Counted(self.clone(), peer))
    }
}

/// Counts a stream as long as it lives.
struct Counted(Streams, IpAddr);

impl Drop for Counted {
    fn drop(&mut self) {
        let mut all = self.0.0.borrow_mut();
        if let Some(at) = all.iter().position(|peer| *peer == self.1) {
            all.swap_remove(at);
        }
    }
}

/// A line of a variable table.
struct Line {
    typed: Result<Typed, String>,
    form: Form,
    /// Its place in the reading.
    index: usize,
}

/// Opens a stream: `items` are names, one per line; `period` in milliseconds.
pub(super) fn open(page: &Rc<Page>, client: Client, call: &Call) -> Reply {
    let Some(counted) = page.streams.place(network(call.peer)) else {
        return plain(StatusCode::SERVICE_UNAVAILABLE, "too many pages show this station: close another one");
    };
    let (to, parts) = mpsc::channel(WAITING);
    let header = call.headers.get("last-event-id").and_then(|id| id.to_str().ok()?.parse().ok());
    // A page that asks for something else opens its stream anew, without the header.
    let after = header.or_else(|| query(&call.query, "after")?.parse().ok());
    let items = query(&call.query, "items").unwrap_or_default();
    let period = query(&call.query, "period").and_then(|text| text.parse().ok()).unwrap_or(1000);
    let left = page.sessions.left(&call.headers);
    let logged_in = mark(page, &client);
    let page = Rc::clone(page);
    let telegrams = query(&call.query, "telegrams").is_some();
    let flows = query(&call.query, "flows").filter(|_| page.allowed.has_program()).unwrap_or_default();
    tokio::task::spawn_local(async move {
        let _counted = counted;
        let taps = if telegrams { taps::open(&page).await } else { None };
        let period = period.clamp(PERIODS.0, PERIODS.1);
        let _flows = watch(&page, &flows, &to);
        let _ = run(&page, (&client, logged_in, &left), &to, after, (&items, period), taps).await;
    });
    let mut reply = hyper::Response::new(Body::Parts(parts));
    reply.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static("text/event-stream"));
    // nginx holds an answer back until a buffer is full, unless it is told not to.
    reply.headers_mut().insert("x-accel-buffering", HeaderValue::from_static("no"));
    reply
}

/// Passes through the blocks that are shown, one a line; they end with this.
fn watch(page: &Rc<Page>, flows: &str, to: &To) -> JoinSet<()> {
    let mut tasks = JoinSet::new();
    for text in flows.lines().take(FLOWS) {
        let Some(shown) = Shown::parse(text) else { continue };
        let (mut sight, to, of) = (page.watch(shown), to.clone(), text.to_owned());
        tasks.spawn_local(async move {
            while let Some(told) = sight.next().await {
                // What is told is JSON already.
                let data =
                    format!("{{\"of\":{},\"told\":{}}}", json!(of), if told.is_empty() { "null" } else { &told });
                if say(&to, "flow", None, &data).await.is_err() {
                    return;
                }
            }
        });
    }
    tasks
}

/// [`crate::shared::Users::mark`] of the client's user now.
fn mark(page: &Page, client: &Client) -> Option<u64> {
    page.users.as_ref().and_then(|users| users.mark(&client.who().user))
}

type To = mpsc::Sender<Bytes>;

/// Sends one message; an error means that the browser is gone.
async fn say(to: &To, name: &str, id: Option<u64>, data: &str) -> Result<(), ()> {
    let id = id.map_or_else(String::new, |id| format!("id: {id}\n"));
    let text = format!("{id}event: {name}\ndata: {data}\n\n");
    timeout(DEAF, to.send(Bytes::from(text))).await.map_err(drop)?.map_err(drop)
}

async fn run(
    page: &Page,
    (client, logged_in, left): (&Client, Option<u64>, &Cell<bool>),
    to: &To,
    after: Option<u64>,
    (items, period): (&str, u64),
    mut taps: Option<taps::Taps>,
) -> Result<(), ()> {
    let station = &page.station;
    let (kept, mut events) = station.events(after.unwrap_or(0));
    // A new page requests past events itself; a reconnected one gets the events it has missed.
    let kept = if after.is_some() { kept } else { Vec::new() };
    let mut status = interval(STATUS);
    let (lines, mut watch) = table(page, items, period).await;
    if !lines.is_empty() {
        let names: Vec<Value> = lines.iter().map(head).collect();
        say(to, "table", None, &json!(names).to_string()).await?;
    }
    for event in kept {
        say(to, "event", Some(event.number), &told(&event).to_string()).await?;
    }
    loop {
        tokio::select! {
            // The browser has gone: its place is free at once.
            () = to.closed() => return Err(()),
            _ = status.tick() => {
                let text = station.document(Document::Status, STATUS * 4 / 5).await;
                match text {
                    Ok(text) => say(to, "status", None, &String::from_utf8_lossy(&text)).await?,
                    Err(why) => say(to, "trouble", None, &json!(why.to_string()).to_string()).await?,
                }
                // A user who has logged out, or must log in again, gets nothing more.
                if left.get() || mark(page, client) != logged_in {
                    return Err(());
                }
            }
            event = events.recv() => match event {
                Ok(event) => say(to, "event", Some(event.number), &told(&event).to_string()).await?,
                Err(RecvError::Lagged(count)) => say(to, "lost", None, &count.to_string()).await?,
                Err(RecvError::Closed) => return Err(()),
            },
            heard = taps::next(&mut taps) => say(to, "telegram", None, &heard.to_string()).await?,
            reading = newest(&mut watch) => match reading {
                Ok(reading) => {
                    let shown: Vec<Value> = lines.iter().map(|line| shown(line, &reading)).collect();
                    let data = json!({ "scan": reading.scan, "values": shown });
                    say(to, "values", None, &data.to_string()).await?;
                }
                Err(Trouble::Gone) => return Err(()),
                Err(why) => say(to, "trouble", None, &json!(why.to_string()).to_string()).await?,
            },
        }
    }
}

async fn newest(watch: &mut Option<Watch>) -> Result<std::sync::Arc<ob1_access::door::Reading>, Trouble> {
    match watch {
        Some(watch) => watch.next().await,
        None => std::future::pending().await,
    }
}

async fn table(page: &Page, items: &str, period: u64) -> (Vec<Line>, Option<Watch>) {
    let names: Vec<&str> = items.lines().map(str::trim).filter(|name| !name.is_empty()).take(ITEMS).collect();
    if names.is_empty() {
        return (Vec::new(), None);
    }
    let catalog = page.station.catalog().await;
    let (mut lines, mut pieces) = (Vec::new(), Vec::new());
    for text in names {
        let (name, form) = Form::split(text);
        let found = match &catalog {
            Ok(catalog) => find(&catalog.names, name),
            Err(why) => Err(why.to_string()),
        };
        let typed = found.map(|(typed, piece)| {
            pieces.push(piece);
            typed
        });
        lines.push(Line { typed, form, index: pieces.len().saturating_sub(1) });
    }
    let watch = (!pieces.is_empty()).then(|| page.station.watch(pieces, Duration::from_millis(period)));
    (lines, watch)
}

fn find(names: &Names, name: &str) -> Result<(Typed, ob1_access::Piece), String> {
    let typed = names.typed(name)?;
    let piece = typed.piece().ok_or_else(|| format!("{name} is a {}, which has no value", typed.ty.name()))?;
    Ok((typed, piece))
}

fn head(line: &Line) -> Value {
    match &line.typed {
        Ok(typed) => json!({ "name": typed.name, "type": typed.ty.name() }),
        Err(why) => json!({ "error": why }),
    }
}

/// A value in its form, or the reason why there is none.
fn shown(line: &Line, reading: &ob1_access::door::Reading) -> Value {
    let Ok(typed) = &line.typed else { return Value::Null };
    let bytes = match reading.piece(line.index) {
        Ok(bytes) => bytes,
        Err(why) => return json!({ "error": why.to_string() }),
    };
    Value::String(line.form.show(&typed.text(bytes), &typed.hex(bytes)))
}

/// An event for the page.
fn told(event: &Event) -> Value {
    match &event.what {
        What::Diagnosis(diagnosis) => json!({ "what": "diagnosis", "entry": entry(diagnosis) }),
        What::State(state) => json!({ "what": "state", "state": state.name() }),
        What::Driver { name, up } => json!({ "what": "driver", "name": name, "up": up }),
        What::Link { name, up } => json!({ "what": "link", "name": name, "up": up }),
        What::Lost(count) => json!({ "what": "lost", "count": count }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_leaves_places_for_others() {
        let streams = Streams::default();
        let [one, other] = [[192, 0, 2, 1], [192, 0, 2, 2]].map(IpAddr::from);
        let mut all: Vec<Counted> = (0..STREAMS).filter_map(|_| streams.place(one)).collect();
        assert_eq!(all.len(), OF_ONE);
        all.extend((0..STREAMS).filter_map(|_| streams.place(other)));
        assert_eq!(all.len(), STREAMS);
        assert!(streams.place([192, 0, 2, 3].into()).is_none(), "full");
        all.remove(0);
        assert!(streams.place(other).is_none() && streams.place(one).is_some());
        drop(all);
        assert!(streams.0.borrow().is_empty());
    }
}
