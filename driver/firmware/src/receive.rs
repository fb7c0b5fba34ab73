//! CP -> CPU: the oldest received telegram handed over block by block [S0 "Example RECEIVE data"].

use crate::registers::{AREA, BLOCK_BYTES, OUTSIDE, count};
use crate::ring::{Capacity, Ring};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// `RX` is 0; the next telegram may be offered once `RX echo` is 0 too.
    Idle,
    /// `RX` = `rest`, and the block that goes with it.
    Offered { rest: usize },
    /// The last block has been fetched, `RX` is 0; `RX echo` has to follow.
    Closing,
}

/// What the CPU's echo has brought about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Step {
    /// Nothing to do.
    Wait,
    /// Another block is on show.
    Offered,
    /// A telegram of this length was handed over completely and has left the buffer.
    Delivered(usize),
    /// The CPU refuses the changed area; it has left the buffer.
    Refused,
}

/// The receive buffer and its handshake.
#[derive(Debug)]
pub(crate) struct ReceiveSide {
    state: State,
    pub(crate) ring: Ring,
    block: [u8; BLOCK_BYTES],
    /// Bit of all counts: the telegrams are changed areas of the Modbus slave "long".
    area: u16,
}

impl ReceiveSide {
    pub(crate) const fn new() -> Self {
        Self { state: State::Idle, ring: Ring::new(), block: [0; BLOCK_BYTES], area: 0 }
    }

    /// Back to "nothing received"; the number of telegrams dropped.
    pub(crate) fn clear(&mut self, capacity: Capacity) -> usize {
        let dropped = self.ring.telegrams();
        self.state = State::Idle;
        self.ring.clear(capacity);
        dropped
    }

    /// Whether telegrams are changed areas.
    pub(crate) const fn set_area(&mut self, area: bool) {
        self.area = if area { AREA } else { 0 };
    }

    /// `RX`.
    pub(crate) const fn word(&self) -> u16 {
        match self.rest() {
            0 => 0,
            rest => rest | self.area,
        }
    }

    /// The count in `RX`.
    pub(crate) const fn rest(&self) -> u16 {
        match self.state {
            State::Idle | State::Closing => 0,
            State::Offered { rest } => rest as u16,
        }
    }

    /// The block that goes with `RX`; empty if that is 0.
    pub(crate) fn block(&self) -> &[u8] {
        &self.block[..usize::from(self.rest()).min(BLOCK_BYTES)]
    }

    /// Looks at `RX echo`.
    pub(crate) fn look(&mut self, echo: u16) -> Step {
        if self.area != 0 && echo == OUTSIDE && matches!(self.state, State::Offered { .. }) {
            self.ring.pop();
            self.state = State::Closing;
            return Step::Refused;
        }
        let echo = if echo == 0 { 0 } else { echo ^ self.area };
        match (self.state, count(echo)) {
            (State::Idle, Some(0)) => match self.ring.oldest() {
                Some(length) => {
                    self.offer(length, length);
                    Step::Offered
                }
                None => Step::Wait,
            },
            (State::Offered { rest }, Some(echo)) if echo == rest => {
                let length = self.ring.oldest().unwrap_or(0);
                if rest > BLOCK_BYTES {
                    self.offer(length, rest - BLOCK_BYTES);
                    return Step::Offered;
                }
                self.ring.pop();
                self.state = State::Closing;
                Step::Delivered(length)
            }
            (State::Closing, Some(0)) => {
                self.state = State::Idle;
                self.look(0)
            }
            _ => Step::Wait,
        }
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
