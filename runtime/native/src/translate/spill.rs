//! Registers to memory and back, and the ways to the reference.

use std::mem::offset_of;

use cranelift_codegen::ir::{self, BlockArg, InstBuilder, JumpTableData, Value, types};
use ob1_cpu::engine::{BR, Db, Hot, OS, OV, Plan, Regs};
use ob1_ir::Op;

use super::state::{self, Accu, Bit, Cc, Data, Reg, State};
use super::{Checked, Landing, Translation};
use crate::flow::{self, Facts, Set};
use crate::run::Run;

/// Registers that some statement of a block changes; the others stay in memory as they are.
pub(crate) fn changed(plan: &Plan, block: u32) -> Set {
    let code = &plan.blocks[block as usize];
    // An inlined block may change all of its results.
    if code.stmts.iter().any(|s| matches!(s.op, Op::Call(_))) {
        return flow::ALL;
    }
    let mut set =
        flow::RLO | flow::FC | flow::OR | flow::STA | flow::A1 | flow::A2 | flow::CC | flow::OV | flow::OS | flow::BR;
    for stmt in &code.stmts {
        set |= match &stmt.op {
            Op::LoadAr(_)
            | Op::LoadArConst(..)
            | Op::LoadArFrom(..)
            | Op::CopyAr1ToAr2
            | Op::CopyAr2ToAr1
            | Op::ExchangeArs
            | Op::AddAr(_)
            | Op::AddArConst(..) => flow::AR1 | flow::AR2,
            Op::Open { .. } => flow::NEST,
            _ => 0,
        };
    }
    set
}

impl Translation<'_, '_> {
    /// Writes the registers of `set` that have changed to memory.
    pub(crate) fn spill(&mut self, set: Set) {
        let set = set & self.changed;
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
        if set & (flow::CC | flow::OV | flow::OS | flow::BR) != 0 {
            let v = self.flags_word(set);
            self.store_state(v, self.run, Self::reg(offset_of!(Regs, flags)));
        }
        if set & flow::NEST != 0 {
            let v = self.nest();
            self.store_state(v, self.run, Self::reg(offset_of!(Regs, nest)));
        }
    }

    /// The flags of `set` in their places of the status word; the others 0: nobody sees them.
    fn flags_word(&mut self, set: Set) -> Value {
        let mut parts = Vec::new();
        if set & flow::CC != 0 {
            parts.push(state::word(self.now.cc, self.vars.cc, &mut self.b));
        }
        for (bit, value, var, mask) in [
            (flow::OV, self.now.ov, self.vars.ov, OV),
            (flow::OS, self.now.os, self.vars.os, OS),
            (flow::BR, self.now.br, self.vars.br, BR),
        ] {
            if set & bit != 0 {
                let value = self.read_bit(value, var);
                parts.push(state::placed(value, mask, &mut self.b));
            }
        }
        let mut word = parts.pop().unwrap_or_else(|| self.word(0));
        for part in parts {
            word = self.b.ins().bor(word, part);
        }
        word
    }

    /// Open brackets as memory has them.
    pub(crate) fn nest(&mut self) -> Value {
        let mut nest = self.b.use_var(self.vars.nest);
        for bracket in self.now.brackets.clone() {
            let eight = self.b.ins().iconst(types::I64, 8);
            nest = self.b.ins().ishl(nest, eight);
            let rlo = bracket.rlo.value(self.vars.rlo, &mut self.b);
            let rlo = self.b.ins().uextend(types::I64, rlo);
            let or = bracket.or.value(self.vars.or, &mut self.b);
            let or = self.b.ins().uextend(types::I64, or);
            let one = self.b.ins().iconst(types::I64, 1);
            let or = self.b.ins().ishl(or, one);
            let rest = i64::from(bracket.negate) << 2 | (bracket.logic as i64) << 3;
            let rest = self.b.ins().iconst(types::I64, rest);
            nest = self.b.ins().bor(nest, rlo);
            nest = self.b.ins().bor(nest, or);
            nest = self.b.ins().bor(nest, rest);
        }
        nest
    }

