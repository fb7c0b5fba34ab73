//! Two RK 512 machines back to back on a bad line, in virtual time: CP 240 and CP 240, CP 341 and CP 240, on 3964R and
//! on 3964.
//!
//! Both programs give orders at the same time (SEND and FETCH, 1 to 512 words), answer the partner's, sometimes late
//! and sometimes with a refusal. Invariants, whatever the line does:
//!
//! * every order ends exactly once, done or with an error; so does every order of the partner that was passed to the
//!   CPU;
//! * nothing is passed to the CPU, and no data of a FETCH are handed over, that do not follow from the telegrams as
//!   they came from the line: they are decoded and assembled here, from the text, not with the code under test;
//! * an order reported as done was done: the partner's CPU has taken or given these data;
//! * when the faults are over, every order succeeds, in both directions, and completely.
//!
//! The decoder here distinguishes damage that the check cannot detect (two errors that cancel out in the block check
//! character; without one, any) from mistakes, and counts it. Seeds as in `pair`: the kept ones, then 1, 2, 3, ...
//! until `OB1_TELEGRAMS` orders have ended; `OB1_SEED=n` runs one alone and prints what happens.

#![allow(clippy::disallowed_methods)] // A test reads its seeds and its environment.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};

use ob1_fakes::sim_line::{End, SimConfig, SimEvent, SimLine};
use ob1_line::sim::{FaultRates, SplitMix64};
use ob1_protocols::rk512::{
    Answer, AnswerError, Area, Command, Config, Coordination, Event, Input, Order, OrderError, Owner, Request, Rk512,
};
use ob1_protocols::s3964::{self, Priority};
use ob1_protocols::{Instant, LineInput, MS, SECOND, Span, Wire};

use crate::defaults;
use crate::pair::{environment, failure, seeds};
use crate::s3964_frame::{Incoming, checked};

/// Name of the test: for the replay command and the kept seeds.
const TEST: &str = "faults_rk512::orders_survive_a_bad_line";
/// Virtual time with faults.
const FAULTY: Instant = Instant::from_secs(30);
/// After the faults: disturbed orders may still fail in this time. A CP 341 waits 20 s for the partner to continue.
const SETTLE: Span = Span::from_secs(45);
/// After that: orders must succeed.
const CALM: Span = Span::from_secs(8);

type Machine = Rk512<4096>;

struct Station {
    end: End,
    machine: Machine,
    deadline: Option<Instant>,
    next_order: Instant,
    books: Books,
}

struct Books {
    rng: SplitMix64,
    bcc: bool,
    /// The running order, with the data of a SEND.
    running: Option<(Request, Vec<u8>)>,
    orders: u64,
    done: u64,
    failed: u64,
    damaged: u64,
    /// Orders done whose data did not arrive although no telegram was corrupted, with the time of their end.
    untrue: Vec<(Instant, Request)>,
    calm: u64,
    incoming: Incoming,
    /// Complete telegrams from the line, each acknowledged by our DLE.
    accepted: Vec<Vec<u8>>,
    /// Number of them before our running order began.
    order_mark: usize,
    /// Number of them compared with the partner's sent telegrams.
    held: usize,
    /// Number of them that the partner has never sent: corrupted without the check detecting it.
    spoilt: u64,
    /// Corrupted telegrams at both ends when our running order began.
    spoilt_mark: u64,
    /// Corrupted telegrams at this end when our running order began.
    order_spoilt: u64,
    /// Corrupted telegrams at this end when the CPU was last asked.
    question_spoilt: u64,
    /// Characters of the block being sent.
    leaving: Vec<Option<u8>>,
    /// Telegrams that have been sent.
    sent: VecDeque<Vec<u8>>,
    /// The partner's order that the CPU has, and when it answers.
    question: Option<(Instant, Request)>,
    /// The data the CPU has taken or given, for each answer.
    served: VecDeque<(Request, Vec<u8>)>,
    /// How the running order ended in this step.
    ended: Option<Result<Vec<u8>, OrderError>>,
}

struct Port<'a> {
    line: &'a mut SimLine,
    end: End,
    now: Instant,
    books: &'a mut Books,
    trace: bool,
}

impl Port<'_> {
    fn trace(&self, what: std::fmt::Arguments<'_>) {
        if self.trace {
            println!("{:>12.3} ms {:?} {what}", self.now.since_start().as_millis_f64(), self.end);
        }
    }
}

