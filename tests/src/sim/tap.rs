//! A tap on the simulated line: which telegrams were sent, and which came out good by the check character alone.
//!
//! 3964R cannot catch everything: two bits flipped in the same column of a block, or a lost 00h, leave the check
//! character right. So a telegram that arrives wrong is a fault of ours only when no block with a right check
//! character came out of the line. The tap decides that with a decoder of its own, written from the manual's
//! description of the block [S0 L1650-L1660] and independent of the machines it judges.

use ob1_cpu::Nanos;

/// A connection request.
pub const STX: u8 = 0x02;
const ETX: u8 = 0x03;
const DLE: u8 = 0x10;
/// A refusal.
pub const NAK: u8 = 0x15;

/// The character delay time of the demo's stations: who is silent for longer in a block has given it up.
const ZVZ: Nanos = 200_000_000;

/// Reads the blocks out of a stream of characters.
#[derive(Debug, Default)]
pub struct Tap {
    state: State,
    payload: Vec<u8>,
    check: u8,
    spoilt: bool,
    last: Nanos,
    /// When the request came.
    begun: Nanos,
    /// What the receiver has sent is still on the line, its DLE perhaps.
    answering: bool,
    /// The request has been repeated before it was answered.
    asked_again: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum State {
    #[default]
    Idle,
    Data,
    Dle,
    Check,
}

impl Tap {
    /// Takes a character that was complete at `now`; answers a payload whose block has a right check character.
    ///
    /// An STX begins a block where none is open; an open one ends with its check character, or by silence longer than
    /// ZVZ.
    pub fn push(&mut self, now: Nanos, byte: u8) -> Option<&[u8]> {
        self.hear(now);
        if byte == STX && self.state == State::Data && self.payload.is_empty() {
            if self.answering || self.begun == now {
                // A request once more: it was sent before the DLE to the first one could be heard. [reference 5.4]
                self.asked_again = true;
                return None;
            }
            // Perhaps one more of these: nobody may take it for data.
            self.spoilt |= self.asked_again;
        }
        if self.state != State::Idle && self.state != State::Check {
            self.check ^= byte;
        }
        match (self.state, byte) {
            (State::Idle, STX) => {
                (self.state, self.begun) = (State::Data, now);
                self.payload.clear();
                (self.check, self.spoilt, self.asked_again) = (0, false, false);
            }
            (State::Idle, _) => {}
            (State::Data, DLE) => self.state = State::Dle,
            (State::Data, _) => self.payload.push(byte),
            (State::Dle, DLE) => {
                self.payload.push(byte);
                self.state = State::Data;
            }
            (State::Dle, ETX) => self.state = State::Check,
            (State::Dle, _) => {
                self.spoilt = true;
                self.state = State::Data;
            }
            (State::Check, bcc) => {
                self.state = State::Idle;
                if bcc == self.check && !self.spoilt {
                    return Some(&self.payload);
                }
            }
        }
        None
    }

    /// The sender puts a connection request on the line: it has no block open, whatever became of the request before.
    pub fn request(&mut self, now: Nanos) {
        self.state = State::Idle;
        let _ = self.push(now, STX);
    }

    /// A character that could not be read: what is open cannot become good.
    pub fn spoil(&mut self, now: Nanos) {
        self.hear(now);
        self.spoilt = true;
        if self.state == State::Check {
            // In the place of the check character: it has ended.
            self.state = State::Idle;
        }
    }

    /// The receiver puts something on the line, or all of it is out.
    pub fn answers(&mut self, is_leaving: bool) {
        self.answering = is_leaving;
    }

    /// The receiver refuses: it has no block open any more, and what comes is a request or means nothing.
    pub fn refuses(&mut self) {
        self.state = State::Idle;
    }

    /// The receiver asks itself instead of answering a request: it does not take that one, and the partner withdraws it
    /// or asks again [S0 L1650-L1660].
    pub fn asks(&mut self) {
        if self.state == State::Data && self.payload.is_empty() {
            self.state = State::Idle;
        }
    }

