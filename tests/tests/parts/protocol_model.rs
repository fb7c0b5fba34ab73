//! A model of the protocol between the two processes of a CP: attach, post, take, acknowledge, restart, explored with
//! the death of either process after every access to the memory they share. The numbers are those of docs/driver.md;
//! 101 and 102 are what the runtime keeps itself.
//!
//! A step is one load or store of a word, and steps of all processes are interleaved in every way (sequential
//! consistency: what the fences must achieve is loom's to check, `backplane/segment/tests/loom.rs`). A word of data is
//! written in two halves, so that a torn content can be seen. The bounds: two orders and one death of a driver; one
//! order and two deaths; one order and a second driver at any time. In each the runtime dies once at any time, or not.
//!
//! What the model shows not to hold: a driver that somebody starts by hand just when the runtime's own has died, while
//! the runtime still clears its words. Two write then; docs/driver.md says so.

use stateright::{Checker as _, Model, Property};

/// Words of the segment.
#[derive(Clone, Copy)]
enum W {
    OutSequence,
    Out0,
    Out1,
    Changes,
    InSequence,
    In0,
    In1,
    Sleeping,
    Generation,
    State,
    Accepted,
    Sent,
    Lost,
}
const WORDS: usize = 13;
/// `cp.state`.
const ABSENT: u8 = 0;
const STARTING: u8 = 1;
const READY: u8 = 4;

/// The protocol with one rule broken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Break {
    Nothing,
    /// D4: no lock.
    NoLock,
    /// D6: the registers of the predecessor stay.
    NotCleared,
    /// D10: a write after an odd sequence ends with an odd one.
    StaysOdd,
    /// D11: open orders are not booked.
    NotBooked,
    /// D16: the generation stays.
    SameGeneration,
    /// D19: the content is written without its sequence.
    NoSequence,
    /// D21: an odd sequence is not looked at.
    TakesTorn,
    /// D25: end of file is overlooked.
    OutlivesRuntime,
    /// D35: it looks for changes before it says that it sleeps.
    LooksTooSoon,
    /// D42: it takes what it finds in the registers for an order.
    TakesOld,
    /// D46: an order goes out when it is taken, and again when it is complete.
    SendsTwice,
    /// 101: the runtime clears the registers before the state.
    ClearsFirst,
    /// 102: the runtime looks whether the driver is there before it reads the registers.
    AsksFirst,
}

/// A driver process; `pc` is its next step.
#[derive(Clone, Debug, Hash, PartialEq, Eq, Default)]
struct Driver {
    alive: bool,
    pc: u8,
    /// Sequence and halves that it copies, or the sequence of its write.
    a: u8,
    c0: u8,
    c1: u8,
    seen: u8,
    mark: u8,
    again: bool,
    /// The order that it has taken.
    order: u8,
    /// What it writes into its registers, and where it goes on then.
    shows: u8,
    then: u8,
    generation: u8,
}

#[derive(Clone, Debug, Hash, PartialEq, Eq)]
struct Whole {
    words: [u8; WORDS],
    bell: bool,
    runtime_alive: bool,
    lock: Option<u8>,
    drivers: [Driver; 2],
    /// The scan of the runtime: its step, the order, and its copies.
    scan: u8,
    order: u8,
    a: u8,
    c0: u8,
    c1: u8,
    is_present: bool,
    /// The generation to which the order was posted.
    posted_to: u8,
    failed: bool,
    /// The supervisor: 0 nothing to do, else its next step after a death.
    supervisor: u8,
    deaths: u8,
    second: bool,
    /// How often each order went onto the line.
    executed: [u8; 3],
    broken: u8,
}

#[derive(Clone, Debug, Hash, PartialEq, Eq)]
enum Step {
    Scan,
    Supervisor,
    Driver(u8),
    KillDriver,
    KillRuntime,
    Second,
}

struct Protocol {
    orders: u8,
    deaths: u8,
    second: bool,
    break_: Break,
}

impl Whole {
    fn get(&self, word: W) -> u8 {
        self.words[word as usize]
    }

    fn set(&mut self, word: W, to: u8) {
        self.words[word as usize] = to;
    }