impl Wire for Port<'_> {
    fn transmit(&mut self, bytes: &[u8]) {
        self.trace(format_args!("tx {bytes:02X?}"));
        if let Some(block) = self.books.incoming.transmitted(bytes) {
            self.books.accepted.extend(checked(&block, self.books.bcc));
        }
        self.books.put_down_sent(bytes);
        self.line.write(self.end, self.now, bytes);
    }

    fn take_back(&mut self) -> usize {
        self.line.take_back(self.end, self.now)
    }
}

impl Owner for Port<'_> {
    fn ended(&mut self, outcome: Result<&[u8], OrderError>) {
        self.trace(format_args!("ended {outcome:02X?}"));
        assert!(self.books.ended.is_none(), "the order ended twice");
        let (request, _) = self.books.running.as_ref().expect("an order ended that was not running");
        if let Ok(data) = outcome {
            let telegrams = &self.books.accepted[self.books.order_mark..];
            let data = (request.command == Command::Fetch).then_some(data);
            let certain = self.books.spoilt == self.books.order_spoilt;
            assert!(reactions_say(telegrams, data, certain), "done without the partner's word");
        }
        self.books.ended = Some(outcome.map(<[u8]>::to_vec));
    }

    fn asked(&mut self, request: &Request, data: &[u8]) {
        self.trace(format_args!("asked {request:?} {data:02X?}"));
        assert!(self.books.question.is_none(), "a second question before the first is over");
        let certain = self.books.spoilt == self.books.question_spoilt;
        self.books.question_spoilt = self.books.spoilt;
        assert!(telegrams_say(&self.books.accepted, request, data, certain), "not what came off the line");
        let patience = match self.books.rng.below(40) {
            0 if self.now < FAULTY => 12 * SECOND,
            1..4 if self.now < FAULTY => 700 * MS,
            _ => 20 * MS,
        };
        let at = self.now + self.books.rng.span_below(patience);
        self.books.question = Some((at, *request));
        if request.command == Command::Send {
            self.books.served.push_back((*request, data.to_vec()));
        }
    }

    fn answered(&mut self, outcome: Result<(), AnswerError>) {
        self.trace(format_args!("answered {outcome:?}"));
        let late = self.books.question.take().is_some();
        assert!(!late || outcome.is_err(), "answered before the CPU has");
    }

    fn report(&mut self, event: Event) {
        self.trace(format_args!("{event:?}"));
    }
}

impl Books {
    /// Records sent telegrams.
    fn put_down_sent(&mut self, bytes: &[u8]) {
        match bytes {
            [0x02] => return self.leaving.clear(),
            [0x10 | 0x15] if self.leaving.is_empty() => return,
            _ => self.leaving.extend(bytes.iter().map(|b| Some(*b))),
        }
        if let Some(telegram) = checked(&self.leaving, self.bcc) {
            self.leaving.clear();
            self.sent.push_back(telegram);
            if self.sent.len() > 30 {
                self.sent.pop_front();
            }
        }
    }

    /// Compares accepted telegrams with the partner's sent ones.
    fn hold_against(&mut self, partner: &Self) {
        let new = &self.accepted[self.held..];
        self.spoilt += new.iter().filter(|telegram| !partner.sent.contains(telegram)).count() as u64;
        self.held = self.accepted.len();
    }
}

/// Whether these pieces, in order, form the data. A piece that equals the previous one may be a repetition of it. If
/// there was undetected corruption (`certain` is false), one of two consecutive pieces may be a corrupted repetition,
/// even of another length.
fn put_together<'a>(pieces: impl Iterator<Item = &'a [u8]>, data: &[u8], certain: bool) -> bool {
    // All lengths the data may have after each piece.
    let mut lengths = vec![0];
    let mut before: Option<&[u8]> = None;
    for piece in pieces {
        let same = before.is_some_and(|before| !certain || before == piece);
        let again = if same { lengths.clone() } else { Vec::new() };
        lengths.retain(|at| data.get(*at..*at + piece.len()) == Some(piece));
        lengths.iter_mut().for_each(|at| *at += piece.len());
        lengths.extend(again);
        lengths.sort_unstable();
        lengths.dedup();
        before = Some(piece);
    }
    lengths.contains(&data.len())
}

