//! Characters with their times to telegrams. Master and slave receive in the same way.
//!
//! "Instead of start and end ID, RTU uses a time watcher." [S0 L2060] The manual gives no times; they are those of the
//! Modbus specification for serial lines: 3.5 characters of silence separate telegrams, within one it is 1.5 at most;
//! above 19200 bit/s 1.75 ms and 0.75 ms.
//!
//! The time of a character is that of its end, so a pause between two characters is the time between their ends minus
//! one character time. A device that hands over characters in bursts (a UART with a FIFO, a USB adapter) gives only a
//! burst's time: [`Config::with_bursts`] says how late it may be. A telegram whose check is correct is still taken
//! after the silence; only an incomplete one, or one shorter than its own length field, is waited for.

use super::{Failure, Mode, TELEGRAM_BYTES, ascii, pdu, rtu};
use crate::machine::{Instant, SECOND, Span};

/// Above this rate the silences of RTU no longer depend on it.
const FIXED_ABOVE_BAUD: u32 = 19_200;

/// Maximum length of a telegram with its CRC (with LRC one byte less).
const BUFFER: usize = TELEGRAM_BYTES + 2;

/// How telegrams are separated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Config {
    /// RTU (bytes) or ASCII (digits).
    pub mode: Mode,
    /// Time of one character on the line.
    pub char_time: Span,
    /// RTU: the silence that ends a telegram and is kept before one. 0: none is kept, and a telegram ends when it has
    /// the length of its function code and its check is correct. ASCII has none.
    pub silence: Span,
    /// RTU: longest pause within a telegram; 0: not checked.
    pub gap: Span,
    /// How long an incomplete telegram is waited for after its last character.
    pub patience: Span,
    /// Bytes of a register: 2, or 4 with 32-bit extensions.
    pub register_bytes: usize,
}

impl Config {
    /// The times of the Modbus specification for this rate.
    pub const fn new(mode: Mode, baud: u32, char_time: Span) -> Self {
        let (silence, gap) = match mode {
            Mode::Rtu if baud > FIXED_ABOVE_BAUD => (Span::from_micros(1_750), Span::from_micros(750)),
            Mode::Rtu => (char_time.times(7).over(2), char_time.times(3).over(2)),
            Mode::Ascii => (Span::ZERO, Span::ZERO),
        };
        let patience = match mode {
            Mode::Rtu => silence,
            // "Intervals of up to one second may elapse between characters within the message."
            Mode::Ascii => SECOND,
        };
        Self { mode, char_time, silence, gap, patience, register_bytes: pdu::REGISTER_BYTES }
    }

    /// The same on a line that hands over characters up to `late` after their arrival.
    #[must_use]
    pub const fn with_bursts(mut self, late: Span) -> Self {
        if !self.gap.is_zero() {
            self.gap = self.gap.plus(late);
        }
        self.patience = self.patience.plus(late);
        self
    }

    /// The same without silences: as fast as the partner can. For lines that separate telegrams by themselves, and for
    /// measurements.
    #[must_use]
    pub const fn without_silence(mut self) -> Self {
        if matches!(self.mode, Mode::Rtu) {
            (self.silence, self.gap) = (Span::ZERO, Span::ZERO);
            self.patience = self.patience.plus(Span::from_millis(50));
        }
        self
    }
}

/// A telegram has ended: whole, or not.
pub type End = Result<(), Failure>;

/// Assembles telegrams of characters and their times.
#[derive(Clone, Debug)]
pub struct Receiver {
    config: Config,
    direction: pdu::Direction,
    /// Characters have come, but no end yet.
    open: bool,
    /// End of the last character.
    last: Instant,
    /// The telegram's first fault.
    flaw: Option<Failure>,
    bytes: [u8; BUFFER],
    len: usize,
    /// RTU: CRC of the bytes received so far.
    crc: u16,
    /// ASCII: the first digit of a byte.
    half: Option<u8>,
    /// ASCII: CR has come.
    cr: bool,
    /// Length of the last whole telegram.
    telegram: usize,
}

impl Receiver {
    /// A receiver before its first character, for telegrams in this direction.
    pub const fn new(config: Config, direction: pdu::Direction) -> Self {
        Self {
            config,
            direction,
            open: false,
            last: Instant::START,
            flaw: None,
            bytes: [0; BUFFER],
            len: 0,
            crc: rtu::CRC_START,
            half: None,
            cr: false,
            telegram: 0,
        }
    }

    /// The configuration it was made with.
    pub const fn config(&self) -> &Config {
        &self.config
    }

    /// Whether a telegram is being received.
    pub const fn is_open(&self) -> bool {
        self.open
    }

    /// The valid telegram that has just ended; available until the next character.
    pub fn telegram(&self) -> &[u8] {
        self.bytes.get(..self.telegram).unwrap_or(&[])
    }

    /// When the line will have been silent long enough to send.
    pub const fn quiet_at(&self) -> Instant {
        self.last.saturating_add(self.config.silence)
    }

