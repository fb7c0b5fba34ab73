//! Two ends of a simulated line, in virtual time: one always has its next order ready, the other serves it.

use ob1_fakes::sim_line::{End, SimConfig, SimEvent, SimLine};
use ob1_protocols::rk512::{self, Answer, AnswerError, OrderError, Owner, Request};
use ob1_protocols::{Event, Input, LineInput, Machine, Order, Rk512, SECOND, SendError, Sink, Wire};
use ob1_time::{Instant, Span};

use super::super::peer::Failure;

/// Bytes of user data in an order.
pub(super) const PAYLOAD: usize = 250;
/// Orders of a run.
pub(in super::super) const ORDERS: u64 = 400;
/// 8N1.
pub(super) const HALF_BITS: u32 = 20;

/// User data without DLE, which would be doubled.
pub(super) fn payload() -> Vec<u8> {
    (0..PAYLOAD).map(|i| 0x20 + (i % 0x60) as u8).collect()
}

/// Time of a character on the line.
pub(super) fn char_time(baud: u32) -> Span {
    (u64::from(HALF_BITS) * SECOND / 2).over_ceil(u64::from(baud))
}

/// The processor time of this thread in nanoseconds: not affected by other work on the machine.
fn processor_time() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e9 + time.tv_nsec as f64
}

/// The line as seen by one end during a step.
pub(super) struct SimEnd<'a> {
    line: &'a mut SimLine,
    end: End,
    now: Instant,
}

/// One end of the line.
pub(super) trait Side {
    /// Handles an input; returns the next deadline.
    fn step(&mut self, input: Input<'_>, wire: &mut SimEnd<'_>) -> Option<Instant>;

    /// Successful orders, received telegrams, and the first failure.
    fn account(&self) -> Account;
}

/// What a side has done.
#[derive(Clone, Debug, Default)]
pub(super) struct Account {
    /// Own successful orders.
    pub(super) done: u64,
    /// User data passed to this side's CPU.
    pub(super) taken: u64,
    /// The reason why an order failed.
    pub(super) failure: Option<String>,
}

/// The result of a run.
pub(super) struct Run {
    /// Bytes of user data per second of line time.
    pub(super) rate: f64,
    /// Processor time of an order, both sides and the line, in nanoseconds.
    pub(super) cost: f64,
}

/// Runs [`ORDERS`] orders of the first side.
///
/// # Errors
/// If an order fails on this undisturbed line, or both sides wait without end.
pub(super) fn run(sides: [Box<dyn Side>; 2], baud: u32) -> Result<Run, Failure> {
    let begin = processor_time();
    let time = drive(sides, baud)?;
    let cost = (processor_time() - begin) / ORDERS as f64;
    Ok(Run { rate: (ORDERS * PAYLOAD as u64) as f64 * SECOND.nanos() as f64 / time.nanos() as f64, cost })
}

/// The same; returns the time on the line. No clock is read: callgrind does not like the one of the system.
pub(super) fn drive(mut sides: [Box<dyn Side>; 2], baud: u32) -> Result<Instant, Failure> {
    let mut line = SimLine::new(SimConfig::new(baud, HALF_BITS), 1);
    let mut due = [None, None];
    let mut now = Instant::START;
    let mut buffer = [0; 64];
    let mut step = |line: &mut SimLine, due: &mut [Option<Instant>; 2], now, end: End, input: Input<'_>| {
        due[end as usize] = sides[end as usize].step(input, &mut SimEnd { line, end, now });
        let account = sides[0].account();
        match account.failure {
            Some(failure) => Err(format!("an order failed on a good line: {failure}")),
            None => Ok(account.done),
        }
    };
    for end in [End::B, End::A] {
        step(&mut line, &mut due, Instant::START, end, Input::Tick)?;
    }
    let mut done = 0;
    while done < ORDERS {
        let next = due.into_iter().flatten().chain(line.next_event()).min();
        now = next.ok_or("both sides wait for ever")?.max(now);
        while let Some((end, event)) = line.pop(now, &mut buffer) {
            let input = match event {
                SimEvent::Rx(count) => Input::Line(LineInput::Rx(&buffer[..count])),
                SimEvent::TxDone => Input::Line(LineInput::TxDone),
                SimEvent::Fault(_) | SimEvent::Cts(_) => continue,
            };
            done = step(&mut line, &mut due, now, end, input)?;
        }
        for end in End::BOTH {
            if due[end as usize].is_some_and(|at| at <= now) {
                done = step(&mut line, &mut due, now, end, Input::Tick)?;
            }
        }
    }
    let taken: u64 = sides.iter().map(|side| side.account().taken).sum();
    if taken < (ORDERS - 1) * PAYLOAD as u64 {
        return Err(format!("{taken} bytes arrived of {ORDERS} orders").into());
    }
    Ok(now)
}

/// A machine with the common interface. The first tick gives it its first order, the end of an order gives the next.
pub(super) struct OfMachine {
    machine: Box<dyn Machine>,
    /// Empty: this side only serves.
    order: Vec<u8>,
    /// Characters of a delivered telegram that are not user data.
    overhead: usize,
    account: Account,
}

impl OfMachine {
    /// A side that sends `order` repeatedly; empty: none.
    pub(super) fn side(machine: impl Machine + 'static, order: Vec<u8>) -> Box<dyn Side> {
        Self::with_overhead(machine, order, 0)
    }

    /// The same, if a delivered telegram has `overhead` bytes that are not user data.
    pub(super) fn with_overhead(machine: impl Machine + 'static, order: Vec<u8>, overhead: usize) -> Box<dyn Side> {
        Box::new(Self { machine: Box::new(machine), order, overhead, account: Account::default() })
    }
}

