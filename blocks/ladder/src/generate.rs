//! A tree to statements, as STEP 7's editors write them. Where brackets and `NOP 0` stand follows from the tree.

use ob1_ir::{BitTest, Jump, Logic, Op, Place, StatusBit};

use crate::tree::{Body, BoxNode, Coil, End, Eno, Input, Kind, Node, Rung, Saves, Tree, Value};

/// A statement made of a tree.
#[derive(Clone, Debug, PartialEq)]
pub struct Made {
    /// Its operation; the target of a box's own jump is not known to it.
    pub op: Op,
    /// The place among the generated statements that a box's own jump leads to.
    pub to: Option<usize>,
}

/// The statements of a tree.
pub fn generate(tree: &Tree) -> Vec<Made> {
    let mut out = Generator { made: Vec::new() };
    tree.rungs.iter().for_each(|rung| out.rung(rung));
    out.made
}

struct Generator {
    made: Vec<Made>,
}

/// What stands before an operand: `U O X`.
const fn scan(logic: Logic, negate: bool, test: BitTest) -> Op {
    Op::Scan { logic, negate, test }
}

const RESULT: BitTest = BitTest::Status(StatusBit::BinaryResult);

impl Generator {
    fn put(&mut self, op: Op) {
        self.made.push(Made { op, to: None });
    }

    fn value(&mut self, value: &Value) {
        self.put(value.op.clone());
    }

    fn rung(&mut self, rung: &Rung) {
        if let Some(logic) = &rung.logic {
            let mut inputs = Vec::new();
            call_inputs(logic, &mut inputs);
            for input in inputs {
                self.argument(&input.logic);
                self.put(Op::Assign(input.carried));
                self.put(Op::Build(103));
            }
            let straight = matches!(logic.kind, Kind::Wire { negate: false, .. })
                && matches!(rung.ends.first(), Some(End::Coil(_)));
            self.logic(logic);
            if straight {
                self.put(Op::Build(102));
            }
        }
        rung.ends.iter().for_each(|end| self.end(end));
    }

    fn end(&mut self, end: &End) {
        match end {
            End::Coil(Coil { value, saves, op, .. }) => {
                if let Some(value) = value {
                    self.value(value);
                }
                if *saves == Saves::One {
                    self.put(Op::SetRlo);
                }
                if *saves != Saves::Nothing {
                    self.put(Op::SaveRlo);
                }
                self.value(op);
            }
            End::Branch { carried, arms, .. } => {
                self.put(Op::Assign(*carried));
                arms.iter().for_each(|arm| self.rung(arm));
            }
        }
    }

    /// Logic that begins a string, without brackets of its own.
    fn logic(&mut self, node: &Node) {
        match &node.kind {
            Kind::Series { items, bare } => self.series(items, *bare),
            Kind::Parallel(legs) => self.parallel(legs),
            Kind::Xor(legs) => legs.iter().for_each(|leg| self.leg(leg, Logic::Xor)),
            Kind::Compare { values, format, how } => {
                values.iter().for_each(|value| self.value(value));
                self.put(Op::Compare(*format, *how));
            }
            Kind::Box(node) => self.boxed(node),
            _ => self.element(node),
        }
    }

    /// The input of a box: what is neither contact nor series is bracketed.
    fn argument(&mut self, node: &Node) {
        match &node.kind {
            Kind::Series { items, bare } => self.series(items, *bare),
            _ => self.element(node),
        }
    }

    fn series(&mut self, items: &[Node], bare: bool) {
        for (at, item) in items.iter().enumerate() {
            if at == 0 && bare { self.logic(item) } else { self.element(item) }
        }
    }

    fn element(&mut self, node: &Node) {
        match &node.kind {
            Kind::Contact { negate, test } => self.put(scan(Logic::And, *negate, *test)),
            Kind::Wire { negate, carried } => self.put(scan(Logic::And, *negate, BitTest::Bit(*carried))),
            Kind::Not => self.put(Op::NotRlo),
            Kind::Edge { rising, memory, boxed } => {
                if *boxed {
                    self.put(Op::Build(100));
                }
                self.put(if *rising { Op::EdgePositive(*memory) } else { Op::EdgeNegative(*memory) });
            }
            Kind::Connector(place) => {
                self.put(Op::Assign(*place));
                self.put(scan(Logic::And, false, BitTest::Bit(*place)));
            }
            Kind::Negated(inner) => self.bracket(Logic::And, true, inner),
            _ => self.bracket(Logic::And, false, node),
        }
    }

    fn bracket(&mut self, logic: Logic, negate: bool, inner: &Node) {
        self.put(Op::Open { logic, negate });
        self.logic(inner);
        self.put(Op::Close);
    }

    fn parallel(&mut self, legs: &[Node]) {
        let last = legs.iter().rposition(acts_on_all);
        for (at, leg) in legs.iter().enumerate() {
            match &leg.kind {
                // What acts on the whole RLO would take the legs above with it.
                Kind::Series { items, bare: false } if at == 0 || last.is_none_or(|last| last < at) => {
                    if at > 0 {
                        self.put(Op::OrBranch);
                    }
                    self.series(items, false);
                }
                _ => self.leg(leg, Logic::Or),
            }
        }
    }

