//! Property test of the alarms: the blocks of each kind against a model written from the manual ("Generating
//! Block-Related Messages"), under random signals, acknowledgements, locks, log-ons, restarts and a slow way out.
//!
//! The model knows nothing of the table: a number has a signal cycle, two memories and acknowledgements.

use std::collections::{BTreeMap, VecDeque};

use ob1_model::{AlarmAck, AlarmChange, AlarmKind, AlarmOrder, AlarmTime, Displays};

use crate::services::AlarmTable;
use crate::tests::Fake;

/// What a display is to be told, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Told {
    Message { id: u32, signals: u8, going: u8, coming: u8, lost: bool },
    Acknowledged { id: u32, going: u8, coming: u8 },
    Locked(u32, bool),
    Released(u32),
    Deleted,
}

/// A message number while it is in use.
#[derive(Clone, Copy, Debug)]
struct Cycle {
    kind: AlarmKind,
    signals: u8,
    coming: u8,
    going: u8,
    /// The last call with a transition has put a message into the memories.
    pending: bool,
    /// When a signal came last, and when one went after that.
    came: Option<u64>,
    went: Option<u64>,
}

#[derive(Default)]
struct Model {
    cycles: BTreeMap<u32, Cycle>,
    way: VecDeque<Told>,
    locked: BTreeMap<u32, bool>,
    all_locked: bool,
    logged_on: [bool; 2],
    now: u64,
}

/// (coming, going) that a display must acknowledge. SQ and DQ: only the coming. S, D and NOTIFY: implicitly.
fn acknowledgeable(kind: AlarmKind) -> (bool, bool) {
    match kind {
        AlarmKind::AlarmSq | AlarmKind::AlarmDq => (true, false),
        AlarmKind::Alarm | AlarmKind::Alarm8 | AlarmKind::Alarm8p => (true, true),
        _ => (false, false),
    }
}

const fn all(kind: AlarmKind) -> u8 {
    match kind {
        AlarmKind::Notify8p | AlarmKind::Alarm8 | AlarmKind::Alarm8p => 0xFF,
        _ => 1,
    }
}

impl Model {
    /// How many messages of this number wait: never more than two.
    fn memories(&self, wanted: u32) -> usize {
        self.way.iter().filter(|told| matches!(told, Told::Message { id, .. } if *id == wanted)).count()
    }

    fn youngest(&self, wanted: u32) -> Option<usize> {
        self.way.iter().rposition(|told| matches!(told, Told::Message { id, .. } if *id == wanted))
    }

    fn put(&mut self, id: u32, lost: bool) {
        let Cycle { signals, going, coming, .. } = self.cycles[&id];
        self.way.push_back(Told::Message { id, signals, going, coming, lost });
    }

    fn is_locked(&self, id: u32) -> bool {
        self.locked.get(&id).copied().unwrap_or(self.all_locked)
    }

    fn turn(&mut self, id: u32, signals: u8, opens: bool) {
        let cycle = self.cycles.get_mut(&id).expect("in use");
        let (coming, going) = acknowledgeable(cycle.kind);
        for bit in (0..8).map(|bit| 1 << bit) {
            match (cycle.signals & bit != 0, signals & bit != 0) {
                (false, true) if coming && opens => cycle.coming &= !bit,
                (true, false) if going && opens => cycle.going &= !bit,
                _ => {}
            }
        }
        if signals & !cycle.signals != 0 {
            (cycle.came, cycle.went) = (Some(self.now), None);
        } else if cycle.signals & !signals != 0 {
            cycle.went = Some(self.now);
        }
        cycle.signals = signals;
    }

    /// RET_VAL of a call of a function.
    fn function(&mut self, kind: AlarmKind, id: u32, signal: bool) -> u32 {
        let logged_on = self.logged_on[1];
        match self.cycles.get(&id) {
            Some(cycle) if cycle.kind != kind => return 0x8088,
            Some(cycle) if (cycle.signals == 1) == signal => return 0x8084,
            Some(_) => {}
            None if !signal => return 0x8087,
            None if !logged_on => return 0x8085,
            None => {
                self.cycles.insert(
                    id,
                    Cycle { kind, signals: 0, coming: 1, going: 1, pending: false, came: None, went: None },
                );
            }
        }
        self.turn(id, u8::from(signal), logged_on);
        let code = if !logged_on {
            0x8085
        } else if self.memories(id) == 2 {
            // The current and the last are discarded; the second but last tells it.
            let last = self.youngest(id).expect("two");
            self.way.remove(last);
            let first = self.youngest(id).expect("one");
            if let Told::Message { lost, .. } = &mut self.way[first] {
                *lost = true;
            }
            0x8083
        } else {
            self.put(id, false);
            0
        };
        self.end_of_cycle(id);
        code
    }

