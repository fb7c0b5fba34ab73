//! A partner with ASCII or STX/ETX: characters, and silence or end characters between telegrams.

use std::collections::VecDeque;

use ob1_line::sim::SplitMix64;
use ob1_time::{Instant, Span};

use super::{Event, leaving};

const XON: u8 = 0x11;
const XOFF: u8 = 0x13;
/// Characters that a UART may still have in its buffer when XOFF comes, and those under way.
const BUFFER: u64 = 18;
/// A CP waits longer than this for XON (`flow_wait_ms` of [`super::super::line`] is 2000).
const HELD: Span = Span::from_millis(1500);

/// What ends a telegram.
#[derive(Clone, Debug)]
pub struct Frame {
    /// First characters of each telegram.
    pub start: Vec<u8>,
    /// Last characters of each telegram; none: silence ends it.
    pub end: Vec<u8>,
    /// The start and end characters are no part of the telegram.
    pub strips: bool,
    /// Silence that surely ends a telegram of the CP.
    pub gap: Span,
    /// Pause between two telegrams of the partner.
    pub pause: Span,
    /// Time of one character.
    pub each: Span,
    /// XON and XOFF control the flow.
    pub flow: bool,
}

/// The partner.
#[derive(Debug)]
pub struct Characters {
    frame: Frame,
    heard: Vec<u8>,
    last: Instant,
    queue: VecDeque<(u32, Vec<u8>)>,
    /// Its own characters have left, and the pause.
    free: Instant,
    /// A telegram is under way until then.
    saying: Option<Instant>,
    /// It has said XOFF: since, until.
    off: Option<(Instant, Instant)>,
    /// The CP has said XOFF.
    held: bool,
    flooded: usize,
    rng: SplitMix64,
}

/// Told instead of a telegram: XOFF for a while.
pub const SAY_XOFF: u32 = 1;

impl Characters {
    /// A partner at rest.
    #[must_use]
    pub fn new(frame: Frame, seed: u64) -> Self {
        let (heard, queue, rng) = (Vec::new(), VecDeque::new(), SplitMix64::new(seed));
        let (last, free) = (Instant::START, Instant::START);
        Self { frame, heard, last, queue, free, saying: None, off: None, held: false, flooded: 0, rng }
    }

    /// A telegram to be sent.
    pub fn send(&mut self, what: u32, telegram: Vec<u8>) {
        self.queue.push_back((what, telegram));
    }

    /// As [`super::Device::hear`].
    pub fn hear(&mut self, now: Instant, bytes: &[u8], out: &mut Vec<u8>, events: &mut Vec<Event>) -> Instant {
        for byte in bytes {
            self.character(now, *byte, events);
        }
        self.time(now, out, events);
        let gap = if self.heard.is_empty() || self.off.is_some() { Instant::NEVER } else { self.last + self.frame.gap };
        let queue = if self.queue.is_empty() || self.held { Instant::NEVER } else { self.free };
        let saying = self.saying.unwrap_or(Instant::NEVER);
        let off = self.off.map_or(Instant::NEVER, |(_, until)| until);
        gap.min(queue).min(saying).min(off)
    }

    fn character(&mut self, now: Instant, byte: u8, events: &mut Vec<Event>) {
        if self.frame.flow && matches!(byte, XON | XOFF) {
            self.held = byte == XOFF;
            return;
        }
        if let Some((since, _)) = self.off
            && now > since + BUFFER * self.frame.each
        {
            self.flooded += 1;
        }
        // While it holds the CP back, silence ends nothing.
        let silent = now > self.last + self.frame.gap && self.off.is_none();
        if silent {
            self.ends(events);
        }
        self.last = now;
        let Frame { start, end, .. } = &self.frame;
        if !start.is_empty() && self.heard.is_empty() && byte != start[0] {
            return;
        }
        self.heard.push(byte);
        if !end.is_empty() && self.heard.ends_with(end) {
            self.ends(events);
        }
    }

    fn ends(&mut self, events: &mut Vec<Event>) {
        let mut telegram = std::mem::take(&mut self.heard);
        let Frame { start, end, strips, .. } = &self.frame;
        if *strips {
            if telegram.len() < start.len() + end.len() || !telegram.ends_with(end) {
                return;
            }
            telegram.truncate(telegram.len() - end.len());
            telegram.drain(..start.len());
        }
        if !telegram.is_empty() {
            events.push(Event::Got { at: self.last, telegram, answered: true });
        }
    }

