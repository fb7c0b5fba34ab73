//! What stands at the right: coils and branches; and what stands there without any logic.

use ob1_ir::{BitTest, Call, CallMode, Jump, Op, Place};
use ob1_model::BlockKind;

use super::{Mode, Parsed, Parser};
use crate::not_drawn::Reason;
use crate::tree::{Coil, End, Kind, Rung, Saves, Value};

/// Most arms of a branch and coils in a row.
const MOST: usize = 4096;

/// Whether the string of this rung goes on behind it: `SAVE` alone does not end one.
pub(super) fn keeps_string(rung: &Rung) -> bool {
    let last = |ends: &[End]| matches!(ends.last(), Some(End::Coil(coil)) if coil.op.op == Op::SaveRlo);
    match rung.ends.last() {
        Some(End::Branch { arms, .. }) => arms.last().is_some_and(keeps_string),
        _ => last(&rung.ends),
    }
}

impl Parser<'_> {
    /// What hangs on logic: coils, or one branch.
    pub(super) fn ends(&mut self) -> Parsed<Vec<End>> {
        if let Some(Op::Assign(carried)) = self.op(0)
            && self.network.is_hidden(carried)
        {
            self.branches.push(*carried);
            let branch = self.arm_ahead(self.at + 1, *carried).then(|| self.deeper(|parser| parser.branch(*carried)));
            self.branches.pop();
            if let Some(branch) = branch {
                return branch.map(|branch| vec![branch]);
            }
        }
        let mut ends = Vec::new();
        while ends.len() < MOST {
            let Some(coil) = self.coil()? else { break };
            let last = Coil::is_last(&coil.op.op) || coil.op.op == Op::End;
            ends.push(End::Coil(coil));
            if last {
                break;
            }
        }
        if ends.is_empty() { self.wrong("no coil") } else { Ok(ends) }
    }

    /// An arm of this branch begins here, perhaps with logic at the inputs of a call.
    fn arm_ahead(&self, mut at: usize, carried: Place) -> bool {
        while let Some(behind) = self.input_ahead(at) {
            at = behind;
        }
        while matches!(self.statement(at).map(|s| &s.op), Some(Op::Open { .. })) {
            at += 1;
        }
        let begins = |op: &Op| matches!(op, Op::Scan { test: BitTest::Bit(place), .. } if *place == carried);
        self.statement(at).is_some_and(|statement| begins(&statement.op))
    }

    fn branch(&mut self, carried: Place) -> Parsed<End> {
        let start = self.here();
        self.at += 1;
        let mut arms = Vec::new();
        while arms.len() < MOST && self.arm_ahead(self.at, carried) {
            let from = self.at;
            let mut arm = self.arm(carried)?;
            let again = self.network.statements.get(from..self.at).unwrap_or_default();
            if again.iter().any(|s| s.op == Op::Assign(carried)) {
                return self.wrong("a branch within a branch with its bit");
            }
            if let Some(first) = arm.logic.as_mut().and_then(crate::tree::Node::leftmost_mut)
                && let Kind::Contact { negate, .. } = first.kind
            {
                first.kind = Kind::Wire { negate, carried };
            }
            arms.push(arm);
        }
        if arms.len() < 2 && self.mode == Mode::Step7 {
            return self.wrong("a branch with one arm");
        }
        Ok(End::Branch { id: 0, statements: self.since(start), carried, arms })
    }

    fn arm(&mut self, carried: Place) -> Parsed<Rung> {
        let bare = matches!(self.op(0), Some(Op::Scan { test: BitTest::Bit(place), .. }) if *place == carried);
        let start = self.here();
        // `U t; BLD 102` goes straight to a coil.
        let arm = if bare && self.op(1) == Some(&Op::Build(102)) {
            let Some(Op::Scan { logic: ob1_ir::Logic::And, negate, test }) = self.op(0) else {
                return self.wrong("no `U` before BLD 102");
            };
            self.at += 2;
            let logic = self.node(start, Kind::Contact { negate: *negate, test: *test });
            let logic = crate::tree::Node { statements: start..start + 1, ..logic };
            Rung { logic: Some(logic), ends: self.ends()? }
        } else {
            let arm = self.deeper(Self::rung)?;
            let straight =
                matches!(arm.logic.as_ref().map(|node| &node.kind), Some(Kind::Contact { negate: false, .. }));
            if straight && self.mode == Mode::Step7 && matches!(arm.ends.first(), Some(End::Coil(_))) {
                return Err(Reason { statement: start + 1, what: "an arm to a coil without BLD 102" });
            }
            arm
        };
        if arm.begins_with(carried) { Ok(arm) } else { self.wrong("an arm that does not begin at its branch") }
    }

    fn coil(&mut self) -> Parsed<Option<Coil>> {
        let start = self.here();
        let (mut value, mut saves) = (None, Saves::Nothing);
        match (self.op(0), self.op(1)) {
            (Some(Op::Assign(_) | Op::Set(_) | Op::Reset(_)), _)
            | (Some(Op::CountUp(_) | Op::CountDown(_) | Op::ResetTimer(_) | Op::ResetCounter(_)), _)
            | (Some(Op::EndIf | Op::McrOpen), _) => {}
            (Some(Op::SaveRlo), Some(Op::EndIf)) => {
                self.at += 1;
                saves = Saves::Rlo;
            }
            (Some(Op::SaveRlo), _) => {}
            (Some(Op::Jump(Jump::IfRlo | Jump::IfNotRlo, _)), _) => self.to_network()?,
            (Some(Op::Call(call)), _) if call.mode == CallMode::Conditional && is_bare(call) => {}
            (Some(load), Some(Op::StartTimer(..) | Op::SetCounter(_))) if load.loads() => value = Some(self.take()?),
            _ => return Ok(None),
        }
        let op = self.take()?;
        Ok(Some(Coil { id: 0, statements: self.since(start), value, saves, op }))
    }

    /// The jump here leads to the begin of a network.
    fn to_network(&self) -> Parsed<()> {
        let fits = self.statement(self.at).is_some_and(|statement| statement.jumps_to_network);
        if fits { Ok(()) } else { self.wrong("a jump over statements") }
    }

    /// A coil at the rail.
    pub(super) fn unconditional(&mut self) -> Parsed<Rung> {
        let start = self.here();
        let mut saves = Saves::Nothing;
        match self.op(0) {
            Some(Op::Jump(Jump::Always, _)) => self.to_network()?,
            Some(Op::End | Op::OpenDb(..) | Op::McrActivate | Op::McrDeactivate | Op::McrClose) => {}
            Some(Op::SetRlo) => {
                if self.op(1) != Some(&Op::SaveRlo) || self.op(2) != Some(&Op::End) {
                    return self.wrong("SET");
                }
                self.at += 2;
                saves = Saves::One;
            }
            Some(Op::Call(call)) if call.mode == CallMode::Unconditional && is_bare(call) => {}
            _ => return self.wrong("no logic begins here"),
        }
        let op: Value = self.take()?;
        let coil = Coil { id: 0, statements: self.since(start), value: None, saves, op };
        Ok(Rung { logic: None, ends: vec![End::Coil(coil)] })
    }
}

/// A call that has no pointers behind it and needs no instance.
fn is_bare(call: &Call) -> bool {
    let ob1_ir::Target::Block(id) = call.target else { return false };
    call.args.is_empty() && call.instance.is_none() && matches!(id.kind, BlockKind::Fc | BlockKind::Sfc | BlockKind::Fb)
}
