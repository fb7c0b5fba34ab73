//! A test coupler: tables, a list of all requests, and its possible misbehaviour.

use ob1_coupler::config::Instant;
use std::collections::{BTreeMap, BTreeSet};

/// A coupler on a connection.
pub(crate) struct Device {
    pub(crate) unit: u8,
    pub(crate) holding: BTreeMap<u16, u16>,
    pub(crate) input: BTreeMap<u16, u16>,
    pub(crate) coils: BTreeSet<u16>,
    pub(crate) discrete: BTreeSet<u16>,
    /// It supports function 17h.
    pub(crate) knows_both: bool,
    /// It does not answer function 17h.
    pub(crate) ignores_both: bool,
    /// Requests that begin at one of these are refused.
    pub(crate) refused: Vec<u16>,
    /// The exception of these refusals.
    pub(crate) exception: u8,
    /// It does not answer, and does nothing.
    pub(crate) silent: bool,
    /// Its watchdog has expired: it answers everything with a device failure until that is cleared, as a WAGO 750 does.
    pub(crate) expired: bool,
    pub(crate) log: Vec<(Instant, Vec<u8>)>,
}

impl Device {
    pub(crate) fn new(unit: u8) -> Self {
        Self {
            unit,
            holding: BTreeMap::new(),
            input: BTreeMap::new(),
            coils: BTreeSet::new(),
            discrete: BTreeSet::new(),
            knows_both: true,
            ignores_both: false,
            refused: Vec::new(),
            exception: 2,
            silent: false,
            expired: false,
            log: Vec::new(),
        }
    }

    /// Answers a request: unit, function, data.
    pub(crate) fn answer(&mut self, now: Instant, request: &[u8]) -> Option<Vec<u8>> {
        self.log.push((now, request.to_vec()));
        if self.silent {
            return None;
        }
        let word = |at: usize| u16::from_be_bytes([request[at], request[at + 1]]);
        let (first, value, code) = (word(2), word(4), request[1]);
        let exception = |number: u8| Some(vec![request[0], code | 0x80, number]);
        self.expired &= (code, first, value) != (6, 0x1008, 0x55AA);
        if self.expired {
            return exception(4);
        }
        if self.refused.contains(&first) {
            return exception(self.exception);
        }
        let mut answer = vec![request[0], code];
        match code {
            1 | 2 => {
                let bits = if code == 1 { &self.coils } else { &self.discrete };
                let mut bytes = vec![0_u8; usize::from(value).div_ceil(8)];
                for n in 0..value {
                    bytes[usize::from(n / 8)] |= u8::from(bits.contains(&(first + n))) << (n % 8);
                }
                answer.push(bytes.len() as u8);
                answer.extend(bytes);
            }
            3 | 4 => self.words(code == 3, first, value, &mut answer),
            5 => {
                self.coil(first, value == 0xFF00);
                answer.extend(&request[2..6]);
            }
            6 => {
                self.holding.insert(first, value);
                answer.extend(&request[2..6]);
            }
            0x0F => {
                for n in 0..value {
                    self.coil(first + n, request[7 + usize::from(n / 8)] >> (n % 8) & 1 == 1);
                }
                answer.extend(&request[2..6]);
            }
            0x10 => {
                self.holding.extend((0..value).map(|n| (first + n, word(7 + 2 * usize::from(n)))));
                answer.extend(&request[2..6]);
            }
            0x17 if self.ignores_both => return None,
            0x17 if self.knows_both => {
                let (to, count) = (word(6), word(8));
                self.holding.extend((0..count).map(|n| (to + n, word(11 + 2 * usize::from(n)))));
                self.words(true, first, value, &mut answer);
            }
            _ => return exception(1),
        }
        Some(answer)
    }

    fn words(&self, holding: bool, first: u16, count: u16, answer: &mut Vec<u8>) {
        let table = if holding { &self.holding } else { &self.input };
        answer.push((2 * count) as u8);
        for n in 0..count {
            answer.extend(table.get(&(first + n)).copied().unwrap_or(0).to_be_bytes());
        }
    }

    fn coil(&mut self, at: u16, on: bool) {
        if on {
            self.coils.insert(at);
        } else {
            self.coils.remove(&at);
        }
    }
}
