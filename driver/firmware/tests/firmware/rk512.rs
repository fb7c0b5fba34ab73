//! RK 512 at the registers: orders of the CPU, their results, orders of the partner, answers (docs/cp240-registers.md,
//! "RK 512").

use ob1_firmware::{Counter, Cp240, CpInput, LineFault, LineInput};

use crate::common::{Bench, MS};

/// 3964R with RK 512 at 9600 8N1, the default times, low priority.
const RK512: [u8; 16] = [0, 0x06, 0x13, 0, 0, 10, 25, 100, 5, 6, 0, 0, 0, 0, 0, 0];

/// Framings.
const OWN: u16 = 0x0800;
const PARTNER: u16 = 0x1000;

/// SEND of two words to DB 5, DW 1; byte 2 carries the CPU's mark.
const SEND: [u8; 14] = [0, 7, b'A', b'D', 5, 1, 0, 2, 0xFF, 0xFF, 0x61, 0x62, 0x63, 0x64];

fn block(telegram: &[u8]) -> Vec<u8> {
    let mut block: Vec<u8> =
        telegram.iter().flat_map(|b| std::iter::repeat_n(*b, if *b == 0x10 { 2 } else { 1 })).collect();
    block.extend([0x10, 0x03]);
    let bcc = block.iter().fold(0, |a, b| a ^ b);
    block.push(bcc);
    block
}

trait Partner {
    fn partner_sends(&mut self, telegram: &[u8]);
    fn partner_takes(&mut self, telegram: &[u8]);
    fn hand_over_framed(&mut self, framing: u16, telegram: &[u8]);
    fn fetch_framed(&mut self, framing: u16, ready: u16) -> Vec<u8>;
}

impl Partner for Bench {
    fn partner_sends(&mut self, telegram: &[u8]) {
        self.line(LineInput::Rx(&[0x02]));
        self.line(LineInput::TxDone);
        self.log.wire.tx.clear();
        self.line(LineInput::Rx(&block(telegram)));
        assert_eq!(self.log.wire.tx.first(), Some(&0x10), "acknowledged");
        self.log.wire.tx.remove(0);
    }

    /// Our STX has been sent.
    fn partner_takes(&mut self, telegram: &[u8]) {
        assert_eq!(self.log.wire.tx, [0x02]);
        self.line(LineInput::TxDone);
        self.log.wire.tx.clear();
        self.line(LineInput::Rx(&[0x10]));
        assert_eq!(self.log.wire.tx, block(telegram));
        self.log.wire.tx.clear();
        self.line(LineInput::TxDone);
        self.line(LineInput::Rx(&[0x10]));
    }

    fn hand_over_framed(&mut self, framing: u16, telegram: &[u8]) {
        for (n, block) in telegram.chunks(12).enumerate() {
            let word = framing | (telegram.len() - 12 * n) as u16;
            self.put_tx(word, block);
            assert_eq!(self.tx_echo(), word);
        }
        self.put_tx(0, &[]);
        assert_eq!(self.tx_echo(), 0, "TX is free as soon as the CP has it");
    }

    fn fetch_framed(&mut self, framing: u16, ready: u16) -> Vec<u8> {
        let mut telegram = Vec::new();
        assert_eq!(self.rx() & 0xF800, framing, "RX {:04X}h", self.rx());
        while self.rx() != 0 {
            let rest = self.rx();
            telegram.extend_from_slice(&self.log.inputs[4..4 + usize::from(rest & 0x7FF).min(12)]);
            self.put_rx(rest);
        }
        self.put_rx(ready);
        telegram
    }
}

