//! The sockets of an Ethernet CP: the network of [`Cp`]. (docs/cp343.md)

use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{IpAddr, SocketAddr, TcpStream, UdpSocket};
use std::os::fd::{AsFd as _, BorrowedFd, OwnedFd};
use std::time::Instant;

use ob1_access::door::{Connection, News};
use ob1_access::settings::{ConnectionType, CpConnection};
use ob1_backplane::CpSide;
use ob1_s7::iso::{Call, Transport, Tsap};
use ob1_s7::server::Settings;
use ob1_s7::tap::Tapped;
use ob1_s7_process::asks::Surroundings;
use ob1_s7_process::cp::{Cp, Network, Received, is_of};
use ob1_serial::tap_record::Kind;
use rustix::event::{PollFd, PollFlags};
use rustix::io::Errno;
use rustix::net::{AddressFamily, SocketFlags, SocketType, connect, ipproto, socket_with, sockopt};

use crate::sockets::{self, PAUSE, is_broken, keep_alive};
use crate::tap::Shared;

/// What a connection has of the network.
#[derive(Debug)]
enum Socket {
    None,
    /// It is being made.
    Coming(TcpStream),
    Up(TcpStream),
    /// With the address of the partner: telegrams from others are ignored.
    Datagrams(UdpSocket, SocketAddr),
}

/// The sockets of a connection.
#[derive(Debug)]
struct Line {
    socket: Socket,
    /// A passive TCP connection waits here.
    listener: Option<OwnedFd>,
    /// We make the connection.
    active: bool,
}

/// All sockets, and the tap of their traffic.
#[derive(Default)]
struct Sockets {
    lines: Vec<Line>,
    tap: Option<Shared>,
}

/// The CP with its sockets.
pub(crate) struct Coupler {
    cp: Cp,
    sockets: Sockets,
    /// Nothing is accepted before this time.
    deaf_until: Instant,
}

impl Sockets {
    fn set(&mut self, index: usize, socket: Socket) {
        if let Some(line) = self.lines.get_mut(index) {
            line.socket = socket;
        }
    }

    /// Reports the traffic of a TCP connection to the tap. Its numbers follow those of clients.
    fn tell(&self, kind: Kind, index: usize, bytes: &[u8]) {
        let (Some(tap), Some(line)) = (&self.tap, self.lines.get(index)) else { return };
        let Socket::Up(stream) = &line.socket else { return };
        let connection = || {
            let partner = stream.peer_addr().unwrap_or(SocketAddr::from(([0, 0, 0, 0], 0)));
            Tapped::of(u32::MAX - index as u32, partner, line.active)
        };
        tap.borrow_mut().tell(kind, connection, bytes);
    }
}

impl Network for Sockets {
    fn connect(&mut self, index: usize, partner: SocketAddr) -> bool {
        begin(partner).map(|stream| self.set(index, Socket::Coming(stream))).is_ok()
    }

    fn close(&mut self, index: usize) {
        if let Some(line) = self.lines.get_mut(index).filter(|line| !matches!(line.socket, Socket::Datagrams(..))) {
            line.socket = Socket::None;
        }
    }

