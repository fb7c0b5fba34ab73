//! Ladder: a network does what its tree says, and its power flow shows what has happened. Trees are drawn at random and
//! evaluated here, by a model that knows no statement.

#[path = "../../../../blocks/ladder/tests/common/trees.rs"]
#[expect(dead_code, reason = "the tests of the trees themselves use more")]
mod trees;

use std::collections::BTreeMap;

use ob1_cpu::{Job, PassJob, Width};
use ob1_ir::{BitTest, CodeBlock, Op, Place, Stmt};
use ob1_ladder::flow::{State, flow};
use ob1_ladder::tree::{Body, End, Eno, Kind, Node, Rung, Tree};
use ob1_ladder::{Network, View, generate, is_ladder, read_step7};
use ob1_model::{Area, BitAddr, Interface, Pass, PassOrder};
use ob1_stl::Mnemonics;
use ob1_stl::print::Listing;
use ob1_time::Span;

use crate::common::window::Looker;
use crate::common::{Bench, MS, block, call, fc, md, ob1, operand, place, program, transfer};
use trees::Maker;

/// Bytes of E and A, and of M.
const IMAGE: u32 = 8;
const MEMORY: u32 = 128;
/// Where OB 1 leaves E and A as the network has left them.
const COPY: u32 = 200;

/// Random states of the short run; `OB1_LADDER_STATES` for a longer one.
#[expect(clippy::disallowed_methods, reason = "how long a run is comes from outside")]
fn states() -> u64 {
    std::env::var("OB1_LADDER_STATES").ok().and_then(|count| count.parse().ok()).unwrap_or(500)
}

/// The memory of the model, by area and byte.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Model {
    bytes: BTreeMap<(u8, u32), u8>,
    carried: BTreeMap<u32, bool>,
    /// What each node gave, by its number.
    values: BTreeMap<u32, bool>,
}

fn area(area: Area) -> u8 {
    area.pointer_code()
}

impl Model {
    fn bit(&self, at: Place) -> bool {
        match at {
            Place::Fixed(Area::Local, at) => self.carried.get(&at.0).copied().unwrap_or(false),
            Place::Fixed(of, at) => self.bytes[&(area(of), at.byte())] >> at.bit() & 1 == 1,
            _ => panic!("{at:?}"),
        }
    }

    fn put(&mut self, at: Place, value: bool) {
        match at {
            Place::Fixed(Area::Local, at) => drop(self.carried.insert(at.0, value)),
            Place::Fixed(of, at) => {
                let byte = self.bytes.get_mut(&(area(of), at.byte())).expect("there");
                *byte = *byte & !(1 << at.bit()) | u8::from(value) << at.bit();
            }
            _ => panic!("{at:?}"),
        }
    }

    fn word(&self, op: &Op) -> i16 {
        match op {
            Op::LoadConst(value) => *value as i16,
            Op::Load(operand) => {
                let Place::Fixed(of, at) = operand.place else { panic!("{op}") };
                let byte = |n| self.bytes[&(area(of), at.byte() + n)];
                i16::from_be_bytes([byte(0), byte(1)])
            }
            _ => panic!("{op}"),
        }
    }

    fn store(&mut self, op: &Op, value: i16) {
        let Op::Transfer(operand) = op else { panic!("{op}") };
        let Place::Fixed(of, at) = operand.place else { panic!("{op}") };
        for (n, byte) in (0..).zip(value.to_be_bytes()) {
            self.bytes.insert((area(of), at.byte() + n), byte);
        }
    }

    fn rung(&mut self, rung: &Rung) {
        let power = rung.logic.as_ref().is_none_or(|logic| self.node(logic));
        for end in &rung.ends {
            match end {
                End::Coil(coil) => {
                    self.values.insert(coil.id, power);
                    match coil.op.op {
                        Op::Assign(at) => self.put(at, power),
                        Op::Set(at) if power => self.put(at, true),
                        Op::Reset(at) if power => self.put(at, false),
                        _ => {}
                    }
                }
                End::Branch { id, carried, arms, .. } => {
                    self.values.insert(*id, power);
                    self.put(*carried, power);
                    arms.iter().for_each(|arm| self.rung(arm));
                }
            }
        }
    }

