//! A partner that speaks RK 512 over the procedure, written from the manual [S0 L1686].

use ob1_time::{Instant, Span};

use crate::compare::random::Random;
use crate::sim::device::Device;

use super::procedure::Procedure;
use super::{Manner, Manners, Sent, Taken, telegram as telegram_of};

/// User data of a telegram at most [S0 L1713]; a first telegram has so many with its header of 10 bytes or without.
const MOST: usize = 128;

/// An order that came from the station.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Order {
    /// When its first telegram came.
    pub at: Instant,
    /// `A` (SEND) or `E` (FETCH).
    pub command: u8,
    /// Data block and first word in the partner.
    pub target: (u8, u8),
    /// Words.
    pub words: usize,
    /// SEND: the data that came. FETCH: those that it gives, with the number of the order.
    pub data: Vec<u8>,
    /// All of it was answered without an error number.
    pub done: Option<Instant>,
    /// It was answered with an error number.
    pub refused: Option<u8>,
    /// A reaction was late, wrong, doubled or not given: the station may see the order otherwise, or give it again.
    pub unclear: bool,
    /// Place of its last reaction in what the procedure sends.
    pub reaction: usize,
}

/// An order of the partner to the station.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Request {
    /// Its telegram.
    pub telegram: Vec<u8>,
    /// When it was put into the queue of the procedure.
    pub given: Instant,
    /// Its place in what the procedure sends.
    pub place: usize,
    /// The reaction that came: error number and data, and when.
    pub reaction: Option<(u8, Vec<u8>, Instant)>,
}

/// The partner.
#[derive(Debug)]
pub struct Rk512 {
    /// The procedure below.
    pub line: Procedure,
    /// Manners of its reactions.
    pub manners: Manners,
    /// The station waits so long for a reaction.
    pub bwz: Span,
    /// Orders of the station.
    pub orders: Vec<Order>,
    /// Its own orders.
    pub requests: Vec<Request>,
    random: Random,
    seen: usize,
    reactions: Vec<(Instant, Vec<u8>)>,
    /// FETCH: data that are still to be sent.
    rest: Vec<u8>,
    /// It has sent a request and waits for the reaction.
    waits: bool,
    pending: Vec<Vec<u8>>,
    give_up: Instant,
}

impl Rk512 {
    /// A partner.
    #[must_use]
    pub fn new(line: Procedure, manners: Manners, bwz: Span, random: Random) -> Self {
        Self {
            line,
            manners,
            bwz,
            orders: Vec::new(),
            requests: Vec::new(),
            random,
            seen: 0,
            reactions: Vec::new(),
            rest: Vec::new(),
            waits: false,
            pending: Vec::new(),
            give_up: Instant::NEVER,
        }
    }

    /// It does what it should, on the line and above it.
    #[must_use]
    pub fn is_good(&self) -> bool {
        self.line.manners == Manners::GOOD && self.manners == Manners::GOOD
    }

    /// It has sent a telegram that is too short for one, and the station has acknowledged it in this time.
    #[must_use]
    pub fn has_garbled(&self, from: Instant, to: Instant) -> bool {
        let short = |sent: &Sent| sent.data.len() < 4 && sent.acknowledged.is_some_and(|at| from <= at && at <= to);
        self.line.sent.iter().any(short)
    }

    /// Gives an order to the station, after those that wait.
    pub fn request(&mut self, telegram: Vec<u8>) {
        self.pending.push(telegram);
    }

    fn react(&mut self, now: Instant, reaction: Vec<u8>) {
        let manner = self.manners.next(&mut self.random);
        let order = self.orders.last_mut();
        let refuses = if let Some(order) = order {
            order.unclear |= manner != Manner::Good;
            if manner == Manner::Refuses {
                order.refused = Some(0x10);
                order.done = None;
            }
            reaction[0]
        } else {
            0
        };
        match manner {
            Manner::Good => self.reactions.push((now, reaction)),
            Manner::Twice => self.reactions.extend([(now, reaction.clone()), (now, reaction)]),
            Manner::Late => {
                let delay = self.bwz * (50 + self.random.below(120) as u64) / 100;
                self.reactions.push((now + delay, reaction));
            }
            Manner::Silent => {}
            Manner::Refuses => self.reactions.push((now, vec![refuses, 0, 0, 0x10])),
            Manner::Wrong => self.reactions.push((now, vec![reaction[0], 0, 7])),
        }
    }

