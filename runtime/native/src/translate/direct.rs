//! Calls from compiled block to compiled block: the frame is made here, without asking the CPU.
//!
//! The called block runs on the same [`Run`]: its registers are the caller's, as on the CPU. Those that are restored
//! for the caller when the block ends are kept in this function's frame meanwhile.

use std::mem::offset_of;

use cranelift_codegen::ir::{self, InstBuilder, Type, Value, types};
use ob1_cpu::engine::{Call, Db, Hot, OS, Op, Regs};

use super::inlined::room_for;
use super::{Checked, Translation};
use crate::frame::{CHAIN, FRESH, Field, KEPT};
use crate::inline::{self, INSTANCE};
use crate::run::Run;

/// A register as values: where each lies, and how wide it is.
fn values((at, bytes): Field) -> impl Iterator<Item = (Type, usize)> {
    let ty = match bytes {
        1 => types::I8,
        4 => types::I32,
        // A data block register is two of 64 bits.
        _ => types::I64,
    };
    (0..bytes).step_by(ty.bytes() as usize).map(move |part| (ty, at + part))
}

impl Translation<'_, '_> {
    /// The call of a function block at `pc`, when the block, its instance and its parameters are known at load: it goes
    /// on at `next`. The code emitted after this handles a block without code, and a lack of room for one more.
    pub(crate) fn call_directly(&mut self, pc: usize, next: ir::Block) {
        let plan = self.plan;
        let Op::Call { call: index } = self.body.ops[pc] else { return };
        let call = &plan.blocks[self.block as usize].calls[index as usize];
        let Some((callee, Some(instance))) = inline::simple(plan, call) else { return };
        if call.safe_point {
            self.safe_point(pc + 1, self.body.live[pc]);
        }
        self.tell_count();
        self.take_count();
        let local_len = plan.blocks[callee as usize].local_len;
        let room = room_for(self, local_len, call.refs.len() as u32);
        let entries = self.load_state(types::I64, self.run, offset_of!(Run, entries));
        let address = self.load_state(types::I64, entries, callee as usize * 8);
        let (free, direct, asked) = (self.b.create_block(), self.b.create_block(), self.b.create_block());
        self.b.set_cold_block(asked);
        self.b.ins().brif(room, free, &[], asked, &[]);
        self.b.seal_block(free);
        self.b.switch_to_block(free);
        self.b.ins().brif(address, direct, &[], asked, &[]);
        self.b.seal_block(direct);
        self.b.seal_block(asked);
        self.b.switch_to_block(direct);
        self.run_directly(pc, call, instance, local_len, address);
        self.b.ins().jump(next, &[]);
        self.b.switch_to_block(asked);
        self.checked = Checked::default();
    }

    fn run_directly(&mut self, pc: usize, call: &Call, instance: Db, local_len: u32, address: Value) {
        self.copy_in(call, instance);
        self.write_back();
        let kept: Vec<(Value, usize)> = KEPT
            .iter()
            .flat_map(|field| values(*field))
            .map(|(ty, at)| (self.load_state(ty, self.run, Self::reg(at)), at))
            .collect();
        let tops = [offset_of!(Hot, refs_top), offset_of!(Hot, local_top), offset_of!(Hot, depth)];
        let [refs, local, depth] = tops.map(|at| self.load_state(types::I32, self.hot, at));
        let ar2 = self.load_state(types::I32, self.run, Self::reg(offset_of!(Regs, ar2)));
        let added = [call.refs.len() as u32, local_len, 1];
        for ((at, top), more) in tops.into_iter().zip([refs, local, depth]).zip(added) {
            let more = self.word(more);
            let top = self.b.ins().iadd(top, more);
            self.store_state(top, self.hot, at);
        }
        let first = self.word(self.plan.areas.local.at.0);
        let first = self.b.ins().iadd(first, local);
        let (length, own) = (self.word(local_len), self.word(self.plan.blocks[self.block as usize].local_len));
        let previous = self.load_state(types::I32, self.run, Self::reg(offset_of!(Regs, local)));
        for (value, at) in [
            (first, offset_of!(Regs, local)),
            (length, offset_of!(Regs, local_len)),
            (previous, offset_of!(Regs, previous_local)),
            (own, offset_of!(Regs, previous_local_len)),
            (refs, offset_of!(Regs, refs)),
        ] {
            self.store_state(value, self.run, Self::reg(at));
        }
        self.put_constants(FRESH);
        self.keep_own_instance();
        self.put_instance(instance);
        self.end_of_chain();
        let answer = self.b.ins().call_indirect(self.other, address, &[self.run]);
        let answer = self.b.inst_results(answer)[0];
        self.abandon_if(answer, pc, &kept);
        for (value, at) in kept {
            self.store_state(value, self.run, Self::reg(at));
        }
        for (at, top) in tops.into_iter().zip([refs, local, depth]) {
            self.store_state(top, self.hot, at);
        }
        self.store_state(ar2, self.run, Self::reg(offset_of!(Regs, ar2)));
        self.end_of_chain();
        self.checked = Checked::default();
        self.copy_out(call, instance);
        self.write_back();
        self.put_data(instance, offset_of!(Regs, db));
    }

    /// Leaves the block when the one it has called was aborted; the CPU is told which call that was.
    fn abandon_if(&mut self, answer: Value, pc: usize, kept: &[(Value, usize)]) {
        let [abandons, next] = [(); 2].map(|()| self.b.create_block());
        self.b.set_cold_block(abandons);
        self.b.ins().brif(answer, abandons, &[], next, &[]);
        self.b.seal_block(abandons);
        self.b.seal_block(next);
        self.b.switch_to_block(abandons);
        for (value, at) in kept {
            self.store_state(*value, self.run, Self::reg(*at));
        }
        let (block, at) = (self.word(self.block), self.word(pc as u32));
        self.call_helper(offset_of!(Run, abandoned), block, at);
        self.ways.aborts = true;
        self.b.ins().jump(self.abort, &[]);
        self.b.switch_to_block(next);
    }

    /// The DB register of a called function block is its caller's DI.
    fn keep_own_instance(&mut self) {
        let size = size_of::<Db>();
        for ((ty, di), (_, db)) in values((offset_of!(Regs, di), size)).zip(values((offset_of!(Regs, db), size))) {
            let part = self.load_state(ty, self.run, Self::reg(di));
            self.store_state(part, self.run, Self::reg(db));
        }
    }

    /// The instance of a function block is the open DI, and AR2 its beginning.
    fn put_instance(&mut self, db: Db) {
        self.put_data(db, offset_of!(Regs, di));
        let ar2 = self.word(INSTANCE);
        self.store_state(ar2, self.run, Self::reg(offset_of!(Regs, ar2)));
    }

    /// The status word at the beginning of a called block and after the call: OS = 0, the chain has ended.
    fn end_of_chain(&mut self) {
        let flags = self.load_state(types::I32, self.run, Self::reg(offset_of!(Regs, flags)));
        let rest = self.word(!OS);
        let flags = self.b.ins().band(flags, rest);
        self.store_state(flags, self.run, Self::reg(offset_of!(Regs, flags)));
        self.put_constants(CHAIN);
    }

    fn put_constants(&mut self, constants: &[(Field, u64)]) {
        for (field, value) in constants {
            for (ty, at) in values(*field) {
                let value = self.b.iconst(ty, *value as i64);
                self.store_state(value, self.run, Self::reg(at));
            }
        }
    }
}
