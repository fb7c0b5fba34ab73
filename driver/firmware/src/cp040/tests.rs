//! Model test of the host protocol: the CP's side from here, the host's side from `ob1-slio`, registers between them,
//! and a random order of events. Every telegram goes through exactly once and in order; with resets, at most once.

use std::collections::VecDeque;

use ob1_protocols::SendError;
use ob1_words::slio::{ReceiveJob, ReceiveStep, SendJob, SendStep};
use proptest::prelude::*;

use super::exchange::{Exchange, Step};
use super::{receive, send};
use ob1_words::cp040::{Area, IDLE, IO_BYTES};

/// What can happen, in any order.
#[derive(Debug, Clone)]
enum Act {
    /// A call of the program's send block.
    HostSend,
    /// A call of its receive block.
    HostReceive,
    /// The CP evaluates the outputs and publishes its inputs.
    Cp,
    /// The line has finished the order.
    Ends(bool),
    /// A telegram has come.
    Telegram(usize),
    /// The program asks for a reset.
    Reset,
    /// The CP's process restarts.
    Restart,
}

struct World {
    cp: Exchange,
    inputs: Area,
    outputs: Area,
    // The host.
    orders: VecDeque<Vec<u8>>,
    telegram: Vec<u8>,
    send: SendJob,
    receive: ReceiveJob,
    collected: Vec<u8>,
    done: Vec<Vec<u8>>,
    failed: usize,
    fetched: Vec<Vec<u8>>,
    // The CP.
    sent: Vec<Vec<u8>>,
    received: Vec<Vec<u8>>,
    next: u8,
}

impl World {
    fn new(io_bytes: usize, orders: &[Vec<u8>]) -> Self {
        let mut cp = Exchange::new(io_bytes);
        cp.clear(250);
        Self {
            cp,
            inputs: [0; 60],
            outputs: [0; 60],
            orders: orders.iter().cloned().collect(),
            telegram: Vec::new(),
            send: SendJob::default(),
            receive: ReceiveJob::default(),
            collected: Vec::new(),
            done: Vec::new(),
            failed: 0,
            fetched: Vec::new(),
            sent: Vec::new(),
            received: Vec::new(),
            next: 0,
        }
    }

    fn command(&mut self, nibble: u8) {
        self.outputs[0] = self.outputs[0] & 0xF0 | nibble;
    }

    fn acknowledge(&mut self, nibble: u8) {
        self.outputs[0] = self.outputs[0] & 0x0F | nibble << 4;
    }

    fn host_send(&mut self) {
        if !self.send.is_running()
            && let Some(telegram) = self.orders.pop_front()
        {
            self.send = SendJob::telegram(telegram.len() as u16).expect("1 to 1024");
            self.telegram = telegram;
        }
        let io_bytes = self.cp.io_bytes();
        let was_reset = self.send.is_reset();
        let (job, step) = self.send.step(&self.inputs[..io_bytes], self.outputs[0], io_bytes);
        // A program can keep only a number.
        self.send = SendJob::unpack(job.pack());
        match step {
            SendStep::Wait => {}
            SendStep::Command(nibble) => self.command(nibble),
            SendStep::Put(piece) => {
                let at = 1 + piece.head(&mut self.outputs[1..io_bytes]);
                self.outputs[at..at + piece.count]
                    .copy_from_slice(&self.telegram[piece.from..piece.from + piece.count]);
                self.command(piece.command);
            }
            SendStep::Done if was_reset => {}
            SendStep::Done => self.done.push(std::mem::take(&mut self.telegram)),
            SendStep::Failed(_) => self.failed += 1,
        }
        if matches!(step, SendStep::Done | SendStep::Failed(_)) {
            self.command(IDLE);
        }
    }

    fn host_receive(&mut self) {
        // The inputs still show the state before the reset.
        if self.send.is_reset() {
            return;
        }
        let io_bytes = self.cp.io_bytes();
        let (job, step) = self.receive.step(&self.inputs[..io_bytes], self.outputs[0], self.send);
        self.receive = ReceiveJob::unpack(job.pack());
        match step {
            ReceiveStep::Wait => {}
            ReceiveStep::Acknowledge(nibble) => self.acknowledge(nibble),
            ReceiveStep::Failed(_) => self.acknowledge(IDLE),
            ReceiveStep::Take(take) => {
                self.collected.resize(take.at, 0);
                self.collected.extend_from_slice(&self.inputs[take.from..take.from + take.count]);
                self.acknowledge(take.acknowledge);
                if let Some(received) = take.received {
                    assert_eq!(received.return_value, 0);
                    assert_eq!(self.collected.len(), usize::from(received.length));
                    self.fetched.push(std::mem::take(&mut self.collected));
                }
            }
        }
    }

