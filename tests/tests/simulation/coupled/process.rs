//! Simulates the process `ob1-s7 --cp`: the CP, the door and the calls of the link's port are real; only its life cycle
//! and its network are virtual.

use std::net::{IpAddr, Ipv4Addr};
use std::os::fd::OwnedFd;
use std::time::{self, Duration};

use ob1_access::door::{Door, News, Reading};
use ob1_backplane::{CpSide, Segment};
use ob1_broker::Broker;
use ob1_line::sim::SplitMix64;
use ob1_s7::server::Connection;
use ob1_s7_process::asks::Surroundings;
use ob1_s7_process::config::Config;
use ob1_s7_process::cp::{Cp, Received};
use ob1_socket::handover;
use ob1_tests::sim::life::{Life, Turn};
use ob1_time::{Instant, Span};

use super::SECOND;
use super::net::{Net, Socket, Sockets};
use super::program::LINES;

/// Between two signs of life.
const BEAT: Span = Span::from_millis(200);

/// A running process.
struct Alive {
    cp: Cp,
    door: Door,
    config: Option<Config>,
    reading: Reading,
    /// Numbers of clients at the broker.
    number: u32,
    lines: [Socket; LINES.len()],
    /// Clients that have not requested a connection yet.
    fronts: Vec<(u64, Connection)>,
    beat: Instant,
    tick: Instant,
}

/// The process, if it is running.
pub(crate) struct Process {
    me: usize,
    segment: Segment,
    life: Life,
    alive: Option<Alive>,
    /// The zero of virtual time, for code that uses the time of the machine.
    base: time::Instant,
    due: Instant,
    /// It gets no core until then, and up to `late` after each of its turns.
    held_up: Instant,
    late: Span,
    rng: SplitMix64,
    pub(crate) kills: u64,
    /// Number of times it was ready.
    pub(crate) ups: u64,
}

impl Process {
    pub(crate) fn new(me: usize, segment: Segment, life: Life, base: time::Instant, late: Span) -> Self {
        Self {
            me,
            segment,
            life,
            alive: None,
            base,
            due: Instant::NEVER,
            held_up: Instant::START,
            late,
            rng: SplitMix64::new(me as u64),
            kills: 0,
            ups: 0,
        }
    }

    pub(crate) fn next(&self, now: Instant, net: &Net) -> Instant {
        let Some(alive) = &self.alive else { return self.life.next_event() };
        let reads = |id: u64| {
            let line = alive.lines.iter().position(|socket| socket.id() == Some(id));
            line.is_none_or(|line| matches!(alive.lines[line], Socket::Up(_)) && alive.cp.wants_read(line))
        };
        self.life.next_event().min(self.due.min(net.next(self.me, now, reads)).max(self.held_up))
    }

    /// Handles everything that is due.
    pub(crate) fn advance(&mut self, now: Instant, broker: &mut Broker, net: &mut Net) {
        while let Some(turn) = self.life.advance(now) {
            match turn {
                Turn::Begins => self.begins(now, broker),
                Turn::Killed => panic!("at {now}: the supervisor kills a process that does nothing wrong"),
            }
        }
        if now >= self.held_up {
            self.poll(now, broker, net);
            if !self.late.is_zero() {
                self.held_up = now + self.rng.span_below(self.late);
            }
        }
    }

    fn begins(&mut self, now: Instant, broker: &mut Broker) {
        let side = CpSide::attach(&self.segment).expect("a segment");
        assert!(side.has_boxes());
        let (ours, theirs): (OwnedFd, OwnedFd) = handover::pair().expect("a socket");
        broker.connect(0, ours, now);
        self.alive = Some(Alive {
            cp: Cp::new(side, self.base + Duration::from(now.since_start())),
            door: Door::new(theirs).expect("a door"),
            config: None,
            reading: Reading::new(),
            number: 0,
            lines: [Socket::None; LINES.len()],
            fronts: Vec::new(),
            beat: now,
            tick: now,
        });
    }

    /// To be called after a cycle of the CPU and of its broker.
    pub(crate) fn listen(&mut self, now: Instant) {
        if let Some(heard) = self.life.heard(now, self.alive.is_some()) {
            self.due = self.due.min(heard);
        }
    }

    /// The broker may have something for it.
    pub(crate) fn nudge(&mut self, at: Instant) {
        self.due = self.due.min(at);
    }

