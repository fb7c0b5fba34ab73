//! A simulated line with any number of participants: two on a cable, or many on a two-wire RS-485 bus.
//!
//! It keeps the time of every character and draws faults from a seed. Each participant has its own character frame, and
//! one that receives with another baud rate or parity gets faults; on a two-wire line each receives everybody, a sender
//! does not receive, and two senders at the same time corrupt both; a participant may send a break; faults may come in
//! bursts.

use std::collections::VecDeque;

use ob1_serial::LineInput;

use super::faults::Fate;
use super::{FaultRates, SplitMix64};
use crate::line::{Instant, LineFault, ModemLines, Span};
use crate::supported_frames::{LineSettings, Parity};

/// Number of a participant, in the order in which they joined.
pub type Participant = usize;

/// Transmissions a sender remembers: more than one character can overlap with.
const REMEMBERED: usize = 8;

/// The character frame with which a participant sends and receives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    /// Time of one character.
    pub char_time: Span,
    /// Parity bit of a character.
    pub parity: Parity,
    /// Data bits, 5 to 8.
    pub data_bits: u8,
}

impl Frame {
    /// The frame of these settings.
    pub const fn of(settings: &LineSettings) -> Self {
        Self { char_time: settings.time_of(1), parity: settings.parity, data_bits: settings.data_bits }
    }

    /// The result of receiving with this frame a character sent with another.
    fn hears(&self, sent: &Self, byte: u8) -> Result<u8, LineFault> {
        // A UART tolerates a difference of 2 to 3 %.
        if self.char_time.abs_diff(sent.char_time) > sent.char_time / 40 {
            return Err(LineFault::Framing);
        }
        if self.parity != Parity::None && self.parity != sent.parity {
            return Err(LineFault::Parity);
        }
        Ok(byte & (0xFF >> (8 - self.data_bits.clamp(5, 8))))
    }
}

/// Periods with more faults.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bursts {
    /// Mean time from the end of one burst to the beginning of the next.
    pub every: Span,
    /// Duration of a burst.
    pub length: Span,
    /// Faults of characters that begin in a burst.
    pub faults: FaultRates,
}

/// Properties of the bus.
#[derive(Debug, Clone, Copy)]
pub struct BusConfig {
    /// Two wires: all on the same pair.
    pub half_duplex: bool,
    /// Panic when two send at the same time on two wires, or when time goes back.
    pub strict: bool,
    /// Faults that are always there.
    pub faults: FaultRates,
    /// Faults that come in bursts; `None`: there are none.
    pub bursts: Option<Bursts>,
}

impl BusConfig {
    /// A line without faults. On two wires collisions are counted.
    pub const fn new(half_duplex: bool) -> Self {
        Self { half_duplex, strict: false, faults: FaultRates::NONE, bursts: None }
    }
}

/// An event of a participant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BusEvent {
    /// This many characters were received; they are at the beginning of the buffer.
    Rx(usize),
    /// A character that could not be read, in its place between the others.
    Fault(LineFault),
    /// The last bit of everything written by this participant has been sent.
    TxDone,
    /// The present modem lines (null modem: the other's RTS is CTS, its DTR is DSR and carrier).
    Modem(ModemLines),
}

impl BusEvent {
    /// The event as input of a protocol machine, with the buffer of the event. `None` for modem lines, which a protocol
    /// on a bus does not get.
    pub fn input(self, buffer: &[u8]) -> Option<LineInput<'_>> {
        Some(match self {
            Self::Rx(len) => LineInput::Rx(buffer.get(..len)?),
            Self::Fault(fault) => LineInput::Fault(fault),
            Self::TxDone => LineInput::TxDone,
            Self::Modem(_) => return None,
        })
    }
}

/// A character in transit, or its fault.
#[derive(Debug, Clone, Copy)]
struct Item {
    begin: Instant,
    end: Instant,
    /// When it is received: at its end, or later.
    arrival: Instant,
    frame: Frame,
    what: What,
}

#[derive(Debug, Clone, Copy)]
enum What {
    Byte(u8),
    Fault(LineFault),
}

/// An event not yet delivered to a participant.
#[derive(Debug, Clone, Copy)]
enum News {
    Byte(u8),
    Other(BusEvent),
}

