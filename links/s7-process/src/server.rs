//! The loop of the process: wait for the door, the listening sockets, the connections or a time, serve, wait again.

use std::cell::RefCell;
use std::net::{SocketAddr, TcpStream};
use std::os::fd::{AsFd as _, OwnedFd};
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use ob1_access::door::{Answer, Ask, Door, DoorError, News, Reading, Ticket, What};
use ob1_s7::iso::Refusal;
use ob1_s7::server::{Connection, CpuEvent};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use tracing::{debug, info, warn};

use crate::busy_wait::{BusyWait, SOON};
use crate::coupler::Coupler;
use crate::entries::Entries;
use crate::session::Session;
use crate::slots::{Verdict, admit, of};
use crate::sockets::{self, PAUSE, is_broken};
use crate::tap::{Shared, Tap};
use ob1_s7_process::asks::Surroundings;
use ob1_s7_process::config::Config;

/// Time between two signs of life.
const BEAT: Duration = Duration::from_millis(200);
const TICK: Duration = Duration::from_secs(1);
/// Maximum of connections without a call; a new one replaces the oldest.
const HALF_OPEN: usize = 64;
/// Time limit for the call.
const CALL: Duration = Duration::from_secs(10);
/// How long a call waits for a place before it is refused.
const PLACE: Duration = Duration::from_secs(4);
/// Maximum accepted per round, so that served connections get their turn.
const ACCEPTS: usize = 64;
/// Maximum of reported connections: as many as fit a message.
const TOLD: usize = 256;
/// The list of the newest entries of the diagnostic buffer.
const DIAGNOSTIC_BUFFER: u16 = 0x01A0;
/// Client number of the link's own requests.
const SELF: u32 = 0;

pub(crate) struct Server {
    door: Door,
    terminate: Arc<AtomicBool>,
    config: Option<Config>,
    listeners: Vec<OwnedFd>,
    /// Nothing is accepted before this time.
    deaf_until: Instant,
    sessions: Vec<Session>,
    reading: Reading,
    next: u32,
    start: Instant,
    beat: Instant,
    tick: Instant,
    buffer: Box<[u8; 16 * 1024]>,
    subscribed: bool,
    /// The connections as last reported.
    told: Vec<ob1_access::door::Connection>,
    /// Entries of the diagnostic buffer that must be read, and the question for them.
    entries: Entries,
    diagnosis: Option<Ticket>,
    /// The process is an Ethernet CP too.
    coupler: Option<Coupler>,
    tap: Shared,
    busy_wait: BusyWait,
    /// Where the session lies that was served last, if it was the only one. If another has its place by now, that one
    /// is read, which is as good.
    alone: Option<usize>,
}

/// The result of a wait.
#[derive(Default)]
struct Ready {
    /// The door has something to read, or takes more.
    door: bool,
    accept: Vec<usize>,
    /// Sessions, and whether their connection is broken.
    read: Vec<(usize, bool)>,
    /// The doorbell of the back plane has rung.
    rung: bool,
    /// Descriptors of the CP, in its order.
    coupler: Vec<PollFlags>,
}

impl Server {
    pub(crate) fn new(door: Door, terminate: Arc<AtomicBool>, coupler: Option<Coupler>) -> Self {
        let now = Instant::now();
        Self {
            door,
            terminate,
            config: None,
            listeners: Vec::new(),
            deaf_until: now,
            sessions: Vec::new(),
            reading: Reading::new(),
            next: SELF,
            start: now,
            beat: now,
            tick: now,
            buffer: Box::new([0; 16 * 1024]),
            subscribed: false,
            told: Vec::new(),
            entries: Entries::default(),
            diagnosis: None,
            coupler,
            tap: Rc::new(RefCell::new(Tap::new(now))),
            busy_wait: BusyWait::new(),
            alone: None,
        }
    }

