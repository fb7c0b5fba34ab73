//! CP -> host: received telegrams, each cut into fragments that the host acknowledges [S3 "Receiving data"].

use crate::ring::{Capacity, ERRORS_MAX, Ring};
use ob1_words::cp040::{Area, FIRST, HEAD_BYTES, IDLE, INFO_OFFSET, INFO_PLAIN, IO_BYTES, LAST, nibble};
use ob1_words::cp240::BUFFER_BYTES;

/// Waiting telegrams are kept with the fields between their length and their data: info, offset if there is one, return
/// value.
const PLAIN_HEAD: usize = 3;
const OFFSET_HEAD: usize = 5;

/// The return value of a telegram. [S3 L319]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ReturnValue {
    /// 0517h: the length is not valid.
    Length = 0x0517,
    /// 080Ah: there was no free receive buffer.
    NoBuffer = 0x080A,
    /// 080Ch: frame or parity error of a character.
    Character = 0x080C,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Idle,
    /// Piece `piece` of the oldest telegram is shown.
    Offered {
        piece: usize,
        nibble: u8,
    },
    /// The last piece was acknowledged, or everything was dropped. The CP waits until the host shows idle: before that,
    /// its acknowledgement could mean either telegram, and the host could take the next one for the rest of the last.
    Closing,
}

/// The effect of the host's acknowledgement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Step {
    /// Nothing to do: the shown piece is not acknowledged, or none is shown.
    Wait,
    /// Another piece is shown.
    Offered,
    /// The last piece was taken; user bytes of the telegram, or `None` if it was an error telegram.
    Delivered(Option<usize>),
}

/// The receive buffer and its handshake.
#[derive(Debug)]
pub(crate) struct ReceiveSide {
    ring: Ring,
    state: State,
    shown: Area,
    /// User bytes in the ring: the buffer holds 1024, not counting what is kept beside them.
    used: usize,
    telegrams_max: usize,
    /// Error telegrams among the telegrams.
    errors: usize,
    /// It has been told that there was no room, and nothing has come out since.
    full_told: bool,
}

impl ReceiveSide {
    pub(crate) const fn new() -> Self {
        Self {
            ring: Ring::new(),
            state: State::Closing,
            shown: [0; *IO_BYTES.end()],
            used: 0,
            telegrams_max: 1,
            errors: 0,
            full_told: false,
        }
    }

    /// Empties the buffer; returns the number of telegrams (not errors) that were in it.
    pub(crate) fn clear(&mut self, telegrams_max: u8) -> usize {
        let dropped = self.telegrams();
        self.ring.clear(Capacity::large(u8::MAX).with_errors());
        (self.state, self.used, self.errors, self.full_told) = (State::Closing, 0, 0, false);
        self.shown = [0; *IO_BYTES.end()];
        self.telegrams_max = usize::from(telegrams_max);
        dropped
    }

    /// Telegrams in the buffer, errors not counted.
    pub(crate) const fn telegrams(&self) -> usize {
        self.ring.telegrams() - self.errors
    }

    /// Maximum user bytes of the next telegram; 0: none is accepted.
    pub(crate) fn room(&self) -> usize {
        let head = self.ring.room().saturating_sub(OFFSET_HEAD);
        if self.telegrams() < self.telegrams_max { (BUFFER_BYTES - self.used).min(head) } else { 0 }
    }

    /// Appends a telegram, with the offset of its data if it has one; false if there is no room.
    pub(crate) fn push(&mut self, offset: Option<u16>, data: &[u8]) -> bool {
        if data.is_empty() || data.len() > self.room() {
            return false;
        }
        let mut entry = [0; OFFSET_HEAD + BUFFER_BYTES];
        let head = match offset {
            None => PLAIN_HEAD,
            Some(offset) => {
                entry[0] = INFO_OFFSET;
                entry[1..3].copy_from_slice(&offset.to_be_bytes());
                OFFSET_HEAD
            }
        };
        let end = head + data.len();
        entry[head..end].copy_from_slice(data);
        let pushed = self.ring.push(&entry[..end]);
        if pushed {
            self.used += data.len();
        }
        pushed
    }

