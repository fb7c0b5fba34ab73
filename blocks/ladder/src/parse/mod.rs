//! Statements to a tree: recursive descent, by the grammar of what STEP 7's editors write.
//!
//! There is one place of doubt: where a box may begin the box is tried; if it is none, the same statements are read as
//! coils.

mod boxes;
mod ends;
mod logic;

use std::collections::BTreeMap;
use std::ops::Range;

use ob1_ir::{Jump, Number, Op, Place};

use crate::network::{Network, Statement};
use crate::not_drawn::Reason;
use crate::tree::{BoxNode, Input, Kind, Node, Rung, Tree};

/// Brackets, branches and boxes within each other.
const DEEPEST: u32 = 48;

/// Whether everything must stand as STEP 7 writes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mode {
    /// One rung, each `NOP 0` and `BLD` in its place.
    Step7,
    /// Several rungs; `NOP 0` and `BLD` may be missing.
    ByHand,
}

pub(crate) type Parsed<T> = Result<T, Reason>;

/// The statements of a network as a tree.
pub(crate) fn parse(network: &Network, mode: Mode) -> Parsed<Tree> {
    let mut parser = Parser {
        network,
        mode,
        at: 0,
        depth: 0,
        inputs: Vec::new(),
        in_input: false,
        branches: Vec::new(),
        ends: BTreeMap::new(),
    };
    let rungs = parser.rungs()?;
    parser.jumps_stay()?;
    let mut tree = Tree { rungs, nodes: 0, as_step7: mode == Mode::Step7 };
    crate::number::number(&mut tree);
    Ok(tree)
}

pub(crate) struct Parser<'n> {
    network: &'n Network,
    mode: Mode,
    at: usize,
    depth: u32,
    /// Those whose call has not come yet.
    inputs: Vec<(Input, u32)>,
    /// The string of such an input is being read.
    in_input: bool,
    /// The bits of the branches whose arms are being read.
    branches: Vec<Place>,
    /// Jumps of the network's own boxes, by the operation they lead to.
    ends: BTreeMap<u32, u32>,
}