    /// From 1 to 0, with SQ and DQ until it is acknowledged.
    fn end_of_cycle(&mut self, id: u32) {
        if self.cycles.get(&id).is_some_and(|c| c.kind.is_function() && c.signals == 0 && c.coming == 1) {
            self.cycles.remove(&id);
        }
    }

    /// DONE, ERROR, STATUS of a call of a function block.
    fn block(&mut self, kind: AlarmKind, id: u32, signals: u8) -> (u32, u32, u32) {
        let is_first = !self.cycles.contains_key(&id);
        if is_first {
            let all = all(kind);
            self.cycles.insert(
                id,
                Cycle { kind, signals: 0, coming: all, going: all, pending: false, came: None, went: None },
            );
        }
        let locked = self.is_locked(id);
        let tells = is_first && matches!(kind, AlarmKind::Notify | AlarmKind::Notify8p);
        if self.cycles[&id].signals != signals || tells {
            self.turn(id, signals, !locked);
            let status = if locked {
                (0, 1, 21)
            } else if !self.logged_on[0] {
                (0, 1, 1)
            } else if self.memories(id) == 2 {
                let last = self.youngest(id).expect("two");
                self.way.remove(last);
                self.put(id, true);
                (0, 0, 11)
            } else {
                self.put(id, false);
                (0, 0, 25)
            };
            self.cycles.get_mut(&id).expect("in use").pending = status.1 == 0;
            return status;
        }
        let waits = self.memories(id) > 0;
        let cycle = self.cycles.get_mut(&id).expect("in use");
        if cycle.pending && !waits {
            cycle.pending = false;
            (1, 0, 0)
        } else if locked {
            (0, 1, 21)
        } else if !self.logged_on[0] {
            (0, 1, 1)
        } else {
            (0, 0, if cycle.pending { 25 } else { 0 })
        }
    }

    fn acknowledge(&mut self, ack: AlarmAck) -> bool {
        let Some(cycle) = self.cycles.get_mut(&ack.id) else { return false };
        let before = (cycle.coming, cycle.going);
        cycle.coming |= ack.coming & all(cycle.kind);
        cycle.going |= ack.going & all(cycle.kind);
        let (coming, going) = (cycle.coming, cycle.going);
        if (coming, going) != before {
            self.way.push_back(Told::Acknowledged { id: ack.id, going, coming });
        }
        self.end_of_cycle(ack.id);
        true
    }

    fn lock_one(&mut self, id: u32, locked: bool) {
        let was = self.is_locked(id);
        self.locked.insert(id, locked);
        if was != locked && self.cycles.contains_key(&id) {
            self.way.push_back(Told::Locked(id, locked));
        }
    }

    fn lock_all(&mut self, locked: bool) {
        let known: Vec<u32> = self.cycles.iter().filter(|(_, c)| !c.kind.is_function()).map(|(id, _)| *id).collect();
        // In the order in which they were called first: the test compares them as a set.
        for id in known {
            if self.is_locked(id) != locked {
                self.way.push_back(Told::Locked(id, locked));
            }
        }
        self.locked.clear();
        self.all_locked = locked;
    }

    fn restart(&mut self, cold: bool) {
        self.cycles.clear();
        self.way.clear();
        if cold {
            self.locked.clear();
            self.all_locked = false;
        }
        self.way.push_back(Told::Deleted);
    }
}

/// The numbers: each function block has one of its own, the functions share theirs.
const BLOCKS: [(AlarmKind, &str, u32); 7] = [
    (AlarmKind::Notify8p, "SYSTEM:SFB31", 31),
    (AlarmKind::Alarm, "SYSTEM:SFB33", 33),
    (AlarmKind::Alarm8, "SYSTEM:SFB34", 34),
    (AlarmKind::Alarm8p, "SYSTEM:SFB35", 35),
    (AlarmKind::Alarm8p, "SYSTEM:SFB35", 45),
    (AlarmKind::Notify, "SYSTEM:SFB36", 36),
    (AlarmKind::Notify, "SYSTEM:SFB36", 46),
];
const FUNCTIONS: [AlarmKind; 4] = [AlarmKind::AlarmSq, AlarmKind::AlarmS, AlarmKind::AlarmDq, AlarmKind::AlarmD];
const NUMBERS: std::ops::Range<u32> = 100..104;

struct Bench {
    table: AlarmTable,
    blocks: Vec<Fake>,
    model: Model,
    last: u64,
}