    fn breaks(&mut self, rule: u8) {
        if self.broken == 0 {
            self.broken = rule;
        }
    }

    /// The order with the start-up that the CPU knows: for the acknowledgement of a start-up, before which a driver takes
    /// nothing.
    fn tagged(&self) -> u8 {
        self.order + 4 * self.posted_to
    }

    fn book_lost(&mut self) {
        let open = self.get(W::Accepted) - self.get(W::Sent) - self.get(W::Lost);
        self.set(W::Lost, self.get(W::Lost) + open);
    }
}

// Steps of a driver.
const LOCK: u8 = 0;
const CLEAR: u8 = 3;
const BOOK: u8 = 8;
const GENERATION: u8 = 9;
const LOOP: u8 = 11;
const SLEEP: u8 = 17;
const CHECK: u8 = 18;
const POLL: u8 = 19;
const AWAKE: u8 = 20;
const WRITE: u8 = 30;
const COMPLETE: u8 = 40;

impl Protocol {
    /// One step of a driver: one load or store.
    fn driver(&self, s: &mut Whole, me: u8) {
        let mut d = s.drivers[usize::from(me)].clone();
        d.pc = match d.pc {
            LOCK => {
                if s.lock.is_some() && self.break_ != Break::NoLock {
                    d.alive = false;
                }
                if d.alive {
                    if s.lock.is_some() {
                        s.breaks(4);
                    }
                    s.lock = Some(me);
                }
                1
            }
            1 => {
                s.set(W::Sleeping, 0);
                2
            }
            2 => {
                s.set(W::State, STARTING);
                CLEAR
            }
            CLEAR if self.break_ == Break::NotCleared => BOOK,
            CLEAR => {
                (d.shows, d.then) = (0, BOOK);
                WRITE
            }
            BOOK => {
                if self.break_ != Break::NotBooked {
                    s.book_lost();
                }
                GENERATION
            }
            GENERATION => {
                if s.get(W::In0) != 0 || s.get(W::In1) != 0 {
                    s.breaks(6);
                }
                if s.get(W::InSequence) % 2 == 1 {
                    s.breaks(10);
                }
                let before = s.get(W::Generation);
                if self.break_ != Break::SameGeneration {
                    s.set(W::Generation, before + 1);
                } else if before > 0 {
                    s.breaks(16);
                } else {
                    s.set(W::Generation, 1);
                }
                d.generation = s.get(W::Generation);
                10
            }
            10 => {
                s.set(W::State, READY);
                LOOP
            }
            LOOP => {
                if d.order == 0 && s.get(W::Accepted) != s.get(W::Sent) + s.get(W::Lost) {
                    s.breaks(11);
                }
                (d.mark, d.again) = (s.get(W::Changes), false);
                12
            }
            12 => {
                d.a = s.get(W::OutSequence);
                let is_odd = d.a % 2 == 1 && self.break_ != Break::TakesTorn;
                d.again = is_odd;
                if is_odd || d.a == d.seen { SLEEP } else { 13 }
            }
            13 => {
                d.c0 = s.get(W::Out0);
                14
            }
            14 => {
                d.c1 = s.get(W::Out1);
                15
            }
            15 => {
                let next = if s.get(W::OutSequence) == d.a {
                    self.take(s, &mut d)
                } else {
                    d.again = true;
                    SLEEP
                };
                (d.c0, d.c1) = (0, 0);
                next
            }
            SLEEP if self.break_ == Break::LooksTooSoon => {
                if s.get(W::Changes) == d.mark && !d.again { 21 } else { AWAKE }
            }
            21 => {
                s.set(W::Sleeping, 1);
                POLL
            }
            SLEEP => {
                s.set(W::Sleeping, 1);
                CHECK
            }
            CHECK => {
                if s.get(W::Changes) == d.mark && !d.again { POLL } else { AWAKE }
            }
            // Enabled when there is a byte or the end of the pipe.
            POLL => {
                s.bell = false;
                AWAKE
            }
            AWAKE => {
                s.set(W::Sleeping, 0);
                if !s.runtime_alive {
                    if self.break_ == Break::OutlivesRuntime {
                        s.breaks(25);
                    }
                    d.alive = false;
                    s.lock = None;
                }
                LOOP
            }
            // A write of the registers, under their sequence.
            WRITE => {
                d.a = s.get(W::InSequence);
                31
            }
            31 => {
                d.a = if d.a % 2 == 0 || self.break_ == Break::StaysOdd { d.a + 1 } else { d.a + 2 };
                if self.break_ != Break::NoSequence {
                    s.set(W::InSequence, d.a);
                }
                32
            }
            32 => {
                s.set(W::In0, d.shows);
                33
            }
            33 => {
                s.set(W::In1, std::mem::take(&mut d.shows));
                34
            }
            34 => {
                s.set(W::InSequence, d.a + 1);
                std::mem::take(&mut d.then)
            }
            // A complete order: taken over, onto the line, done.
            COMPLETE => {
                s.set(W::Accepted, s.get(W::Accepted) + 1);
                41
            }
            41 => {
                self.execute(s, &d);
                42
            }
            _ => {
                s.set(W::Sent, s.get(W::Sent) + 1);
                (d.order, d.shows, d.then) = (0, 0, SLEEP);
                WRITE
            }
        };
        // What is not read again makes no states.
        if !matches!(d.pc, 13..=15 | 31..=34) {
            d.a = 0;
        }
        s.drivers[usize::from(me)] = if d.alive { d } else { Driver::default() };
    }

