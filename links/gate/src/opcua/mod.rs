//! OPC UA of a station: namespace 2 has the cells under the names of the tools (`ns=2;s=MW10`), data blocks as objects
//! from their declarations, diagnostic events, and methods for the operating state (docs/opcua.md).
//!
//! async-opcua implements the protocol; the nodes, their values and who may change them are decided here and in
//! `shared`. No node is stored: the program's catalog determines which exist.

mod attributes;
mod auth;
mod bounded;
mod chunks;
mod client_places;
mod events;
mod front;
mod leave;
mod limits;
mod manager;
mod monitor;
mod nodes;
mod pki;
mod publish_times;
mod range;
mod sample;
mod space;
mod value;
mod watched;

use std::net::{IpAddr, SocketAddr, TcpListener};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::shared::{Link, Memory, Station, unix_now};
use ob1_access::settings::{OpcUaSettings, Trust};
use ob1_access::{Allowed, Cell, Piece};
use ob1_model::Area;
use opcua_crypto::SecurityPolicy;
use opcua_server::node_manager::ServerContext;
use opcua_server::{ANONYMOUS_USER_TOKEN_ID, Server, ServerBuilder, ServerEndpoint, ServerHandle};
use opcua_types::{BuildInfo, DateTime, MessageSecurityMode, VariableId, Variant};
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinSet;

use crate::opcua::auth::Auth;
use crate::opcua::client_places::Seats;
use crate::opcua::front::Front;
use crate::opcua::manager::Manager;
use crate::opcua::monitor::Monitor;
use crate::opcua::pki::Pki;

/// How often to check whether a server must be restarted.
const LOOK: Duration = Duration::from_secs(1);
/// How often to check whether memory is short: a stranger can send some ten megabytes in between.
const MEMORY_LOOK: Duration = Duration::from_millis(20);
/// Milliseconds by which the clock may be set back without a restart.
const BACK: u64 = 1_000;
/// Time a server has for its last messages.
const GOODBYE: Duration = Duration::from_millis(500);
/// The library recurses into nested values without a limit: this stack is enough for a whole chunk of them.
const STACK: usize = 64 << 20;
/// Threads for passwords, per server.
const HELPERS: usize = 2;

/// Serves a link until its station is gone.
///
/// # Errors
/// What is wrong with its files or its sockets.
pub(crate) async fn serve(link: Link, told: OpcUaSettings) -> Result<(), String> {
    let Link { station, listeners, inner, users, state, memory, .. } = link;
    let addresses = listeners.iter().map(TcpListener::local_addr).collect::<Result<Vec<_>, _>>();
    let addresses = addresses.map_err(|error| error.to_string())?;
    let open = addresses.iter().all(|address| address.ip().is_loopback());
    let state: PathBuf = state.ok_or("it has no folder for its certificates")?.join(&station.welcome().link);
    let name = format!("ob1 {}", station.welcome().station);
    let uri = format!("urn:ob1:{}:{}", station.welcome().station, station.welcome().link);
    let first = *addresses.first().ok_or("it needs `listen`")?;
    let made = {
        let (name, uri) = (name.clone(), uri.clone());
        tokio::task::spawn_blocking(move || pki::open(&state, &name, &uri, first.ip())).await
    };
    let pki = made.map_err(|error| error.to_string())??;
    let auth = Arc::new(Auth::new(users, told.anonymous.unwrap_or(open), station.audit().clone()));
    let about = Arc::new(About { station, told, open, auth, pki, memory, name, uri });
    let mut servers = JoinSet::new();
    if inner.len() < listeners.len() {
        return Err("it has no sockets for its front".to_owned());
    }
    for ((listener, inner), address) in listeners.into_iter().zip(inner).zip(addresses) {
        let about = Arc::clone(&about);
        servers.spawn(async move { about.keep(&listener, &inner, address).await });
    }
    while let Some(ended) = servers.join_next().await {
        ended.map_err(|error| error.to_string())??;
    }
    Ok(())
}

