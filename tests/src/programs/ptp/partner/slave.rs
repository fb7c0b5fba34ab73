//! A Modbus slave in ASCII or RTU: the memory of [`crate::modbus_slave`], its own frames, and moods.

use ob1_line::sim::SplitMix64;
use ob1_time::{Instant, Span};

use crate::modbus_slave::ModbusSlave;

use super::{Event, Moods, leaving};

/// How telegrams are framed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Frame {
    /// Colon, digits, LRC, CR LF. [S4 L620-L690]
    Ascii,
    /// Bytes and CRC, ended by silence. [S3 L381]
    Rtu,
}

/// What it does with one request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mood {
    Good,
    /// Did not hear it.
    Deaf,
    /// Carries it out and says nothing.
    Mute,
    /// Answers after the master has given up.
    Late,
    /// A wrong check.
    Spoilt,
    /// Half of the answer.
    Cut,
    /// Another slave answers.
    Other,
    /// An exception.
    Refuses,
    /// The answer twice.
    Twice,
    /// Characters before the answer.
    Noise,
}

const BAD: [Mood; 9] =
    [Mood::Deaf, Mood::Mute, Mood::Late, Mood::Spoilt, Mood::Cut, Mood::Other, Mood::Refuses, Mood::Twice, Mood::Noise];

/// Settings of the slave.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Its address.
    pub address: u8,
    /// The frame.
    pub frame: Frame,
    /// The master waits this long.
    pub timeout: Span,
    /// Time of one character.
    pub each: Span,
}

/// The slave on its line.
#[derive(Debug)]
pub struct Slave {
    settings: Settings,
    memory: ModbusSlave,
    heard: Vec<u8>,
    last: Instant,
    /// An answer that is still to be sent, and what it says.
    answer: Option<(Instant, Vec<u8>, Option<Event>)>,
    requests: u32,
    rng: SplitMix64,
}

impl Slave {
    /// A slave whose registers change with each request.
    #[must_use]
    pub fn new(settings: Settings, seed: u64) -> Self {
        let memory = ModbusSlave::new(settings.address);
        let (heard, last, rng) = (Vec::new(), Instant::START, SplitMix64::new(seed));
        Self { settings, memory, heard, last, answer: None, requests: 0, rng }
    }

    /// As [`super::Device::hear`].
    pub fn hear(
        &mut self,
        now: Instant,
        bytes: &[u8],
        moods: &Moods,
        out: &mut Vec<u8>,
        events: &mut Vec<Event>,
    ) -> Instant {
        let gap = 4 * self.settings.each;
        for byte in bytes {
            if self.settings.frame == Frame::Rtu && now > self.last + gap {
                self.request(moods, events);
            }
            self.last = now;
            if self.settings.frame == Frame::Ascii && *byte == b':' {
                self.heard.clear();
            }
            self.heard.push(*byte);
            if self.settings.frame == Frame::Ascii && *byte == b'\n' {
                self.request(moods, events);
            }
        }
        if self.settings.frame == Frame::Rtu && !self.heard.is_empty() && now >= self.last + gap {
            self.request(moods, events);
        }
        if let Some((_, answer, said)) = self.answer.take_if(|(at, _, _)| *at <= now) {
            out.extend(answer);
            events.extend(said);
        }
        let silence = match self.settings.frame {
            Frame::Rtu if !self.heard.is_empty() => self.last + gap,
            _ => Instant::NEVER,
        };
        silence.min(self.answer.as_ref().map_or(Instant::NEVER, |(at, _, _)| *at))
    }