    fn execute(&self, s: &mut Whole, d: &Driver) {
        let count = &mut s.executed[usize::from(d.order % 4)];
        *count += 1;
        if *count > 1 {
            s.breaks(46);
        }
        if s.posted_to != d.generation {
            s.breaks(42);
        }
    }

    /// The driver has a copy of the output registers.
    fn take(&self, s: &mut Whole, d: &mut Driver) -> u8 {
        if d.c0 != d.c1 {
            s.breaks(21);
        }
        (d.seen, d.shows, d.then) = (d.a, d.c0, SLEEP);
        match (d.c0, d.order) {
            (0, 0) => SLEEP,
            (order, 0) if order / 4 != d.generation && self.break_ != Break::TakesOld => SLEEP,
            (order, 0) => {
                d.order = order;
                if self.break_ == Break::SendsTwice {
                    self.execute(s, d);
                }
                WRITE
            }
            (0, _) => COMPLETE,
            _ => SLEEP,
        }
    }

    /// One step of the scan: it posts an order, waits for its echo, writes 0, waits for the end. Orders are numbered.
    fn scan(&self, s: &mut Whole) {
        let posts = s.scan < 10;
        s.scan = match s.scan {
            0 | 10 => {
                if posts {
                    (s.posted_to, s.failed) = (s.get(W::Generation), false);
                }
                s.set(W::OutSequence, s.get(W::OutSequence) + 1);
                s.scan + 1
            }
            1 | 11 => {
                s.set(W::Out0, if posts { s.tagged() } else { 0 });
                s.scan + 1
            }
            2 | 12 => {
                s.set(W::Out1, if posts { s.tagged() } else { 0 });
                s.scan + 1
            }
            3 | 13 => {
                s.set(W::OutSequence, s.get(W::OutSequence) + 1);
                s.scan + 1
            }
            4 | 14 => {
                s.set(W::Changes, s.get(W::Changes) + 1);
                s.scan + 1
            }
            5 | 15 => {
                if s.get(W::Sleeping) == 0 { if posts { 20 } else { 30 } } else { s.scan + 1 }
            }
            6 | 16 => {
                s.set(W::Sleeping, 0);
                s.scan + 1
            }
            7 | 17 => {
                s.bell = true;
                if posts { 20 } else { 30 }
            }
            20 | 30 => {
                if self.break_ == Break::AsksFirst {
                    s.is_present = s.get(W::State) == READY && s.get(W::Generation) == s.posted_to;
                }
                (s.c0, s.c1, s.a) = (0, 0, s.get(W::InSequence));
                if s.a % 2 == 1 { s.scan } else { s.scan + 1 }
            }
            21 | 31 => {
                s.c0 = s.get(W::In0);
                s.scan + 1
            }
            22 | 32 => {
                s.c1 = s.get(W::In1);
                s.scan + 1
            }
            23 | 33 => {
                if s.get(W::InSequence) == s.a {
                    if s.c0 != s.c1 {
                        s.breaks(19);
                    }
                    s.scan + 1
                } else {
                    s.scan - 3
                }
            }
            24 | 34 => {
                // The state, and then the generation: two loads in this order, of which only the first can be early.
                if self.break_ != Break::AsksFirst {
                    s.is_present = s.get(W::State) == READY;
                }
                s.scan + 1
            }
            25 => {
                s.failed |= s.get(W::Generation) != s.posted_to || !s.is_present;
                if s.failed || s.c0 == s.tagged() { 10 } else { 20 }
            }
            _ => {
                if self.break_ != Break::AsksFirst {
                    s.is_present &= s.get(W::Generation) == s.posted_to;
                }
                s.failed |= !s.is_present;
                if !s.failed && s.c0 != 0 {
                    30
                } else {
                    if !s.failed && s.executed[usize::from(s.order)] != 1 {
                        let rule = if self.break_ == Break::ClearsFirst { 101 } else { 102 };
                        s.breaks(rule);
                    }
                    // What was posted to no driver or to a dead one was not executed by its successor.
                    s.order += 1;
                    0
                }
            }
        };
        if !matches!(s.scan, 20..40) {
            (s.a, s.c0, s.c1, s.is_present) = (0, 0, 0, false);
        }
    }

