//! What a network is: rungs of series and parallels, boxes, coils, branches. Every node keeps the range of its
//! statements. Brackets are not kept: where they stand follows from the tree.

use std::ops::Range;

use ob1_ir::{BitTest, Compare, NumberFormat, Op, Place};

/// A network that can be drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Tree {
    /// One below the other. More than one, or none, only where STEP 7 itself would show statements.
    pub rungs: Vec<Rung>,
    /// Nodes are numbered from 0 to this, in the order of their first statements.
    pub nodes: u32,
    /// STEP 7 would draw it too: one rung, each `NOP 0` and `BLD` in its place.
    pub as_step7: bool,
}

/// What begins at the rail, or an arm, which begins at its branch.
#[derive(Clone, Debug, PartialEq)]
pub struct Rung {
    /// What the ends hang on; `None`: the rail itself.
    pub logic: Option<Node>,
    /// Coils or one branch; none behind a box whose output is open.
    pub ends: Vec<End>,
}

/// The logic at a Boolean input of a call, and the bit that carries its result there.
#[derive(Clone, Debug, PartialEq)]
pub struct Input {
    /// The logic in front of the input.
    pub logic: Node,
    /// The compiler's bit, in local data that nobody has declared.
    pub carried: Place,
}

/// A part of the logic.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Its number within the tree.
    pub id: u32,
    /// Its statements, as indices into [`crate::Network::statements`].
    pub statements: Range<u32>,
    /// What it is, with its parts.
    pub kind: Kind,
}

/// The kinds of parts.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// `U b`, `UN b`, `O b`, `X b`.
    Contact {
        /// Normally closed: it asks for 0.
        negate: bool,
        /// What it asks: a bit, timer, counter or condition.
        test: BitTest,
    },
    /// The begin of an arm: the bit that keeps what its branch had.
    Wire {
        /// The arm begins with `UN t` instead of `U t`.
        negate: bool,
        /// The compiler's bit that keeps it.
        carried: Place,
    },
    /// `NOT`: what comes from the left, inverted.
    Not,
    /// `FP m`, `FN m`.
    Edge {
        /// True for `FP`, false for `FN`.
        rising: bool,
        /// The bit with the state before.
        memory: Place,
        /// `BLD 100` stands before it: the box POS or NEG.
        boxed: bool,
    },
    /// `= b; U b` within a series: the bit gets what has come so far.
    Connector(Place),
    /// One behind the other.
    Series {
        /// The parts, from left to right.
        items: Vec<Node>,
        /// The first item stands without the brackets that STEP 7 would write.
        bare: bool,
    },
    /// One below the other.
    Parallel(Vec<Node>),
    /// Exclusive or of these parts.
    Xor(Vec<Node>),
    /// `UN( .. )`, `ON( .. )`, `XN( .. )`.
    Negated(Box<Node>),
    /// `L v; L v; >I`.
    Compare {
        /// The two values that are loaded.
        values: [Value; 2],
        /// I, D or R.
        format: NumberFormat,
        /// How they are compared.
        how: Compare,
    },
    /// A box with inputs, outputs, and perhaps the one that goes on.
    Box(Box<BoxNode>),
}

/// A box with its pins.
#[derive(Clone, Debug, PartialEq)]
pub struct BoxNode {
    /// What comes from the left to its first input: S, R, CU, EN. `None`: the rail, only at EN.
    pub input: Option<Node>,
    /// What it does, with its other pins.
    pub body: Body,
    /// Its output goes on: Q or ENO.
    pub used: bool,
}

/// What a box does.
#[derive(Clone, Debug, PartialEq)]
pub enum Body {
    /// A flip-flop: SR and RS.
    Latch {
        /// The bit that it sets and resets.
        place: Place,
        /// `S` first: reset has priority, SR.
        set_first: bool,
        /// The other input: R of SR, S of RS. `None`: open.
        second: Option<Node>,
    },
    /// S_PULSE, S_PEXT, S_ODT, S_ODTS, S_OFFDT.
    Timer {
        /// TV: the time that is loaded.
        time: Value,
        /// The start statement: `SE T 1`.
        start: Value,
        /// R: logic that resets. `None`: open.
        reset: Option<Node>,
        /// BI and BCD: what is loaded and where it goes.
        outputs: [Option<[Value; 2]>; 2],
    },
    /// A counter: S_CU, S_CD, S_CUD.
    Counter {
        /// `ZV Z 1` or `ZR Z 1`: what the first input does.
        count: Value,
        /// The other direction, of S_CUD.
        second: Option<Node>,
        /// S with its value.
        set: Option<(Node, Value)>,
        /// R: logic that resets. `None`: open.
        reset: Option<Node>,
        /// CV and CV_BCD: what is loaded and where it goes.
        outputs: [Option<[Value; 2]>; 2],
    },
    /// `L v; op; T w`.
    Move {
        /// The values that are loaded, one or two.
        loads: Vec<Value>,
        /// None of a MOVE.
        ops: Vec<Value>,
        /// One; more only in hand-written sources.
        stores: Vec<Value>,
        /// How BR is made where ENO goes on.
        eno: Eno,
        /// The `NOP 0` of an open ENO is missing.
        unmarked: bool,
    },
    /// A block that is called with `CALL`.
    Call {
        /// The statement of the call.
        call: Value,
        /// The logic at its Boolean inputs, which stands at the very begin of the rung or arm.
        inputs: Vec<CallInput>,
        /// The `NOP 0` of an open ENO is missing.
        unmarked: bool,
    },
}