/// The common data of all servers of a link.
struct About {
    station: Station,
    told: OpcUaSettings,
    /// Whether a channel without security is offered: only on loopback.
    open: bool,
    auth: Arc<Auth>,
    pki: Pki,
    memory: Memory,
    name: String,
    uri: String,
}

impl About {
    fn clients(&self) -> usize {
        self.told.clients.unwrap_or(limits::CLIENTS)
    }

    fn items(&self) -> usize {
        self.told.items.unwrap_or(limits::ITEMS)
    }

    /// Keeps a server running at a socket until the station is gone. The library never frees all of a deleted item, so
    /// the server is restarted after many deletions. It is also restarted when memory runs short, whatever uses it,
    /// when the clock is set back, and when a task has panicked.
    async fn keep(&self, listener: &TcpListener, inner: &TcpListener, address: SocketAddr) -> Result<(), String> {
        loop {
            let monitor = Arc::new(Monitor::new(self.items(), heartbeat(&self.told.allowed)));
            let seats = Arc::new(Seats::new(self.clients()));
            let (server, handle) = self.server(address, &monitor, &seats)?;
            let socket = |socket: &TcpListener| socket.try_clone().map_err(|error| format!("{address}: {error}"));
            let sockets = Sockets { outer: socket(listener)?, inner: socket(inner)?, url: url(address) };
            let front = (sockets, seats, self.open);
            let mut running = Running::begin(server, &handle, front, Arc::clone(&monitor))?;
            let why = tokio::select! {
                () = monitor.gone() => None,
                () = worn(&monitor, &handle, &self.pki) => Some("many items have been deleted"),
                () = short(&self.memory) => Some("its clients have taken too much memory"),
                () = set_back() => Some("the clock was set back, and values would wait until it has caught up"),
                () = monitor.failed() => Some("a part of it has failed: see above"),
                ended = &mut running.ended => return ended.unwrap_or_else(|_| Err("the OPC UA server has failed".into())),
            };
            handle.cancel();
            running.end().await;
            monitor.stop();
            let Some(why) = why else { return Ok(()) };
            tracing::warn!(link = %self.station.welcome().link, "the OPC UA server is restarted: {why}");
        }
    }

    fn server(
        &self,
        address: SocketAddr,
        monitor: &Arc<Monitor>,
        seats: &Arc<Seats>,
    ) -> Result<(Server, ServerHandle), String> {
        let host = host(address.ip(), opcua_crypto::hostname().ok());
        let mut builder = ServerBuilder::new()
            .application_name(&self.name)
            .application_uri(&self.uri)
            .product_uri("urn:ob1")
            .build_info(BuildInfo {
                product_uri: "urn:ob1".into(),
                manufacturer_name: "ob1".into(),
                product_name: "ob1".into(),
                software_version: env!("CARGO_PKG_VERSION").into(),
                build_number: env!("CARGO_PKG_VERSION").into(),
                build_date: DateTime::null(),
            })
            .pki_dir(&self.pki.folder)
            .certificate_path(&self.pki.certificate)
            .private_key_path(&self.pki.key)
            .trust_client_certs(self.told.trust == Trust::Any)
            .check_cert_time(true)
            .host(host)
            .port(address.port())
            .discovery_urls(vec![url(address)])
            .limits(limits::limits(self.clients(), self.items()))
            .subscription_poll_interval_ms(limits::POLL_MS)
            .max_session_timeout_ms(limits::SESSION_MS)
            .max_timeout_ms(limits::SESSION_MS as u32)
            .diagnostics_enabled(true)
            .with_authenticator(Arc::clone(&self.auth) as Arc<_>);
        for (name, endpoint) in endpoints(self.open) {
            builder = builder.add_endpoint(name, endpoint);
        }
        let (station, auth) = (self.station.clone(), Arc::clone(&self.auth));
        let (monitor, allowed, seats) = (Arc::clone(monitor), self.told.allowed.clone(), Arc::clone(seats));
        let built = builder
            .with_node_manager(move |context: ServerContext| {
                Manager::new(station, auth, (monitor, seats), allowed, &context)
            })
            .build()?;
        *built.1.info().type_loaders.write() = bounded::loaders();
        Ok(built)
    }
}

