//! Trees drawn at random: all elements, every nesting, in the forms that STEP 7 writes.

use fastrand::Rng;
use ob1_ir::{
    AccuOp, Arg, BitTest, Call, CallMode, Compare, Convert, DbRegister, Jump, MathFn, Number, NumberFormat, Op,
    Operand, Place, Shift, StatusBit, Target, Width, WordLogic,
};
use ob1_ladder::tree::{Body, BoxNode, CallInput, Coil, End, Eno, Input, Kind, Node, Rung, Saves, Tree, Value};
use ob1_model::{Area, BitAddr, BlockId, BlockKind, TimerKind};

/// What is drawn.
pub(crate) struct Maker {
    pub(crate) rng: Rng,
    /// The compiler's next bit.
    carried: u32,
    left: u32,
    /// Only what has an outcome that can be evaluated bit by bit: no status bits, no jumps out, no MCR.
    pub(crate) plain: bool,
}

fn node(kind: Kind) -> Node {
    Node { id: 0, statements: 0..0, kind }
}

fn value(op: Op) -> Value {
    Value { statement: 0, op }
}

fn memory(bit: u32) -> Place {
    Place::Fixed(Area::Memory, BitAddr(bit))
}

impl Maker {
    pub(crate) fn new(seed: u64, size: u32, plain: bool) -> Self {
        Self { rng: Rng::with_seed(seed), carried: 20 * 8, left: size, plain }
    }

    fn carried(&mut self) -> Place {
        self.carried += 1;
        Place::Fixed(Area::Local, BitAddr(self.carried - 1))
    }

    fn bit(&mut self) -> Place {
        let at = BitAddr(self.rng.u32(0..64));
        match self.rng.u32(0..8) {
            0..=2 => Place::Fixed(Area::Input, at),
            3 => Place::Fixed(Area::Output, at),
            4 if !self.plain => Place::InDb(5, at),
            _ => Place::Fixed(Area::Memory, at),
        }
    }

    /// A bit that the program writes.
    fn written(&mut self) -> Place {
        let at = BitAddr(self.rng.u32(0..64));
        if self.rng.bool() { Place::Fixed(Area::Output, at) } else { Place::Fixed(Area::Memory, at) }
    }

    /// A bit of its own, for edges.
    fn edge(&mut self) -> Place {
        memory(800 + self.rng.u32(0..200))
    }

    fn word(&mut self) -> Operand {
        let at = BitAddr::byte_addr(20 + 2 * self.rng.u32(0..20));
        Operand { width: Width::Word, place: Place::Fixed(Area::Memory, at) }
    }

    fn load(&mut self) -> Value {
        value(if self.rng.bool() { Op::Load(self.word()) } else { Op::LoadConst(self.rng.u32(0..0x7FFF)) })
    }

    fn store(&mut self) -> Value {
        value(Op::Transfer(self.word()))
    }

    fn number(&mut self) -> Number {
        Number::Fixed(self.rng.u16(1..30))
    }

    fn test(&mut self) -> BitTest {
        match self.rng.u32(0..10) {
            0 if !self.plain => BitTest::Timer(self.number()),
            1 if !self.plain => BitTest::Counter(self.number()),
            2 if !self.plain => BitTest::Status(*self.rng.choice(&StatusBit::ALL).unwrap_or(&StatusBit::Overflow)),
            _ => BitTest::Bit(self.bit()),
        }
    }

    fn contact(&mut self) -> Node {
        let test = self.test();
        node(Kind::Contact { negate: self.rng.u32(0..3) == 0, test })
    }

    /// Logic for an input or before a coil.
    pub(crate) fn logic(&mut self, depth: u32) -> Node {
        if depth == 0 || self.left == 0 {
            return self.contact();
        }
        self.left -= 1;
        match self.rng.u32(0..12) {
            0..=2 => self.contact(),
            3..=5 => self.series(depth, None),
            6..=7 => self.parallel(depth, None),
            8 => node(Kind::Xor((0..self.rng.u32(1..4)).map(|_| self.leg(depth)).collect())),
            9 => self.compare(),
            _ => self.boxed(depth, None, true),
        }
    }

    fn compare(&mut self) -> Node {
        let format = if self.plain { NumberFormat::Int } else { *self.rng.choice(&NumberFormat::ALL).expect("some") };
        let how = *self.rng.choice(&Compare::ALL).expect("some");
        node(Kind::Compare { values: [self.load(), self.load()], format, how })
    }

    fn leg(&mut self, depth: u32) -> Node {
        let inner = self.logic(depth - 1);
        let plain = matches!(inner.kind, Kind::Contact { .. });
        if !plain && self.rng.u32(0..8) == 0 { node(Kind::Negated(Box::new(inner))) } else { inner }
    }

    fn series(&mut self, depth: u32, first: Option<Node>) -> Node {
        let mut items = vec![first.unwrap_or_else(|| self.leg(depth))];
        for _ in 0..self.rng.u32(1..4) {
            items.push(match self.rng.u32(0..12) {
                0 => node(Kind::Not),
                1 => node(Kind::Edge { rising: self.rng.bool(), memory: self.edge(), boxed: self.rng.u32(0..4) == 0 }),
                2 => node(Kind::Connector(self.written())),
                _ => self.leg(depth),
            });
        }
        node(Kind::Series { items, bare: false })
    }

