//! Registers to memory and back, and the ways to the reference.

use std::mem::offset_of;

use cranelift_codegen::ir::{self, BlockArg, InstBuilder, JumpTableData, Value, condcodes::IntCC, types};
use ob1_cpu::engine::{BR, Db, Hot, OS, OV, Regs};

use super::meeting::Met;
use super::state::{self, Accu, Bit, Cc, Data, Reg, State};
use super::{Checked, Landing, Translation};
use crate::flow::{self, Facts, Set};
use crate::run::Run;

/// Bits of the status word that lie in one word of memory.
const FLAGS: Set = flow::CC | flow::OV | flow::OS | flow::BR;

impl Translation<'_, '_> {
    /// Writes those registers of `set` to memory that memory does not have yet.
    pub(crate) fn spill(&mut self, set: Set) {
        let set = set & !self.in_memory();
        for (i, (bit, at)) in
            [(flow::A1, offset_of!(Regs, a1)), (flow::A2, offset_of!(Regs, a2))].into_iter().enumerate()
        {
            if set & bit != 0 {
                let v = state::full(self.now.a[i], self.vars.a[i], &mut self.b);
                self.store_state(v, self.run, Self::reg(at));
            }
        }
        for (i, (bit, at)) in
            [(flow::AR1, offset_of!(Regs, ar1)), (flow::AR2, offset_of!(Regs, ar2))].into_iter().enumerate()
        {
            if set & bit != 0 {
                let v = self.address(i);
                self.store_state(v, self.run, Self::reg(at));
            }
        }
        let bits = [
            (flow::RLO, self.now.rlo, self.vars.rlo, offset_of!(Regs, rlo)),
            (flow::FC, self.now.fc, self.vars.fc, offset_of!(Regs, fc)),
            (flow::OR, self.now.or, self.vars.or, offset_of!(Regs, or)),
            (flow::STA, self.now.sta, self.vars.sta, offset_of!(Regs, sta)),
        ];
        for (bit, value, var, at) in bits {
            if set & bit != 0 {
                let v = value.value(var, &mut self.b);
                self.store_state(v, self.run, Self::reg(at));
            }
        }
        if set & FLAGS != 0 {
            let v = self.flags_word(set);
            self.store_state(v, self.run, Self::reg(offset_of!(Regs, flags)));
        }
        if set & flow::NEST != 0 {
            let v = self.nest();
            self.store_state(v, self.run, Self::reg(offset_of!(Regs, nest)));
        }
    }

    /// Registers whose values memory has.
    fn in_memory(&self) -> Set {
        let now = &self.now;
        let fresh = |bit: Set| now.fresh[bit.trailing_zeros() as usize];
        let kept = |bit: Set, value: Option<Value>| value.is_some() && fresh(bit) == value;
        let mut set = 0;
        for (i, bit) in [flow::A1, flow::A2].into_iter().enumerate() {
            let is = match now.a[i] {
                Accu::Var => now.stored & bit != 0,
                Accu::Full(v) => kept(bit, Some(v)),
                _ => false,
            };
            set |= if is { bit } else { 0 };
        }
        for (i, bit) in [flow::AR1, flow::AR2].into_iter().enumerate() {
            let is = match now.ar[i] {
                Reg::Var => now.stored & bit != 0,
                Reg::Val(v) => kept(bit, Some(v)),
                Reg::Known(_) => false,
            };
            set |= if is { bit } else { 0 };
        }
        for (value, bit) in [
            (now.rlo, flow::RLO),
            (now.fc, flow::FC),
            (now.or, flow::OR),
            (now.sta, flow::STA),
            (now.ov, flow::OV),
            (now.os, flow::OS),
            (now.br, flow::BR),
        ] {
            let is = match value {
                Bit::Var => now.stored & bit != 0,
                Bit::Val(v) => kept(bit, Some(v)),
                _ => false,
            };
            set |= if is { bit } else { 0 };
        }
        let is = match now.cc {
            Cc::Var => now.stored & flow::CC != 0,
            Cc::Word(v) => kept(flow::CC, Some(v)),
            _ => false,
        };
        set |= if is { flow::CC } else { 0 };
        set | if now.brackets.is_empty() { now.stored & flow::NEST } else { 0 }
    }