    /// Reads the registers of `set` from memory into values.
    pub(crate) fn reload(&mut self, set: Set) {
        for (i, (bit, at)) in
            [(flow::A1, offset_of!(Regs, a1)), (flow::A2, offset_of!(Regs, a2))].into_iter().enumerate()
        {
            if set & bit != 0 {
                let v = self.load_state(types::I32, self.run, Self::reg(at));
                self.now.a[i] = Accu::Full(v);
            }
        }
        for (i, (bit, at)) in
            [(flow::AR1, offset_of!(Regs, ar1)), (flow::AR2, offset_of!(Regs, ar2))].into_iter().enumerate()
        {
            if set & bit != 0 {
                let v = self.load_state(types::I32, self.run, Self::reg(at));
                self.now.ar[i] = Reg::Val(v);
            }
        }
        for (bit, at) in [
            (flow::RLO, offset_of!(Regs, rlo)),
            (flow::FC, offset_of!(Regs, fc)),
            (flow::OR, offset_of!(Regs, or)),
            (flow::STA, offset_of!(Regs, sta)),
        ] {
            if set & bit != 0 {
                let v = self.load_state(types::I8, self.run, Self::reg(at));
                let place = match bit {
                    flow::RLO => &mut self.now.rlo,
                    flow::FC => &mut self.now.fc,
                    flow::OR => &mut self.now.or,
                    _ => &mut self.now.sta,
                };
                *place = Bit::Val(v);
            }
        }
        if set & (flow::CC | flow::OV | flow::OS | flow::BR) != 0 {
            let word = self.load_state(types::I32, self.run, Self::reg(offset_of!(Regs, flags)));
            if set & flow::CC != 0 {
                let mask = self.word(ob1_cpu::engine::CC1 | ob1_cpu::engine::CC0);
                let cc = self.b.ins().band(word, mask);
                self.now.cc = Cc::Word(cc);
            }
            for (bit, mask) in [(flow::OV, OV), (flow::OS, OS), (flow::BR, BR)] {
                if set & bit != 0 {
                    let shift = self.word(mask.trailing_zeros());
                    let v = self.b.ins().ushr(word, shift);
                    let one = self.word(1);
                    let v = self.b.ins().band(v, one);
                    let v = self.b.ins().ireduce(types::I8, v);
                    let place = match bit {
                        flow::OV => &mut self.now.ov,
                        flow::OS => &mut self.now.os,
                        _ => &mut self.now.br,
                    };
                    *place = Bit::Val(v);
                }
            }
        }
        if set & flow::NEST != 0 {
            let v = self.load_state(types::I64, self.run, Self::reg(offset_of!(Regs, nest)));
            self.b.def_var(self.vars.nest, v);
            self.now.brackets.clear();
        }
    }

    /// Reads the data block registers from memory.
    pub(crate) fn reload_data(&mut self) {
        for (at, vars) in [(offset_of!(Regs, db), self.vars.db), (offset_of!(Regs, di), self.vars.di)] {
            let parts = [offset_of!(Db, at), offset_of!(Db, len), offset_of!(Db, writable)];
            for (part, var) in parts.into_iter().zip(vars) {
                let v = self.load_state(types::I32, self.run, Self::reg(at) + part);
                self.b.def_var(var, v);
            }
        }
        self.now.db = Data::Var;
        self.now.di = Data::Var;
        self.checked.db = [0; 2];
        self.checked.di = [0; 2];
        self.checked.instance = None;
    }

    /// Puts the registers that statement `pc` needs into their variables: jumps meet there.
    pub(crate) fn flush(&mut self, pc: usize) {
        self.write_back();
        let live = self.body.live[pc];
        let facts = self.body.facts[pc].unwrap_or(Facts::NONE);
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
        if live & flow::NEST != 0 && !self.now.brackets.is_empty() {
            let v = self.nest();
            self.b.def_var(self.vars.nest, v);
        }
        for (data, vars, known) in [(self.now.db, self.vars.db, facts.db), (self.now.di, self.vars.di, facts.di)] {
            if let (Data::Known(db), None) = (data, known) {
                for (value, var) in [db.at.0, db.len, db.writable].into_iter().zip(vars) {
                    let v = self.word(value);
                    self.b.def_var(var, v);
                }
            }
        }
        self.send_places(pc);
        self.count();
    }

    /// The variable counts every statement up to here.
    pub(crate) fn count(&mut self) {
        if self.now.uncounted > 0 {
            let executed = self.executed();
            self.b.def_var(self.vars.executed, executed);
            self.now.uncounted = 0;
        }
    }

    /// Statements executed, those that the variable does not count yet included.
    pub(crate) fn executed(&mut self) -> Value {
        let executed = self.b.use_var(self.vars.executed);
        if self.now.uncounted == 0 {
            return executed;
        }
        let more = self.word(self.now.uncounted);
        self.b.ins().iadd(executed, more)
    }

    /// Tells memory how many statements were executed.
    pub(crate) fn tell_count(&mut self) {
        let executed = self.executed();
        self.store_state(executed, self.hot, offset_of!(Hot, pending));
    }