    fn parallel(&mut self, depth: u32, first: Option<Node>) -> Node {
        let mut legs: Vec<Node> = first.into_iter().collect();
        while legs.len() < 2 || self.rng.u32(0..3) == 0 {
            legs.push(self.leg(depth));
        }
        node(Kind::Parallel(legs))
    }

    fn maybe(&mut self, depth: u32) -> Option<Node> {
        self.rng.bool().then(|| self.logic(depth - 1))
    }

    fn outputs(&mut self, loads: [Op; 2]) -> [Option<[Value; 2]>; 2] {
        loads.map(|load| self.rng.bool().then(|| [value(load), self.store()]))
    }

    fn boxed(&mut self, depth: u32, first: Option<Node>, used: bool) -> Node {
        let has_first = first.is_some();
        let input = Some(first.unwrap_or_else(|| self.logic(depth - 1)));
        let number = self.number();
        let kind = self.rng.u32(0..7);
        let body = match if self.plain && kind > 0 { 4 } else { kind } {
            0 | 1 => Body::Latch { place: self.written(), set_first: self.rng.bool(), second: self.maybe(depth) },
            2 => Body::Timer {
                time: value(Op::LoadConst(0x0100 + self.rng.u32(0..0x99))),
                start: value(Op::StartTimer(TimerKind::ALL[self.rng.usize(0..5)], number)),
                reset: self.maybe(depth),
                outputs: self.outputs([Op::LoadTimer(number), Op::LoadTimerBcd(number)]),
            },
            3 => {
                let up = self.rng.bool();
                let count = if up { Op::CountUp(number) } else { Op::CountDown(number) };
                Body::Counter {
                    count: value(count),
                    second: if up { self.maybe(depth) } else { None },
                    set: self.maybe(depth).map(|node| (node, value(Op::LoadConst(self.rng.u32(0..10))))),
                    reset: self.maybe(depth),
                    outputs: self.outputs([Op::LoadCounter(number), Op::LoadCounterBcd(number)]),
                }
            }
            6 => return self.call(depth, input, used),
            _ => {
                let input = if !has_first && self.rng.u32(0..4) == 0 { None } else { input };
                return node(Kind::Box(Box::new(BoxNode { input, body: self.moved(used), used })));
            }
        };
        node(Kind::Box(Box::new(BoxNode { input, body, used })))
    }

    fn moved(&mut self, used: bool) -> Body {
        let format = *self.rng.choice(&NumberFormat::ALL).expect("some");
        let (loads, ops): (u32, Vec<Op>) = match self.rng.u32(0..if self.plain { 4 } else { 10 }) {
            0 | 1 => (1, vec![]),
            2 => (2, vec![Op::Arithmetic(NumberFormat::Int, AccuOp::Add)]),
            3 => (1, vec![Op::AddConst { format: NumberFormat::Int, value: self.rng.i32(-9..9) }]),
            4 => {
                (2, vec![Op::Arithmetic(format, if format == NumberFormat::DInt { AccuOp::Mod } else { AccuOp::Mul })])
            }
            5 => (2, vec![Op::WordLogic(*self.rng.choice(&WordLogic::ALL).expect("some"), None)]),
            6 => (2, vec![Op::Shift(*self.rng.choice(&Shift::ALL).expect("some"), None)]),
            7 => (1, vec![Op::Shift(Shift::LeftWord, Some(self.rng.u8(0..15)))]),
            8 => (1, vec![Op::Convert(Convert::Itd), Op::Convert(Convert::Dtr)]),
            _ => (1, vec![Op::Math(*self.rng.choice(&MathFn::ALL).expect("some"))]),
        };
        let eno = match (used, ops.is_empty()) {
            (false, _) => Eno::Open,
            (true, true) => Eno::Set,
            // An addition of a constant leaves OV as it is.
            (true, false) if self.plain && matches!(ops.first(), Some(Op::AddConst { .. })) => Eno::Set,
            (true, false) => Eno::NoOverflow,
        };
        let loads = (0..loads).map(|_| self.load()).collect();
        Body::Move {
            loads,
            ops: ops.into_iter().map(value).collect(),
            stores: vec![self.store()],
            eno,
            unmarked: false,
        }
    }

    /// A call of FC 7: a, b BOOL and c INT in, q BOOL and w INT out.
    fn call(&mut self, depth: u32, input: Option<Node>, used: bool) -> Node {
        let mut inputs = Vec::new();
        let mut args = Vec::new();
        let bit = |place| Arg::Operand(Operand { width: Width::Bit, place });
        for argument in 0..2 {
            let place = if self.rng.bool() {
                let carried = self.carried();
                inputs.push(CallInput { argument, input: Input { logic: self.logic(depth - 1), carried } });
                carried
            } else {
                memory(self.rng.u32(0..64))
            };
            args.push(bit(place));
        }
        args.push(Arg::Const(self.rng.u32(0..100)));
        args.push(bit(self.written()));
        args.push(Arg::Operand(self.word()));
        let target = Target::Block(BlockId::new(BlockKind::Fc, 7));
        let call = Op::Call(Box::new(Call { mode: CallMode::Call, target, instance: None, args }));
        let body = Body::Call { call: value(call), inputs, unmarked: false };
        node(Kind::Box(Box::new(BoxNode { input, body, used })))
    }