    /// Appends an error: a telegram with only the return value. A full buffer is told once until something has come
    /// out, and has the last place; other errors are dropped when too many wait. [S3 L319]
    pub(crate) fn push_error(&mut self, value: ReturnValue) {
        let is_full = value == ReturnValue::NoBuffer;
        if is_full && self.full_told || self.errors + usize::from(!is_full) >= ERRORS_MAX {
            return;
        }
        let [high, low] = (value as u16).to_be_bytes();
        if self.ring.push(&[INFO_PLAIN, high, low]) {
            self.errors += 1;
            self.full_told |= is_full;
        }
    }

    /// Fragment info: low nibble of input byte 0.
    pub(crate) const fn nibble(&self) -> u8 {
        match self.state {
            State::Offered { nibble, .. } => nibble,
            State::Idle | State::Closing => IDLE,
        }
    }

    /// The bytes after byte 0.
    pub(crate) const fn shown(&self) -> &Area {
        &self.shown
    }

    /// Evaluates the acknowledgement; offers as much as fits an area of `io_bytes`.
    pub(crate) fn look(&mut self, acknowledgement: u8, io_bytes: usize) -> Step {
        match self.state {
            State::Idle => self.offer(0, acknowledgement, io_bytes),
            State::Offered { piece, nibble } if acknowledgement == nibble => {
                if nibble != LAST {
                    return self.offer(piece + 1, acknowledgement, io_bytes);
                }
                let delivered = self.pop();
                self.state = State::Closing;
                Step::Delivered(delivered)
            }
            State::Closing if acknowledgement == IDLE => {
                self.state = State::Idle;
                self.offer(0, acknowledgement, io_bytes)
            }
            State::Offered { .. } | State::Closing => Step::Wait,
        }
    }

    fn pop(&mut self) -> Option<usize> {
        let mut info = [0];
        self.ring.copy(0, &mut info);
        let head = if info[0] == INFO_OFFSET { OFFSET_HEAD } else { PLAIN_HEAD };
        let bytes = self.ring.oldest().unwrap_or(head) - head;
        self.ring.pop();
        if bytes == 0 {
            self.errors -= 1;
            return None;
        }
        self.used -= bytes;
        self.full_told = false;
        Some(bytes)
    }