    fn request(&mut self, moods: &Moods, events: &mut Vec<Event>) {
        let heard = std::mem::take(&mut self.heard);
        let at = self.last;
        let Some(request) = unframed(self.settings.frame, &heard) else {
            // The master asks for something else meanwhile (R, a kill), and the line has spoilt it: as with `Deaf` it
            // would take the answer to the request before for that to this one. RTU does not number requests.
            self.answer = None;
            return;
        };
        let Settings { address, frame, timeout, .. } = self.settings;
        if request.len() < 2 || (request[0] != address && request[0] != 0) {
            return;
        }
        let mut mood = Mood::Good;
        if moods.is_bad(at, &mut self.rng) {
            mood = BAD[self.rng.below(BAD.len() as u64) as usize];
            events.push(Event::Disturbs(at + 2 * timeout));
        }
        if mood == Mood::Deaf {
            // An answer to an earlier request would be taken for that to this one, and nobody has heard it.
            self.answer = None;
            return;
        }
        self.requests += 1;
        for (n, register) in (0_u32..).zip(&mut self.memory.registers) {
            *register = (self.requests * 257 + n * 3) as u16;
        }
        self.memory.input_registers.clone_from(&self.memory.registers);
        self.memory.refuses = (mood == Mood::Refuses).then_some(1 + (self.requests % 7) as u8);
        let answers = self.memory.hear(&framed(Frame::Ascii, &request));
        let answer = unframed(Frame::Ascii, &answers).unwrap_or_default();
        let refused = answer.get(1).is_some_and(|function| function & 0x80 != 0);
        let good = matches!(mood, Mood::Good | Mood::Twice | Mood::Noise);
        // A CP 040 hands every answer to its program. [S3 L391]
        let all = frame == Frame::Rtu;
        if !refused || all {
            events.push(Event::Got { at, telegram: request.clone(), answered: good });
        } else {
            events.push(Event::Disturbs(at + 2 * timeout));
        }
        if answer.is_empty() || mood == Mood::Mute {
            // As with [`Mood::Deaf`].
            self.answer = None;
            return;
        }
        let reads = matches!(request[1], 3 | 4) && !refused;
        let text = if all { answer.clone() } else { answer.get(3..).unwrap_or_default().to_vec() };
        // A late answer may come when the master waits for that to its next request: nothing tells them apart in RTU.
        let other = all && matches!(mood, Mood::Refuses | Mood::Late);
        let said = ((reads || all) && (good || other)).then_some(Event::Said { at, telegram: text, owed: false });
        let mut characters = framed(frame, &answer);
        let mut wait = Span::from_micros(100) + self.rng.span_below(timeout * 8 / 10);
        match mood {
            Mood::Late => {
                wait = timeout + leaving(request.len() * 3, self.settings.each) + self.rng.span_below(timeout);
            }
            Mood::Spoilt => {
                let place = characters.len() - 3;
                characters[place] ^= 1;
            }
            Mood::Cut => characters.truncate(characters.len() / 2),
            Mood::Other => {
                let mut other = answer;
                other[0] ^= 1;
                characters = framed(frame, &other);
            }
            Mood::Twice => characters = characters.repeat(2),
            Mood::Noise => _ = characters.splice(0..0, *b"x"),
            _ => {}
        }
        self.answer = Some((at + wait, characters, said));
    }
}

/// The characters of a telegram.
fn framed(frame: Frame, telegram: &[u8]) -> Vec<u8> {
    match frame {
        Frame::Ascii => {
            let sum = telegram.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
            let digits: String =
                telegram.iter().chain([&sum.wrapping_neg()]).map(|byte| format!("{byte:02X}")).collect();
            format!(":{digits}\r\n").into_bytes()
        }
        Frame::Rtu => [telegram, &crc(telegram).to_le_bytes()].concat(),
    }
}

/// The telegram in these characters, if they are one.
fn unframed(frame: Frame, characters: &[u8]) -> Option<Vec<u8>> {
    match frame {
        Frame::Ascii => {
            let text = std::str::from_utf8(characters).ok()?.strip_prefix(':')?.strip_suffix("\r\n")?;
            let bytes: Option<Vec<u8>> =
                (0..text.len() / 2).map(|at| u8::from_str_radix(text.get(2 * at..2 * at + 2)?, 16).ok()).collect();
            let mut bytes = bytes?;
            let sum = bytes.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
            bytes.pop()?;
            (sum == 0).then_some(bytes)
        }
        Frame::Rtu => {
            let (telegram, check) = characters.split_last_chunk::<2>()?;
            (crc(telegram) == u16::from_le_bytes(*check)).then(|| telegram.to_vec())
        }
    }
}