    fn send(&mut self, index: usize, bytes: &[u8]) -> Option<usize> {
        let Some(Socket::Up(stream)) = self.lines.get_mut(index).map(|line| &mut line.socket) else { return Some(0) };
        loop {
            match stream.write(bytes) {
                Ok(0) => return None,
                Ok(len) => {
                    self.tell(Kind::Out, index, bytes.get(..len).unwrap_or_default());
                    return Some(len);
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Some(0),
                Err(_) => return None,
            }
        }
    }

    fn datagram(&mut self, index: usize, bytes: &[u8]) {
        if let Some(Socket::Datagrams(socket, partner)) = self.lines.get(index).map(|line| &line.socket) {
            let _ = socket.send_to(bytes, *partner);
        }
    }

    fn receive(&mut self, index: usize, into: &mut [u8]) -> Received {
        loop {
            let read = match self.lines.get_mut(index).map(|line| &mut line.socket) {
                Some(Socket::Datagrams(socket, partner)) => match socket.recv_from(into) {
                    Ok((len, from)) if is_of(*partner, from.ip()) && from.port() == partner.port() => {
                        return Received::Bytes(len);
                    }
                    // Or the answer to a datagram: nobody is listening there at the moment.
                    Ok(_) | Err(_) => return Received::Nothing,
                },
                Some(Socket::Up(stream)) => stream.read(into),
                _ => return Received::Nothing,
            };
            match read {
                Ok(0) => return Received::Ended,
                Ok(len) => {
                    self.tell(Kind::In, index, into.get(..len).unwrap_or_default());
                    return Received::Bytes(len);
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Received::Nothing,
                Err(_) => return Received::Gone,
            }
        }
    }
}

impl Coupler {
    /// A CP without connections yet.
    pub(crate) fn new(segment: CpSide) -> Self {
        let now = Instant::now();
        Self { cp: Cp::new(segment, now), sockets: Sockets::default(), deaf_until: now }
    }

    /// The connections, for tools that show the station.
    pub(crate) fn told(&self) -> Vec<Connection> {
        self.cp.told()
    }

    /// The connections of the station file, and the sockets the runtime has bound for them.
    pub(crate) fn configure(
        &mut self,
        told: &[CpConnection],
        settings: Settings,
        mut sockets: impl Iterator<Item = OwnedFd>,
        tap: Shared,
    ) {
        let line = |told: &CpConnection| {
            let (socket, listener) = match told.port.and_then(|_| sockets.next()) {
                Some(fd) if told.kind == ConnectionType::Udp => {
                    let of = |partner| Socket::Datagrams(UdpSocket::from(fd), partner);
                    (told.partner.map_or(Socket::None, of), None)
                }
                handed => (Socket::None, handed),
            };
            Line { socket, listener, active: told.active }
        };
        self.sockets = Sockets { lines: told.iter().map(line).collect(), tap: Some(tap) };
        self.cp.configure(told, settings);
    }

    /// A sign of life.
    pub(crate) fn beat(&mut self) {
        self.cp.beat();
    }

    /// The connection that a call is meant for.
    pub(crate) fn find(&self, call: &Call, peer: IpAddr) -> Option<usize> {
        self.cp.find(call, peer)
    }

    /// Whether this is the TSAP of a connection that waits for calls.
    pub(crate) fn has_tsap(&self, called: &Tsap) -> bool {
        self.cp.has_tsap(called)
    }

    /// A partner has called for a connection.
    pub(crate) fn called(&mut self, index: usize, socket: TcpStream, transport: Transport, now: Instant) {
        self.sockets.set(index, Socket::Up(socket));
        self.cp.called(index, transport, now);
    }

    /// Handles the CPU's boxes, everything that is due, and the consequences.
    pub(crate) fn serve(&mut self, around: &mut Surroundings<'_>, number: &mut dyn FnMut() -> u32) {
        self.cp.serve(around, number, &mut self.sockets);
    }

    /// Takes an answer of the broker; false: it is not for a connection here.
    pub(crate) fn news(&mut self, client: u32, news: &News, around: &mut Surroundings<'_>) -> bool {
        self.cp.news(client, news, around)
    }

    /// Descriptors to wait for; [`Coupler::ready`] gets the result.
    pub(crate) fn poll_fds<'c>(&'c self, fds: &mut Vec<PollFd<'c>>, now: Instant) {
        let accepts = if now < self.deaf_until { PollFlags::empty() } else { PollFlags::IN };
        for (index, line) in self.sockets.lines.iter().enumerate() {
            let mut flags = PollFlags::empty();
            let fd: Option<BorrowedFd<'_>> = match &line.socket {
                Socket::None => None,
                Socket::Coming(stream) => {
                    flags = PollFlags::OUT;
                    Some(stream.as_fd())
                }
                Socket::Up(stream) => {
                    flags.set(PollFlags::IN, self.cp.wants_read(index));
                    flags.set(PollFlags::OUT, self.cp.wants_write(index));
                    Some(stream.as_fd())
                }
                Socket::Datagrams(socket, _) => {
                    flags = PollFlags::IN;
                    Some(socket.as_fd())
                }
            };
            fds.extend(fd.map(|fd| PollFd::from_borrowed_fd(fd, flags)));
            fds.extend(line.listener.as_ref().map(|listener| PollFd::new(listener, accepts)));
        }
    }

