//! Calls whose block becomes part of the caller ([`crate::inline`] says which).

use std::mem::offset_of;

use cranelift_codegen::ir::{InstBuilder, Value, condcodes::IntCC, types};
use ob1_cpu::engine::{Call, Db, Hot, InSource, OutTarget};
use ob1_ir::Place;

use super::operand::{BitAt, Spot, Which};
use super::state::{Bit, Data, Reg};
use super::{Body, Checked, Inlined, Translation};
use crate::flow::{self, Facts};
use crate::inline::{INSTANCE, candidate, references};

/// Whether there is room for the blocks that are inlined into this one: nesting, local data, references. `None` if
/// there are no such blocks.
pub(crate) fn room(t: &mut Translation<'_, '_>) -> Option<Value> {
    let block = &t.plan.blocks[t.block as usize];
    let (mut any, mut local, mut refs) = (false, 0, 0);
    for call in &block.calls {
        if let Some((callee, _)) = candidate(t.plan, call) {
            any = true;
            local = local.max(t.plan.blocks[callee as usize].local_len);
            refs = refs.max(call.refs.len() as u32);
        }
    }
    if !any {
        return None;
    }
    Some(room_for(t, local, refs))
}

/// There is room for one more block with so many bytes of local data and so many references.
pub(crate) fn room_for(t: &mut Translation<'_, '_>, local: u32, refs: u32) -> Value {
    let (depth, room) = (u32::from(t.plan.nesting_depth), t.plan.areas.local.len);
    let mut check = |at: usize, more: u32, most: u32| {
        let used = t.load_state(types::I32, t.hot, at);
        let more = t.word(more);
        let needed = t.b.ins().iadd(used, more);
        let most = t.word(most);
        t.b.ins().icmp(IntCC::UnsignedLessThanOrEqual, needed, most)
    };
    let depth = check(offset_of!(Hot, depth), 1, depth);
    let local = check(offset_of!(Hot, local_top), local, room);
    let used = t.load_state(types::I32, t.hot, offset_of!(Hot, refs_top));
    let more = t.word(refs);
    let needed = t.b.ins().iadd(used, more);
    let most = t.load_state(types::I32, t.hot, offset_of!(Hot, refs_len));
    let refs = t.b.ins().icmp(IntCC::UnsignedLessThanOrEqual, needed, most);
    let both = t.b.ins().band(depth, local);
    t.b.ins().band(both, refs)
}

impl Translation<'_, '_> {
    /// Translates the call at `pc`, if its block is inlined here.
    pub(crate) fn inlined_call(&mut self, pc: usize) -> bool {
        if self.body.inlined.is_some() {
            return false;
        }
        let plan = self.plan;
        let ob1_cpu::engine::Op::Call { call: index } = self.body.ops[pc] else { return false };
        let call = &plan.blocks[self.block as usize].calls[index as usize];
        let Some((callee, instance)) = candidate(plan, call) else { return false };
        self.now.uncounted = self.now.uncounted.wrapping_add(1);
        if call.safe_point {
            // Keeping registers alive for the stacks makes a program of many small calls 5 % slower.
            self.safe_point(pc + 1, 0);
        }
        let base = plan.blocks[self.block as usize].local_len;
        let refs = references(call);
        if let Some(db) = instance {
            self.copy_in(call, db);
        }
        let entry = Facts {
            fc: Some(false),
            or: Some(false),
            db: if let Data::Known(db) = self.now.db { Some(db.number) } else { None },
            di: None,
        };
        // After the call AR2 is the caller's again.
        let given_back = if instance.is_some() { flow::AR2 } else { 0 };
        let end = self.body.live[pc + 1] & flow::RESULTS & !given_back;
        let inlined = Inlined { local: base, refs, instance: instance.map(|db| db.at.0) };
        let mut body = Body::new(plan, callee, entry, call.instance_bytes, end, Some(inlined));
        body.ends_within();
        let outer = std::mem::replace(&mut self.body, body);
        let brackets = std::mem::take(&mut self.now.brackets);
        let (db, di, saved, ar2) = (self.now.db, self.now.di, self.now.saved, self.now.ar[1]);
        let own = flow::NEST | given_back;
        let stored = self.now.stored & own;
        let checked = self.checked.clone();
        if let Some(db) = instance {
            self.now.di = Data::Known(db);
            self.now.ar[1] = Reg::Known(INSTANCE);
        }
        self.called();
        self.statements();
        self.called();
        let inner = std::mem::replace(&mut self.body, outer);
        drop(inner);
        self.now.brackets = brackets;
        // It opens no data block.
        (self.now.db, self.now.di, self.now.saved) = (db, di, saved);
        self.now.stored = self.now.stored & !own | stored;
        if instance.is_some() {
            self.now.ar[1] = ar2;
        }
        // What was checked of the caller's registers still holds: the block opens no data block.
        let cache = std::mem::take(&mut self.checked.cache);
        self.checked = Checked { instance: None, cache, ..checked };
        if let Some(db) = instance {
            self.copy_out(call, db);
            self.open(Which::Db, db.number);
        }
        true
    }

    /// The actual parameters into the instance.
    pub(crate) fn copy_in(&mut self, call: &Call, db: Db) {
        for input in &call.ins {
            let to = spot(self.arena, db.at.0 * 8 + input.at);
            match &input.from {
                InSource::Const(value) => {
                    let value = self.word(*value);
                    self.put_value(to, input.bits, value);
                }
                InSource::Arena(bit) => self.copy(spot(self.arena, bit.0), to, input.bits),
                InSource::Place(Place::Fixed(_, at)) => self.copy(spot(self.local, at.0), to, input.bits),
                _ => {}
            }
        }
    }

    /// The results out of the instance.
    pub(crate) fn copy_out(&mut self, call: &Call, db: Db) {
        for out in &call.outs {
            let from = spot(self.arena, db.at.0 * 8 + out.at);
            match &out.to {
                OutTarget::Arena(bit) => self.copy(from, spot(self.arena, bit.0), out.bits),
                OutTarget::Place(Place::Fixed(_, at)) => self.copy(from, spot(self.local, at.0), out.bits),
                OutTarget::Place(_) => {}
            }
        }
    }

    /// The status word at the beginning of a called block and after the call.
    fn called(&mut self) {
        self.now.os = Bit::Known(false);
        self.end_chain(Bit::Known(true));
    }

    /// The end of an inlined block.
    pub(crate) fn end_inlined(&mut self) {
        let end = self.body.stmts.len();
        if self.body.marks[end] {
            let start = self.start_of(end);
            self.flush(end);
            self.b.ins().jump(start, &[]);
        }
    }

    fn copy(&mut self, from: Spot, to: Spot, bits: u32) {
        if bits == 1 {
            let bit = self.bit(from);
            self.put_bit(to, bit);
        } else {
            let value = self.read(from, bits);
            self.write(to, bits, value);
        }
    }
}

const fn spot(base: Value, bit: u32) -> Spot {
    Spot::fixed(base, bit / 8, BitAt::Known((bit % 8) as u8))
}
