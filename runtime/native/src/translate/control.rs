//! Jumps, ends, safe points, calls.

use std::mem::offset_of;

use cranelift_codegen::ir::{self, BlockArg, InstBuilder, JumpTableData, condcodes::IntCC, types};
use ob1_cpu::engine::Hot;
use ob1_ir::{Jump, StatusBit};

use super::state::{self, Bit, Data, State};
use super::{Checked, Landing, Translation};
use crate::flow;
use crate::run::Run;

/// Places whose values are kept over a safe point, at most, besides those that wait to be written.
const KEPT: usize = 0;

impl Translation<'_, '_> {
    /// False when nothing falls through.
    pub(crate) fn jump(&mut self, on: Jump, to: usize, pc: usize) -> bool {
        let mut when = true;
        let taken = match on {
            Jump::Always => Bit::Known(true),
            Jump::IfRlo | Jump::IfNotRlo | Jump::IfRloSaveBr | Jump::IfNotRloSaveBr => {
                let rlo = self.rlo();
                if matches!(on, Jump::IfRloSaveBr | Jump::IfNotRloSaveBr) {
                    self.now.br = rlo;
                }
                self.now.rlo = Bit::Known(true);
                self.end_chain(Bit::Known(true));
                when = matches!(on, Jump::IfRlo | Jump::IfRloSaveBr);
                rlo
            }
            Jump::IfBr | Jump::IfNotBr => {
                let br = self.status(StatusBit::BinaryResult);
                self.end_chain(Bit::Known(true));
                when = on == Jump::IfBr;
                br
            }
            Jump::IfStoredOverflow => {
                let os = self.status(StatusBit::StoredOverflow);
                self.now.os = Bit::Known(false);
                os
            }
            Jump::IfOverflow => self.status(StatusBit::Overflow),
            Jump::IfZero => self.status(StatusBit::Zero),
            Jump::IfNotZero => self.status(StatusBit::NotZero),
            Jump::IfPositive => self.status(StatusBit::Positive),
            Jump::IfNegative => self.status(StatusBit::Negative),
            Jump::IfNotNegative => self.status(StatusBit::NotNegative),
            Jump::IfNotPositive => self.status(StatusBit::NotPositive),
            Jump::IfUnordered => self.status(StatusBit::Unordered),
        };
        match taken {
            Bit::Known(bit) if bit == when => {
                self.go(to, pc);
                false
            }
            Bit::Known(_) => true,
            taken => {
                if self.fast || to <= pc {
                    self.write_back();
                } else {
                    self.write_slow();
                }
                self.branch(taken, when, |t| t.go(to, pc));
                true
            }
        }
    }

    /// Branches to `other` if `condition` is 1 (`when`) or is not 1; `other` does not come back here.
    fn branch(&mut self, condition: Bit, when: bool, other: impl FnOnce(&mut Self)) {
        let condition = condition.condition(self.vars.rlo, &mut self.b);
        let taken = self.b.create_block();
        let next = self.b.create_block();
        let (one, zero) = if when { (taken, next) } else { (next, taken) };
        self.b.ins().brif(condition, one, &[], zero, &[]);
        self.b.seal_block(taken);
        self.b.seal_block(next);
        self.b.switch_to_block(taken);
        self.beside(other);
        self.b.switch_to_block(next);
    }

    /// Goes to statement `to`; backwards there is a safe point.
    fn go(&mut self, to: usize, pc: usize) {
        if to <= pc {
            self.safe_point(to, self.body.live[to]);
        }
        let start = self.start_of(to);
        self.flush(to);
        self.b.ins().jump(start, &[]);
    }

    /// `LOOP`: counts ACCU1-L down and jumps unless it is 0.
    pub(crate) fn count_down(&mut self, to: usize, pc: usize) {
        let low = self.accu_low(0);
        let one = self.word(1);
        let left = self.b.ins().isub(low, one);
        let hi = state::high(self.now.a[0], self.vars.a[0], &mut self.b);
        self.now.a[0] = super::state::Accu::Split { hi, lo: left };
        let word = self.b.ins().ireduce(types::I16, left);
        let zero = self.b.iconst(types::I16, 0);
        let more = self.b.ins().icmp(IntCC::NotEqual, word, zero);
        // Both paths need what waits, and each would calculate it again.
        self.write_back();
        self.branch(Bit::Val(more), true, |t| t.go(to, pc));
    }

    /// `SPL`: jumps by the number in ACCU1-LL.
    pub(crate) fn jump_list(&mut self, targets: &[u32], otherwise: u32, pc: usize) {
        let low = self.accu_low(0);
        let mask = self.word(0xFF);
        let index = self.b.ins().band(low, mask);
        let ways: Vec<ir::Block> = (0..=targets.len()).map(|_| self.b.create_block()).collect();
        let calls: Vec<_> = ways.iter().map(|way| self.b.func.dfg.block_call(*way, &[])).collect();
        let (last, listed) = calls.split_last().expect("at least the last one");
        self.write_back();
        let table = self.b.create_jump_table(JumpTableData::new(*last, listed));
        self.b.ins().br_table(index, table);
        for (way, to) in ways.into_iter().zip(targets.iter().chain([&otherwise])) {
            self.b.seal_block(way);
            self.b.switch_to_block(way);
            self.beside(|t| t.go(*to as usize, pc));
        }
    }

