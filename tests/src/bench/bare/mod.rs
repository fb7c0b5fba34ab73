//! What the compiler is measured beside: the same statements as a bare translator built on Cranelift would make them.
//!
//! Each block is one function, each place of a jump a block of it. Accumulators and all status bits are variables of
//! the front end. They are read from a struct where the function begins and after each call, and written there before
//! each call and at the end. The translator knows which scan is the first of a chain. Operands, parameters and timers
//! lie as the CPU has them. That is all: no check of an operand, no safe point, no count of statements, no way to the
//! reference, no inlining. A compiler built on Cranelift takes at least this long for the program. The code is never
//! run.

mod accus;

use std::mem::offset_of;

use cranelift_codegen::control::ControlPlane;
use cranelift_codegen::ir::{
    self, AbiParam, Function, InstBuilder, MemFlagsData, Signature, Type, UserFuncName, Value, condcodes::IntCC, types,
};
use cranelift_codegen::isa::CallConv;
use cranelift_frontend::{FunctionBuilder, FunctionBuilderContext, Variable};
use ob1_cpu::engine::{Plan, Timer};
use ob1_ir::{BitTest, Jump, Logic, Number, Op, Place, StatusBit, Stmt};
use ob1_model::Area;

use ob1_native::Compiler;

/// Registers: the accumulators, and a byte for each bit of the status word but FC.
const REGISTERS: [Type; 10] = {
    let (word, bit) = (types::I32, types::I8);
    [word, word, bit, bit, bit, bit, bit, bit, bit, bit]
};
const A1: usize = 0;
const A2: usize = 1;
const RLO: usize = 2;
const OR: usize = 3;
const STA: usize = 4;
const CC1: usize = 5;
const CC0: usize = 6;
const OV: usize = 7;
const OS: usize = 8;
const BR: usize = 9;
/// Where the struct has pointers, after the registers: the arena, the local data, references to parameters, timers, a
/// helper.
const ARENA: i32 = 16;
const LOCAL: i32 = 24;
const REFERENCES: i32 = 32;
const TIMERS: i32 = 40;
const HELPER: i32 = 48;
/// Where it has the time.
const NOW: i32 = 56;

/// The place of a register in the struct.
const fn place_of(register: usize) -> i32 {
    (if register < RLO { register * 4 } else { register + 6 }) as i32
}

/// Compiles the statements of a plan bare, for the processor and with the settings of a compiler: bytes of machine
/// code.
pub(super) fn compile(compiler: &Compiler, plan: &Plan) -> Result<usize, String> {
    let isa = compiler.isa();
    let mut context = cranelift_codegen::Context::new();
    let mut frontend = FunctionBuilderContext::new();
    let mut bytes = 0;
    for (index, block) in plan.blocks.iter().enumerate() {
        context.clear();
        let signature = signature(isa.default_call_conv(), &[types::I64]);
        context.func = Function::with_name_signature(UserFuncName::user(0, index as u32), signature);
        bare(plan, &block.stmts, &mut context.func, &mut frontend, isa.frontend_config());
        let compiled =
            context.compile(isa, &mut ControlPlane::default()).map_err(|error| format!("{:?}", error.inner))?;
        bytes += compiled.buffer.data().len();
    }
    Ok(bytes)
}

/// Functions with these parameters: the struct, and of a helper two numbers. They give a number.
fn signature(convention: CallConv, parameters: &[Type]) -> Signature {
    let mut signature = Signature::new(convention);
    signature.params = parameters.iter().map(|ty| AbiParam::new(*ty)).collect();
    signature.returns = vec![AbiParam::new(types::I32)];
    signature
}

/// For each statement (and the end) whether a jump leads there.
fn targets(stmts: &[Stmt]) -> Vec<bool> {
    let mut marks = vec![false; stmts.len() + 1];
    for stmt in stmts {
        match &stmt.op {
            Op::Jump(_, to) | Op::Loop(to) => marks[*to as usize] = true,
            Op::JumpList { targets, otherwise } => {
                targets.iter().chain([otherwise]).for_each(|to| marks[*to as usize] = true);
            }
            _ => {}
        }
    }
    marks
}

/// The function of one block.
struct Bare<'a, 'f> {
    b: FunctionBuilder<'f>,
    plan: &'a Plan,
    run: Value,
    arena: Value,
    helper: ir::SigRef,
    vars: [Variable; REGISTERS.len()],
    /// RLO and OR before the open brackets, and what they do.
    brackets: Vec<(Value, Value, bool, Logic)>,
    /// The next scan begins a chain.
    first: bool,
    /// OR may be 1: a branch was opened.
    or: bool,
}

