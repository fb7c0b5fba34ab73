//! A connection: its TCP connection, its protocol, and what waits on it.

use std::collections::{BTreeMap, VecDeque};

use super::stream::Stream;
use super::{Condition, ConnectionKind, PATIENCE, RETRY, RETRY_MAX, Spec, Traffic};
use crate::iso::{Event, Transport};
use crate::server::{Connection, Settings};

/// Telegrams that wait for AG_RECV; beyond that the partner has to wait, and datagrams are lost.
const MESSAGES: usize = 8;
/// Longest datagram, in bytes.
const DATAGRAM: usize = 2048;
/// R_IDs whose USEND waits for a URCV.
const INBOX: usize = 64;

/// The protocol of a connection.
#[derive(Debug)]
enum Wire {
    None,
    Stream(Vec<u8>),
    Datagrams(VecDeque<Vec<u8>>),
    Iso(Transport),
    S7(Box<Connection>),
}

/// A job of ours at the partner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Own {
    pub(super) reference: u16,
    /// Its box, and the job in it.
    pub(super) at: usize,
    pub(super) job: u16,
    /// By then the answer must have come.
    pub(super) until: u64,
}

#[derive(Debug)]
pub(super) struct Link {
    pub(super) spec: Spec,
    wire: Wire,
    /// The TCP connection exists, or is wanted.
    is_wired: bool,
    asked: bool,
    retry_at: u64,
    wait: u64,
    since: u64,
    is_broken: bool,
    /// The present connection has come up.
    has_come_up: bool,
    /// The partner has sent something on the present connection, or on the last one; or it has lasted.
    has_served: bool,
    pub(super) is_locked: bool,
    /// Bytes sent so far, over all TCP connections.
    out: u64,
    stream: Stream,
    messages: VecDeque<Vec<u8>>,
    pub(super) own: Vec<Own>,
    /// Newest data of USEND, and whether older ones were lost.
    pub(super) inbox: BTreeMap<u32, (Vec<u8>, bool)>,
    /// First parts of BSEND that wait for a BRCV: until when, and what.
    pub(super) parts: BTreeMap<u32, (u64, crate::client::Came)>,
    /// R_IDs with a BSEND of which some parts have been taken, and more follow.
    pub(super) begun: Vec<u32>,
    /// R_IDs a BRCV has asked for since the start.
    pub(super) known: Vec<u32>,
    pub(super) traffic: Traffic,
}

impl Link {
    pub(super) fn new(spec: Spec) -> Self {
        let wire = if spec.kind == ConnectionKind::Udp { Wire::Datagrams(VecDeque::new()) } else { Wire::None };
        Self {
            spec,
            wire,
            is_wired: false,
            asked: false,
            retry_at: 0,
            wait: RETRY,
            since: 0,
            is_broken: false,
            has_come_up: false,
            has_served: false,
            is_locked: false,
            out: 0,
            stream: Stream::default(),
            messages: VecDeque::new(),
            own: Vec::new(),
            inbox: BTreeMap::new(),
            parts: BTreeMap::new(),
            begun: Vec::new(),
            known: Vec::new(),
            traffic: Traffic::default(),
        }
    }

    pub(super) fn condition(&self) -> Condition {
        match &self.wire {
            Wire::Datagrams(_) | Wire::Stream(_) => Condition::Up,
            Wire::None if self.asked => Condition::Coming,
            Wire::None => Condition::Down,
            Wire::Iso(transport) if transport.is_open() => Condition::Up,
            Wire::S7(connection) if connection.pdu().is_some() && connection.end().is_none() => Condition::Up,
            Wire::Iso(_) | Wire::S7(_) => Condition::Coming,
        }
    }

    pub(super) fn agreed_pdu(&self) -> u16 {
        if let Wire::S7(connection) = &self.wire { connection.pdu().unwrap_or(0) } else { 0 }
    }

    /// Whether a TCP connection must be made now.
    pub(super) fn wants_connection(&mut self, now: u64) -> bool {
        let wants = self.spec.active
            && self.spec.kind != ConnectionKind::Udp
            && !self.is_wired
            && !self.asked
            && now >= self.retry_at;
        if wants {
            (self.asked, self.since) = (true, now);
        }
        wants
    }

    /// Whether the setup has taken too long, or a job of ours has no answer.
    pub(super) fn is_late(&self, now: u64) -> bool {
        let coming = (self.asked || self.is_wired) && self.condition() == Condition::Coming;
        coming && now >= self.since + PATIENCE || self.own.iter().any(|own| now >= own.until)
    }

    pub(super) fn due(&self) -> Option<u64> {
        let own = self.own.iter().map(|own| own.until).min();
        let parts = self.parts.values().map(|(until, _)| *until).min();
        let coming = match self.condition() {
            Condition::Coming => Some(self.since + PATIENCE),
            Condition::Down if self.spec.active => Some(self.retry_at),
            _ => None,
        };
        [own, parts, coming].into_iter().flatten().min()
    }