    fn node(&mut self, node: &Node) -> bool {
        let value = match &node.kind {
            Kind::Contact { negate, test: BitTest::Bit(at) } => self.bit(*at) != *negate,
            Kind::Wire { negate, carried } => self.bit(*carried) != *negate,
            Kind::Series { items, .. } => self.series(items),
            // Every leg is run.
            Kind::Parallel(legs) => legs.iter().fold(false, |any, leg| self.node(leg) | any),
            Kind::Xor(legs) => legs.iter().fold(false, |odd, leg| self.node(leg) ^ odd),
            Kind::Negated(inner) => !self.node(inner),
            Kind::Compare { values: [a, b], how, .. } => {
                let (a, b) = (self.word(&a.op), self.word(&b.op));
                match how {
                    ob1_ir::Compare::Equal => a == b,
                    ob1_ir::Compare::NotEqual => a != b,
                    ob1_ir::Compare::Greater => a > b,
                    ob1_ir::Compare::Less => a < b,
                    ob1_ir::Compare::GreaterEqual => a >= b,
                    ob1_ir::Compare::LessEqual => a <= b,
                }
            }
            Kind::Box(inner) => {
                let input = inner.input.as_ref().is_none_or(|input| self.node(input));
                self.body(&inner.body, input)
            }
            other => panic!("{other:?}"),
        };
        self.values.insert(node.id, value);
        value
    }

    fn series(&mut self, items: &[Node]) -> bool {
        let mut all = true;
        for item in items {
            all = match &item.kind {
                Kind::Not => !all,
                Kind::Edge { rising, memory, .. } => {
                    let before = self.bit(*memory);
                    self.put(*memory, all);
                    if *rising { all && !before } else { !all && before }
                }
                Kind::Connector(at) => {
                    self.put(*at, all);
                    all
                }
                _ => {
                    let value = self.node(item);
                    all && value
                }
            };
            self.values.insert(item.id, all);
            if !matches!(item.kind, Kind::Not | Kind::Edge { .. } | Kind::Connector(_)) {
                // In a function plan a part begins anew.
                self.values.remove(&item.id);
            }
        }
        all
    }

    fn body(&mut self, body: &Body, input: bool) -> bool {
        match body {
            Body::Latch { place, set_first, second } => {
                if input {
                    self.put(*place, *set_first);
                }
                if second.as_ref().is_some_and(|second| self.node(second)) {
                    self.put(*place, !set_first);
                }
                self.bit(*place)
            }
            Body::Move { loads, ops, stores, eno, .. } => {
                if !input {
                    return false;
                }
                let first = self.word(&loads[0].op);
                let (value, overflow) = match ops.first().map(|op| &op.op) {
                    None => (first, false),
                    Some(Op::AddConst { value, .. }) => (first.wrapping_add(*value as i16), false),
                    Some(Op::Arithmetic(..)) => first.overflowing_add(self.word(&loads[1].op)),
                    Some(other) => panic!("{other}"),
                };
                self.store(&stores[0].op, value);
                *eno != Eno::NoOverflow || !overflow
            }
            other => panic!("{other:?}"),
        }
    }
}

/// The network of a block, and the block.
fn network(tree: &Tree) -> (Network, CodeBlock) {
    let made = generate(tree);
    let ops = made.iter().map(|made| match (&made.op, made.to) {
        (Op::Jump(jump, _), Some(to)) => Op::Jump(*jump, to as u32),
        (op, _) => op.clone(),
    });
    let mut code = block(fc(1), Interface::default(), ops.chain([Op::Nop]).collect());
    if let Some(last) = code.code.last_mut() {
        *last = Stmt { network: 2, ..last.clone() };
    }
    let (none, listing) = (BTreeMap::new(), Listing::default());
    let view = View { mnemonics: Mnemonics::German, callees: &|_| None, symbols: &none, listing: &listing };
    (view.networks(&code).swap_remove(0), code)
}

/// OB 1: the memory as it is given, the network, what it has left of the image.
fn around(model: &Model) -> CodeBlock {
    let mut ops = Vec::new();
    let double = |of: u8, byte: u32| {
        let bytes = [0, 1, 2, 3].map(|n| model.bytes[&(of, byte + n)]);
        Op::LoadConst(u32::from_be_bytes(bytes))
    };
    for (of, bytes) in [(Area::Input, IMAGE), (Area::Output, IMAGE), (Area::Memory, MEMORY)] {
        for byte in (0..bytes).step_by(4) {
            ops.push(double(area(of), byte));
            ops.push(transfer(operand(Width::DWord, place(of, byte, 0))));
        }
    }
    ops.push(call(fc(1), vec![]));
    for (of, to) in [(Area::Input, COPY), (Area::Output, COPY + IMAGE)] {
        for byte in (0..IMAGE).step_by(4) {
            ops.push(Op::Load(operand(Width::DWord, place(of, byte, 0))));
            ops.push(transfer(md(to + byte)));
        }
    }
    ob1(ops)
}