    /// One step of the supervisor after a death: the words of the dead driver, and a new process.
    fn supervisor(&self, s: &mut Whole) {
        let state_first = self.break_ != Break::ClearsFirst;
        s.supervisor = match s.supervisor {
            1 => {
                if state_first {
                    s.set(W::State, ABSENT);
                }
                2
            }
            2 => {
                let before = s.get(W::InSequence);
                s.set(W::InSequence, if before % 2 == 0 { before + 1 } else { before + 2 });
                3
            }
            3 => {
                s.set(W::In0, 0);
                4
            }
            4 => {
                s.set(W::In1, 0);
                5
            }
            5 => {
                s.set(W::InSequence, s.get(W::InSequence) + 1);
                6
            }
            6 => {
                s.set(W::State, ABSENT);
                s.set(W::Sleeping, 0);
                7
            }
            _ => {
                // A driver that died in its attaching may have cleared nothing; here the successor must do it alone.
                s.drivers[0] = Driver { alive: true, ..Driver::default() };
                0
            }
        };
    }

    /// A driver that sleeps without a byte has nothing to do.
    fn can_step(s: &Whole, driver: &Driver) -> bool {
        driver.alive && (driver.pc != POLL || s.bell || !s.runtime_alive)
    }
}

impl Model for Protocol {
    type State = Whole;
    type Action = Step;

    fn init_states(&self) -> Vec<Whole> {
        vec![Whole {
            words: [0; WORDS],
            bell: false,
            runtime_alive: true,
            lock: None,
            drivers: [Driver { alive: true, ..Driver::default() }, Driver::default()],
            scan: 0,
            order: 1,
            a: 0,
            c0: 0,
            c1: 0,
            is_present: false,
            posted_to: 0,
            failed: false,
            supervisor: 0,
            deaths: 0,
            second: self.second,
            executed: [0; 3],
            broken: 0,
        }]
    }

    fn actions(&self, s: &Whole, actions: &mut Vec<Step>) {
        if s.broken != 0 {
            return;
        }
        if s.runtime_alive {
            if s.order <= self.orders {
                actions.push(Step::Scan);
            }
            if s.supervisor != 0 {
                actions.push(Step::Supervisor);
            }
            actions.push(Step::KillRuntime);
        }
        if s.second {
            actions.push(Step::Second);
        }
        if s.drivers[0].alive && s.deaths < self.deaths {
            actions.push(Step::KillDriver);
        }
        for me in 0..2 {
            if Self::can_step(s, &s.drivers[usize::from(me)]) {
                actions.push(Step::Driver(me));
            }
        }
    }