    fn cp(&mut self) {
        self.cp.set_outputs(&self.outputs);
        match self.cp.look() {
            Step::Reset => {
                self.cp.clear(250);
            }
            Step::Both(sending, receiving) => {
                assert!(!matches!(sending, send::Step::BadLength | send::Step::BadOrder), "{sending:?}");
                if sending == send::Step::Complete {
                    self.sent.push(self.cp.send.telegram().to_vec());
                }
                if let receive::Step::Delivered(bytes) = receiving {
                    assert!(bytes.is_some());
                }
            }
        }
        self.show();
    }

    fn show(&mut self) {
        self.inputs = self.cp.inputs();
    }

    fn run(&mut self, act: &Act) {
        match act {
            Act::HostSend => self.host_send(),
            Act::HostReceive => self.host_receive(),
            Act::Cp => self.cp(),
            Act::Ends(well) => {
                self.cp.send.ended(well.then_some(()).ok_or(SendError::Frame));
                self.show();
            }
            Act::Telegram(length) => {
                self.next = self.next.wrapping_add(1);
                let telegram: Vec<u8> = (0..*length).map(|n| (n as u8).wrapping_mul(7) ^ self.next).collect();
                if self.cp.receive.push(None, &telegram) {
                    self.received.push(telegram);
                }
            }
            Act::Reset => {
                self.send = SendJob::reset();
                self.receive = ReceiveJob::default();
                self.acknowledge(IDLE);
            }
            Act::Restart => {
                self.cp = Exchange::new(self.cp.io_bytes());
                self.cp.set_outputs(&self.outputs);
                self.cp.clear(250);
                self.show();
            }
        }
    }

    /// Runs to the end, so that everything that was started is completed.
    fn finish(&mut self) {
        for _ in 0..40_000 {
            for act in [Act::HostSend, Act::Cp, Act::Ends(true), Act::HostReceive, Act::Cp] {
                self.run(&act);
            }
            if self.orders.is_empty() && !self.send.is_running() && self.cp.receive.telegrams() == 0 {
                return;
            }
        }
        panic!("it hangs: {:?} {:?} {:?}", self.send, self.receive, self.cp.inputs());
    }
}

fn act(disturbed: bool) -> impl Strategy<Value = Act> {
    let weight = u32::from(disturbed);
    prop_oneof![
        30 => Just(Act::HostSend),
        30 => Just(Act::HostReceive),
        40 => Just(Act::Cp),
        8 => Just(Act::Ends(true)),
        weight * 2 => Just(Act::Ends(false)),
        1 => (1usize..=1024).prop_map(Act::Telegram),
        2 => (1usize..=60).prop_map(Act::Telegram),
        weight * 2 => Just(Act::Reset),
        weight * 2 => Just(Act::Restart),
    ]
}

fn orders() -> impl Strategy<Value = Vec<Vec<u8>>> {
    proptest::collection::vec(prop_oneof![2 => 1usize..=60, 1 => 1usize..=1024], 0..12).prop_map(|lengths| {
        let telegram = |(n, length)| (0..length).map(|i| (i as u8).wrapping_mul(3) ^ n as u8).collect();
        lengths.into_iter().enumerate().map(telegram).collect()
    })
}

/// Whether `some` came out of `all` in order, each at most once.
fn is_subsequence(some: &[Vec<u8>], all: &[Vec<u8>]) -> bool {
    let mut rest = all.iter();
    some.iter().all(|one| rest.any(|other| other == one))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 600, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn telegrams_go_through_exactly_once_and_in_order(
        io_bytes in IO_BYTES,
        orders in orders(),
        acts in proptest::collection::vec(act(false), 0..600),
    ) {
        let mut world = World::new(io_bytes, &orders);
        for act in &acts {
            world.run(act);
        }
        world.finish();
        prop_assert_eq!(&world.done, &orders, "the host knows that all are done");
        prop_assert_eq!(&world.sent, &orders, "each was transmitted once");
        prop_assert_eq!(world.failed, 0);
        prop_assert_eq!(&world.fetched, &world.received);
    }

    #[test]
    fn with_resets_and_restarts_they_go_through_at_most_once(
        io_bytes in IO_BYTES,
        orders in orders(),
        acts in proptest::collection::vec(act(true), 0..600),
    ) {
        let mut world = World::new(io_bytes, &orders);
        for act in &acts {
            world.run(act);
        }
        world.finish();
        prop_assert!(is_subsequence(&world.sent, &orders), "none twice, none mixed");
        prop_assert!(is_subsequence(&world.done, &world.sent), "none done that was not transmitted");
        prop_assert!(is_subsequence(&world.fetched, &world.received), "none twice, none mixed");
        // It works again afterwards.
        let before = (world.sent.len(), world.fetched.len());
        world.orders.push_back(vec![0x55; 100]);
        world.run(&Act::Telegram(100));
        world.finish();
        prop_assert_eq!((world.sent.len(), world.fetched.len()), (before.0 + 1, before.1 + 1));
    }
}