fn pass(bench: &mut Bench) -> Pass {
    let mut looker = Looker::of(&mut bench.cpu).expect("the first");
    bench.run();
    let wait = Span::from_secs(2).nanos();
    let order = PassOrder { block: fc(1), from: None, db: 0, first: 0, count: 512, wait, before: false };
    looker.link.hand(PassJob::new(1, order)).expect("room");
    for _ in 0..30 {
        bench.clock.now += 100 * MS;
        bench.cycle();
        if let Some(Job::Pass(job)) = looker.link.take() {
            return job.into_pass();
        }
    }
    panic!("it does not come back");
}

fn check(seed: u64) {
    let tree = Maker::new(seed, 4 + (seed % 25) as u32, true).tree(2 + (seed % 3) as u32);
    let (network, code) = network(&tree);
    let tree = read_step7(&network).unwrap_or_else(|why| panic!("seed {seed}: {why}"));
    let mut rng = fastrand::Rng::with_seed(seed);
    let mut model = Model { bytes: BTreeMap::new(), carried: BTreeMap::new(), values: BTreeMap::new() };
    for (of, bytes) in [(Area::Input, IMAGE), (Area::Output, IMAGE), (Area::Memory, MEMORY)] {
        for byte in 0..bytes {
            model.bytes.insert((area(of), byte), rng.u8(..));
        }
    }
    let mut bench = Bench::new(&program(vec![around(&model), code.clone()], vec![]));
    tree.rungs.iter().for_each(|rung| model.rung(rung));
    let pass = pass(&mut bench);
    for ((of, byte), value) in &model.bytes {
        let at = match Area::from_pointer_code(*of) {
            Some(Area::Input) => COPY + byte,
            Some(Area::Output) => COPY + IMAGE + byte,
            _ => *byte,
        };
        assert_eq!(bench.mb(at), u32::from(*value), "seed {seed}: byte {byte} of area {of}");
    }
    if code.code.len() > pass.lines.len() {
        return;
    }
    let line = |op: u32| pass.lines.get(op as usize).copied();
    let shown = flow(&network, &tree, true, &line);
    for (id, value) in &model.values {
        let state = shown.nodes[*id as usize][2];
        let wanted = if *value { State::On } else { State::Off };
        // An open output tells nothing.
        assert!(state == wanted || state == State::Unknown, "seed {seed}, node {id}: {state:?}, not {value}");
    }
    let mut ends = Vec::new();
    tree.rungs.iter().for_each(|rung| coils(rung, &mut ends));
    let ladder = flow(&network, &tree, false, &line);
    for id in ends {
        let wanted = if model.values[&id] { State::On } else { State::Off };
        assert_eq!(shown.nodes[id as usize], [wanted; 3], "seed {seed}, end {id} of the function plan");
        assert_eq!(ladder.nodes[id as usize], [wanted; 3], "seed {seed}, end {id} of {}", is_ladder(&tree));
    }
    assert_eq!(flow(&network, &tree, true, &|_| None).rail, State::Unknown);
}

fn coils(rung: &Rung, out: &mut Vec<u32>) {
    for end in &rung.ends {
        match end {
            End::Coil(coil) => out.push(coil.id),
            End::Branch { id, arms, .. } => {
                out.push(*id);
                arms.iter().for_each(|arm| coils(arm, out));
            }
        }
    }
}

#[test]
fn networks_do_and_show_what_their_trees_say() {
    (0..states()).for_each(check);
}

#[test]
fn what_did_not_run_is_black() {
    let at = |of, bit| Place::Fixed(of, BitAddr(bit));
    let (e, m) = (at(Area::Input, 0), at(Area::Memory, 8));
    let tree = Tree {
        rungs: vec![Rung {
            logic: Some(Node { id: 0, statements: 0..0, kind: Kind::Contact { negate: false, test: BitTest::Bit(e) } }),
            ends: vec![End::Coil(ob1_ladder::tree::Coil {
                id: 0,
                statements: 0..0,
                value: None,
                saves: ob1_ladder::tree::Saves::Nothing,
                op: ob1_ladder::tree::Value { statement: 0, op: Op::Assign(m) },
            })],
        }],
        nodes: 0,
        as_step7: true,
    };
    let (network, _) = network(&tree);
    let tree = read_step7(&network).expect("it is drawn");
    let black = flow(&network, &tree, false, &|_| None);
    assert!(black.nodes.iter().flatten().all(|state| *state == State::Unknown));
}