#[test]
fn an_order_of_the_cpu_and_its_result() {
    let mut cp = Bench::working(&RK512);
    cp.hand_over_framed(OWN, &SEND);
    cp.partner_takes(&[0, 0, b'A', b'D', 5, 1, 0, 2, 0xFF, 0xFF, 0x61, 0x62, 0x63, 0x64]);
    assert_eq!(cp.rx(), 0, "the reaction is awaited");
    cp.partner_sends(&[0, 0, 0, 0]);
    assert_eq!(cp.fetch_framed(OWN, 0), [0, 7, 0, 0]);
    // The partner refuses: the result has its number, marked as the partner's.
    cp.line(LineInput::TxDone);
    cp.hand_over_framed(OWN, &[0, 8, b'E', b'D', 5, 1, 0, 2, 6, 4]);
    cp.partner_takes(&[0, 0, b'E', b'D', 5, 1, 0, 2, 6, 4]);
    cp.partner_sends(&[0, 0, 0, 0x32]);
    assert_eq!(cp.fetch_framed(OWN, 0), [0, 8, 0, 0x32]);
    // Data of a FETCH.
    cp.line(LineInput::TxDone);
    cp.hand_over_framed(OWN, &[0, 9, b'E', b'D', 5, 1, 0, 6, 0xFF, 0xFF]);
    cp.partner_takes(&[0, 0, b'E', b'D', 5, 1, 0, 6, 0xFF, 0xFF]);
    cp.partner_sends(&[0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]);
    assert_eq!(cp.fetch_framed(OWN, 0), [0, 9, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]);
    let counts = [Counter::OrdersAccepted, Counter::TelegramsSent, Counter::SendErrors].map(|c| cp.count(c));
    assert_eq!(counts, [3, 2, 1]);
}

#[test]
fn the_cps_own_errors_are_told_from_the_partners() {
    let mut cp = Bench::working(&RK512);
    // No answer: QVZ after each of 6 STX.
    cp.hand_over_framed(OWN, &SEND);
    for _ in 0..6 {
        cp.line(LineInput::TxDone);
        cp.pass(500 * MS);
    }
    assert_eq!(cp.fetch_framed(OWN, 0), [0, 7, 1, 0x07]);
    // No header, and data that do not match it.
    cp.line(LineInput::TxDone);
    cp.hand_over_framed(OWN, &[0, 1, b'A']);
    assert_eq!(cp.fetch_framed(OWN, 0), [0, 1, 1, 0x0C]);
    cp.hand_over_framed(OWN, &SEND[..12]);
    assert_eq!(cp.fetch_framed(OWN, 0), [0, 7, 1, 0x0C]);
    // Longer than the buffer.
    cp.put_tx(OWN | 1035, &[]);
    assert_eq!(cp.tx_echo(), 0x2017);
    // A count without framing (FC 0) is not an order of RK 512: it is refused, not left waiting.
    cp.put_tx(0x2000, &[]);
    cp.put_tx(0, &[]);
    cp.put_tx(30, b"abcdefghijkl");
    assert_eq!(cp.tx_echo(), 0x200C);
}

#[test]
fn an_order_of_the_partner_and_the_answer() {
    let mut cp = Bench::working(&RK512);
    cp.partner_sends(&[0, 0, b'A', b'D', 5, 1, 0, 1, 6, 4, 0x61, 0x62]);
    assert_eq!(cp.rx(), 0, "not before the CPU says that it serves");
    cp.put_rx(PARTNER);
    let order = cp.fetch_framed(PARTNER, PARTNER);
    assert_eq!(order, [0, 1, b'A', b'D', 5, 1, 0, 1, 6, 4, 0x61, 0x62]);
    cp.line(LineInput::TxDone);
    assert!(cp.log.wire.tx.is_empty(), "no reaction before the CPU has answered");
    cp.hand_over_framed(PARTNER, &[0, 1, 0, 0]);
    cp.partner_takes(&[0, 0, 0, 0]);
    // FETCH: data with the answer, number 2.
    cp.partner_sends(&[0, 0, b'E', b'M', 0, 16, 0, 3, 0xFF, 0xFF]);
    assert_eq!(cp.fetch_framed(PARTNER, PARTNER)[..2], [0, 2]);
    cp.line(LineInput::TxDone);
    cp.put_tx(PARTNER | 7, &[0, 1, 0, 0, 9, 9, 9]);
    cp.put_tx(0, &[]);
    assert!(cp.log.wire.tx.is_empty(), "the answer to an order that is over goes nowhere");
    assert_eq!(cp.tx_echo(), 0x200C, "and the CPU is not told that it was taken");
    cp.put_tx(0x2000, &[]);
    cp.put_tx(0, &[]);
    cp.hand_over_framed(PARTNER, &[0, 2, 0, 0, 7, 8, 9]);
    cp.partner_takes(&[0, 0, 0, 0, 7, 8, 9]);
    // Refused by the CPU.
    cp.partner_sends(&[0, 0, b'E', b'M', 0, 16, 0, 3, 6, 4]);
    cp.fetch_framed(PARTNER, PARTNER);
    cp.line(LineInput::TxDone);
    cp.hand_over_framed(PARTNER, &[0, 3, 0, 0x32]);
    cp.partner_takes(&[0, 0, 0, 0x32]);
    assert_eq!([Counter::TelegramsReceived, Counter::TelegramsDelivered].map(|c| cp.count(c)), [3, 3]);
}

