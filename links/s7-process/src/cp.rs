//! The process as an Ethernet CP: its end of the back plane, the connections of the station file with their machine,
//! and requests of partners to the CPU. (docs/cp343.md)
//!
//! Its owner provides the network and the time. The CP uses the network through [`Network`]; the owner reports its
//! events: [`Cp::connected`], [`Cp::accepted`], [`Cp::called`], [`Cp::receive`], [`Cp::lost`].

use std::net::{IpAddr, SocketAddr};
use std::time::{Duration, Instant};

use ob1_access::door::{self, News};
use ob1_access::settings::CpConnection;
use ob1_backplane::layout::{BOX_BYTES, BOXES};
use ob1_backplane::{ChangeMark, Counter, CpSide, CpuState, DriverState, Freshness, Leds};
use ob1_s7::coupling::{Action, Condition, ConnectionKind, Coupling, Spec};
use ob1_s7::iso::{Call, Transport, Tsap};
use ob1_s7::server::Settings;
use tracing::{info, warn};

use crate::asks::{Asks, Surroundings};
use crate::config::spec;

/// Bytes read at a time.
const READ: usize = 8192;
/// Reads of one connection before the others get their turn.
const READS: u32 = 8;

/// The result of a read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Received {
    /// This many bytes, or a datagram of this many.
    Bytes(usize),
    /// There is nothing at the moment.
    Nothing,
    /// The partner has closed the connection, and everything it has sent has been received.
    Ended,
    /// The connection is gone.
    Gone,
}

/// The network of a CP. `index` is the place of a connection in the list of the station file.
pub trait Network {
    /// Begins to make a TCP connection; false: it cannot be made.
    fn connect(&mut self, index: usize, partner: SocketAddr) -> bool;
    /// Closes a TCP connection, if there is one. Datagrams continue.
    fn close(&mut self, index: usize);
    /// Sends over a TCP connection; returns the number of bytes taken. 0: there is no room, or it is not connected yet.
    /// `None`: it is gone.
    fn send(&mut self, index: usize, bytes: &[u8]) -> Option<usize>;
    /// Sends a datagram. One that cannot be sent is lost, just as it may be lost on the network.
    fn datagram(&mut self, index: usize, bytes: &[u8]);
    /// Receives data that have come; never waits.
    fn receive(&mut self, index: usize, into: &mut [u8]) -> Received;
}

/// The data of a connection besides the machine.
#[derive(Debug)]
struct Line {
    /// The partner of an active connection; the permitted caller of a passive one.
    partner: Option<SocketAddr>,
    asks: Asks,
    /// Its number at the broker, a new one with each partner.
    client: u32,
    was: Condition,
    telling: Telling,
}

/// What is reported of a connection. A fault is reported once until a connection is of use: a partner that accepts and
/// closes again and again does not fill the log.
#[derive(Debug, Default)]
struct Telling {
    /// The last report was that it is up.
    says_up: bool,
    /// The end of a connection of no use was reported.
    is_tired: bool,
}

impl Telling {
    /// The connection is up, or not, and of use, or not: whether that is to be reported.
    fn tells(&mut self, is_up: bool, is_of_use: bool) -> bool {
        self.is_tired &= !is_of_use;
        let tells = if is_up { !self.says_up && !self.is_tired } else { self.says_up };
        if tells {
            self.says_up = is_up;
            self.is_tired |= !is_up && !is_of_use;
        }
        tells
    }
}

/// The Ethernet CP of a station; see [the module](self).
pub struct Cp {
    segment: CpSide,
    machine: Coupling,
    lines: Vec<Line>,
    start: Instant,
    due: Option<u64>,
    mark: Option<ChangeMark>,
    counted: (u64, u64),
}

impl std::fmt::Debug for Cp {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Cp").field("machine", &self.machine).finish_non_exhaustive()
    }
}

impl Cp {
    /// A CP without connections yet.
    #[must_use]
    pub fn new(mut segment: CpSide, now: Instant) -> Self {
        segment.set_state(DriverState::Starting);
        Self {
            segment,
            machine: Coupling::new(Vec::new(), Settings::default()),
            lines: Vec::new(),
            start: now,
            due: None,
            mark: None,
            counted: (0, 0),
        }
    }

    /// The connections of the station file.
    pub fn configure(&mut self, told: &[CpConnection], settings: Settings) {
        self.machine = Coupling::new(told.iter().map(spec).collect(), settings);
        let line = |told: &CpConnection| Line {
            partner: told.partner,
            asks: Asks::default(),
            client: 0,
            was: Condition::Down,
            telling: Telling::default(),
        };
        self.lines = told.iter().map(line).collect();
        // The content of the boxes was meant for a previous process: the CPU counts those jobs as failed.
        for index in 0..BOXES {
            let _old = self.segment.read_box(index, &mut [0; BOX_BYTES]);
        }
        self.segment.set_leds(Leds { power: true, ..Leds::default() });
        self.segment.set_state(DriverState::Ready);
        info!(connections = self.lines.len(), "the CP is ready");
    }

