//! CP -> CPU: the oldest received telegram handed over block by block [S0 "Example RECEIVE data"].

use ob1_protocols::Part;

use crate::ring::{Capacity, Ring};
use ob1_words::cp240::{AREA, BLOCK_BYTES, BROKEN_OFF, MORE, OUTSIDE, count};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// `RX` is 0; the next telegram may be offered once `RX echo` is 0 too.
    Idle,
    /// `RX` = `rest`, with its block.
    Offered { rest: usize },
    /// `RX` shows the end of a telegram whose parts have been fetched.
    Marked { word: u16 },
    /// The last block has been fetched, `RX` is 0; `RX echo` must become 0 too.
    Closing,
}

/// The effect of the CPU's echo.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Step {
    /// Nothing to do: the shown block is not echoed, or none is shown.
    Wait,
    /// Another block is shown.
    Offered,
    /// A telegram of this length was handed over completely and has left the buffer.
    Delivered(usize),
    /// A part of a telegram has left the buffer, or the mark that its rest is lost.
    PartTaken,
    /// The CPU refuses the changed area, which has left the buffer.
    Refused,
}

/// The receive buffer and its handshake.
#[derive(Debug)]
pub(crate) struct ReceiveSide {
    state: State,
    pub(crate) ring: Ring,
    block: [u8; BLOCK_BYTES],
    /// Bit set in all counts when the telegrams are changed areas of the Modbus slave "long".
    area: u16,
    /// [`MORE`] if more follows the shown block.
    more: u16,
    /// Bytes of the parts that were fetched.
    fetched: usize,
}

impl ReceiveSide {
    pub(crate) const fn new() -> Self {
        let block = [0; BLOCK_BYTES];
        Self { state: State::Idle, ring: Ring::new(), block, area: 0, more: 0, fetched: 0 }
    }

    /// Back to "nothing received"; returns the number of telegrams dropped.
    pub(crate) fn clear(&mut self, capacity: Capacity) -> usize {
        let dropped = self.ring.complete();
        (self.state, self.more, self.fetched) = (State::Idle, 0, 0);
        self.ring.clear(capacity);
        dropped
    }

    /// Whether telegrams are changed areas.
    pub(crate) const fn set_area(&mut self, area: bool) {
        self.area = if area { AREA } else { 0 };
    }

    /// The count word `RX` as it is shown.
    pub(crate) const fn word(&self) -> u16 {
        match self.state {
            State::Idle | State::Closing => 0,
            State::Offered { rest } => rest as u16 | self.area | self.more,
            State::Marked { word } => word,
        }
    }

    /// The count in `RX`.
    pub(crate) const fn rest(&self) -> u16 {
        match self.state {
            State::Idle | State::Closing | State::Marked { .. } => 0,
            State::Offered { rest } => rest as u16,
        }
    }

    /// Whether something is shown.
    pub(crate) const fn is_offering(&self) -> bool {
        matches!(self.state, State::Offered { .. } | State::Marked { .. })
    }

    /// The block of `RX`; empty if `RX` is 0.
    pub(crate) fn block(&self) -> &[u8] {
        &self.block[..usize::from(self.rest()).min(BLOCK_BYTES)]
    }

    /// Evaluates `RX echo`: whether the CPU has taken what `RX` shows.
    pub(crate) fn look(&mut self, echo: u16) -> Step {
        if self.area != 0 && echo == OUTSIDE && matches!(self.state, State::Offered { .. }) {
            self.ring.pop();
            self.state = State::Closing;
            return Step::Refused;
        }
        if let State::Marked { word } = self.state {
            return if echo == MORE || echo == word { self.taken(0) } else { Step::Wait };
        }
        let echo = if echo == 0 { 0 } else { echo ^ self.area };
        let echo = if self.area == 0 { echo & !MORE } else { echo };
        match (self.state, count(echo)) {
            (State::Idle, Some(0)) => match (self.ring.oldest(), self.ring.oldest_part()) {
                (Some(_), Part::Broken) => self.mark(BROKEN_OFF),
                (Some(0), _) => self.mark(MORE),
                (Some(length), part) => {
                    self.more = if part == Part::More { MORE } else { 0 };
                    self.offer(length, length);
                    Step::Offered
                }
                (None, _) => Step::Wait,
            },
            (State::Offered { rest }, Some(echo)) if echo == rest => {
                let length = self.ring.oldest().unwrap_or(0);
                if rest > BLOCK_BYTES {
                    self.offer(length, rest - BLOCK_BYTES);
                    return Step::Offered;
                }
                self.taken(length)
            }
            (State::Closing, Some(0)) => {
                self.state = State::Idle;
                self.look(0)
            }
            _ => Step::Wait,
        }
    }

