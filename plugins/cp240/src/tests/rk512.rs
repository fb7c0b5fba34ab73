//! FC 2, FC 3 and FC 4: the steps of an order of this CPU against a CP written from the register document, and the
//! answers to headers of the partner.

use ob1_sdk::ModuleInfo;

use crate::pafe::Pafe;
use crate::registers::{FAILED, Words};
use crate::rk512::{Evaluated, Header, Job, OWN, PARTNER, Phase, Rk512State, Step, evaluate};
use crate::turn::{GIVEN_UP, Key, Role, Take};

/// The CP's side of `TX` and `RX` with framings.
#[derive(Default)]
struct Cp {
    tx: u16,
    tx_echo: u16,
    rx_echo: u16,
    block: [u8; 12],
    collected: Vec<u8>,
    taken: Vec<Vec<u8>>,
    result: Vec<u8>,
    offered: usize,
    closing: bool,
}

impl Cp {
    fn look(&mut self) {
        if self.tx != self.tx_echo {
            let count = usize::from(self.tx & 0x7FF);
            match count {
                0 => self.taken.push(std::mem::take(&mut self.collected)),
                n => self.collected.extend_from_slice(&self.block[..n.min(12)]),
            }
            self.tx_echo = self.tx;
        }
        let rx = self.rx();
        if rx != 0 && self.rx_echo == rx {
            self.result.drain(..self.result.len().min(12));
            self.offered = self.result.len();
            self.closing = self.offered == 0;
        } else if self.rx_echo & 0x7FF == 0 && self.offered == 0 && !self.result.is_empty() {
            self.offered = self.result.len();
        }
        if self.closing && self.rx_echo & 0x7FF == 0 {
            self.closing = false;
        }
    }

    fn rx(&self) -> u16 {
        if self.offered == 0 { 0 } else { OWN | self.offered as u16 }
    }

    fn words(&self) -> Words {
        Words { rx: self.rx(), tx_echo: self.tx_echo }
    }

    fn shown(&self) -> [u8; 12] {
        let mut block = [0; 12];
        let n = self.offered.min(12);
        block[..n].copy_from_slice(&self.result[..n]);
        block
    }
}

/// Calls a block with a telegram until the order has ended; the CP acts after each call.
fn play(telegram: &[u8], result: &[u8]) -> (Cp, Vec<u8>, Result<(), u8>, Vec<Step>) {
    let (mut cp, mut got, mut log) = (Cp::default(), Vec::new(), Vec::new());
    let (mut job, mut step) = Job::start(7, telegram.len() as u16);
    for _ in 0..2000 {
        log.push(step);
        match step {
            Step::Wait | Step::Handed => {}
            Step::Post { from, len, word } => {
                cp.block[..usize::from(len)].copy_from_slice(&telegram[usize::from(from)..][..usize::from(len)]);
                cp.tx = word;
            }
            Step::Word(word) => cp.tx = word,
            Step::Drain(word) => cp.rx_echo = word,
            Step::Take { from, len, word } => {
                let block = cp.shown();
                got.extend_from_slice(&block[..usize::from(len)]);
                cp.rx_echo = word;
                job = job.taken(len, (from == 0).then_some(block[3]));
            }
            Step::Ended { outcome, echo, .. } => {
                cp.rx_echo = echo.unwrap_or(cp.rx_echo);
                return (cp, got, outcome, log);
            }
        }
        cp.look();
        if job.phase == Phase::Waiting && cp.result.is_empty() && !cp.closing {
            cp.result = result.to_vec();
        }
        if job.phase == Phase::Waiting && cp.closing {
            cp.rx_echo = 0;
        }
        (job, step) = job.go_on(cp.words(), &cp.shown());
    }
    panic!("it does not end: {log:?}");
}

fn bytes(len: usize) -> Vec<u8> {
    (0..len).map(|i| i as u8 ^ 0x5A).collect()
}

#[test]
fn a_header_with_twenty_bytes_is_30_18_6_0() {
    let (cp, got, outcome, log) = play(&bytes(30), &[0, 7, 0, 0]);
    assert_eq!((cp.taken, outcome, got), (vec![bytes(30)], Ok(()), vec![0, 7, 0, 0]));
    let words: Vec<u16> = log
        .iter()
        .filter_map(|step| match step {
            Step::Post { word, .. } | Step::Word(word) => Some(*word),
            _ => None,
        })
        .collect();
    assert_eq!(words, [OWN | 30, OWN | 18, OWN | 6, 0]);
    assert_eq!(cp.rx_echo, 0, "both sides are at 0 before the program is told");
}

#[test]
fn every_length_goes_and_comes_whole() {
    for len in (10..=1034).step_by(7).chain([12, 1034]) {
        let mut result = bytes(len - 6);
        result[..4].copy_from_slice(&[0, 7, 0, 0]);
        let (cp, got, outcome, _) = play(&bytes(len), &result);
        assert_eq!((cp.taken, outcome), (vec![bytes(len)], Ok(())), "{len} bytes");
        assert_eq!(got, result, "{len} bytes");
    }
}

#[test]
fn errors_of_the_partner_and_of_the_cp_are_told() {
    for (by, code) in [(0, 0x32), (1, 0x07), (1, 0x0A), (1, 0x0C), (1, 0x17)] {
        let (_, _, outcome, _) = play(&bytes(10), &[0, 7, by, code]);
        assert_eq!(outcome, Err(code));
    }
}