    /// `kill -9`, one time in three while it writes a box. False: there is no process.
    pub(crate) fn kill(&mut self, now: Instant, at: usize, net: &mut Net) -> bool {
        let Some(alive) = self.alive.take() else { return false };
        let ids = alive.lines.iter().filter_map(|socket| socket.id()).chain(alive.fronts.iter().map(|front| front.0));
        ids.for_each(|id| net.kill(id, self.me, now));
        self.kills += 1;
        self.due = Instant::NEVER;
        if self.life.dies_writing() {
            use ob1_backplane::layout::{BOX_STRIDE, BOXES, FIELDS};
            let boxes = FIELDS.iter().find(|field| field.name == "boxes.to_cpu").expect("boxes").offset;
            let sequence = boxes + at % BOXES * BOX_STRIDE;
            for (offset, change) in [(sequence, 1), (sequence + 8, 0x0101), (sequence + 48, 0xFF00_FF00)] {
                let word = self.segment.peek(offset).expect("it lies in the segment");
                self.segment.poke(offset, word | change);
            }
        }
        self.life.died(now);
        true
    }

    /// Runs like `Server::run` until it may sleep.
    fn poll(&mut self, now: Instant, broker: &mut Broker, net: &mut Net) {
        let Some(alive) = &mut self.alive else { return };
        let at = self.base + Duration::from(now.since_start());
        alive.cp.awake();
        if now >= alive.beat {
            alive.door.beat();
            alive.cp.beat();
            alive.beat = now + BEAT;
        }
        if now >= alive.tick {
            alive.door.tick();
            alive.tick = now + SECOND;
        }
        loop {
            let was_ready = alive.config.is_some();
            alive.round(self.me, now, at, net);
            self.ups += u64::from(alive.config.is_some() && !was_ready);
            broker.step(now);
            if alive.cp.prepare_sleep() {
                break;
            }
        }
        let cp = alive.cp.due().map(|due| due.saturating_duration_since(self.base).into());
        let cp = cp.map_or(Instant::NEVER, |time: Span| Instant::START.saturating_add(time));
        self.due = cp.min(alive.beat).min(alive.tick).max(now + Span::from_nanos(1));
    }
}

impl Alive {
    fn round(&mut self, me: usize, now: Instant, at: time::Instant, net: &mut Net) {
        self.door.pump().expect("the broker is there");
        if self.config.is_none() {
            let Some(welcome) = self.door.welcome() else { return };
            let (config, connections) = Config::of(welcome).expect("keys");
            self.cp.configure(&connections, config.settings);
            self.config = Some(config);
        }
        let Some(config) = self.config else { return };
        self.network(me, now, at, net, &config);
        while let Some(news) = self.door.take_news() {
            if let News::Written { client, .. } | News::Answer { client, .. } = &news {
                let mut around =
                    Surroundings { door: &mut self.door, reading: &mut self.reading, config: &config, now: at };
                self.cp.news(*client, &news, &mut around);
            }
        }
        let mut around = Surroundings { door: &mut self.door, reading: &mut self.reading, config: &config, now: at };
        let number = &mut self.number;
        let mut numbers = || {
            *number += 1;
            *number
        };
        self.cp.serve(&mut around, &mut numbers, &mut Sockets { net, me, now, lines: &mut self.lines });
        self.door.pump().expect("the broker is there");
    }

    /// Handles data from the network.
    fn network(&mut self, me: usize, now: Instant, at: time::Instant, net: &mut Net, config: &Config) {
        for line in 0..LINES.len() {
            if let Socket::Coming(id) = self.lines[line]
                && net.is_made(id, me, now)
            {
                self.lines[line] = Socket::Up(id);
                self.cp.connected(line, at);
            }
            self.cp.receive(line, at, &mut Sockets { net, me, now, lines: &mut self.lines });
        }
        while let Some((id, line)) = net.accept(me, now) {
            if LINES[line].0 == "tcp" {
                Sockets { net, me, now, lines: &mut self.lines }.take(line, id);
                self.cp.accepted(line, at);
            } else {
                self.fronts.push((id, Connection::new(config.settings)));
            }
        }
        let mut index = 0;
        while index < self.fronts.len() {
            let (id, front) = &mut self.fronts[index];
            let mut buffer = [0; 64];
            match net.receive(*id, me, now, &mut buffer) {
                Received::Bytes(len) => front.receive(&buffer[..len]),
                Received::Nothing => {
                    index += 1;
                    continue;
                }
                Received::Ended | Received::Gone => {
                    net.close(*id, me, now);
                    self.fronts.swap_remove(index);
                    continue;
                }
            }
            let peer = IpAddr::V4(Ipv4Addr::new(127, 0, 0, 11 - me as u8));
            if let Some(line) = front.call().map(|call| self.cp.find(call, peer).expect("a call for a connection")) {
                let (id, front) = self.fronts.swap_remove(index);
                Sockets { net, me, now, lines: &mut self.lines }.take(line, id);
                self.cp.called(line, front.into_transport(), at);
            }
        }
    }
}

impl Sockets<'_> {
    /// The newest partner gets the connection; the previous one is closed.
    fn take(&mut self, line: usize, id: u64) {
        if let Some(before) = std::mem::replace(&mut self.lines[line], Socket::Up(id)).id() {
            self.net.close(before, self.me, self.now);
        }
    }
}