#[derive(Debug, Clone)]
struct Member {
    present: bool,
    frame: Frame,
    queue: VecDeque<Item>,
    /// When it sent: begin and end of each uninterrupted transmission, the newest last.
    spoke: VecDeque<(Instant, Instant)>,
    busy_until: Instant,
    owes_done: bool,
    last_arrival: Instant,
    /// The modem lines it sees, and its own RTS and DTR.
    modem: ModemLines,
    drives: (bool, bool),
    news: VecDeque<News>,
}

impl Member {
    /// Converts another's RTS and DTR to modem lines here.
    fn see(&mut self, rts: bool, dtr: bool) {
        let lines = ModemLines { cts: rts, dsr: dtr, ri: false, cd: dtr };
        if self.modem != lines {
            self.modem = lines;
            self.news.push_back(News::Other(BusEvent::Modem(lines)));
        }
    }

    fn spoke_in(&self, begin: Instant, end: Instant) -> bool {
        self.spoke.iter().any(|(from, to)| *from < end && begin < *to)
    }

    fn speak(&mut self, begin: Instant, end: Instant) {
        match self.spoke.back_mut() {
            Some((_, to)) if *to == begin => *to = end,
            _ => {
                if self.spoke.len() == REMEMBERED {
                    self.spoke.pop_front();
                }
                self.spoke.push_back((begin, end));
            }
        }
    }

    /// No two characters arrive within less than a character time.
    fn push(&mut self, begin: Instant, time: Span, delay: Span, what: What) {
        let arrival = (begin + time).max(self.last_arrival + time) + delay;
        self.last_arrival = arrival;
        self.queue.push_back(Item { begin, end: begin + time, arrival, frame: self.frame, what });
    }
}

/// The times of bursts, drawn one after the other from a separate random stream.
#[derive(Debug, Clone)]
struct Weather {
    rng: SplitMix64,
    bursts: Bursts,
    begin: Instant,
}

impl Weather {
    fn new(bursts: Bursts, seed: u64) -> Self {
        let mut weather = Self { rng: SplitMix64::new(seed), bursts, begin: Instant::START };
        weather.next(Instant::START);
        weather
    }

    fn next(&mut self, from: Instant) {
        let every = self.bursts.every;
        self.begin = from.saturating_add(every / 2).saturating_add(self.rng.span_below(every));
    }

    fn is_bad(&mut self, at: Instant) -> bool {
        // With a burst of length 0 and `every` 0 this loop would never end.
        let length = self.bursts.length.max(Span::from_nanos(1));
        while at >= self.begin.saturating_add(length) {
            self.next(self.begin + length);
        }
        at >= self.begin
    }
}

/// A line between any number of participants.
#[derive(Debug, Clone)]
pub struct SimBus {
    config: BusConfig,
    rng: SplitMix64,
    weather: Option<Weather>,
    members: Vec<Member>,
    now: Instant,
    collisions: u64,
}

impl SimBus {
    /// A line without participants. The seed determines all faults.
    pub fn new(config: BusConfig, seed: u64) -> Self {
        Self {
            config,
            rng: SplitMix64::new(seed),
            weather: config.bursts.map(|bursts| Weather::new(bursts, seed ^ 0x6275_7273_7473)),
            members: Vec::new(),
            now: Instant::START,
            collisions: 0,
        }
    }

    /// A participant joins. A cable has two ends; with a third the characters collide.
    ///
    /// On a cable, a participant that joins while one that has left is still sending takes that end: it sends after
    /// those characters, as if a UART still held them from an earlier program, and does not receive them.
    pub fn join(&mut self, frame: Frame) -> Participant {
        let mut member = Member {
            present: true,
            frame,
            queue: VecDeque::new(),
            spoke: VecDeque::new(),
            busy_until: Instant::START,
            owes_done: false,
            last_arrival: Instant::START,
            modem: ModemLines::default(),
            drives: (false, false),
            news: VecDeque::new(),
        };
        let levels = self.members.iter().rev().find(|member| member.present).map(|member| member.drives);
        let cable = !self.config.half_duplex;
        let sending = |member: &Member| !member.queue.is_empty();
        let free = self.members.iter().position(|member| cable && !member.present && sending(member));
        let free = free.or_else(|| self.members.iter().position(|member| !member.present && !sending(member)));
        let who = match free {
            Some(free) => {
                let left = &mut self.members[free];
                if sending(left) {
                    member.queue = std::mem::take(&mut left.queue);
                    member.busy_until = left.busy_until;
                    member.last_arrival = left.last_arrival;
                }
                *left = member;
                free
            }
            None => {
                self.members.push(member);
                self.members.len() - 1
            }
        };
        if let Some((rts, dtr)) = levels {
            self.members[who].see(rts, dtr);
        }
        who
    }