    /// What those descriptors are ready for, in the same order.
    pub(crate) fn ready(&mut self, ready: &[PollFlags], now: Instant) {
        let mut ready = ready.iter().copied();
        for index in 0..self.sockets.lines.len() {
            let Some(line) = self.sockets.lines.get(index) else { return };
            let (has_socket, has_listener) = (!matches!(line.socket, Socket::None), line.listener.is_some());
            let is_up = matches!(line.socket, Socket::Up(_));
            let mut next = |has_it: bool| has_it.then(|| ready.next()).flatten().unwrap_or_else(PollFlags::empty);
            let (socket, listener) = (next(has_socket), next(has_listener));
            if is_up && is_broken(socket) && !self.cp.wants_read(index) {
                // Nobody takes its data, so no read would notice.
                self.cp.lost(index, now, &mut self.sockets);
            } else if !socket.is_empty() {
                self.made(index, now);
                self.cp.receive(index, now, &mut self.sockets);
            }
            if !listener.is_empty() {
                self.accept(index, now);
            }
        }
    }

    /// A connection attempt has ended.
    fn made(&mut self, index: usize, now: Instant) {
        let Some(line) = self.sockets.lines.get_mut(index) else { return };
        match std::mem::replace(&mut line.socket, Socket::None) {
            Socket::Coming(stream) => {
                if matches!(sockopt::socket_error(&stream), Ok(Ok(()))) {
                    line.socket = Socket::Up(stream);
                    self.cp.connected(index, now);
                } else {
                    self.cp.lost(index, now, &mut self.sockets);
                }
            }
            other => line.socket = other,
        }
    }

    /// Accepts for a passive TCP connection: the newest partner gets it.
    fn accept(&mut self, index: usize, now: Instant) {
        let Some(listener) = self.sockets.lines.get(index).and_then(|line| line.listener.as_ref()) else { return };
        let (socket, peer) = match sockets::accept(listener) {
            Ok(Some(caller)) => caller,
            Ok(None) => return,
            Err(_) => {
                self.deaf_until = now + PAUSE;
                return;
            }
        };
        if !self.cp.may_call(index, peer.ip()) {
            return;
        }
        // The partner may have closed the previous connection since the last look at it.
        self.cp.receive(index, now, &mut self.sockets);
        self.sockets.set(index, Socket::Up(TcpStream::from(socket)));
        self.cp.accepted(index, now);
    }

    /// When [`Coupler::serve`] is due at the latest.
    pub(crate) fn due(&self) -> Option<Instant> {
        self.cp.due()
    }

    /// True: the CPU side rings for its next change; false: there is one already.
    pub(crate) fn prepare_sleep(&mut self) -> bool {
        self.cp.prepare_sleep()
    }

    /// The sleep is over.
    pub(crate) fn awake(&mut self) {
        self.cp.awake();
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    fn datagrams(partner: SocketAddr) -> (Sockets, SocketAddr) {
        let socket = UdpSocket::bind("127.0.0.1:0").expect("a port");
        socket.set_nonblocking(true).expect("a socket");
        let at = socket.local_addr().expect("bound");
        let line = Line { socket: Socket::Datagrams(socket, partner), listener: None, active: false };
        (Sockets { lines: vec![line], tap: None }, at)
    }

    /// The runtime leaves the socket unconnected while there is no way to the partner.
    #[test]
    fn telegrams_come_from_the_partner_alone() {
        let partner = UdpSocket::bind("127.0.0.1:0").expect("a port");
        let stranger = UdpSocket::bind("127.0.0.1:0").expect("a port");
        let (mut sockets, at) = datagrams(partner.local_addr().expect("bound"));
        let mut into = [0; 8];
        stranger.send_to(b"strange", at).expect("sent");
        partner.send_to(b"known", at).expect("sent");
        assert!(matches!(sockets.receive(0, &mut into), Received::Nothing));
        assert!(matches!(sockets.receive(0, &mut into), Received::Bytes(5)));
        assert_eq!(into.get(..5), Some(&b"known"[..]));
        sockets.datagram(0, b"answer");
        assert_eq!(partner.recv(&mut into).expect("an answer"), 6);
    }
}
