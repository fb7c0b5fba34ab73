//! HTTP/1.1 for a link: who may connect, how long a request may take, which hosts it may name. All input is untrusted.

use std::cell::{Cell, RefCell};
use std::convert::Infallible;
use std::future::Future;
use std::net::{IpAddr, SocketAddr};
use std::pin::Pin;
use std::rc::Rc;
use std::task::{Context, Poll};
use std::time::Duration;

use crate::shared::{Link, network};
use http_body_util::{BodyExt as _, LengthLimitError, Limited};
use hyper::body::{Bytes, Frame, Incoming};
use hyper::header::{ALLOW, CACHE_CONTROL, CONTENT_TYPE, HOST, HeaderMap, HeaderName, HeaderValue, ORIGIN};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use ob1_access::settings::HttpSettings;
use rustix::net::sockopt;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpListener;
use tokio::sync::{Notify, mpsc};
use tokio::time::timeout;
use tracing::{debug, warn};

/// Time limit for each of a request's header, a handshake and a body.
const PATIENCE: Duration = Duration::from_secs(10);
/// A partner that takes nothing for this long is dropped.
const DEAF: Duration = Duration::from_secs(30);
/// Longest header and body, in bytes.
const HEAD: usize = 32 << 10;
const BODY: usize = 64 << 10;
/// Default limit of concurrent connections; one address gets at most half of them. A new one replaces one that asks for
/// nothing.
const CLIENTS: usize = 64;
/// Wait before the next accept when there is no free descriptor.
const PAUSE: Duration = Duration::from_millis(100);

/// Only the page's own files may run, be shown or be requested.
const POLICY: &str = "default-src 'none'; script-src 'self'; worker-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self'; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// A complete request.
#[derive(Debug)]
pub(crate) struct Call {
    pub(crate) method: Method,
    pub(crate) path: String,
    pub(crate) query: String,
    pub(crate) headers: HeaderMap,
    pub(crate) body: Bytes,
    pub(crate) peer: IpAddr,
    /// The browser speaks TLS, to us or to a proxy.
    pub(crate) tls: bool,
}

/// The handler of requests.
pub(crate) trait Site: 'static {
    fn call(self: Rc<Self>, call: Call) -> Pin<Box<dyn Future<Output = Reply>>>;
}

pub(crate) type Reply = Response<Body>;

/// A complete body, or one that comes in parts.
#[derive(Debug)]
pub(crate) enum Body {
    Whole(Option<Bytes>),
    Parts(mpsc::Receiver<Bytes>),
}

impl hyper::body::Body for Body {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        match &mut *self {
            Self::Whole(bytes) => Poll::Ready(bytes.take().map(|bytes| Ok(Frame::data(bytes)))),
            Self::Parts(parts) => parts.poll_recv(context).map(|part| part.map(|part| Ok(Frame::data(part)))),
        }
    }

    fn size_hint(&self) -> hyper::body::SizeHint {
        match self {
            Self::Whole(bytes) => hyper::body::SizeHint::with_exact(bytes.as_ref().map_or(0, Bytes::len) as u64),
            Self::Parts(_) => hyper::body::SizeHint::new(),
        }
    }

    fn is_end_stream(&self) -> bool {
        matches!(self, Self::Whole(None))
    }
}

/// An open connection.
struct Connection {
    /// The address, as far as its owner cannot choose it.
    network: IpAddr,
    /// Requests that have no complete answer yet.
    requests: Cell<u32>,
    /// It has to make room.
    leaves: Notify,
}

/// A request of a connection that has no complete answer yet.
struct Busy(Rc<Connection>);

impl Busy {
    fn of(connection: &Rc<Connection>) -> Self {
        connection.requests.set(connection.requests.get() + 1);
        Self(Rc::clone(connection))
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        self.0.requests.set(self.0.requests.get() - 1);
    }
}

