//! The network between two stations: TCP connections whose chunks are delayed and divided, that break or become silent;
//! datagrams that are lost. The kernel keeps the data of a dead process.

use std::collections::{BTreeMap, VecDeque};
use std::net::SocketAddr;

use ob1_line::sim::SplitMix64;
use ob1_s7_process::cp::{Network, Received};
use ob1_time::{Instant, Span};

use super::SECOND;
use super::program::LINES;

/// Transmission time of a chunk: minimum, and maximum addition.
const WAY: (Span, Span) = (Span::from_micros(20), Span::from_millis(3));
/// Maximum bytes in transit in one direction.
const ROOM: usize = 64 * 1024;
/// Maximum datagrams that a kernel keeps.
const DATAGRAMS: usize = 64;
/// Time after which a silent partner is detected.
const KEEP_ALIVE: Span = Span::from_secs(60);

/// Something in transit.
enum Item {
    Bytes(Vec<u8>),
    /// End of the data.
    End,
}

#[derive(Default)]
struct Pipe {
    queue: VecDeque<(Instant, Item)>,
    bytes: usize,
}

/// A TCP connection.
struct Conn {
    line: usize,
    caller: usize,
    /// Time at which each station knows that the connection is established.
    made: [Instant; 2],
    /// In transit to each station.
    to: [Pipe; 2],
    /// Stations that have closed their end.
    closed: [bool; 2],
    /// If broken: the time at which each station detects this.
    broken: Option<[Instant; 2]>,
}

/// The network.
pub(crate) struct Net {
    rng: SplitMix64,
    conns: BTreeMap<u64, Conn>,
    last: u64,
    /// Incoming connections of each station that are not accepted yet.
    backlog: [VecDeque<u64>; 2],
    datagrams: [VecDeque<(Instant, Vec<u8>)>; 2],
    /// One datagram in this many is lost; one connection request in this many is refused; 0: none.
    pub(crate) loses: u64,
    /// Time until which a connection may be silent.
    pub(crate) mute_until: Instant,
}

impl Net {
    pub(crate) fn new(seed: u64) -> Self {
        Self {
            rng: SplitMix64::new(seed),
            conns: BTreeMap::new(),
            last: 0,
            backlog: Default::default(),
            datagrams: Default::default(),
            loses: 0,
            mute_until: Instant::START,
        }
    }

    fn way(&mut self) -> Span {
        WAY.0 + self.rng.span_below(WAY.1)
    }

    fn happens(&mut self) -> bool {
        self.loses > 0 && self.rng.below(self.loses) == 0
    }

    /// Breaks a connection: both stations detect it a little later, and data in transit are lost. True if there was
    /// one.
    pub(crate) fn breaks(&mut self, line: usize, now: Instant) -> bool {
        self.sever(line, |net| [now + net.way(), now + net.way()])
    }

    /// Makes a connection silent without an error.
    pub(crate) fn mutes(&mut self, line: usize, now: Instant) -> bool {
        let until = now + KEEP_ALIVE;
        let done = self.sever(line, |net| [until + net.rng.span_below(SECOND), until + net.rng.span_below(SECOND)]);
        if done {
            self.mute_until = until + SECOND;
        }
        done
    }

    fn sever(&mut self, line: usize, when: impl FnOnce(&mut Self) -> [Instant; 2]) -> bool {
        let found = self.conns.iter().rev().find(|(_, conn)| conn.line == line && conn.broken.is_none());
        let Some(id) = found.map(|(id, _)| *id) else { return false };
        let when = when(self);
        if let Some(conn) = self.conns.get_mut(&id) {
            conn.broken = Some(when);
            conn.to = Default::default();
        }
        true
    }

    /// Accepts an incoming connection of `me`.
    pub(crate) fn accept(&mut self, me: usize, now: Instant) -> Option<(u64, usize)> {
        let is_there = |id: &u64| self.conns.get(id).is_some_and(|conn| now >= conn.made[me]);
        let id = self.backlog[me].iter().position(is_there).and_then(|at| self.backlog[me].remove(at))?;
        self.conns.get(&id).map(|conn| (id, conn.line))
    }

    /// Whether an outgoing connection of `me` is established.
    pub(crate) fn is_made(&self, id: u64, me: usize, now: Instant) -> bool {
        self.conns.get(&id).is_none_or(|conn| now >= conn.made[me])
    }

    /// The kernel closes the connections of a dead process: data already sent may still arrive.
    pub(crate) fn kill(&mut self, id: u64, me: usize, now: Instant) {
        let seen = [now + self.way(); 2];
        let is_broken = self.rng.below(2) == 0;
        if let Some(conn) = self.conns.get_mut(&id).filter(|_| is_broken) {
            conn.broken.get_or_insert(seen);
            conn.to = Default::default();
        }
        self.close(id, me, now);
    }

    pub(crate) fn close(&mut self, id: u64, me: usize, now: Instant) {
        let way = self.way();
        let Some(conn) = self.conns.get_mut(&id) else { return };
        conn.closed[me] = true;
        conn.to[me] = Pipe::default();
        let pipe = &mut conn.to[1 - me];
        let due = pipe.queue.back().map_or(Instant::START, |last| last.0).max(now + way);
        pipe.queue.push_back((due, Item::End));
        // A connection that is not accepted yet exists nevertheless.
        if conn.closed == [true; 2] {
            self.conns.remove(&id);
            self.backlog.iter_mut().for_each(|backlog| backlog.retain(|waiting| *waiting != id));
        }
    }

