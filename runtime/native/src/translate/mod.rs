//! From the statements of a block to Cranelift's intermediate form.
//!
//! Accumulators, address registers and status bits are values while a stretch of statements runs; they go to memory
//! only where other code reads them. A statement whose operand cannot be reached goes, with all registers, to the
//! reference, which executes it and what follows up to the next place where compiled code can be entered again.

mod arithmetic;
mod bits;
mod builder;
pub(crate) mod cache;
mod control;
mod direct;
mod inlined;
mod meeting;
mod memory;
pub(crate) mod operand;
mod shifts;
mod spill;
pub(crate) mod state;
mod timers;
mod waiting;
mod words;

use std::collections::{BTreeMap, BTreeSet};

use cranelift_codegen::ir::condcodes::IntCC;
use cranelift_codegen::ir::{self, AliasRegion, AliasRegionData, InstBuilder, MemFlagsData, SigRef, Value, types};
use cranelift_frontend::{FunctionBuilder, Variable};
use ob1_cpu::engine::{Op as PlanOp, Plan, Regs};
use ob1_ir::{Op, Place, Stmt};
use ob1_model::{Area, BlockKind};

use crate::flow::{self, Env, Facts, How, Set};
use crate::image::{Made, Resume};
use crate::inline::{self, Reference};
use crate::run::Run;
use crate::tier::Tier;
use builder::Builder;
use state::{Bit, Data, State, Vars};

/// The function being made.
pub(crate) struct Translation<'a, 'f> {
    pub(crate) b: Builder<'f>,
    pub(crate) plan: &'a Plan,
    pub(crate) vars: Vars,
    pub(crate) run: Value,
    pub(crate) hot: Value,
    pub(crate) arena: Value,
    /// The block's local data.
    pub(crate) local: Value,
    /// The references to its actual parameters.
    pub(crate) refs: Value,
    /// The arena is one alias region: every area can be reached through a pointer.
    pub(crate) arena_region: AliasRegion,
    /// Registers and hot state are the other.
    pub(crate) state_region: AliasRegion,
    pub(crate) now: State,
    /// What has been checked on the way to here.
    pub(crate) checked: Checked,
    /// The block, or the one that is inlined into it.
    pub(crate) body: Body<'a>,
    /// Index of the block in the plan.
    pub(crate) block: u32,
    /// Entries from the reference: where they lead and what they need.
    pub(crate) landings: Vec<Landing>,
    pub(crate) resume: Vec<Resume>,
    /// Where the reference is to continue; its argument is the statement.
    pub(crate) leave: ir::Block,
    /// The same when the count is already in memory.
    pub(crate) leave_counted: ir::Block,
    /// Where a call leads that was not made, or was aborted: the answer, and the statement after it.
    pub(crate) failed: ir::Block,
    /// Where an abort returns.
    pub(crate) abort: ir::Block,
    /// Which of these exits are used.
    pub(crate) ways: Ways,
    pub(crate) helper: SigRef,
    /// The signature of other compiled blocks.
    pub(crate) other: SigRef,
    /// Registers that are needed after the statement being translated.
    pub(crate) wanted: Set,
    /// No actual parameter is a pointer: that was checked before the first statement.
    pub(crate) no_pointers: bool,
    /// Compiled quickly: known contents of memory are dropped where paths meet.
    pub(crate) fast: bool,
    /// The variables of places of memory, for where paths meet.
    pub(crate) places: BTreeMap<cache::Place, Variable>,
}

/// The exits of a function, besides its end, that are used.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Ways {
    pub(crate) leaves: bool,
    pub(crate) fails: bool,
    pub(crate) aborts: bool,
}

/// Where the reference can continue: the code, the registers it needs, and the statement when jumps lead there, too.
pub(crate) struct Landing {
    pub(crate) block: ir::Block,
    pub(crate) live: Set,
    pub(crate) met: Option<usize>,
}

