//! The process as an Ethernet CP: its end of the back plane, the sockets of its connections, and the machine between
//! them. (docs/cp343.md)

use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{IpAddr, SocketAddr, TcpStream, UdpSocket};
use std::os::fd::{AsFd as _, BorrowedFd, OwnedFd};
use std::time::{Duration, Instant};

use ob1_access::door::{self, News};
use ob1_backplane::layout::{BOX_BYTES, BOXES};
use ob1_backplane::{ChangeMark, Counter, CpSide, CpuState, DriverState, Freshness, Leds};
use ob1_protocols::trace::record::Kind;
use ob1_s7::coupling::{Action, Condition, ConnectionKind, Coupling, Spec};
use ob1_s7::iso::{Call, Transport};
use ob1_s7::server::Settings;
use ob1_s7::tap::Tapped;
use rustix::event::{PollFd, PollFlags};
use rustix::io::Errno;
use rustix::net::{AddressFamily, SocketFlags, SocketType, acceptfrom_with, connect, ipproto, socket_with, sockopt};
use tracing::{info, warn};

use crate::asks::{Asks, Surroundings};
use crate::config::ConnectionKeys;
use crate::tap::Shared;

/// Bytes read at a time.
const READ: usize = 8192;
/// Reads of one connection before the others have their turn.
const READS: u32 = 8;

/// A connection's socket.
#[derive(Debug)]
enum Socket {
    None,
    /// It is being made.
    Coming(TcpStream),
    Up(TcpStream),
    Datagrams(UdpSocket),
}

/// What belongs to a connection beside the machine.
#[derive(Debug)]
struct Line {
    socket: Socket,
    /// Where an active one connects to; who may call a passive one.
    partner: Option<SocketAddr>,
    /// A passive TCP connection waits here.
    listener: Option<OwnedFd>,
    asks: Asks,
    /// Its number at the broker, another one with each partner.
    client: u32,
    was: Condition,
}

/// The CP.
pub(crate) struct Coupler {
    segment: CpSide,
    machine: Coupling,
    lines: Vec<Line>,
    start: Instant,
    due: Option<u64>,
    mark: Option<ChangeMark>,
    counted: (u64, u64),
    tap: Option<Shared>,
}

impl Coupler {
    /// A CP without connections yet.
    pub(crate) fn new(mut segment: CpSide) -> Self {
        segment.set_state(DriverState::Starting);
        Self {
            segment,
            machine: Coupling::new(Vec::new(), Settings::default()),
            lines: Vec::new(),
            start: Instant::now(),
            due: None,
            mark: None,
            counted: (0, 0),
            tap: None,
        }
    }

    /// The connections, for whoever looks at the station.
    pub(crate) fn told(&self) -> Vec<door::Connection> {
        let told = |(index, line): (usize, &Line)| {
            let spec = self.machine.spec(index)?;
            let (condition, traffic) = self.machine.condition(index);
            let state = match condition {
                Condition::Down => "down",
                Condition::Coming => "coming",
                Condition::Up => "up",
            };
            Some(door::Connection {
                partner: line.partner.map_or_else(|| "-".to_owned(), |at| at.to_string()),
                name: format!("ID {} {}", spec.id, spec.kind.name()),
                state: state.into(),
                pdu: self.machine.agreed_pdu(index),
                jobs: traffic.jobs + traffic.errors,
                errors: traffic.errors,
            })
        };
        self.lines.iter().enumerate().filter_map(told).collect()
    }

    /// The connections of the station file, and the sockets the runtime has bound for them.
    pub(crate) fn configure(
        &mut self,
        keys: &[ConnectionKeys],
        settings: Settings,
        mut sockets: Vec<Option<OwnedFd>>,
        tap: Shared,
    ) {
        self.tap = Some(tap);
        let specs = keys.iter().map(ConnectionKeys::spec).collect();
        self.machine = Coupling::new(specs, settings);
        self.lines = keys
            .iter()
            .map(|keys| {
                let handed = keys.socket.and_then(|at| sockets.get_mut(at)).and_then(Option::take);
                let (socket, listener) = match handed {
                    Some(fd) if keys.kind() == ConnectionKind::Udp => (Socket::Datagrams(UdpSocket::from(fd)), None),
                    handed => (Socket::None, handed),
                };
                let partner = keys.partner.as_deref().and_then(|text| text.parse().ok());
                Line { socket, partner, listener, asks: Asks::default(), client: 0, was: Condition::Down }
            })
            .collect();
        self.segment.set_leds(Leds { power: true, ..Leds::default() });
        self.segment.set_state(DriverState::Ready);
        info!(connections = self.lines.len(), "the CP is ready");
    }