    fn hear(&mut self, now: Nanos) {
        if now.saturating_sub(self.last) > ZVZ {
            self.state = State::Idle;
        }
        self.last = now;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn good(bytes: &[u8]) -> Vec<Vec<u8>> {
        let mut tap = Tap::default();
        (1..).zip(bytes).filter_map(|(at, byte)| tap.push(at, *byte).map(<[u8]>::to_vec)).collect()
    }

    #[test]
    fn check_values_of_the_reference() {
        // Reference 5.1.
        assert_eq!(good(b"\x02\x31\x10\x03\x22"), [b"\x31"]);
        assert_eq!(good(b"\x02\x10\x10\x10\x03\x13"), [b"\x10"]);
        assert_eq!(good(b"\x02\x02\x10\x10\x03\x15\x10\x03\x07"), [b"\x02\x10\x03\x15"]);
    }

    #[test]
    fn a_wrong_check_character_is_not_good() {
        assert!(good(b"\x02\x31\x10\x03\x23").is_empty());
        assert_eq!(good(b"\x02\x31\x10\x03\x23\x02\x41\x42\x43\x10\x03\x53"), [b"ABC"]);
    }

    #[test]
    fn silence_and_unreadable_characters_end_what_is_open() {
        let mut tap = Tap::default();
        let mut good = 0;
        for (at, byte) in
            [(0, 0x02), (1, 0x31), (ZVZ + 2, 0x02), (ZVZ + 3, 0x31), (ZVZ + 4, 0x10), (ZVZ + 5, 0x03), (ZVZ + 6, 0x22)]
        {
            good += u32::from(tap.push(at, byte).is_some());
        }
        assert_eq!(good, 1);
        for byte in [0x02, 0x31] {
            assert!(tap.push(ZVZ + 7, byte).is_none());
        }
        tap.spoil(ZVZ + 8);
        assert!([0x10, 0x03, 0x22].into_iter().all(|byte| tap.push(ZVZ + 9, byte).is_none()));
        for byte in [0x02, 0x31, 0x10, 0x03] {
            assert!(tap.push(ZVZ + 10, byte).is_none());
        }
        tap.spoil(ZVZ + 11);
        let good = b"\x02\x31\x10\x03\x22".iter().filter(|byte| tap.push(ZVZ + 12, **byte).is_some()).count();
        assert_eq!(good, 1, "the block after one whose check character could not be read");
    }

    /// A driver that was started anew refuses the rest of a block its predecessor was at, a NAK for each character;
    /// the sender asks anew for each of them. Two of these requests read as data leave the check character as it is.
    #[test]
    fn a_block_that_was_refused_is_over() {
        let mut tap = Tap::default();
        for byte in [STX, 0x31, 0x32] {
            assert!(tap.push(1, byte).is_none());
        }
        tap.refuses();
        let mut good = Vec::new();
        for (at, byte) in (2..).zip(*b"\x02\x02\x02\x31\x10\x03\x22") {
            good.extend(tap.push(at, byte).map(<[u8]>::to_vec));
        }
        assert_eq!(good, [b"\x02\x02\x31"]);
    }

    /// The acknowledgement of a block is lost, the partner asks, the sender asks anew: the partner withdraws, takes the
    /// block again, and its acknowledgement and its next request arrive together.
    #[test]
    fn a_request_that_is_answered_by_a_request_is_void() {
        let mut tap = Tap::default();
        assert!(tap.push(1, STX).is_none());
        tap.asks();
        let good =
            |tap: &mut Tap, at: u64, bytes: &[u8]| bytes.iter().filter(|byte| tap.push(at, **byte).is_some()).count();
        assert_eq!(good(&mut tap, 2, &[DLE]), 0);
        assert_eq!(good(&mut tap, 3, &[DLE, STX]), 0);
        assert_eq!(good(&mut tap, 4, b"\x31\x10\x03\x22"), 1);
        // In the middle of a block nothing changes.
        assert_eq!(good(&mut tap, 5, b"\x02\x31"), 0);
        tap.asks();
        assert_eq!(good(&mut tap, 6, b"\x10\x03\x22"), 1);
    }

    #[test]
    fn a_request_that_is_repeated_before_the_answer_is_no_data() {
        let mut tap = Tap::default();
        // In one go, and while the answer leaves.
        assert!(tap.push(1, STX).is_none() && tap.push(1, STX).is_none());
        tap.answers(true);
        assert!(tap.push(2, STX).is_none());
        tap.answers(false);
        let mut good = |at: Nanos, bytes: &[u8]| bytes.iter().filter(|byte| tap.push(at, **byte).is_some()).count();
        assert_eq!(good(3, b"\x31\x10\x03\x22"), 1);
        // The same, and two more of them behind the answer: they leave the check character right.
        assert_eq!(good(4, b"\x02\x02"), 0);
        assert_eq!(good(5, b"\x02\x02\x31\x10\x03\x22"), 0);
        // Asked once, they are data.
        assert_eq!(good(6, b"\x02"), 0);
        assert_eq!(good(7, b"\x02\x02\x31\x10\x03\x22"), 1);
    }
}
