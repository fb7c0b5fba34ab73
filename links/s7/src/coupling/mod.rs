//! An Ethernet CP as a machine: the connections of its station to other PLCs, and the jobs of its handling blocks on
//! them. (docs/cp343.md)
//!
//! Its owner makes the TCP connections and reports lost ones, moves bytes, passes the CPU's boxes to it and its answers
//! to the CPU. It has no socket and no clock; times are milliseconds from any origin.

mod blocks;
mod boxes;
mod connection;
mod datagram;
mod stream;
mod vars;

use std::collections::VecDeque;

use ob1_words::boxes::{BOXES, Service, status};

use crate::iso::{Call, Transport, Tsap};
use crate::server::{Reply, Request, Settings};
use boxes::{Phase, Slot};
use connection::Link;

/// Time before the first attempt to restore a lost connection, and the maximum between two attempts.
const RETRY: u64 = 250;
const RETRY_MAX: u64 = 4_000;
/// Time limit for setting up a connection, and for a job of ours.
const PATIENCE: u64 = 10_000;
/// The additional time for a piece of a BSEND: the partner's program takes one a cycle, and its answer to the last part
/// comes when it has all of them.
const TAKING: u64 = 1_000;
/// How long a part of BSEND waits for a BRCV that is known, but not ready.
const NOT_READY: u64 = 3_000;

/// The kinds of connection of an Ethernet CP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConnectionKind {
    /// Plain TCP: a stream of bytes.
    Tcp,
    /// UDP: telegrams without a connection.
    Udp,
    /// ISO on TCP: telegrams.
    Iso,
    /// S7: PUT, GET, USEND, BSEND.
    S7,
}

impl ConnectionKind {
    /// The name in the station file.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tcp => "tcp",
            Self::Udp => "udp",
            Self::Iso => "iso-on-tcp",
            Self::S7 => "s7",
        }
    }
}

/// A connection as it is configured.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Spec {
    /// ID of the handling blocks.
    pub id: u16,
    /// Its kind, which decides the protocol.
    pub kind: ConnectionKind,
    /// We make the connection.
    pub active: bool,
    /// Our TSAP; empty for TCP and UDP.
    pub local: Tsap,
    /// The partner's TSAP; for a passive connection an empty one means any partner.
    pub remote: Tsap,
}

impl Spec {
    fn waits_at(&self, called: &Tsap) -> bool {
        let has_tsaps = matches!(self.kind, ConnectionKind::Iso | ConnectionKind::S7);
        !self.active && has_tsaps && self.local == *called
    }
}

/// A request of the machine to its owner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// Make the TCP connection of this index.
    Connect(usize),
    /// Close the TCP connection of this index.
    Close(usize),
}

/// State of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Condition {
    /// It does not exist.
    Down,
    /// It is being set up.
    Coming,
    /// Data can be sent.
    Up,
}

/// Counters of a connection.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Jobs that ended without error.
    pub jobs: u64,
    /// Jobs that ended with one.
    pub errors: u64,
}

/// The connections of a CP.
#[derive(Debug)]
pub struct Coupling {
    links: Vec<Link>,
    slots: Vec<Slot>,
    actions: VecDeque<Action>,
    settings: Settings,
    now: u64,
    runs: bool,
}

impl Coupling {
    /// A CP with these connections; partners of S7 connections are served with these settings.
    #[must_use]
    pub fn new(specs: Vec<Spec>, settings: Settings) -> Self {
        Self {
            links: specs.into_iter().map(Link::new).collect(),
            slots: (0..BOXES).map(|_| Slot::default()).collect(),
            actions: VecDeque::new(),
            settings,
            now: 0,
            runs: false,
        }
    }

    /// The next thing to do.
    pub fn action(&mut self) -> Option<Action> {
        self.actions.pop_front()
    }

    /// The CPU runs or stops: in STOP no block is called, and every job is dropped.
    pub fn run(&mut self, runs: bool) {
        if self.runs && !runs {
            (0..self.slots.len()).for_each(|index| self.cancel(index));
        }
        self.runs = runs;
    }

