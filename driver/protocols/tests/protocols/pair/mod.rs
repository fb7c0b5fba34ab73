//! Two machines back to back on a bad line, in virtual time.
//!
//! A [`Duet`] defines the two machines, the telegrams of their programs, and the judge of accepted telegrams. The
//! harness plays both programs and the line, and checks the same invariants for every protocol:
//!
//! * every order ends exactly once, done or with an error;
//! * nothing is accepted that the protocol's own check would have detected: the [`Judge`] sees every character as it
//!   came from the line and decides from the text of the procedure, not with the code under test;
//! * "done" is true: the telegram arrived ([`Duet::ACKNOWLEDGED`]), at the latest when the line is calm
//!   ([`Duet::GRACE`]);
//! * no deadlock: when the faults are over, telegrams arrive in bounded time in both directions, and whole.
//!
//! The seeds kept in `tests/seeds` run first, then 1, 2, 3, ... until `OB1_TELEGRAMS` orders have ended (default 20000;
//! the long run takes 100000). A seed that fails is named together with the command that replays it; `OB1_SEED=n` runs
//! that one alone and prints what happens on the line.

#![allow(clippy::disallowed_methods)] // A test reads its seeds and its environment.

use std::panic::{AssertUnwindSafe, catch_unwind};

use ob1_fakes::sim_line::{End, SimConfig, SimEvent, SimLine};
use ob1_line::sim::{FaultRates, SplitMix64};
use ob1_protocols::{Event, Input, Instant, LineInput, MS, Machine, ModemLines, Order, SendError, Sink, Span, Wire};

/// Virtual time with faults.
const FAULTY: Instant = Instant::from_secs(30);
/// After the faults: an order that was running may still fail in this time.
const SETTLE: Span = Span::from_secs(10);
/// After that: orders must succeed.
const CALM: Span = Span::from_secs(5);

/// Two partners of one protocol.
pub(crate) trait Duet {
    /// Name of the test: for the replay command and the kept seeds.
    const TEST: &'static str;
    /// Either partner.
    type Machine: Machine;
    /// The judge of accepted telegrams.
    type Judge: Judge;
    /// "Done" is confirmed by the partner: the telegram has been delivered before. Otherwise it means "the last bit has
    /// been sent".
    const ACKNOWLEDGED: bool;
    /// On a calm line: longest time from the end of an order to the delivery of its telegram.
    const GRACE: Span;

    /// The line without its faults, and the partners at its ends A and B.
    fn stage(rng: &mut SplitMix64) -> Stage<Self::Machine, Self::Judge>;

    /// The next telegram of the program at this end; `None`: it sends none of its own (a slave).
    fn telegram(rng: &mut SplitMix64, end: End) -> Option<Vec<u8>>;

    /// Maximum rate of each kind of fault, in characters per million; the seed draws a lower one.
    fn worst() -> FaultRates {
        FaultRates {
            flip: 3000,
            lose: 3000,
            double: 2000,
            delay: 1000,
            parity: 2000,
            framing: 1000,
            break_: 1000,
            delay_max: 250 * MS,
        }
    }

    /// A final check of the sum of all seeds.
    fn verdict(_sum: &Sum) {}
}

/// The starting point of a seed.
pub(crate) struct Stage<M, J> {
    pub(crate) sim: SimConfig,
    /// At the ends A and B.
    pub(crate) partners: [(M, J); 2],
    /// Longest pause of a program between the end of an order and the next.
    pub(crate) pause: Span,
    /// The CPU is slow to take one telegram in this many; 0: never.
    pub(crate) slow_one_in: u64,
}

/// Judges one partner from its inputs and outputs.
pub(crate) trait Judge {
    /// A readable character came in (`None`: one that could not be read).
    fn character(&mut self, now: Instant, character: Option<u8>);
    /// The machine put this on the line.
    fn transmitted(&mut self, _now: Instant, _bytes: &[u8]) {}
    /// All output of the machine has been sent.
    fn out(&mut self) {}
    /// Whether the machine may deliver this now.
    fn accepts(&mut self, now: Instant, telegram: &[u8]) -> bool;
}

/// The sum of conversations.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Sum {
    /// Orders done.
    pub(crate) done: u64,
    /// Orders ended with an error.
    pub(crate) failed: u64,
    /// Orders done whose telegram did not arrive whole, undetectable by the protocol's check.
    pub(crate) damaged: u64,
}

struct Station<D: Duet> {
    end: End,
    machine: D::Machine,
    deadline: Option<Instant>,
    next_order: Instant,
    books: Books<D::Judge>,
}