    /// The flags of `set` in their places of the status word, with those that memory has.
    fn flags_word(&mut self, set: Set) -> Value {
        let mut parts = Vec::new();
        let mut replaced = 0;
        if set & flow::CC != 0 {
            replaced |= ob1_cpu::engine::CC1 | ob1_cpu::engine::CC0;
            parts.push(state::word(self.now.cc, self.vars.cc, &mut self.b));
        }
        for (bit, value, var, mask) in [
            (flow::OV, self.now.ov, self.vars.ov, OV),
            (flow::OS, self.now.os, self.vars.os, OS),
            (flow::BR, self.now.br, self.vars.br, BR),
        ] {
            if set & bit != 0 {
                replaced |= mask;
                let value = self.read_bit(value, var);
                parts.push(state::placed(value, mask, &mut self.b));
            }
        }
        if self.in_memory() & FLAGS != 0 {
            let before = self.load_state(types::I32, self.run, Self::reg(offset_of!(Regs, flags)));
            let rest = self.word(!replaced);
            parts.push(self.b.ins().band(before, rest));
        }
        let mut word = parts.pop().unwrap_or_else(|| self.word(0));
        for part in parts {
            word = self.b.ins().bor(word, part);
        }
        word
    }

    /// Brackets opened before the last place where jumps meet.
    pub(crate) fn outer_nest(&mut self) -> Value {
        if self.now.stored & flow::NEST != 0 {
            let v = self.load_state(types::I64, self.run, Self::reg(offset_of!(Regs, nest)));
            self.b.def_var(self.vars.nest, v);
            self.now.stored &= !flow::NEST;
        }
        self.b.use_var(self.vars.nest)
    }

    /// Open brackets as memory has them.
    pub(crate) fn nest(&mut self) -> Value {
        let mut nest = self.outer_nest();
        for bracket in self.now.brackets.clone() {
            let eight = self.b.iconst(types::I64, 8);
            nest = self.b.ins().ishl(nest, eight);
            let rlo = bracket.rlo.value(self.vars.rlo, &mut self.b);
            let rlo = self.b.ins().uextend(types::I64, rlo);
            let or = bracket.or.value(self.vars.or, &mut self.b);
            let or = self.b.ins().uextend(types::I64, or);
            let one = self.b.iconst(types::I64, 1);
            let or = self.b.ins().ishl(or, one);
            let rest = i64::from(bracket.negate) << 2 | (bracket.logic as i64) << 3;
            let rest = self.b.iconst(types::I64, rest);
            nest = self.b.ins().bor(nest, rlo);
            nest = self.b.ins().bor(nest, or);
            nest = self.b.ins().bor(nest, rest);
        }
        nest
    }