const FLAGS: MemFlagsData = MemFlagsData::trusted();

fn bare(
    plan: &Plan,
    stmts: &[Stmt],
    func: &mut Function,
    frontend: &mut FunctionBuilderContext,
    target: cranelift_codegen::isa::TargetFrontendConfig,
) {
    let mut b = FunctionBuilder::new(func, frontend);
    let helper = b.import_signature(signature(target.default_call_conv, &[types::I64, types::I32, types::I32]));
    let entry = b.create_block();
    b.append_block_params_for_function_params(entry);
    b.switch_to_block(entry);
    let run = b.block_params(entry)[0];
    let vars = REGISTERS.map(|ty| b.declare_var(ty));
    let arena = b.ins().load(types::I64, FLAGS, run, ARENA);
    let mut bare = Bare { b, plan, run, arena, helper, vars, brackets: Vec::new(), first: true, or: false };
    bare.fetch();
    let marks = targets(stmts);
    let starts: Vec<_> = marks.iter().map(|mark| mark.then(|| bare.b.create_block())).collect();
    let mut open = true;
    for (pc, stmt) in stmts.iter().enumerate() {
        if let Some(start) = starts[pc] {
            bare.start(start, open);
            open = true;
        }
        if open {
            open = bare.statement(&stmt.op, &starts);
        }
    }
    if let Some(end) = starts[stmts.len()] {
        bare.start(end, open);
        open = true;
    }
    if open {
        bare.end();
    }
    bare.b.seal_all_blocks();
    bare.b.finalize(target);
}

impl Bare<'_, '_> {
    fn start(&mut self, block: ir::Block, falls: bool) {
        if falls {
            self.b.ins().jump(block, &[]);
        }
        self.b.switch_to_block(block);
    }

    /// All registers from the struct.
    fn fetch(&mut self) {
        for (register, ty) in REGISTERS.into_iter().enumerate() {
            let value = self.b.ins().load(ty, FLAGS, self.run, place_of(register));
            self.b.def_var(self.vars[register], value);
        }
    }

    /// All registers into the struct.
    fn keep(&mut self) {
        for register in 0..REGISTERS.len() {
            let value = self.get(register);
            self.b.ins().store(FLAGS, value, self.run, place_of(register));
        }
    }

    fn end(&mut self) {
        self.keep();
        let done = self.word(0);
        self.b.ins().return_(&[done]);
    }

    fn get(&mut self, register: usize) -> Value {
        self.b.use_var(self.vars[register])
    }

    fn set(&mut self, register: usize, value: Value) {
        self.b.def_var(self.vars[register], value);
    }

    fn word(&mut self, value: u32) -> Value {
        self.b.ins().iconst(types::I32, i64::from(value))
    }

    fn byte(&mut self, value: i64) -> Value {
        self.b.ins().iconst(types::I8, value)
    }

    fn clear(&mut self, registers: &[usize]) {
        let zero = self.byte(0);
        for register in registers {
            self.set(*register, zero);
        }
    }

    /// The end of a chain of scans.
    fn end_chain(&mut self, sta: Value) {
        self.set(STA, sta);
        self.clear(&[OR]);
        (self.first, self.or) = (true, false);
    }

    fn result(&mut self, rlo: Value) {
        self.end_chain(rlo);
        self.set(RLO, rlo);
        self.first = false;
    }