    fn now(&self) -> u64 {
        u64::try_from(self.start.elapsed().as_millis()).unwrap_or(u64::MAX)
    }

    /// A sign of life.
    pub(crate) fn beat(&mut self) {
        self.segment.beat();
    }

    /// The connection a call is for.
    pub(crate) fn find(&self, call: &Call, peer: IpAddr) -> Option<usize> {
        let index = self.machine.find(call)?;
        let partner = self.lines.get(index)?.partner;
        partner.is_none_or(|partner| partner.ip() == peer).then_some(index)
    }

    /// Somebody has called for a connection.
    pub(crate) fn called(&mut self, index: usize, socket: TcpStream, transport: Transport) {
        let now = self.now();
        if let Some(line) = self.lines.get_mut(index) {
            line.socket = Socket::Up(socket);
            line.asks = Asks::default();
        }
        self.machine.called(index, transport, now);
    }

    /// What the CPU has written, what is due, and everything that follows from it.
    pub(crate) fn serve(&mut self, around: &mut Surroundings<'_>, number: &mut dyn FnMut() -> u32) {
        let mark = self.segment.changes();
        self.mark = Some(mark);
        let now = self.now();
        self.machine.run(!matches!(self.segment.cpu_state(), Ok(CpuState::Stop) | Err(_)));
        for index in 0..BOXES {
            if !self.segment.box_changed(index) {
                continue;
            }
            let mut block = [0; BOX_BYTES];
            if self.segment.read_box(index, &mut block) == Freshness::Fresh {
                self.machine.show(index, &block, now);
            }
        }
        self.due = self.machine.tick(now);
        for index in 0..self.lines.len() {
            self.questions(index, around, number);
        }
        while let Some(action) = self.machine.action() {
            match action {
                Action::Connect(index) => self.connect(index),
                Action::Close(index) => self.close(index),
            }
        }
        (0..self.lines.len()).for_each(|index| self.send(index));
        while let Some((index, block)) = self.machine.next_box() {
            self.segment.write_box(index, block);
        }
        self.tell();
    }

    /// What partners ask of the CPU.
    fn questions(&mut self, index: usize, around: &mut Surroundings<'_>, number: &mut dyn FnMut() -> u32) {
        let Some(line) = self.lines.get_mut(index) else { return };
        let condition = self.machine.condition(index).0;
        if condition != line.was {
            let name = self.machine.spec(index).map_or(0, |spec| spec.id);
            match condition {
                Condition::Up => info!("connection {name} is up"),
                Condition::Down if line.was == Condition::Up => warn!("connection {name} is down"),
                Condition::Down | Condition::Coming => {}
            }
            if condition == Condition::Up {
                line.asks = Asks::default();
                line.client = number();
            } else if line.was == Condition::Up {
                around.door.client_gone(line.client);
            }
            line.was = condition;
        }
        loop {
            let mut any = false;
            while let Some(request) = self.machine.next_ask(index) {
                line.asks.push(request);
                any = true;
            }
            let machine = &mut self.machine;
            line.asks.step(line.client, around, &mut |id, reply| {
                machine.reply(index, id, reply);
                any = true;
            });
            if !any {
                return;
            }
        }
    }

    /// An answer of the broker; false: it is for nobody here.
    pub(crate) fn news(&mut self, client: u32, news: &News, around: &mut Surroundings<'_>) -> bool {
        let Some(index) = self.lines.iter().position(|line| line.client == client) else { return false };
        let Some(line) = self.lines.get_mut(index) else { return false };
        let machine = &mut self.machine;
        line.asks.news(client, news, around, &mut |id, reply| machine.reply(index, id, reply));
        true
    }

    fn connect(&mut self, index: usize) {
        let made = self.lines.get(index).and_then(|line| line.partner).ok_or(Errno::DESTADDRREQ).and_then(begin);
        match made {
            Ok(stream) => {
                if let Some(line) = self.lines.get_mut(index) {
                    line.socket = Socket::Coming(stream);
                }
            }
            Err(_) => self.lost(index),
        }
    }

    fn close(&mut self, index: usize) {
        if let Some(line) = self.lines.get_mut(index).filter(|line| !matches!(line.socket, Socket::Datagrams(_))) {
            line.socket = Socket::None;
        }
    }