struct Books<J> {
    judge: J,
    rng: SplitMix64,
    /// The telegram of the running order.
    running: Option<Vec<u8>>,
    orders: u64,
    done: u64,
    failed: u64,
    damaged: u64,
    delivered: Vec<Vec<u8>>,
    /// Number of them before the partner's running order began.
    partner_mark: usize,
    /// Telegrams of orders done on a calm line, with the time of their end.
    calm: Vec<(Instant, Vec<u8>)>,
    slow_one_in: u64,
    /// When the CPU takes the last telegram.
    occupied_until: Instant,
    /// When it put its last DLE on the line, and its last block.
    last_dle: Instant,
    last_block: Instant,
    /// The order in this step ended.
    ended: Option<Result<(), SendError>>,
}

/// A machine's view of line and books during a step.
struct Port<'a, J> {
    line: &'a mut SimLine,
    end: End,
    now: Instant,
    books: &'a mut Books<J>,
    trace: bool,
}

impl<J> Port<'_, J> {
    fn trace(&self, what: std::fmt::Arguments<'_>) {
        if self.trace {
            println!("{:>12.3} ms {:?} {what}", self.now.since_start().as_millis_f64(), self.end);
        }
    }
}

impl<J: Judge> Wire for Port<'_, J> {
    fn transmit(&mut self, bytes: &[u8]) {
        self.trace(format_args!("tx {bytes:02X?}"));
        self.books.judge.transmitted(self.now, bytes);
        match bytes {
            [0x10] => self.books.last_dle = self.now,
            [_] => {}
            _ => self.books.last_block = self.now,
        }
        self.line.write(self.end, self.now, bytes);
    }

    fn take_back(&mut self) -> usize {
        self.line.take_back(self.end, self.now)
    }

    fn rts(&mut self, on: bool) {
        self.trace(format_args!("rts {on}"));
        self.line.set_rts(self.end, self.now, on);
    }
}

impl<J: Judge> Sink for Port<'_, J> {
    fn room(&self) -> usize {
        if self.now < self.books.occupied_until { 0 } else { 1024 }
    }

    fn deliver(&mut self, telegram: &[u8]) {
        self.trace(format_args!("got {telegram:02X?}"));
        assert!(!telegram.is_empty() && telegram.len() <= self.room(), "delivered without room");
        assert!(self.books.judge.accepts(self.now, telegram), "accepted what the check would have refused");
        self.books.delivered.push(telegram.to_vec());
        if self.now < FAULTY && self.books.rng.below(self.books.slow_one_in) + 1 == self.books.slow_one_in {
            self.books.occupied_until = self.now + self.books.rng.span_below(700 * MS);
        }
    }

    fn sent(&mut self, outcome: Result<(), SendError>) {
        self.trace(format_args!("sent {outcome:?}"));
        assert!(self.books.running.is_some(), "an order ended that was not running");
        assert!(self.books.ended.is_none(), "the order ended twice");
        self.books.ended = Some(outcome);
    }

    fn report(&mut self, event: Event) {
        self.trace(format_args!("{event:?}"));
    }
}

impl<D: Duet> Station<D> {
    fn new(end: End, (machine, judge): (D::Machine, D::Judge), slow_one_in: u64, seed: u64) -> Self {
        let books = Books {
            judge,
            rng: SplitMix64::new(seed),
            running: None,
            orders: 0,
            done: 0,
            failed: 0,
            damaged: 0,
            delivered: Vec::new(),
            partner_mark: 0,
            calm: Vec::new(),
            slow_one_in,
            occupied_until: Instant::START,
            last_dle: Instant::START,
            last_block: Instant::START,
            ended: None,
        };
        Self { end, machine, deadline: Some(Instant::START), next_order: Instant::START, books }
    }

    fn step(&mut self, now: Instant, input: Input<'_>, line: &mut SimLine, trace: bool) {
        match input {
            Input::Line(LineInput::Rx(bytes)) => bytes.iter().for_each(|b| self.books.judge.character(now, Some(*b))),
            Input::Line(LineInput::Fault(_)) => self.books.judge.character(now, None),
            Input::Line(LineInput::TxDone) => self.books.judge.out(),
            _ => {}
        }
        let mut port = Port { line, end: self.end, now, books: &mut self.books, trace };
        port.trace(format_args!("{input:02X?}"));
        self.deadline = self.machine.step(now, input, &mut port);
        let passed = !matches!(input, Input::Tick) || self.deadline.is_none_or(|at| at > now);
        assert!(passed, "the machine does not get past {now}");
        assert_eq!(
            self.machine.busy(),
            self.books.running.is_some() && self.books.ended.is_none(),
            "an order ended without a word, or runs on after its end"
        );
    }

    /// When the station will act by itself.
    fn next(&self, now: Instant) -> Option<Instant> {
        let order = self.books.running.is_none().then_some(self.next_order);
        let room = Some(self.books.occupied_until).filter(|at| *at > now);
        self.deadline.into_iter().chain(order).chain(room).min()
    }