impl Bench {
    fn new() -> Self {
        let instance = |(index, (_, key, id)): (usize, &(AlarmKind, &str, u32))| {
            let mut fake = Fake::new(key).with("EV_ID", id.to_be_bytes());
            fake.place = (50 + index as u16, 4);
            if !key.ends_with("31") && !key.ends_with("36") {
                fake.set("EN_R", &[1]);
            }
            fake
        };
        let blocks = BLOCKS.iter().enumerate().map(instance).collect();
        Self { table: AlarmTable::default(), blocks, model: Model::default(), last: 0 }
    }

    /// Runs a block on the common table.
    fn run(&mut self, fake: &mut Fake) {
        fake.station.alarm_time.nanos = self.model.now;
        std::mem::swap(&mut self.table, &mut fake.station.alarms);
        fake.run();
        std::mem::swap(&mut self.table, &mut fake.station.alarms);
    }

    /// What a display would be given when it asks.
    fn look(&self) {
        let times = |id: u32| self.table.get(id).map(|now| [now.came, now.went].map(|turn| turn.map(|t| t.time.nanos)));
        for (id, cycle) in &self.model.cycles {
            assert_eq!(times(*id), Some([cycle.came, cycle.went]), "times of {id}");
        }
        assert_eq!(self.table.iter().count(), self.model.cycles.len());
    }

    fn step(&mut self, random: &mut fastrand::Rng) {
        self.model.now += 1;
        let time = AlarmTime { nanos: self.model.now, ..AlarmTime::default() };
        match random.u32(0..100) {
            0..45 => {
                let index = random.usize(..BLOCKS.len());
                let (kind, _, id) = BLOCKS[index];
                let old = self.model.cycles.get(&id).map_or(0, |cycle| cycle.signals);
                let signals = if random.bool() { old } else { random.u8(..) & random.u8(..) } & all(kind);
                let mut fake = self.blocks.remove(index);
                match all(kind) {
                    1 => fake.set("SIG", &[signals]),
                    _ => (0..8).for_each(|bit| fake.set(&format!("SIG_{}", bit + 1), &[signals >> bit & 1])),
                }
                self.run(&mut fake);
                let expected = self.model.block(kind, id, signals);
                assert_eq!((fake.value("DONE"), fake.value("ERROR"), fake.value("STATUS")), expected, "{kind:?} {id}");
                let Cycle { coming, going, .. } = self.model.cycles[&id];
                match kind {
                    AlarmKind::Alarm => {
                        let told = (fake.value("ACK_UP"), fake.value("ACK_DN"));
                        assert_eq!(told, (coming.into(), going.into()), "ALARM");
                    }
                    AlarmKind::Alarm8 | AlarmKind::Alarm8p => {
                        let told = u16::from_be_bytes([going, coming]);
                        assert_eq!(fake.value("ACK_STATE"), told.into(), "{kind:?} {id}");
                    }
                    _ => {}
                }
                self.blocks.insert(index, fake);
            }
            45..70 => {
                let (kind, id) = (FUNCTIONS[random.usize(..4)], random.u32(NUMBERS));
                // Mostly the kind that has the number.
                let kind = match self.model.cycles.get(&id) {
                    Some(cycle) if random.u8(..) > 20 => cycle.kind,
                    _ => kind,
                };
                let signal = random.bool();
                let mut fake = Fake::new(&format!("SYSTEM:SFC{}", kind.number())).with("SIG", [u8::from(signal)]);
                fake = fake.with("EV_ID", id.to_be_bytes()).with("RET_VAL", [9; 2]);
                if matches!(kind, AlarmKind::AlarmDq | AlarmKind::AlarmD) {
                    fake.set("CMP_ID", &[0, 0, 0, 7]);
                }
                self.run(&mut fake);
                assert_eq!(fake.value("RET_VAL"), self.model.function(kind, id, signal), "{kind:?} {id} {signal}");
                // SFC 19 tells what is kept.
                let mut fake = Fake::new("SYSTEM:SFC19").with("EV_ID", id.to_be_bytes()).with("RET_VAL", [9; 2]);
                fake = fake.with("STATE", [7]).with("Q_STATE", [7]);
                self.run(&mut fake);
                let told = (fake.value("RET_VAL"), fake.value("STATE"), fake.value("Q_STATE"));
                let expected = self.model.cycles.get(&id).map(|c| (0, c.signals.into(), c.coming.into()));
                assert_eq!(told, expected.unwrap_or((0x8082, 7, 7)), "SFC 19 of {id}");
            }
            70..82 => {
                let id = if random.bool() { BLOCKS[random.usize(..BLOCKS.len())].2 } else { random.u32(NUMBERS) };
                let ack = AlarmAck { id, coming: random.u8(..), going: random.u8(..) };
                let mut found = Vec::with_capacity(1);
                self.table.order(&AlarmOrder::Acknowledge(vec![ack]), time, &mut Vec::new(), &mut found);
                assert_eq!(found, [self.model.acknowledge(ack)]);
            }
            82..86 => {
                // A display can lock what it knows; a program also what comes later.
                let (_, _, id) = BLOCKS[random.usize(..BLOCKS.len())];
                let locked = random.bool();
                if self.model.cycles.contains_key(&id) {
                    let mut found = Vec::with_capacity(1);
                    let order = AlarmOrder::Lock { ids: vec![id], locked };
                    self.table.order(&order, time, &mut Vec::new(), &mut found);
                    assert_eq!(found, [true]);
                } else {
                    self.program_locks(4, id, locked);
                }
                self.model.lock_one(id, locked);
            }
            86 => {
                let locked = random.bool();
                self.fetch(usize::MAX);
                self.program_locks(random.u8(0..2), 0, locked);
                self.model.lock_all(locked);
                self.fetch_as_set();
            }
            87 => {
                let mut fake = Fake::new("SYSTEM:SFC106").with("MODE", [0, 1]).with("SI_ID", [0; 4]);
                fake = fake.with("RET_VAL", [9; 2]);
                self.run(&mut fake);
                assert_eq!(fake.value("RET_VAL"), 0);
                let is_dynamic = |c: &Cycle| matches!(c.kind, AlarmKind::AlarmDq | AlarmKind::AlarmD);
                let gone: Vec<u32> =
                    self.model.cycles.iter().filter(|(_, c)| is_dynamic(c)).map(|(id, _)| *id).collect();
                for id in gone {
                    self.model.cycles.remove(&id);
                    self.model.way.push_back(Told::Released(id));
                }
            }
            88..91 => {
                self.model.logged_on[random.usize(..2)] ^= true;
                let [blocks, functions] = self.model.logged_on;
                let bit = |on, bit| if on { bit } else { 0 };
                self.table.set_displays(Displays(bit(blocks, Displays::BLOCKS) | bit(functions, Displays::FUNCTIONS)));
            }
            91 if random.u8(..) < 60 => {
                let cold = random.bool();
                self.table.restart(cold, time);
                self.model.restart(cold);
            }
            _ => self.fetch(random.usize(1..8)),
        }
        self.look();
    }