    fn lost(&mut self, index: usize) {
        self.close(index);
        let now = self.now();
        self.machine.lost(index, now);
    }

    fn send(&mut self, index: usize) {
        let now = self.now();
        let Some(line) = self.lines.get_mut(index) else { return };
        match &mut line.socket {
            Socket::None | Socket::Coming(_) => {}
            Socket::Datagrams(socket) => {
                // A datagram that cannot be sent is lost, as one on the way is.
                while let Some(datagram) = self.machine.datagram(index) {
                    let _ = socket.send(&datagram);
                }
            }
            Socket::Up(stream) => {
                let mut gone = false;
                while !self.machine.output(index).is_empty() {
                    match stream.write(self.machine.output(index)) {
                        Ok(0) => gone = true,
                        Ok(len) => {
                            let sent = self.machine.output(index).get(..len).unwrap_or_default();
                            tell(self.tap.as_ref(), Kind::Out, (index, stream, self.machine.spec(index)), sent);
                            self.machine.sent(index, len, now);
                        }
                        Err(error) if error.kind() == ErrorKind::Interrupted => {}
                        Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                        Err(_) => gone = true,
                    }
                    if gone {
                        break;
                    }
                }
                if gone {
                    self.lost(index);
                }
            }
        }
    }

    fn receive(&mut self, index: usize) {
        let mut buffer = [0; READ];
        for _ in 0..READS {
            let (now, room) = (self.now(), self.machine.room(index).min(READ));
            let Some(line) = self.lines.get_mut(index) else { return };
            let read = match &mut line.socket {
                Socket::Datagrams(socket) => socket.recv(&mut buffer).map(|len| (len, false)),
                Socket::Up(_) if room == 0 => return,
                Socket::Up(stream) => {
                    stream.read(buffer.get_mut(..room).unwrap_or_default()).map(|len| (len, len == 0))
                }
                Socket::None | Socket::Coming(_) => return,
            };
            match read {
                Ok((_, true)) => return self.lost(index),
                Ok((len, false)) => {
                    let bytes = buffer.get(..len).unwrap_or_default();
                    if let Socket::Up(stream) = &line.socket {
                        tell(self.tap.as_ref(), Kind::In, (index, stream, self.machine.spec(index)), bytes);
                    }
                    self.machine.receive(index, bytes, now);
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => return,
                // To a datagram: nobody is there at the moment.
                Err(_) if matches!(line.socket, Socket::Datagrams(_)) => return,
                Err(_) => return self.lost(index),
            }
        }
    }

    /// Descriptors to wait for; [`Coupler::ready`] gets what has become of them.
    pub(crate) fn poll_fds<'c>(&'c self, fds: &mut Vec<PollFd<'c>>) {
        for (index, line) in self.lines.iter().enumerate() {
            let mut flags = PollFlags::empty();
            let fd: Option<BorrowedFd<'_>> = match &line.socket {
                Socket::None => None,
                Socket::Coming(stream) => {
                    flags = PollFlags::OUT;
                    Some(stream.as_fd())
                }
                Socket::Up(stream) => {
                    flags.set(PollFlags::IN, self.machine.room(index) > 0);
                    flags.set(PollFlags::OUT, !self.machine.output(index).is_empty());
                    Some(stream.as_fd())
                }
                Socket::Datagrams(socket) => {
                    flags = PollFlags::IN;
                    Some(socket.as_fd())
                }
            };
            fds.extend(fd.map(|fd| PollFd::from_borrowed_fd(fd, flags)));
            fds.extend(line.listener.as_ref().map(|listener| PollFd::new(listener, PollFlags::IN)));
        }
    }

    /// Which of those descriptors have something, in the same order.
    pub(crate) fn ready(&mut self, ready: &[bool]) {
        let mut ready = ready.iter().copied();
        for index in 0..self.lines.len() {
            let Some(line) = self.lines.get(index) else { return };
            let (has_socket, has_listener) = (!matches!(line.socket, Socket::None), line.listener.is_some());
            let socket = has_socket && ready.next().unwrap_or(false);
            let listener = has_listener && ready.next().unwrap_or(false);
            if socket {
                self.made(index);
                self.receive(index);
            }
            if listener {
                self.accept(index);
            }
        }
    }

    /// A connection that was being made.
    fn made(&mut self, index: usize) {
        let now = self.now();
        let Some(line) = self.lines.get_mut(index) else { return };
        match std::mem::replace(&mut line.socket, Socket::None) {
            Socket::Coming(stream) => {
                if matches!(sockopt::socket_error(&stream), Ok(Ok(()))) {
                    line.socket = Socket::Up(stream);
                    self.machine.connected(index, now);
                } else {
                    self.lost(index);
                }
            }
            other => line.socket = other,
        }
    }

    /// A passive TCP connection: the newest partner has it.
    fn accept(&mut self, index: usize) {
        let now = self.now();
        let Some(line) = self.lines.get_mut(index) else { return };
        let Some(listener) = &line.listener else { return };
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let Ok((socket, Some(peer))) = acceptfrom_with(listener, flags) else { return };
        let peer = SocketAddr::try_from(peer).ok().map(|peer| peer.ip());
        if line.partner.is_some_and(|partner| Some(partner.ip()) != peer) {
            return;
        }
        let _ = sockopt::set_tcp_nodelay(&socket, true);
        keep_alive(&socket);
        line.socket = Socket::Up(TcpStream::from(socket));
        self.machine.lost(index, now);
        self.machine.connected(index, now);
    }

    /// When [`Coupler::serve`] is wanted, whatever comes before.
    pub(crate) fn due(&self) -> Option<Instant> {
        let asks = self.lines.iter().filter_map(|line| line.asks.due()).min();
        let machine = self.due.map(|ms| self.start + Duration::from_millis(ms));
        [asks, machine].into_iter().flatten().min()
    }

    /// True: the CPU side rings for its next change; false: there is one already.
    pub(crate) fn prepare_sleep(&mut self) -> bool {
        self.mark.is_some_and(|mark| self.segment.prepare_sleep(mark))
    }

    /// The sleep is over.
    pub(crate) fn awake(&mut self) {
        self.segment.awake();
    }

    /// LEDs and counters.
    fn tell(&mut self) {
        let (mut jobs, mut errors, mut down) = (0, 0, false);
        for index in 0..self.lines.len() {
            let (condition, traffic) = self.machine.condition(index);
            jobs += traffic.jobs;
            errors += traffic.errors;
            down |= condition != Condition::Up;
        }
        if self.counted != (jobs, errors) {
            let (done, failed) = (jobs - self.counted.0, errors - self.counted.1);
            self.segment.count(Counter::OrdersAccepted, done + failed);
            self.segment.count(Counter::TelegramsSent, done);
            self.segment.count(Counter::SendErrors, failed);
            self.counted = (jobs, errors);
        }
        if !self.lines.is_empty() {
            self.segment.set_leds(Leds { power: true, error: down, ..Leds::default() });
        }
    }
}