    /// A safe point before statement `statement`: reads the clock and checks what is due, if it is time.
    ///
    /// What waits to be written is written only if the safe point looks; after that everything is read again. The
    /// stacks of a CPU that goes to STOP here have the registers of `told`.
    pub(crate) fn safe_point(&mut self, statement: usize, told: flow::Set) {
        let uncounted = self.now.uncounted;
        self.count(uncounted);
        let executed = self.executed();
        let look_after = self.load_state(types::I32, self.hot, offset_of!(Hot, look_after));
        let late = self.b.ins().icmp(IntCC::UnsignedGreaterThanOrEqual, executed, look_after);
        let [looks, early, next] = [(); 3].map(|()| self.b.create_block());
        self.b.set_cold_block(looks);
        let kept = self.keep(KEPT);
        let values = self.held(&kept);
        let mut params = Vec::with_capacity(values.len());
        for value in &values {
            let ty = self.b.func.dfg.value_type(*value);
            params.push(self.b.append_block_param(next, ty));
        }
        let arguments: Vec<BlockArg> = values.into_iter().map(BlockArg::from).collect();
        self.b.ins().brif(late, looks, &[], early, &[]);
        self.b.seal_block(early);
        self.b.switch_to_block(early);
        let flags = self.state_flags();
        let due = self.load_state(types::I64, self.hot, offset_of!(Hot, due));
        let due = self.b.ins().load(types::I8, flags, due, 0);
        self.b.ins().brif(due, looks, &[], next, &arguments);
        self.b.seal_block(looks);
        self.b.switch_to_block(looks);
        self.beside(|t| {
            t.write_back();
            t.tell_count();
            t.spill(told);
            t.spill_data();
        });
        let (block, at) = (self.word(self.block), self.word(statement as u32));
        let answer = self.call_helper(offset_of!(Run, safe_point), block, at);
        self.abort_if(answer);
        self.take_count();
        self.count(uncounted);
        // Others may have written.
        let again: Vec<BlockArg> = kept.iter().map(|place| BlockArg::from(self.load_place(*place))).collect();
        self.b.ins().jump(next, &again);
        self.b.seal_block(next);
        self.b.switch_to_block(next);
        self.hold(&kept, &params);
    }

    /// The end of the block. It counts as the statement it is on the CPU.
    pub(crate) fn end(&mut self) {
        self.now.uncounted = self.now.uncounted.wrapping_add(1);
        if self.body.inlined.is_some() {
            self.end_inlined();
            return;
        }
        self.write_back();
        let seen = self.body.env.end;
        self.spill(seen);
        self.tell_count();
        let done = self.word(0);
        self.b.ins().return_(&[done]);
    }

    /// `BEB`: ends the block if the RLO is 1.
    pub(crate) fn end_if(&mut self) {
        let rlo = self.rlo();
        self.write_back();
        self.branch(rlo, true, |t| {
            // The statement counts as the end.
            t.now.uncounted = t.now.uncounted.wrapping_sub(1);
            t.end();
        });
        self.now.rlo = Bit::Known(true);
        self.end_chain(Bit::Known(true));
    }

    /// A call. All registers are in memory, for the helper and for the reference, which may take over here.
    pub(crate) fn call(&mut self, pc: usize) {
        if self.inlined_call(pc) {
            return;
        }
        self.write_back();
        let live = self.body.live[pc];
        self.spill(live);
        self.spill_data();
        if self.body.entries[pc] {
            self.tell_count();
            let here = self.b.create_block();
            self.b.ins().jump(here, &[]);
            self.resume.push((pc as u32, self.landings.len() as u32 + 1));
            self.landings.push(Landing { block: here, live: 0, met: None });
            self.b.switch_to_block(here);
            self.take_count();
        }
        let (db, di) = (self.now.db, self.now.di);
        let (stored, uncounted) = (self.now.stored | flow::ALL, self.now.uncounted.wrapping_add(1));
        self.now = State { db, di, saved: [true; 2], uncounted, stored, ..State::variables() };
        self.checked = Checked::default();
        let next = self.b.create_block();
        self.call_directly(pc, next);
        self.tell_count();
        let (block, at) = (self.word(self.block), self.word(pc as u32));
        let answer = self.call_helper(offset_of!(Run, call), block, at);
        let other = self.b.create_block();
        self.b.set_cold_block(other);
        self.b.ins().brif(answer, other, &[], next, &[]);
        self.b.seal_block(other);
        self.b.seal_block(next);
        self.b.switch_to_block(other);
        let behind = self.word(pc as u32 + 1);
        self.ways.fails = true;
        self.b.ins().jump(self.failed, &[BlockArg::from(answer), BlockArg::from(behind)]);
        self.b.switch_to_block(next);
        self.checked = Checked::default();
        // A call that could not be made leaves the register alone, and the reference may come back to code behind it.
        let db = if flow::opens_instance(&self.body.stmts[pc].op) { Data::Var } else { db };
        self.now = State { db, di, saved: [true; 2], ..State::memory() };
        self.end_chain(Bit::Known(true));
    }
}