/// Checks that hold until the registers they are about change, or jumps meet.
#[derive(Clone, Debug, Default)]
pub(crate) struct Checked {
    /// Bytes of the opened data blocks that can be read, and written.
    pub(crate) db: [u32; 2],
    pub(crate) di: [u32; 2],
    /// First byte, length and writable length in the registers DB and DI, as memory has them.
    pub(crate) data: [[Option<Value>; 3]; 2],
    /// Their addresses.
    pub(crate) bases: [Option<Value>; 2],
    /// The instance's first byte.
    pub(crate) instance: Option<Value>,
    /// References to actual parameters.
    pub(crate) params: Vec<operand::Param>,
    /// What memory holds, and what is to be written there.
    pub(crate) cache: cache::Cache,
}

/// A block's statements with what is known of them.
pub(crate) struct Body<'a> {
    pub(crate) stmts: &'a [Stmt],
    pub(crate) ops: &'a [PlanOp],
    pub(crate) env: Env<'a>,
    pub(crate) live: Vec<Set>,
    pub(crate) marks: Vec<bool>,
    pub(crate) facts: Vec<Option<Facts>>,
    /// Code of the statements jumps lead to.
    pub(crate) starts: Vec<Option<ir::Block>>,
    /// Statements a jump leads back to: not every path to them is known when they are translated.
    pub(crate) loops: Vec<bool>,
    /// Places whose values are known on all paths that lead to a statement so far.
    pub(crate) meeting: Vec<Option<Vec<meeting::Met>>>,
    /// What the count lacks where jumps have met so far.
    pub(crate) uncounted: Vec<Option<u32>>,
    /// Registers that memory may lack where jumps meet.
    pub(crate) unsaved: Vec<Set>,
    /// Statements where compiled code can be entered from the reference.
    pub(crate) entries: Vec<bool>,
    /// Set when the block is inlined into its caller.
    pub(crate) inlined: Option<Inlined>,
    pub(crate) instance_bytes: u32,
}

/// What is known of an inlined block.
#[derive(Clone, Debug)]
pub(crate) struct Inlined {
    /// Where its local data begins in that of the function.
    pub(crate) local: u32,
    /// References to its actual parameters.
    pub(crate) refs: Vec<Reference>,
    /// Its instance in the arena: first byte.
    pub(crate) instance: Option<u32>,
}

impl<'a> Body<'a> {
    pub(crate) fn new(
        plan: &'a Plan,
        block: u32,
        entry: Facts,
        instance_bytes: u32,
        end: Set,
        inlined: Option<Inlined>,
    ) -> Self {
        let code = &plan.blocks[block as usize];
        let mcr = code.stmts.iter().any(|s| matches!(s.op, Op::McrActivate));
        let env = Env { plan, mcr, end, inlined: inlined.is_some() };
        let marks = flow::targets(&code.stmts);
        let loops = flow::loops(&code.stmts);
        let is_inlined = |pc: usize| match code.ops[pc] {
            PlanOp::Call { call } => inline::candidate(plan, &code.calls[call as usize]).is_some(),
            _ => false,
        };
        let calls = |pc: usize| matches!(code.stmts[pc].op, Op::Call(_)) && !is_inlined(pc);
        let unsaved = if inlined.is_some() { flow::ALL & !flow::NEST } else { 0 };
        Self {
            unsaved: crate::unsaved::unsaved(&code.stmts, unsaved, &marks, &env, &is_inlined),
            entries: entries(&marks, &loops, &calls),
            live: flow::liveness(&code.stmts, &env),
            facts: flow::facts(&code.stmts, entry, &marks, &env),
            starts: vec![None; code.stmts.len() + 1],
            loops,
            uncounted: vec![None; code.stmts.len() + 1],
            meeting: (0..=code.stmts.len()).map(|_| None).collect(),
            stmts: &code.stmts,
            ops: &code.ops,
            env,
            marks,
            inlined,
            instance_bytes,
        }
    }

    /// How many statements the variable lacks at statement `pc`, where jumps meet: as many as on the first path, which
    /// has nothing to add.
    pub(crate) fn uncounted(&mut self, pc: usize, first: u32) -> u32 {
        *self.uncounted[pc].get_or_insert(first)
    }

