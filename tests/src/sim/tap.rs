//! A tap on the simulated line: which telegrams were sent, and which were received with a correct check character.
//!
//! 3964R cannot detect every error: two inverted bits in the same column of a block, or a lost 00h, do not change the
//! check character. So a wrong telegram is our error only if no block with a correct check character came out of the
//! line. The tap checks this with its own decoder, written from the manual's description of the block [S0 L1650-L1660]
//! and independent of the tested machines.

use ob1_time::{Instant, Span};

/// A connection request.
pub const STX: u8 = 0x02;
const ETX: u8 = 0x03;
/// Ready to receive, and received.
pub const DLE: u8 = 0x10;
/// A refusal.
pub const NAK: u8 = 0x15;

/// The character delay time of the demo's stations: a longer silence in a block ends it.
const ZVZ: Span = Span::from_millis(200);

/// Decodes the blocks in a stream of characters.
#[derive(Debug, Default)]
pub struct Tap {
    state: State,
    payload: Vec<u8>,
    check: u8,
    spoilt: bool,
    last: Instant,
    /// Time of the request.
    begun: Instant,
    /// Characters of the receiver, perhaps its DLE, are still on the line.
    answering: bool,
    /// The request was repeated before it was answered.
    asked_again: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum State {
    #[default]
    Idle,
    /// A connection was requested, and the receiver has not sent DLE yet.
    Asked,
    /// The same, and since then a refusal was sent, perhaps for characters before the request in the same burst, or the
    /// sender has answered a request of the receiver: the next STX is not a repetition.
    AskedOnce,
    Data,
    Dle,
    Check,
}

impl Tap {
    /// Takes a character that was complete at `now`; returns the payload of a block with a correct check character.
    ///
    /// If no block is open, an STX requests a connection, and the DLE of the receiver opens the block; a block ends
    /// with its check character, or by a silence longer than ZVZ.
    pub fn push(&mut self, now: Instant, byte: u8) -> Option<&[u8]> {
        self.hear(now);
        if byte == STX && self.state == State::Data && self.payload.is_empty() {
            if self.answering || self.begun == now {
                // A repeated request: it was sent before the DLE to the first one could be received.
                // [TIA help "Configuration for point-to-point links"]
                self.asked_again = true;
                return None;
            }
            // Perhaps another repetition, which must not be taken for data.
            self.spoilt |= self.asked_again;
        }
        if matches!(self.state, State::Data | State::Dle) {
            self.check ^= byte;
        }
        match (self.state, byte) {
            (State::Idle | State::Asked | State::AskedOnce, STX) => {
                self.asked_again = self.state == State::Asked;
                (self.state, self.begun) = (State::Asked, now);
            }
            // Before the DLE nothing is data: the character answers a request of the receiver that has priority over
            // this one.
            (State::Asked, _) => self.state = State::AskedOnce,
            (State::Idle | State::AskedOnce, _) => {}
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

    /// The sender sends a connection request: its block follows, independent of the previous one.
    pub fn request(&mut self, now: Instant) {
        self.hear(now);
        self.begun = now;
        self.asked_again = false;
        self.open();
    }

    /// The receiver sends a DLE: if a connection was requested, the block begins [S0 L1650-L1660].
    pub fn accepts(&mut self) {
        if matches!(self.state, State::Asked | State::AskedOnce) {
            self.open();
        }
    }

    fn open(&mut self) {
        self.state = State::Data;
        self.payload.clear();
        (self.check, self.spoilt) = (0, false);
    }

    /// A character error: an open block cannot become valid.
    pub fn spoil(&mut self, now: Instant) {
        self.hear(now);
        self.spoilt = true;
        if self.state == State::Check {
            // Instead of the check character: the block has ended.
            self.state = State::Idle;
        }
    }

    /// The receiver starts to send something, or has sent all of it.
    pub fn answers(&mut self, is_leaving: bool) {
        self.answering = is_leaving;
    }

    /// The receiver refuses: no block is open any more, and only a request is valid next.
    pub fn refuses(&mut self) {
        self.state = if self.state == State::Asked { State::AskedOnce } else { State::Idle };
    }

    fn hear(&mut self, now: Instant) {
        if now.since(self.last) > ZVZ {
            self.state = State::Idle;
        }
        self.last = now;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ZVZ: u64 = super::ZVZ.nanos();

    const fn ns(nanos: u64) -> Instant {
        Instant::from_nanos(nanos)
    }

    /// The valid blocks of a line whose receiver sends DLE after the first character of each block.
    fn good(blocks: &[&[u8]]) -> Vec<Vec<u8>> {
        let mut tap = Tap::default();
        blocks.iter().zip(1..).flat_map(|(block, at)| block_at(&mut tap, 1_000 * at, block)).collect()
    }

    fn block_at(tap: &mut Tap, at: u64, block: &[u8]) -> Vec<Vec<u8>> {
        let mut good = Vec::new();
        for (now, byte) in (at..).zip(block) {
            good.extend(tap.push(ns(now), *byte).map(<[u8]>::to_vec));
            if now == at {
                tap.accepts();
            }
        }
        good
    }

    #[test]
    fn check_values_of_the_reference() {
        // Reference 5.1.
        assert_eq!(good(&[b"\x02\x31\x10\x03\x22"]), [b"\x31"]);
        assert_eq!(good(&[b"\x02\x10\x10\x10\x03\x13"]), [b"\x10"]);
        assert_eq!(good(&[b"\x02\x02\x10\x10\x03\x15\x10\x03\x07"]), [b"\x02\x10\x03\x15"]);
    }

    #[test]
    fn a_wrong_check_character_is_not_good() {
        assert!(good(&[b"\x02\x31\x10\x03\x23"]).is_empty());
        assert_eq!(good(&[b"\x02\x31\x10\x03\x23", b"\x02\x41\x42\x43\x10\x03\x53"]), [b"ABC"]);
    }

    #[test]
    fn silence_and_unreadable_characters_end_what_is_open() {
        let block: &[u8] = b"\x02\x31\x10\x03\x22";
        let mut tap = Tap::default();
        assert!(block_at(&mut tap, 0, b"\x02\x31").is_empty());
        assert_eq!(block_at(&mut tap, 2 * ZVZ, block), [b"\x31"]);
        assert!(block_at(&mut tap, 2 * ZVZ + 9, b"\x02\x31").is_empty());
        tap.spoil(ns(2 * 2 * ZVZ + 90));
        assert!([0x10, 0x03, 0x22].into_iter().all(|byte| tap.push(ns(2 * 2 * ZVZ + 91), byte).is_none()));
        assert!(block_at(&mut tap, 2 * 2 * 2 * ZVZ + 900, b"\x02\x31\x10\x03").is_empty());
        tap.spoil(ns(2 * 2 * 2 * ZVZ + 910));
        assert_eq!(
            block_at(&mut tap, 2 * 2 * 2 * 2 * ZVZ + 9000, block),
            [b"\x31"],
            "after one whose check character could not be read"
        );
    }

    /// A restarted driver refuses the rest of a block of its predecessor with a NAK for each character, and the sender
    /// repeats its request for each of them. Two of these requests, taken as data, do not change the check character.
    #[test]
    fn a_block_that_was_refused_is_over() {
        let mut tap = Tap::default();
        assert!(block_at(&mut tap, 1, &[STX, 0x31, 0x32]).is_empty());
        tap.refuses();
        assert!(tap.push(ns(2), STX).is_none());
        tap.accepts();
        let mut good = Vec::new();
        for (at, byte) in (3..).zip(*b"\x02\x02\x31\x10\x03\x22") {
            good.extend(tap.push(ns(at), byte).map(<[u8]>::to_vec));
        }
        assert_eq!(good, [b"\x02\x02\x31"]);
    }

    /// Both send a request at the same time, and the receiver has the higher priority: the sender withdraws and sends
    /// DLE. This DLE belongs to the receiver's block, so it is not data, and neither are the sender's answers to that
    /// block.
    #[test]
    fn what_comes_before_the_receivers_answer_is_no_data() {
        let mut tap = Tap::default();
        assert!([STX, DLE, DLE].into_iter().all(|byte| tap.push(ns(1), byte).is_none()));
        assert_eq!(block_at(&mut tap, 2, b"\x02\x31\x10\x03\x22"), [b"\x31"]);
        // In the middle of a block an answer changes nothing.
        assert!(block_at(&mut tap, 3, b"\x02\x31").is_empty());
        tap.accepts();
        assert!([0x10, 0x03].into_iter().all(|byte| tap.push(ns(4), byte).is_none()));
        assert!(tap.push(ns(4), 0x22).is_some());
    }

    #[test]
    fn a_request_that_is_repeated_before_the_answer_is_no_data() {
        let mut tap = Tap::default();
        // Together, and while the answer is being sent.
        assert!(tap.push(ns(1), STX).is_none() && tap.push(ns(1), STX).is_none());
        tap.accepts();
        tap.answers(true);
        assert!(tap.push(ns(2), STX).is_none());
        tap.answers(false);
        let good = |tap: &mut Tap, at: u64, bytes: &[u8]| {
            bytes.iter().filter(|byte| tap.push(ns(at), **byte).is_some()).count()
        };
        assert_eq!(good(&mut tap, 3, b"\x31\x10\x03\x22"), 1);
        // The same, and two more of them after the answer: they do not change the check character.
        assert_eq!(good(&mut tap, 4, b"\x02\x02"), 0);
        tap.accepts();
        assert_eq!(good(&mut tap, 5, b"\x02\x02\x31\x10\x03\x22"), 0);
        // After a single request they are data.
        assert_eq!(good(&mut tap, 6, b"\x02"), 0);
        tap.accepts();
        assert_eq!(good(&mut tap, 7, b"\x02\x02\x31\x10\x03\x22"), 1);
    }
}