/// The sockets of a server: where clients connect, and where the library listens; and the address for clients.
struct Sockets {
    outer: TcpListener,
    inner: TcpListener,
    url: String,
}

/// A server with its front, in a thread and a runtime of its own: when it ends, all its memory is freed, whatever its
/// clients do.
struct Running {
    ended: oneshot::Receiver<Result<(), String>>,
    /// Dropping it ends the server at once.
    hold: oneshot::Sender<()>,
}

impl Running {
    fn begin(
        server: Server,
        handle: &ServerHandle,
        (sockets, seats, open): (Sockets, Arc<Seats>, bool),
        monitor: Arc<Monitor>,
    ) -> Result<Self, String> {
        let (to, ended) = oneshot::channel();
        let (hold, let_go) = oneshot::channel::<()>();
        let (subscriptions, handle) = (Arc::clone(handle.subscriptions()), handle.clone());
        let run = move || {
            let runtime = tokio::runtime::Builder::new_current_thread()
                .enable_all()
                .max_blocking_threads(HELPERS)
                .thread_name("ob1-gate-helper")
                .build()?;
            let ended = runtime.block_on(async {
                let Sockets { outer, inner, url } = sockets;
                let (at, inner) = (inner.local_addr()?, tokio::net::TcpListener::from_std(inner)?);
                let listener = tokio::net::TcpListener::from_std(outer)?;
                let (leaves, left) = mpsc::channel(limits::WAITING);
                let front = Front { listener, inner: at, open, seats, handle: handle.clone(), ended: leaves };
                let (ended, over) = oneshot::channel::<()>();
                let intervals = || monitor.intervals(&subscriptions);
                let served = async {
                    let served = publish_times::conduct(server.run_with(inner), monitor.pace(), intervals).await;
                    drop(ended);
                    served
                };
                tokio::spawn(leave::see_off(handle, at, url, left));
                // The front ends after the server, with the last words of it.
                let both = async { tokio::join!(served, front.run(over)).0 };
                tokio::select! {
                    ended = both => ended.map_err(std::io::Error::other),
                    _ = let_go => Ok(()),
                }
            });
            runtime.shutdown_background();
            ended
        };
        let thread = std::thread::Builder::new().name("ob1-gate-opcua".to_owned()).stack_size(STACK);
        let thread = thread.spawn(move || drop(to.send(run().map_err(|error| error.to_string()))));
        thread.map_err(|error| error.to_string())?;
        Ok(Self { ended, hold })
    }

    /// Waits a moment while it closes the connections of its clients.
    async fn end(mut self) {
        if tokio::time::timeout(GOODBYE, &mut self.ended).await.is_err() {
            drop(self.hold);
            let _ = self.ended.await;
        }
    }
}

/// The host in the addresses of a server. Many clients connect to the address that the server tells them, and nobody
/// reaches 0.0.0.0: a server on all addresses tells the name of the machine.
fn host(address: IpAddr, machine: Option<String>) -> String {
    let legal = |name: &String| {
        !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_alphanumeric() || b".-_".contains(&byte))
    };
    match address {
        _ if address.is_unspecified() => machine.filter(legal).unwrap_or_else(|| "localhost".to_owned()),
        IpAddr::V4(address) => address.to_string(),
        IpAddr::V6(address) => format!("[{address}]"),
    }
}

/// The address that a server tells its clients.
fn url(address: SocketAddr) -> String {
    format!("opc.tcp://{}:{}/", host(address.ip(), opcua_crypto::hostname().ok()), address.port())
}

/// A byte of the first area that the link may read.
fn heartbeat(allowed: &Allowed) -> Option<Piece> {
    let cells = [Area::Memory, Area::Input, Area::Output].map(|area| Cell::Area(area, 0));
    cells.into_iter().find(|cell| allowed.has(*cell)).map(|at| Piece::Bytes { at, len: 1 })
}