    /// The ends inside an inlined block meet at its end.
    pub(crate) fn ends_within(&mut self) {
        let end = self.stmts.len();
        let early = |(i, stmt): (usize, &Stmt)| matches!(stmt.op, Op::End | Op::EndIf) && i + 1 < end;
        if self.stmts.iter().enumerate().any(early) || self.stmts.last().is_some_and(|s| s.op == Op::EndIf) {
            self.marks[end] = true;
        }
        if self.marks[end] {
            self.facts[end] = None;
        }
    }
}

/// Statements between two entries from the reference, at least; those that jumps lead back to are always entries.
const BETWEEN: usize = 64;

/// Where compiled code can be entered from the reference. Each entry costs code, and is used only after a failed check.
fn entries(marks: &[bool], loops: &[bool], calls: &dyn Fn(usize) -> bool) -> Vec<bool> {
    let end = marks.len() - 1;
    let mut next = BETWEEN;
    let entry = |pc: usize| {
        let is = loops[pc] || pc >= next && pc < end && (marks[pc] || calls(pc));
        next = if is { pc + BETWEEN } else { next };
        is
    };
    (0..marks.len()).map(entry).collect()
}

/// Fills `func` with the code of block `block`.
pub(crate) fn translate(
    plan: &Plan,
    block: u32,
    func: &mut ir::Function,
    context: &mut cranelift_frontend::FunctionBuilderContext,
    target: cranelift_codegen::isa::TargetFrontendConfig,
    tier: Tier,
) -> Made {
    let arena_region = func.dfg.alias_regions.insert(AliasRegionData { user_id: 1, description: "arena".into() });
    let state_region = func.dfg.alias_regions.insert(AliasRegionData { user_id: 2, description: "state".into() });
    let mut b = Builder::new(FunctionBuilder::new(func, context));
    let vars = Vars::declare(&mut b);
    let helper = crate::signature::helper_signature(target.default_call_conv);
    let helper = b.import_signature(helper);
    let other = b.import_signature(crate::signature::block_signature(target.default_call_conv));
    let entry = b.create_block();
    b.append_block_params_for_function_params(entry);
    b.switch_to_block(entry);
    let run = b.block_params(entry)[0];
    let [leave, leave_counted, failed, abort] = [(); 4].map(|()| b.create_block());
    for cold in [leave, leave_counted, failed, abort] {
        b.set_cold_block(cold);
    }
    let facts = Facts { fc: Some(false), or: Some(false), ..Facts::NONE };
    // Nobody sees the registers of an organization block at its end.
    let end = if plan.blocks[block as usize].id.kind == BlockKind::Ob { 0 } else { flow::RESULTS };
    let body = Body::new(plan, block, facts, inline::instance_bytes(plan, block), end, None);
    let unknown = b.iconst(types::I64, 0);
    let mut t = Translation {
        b,
        plan,
        vars,
        run,
        hot: unknown,
        arena: unknown,
        local: unknown,
        refs: unknown,
        arena_region,
        state_region,
        now: State::memory(),
        checked: Checked::default(),
        body,
        block,
        landings: Vec::new(),
        resume: Vec::new(),
        leave,
        leave_counted,
        failed,
        abort,
        ways: Ways::default(),
        helper,
        other,
        wanted: flow::ALL,
        no_pointers: false,
        fast: tier == Tier::Fast,
        places: BTreeMap::new(),
    };
    t.enter();
    t.statements();
    t.ways_back();
    let mut resume = std::mem::take(&mut t.resume);
    resume.sort_unstable();
    t.b.seal_all_blocks();
    t.b.finish().finalize(target);
    Made { resume }
}

/// What a block reaches besides the memory of the CPU: its local data, and references to actual parameters. The local
/// data of inlined blocks lie after its own.
fn touches(plan: &Plan, block: u32) -> (bool, BTreeSet<u16>) {
    let code = &plan.blocks[block as usize];
    let (mut local, mut refs) = (false, BTreeSet::new());
    for stmt in &code.stmts {
        local |= matches!(stmt.op, Op::Call(_));
        stmt.op.places(&mut |place, _| match place {
            Place::Param { index, .. } => _ = refs.insert(index),
            Place::Fixed(Area::Local, _) | Place::Register(..) => local = true,
            Place::Memory(area, pointer) => local |= area == Area::Local || pointer.area == Area::Local,
            _ => {}
        });
    }
    (local, refs)
}