#[test]
fn both_directions_at_once() {
    let mut cp = Bench::working(&RK512);
    cp.hand_over_framed(OWN, &SEND);
    cp.partner_takes(&[0, 0, b'A', b'D', 5, 1, 0, 2, 0xFF, 0xFF, 0x61, 0x62, 0x63, 0x64]);
    cp.partner_sends(&[0, 0, b'E', b'M', 0, 16, 0, 1, 0xFF, 0xFF]);
    cp.put_rx(PARTNER);
    cp.fetch_framed(PARTNER, PARTNER);
    cp.line(LineInput::TxDone);
    cp.hand_over_framed(PARTNER, &[0, 1, 0, 0, 0x5A]);
    cp.partner_takes(&[0, 0, 0, 0, 0x5A]);
    cp.partner_sends(&[0, 0, 0, 0]);
    assert_eq!(cp.fetch_framed(OWN, PARTNER), [0, 7, 0, 0]);
    // A result comes before an order of the partner that no program serves.
    cp.line(LineInput::TxDone);
    cp.put_rx(0);
    cp.hand_over_framed(OWN, &SEND);
    cp.partner_takes(&[0, 0, b'A', b'D', 5, 1, 0, 2, 0xFF, 0xFF, 0x61, 0x62, 0x63, 0x64]);
    cp.partner_sends(&[0, 0, b'E', b'M', 0, 16, 0, 1, 0xFF, 0xFF]);
    cp.line(LineInput::TxDone);
    cp.partner_sends(&[0, 0, 0, 0]);
    assert_eq!(cp.fetch_framed(OWN, 0), [0, 7, 0, 0]);
}

#[test]
fn an_order_nobody_serves_is_refused_with_2a() {
    let mut cp = Bench::working(&RK512);
    cp.partner_sends(&[0, 0, b'E', b'M', 0, 16, 0, 1, 0xFF, 0xFF]);
    cp.line(LineInput::TxDone);
    cp.pass(4000 * MS);
    cp.partner_takes(&[0, 0, 0, 0x2A]);
    // It was shown and half fetched: it is withdrawn.
    cp.put_rx(PARTNER);
    cp.partner_sends(&[0, 0, b'A', b'D', 5, 1, 0, 4, 6, 4, 1, 2, 3, 4, 5, 6, 7, 8]);
    cp.line(LineInput::TxDone);
    assert_eq!(cp.rx(), PARTNER | 18);
    cp.put_rx(PARTNER | 18);
    assert_eq!(cp.rx(), PARTNER | 6);
    cp.pass(4000 * MS);
    assert_eq!(cp.rx(), 0);
    cp.partner_takes(&[0, 0, 0, 0x2A]);
    cp.partner_sends(&[0, 0, b'E', b'M', 0, 16, 0, 1, 0xFF, 0xFF]);
    cp.line(LineInput::TxDone);
    assert_eq!(cp.rx(), 0, "the echo still has its count");
    cp.put_rx(PARTNER);
    assert_eq!(cp.fetch_framed(PARTNER, PARTNER)[..2], [0, 3]);
    assert_eq!(
        [Counter::TelegramsReceived, Counter::TelegramsDelivered, Counter::ReceiveAborted].map(|c| cp.count(c)),
        [3, 1, 2]
    );
    // CPU in STOP: at once.
    cp.step(CpInput::CpuRun(false));
    cp.partner_takes(&[0, 0, 0, 0x2A]);
    cp.partner_sends(&[0, 0, b'E', b'M', 0, 16, 0, 1, 0xFF, 0xFF]);
    cp.line(LineInput::TxDone);
    cp.log.wire.tx = vec![0x02];
    cp.partner_takes(&[0, 0, 0, 0x2A]);
    cp.step(CpInput::CpuRun(true));
    cp.partner_sends(&[0, 0, b'E', b'M', 0, 16, 0, 1, 0xFF, 0xFF]);
    assert_eq!(cp.fetch_framed(PARTNER, PARTNER)[..2], [0, 4]);
}