    /// Runs until SIGTERM, or until the door is closed.
    pub(crate) fn run(&mut self) -> Result<(), DoorError> {
        let mut speaks = true;
        let mut now = Instant::now();
        while !self.terminate.load(Ordering::Relaxed) {
            self.times(now);
            if speaks {
                self.door.pump()?;
            }
            self.welcome();
            self.news(now);
            self.serve(now);
            // Requests made in between are sent before the wait.
            self.door.flush()?;
            if self.comes_at_once(now) {
                (speaks, now) = (false, Instant::now());
                continue;
            }
            let ready = self.wait()?;
            speaks = ready.door;
            now = Instant::now();
            self.alone = if let [(index, _)] = *ready.read { Some(index) } else { None };
            // Sessions come first: accepting may close one, and that moves others in the list.
            for (index, broken) in ready.read {
                if let Some(session) = self.sessions.get_mut(index) {
                    session.receive(&mut self.buffer, &self.tap, now);
                    if broken {
                        session.broken();
                    }
                }
            }
            self.accept(&ready.accept, now);
            if let Some(coupler) = &mut self.coupler {
                coupler.ready(&ready.coupler, now);
                if ready.rung && doorbell_closed()? {
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    fn welcome(&mut self) {
        if self.config.is_some() {
            return;
        }
        let Some(welcome) = self.door.welcome() else { return };
        let (station, link) = (welcome.station.clone(), welcome.link.clone());
        match Config::of(welcome) {
            Ok((config, connections)) => {
                info!(link, rack = config.place.rack, slot = config.place.slot, "serving");
                self.config = Some(config);
                self.listeners = self.door.take_listeners();
                if let Some(socket) = self.listeners.pop_if(|_| config.tap) {
                    self.tap.borrow_mut().open(socket, &station, &link);
                }
                if let Some(coupler) = &mut self.coupler {
                    // The first is the server's, the following ones belong to connections.
                    let sockets = self.listeners.split_off(self.listeners.len().min(1));
                    coupler.configure(&connections, config.settings, sockets.into_iter(), Rc::clone(&self.tap));
                }
            }
            Err(error) => {
                warn!("the settings of the link: {error}");
                self.terminate.store(true, Ordering::Relaxed);
            }
        }
    }

    fn times(&mut self, now: Instant) {
        if now >= self.beat {
            self.door.beat();
            self.tap.borrow_mut().admit();
            if let Some(coupler) = &mut self.coupler {
                coupler.beat();
            }
            self.beat = now + BEAT;
        }
        if now >= self.tick {
            self.door.tick();
            self.tick = now + TICK;
            self.tell_connections();
            let idle = self.config.and_then(|config| config.idle);
            let late = |session: &Session| session.resource.is_none() && now.duration_since(session.since) >= CALL;
            let silent = |session: &Session| idle.is_some_and(|idle| session.is_silent(idle, now));
            let gone: Vec<u32> =
                self.sessions.iter().filter(|s| late(s) || silent(s)).map(|session| session.number).collect();
            gone.into_iter().for_each(|number| self.close(number, "it has been silent for too long"));
        }
    }

    /// Reports the connections: tools that show the station see them at most a second late.
    fn tell_connections(&mut self) {
        let is_there = |session: &&Session| session.resource.is_some();
        let mut list: Vec<_> = self.sessions.iter().filter(is_there).map(Session::told).collect();
        list.extend(self.coupler.iter().flat_map(Coupler::told));
        list.truncate(TOLD);
        if list != self.told {
            self.door.connections(list.clone());
            self.told = list;
        }
    }

    fn news(&mut self, now: Instant) {
        let Some(config) = self.config else { return };
        while let Some(news) = self.door.take_news() {
            match &news {
                News::Event(event) => self.event(&event.what),
                News::Answer { client: SELF, ticket, answer } if self.diagnosis == Some(*ticket) => {
                    self.diagnosis = None;
                    let newest: &[u8] = if let Answer::Szl { bytes, .. } = answer { bytes } else { &[] };
                    for entry in self.entries.read(newest) {
                        self.sessions.iter_mut().for_each(|session| session.event(&CpuEvent::Diagnosis(entry)));
                    }
                    self.ask_for_entries();
                }
                News::Watching => {}
                News::Alarm { client, event } => {
                    match self.sessions.iter_mut().find(|session| session.number == *client) {
                        Some(session) => session.alarm(event.clone()),
                        None => self.door.handed(*client, event.number),
                    }
                }
                News::Written { client, .. } | News::Answer { client, .. } => {
                    let mut around =
                        Surroundings { door: &mut self.door, reading: &mut self.reading, config: &config, now };
                    if let Some(session) = self.sessions.iter_mut().find(|session| session.number == *client) {
                        session.news(&news, &mut around);
                    } else if let Some(coupler) = &mut self.coupler {
                        coupler.news(*client, &news, &mut around);
                    }
                }
            }
        }
    }

    fn event(&mut self, what: &What) {
        match what {
            What::State(state) => {
                let mode = CpuEvent::Mode(state.number());
                self.sessions.iter_mut().for_each(|session| session.event(&mode));
            }
            What::Diagnosis(entry) => {
                self.entries.report(entry.event);
                self.ask_for_entries();
            }
            _ => {}
        }
    }

    /// One question at a time.
    fn ask_for_entries(&mut self) {
        if self.diagnosis.is_none()
            && let Some(index) = self.entries.ask()
        {
            self.diagnosis = Some(self.door.ask(SELF, Ask::Szl { id: DIAGNOSTIC_BUFFER, index }));
        }
    }

    fn serve(&mut self, now: Instant) {
        let Some(config) = self.config else { return };
        self.calls(&config, now);
        let now_ms = u64::try_from(now.duration_since(self.start).as_millis()).unwrap_or(u64::MAX);
        let mut over = Vec::new();
        for session in &mut self.sessions {
            let mut around = Surroundings { door: &mut self.door, reading: &mut self.reading, config: &config, now };
            session.serve(&mut around, now_ms);
            if let Some((ends, socket)) = session.unannounced() {
                // Before they are written: if this process is killed, those that have arrived are not repeated.
                around.door.sending(session.number, ends, socket);
                let _ = around.door.flush();
            }
            session.send(&self.tap, now);
            if let Some(number) = session.handed() {
                around.door.handed(session.number, number);
            }
            if let Some(why) = session.over(now) {
                over.push((session.number, why));
            }
        }
        over.into_iter().for_each(|(number, why)| self.close(number, why));
        if let Some(coupler) = &mut self.coupler {
            let mut around = Surroundings { door: &mut self.door, reading: &mut self.reading, config: &config, now };
            let next = &mut self.next;
            coupler.serve(&mut around, &mut || number(next));
        }
        if !self.subscribed && self.sessions.iter().any(Session::wants_events) {
            self.door.ask(SELF, Ask::Events { after: u64::MAX });
            self.subscribed = true;
        }
    }

    /// Handles connections whose call has come.
    fn calls(&mut self, config: &Config, now: Instant) {
        // Those that go on waiting.
        let mut waiting = Vec::new();
        loop {
            let others: Vec<_> = self.sessions.iter().filter_map(|session| session.occupant(now)).collect();
            let calls = self.sessions.iter().enumerate().filter(|(_, s)| s.resource.is_none() && s.call().is_some());
            // Who has the fewest places gets the next one, then who waits longest.
            let next = calls
                .filter(|(_, session)| !waiting.contains(&session.number))
                .min_by_key(|(_, session)| (of(session.peer.ip(), &others), session.since, session.number));
            let Some(index) = next.map(|(index, _)| index) else { return };
            let Some(call) = self.sessions.get(index).and_then(|s| s.call()).cloned() else { return };
            if self.is_for_coupler(index, now) {
                continue;
            }
            let called = &call.called;
            // The TSAP of a connection is for its partner alone, unless it also names a CPU.
            let is_anothers = called.place().is_none() && self.coupler.as_ref().is_some_and(|cp| cp.has_tsap(called));
            let resource = called.resource();
            let Some(session) = self.sessions.get_mut(index) else { return };
            let (number, peer) = (session.number, session.peer);
            let verdict = admit(config.clients, resource, peer.ip(), &others);
            if call.is_elsewhere(config.place) {
                session.refuse(Refusal::Unknown);
                let place = config.place;
                info!("{peer} refused: it calls {called}, this CPU is in rack {} slot {}", place.rack, place.slot);
                continue;
            }
            if is_anothers {
                session.refuse(Refusal::Unknown);
                info!("{peer} refused: {called} is the TSAP of a connection with another partner");
                continue;
            }
            match verdict {
                Verdict::Full if now < *session.queued.get_or_insert(now + PLACE) => waiting.push(number),
                Verdict::Full => {
                    session.refuse(Refusal::Full);
                    info!("{peer} refused: all {} connections are taken", config.clients);
                }
                Verdict::Free | Verdict::InsteadOf(_) => {
                    session.accept(resource);
                    self.door.partner(number, peer.to_string());
                    debug!("{peer} connected to {called}");
                    if let Verdict::InsteadOf(other) = verdict {
                        self.close(other, "its place is needed");
                    }
                }
            }
        }
    }

    /// Passes a call for a connection of the CP to it.
    fn is_for_coupler(&mut self, index: usize, now: Instant) -> bool {
        let Some(coupler) = &mut self.coupler else { return false };
        let Some(session) = self.sessions.get(index) else { return false };
        let Some(connection) = session.call().and_then(|call| coupler.find(call, session.peer.ip())) else {
            return false;
        };
        let (socket, transport) = self.sessions.swap_remove(index).into_call();
        coupler.called(connection, socket, transport, now);
        true
    }

    fn close(&mut self, number: u32, why: &'static str) {
        let Some(index) = self.sessions.iter().position(|session| session.number == number) else { return };
        let session = self.sessions.swap_remove(index);
        session.end();
        let (pdu, jobs, errors) = session.summary();
        debug!(pdu, jobs, errors, "{} ended: {why}", session.peer);
        self.door.client_gone(number);
    }

    fn accept(&mut self, ready: &[usize], now: Instant) {
        let Some(config) = self.config else { return };
        for index in ready {
            for _ in 0..ACCEPTS {
                let Some(listener) = self.listeners.get(*index) else { break };
                let (socket, peer) = match sockets::accept(listener) {
                    Ok(Some(caller)) => caller,
                    Ok(None) => break,
                    Err(error) => {
                        warn!("no connection can be accepted at the moment: {error}");
                        self.deaf_until = now + PAUSE;
                        return;
                    }
                };
                self.open(socket, peer, &config, now);
            }
        }
    }

    fn open(&mut self, socket: OwnedFd, mut peer: SocketAddr, config: &Config, now: Instant) {
        // An IPv4 partner is shown by its own address, also on a socket for IPv6.
        peer.set_ip(peer.ip().to_canonical());
        let mut half_open = self.sessions.iter().filter(|session| session.resource.is_none());
        if half_open.clone().count() >= HALF_OPEN
            && let Some(oldest) = half_open.clone().map(|s| s.since).min()
            && let Some(number) = half_open.find(|s| s.since == oldest).map(|s| s.number)
        {
            self.close(number, "it has sent no connection request, and others wait");
        }
        let connection = Connection::new(config.settings);
        self.sessions.push(Session::new(number(&mut self.next), TcpStream::from(socket), peer, connection, now));
    }

    /// Whether the partner that was served last, alone, has something again, if it is one that asks at once.
    fn comes_at_once(&mut self, since: Instant) -> bool {
        if !self.busy_wait.is_awake() {
            return false;
        }
        let alone = self.alone.and_then(|index| self.sessions.get_mut(index));
        let Some(session) = alone.filter(|session| session.wants_read()) else { return false };
        loop {
            if session.receive(&mut self.buffer, &self.tap, since) {
                self.busy_wait.came();
                return true;
            }
            if since.elapsed() >= SOON {
                self.busy_wait.missed();
                return false;
            }
            std::thread::yield_now();
        }
    }

    fn wait(&mut self) -> Result<Ready, DoorError> {
        let sleeps = self.coupler.as_mut().is_none_or(Coupler::prepare_sleep);
        let ready = self.poll(sleeps);
        if let Some(coupler) = &mut self.coupler {
            coupler.awake();
        }
        ready
    }

    fn poll(&mut self, sleeps: bool) -> Result<Ready, DoorError> {
        let mut due = self.beat.min(self.tick);
        let mut fds = Vec::with_capacity(1 + self.listeners.len() + self.sessions.len());
        let door = if self.door.wants_write() { PollFlags::IN | PollFlags::OUT } else { PollFlags::IN };
        let door_fd = self.door.fd();
        fds.push(PollFd::from_borrowed_fd(door_fd, door));
        let now = Instant::now();
        let accepts = if now < self.deaf_until { PollFlags::empty() } else { PollFlags::IN };
        if accepts.is_empty() {
            due = due.min(self.deaf_until);
        }
        fds.extend(self.listeners.iter().map(|listener| PollFd::new(listener, accepts)));
        for session in &self.sessions {
            let mut flags = PollFlags::empty();
            flags.set(PollFlags::IN, session.wants_read());
            flags.set(PollFlags::OUT, session.wants_write());
            fds.push(PollFd::from_borrowed_fd(session.socket().as_fd(), flags));
            due = session.due(self.start).map_or(due, |at| at.min(due));
        }
        let sessions = fds.len();
        let stdin = rustix::stdio::stdin();
        if let Some(coupler) = &self.coupler {
            fds.push(PollFd::from_borrowed_fd(stdin, PollFlags::IN));
            coupler.poll_fds(&mut fds, now);
            due = coupler.due().map_or(due, |at| at.min(due));
        }
        let timeout = if sleeps { due.saturating_duration_since(now) } else { Duration::ZERO };
        match poll(&mut fds, Timespec::try_from(timeout).ok().as_ref()) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(error) => return Err(std::io::Error::from(error).into()),
        }
        self.busy_wait.slept(now.elapsed());
        let mut ready = Ready { door: fds.first().is_some_and(|fd| !fd.revents().is_empty()), ..Ready::default() };
        let listeners = 1 + self.listeners.len();
        ready.rung = fds.get(sessions).is_some_and(|fd| !fd.revents().is_empty());
        ready.coupler = fds.iter().skip(sessions + 1).map(PollFd::revents).collect();
        for (index, fd) in fds.iter().enumerate().take(sessions).skip(1).filter(|(_, fd)| !fd.revents().is_empty()) {
            match index.checked_sub(listeners) {
                None => ready.accept.push(index - 1),
                Some(session) => ready.read.push((session, is_broken(fd.revents()))),
            }
        }
        Ok(ready)
    }
}

/// Each number is used once, so that no connection gets the rights of an earlier one.
fn number(next: &mut u32) -> u32 {
    *next = next.checked_add(1).unwrap_or(SELF + 1);
    *next
}

/// Reads the doorbell; true if it has been closed.
fn doorbell_closed() -> Result<bool, DoorError> {
    let mut rings = [0; 64];
    match rustix::io::read(rustix::stdio::stdin(), &mut rings) {
        Ok(0) => Ok(true),
        Ok(_) | Err(Errno::AGAIN | Errno::INTR) => Ok(false),
        Err(error) => Err(std::io::Error::from(error).into()),
    }
}