/// The open connections of a link, the oldest first.
#[derive(Default)]
struct Connections(RefCell<Vec<Rc<Connection>>>);

impl Connections {
    /// A place for one more; `None`: there is none for this address. With too many of an address its oldest that asks
    /// for nothing makes room, with too many of all that of the address that has most.
    fn enter(&self, network: IpAddr, most: usize) -> Option<Rc<Connection>> {
        let mut all = self.0.borrow_mut();
        let count = |of: IpAddr| all.iter().filter(|other| other.network == of).count();
        let has_its_share = count(network) >= most.div_ceil(2);
        if has_its_share || all.len() >= most {
            let idle = all.iter().enumerate().rev().filter(|(_, other)| other.requests.get() == 0);
            let fit = idle.filter(|(_, other)| !has_its_share || other.network == network);
            // The last of equal ones, which is the oldest.
            let (at, _) = fit.max_by_key(|(_, other)| count(other.network))?;
            all.remove(at).leaves.notify_one();
        }
        let one = Rc::new(Connection { network, requests: Cell::new(0), leaves: Notify::new() });
        all.push(Rc::clone(&one));
        Some(one)
    }

    fn leave(&self, one: &Rc<Connection>) {
        self.0.borrow_mut().retain(|other| !Rc::ptr_eq(other, one));
    }
}

/// An answer of a type.
pub(crate) fn reply(status: StatusCode, kind: &'static str, body: impl Into<Bytes>) -> Reply {
    let mut reply = Response::new(Body::Whole(Some(body.into())));
    *reply.status_mut() = status;
    reply.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static(kind));
    reply
}

/// An answer in a sentence.
pub(crate) fn plain(status: StatusCode, text: impl Into<String>) -> Reply {
    reply(status, "text/plain; charset=utf-8", text.into() + "\n")
}

/// This path has other methods [RFC 9110, 15.5.6].
pub(crate) fn not_so(allowed: &'static str) -> Reply {
    let mut reply = plain(StatusCode::METHOD_NOT_ALLOWED, format!("only {allowed}"));
    reply.headers_mut().insert(ALLOW, HeaderValue::from_static(allowed));
    reply
}

/// The elements of a header that is a list; it may have several lines [RFC 9110, 5.6.1].
pub(crate) fn list(headers: &HeaderMap, name: HeaderName) -> impl Iterator<Item = &str> {
    let lines = headers.get_all(name).iter().filter_map(|value| value.to_str().ok());
    lines.flat_map(|line| line.split(',')).map(str::trim)
}

/// The names of a link.
#[derive(Debug, Default)]
struct Names {
    hosts: Vec<String>,
    /// The addresses under which a proxy shows the page: `https://press.plant.example`.
    origins: Vec<String>,
}

impl Names {
    /// Addresses are always accepted; somebody else may have made a name lead here (DNS rebinding), so only names in
    /// the station file are.
    fn has(&self, host: &str) -> bool {
        let name = host_name(host);
        let proxies = self.origins.iter().filter_map(|origin| Some(host_name(origin.split_once("://")?.1)));
        name.parse::<IpAddr>().is_ok()
            || name.eq_ignore_ascii_case("localhost")
            || self.hosts.iter().map(String::as_str).chain(proxies).any(|known| known.eq_ignore_ascii_case(name))
    }

    /// Whether a proxy shows the page as a part of this origin.
    fn shown_at(&self, origin: &str) -> bool {
        self.origins.iter().any(|known| known.eq_ignore_ascii_case(origin))
    }
}

/// `press.plant:8080`, `[::1]:8080` -> the name.
fn host_name(host: &str) -> &str {
    if let Some((name, _)) = host.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
        return name;
    }
    host.rsplit_once(':')
        .map_or(host, |(name, port)| if port.bytes().all(|b| b.is_ascii_digit()) { name } else { host })
}