#[test]
fn words_that_do_not_fit_end_the_order() {
    let (job, _) = Job::start(7, 30);
    let at = |rx, tx_echo| job.go_on(Words { rx, tx_echo }, &[0; 12]).1;
    assert_eq!(at(0, 0), Step::Wait, "the CP has not looked yet");
    assert_eq!(at(0, 30), Step::Ended { outcome: Err(0x0C), tx: Some(0), echo: None }, "no framing");
    assert_eq!(at(0, OWN | 18), Step::Ended { outcome: Err(0x0C), tx: Some(0), echo: None });
    assert_eq!(at(0, FAILED | 0x17), Step::Ended { outcome: Err(0x17), tx: Some(FAILED), echo: None });
    let waits = Job { phase: Phase::Waiting, token: 7, total: 30, gese: 30, failed: false };
    assert_eq!(waits.go_on(Words { rx: PARTNER | 12, tx_echo: 0 }, &[0; 12]).1, Step::Wait, "FC 4's affair");
    let stale = waits.go_on(Words { rx: OWN | 4, tx_echo: 0 }, &[0, 6, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]).1;
    assert_eq!(stale, Step::Drain(OWN | 4), "the result of an order that was given up");
    let comes = Job { phase: Phase::Receiving, token: 7, total: 30, gese: 12, failed: false };
    let at = |rx| comes.go_on(Words { rx, tx_echo: 0 }, &[0; 12]).1;
    assert_eq!((at(OWN | 30), at(OWN | 18)), (Step::Wait, Step::Take { from: 12, len: 12, word: OWN | 18 }));
    assert_eq!(at(0), Step::Ended { outcome: Err(0x0C), tx: None, echo: Some(0) });
    assert_eq!(at(PARTNER | 18), Step::Ended { outcome: Err(0x0C), tx: None, echo: None });
}

#[test]
fn anz_holds_mark_and_count() {
    let job = Job { token: 31, total: 1034, ..Job::default() };
    assert_eq!((job.anz() >> 11, job.anz() & 0x7FF), (31, 1034));
}

fn header(bytes: &[u8; 10]) -> Header {
    let mut block = [0; 12];
    block[..10].copy_from_slice(bytes);
    Header::of(&block)
}

#[test]
fn headers_are_read() {
    let send = header(b"\0\x05AD\x07\x01\0\x08\x06\x04");
    assert_eq!((send.job, send.fetch, send.area, send.db, send.start), (5, false, b'D', 7, 1));
    assert_eq!((send.length, send.coordination), (8, 0x0604));
    assert_eq!(header(b"\0\x05OD\x07\x01\0\x08\xFF\xFF").area, b'X', "a DX");
    assert!(header(b"\0\x05EM\0\x10\0\x20\xFF\xFF").fetch);
}

#[test]
fn what_an_order_of_the_partner_is_answered() {
    let free = Some(false);
    for (command, letter, locked, db, room, code, pafe) in [
        (b'A', b'D', free, Pafe::Ok, true, 0x00, Pafe::Ok),
        (b'E', b'D', free, Pafe::Ok, true, 0x00, Pafe::Ok),
        (b'E', b'M', free, Pafe::Ok, true, 0x00, Pafe::Ok),
        (b'E', b'Z', free, Pafe::Ok, true, 0x00, Pafe::Ok),
        (b'E', b'T', free, Pafe::Ok, true, 0x00, Pafe::Ok),
        (b'E', b'E', free, Pafe::Ok, false, 0x14, Pafe::Ok),
        (b'E', b'A', free, Pafe::Ok, true, 0x00, Pafe::Ok),
        (b'E', b'X', free, Pafe::Ok, true, 0x10, Pafe::Ok),
        (b'O', b'D', free, Pafe::Ok, true, 0x10, Pafe::Ok),
        (b'A', b'M', free, Pafe::Ok, true, 0x10, Pafe::Ok),
        (b'A', b'D', Some(true), Pafe::Ok, true, 0x32, Pafe::Ok),
        (b'A', b'D', None, Pafe::Ok, true, 0x0C, Pafe::Ok),
        (b'A', b'D', free, Pafe::Missing, true, 0x14, Pafe::Missing),
        (b'E', b'D', free, Pafe::Short, true, 0x14, Pafe::Short),
        (b'A', b'D', free, Pafe::Number, true, 0x14, Pafe::Number),
        // The flag is checked before the data block: a locked area gives no other error.
        (b'A', b'D', Some(true), Pafe::Missing, true, 0x32, Pafe::Ok),
    ] {
        let header = header(&[0, 1, command, letter, 7, 1, 0, 1, 0xFF, 0xFF]);
        assert_eq!(evaluate(&header, locked, db, room), Evaluated { code, pafe }, "{} {letter}", command as char);
    }
}

/// FC 9 clears STEUERB_R only where no control bits of an order stand in it [S0 L1297].
#[test]
fn an_order_whose_block_has_lost_its_turn_is_still_to_be_told() {
    let cp = ModuleInfo { address: 256, input_bytes: 16, output_bytes: 16, present: true, generation: 1 };
    let (fetch, send) = (Key::new(Role::Order, 1), Key::new(Role::Order, 2));
    let give_up: [&dyn Fn(&Rk512State); 2] = [
        // FC 4 has fetched the result.
        &|state| state.order.claim.abandon(),
        // FC 3 has taken its turn, and its own order has ended.
        &|state| {
            assert_eq!(state.order.take(send, &cp, GIVEN_UP), Take::Over);
            state.order.claim.release();
        },
    ];
    for give_up in give_up {
        let state = Rk512State::default();
        assert!(!state.is_running());
        state.order.take(fetch, &cp, 0);
        state.order.claim.note(7);
        give_up(&state);
        assert!(state.is_running(), "its control bits stand");
        state.clear();
        assert!(state.is_running(), "and still do after the reset");
    }
}
