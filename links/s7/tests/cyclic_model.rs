//! Cyclic data in random sessions, beside a model of what a client must see, which is written from the rules alone.

mod common;

use std::collections::BTreeMap;

use common::cyclic::{CHANGES, DELETE, PERIODIC, REPLACE, ask, at, list, refused};
use common::{Desk, areas, item, items};
use ob1_s7::Rights;
use ob1_s7::server::Settings;
use proptest::prelude::*;

/// What is done to a session.
#[derive(Clone, Debug)]
enum Act {
    /// The program changes a byte.
    Program(usize, usize, u8),
    /// The partner writes one.
    Write(usize, usize, u8),
    /// A job is made: periodic or of changes.
    Make(bool, List),
    /// The n-th job gets another list.
    Replace(usize, List),
    /// The n-th job is deleted.
    Delete(usize),
    /// So many tenths of a second pass.
    Time(u64),
}

/// Period in tenths of a second, and for each item its areas; `None`: a byte of bit memory.
type List = (u8, Vec<Option<Vec<(u8, usize, u8)>>>);

const DBS: [u16; 3] = [30, 31, 32];
const BYTES: usize = 12;

#[derive(Clone, Debug)]
struct Modelled {
    sub: u8,
    list: List,
    due: u64,
    sent: Vec<Vec<Vec<u8>>>,
    complete: bool,
}

#[derive(Debug, Default)]
struct Model {
    dbs: [[u8; BYTES]; 3],
    memory: u8,
    jobs: BTreeMap<u8, Modelled>,
}

impl Model {
    /// For each item, each area with its code.
    fn values(&self, list: &List) -> Vec<Vec<Vec<u8>>> {
        let area = |(bytes, db, at): &(u8, usize, u8)| {
            let (from, bytes) = (usize::from(*at), usize::from(*bytes));
            match self.dbs.get(*db) {
                None => vec![0x0A],
                Some(db) => db.get(from..from + bytes).map_or(vec![0x05], |found| [&[0xFF], found].concat()),
            }
        };
        let item = |item: &Option<Vec<_>>| match item {
            Some(areas) => areas.iter().map(area).collect(),
            None => vec![vec![self.memory]],
        };
        list.1.iter().map(item).collect()
    }

    fn data(list: &List, now: &[Vec<Vec<u8>>], before: Option<&[Vec<Vec<u8>>]>) -> Vec<u8> {
        let mut data = (now.len() as u16).to_be_bytes().to_vec();
        for (index, item) in now.iter().enumerate() {
            if data.len() % 2 == 1 {
                data.push(0);
            }
            if list.1[index].is_none() {
                data.extend_from_slice(&[0xFF, 4, 0, 8, item[0][0]]);
                continue;
            }
            let mut areas = Vec::new();
            for (n, area) in item.iter().enumerate() {
                let same = before.is_some_and(|before| before[index][n] == *area);
                areas.extend_from_slice(if same { &[0xFE] } else { area });
            }
            data.extend_from_slice(&[0xFF, 9, 0, areas.len() as u8]);
            data.extend_from_slice(&areas);
        }
        data
    }

    /// The messages of this moment, by their jobs.
    fn messages(&mut self, now: u64) -> BTreeMap<u8, (u8, Vec<u8>)> {
        let mut told = BTreeMap::new();
        for number in self.jobs.keys().copied().collect::<Vec<_>>() {
            let job = self.jobs[&number].clone();
            if job.due > now {
                continue;
            }
            let values = self.values(&job.list);
            let place = self.jobs.get_mut(&number).expect("it is there");
            place.due += u64::from(job.list.0) * 100;
            let data = match (job.sub, job.complete) {
                (PERIODIC, _) | (_, true) => Self::data(&job.list, &values, None),
                _ if values == job.sent => continue,
                _ => Self::data(&job.list, &values, Some(&job.sent)),
            };
            (place.sent, place.complete) = (values, false);
            told.insert(number, (job.sub, data));
        }
        told
    }

    fn set(&mut self, db: usize, at: usize, value: u8) {
        match self.dbs.get_mut(db) {
            Some(db) => db[at] = value,
            None => self.memory = value,
        }
    }
}

