//! Power flow: one pass of program status on the tree.
//!
//! The tree is evaluated by STEP 7's rules ["Programming with STEP 7", program status of LAD and FBD]; what a
//! statement has seen comes from its record: STA of contacts, the RLO behind comparisons and edges. Where the value and
//! the recorded RLO differ, or a statement did not run, nothing is known.

use ob1_ir::Op;
use ob1_model::PassLine;

use crate::layout::{Place, is_ladder};
use crate::network::Network;
use crate::tree::{Body, BoxNode, Coil, End, Kind, Node, Rung, Tree};

/// What is known of a node or wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum State {
    /// Fulfilled: green, drawn as a continuous line.
    On,
    /// Not fulfilled: blue, dotted.
    Off,
    /// It did not run, or nothing says what it had: black.
    #[default]
    Unknown,
}

impl State {
    const fn of(on: bool) -> Self {
        if on { State::On } else { State::Off }
    }

    const fn and(self, other: Self) -> Self {
        match (self, other) {
            (State::Off, _) | (_, State::Off) => State::Off,
            (State::On, State::On) => State::On,
            _ => State::Unknown,
        }
    }

    const fn or(self, other: Self) -> Self {
        match (self, other) {
            (State::On, _) | (_, State::On) => State::On,
            (State::Off, State::Off) => State::Off,
            _ => State::Unknown,
        }
    }

    const fn not(self) -> Self {
        match self {
            State::On => State::Off,
            State::Off => State::On,
            State::Unknown => State::Unknown,
        }
    }

    /// This, if the other is known at all.
    const fn ran(self, other: Self) -> Self {
        if matches!(other, State::Unknown) { State::Unknown } else { self }
    }
}

/// The states of a network.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Flow {
    /// Before, at and after each node, by its number.
    pub nodes: Vec<[State; 3]>,
    /// The rail: fulfilled, if anything ran.
    pub rail: State,
}

impl Flow {
    /// The state of a piece of the drawing.
    pub fn of(&self, place: Place) -> State {
        let (id, which) = match place {
            Place::Rail => return self.rail,
            Place::Before(id) => (id, 0),
            Place::At(id) => (id, 1),
            Place::After(id) => (id, 2),
        };
        self.nodes.get(id as usize).and_then(|node| node.get(which)).copied().unwrap_or_default()
    }
}

/// The power flow of a pass. `line` gives the record of an operation of the block; `is_plan`: a function plan is drawn,
/// where each box begins anew.
pub fn flow(network: &Network, tree: &Tree, is_plan: bool, line: &dyn Fn(u32) -> Option<PassLine>) -> Flow {
    let records = network.statements.iter().map(|statement| {
        let last = statement.ops.end.checked_sub(1)?;
        line(last).filter(|line| line.times > 0)
    });
    let records: Vec<Option<PassLine>> = records.collect();
    let rail = if records.iter().any(Option::is_some) { State::On } else { State::Unknown };
    let nodes = vec![[State::Unknown; 3]; tree.nodes as usize];
    let mut walk = Walk { network, records, is_plan: is_plan || !is_ladder(tree), flow: Flow { nodes, rail } };
    tree.rungs.iter().for_each(|rung| walk.rung(rung, rail));
    walk.flow
}

/// Status word: RLO and STA.
const RLO: u16 = 1 << 1;
const STA: u16 = 1 << 2;

struct Walk<'n> {
    network: &'n Network,
    records: Vec<Option<PassLine>>,
    is_plan: bool,
    flow: Flow,
}