    /// Drops what has been received; the line counts as busy until `now`.
    pub const fn clear(&mut self, now: Instant) {
        self.reset();
        self.open = false;
        self.last = now;
    }

    const fn reset(&mut self) {
        (self.len, self.crc, self.half, self.cr, self.flaw, self.telegram) = (0, rtu::CRC_START, None, false, None, 0);
    }

    /// Characters came in together, the last of them now. Call it before [`Receiver::take`].
    pub fn chunk(&mut self, now: Instant, characters: usize) {
        if !self.open || self.config.gap.is_zero() {
            return;
        }
        let begun = now.saturating_sub(self.config.char_time * characters as u64);
        if begun.since(self.last) > self.config.gap {
            self.spoil(Failure::Incomplete);
        }
    }

    /// Takes characters, up to the end of a telegram if there is one; what follows it remains in `characters`.
    pub fn take(&mut self, now: Instant, characters: &mut &[u8]) -> Option<End> {
        if !characters.is_empty() {
            self.last = now;
        }
        match self.config.mode {
            Mode::Rtu => self.take_rtu(characters),
            Mode::Ascii => self.take_ascii(characters),
        }
    }

    /// A character that could not be read: it invalidates its telegram.
    pub const fn unreadable(&mut self, now: Instant) {
        self.last = now;
        self.begin();
        self.spoil(Failure::DataLost);
    }

    /// When [`Receiver::tick`] is due.
    pub fn deadline(&self) -> Option<Instant> {
        if !self.open {
            return None;
        }
        let wait = if self.is_whole() && !self.names_more() { self.config.silence } else { self.config.patience };
        Some(self.last + wait)
    }

    /// Time has passed; returns the end of a telegram, if that ended one.
    pub fn tick(&mut self, now: Instant) -> Option<End> {
        if self.deadline().is_none_or(|at| now < at) {
            return None;
        }
        Some(match self.config.mode {
            Mode::Rtu => self.end_rtu(),
            // Without CR LF it is incomplete.
            Mode::Ascii => self.end(Err(self.flaw.unwrap_or(Failure::Incomplete))),
        })
    }

    const fn begin(&mut self) {
        if !self.open {
            self.reset();
            self.open = true;
        }
    }

    const fn spoil(&mut self, failure: Failure) {
        if self.flaw.is_none() {
            self.flaw = Some(failure);
        }
    }

    const fn end(&mut self, end: End) -> End {
        self.open = false;
        end
    }

    fn store(&mut self, byte: u8) {
        match self.bytes.get_mut(self.len) {
            Some(place) => {
                *place = byte;
                self.len += 1;
            }
            None => self.spoil(Failure::Overflow),
        }
    }

    // ---- RTU ----

    /// RTU: no fault so far, and the check is correct.
    const fn is_whole(&self) -> bool {
        matches!(self.config.mode, Mode::Rtu) && self.flaw.is_none() && self.len >= 4 && self.crc == 0
    }

    fn take_rtu(&mut self, characters: &mut &[u8]) -> Option<End> {
        while let Some((&byte, rest)) = characters.split_first() {
            *characters = rest;
            self.begin();
            self.store(byte);
            self.crc = rtu::crc_push(self.crc, byte);
            if self.config.silence.is_zero() && self.is_whole() && self.expected() == Some(self.len - 2) {
                return Some(self.end_rtu());
            }
        }
        None
    }

    /// Length of the telegram according to its first bytes.
    fn expected(&self) -> Option<usize> {
        pdu::length(self.direction, self.bytes.get(..self.len)?, self.config.register_bytes)
    }

    /// The telegram announces more bytes than have come: a burst may end where the check happens to be correct. On a
    /// bus a slave also receives the answers of other slaves, which are not short requests.
    fn names_more(&self) -> bool {
        let is_answer = self.direction == pdu::Direction::Request
            && self.bytes.get(..self.len).is_some_and(|bytes| {
                let answer = pdu::length(pdu::Direction::Answer, bytes, self.config.register_bytes);
                answer.is_some_and(|answer| self.len == answer + 2)
            });
        !is_answer && self.expected().is_some_and(|expected| self.len < expected + 2)
    }

    fn end_rtu(&mut self) -> End {
        if self.is_whole() {
            self.telegram = self.len - 2;
            return self.end(Ok(()));
        }
        let part = self.len < 4 || self.expected().is_some_and(|expected| self.len < expected + 2);
        let wrong = if part { Failure::Incomplete } else { Failure::Fault };
        self.end(Err(self.flaw.unwrap_or(wrong)))
    }

    // ---- ASCII ----

    fn take_ascii(&mut self, characters: &mut &[u8]) -> Option<End> {
        while let Some((&byte, rest)) = characters.split_first() {
            *characters = rest;
            let end = self.ascii(byte);
            if end.is_some() {
                return end;
            }
            self.ascii_pairs(characters);
        }
        None
    }

