//! A yardstick for the compiler: the same statements as bare functions of Cranelift.
//!
//! Each statement becomes what it does to memory, the accumulators and the RLO, and no more: no other status bit, no
//! check, no safe point, no count of statements, no way to the reference. Every block is a function, every place of a
//! jump a block of it; registers are variables of the front end. What that costs is the least that a compiler built on
//! Cranelift can take for the program. The code is never run.

use cranelift_codegen::control::ControlPlane;
use cranelift_codegen::ir::{self, Function, InstBuilder, MemFlagsData, UserFuncName, Value, condcodes::IntCC, types};
use cranelift_frontend::{FunctionBuilder, FunctionBuilderContext, Variable};
use ob1_cpu::engine::Plan;
use ob1_ir::{AccuOp, BitTest, Compare, Jump, Logic, Op, Place, Stmt, WordLogic};

use crate::compile::{CompileError, Compiler, block_signature, helper_signature};
use crate::{flow, place};

impl Compiler {
    /// Compiles the statements of a plan bare: bytes of machine code.
    ///
    /// # Errors
    /// Cranelift refuses a function.
    pub fn yardstick(&self, plan: &Plan) -> Result<usize, CompileError> {
        let mut context = cranelift_codegen::Context::new();
        let mut frontend = FunctionBuilderContext::new();
        let mut bytes = 0;
        for (index, block) in plan.blocks.iter().enumerate() {
            context.clear();
            let signature = block_signature(self.isa.default_call_conv());
            context.func = Function::with_name_signature(UserFuncName::user(0, index as u32), signature);
            bare(plan, &block.stmts, &mut context.func, &mut frontend, self.isa.frontend_config());
            let compiled = context
                .compile(&*self.isa, &mut ControlPlane::default())
                .map_err(|error| CompileError(format!("{:?}", error.inner)))?;
            bytes += compiled.buffer.data().len();
        }
        Ok(bytes)
    }
}

/// The function of one block.
struct Bare<'a, 'f> {
    b: FunctionBuilder<'f>,
    plan: &'a Plan,
    memory: Value,
    helper: ir::SigRef,
    a: [Variable; 2],
    rlo: Variable,
    /// RLO before the open brackets.
    brackets: Vec<Value>,
    /// The next scan begins a chain.
    first: bool,
}

fn bare(
    plan: &Plan,
    stmts: &[Stmt],
    func: &mut Function,
    frontend: &mut FunctionBuilderContext,
    target: cranelift_codegen::isa::TargetFrontendConfig,
) {
    let mut b = FunctionBuilder::new(func, frontend);
    let helper = b.import_signature(helper_signature(target.default_call_conv));
    let entry = b.create_block();
    b.append_block_params_for_function_params(entry);
    b.switch_to_block(entry);
    let memory = b.block_params(entry)[0];
    let a = [b.declare_var(types::I32), b.declare_var(types::I32)];
    let rlo = b.declare_var(types::I8);
    let mut bare = Bare { b, plan, memory, helper, a, rlo, brackets: Vec::new(), first: true };
    for var in a {
        let zero = bare.word(0);
        bare.b.def_var(var, zero);
    }
    let one = bare.byte(1);
    bare.b.def_var(rlo, one);
    let marks = flow::targets(stmts);
    let starts: Vec<_> = marks.iter().map(|mark| mark.then(|| bare.b.create_block())).collect();
    let mut open = true;
    for (pc, stmt) in stmts.iter().enumerate() {
        if let Some(start) = starts[pc] {
            if open {
                bare.b.ins().jump(start, &[]);
            }
            bare.b.switch_to_block(start);
            open = true;
        }
        if open {
            open = bare.statement(&stmt.op, &starts);
        }
    }
    if let Some(end) = starts[stmts.len()] {
        if open {
            bare.b.ins().jump(end, &[]);
        }
        bare.b.switch_to_block(end);
        open = true;
    }
    if open {
        let done = bare.word(0);
        bare.b.ins().return_(&[done]);
    }
    bare.b.seal_all_blocks();
    bare.b.finalize(target);
}

impl Bare<'_, '_> {
    fn word(&mut self, value: u32) -> Value {
        self.b.ins().iconst(types::I32, i64::from(value))
    }