impl Walk<'_> {
    fn bit(&self, statement: u32, bit: u16) -> State {
        let record = self.records.get(statement as usize).copied().flatten();
        record.map_or(State::Unknown, |record| State::of(record.status & bit != 0))
    }

    fn put(&mut self, id: u32, states: [State; 3]) -> State {
        if let Some(node) = self.flow.nodes.get_mut(id as usize) {
            *node = states;
        }
        states[2]
    }

    fn rung(&mut self, rung: &Rung, rail: State) {
        let power = match &rung.logic {
            Some(logic) => self.node(logic, rail),
            None => rail,
        };
        let logic = rung.logic.as_ref();
        for end in &rung.ends {
            match end {
                End::Coil(coil) => {
                    if !self.coil(coil, power, logic.is_none()) {
                        // The record says something else: what leads here is not known either.
                        if let Some(node) = logic.and_then(|logic| self.flow.nodes.get_mut(logic.id as usize)) {
                            node[2] = State::Unknown;
                        }
                    }
                }
                End::Branch { id, statements, arms, .. } => {
                    let state = self.agrees(statements.start, power);
                    self.put(*id, [state; 3]);
                    arms.iter().for_each(|arm| self.rung(arm, state));
                }
            }
        }
    }

    /// The state, if the recorded RLO is the same.
    fn agrees(&self, statement: u32, state: State) -> State {
        let recorded = self.bit(statement, RLO);
        if recorded == state { state } else { State::Unknown }
    }

    /// False where the evaluated state is not the recorded one.
    fn coil(&mut self, coil: &Coil, power: State, at_rail: bool) -> bool {
        let statement = coil.op.statement;
        let ran = self.bit(statement, RLO);
        let keeps = matches!(
            coil.op.op,
            Op::Assign(_)
                | Op::Set(_)
                | Op::Reset(_)
                | Op::SaveRlo
                | Op::ResetTimer(_)
                | Op::ResetCounter(_)
                | Op::StartTimer(..)
                | Op::SetCounter(_)
                | Op::CountUp(_)
                | Op::CountDown(_)
        );
        let state = match keeps {
            true => self.agrees(statement, power),
            // A jump, an end, a call change the RLO.
            false if at_rail => State::On.ran(ran),
            false => power.ran(ran),
        };
        let fulfilled = match coil.op.op {
            Op::Jump(ob1_ir::Jump::IfNotRlo, _) => state.not(),
            _ => state,
        };
        self.put(coil.id, [state, fulfilled, state]);
        state != State::Unknown || ran == State::Unknown
    }

    /// Evaluates a part; `power` is what comes to it. In a function plan everything begins at 1.
    fn node(&mut self, node: &Node, power: State) -> State {
        let power = if self.is_plan { State::On.ran(self.flow.rail) } else { power };
        let first = node.statements.start;
        let last = node.statements.end.saturating_sub(1);
        match &node.kind {
            Kind::Contact { negate, .. } => {
                let asked = self.bit(first, STA);
                let at = if *negate { asked.not() } else { asked };
                self.put(node.id, [power, at, power.and(at).ran(at)])
            }
            Kind::Wire { negate, .. } => {
                let kept = self.bit(first, STA);
                let at = if *negate { kept.not() } else { kept };
                self.put(node.id, [kept, at, at])
            }
            Kind::Not => self.put(node.id, [power, power.not(), power.not()]),
            Kind::Edge { .. } => {
                let at = self.bit(last, RLO);
                self.put(node.id, [power, at, at])
            }
            Kind::Connector(_) => self.put(node.id, [power; 3]),
            Kind::Series { items, .. } => {
                let after = self.series(items, power);
                self.put(node.id, [power, after, after])
            }
            Kind::Parallel(legs) => {
                let leads = legs.first().and_then(Node::leftmost).is_some_and(|n| matches!(n.kind, Kind::Wire { .. }));
                let mut after: Option<State> = None;
                for (at, leg) in legs.iter().enumerate() {
                    // Behind a branch the other legs begin at a rail of their own.
                    let power = if leads && at > 0 { self.flow.rail } else { power };
                    let state = self.node(leg, power);
                    after = Some(after.map_or(state, |after| after.or(state)));
                }
                let after = after.unwrap_or_default();
                self.put(node.id, [power, after, after])
            }
            Kind::Xor(legs) => {
                let mut after: Option<State> = None;
                for leg in legs {
                    let state = self.node(leg, power);
                    after = Some(match after {
                        None => state,
                        Some(before) if before == State::Unknown || state == State::Unknown => State::Unknown,
                        Some(before) => State::of(before != state),
                    });
                }
                let after = after.unwrap_or_default();
                self.put(node.id, [power, after, after])
            }
            Kind::Negated(inner) => {
                let after = self.node(inner, power).not();
                self.put(node.id, [power, after, after])
            }
            Kind::Compare { .. } => {
                let at = self.bit(self.comparison(node), RLO);
                self.put(node.id, [power, at, power.and(at).ran(at)])
            }
            Kind::Box(inner) => self.boxed(node, inner, power),
        }
    }

    /// The statement that compares: the last but a bracket.
    fn comparison(&self, node: &Node) -> u32 {
        let mut at = node.statements.end;
        while at > node.statements.start {
            at -= 1;
            if matches!(self.network.statements.get(at as usize).map(|s| &s.op), Some(Op::Compare(..))) {
                return at;
            }
        }
        at
    }

    fn series(&mut self, items: &[Node], power: State) -> State {
        if !self.is_plan {
            return items.iter().fold(power, |power, item| self.node(item, power));
        }
        let mut value: Option<State> = None;
        for item in items {
            let acts = matches!(item.kind, Kind::Not | Kind::Edge { .. } | Kind::Connector(_));
            let state = if acts { self.acting(item, value.unwrap_or_default()) } else { self.node(item, power) };
            value = Some(match value {
                Some(before) if !acts => before.and(state),
                _ => state,
            });
        }
        value.unwrap_or_default()
    }

    /// NOT, an edge, a connector of a function plan.
    fn acting(&mut self, item: &Node, before: State) -> State {
        let is_plan = std::mem::replace(&mut self.is_plan, false);
        let after = self.node(item, before);
        self.is_plan = is_plan;
        after
    }

    fn boxed(&mut self, node: &Node, inner: &BoxNode, power: State) -> State {
        for input in inner.body.inputs() {
            self.node(input, self.flow.rail);
        }
        let before = match &inner.input {
            Some(input) => self.node(input, power),
            None => power,
        };
        for other in inner.body.others() {
            self.node(other, self.flow.rail);
        }
        let output = self.output_statement(node);
        let after = match (&inner.body, inner.used) {
            (_, true) => self.bit(output, STA),
            (Body::Latch { place, .. }, false) => self.latch(node, *place),
            (_, false) => State::Unknown,
        };
        self.put(node.id, [before, after, after])
    }

    /// The statement that asks for the output: the last one of the box, in front of the bracket around it.
    fn output_statement(&self, node: &Node) -> u32 {
        let mut at = node.statements.end.saturating_sub(1);
        while at > node.statements.start && matches!(self.op(at), Some(Op::Close)) {
            at -= 1;
        }
        at
    }

    fn op(&self, statement: u32) -> Option<&Op> {
        self.network.statements.get(statement as usize).map(|statement| &statement.op)
    }

    /// A flip-flop whose output is open: what was done last tells its bit, if anything was done.
    fn latch(&self, node: &Node, bit: ob1_ir::Place) -> State {
        let mut state = State::Unknown;
        for at in node.statements.clone() {
            let set = match self.op(at) {
                Some(Op::Set(place)) if *place == bit => State::On,
                Some(Op::Reset(place)) if *place == bit => State::Off,
                // Whoever else writes between may have written it.
                Some(Op::Assign(place) | Op::Set(place) | Op::Reset(place)) if apart(*place, bit) => continue,
                Some(op) if op.writes() || matches!(op, Op::Call(_)) => {
                    state = State::Unknown;
                    continue;
                }
                _ => continue,
            };
            if self.bit(at, RLO) == State::On {
                state = set;
            }
        }
        state
    }
}

/// Two bits that cannot be the same one.
fn apart(one: ob1_ir::Place, other: ob1_ir::Place) -> bool {
    matches!((one, other), (ob1_ir::Place::Fixed(..), ob1_ir::Place::Fixed(..))) && one != other
}