    fn next_state(&self, last: &Whole, step: Step) -> Option<Whole> {
        let mut s = last.clone();
        match step {
            Step::Scan => self.scan(&mut s),
            Step::Supervisor => self.supervisor(&mut s),
            Step::Driver(me) => self.driver(&mut s, me),
            Step::KillDriver => {
                s.deaths += 1;
                s.drivers[0] = Driver::default();
                if s.lock == Some(0) {
                    s.lock = None;
                }
                s.supervisor = u8::from(s.runtime_alive);
            }
            Step::KillRuntime => {
                s.runtime_alive = false;
                s.supervisor = 0;
            }
            Step::Second => {
                s.second = false;
                s.drivers[1] = Driver { alive: true, ..Driver::default() };
            }
        }
        // It sleeps, nobody will ring, and there is something that it has not seen.
        let rings = matches!(s.scan, 0..8 | 10..18) && s.runtime_alive;
        let sleeper = s.drivers.iter().find(|d| d.alive && d.pc == POLL);
        if sleeper.is_some_and(|d| !rings && !s.bell && s.runtime_alive && d.mark != s.get(W::Changes)) {
            s.breaks(35);
        }
        Some(s)
    }

    fn properties(&self) -> Vec<Property<Self>> {
        macro_rules! rules {
            ($($number:literal)*) => {
                vec![$(Property::always(stringify!($number), |_, s: &Whole| s.broken != $number),)*]
            };
        }
        let mut all = rules!(4 6 10 11 16 19 21 25 35 42 46 101 102);
        // The exploration is not empty: orders are done, also after two deaths.
        all.push(Property::sometimes("an order is done", |_, s: &Whole| s.executed[1] == 1 && s.order == 2 && !s.failed));
        all.push(Property::sometimes("an order is done after the last death", |model: &Self, s: &Whole| {
            s.deaths == model.deaths && s.order == model.orders + 1 && !s.failed
        }));
        all
    }
}

/// What is broken, and how many states there are.
fn explore(protocol: Protocol) -> (Vec<String>, usize) {
    let checker = protocol.checker().threads(2).spawn_bfs().join();
    let broken = checker.discoveries().into_keys().filter(|name| name.parse::<u8>().is_ok());
    let broken: Vec<String> = broken.map(ToString::to_string).collect();
    if broken.is_empty() {
        checker.assert_properties();
    }
    (broken, checker.unique_state_count())
}

#[test]
fn every_rule_holds_whoever_dies_wherever() {
    for (orders, deaths, second) in [(2, 1, false), (1, 2, false), (1, 0, true)] {
        let (broken, states) = explore(Protocol { orders, deaths, second, break_: Break::Nothing });
        println!("{orders} orders, {deaths} deaths of a driver, a second driver: {second}: {states} states");
        assert_eq!(broken, [""; 0], "{orders} orders, {deaths} deaths, a second driver: {second}");
    }
}

/// Seen only when somebody starts a driver before the runtime has cleared what the dead one has left.
const BY_HAND: [Break; 3] = [Break::NoLock, Break::NotCleared, Break::StaysOdd];

#[test]
fn each_broken_rule_is_seen() {
    for (break_, rules) in [
        (Break::NoLock, &["4"][..]),
        (Break::NotCleared, &["6"]),
        (Break::StaysOdd, &["10"]),
        (Break::NotBooked, &["11"]),
        (Break::SameGeneration, &["16"]),
        (Break::NoSequence, &["19"]),
        (Break::TakesTorn, &["21"]),
        (Break::OutlivesRuntime, &["25"]),
        (Break::LooksTooSoon, &["35"]),
        (Break::TakesOld, &["42"]),
        (Break::SendsTwice, &["46"]),
        (Break::ClearsFirst, &["101"]),
        (Break::AsksFirst, &["102"]),
    ] {
        let (broken, _) = explore(Protocol { orders: 1, deaths: 1, second: BY_HAND.contains(&break_), break_ });
        assert!(rules.iter().any(|rule| broken.iter().any(|found| found == rule)), "{break_:?}: {broken:?}");
    }
}