    fn byte(&mut self, value: i64) -> Value {
        self.b.ins().iconst(types::I8, value)
    }

    /// Address and offset of an operand, and its bit.
    fn spot(&mut self, at: &Place, bits: u32) -> (Value, i32, u8) {
        let bit = match *at {
            Place::Fixed(_, at) | Place::InDb(_, at) | Place::InDi(_, at) | Place::Instance(at) => at.0,
            Place::Param { index, at } => {
                let flags = MemFlagsData::trusted();
                let first = self.b.ins().load(types::I64, flags, self.memory, i32::from(index) * 8);
                return (first, (at.0 / 8) as i32, (at.0 % 8) as u8);
            }
            _ => 0,
        };
        let first = match (*at, place::class(at, bits, self.plan)) {
            (Place::InDb(n, _) | Place::InDi(n, _), _) => place::data(self.plan, n).map_or(0, |db| db.at.0 + bit / 8),
            (_, place::Class::Fixed(Some(byte))) => byte,
            _ => bit / 8,
        };
        (self.memory, first as i32, (bit % 8) as u8)
    }

    fn call(&mut self, number: u32) -> Value {
        let flags = MemFlagsData::trusted();
        let code = self.b.ins().load(types::I64, flags, self.memory, 0);
        let (one, two) = (self.word(number), self.word(0));
        let call = self.b.ins().call_indirect(self.helper, code, &[self.memory, one, two]);
        self.b.inst_results(call)[0]
    }

    fn load(&mut self, value: Value) {
        let a1 = self.b.use_var(self.a[0]);
        self.b.def_var(self.a[1], a1);
        self.b.def_var(self.a[0], value);
    }

    fn test(&mut self, test: &BitTest) -> Value {
        let flags = MemFlagsData::new().with_notrap();
        match test {
            BitTest::Bit(at) => {
                let (base, offset, bit) = self.spot(at, 1);
                let byte = self.b.ins().load(types::I8, flags, base, offset);
                let (shift, one) = (self.byte(i64::from(bit)), self.byte(1));
                let moved = self.b.ins().ushr(byte, shift);
                self.b.ins().band(moved, one)
            }
            BitTest::Timer(_) | BitTest::Counter(_) => {
                let running = self.b.ins().load(types::I8, flags, self.memory, 8);
                let end = self.b.ins().load(types::I64, flags, self.memory, 16);
                let now = self.b.ins().load(types::I64, flags, self.memory, 24);
                let goes = self.b.ins().icmp(IntCC::UnsignedLessThan, now, end);
                self.b.ins().band(running, goes)
            }
            BitTest::Status(_) => self.b.use_var(self.rlo),
        }
    }

    fn put(&mut self, at: &Place, value: Value) {
        let flags = MemFlagsData::new().with_notrap();
        let (base, offset, bit) = self.spot(at, 1);
        let byte = self.b.ins().load(types::I8, flags, base, offset);
        let (rest, shift) = (self.byte(!(1i64 << bit) & 0xFF), self.byte(i64::from(bit)));
        let kept = self.b.ins().band(byte, rest);
        let placed = self.b.ins().ishl(value, shift);
        let new = self.b.ins().bor(kept, placed);
        self.b.ins().store(flags, new, base, offset);
    }