    /// Reads those registers of `set` into values that only memory has.
    pub(crate) fn need(&mut self, set: Set) {
        let set = set & self.now.stored;
        for (i, (bit, at)) in
            [(flow::A1, offset_of!(Regs, a1)), (flow::A2, offset_of!(Regs, a2))].into_iter().enumerate()
        {
            if set & bit != 0 && self.now.a[i] == Accu::Var {
                let v = self.load_state(types::I32, self.run, Self::reg(at));
                self.now.a[i] = Accu::Full(v);
                self.is_fresh(bit, v);
            }
        }
        for (i, (bit, at)) in
            [(flow::AR1, offset_of!(Regs, ar1)), (flow::AR2, offset_of!(Regs, ar2))].into_iter().enumerate()
        {
            if set & bit != 0 && self.now.ar[i] == Reg::Var {
                let v = self.load_state(types::I32, self.run, Self::reg(at));
                self.now.ar[i] = Reg::Val(v);
                self.is_fresh(bit, v);
            }
        }
        for (bit, at) in [
            (flow::RLO, offset_of!(Regs, rlo)),
            (flow::FC, offset_of!(Regs, fc)),
            (flow::OR, offset_of!(Regs, or)),
            (flow::STA, offset_of!(Regs, sta)),
        ] {
            if set & bit != 0 && *self.bit_place(bit) == Bit::Var {
                let v = self.load_state(types::I8, self.run, Self::reg(at));
                *self.bit_place(bit) = Bit::Val(v);
                self.is_fresh(bit, v);
            }
        }
        if set & flow::CC != 0 && self.now.cc == Cc::Var {
            let word = self.load_state(types::I32, self.run, Self::reg(offset_of!(Regs, flags)));
            let mask = self.word(ob1_cpu::engine::CC1 | ob1_cpu::engine::CC0);
            let cc = self.b.ins().band(word, mask);
            self.now.cc = Cc::Word(cc);
            self.is_fresh(flow::CC, cc);
        }
        for (bit, mask) in [(flow::OV, OV), (flow::OS, OS), (flow::BR, BR)] {
            if set & bit != 0 && *self.bit_place(bit) == Bit::Var {
                let word = self.load_state(types::I32, self.run, Self::reg(offset_of!(Regs, flags)));
                let shift = self.word(mask.trailing_zeros());
                let v = self.b.ins().ushr(word, shift);
                let one = self.word(1);
                let v = self.b.ins().band(v, one);
                let v = self.b.ins().ireduce(types::I8, v);
                *self.bit_place(bit) = Bit::Val(v);
                self.is_fresh(bit, v);
            }
        }
    }

    const fn bit_place(&mut self, bit: Set) -> &mut Bit {
        match bit {
            flow::RLO => &mut self.now.rlo,
            flow::FC => &mut self.now.fc,
            flow::OR => &mut self.now.or,
            flow::STA => &mut self.now.sta,
            flow::OV => &mut self.now.ov,
            flow::OS => &mut self.now.os,
            _ => &mut self.now.br,
        }
    }

    const fn is_fresh(&mut self, bit: Set, v: Value) {
        self.now.fresh[bit.trailing_zeros() as usize] = Some(v);
    }

    /// Writes the data block registers to memory when it does not have them.
    pub(crate) fn spill_data(&mut self) {
        for (i, (data, at)) in
            [(self.now.db, offset_of!(Regs, db)), (self.now.di, offset_of!(Regs, di))].into_iter().enumerate()
        {
            let Data::Known(db) = data else { continue };
            if std::mem::replace(&mut self.now.saved[i], true) {
                continue;
            }
            self.put_data(db, at);
        }
    }

    /// Writes a data block register to memory; `at` is its place in [`Regs`].
    pub(crate) fn put_data(&mut self, db: Db, at: usize) {
        let first = u64::from(db.at.0) | u64::from(db.len) << 32;
        let second = u64::from(db.writable) | u64::from(db.number) << 32;
        for (value, part) in [(first, 0), (second, 8)] {
            let v = self.b.iconst(types::I64, value as i64);
            self.store_state(v, self.run, Self::reg(at + part));
        }
    }

