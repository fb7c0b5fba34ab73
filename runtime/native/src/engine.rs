//! The engine: compiled blocks, and the reference for what is not compiled.

use std::sync::Arc;

use ob1_cpu::Abort;
use ob1_cpu::engine::{Caller, Context, Engine, Entry, Factory, Plan, Regs};

use crate::code::CodeMemory;
use crate::compile::{Compiled, Compiler, Image, Target, Tier};
use crate::run::{Run, interpret};

/// The code of a plan, in place.
pub(crate) struct Code {
    pub(crate) plan: Arc<Plan>,
    pub(crate) functions: Vec<Compiled>,
    memory: Option<CodeMemory>,
}

/// Runs blocks as machine code.
pub struct Native {
    code: Code,
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
    pub fn new(plan: &Arc<Plan>, image: Image) -> Result<Self, String> {
        if image.functions.len() != plan.blocks.len() {
            return Err("the code is of another program".into());
        }
        let memory = if image.bytes.is_empty() {
            None
        } else {
            Some(CodeMemory::of(&image.bytes).map_err(|error| format!("no memory for code: {error}"))?)
        };
        Ok(Self { code: Code { plan: Arc::clone(plan), functions: image.functions, memory } })
    }
}

impl Engine for Native {
    fn name(&self) -> &'static str {
        "native"
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
        self.code.run(block, &mut regs, cx)?;
        let hot = cx.hot();
        (hot.local_top, hot.depth) = (local_top, depth);
        Ok(())
    }
}

impl Code {
    /// Runs a block whose registers and local data are in place.
    pub(crate) fn run(&self, block: u32, r: &mut Regs, cx: &mut Context<'_>) -> Result<(), Abort> {
        let at = self.functions.get(block as usize).and_then(|compiled| compiled.at);
        let Some(address) = at.zip(self.memory.as_ref()).and_then(|(at, memory)| memory.at(at)) else {
            return interpret(self, block, 0, r, cx).map(|_| ());
        };
        let mut run = Run::new(*r, self, cx);
        // SAFETY: the address is that of a function that `Compiler` has made with this signature for this processor, in
        // memory that nobody can change. `run` outlives the call; its pointers are valid as long as `cx` is borrowed.
        let answer = unsafe {
            let entry: crate::run::Entry = std::mem::transmute(address);
            entry(&raw mut run)
        };
        *r = run.regs;
        if run.panicked {
            std::panic::resume_unwind(Box::new("a helper of compiled code has panicked"));
        }
        if answer == 0 { Ok(()) } else { Err(Abort) }
    }

    /// The statement, for those who ask.
    #[allow(dead_code)]
    pub(crate) fn site(&self, at: Caller) -> Option<ob1_model::Site> {
        self.plan.site(at)
    }
}

/// Makes native engines: compiles at load, on the thread that loads.
#[derive(Clone, Copy, Debug, Default)]
pub struct AtLoad(pub Tier);

impl Factory for AtLoad {
    fn engine(&self, plan: &Arc<Plan>) -> Result<Box<dyn Engine>, String> {
        let compiler = Compiler::new(Target::Host, self.0).map_err(|error| error.to_string())?;
        Ok(Box::new(Native::new(plan, compiler.image(plan))?))
    }

    fn stack_per_block(&self) -> usize {
        crate::STACK_PER_BLOCK
    }
}