    pub(super) fn connected(&mut self, settings: Settings, now: u64) {
        (self.is_wired, self.asked, self.since, self.has_served) = (true, false, now, false);
        let (local, remote) = (self.spec.local.clone(), self.spec.remote.clone());
        self.wire = match self.spec.kind {
            ConnectionKind::Udp => return,
            ConnectionKind::Tcp => {
                self.stream.begin();
                Wire::Stream(Vec::new())
            }
            ConnectionKind::Iso => {
                let mut transport = Transport::new();
                transport.call(local, remote);
                Wire::Iso(transport)
            }
            ConnectionKind::S7 => Wire::S7(Box::new(Connection::calling(settings, local, remote))),
        };
        self.note_up();
    }

    pub(super) fn called(&mut self, mut transport: Transport, settings: Settings, now: u64) {
        (self.is_wired, self.asked, self.since, self.has_served) = (true, false, now, false);
        self.wire = if self.spec.kind == ConnectionKind::S7 {
            Wire::S7(Box::new(Connection::called(settings, transport)))
        } else {
            transport.accept();
            Wire::Iso(transport)
        };
        // Handles the bytes that followed the call.
        self.events();
        self.note_up();
    }

    /// Notes that the connection is up, if it is.
    fn note_up(&mut self) {
        self.has_come_up |= self.condition() == Condition::Up;
    }

    /// Whether the present connection, or else the last one, is of use: the partner has sent something on it after the
    /// setup, or it has lasted. One that comes up and is closed at once is not.
    pub(super) fn is_of_use(&self, now: u64) -> bool {
        self.has_served || self.has_come_up && now >= self.since + RETRY_MAX
    }

    /// The partner has closed the connection. What it has sent before stays for AG_RECV.
    pub(super) fn finished(&mut self, now: u64) {
        self.stream.finish();
        self.lost(now);
    }

    pub(super) fn lost(&mut self, now: u64) {
        self.has_served = self.is_of_use(now);
        if self.has_served && self.has_come_up {
            self.wait = RETRY;
        }
        self.out += self.output().len() as u64;
        if self.spec.kind != ConnectionKind::Udp {
            self.wire = Wire::None;
        }
        (self.is_wired, self.asked, self.is_broken, self.has_come_up) = (false, false, false, false);
        self.retry_at = now + self.wait;
        self.wait = (self.wait * 2).min(RETRY_MAX);
        self.stream.lose();
        self.own.clear();
        self.parts.clear();
        self.begun.clear();
    }

    pub(super) fn broken(&mut self) -> bool {
        let ended = match &self.wire {
            Wire::S7(connection) => connection.end().is_some(),
            Wire::Iso(transport) => transport.is_ended(),
            _ => false,
        };
        ended || self.is_broken
    }

    pub(super) fn room(&self) -> usize {
        match &self.wire {
            Wire::None => 0,
            Wire::Stream(_) => self.stream.room(),
            Wire::Datagrams(_) => DATAGRAM,
            Wire::Iso(_) if self.messages.len() >= MESSAGES => 0,
            Wire::Iso(transport) => transport.room(),
            Wire::S7(connection) => connection.room(),
        }
    }

    pub(super) fn receive(&mut self, bytes: &[u8]) {
        let was_up = self.condition() == Condition::Up;
        match &mut self.wire {
            Wire::None => {}
            Wire::Stream(_) => self.stream.push(bytes),
            Wire::Datagrams(_) if self.messages.len() < MESSAGES => self.messages.push_back(bytes.to_vec()),
            Wire::Datagrams(_) => self.traffic.errors += 1,
            Wire::Iso(transport) => self.is_broken |= transport.receive(bytes).is_err(),
            Wire::S7(connection) => connection.receive(bytes),
        }
        self.events();
        self.note_up();
        self.has_served |= was_up && !self.broken();
    }

    /// Whole telegrams of an ISO-on-TCP connection.
    fn events(&mut self) {
        let Wire::Iso(transport) = &mut self.wire else { return };
        while self.messages.len() < MESSAGES {
            match transport.event() {
                Ok(Some(Event::Message(message))) => self.messages.push_back(message),
                Ok(Some(Event::Open)) => {}
                Ok(None) => return,
                Ok(Some(Event::Ended(_) | Event::Call(_))) | Err(_) => {
                    self.is_broken = true;
                    return;
                }
            }
        }
    }

    pub(super) fn output(&self) -> &[u8] {
        match &self.wire {
            Wire::None | Wire::Datagrams(_) => &[],
            Wire::Stream(output) => output,
            Wire::Iso(transport) => transport.output(),
            Wire::S7(connection) => connection.output(),
        }
    }