    fn order(&mut self, now: Instant, telegram: &[u8], told: bool) {
        let [_, _, command, _, db, word, high, low, _, _, data @ ..] = telegram else { return };
        let words = usize::from(u16::from_be_bytes([*high, *low]));
        // "BWZ is the max. time between acknowledgement of a request telegram (DLE) and STX of the answer telegram"
        // [S0 L1635]: a good partner does not send an answer any more that a new order has overtaken.
        if self.is_good()
            && let Some(order) = self.orders.last()
        {
            self.line.withdraw(order.reaction);
        }
        self.orders.push(Order {
            at: now,
            command: *command,
            target: (*db, *word),
            words,
            data: if *command == b'A' { data.to_vec() } else { Vec::new() },
            done: None,
            refused: None,
            unclear: !told,
            reaction: usize::MAX,
        });
        if *command == b'A' {
            self.stored(now, 0);
        } else {
            self.rest = telegram_of(self.orders.len() as u32, 2 * words, false);
            if let Some(order) = self.orders.last_mut() {
                order.data = self.rest.clone();
            }
            self.fetched(now, 0);
        }
    }

    /// Data of a SEND are here.
    fn stored(&mut self, now: Instant, flag: u8) {
        if let Some(order) = self.orders.last_mut() {
            if order.data.len() >= 2 * order.words {
                order.done = Some(now);
            }
            self.react(now, vec![flag, 0, 0, 0]);
        }
    }

    /// The next data of a FETCH.
    fn fetched(&mut self, now: Instant, flag: u8) {
        let part: Vec<u8> = self.rest.drain(..self.rest.len().min(MOST)).collect();
        if self.rest.is_empty()
            && let Some(order) = self.orders.last_mut()
        {
            order.done = Some(now);
        }
        self.react(now, [&[flag, 0, 0, 0][..], &part].concat());
    }

    fn telegram(&mut self, now: Instant, telegram: &[u8], told: bool) {
        if let Some(order) = self.orders.last_mut() {
            order.unclear |= !told;
        }
        match telegram {
            [0, 0, 0, error, data @ ..] => {
                // What the station refuses before it has the order is something else that it was sent. Nor does FFh
                // answer it: that is for a next message [S0 L1728], and its orders have none.
                let has = |place: usize| self.line.sent.get(place).is_some_and(|sent| sent.acknowledged.is_some());
                if let Some(request) = self.requests.last_mut()
                    && request.reaction.is_none()
                    && has(request.place)
                {
                    request.reaction = Some((*error, data.to_vec(), now));
                    self.waits = false;
                }
            }
            [0, 0, b'A' | b'E', ..] => self.order(now, telegram, told),
            [0xFF, 0, b'A', _, data @ ..] => {
                if let Some(order) = self.orders.last_mut().filter(|order| order.command == b'A') {
                    order.data.extend(data);
                    self.stored(now, 0xFF);
                }
            }
            [0xFF, 0, b'E', ..] => self.fetched(now, 0xFF),
            _ => {}
        }
    }
}