    /// A leg of a parallel or of an exclusive or: an operand, or brackets.
    fn leg(&mut self, leg: &Node, logic: Logic) {
        match &leg.kind {
            Kind::Contact { negate, test } => self.put(scan(logic, *negate, *test)),
            Kind::Wire { negate, carried } => self.put(scan(logic, *negate, BitTest::Bit(*carried))),
            Kind::Negated(inner) => self.bracket(logic, true, inner),
            _ => self.bracket(logic, false, leg),
        }
    }

    /// An input that is open has a `NOP 0`.
    fn pin(&mut self, node: Option<&Node>, does: Op) {
        match node {
            Some(node) => {
                self.argument(node);
                self.put(does);
            }
            None => self.put(Op::Nop),
        }
    }

    fn outputs(&mut self, outputs: &[Option<[Value; 2]>; 2]) {
        for output in outputs {
            match output {
                Some(values) => values.iter().for_each(|value| self.value(value)),
                None => self.put(Op::Nop),
            }
        }
    }

    /// Q, or a `NOP 0` for it.
    fn output(&mut self, used: bool, test: BitTest) {
        self.put(if used { scan(Logic::And, false, test) } else { Op::Nop });
    }

    fn boxed(&mut self, node: &BoxNode) {
        let BoxNode { input, body, used } = node;
        if let Some(input) = input {
            self.argument(input);
        }
        match body {
            Body::Latch { place, set_first, second } => {
                let (first, other) = (Op::Set(*place), Op::Reset(*place));
                let (first, other) = if *set_first { (first, other) } else { (other, first) };
                self.put(first);
                self.pin(second.as_ref(), other);
                self.output(*used, BitTest::Bit(*place));
            }
            Body::Timer { time, start, reset, outputs } => {
                self.value(time);
                self.value(start);
                let Some(number) = start.op.number().copied() else { return };
                self.pin(reset.as_ref(), Op::ResetTimer(number));
                self.outputs(outputs);
                self.output(*used, BitTest::Timer(number));
            }
            Body::Counter { count, second, set, reset, outputs } => {
                self.value(count);
                let Some(number) = count.op.number().copied() else { return };
                match second {
                    Some(node) => {
                        self.argument(node);
                        let up = matches!(count.op, Op::CountUp(_));
                        self.put(if up { Op::CountDown(number) } else { Op::CountUp(number) });
                    }
                    None => self.put(Op::Build(101)),
                }
                match set {
                    Some((node, value)) => {
                        self.argument(node);
                        self.value(value);
                        self.put(Op::SetCounter(number));
                    }
                    None => {
                        self.put(Op::Nop);
                        self.put(Op::Nop);
                    }
                }
                self.pin(reset.as_ref(), Op::ResetCounter(number));
                self.outputs(outputs);
                self.output(*used, BitTest::Counter(number));
            }
            Body::Move { .. } | Body::Call { .. } => self.enabled(input.is_some(), body, *used),
        }
    }

    fn enabled(&mut self, has_input: bool, body: &Body, used: bool) {
        let jump = self.made.len();
        if has_input {
            self.put(Op::Jump(Jump::IfNotRloSaveBr, 0));
        }
        let unmarked = match body {
            Body::Move { loads, ops, stores, eno, unmarked } => {
                loads.iter().chain(ops).chain(stores).for_each(|value| self.value(value));
                match eno {
                    Eno::Open => {}
                    Eno::Set => self.put(Op::SetRlo),
                    Eno::NoOverflow => self.put(scan(Logic::And, true, BitTest::Status(StatusBit::Overflow))),
                }
                if *eno != Eno::Open {
                    self.put(Op::SaveRlo);
                    self.put(Op::ClearRlo);
                }
                *unmarked
            }
            Body::Call { call, unmarked, .. } => {
                self.value(call);
                *unmarked
            }
            _ => false,
        };
        let end = self.made.len();
        if let Some(made) = self.made.get_mut(jump).filter(|_| has_input) {
            made.to = Some(end);
        }
        if !unmarked {
            self.output(used, RESULT);
        }
    }
}

/// An edge, NOT or connector is somewhere in it: those act on the whole RLO.
fn acts_on_all(leg: &Node) -> bool {
    matches!(leg.kind, Kind::Not | Kind::Edge { .. } | Kind::Connector(_))
        || leg.children().into_iter().any(acts_on_all)
}

/// The logic at inputs of calls, which stands before the rung.
fn call_inputs<'n>(node: &'n Node, out: &mut Vec<&'n Input>) {
    if let Kind::Box(inner) = &node.kind {
        if let Some(input) = &inner.input {
            call_inputs(input, out);
        }
        inner.body.others().into_iter().for_each(|node| call_inputs(node, out));
        if let Body::Call { inputs, .. } = &inner.body {
            for input in inputs {
                call_inputs(&input.input.logic, out);
                out.push(&input.input);
            }
        }
        return;
    }
    node.children().into_iter().for_each(|child| call_inputs(child, out));
}

/// The places that the compiler's bits of this rung lie at.
pub fn carried(tree: &Tree) -> Vec<Place> {
    let mut all = Vec::new();
    tree.rungs.iter().for_each(|rung| carried_by(rung, &mut all));
    all
}

fn carried_by(rung: &Rung, all: &mut Vec<Place>) {
    if let Some(logic) = &rung.logic {
        let mut inputs = Vec::new();
        call_inputs(logic, &mut inputs);
        all.extend(inputs.iter().map(|input| input.carried));
    }
    for end in &rung.ends {
        if let End::Branch { carried, arms, .. } = end {
            all.push(*carried);
            arms.iter().for_each(|arm| carried_by(arm, all));
        }
    }
}