/// Most statements of a block that the reference runs as a whole when an actual parameter is a pointer. Pointers are
/// rare, and a check for each use takes much code; but a long block or a loop should not go to the reference for one of
/// them.
const WHOLE: usize = 2 * BETWEEN;

impl Translation<'_, '_> {
    /// The entry: pointers, and the registers that are needed.
    fn enter(&mut self) {
        use std::mem::offset_of;
        self.hot = self.load_pointer(self.run, offset_of!(Run, hot));
        self.arena = self.load_pointer(self.hot, offset_of!(ob1_cpu::engine::Hot, arena));
        let (local, refs) = touches(self.plan, self.block);
        if local {
            let local = self.load_state(types::I32, self.run, offset_of!(Run, regs) + offset_of!(Regs, local));
            let local = self.b.ins().uextend(types::I64, local);
            self.local = self.b.ins().iadd(self.arena, local);
        }
        let room = inlined::room(self);
        let plain = if refs.is_empty() { None } else { self.references(&refs) };
        let good = match (room, plain) {
            (Some(room), Some(plain)) => Some(self.b.ins().band(room, plain)),
            (room, plain) => room.or(plain),
        };
        if let Some(good) = good {
            self.leave_for_good_unless(good);
        }
        let executed = self.load_state(types::I32, self.hot, offset_of!(ob1_cpu::engine::Hot, pending));
        self.b.def_var(self.vars.executed, executed);
        self.now.stored &= !flow::COUNT;
        self.now.fc = Bit::Known(false);
        self.now.or = Bit::Known(false);
    }

    /// Where the references to actual parameters lie; and whether none is a pointer, if that is checked once.
    fn references(&mut self, used: &BTreeSet<u16>) -> Option<Value> {
        use std::mem::offset_of;
        let refs = self.load_pointer(self.hot, offset_of!(ob1_cpu::engine::Hot, refs));
        let first = self.load_state(types::I32, self.run, offset_of!(Run, regs) + offset_of!(Regs, refs));
        let first = self.b.ins().uextend(types::I64, first);
        let two = self.b.iconst(types::I64, 2);
        let first = self.b.ins().ishl(first, two);
        self.refs = self.b.ins().iadd(refs, first);
        if self.body.stmts.len() > WHOLE || self.body.loops.contains(&true) {
            return None;
        }
        self.no_pointers = true;
        let mut all = None;
        for index in used {
            let reference = self.load_state(types::I32, self.refs, usize::from(*index) * 4);
            all = Some(all.map_or(reference, |all| self.b.ins().bor(all, reference)));
        }
        let zero = self.word(0);
        all.map(|all| self.b.ins().icmp(IntCC::SignedGreaterThanOrEqual, all, zero))
    }

    /// Every statement of the body.
    pub(crate) fn statements(&mut self) {
        let mut reachable = true;
        for pc in 0..self.body.stmts.len() {
            if self.body.marks[pc] {
                reachable |= self.meet(pc, reachable);
            }
            if reachable {
                reachable = self.statement(pc);
            }
        }
        let end = self.body.stmts.len();
        if self.body.inlined.is_some() {
            // Every end has counted itself.
            if reachable {
                self.end();
            }
            if self.body.marks[end] {
                self.meet(end, false);
            }
            return;
        }
        if self.body.marks[end] {
            reachable |= self.meet(end, reachable);
        }
        if reachable {
            self.end();
        }
    }

    /// Jumps meet before statement `pc`; `falls`: the statement before it leads here too.
    fn meet(&mut self, pc: usize, falls: bool) -> bool {
        let start = self.start_of(pc);
        if falls {
            self.flush(pc);
            self.b.ins().jump(start, &[]);
        }
        self.b.switch_to_block(start);
        self.now = self.at_start(pc);
        self.checked = Checked::default();
        self.take_places(pc);
        true
    }

