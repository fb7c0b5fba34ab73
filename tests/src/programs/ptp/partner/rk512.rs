//! A partner with RK 512, on top of [`super::procedure`]. [S0 L1669-L1800]
//! [TIA help "Configuration for point-to-point links"]

use std::collections::VecDeque;

use ob1_time::Instant;

use super::procedure::{Procedure, Told};
use super::{Event, Moods};

/// Bytes of user data in one telegram. [TIA help "Configuration for point-to-point links"]
const PORTION: usize = 128;

/// A SEND of the CP under way: its header and data.
#[derive(Debug)]
struct Taking {
    header: [u8; 10],
    data: Vec<u8>,
    bytes: usize,
    /// All answers went out good.
    answered: bool,
    /// The answer to the last block did not go out good: it may come again.
    unsure: bool,
}

/// A FETCH of the CP under way: what is still to be answered.
#[derive(Debug)]
struct Giving {
    letters: [u8; 2],
    rest: Vec<u8>,
}

/// An own SEND: data block of the CPU and data.
#[derive(Debug)]
struct Order {
    db: u8,
    data: Vec<u8>,
    sent: usize,
    asked: Option<Instant>,
}

/// The partner.
#[derive(Debug)]
pub struct Rk512 {
    procedure: Procedure,
    taking: Option<Taking>,
    giving: Option<Giving>,
    orders: VecDeque<Order>,
    /// Data block of the CPU that its SENDs name.
    pub target: u8,
}

/// What the partner gives for a FETCH of byte `at` of data block `db`.
#[must_use]
pub fn memory(db: u8, at: usize) -> u8 {
    0x20 + ((at * 5 + usize::from(db)) & 0x3F) as u8
}

impl Rk512 {
    /// A partner at rest.
    #[must_use]
    pub fn new(procedure: Procedure, target: u8) -> Self {
        Self { procedure, taking: None, giving: None, orders: VecDeque::new(), target }
    }

    /// An own SEND of these data.
    pub fn order(&mut self, _number: u32, mut data: Vec<u8>) {
        if data.len() % 2 == 1 {
            data.push(0x20);
        }
        self.orders.push_back(Order { db: self.target, data, sent: 0, asked: None });
    }

    /// As [`super::Device::hear`].
    pub fn hear(
        &mut self,
        now: Instant,
        bytes: &[u8],
        moods: &Moods,
        out: &mut Vec<u8>,
        events: &mut Vec<Event>,
    ) -> Instant {
        let mut told = Vec::new();
        let mut next = self.procedure.hear(now, bytes, moods, out, &mut told);
        loop {
            for told in told.drain(..) {
                match told {
                    Told::Block(block, answered) => self.block(now, &block, answered, events),
                    // The own response did not arrive: the CP will not believe it.
                    Told::Unanswered(block) if block.get(2) == Some(&0) => self.doubt(),
                    // A CP that has the response goes on with the next block, and the data repeat themselves.
                    Told::Acknowledged(block) if block.get(2) == Some(&0) => {
                        self.taking.iter_mut().for_each(|taking| taking.unsure = false);
                    }
                    Told::GivenUp => events.push(Event::GivesUp(now)),
                    Told::Offered(_) | Told::Acknowledged(_) | Told::Unanswered(_) => {}
                }
            }
            let wanted = self.orders.front().filter(|order| order.asked.is_none());
            if wanted.is_none() || self.procedure.waiting() > 0 {
                break;
            }
            self.ask(now, events);
            next = next.min(self.procedure.hear(now, &[], moods, out, &mut told));
        }
        if self.procedure.waiting() > 0 {
            next = next.min(self.procedure.hear(now, &[], moods, out, &mut told));
        }
        next
    }

    fn doubt(&mut self) {
        if let Some(taking) = &mut self.taking {
            taking.answered = false;
        }
    }

    fn block(&mut self, now: Instant, block: &[u8], answered: bool, events: &mut Vec<Event>) {
        match block {
            [0 | 0xFF, 0, 0, code] => self.response(*code, events),
            // A response that has lost a 00h, which 3964R does not see. It is no order, and only orders are answered
            // [S0 L1686-L1711]: an error number would be taken for the response to what the CP has sent behind it.
            [] | [_] | [_, _] | [_, _, _] => {}
            [0, 0, b'A' | b'O', letter, ..] if block.len() >= 10 => {
                let mut header = [0; 10];
                header.copy_from_slice(&block[..10]);
                let words = usize::from(u16::from_be_bytes([block[6], block[7]]));
                let _ = letter;
                let (data, bytes) = (block[10..].to_vec(), 2 * words);
                // 3964R does not see that a 00h was lost. If its answer was spoilt too, the CP repeats
                // the block, and nothing would tell a refusal of the first from that of the second. [S0 L1686-L1711]
                if data.len() != bytes.min(PORTION) {
                    self.taking = None;
                    if answered {
                        self.procedure.send(vec![0, 0, 0, 0x34]);
                    }
                    return;
                }
                self.taking = Some(Taking { header, data, bytes, answered, unsure: !answered });
                self.took(now, 0, events);
            }
            [0xFF, 0, b'A' | b'O', _, data @ ..] if self.taking.is_some() => {
                let Some(taking) = &mut self.taking else { return };
                // The CP repeats a block whose answer did not come.
                let again = taking.unsure && taking.data.ends_with(data);
                if !again && data.len() != (taking.bytes - taking.data.len()).min(PORTION) {
                    self.taking = None;
                    self.procedure.send(vec![0xFF, 0, 0, 0x34]);
                    return;
                }
                if !again {
                    taking.data.extend(data);
                }
                taking.answered &= answered;
                taking.unsure = !answered;
                if again && self.procedure.waiting() > 0 {
                    return;
                }
                self.took(now, 0xFF, events);
            }
            [0, 0, b'E', letter, db, dw, high, low, ..] if block.len() == 10 => {
                let count = usize::from(u16::from_be_bytes([*high, *low]));
                let bytes = if matches!(letter, b'M' | b'E' | b'A') { count } else { 2 * count };
                let from = if matches!(letter, b'M' | b'E' | b'A') { usize::from(*dw) } else { 2 * usize::from(*dw) };
                let rest = (from..from + bytes).map(|at| memory(*db, at)).collect();
                self.giving = Some(Giving { letters: [b'E', *letter], rest });
                self.give(0);
            }
            [0xFF, 0, b'E', ..] if self.giving.is_some() => self.give(0xFF),
            // Out of order.
            _ => self.procedure.send(vec![0, 0, 0, 0x36]),
        }
    }

