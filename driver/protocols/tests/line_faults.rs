//! Two 3964(R) machines on a simulated line with faults: two CP 240 with and without block check, a CP 341 and a CP 240. What must hold, whatever the line does:
//!
//! * every order ends exactly once, done or with an error;
//! * a telegram is delivered only if its block, as it came off the line, passes the check (computed here independently);
//! * what is reported done has been delivered (damaged, if two errors cancel out in the XOR of the check character: such
//!   collisions are told from mistakes by the independent check, and counted);
//! * when the faults have stopped, telegrams get through in bounded time, in both directions, and whole.
//!
//! The seeds of `tests/seeds/*.txt` run first, then `OB1_SEEDS` more (default 40). A seed that fails is named together
//! with the command that replays it; `OB1_SEED=n` runs that one alone and prints what happens on the line.

#![allow(clippy::disallowed_methods)] // A test reads its seeds and its environment.

use std::panic::{AssertUnwindSafe, catch_unwind};

use ob1_line::sim::{End, FaultRates, SimConfig, SimEvent, SimLine, SplitMix64};
use ob1_protocols::s3964::{Config, Priority, S3964};
use ob1_protocols::{Event, Input, LineFault, MS, Machine, Nanos, Order, SECOND, SendError, Sink};

/// Virtual time with faults.
const FAULTY: Nanos = 30 * SECOND;
/// After the faults: an order that was running may still fail in this time.
const SETTLE: Nanos = 10 * SECOND;
/// After that: orders must go through.
const CALM: Nanos = 5 * SECOND;

/// One station: its machine, its program, its books.
struct Station {
    end: End,
    machine: S3964,
    deadline: Option<Nanos>,
    next_order: Nanos,
    books: Books,
}

struct Books {
    rng: SplitMix64,
    bcc: bool,
    /// The telegram of the running order.
    running: Option<Vec<u8>>,
    orders: u32,
    done: u32,
    failed: u32,
    /// Orders done whose telegram arrived damaged past the check.
    collisions: u32,
    /// Telegrams delivered here.
    delivered: Vec<Vec<u8>>,
    /// Of those: how many before the partner's running order began.
    partner_mark: usize,
    /// Characters that came in since our last DLE; `None` in the place of an unreadable one.
    raw: Vec<Option<u8>>,
    /// The same for the block that our last DLE acknowledged.
    block: Vec<Option<u8>>,
    /// The CPU is slow with one telegram in so many; 0: never.
    slow_one_in: u64,
    /// The CPU has not taken the last telegram before this.
    occupied_until: Nanos,
    /// The order in this step ended.
    ended: Option<Result<(), SendError>>,
}

/// A machine's view of line and books during a step.
struct Port<'a> {
    line: &'a mut SimLine,
    end: End,
    now: Nanos,
    books: &'a mut Books,
    trace: bool,
}

impl Port<'_> {
    fn trace(&self, what: std::fmt::Arguments<'_>) {
        if self.trace {
            println!("{:>12.3} ms {:?} {what}", self.now as f64 / MS as f64, self.end);
        }
    }
}