    fn coil(&mut self, last: bool) -> Coil {
        let number = self.number();
        let most = match (self.plain, last) {
            (true, _) => 6,
            (false, false) => 10,
            (false, true) => 13,
        };
        let (value_of, saves, op) = match self.rng.u32(0..most) {
            0..=3 => (None, Saves::Nothing, Op::Assign(self.written())),
            4 => (None, Saves::Nothing, Op::Set(self.written())),
            5 => (None, Saves::Nothing, Op::Reset(self.written())),
            6 => {
                let time = Op::LoadConst(0x0100 + self.rng.u32(0..0x99));
                let start = Op::StartTimer(TimerKind::ALL[self.rng.usize(0..5)], number);
                (Some(value(time)), Saves::Nothing, start)
            }
            7 => (None, Saves::Nothing, Op::CountUp(number)),
            8 => {
                (None, Saves::Nothing, if self.rng.bool() { Op::ResetTimer(number) } else { Op::ResetCounter(number) })
            }
            9 => (Some(value(Op::LoadConst(7))), Saves::Nothing, Op::SetCounter(number)),
            10 => (None, Saves::Rlo, Op::EndIf),
            11 => (None, Saves::Nothing, Op::Jump(*self.rng.choice(&[Jump::IfRlo, Jump::IfNotRlo]).expect("some"), 0)),
            _ => (None, Saves::Nothing, Op::SaveRlo),
        };
        Coil { id: 0, statements: 0..0, value: value_of, saves, op: value(op) }
    }

    fn ends(&mut self, depth: u32) -> Vec<End> {
        if depth > 0 && self.left > 0 && self.rng.u32(0..4) == 0 {
            self.left -= 1;
            let carried = self.carried();
            let arms = (0..self.rng.u32(2..4)).map(|_| self.arm(depth - 1, carried)).collect();
            return vec![End::Branch { id: 0, statements: 0..0, carried, arms }];
        }
        let count = self.rng.u32(1..4);
        (0..count).map(|at| End::Coil(self.coil(at + 1 == count))).collect()
    }

    fn arm(&mut self, depth: u32, carried: Place) -> Rung {
        let depth = depth.max(1);
        let wire = node(Kind::Wire { negate: self.rng.u32(0..8) == 0, carried });
        match self.rng.u32(0..6) {
            0 => Rung { logic: Some(wire), ends: self.ends(depth - 1) },
            1 | 2 => Rung { logic: Some(self.series(depth, Some(wire))), ends: self.ends(depth - 1) },
            3 => Rung { logic: Some(self.parallel(depth, Some(wire))), ends: self.ends(depth - 1) },
            4 => Rung { logic: Some(self.boxed(depth, Some(wire), true)), ends: self.ends(depth - 1) },
            _ => Rung { logic: Some(self.boxed(depth, Some(wire), false)), ends: Vec::new() },
        }
    }

    /// A network.
    pub(crate) fn tree(&mut self, depth: u32) -> Tree {
        let rung = match self.rng.u32(0..12) {
            0 => Rung { logic: Some(self.boxed(depth, None, false)), ends: Vec::new() },
            1 if !self.plain => {
                let (saves, op) = match self.rng.u32(0..4) {
                    0 => (Saves::One, Op::End),
                    1 => (Saves::Nothing, Op::OpenDb(DbRegister::Db, Number::Fixed(5))),
                    2 => (Saves::Nothing, Op::McrActivate),
                    _ => (Saves::Nothing, Op::Jump(Jump::Always, 0)),
                };
                let coil = Coil { id: 0, statements: 0..0, value: None, saves, op: value(op) };
                Rung { logic: None, ends: vec![End::Coil(coil)] }
            }
            _ => Rung { logic: Some(self.logic(depth)), ends: self.ends(depth) },
        };
        Tree { rungs: vec![rung], nodes: 0, as_step7: true }
    }
}

/// A tree without the numbers of its nodes and statements: what two that mean the same have alike.
pub(crate) fn bare(tree: &Tree) -> String {
    let text = format!("{:?}", tree.rungs);
    let mut out = String::with_capacity(text.len());
    let mut rest = text.as_str();
    'outer: while !rest.is_empty() {
        for name in ["statements: ", "statement: ", "id: "] {
            if let Some(behind) = rest.strip_prefix(name)
                && !out.ends_with(|c: char| c.is_alphanumeric() || c == '_')
                && behind.starts_with(|c: char| c.is_ascii_digit())
            {
                rest = behind.trim_start_matches(|c: char| c.is_ascii_digit() || c == '.');
                continue 'outer;
            }
        }
        let mut chars = rest.chars();
        out.extend(chars.next());
        rest = chars.as_str();
    }
    out
}