    /// Puts the registers that statement `pc` needs into their variables: jumps meet there.
    pub(crate) fn flush(&mut self, pc: usize) {
        let facts = self.body.facts[pc].unwrap_or(Facts::NONE);
        let live = self.body.live[pc];
        debug_assert_eq!(
            live & !self.body.unsaved[pc] & !self.in_memory() & !(flow::FC | flow::OR),
            0,
            "what memory does not have is carried on"
        );
        let live = live & self.body.unsaved[pc];
        self.need(live);
        for (i, bit) in [flow::A1, flow::A2].into_iter().enumerate() {
            if live & bit != 0 && self.now.a[i] != Accu::Var {
                let v = state::full(self.now.a[i], self.vars.a[i], &mut self.b);
                self.b.def_var(self.vars.a[i], v);
            }
        }
        for (i, bit) in [flow::AR1, flow::AR2].into_iter().enumerate() {
            if live & bit != 0 && self.now.ar[i] != Reg::Var {
                let v = self.address(i);
                self.b.def_var(self.vars.ar[i], v);
            }
        }
        let known = |known: Option<bool>| known.is_none();
        for (bit, value, var, wanted) in [
            (flow::RLO, self.now.rlo, self.vars.rlo, true),
            (flow::FC, self.now.fc, self.vars.fc, known(facts.fc)),
            (flow::OR, self.now.or, self.vars.or, known(facts.or)),
            (flow::STA, self.now.sta, self.vars.sta, true),
            (flow::OV, self.now.ov, self.vars.ov, true),
            (flow::OS, self.now.os, self.vars.os, true),
            (flow::BR, self.now.br, self.vars.br, true),
        ] {
            if live & bit != 0 && wanted && value != Bit::Var {
                let v = value.value(var, &mut self.b);
                self.b.def_var(var, v);
            }
        }
        if live & flow::CC != 0 && self.now.cc != Cc::Var {
            let v = state::word(self.now.cc, self.vars.cc, &mut self.b);
            self.b.def_var(self.vars.cc, v);
        }
        if live & flow::NEST != 0 {
            let v = self.nest();
            self.b.def_var(self.vars.nest, v);
        }
        // An inlined block opens no data block.
        if self.body.inlined.is_none() {
            let unknown = [facts.db.is_none(), facts.di.is_none()];
            let saved = self.now.saved;
            self.now.saved = [saved[0] || !unknown[0], saved[1] || !unknown[1]];
            self.spill_data();
            self.now.saved = [saved[0] || unknown[0], saved[1] || unknown[1]];
        }
        self.send_places(pc);
        let uncounted = self.body.uncounted(pc, self.now.uncounted);
        self.count(uncounted);
    }

    /// The variable counts all but `uncounted` of the statements up to here.
    pub(crate) fn count(&mut self, uncounted: u32) {
        if self.now.uncounted != uncounted || self.now.stored & flow::COUNT != 0 {
            self.now.uncounted = self.now.uncounted.wrapping_sub(uncounted);
            let executed = self.executed();
            self.b.def_var(self.vars.executed, executed);
            self.now.uncounted = uncounted;
        }
    }

    /// Statements executed, including those that the variable does not count yet.
    pub(crate) fn executed(&mut self) -> Value {
        if self.now.stored & flow::COUNT != 0 {
            self.now.stored &= !flow::COUNT;
            let executed = self.load_state(types::I32, self.hot, offset_of!(Hot, pending));
            self.b.def_var(self.vars.executed, executed);
        }
        let executed = self.b.use_var(self.vars.executed);
        if self.now.uncounted == 0 {
            return executed;
        }
        let more = self.word(self.now.uncounted);
        self.b.ins().iadd(executed, more)
    }

    /// Writes to memory how many statements were executed.
    pub(crate) fn tell_count(&mut self) {
        if self.now.stored & flow::COUNT != 0 && self.now.uncounted == 0 {
            return;
        }
        let executed = self.executed();
        self.store_state(executed, self.hot, offset_of!(Hot, pending));
    }

    /// After a helper: the count is the one in memory.
    pub(crate) const fn take_count(&mut self) {
        self.now.stored |= flow::COUNT;
        self.now.uncounted = 0;
    }

    /// When `bad` is not 0, the reference executes statement `pc` and those that follow.
    pub(crate) fn leave_if(&mut self, bad: Value, pc: usize) {
        if state::constant(&self.b, bad) == Some(0) {
            return;
        }
        let exit = self.b.create_block();
        let next = self.b.create_block();
        self.b.set_cold_block(exit);
        self.b.ins().brif(bad, exit, &[], next, &[]);
        self.b.seal_block(exit);
        self.b.seal_block(next);
        self.b.switch_to_block(exit);
        self.beside(|t| t.leave_here(pc));
        self.b.switch_to_block(next);
    }

