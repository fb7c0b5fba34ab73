//! A CPU and a line that act at random, against the guarantees of a CP: telegrams exactly once and in order, or an
//! error; nothing is sent that was not completely handed over.

use std::collections::VecDeque;

use ob1_firmware::{Counter, Cp as _, CpInput, LineInput, Span};
use proptest::prelude::*;

use crate::common;
use crate::common::{Bench, MS, ascii};

/// A CPU that sends and receives by the rules, one register write at a time, whenever it is its turn.
#[derive(Default)]
struct Cpu {
    orders: VecDeque<Vec<u8>>,
    /// The telegram being handed over, and the number of its unacknowledged bytes.
    sending: Option<(Vec<u8>, usize)>,
    done: Vec<Vec<u8>>,
    /// The fetched part of the telegram shown.
    fetching: Vec<u8>,
    fetched: Vec<Vec<u8>>,
}

impl Cpu {
    /// At most what one call of FC 0 does.
    fn send(&mut self, bench: &mut Bench) {
        let echo = bench.tx_echo();
        match &mut self.sending {
            None => {
                if let Some(telegram) = self.orders.pop_front() {
                    let rest = telegram.len();
                    bench.put_tx(rest as u16, &telegram[..rest.min(12)]);
                    self.sending = Some((telegram, rest));
                }
            }
            Some((telegram, rest)) if *rest > 0 && usize::from(echo) == *rest => {
                *rest = rest.saturating_sub(12);
                let at = telegram.len() - *rest;
                bench.put_tx(*rest as u16, &telegram[at..(at + 12).min(telegram.len())]);
            }
            Some((telegram, 0)) if echo == 0 => {
                self.done.push(std::mem::take(telegram));
                self.sending = None;
            }
            Some(_) => {}
        }
    }

    /// At most what one call of FC 1 does.
    fn receive(&mut self, bench: &mut Bench) {
        let rest = bench.rx();
        let echo = u16::from_be_bytes([bench.outputs[0], bench.outputs[1]]);
        if rest == 0 {
            if !self.fetching.is_empty() {
                self.fetched.push(std::mem::take(&mut self.fetching));
            }
            bench.put_rx(0);
        } else if rest != echo {
            let n = usize::from(rest).min(12);
            self.fetching.extend_from_slice(&bench.log.inputs[4..4 + n]);
            bench.put_rx(rest);
        }
    }
}

#[derive(Debug, Clone)]
enum Act {
    Send,
    Receive,
    TxDone,
    Telegram(usize),
    Silence,
    Time(Span),
}