    /// Address and offset of an operand, and the distance of its bit.
    fn spot(&mut self, at: &Place, bits: u32) -> (Value, i32, Value) {
        let bit = match *at {
            Place::Param { index, at } => {
                let refs = self.b.ins().load(types::I64, FLAGS, self.run, REFERENCES);
                let reference = self.b.ins().load(types::I32, FLAGS, refs, i32::from(index) * 4);
                let three = self.word(3);
                let byte = self.b.ins().ushr(reference, three);
                let byte = self.b.ins().uextend(types::I64, byte);
                return (self.b.ins().iadd(self.arena, byte), (at.0 / 8) as i32, reference);
            }
            Place::Fixed(_, at) | Place::InDb(_, at) | Place::InDi(_, at) | Place::Instance(at) => at.0,
            _ => 0,
        };
        let distance = self.byte(i64::from(bit % 8));
        let base = match at {
            Place::Fixed(Area::Local, _) => self.b.ins().load(types::I64, FLAGS, self.run, LOCAL),
            _ => self.arena,
        };
        let (areas, data) = (&self.plan.areas, &self.plan.data);
        let area = match *at {
            Place::Fixed(Area::Input, _) => Some(areas.inputs),
            Place::Fixed(Area::Output, _) => Some(areas.outputs),
            Place::Fixed(Area::Memory, _) => Some(areas.memory),
            _ => None,
        };
        let first = match *at {
            Place::InDb(n, _) | Place::InDi(n, _) => {
                data.iter().find(|db| db.number == n).map_or(0, |db| db.at.0 + bit / 8)
            }
            _ => area.and_then(|area| area.locate(bit / 8, bits.div_ceil(8))).map_or(bit / 8, |byte| byte.0),
        };
        (base, first as i32, distance)
    }

    /// Calls a helper and ignores its answer.
    fn call(&mut self, number: u32, with: Value) {
        let code = self.b.ins().load(types::I64, FLAGS, self.run, HELPER);
        let number = self.word(number);
        self.b.ins().call_indirect(self.helper, code, &[self.run, number, with]);
    }

    /// What others do with the registers: calls, and statements that are not worth compiling.
    fn others(&mut self, number: u32) {
        self.keep();
        let none = self.word(0);
        self.call(number, none);
        self.fetch();
    }

    fn load(&mut self, value: Value) {
        let a1 = self.get(A1);
        self.set(A2, a1);
        self.set(A1, value);
    }

    fn not(&mut self, bit: Value) -> Value {
        let one = self.byte(1);
        self.b.ins().bxor(bit, one)
    }

    fn test(&mut self, test: &BitTest) -> Value {
        match test {
            BitTest::Bit(at) => {
                let (base, offset, distance) = self.spot(at, 1);
                let byte = self.b.ins().load(types::I8, FLAGS, base, offset);
                let (moved, one) = (self.b.ins().ushr(byte, distance), self.byte(1));
                self.b.ins().band(moved, one)
            }
            BitTest::Timer(n) => self.timer(n),
            BitTest::Counter(_) => {
                let counters = self.b.ins().load(types::I64, FLAGS, self.run, TIMERS);
                let value = self.b.ins().load(types::I16, FLAGS, counters, 8);
                let zero = self.b.ins().iconst(types::I16, 0);
                self.b.ins().icmp(IntCC::NotEqual, value, zero)
            }
            BitTest::Status(bit) => self.condition(*bit),
        }
    }

    fn condition(&mut self, bit: StatusBit) -> Value {
        let (cc1, cc0) = (self.get(CC1), self.get(CC0));
        match bit {
            StatusBit::Overflow => self.get(OV),
            StatusBit::StoredOverflow => self.get(OS),
            StatusBit::BinaryResult => self.get(BR),
            StatusBit::Positive => self.b.ins().band_not(cc1, cc0),
            StatusBit::Negative => self.b.ins().band_not(cc0, cc1),
            StatusBit::NotZero => self.b.ins().bxor(cc1, cc0),
            StatusBit::NotNegative => self.not(cc0),
            StatusBit::NotPositive => self.not(cc1),
            StatusBit::Zero => {
                let any = self.b.ins().bor(cc1, cc0);
                self.not(any)
            }
            _ => self.b.ins().band(cc1, cc0),
        }
    }

    /// Where timers lie, and the first byte of this one.
    fn timer_at(&mut self, number: &Number) -> (Value, usize) {
        let timers = self.b.ins().load(types::I64, FLAGS, self.run, TIMERS);
        let n = if let Number::Fixed(n) = number { usize::from(*n) } else { 0 };
        (timers, n * size_of::<Timer>())
    }

    fn timer(&mut self, number: &Number) -> Value {
        let (timers, at) = self.timer_at(number);
        let byte = |t: &mut Self, field: usize| t.b.ins().load(types::I8, FLAGS, timers, (at + field) as i32);
        let running = byte(self, offset_of!(Timer, running));
        let latched = byte(self, offset_of!(Timer, latched));
        let kind = byte(self, offset_of!(Timer, kind));
        let end = self.b.ins().load(types::I64, FLAGS, timers, (at + offset_of!(Timer, end)) as i32);
        let now = self.b.ins().load(types::I64, FLAGS, self.run, NOW);
        let runs = self.b.ins().icmp(IntCC::UnsignedLessThan, now, end);
        let (one, two) = (self.byte(1), self.byte(2));
        let delay = self.b.ins().ushr(kind, one);
        let delay = self.b.ins().band(delay, one);
        let shown = self.b.ins().bxor(runs, delay);
        let shown = self.b.ins().band(running, shown);
        let no_pulse = self.b.ins().icmp(IntCC::UnsignedGreaterThanOrEqual, kind, two);
        let held = self.b.ins().band(latched, no_pulse);
        self.b.ins().bor(shown, held)
    }