/// Beside the model, a real connection to a CPU with the same values.
struct Session {
    desk: Desk,
    model: Model,
    now: u64,
    /// Messages, complete ones, marks of unchanged areas.
    seen: [u64; 3],
}

impl Session {
    fn new(is_400: bool) -> Self {
        let mut desk = Desk::open(Settings { rights: Rights::Write, is_400, ..Settings::default() }, 480);
        desk.cpu.dbs = DBS.iter().map(|db| (*db, vec![0; BYTES])).collect();
        desk.cpu.memory = vec![0; 16];
        Self { desk, model: Model::default(), now: 0, seen: [0; 3] }
    }

    fn request((factor, items): &List) -> Vec<u8> {
        let items: Vec<Vec<u8>> = items
            .iter()
            .map(|one| match one {
                None => item(2, 1, 0, 0x83, 0),
                Some(list) => {
                    let of = |(bytes, db, at): &(u8, usize, u8)| {
                        (*bytes, DBS.get(*db).copied().unwrap_or(99), u16::from(*at))
                    };
                    areas(&list.iter().map(of).collect::<Vec<_>>())
                }
            })
            .collect();
        list(0, *factor, &items)
    }

    fn job(&mut self, sub: u8, number: u8, list: &List) {
        let told = ask(&mut self.desk, sub, number, &Self::request(list));
        let values = self.model.values(list);
        assert_eq!((told.error, told.data), (0, Model::data(list, &values, None)));
        assert!(sub == REPLACE && told.number == number || !self.model.jobs.contains_key(&told.number));
        let due = self.now + u64::from(list.0) * 100;
        self.model.jobs.insert(told.number, Modelled { sub, list: list.clone(), due, sent: values, complete: false });
        self.desk.connection.tick(self.now);
    }

    fn number(&self, n: usize) -> Option<u8> {
        let count = self.model.jobs.len();
        if count == 0 { None } else { self.model.jobs.keys().nth(n % count).copied() }
    }

    fn act(&mut self, act: &Act, most: usize) {
        match act {
            Act::Program(db, byte, value) => {
                match DBS.get(*db) {
                    Some(number) => self.desk.cpu.dbs.get_mut(number).expect("it is there")[*byte] = *value,
                    None => self.desk.cpu.memory[0] = *value,
                }
                self.model.set(*db, *byte, *value);
            }
            Act::Write(db, byte, value) => {
                let at = match DBS.get(*db) {
                    Some(number) => item(2, 1, *number, 0x84, *byte as u32 * 8),
                    None => item(2, 1, 0, 0x83, 0),
                };
                assert_eq!(self.desk.job(&items(5, &[at]), &[0, 4, 0, 8, *value])[12..], [5, 1, 0xFF]);
                self.model.set(*db, *byte, *value);
                self.model.jobs.values_mut().for_each(|job| job.complete = true);
            }
            Act::Make(periodic, list) if self.model.jobs.len() < most => {
                self.job(if *periodic { PERIODIC } else { CHANGES }, 0, list);
            }
            Act::Make(_, list) => {
                assert_eq!(refused(&mut self.desk, CHANGES, 0, &Self::request(list)), 0xD805);
            }
            Act::Replace(n, list) => {
                let Some(number) = self.number(*n) else { return };
                if self.model.jobs[&number].sub == PERIODIC {
                    assert_eq!(refused(&mut self.desk, REPLACE, number, &Self::request(list)), 0xD806);
                } else {
                    self.job(REPLACE, number, list);
                }
            }
            Act::Delete(n) => {
                let Some(number) = self.number(*n) else { return };
                assert_eq!(ask(&mut self.desk, DELETE, 0, &[5, number]).number, number);
                self.model.jobs.remove(&number);
            }
            Act::Time(tenths) => (0..*tenths).for_each(|_| self.pass()),
        }
    }