/// Tells those who listen what has gone over a TCP connection of the CP. Their numbers are behind those of clients.
fn tell(tap: Option<&Shared>, kind: Kind, (index, stream, spec): (usize, &TcpStream, Option<&Spec>), bytes: &[u8]) {
    let Some(tap) = tap else { return };
    let connection = || {
        let partner = stream.peer_addr().unwrap_or(SocketAddr::from(([0, 0, 0, 0], 0)));
        Tapped::of(u32::MAX - index as u32, partner, spec.is_some_and(|spec| spec.active))
    };
    tap.borrow_mut().tell(kind, connection, bytes);
}

/// A partner that is gone is noticed after a minute.
pub(crate) fn keep_alive(socket: &OwnedFd) {
    // Without them a connection works too, only a dead partner is noticed later.
    let _ = sockopt::set_socket_keepalive(socket, true);
    let _ = sockopt::set_tcp_keepidle(socket, Duration::from_secs(30));
    let _ = sockopt::set_tcp_keepintvl(socket, Duration::from_secs(10));
    let _ = sockopt::set_tcp_keepcnt(socket, 3);
}

/// Begins a TCP connection.
fn begin(partner: SocketAddr) -> Result<TcpStream, Errno> {
    let family = if partner.is_ipv4() { AddressFamily::INET } else { AddressFamily::INET6 };
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let socket = socket_with(family, SocketType::STREAM, flags, Some(ipproto::TCP))?;
    let _ = sockopt::set_tcp_nodelay(&socket, true);
    keep_alive(&socket);
    match connect(&socket, &partner) {
        Ok(()) | Err(Errno::INPROGRESS | Errno::INTR) => Ok(TcpStream::from(socket)),
        Err(error) => Err(error),
    }
}

impl ConnectionKeys {
    fn spec(&self) -> Spec {
        Spec {
            id: self.id,
            kind: self.kind(),
            active: self.active,
            local: self.tsap(&self.local),
            remote: self.tsap(&self.remote),
        }
    }
}