impl Sink for Port<'_> {
    fn transmit(&mut self, bytes: &[u8]) {
        self.trace(format_args!("tx {bytes:02X?}"));
        if bytes.contains(&0x10) && bytes.len() == 1 {
            self.books.block = std::mem::take(&mut self.books.raw);
        }
        self.line.write(self.end, self.now, bytes);
    }

    fn take_back(&mut self) -> usize {
        self.line.take_back(self.end, self.now)
    }

    fn room(&self) -> usize {
        if self.now < self.books.occupied_until { 0 } else { 1024 }
    }

    fn deliver(&mut self, telegram: &[u8]) {
        self.trace(format_args!("got {} bytes", telegram.len()));
        let checked = checked(&self.books.block, self.books.bcc);
        assert_eq!(checked.as_deref(), Some(telegram), "accepted what the check would have refused");
        self.books.delivered.push(telegram.to_vec());
        if self.now < FAULTY && self.books.rng.below(self.books.slow_one_in) + 1 == self.books.slow_one_in {
            self.books.occupied_until = self.now + self.books.rng.below(700 * MS);
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

/// The user data of a block as it came off the line, if everything is right with it. Written from the text of the
/// procedure, not with the codec under test.
fn checked(raw: &[Option<u8>], bcc: bool) -> Option<Vec<u8>> {
    let mut raw: Vec<u8> = raw.iter().copied().collect::<Option<_>>()?;
    if bcc && raw.pop()? != raw.iter().fold(0, |a, b| a ^ b) {
        return None;
    }
    let data = raw.strip_suffix(&[0x10, 0x03])?;
    let mut plain = Vec::new();
    let mut bytes = data.iter();
    while let Some(byte) = bytes.next() {
        if *byte == 0x10 && bytes.next() != Some(&0x10) {
            return None;
        }
        plain.push(*byte);
    }
    Some(plain)
}

fn telegram(rng: &mut SplitMix64) -> Vec<u8> {
    let len = 1 + rng.below(250);
    let special = rng.below(3) == 0;
    (0..len)
        .map(|_| match rng.below(4) {
            0 if special => [0x02, 0x03, 0x10, 0x15][rng.below(4) as usize],
            _ => rng.next_u64() as u8,
        })
        .collect()
}

impl Station {
    fn new(end: End, config: Config, seed: u64) -> Self {
        let books = Books {
            rng: SplitMix64::new(seed),
            bcc: config.bcc,
            running: None,
            orders: 0,
            done: 0,
            failed: 0,
            collisions: 0,
            delivered: Vec::new(),
            partner_mark: 0,
            raw: Vec::new(),
            block: Vec::new(),
            slow_one_in: 10,
            occupied_until: 0,
            ended: None,
        };
        Self { end, machine: S3964::new(config), deadline: Some(0), next_order: 0, books }
    }

    fn step(&mut self, now: Nanos, input: Input<'_>, line: &mut SimLine, trace: bool) {
        match input {
            Input::Rx(bytes) => self.books.raw.extend(bytes.iter().map(|b| Some(*b))),
            Input::LineFault(_) => self.books.raw.push(None),
            _ => {}
        }
        let mut port = Port { line, end: self.end, now, books: &mut self.books, trace };
        port.trace(format_args!("{input:02X?}"));
        self.deadline = self.machine.step(now, input, &mut port);
        let passed = !matches!(input, Input::Tick) || self.deadline.is_none_or(|at| at > now);
        assert!(passed, "the machine does not get past {now}");
    }

    /// When the station wants to do something by itself.
    fn next(&self) -> Option<Nanos> {
        let order = self.books.running.is_none().then_some(self.next_order);
        self.deadline.into_iter().chain(order).min()
    }
}

/// The sum of a conversation.
#[derive(Default)]
struct Sum {
    done: u32,
    failed: u32,
    collisions: u32,
}

/// A whole conversation.
fn run(seed: u64, trace: bool) -> Sum {
    let mut rng = SplitMix64::new(seed);
    let bauds = [9600, 19_200, 115_200];
    let mut sim = SimConfig::new(bauds[rng.below(3) as usize], 22);
    let mut rate = |most: u64| if rng.below(3) == 0 { 0 } else { rng.below(most) as u32 };
    sim.faults = FaultRates {
        flip: rate(3000),
        lose: rate(3000),
        double: rate(2000),
        delay: rate(1000),
        parity: rate(2000),
        framing: rate(1000),
        break_: rate(1000),
        delay_max: 250 * MS,
    };
    sim.faults_until = FAULTY;
    let bcc = rng.below(4) != 0;
    let low = Config::cp240(bcc, sim.char_time);
    let high = match rng.below(3) {
        0 => Config::cp341(bcc, sim.char_time),
        _ => Config { priority: Priority::High, ..low.clone() },
    };
    let mut stations = [Station::new(End::A, high, rng.next_u64()), Station::new(End::B, low, rng.next_u64())];
    let mut line = SimLine::new(sim, rng.next_u64());
    let mut buffer = [0; 64];
    let mut calm_done = [0; 2];
    let end = FAULTY + SETTLE + CALM;
    loop {
        let own = stations.iter().filter_map(Station::next).min();
        let Some(now) = own.into_iter().chain(line.next_event()).min().filter(|now| *now < end) else { break };
        while let Some((end, event)) = line.pop(now, &mut buffer) {
            let input = match event {
                SimEvent::Rx(n) => Input::Rx(&buffer[..n]),
                SimEvent::TxDone => Input::TxDone,
                SimEvent::Fault(ob1_line::LineFault::Parity) => Input::LineFault(LineFault::Parity),
                SimEvent::Fault(ob1_line::LineFault::Framing) => Input::LineFault(LineFault::Framing),
                SimEvent::Fault(_) => Input::LineFault(LineFault::Break),
                SimEvent::Cts(_) => continue,
            };
            stations[end as usize].step(now, input, &mut line, trace);
            settle(&mut stations, end as usize, now, &mut calm_done);
        }
        for n in 0..2 {
            if stations[n].deadline.is_some_and(|at| at <= now) {
                stations[n].step(now, Input::Tick, &mut line, trace);
                settle(&mut stations, n, now, &mut calm_done);
            }
            if stations[n].books.running.is_none() && stations[n].next_order <= now {
                let data = telegram(&mut stations[n].books.rng);
                stations[n].books.orders += 1;
                stations[n].books.running = Some(data.clone());
                let partner = &mut stations[1 - n].books;
                partner.partner_mark = partner.delivered.len();
                stations[n].step(now, Input::Order(Order::Send(&data)), &mut line, trace);
                settle(&mut stations, n, now, &mut calm_done);
            }
        }
    }
    let mut result = Sum::default();
    for station in &stations {
        let books = &station.books;
        assert_eq!(books.orders, books.done + books.failed + u32::from(books.running.is_some()), "an order was lost");
        assert_eq!(books.running.is_some(), station.machine.busy(), "an order ended without a word");
        assert!(calm_done[station.end as usize] >= 3, "{:?} gets nothing through after the faults", station.end);
        result.done += books.done;
        result.failed += books.failed;
        result.collisions += books.collisions;
    }
    result
}

/// Books the end of an order.
fn settle(stations: &mut [Station; 2], n: usize, now: Nanos, calm_done: &mut [u32; 2]) {
    let Some(outcome) = stations[n].books.ended.take() else { return };
    let Some(data) = stations[n].books.running.take() else { return };
    let partner = &stations[1 - n].books;
    match outcome {
        Ok(()) => {
            let arrived = &partner.delivered[partner.partner_mark..];
            assert!(!arrived.is_empty(), "reported done and not delivered");
            let whole = arrived.contains(&data);
            assert!(whole || now < FAULTY + SETTLE, "damaged on a calm line");
            stations[n].books.collisions += u32::from(!whole && stations[n].books.bcc);
            stations[n].books.done += 1;
            calm_done[n] += u32::from(now > FAULTY + SETTLE);
        }
        Err(error) => {
            assert!(now <= FAULTY + SETTLE, "{:?} fails with {error:?} on a calm line", stations[n].end);
            stations[n].books.failed += 1;
        }
    }
    stations[n].next_order = now + stations[n].books.rng.below(30 * MS);
}

/// The kept seeds: `seed NUMBER`, with a remark behind `#`.
fn kept_seeds() -> Vec<u64> {
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
            if !line.is_empty() {
                let number = line.strip_prefix("seed ").and_then(|n| n.parse().ok());
                seeds.push(number.unwrap_or_else(|| panic!("{}: `{line}` is not `seed NUMBER`", file.display())));
            }
        }
    }
    seeds
}