impl Device for Rk512 {
    fn hear(&mut self, now: Instant, bytes: &[u8], out: &mut Vec<u8>) -> Option<Instant> {
        let line = self.line.hear(now, bytes, out);
        while self.seen < self.line.took.len() {
            let Taken { data, told, .. } = self.line.took[self.seen].clone();
            self.seen += 1;
            self.telegram(now, &data, told);
        }
        let (due, later): (Vec<_>, Vec<_>) = self.reactions.drain(..).partition(|(at, _)| *at <= now);
        self.reactions = later;
        let mut again = false;
        for (_, reaction) in due {
            if let Some(order) = self.orders.last_mut() {
                order.reaction = self.line.sent.len();
            }
            self.line.send(reaction);
            again = true;
        }
        if self.waits && self.give_up <= now {
            self.waits = false;
        }
        if !self.waits && !self.pending.is_empty() {
            let telegram = self.pending.remove(0);
            let place = self.line.sent.len();
            self.line.send(telegram.clone());
            self.requests.push(Request { telegram, given: now, place, reaction: None });
            self.waits = true;
            self.give_up = now + Span::from_secs(6);
            again = true;
        }
        let line = if again { self.line.hear(now, &[], out) } else { line };
        let wait = self.waits.then_some(self.give_up);
        let reactions = self.reactions.iter().map(|(at, _)| *at).min();
        [line, wait, reactions].into_iter().flatten().min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::programs::partner::Pace;
    use crate::sim::MS;

    /// A RESET of the station: its first order is forgotten, and nobody answers the STX of the reaction to it.
    fn overtaken(manners: Manners) -> Vec<u8> {
        let pace = Pace { char: MS / 10, qvz: 40 * MS, zvz: 20 * MS };
        let line = Procedure::new(true, false, Manners::GOOD, pace, Random::new(1));
        let mut rk = Rk512::new(line, manners, 100 * MS, Random::new(1));
        let mut now = Instant::START + MS;
        let mut out = Vec::new();
        for number in [1, 2] {
            let order = [&[0, 0, b'A', b'D', 21, 0, 0, 2, 0xFF, 0xFF][..], &telegram_of(number, 4, false)].concat();
            let block = rk.line.block(&order);
            for bytes in [&[0x02][..], &block] {
                rk.hear(now, bytes, &mut out);
                now += 5 * MS;
                rk.hear(now, &[], &mut out);
            }
            now += 20 * MS;
            rk.hear(now, &[], &mut out);
        }
        assert_eq!(rk.orders.len(), 2, "{out:?}");
        (0..40).for_each(|_| {
            now += 5 * MS;
            rk.hear(now, &[], &mut out);
            if out.last() == Some(&0x02) {
                rk.hear(now, &[0x10], &mut out);
            } else if out.ends_with(&[0x10, 0x03, 0x13]) {
                rk.hear(now, &[0x10], &mut out);
                out.push(0);
            }
        });
        rk.line.sent.iter().map(|sent| u8::from(sent.acknowledged.is_some())).collect()
    }

    /// The station refuses a telegram that is too short with 34h. That is no answer to an order which it does not have,
    /// and FFh never is one.
    #[test]
    fn a_reaction_answers_an_order_that_is_there() {
        let pace = Pace { char: MS / 10, qvz: 40 * MS, zvz: 20 * MS };
        let line = Procedure::new(true, false, Manners::GOOD, pace, Random::new(1));
        let mut rk = Rk512::new(line, Manners::GOOD, 100 * MS, Random::new(1));
        let now = Instant::START + MS;
        rk.request(vec![0, 0, b'E', b'D', 63, 0, 0, 2, 0xFF, 0xFF]);
        rk.hear(now, &[], &mut Vec::new());
        let mut is_answered = |acknowledged, reaction: &[u8]| {
            rk.line.sent[0].acknowledged = acknowledged;
            rk.telegram(now, reaction, true);
            rk.requests[0].reaction.is_some()
        };
        assert!(!is_answered(None, &[0, 0, 0, 0x34]));
        assert!(!is_answered(Some(now), &[0xFF, 0, 0, 0x34]));
        assert!(is_answered(Some(now), &[0, 0, 0, 0x34]));
    }

    #[test]
    fn a_good_partner_forgets_a_reaction_that_is_overtaken() {
        assert_eq!(overtaken(Manners::GOOD), [0, 1]);
        // The draw of these manners is never used: only that they are not those of a good partner.
        assert_eq!(overtaken(Manners { late: 0, silent: 0, refuses: 0, wrong: 0, twice: 1 })[0], 1);
    }
}