/// Why a request is refused without evaluation.
fn stranger(names: &Names, headers: &HeaderMap, method: &Method, tls: bool) -> Option<&'static str> {
    let text = |value: Option<&HeaderValue>| value.and_then(|value| value.to_str().ok()).map(str::to_owned);
    let hosts: Vec<_> = headers.get_all(HOST).iter().collect();
    let [host] = hosts[..] else { return Some("exactly one Host header is needed") };
    let Some(host) = text(Some(host)).filter(|host| names.has(host)) else {
        return Some("this is not a name of the station: the key `hosts` of the link lists its names");
    };
    let origin = text(headers.get(ORIGIN));
    let own = format!("{}://{host}", if tls { "https" } else { "http" });
    let changes = !matches!(*method, Method::GET | Method::HEAD);
    let ours = origin.as_deref().is_some_and(|origin| origin == own || names.shown_at(origin));
    if (changes || origin.is_some()) && !ours {
        return Some("the request comes from another page (Origin)");
    }
    match text(headers.get("sec-fetch-site")).as_deref() {
        Some("cross-site" | "same-site") if changes => Some("the request comes from another page (Sec-Fetch-Site)"),
        _ => None,
    }
}

/// Serves a link until the process ends.
pub(crate) async fn serve(link: Link, own: HttpSettings, site: Rc<impl Site>) -> Result<(), String> {
    let clients = own.clients.unwrap_or(CLIENTS);
    let names = Rc::new(Names { hosts: own.hosts, origins: own.origins });
    let connections = Rc::<Connections>::default();
    let listener = link.listeners.into_iter().next().ok_or("nowhere to listen: see above")?;
    let listener = TcpListener::from_std(listener).map_err(|error| error.to_string())?;
    loop {
        let (stream, peer) = match listener.accept().await {
            Ok(accepted) => accepted,
            Err(error) => {
                debug!("accept: {error}");
                tokio::time::sleep(PAUSE).await;
                continue;
            }
        };
        let Some(one) = connections.enter(network(peer.ip()), clients) else {
            debug!(%peer, "too many connections");
            continue;
        };
        let _ = stream.set_nodelay(true);
        let _ = sockopt::set_tcp_user_timeout(&stream, DEAF.as_millis() as u32);
        let _ = sockopt::set_socket_keepalive(&stream, true);
        let (site, names, connections) = (Rc::clone(&site), Rc::clone(&names), Rc::clone(&connections));
        let tls = link.tls.as_ref().map(crate::shared::Tls::acceptor);
        tokio::task::spawn_local(async move {
            let served = async {
                match tls {
                    None => connection(stream, peer, false, names, site, &one).await,
                    Some(acceptor) => match timeout(PATIENCE, acceptor.accept(stream)).await {
                        Ok(Ok(stream)) => connection(stream, peer, true, names, site, &one).await,
                        Ok(Err(error)) => debug!(%peer, "TLS: {error}"),
                        Err(_) => debug!(%peer, "TLS: no handshake"),
                    },
                }
            };
            tokio::select! {
                () = served => {}
                () = one.leaves.notified() => debug!(%peer, "makes room for another"),
            }
            connections.leave(&one);
        });
        // Its request is read before others can take its place.
        tokio::task::yield_now().await;
    }
}

async fn connection<S: Site>(
    stream: impl AsyncRead + AsyncWrite + Unpin + 'static,
    peer: SocketAddr,
    tls: bool,
    names: Rc<Names>,
    site: Rc<S>,
    one: &Rc<Connection>,
) {
    let service = service_fn(move |request: Request<Incoming>| {
        let (names, site, one) = (Rc::clone(&names), Rc::clone(&site), Rc::clone(one));
        async move {
            let received = receive(request, peer, tls, &names).await;
            let busy = Busy::of(&one);
            let reply = match received {
                Ok(call) => site.call(call).await,
                Err(refused) => *refused,
            };
            // The request lasts as long as its body.
            Ok::<_, Infallible>(guarded(reply).map(|body| {
                body.map_err(move |never| {
                    let _ = &busy;
                    never
                })
            }))
        }
    });
    let served = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(PATIENCE)
        .max_buf_size(HEAD)
        .serve_connection(TokioIo::new(stream), service)
        .await;
    if let Err(error) = served {
        debug!(%peer, "{error}");
    }
}