    /// False when nothing falls through.
    fn statement(&mut self, op: &Op, starts: &[Option<ir::Block>]) -> bool {
        let flags = MemFlagsData::new().with_notrap();
        let rlo = self.b.use_var(self.rlo);
        match op {
            Op::Scan { logic, negate, test } => {
                let mut bit = self.test(test);
                if *negate {
                    let one = self.byte(1);
                    bit = self.b.ins().bxor(bit, one);
                }
                let result = if self.first {
                    bit
                } else {
                    match logic {
                        Logic::And => self.b.ins().band(rlo, bit),
                        Logic::Or => self.b.ins().bor(rlo, bit),
                        Logic::Xor => self.b.ins().bxor(rlo, bit),
                    }
                };
                self.b.def_var(self.rlo, result);
            }
            Op::Open { .. } => self.brackets.push(rlo),
            Op::Close => {
                let before = self.brackets.pop().unwrap_or(rlo);
                let both = self.b.ins().band(before, rlo);
                self.b.def_var(self.rlo, both);
            }
            Op::Assign(at) | Op::Set(at) | Op::Reset(at) => self.put(at, rlo),
            Op::EdgePositive(at) | Op::EdgeNegative(at) => {
                let before = self.test(&BitTest::Bit(*at));
                self.put(at, rlo);
                let edge = self.b.ins().band_not(rlo, before);
                self.b.def_var(self.rlo, edge);
            }
            Op::Load(operand) => {
                let bits = place::bits(operand.width);
                let (base, offset, _) = self.spot(&operand.place, bits);
                let ty = if bits == 32 { types::I32 } else { types::I16 };
                let value = self.b.ins().load(ty, flags, base, offset);
                let value = self.b.ins().bswap(value);
                let value = if bits == 32 { value } else { self.b.ins().uextend(types::I32, value) };
                self.load(value);
            }
            Op::LoadConst(value) => {
                let value = self.word(*value);
                self.load(value);
            }
            Op::Transfer(operand) => {
                let bits = place::bits(operand.width);
                let (base, offset, _) = self.spot(&operand.place, bits);
                let value = self.b.use_var(self.a[0]);
                let value = if bits == 32 { value } else { self.b.ins().ireduce(types::I16, value) };
                let value = self.b.ins().bswap(value);
                self.b.ins().store(flags, value, base, offset);
            }
            Op::Arithmetic(_, AccuOp::Mul) => self.accus(|b, x, y| b.ins().imul(x, y)),
            Op::Arithmetic(_, AccuOp::Sub) => self.accus(|b, x, y| b.ins().isub(x, y)),
            Op::Arithmetic(..) => self.accus(|b, x, y| b.ins().iadd(x, y)),
            Op::WordLogic(logic, _) | Op::DWordLogic(logic, _) => match logic {
                WordLogic::And => self.accus(|b, x, y| b.ins().band(x, y)),
                WordLogic::Or => self.accus(|b, x, y| b.ins().bor(x, y)),
                WordLogic::Xor => self.accus(|b, x, y| b.ins().bxor(x, y)),
            },
            Op::Compare(_, compare) => {
                let (x, y) = (self.b.use_var(self.a[1]), self.b.use_var(self.a[0]));
                let how = if *compare == Compare::Equal { IntCC::Equal } else { IntCC::SignedGreaterThan };
                let result = self.b.ins().icmp(how, x, y);
                self.b.def_var(self.rlo, result);
            }
            Op::StartTimer(..) => {
                let before = self.b.ins().load(types::I8, flags, self.memory, 8);
                let edge = self.b.ins().bxor(rlo, before);
                let (works, next) = (self.b.create_block(), self.b.create_block());
                self.b.ins().brif(edge, works, &[], next, &[]);
                self.b.switch_to_block(works);
                self.call(1);
                self.b.ins().jump(next, &[]);
                self.b.switch_to_block(next);
            }
            Op::Call(_) => {
                self.call(2);
            }
            Op::Jump(Jump::Always, to) => {
                if let Some(start) = starts[*to as usize] {
                    self.b.ins().jump(start, &[]);
                }
                return false;
            }
            Op::Jump(_, to) | Op::Loop(to) => {
                let next = self.b.create_block();
                if let Some(start) = starts[*to as usize] {
                    self.b.ins().brif(rlo, next, &[], start, &[]);
                }
                self.b.switch_to_block(next);
            }
            Op::End => {
                let done = self.word(0);
                self.b.ins().return_(&[done]);
                return false;
            }
            _ => {}
        }
        self.first =
            !matches!(op, Op::Scan { .. } | Op::EdgePositive(_) | Op::EdgeNegative(_) | Op::Compare(..) | Op::Close);
        true
    }

    fn accus(&mut self, work: impl FnOnce(&mut FunctionBuilder<'_>, Value, Value) -> Value) {
        let (x, y) = (self.b.use_var(self.a[1]), self.b.use_var(self.a[0]));
        let result = work(&mut self.b, x, y);
        self.b.def_var(self.a[0], result);
    }
}