/// An input of a call with logic.
#[derive(Clone, Debug, PartialEq)]
pub struct CallInput {
    /// The place among the call's arguments.
    pub argument: u16,
    /// The logic that leads there.
    pub input: Input,
}

/// How the BR of a box is made for its ENO.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Eno {
    /// ENO is open: BR is not made.
    Open,
    /// `SET; SAVE; CLR`: always 1.
    Set,
    /// `UN OV; SAVE; CLR`.
    NoOverflow,
}

/// A statement that carries a value, or a coil.
#[derive(Clone, Debug, PartialEq)]
pub struct Value {
    /// Its index in [`crate::Network::statements`].
    pub statement: u32,
    /// The operation of this statement.
    pub op: Op,
}

/// What stands at the right.
#[derive(Clone, Debug, PartialEq)]
pub enum End {
    /// A coil, at the end of the wire.
    Coil(Coil),
    /// `= t`, and arms that begin with `U t`.
    Branch {
        /// Number of the branch, for colours.
        id: u32,
        /// Of `= t` and all arms.
        statements: Range<u32>,
        /// The compiler's bit that keeps the logic in front.
        carried: Place,
        /// One below the other.
        arms: Vec<Rung>,
    },
}

/// A coil with its statements.
#[derive(Clone, Debug, PartialEq)]
pub struct Coil {
    /// Number of the coil, for colours.
    pub id: u32,
    /// The statements that make it.
    pub statements: Range<u32>,
    /// The value of a timer or counter coil.
    pub value: Option<Value>,
    /// `SAVE` of the RET coil, and the `SET; SAVE` of the unconditional one.
    pub saves: Saves,
    /// The statement that does something: `= A 4.0`.
    pub op: Value,
}

/// What a RET coil saves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Saves {
    /// Nothing: a bare `BEB`, or no RET at all.
    Nothing,
    /// The RLO: `SAVE; BEB`.
    Rlo,
    /// Always 1: `SET; SAVE; BEA`.
    One,
}

impl Coil {
    /// It takes the RLO with it: no other coil can hang on the same logic behind it.
    pub const fn is_last(op: &Op) -> bool {
        matches!(op, Op::Jump(..) | Op::EndIf | Op::Call(_) | Op::McrOpen)
    }
}

impl Node {
    /// The part that begins leftmost in its row; of an arm that is its wire.
    pub fn leftmost(&self) -> Option<&Node> {
        match &self.kind {
            Kind::Series { items, .. } | Kind::Parallel(items) | Kind::Xor(items) => items.first()?.leftmost(),
            Kind::Negated(node) => node.leftmost(),
            Kind::Box(node) => node.input.as_ref()?.leftmost(),
            _ => Some(self),
        }
    }

    /// The same, to be exchanged.
    pub(crate) fn leftmost_mut(&mut self) -> Option<&mut Node> {
        let lone = matches!(
            self.kind,
            Kind::Contact { .. }
                | Kind::Wire { .. }
                | Kind::Not
                | Kind::Edge { .. }
                | Kind::Connector(_)
                | Kind::Compare { .. }
        );
        if lone {
            return Some(self);
        }
        match &mut self.kind {
            Kind::Series { items, .. } | Kind::Parallel(items) | Kind::Xor(items) => items.first_mut()?.leftmost_mut(),
            Kind::Negated(node) => node.leftmost_mut(),
            Kind::Box(node) => node.input.as_mut()?.leftmost_mut(),
            _ => None,
        }
    }