    fn program_locks(&mut self, mode: u8, id: u32, locked: bool) {
        let mut fake = Fake::new(if locked { "SYSTEM:SFC10" } else { "SYSTEM:SFC9" }).with("REQ", [1]);
        fake = fake.with("MODE", [mode]).with("MESGN", id.to_be_bytes()).with("RET_VAL", [9; 2]).with("BUSY", [1]);
        self.run(&mut fake);
        assert_eq!((fake.value("RET_VAL"), fake.value("BUSY")), (0, 0));
    }

    fn next(&mut self) -> Option<Told> {
        let event = *self.table.next()?;
        self.table.sent();
        assert!(event.number > self.last, "numbers rise");
        self.last = event.number;
        let state = event.state;
        let (id, signals, going, coming) = (state.id, state.signals, state.going, state.coming);
        Some(match event.change {
            AlarmChange::Message { lost, .. } => Told::Message { id, signals, going, coming, lost },
            AlarmChange::Acknowledged => Told::Acknowledged { id, going, coming },
            AlarmChange::Locked => Told::Locked(id, true),
            AlarmChange::Unlocked => Told::Locked(id, false),
            AlarmChange::Released => Told::Released(id),
            AlarmChange::Deleted => Told::Deleted,
            AlarmChange::Lost(_) => panic!("nothing is lost but what the manual loses"),
        })
    }

    fn fetch(&mut self, most: usize) {
        for _ in 0..most {
            let (told, expected) = (self.next(), self.model.way.pop_front());
            assert_eq!(told, expected);
            if told.is_none() {
                return;
            }
        }
    }

    /// Locks of all numbers come in any order.
    fn fetch_as_set(&mut self) {
        let mut told: Vec<Told> = std::iter::from_fn(|| self.next()).collect();
        let mut expected: Vec<Told> = self.model.way.drain(..).collect();
        told.sort_by_key(|told| format!("{told:?}"));
        expected.sort_by_key(|told| format!("{told:?}"));
        assert_eq!(told, expected);
    }
}

#[test]
fn each_kind_does_what_the_manual_says() {
    for seed in 0..120 {
        let (mut bench, mut random) = (Bench::new(), fastrand::Rng::with_seed(seed));
        for _ in 0..600 {
            bench.step(&mut random);
        }
        bench.fetch(usize::MAX);
    }
}