    /// A participant leaves: it gets no more events, and its modem lines go OFF. Characters it has written are still
    /// sent, as from the buffer of a UART; its number is reused. Characters without any receiver left are lost.
    pub fn leave(&mut self, who: Participant, now: Instant) {
        self.set_modem(who, now, false, false);
        if let Some(member) = self.members.get_mut(who) {
            member.present = false;
            member.owes_done = false;
            member.news.clear();
        }
        if self.participants() == 0 {
            self.members.iter_mut().for_each(|member| member.queue.clear());
        }
    }

    /// Number of present participants.
    pub fn participants(&self) -> usize {
        self.members.iter().filter(|member| member.present).count()
    }

    /// Characters that collided on two wires.
    pub fn collisions(&self) -> u64 {
        self.collisions
    }

    /// Characters of a participant that have not arrived yet.
    pub fn waiting(&self, who: Participant) -> usize {
        self.members.get(who).map_or(0, |member| member.queue.len())
    }

    /// Changes the frame of a participant for both directions from now on.
    pub fn set_frame(&mut self, who: Participant, frame: Frame) {
        if let Some(member) = self.members.get_mut(who) {
            member.frame = frame;
        }
    }

    /// Sends characters, after those still being sent.
    pub fn write(&mut self, who: Participant, now: Instant, bytes: &[u8]) {
        self.advance(now);
        let Self { config, rng, weather, members, .. } = self;
        let Some(member) = members.get_mut(who).filter(|_| !bytes.is_empty()) else { return };
        let time = member.frame.char_time;
        let mut begin = member.busy_until.max(now);
        for &byte in bytes {
            let bad = weather.as_mut().is_some_and(|weather| weather.is_bad(begin));
            let faults = config.bursts.filter(|_| bad).map_or(config.faults, |bursts| bursts.faults);
            match Fate::of(&faults, rng) {
                Fate::Whole => member.push(begin, time, Span::ZERO, What::Byte(byte)),
                Fate::Flip(mask) => member.push(begin, time, Span::ZERO, What::Byte(byte ^ mask)),
                Fate::Lost => {}
                Fate::Doubled => {
                    member.push(begin, time, Span::ZERO, What::Byte(byte));
                    member.push(begin, time, Span::ZERO, What::Byte(byte));
                }
                Fate::Late(delay) => member.push(begin, time, delay, What::Byte(byte)),
                Fate::Unreadable(fault) => member.push(begin, time, Span::ZERO, What::Fault(fault)),
            }
            begin += time;
        }
        let from = member.busy_until.max(now);
        member.speak(from, begin);
        member.busy_until = begin;
        member.owes_done = true;
    }

    /// Holds the line at 0 for this long, after characters still being sent.
    pub fn send_break(&mut self, who: Participant, now: Instant, length: Span) {
        self.advance(now);
        let Some(member) = self.members.get_mut(who) else { return };
        let begin = member.busy_until.max(now);
        member.push(begin, length, Span::ZERO, What::Fault(LineFault::Break));
        member.speak(begin, begin + length);
        member.busy_until = begin + length;
        member.owes_done = true;
    }

    /// Takes back the characters of `who` that have not begun; returns how many.
    pub fn take_back(&mut self, who: Participant, now: Instant) -> usize {
        self.advance(now);
        let Some(member) = self.members.get_mut(who) else { return 0 };
        let time = member.frame.char_time.max(Span::from_nanos(1));
        let waiting = member.busy_until.since(now) / time;
        member.busy_until -= waiting * time;
        while member.queue.back().is_some_and(|item| item.begin >= member.busy_until) {
            member.queue.pop_back();
        }
        if waiting > 0 {
            member.last_arrival = member.queue.back().map_or(now, |item| item.arrival);
            if let Some((_, to)) = member.spoke.back_mut() {
                *to = member.busy_until.max(now);
            }
        }
        waiting as usize
    }

    /// Switches RTS and DTR of `who`; the others see them at the same instant. Two wires have no modem lines.
    pub fn set_modem(&mut self, who: Participant, now: Instant, rts: bool, dtr: bool) {
        self.advance(now);
        if self.config.half_duplex {
            return;
        }
        for (number, member) in self.members.iter_mut().enumerate() {
            if number == who {
                member.drives = (rts, dtr);
            } else if member.present {
                member.see(rts, dtr);
            }
        }
    }

