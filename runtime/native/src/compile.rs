//! Blocks to machine code.

use std::fmt;

use cranelift_codegen::control::ControlPlane;
use cranelift_codegen::ir::{DebugTag, Function, UserFuncName};
use cranelift_codegen::isa::{self, OwnedTargetIsa};
use cranelift_codegen::settings::{self, Configurable};
use cranelift_frontend::FunctionBuilderContext;
use ob1_cpu::engine::Plan;

use crate::image::{BlockCode, Image, Made};
use crate::signature::block_signature;
use crate::tier::Tier;
use crate::translate::translate;

/// Why nothing is compiled.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CompileError(pub String);

impl fmt::Display for CompileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for CompileError {}

/// The processors code can be made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// The one this runs on.
    Host,
    /// x86-64, with the instructions that this processor has.
    X86_64,
    /// AArch64, with no more than its base instructions.
    Aarch64,
}

/// Compiles blocks for one processor.
pub struct Compiler {
    isa: OwnedTargetIsa,
    target: Target,
    tier: Tier,
}

/// What Cranelift needs to know; with `verify` it checks its input.
fn isa_of(target: Target, tier: Tier, verify: bool) -> Result<OwnedTargetIsa, CompileError> {
    let wrong = |error: &dyn fmt::Display| CompileError(error.to_string());
    let mut flags = settings::builder();
    let mut set = |name: &str, value: &str| flags.set(name, value).map_err(|error| wrong(&error));
    set("opt_level", if tier == Tier::Fast { "none" } else { "speed" })?;
    // With the single-pass allocator the code is half as long again, and the frames of large blocks are too large for
    // the stack.
    set("regalloc_algorithm", "backtracking")?;
    set("enable_verifier", if verify { "true" } else { "false" })?;
    set("is_pic", "true")?;
    set("unwind_info", "false")?;
    set("enable_probestack", "false")?;
    let triple = match target {
        Target::Host => target_lexicon::HOST,
        Target::X86_64 => target_lexicon::triple!("x86_64-unknown-linux-gnu"),
        Target::Aarch64 => target_lexicon::triple!("aarch64-unknown-linux-gnu"),
    };
    let mut builder = isa::lookup(triple).map_err(|error| wrong(&error))?;
    if target != Target::Aarch64 {
        for feature in host_features() {
            builder.enable(feature).map_err(|error| wrong(&error))?;
        }
    }
    builder.finish(settings::Flags::new(flags)).map_err(|error| wrong(&error))
}

impl fmt::Debug for Compiler {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Compiler").field("target", &self.isa.triple().to_string()).finish_non_exhaustive()
    }
}

impl Compiler {
    /// A compiler for this processor, in this tier.
    ///
    /// # Errors
    /// There is no code for it.
    pub fn new(target: Target, tier: Tier) -> Result<Self, CompileError> {
        Ok(Self { isa: isa_of(target, tier, cfg!(debug_assertions))?, target, tier })
    }

    /// Processor and settings, for who measures a translator beside this one.
    #[must_use]
    pub fn isa(&self) -> &dyn isa::TargetIsa {
        &*self.isa
    }

    /// The code of all blocks of a plan. A block that has none is run by the reference.
    #[must_use]
    pub fn image(&self, plan: &Plan) -> Image {
        let mut image = Image::empty(plan);
        self.compile(plan, 0..plan.blocks.len() as u32, &mut image);
        image
    }

    /// Compiles some blocks of a plan. Their code replaces what the image has of them; one that cannot be compiled
    /// keeps what it has.
    pub fn compile(&self, plan: &Plan, blocks: impl IntoIterator<Item = u32>, image: &mut Image) {
        let mut context = cranelift_codegen::Context::new();
        let mut frontend = FunctionBuilderContext::new();
        for block in blocks {
            let compiled = self.block(plan, block, &mut context, &mut frontend);
            image.put(block, self.tier, compiled.ok());
        }
    }

    fn block(
        &self,
        plan: &Plan,
        block: u32,
        context: &mut cranelift_codegen::Context,
        frontend: &mut FunctionBuilderContext,
    ) -> Result<BlockCode, CompileError> {
        let made = self.translated(plan, block, context, frontend);
        let compiled = context
            .compile(&*self.isa, &mut ControlPlane::default())
            .map_err(|error| CompileError(format!("{:?}", error.inner)))?;
        // There is no linker: code that needs relocations cannot be used.
        if !compiled.buffer.relocs().is_empty() {
            return Err(CompileError("the code needs what is not in it".into()));
        }
        let stack = frame(compiled);
        if stack > crate::FRAME {
            return Err(CompileError("the block's frame is too large for the stack that was reckoned with".into()));
        }
        Ok(BlockCode { code: compiled.buffer.data().into(), made, stack })
    }

    fn translated(
        &self,
        plan: &Plan,
        block: u32,
        context: &mut cranelift_codegen::Context,
        frontend: &mut FunctionBuilderContext,
    ) -> Made {
        context.clear();
        let convention = self.isa.default_call_conv();
        let signature = block_signature(convention);
        context.func = Function::with_name_signature(UserFuncName::user(0, block), signature);
        translate(plan, block, &mut context.func, frontend, self.isa.frontend_config(), self.tier)
    }

