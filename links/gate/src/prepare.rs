//! Before the first thread: the doors with the broker's first messages, the needed files, and the fences.

use std::net::{Ipv4Addr, TcpListener};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

use crate::shared::{Audit, Memory, Tls, Users};
use ob1_access::Right;
use ob1_access::door::{Door, DoorError, Welcome};
use ob1_access::settings::{GateKind, GateSettings, WebSettings};
use ob1_process::{Confinement, Network};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use tracing::{error, warn};

/// Maximum data, in bytes.
const MEMORY: u64 = 1 << 30;
/// Descriptors: a client of OPC UA takes three.
const DESCRIPTORS: u64 = 4096;
/// The gate is restarted by itself, the runtime is not: when memory runs out, the gate is killed first.
const OOM_SCORE: i16 = 600;

/// A link that is ready to be served.
pub(crate) struct Ready {
    /// What its protocol is told; `None`: it is not served.
    pub(crate) told: Option<GateSettings>,
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
    for link in &links {
        let Some(told) = &link.told else { continue };
        // Folders, not files: renewal replaces a file by another of the same name.
        wanted.readable.extend(told.files().filter_map(|file| file.parent().map(Path::to_owned)));
        match &told.own {
            GateKind::Web(WebSettings { reports: Some(reports), .. }) => {
                if !reports.is_dir() {
                    let reports = reports.display();
                    warn!("{reports} is not a folder: create it and restart the gate to see reports there");
                }
                wanted.readable.push(reports.clone());
            }
            GateKind::Mqtt(_) => wanted.network = Network::Name,
            _ => {}
        }
        wanted.folders.extend(link.state.clone());
        wanted.ports.extend(link.inner.iter().filter_map(|inner| Some(inner.local_addr().ok()?.port())));
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

/// A link; if something it needs cannot be had, it is not served, and only its door is kept.
fn link(mut door: Door) -> Result<Ready, String> {
    let welcome = door.welcome().cloned().ok_or("no welcome")?;
    let told: GateSettings =
        serde_json::from_str(&welcome.config).map_err(|error| format!("the settings of the link: {error}"))?;
    let listeners = door.take_listeners();
    let (users, tls, audit, state) = match needs(&told, &welcome) {
        Ok(needs) => needs,
        Err(why) => {
            error!("{why}: this link is not served, the others are; correct it and start the station again");
            let (ceiling, audit) = (Right::Read, Audit::none(&welcome.link));
            let (listeners, inner) = (Vec::new(), Vec::new());
            let (told, users, tls, state) = (None, None, None, None);
            return Ok(Ready { told, ceiling, door, listeners, inner, users, tls, audit, state });
        }
    };
    let listeners: Vec<_> = listeners.into_iter().map(TcpListener::from).collect();
    let fronts = if matches!(told.own, GateKind::OpcUa(_)) { listeners.len() } else { 0 };
    let inner = (0..fronts).map(|_| inner()).collect::<Result<_, _>>();
    let inner = inner.map_err(|why| format!("link \"{}\": its inner port: {why}", welcome.link))?;
    Ok(Ready { told: Some(told), ceiling: welcome.rights, door, listeners, inner, users, tls, audit, state })
}

/// A port on loopback for the library behind a front.
fn inner() -> std::io::Result<TcpListener> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?;
    listener.set_nonblocking(true)?;
    Ok(listener)
}

/// What a link needs.
type Needs = (Option<Users>, Option<Tls>, Audit, Option<PathBuf>);

fn needs(told: &GateSettings, welcome: &Welcome) -> Result<Needs, String> {
    let named = |why: &dyn std::fmt::Display| format!("link \"{}\": {why}", welcome.link);
    let users = told.users.as_ref().map(|file| Users::read(file)).transpose().map_err(|why| named(&why))?;
    let tls = told.tls.as_ref().map(|(certificate, key)| Tls::load(certificate, key)).transpose();
    let tls = tls.map_err(|why| named(&why))?;
    // A link that only reads and has no users writes no log.
    let audit = if users.is_some() || welcome.rights > Right::Read {
        Audit::open(&welcome.link, &told.audit)
            .map_err(|why| named(&format!("the audit log {}: {why}", told.audit.display())))?
    } else {
        Audit::none(&welcome.link)
    };
    let mut state = told.state.clone();
    if let Some(folder) = &state
        && let Err(why) = std::fs::create_dir_all(folder)
    {
        let why = named(&format!("{}: {why}", folder.display()));
        if !matches!(told.own, GateKind::Web(_)) {
            return Err(why);
        }
        warn!("{why}: no variable table can be kept");
        state = None;
    }
    Ok((users, tls, audit, state))
}