    /// The modem lines as `who` sees them: OFF while nobody drives them. `None`: two wires have none.
    pub fn modem_lines(&self, who: Participant) -> Option<ModemLines> {
        self.members.get(who).filter(|_| !self.config.half_duplex).map(|member| member.modem)
    }

    /// Whether `who` has characters on the line or waiting to be.
    pub fn is_sending(&self, who: Participant, now: Instant) -> bool {
        self.members.get(who).is_some_and(|member| now < member.busy_until)
    }

    /// When the next event happens.
    pub fn next_event(&self) -> Option<Instant> {
        if self.members.iter().any(|member| !member.news.is_empty()) {
            return Some(self.now);
        }
        self.next_due().map(|(at, ..)| at)
    }

    /// Takes the next event that has happened by `now`, with its participant: first all events of the first participant
    /// in order, then those of the second. `buffer` must not be empty.
    pub fn pop(&mut self, now: Instant, buffer: &mut [u8]) -> Option<(Participant, BusEvent)> {
        self.advance(now);
        let (who, member) = self.members.iter_mut().enumerate().find(|(_, member)| !member.news.is_empty())?;
        let mut taken = 0;
        while let Some(News::Byte(byte)) = member.news.front() {
            let Some(place) = buffer.get_mut(taken) else { break };
            *place = *byte;
            taken += 1;
            member.news.pop_front();
        }
        if taken > 0 {
            return Some((who, BusEvent::Rx(taken)));
        }
        match member.news.pop_front() {
            Some(News::Other(event)) => Some((who, event)),
            Some(News::Byte(_)) | None => None,
        }
    }

    /// The next event: its time, whether it is an arrival (ends of transmission come first), and its participant.
    fn next_due(&self) -> Option<(Instant, bool, Participant)> {
        let dues = self.members.iter().enumerate().flat_map(|(who, member)| {
            let done = member.owes_done.then_some((member.busy_until, false, who));
            let item = member.queue.front().map(|item| (item.arrival, true, who));
            [done, item]
        });
        dues.flatten().min()
    }

    fn advance(&mut self, now: Instant) {
        if now < self.now {
            assert!(!self.config.strict, "simulated bus at {} ns: time goes back", self.now);
            return;
        }
        while let Some((_, arrival, who)) = self.next_due().filter(|(at, ..)| *at <= now) {
            if arrival {
                self.arrive(who);
            } else {
                self.members[who].owes_done = false;
                self.members[who].news.push_back(News::Other(BusEvent::TxDone));
            }
        }
        self.now = now;
    }

    /// Delivers the first character of `from` to all receivers.
    fn arrive(&mut self, from: Participant) {
        let Some(item) = self.members[from].queue.pop_front() else { return };
        let half_duplex = self.config.half_duplex;
        let spoke = |member: &Member| half_duplex && member.spoke_in(item.begin, item.end);
        let collides = self.members.iter().enumerate().any(|(who, member)| who != from && spoke(member));
        let mut what = item.what;
        if collides {
            self.collisions += 1;
            assert!(!self.config.strict, "simulated bus at {} ns: two speak at the same time", item.end);
            what = self.spoilt(what);
        }
        for (_, member) in self.members.iter_mut().enumerate().filter(|(who, _)| *who != from) {
            if !member.present || spoke(member) {
                continue;
            }
            let heard = match what {
                What::Byte(byte) => member.frame.hears(&item.frame, byte),
                What::Fault(fault) => Err(fault),
            };
            member.news.push_back(match heard {
                Ok(byte) => News::Byte(byte),
                Err(fault) => News::Other(BusEvent::Fault(fault)),
            });
        }
    }

    /// Two characters at once: mostly an unreadable character, sometimes a wrong one.
    fn spoilt(&mut self, what: What) -> What {
        let draw = self.rng.next_u64();
        match what {
            What::Byte(byte) if draw & 3 == 0 => What::Byte(byte & (draw >> 8) as u8),
            What::Fault(LineFault::Break) => What::Fault(LineFault::Break),
            What::Byte(_) | What::Fault(_) => What::Fault(LineFault::Framing),
        }
    }
}

#[cfg(test)]
mod tests;