/// Receives a whole request.
async fn receive(request: Request<Incoming>, peer: SocketAddr, tls: bool, names: &Names) -> Result<Call, Box<Reply>> {
    let refuse = |status, why: &str| Err(Box::new(plain(status, why)));
    let (head, body) = request.into_parts();
    if let Some(why) = stranger(names, &head.headers, &head.method, tls) {
        warn!(%peer, "refused: {why}");
        return refuse(StatusCode::FORBIDDEN, why);
    }
    let body = match timeout(PATIENCE, Limited::new(body, BODY).collect()).await {
        Ok(Ok(body)) => body.to_bytes(),
        Ok(Err(error)) if error.is::<LengthLimitError>() => {
            return refuse(StatusCode::PAYLOAD_TOO_LARGE, "at most 64 KiB");
        }
        Ok(Err(_)) => return refuse(StatusCode::BAD_REQUEST, "the body of the request is broken"),
        Err(_) => return refuse(StatusCode::REQUEST_TIMEOUT, "the body of the request did not arrive in time"),
    };
    // The origin is ours; if it is one of HTTPS, the browser speaks TLS to a proxy.
    let tls = tls || head.headers.get(ORIGIN).is_some_and(|origin| origin.as_bytes().starts_with(b"https://"));
    let path = head.uri.path().to_owned();
    let query = head.uri.query().unwrap_or_default().to_owned();
    Ok(Call { method: head.method, path, query, headers: head.headers, body, peer: peer.ip().to_canonical(), tls })
}

