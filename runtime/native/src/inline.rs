//! Calls known at load: those of small blocks, which become part of their callers without a frame, and those whose
//! parameters and instance lie at known places.

use ob1_cpu::engine::{Call, CallTarget, Callee, Db, InSource, InstanceOf, OutTarget, Plan, RefArg, SHORT_BLOCK};
use ob1_ir::{CallMode, Number, Op, Place};
use ob1_model::{Area, BlockId, BlockKind};

use crate::flow::{self, Env, How};
use crate::place;

/// AR2 of a function block with an instance of its own.
pub(crate) const INSTANCE: u32 = (Area::Db.pointer_code() as u32) << 24;

/// An actual parameter that is known when the call is translated.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Reference {
    /// This bit of the arena.
    Arena(u32),
    /// This bit of the function's local data.
    Local(u32),
}

/// Bytes of the instance of a function block.
pub(crate) fn instance_bytes(plan: &Plan, block: u32) -> u32 {
    let id = plan.blocks[block as usize].id;
    plan.signatures.find(id).map_or(0, |signature| signature.instance_bytes)
}

/// A call whose block is inlined: its index, and where its instance lies.
pub(crate) fn candidate(plan: &Plan, call: &Call) -> Option<(u32, Option<Db>)> {
    simple(plan, call).filter(|(block, instance)| leaf(plan, *block, instance.is_some()))
}

/// A call of a block of statements whose parameters are places known at load: its index, and where its instance lies.
pub(crate) fn simple(plan: &Plan, call: &Call) -> Option<(u32, Option<Db>)> {
    let CallTarget::Known(Callee::Code(block)) = call.target else { return None };
    if call.mode != CallMode::Call || call.list.is_some() {
        return None;
    }
    let instance = match call.instance {
        InstanceOf::None => {
            let simple = call.patches.iter().all(|(_, patch)| matches!(patch, RefArg::Local(_)));
            if !simple || call.copies_out {
                return None;
            }
            None
        }
        InstanceOf::Db(Number::Fixed(n)) => {
            let db = place::data(plan, n)?;
            let fits = call.instance_bytes <= db.len && (db.writable > 0 || call.instance_bytes == 0);
            let local = |place: &Place| matches!(place, Place::Fixed(Area::Local, _));
            let ins = call.ins.iter().all(|input| {
                input.bits <= 32
                    && match &input.from {
                        InSource::Const(_) | InSource::Arena(_) => true,
                        InSource::Place(place) => local(place),
                        _ => false,
                    }
            });
            let outs = call.outs.iter().all(|out| {
                out.bits <= 32
                    && match &out.to {
                        OutTarget::Arena(_) => true,
                        OutTarget::Place(place) => local(place),
                    }
            });
            if !fits || !ins || !outs {
                return None;
            }
            Some(db)
        }
        _ => return None,
    };
    Some((block, instance))
}

/// The block can be inlined: short, without loops and calls, and nothing in it can fail.
fn leaf(plan: &Plan, block: u32, instance: bool) -> bool {
    let code = &plan.blocks[block as usize];
    let (id, kind) = (code.id, code.id.kind);
    if code.stmts.len() > SHORT_BLOCK
        || !matches!(kind, BlockKind::Fc | BlockKind::Fb)
        || (kind == BlockKind::Fb) != instance
    {
        return false;
    }
    let mcr = code.stmts.iter().any(|s| matches!(s.op, Op::McrActivate));
    let env = Env { plan, mcr, end: flow::RESULTS, inlined: false };
    let marks = flow::targets(&code.stmts);
    let mut open = 0u32;
    for (pc, stmt) in code.stmts.iter().enumerate() {
        if marks[pc] && open > 0 {
            return false;
        }
        match &stmt.op {
            Op::Open { .. } => open += 1,
            Op::Close => open = open.saturating_sub(1),
            // Its list would be a table for each call.
            Op::JumpList { .. } => return false,
            _ => {}
        }
        let mut back = false;
        flow::successors(&stmt.op, pc, &mut |next| back |= next <= pc);
        let mut reachable = true;
        stmt.op.places(&mut |place, width| {
            reachable &= match place {
                // The actual of a STRING may be shorter than its formal.
                Place::Param { index, at } => at.0 == 0 || !is_string(plan, id, index),
                Place::Fixed(Area::Local, _) => true,
                Place::Instance(_) => instance,
                other => matches!(place::class(&other, u32::from(width.bits()), plan), place::Class::Fixed(_)),
            };
        });
        let sets_ar2 = matches!(
            stmt.op,
            Op::LoadAr(ob1_ir::AddressRegister::Ar2)
                | Op::LoadArConst(ob1_ir::AddressRegister::Ar2, _)
                | Op::LoadArFrom(ob1_ir::AddressRegister::Ar2, _)
                | Op::CopyAr1ToAr2
                | Op::ExchangeArs
                | Op::AddAr(ob1_ir::AddressRegister::Ar2)
                | Op::AddArConst(ob1_ir::AddressRegister::Ar2, _)
        );
        let how = env.how(&stmt.op);
        if back
            || !reachable
            || how == How::Step
            || how == How::Call
            || flow::opens_data(&stmt.op)
            || instance && sets_ar2
        {
            return false;
        }
    }
    open == 0
}

fn is_string(plan: &Plan, id: BlockId, index: u16) -> bool {
    plan.signatures.find(id).and_then(|signature| signature.formals.get(usize::from(index))).is_some_and(|f| f.string)
}

/// The references of a simple call.
pub(crate) fn references(call: &Call) -> Vec<Reference> {
    let mut refs: Vec<Reference> = call.refs.iter().map(|bit| Reference::Arena(*bit)).collect();
    for (index, patch) in &call.patches {
        if let (RefArg::Local(at), Some(slot)) = (patch, refs.get_mut(usize::from(*index))) {
            *slot = Reference::Local(*at);
        }
    }
    refs
}