/// Whether the last telegrams from the line form this order.
fn telegrams_say(accepted: &[Vec<u8>], request: &Request, data: &[u8], certain: bool) -> bool {
    let header = request.header();
    let letters = &header[2..4];
    let Some(begin) = accepted.iter().rposition(|t| t.starts_with(&header)) else { return false };
    // The same first telegram may have come more than once.
    let first = &accepted[begin][10..];
    let follow = accepted[begin + 1..].iter().filter(|t| t.starts_with(&[0xFF, 0]) && t[2..].starts_with(letters));
    put_together(std::iter::once(first).chain(follow.map(|t| &t[4..])), data, certain)
}

/// Whether the reactions from the line mean "done" and, for a FETCH, contain these data.
fn reactions_say(accepted: &[Vec<u8>], data: Option<&[u8]>, certain: bool) -> bool {
    let good = |t: &&Vec<u8>| matches!(t[..], [0x00 | 0xFF, 0, 0, 0, ..]);
    let reactions: Vec<_> = accepted.iter().filter(good).collect();
    let last_is_one = accepted.last().is_some_and(|t| good(&t));
    // Reactions to earlier orders may have come first.
    let fits = |from: usize, data| put_together(reactions[from..].iter().map(|t| &t[4..]), data, certain);
    last_is_one && data.is_none_or(|data| (0..reactions.len()).any(|from| fits(from, data)))
}

impl Station {
    fn new(end: End, config: Config, seed: u64) -> Self {
        let books = Books {
            rng: SplitMix64::new(seed),
            bcc: config.line.bcc,
            running: None,
            orders: 0,
            done: 0,
            failed: 0,
            damaged: 0,
            untrue: Vec::new(),
            calm: 0,
            incoming: Incoming::default(),
            accepted: Vec::new(),
            order_mark: 0,
            held: 0,
            spoilt: 0,
            spoilt_mark: 0,
            order_spoilt: 0,
            question_spoilt: 0,
            leaving: Vec::new(),
            sent: VecDeque::new(),
            question: None,
            served: VecDeque::new(),
            ended: None,
        };
        Self { end, machine: Machine::new(config), deadline: Some(Instant::START), next_order: Instant::START, books }
    }

    fn step(&mut self, now: Instant, input: Input<'_>, line: &mut SimLine, trace: bool) {
        match input {
            // One at a time, so that an accepted telegram is recorded before it takes effect.
            Input::Line(LineInput::Rx(bytes)) if bytes.len() > 1 => {
                return bytes.iter().for_each(|b| self.step(now, Input::Line(LineInput::Rx(&[*b])), line, trace));
            }
            Input::Line(LineInput::Rx(bytes)) => self.books.incoming.push(Some(bytes[0])),
            Input::Line(LineInput::Fault(_)) => self.books.incoming.push(None),
            Input::Line(LineInput::TxDone) => self.books.incoming.out(),
            _ => {}
        }
        let mut port = Port { line, end: self.end, now, books: &mut self.books, trace };
        if !matches!(input, Input::Order(_)) {
            port.trace(format_args!("{input:02X?}"));
        }
        self.deadline = self.machine.step(now, input, &mut port);
        let passed = !matches!(input, Input::Tick) || self.deadline.is_none_or(|at| at > now);
        assert!(passed, "the machine does not get past {now}");
        let running = self.books.running.is_some() && self.books.ended.is_none();
        assert_eq!(self.machine.busy(), running, "an order ended without a word, or runs on after its end");
    }

    fn next(&self) -> Option<Instant> {
        let order = self.books.running.is_none().then_some(self.next_order);
        let answer = self.books.question.map(|(at, _)| at);
        self.deadline.into_iter().chain(order).chain(answer).min()
    }

    /// The CPU answers the partner's order.
    fn answer(&mut self, now: Instant, line: &mut SimLine, trace: bool) {
        let Some((_, request)) = self.books.question.take_if(|(at, _)| *at <= now) else { return };
        let rng = &mut self.books.rng;
        if now < FAULTY && rng.below(20) == 0 {
            return self.step(now, Input::Order(Order::Answer(Answer::Refused(0x32))), line, trace);
        }
        match request.command {
            Command::Send => self.step(now, Input::Order(Order::Answer(Answer::Taken)), line, trace),
            Command::Fetch => {
                let data = random(rng, request.bytes());
                self.books.served.push_back((request, data.clone()));
                self.step(now, Input::Order(Order::Answer(Answer::Data(&data))), line, trace);
            }
        }
        if self.books.served.len() > 20 {
            self.books.served.pop_front();
        }
    }
}