    /// The connections, for tools that show the station.
    #[must_use]
    pub fn told(&self) -> Vec<door::Connection> {
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

    fn ms(&self, now: Instant) -> u64 {
        u64::try_from(now.saturating_duration_since(self.start).as_millis()).unwrap_or(u64::MAX)
    }

    fn spec(&self, index: usize) -> Option<&Spec> {
        self.machine.spec(index)
    }

    fn is_udp(&self, index: usize) -> bool {
        self.spec(index).is_some_and(|spec| spec.kind == ConnectionKind::Udp)
    }

    /// A sign of life.
    pub fn beat(&mut self) {
        self.segment.beat();
    }

    /// The connection that a call is meant for.
    #[must_use]
    pub fn find(&self, call: &Call, peer: IpAddr) -> Option<usize> {
        self.machine.find(call, |index| self.may_call(index, peer))
    }

    /// Whether this is the TSAP of a connection that waits for calls.
    #[must_use]
    pub fn has_tsap(&self, called: &Tsap) -> bool {
        self.machine.has_tsap(called)
    }

    /// Whether the partner of a passive connection may have this address.
    #[must_use]
    pub fn may_call(&self, index: usize, peer: IpAddr) -> bool {
        self.lines.get(index).is_some_and(|line| line.partner.is_none_or(|partner| is_of(partner, peer)))
    }

    /// A partner has called for a connection.
    pub fn called(&mut self, index: usize, transport: Transport, now: Instant) {
        if let Some(line) = self.lines.get_mut(index) {
            line.asks = Asks::default();
        }
        let now = self.ms(now);
        self.machine.called(index, transport, now);
    }

    /// The requested TCP connection has been made.
    pub fn connected(&mut self, index: usize, now: Instant) {
        let now = self.ms(now);
        self.machine.connected(index, now);
    }

    /// A partner has connected to a passive TCP connection: the newest gets it.
    pub fn accepted(&mut self, index: usize, now: Instant) {
        let now = self.ms(now);
        self.machine.lost(index, now);
        self.machine.connected(index, now);
    }

    /// The partner has closed the TCP connection.
    fn finished(&mut self, index: usize, now: Instant, net: &mut dyn Network) {
        net.close(index);
        let now = self.ms(now);
        self.machine.finished(index, now);
    }

    /// The TCP connection was lost, or could not be made.
    pub fn lost(&mut self, index: usize, now: Instant, net: &mut dyn Network) {
        net.close(index);
        let now = self.ms(now);
        self.machine.lost(index, now);
    }

    /// Handles the CPU's boxes, everything that is due, and the consequences.
    pub fn serve(&mut self, around: &mut Surroundings<'_>, number: &mut dyn FnMut() -> u32, net: &mut dyn Network) {
        let at = around.now;
        let mark = self.segment.changes();
        self.mark = Some(mark);
        let now = self.ms(at);
        // The state before the boxes: those of a CPU in STOP have everything that its program has done before.
        let runs = !matches!(self.segment.cpu_state(), Ok(CpuState::Stop) | Err(_));
        let mut boxes = Vec::new();
        for index in 0..BOXES {
            let mut block = [0; BOX_BYTES];
            if self.segment.box_changed(index) && self.segment.read_box(index, &mut block) == Freshness::Fresh {
                self.machine.settle(index, &block, now);
                boxes.push((index, block));
            }
        }
        self.machine.run(runs);
        boxes.iter().for_each(|(index, block)| self.machine.show(*index, block, now));
        self.due = self.machine.tick(now);
        for index in 0..self.lines.len() {
            self.questions(index, around, number);
        }
        while let Some(action) = self.machine.action() {
            match action {
                Action::Connect(index) => {
                    let partner = self.lines.get(index).and_then(|line| line.partner);
                    if !partner.is_some_and(|partner| net.connect(index, partner)) {
                        self.lost(index, at, net);
                    }
                }
                Action::Close(index) => net.close(index),
            }
        }
        (0..self.lines.len()).for_each(|index| self.send(index, at, net));
        while let Some((index, block)) = self.machine.next_box() {
            self.segment.write_box(index, block);
        }
        self.tell();
    }

    /// Handles requests of partners to the CPU.
    fn questions(&mut self, index: usize, around: &mut Surroundings<'_>, number: &mut dyn FnMut() -> u32) {
        let is_of_use = self.machine.is_of_use(index, self.ms(around.now));
        let Some(line) = self.lines.get_mut(index) else { return };
        let condition = self.machine.condition(index).0;
        let id = self.machine.spec(index).map_or(0, |spec| spec.id);
        let is_up = condition == Condition::Up;
        if line.telling.tells(is_up, is_of_use) {
            if is_up {
                info!("connection {id} is up");
            } else {
                warn!("connection {id} is down");
            }
        }
        if condition != line.was {
            if is_up {
                line.asks = Asks::default();
                line.client = number();
                let partner = line.partner.map(|partner| partner.to_string());
                around.door.partner(line.client, partner.unwrap_or_else(|| format!("connection {id}")));
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

    /// Takes an answer of the broker; false: it is not for a connection here.
    pub fn news(&mut self, client: u32, news: &News, around: &mut Surroundings<'_>) -> bool {
        let Some(index) = self.lines.iter().position(|line| line.client == client) else { return false };
        let Some(line) = self.lines.get_mut(index) else { return false };
        let machine = &mut self.machine;
        line.asks.news(client, news, around, &mut |id, reply| machine.reply(index, id, reply));
        true
    }

    fn send(&mut self, index: usize, at: Instant, net: &mut dyn Network) {
        if self.is_udp(index) {
            while let Some(datagram) = self.machine.datagram(index) {
                net.datagram(index, &datagram);
            }
            return;
        }
        let now = self.ms(at);
        while !self.machine.output(index).is_empty() {
            match net.send(index, self.machine.output(index)) {
                Some(0) => return,
                Some(len) => self.machine.sent(index, len, now),
                None => return self.lost(index, at, net),
            }
        }
    }

    /// Receives the data of a connection.
    pub fn receive(&mut self, index: usize, at: Instant, net: &mut dyn Network) {
        let (mut buffer, is_udp, now) = ([0; READ], self.is_udp(index), self.ms(at));
        for _ in 0..READS {
            let room = if is_udp { READ } else { self.machine.room(index).min(READ) };
            if room == 0 {
                return;
            }
            match net.receive(index, buffer.get_mut(..room).unwrap_or_default()) {
                Received::Bytes(len) => self.machine.receive(index, buffer.get(..len).unwrap_or_default(), now),
                Received::Nothing => return,
                Received::Ended => return self.finished(index, at, net),
                Received::Gone => return self.lost(index, at, net),
            }
        }
    }

    /// Whether [`Cp::receive`] would accept data.
    #[must_use]
    pub fn wants_read(&self, index: usize) -> bool {
        self.is_udp(index) || self.machine.room(index) > 0
    }

    /// Whether something waits for room in a TCP connection.
    #[must_use]
    pub fn wants_write(&self, index: usize) -> bool {
        !self.machine.output(index).is_empty()
    }

    /// When [`Cp::serve`] is due at the latest.
    #[must_use]
    pub fn due(&self) -> Option<Instant> {
        let asks = self.lines.iter().filter_map(|line| line.asks.due()).min();
        let machine = self.due.map(|ms| self.start + Duration::from_millis(ms));
        [asks, machine].into_iter().flatten().min()
    }

    /// True: the CPU side rings for its next change; false: there is one already.
    pub fn prepare_sleep(&mut self) -> bool {
        self.mark.is_some_and(|mark| self.segment.prepare_sleep(mark))
    }

    /// The sleep is over.
    pub fn awake(&mut self) {
        self.segment.awake();
    }

    /// Updates LEDs and counters.
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

/// Whether a peer has the address of this partner. A socket for IPv6 and IPv4 shows the latter as a part of the former.
#[must_use]
pub fn is_of(partner: SocketAddr, peer: IpAddr) -> bool {
    partner.ip().to_canonical() == peer.to_canonical()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_connection_that_comes_and_goes_is_reported_once_until_it_is_of_use() {
        let mut telling = Telling::default();
        let mut told = |states: &[(bool, bool)]| -> Vec<bool> {
            states.iter().map(|(is_up, is_of_use)| telling.tells(*is_up, *is_of_use)).collect()
        };
        assert_eq!(told(&[(false, false), (true, false), (true, false)]), [false, true, false]);
        assert_eq!(told(&[(false, false), (true, false), (false, false), (true, false)]), [true, false, false, false]);
        assert_eq!(told(&[(true, true), (true, true), (false, true), (false, true)]), [true, false, true, false]);
        assert_eq!(told(&[(true, false), (false, false), (true, false)]), [true, true, false], "the next fault");
    }

    #[test]
    fn a_partner_is_known_on_a_socket_for_both_kinds_of_addresses() {
        for (partner, peer, is_it) in [
            ("192.0.2.7:102", "192.0.2.7", true),
            ("192.0.2.7:102", "::ffff:192.0.2.7", true),
            ("192.0.2.7:102", "::ffff:192.0.2.8", false),
            ("[2001:db8::7]:102", "2001:db8::7", true),
            ("[2001:db8::7]:102", "192.0.2.7", false),
        ] {
            let partner: SocketAddr = partner.parse().expect("an address");
            assert_eq!(is_of(partner, peer.parse().expect("an address")), is_it, "{partner} {peer}");
        }
    }
}
