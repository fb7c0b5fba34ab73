//! One connection: its socket, its machine, its requests.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::os::fd::{AsFd as _, OwnedFd};
use std::time::{Duration, Instant};

use ob1_access::door::{self, News};
use ob1_model::AlarmEvent;
use ob1_s7::iso::{Call, Refusal, Resource, Transport};
use ob1_s7::server::{Connection, CpuEvent, End};
use ob1_s7::tap::Tapped;
use ob1_serial::tap_record::Kind;

use crate::slots::Occupant;
use crate::tap::Shared;
use ob1_s7_process::asks::{Asks, Surroundings};

/// Bytes read at a time.
const READ: usize = 16 * 1024;
/// A partner that takes nothing for this long is dropped.
const STUCK: Duration = Duration::from_secs(30);
/// Time limit for the end, while the last answer is sent.
const FAREWELL: Duration = Duration::from_secs(1);

/// A change of an alarm under way: its number, and how many bytes of the connection are written when it is.
type AlarmEnd = (u64, u64);

#[derive(Debug)]
pub(crate) struct Session {
    pub(crate) number: u32,
    pub(crate) peer: SocketAddr,
    /// Its kind, once it has been accepted.
    pub(crate) resource: Option<Resource>,
    pub(crate) since: Instant,
    /// Its call waits for a place until then.
    pub(crate) queued: Option<Instant>,
    /// The TSAP it has called.
    tsap: String,
    socket: TcpStream,
    connection: Connection,
    asks: Asks,
    /// Bytes written to the socket.
    written: u64,
    /// Changes of alarms under way.
    alarms: VecDeque<AlarmEnd>,
    /// The broker knows of the changes up to this one.
    announced: u64,
    heard: Instant,
    moved: Instant,
    works: bool,
    gone: bool,
    ends_by: Option<Instant>,
}

impl Session {
    pub(crate) fn new(number: u32, socket: TcpStream, peer: SocketAddr, connection: Connection, now: Instant) -> Self {
        Self {
            number,
            peer,
            resource: None,
            since: now,
            queued: None,
            tsap: String::new(),
            socket,
            connection,
            asks: Asks::default(),
            written: 0,
            alarms: VecDeque::new(),
            announced: 0,
            heard: now,
            moved: now,
            works: false,
            gone: false,
            ends_by: None,
        }
    }

    pub(crate) fn socket(&self) -> &TcpStream {
        &self.socket
    }

    /// The connection, for tools that show the station.
    pub(crate) fn told(&self) -> door::Connection {
        let (pdu, jobs, errors) = self.summary();
        let state = match self.connection.pdu() {
            Some(_) if self.connection.under_way() > 0 => "at work",
            Some(_) => "up",
            None => "coming",
        };
        let name = self.tsap.clone();
        door::Connection { partner: self.peer.to_string(), name, state: state.into(), pdu, jobs, errors }
    }

    pub(crate) fn call(&self) -> Option<&Call> {
        self.connection.call()
    }

    /// The socket, and the transport with the call, for the connection that it is meant for.
    pub(crate) fn into_call(self) -> (TcpStream, Transport) {
        (self.socket, self.connection.into_transport())
    }

    pub(crate) fn accept(&mut self, resource: Resource) {
        self.tsap = self.call().map(|call| call.called.to_string()).unwrap_or_default();
        self.resource = Some(resource);
        self.connection.accept();
    }

    pub(crate) fn refuse(&mut self, why: Refusal) {
        self.queued = None;
        self.connection.refuse(why);
    }

    /// Whether it can take input.
    pub(crate) fn wants_read(&self) -> bool {
        self.connection.room() > 0
    }

    pub(crate) fn wants_write(&self) -> bool {
        !self.connection.output().is_empty()
    }

    pub(crate) fn wants_events(&self) -> bool {
        self.connection.wants_events()
    }

    pub(crate) fn occupant(&self, now: Instant) -> Option<Occupant> {
        let waits = self.connection.waits();
        let silent = now.saturating_duration_since(self.heard);
        self.resource.map(|resource| Occupant {
            number: self.number,
            address: self.peer.ip(),
            resource,
            works: self.works,
            waits,
            guesses: self.connection.guesses(),
            silent,
        })
    }

    /// Whether it has been silent for this long, and waits for nothing.
    pub(crate) fn is_silent(&self, idle: Duration, now: Instant) -> bool {
        !self.connection.waits() && now.saturating_duration_since(self.heard) >= idle
    }

    /// For the log: the PDU, jobs, errors.
    pub(crate) fn summary(&self) -> (u16, u64, u64) {
        let counts = self.connection.counts();
        (self.connection.pdu().unwrap_or(0), counts.jobs, counts.errors)
    }

    fn tapped(&self) -> Tapped {
        Tapped::of(self.number, self.peer, false)
    }