fn act() -> impl Strategy<Value = Act> {
    prop_oneof![
        30 => Just(Act::Send),
        30 => Just(Act::Receive),
        4 => Just(Act::TxDone),
        2 => (1usize..=1024).prop_map(Act::Telegram),
        1 => (1usize..=20).prop_map(Act::Telegram),
        4 => Just(Act::Silence),
        4 => (0..60 * MS.nanos()).prop_map(|time| Act::Time(Span::from_nanos(time))),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn telegrams_go_through_once_and_in_order(
        lengths in proptest::collection::vec(prop_oneof![3 => 1usize..=40, 1 => 1usize..=1024], 0..12),
        acts in proptest::collection::vec(act(), 0..400),
        buffers in 1u8..=250,
    ) {
        let mut bench = Bench::working(&ascii(buffers));
        let orders: Vec<Vec<u8>> =
            lengths.iter().enumerate().map(|(n, l)| (0..*l).map(|i| (i * 3 + n) as u8).collect()).collect();
        let mut cpu = Cpu { orders: orders.iter().cloned().collect(), ..Cpu::default() };
        let mut sent = 0u8;
        // The line reports the end of an output only when there was one.
        let mut reported = 0;
        let mut run = |bench: &mut Bench, cpu: &mut Cpu, act: &Act| match act {
            Act::Send => cpu.send(bench),
            Act::Receive => cpu.receive(bench),
            Act::TxDone => {
                if bench.log.wire.tx.len() > reported {
                    reported = bench.log.wire.tx.len();
                    bench.line(LineInput::TxDone);
                }
            }
            Act::Telegram(length) => {
                sent = sent.wrapping_add(1);
                bench.line(LineInput::Rx(&vec![sent; *length]));
            }
            Act::Silence => bench.pass(50 * MS),
            Act::Time(time) => bench.pass(*time),
        };
        for act in &acts {
            run(&mut bench, &mut cpu, act);
        }
        // To the end: everything begun comes out.
        for _ in 0..2_000 {
            for act in [Act::Send, Act::TxDone, Act::Receive] {
                run(&mut bench, &mut cpu, &act);
            }
            bench.pass(MS);
        }
        prop_assert_eq!(&cpu.done, &orders, "all orders done, in order");
        prop_assert_eq!(&bench.log.wire.tx, &orders.concat(), "each exactly once on the line");
        prop_assert_eq!(&cpu.fetched, &bench.log.received, "what the CP has received is what the CPU has fetched");
        prop_assert_eq!(bench.cp.received_waiting(), 0);
        prop_assert_eq!(bench.count(Counter::OrdersAccepted), orders.len() as u64);
        prop_assert_eq!(bench.count(Counter::TelegramsSent), orders.len() as u64);
        prop_assert_eq!(bench.count(Counter::TelegramsDelivered), cpu.fetched.len() as u64);
    }

    #[test]
    fn garbage_in_the_registers_sends_nothing_that_was_not_handed_over(
        writes in proptest::collection::vec(
            (
                any::<u8>(),
                prop_oneof![2 => any::<u16>(), 8 => 0u16..20, 8 => Just(0), 1 => Just(0x2000), 1 => Just(0x8001)],
                prop_oneof![2 => any::<u16>(), 99 => Just(0), 1 => Just(0x8002), 1 => Just(0x8001)],
            ),
            0..600,
        ),
        start_up in any::<bool>(),
    ) {
        let mut bench = if start_up { Bench::starting(&ascii(2)) } else { Bench::working(&ascii(2)) };
        // A model of the order: the bytes that were stored since the echo was last 0.
        let mut allowed = Vec::new();
        let mut collected: Vec<u8> = Vec::new();
        for (fill, tx, rx) in writes {
            let (before, working) = (bench.tx_echo(), bench.cp.is_working());
            let transmitting = bench.log.wire.tx.len();
            bench.put(rx, tx, &[fill; 12]);
            // The write that ends the start-up may already contain a first count.
            let before = if working { before } else { 0 };
            let after = bench.tx_echo();
            let complete = working && rx != 0x8002 && tx == 0 && (1..=12).contains(&before) && !collected.is_empty();
            if complete {
                allowed.append(&mut collected);
                bench.line(LineInput::TxDone);
            } else {
                prop_assert_eq!(bench.log.wire.tx.len(), transmitting, "nothing leaves at {:04X} -> {:04X}", before, after);
                if bench.cp.is_working() && after != before && after == tx && (1..=1024).contains(&after) {
                    if before == 0 {
                        collected.clear();
                    }
                    collected.extend(std::iter::repeat_n(fill, usize::from(after).min(12)));
                } else if after == 0 || after & 0x8000 != 0 {
                    collected.clear();
                }
            }
            prop_assert_eq!(&bench.log.wire.tx, &allowed);
        }
    }

    #[test]
    fn nothing_at_all_makes_it_panic(
        steps in proptest::collection::vec((0u8..7, any::<[u8; 16]>(), 0..3_000 * MS.nanos()), 0..200),
        r in any::<bool>(),
    ) {
        let mut bench = Bench::working(&if r { common::s3964r(true) } else { ascii(3) });
        for (kind, bytes, time) in steps {
            match kind {
                0 => bench.step(CpInput::Tick),
                1 => bench.step(CpInput::Outputs(&bytes)),
                2 => bench.line(LineInput::Rx(&bytes[..usize::from(bytes[0] % 16)])),
                3 => bench.line(LineInput::TxDone),
                4 => bench.step(CpInput::CpuRun(bytes[0] & 1 == 0)),
                5 => bench.step(CpInput::Parameters(&bytes)),
                _ => bench.pass(Span::from_nanos(time)),
            }
            let orders = bench.count(Counter::OrdersAccepted);
            let ended = [Counter::TelegramsSent, Counter::SendErrors, Counter::OrdersAborted].map(|c| bench.count(c));
            prop_assert!((0..=1).contains(&(orders - ended.iter().sum::<u64>())), "one order at a time, each ends once");
        }
    }
}
