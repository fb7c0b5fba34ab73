//! A partner with the procedure 3964 or 3964R, written from the manual [S0 "3964(R)"].

use std::collections::VecDeque;

use ob1_time::{Instant, Span};

use crate::compare::random::Random;
use crate::sim::MS;
use crate::sim::device::Device;

use super::{Manner, Manners, Output, Pace, Sent, Taken};

const STX: u8 = 0x02;
const ETX: u8 = 0x03;
const DLE: u8 = 0x10;
const NAK: u8 = 0x15;
/// Something that is no control character, and none of them with one bit changed.
const NOISE: u8 = 0x6D;
/// Attempts to send a telegram.
const ATTEMPTS: u32 = 6;
/// It does not answer at once: as a device, which needs its time.
const TURN: Span = Span::from_micros(300);

#[derive(Clone, Debug, PartialEq, Eq)]
enum State {
    Idle,
    /// Characters of a telegram come; the bytes since DLE was sent.
    Receives(Vec<u8>),
    /// STX is out.
    Called,
    /// The telegram is out.
    Awaits,
}

/// The partner.
#[derive(Debug)]
pub struct Procedure {
    /// 3964R: with a block check character.
    pub checked: bool,
    /// It has the high priority.
    pub high: bool,
    /// Manners.
    pub manners: Manners,
    /// What it has taken.
    pub took: Vec<Taken>,
    /// What it sends, or has sent.
    pub sent: Vec<Sent>,
    /// When it has taken a character for STX, and agreed.
    pub agreed: Vec<Instant>,
    /// When it has given up a telegram last: its NAK may cross an STX.
    pub gave_up: Option<Instant>,
    pace: Pace,
    random: Random,
    state: State,
    until: Instant,
    output: Output,
    queue: VecDeque<usize>,
    tries: u32,
    /// The end of its own block on the line.
    block_out: Instant,
    /// No attempt to send before this time.
    quiet: Instant,
}

impl Procedure {
    /// A partner.
    #[must_use]
    pub fn new(checked: bool, high: bool, manners: Manners, pace: Pace, random: Random) -> Self {
        Self {
            checked,
            high,
            manners,
            took: Vec::new(),
            sent: Vec::new(),
            agreed: Vec::new(),
            gave_up: None,
            pace,
            random,
            state: State::Idle,
            until: Instant::NEVER,
            output: Output::default(),
            queue: VecDeque::new(),
            tries: 0,
            block_out: Instant::START,
            quiet: Instant::START,
        }
    }

    /// Sends a telegram as soon as the line is free.
    pub fn send(&mut self, data: Vec<u8>) {
        self.queue.push_back(self.sent.len());
        self.sent.push(Sent { data, begun: Instant::NEVER, acknowledged: None, attempts: 0 });
    }

    /// A telegram is not sent, if it is still to be sent: `index` in [`Procedure::sent`].
    pub fn withdraw(&mut self, index: usize) {
        if self.queue.front() == Some(&index) {
            self.tries = 0;
        }
        self.queue.retain(|waits| *waits != index);
    }

    /// A telegram as it stands on the line.
    #[must_use]
    pub fn block(&self, data: &[u8]) -> Vec<u8> {
        let mut block = Vec::with_capacity(data.len() + 3);
        for byte in data {
            // "The driver duplicates any DLE-character that is contained in a message" [S0 L1653].
            block.extend(std::iter::repeat_n(*byte, 1 + usize::from(*byte == DLE)));
        }
        block.extend([DLE, ETX]);
        if self.checked {
            // "XOR function over the entire data of the message, including the DLE/ETX" [S0 L1643].
            block.push(block.iter().fold(0, |sum, byte| sum ^ byte));
        }
        block
    }

    /// The telegram in these characters, once it is complete; false: its check is wrong.
    fn complete(&self, heard: &[u8]) -> Option<Result<Vec<u8>, ()>> {
        let mut data = Vec::new();
        let mut at = 0;
        while at < heard.len() {
            match (heard[at], heard.get(at + 1)) {
                (DLE, None) => return None,
                (DLE, Some(&DLE)) => {
                    data.push(DLE);
                    at += 2;
                }
                (DLE, Some(&ETX)) if self.checked => {
                    let check = heard.get(at + 2)?;
                    let sum = heard[..at + 2].iter().fold(0, |sum, byte| sum ^ byte);
                    return Some(if sum == *check { Ok(data) } else { Err(()) });
                }
                (DLE, Some(&ETX)) => return Some(Ok(data)),
                (DLE, Some(_)) => return Some(Err(())),
                (byte, _) => {
                    data.push(byte);
                    at += 1;
                }
            }
        }
        None
    }

    /// Answers DLE, in its manner; true if it is in time, None if something else goes out. A DLE that was still to
    /// be sent is void.
    fn agree(&mut self, now: Instant) -> Option<bool> {
        self.output.drop_all(&[DLE]);
        let manner = self.manners.next(&mut self.random);
        match manner {
            Manner::Good => self.output.push(now + TURN, vec![DLE]),
            Manner::Twice => self.output.push(now + TURN, vec![DLE, DLE]),
            Manner::Late => {
                let delay = self.pace.qvz / 2 + self.pace.qvz * self.random.below(150) as u64 / 100;
                self.output.push(now + delay, vec![DLE]);
                return Some(delay < self.pace.qvz * 8 / 10);
            }
            Manner::Silent => return None,
            Manner::Refuses => {
                self.output.push(now + TURN, vec![NAK]);
                return None;
            }
            Manner::Wrong => {
                self.output.push(now + TURN, vec![NOISE]);
                return None;
            }
        }
        Some(manner == Manner::Good)
    }