#[test]
fn an_order_the_program_has_given_up_is_waited_for() {
    let mut cp = Bench::working(&RK512);
    cp.hand_over_framed(OWN, &SEND);
    cp.partner_takes(&[0, 0, b'A', b'D', 5, 1, 0, 2, 0xFF, 0xFF, 0x61, 0x62, 0x63, 0x64]);
    let mut second = SEND;
    second[1] = 8;
    for (word, part) in [(OWN | 14, &second[..12]), (OWN | 2, &second[12..])] {
        cp.put_tx(word, part);
    }
    cp.put_tx(0, &[]);
    assert_eq!(cp.tx_echo(), OWN | 2, "it stands there until the first is over");
    cp.partner_sends(&[0, 0, 0, 0]);
    assert_eq!((cp.tx_echo(), cp.rx()), (0, 0), "the result of the first is nobody's");
    cp.line(LineInput::TxDone);
    cp.log.wire.tx = vec![0x02];
    cp.partner_takes(&[0, 0, b'A', b'D', 5, 1, 0, 2, 0xFF, 0xFF, 0x61, 0x62, 0x63, 0x64]);
    cp.partner_sends(&[0, 0, 0, 0]);
    assert_eq!(cp.fetch_framed(OWN, 0), [0, 8, 0, 0]);
    assert_eq!([Counter::OrdersAccepted, Counter::TelegramsSent].map(|c| cp.count(c)), [2, 2]);
}

#[test]
fn a_reset_drops_both_roles() {
    let mut cp = Bench::working(&RK512);
    cp.put_rx(PARTNER);
    cp.partner_sends(&[0, 0, b'E', b'M', 0, 16, 0, 1, 0xFF, 0xFF]);
    cp.hand_over_framed(OWN, &SEND);
    cp.put_rx(0x8002);
    cp.put_rx(0);
    cp.synchronise();
    assert_eq!((cp.rx(), cp.tx_echo()), (0, 0));
    let counts = [Counter::OrdersAborted, Counter::ReceiveAborted].map(|c| cp.count(c));
    assert_eq!(counts, [1, 1]);
    cp.log.wire.tx.clear();
    cp.pass(10_000 * MS);
    assert!(cp.log.wire.tx.is_empty() && cp.rx() == 0, "nothing of before comes back");
}

#[test]
fn the_reaction_to_an_order_from_before_ends_no_order() {
    let reset = || {
        let mut cp = Bench::working(&RK512);
        cp.hand_over_framed(OWN, &SEND);
        cp.partner_takes(&[0, 0, b'A', b'D', 5, 1, 0, 2, 0xFF, 0xFF, 0x61, 0x62, 0x63, 0x64]);
        cp.put_rx(0x8002);
        cp.put_rx(0);
        cp
    };
    let successor = || {
        let mut cp = Bench::off();
        cp.cp = Cp240::new(2);
        cp.step(CpInput::Parameters(&RK512));
        cp
    };
    for (before, what) in [(reset(), "a RESET"), (successor(), "another process")] {
        let mut cp = before;
        cp.synchronise();
        cp.log.wire.tx.clear();
        cp.hand_over_framed(OWN, &SEND);
        cp.pass(100 * MS);
        assert!(cp.log.wire.tx.is_empty(), "after {what} it waits for that reaction");
        cp.partner_sends(&[0, 0, 0, 0]);
        assert_eq!(cp.rx(), 0, "which ends nothing");
        cp.line(LineInput::TxDone);
        cp.log.wire.tx = vec![0x02];
        cp.partner_takes(&[0, 0, b'A', b'D', 5, 1, 0, 2, 0xFF, 0xFF, 0x61, 0x62, 0x63, 0x64]);
        cp.partner_sends(&[0, 0, 0, 0]);
        assert_eq!(cp.fetch_framed(OWN, 0), [0, 7, 0, 0]);
    }
}