    /// Starts a timer by a helper, at an edge.
    fn start_timer(&mut self, number: &Number) {
        let (timers, at) = self.timer_at(number);
        let (rlo, time) = (self.get(RLO), self.get(A1));
        let before = self.b.ins().load(types::I8, FLAGS, timers, (at + offset_of!(Timer, start_rlo)) as i32);
        let edge = self.b.ins().bxor(rlo, before);
        let (works, next) = (self.b.create_block(), self.b.create_block());
        self.b.ins().brif(edge, works, &[], next, &[]);
        self.b.switch_to_block(works);
        self.call(1, time);
        self.b.ins().jump(next, &[]);
        self.b.switch_to_block(next);
        self.clear(&[OR]);
        (self.first, self.or) = (true, false);
    }

    /// `=`, and with `set` `S` and `R`.
    fn put(&mut self, at: &Place, value: Value, set: Option<bool>) {
        let (base, offset, distance) = self.spot(at, 1);
        let byte = self.b.ins().load(types::I8, FLAGS, base, offset);
        let placed = self.b.ins().ishl(value, distance);
        let new = match set {
            Some(true) => self.b.ins().bor(byte, placed),
            Some(false) => self.b.ins().band_not(byte, placed),
            None => {
                let one = self.byte(1);
                let mask = self.b.ins().ishl(one, distance);
                let kept = self.b.ins().band_not(byte, mask);
                self.b.ins().bor(kept, placed)
            }
        };
        self.b.ins().store(FLAGS, new, base, offset);
    }

    fn scan(&mut self, logic: Logic, negate: bool, test: &BitTest) {
        let tested = self.test(test);
        let bit = if negate { self.not(tested) } else { tested };
        let rlo = self.get(RLO);
        let result = match (self.first, logic) {
            (true, _) => bit,
            (_, Logic::And) => self.b.ins().band(rlo, bit),
            (_, Logic::Or) => self.b.ins().bor(rlo, bit),
            (_, Logic::Xor) => self.b.ins().bxor(rlo, bit),
        };
        let result = if self.or && logic == Logic::And {
            let or = self.get(OR);
            self.b.ins().bor(result, or)
        } else {
            result
        };
        let or = self.or && logic == Logic::And;
        let before = self.get(OR);
        self.result(result);
        self.set(STA, tested);
        if or {
            self.set(OR, before);
            self.or = true;
        }
    }

    fn close(&mut self) {
        let rlo = self.get(RLO);
        let Some((before, or, negate, logic)) = self.brackets.pop() else { return };
        let inner = if negate { self.not(rlo) } else { rlo };
        let rlo = match logic {
            Logic::And => {
                let both = self.b.ins().band(before, inner);
                self.b.ins().bor(both, or)
            }
            Logic::Or => self.b.ins().bor(before, inner),
            Logic::Xor => self.b.ins().bxor(before, inner),
        };
        let one = self.byte(1);
        self.result(rlo);
        self.set(STA, one);
        self.set(OR, or);
    }

