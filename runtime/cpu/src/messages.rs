//! Messages of the program: user entries of the diagnostic buffer (SFC 52), and the alarms.

use ob1_model::{AlarmTime, Displays, Event};
use ob1_std::services::{AlarmTable, MessageError, Messages};

use crate::machine::Machine;
use crate::{LOG_TEXT, ShortText};

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

impl Machine {
    /// The time of what happens to an alarm now.
    pub(crate) fn alarm_time(&self) -> AlarmTime {
        AlarmTime { nanos: self.real().nanos(), wall: self.wall.bytes(self.hot.now) }
    }
}

impl Messages for Machine {
    fn user_message(&mut self, event: u16, info1: &[u8], info2: &[u8], send: bool) -> Result<(), MessageError> {
        let mut text = Line::new();
        text.text("INFO1 ").hex(info1).text(", INFO2 ").hex(info2);
        let word = info1.iter().take(2).fold(0, |word, byte| word << 8 | u32::from(*byte));
        self.enter(Event(event), None, word, ShortText::new(text.as_str()));
        // Whoever has logged on gets every entry of the buffer.
        let logged_on = self.alarms.table.displays().want(Displays::DIAGNOSIS);
        if send && !logged_on { Err(MessageError::NoStation) } else { Ok(()) }
    }

    fn alarms(&mut self) -> &mut AlarmTable {
        &mut self.alarms.table
    }

    fn alarm_time(&mut self) -> AlarmTime {
        Machine::alarm_time(self)
    }

    fn send_alarms(&mut self) {
        self.alarms.send();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_ends_where_the_room_ends() {
        let mut line = Line::new();
        line.text("x").hex(&[0xA5; 200]);
        assert_eq!((line.as_str().len(), &line.as_str()[..5]), (LOG_TEXT, "xA5A5"));
    }
}