    fn is_due(&self, now: Instant) -> bool {
        self.deadline.is_some_and(|at| at <= now) || self.books.occupied_until == now && now > Instant::START
    }
}

/// A whole conversation on a line that is at most as bad as `worst`.
fn run<D: Duet>(seed: u64, worst: FaultRates, trace: bool) -> Sum {
    let mut rng = SplitMix64::new(seed);
    let Stage { mut sim, partners: [a, b], pause, slow_one_in } = D::stage(&mut rng);
    let slow_one_in = if worst == FaultRates::NONE { 0 } else { slow_one_in };
    let mut rate = |most: u32| if rng.below(3) == 0 { 0 } else { rng.below(u64::from(most).max(1)) as u32 };
    sim.faults = FaultRates {
        flip: rate(worst.flip),
        lose: rate(worst.lose),
        double: rate(worst.double),
        delay: rate(worst.delay),
        parity: rate(worst.parity),
        framing: rate(worst.framing),
        break_: rate(worst.break_),
        delay_max: worst.delay_max,
    };
    sim.faults_until = FAULTY;
    let mut stations = [
        Station::<D>::new(End::A, a, slow_one_in, rng.next_u64()),
        Station::<D>::new(End::B, b, slow_one_in, rng.next_u64()),
    ];
    let mut line = SimLine::new(sim, rng.next_u64());
    let mut buffer = [0; 64];
    let end = FAULTY + SETTLE + CALM;
    let mut now = Instant::START;
    loop {
        let own = stations.iter().filter_map(|s| s.next(now)).min();
        let Some(next) = own.into_iter().chain(line.next_event()).min().filter(|next| *next < end) else { break };
        now = next.max(now);
        while let Some((end, event)) = line.pop(now, &mut buffer) {
            let input = match event {
                SimEvent::Rx(n) => Input::Line(LineInput::Rx(&buffer[..n])),
                SimEvent::TxDone => Input::Line(LineInput::TxDone),
                SimEvent::Fault(fault) => Input::Line(LineInput::Fault(fault)),
                SimEvent::Cts(cts) => Input::Line(LineInput::Modem(ModemLines { cts, ..ModemLines::default() })),
            };
            stations[end as usize].step(now, input, &mut line, trace);
            settle::<D>(&mut stations, end as usize, now, pause);
        }
        for n in 0..2 {
            if stations[n].is_due(now) {
                stations[n].step(now, Input::Tick, &mut line, trace);
                settle::<D>(&mut stations, n, now, pause);
            }
            if stations[n].books.running.is_none() && stations[n].next_order <= now {
                begin::<D>(&mut stations, n, now, &mut line, trace, pause);
            }
        }
    }
    let mut sum = Sum::default();
    for n in 0..2 {
        let (books, partner) = (&stations[n].books, &stations[1 - n].books);
        assert_eq!(books.orders, books.done + books.failed + u64::from(books.running.is_some()), "an order was lost");
        let mut arrived = partner.delivered.iter();
        for (at, telegram) in books.calm.iter().filter(|(at, _)| *at + D::GRACE < end) {
            let found = arrived.any(|got| got == telegram);
            assert!(found, "{:?}: done at {at} on a calm line and not delivered: {telegram:02X?}", stations[n].end);
        }
        let sends = stations[n].next_order != Instant::NEVER;
        assert!(!sends || books.calm.len() >= 3, "{:?} gets nothing through after the faults", stations[n].end);
        sum.done += books.done;
        sum.failed += books.failed;
        sum.damaged += books.damaged;
    }
    sum
}

/// Gives the next order of station `n`.
fn begin<D: Duet>(
    stations: &mut [Station<D>; 2],
    n: usize,
    now: Instant,
    line: &mut SimLine,
    trace: bool,
    pause: Span,
) {
    let end = stations[n].end;
    let Some(data) = D::telegram(&mut stations[n].books.rng, end) else {
        stations[n].next_order = Instant::NEVER;
        return;
    };
    stations[n].books.orders += 1;
    stations[n].books.running = Some(data.clone());
    let partner = &mut stations[1 - n].books;
    partner.partner_mark = partner.delivered.len();
    stations[n].step(now, Input::Order(Order::Send(&data)), line, trace);
    settle::<D>(stations, n, now, pause);
}