/// The endpoints: the current policies, and on loopback one without security. None with SHA-1 signatures.
fn endpoints(open: bool) -> Vec<(String, ServerEndpoint)> {
    let anonymous: &[&str] = &[ANONYMOUS_USER_TOKEN_ID];
    let mut all = Vec::new();
    for policy in
        [SecurityPolicy::Basic256Sha256, SecurityPolicy::Aes128Sha256RsaOaep, SecurityPolicy::Aes256Sha256RsaPss]
    {
        for mode in [MessageSecurityMode::Sign, MessageSecurityMode::SignAndEncrypt] {
            all.push((format!("{policy} {mode}"), ServerEndpoint::from(("/", policy, mode, anonymous))));
        }
    }
    if open {
        let mut endpoint = ServerEndpoint::from(("/", SecurityPolicy::None, MessageSecurityMode::None, anonymous));
        endpoint.password_security_policy = Some(SecurityPolicy::Basic256Sha256.to_string());
        all.push(("open".to_owned(), endpoint));
    }
    all
}

/// Waits until enough items have been deleted to restart the server.
async fn worn(monitor: &Monitor, handle: &ServerHandle, pki: &Pki) {
    loop {
        tokio::time::sleep(LOOK).await;
        pki::prune(&pki.folder);
        let sessions = VariableId::Server_ServerDiagnostics_ServerDiagnosticsSummary_CurrentSessionCount;
        let sessions = handle.info().diagnostics.get(sessions).and_then(|value| value.value);
        let idle = matches!(sessions, Some(Variant::UInt32(0)));
        let deleted = monitor.deleted();
        if deleted >= limits::RENEW_ANYWAY || idle && deleted >= limits::RENEW_IDLE {
            return;
        }
    }
}

/// Waits until the clock is set back. The library measures sampling intervals by the timestamps of the values.
async fn set_back() {
    loop {
        let (before, at) = (unix_now(), Instant::now());
        tokio::time::sleep(LOOK).await;
        if is_back(before, at.elapsed(), unix_now()) {
            return;
        }
    }
}

fn is_back(before: u64, passed: Duration, now: u64) -> bool {
    now.saturating_add(BACK) < before.saturating_add(passed.as_millis() as u64)
}

/// Waits until memory is short.
async fn short(memory: &Memory) {
    while !memory.is_short() {
        tokio::time::sleep(MEMORY_LOOK).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_that_is_set_back_is_noticed() {
        let second = Duration::from_secs(1);
        for (before, passed, now, back) in [
            (10_000, second, 11_000, false),
            (10_000, second, 10_500, false),
            (10_000, second, 9_900, true),
            (10_000, second, 3_700_000, false),
            (10_000, second * 60, 70_000, false),
            (10_000, second, 0, true),
        ] {
            assert_eq!(is_back(before, passed, now), back, "{before} {passed:?} {now}");
        }
    }

    #[test]
    fn a_server_tells_an_address_that_clients_reach() {
        for (address, machine, told) in [
            ("127.0.0.1", Some("press"), "127.0.0.1"),
            ("::1", Some("press"), "[::1]"),
            ("0.0.0.0", Some("press"), "press"),
            ("::", Some("press-3.plant"), "press-3.plant"),
            ("0.0.0.0", Some("a/b"), "localhost"),
            ("::", None, "localhost"),
        ] {
            let ip = address.parse().expect("an address");
            assert_eq!(host(ip, machine.map(str::to_owned)), told, "{address} {machine:?}");
        }
    }

    #[test]
    fn beyond_loopback_nothing_goes_without_security_or_with_old_policies() {
        let policies = |open| endpoints(open).into_iter().map(|(_, e)| e.security_policy).collect::<Vec<_>>();
        let far = policies(false);
        assert!(!far.is_empty());
        for policy in far.iter().chain(&policies(true)[..6]) {
            assert!(!["None", "Basic256", "Basic128Rsa15"].contains(&policy.as_str()), "{policy}");
        }
        assert_eq!(policies(true).iter().filter(|policy| *policy == "None").count(), 1);
    }
}
