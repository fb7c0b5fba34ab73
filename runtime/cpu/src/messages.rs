//! Messages of the program: user entries of the diagnostic buffer (SFC 52) and block-related messages (SFC 17 to
//! 19, 105 to 108).
//!
//! There are no display devices that could log on: a block-related message goes to the log, and SFC 17's and 107's are
//! acknowledged at once.

use ob1_model::Event;
use ob1_std::services::{Alarm, AlarmError, InUse, MessageError, Messages};

use crate::machine::Machine;
use crate::{DiagEntry, LOG_TEXT, ShortText};

/// Message numbers that can be in use at one time.
const NUMBERS: usize = 64;

/// The message numbers seen, with their signals.
#[derive(Debug)]
pub(crate) struct Signals {
    list: [InUse; NUMBERS],
    used: usize,
}

impl Default for Signals {
    fn default() -> Self {
        Self { list: [InUse::default(); NUMBERS], used: 0 }
    }
}

impl Signals {
    /// Notes the signal of a number. A number whose signal has gone makes room when another needs it.
    fn change(&mut self, alarm: Alarm<'_>) -> Result<(), AlarmError> {
        // With nobody logged on, a message that waits for an acknowledgement has it at once.
        let Alarm { sfc, id, component, signal, acknowledge: acknowledged, .. } = alarm;
        if let Some(known) = self.list[..self.used].iter_mut().find(|known| known.id == id) {
            if known.signal == signal {
                return Err(AlarmError::NoChange);
            }
            (known.signal, known.acknowledged) = (signal, acknowledged);
            return Ok(());
        }
        if !signal {
            return Err(AlarmError::FirstIsZero);
        }
        let place = match self.list[..self.used].iter().position(|number| !number.signal) {
            _ if self.used < NUMBERS => {
                self.used += 1;
                self.used - 1
            }
            Some(gone) => gone,
            None => return Err(AlarmError::NoResources),
        };
        self.list[place] = InUse { sfc, id, component, signal, acknowledged };
        Ok(())
    }

    /// Sets numbers free.
    fn release(&mut self, which: &dyn Fn(InUse) -> bool) {
        let mut at = 0;
        while at < self.used {
            if which(self.list[at]) {
                self.used -= 1;
                self.list[at] = self.list[self.used];
            } else {
                at += 1;
            }
        }
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
            time: self.hot.now,
            event: Event(event),
            site: None,
            accus: [0; 2],
            data: word,
            text: ShortText::new(text.as_str()),
        });
        if send { Err(MessageError::NoStation) } else { Ok(()) }
    }

    fn alarm(&mut self, alarm: Alarm<'_>) -> Result<(), AlarmError> {
        self.services.signals.change(alarm)?;
        let mut text = Line::new();
        text.text("message ").hex(&alarm.id.to_be_bytes()).text(if alarm.signal { " came" } else { " went" });
        if !alarm.value.is_empty() {
            text.text(", value ").hex(alarm.value);
        }
        self.log(if alarm.acknowledge { 2 } else { 3 }, text.as_str());
        Ok(())
    }

    fn in_use(&mut self, each: &mut dyn FnMut(InUse)) {
        let signals = &self.services.signals;
        signals.list[..signals.used].iter().copied().for_each(each);
    }

    fn release(&mut self, which: &dyn Fn(InUse) -> bool) {
        self.services.signals.release(which);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signals_change_and_make_room() {
        let mut signals = Signals::default();
        let alarm = |id, signal| Alarm { sfc: 108, id, component: id % 2, signal, acknowledge: false, value: &[] };
        assert_eq!(signals.change(alarm(1, false)), Err(AlarmError::FirstIsZero));
        for id in 1..=NUMBERS as u32 {
            assert_eq!(signals.change(alarm(id, true)), Ok(()));
        }
        assert_eq!(signals.change(alarm(1, true)), Err(AlarmError::NoChange));
        assert_eq!(signals.change(alarm(1000, true)), Err(AlarmError::NoResources));
        assert_eq!(signals.change(alarm(7, false)), Ok(()));
        assert_eq!(signals.change(alarm(1000, true)), Ok(()));
        assert_eq!(signals.change(alarm(7, false)), Err(AlarmError::FirstIsZero), "its place is another's");
        signals.release(&|number| number.component == 0);
        assert_eq!(signals.used, NUMBERS / 2 - 1);
        assert!(signals.list[..signals.used].iter().all(|number| number.id % 2 == 1));
        assert_eq!(signals.change(alarm(2, true)), Ok(()), "set free, so it is a new one");
    }

    #[test]
    fn a_line_ends_where_the_room_ends() {
        let mut line = Line::new();
        line.text("x").hex(&[0xA5; 200]);
        assert_eq!((line.as_str().len(), &line.as_str()[..5]), (LOG_TEXT, "xA5A5"));
    }
}