    /// The nodes below, in the order of their statements; those at the inputs of a call first.
    pub(crate) fn children(&self) -> Vec<&Node> {
        match &self.kind {
            Kind::Series { items, .. } | Kind::Parallel(items) | Kind::Xor(items) => items.iter().collect(),
            Kind::Negated(node) => vec![node],
            Kind::Box(node) => {
                node.body.inputs().into_iter().chain(node.input.as_ref()).chain(node.body.others()).collect()
            }
            _ => Vec::new(),
        }
    }

    pub(crate) fn children_mut(&mut self) -> Vec<&mut Node> {
        match &mut self.kind {
            Kind::Series { items, .. } | Kind::Parallel(items) | Kind::Xor(items) => items.iter_mut().collect(),
            Kind::Negated(node) => vec![node],
            Kind::Box(node) => {
                let BoxNode { input, body, .. } = &mut **node;
                match body {
                    Body::Latch { second, .. } => input.iter_mut().chain(second).collect(),
                    Body::Timer { reset, .. } => input.iter_mut().chain(reset).collect(),
                    Body::Counter { second, set, reset, .. } => {
                        input.iter_mut().chain(second).chain(set.as_mut().map(|(node, _)| node)).chain(reset).collect()
                    }
                    Body::Move { .. } => input.iter_mut().collect(),
                    Body::Call { inputs, .. } => {
                        inputs.iter_mut().map(|i| &mut i.input.logic).chain(input.iter_mut()).collect()
                    }
                }
            }
            _ => Vec::new(),
        }
    }
}

impl Body {
    /// What leads to Boolean inputs of a call.
    pub(crate) fn inputs(&self) -> Vec<&Node> {
        match self {
            Body::Call { inputs, .. } => inputs.iter().map(|i| &i.input.logic).collect(),
            _ => Vec::new(),
        }
    }

    /// What leads to the other inputs of a box, in order.
    pub(crate) fn others(&self) -> Vec<&Node> {
        match self {
            Body::Latch { second, .. } => second.iter().collect(),
            Body::Timer { reset, .. } => reset.iter().collect(),
            Body::Counter { second, set, reset, .. } => {
                second.iter().chain(set.as_ref().map(|(node, _)| node)).chain(reset).collect()
            }
            Body::Move { .. } | Body::Call { .. } => Vec::new(),
        }
    }
}

impl Rung {
    /// True for an arm of the branch that keeps its state in this bit.
    pub(crate) fn begins_with(&self, carried: Place) -> bool {
        let first = self.logic.as_ref().and_then(Node::leftmost).map(|node| &node.kind);
        matches!(first, Some(Kind::Contact { test: BitTest::Bit(place), .. }) if *place == carried)
            || matches!(first, Some(Kind::Wire { carried: place, .. }) if *place == carried)
    }
}

impl Node {
    /// Counts its statements from another begin.
    pub(crate) fn shift(&mut self, by: u32) {
        self.statements = self.statements.start + by..self.statements.end + by;
        match &mut self.kind {
            Kind::Compare { values, .. } => values.iter_mut().for_each(|value| value.statement += by),
            Kind::Box(inner) => inner.body.values_mut().into_iter().for_each(|value| value.statement += by),
            _ => {}
        }
        self.children_mut().into_iter().for_each(|child| child.shift(by));
    }
}

impl Body {
    /// Its statements with values, in a fixed order.
    pub(crate) fn values_mut(&mut self) -> Vec<&mut Value> {
        match self {
            Body::Latch { .. } => Vec::new(),
            Body::Timer { time, start, outputs, .. } => {
                [time, start].into_iter().chain(outputs.iter_mut().flatten().flatten()).collect()
            }
            Body::Counter { count, set, outputs, .. } => std::iter::once(count)
                .chain(set.as_mut().map(|(_, value)| value))
                .chain(outputs.iter_mut().flatten().flatten())
                .collect(),
            Body::Move { loads, ops, stores, .. } => loads.iter_mut().chain(ops).chain(stores).collect(),
            Body::Call { call, .. } => vec![call],
        }
    }
}

impl Rung {
    /// Moves all statement numbers by `by`: see [`Node::shift`].
    pub(crate) fn shift(&mut self, by: u32) {
        if let Some(logic) = &mut self.logic {
            logic.shift(by);
        }
        self.ends.iter_mut().for_each(|end| end.shift(by));
    }
}

impl End {
    pub(crate) fn shift(&mut self, by: u32) {
        match self {
            End::Coil(coil) => {
                coil.statements = coil.statements.start + by..coil.statements.end + by;
                coil.op.statement += by;
                if let Some(value) = &mut coil.value {
                    value.statement += by;
                }
            }
            End::Branch { statements, arms, .. } => {
                *statements = statements.start + by..statements.end + by;
                arms.iter_mut().for_each(|arm| arm.shift(by));
            }
        }
    }
}