    /// A tenth of a second passes.
    fn pass(&mut self) {
        self.now += 100;
        let complete: BTreeMap<u8, bool> =
            self.model.jobs.iter().map(|(number, job)| (*number, job.complete)).collect();
        let expected = self.model.messages(self.now);
        let mut came = BTreeMap::new();
        for (sub, number, data) in at(&mut self.desk, self.now) {
            assert!(came.insert(number, (sub, data)).is_none(), "two messages of job {number}");
        }
        for (number, (_, data)) in &came {
            self.seen[0] += 1;
            self.seen[1] += u64::from(complete.get(number).copied().unwrap_or(false));
            self.seen[2] += u64::from(data.contains(&0xFE));
        }
        assert_eq!(came, expected, "at {}", self.now);
    }
}

fn any_list() -> impl Strategy<Value = List> {
    let area = (1u8..5, 0usize..4, 0u8..11);
    let item = prop_oneof![6 => prop::collection::vec(area, 1..5).prop_map(Some), 1 => Just(None)];
    (1u8..6, prop::collection::vec(item, 1..4))
        // A list that cannot be read at all is refused: one that is there stands in front.
        .prop_map(|(period, mut items)| {
            items.insert(0, Some(vec![(1, 0, 0)]));
            (period, items)
        })
}

fn any_act() -> impl Strategy<Value = Act> {
    prop_oneof![
        6 => (0usize..4, 0..BYTES, 0u8..4).prop_map(|(db, byte, value)| Act::Program(db, byte, value)),
        2 => (0usize..4, 0..BYTES, 0u8..4).prop_map(|(db, byte, value)| Act::Write(db, byte, value)),
        3 => (prop::bool::weighted(0.2), any_list()).prop_map(|(periodic, list)| Act::Make(periodic, list)),
        2 => (any::<usize>(), any_list()).prop_map(|(n, list)| Act::Replace(n, list)),
        1 => any::<usize>().prop_map(Act::Delete),
        8 => (1u64..4).prop_map(Act::Time),
    ]
}

proptest! {
    #[test]
    fn random_sessions_are_told_as_the_model_says(
        acts in prop::collection::vec(any_act(), 1..120),
        is_400 in any::<bool>(),
    ) {
        let mut session = Session::new(is_400);
        for act in &acts {
            session.act(act, if is_400 { 32 } else { 16 });
        }
        session.act(&Act::Time(12), 32);
    }
}

/// As long as the recording of WinCC with an S7-400: 135 minutes, two or three jobs, a picture opened now and then.
#[test]
fn the_rules_hold_over_135_minutes() {
    let mut random = fastrand::Rng::with_seed(37);
    let mut session = Session::new(true);
    let lists: [List; 3] = [
        (5, vec![Some((0..6).map(|n| (2, n % 3, n as u8)).collect())]),
        (10, vec![Some((0..4).map(|n| (1, n % 3, n as u8)).collect()), Some(vec![(4, 1, 8)])]),
        (10, vec![Some(vec![(1, 0, 0), (1, 3, 0), (2, 1, 11)])]),
    ];
    session.act(&Act::Make(false, lists[0].clone()), 32);
    session.act(&Act::Make(false, lists[1].clone()), 32);
    let mut writes = 0;
    while session.now < 8_100_000 {
        match random.u32(0..3000) {
            0..90 => session.act(&Act::Program(random.usize(0..3), random.usize(0..BYTES), random.u8(..)), 32),
            90..96 => {
                writes += 1;
                let value = session.model.dbs[1][8];
                session.act(&Act::Write(1, 8, if random.bool() { value } else { random.u8(..) }), 32);
            }
            96..100 => session.act(&Act::Replace(random.usize(0..2), lists[random.usize(0..3)].clone()), 32),
            100 => {
                session.act(&Act::Delete(random.usize(0..2)), 32);
                session.act(&Act::Make(false, lists[random.usize(0..3)].clone()), 32);
            }
            _ => session.pass(),
        }
    }
    let [messages, complete, unchanged] = session.seen;
    assert_eq!(session.model.jobs.len(), 2);
    assert!(messages > 1000 && complete > 200 && unchanged > 800 && writes > 100, "{:?}, {writes}", session.seen);
}
