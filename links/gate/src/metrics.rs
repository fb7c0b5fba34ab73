//! A link of type `metrics`: `/metrics` for Prometheus in the text of OpenMetrics, or in the format before it.

mod text;

use std::cell::RefCell;
use std::future::Future;
use std::pin::Pin;
use std::rc::Rc;
use std::time::{Duration, Instant};

use crate::shared::{Link, Source, Station, Trouble, Users};
use base64ct::{Base64, Encoding as _};
use hyper::header::{ACCEPT, AUTHORIZATION, HeaderMap, HeaderValue, WWW_AUTHENTICATE};
use hyper::{Method, StatusCode};
use ob1_access::alarms::StandingAlarm;
use ob1_access::door::{Document, What};
use ob1_access::settings::HttpSettings;
use ring::digest::{SHA256, digest};
use serde_json::Value;

use crate::http::{self, Call, Reply, Site, not_so, plain, reply};
use text::Format;

/// The content types of the formats.
const OPEN_METRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";
const TEXT: &str = "text/plain; version=0.0.4; charset=utf-8";
/// Scrapes within this time get the same figures.
const AGE: Duration = Duration::from_millis(500);
/// A correct password is not checked again for this long: a scrape comes every few seconds.
const TRUSTED: Duration = Duration::from_secs(300);
const TRUSTED_ONES: usize = 16;

type Trusted = (Vec<u8>, String, Instant);

struct Figures {
    station: Station,
    users: Option<Users>,
    /// Digests of correct passwords, their users, and when they were checked.
    trusted: RefCell<Vec<Trusted>>,
    events: Rc<RefCell<text::Counts>>,
}

/// Serves a link of type `metrics`.
pub(crate) async fn serve(mut link: Link, own: HttpSettings) -> Result<(), String> {
    let station = link.station.clone();
    let events = Rc::new(RefCell::new(text::Counts::default()));
    tokio::task::spawn_local(count(station.clone(), Rc::clone(&events)));
    let figures = Figures { users: link.users.take(), trusted: RefCell::default(), events, station };
    http::serve(link, own, Rc::new(figures)).await
}

/// Counts events.
async fn count(station: Station, counts: Rc<RefCell<text::Counts>>) {
    let (kept, mut events) = station.events(0);
    let take = |what: &What| match what {
        What::Diagnosis(entry) => counts.borrow_mut().event(entry.event),
        What::Lost(lost) => counts.borrow_mut().lost(*lost),
        What::State(_) | What::Driver { .. } | What::Link { .. } => {}
    };
    kept.iter().for_each(|event| take(&event.what));
    loop {
        match events.recv().await {
            Ok(event) => take(&event.what),
            Err(tokio::sync::broadcast::error::RecvError::Lagged(lost)) => take(&What::Lost(lost)),
            Err(tokio::sync::broadcast::error::RecvError::Closed) => return,
        }
    }
}

impl Site for Figures {
    fn call(self: Rc<Self>, call: Call) -> Pin<Box<dyn Future<Output = Reply>>> {
        Box::pin(async move {
            if !matches!(call.method, Method::GET | Method::HEAD) {
                return not_so("GET, HEAD");
            }
            if let Err(refused) = self.known(&call).await {
                return *refused;
            }
            if call.path != "/metrics" {
                return plain(StatusCode::NOT_FOUND, "figures are at /metrics");
            }
            let (format, kind) = format(&call.headers);
            match self.text(format).await {
                Ok(text) => reply(StatusCode::OK, kind, text),
                Err(why) => plain(StatusCode::SERVICE_UNAVAILABLE, why.to_string()),
            }
        })
    }
}

impl Figures {
    /// With users, each request must contain a name and a password.
    async fn known(&self, call: &Call) -> Result<(), Box<Reply>> {
        let Some(users) = &self.users else { return Ok(()) };
        let ask = |why: &str| {
            let mut reply = plain(StatusCode::UNAUTHORIZED, why);
            reply.headers_mut().insert(WWW_AUTHENTICATE, HeaderValue::from_static("Basic realm=\"ob1\""));
            Box::new(reply)
        };
        let given = call.headers.get(AUTHORIZATION).and_then(|value| value.to_str().ok());
        let Some((user, password)) = given.and_then(basic) else { return Err(ask("name and password are needed")) };
        // Another password makes what was checked before worthless.
        let proof = format!("{user}\n{password}\n{:?}", users.mark(&user));
        let proof = digest(&SHA256, proof.as_bytes()).as_ref().to_vec();
        let now = Instant::now();
        self.trusted.borrow_mut().retain(|(_, _, since)| now.duration_since(*since) < TRUSTED);
        let trusted = self.trusted.borrow().iter().any(|(known, _, _)| *known == proof);
        if trusted && users.right(&user).is_some() {
            return Ok(());
        }
        match users.login(&user, &password, &Source::address(call.peer)).await {
            Ok(login) => {
                trust(&mut self.trusted.borrow_mut(), (proof, login.user, now));
                Ok(())
            }
            Err(why) => {
                self.station.audit().refused(&user, &call.peer.to_string(), "scrape", &why.to_string());
                Err(ask(&why.to_string()))
            }
        }
    }