    fn took(&mut self, now: Instant, first: u8, events: &mut Vec<Event>) {
        self.procedure.send(vec![first, 0, 0, 0]);
        let Some(taking) = self.taking.take_if(|taking| taking.data.len() >= taking.bytes) else { return };
        let mut telegram = taking.header[2..6].to_vec();
        telegram.extend(&taking.data);
        events.push(Event::Got { at: now, telegram, answered: taking.answered });
    }

    fn give(&mut self, first: u8) {
        let Some(giving) = &mut self.giving else { return };
        let _ = giving.letters;
        let now: Vec<u8> = giving.rest.drain(..giving.rest.len().min(PORTION)).collect();
        let mut block = vec![first, 0, 0, 0];
        block.extend(now);
        if giving.rest.is_empty() {
            self.giving = None;
        }
        self.procedure.send(block);
    }

    fn ask(&mut self, now: Instant, events: &mut Vec<Event>) {
        let Some(order) = self.orders.front_mut() else { return };
        let [high, low] = ((order.data.len() / 2) as u16).to_be_bytes();
        let mut block = match order.sent {
            0 => vec![0, 0, b'A', b'D', order.db, 0, high, low, 0xFF, 0xFF],
            _ => vec![0xFF, 0, b'A', b'D'],
        };
        if order.sent == 0 {
            events.push(Event::Said { at: now, telegram: order.data.clone(), owed: false });
        }
        let portion = &order.data[order.sent..order.data.len().min(order.sent + PORTION)];
        block.extend(portion);
        order.sent += portion.len();
        order.asked = Some(now);
        self.procedure.send(block);
    }

    fn response(&mut self, code: u8, events: &mut Vec<Event>) {
        let Some(order) = self.orders.front_mut().filter(|order| order.asked.is_some()) else { return };
        // The response shows that the block has arrived: only its acknowledgement was lost.
        self.procedure.forget(|block| matches!(block, [_, 0, b'A', ..]));
        if code == 0 && order.sent < order.data.len() {
            order.asked = None;
            return;
        }
        let telegram = std::mem::take(&mut order.data);
        self.orders.pop_front();
        if code == 0 {
            events.push(Event::Owed { telegram });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::programs::ptp::partner::procedure::Settings;
    use ob1_time::Span;

    fn wire(block: &[u8]) -> Vec<u8> {
        let mut out: Vec<u8> =
            block.iter().flat_map(|b| std::iter::repeat_n(*b, if *b == 0x10 { 2 } else { 1 })).collect();
        out.extend([0x10, 3]);
        out.push(out.iter().fold(0, |check, byte| check ^ byte));
        out
    }

    #[test]
    fn a_send_is_taken_and_answered() {
        let ms = Span::from_millis;
        let settings = Settings { qvz: ms(100), zvz: ms(100), is_high: false, attempts: 2 };
        let mut partner = Rk512::new(Procedure::new(settings, 1), 9);
        let (mut out, mut events) = (Vec::new(), Vec::new());
        let at = |n| Instant::START + ms(n);
        partner.hear(at(1), &[2], &Moods::GOOD, &mut out, &mut events);
        let send = [0, 0, 0x41, 0x44, 5, 1, 0, 1, 0xFF, 0xFF, 7, 8];
        let next = partner.hear(at(2), &wire(&send), &Moods::GOOD, &mut out, &mut events);
        let telegram = vec![0x41, 0x44, 5, 1, 7, 8];
        assert_eq!(events, [Event::Got { at: at(2), telegram, answered: true }]);
        out.clear();
        partner.hear(next.max(at(40)), &[], &Moods::GOOD, &mut out, &mut events);
        assert_eq!(out, [2]);
        partner.hear(at(50), &[0x10], &Moods::GOOD, &mut out, &mut events);
        // The response of the reference, 4.9.
        assert_eq!(out[1..], [0, 0, 0, 0, 0x10, 3, 0x13]);
    }

    #[test]
    fn what_is_too_short_for_an_order_is_not_answered() {
        let ms = Span::from_millis;
        let settings = Settings { qvz: ms(100), zvz: ms(100), is_high: false, attempts: 2 };
        for (block, answers) in [(&[0, 0, 0][..], false), (&[0, 0, 0x42, 0x44], true)] {
            let mut partner = Rk512::new(Procedure::new(settings, 1), 9);
            let (mut out, mut events) = (Vec::new(), Vec::new());
            let at = |n| Instant::START + ms(n);
            partner.hear(at(1), &[2], &Moods::GOOD, &mut out, &mut events);
            partner.hear(at(2), &wire(block), &Moods::GOOD, &mut out, &mut events);
            partner.hear(at(40), &[], &Moods::GOOD, &mut out, &mut events);
            assert_eq!(out.last() == Some(&2), answers);
        }
    }
}
