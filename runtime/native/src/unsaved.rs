//! Which registers memory may lack: a changed register is written to memory where somebody looks, and one that has not
//! changed since is read from there when it is needed.

use ob1_ir::{Jump, Op, Stmt};

use crate::flow::{A1, A2, ALL, AR1, AR2, BR, CC, CHAIN, Env, FC, How, NEST, OR, OS, OV, RLO, STA, Set, successors};

/// Registers that a compiled statement may change.
pub(crate) fn changes(op: &Op) -> Set {
    match op {
        Op::Scan { .. } => RLO | FC | OR | STA,
        Op::Open { .. } | Op::Close => RLO | CHAIN | NEST,
        Op::OrBranch | Op::Assign(_) | Op::Set(_) | Op::Reset(_) => CHAIN,
        Op::EdgePositive(_) | Op::EdgeNegative(_) | Op::SetRlo | Op::ClearRlo | Op::EndIf => RLO | CHAIN,
        Op::NotRlo => RLO | STA,
        Op::SaveRlo => BR,
        Op::Load(_) | Op::LoadConst(_) | Op::LoadTimer(_) | Op::LoadCounter(_) | Op::TransferAr(_) => A1 | A2,
        Op::Transfer(_)
        | Op::TransferArTo(..)
        | Op::JumpList { .. }
        | Op::OpenDb(..)
        | Op::Nop
        | Op::Build(_)
        | Op::End => 0,
        Op::Arithmetic(..) => A1 | A2 | CC | OV | OS,
        Op::AddConst { .. } | Op::Increment(_) | Op::Decrement(_) | Op::Loop(_) => A1,
        Op::Compare(..) => RLO | CHAIN | CC | OV | OS,
        Op::WordLogic(..)
        | Op::DWordLogic(..)
        | Op::Shift(..)
        | Op::RotateLeftCc1
        | Op::RotateRightCc1
        | Op::Convert(_)
        | Op::Math(_) => A1 | CC | OV | OS,
        Op::ExchangeAccus | Op::Push | Op::Pop | Op::Enter | Op::Leave => A1 | A2,
        Op::LoadAr(_)
        | Op::LoadArConst(..)
        | Op::LoadArFrom(..)
        | Op::CopyAr1ToAr2
        | Op::CopyAr2ToAr1
        | Op::ExchangeArs
        | Op::AddAr(_)
        | Op::AddArConst(..) => AR1 | AR2,
        Op::Jump(on, _) => match on {
            Jump::IfRlo | Jump::IfNotRlo => RLO | CHAIN,
            Jump::IfRloSaveBr | Jump::IfNotRloSaveBr => RLO | CHAIN | BR,
            Jump::IfBr | Jump::IfNotBr => CHAIN,
            Jump::IfStoredOverflow => OS,
            _ => 0,
        },
        Op::ResetTimer(_) | Op::CountUp(_) | Op::CountDown(_) | Op::ResetCounter(_) | Op::StartTimer(..) => CHAIN,
        _ => ALL,
    }
}

/// Registers and brackets on the way through a stretch of statements.
#[derive(Clone, Copy)]
struct Walk {
    unsaved: Set,
    /// Brackets opened since jumps met, or since everything was saved.
    opened: u32,
    /// Whether brackets opened before that are unsaved, too.
    waiting: Set,
}

impl Walk {
    fn from(unsaved: Set) -> Self {
        Self { unsaved, opened: 0, waiting: unsaved & NEST }
    }

    fn behind(self, op: &Op, how: How, inlined: bool) -> Self {
        match (op, how) {
            // Compiled when its time is a constant, else by the reference: either may be.
            (Op::StartTimer(..), _) => Self::from(self.unsaved | CHAIN),
            (_, How::Call) if inlined => Self { unsaved: self.unsaved | ALL & !NEST, ..self },
            (_, How::Call) => Self::from(CHAIN),
            (_, How::Step) => Self::from(0),
            (Op::Open { .. }, _) => Self { unsaved: self.unsaved | changes(op), opened: self.opened + 1, ..self },
            (Op::Close, _) if self.opened == 1 => {
                let unsaved = (self.unsaved | changes(op)) & !NEST | self.waiting;
                Self { unsaved, opened: 0, ..self }
            }
            (Op::Close, _) if self.opened == 0 => Self::from(self.unsaved | changes(op)),
            (Op::Close, _) => Self { unsaved: self.unsaved | changes(op), opened: self.opened - 1, ..self },
            _ => Self { unsaved: self.unsaved | changes(op), ..self },
        }
    }
}

/// Registers that memory may lack, before each statement a jump leads to and at the end; `inlined` says which calls are
/// inlined.
pub(crate) fn unsaved(
    stmts: &[Stmt],
    entry: Set,
    marks: &[bool],
    env: &Env<'_>,
    inlined: &dyn Fn(usize) -> bool,
) -> Vec<Set> {
    let mut at = vec![0; stmts.len() + 1];
    at[0] = entry;
    let mut again = true;
    while again {
        again = false;
        let mut walk = Some(Walk::from(entry));
        for (i, stmt) in stmts.iter().enumerate() {
            if marks[i] {
                let met = at[i] | walk.map_or(0, |walk| walk.unsaved);
                again |= at[i] != met;
                at[i] = met;
                walk = Some(Walk::from(met));
            }
            let Some(before) = walk else { continue };
            let behind = before.behind(&stmt.op, env.how(&stmt.op), inlined(i));
            walk = None;
            successors(&stmt.op, i, &mut |next| {
                if next == i + 1 {
                    walk = Some(behind);
                }
                if marks[next] {
                    let met = at[next] | behind.unsaved;
                    again |= at[next] != met;
                    at[next] = met;
                }
            });
            // An end within an inlined block leads to the end of that block.
            if matches!(stmt.op, Op::End | Op::EndIf) {
                let end = at.len() - 1;
                again |= at[end] | behind.unsaved != at[end];
                at[end] |= behind.unsaved;
            }
        }
        if let Some(walk) = walk {
            let end = at.len() - 1;
            at[end] |= walk.unsaved;
        }
    }
    at
}