fn random(rng: &mut SplitMix64, len: usize) -> Vec<u8> {
    let special = rng.below(3) == 0;
    (0..len)
        .map(|_| match rng.below(4) {
            0 if special => [0x02, 0x03, 0x10, 0x15][rng.below(4) as usize],
            _ => rng.next_u64() as u8,
        })
        .collect()
}

fn order(rng: &mut SplitMix64) -> (Request, Vec<u8>) {
    let words = [20, 80, 80, 200, 512][rng.below(5) as usize];
    let length = 1 + rng.below(words) as u16;
    let (command, area) = match rng.below(4) {
        0 | 1 => (Command::Send, Area::Db),
        2 => (Command::Fetch, Area::Db),
        _ => (Command::Fetch, Area::ALL[rng.below(7) as usize]),
    };
    let db = if matches!(area, Area::Db | Area::Dx) { 1 + rng.below(255) as u8 } else { 0 };
    let start = rng.below(256) as u8;
    let request = Request { command, area, db, start, length, coordination: Coordination::NONE };
    let data = if command == Command::Send { random(rng, request.bytes()) } else { Vec::new() };
    (request, data)
}

#[derive(Debug, Default, PartialEq, Eq)]
struct Sum {
    done: u64,
    failed: u64,
    /// Orders done whose data did not arrive whole because of undetected corruption.
    damaged: u64,
    /// Number of them on 3964R.
    damaged_bcc: u64,
}

/// A whole conversation.
fn run(seed: u64, faults: bool, trace: bool) -> Sum {
    let mut rng = SplitMix64::new(seed);
    let bauds = [19_200, 115_200, 115_200];
    let mut sim = SimConfig::new(bauds[rng.below(3) as usize], 22);
    let mut rate = |most: u64| if rng.below(3) == 0 || !faults { 0 } else { rng.below(most) as u32 };
    sim.faults = FaultRates {
        flip: rate(1500),
        lose: rate(1500),
        double: rate(1000),
        delay: rate(500),
        parity: rate(1000),
        framing: rate(500),
        break_: rate(500),
        delay_max: 250 * MS,
    };
    sim.faults_until = FAULTY;
    let bcc = rng.below(4) != 0;
    let low = Config::cp240(defaults::cp240(bcc, sim.char_time));
    let high = match rng.below(3) {
        0 => Config::cp341(defaults::cp341(bcc, sim.char_time)),
        _ => Config { line: s3964::Config { priority: Priority::High, ..low.line.clone() }, ..low.clone() },
    };
    let mut stations = [Station::new(End::A, high, rng.next_u64()), Station::new(End::B, low, rng.next_u64())];
    let mut line = SimLine::new(sim, rng.next_u64());
    let mut buffer = [0; 64];
    let end = FAULTY + SETTLE + CALM;
    let mut now = Instant::START;
    loop {
        let own = stations.iter().filter_map(Station::next).min();
        let Some(next) = own.into_iter().chain(line.next_event()).min().filter(|next| *next < end) else { break };
        now = next.max(now);
        while let Some((end, event)) = line.pop(now, &mut buffer) {
            let input = match event {
                SimEvent::Rx(n) => Input::Line(LineInput::Rx(&buffer[..n])),
                SimEvent::TxDone => Input::Line(LineInput::TxDone),
                SimEvent::Fault(fault) => Input::Line(LineInput::Fault(fault)),
                SimEvent::Cts(_) => continue,
            };
            stations[end as usize].step(now, input, &mut line, trace);
            settle(&mut stations, end as usize, now);
        }
        for n in 0..2 {
            let station = &mut stations[n];
            if station.deadline.is_some_and(|at| at <= now) {
                station.step(now, Input::Tick, &mut line, trace);
            }
            station.answer(now, &mut line, trace);
            settle(&mut stations, n, now);
            let station = &mut stations[n];
            // In the time that does not count there are few orders, so that the long run contains many faults.
            let quiet = (FAULTY + SECOND..FAULTY + SETTLE).contains(&now);
            if quiet {
                station.next_order = station.next_order.max(FAULTY + SETTLE + MS);
            } else if station.books.running.is_none() && station.next_order <= now {
                let (request, data) = order(&mut station.books.rng);
                station.books.orders += 1;
                station.books.running = Some((request, data.clone()));
                station.books.order_mark = station.books.accepted.len();
                stations[n].books.spoilt_mark = stations[0].books.spoilt + stations[1].books.spoilt;
                stations[n].books.order_spoilt = stations[n].books.spoilt;
                let station = &mut stations[n];
                if trace {
                    println!("{:>12.3} ms {:?} order {request:?}", now.since_start().as_millis_f64(), station.end);
                }
                station.step(now, Input::Order(Order::Start(request, &data)), &mut line, trace);
                settle(&mut stations, n, now);
            }
        }
    }
    let mut sum = Sum::default();
    for Station { books, end, .. } in &stations {
        assert_eq!(books.orders, books.done + books.failed + u64::from(books.running.is_some()), "an order was lost");
        assert!(books.calm >= 3, "{end:?} gets nothing through after the faults");
        sum.done += books.done;
        sum.failed += books.failed;
        sum.damaged += books.damaged;
        sum.damaged_bcc += if books.bcc { books.damaged } else { 0 };
        assert!(books.untrue.is_empty(), "{end:?}: reported done and was not: {:?}", books.untrue);
    }
    sum
}