/// Any content of the registers and any input from the line: no panic, the counters balance, and after a reset the CP
/// works again.
#[test]
fn noise() {
    let mut random = fastrand::Rng::with_seed(0x2545_F491_4F6C_DD1D);
    let mut next = move |below: u64| random.u64(..below);
    let mut cp = Bench::working(&RK512);
    for round in 0..30_000 {
        match next(8) {
            0 => cp.pass(next(300) * MS),
            1 => cp.line(LineInput::TxDone),
            2 => cp.line(LineInput::Fault([LineFault::Parity, LineFault::Gone, LineFault::Back][next(3) as usize])),
            3 => {
                let telegram: Vec<u8> = match next(3) {
                    0 => [&[0, 0, b'A', b'D', 5, 1, 0, 2, 0xFF, 0xFF][..], &[1, 2, 3, 4]].concat(),
                    1 => vec![0, 0, 0, 0],
                    _ => vec![0, 0, b'E', b'M', 0, 1, 0, 20, 0xFF, 0xFF],
                };
                cp.line(LineInput::Rx(&[0x02]));
                cp.line(LineInput::TxDone);
                cp.line(LineInput::Rx(&block(&telegram)));
            }
            4 => cp.line(LineInput::Rx(&[[0x02, 0x10, 0x15, 0x03][next(4) as usize]])),
            5 => {
                // What a sensible CPU would write next.
                let (rx, tx) = (cp.rx(), cp.tx_echo());
                cp.put_rx(if next(4) == 0 { PARTNER } else { rx });
                cp.put_tx(if tx & 0x7FF > 12 { tx - 12 } else { 0 }, b"\0\x01ADDDDD\xFF\xFFxy");
            }
            6 => cp.put_tx(
                [OWN | 14, OWN | 10, PARTNER | 4, PARTNER | 30, 0, 0x2000][next(6) as usize],
                b"\0\x01AD\x05\x01\0\x02\xFF\xFFxy",
            ),
            _ => cp.put(next(0x8000) as u16, next(0x8000) as u16, &[next(256) as u8; 12]),
        }
        if round % 1000 == 0 {
            cp.step(CpInput::CpuRun(next(2) == 0));
        }
    }
    cp.step(CpInput::CpuRun(true));
    cp.line(LineInput::Fault(LineFault::Back));
    cp.put(0x8002, 0, &[]);
    cp.put(0, 0, &[]);
    cp.synchronise();
    let books = [Counter::TelegramsSent, Counter::SendErrors, Counter::OrdersAborted].map(|c| cp.count(c));
    assert_eq!(cp.count(Counter::OrdersAccepted), books.iter().sum::<u64>(), "{books:?}");
    let books = [Counter::TelegramsDelivered, Counter::ReceiveAborted].map(|c| cp.count(c));
    assert_eq!(cp.count(Counter::TelegramsReceived), books.iter().sum::<u64>(), "{books:?}");
    assert!(cp.count(Counter::OrdersAccepted) > 50 && books[0] > 5 && cp.count(Counter::TelegramsSent) > 0);
    cp.log.wire.tx.clear();
    cp.hand_over_framed(OWN, &SEND);
    cp.log.wire.tx = vec![0x02];
    cp.partner_takes(&[0, 0, b'A', b'D', 5, 1, 0, 2, 0xFF, 0xFF, 0x61, 0x62, 0x63, 0x64]);
    cp.partner_sends(&[0, 0, 0, 0]);
    assert_eq!(cp.fetch_framed(OWN, 0), [0, 7, 0, 0]);
}
