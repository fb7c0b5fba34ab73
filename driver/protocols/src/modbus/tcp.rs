//! The frame of Modbus TCP: a header of transaction, protocol and length in front of the telegram, and no check,
//! because TCP has its own. ["MODBUS Messaging on TCP/IP Implementation Guide V1.0b", 3.1.3]
//!
//! The telegram is the one of serial lines: unit (where those have the slave address), function code, data.

use super::failure::Failure;

/// Bytes of the header in front of the telegram.
pub const HEAD_BYTES: usize = 6;
/// Longest telegram: unit and 253 bytes of function code and data.
pub const TELEGRAM_BYTES: usize = 254;
/// Longest frame: header and longest telegram, in bytes.
pub const FRAME_BYTES: usize = HEAD_BYTES + TELEGRAM_BYTES;
/// Unit and function code.
const SHORTEST: usize = 2;

/// Writes header and telegram; returns the length. `None`: the telegram is too short or too long.
pub fn encode(transaction: u16, telegram: &[u8], frame: &mut [u8; FRAME_BYTES]) -> Option<usize> {
    if !(SHORTEST..=TELEGRAM_BYTES).contains(&telegram.len()) {
        return None;
    }
    let [t0, t1] = transaction.to_be_bytes();
    let [l0, l1] = (telegram.len() as u16).to_be_bytes();
    let (head, rest) = frame.split_at_mut(HEAD_BYTES);
    head.copy_from_slice(&[t0, t1, 0, 0, l0, l1]);
    rest.get_mut(..telegram.len())?.copy_from_slice(telegram);
    Some(HEAD_BYTES + telegram.len())
}

/// Assembles telegrams from a stream of bytes.
#[derive(Clone, Debug)]
pub struct Receiver {
    bytes: [u8; FRAME_BYTES],
    len: usize,
    /// The last telegram has been handed out: the next byte begins another.
    done: bool,
}

impl Default for Receiver {
    fn default() -> Self {
        Self::new()
    }
}

impl Receiver {
    /// A receiver before its first byte.
    pub const fn new() -> Self {
        Self { bytes: [0; FRAME_BYTES], len: 0, done: false }
    }

    /// Drops what has been received: another connection begins.
    pub const fn clear(&mut self) {
        (self.len, self.done) = (0, false);
    }

    /// Takes one byte; true if it completes a telegram.
    ///
    /// # Errors
    /// [`Failure::Start`]: another protocol. [`Failure::Overflow`]: a length that no telegram has. After that the
    /// beginning of a telegram can no longer be found: the connection must be closed.
    pub fn byte(&mut self, byte: u8) -> Result<bool, Failure> {
        if self.done {
            self.clear();
        }
        let place = self.bytes.get_mut(self.len).ok_or(Failure::Overflow)?;
        *place = byte;
        self.len += 1;
        if self.len < HEAD_BYTES {
            return Ok(false);
        }
        if self.bytes[2..4] != [0, 0] {
            return Err(Failure::Start);
        }
        let length = usize::from(u16::from_be_bytes([self.bytes[4], self.bytes[5]]));
        if !(SHORTEST..=TELEGRAM_BYTES).contains(&length) {
            return Err(Failure::Overflow);
        }
        self.done = self.len == HEAD_BYTES + length;
        Ok(self.done)
    }

    /// The complete telegram and its transaction; available until the next byte.
    pub fn telegram(&self) -> Option<(u16, &[u8])> {
        let telegram = self.bytes.get(HEAD_BYTES..self.len)?;
        self.done.then_some((u16::from_be_bytes([self.bytes[0], self.bytes[1]]), telegram))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fed(receiver: &mut Receiver, bytes: &[u8]) -> Result<bool, Failure> {
        let mut whole = Ok(false);
        for byte in bytes {
            whole = receiver.byte(*byte);
        }
        whole
    }

    #[test]
    fn telegrams_go_both_ways() {
        let mut frame = [0; FRAME_BYTES];
        let request = [0x11, 0x03, 0x00, 0x6B, 0x00, 0x03];
        assert_eq!(encode(0x1501, &request, &mut frame), Some(12));
        assert_eq!(frame[..12], [0x15, 0x01, 0, 0, 0, 6, 0x11, 0x03, 0x00, 0x6B, 0x00, 0x03]);
        let mut receiver = Receiver::new();
        for _ in 0..2 {
            assert_eq!(fed(&mut receiver, &frame[..11]), Ok(false));
            assert_eq!(receiver.telegram(), None);
            assert_eq!(receiver.byte(frame[11]), Ok(true));
            assert_eq!(receiver.telegram(), Some((0x1501, &request[..])));
        }
        for wrong in [&[1][..], &[0; 255]] {
            assert_eq!(encode(1, wrong, &mut frame), None);
        }
        assert_eq!(encode(1, &[7; 254], &mut frame), Some(FRAME_BYTES));
        assert_eq!(fed(&mut receiver, &frame), Ok(true));
    }

    #[test]
    fn another_protocol_and_lengths_that_cannot_be() {
        for (head, failure) in [
            ([0, 1, 0, 1, 0, 6], Failure::Start),
            ([0, 1, 0, 0, 0, 1], Failure::Overflow),
            ([0, 1, 0, 0, 0, 255], Failure::Overflow),
            ([0, 1, 0, 0, 1, 6], Failure::Overflow),
        ] {
            let mut receiver = Receiver::new();
            assert_eq!(fed(&mut receiver, &head), Err(failure), "{head:?}");
            receiver.clear();
            assert_eq!(fed(&mut receiver, &[0, 1, 0, 0, 0, 2, 1, 3]), Ok(true));
        }
    }
}