struct Plug<'a, 'b> {
    wire: &'a mut SimEnd<'b>,
    account: &'a mut Account,
    overhead: usize,
    ended: bool,
}

impl Wire for Plug<'_, '_> {
    fn transmit(&mut self, bytes: &[u8]) {
        self.wire.line.write(self.wire.end, self.wire.now, bytes);
    }

    fn take_back(&mut self) -> usize {
        self.wire.line.take_back(self.wire.end, self.wire.now)
    }
}

impl Sink for Plug<'_, '_> {
    fn room(&self) -> usize {
        1024
    }
    fn deliver(&mut self, telegram: &[u8]) {
        self.account.taken += telegram.len().saturating_sub(self.overhead) as u64;
    }
    fn sent(&mut self, outcome: Result<(), SendError>) {
        self.ended = true;
        match outcome {
            Ok(()) => self.account.done += 1,
            Err(error) => self.account.failure = Some(format!("{error:?}")),
        }
    }
    fn report(&mut self, _: Event) {}
}

impl Side for OfMachine {
    fn step(&mut self, input: Input<'_>, wire: &mut SimEnd<'_>) -> Option<Instant> {
        let now = wire.now;
        let first = now == Instant::START && input == Input::Tick && !self.machine.busy();
        let mut plug = Plug { wire, account: &mut self.account, overhead: self.overhead, ended: first };
        let mut due = self.machine.step(now, input, &mut plug);
        while std::mem::take(&mut plug.ended) && plug.account.failure.is_none() && !self.order.is_empty() {
            due = self.machine.step(now, Input::Order(Order::Send(&self.order)), &mut plug);
        }
        due
    }

    fn account(&self) -> Account {
        self.account.clone()
    }
}

/// RK 512: an order repeatedly, or a CPU that accepts every order of the partner at once.
pub(super) struct OfRk512 {
    machine: Rk512,
    request: Option<(Request, Vec<u8>)>,
    account: Account,
}

impl OfRk512 {
    /// A side that gives this order, a SEND with its data or a FETCH; or that only serves.
    pub(super) fn side(config: rk512::Config, request: Option<(Request, Vec<u8>)>) -> Box<dyn Side> {
        Box::new(Self { machine: Rk512::new(config), request, account: Account::default() })
    }
}

struct RkPlug<'a, 'b> {
    wire: &'a mut SimEnd<'b>,
    account: &'a mut Account,
    ended: bool,
    answer: Option<Vec<u8>>,
}

impl Wire for RkPlug<'_, '_> {
    fn transmit(&mut self, bytes: &[u8]) {
        self.wire.line.write(self.wire.end, self.wire.now, bytes);
    }

    fn take_back(&mut self) -> usize {
        self.wire.line.take_back(self.wire.end, self.wire.now)
    }
}

impl Owner for RkPlug<'_, '_> {
    fn ended(&mut self, outcome: Result<&[u8], OrderError>) {
        self.ended = true;
        match outcome {
            Ok(data) => {
                self.account.done += 1;
                self.account.taken += data.len() as u64;
            }
            Err(error) => self.account.failure = Some(format!("{error:?}")),
        }
    }
    fn asked(&mut self, request: &Request, data: &[u8]) {
        self.account.taken += data.len() as u64;
        self.answer = Some(vec![0x55; if data.is_empty() { request.bytes() } else { 0 }]);
    }
    fn answered(&mut self, outcome: Result<(), AnswerError>) {
        if let Err(error) = outcome {
            self.account.failure = Some(format!("{error:?}"));
        }
    }
    fn report(&mut self, _: rk512::Event) {}
}

impl Side for OfRk512 {
    fn step(&mut self, input: Input<'_>, wire: &mut SimEnd<'_>) -> Option<Instant> {
        let now = wire.now;
        let first = now == Instant::START && input == Input::Tick && !self.machine.busy();
        let mut plug = RkPlug { wire, account: &mut self.account, ended: first, answer: None };
        let mut due = self.machine.step(now, input.with_orders(rk512::Order::Abort), &mut plug);
        loop {
            if let Some(data) = plug.answer.take() {
                let answer = if data.is_empty() { Answer::Taken } else { Answer::Data(&data) };
                due = self.machine.step(now, Input::Order(rk512::Order::Answer(answer)), &mut plug);
            } else if let (true, None, Some((request, data))) =
                (std::mem::take(&mut plug.ended), &plug.account.failure, &self.request)
            {
                due = self.machine.step(now, Input::Order(rk512::Order::Start(*request, data)), &mut plug);
            } else {
                return due;
            }
        }
    }

    fn account(&self) -> Account {
        self.account.clone()
    }
}

/// No protocol: sends the same characters repeatedly, to measure the line itself.
pub(super) struct Bare {
    block: Vec<u8>,
    account: Account,
}

impl Bare {
    /// A side that sends this block repeatedly, or (empty) counts the received characters.
    pub(super) fn side(block: Vec<u8>) -> Box<dyn Side> {
        Box::new(Self { block, account: Account::default() })
    }
}

impl Side for Bare {
    fn step(&mut self, input: Input<'_>, wire: &mut SimEnd<'_>) -> Option<Instant> {
        match input {
            Input::Line(LineInput::Rx(bytes)) => self.account.taken += bytes.len() as u64,
            Input::Line(LineInput::TxDone) => self.account.done += 1,
            _ => {}
        }
        if matches!(input, Input::Tick | Input::Line(LineInput::TxDone)) && !self.block.is_empty() {
            wire.line.write(wire.end, wire.now, &self.block);
        }
        None
    }

    fn account(&self) -> Account {
        self.account.clone()
    }
}