    /// False when nothing falls through.
    fn statement(&mut self, op: &Op, starts: &[Option<ir::Block>]) -> bool {
        match op {
            Op::Scan { logic, negate, test } => self.scan(*logic, *negate, test),
            Op::Open { logic, negate } => {
                let rlo = if self.first { self.byte(i64::from(*logic == Logic::And)) } else { self.get(RLO) };
                let (or, one) = (self.get(OR), self.byte(1));
                self.brackets.push((rlo, or, *negate, *logic));
                self.end_chain(one);
            }
            Op::Close => self.close(),
            Op::OrBranch => {
                let (rlo, one) = (self.get(RLO), self.byte(1));
                self.set(OR, rlo);
                self.set(STA, one);
                (self.first, self.or) = (true, true);
            }
            Op::Assign(at) | Op::Set(at) | Op::Reset(at) => {
                let rlo = self.get(RLO);
                let set = match op {
                    Op::Assign(_) => None,
                    op => Some(matches!(op, Op::Set(_))),
                };
                self.put(at, rlo, set);
                self.end_chain(rlo);
            }
            Op::EdgePositive(at) | Op::EdgeNegative(at) => {
                let (rlo, before) = (self.get(RLO), self.test(&BitTest::Bit(*at)));
                self.put(at, rlo, None);
                let rises = matches!(op, Op::EdgePositive(_));
                let edge = if rises { self.b.ins().band_not(rlo, before) } else { self.b.ins().band_not(before, rlo) };
                self.result(edge);
                self.set(STA, rlo);
            }
            Op::Load(operand) => {
                let bits = u32::from(operand.width.bits());
                let (base, offset, _) = self.spot(&operand.place, bits);
                let ty = Type::int(bits.max(8) as u16).unwrap_or(types::I32);
                let value = self.b.ins().load(ty, FLAGS, base, offset);
                let value = if bits > 8 { self.b.ins().bswap(value) } else { value };
                let value = if bits == 32 { value } else { self.b.ins().uextend(types::I32, value) };
                self.load(value);
            }
            Op::LoadConst(value) => {
                let value = self.word(*value);
                self.load(value);
            }
            Op::Transfer(operand) => {
                let bits = u32::from(operand.width.bits());
                let (base, offset, _) = self.spot(&operand.place, bits);
                let value = self.get(A1);
                let ty = Type::int(bits.max(8) as u16).unwrap_or(types::I32);
                let value = if bits == 32 { value } else { self.b.ins().ireduce(ty, value) };
                let value = if bits > 8 { self.b.ins().bswap(value) } else { value };
                self.b.ins().store(FLAGS, value, base, offset);
            }
            Op::Arithmetic(format, op) => self.arithmetic(*format, *op),
            Op::WordLogic(logic, with) => self.logic(*logic, with.map(u32::from), true),
            Op::DWordLogic(logic, with) => self.logic(*logic, *with, false),
            Op::Compare(format, compare) => self.compare(*format, *compare),
            Op::StartTimer(_, number) => self.start_timer(number),
            Op::Call(_) => {
                self.others(2);
                let one = self.byte(1);
                self.end_chain(one);
                self.clear(&[OS]);
            }
            Op::Jump(on, to) => return self.jump(*on, starts[*to as usize]),
            Op::End => {
                self.end();
                return false;
            }
            Op::Nop | Op::Build(_) => {}
            _ => self.others(3),
        }
        true
    }

    fn jump(&mut self, on: Jump, to: Option<ir::Block>) -> bool {
        let Some(to) = to else { return false };
        let (bit, when) = match on {
            Jump::Always => {
                self.b.ins().jump(to, &[]);
                return false;
            }
            Jump::IfRlo | Jump::IfRloSaveBr => (self.get(RLO), true),
            Jump::IfNotRlo | Jump::IfNotRloSaveBr => (self.get(RLO), false),
            Jump::IfBr => (self.get(BR), true),
            Jump::IfNotBr => (self.get(BR), false),
            Jump::IfOverflow => (self.get(OV), true),
            Jump::IfStoredOverflow => (self.get(OS), true),
            Jump::IfZero => (self.condition(StatusBit::Zero), true),
            Jump::IfNotZero => (self.condition(StatusBit::NotZero), true),
            Jump::IfPositive => (self.condition(StatusBit::Positive), true),
            Jump::IfNegative => (self.condition(StatusBit::Negative), true),
            Jump::IfNotNegative => (self.condition(StatusBit::NotNegative), true),
            Jump::IfNotPositive => (self.condition(StatusBit::NotPositive), true),
            Jump::IfUnordered => (self.condition(StatusBit::Unordered), true),
        };
        if matches!(on, Jump::IfRlo | Jump::IfNotRlo | Jump::IfRloSaveBr | Jump::IfNotRloSaveBr) {
            if matches!(on, Jump::IfRloSaveBr | Jump::IfNotRloSaveBr) {
                self.set(BR, bit);
            }
            let one = self.byte(1);
            self.set(RLO, one);
            self.end_chain(one);
        }
        let next = self.b.create_block();
        let (one, zero) = if when { (to, next) } else { (next, to) };
        self.b.ins().brif(bit, one, &[], zero, &[]);
        self.b.switch_to_block(next);
        true
    }
}