    fn take(&mut self, now: Instant, byte: u8) {
        match &mut self.state {
            State::Idle if byte == STX => self.called(now),
            // An acknowledgement that came too late is not answered.
            State::Idle if byte == DLE || byte == NAK => {}
            // "it receives a character that is not equal to STX it will transmit a NAK" [S0 L1637].
            State::Idle if self.manners.silent < 100 => self.output.push(now + TURN, vec![NAK]),
            State::Idle => {}
            // DLE is not out yet: the other side calls again.
            State::Receives(heard) if heard.is_empty() && byte == STX && self.output.next().is_some() => {}
            State::Receives(heard) => {
                heard.push(byte);
                self.until = now + self.pace.zvz;
                let heard = std::mem::take(heard);
                match self.complete(&heard) {
                    None => self.state = State::Receives(heard),
                    Some(Err(())) => {
                        self.idle(now);
                        self.output.push(now + TURN, vec![NAK]);
                    }
                    Some(Ok(data)) => {
                        self.idle(now);
                        // What it does not acknowledge it does not take.
                        if let Some(told) = self.agree(now) {
                            self.took.push(Taken { at: now, data, told });
                        }
                    }
                }
            }
            State::Called if byte == DLE => {
                let index = self.queue[0];
                let block = self.block(&self.sent[index].data);
                self.sent[index].attempts += 1;
                self.block_out = now + TURN + self.pace.char * block.len() as u64;
                self.until = now + self.pace.char * block.len() as u64 + self.pace.qvz;
                self.output.push(now + TURN, block);
                self.state = State::Awaits;
            }
            // "the station with the lower priority will transmit the DLE and change to receive mode" [S0 L1649].
            State::Called if byte == STX && self.high => {}
            State::Called if byte == STX => self.called(now),
            State::Awaits if byte == DLE => {
                if let Some(index) = self.queue.pop_front() {
                    self.sent[index].acknowledged = Some(now);
                }
                self.tries = 0;
                self.idle(now);
            }
            State::Called | State::Awaits => self.again(now),
        }
    }

    /// STX has come: answers it.
    fn called(&mut self, now: Instant) {
        self.idle(now);
        if self.agree(now).is_some() {
            self.agreed.push(now);
            self.state = State::Receives(Vec::new());
            self.until = now + self.pace.zvz + self.pace.qvz * 2;
        }
    }

    fn idle(&mut self, now: Instant) {
        self.state = State::Idle;
        self.until = Instant::NEVER;
        self.quiet = now + 10 * MS;
    }

    /// An attempt to send has failed. What is on the line of its block leaves first: several STX behind it would come
    /// at once, as data. [S0 L1633]
    fn again(&mut self, now: Instant) {
        self.tries += 1;
        if self.tries >= ATTEMPTS {
            self.tries = 0;
            self.queue.pop_front();
            self.gave_up = Some(now);
            self.output.push(now + TURN, vec![NAK]);
        }
        self.idle(now);
        self.quiet = now.max(self.block_out) + 20 * MS;
    }

    fn clock(&mut self, now: Instant) {
        if self.until <= now {
            match self.state {
                State::Receives(_) => {
                    self.idle(now);
                    self.output.push(now, vec![NAK]);
                }
                State::Called | State::Awaits => self.again(now),
                State::Idle => {}
            }
        }
        if self.state == State::Idle
            && self.quiet <= now
            && self.output.next().is_none()
            && let Some(index) = self.queue.front()
        {
            let sent = &mut self.sent[*index];
            sent.begun = sent.begun.min(now);
            self.output.push(now, vec![STX]);
            self.state = State::Called;
            self.until = now + self.pace.qvz;
        }
    }

    /// Next deadline.
    #[must_use]
    pub fn next(&self) -> Option<Instant> {
        let free = self.state == State::Idle && self.output.next().is_none();
        let begin = (free && !self.queue.is_empty()).then_some(self.quiet);
        let until = Some(self.until).filter(|at| *at != Instant::NEVER);
        [begin, until, self.output.next()].into_iter().flatten().min()
    }
}

impl Device for Procedure {
    fn hear(&mut self, now: Instant, bytes: &[u8], out: &mut Vec<u8>) -> Option<Instant> {
        for byte in bytes {
            self.take(now, *byte);
        }
        self.clock(now);
        self.output.due(now, out);
        self.next()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A CP that was reset answers the rest of a block with NAK: STX comes when the block has left.
    #[test]
    fn it_asks_again_behind_its_own_block() {
        let pace = Pace { char: MS, qvz: 60 * MS, zvz: 40 * MS };
        let mut partner = Procedure::new(true, false, Manners::GOOD, pace, Random::new(1));
        let (mut out, start) = (Vec::new(), Instant::START + 100 * MS);
        partner.send(vec![1; 97]);
        partner.hear(start, &[], &mut out);
        partner.hear(start + MS, &[DLE], &mut out);
        partner.hear(start + 2 * MS, &[], &mut out);
        assert_eq!(out.len(), 101);
        assert_eq!(partner.hear(start + 50 * MS, &[NAK], &mut out), Some(start + MS + TURN + 120 * MS));
    }
}