    pub(crate) fn receive(&mut self, id: u64, me: usize, now: Instant, into: &mut [u8]) -> Received {
        let Some(conn) = self.conns.get_mut(&id) else { return Received::Gone };
        if let Some(seen) = conn.broken {
            return if now >= seen[me] { Received::Gone } else { Received::Nothing };
        }
        let pipe = &mut conn.to[me];
        match pipe.queue.front_mut() {
            Some((due, item)) if now >= *due => match item {
                Item::End => Received::Ended,
                Item::Bytes(bytes) => {
                    let len = bytes.len().min(into.len());
                    into[..len].copy_from_slice(&bytes[..len]);
                    bytes.drain(..len);
                    pipe.bytes -= len;
                    if bytes.is_empty() {
                        pipe.queue.pop_front();
                    }
                    Received::Bytes(len)
                }
            },
            _ => Received::Nothing,
        }
    }

    pub(crate) fn send(&mut self, id: u64, me: usize, now: Instant, bytes: &[u8]) -> Option<usize> {
        let (way, part) = (self.way(), 1 + self.rng.below(bytes.len() as u64) as usize);
        let conn = self.conns.get_mut(&id)?;
        let pipe = &mut conn.to[1 - me];
        if let Some(seen) = conn.broken {
            // The kernel accepts the data but does not deliver them.
            let taken = part.min(ROOM - pipe.bytes);
            pipe.bytes += taken;
            return (now < seen[me]).then_some(taken);
        }
        if conn.closed[1 - me] {
            return Some(part);
        }
        let taken = part.min(ROOM - pipe.bytes);
        if taken > 0 {
            let due = pipe.queue.back().map_or(Instant::START, |last| last.0).max(now + way);
            pipe.queue.push_back((due, Item::Bytes(bytes[..taken].to_vec())));
            pipe.bytes += taken;
        }
        Some(taken)
    }

    /// Time of the next event for `me`; ignores connections that `me` does not read now.
    pub(crate) fn next(&self, me: usize, now: Instant, reads: impl Fn(u64) -> bool) -> Instant {
        let of = |(id, conn): (&u64, &Conn)| {
            if conn.closed[me] {
                return None;
            }
            let made = Some(conn.made[me]).filter(|at| *at > now);
            let came = match conn.broken {
                Some(seen) => Some(seen[me]),
                None => conn.to[me].queue.front().map(|front| front.0),
            };
            // Nothing arrives before the connection is established.
            let came = came.map(|at| at.max(conn.made[me])).filter(|_| reads(*id));
            [made, came].into_iter().flatten().min()
        };
        let datagram = self.datagrams[me].front().map(|front| front.0);
        self.conns.iter().filter_map(of).chain(datagram).min().unwrap_or(Instant::NEVER)
    }
}

/// A connection of a station.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Socket {
    None,
    Coming(u64),
    Up(u64),
}

impl Socket {
    pub(crate) fn id(self) -> Option<u64> {
        match self {
            Self::None => None,
            Self::Coming(id) | Self::Up(id) => Some(id),
        }
    }
}

/// The network for a station's process.
pub(crate) struct Sockets<'n> {
    pub(crate) net: &'n mut Net,
    pub(crate) me: usize,
    pub(crate) now: Instant,
    pub(crate) lines: &'n mut [Socket; LINES.len()],
}

impl Network for Sockets<'_> {
    fn connect(&mut self, index: usize, _partner: SocketAddr) -> bool {
        if self.net.happens() {
            return false;
        }
        let made = [self.now + self.net.way(), self.now + self.net.way()];
        self.net.last += 1;
        let id = self.net.last;
        let conn =
            Conn { line: index, caller: self.me, made, to: Default::default(), closed: [false; 2], broken: None };
        assert_eq!(conn.caller, LINES[index].1, "the other one calls");
        self.net.conns.insert(id, conn);
        self.net.backlog[1 - self.me].push_back(id);
        self.lines[index] = Socket::Coming(id);
        true
    }

    fn close(&mut self, index: usize) {
        if let Some(id) = std::mem::replace(&mut self.lines[index], Socket::None).id() {
            self.net.close(id, self.me, self.now);
        }
    }

    fn send(&mut self, index: usize, bytes: &[u8]) -> Option<usize> {
        match self.lines[index] {
            Socket::Up(id) => self.net.send(id, self.me, self.now, bytes),
            _ => Some(0),
        }
    }

    fn datagram(&mut self, _index: usize, bytes: &[u8]) {
        let due = self.now + self.net.way();
        let lost = self.net.happens();
        let queue = &mut self.net.datagrams[1 - self.me];
        if !lost && queue.len() < DATAGRAMS {
            let due = queue.back().map_or(Instant::START, |last| last.0).max(due);
            queue.push_back((due, bytes.to_vec()));
        }
    }

    fn receive(&mut self, index: usize, into: &mut [u8]) -> Received {
        if LINES[index].0 == "udp" {
            let due = self.net.datagrams[self.me].front().is_some_and(|front| self.now >= front.0);
            let Some((_, bytes)) = self.net.datagrams[self.me].pop_front_if(|_| due) else { return Received::Nothing };
            into[..bytes.len()].copy_from_slice(&bytes);
            return Received::Bytes(bytes.len());
        }
        match self.lines[index] {
            Socket::Up(id) => self.net.receive(id, self.me, self.now, into),
            _ => Received::Nothing,
        }
    }
}
