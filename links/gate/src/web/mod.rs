//! The web page: its files, and its requests.

mod alarms;
mod api;
mod files;
mod flow;
mod insight;
mod io;
mod ladder;
mod program;
mod sessions;
mod stack;
mod stream;
mod tables;
mod taps;
mod why;

use std::future::Future;
use std::pin::Pin;
use std::rc::Rc;

use crate::shared::{Client, Link, Station, Users, Who};
use hyper::{Method, StatusCode};
use ob1_access::settings::WebSettings;
use ob1_access::{Allowed, Right};

use crate::http::{self, Call, Reply, Site, not_so, plain};
use sessions::Sessions;

/// Requests that change something; all others are read.
const CHANGES: [&str; 6] = ["login", "logout", "write", "command", "tables", "acknowledge"];

/// A link of type `web`.
pub(super) struct Page {
    station: Station,
    users: Option<Users>,
    sessions: Sessions,
    /// What the page shows of the program.
    allowed: Allowed,
    /// Without users everybody is this client, which may read.
    everybody: Client,
    reports: Option<std::path::PathBuf>,
    /// The folder of the drivers' taps.
    taps: Option<std::path::PathBuf>,
    tables: tables::Tables,
    /// The open event streams.
    streams: stream::Streams,
    /// The program as it is explained.
    insight: insight::Newest,
    /// The blocks that are watched.
    flows: flow::Flows,
}

/// Serves a link of type `web`.
pub(crate) async fn serve(mut link: Link, own: WebSettings) -> Result<(), String> {
    let station = link.station.clone();
    let who = Who { user: "-".into(), address: "-".into(), right: Right::Read };
    let page = Page {
        allowed: own.allowed,
        everybody: station.client(who),
        users: link.users.take(),
        sessions: Sessions::of(&station.welcome().station, &station.welcome().link),
        reports: own.reports,
        taps: own.taps,
        tables: tables::Tables(link.state.take().map(|folder| folder.join("tables.json"))),
        streams: stream::Streams::default(),
        insight: insight::Newest::default(),
        flows: flow::Flows::default(),
        station,
    };
    http::serve(link, own.http, Rc::new(page)).await
}

impl Site for Page {
    fn call(self: Rc<Self>, call: Call) -> Pin<Box<dyn Future<Output = Reply>>> {
        Box::pin(async move { self.answer(call).await })
    }
}

impl Page {
    /// The client of a request; `None`: login is required first.
    fn client(&self, call: &Call) -> Option<Client> {
        match &self.users {
            None => Some(self.everybody.clone()),
            Some(users) => self.sessions.client(&call.headers, users),
        }
    }

    async fn answer(self: Rc<Self>, call: Call) -> Reply {
        let reads = matches!(call.method, Method::GET | Method::HEAD);
        if let Some(file) = files::find(&call.path) {
            return if reads { file.reply(&call.headers) } else { not_so("GET, HEAD") };
        }
        let Some(what) = call.path.strip_prefix("/api/") else {
            return plain(StatusCode::NOT_FOUND, "there is no such page");
        };
        let what = what.to_owned();
        let changes = CHANGES.contains(&&*what);
        if !reads && call.method != Method::POST {
            return not_so(if changes { "POST" } else { "GET, HEAD" });
        }
        // Requests that need no login.
        match (&*what, reads) {
            ("session", true) => return self.session(&call),
            ("login", false) => return self.login(&call).await,
            ("logout", false) => return self.logout(&call),
            _ => {}
        }
        let Some(client) = self.client(&call) else {
            return plain(StatusCode::UNAUTHORIZED, "log in first");
        };
        match (&*what, reads) {
            ("stream", true) => stream::open(&self, client, &call),
            ("diagnostics", true) => self.diagnostics(&client).await,
            ("why", true) => self.why(&client).await,
            ("status" | "timing" | "buffers" | "links", true) => self.document(&what).await,
            ("program", true) => program::overview(&self).await,
            ("block", true) => program::block(&self, &call.query).await,
            ("xref", true) => program::xref(&self, &call.query).await,
            ("alarms", true) => self.alarms().await,
            ("acknowledge", false) => self.acknowledge(&client, &call.body).await,
            ("io", true) => self.io().await,
            ("drawing", true) => self.drawing(&call.query).await,
            ("reason", true) => self.reason(&call.query).await,
            ("reports", true) => self.reports(&call.query),
            ("tables", true) => self.tables(),
            ("tables", false) => self.keep_table(&client, &call.body),
            ("write", false) => self.write(&client, &call.body).await,
            ("command", false) => self.command(&client, &call.body).await,
            _ if reads && changes => not_so("POST"),
            _ if reads => plain(StatusCode::NOT_FOUND, "there is no such request"),
            _ => not_so("GET, HEAD"),
        }
    }
}