/// Books the end of an order.
fn settle(stations: &mut [Station; 2], n: usize, now: Instant) {
    let [a, b] = stations;
    let (this, other) = if n == 0 { (a, b) } else { (b, a) };
    this.books.hold_against(&other.books);
    let spoilt = this.books.spoilt + other.books.spoilt;
    let Some(outcome) = stations[n].books.ended.take() else { return };
    let Some((request, data)) = stations[n].books.running.take() else { return };
    let partner = &stations[1 - n].books;
    match outcome {
        Ok(got) => {
            let data = if request.command == Command::Fetch { got } else { data };
            let whole = partner.served.iter().any(|(asked, served)| *asked == request && *served == data);
            assert!(whole || now < FAULTY + SETTLE, "damaged on a calm line");
            if !whole && spoilt > stations[n].books.spoilt_mark {
                stations[n].books.damaged += 1;
            } else if !whole {
                stations[n].books.untrue.push((now, request));
            }
            stations[n].books.done += 1;
            stations[n].books.calm += u64::from(now > FAULTY + SETTLE);
        }
        Err(error) => {
            assert!(now <= FAULTY + SETTLE, "{:?} fails with {error:?} on a calm line", stations[n].end);
            stations[n].books.failed += 1;
        }
    }
    let pause = [5 * MS, 5 * MS, 100 * MS][stations[n].books.rng.below(3) as usize];
    stations[n].next_order = now + stations[n].books.rng.span_below(pause);
}

#[test]
fn orders_survive_a_bad_line() {
    if let Some(seed) = environment("OB1_SEED") {
        println!("seed {seed}: {:?}", run(seed, true, true));
        return;
    }
    let wanted = environment("OB1_TELEGRAMS").unwrap_or(10_000);
    let (mut sum, mut conversations) = (Sum::default(), 0_u64);
    for seed in seeds(TEST) {
        let Ok(result) = catch_unwind(AssertUnwindSafe(|| run(seed, true, false))) else {
            panic!("{}", failure(TEST, seed));
        };
        sum.done += result.done;
        sum.failed += result.failed;
        sum.damaged += result.damaged;
        sum.damaged_bcc += result.damaged_bcc;
        conversations += 1;
        if sum.done + sum.failed >= wanted {
            break;
        }
        assert!(conversations * 3 <= sum.done + sum.failed, "orders hardly ever end");
    }
    println!("{TEST}: {conversations} conversations, {sum:?}");
    // The test is meaningful: most orders succeed, and the faults make some fail.
    assert!(sum.done > 3 * sum.failed && sum.failed > 0, "{sum:?}");
    assert!(sum.damaged_bcc * 500 < sum.done, "more than the check character lets through: {sum:?}");
}

/// Without faults only orders refused by the CPUs fail, everything arrives whole, and the same seed gives the same
/// conversation.
#[test]
fn a_clean_line_loses_nothing() {
    for seed in 1..=3 {
        let sum = run(seed, false, false);
        assert!(sum.done > 100 && sum.damaged == 0, "seed {seed}: {sum:?}");
        assert!(sum.failed * 5 < sum.done, "seed {seed}: {sum:?}");
        assert_eq!(sum, run(seed, false, false), "seed {seed} twice");
    }
}