/// The check of Modbus RTU, by the specification: polynomial A001h, bit by bit.
fn crc(telegram: &[u8]) -> u16 {
    telegram.iter().fold(0xFFFF, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| if crc & 1 == 0 { crc >> 1 } else { crc >> 1 ^ 0xA001 })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slave(frame: Frame) -> Slave {
        let ms = Span::from_millis;
        Slave::new(Settings { address: 5, frame, timeout: ms(100), each: ms(1) }, 1)
    }

    fn at(ms: u64) -> Instant {
        Instant::START + Span::from_millis(ms)
    }

    #[test]
    fn the_frames_of_the_specification() {
        assert_eq!(framed(Frame::Ascii, &[5, 8, 0, 0, 0xA5, 0xC3]), b":05080000A5C38B\r\n");
        // The example of the Modbus specification: 02 07 has the check 41 12.
        assert_eq!(framed(Frame::Rtu, &[2, 7]), [2, 7, 0x41, 0x12]);
        for frame in [Frame::Ascii, Frame::Rtu] {
            assert_eq!(unframed(frame, &framed(frame, &[1, 2, 3])), Some(vec![1, 2, 3]));
        }
    }

    #[test]
    fn a_write_is_in_the_ledger_and_is_answered() {
        for frame in [Frame::Ascii, Frame::Rtu] {
            let mut slave = slave(frame);
            let (mut out, mut events) = (Vec::new(), Vec::new());
            let request = vec![5, 6, 0, 1, 0, 2];
            let at = Instant::START + Span::from_millis(50);
            let mut next = slave.hear(at, &framed(frame, &request), &Moods::GOOD, &mut out, &mut events);
            while next < Instant::NEVER {
                next = slave.hear(next, &[], &Moods::GOOD, &mut out, &mut events);
            }
            assert_eq!(events.first(), Some(&Event::Got { at, telegram: request.clone(), answered: true }));
            assert_eq!(out, framed(frame, &request));
        }
    }

    #[test]
    fn an_answer_is_dropped_when_the_next_request_is_spoilt() {
        for (spoilt, answers) in [(0, true), (1, false)] {
            let mut slave = slave(Frame::Rtu);
            let (mut out, mut events) = (Vec::new(), Vec::new());
            let mut request = framed(Frame::Rtu, &[5, 6, 0, 1, 0, 2]);
            slave.hear(at(50), &request, &Moods::GOOD, &mut out, &mut events);
            slave.hear(at(54), &[], &Moods::GOOD, &mut out, &mut events);
            request[4] ^= spoilt;
            let mut next = slave.hear(at(54), &request, &Moods::GOOD, &mut out, &mut events);
            while next < Instant::NEVER {
                next = slave.hear(next, &[], &Moods::GOOD, &mut out, &mut events);
            }
            assert_eq!(!out.is_empty(), answers);
        }
    }

    /// A CP 040 takes every answer with a right check, late ones for that to its next request, too.
    #[test]
    fn every_whole_answer_is_in_the_ledger() {
        let mut slave = slave(Frame::Rtu);
        let (moods, mut now, mut whole) = (Moods { bad: 100, until: Instant::NEVER }, Instant::START, 0);
        for register in 0..100 {
            now += Span::from_millis(500);
            let (mut out, mut events) = (Vec::new(), Vec::new());
            let request = framed(Frame::Rtu, &[5, 6, 0, register, 0, 2]);
            let mut next = slave.hear(now, &request, &moods, &mut out, &mut events);
            while next < Instant::NEVER {
                next = slave.hear(next, &[], &moods, &mut out, &mut events);
            }
            let Some(answer) = unframed(Frame::Rtu, &out).filter(|answer| answer.first() == Some(&5)) else { continue };
            whole += 1;
            let is_said = |event: &Event| matches!(event, Event::Said { telegram, .. } if *telegram == answer);
            assert!(events.iter().any(is_said), "{answer:02X?}");
        }
        assert!(whole > 10, "{whole}");
    }
}