    fn time(&mut self, now: Instant, out: &mut Vec<u8>, events: &mut Vec<Event>) {
        if !self.heard.is_empty() && now >= self.last + self.frame.gap && self.off.is_none() {
            self.ends(events);
        }
        self.saying.take_if(|at| *at <= now);
        if self.off.is_some_and(|(_, until)| until <= now) {
            self.off = None;
            self.last = self.last.max(now + 4 * self.frame.each);
            out.push(XON);
            self.free = self.free.max(now + self.frame.each);
            if self.flooded > 0 {
                events.push(Event::Flooded { at: now, characters: std::mem::take(&mut self.flooded) });
            }
        }
        if now < self.free || self.saying.is_some() || self.held {
            return;
        }
        let Some((what, telegram)) = self.queue.pop_front() else { return };
        if what == SAY_XOFF {
            if self.off.is_none() {
                out.push(XOFF);
                let since = now + self.frame.each;
                self.off = Some((since, since + Span::from_millis(50 + self.rng.below(300))));
            }
            return;
        }
        let Frame { start, end, each, pause, strips, .. } = &self.frame;
        let left = now + leaving(start.len() + telegram.len() + end.len(), *each);
        if let Some((since, until)) = &mut self.off {
            // One character after the other: XON leaves behind those of the telegram, and the CP is held until then.
            if left > *since + HELD {
                self.free = *until + *each;
                self.queue.push_front((what, telegram));
                return;
            }
            *until = left.max(*until);
        }
        let from = out.len();
        out.extend(start);
        out.extend(&telegram);
        out.extend(end);
        self.free = left + *pause;
        // The end characters of ASCII are part of what the block gets.
        // [TIA help "Configuration for point-to-point links"]
        let telegram = if *strips { telegram } else { out[from..].to_vec() };
        self.saying = Some(left);
        events.push(Event::Said { at: left, telegram, owed: true });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Instant {
        Instant::START + Span::from_millis(ms)
    }

    fn frame() -> Frame {
        let ms = Span::from_millis;
        Frame {
            start: Vec::new(),
            end: Vec::new(),
            strips: false,
            gap: ms(10),
            pause: ms(20),
            each: ms(1),
            flow: false,
        }
    }

    #[test]
    fn silence_ends_a_telegram_with_the_time_of_its_last_character() {
        let mut partner = Characters::new(frame(), 1);
        let (mut out, mut events) = (Vec::new(), Vec::new());
        partner.hear(at(100), b"a", &mut out, &mut events);
        let next = partner.hear(at(105), b"b", &mut out, &mut events);
        assert!(events.is_empty());
        partner.hear(next, b"", &mut out, &mut events);
        assert_eq!(events, [Event::Got { at: at(105), telegram: b"ab".to_vec(), answered: true }]);
    }

    #[test]
    fn start_and_end_characters_are_no_part_of_it() {
        let frame = Frame { start: vec![2], end: vec![3], strips: true, ..frame() };
        let mut partner = Characters::new(frame, 1);
        let (mut out, mut events) = (Vec::new(), Vec::new());
        partner.hear(at(100), b"x\x02ab\x03", &mut out, &mut events);
        assert_eq!(events, [Event::Got { at: at(100), telegram: b"ab".to_vec(), answered: true }]);
        partner.send(2 << 16, b"c".to_vec());
        partner.hear(at(101), b"", &mut out, &mut events);
        assert_eq!(out, b"\x02c\x03");
        partner.hear(at(104), b"", &mut out, &mut events);
        assert_eq!(events[1], Event::Said { at: at(104), telegram: b"c".to_vec(), owed: true });
    }

    #[test]
    fn characters_after_xoff_are_counted() {
        let mut partner = Characters::new(frame(), 1);
        let (mut out, mut events) = (Vec::new(), Vec::new());
        partner.send(SAY_XOFF, Vec::new());
        partner.hear(at(100), b"a", &mut out, &mut events);
        assert_eq!(out, [XOFF]);
        // One is under way; the second comes too late.
        partner.hear(at(101), b"b", &mut out, &mut events);
        partner.hear(at(130), b"c", &mut out, &mut events);
        partner.hear(at(600), b"", &mut out, &mut events);
        assert!(events.contains(&Event::Flooded { at: at(600), characters: 1 }), "{events:?}");
    }

    /// The silence that XOFF has made does not end the telegram of the CP before XON has left.
    #[test]
    fn xon_stands_behind_its_own_telegram() {
        for (len, first) in [(1000, b'y'), (2000, XON)] {
            let mut partner = Characters::new(frame(), 1);
            let (mut out, mut events) = (Vec::new(), Vec::new());
            partner.hear(at(99), b"a", &mut out, &mut events);
            partner.send(SAY_XOFF, Vec::new());
            partner.send(2 << 16, vec![b'y'; len]);
            let (mut now, mut next) = (at(100), at(100));
            while out.last() != Some(&XON) {
                now = next.max(now);
                next = partner.hear(now, b"", &mut out, &mut events);
            }
            // What would hold the CP back for too long comes behind XON.
            assert_eq!(out[1], first);
            assert_eq!((now >= at(1100), events.len()), (first == b'y', usize::from(first == b'y')));
            partner.hear(now + Span::from_millis(5), b"b", &mut out, &mut events);
            partner.hear(now + Span::from_millis(20), b"", &mut out, &mut events);
            let is_whole = |event: &Event| matches!(event, Event::Got { telegram, .. } if telegram == b"ab");
            assert!(events.iter().any(is_whole), "{events:?}");
        }
    }
}