    /// At the entry: the reference runs the whole block when `room` is 0.
    pub(crate) fn leave_for_good_unless(&mut self, room: Value) {
        let (whole, next) = (self.b.create_block(), self.b.create_block());
        self.b.set_cold_block(whole);
        self.b.ins().brif(room, next, &[], whole, &[]);
        self.b.seal_block(whole);
        self.b.seal_block(next);
        self.b.switch_to_block(whole);
        let (block, first) = (self.word(self.block), self.word(0));
        let answer = self.call_helper(offset_of!(Run, whole), block, first);
        self.b.ins().return_(&[answer]);
        self.b.switch_to_block(next);
    }

    /// Code that does not come back here: what is known stays as it is.
    pub(crate) fn beside(&mut self, make: impl FnOnce(&mut Self)) {
        let (before, checked) = (self.now.clone(), self.checked.clone());
        make(self);
        (self.now, self.checked) = (before, checked);
    }

    fn leave_here(&mut self, pc: usize) {
        debug_assert!(self.body.inlined.is_none(), "what can fail is not inlined");
        self.write_back();
        self.spill(self.body.live[pc]);
        self.spill_data();
        // The statement itself is counted by the reference.
        self.now.uncounted = self.now.uncounted.wrapping_sub(1);
        self.count(pc as u32);
        let at = self.word(pc as u32);
        self.ways.leaves = true;
        self.b.ins().jump(self.leave, &[BlockArg::from(at)]);
    }

    /// Calls a helper with two numbers; returns its answer.
    pub(crate) fn call_helper(&mut self, pointer: usize, first: Value, second: Value) -> Value {
        let helper = self.load_pointer(self.run, pointer);
        let call = self.b.ins().call_indirect(self.helper, helper, &[self.run, first, second]);
        self.b.inst_results(call)[0]
    }

    /// Returns when a helper's answer is not 0: the run is aborted.
    pub(crate) fn abort_if(&mut self, answer: Value) {
        let next = self.b.create_block();
        self.ways.aborts = true;
        self.b.ins().brif(answer, self.abort, &[], next, &[]);
        self.b.seal_block(next);
        self.b.switch_to_block(next);
    }

    /// The reference executes this one statement.
    pub(crate) fn step(&mut self, pc: usize) {
        self.write_back();
        let live = self.body.live[pc];
        self.spill(live);
        self.spill_data();
        self.tell_count();
        let (block, at) = (self.word(self.block), self.word(pc as u32));
        let answer = self.call_helper(offset_of!(Run, step), block, at);
        self.abort_if(answer);
        self.now = State::memory();
        self.checked = Checked::default();
    }

    /// The reference can continue at statement `pc`, whose code is `block`.
    pub(crate) fn landing(&mut self, pc: usize, block: ir::Block) {
        self.resume.push((pc as u32, self.landings.len() as u32 + 1));
        let live = self.body.live[pc] & self.body.unsaved[pc];
        self.landings.push(Landing { block, live, met: Some(pc) });
    }