    /// Receives data, as much as the machine has room for. Returns whether something came, if only the end.
    pub(crate) fn receive(&mut self, buffer: &mut [u8; READ], tap: &Shared, now: Instant) -> bool {
        let room = self.connection.room().min(READ);
        if room == 0 {
            return false;
        }
        match self.socket.read(&mut buffer[..room]) {
            Ok(0) => self.gone = true,
            Ok(len) => {
                self.heard = now;
                tap.borrow_mut().tell(Kind::In, || self.tapped(), &buffer[..len]);
                self.connection.receive(&buffer[..len]);
                // Setup alone does not count as work.
                self.works |= self.connection.counts().jobs > 1;
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => return false,
            Err(_) => self.gone = true,
        }
        true
    }

    /// The partner has broken the connection off. If nothing is read at the moment, this is its end.
    pub(crate) fn broken(&mut self) {
        self.gone |= !self.wants_read();
    }

    /// Serves the requests of the machine as far as possible now.
    pub(crate) fn serve(&mut self, around: &mut Surroundings<'_>, now_ms: u64) {
        if self.connection.next_tick().is_some_and(|due| due <= now_ms) {
            self.connection.tick(now_ms);
        }
        loop {
            let mut any = false;
            while let Some(request) = self.connection.next_ask() {
                self.asks.push(request);
                any = true;
            }
            let connection = &mut self.connection;
            self.asks.step(self.number, around, &mut |id, reply| {
                connection.reply(id, reply);
                any = true;
            });
            if !any {
                return;
            }
        }
    }

    pub(crate) fn news(&mut self, news: &News, around: &mut Surroundings<'_>) {
        let connection = &mut self.connection;
        self.asks.news(self.number, news, around, &mut |id, reply| connection.reply(id, reply));
    }

    pub(crate) fn event(&mut self, event: &CpuEvent) {
        self.connection.event(event);
    }

    /// A change of an alarm, for a partner that has logged on.
    pub(crate) fn alarm(&mut self, event: Box<AlarmEvent>) {
        let number = event.number;
        self.connection.event(&CpuEvent::Alarm(event));
        self.alarms.push_back((number, self.written + self.connection.output().len() as u64));
    }

    /// Changes of alarms that [`Session::send`] may write and the broker does not know of; before the first, with the
    /// socket.
    pub(crate) fn unannounced(&mut self) -> Option<(Vec<AlarmEnd>, Option<OwnedFd>)> {
        let from = self.alarms.partition_point(|(number, _)| *number <= self.announced);
        let ends: Vec<_> = self.alarms.range(from..).copied().collect();
        let (newest, _) = *ends.last()?;
        let is_first = std::mem::replace(&mut self.announced, newest) == 0;
        let socket = is_first.then(|| self.socket.as_fd().try_clone_to_owned().ok()).flatten();
        Some((ends, socket))
    }

    /// The last change of an alarm that is with the system since the last question.
    pub(crate) fn handed(&mut self) -> Option<u64> {
        let count = self.alarms.iter().take_while(|(_, by)| *by <= self.written).count();
        self.alarms.drain(..count).next_back().map(|(number, _)| number)
    }

    /// Sends what it can.
    pub(crate) fn send(&mut self, tap: &Shared, now: Instant) {
        if self.connection.output().is_empty() {
            self.moved = now;
        }
        while !self.connection.output().is_empty() && !self.gone {
            match self.socket.write(self.connection.output()) {
                Ok(0) => self.gone = true,
                Ok(len) => {
                    self.moved = now;
                    self.written += len as u64;
                    let sent = self.connection.output().get(..len).unwrap_or_default();
                    tap.borrow_mut().tell(Kind::Out, || self.tapped(), sent);
                    self.connection.sent(len);
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                Err(_) => self.gone = true,
            }
        }
    }

    /// Ends the connection: the broker may hold its socket as well.
    pub(crate) fn end(&self) {
        let _ = self.socket.shutdown(Shutdown::Both);
    }

    /// Why the session has ended, if it has.
    pub(crate) fn over(&mut self, now: Instant) -> Option<&'static str> {
        if self.gone {
            return Some("closed by the partner");
        }
        if let Some(end) = self.connection.end() {
            let by = *self.ends_by.get_or_insert(now + FAREWELL);
            return (self.connection.output().is_empty() || now >= by).then_some(match end {
                End::Closed => "closed",
                End::Broken(_) => "it does not speak ISO on TCP",
                End::NotS7 => "it does not speak S7 communication",
                End::Passwords => "three wrong passwords",
            });
        }
        let stuck = !self.connection.output().is_empty() && now.saturating_duration_since(self.moved) >= STUCK;
        stuck.then_some("it does not read its answers")
    }

    /// When [`Session::serve`] or [`Session::over`] is due at the latest. Milliseconds count from `start`.
    pub(crate) fn due(&self, start: Instant) -> Option<Instant> {
        let tick = self.connection.next_tick().map(|ms| start + Duration::from_millis(ms));
        let queued = self.queued.filter(|_| self.resource.is_none());
        [tick, self.asks.due(), self.ends_by, queued].into_iter().flatten().min()
    }
}
