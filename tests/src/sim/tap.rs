//! A tap on the simulated line: which telegrams were sent, and which came out good by the check character alone.
//!
//! 3964R cannot catch everything: two bits flipped in the same column of a block, or a lost 00h, leave the check
//! character right. So a telegram that arrives wrong is a fault of ours only when no block with a right check
//! character came out of the line. The tap decides that with a decoder of its own, written from the manual's
//! description of the block [S0 L1650-L1660] and independent of the machines it judges.

use ob1_time::{Instant, Span};

/// A connection request.
pub const STX: u8 = 0x02;
const ETX: u8 = 0x03;
/// Ready to receive, and received.
pub const DLE: u8 = 0x10;
/// A refusal.
pub const NAK: u8 = 0x15;

/// The character delay time of the demo's stations: who is silent for longer in a block has given it up.
const ZVZ: Span = Span::from_millis(200);

/// Reads the blocks out of a stream of characters.
#[derive(Debug, Default)]
pub struct Tap {
    state: State,
    payload: Vec<u8>,
    check: u8,
    spoilt: bool,
    last: Instant,
    /// When the request came.
    begun: Instant,
    /// What the receiver has sent is still on the line, its DLE perhaps.
    answering: bool,
    /// The request has been repeated before it was answered.
    asked_again: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum State {
    #[default]
    Idle,
    /// A connection is asked for, and the receiver has not said DLE yet.
    Asked,
    /// The same, and since then a refusal has gone out, perhaps for what came before the request in the same burst, or
    /// the sender has answered a request of the receiver's own: the next STX is no repetition.
    AskedOnce,
    Data,
    Dle,
    Check,
}

impl Tap {
    /// Takes a character that was complete at `now`; answers a payload whose block has a right check character.
    ///
    /// An STX asks for a connection where no block is open, and the receiver's DLE opens it; an open one ends with its
    /// check character, or by silence longer than ZVZ.
    pub fn push(&mut self, now: Instant, byte: u8) -> Option<&[u8]> {
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
        if matches!(self.state, State::Data | State::Dle) {
            self.check ^= byte;
        }
        match (self.state, byte) {
            (State::Idle | State::Asked | State::AskedOnce, STX) => {
                self.asked_again = self.state == State::Asked;
                (self.state, self.begun) = (State::Asked, now);
            }
            // Before the DLE nothing is data: it answers a request of the receiver's own, which it puts above this one.
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

    /// The sender puts a connection request on the line: what follows is its block, whatever became of the one before.
    pub fn request(&mut self, now: Instant) {
        self.hear(now);
        self.begun = now;
        self.asked_again = false;
        self.open();
    }

    /// The receiver puts a DLE on the line: where a connection was asked for, the block begins [S0 L1650-L1660].
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

    /// A character that could not be read: what is open cannot become good.
    pub fn spoil(&mut self, now: Instant) {
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

    /// What comes good out of a line whose receiver says DLE to the first character of each block.
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

    /// A driver that was started anew refuses the rest of a block its predecessor was at, a NAK for each character;
    /// the sender asks anew for each of them. Two of these requests read as data leave the check character as it is.
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

    /// Both ask at once, and the receiver has the higher priority: the sender withdraws and says DLE. This DLE belongs
    /// to the receiver's block, so it is not data; nor is what the sender answers to it.
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
        // In one go, and while the answer leaves.
        assert!(tap.push(ns(1), STX).is_none() && tap.push(ns(1), STX).is_none());
        tap.accepts();
        tap.answers(true);
        assert!(tap.push(ns(2), STX).is_none());
        tap.answers(false);
        let good = |tap: &mut Tap, at: u64, bytes: &[u8]| {
            bytes.iter().filter(|byte| tap.push(ns(at), **byte).is_some()).count()
        };
        assert_eq!(good(&mut tap, 3, b"\x31\x10\x03\x22"), 1);
        // The same, and two more of them behind the answer: they leave the check character right.
        assert_eq!(good(&mut tap, 4, b"\x02\x02"), 0);
        tap.accepts();
        assert_eq!(good(&mut tap, 5, b"\x02\x02\x31\x10\x03\x22"), 0);
        // Asked once, they are data.
        assert_eq!(good(&mut tap, 6, b"\x02"), 0);
        tap.accepts();
        assert_eq!(good(&mut tap, 7, b"\x02\x02\x31\x10\x03\x22"), 1);
    }
}