    /// The ways back from the reference, and the way out of an abort.
    pub(crate) fn ways_back(&mut self) {
        self.b.set_srcloc(ir::SourceLoc::default());
        if self.ways.leaves {
            let at = self.b.append_block_param(self.leave, types::I32);
            self.b.switch_to_block(self.leave);
            // The variable counts all but the statements before.
            let counted = self.b.use_var(self.vars.executed);
            let executed = self.b.ins().iadd(counted, at);
            self.store_state(executed, self.hot, offset_of!(Hot, pending));
            self.b.ins().jump(self.leave_counted, &[BlockArg::from(at)]);
        }
        if self.ways.fails {
            let answer = self.b.append_block_param(self.failed, types::I32);
            let behind = self.b.append_block_param(self.failed, types::I32);
            self.b.switch_to_block(self.failed);
            // Less than 0: aborted. Else an error organization block has run, and the chain is as it was.
            let zero = self.word(0);
            let aborted = self.b.ins().icmp(IntCC::SignedLessThan, answer, zero);
            self.ways.aborts = true;
            self.b.ins().brif(aborted, self.abort, &[], self.leave_counted, &[BlockArg::from(behind)]);
        }
        if self.ways.leaves || self.ways.fails {
            self.reference_goes_on();
        } else {
            // Nothing leads to the reference, nothing comes back.
            self.resume.clear();
        }
        if self.ways.aborts {
            self.b.switch_to_block(self.abort);
            let aborted = self.word(u32::MAX);
            self.b.ins().return_(&[aborted]);
        }
    }

    /// The reference continues, and may return to compiled code.
    fn reference_goes_on(&mut self) {
        let at = self.b.append_block_param(self.leave_counted, types::I32);
        self.b.switch_to_block(self.leave_counted);
        let block = self.word(self.block);
        let answer = self.call_helper(offset_of!(Run, leave), block, at);
        if self.landings.is_empty() {
            // It has reached the end, or was aborted.
            self.b.ins().return_(&[answer]);
        } else {
            self.dispatch(answer);
        }
    }

    /// To the entry with this number.
    fn dispatch(&mut self, answer: Value) {
        let dispatch = self.b.create_block();
        self.b.set_cold_block(dispatch);
        self.b.ins().jump(dispatch, &[]);
        // Number 0: the reference has reached the end.
        let ended = self.b.create_block();
        self.b.set_cold_block(ended);
        let mut calls = vec![self.b.func.dfg.block_call(ended, &[])];
        for to in std::mem::take(&mut self.landings) {
            let landing = self.b.create_block();
            self.b.set_cold_block(landing);
            let call = self.b.func.dfg.block_call(landing, &[]);
            calls.push(call);
            self.land(landing, &to);
        }
        self.b.switch_to_block(dispatch);
        self.ways.aborts = true;
        let table = JumpTableData::new(self.b.func.dfg.block_call(self.abort, &[]), &calls);
        let table = self.b.create_jump_table(table);
        self.b.ins().br_table(answer, table);

        self.b.switch_to_block(ended);
        let done = self.word(0);
        self.b.ins().return_(&[done]);
    }

    fn land(&mut self, landing: ir::Block, to: &Landing) {
        self.b.switch_to_block(landing);
        self.now = State::memory();
        self.need(to.live);
        for (i, accu) in self.now.a.into_iter().enumerate() {
            if let Accu::Full(v) = accu {
                self.b.def_var(self.vars.a[i], v);
            }
        }
        for (i, ar) in self.now.ar.into_iter().enumerate() {
            if let Reg::Val(v) = ar {
                self.b.def_var(self.vars.ar[i], v);
            }
        }
        for (value, var) in [
            (self.now.rlo, self.vars.rlo),
            (self.now.fc, self.vars.fc),
            (self.now.or, self.vars.or),
            (self.now.sta, self.vars.sta),
            (self.now.ov, self.vars.ov),
            (self.now.os, self.vars.os),
            (self.now.br, self.vars.br),
        ] {
            if let Bit::Val(v) = value {
                self.b.def_var(var, v);
            }
        }
        if let Cc::Word(v) = self.now.cc {
            self.b.def_var(self.vars.cc, v);
        }
        if to.live & flow::NEST != 0 {
            self.outer_nest();
        }
        if let Some(pc) = to.met {
            for Met { place, .. } in self.body.meeting[pc].clone().unwrap_or_default() {
                let value = self.load_place(place);
                let var = self.variable(place);
                self.b.def_var(var, value);
            }
            let uncounted = self.body.uncounted(pc, pc as u32);
            self.count(uncounted);
        }
        self.b.ins().jump(to.block, &[]);
    }
}