    /// What is known where jumps meet.
    fn at_start(&mut self, pc: usize) -> State {
        let facts = self.body.facts[pc].unwrap_or(Facts::NONE);
        let bit = |known: Option<bool>| known.map_or(Bit::Var, Bit::Known);
        let data = |known: Option<u16>| known.map_or(Data::Var, |n| self.known_data(n));
        State {
            fc: bit(facts.fc),
            or: bit(facts.or),
            db: data(facts.db),
            di: data(facts.di),
            stored: flow::ALL & !self.body.unsaved[pc],
            uncounted: self.body.uncounted(pc, pc as u32),
            ..State::variables()
        }
    }

    /// The code of statement `pc`, which jumps lead to. The reference can continue there, too.
    pub(crate) fn start_of(&mut self, pc: usize) -> ir::Block {
        if let Some(block) = self.body.starts[pc] {
            return block;
        }
        let block = self.b.create_block();
        self.body.starts[pc] = Some(block);
        if self.body.inlined.is_none() && self.body.entries[pc] {
            self.landing(pc, block);
        }
        block
    }

    /// One statement. False when nothing falls through to the next.
    fn statement(&mut self, pc: usize) -> bool {
        let body_stmts = self.body.stmts;
        let op = &body_stmts[pc].op;
        self.wanted = self.body.live[pc + 1];
        if self.body.inlined.is_none() {
            self.b.set_srcloc(ir::SourceLoc::new(pc as u32));
        }
        if !matches!(op, Op::Call(_)) {
            self.now.uncounted = self.now.uncounted.wrapping_add(1);
        }
        match self.body.env.how(op) {
            How::Call => {
                self.call(pc);
                true
            }
            How::Step => {
                if !self.started_timer(op) {
                    self.step(pc);
                }
                true
            }
            How::Plain | How::Checked => self.compiled(op, pc),
        }
    }

    fn compiled(&mut self, op: &Op, pc: usize) -> bool {
        // OS is sticky: a statement that may set it needs its value, although it does not use it.
        let grows = self.wanted & crate::unsaved::changes(op) & flow::OS;
        let uses = self.body.env.at_hand(op, self.wanted);
        if !matches!(op, Op::End) {
            self.need(uses | grows);
        }
        match op {
            Op::Jump(on, to) => return self.jump(*on, *to as usize, pc),
            Op::Loop(to) => self.count_down(*to as usize, pc),
            Op::JumpList { targets, otherwise } => {
                self.jump_list(targets, *otherwise, pc);
                return false;
            }
            Op::End => {
                // The end counts itself.
                self.now.uncounted = self.now.uncounted.wrapping_sub(1);
                self.end();
                return false;
            }
            Op::EndIf => self.end_if(),
            Op::Nop | Op::Build(_) => {}
            _ => {
                if !self.bit_statement(op, pc) && !self.word_statement(op, pc) && !self.timer_statement(op) {
                    self.accumulators(op);
                }
            }
        }
        true
    }

    /// Memory that only the CPU uses.
    pub(crate) fn state_flags(&self) -> MemFlagsData {
        MemFlagsData::trusted().with_alias_region(Some(self.state_region))
    }

    pub(crate) fn arena_flags(&self) -> MemFlagsData {
        MemFlagsData::new().with_notrap().with_alias_region(Some(self.arena_region))
    }

    fn load_pointer(&mut self, base: Value, offset: usize) -> Value {
        let flags = self.state_flags();
        self.b.ins().load(types::I64, flags, base, offset as i32)
    }

    pub(crate) fn load_state(&mut self, ty: ir::Type, base: Value, offset: usize) -> Value {
        let flags = self.state_flags();
        self.b.ins().load(ty, flags, base, offset as i32)
    }

    pub(crate) fn store_state(&mut self, value: Value, base: Value, offset: usize) {
        let flags = self.state_flags();
        self.b.ins().store(flags, value, base, offset as i32);
    }

    pub(crate) fn word(&mut self, value: u32) -> Value {
        self.b.iconst(types::I32, i64::from(value))
    }

    /// The place of a register in memory.
    pub(crate) const fn reg(offset: usize) -> usize {
        std::mem::offset_of!(Run, regs) + offset
    }
}