impl<'n> Parser<'n> {
    fn op(&self, ahead: usize) -> Option<&'n Op> {
        self.network.statements.get(self.at + ahead).map(|statement| &statement.op)
    }

    fn here(&self) -> u32 {
        self.at as u32
    }

    fn since(&self, start: u32) -> Range<u32> {
        start..self.here()
    }

    fn statement(&self, at: usize) -> Option<&'n Statement> {
        self.network.statements.get(at)
    }

    fn wrong<T>(&self, what: &'static str) -> Parsed<T> {
        // What is missing behind the last statement is a fault of that one.
        let last = self.network.statements.len().saturating_sub(1) as u32;
        Err(Reason { statement: self.here().min(last), what })
    }

    /// Takes the statement if it is this one.
    fn eat(&mut self, op: &Op) -> bool {
        let is = self.op(0) == Some(op);
        self.at += usize::from(is);
        is
    }

    /// Takes it, or says what should be there.
    fn expect(&mut self, op: &Op, what: &'static str) -> Parsed<()> {
        if self.eat(op) { Ok(()) } else { self.wrong(what) }
    }

    /// What `try_it` gives, or nothing, and everything as it was.
    fn attempt<T>(&mut self, try_it: impl FnOnce(&mut Self) -> Parsed<T>) -> Parsed<T> {
        let (at, depth, inputs, ends) = (self.at, self.depth, self.inputs.clone(), self.ends.clone());
        let result = try_it(self);
        if result.is_err() {
            (self.at, self.depth, self.inputs, self.ends) = (at, depth, inputs, ends);
        }
        result
    }

    fn deeper<T>(&mut self, inner: impl FnOnce(&mut Self) -> Parsed<T>) -> Parsed<T> {
        if self.depth >= DEEPEST {
            return self.wrong("too deep");
        }
        self.depth += 1;
        let result = inner(self);
        self.depth -= 1;
        result
    }

    fn rungs(&mut self) -> Parsed<Vec<Rung>> {
        let mut rungs = Vec::new();
        // STEP 7 puts it there for a network that somebody has emptied; behind a label nobody cares.
        let named = !self.network.label.is_empty();
        if self.op(1).is_some() && named || self.mode == Mode::ByHand {
            self.eat(&Op::Nop);
        }
        while self.at < self.network.statements.len() {
            if self.mode == Mode::ByHand && self.eat(&Op::Nop) {
                continue;
            }
            if !rungs.is_empty() && self.mode == Mode::Step7 {
                return self.wrong("a second rung");
            }
            let saved = rungs.last().is_some_and(ends::keeps_string);
            let rung = self.deeper(Self::rung)?;
            if saved && rung.logic.is_some() {
                return self.wrong("logic behind SAVE");
            }
            rungs.push(rung);
        }
        Ok(rungs)
    }

    /// One rung, or one arm.
    fn rung(&mut self) -> Parsed<Rung> {
        let outer = std::mem::take(&mut self.inputs);
        self.call_inputs()?;
        let rung = self.rung_logic()?;
        if let Some((_, statement)) = self.inputs.first() {
            return Err(Reason { statement: *statement, what: "logic for no input of a call" });
        }
        self.inputs = outer;
        Ok(rung)
    }

    fn rung_logic(&mut self) -> Parsed<Rung> {
        if let Ok(rung) = self.attempt(Self::unconditional) {
            return Ok(rung);
        }
        let start = self.here();
        let logic = if self.logic_ahead() { Some(self.logic()?) } else { None };
        let boxed = self.attempt(|parser| {
            let logic = parser.boxed(logic.clone(), start)?;
            let ends = if is_open(&logic) { Vec::new() } else { parser.ends()? };
            Ok(Rung { logic: Some(logic), ends })
        });
        let best = match boxed {
            Ok(rung) => return Ok(rung),
            Err(reason) => reason,
        };
        let Some(logic) = logic else { return Err(best) };
        let ends = self.ends().map_err(|reason| best.later(reason))?;
        Ok(Rung { logic: Some(logic), ends })
    }

    /// `arg; = t; BLD 103`, as often as they come.
    fn call_inputs(&mut self) -> Parsed<()> {
        while self.input_ahead(self.at).is_some() {
            let start = self.here();
            let input = self.deeper(|parser| {
                let outer = std::mem::replace(&mut parser.in_input, true);
                let logic = parser.argument();
                parser.in_input = outer;
                let logic = logic?;
                let Some(Op::Assign(carried)) = parser.op(0) else { return parser.wrong("no `=` before BLD 103") };
                parser.at += 1;
                parser.expect(&Op::Build(103), "no BLD 103")?;
                Ok(Input { logic, carried: *carried })
            })?;
            self.inputs.push((input, start));
        }
        Ok(())
    }

    /// Behind the `BLD 103` of an input that begins here: what ends its string is the `=` before it.
    pub(super) fn input_ahead(&self, at: usize) -> Option<usize> {
        let rest = self.network.statements.get(at..)?;
        if self.at_branch(at) {
            return None;
        }
        let (mut depth, mut found) = (0u32, None);
        for (ahead, statement) in rest.iter().enumerate() {
            match &statement.op {
                Op::Open { .. } => depth += 1,
                Op::Close => depth = depth.checked_sub(1)?,
                Op::Assign(place) if depth == 0 => {
                    let behind = rest.get(ahead + 1).map(|s| &s.op);
                    let connects =
                        matches!(behind, Some(Op::Scan { test: ob1_ir::BitTest::Bit(bit), .. }) if bit == place);
                    if behind == Some(&Op::Build(103)) && self.network.is_hidden(place) {
                        found = Some(at + ahead + 2);
                    }
                    if found.is_some() || !connects || self.network.is_hidden(place) {
                        return found;
                    }
                }
                Op::Scan { .. }
                | Op::OrBranch
                | Op::NotRlo
                | Op::EdgePositive(_)
                | Op::EdgeNegative(_)
                | Op::Build(_) => {}
                _ if depth > 0 => {}
                _ => return None,
            }
        }
        found
    }

    /// The string here begins at the bit of an open branch: it is an arm. An input of a box begins at the rail.
    pub(super) fn at_branch(&self, at: usize) -> bool {
        let rest = self.network.statements.get(at..).unwrap_or_default();
        let first = rest.iter().find(|statement| !matches!(statement.op, Op::Open { .. }));
        matches!(first.map(|s| &s.op), Some(Op::Scan { test: ob1_ir::BitTest::Bit(bit), .. }) if self.branches.contains(bit))
    }

    /// No jump leads into the network but to its first statement, and those of its own boxes.
    fn jumps_stay(&self) -> Parsed<()> {
        let first = self.network.statements.first().map_or(0, |statement| statement.ops.start);
        for (to, count) in self.network.targets.iter().filter(|(to, _)| **to != first) {
            if self.ends.get(to) != Some(count) {
                let statement = self.network.at_op(*to).unwrap_or_default();
                return Err(Reason { statement, what: "a jump leads here" });
            }
        }
        Ok(())
    }

    /// A plain operand: what pointers lead to is known while the program runs only.
    fn direct(&self, at: usize) -> Parsed<()> {
        let Some(statement) = self.statement(at) else { return Ok(()) };
        let mut indirect = false;
        let alone = statement.ops.len() == 1 || matches!(statement.op, Op::Call(_));
        if alone {
            statement.op.places(&mut |place, _| {
                indirect |= matches!(place, Place::Memory(..) | Place::Register(..));
            });
            statement.op.numbers(&mut |number| indirect |= matches!(number, Number::Memory(_)));
        }
        if indirect {
            return Err(Reason { statement: at as u32, what: "indirect addressing" });
        }
        Ok(())
    }

    /// Takes the statement, whatever it is.
    fn take(&mut self) -> Parsed<crate::tree::Value> {
        self.direct(self.at)?;
        let Some(op) = self.op(0) else { return self.wrong("the network ends here") };
        self.at += 1;
        Ok(crate::tree::Value { statement: self.here() - 1, op: op.clone() })
    }

    fn node(&self, start: u32, kind: Kind) -> Node {
        Node { id: 0, statements: self.since(start), kind }
    }

    /// A `SPBNB` here, and where it leads.
    fn box_jump(&mut self) -> Option<u32> {
        let Some(Op::Jump(Jump::IfNotRloSaveBr, to)) = self.op(0) else { return None };
        self.at += 1;
        Some(*to)
    }
}

/// A box whose output goes nowhere.
fn is_open(node: &Node) -> bool {
    matches!(&node.kind, Kind::Box(inner) if matches!(**inner, BoxNode { used: false, .. }))
}