    /// The count as memory has it, behind a helper.
    pub(crate) fn take_count(&mut self) {
        let executed = self.load_state(types::I32, self.hot, offset_of!(Hot, pending));
        self.b.def_var(self.vars.executed, executed);
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
        let (before, checked) = (self.now.clone(), self.checked.clone());
        self.leave_here(pc);
        (self.now, self.checked) = (before, checked);
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

    fn leave_here(&mut self, pc: usize) {
        debug_assert!(self.body.inlined.is_none(), "what can fail is not inlined");
        self.write_back();
        self.spill(self.body.live[pc]);
        // The statement itself is counted by the reference.
        self.now.uncounted = self.now.uncounted.saturating_sub(1);
        self.tell_count();
        let at = self.word(pc as u32);
        self.b.ins().jump(self.leave, &[BlockArg::from(at)]);
    }

    /// Calls a helper with two numbers; its answer.
    pub(crate) fn call_helper(&mut self, pointer: usize, first: Value, second: Value) -> Value {
        let helper = self.load_pointer(self.run, pointer);
        let call = self.b.ins().call_indirect(self.helper, helper, &[self.run, first, second]);
        self.b.inst_results(call)[0]
    }

    /// Returns when a helper's answer is not 0: the run is aborted.
    pub(crate) fn abort_if(&mut self, answer: Value) {
        let next = self.b.create_block();
        self.b.ins().brif(answer, self.abort, &[], next, &[]);
        self.b.seal_block(next);
        self.b.switch_to_block(next);
    }

    /// The reference executes this one statement.
    pub(crate) fn step(&mut self, pc: usize) {
        self.write_back();
        let live = self.body.live[pc];
        self.spill(live);
        self.tell_count();
        let (block, at) = (self.word(self.block), self.word(pc as u32));
        let answer = self.call_helper(offset_of!(Run, step), block, at);
        self.abort_if(answer);
        self.take_count();
        self.take_registers(pc + 1);
    }

    /// Registers as memory has them, before statement `pc`.
    pub(crate) fn take_registers(&mut self, pc: usize) {
        let (db, di) = (self.now.db, self.now.di);
        self.now = State { uncounted: self.now.uncounted, ..State::variables() };
        self.checked = Checked::default();
        self.reload(self.body.live[pc]);
        self.reload_data();
        // A call gives the data block registers back.
        if pc > 0 && matches!(self.body.stmts[pc - 1].op, Op::Call(_)) {
            (self.now.db, self.now.di) = (db, di);
        }
    }

    /// The reference can go on at statement `pc`, whose code is `block`.
    pub(crate) fn landing(&mut self, pc: usize, block: ir::Block) {
        self.resume.push((pc as u32, self.landings.len() as u32 + 1));
        self.landings.push(Landing { block, live: self.body.live[pc], met: Some(pc) });
    }

    /// The ways back from the reference, and the way out of an abort.
    pub(crate) fn ways_back(&mut self) {
        self.b.set_srcloc(ir::SourceLoc::default());
        let at = self.b.append_block_param(self.leave, types::I32);
        self.b.switch_to_block(self.leave);
        let block = self.word(self.block);
        let answer = self.call_helper(offset_of!(Run, leave), block, at);
        self.b.ins().jump(self.dispatch, &[BlockArg::from(answer)]);

        let answer = self.b.append_block_param(self.dispatch, types::I32);
        self.b.switch_to_block(self.dispatch);
        // Number 0: the reference has come to the end.
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
        self.b.switch_to_block(self.dispatch);
        let table = JumpTableData::new(self.b.func.dfg.block_call(self.abort, &[]), &calls);
        let table = self.b.create_jump_table(table);
        self.b.ins().br_table(answer, table);

        self.b.switch_to_block(ended);
        let done = self.word(0);
        self.b.ins().return_(&[done]);

        self.b.switch_to_block(self.abort);
        let aborted = self.word(u32::MAX);
        self.b.ins().return_(&[aborted]);
    }

    fn land(&mut self, landing: ir::Block, to: &Landing) {
        self.b.switch_to_block(landing);
        self.now = State::variables();
        self.take_count();
        self.reload(to.live);
        self.reload_data();
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
        for place in to.met.and_then(|pc| self.body.meeting[pc].clone()).unwrap_or_default() {
            let value = self.load_place(place);
            let var = self.variable(place);
            self.b.def_var(var, value);
        }
        self.b.ins().jump(to.block, &[]);
    }
}
