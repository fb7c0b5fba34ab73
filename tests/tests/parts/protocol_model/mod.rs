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

mod driver;
mod runtime;

use stateright::{Checker as _, HasDiscoveries, Model, Property};

use driver::POLL;

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

    /// The order with the start-up that the CPU knows: for the acknowledgement of a start-up, before which a driver
    /// takes nothing.
    fn tagged(&self) -> u8 {
        self.order + 4 * self.posted_to
    }

    fn book_lost(&mut self) {
        let open = self.get(W::Accepted) - self.get(W::Sent) - self.get(W::Lost);
        self.set(W::Lost, self.get(W::Lost) + open);
    }
}

impl Protocol {
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
                s.supervisor = match () {
                    () if !s.runtime_alive => 0,
                    () if UNCLEARED.contains(&self.break_) => 7,
                    () => 1,
                };
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
        all.push(Property::sometimes("an order is done", |_, s: &Whole| {
            s.executed[1] == 1 && s.order == 2 && !s.failed
        }));
        all.push(Property::sometimes("an order is done after the last death", |model: &Self, s: &Whole| {
            s.deaths == model.deaths && s.order == model.orders + 1 && !s.failed
        }));
        all
    }
}

/// What is broken, and how many states there are.
fn explore(protocol: Protocol) -> (Vec<String>, usize) {
    let checker = protocol.checker().threads(2).finish_when(HasDiscoveries::AnyFailures).spawn_bfs().join();
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

/// Seen only when the runtime has not cleared what a dead driver has left: the next driver must do it alone too.
const UNCLEARED: [Break; 2] = [Break::NotCleared, Break::StaysOdd];

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
        let (broken, _) = explore(Protocol { orders: 1, deaths: 1, second: break_ == Break::NoLock, break_ });
        assert!(rules.iter().any(|rule| broken.iter().any(|found| found == rule)), "{break_:?}: {broken:?}");
    }
}