    fn mark(&mut self, word: u16) -> Step {
        self.state = State::Marked { word };
        Step::Offered
    }

    /// The shown block has been fetched.
    fn taken(&mut self, length: usize) -> Step {
        let part = self.ring.oldest_part();
        self.ring.pop();
        self.state = State::Closing;
        self.fetched += length;
        if part == Part::More {
            return Step::PartTaken;
        }
        let length = core::mem::take(&mut self.fetched);
        if part == Part::Broken { Step::PartTaken } else { Step::Delivered(length) }
    }

    fn offer(&mut self, length: usize, rest: usize) {
        self.block = [0; BLOCK_BYTES];
        self.ring.copy(length - rest, &mut self.block[..rest.min(BLOCK_BYTES)]);
        self.state = State::Offered { rest };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eighteen_bytes_are_18_6_0() {
        let mut receive = ReceiveSide::new();
        receive.clear(Capacity::buffers(250));
        receive.ring.push(b"abcdefghijklmnopqr");
        receive.ring.push(b"next");
        assert_eq!(receive.look(0), Step::Offered);
        assert_eq!((receive.rest(), receive.block()), (18, &b"abcdefghijkl"[..]));
        assert_eq!(receive.look(18), Step::Offered);
        assert_eq!((receive.rest(), receive.block()), (6, &b"mnopqr"[..]));
        assert_eq!(receive.ring.telegrams(), 2, "it leaves the buffer when its last count is echoed");
        assert_eq!(receive.look(6), Step::Delivered(18));
        assert_eq!((receive.rest(), receive.ring.telegrams()), (0, 1));
        assert_eq!(receive.look(6), Step::Wait, "the echo has to go to 0 first");
        assert_eq!(receive.look(0), Step::Offered);
        assert_eq!(receive.rest(), 4);
    }

    #[test]
    fn parts_say_what_comes_behind_them() {
        let mut receive = ReceiveSide::new();
        receive.clear(Capacity::buffers(250));
        for (bytes, part) in [
            (&b"abcdefghijkl"[..], Part::More),
            (b"mno", Part::Last),
            (b"123456789012", Part::More),
            (b"", Part::Last),
            (b"ABCDEFGHIJKL", Part::More),
            (b"", Part::Broken),
        ] {
            assert!(receive.ring.push_part(bytes, part));
        }
        assert_eq!(receive.ring.complete(), 2);
        for (word, bytes, step) in [
            (0x200C, &b"abcdefghijkl"[..], Step::PartTaken),
            (3, b"mno", Step::Delivered(15)),
            (0x200C, b"123456789012", Step::PartTaken),
            (0x2000, b"", Step::Delivered(12)),
            (0x200C, b"ABCDEFGHIJKL", Step::PartTaken),
            (0x27FF, b"", Step::PartTaken),
        ] {
            assert_eq!(receive.look(0), Step::Offered);
            assert_eq!((receive.word(), receive.block()), (word, bytes));
            assert_eq!(receive.look(word), step);
        }
        assert_eq!((receive.look(0), receive.word()), (Step::Wait, 0));
    }

    /// A CPU that does not know the bit sends counts, and 0.
    #[test]
    fn the_bit_may_be_left_out_of_the_echo() {
        let mut receive = ReceiveSide::new();
        receive.clear(Capacity::buffers(250));
        receive.ring.push_part(b"abcdefghijkl", Part::More);
        receive.ring.push_part(b"", Part::Last);
        receive.ring.push_part(b"xy", Part::Last);
        receive.look(0);
        assert_eq!(receive.look(12), Step::PartTaken);
        assert_eq!((receive.look(0), receive.word()), (Step::Offered, 0x2000));
        assert_eq!(receive.look(0), Step::Wait);
        assert_eq!(receive.look(0x2000), Step::Delivered(12));
        assert_eq!((receive.look(0x2000), receive.word()), (Step::Offered, 2));
    }

    #[test]
    fn an_echo_that_does_not_fit_is_absent() {
        let mut receive = ReceiveSide::new();
        receive.clear(Capacity::buffers(250));
        receive.ring.push(&[1; 30]);
        assert_eq!(receive.look(30), Step::Wait, "offered only while the echo is 0");
        receive.look(0);
        for echo in [0, 18, 6, 31, 0x8001, 0x401E] {
            assert_eq!(receive.look(echo), Step::Wait, "{echo:04X}h");
            assert_eq!(receive.rest(), 30);
        }
    }
}
