//! The engine: compiled blocks, and the reference for what is not compiled.

use std::os::fd::BorrowedFd;
use std::sync::Arc;

use ob1_cpu::Abort;
use ob1_cpu::engine::{Context, Engine, Entry, Factory, Plan, Slow, Watched};

use crate::code::CodeMemory;
use crate::compile::{Compiler, Target};
use crate::file::{Contents, Order};
use crate::image::Image;
use crate::run::Code;
use crate::tier::Tier;

/// What the engine is called.
pub const NAME: &str = "native";
/// What it is called while its code is that of the fast tier.
pub const NAME_FAST: &str = "native, fast tier";
/// What it is called while only its hottest blocks are optimised.
pub const NAME_HOTTEST: &str = "native, hottest blocks";

/// Runs blocks as machine code.
pub struct Native {
    code: Code,
    refused: Vec<String>,
}

impl std::fmt::Debug for Native {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Native").field("blocks", &self.code.functions.len()).finish_non_exhaustive()
    }
}

impl Native {
    /// The engine of a plan and its image.
    ///
    /// # Errors
    /// The image is of another plan, or the system has no room for it.
    pub fn new(plan: &Arc<Plan>, image: &Image) -> Result<Self, String> {
        let (bytes, functions) = image.placed();
        if functions.len() != plan.blocks.len() {
            return Err("the code is of another program".into());
        }
        has_stack(plan)?;
        let memory = if bytes.is_empty() {
            None
        } else {
            Some(CodeMemory::of(&bytes).map_err(|error| format!("no memory for code: {error}"))?)
        };
        let optimised = functions.len() - image.unoptimised().len();
        Ok(Self { code: Code::new(plan, functions, memory, optimised), refused: Vec::new() })
    }

    /// The engine of a plan and a sealed code file ([`Image::file`]), which may come from anywhere: whatever is not
    /// made for this order is refused before any of it could run.
    ///
    /// # Errors
    /// What is wrong with the file, or the system has no room for it.
    pub fn of_file(plan: &Arc<Plan>, order: &Order, file: BorrowedFd<'_>) -> Result<Self, String> {
        has_stack(plan)?;
        let memory = CodeMemory::map(file).map_err(|error| format!("it cannot be mapped: {error}"))?;
        let statements: Vec<usize> = plan.blocks.iter().map(|block| block.stmts.len()).collect();
        let Contents { optimised, functions, refused } = crate::file::read(memory.bytes(), order, &statements)?;
        let named = |(block, why): (usize, String)| Some(format!("{}: {why}", plan.blocks.get(block)?.id));
        let refused = refused.into_iter().filter_map(named).collect();
        Ok(Self { code: Code::new(plan, functions, Some(memory), optimised), refused })
    }
}

impl Native {
    /// In one line: which code, for how many blocks.
    #[must_use]
    pub fn told(&self) -> String {
        let functions = &self.code.functions;
        let compiled = functions.iter().filter(|function| function.at.is_some()).count();
        let bytes = self.code.memory.as_ref().map_or(0, |memory| memory.bytes().len());
        let optimised = self.code.optimised;
        format!(
            "{}, {compiled} of {} blocks, {optimised} optimised, {} KiB",
            self.name(),
            functions.len(),
            bytes.div_ceil(1024)
        )
    }

    /// Blocks of the file whose code is not taken, each with the reason; the reference runs them.
    #[must_use]
    pub fn refused(&self) -> &[String] {
        &self.refused
    }

    /// How many of its blocks are optimised.
    #[must_use]
    pub fn optimised(&self) -> usize {
        self.code.optimised
    }

    /// Every block is optimised: no better code will come.
    #[must_use]
    pub fn is_optimised(&self) -> bool {
        self.code.optimised == self.code.functions.len()
    }
}

/// Checks that the stack calculated at load is enough for nested compiled blocks.
fn has_stack(plan: &Plan) -> Result<(), String> {
    if plan.stack_per_block < crate::STACK_PER_BLOCK {
        return Err("the stack for so many nested blocks would be too large for machine code".into());
    }
    Ok(())
}

/// A thread calls this after it was given code that another thread has mapped, before it executes any: it discards what
/// it has prefetched. The kernel has maintained the caches when the code was mapped.
pub fn synchronise() {
    #[cfg(target_arch = "aarch64")]
    // SAFETY: a barrier; it touches neither memory nor registers.
    unsafe {
        std::arch::asm!("isb", options(nostack, preserves_flags));
    }
}

impl Engine for Native {
    fn name(&self) -> &'static str {
        match self.code.optimised {
            _ if self.is_optimised() => NAME,
            0 => NAME_FAST,
            _ => NAME_HOTTEST,
        }
    }

    fn plan(&self) -> &Arc<Plan> {
        &self.code.plan
    }

    fn call(&self, block: u32, entry: &Entry, cx: &mut Context<'_>) -> Result<(), Abort> {
        let Some(code) = self.code.plan.blocks.get(block as usize) else { return Ok(()) };
        let (local_top, depth) = (cx.hot().local_top, cx.hot().depth);
        let mut regs = match cx.begin(code, entry) {
            Ok(regs) => regs,
            Err(fault) => return cx.no_room(block, fault),
        };
        self.code.run(block, None, &mut regs, cx)?;
        let hot = cx.hot();
        (hot.local_top, hot.depth) = (local_top, depth);
        Ok(())
    }

    fn watch(&self, watched: &Watched) {
        self.code.watch(watched);
    }

    fn watching(&self) -> Slow {
        Slow { weighs: true, contained: self.code.any_contains_watched() }
    }
}

/// Makes native engines: compiles at load, on the thread that loads.
#[derive(Clone, Copy, Debug, Default)]
pub struct AtLoad(pub Tier);

impl Factory for AtLoad {
    fn engine(&self, plan: &Arc<Plan>) -> Result<Box<dyn Engine>, String> {
        let compiler = Compiler::new(Target::Host, self.0).map_err(|error| error.to_string())?;
        Ok(Box::new(Native::new(plan, &compiler.image(plan))?))
    }

    fn stack_per_block(&self) -> usize {
        crate::STACK_PER_BLOCK
    }
}