#[test]
fn telegrams_survive_a_bad_line() {
    if let Some(seed) = std::env::var("OB1_SEED").ok().and_then(|s| s.parse().ok()) {
        let result = run(seed, true);
        println!("seed {seed}: {} done, {} failed", result.done, result.failed);
        return;
    }
    let count = std::env::var("OB1_SEEDS").ok().and_then(|s| s.parse().ok()).unwrap_or(40);
    let mut sum = Sum::default();
    for seed in kept_seeds().into_iter().chain(1..=count) {
        let Ok(result) = catch_unwind(AssertUnwindSafe(|| run(seed, false))) else {
            panic!(
                "seed {seed} failed (see above). Replay it with\n    OB1_SEED={seed} cargo test -p ob1-protocols --test \
                 line_faults -- --nocapture\nand keep it in driver/protocols/tests/seeds/"
            );
        };
        sum.done += result.done;
        sum.failed += result.failed;
        sum.collisions += result.collisions;
    }
    let Sum { done, failed, collisions } = sum;
    println!("{done} telegrams done, {failed} failed with an error, {collisions} damaged past the check character");
    // The test tests something: most telegrams come through, and the faults do hurt.
    assert!(u64::from(done) > 50 * count && failed > 0, "{done} done, {failed} failed");
    assert!(collisions * 100 < done, "{collisions} of {done} damaged: more than the check character lets through");
}

/// Without faults nothing fails, nothing is repeated, and the same seed is the same conversation.
#[test]
fn a_clean_line_loses_nothing() {
    for (bcc, baud) in [(true, 115_200), (false, 9600)] {
        let sim = SimConfig::new(baud, 20);
        let config = Config { priority: Priority::High, ..Config::cp240(bcc, sim.char_time) };
        let mut a = Station::new(End::A, config, 1);
        let mut b = Station::new(End::B, Config::cp240(bcc, sim.char_time), 2);
        b.books.slow_one_in = 0;
        let mut line = SimLine::new(sim, 0);
        let mut buffer = [0; 64];
        for n in 0..200 {
            let data = telegram(&mut a.books.rng);
            a.books.running = Some(data.clone());
            let mut now = a.next_order;
            if n == 0 {
                a.step(now, Input::Tick, &mut line, false);
                b.step(now, Input::Tick, &mut line, false);
            }
            a.step(now, Input::Order(Order::Send(&data)), &mut line, false);
            while let Some(at) = line.next_event() {
                now = at;
                while let Some((end, event)) = line.pop(now, &mut buffer) {
                    let input = match event {
                        SimEvent::Rx(n) => Input::Rx(&buffer[..n]),
                        _ => Input::TxDone,
                    };
                    let station = if end == End::A { &mut a } else { &mut b };
                    station.step(now, input, &mut line, false);
                }
            }
            assert_eq!(a.books.ended.take(), Some(Ok(())));
            a.books.running = None;
            assert_eq!(b.books.delivered.len(), n + 1);
            assert_eq!(b.books.delivered.last(), Some(&data));
            a.next_order = now + MS;
        }
    }
}