    /// What a block is compiled to, for a reader.
    ///
    /// # Errors
    /// It cannot be compiled.
    pub fn listing(&self, plan: &Plan, block: u32) -> Result<Listing, CompileError> {
        let mut context = cranelift_codegen::Context::new();
        let mut frontend = FunctionBuilderContext::new();
        self.translated(plan, block, &mut context, &mut frontend);
        let form = context.func.display().to_string();
        mark_statements(&mut context.func);
        context.set_disasm(true);
        // The verifier accepts marks at calls only.
        let isa = isa_of(self.target, self.tier, false)?;
        let compiled = context
            .compile(&*isa, &mut ControlPlane::default())
            .map_err(|error| CompileError(error.inner.to_string()))?;
        let mut statements = vec![StatementCode::default(); plan.blocks[block as usize].stmts.len()];
        for part in compiled.buffer.get_srclocs_sorted() {
            if let Some(statement) = statements.get_mut(part.loc.bits() as usize) {
                statement.bytes += part.end - part.start;
            }
        }
        let rest = by_statement(compiled.vcode.as_deref().unwrap_or_default(), &mut statements);
        let code = compiled.vcode.as_deref().unwrap_or_default();
        Ok(Listing {
            form,
            code: code.lines().filter(|line| marked(line).is_none()).flat_map(|line| [line, "\n"]).collect(),
            bytes: compiled.buffer.data().len(),
            stack: frame(compiled),
            statements,
            rest,
        })
    }
}

/// What a block is compiled to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Listing {
    /// Cranelift's intermediate form, as text.
    pub form: String,
    /// The machine code, as text.
    pub code: String,
    /// Bytes of machine code.
    pub bytes: usize,
    /// Bytes of stack it takes.
    pub stack: u32,
    /// The machine code of each statement; an inlined block counts as part of the call.
    pub statements: Vec<StatementCode>,
    /// Code of no statement: the beginning and the end of the function, and the ways to and from the reference.
    pub rest: Vec<String>,
}

/// The machine code of a statement. It need not be contiguous: rarely needed code is at the end of the block.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StatementCode {
    /// Bytes of machine code that it has.
    pub bytes: u32,
    /// It as text, in the order of the code, each stretch with the name of the part of the code it lies in.
    pub lines: Vec<String>,
}

/// Marks each instruction with its statement, so that the statement of its machine code is known.
fn mark_statements(func: &mut Function) {
    let mut marks = Vec::new();
    for block in func.layout.blocks() {
        for inst in func.layout.block_insts(block) {
            let place = func.srcloc(inst);
            if !place.is_default() {
                marks.push((inst, place.bits()));
            }
        }
    }
    for (inst, statement) in marks {
        func.debug_tags.set(inst, [DebugTag::User(statement)]);
    }
}

/// The statement a line of the code's text names, when it is a mark.
fn marked(line: &str) -> Option<u32> {
    let (_, mark) = line.trim_start().strip_prefix("; ^-- debug @ ")?.split_once("User(")?;
    mark.split_once(')')?.0.parse().ok()
}

/// Divides code among its statements. A line without a mark, such as a move of a register, belongs to the statement
/// whose mark comes next, or after the last mark of its part to that one. A part without marks belongs to no statement.
fn by_statement(code: &str, statements: &mut [StatementCode]) -> Vec<String> {
    let (mut rest, mut waiting) = (Vec::new(), Vec::new());
    let mut part = String::new();
    let mut last: Option<usize> = None;
    let mut named: Option<usize> = None;
    let mut give = |to: Option<usize>, part: &str, waiting: &mut Vec<String>, named: &mut Option<usize>| {
        let lines = match to.and_then(|statement| statements.get_mut(statement)) {
            Some(statement) => &mut statement.lines,
            None => &mut rest,
        };
        if !waiting.is_empty() && !part.is_empty() && (*named != to || lines.is_empty()) {
            lines.push(part.to_owned());
            *named = to;
        }
        lines.append(waiting);
    };
    for line in code.lines() {
        if let Some(statement) = marked(line) {
            last = Some(statement as usize);
            give(last, &part, &mut waiting, &mut named);
        } else if line.starts_with(char::is_whitespace) {
            waiting.push(line.to_owned());
        } else {
            give(last, &part, &mut waiting, &mut named);
            (last, named) = (None, None);
            line.clone_into(&mut part);
        }
    }
    give(last, &part, &mut waiting, &mut named);
    rest
}

/// Bytes of stack that compiled code takes.
fn frame(compiled: &cranelift_codegen::CompiledCode) -> u32 {
    compiled.buffer.frame_layout().map_or(0, |layout| layout.frame_to_fp_offset) + 64
}

#[cfg(target_arch = "x86_64")]
fn host_features() -> Vec<&'static str> {
    let mut list = Vec::new();
    macro_rules! feature {
        ($($name:tt $flag:literal),*) => {$(
            if std::arch::is_x86_feature_detected!($name) {
                list.push($flag);
            }
        )*};
    }
    feature!("sse3" "has_sse3", "ssse3" "has_ssse3", "sse4.1" "has_sse41", "sse4.2" "has_sse42", "popcnt" "has_popcnt");
    feature!("bmi1" "has_bmi1", "bmi2" "has_bmi2", "lzcnt" "has_lzcnt", "avx" "has_avx", "avx2" "has_avx2", "fma" "has_fma");
    list
}

#[cfg(not(target_arch = "x86_64"))]
fn host_features() -> Vec<&'static str> {
    Vec::new()
}