/// The headers of every answer.
fn guarded(mut reply: Reply) -> Reply {
    let headers = reply.headers_mut();
    for (name, value) in [
        ("content-security-policy", POLICY),
        ("x-content-type-options", "nosniff"),
        ("referrer-policy", "no-referrer"),
        ("cross-origin-opener-policy", "same-origin"),
        ("cross-origin-resource-policy", "same-origin"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    headers.entry(CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    reply
}

/// A value of a query, decoded.
pub(crate) fn query(query: &str, key: &str) -> Option<String> {
    query.split('&').find_map(|pair| {
        let (name, value) = pair.split_once('=').unwrap_or((pair, ""));
        (name == key).then(|| decode(value))
    })
}

/// `%41+b` -> `A b`. Invalid characters are replaced.
fn decode(text: &str) -> String {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let [first, tail @ ..] = rest {
        rest = tail;
        let hex = |digits: &[u8]| u8::from_str_radix(std::str::from_utf8(digits).ok()?, 16).ok();
        match (first, tail) {
            (b'+', _) => bytes.push(b' '),
            (b'%', [a, b, after @ ..]) if a.is_ascii_hexdigit() && b.is_ascii_hexdigit() => {
                bytes.extend(hex(&[*a, *b]));
                rest = after;
            }
            _ => bytes.push(*first),
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_asks_for_nothing_makes_room() {
        let of = |text: &str| text.parse::<IpAddr>().expect("an address");
        let (here, there) = (of("127.0.0.1"), of("192.0.2.1"));
        let all = Connections::default();
        let silent: Vec<_> = (0..4).map(|_| all.enter(here, 8).expect("room")).collect();
        let asking: Vec<Busy> = silent[..2].iter().map(Busy::of).collect();
        assert!(all.enter(here, 8).is_some(), "one of the own that asks for nothing goes");
        assert_eq!(all.0.borrow().len(), 4);
        assert!(!all.0.borrow().iter().any(|other| Rc::ptr_eq(other, &silent[2])), "the oldest of them");
        let others: Vec<Busy> = (0..4).map(|_| Busy::of(&all.enter(there, 8).expect("room"))).collect();
        assert!(all.enter(there, 8).is_none(), "all of its own are served");
        assert!(all.enter(of("192.0.2.2"), 8).is_some(), "of the address that has most");
        drop((asking, others));
        assert!(all.enter(there, 8).is_some());
        let one = all.enter(here, 8).expect("room");
        let count = all.0.borrow().len();
        all.leave(&one);
        assert_eq!(all.0.borrow().len(), count - 1);
    }

    #[test]
    fn queries_are_decoded() {
        let text = "items=DB10.DBW0%0A%22St%C3%A4rt%22&period=100&odd=%zz%4&plus=a+b";
        assert_eq!(query(text, "items").as_deref(), Some("DB10.DBW0\n\"Stärt\""));
        assert_eq!(query(text, "odd").as_deref(), Some("%zz%4"));
        assert_eq!(query(text, "plus").as_deref(), Some("a b"));
        assert_eq!(query(text, "none"), None);
        assert_eq!(query("a=%ff", "a").as_deref(), Some("\u{FFFD}"));
    }

    #[test]
    fn a_name_that_was_made_to_lead_here_is_no_name_of_ours() {
        let names = Names { hosts: vec!["press.plant".into()], origins: vec!["https://a.b:8443".into()] };
        for (host, known) in [
            ("127.0.0.1:8080", true),
            ("[::1]:8080", true),
            ("192.0.2.7", true),
            ("localhost:8080", true),
            ("Press.Plant:443", true),
            ("A.b:443", true),
            ("https", false),
            ("evil.example:8080", false),
            ("press.plant.evil.example", false),
            ("localhost.evil.example", false),
            ("127.0.0.1.evil.example:80", false),
            ("", false),
            ("press.plant@evil", false),
        ] {
            assert_eq!(names.has(host), known, "{host}");
        }
    }

    #[test]
    fn another_page_changes_nothing() {
        let names = Names { origins: vec!["https://press.plant".into()], ..Names::default() };
        let refused = |method: &Method, pairs: &[(&'static str, &str)]| {
            let mut headers = HeaderMap::new();
            for (name, value) in pairs {
                headers.append(*name, value.parse().expect("a value"));
            }
            stranger(&names, &headers, method, false).is_some()
        };
        let host = ("host", "127.0.0.1:8080");
        let own = ("origin", "http://127.0.0.1:8080");
        for (method, headers, wrong) in [
            (Method::GET, &[host][..], false),
            (Method::GET, &[], true),
            (Method::GET, &[host, host], true),
            (Method::GET, &[host, ("origin", "http://evil.example")], true),
            (Method::POST, &[host], true),
            (Method::POST, &[host, own], false),
            (Method::POST, &[host, ("origin", "null")], true),
            (Method::POST, &[host, ("origin", "https://127.0.0.1:8080")], true),
            (Method::POST, &[host, ("origin", "http://127.0.0.1:8081")], true),
            (Method::POST, &[host, own, ("sec-fetch-site", "cross-site")], true),
            (Method::POST, &[host, own, ("sec-fetch-site", "same-origin")], false),
            (Method::DELETE, &[("host", "evil.example"), ("origin", "http://evil.example")], true),
            (Method::POST, &[host, ("origin", "https://press.plant")], false),
            (Method::POST, &[("host", "press.plant"), ("origin", "https://press.plant")], false),
            (Method::POST, &[host, ("origin", "http://press.plant")], true),
            (Method::POST, &[host, ("origin", "https://press.plant.evil")], true),
            (Method::POST, &[host, ("origin", "https://press.plant"), ("sec-fetch-site", "same-site")], true),
        ] {
            assert_eq!(refused(&method, headers), wrong, "{method} {headers:?}");
        }
    }
}
