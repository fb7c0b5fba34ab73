//! Characters to a reply: colon, digits, CR, LF. [S4 "4.1 Message Structure"]
//!
//! A fault of a reply is kept until the reply has ended, by LF or by silence: the next request must not collide with
//! the rest.

use super::{FRAME_CHARACTERS, TELEGRAM_BYTES, number};
use crate::machine::Instant;
use crate::modbus::ascii::{CR, LF, START, digit, lrc};

/// Maximum characters of one reply, false starts included: an endless reply must not prolong a job forever
/// (ours).
const CHARACTERS_MAX: usize = 2 * FRAME_CHARACTERS;

/// The effect of a character.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Heard {
    /// Nothing: the reply goes on.
    Nothing,
    /// A second colon: everything before it is dropped.
    Restart,
    /// The reply has ended: complete, or with an event number.
    End(Result<(), u16>),
}

#[derive(Clone, Debug)]
pub(super) struct Receiver {
    bytes: [u8; TELEGRAM_BYTES + 1],
    len: usize,
    /// First digit of a byte.
    half: Option<u8>,
    /// CR has come: only LF may follow.
    cr: bool,
    /// A colon has come.
    colon: bool,
    /// Something has come: the character delay runs.
    open: bool,
    /// Time of the last character.
    last: Instant,
    /// Characters of the reply so far.
    heard: usize,
    /// Fault in the characters since the last colon.
    flaw: Option<u16>,
    /// Fault of the line since the request: a colon does not clear it.
    fault: Option<u16>,
}

impl Receiver {
    pub(super) const fn new() -> Self {
        Self {
            bytes: [0; TELEGRAM_BYTES + 1],
            len: 0,
            half: None,
            cr: false,
            colon: false,
            open: false,
            last: Instant::START,
            heard: 0,
            flaw: None,
            fault: None,
        }
    }

    /// Drops everything: a request has been sent.
    pub(super) const fn clear(&mut self) {
        self.forget();
        (self.open, self.colon, self.heard, self.fault) = (false, false, 0, None);
    }

    const fn forget(&mut self) {
        (self.len, self.half, self.cr, self.flaw) = (0, None, false, None);
    }

    pub(super) const fn is_open(&self) -> bool {
        self.open
    }

    /// End of the last character.
    pub(super) const fn last(&self) -> Instant {
        self.last
    }

    /// The whole reply, without LRC.
    pub(super) fn telegram(&self) -> &[u8] {
        self.bytes.get(..self.len.saturating_sub(1)).unwrap_or(&[])
    }

    /// The event number of a reply that has ended by silence.
    pub(super) fn silence(&self) -> u16 {
        self.fault.or(self.flaw).unwrap_or(number::CHARACTER_DELAY)
    }

    /// A character that could not be read. In normal operation it also counts before the colon, and a colon does not
    /// clear it.
    pub(super) const fn unreadable(&mut self, now: Instant, normal: bool) {
        if normal {
            self.open = true;
            if self.fault.is_none() {
                self.fault = Some(number::TRANSMISSION);
            }
        } else if self.open && self.flaw.is_none() {
            self.flaw = Some(number::TRANSMISSION);
        }
        self.last = now;
    }

    pub(super) fn character(&mut self, now: Instant, byte: u8, normal: bool) -> Heard {
        if byte != START && !self.open && !normal {
            // "The start of the receive message from the slave is recognized by means of the correctly-received start
            // character." [S4 L540]
            return Heard::Nothing;
        }
        self.last = now;
        self.heard += 1;
        if self.heard > CHARACTERS_MAX {
            return Heard::End(Err(number::OVERFLOW));
        }
        match byte {
            START => {
                let restart = self.colon;
                self.forget();
                (self.open, self.colon) = (true, true);
                return if restart { Heard::Restart } else { Heard::Nothing };
            }
            _ if !self.open => {
                self.open = true;
                self.fault = Some(number::START);
            }
            LF => return Heard::End(self.end()),
            _ if !self.colon => {}
            // CR was not the end.
            _ if self.cr => self.spoil(number::CHARACTER),
            CR => self.cr = true,
            _ => match (digit(byte), self.half.take()) {
                (None, _) => self.spoil(number::CHARACTER),
                (Some(high), None) => self.half = Some(high),
                (Some(low), Some(high)) => self.store(high << 4 | low),
            },
        }
        Heard::Nothing
    }

    const fn spoil(&mut self, number: u16) {
        if self.flaw.is_none() {
            self.flaw = Some(number);
        }
    }

    fn store(&mut self, byte: u8) {
        match self.bytes.get_mut(self.len) {
            Some(place) => {
                *place = byte;
                self.len += 1;
            }
            None => self.spoil(number::OVERFLOW),
        }
    }

    fn end(&self) -> Result<(), u16> {
        if let Some(number) = self.fault.or(self.flaw) {
            return Err(number);
        }
        if !self.cr {
            // LF is valid only after CR.
            return Err(number::CHARACTER);
        }
        // Half a byte, or not even address, function code and LRC. [S4 L1809]
        if self.half.is_some() || self.len < 3 {
            return Err(number::REPLY_SHORT);
        }
        // The sum over a telegram and its LRC is 0. [S4 "LRC"]
        if lrc(self.bytes.get(..self.len).unwrap_or(&[])) != 0 {
            return Err(number::LRC);
        }
        Ok(())
    }
}