    fn offer(&mut self, piece: usize, acknowledgement: u8, io_bytes: usize) -> Step {
        let Some(entry) = self.ring.oldest() else { return Step::Wait };
        // Info, length, and the entry without its info.
        let total = HEAD_BYTES + entry - 1;
        let payload = io_bytes - 1;
        let nibble = nibble(piece, total, payload);
        // The acknowledgement of an earlier telegram would be taken for that of this one.
        if piece == 0 && acknowledgement == nibble {
            return Step::Wait;
        }
        self.shown = [0; *IO_BYTES.end()];
        let mut info = [0];
        self.ring.copy(0, &mut info);
        // The length counts the return value, not the offset. [S3 L321]
        let length = entry - 1 - if info[0] == INFO_OFFSET { 2 } else { 0 };
        let [high, low] = (length as u16).to_be_bytes();
        let head = [info[0], high, low];
        let begin = piece * payload;
        let end = total.min(begin + payload);
        let mut at = begin;
        while at < end.min(HEAD_BYTES) {
            self.shown[1 + at - begin] = head[at];
            at += 1;
        }
        let (from, to) = (1 + at - begin, 1 + end - begin);
        self.ring.copy(at - HEAD_BYTES + 1, &mut self.shown[from..to]);
        self.state = State::Offered { piece, nibble };
        debug_assert!(nibble == LAST || piece > 0 || nibble == FIRST);
        Step::Offered
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ready(telegrams_max: u8) -> ReceiveSide {
        let mut side = ReceiveSide::new();
        side.clear(telegrams_max);
        side
    }

    #[test]
    fn an_offset_stands_between_length_and_return_value() {
        let mut side = ready(250);
        assert!(side.push(Some(0x0118), &[1, 2, 3, 4, 5, 6, 7, 8]));
        assert_eq!(side.look(IDLE, 8), Step::Offered);
        assert_eq!((side.nibble(), &side.shown()[1..8]), (FIRST, &[4, 0, 10, 0x01, 0x18, 0, 0][..]));
        assert_eq!(side.look(FIRST, 8), Step::Offered);
        assert_eq!((side.nibble(), &side.shown()[1..8]), (0, &[1, 2, 3, 4, 5, 6, 7][..]));
        assert_eq!(side.look(0, 8), Step::Offered);
        assert_eq!((side.nibble(), &side.shown()[1..8]), (LAST, &[8, 0, 0, 0, 0, 0, 0][..]));
        assert_eq!(side.look(LAST, 8), Step::Delivered(Some(8)));
    }

    #[test]
    fn an_error_is_a_telegram_of_two_bytes() {
        let mut side = ready(1);
        assert!(side.push(None, b"x"));
        for value in [ReturnValue::Character, ReturnValue::NoBuffer, ReturnValue::NoBuffer] {
            side.push_error(value);
        }
        assert_eq!((side.telegrams(), side.room()), (1, 0));
        side.look(IDLE, 16);
        side.look(LAST, 16);
        for expected in [[0, 0, 2, 0x08, 0x0C], [0, 0, 2, 0x08, 0x0A]] {
            assert_eq!(side.look(IDLE, 16), Step::Offered);
            assert_eq!((side.nibble(), &side.shown()[1..6]), (LAST, &expected[..]));
            assert_eq!(side.look(LAST, 16), Step::Delivered(None));
        }
        assert_eq!(side.look(IDLE, 16), Step::Wait);
        assert_eq!(side.room(), 1024);
    }

    #[test]
    fn the_buffer_holds_1024_user_bytes_in_250_telegrams() {
        let mut side = ready(250);
        for n in 0..250 {
            assert!(side.push(None, &[n; 4]), "{n}");
        }
        assert!(!side.push(None, &[1]));
        // "A free receive buffer is not available" is told all the same, whatever else there is to tell. [S3 L319]
        for _ in 0..20 {
            side.push_error(ReturnValue::Character);
            side.push_error(ReturnValue::NoBuffer);
        }
        let (mut told, mut telegrams) = (Vec::new(), 0);
        while side.look(IDLE, 16) == Step::Offered {
            let value = [side.shown()[4], side.shown()[5]];
            match side.look(LAST, 16) {
                Step::Delivered(None) => told.push(u16::from_be_bytes(value)),
                _ => telegrams += 1,
            }
        }
        assert_eq!((telegrams, told.iter().filter(|value| **value == 0x080A).count()), (250, 1));
        side.push_error(ReturnValue::NoBuffer);
        side.push_error(ReturnValue::NoBuffer);
        assert_eq!(side.telegrams() + side.errors, 1, "again, because something has come out; and once");
        side.clear(250);
        assert!(side.push(None, &[1; 1024]));
        assert_eq!(side.room(), 0);
    }

    #[test]
    fn an_old_acknowledgement_fetches_nothing_new() {
        let mut side = ready(250);
        side.push(None, &[7; 40]);
        side.look(IDLE, 16);
        assert_eq!(side.look(FIRST, 16), Step::Offered);
        side.clear(250);
        side.push(None, &[8; 40]);
        for old in [FIRST, 0, LAST] {
            assert_eq!(side.look(old, 16), Step::Wait);
            assert_eq!(side.nibble(), IDLE);
        }
        assert_eq!(side.look(IDLE, 16), Step::Offered);
        assert_eq!(side.nibble(), FIRST);
    }
}
