//! Messages of the program: user entries of the diagnostic buffer (SFC 52) and block-related messages (SFC 17, SFC 18).
//!
//! There are no display devices that could log on: a block-related message goes to the log, and SFC 17's are
//! acknowledged at once.

use ob1_model::Event;
use ob1_std::services::{Alarm, AlarmError, MessageError, Messages};

use crate::machine::Machine;
use crate::{DiagEntry, LOG_TEXT, ShortText};

/// Message numbers that can be in use at one time.
const NUMBERS: usize = 64;

/// The signals of the message numbers seen.
#[derive(Debug)]
pub(crate) struct Signals {
    list: [(u32, bool); NUMBERS],
    used: usize,
}

impl Default for Signals {
    fn default() -> Self {
        Self { list: [(0, false); NUMBERS], used: 0 }
    }
}

impl Signals {
    /// Notes the signal of a number. A number whose signal has gone makes room when another needs it.
    fn change(&mut self, id: u32, signal: bool) -> Result<(), AlarmError> {
        if let Some((_, last)) = self.list[..self.used].iter_mut().find(|(known, _)| *known == id) {
            return if std::mem::replace(last, signal) == signal { Err(AlarmError::NoChange) } else { Ok(()) };
        }
        if !signal {
            return Err(AlarmError::FirstIsZero);
        }
        let place = match self.list[..self.used].iter().position(|(_, signal)| !signal) {
            _ if self.used < NUMBERS => {
                self.used += 1;
                self.used - 1
            }
            Some(gone) => gone,
            None => return Err(AlarmError::NoResources),
        };
        self.list[place] = (id, signal);
        Ok(())
    }
}

/// Text of fixed size, written without allocating.
struct Line {
    bytes: [u8; LOG_TEXT],
    len: usize,
}

impl Line {
    fn new() -> Self {
        Self { bytes: [0; LOG_TEXT], len: 0 }
    }

    fn text(&mut self, text: &str) -> &mut Self {
        let len = text.len().min(self.bytes.len() - self.len);
        self.bytes[self.len..self.len + len].copy_from_slice(&text.as_bytes()[..len]);
        self.len += len;
        self
    }

    fn hex(&mut self, bytes: &[u8]) -> &mut Self {
        const DIGITS: &[u8; 16] = b"0123456789ABCDEF";
        for byte in bytes {
            let digits = [DIGITS[usize::from(byte >> 4)], DIGITS[usize::from(byte & 15)]];
            self.text(std::str::from_utf8(&digits).unwrap_or("??"));
        }
        self
    }

    fn as_str(&self) -> &str {
        std::str::from_utf8(&self.bytes[..self.len]).unwrap_or("")
    }
}

impl Messages for Machine {
    fn user_message(&mut self, event: u16, info1: &[u8], info2: &[u8], send: bool) -> Result<(), MessageError> {
        let mut text = Line::new();
        text.text("INFO1 ").hex(info1).text(", INFO2 ").hex(info2);
        let word = info1.iter().take(2).fold(0, |word, byte| word << 8 | u32::from(*byte));
        self.diag.push(DiagEntry {
            number: 0,
            time: self.now,
            event: Event(event),
            site: None,
            accus: [0; 2],
            data: word,
            text: ShortText::new(text.as_str()),
        });
        if send { Err(MessageError::NoStation) } else { Ok(()) }
    }

    fn alarm(&mut self, alarm: Alarm<'_>) -> Result<(), AlarmError> {
        self.services.signals.change(alarm.id, alarm.signal)?;
        let mut text = Line::new();
        text.text("message ").hex(&alarm.id.to_be_bytes()).text(if alarm.signal { " came" } else { " went" });
        if !alarm.value.is_empty() {
            text.text(", value ").hex(alarm.value);
        }
        self.log(if alarm.acknowledge { 2 } else { 3 }, text.as_str());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signals_change_and_make_room() {
        let mut signals = Signals::default();
        assert_eq!(signals.change(1, false), Err(AlarmError::FirstIsZero));
        for id in 1..=NUMBERS as u32 {
            assert_eq!(signals.change(id, true), Ok(()));
        }
        assert_eq!(signals.change(1, true), Err(AlarmError::NoChange));
        assert_eq!(signals.change(1000, true), Err(AlarmError::NoResources));
        assert_eq!(signals.change(7, false), Ok(()));
        assert_eq!(signals.change(1000, true), Ok(()));
        assert_eq!(signals.change(7, false), Err(AlarmError::FirstIsZero), "its place is another's");
    }

    #[test]
    fn a_line_ends_where_the_room_ends() {
        let mut line = Line::new();
        line.text("x").hex(&[0xA5; 200]);
        assert_eq!((line.as_str().len(), &line.as_str()[..5]), (LOG_TEXT, "xA5A5"));
    }
}