    /// Takes whole bytes in the middle of a telegram, which are nearly all of it. Whatever is not a pair of digits is
    /// left to [`Self::ascii`].
    fn ascii_pairs(&mut self, characters: &mut &[u8]) {
        if characters.len() < 2 || !self.open || self.flaw.is_some() || self.half.is_some() || self.cr {
            return;
        }
        let places = self.bytes.get_mut(self.len..).unwrap_or_default();
        let bytes = characters.as_chunks::<2>().0.iter().map_while(ascii::byte);
        let taken = places.iter_mut().zip(bytes).map(|(place, byte)| *place = byte).count();
        self.len += taken;
        *characters = characters.get(2 * taken..).unwrap_or_default();
    }

    fn ascii(&mut self, byte: u8) -> Option<End> {
        if byte == ascii::START {
            // Whatever came before, a telegram begins here.
            self.open = false;
            self.begin();
            return None;
        }
        if !self.open {
            self.begin();
            self.spoil(Failure::Start);
        }
        match byte {
            ascii::LF => {
                let cr = self.cr;
                return Some(self.end_ascii(cr));
            }
            // CR was not the end.
            _ if self.cr => self.spoil(Failure::Overflow),
            ascii::CR => self.cr = true,
            _ => match (ascii::digit(byte), self.half.take()) {
                (None, _) => self.spoil(Failure::Fault),
                (Some(high), None) => self.half = Some(high),
                (Some(low), Some(high)) => self.store(high << 4 | low),
            },
        }
        None
    }

    fn end_ascii(&mut self, cr: bool) -> End {
        let bytes = self.bytes.get(..self.len).unwrap_or(&[]);
        let end = match self.flaw {
            Some(flaw) => Err(flaw),
            None if !cr => Err(Failure::Overflow),
            None if self.half.is_some() || self.len < 3 => Err(Failure::Incomplete),
            None if self.len > TELEGRAM_BYTES + 1 => Err(Failure::Overflow),
            None if ascii::lrc(bytes) != 0 => Err(Failure::Fault),
            None => Ok(self.len - 1),
        };
        self.telegram = end.unwrap_or(0);
        self.end(end.map(drop))
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::vec;
    use std::vec::Vec;

    use proptest::prelude::*;

    use super::*;

    /// What a receiver makes of characters that come in pieces of this length: each end, and its telegram.
    fn received(mode: Mode, characters: &[u8], piece: usize) -> Vec<(End, Vec<u8>)> {
        let config = Config::new(mode, 9600, Span::from_millis(1)).without_silence();
        let mut receiver = Receiver::new(config, pdu::Direction::Request);
        let mut ends = Vec::new();
        for mut rest in characters.chunks(piece) {
            while let Some(end) = receiver.take(Instant::START, &mut rest) {
                ends.push((end, receiver.telegram().to_vec()));
            }
        }
        ends
    }

    /// Characters of ASCII frames, some of them whole and valid, some too long, with anything in between.
    fn ascii_characters() -> impl Strategy<Value = Vec<u8>> {
        let frame = proptest::collection::vec(any::<u8>(), 0..=TELEGRAM_BYTES).prop_map(|telegram| {
            let mut frame = [0; 2 * BUFFER + 3];
            let len = ascii::encode(&telegram, &mut frame).unwrap_or(0);
            frame[..len].to_vec()
        });
        let digits = proptest::collection::vec(prop::sample::select(b"0123456789ABCDEF".as_slice()), 0..1200);
        let odd = proptest::collection::vec(prop::sample::select(b":\r\n5Fa".as_slice()), 0..8);
        let parts = prop_oneof![4 => frame, 1 => digits, 2 => odd];
        proptest::collection::vec(parts, 0..6).prop_map(|parts| parts.concat())
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn it_does_not_matter_in_which_pieces_ascii_comes(characters in ascii_characters(), piece in 2_usize..700) {
            prop_assert_eq!(received(Mode::Ascii, &characters, piece), received(Mode::Ascii, &characters, 1));
        }
    }

    #[test]
    fn the_test_sees_telegrams_and_every_fault() {
        let mut long = vec![b'0'; 2 * BUFFER + 2];
        long[0] = ascii::START;
        let long = [&long, &b"0\r\n"[..]].concat();
        let cases: [(&[u8], End); 6] = [
            (b":1103006B00037E\r\n", Ok(())),
            (b":1103006B00037F\r\n", Err(Failure::Fault)),
            (b":1103006B0003x7E\r\n", Err(Failure::Fault)),
            (b":110300\r6B\r\n", Err(Failure::Overflow)),
            (b"11\r\n", Err(Failure::Start)),
            (&long, Err(Failure::Overflow)),
        ];
        for (characters, end) in cases {
            let ends = received(Mode::Ascii, characters, characters.len());
            assert_eq!(ends.iter().map(|(end, _)| *end).collect::<Vec<_>>(), [end], "{}", characters.escape_ascii());
        }
    }
}