    /// The configured connection that matches this call, among those that this partner may call. A connection that
    /// names the partner's TSAP goes before one that takes any partner.
    #[must_use]
    pub fn find(&self, call: &Call, may_call: impl Fn(usize) -> bool) -> Option<usize> {
        let fits = |(index, link): &(usize, &Link)| {
            let remote = &link.spec.remote;
            let is_partner = remote.bytes().is_empty() || *remote == call.calling;
            link.spec.waits_at(&call.called) && is_partner && may_call(*index)
        };
        let fitting = self.links.iter().enumerate().filter(fits);
        fitting.min_by_key(|(_, link)| link.spec.remote.bytes().is_empty()).map(|(index, _)| index)
    }

    /// Whether this is the TSAP of a connection that waits for calls.
    #[must_use]
    pub fn has_tsap(&self, called: &Tsap) -> bool {
        self.links.iter().any(|link| link.spec.waits_at(called))
    }

    /// The configured connection of an index.
    #[must_use]
    pub fn spec(&self, index: usize) -> Option<&Spec> {
        self.links.get(index).map(|link| &link.spec)
    }

    /// State and counters of a connection.
    #[must_use]
    pub fn condition(&self, index: usize) -> (Condition, Traffic) {
        self.links.get(index).map_or((Condition::Down, Traffic::default()), |link| (link.condition(), link.traffic))
    }

    /// Whether the present connection, or else the last one, is of use: its partner has sent something after the setup,
    /// or it has lasted.
    #[must_use]
    pub fn is_of_use(&self, index: usize, now: u64) -> bool {
        self.links.get(index).is_some_and(|link| link.is_of_use(now))
    }

    /// The agreed PDU of an S7 connection; 0: none.
    #[must_use]
    pub fn agreed_pdu(&self, index: usize) -> u16 {
        self.links.get(index).map_or(0, Link::agreed_pdu)
    }

    /// Time passes; returns when [`Coupling::tick`] is due again.
    pub fn tick(&mut self, now: u64) -> Option<u64> {
        self.now = now;
        for index in 0..self.links.len() {
            self.times(index);
        }
        let due = self.links.iter().filter_map(Link::due).min();
        self.slots.iter().filter_map(|slot| slot.held.as_ref().map(|held| held.until)).chain(due).min()
    }

    /// A partner has called, and [`Coupling::find`] has found this connection for it. An existing connection is given
    /// up, because the partner has restarted.
    pub fn called(&mut self, index: usize, transport: Transport, now: u64) {
        self.lost(index, now);
        self.is_another(index);
        let settings = self.settings;
        if let Some(link) = self.links.get_mut(index) {
            link.called(transport, settings, now);
        }
        self.advance(index);
    }

    /// The TCP connection has been made, by us or by the partner.
    pub fn connected(&mut self, index: usize, now: u64) {
        self.now = now;
        self.is_another(index);
        let settings = self.settings;
        if let Some(link) = self.links.get_mut(index) {
            link.connected(settings, now);
        }
        self.advance(index);
    }

    /// The partner has closed the TCP connection, and everything that it has sent has been received: blocks still get
    /// it.
    pub fn finished(&mut self, index: usize, now: u64) {
        self.now = now;
        let Some(link) = self.links.get_mut(index) else { return };
        link.finished(now);
        self.orphans(index);
    }

    /// The TCP connection was lost, or could not be made.
    pub fn lost(&mut self, index: usize, now: u64) {
        self.now = now;
        let Some(link) = self.links.get_mut(index) else { return };
        link.lost(now);
        self.orphans(index);
    }

    /// Number of bytes that [`Coupling::receive`] accepts now.
    #[must_use]
    pub fn room(&self, index: usize) -> usize {
        self.links.get(index).map_or(0, Link::room)
    }

    /// Bytes, or one datagram, from the wire.
    pub fn receive(&mut self, index: usize, bytes: &[u8], now: u64) {
        self.now = now;
        if let Some(link) = self.links.get_mut(index) {
            link.receive(bytes);
        }
        self.advance(index);
    }

    /// The bytes to send.
    #[must_use]
    pub fn output(&self, index: usize) -> &[u8] {
        self.links.get(index).map_or(&[], Link::output)
    }

