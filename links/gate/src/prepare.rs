//! Before the first thread: the doors with the broker's first messages, the needed files, and the fences.

use std::net::{Ipv4Addr, TcpListener};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

use ob1_access::Right;
use ob1_access::door::{Door, DoorError, Welcome};
use ob1_gate_core::{Audit, Memory, Tls, Users};
use ob1_process::{Confinement, Network};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use serde_json::Value;
use tracing::{error, warn};

/// Maximum data, in bytes.
const MEMORY: u64 = 1 << 30;
/// Descriptors: a client of OPC UA takes three.
const DESCRIPTORS: u64 = 4096;
/// The gate is restarted by itself, the runtime is not: when memory runs out, the gate is killed first.
const OOM_SCORE: i16 = 600;

/// A link that is ready to be served.
pub(crate) struct Ready {
    pub(crate) kind: String,
    pub(crate) door: Door,
    pub(crate) ceiling: Right,
    pub(crate) listeners: Vec<TcpListener>,
    /// For each of them one that only this process connects to, for a link with a front.
    pub(crate) inner: Vec<TcpListener>,
    pub(crate) users: Option<Users>,
    pub(crate) tls: Option<Tls>,
    pub(crate) audit: Audit,
    pub(crate) state: Option<PathBuf>,
}

/// Waits for the doors of all links, and for the broker's first message on each.
pub(crate) fn doors(input: &OwnedFd) -> Result<Vec<Door>, DoorError> {
    let wait = |fd: std::os::fd::BorrowedFd<'_>| {
        // An interrupted wait just ends early.
        let _ = poll(&mut [PollFd::from_borrowed_fd(fd, PollFlags::IN)], None);
    };
    let mut doors = loop {
        if let Some(doors) = Door::several(input)? {
            break doors;
        }
        wait(std::os::fd::AsFd::as_fd(input));
    };
    for door in &mut doors {
        door.pump()?;
        while door.welcome().is_none() {
            wait(door.fd());
            door.pump()?;
        }
    }
    Ok(doors)
}

/// Opens what each link needs, then confines the process.
pub(crate) fn links(doors: Vec<Door>) -> Result<(Vec<Ready>, Memory), String> {
    let memory = Memory::open(MEMORY);
    let mut links = doors.into_iter().map(link).collect::<Result<Vec<_>, _>>()?;
    let mut wanted = Confinement { events: true, memory: MEMORY, oom_score: OOM_SCORE, ..Confinement::default() };
    for link in links.iter().filter(|link| !link.kind.is_empty()) {
        let keys = keys(&link.door)?;
        // Folders, not files: renewal replaces a file by another of the same name.
        let of = |key: &str| path(&keys, key).and_then(|path| path.parent().map(Path::to_owned));
        wanted.readable.extend(["users", "certificate", "key", "ca", "password_file"].into_iter().filter_map(of));
        if let Some(reports) = path(&keys, "reports") {
            if !reports.is_dir() {
                warn!("{} is not a folder: create it and restart the gate to see reports there", reports.display());
            }
            wanted.readable.push(reports);
        }
        wanted.folders.extend(link.state.clone());
        wanted.ports.extend(link.inner.iter().filter_map(|inner| Some(inner.local_addr().ok()?.port())));
        if link.kind == "mqtt" {
            wanted.network = Network::Name;
        }
    }
    more_descriptors();
    let refused = ob1_process::confine(&wanted);
    refused.iter().for_each(|(what, why)| warn!("not confined, {what}: {why}"));
    // Without fences an intruder must gain as little as possible.
    if refused.iter().any(|(what, _)| matches!(*what, "landlock" | "seccomp" | "no new privileges")) {
        error!("this process cannot be confined here: every link is read only, and only from this machine");
        for link in &mut links {
            link.ceiling = Right::Read;
            link.listeners.retain(|listener| {
                listener.local_addr().is_ok_and(|address| address.ip().to_canonical().is_loopback())
            });
        }
    }
    Ok((links, memory))
}