    pub(super) fn sent(&mut self, count: usize) {
        let count = count.min(self.output().len());
        self.out += count as u64;
        match &mut self.wire {
            Wire::None | Wire::Datagrams(_) => {}
            Wire::Stream(output) => drop(output.drain(..count)),
            Wire::Iso(transport) => transport.sent(count),
            Wire::S7(connection) => connection.sent(count),
        }
    }

    pub(super) fn take_datagram(&mut self) -> Option<Vec<u8>> {
        match &mut self.wire {
            Wire::Datagrams(waiting) => waiting.pop_front(),
            _ => None,
        }
    }

    /// Bytes sent on this connection so far.
    pub(super) const fn out(&self) -> u64 {
        self.out
    }

    /// The byte count at which everything so far has been sent.
    pub(super) fn out_with_this(&self) -> u64 {
        self.out + self.output().len() as u64
    }

    /// Sends a telegram, or bytes; returns the byte count at which it has been sent.
    pub(super) fn send(&mut self, bytes: &[u8]) -> u64 {
        match &mut self.wire {
            Wire::None | Wire::S7(_) => {}
            Wire::Stream(output) => output.extend_from_slice(bytes),
            Wire::Datagrams(waiting) => waiting.push_back(bytes.to_vec()),
            Wire::Iso(transport) => transport.send(bytes),
        }
        self.out_with_this()
    }

    /// A received telegram; for a stream `room` bytes, once all of them have come. And, for a stream, the number of the
    /// TCP connection that has brought them.
    pub(super) fn take(&mut self, room: usize) -> Option<(Vec<u8>, u64)> {
        if self.spec.kind == ConnectionKind::Tcp {
            return self.stream.take(room);
        }
        let message = self.messages.pop_front();
        self.events();
        message.map(|message| (message, 0))
    }

    /// Puts back what [`Self::take`] has returned. Bytes of a stream are part of their TCP connection: those of a lost
    /// one go with it.
    pub(super) fn put_back(&mut self, data: Vec<u8>, number: u64) {
        if self.spec.kind == ConnectionKind::Tcp {
            self.stream.put_back(data, number);
        } else {
            self.messages.push_front(data);
        }
    }

    /// The connection to another CPU.
    pub(super) fn s7(&mut self) -> Option<&mut Connection> {
        match &mut self.wire {
            Wire::S7(connection) => Some(connection),
            _ => None,
        }
    }

    /// Keeps the newest data of a USEND.
    pub(super) fn keep(&mut self, r_id: u32, items: Vec<u8>) {
        let is_older = self.inbox.contains_key(&r_id);
        if is_older || self.inbox.len() < INBOX {
            self.inbox.insert(r_id, (items, is_older));
        } else {
            self.traffic.errors += 1;
        }
    }

    /// Whether a BSEND under this R_ID has begun. This forgets it: the next part that is taken notes it again.
    pub(super) fn take_begun(&mut self, r_id: u32) -> bool {
        let at = self.begun.iter().position(|begun| *begun == r_id);
        at.map(|at| self.begun.swap_remove(at)).is_some()
    }

    /// A BRCV or URCV has asked for this R_ID.
    pub(super) fn know(&mut self, r_id: u32) {
        if !self.known.contains(&r_id) && self.known.len() < INBOX {
            self.known.push(r_id);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::iso::Tsap;

    /// How long a TCP connection of ours waits before it calls again, after each of these connections. Of each, the
    /// time that it was up is given, and whether the partner sent data.
    fn waits(connections: &[(u64, bool)]) -> Vec<u64> {
        let (local, remote) = (Tsap::default(), Tsap::default());
        let mut link = Link::new(Spec { id: 1, kind: ConnectionKind::Tcp, active: true, local, remote });
        let mut now = 0;
        let wait = |(lasts, data): &(u64, bool)| {
            assert!(link.wants_connection(now));
            link.connected(Settings::default(), now);
            if *data {
                link.receive(&[1]);
            }
            now += lasts;
            link.lost(now);
            let lost = now;
            while !link.wants_connection(now) {
                now += 1;
            }
            // The next one is wanted now.
            link.asked = false;
            now - lost
        };
        connections.iter().map(wait).collect()
    }

    #[test]
    fn a_partner_that_closes_at_once_is_called_less_and_less_often() {
        assert_eq!(waits(&[(1, false); 6]), [250, 500, 1000, 2000, 4000, 4000]);
        assert_eq!(waits(&[(1, false), (1, true), (1, true), (1, false)]), [250, 250, 250, 500]);
        assert_eq!(waits(&[(1, false), (1, false), (RETRY_MAX, false)]), [250, 500, 250]);
    }
}