    /// Reports that `count` bytes of the output have been sent.
    pub fn sent(&mut self, index: usize, count: usize, now: u64) {
        self.now = now;
        if let Some(link) = self.links.get_mut(index) {
            link.sent(count);
        }
        self.advance(index);
    }

    /// The next datagram to send.
    pub fn datagram(&mut self, index: usize) -> Option<Vec<u8>> {
        self.links.get_mut(index)?.take_datagram()
    }

    /// The next request of a partner to the CPU.
    pub fn next_ask(&mut self, index: usize) -> Option<Request> {
        self.links.get_mut(index)?.s7()?.next_ask()
    }

    /// The CPU's reply to it.
    pub fn reply(&mut self, index: usize, id: u64, reply: Reply) {
        if let Some(connection) = self.links.get_mut(index).and_then(Link::s7) {
            connection.reply(id, reply);
        }
        self.advance(index);
    }

    /// Advances a connection's jobs after any event on it.
    fn advance(&mut self, index: usize) {
        self.came(index);
        if self.links.get_mut(index).is_some_and(Link::broken) {
            self.drop_link(index);
        }
        self.flushed(index);
        self.waiting(index);
        self.queued(index);
    }

    /// A TCP connection has replaced the previous one: a pending close was for the old one and must not close the new
    /// one.
    fn is_another(&mut self, index: usize) {
        self.actions.retain(|action| *action != Action::Close(index));
    }

    /// Closes a connection from our side.
    fn drop_link(&mut self, index: usize) {
        let now = self.now;
        self.actions.push_back(Action::Close(index));
        if let Some(link) = self.links.get_mut(index) {
            link.lost(now);
        }
        self.orphans(index);
    }

    fn times(&mut self, index: usize) {
        let now = self.now;
        let Some(link) = self.links.get_mut(index) else { return };
        if link.is_late(now) {
            self.drop_link(index);
        } else if link.wants_connection(now) {
            self.actions.push_back(Action::Connect(index));
        }
        self.expire(index);
    }

    /// Ends the jobs of a lost connection.
    fn orphans(&mut self, index: usize) {
        let Some(id) = self.links.get(index).map(|link| link.spec.id) else { return };
        for at in 0..self.slots.len() {
            let Some(slot) = self.slots.get_mut(at).filter(|slot| slot.order.id == id) else { continue };
            slot.held = None;
            if slot.phase != Phase::Running {
                continue;
            }
            // A BSEND that has begun begins anew on the next connection.
            slot.total = None;
            slot.give.clear();
            match slot.order.service {
                Some(Service::Send) => self.fail(at, status::NOT_CONNECTED),
                Some(Service::Usend | Service::Bsend | Service::Put | Service::Get) => {
                    self.fail(at, status::CONNECTION);
                }
                _ => {}
            }
        }
    }

    fn link_of(&self, id: u16) -> Option<usize> {
        self.links.iter().position(|link| link.spec.id == id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_call_finds_its_connection() {
        let tsap = |text: &str| Tsap::new(text.as_bytes()).expect("short");
        let spec =
            |id, kind, active, remote: &str| Spec { id, kind, active, local: tsap("HERE"), remote: tsap(remote) };
        let specs = vec![
            spec(1, ConnectionKind::Iso, true, "A"),
            spec(2, ConnectionKind::Iso, false, ""),
            spec(3, ConnectionKind::S7, false, "A"),
            spec(4, ConnectionKind::Iso, false, "A"),
        ];
        let machine = Coupling::new(specs, Settings::default());
        let call = |calling| Call { calling: tsap(calling), called: tsap("HERE"), routed: false };
        assert_eq!(machine.find(&call("A"), |_| true), Some(2), "the one that names it");
        assert_eq!(machine.find(&call("A"), |index| index == 3), Some(3), "the one that this partner may call");
        assert_eq!(machine.find(&call("B"), |_| true), Some(1));
        assert_eq!(machine.find(&call("B"), |index| index != 1), None);
        assert_eq!([machine.has_tsap(&tsap("HERE")), machine.has_tsap(&tsap("THERE"))], [true, false]);
    }
}