/// Raises the limit of descriptors to [`DESCRIPTORS`], or as far as it goes.
fn more_descriptors() {
    let limit = getrlimit(Resource::Nofile);
    let wanted = limit.maximum.map_or(DESCRIPTORS, |most| most.min(DESCRIPTORS));
    if limit.current.is_some_and(|current| current < wanted) {
        let _ = setrlimit(Resource::Nofile, Rlimit { current: Some(wanted), ..limit });
    }
}

fn keys(door: &Door) -> Result<Value, String> {
    let config = door.welcome().map_or("", |welcome| &welcome.config);
    serde_json::from_str(config).map_err(|error| format!("the keys of the link: {error}"))
}

fn path(keys: &Value, key: &str) -> Option<PathBuf> {
    keys.get(key).and_then(Value::as_str).map(PathBuf::from)
}

/// A link; if something it needs cannot be had, it is of no kind, and only its door is kept.
fn link(mut door: Door) -> Result<Ready, String> {
    let keys = keys(&door)?;
    let welcome = door.welcome().cloned().ok_or("no welcome")?;
    let listeners = door.take_listeners();
    let (users, tls, audit, state) = match needs(&keys, &welcome) {
        Ok(needs) => needs,
        Err(why) => {
            error!("{why}: this link is not served, the others are; correct it and start the station again");
            let (ceiling, audit) = (Right::Read, Audit::none(&welcome.link));
            let (kind, listeners) = (String::new(), Vec::new());
            let (inner, users, tls, state) = (Vec::new(), None, None, None);
            return Ok(Ready { kind, ceiling, door, listeners, inner, users, tls, audit, state });
        }
    };
    let listeners: Vec<_> = listeners.into_iter().map(TcpListener::from).collect();
    let kind = keys.get("type").and_then(Value::as_str).unwrap_or_default().to_owned();
    let fronts = if kind == "opcua" { listeners.len() } else { 0 };
    let inner = (0..fronts).map(|_| inner()).collect::<Result<_, _>>();
    let inner = inner.map_err(|why| format!("link \"{}\": its inner port: {why}", welcome.link))?;
    Ok(Ready { kind, ceiling: welcome.rights, door, listeners, inner, users, tls, audit, state })
}

/// A port on loopback for the library behind a front.
fn inner() -> std::io::Result<TcpListener> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
    listener.set_nonblocking(true)?;
    Ok(listener)
}

/// What a link needs.
type Needs = (Option<Users>, Option<Tls>, Audit, Option<PathBuf>);

fn needs(keys: &Value, welcome: &Welcome) -> Result<Needs, String> {
    let named = |why: &dyn std::fmt::Display| format!("link \"{}\": {why}", welcome.link);
    let users = path(keys, "users").map(|file| Users::read(&file)).transpose().map_err(|why| named(&why))?;
    let tls = match (path(keys, "certificate"), path(keys, "key")) {
        (Some(certificate), Some(key)) => Some(Tls::load(&certificate, &key).map_err(|why| named(&why))?),
        _ => None,
    };
    // A link that only reads and has no users writes no log.
    let audit = match path(keys, "audit").filter(|_| users.is_some() || welcome.rights > Right::Read) {
        Some(file) => Audit::open(&welcome.link, &file)
            .map_err(|why| named(&format!("the audit log {}: {why}", file.display())))?,
        None => Audit::none(&welcome.link),
    };
    let mut state = path(keys, "state");
    if let Some(folder) = &state
        && let Err(why) = std::fs::create_dir_all(folder)
    {
        let why = named(&format!("{}: {why}", folder.display()));
        if keys["type"] != "web" {
            return Err(why);
        }
        warn!("{why}: no variable table can be kept");
        state = None;
    }
    Ok((users, tls, audit, state))
}