    async fn text(&self, format: Format) -> Result<String, Trouble> {
        let mut documents = [const { Value::Null }; 4];
        let which = [Document::Status, Document::Timing, Document::Links, Document::Buffers];
        for (value, which) in documents.iter_mut().zip(which) {
            let text = self.station.document(which, AGE).await?;
            *value = serde_json::from_slice(&text).map_err(|error| Trouble::Program(error.to_string()))?;
        }
        let [status, timing, links, buffers] = documents;
        let alarms = self.station.alarms().await?;
        let count = |which: &dyn Fn(&StandingAlarm) -> bool| alarms.iter().filter(|alarm| which(alarm)).count();
        let alarms = [count(&|alarm| alarm.active), count(&|alarm| !alarm.acknowledged)];
        Ok(text::figures(&text::Told { status, timing, links, buffers, alarms }, &self.events.borrow(), format))
    }
}

/// Remembers a correct password in place of the oldest.
fn trust(trusted: &mut Vec<Trusted>, one: Trusted) {
    if trusted.len() >= TRUSTED_ONES {
        trusted.remove(0);
    }
    trusted.push(one);
}

/// The format for a client, and its content type: OpenMetrics for those that ask for it, as collectors do; the text
/// before it for all others (`curl | promtool check metrics`, browsers).
fn format(headers: &HeaderMap) -> (Format, &'static str) {
    let name = "application/openmetrics-text";
    let is_open = |kind: &str| kind.get(..name.len()).is_some_and(|begin| begin.eq_ignore_ascii_case(name));
    if http::list(headers, ACCEPT).any(is_open) { (Format::OpenMetrics, OPEN_METRICS) } else { (Format::Text, TEXT) }
}

/// `Basic bmFtZTpwYXNzd29yZA==`.
fn basic(header: &str) -> Option<(String, String)> {
    // The name of a scheme has no case [RFC 9110, 11.1].
    let (_, coded) = header.split_once(' ').filter(|(scheme, _)| scheme.eq_ignore_ascii_case("basic"))?;
    let text = String::from_utf8(Base64::decode_vec(coded.trim()).ok()?).ok()?;
    let (user, password) = text.split_once(':')?;
    Some((user.to_owned(), password.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_the_trusted_passwords_the_oldest_goes() {
        let mut trusted = Vec::new();
        (0..=TRUSTED_ONES).for_each(|number| trust(&mut trusted, (vec![number as u8], String::new(), Instant::now())));
        let kept: Vec<u8> = trusted.iter().map(|(proof, ..)| proof[0]).collect();
        assert_eq!(kept, (1..=TRUSTED_ONES as u8).collect::<Vec<_>>());
    }

    #[test]
    fn only_who_asks_for_it_gets_open_metrics() {
        let of = |lines: &[&str]| {
            let mut headers = HeaderMap::new();
            for line in lines {
                headers.append(ACCEPT, line.parse().expect("a value"));
            }
            format(&headers).0
        };
        for (lines, wanted) in [
            (&[][..], Format::Text),
            (&["*/*"], Format::Text),
            (&["application/openmetrics-text;version=1.0.0;q=0.5,text/plain;q=0.4,*/*;q=0.1"], Format::OpenMetrics),
            (&["text/plain;version=0.0.4", "application/openmetrics-text"], Format::OpenMetrics),
            (&["text/plain;version=0.0.4;q=0.5,*/*;q=0.1"], Format::Text),
            (&["Text/Plain"], Format::Text),
            (&["text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8"], Format::Text),
            (&["application/json", "", ",;,"], Format::Text),
            (&["Application/OpenMetrics-Text"], Format::OpenMetrics),
        ] {
            assert_eq!(of(lines), wanted, "{lines:?}");
        }
    }

    #[test]
    fn a_name_and_a_password_out_of_a_header() {
        let both = |user: &str, password: &str| Some((user.to_owned(), password.to_owned()));
        for (header, told) in [
            ("Basic YW5uYTpzZWNyZXQ=", both("anna", "secret")),
            ("basic  YW5uYTpzZWNyZXQ=", both("anna", "secret")),
            ("Basic YW5uYTo=", both("anna", "")),
            ("Basic YTpiOmM=", both("a", "b:c")),
            ("Basic w7w6w6Q=", both("ü", "ä")),
            ("Basic YW5uYQ==", None),
            ("Basic %%%%", None),
            ("Basic /w==", None),
            ("Bearer YW5uYTpzZWNyZXQ=", None),
            ("", None),
        ] {
            assert_eq!(basic(header), told, "{header}");
        }
    }
}