/// Books the end of an order.
fn settle<D: Duet>(stations: &mut [Station<D>; 2], n: usize, now: Instant, pause: Span) {
    let Some(outcome) = stations[n].books.ended.take() else { return };
    let Some(data) = stations[n].books.running.take() else { return };
    let partner = &stations[1 - n].books;
    match outcome {
        Ok(()) => {
            let arrived = &partner.delivered[partner.partner_mark..];
            let whole = arrived.contains(&data);
            if D::ACKNOWLEDGED {
                // A late DLE sent before our block cannot be distinguished from the acknowledgement.
                let is_late = partner.last_dle <= stations[n].books.last_block && now < FAULTY + SETTLE;
                assert!(!arrived.is_empty() || is_late, "reported done and not delivered");
                assert!(whole || now < FAULTY + SETTLE, "damaged on a calm line");
                stations[n].books.damaged += u64::from(!whole);
            }
            stations[n].books.done += 1;
            if now > FAULTY + SETTLE {
                stations[n].books.calm.push((now, data));
            }
        }
        Err(error) => {
            assert!(now <= FAULTY + SETTLE, "{:?} fails with {error:?} on a calm line", stations[n].end);
            stations[n].books.failed += 1;
        }
    }
    stations[n].next_order = now + stations[n].books.rng.span_below(pause);
}

/// The kept seeds of a test: lines `TEST NUMBER` in `tests/seeds/*.txt`, with a comment after `#`.
fn kept_seeds(test: &str) -> Vec<u64> {
    let mut files: Vec<_> = std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/seeds"))
        .expect("the directory of kept seeds")
        .map(|entry| entry.expect("a directory entry").path())
        .filter(|path| path.extension().is_some_and(|ext| ext == "txt"))
        .collect();
    files.sort();
    let mut seeds = Vec::new();
    for file in files {
        for line in std::fs::read_to_string(&file).expect("a file of seeds").lines() {
            let line = line.split('#').next().unwrap_or("").trim();
            let Some((name, number)) = line.rsplit_once(' ') else {
                assert!(line.is_empty(), "{}: `{line}` is not `TEST NUMBER`", file.display());
                continue;
            };
            let number = number.parse();
            let number = number.unwrap_or_else(|_| panic!("{}: `{line}` is not `TEST NUMBER`", file.display()));
            if name.trim() == test {
                seeds.push(number);
            }
        }
    }
    seeds
}

pub(crate) fn environment(name: &str) -> Option<u64> {
    std::env::var(name).ok().and_then(|text| text.parse().ok())
}

/// The seeds of a run: those that are kept first, then 1, 2, 3, ...; in a part of a campaign (`--part`) only others.
pub(crate) fn seeds(test: &str) -> impl Iterator<Item = u64> {
    let part = std::env::var("OB1_PART").ok();
    let number = part.as_ref().and_then(|part| part.split_once('/')?.0.parse::<u64>().ok()).unwrap_or(1);
    let kept = if number == 1 { kept_seeds(test) } else { Vec::new() };
    kept.into_iter().chain(((number - 1) << 32) + 1..)
}

/// The words for a seed that failed.
pub(crate) fn failure(test: &str, seed: u64) -> String {
    format!(
        "seed {seed} failed (see above). Replay it with\n    OB1_SEED={seed} cargo test -p ob1-protocols --test protocols \
         {test} -- --nocapture\nand keep it in driver/protocols/tests/seeds/ as `{test} {seed}`"
    )
}

/// Runs the seeds of a duet.
pub(crate) fn check<D: Duet>() {
    if let Some(seed) = environment("OB1_SEED") {
        println!("seed {seed}: {:?}", run::<D>(seed, D::worst(), true));
        return;
    }
    let wanted = environment("OB1_TELEGRAMS").unwrap_or(20_000);
    let mut sum = Sum::default();
    let mut conversations = 0_u64;
    for seed in seeds(D::TEST) {
        let Ok(result) = catch_unwind(AssertUnwindSafe(|| run::<D>(seed, D::worst(), false))) else {
            panic!("{}", failure(D::TEST, seed));
        };
        sum.done += result.done;
        sum.failed += result.failed;
        sum.damaged += result.damaged;
        conversations += 1;
        if sum.done + sum.failed >= wanted {
            break;
        }
        assert!(conversations * 3 <= sum.done + sum.failed, "telegrams hardly ever end");
    }
    println!("{}: {conversations} conversations, {sum:?}", D::TEST);
    // The test is meaningful: most telegrams arrive.
    assert!(sum.done > sum.failed, "{sum:?}");
    D::verdict(&sum);
}

/// Without faults and with a CPU that takes everything at once nothing fails, everything arrives whole, and the same
/// seed gives the same conversation.
pub(crate) fn check_clean<D: Duet>() {
    for seed in 1..=3 {
        let sum = run::<D>(seed, FaultRates::NONE, false);
        assert!(sum.done > 100 && sum.failed == 0 && sum.damaged == 0, "seed {seed}: {sum:?}");
        assert_eq!(sum, run::<D>(seed, FaultRates::NONE, false), "seed {seed} twice");
    }
}
