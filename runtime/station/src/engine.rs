//! Which engine runs the program: `[cpu] engine`, `ob1 exec --engine`.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use ob1_arena::Arena;
use ob1_cpu::engine::{Both, Engine, Factory, PLAIN, Plan, REFERENCE};
use ob1_native::{AtLoad, Tier};

/// The engine asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EngineChoice {
    /// The reference engine at once, and machine code as soon as a process beside has made it ([`crate::compiling`]).
    #[default]
    Auto,
    /// The one that compiles to machine code.
    Native,
    /// The one that defines what a statement means.
    Reference,
    /// The reference engine runs, the native one is held against it.
    Both,
    /// The reference engine without short forms; for comparisons.
    Plain,
}

impl EngineChoice {
    /// What a station file may say.
    pub const WORDS: [(&str, EngineChoice); 4] = [
        ("auto", EngineChoice::Auto),
        ("native", EngineChoice::Native),
        ("reference", EngineChoice::Reference),
        ("both", EngineChoice::Both),
    ];

    /// The choice of a word on a command line: that of a station file, or `plain`.
    ///
    /// # Errors
    /// Which words there are.
    pub fn parse(word: &str) -> Result<Self, String> {
        let mut words = Self::WORDS.into_iter().chain([("plain", EngineChoice::Plain)]);
        words
            .find(|(name, _)| *name == word)
            .map(|(_, choice)| choice)
            .ok_or_else(|| "one of auto, native, reference, both, plain".to_owned())
    }

    /// What makes the engine of a program that takes over while the CPU is in RUN: falling back to the reference engine
    /// would make it late.
    #[must_use]
    pub fn factory_in_run(self) -> &'static dyn Factory {
        if self == EngineChoice::Auto { &Quick } else { self.factory() }
    }

    /// What makes the engine the CPU begins with.
    #[must_use]
    pub fn factory(self) -> &'static dyn Factory {
        match self {
            EngineChoice::Auto => &Succeeded,
            EngineChoice::Reference => REFERENCE,
            EngineChoice::Plain => PLAIN,
            EngineChoice::Native => &Compiled,
            EngineChoice::Both => &Both(&Compiled),
        }
    }
}

/// Machine code that is made quickly, for a program that takes over from machine code in RUN.
struct Quick;

const QUICK: AtLoad = AtLoad(Tier::Fast);

impl Factory for Quick {
    fn engine(&self, plan: &Arc<Plan>) -> Result<Box<dyn Engine>, String> {
        QUICK.engine(plan)
    }

    fn arena(&self, bytes: usize) -> Arena {
        Succeeded.arena(bytes)
    }

    fn stack_per_block(&self) -> usize {
        QUICK.stack_per_block()
    }
}

/// Machine code, made when the program is loaded, on memory that covers every offset code can have.
struct Compiled;

const NATIVE: AtLoad = AtLoad(Tier::Optimised);

impl Factory for Compiled {
    fn engine(&self, plan: &Arc<Plan>) -> Result<Box<dyn Engine>, String> {
        NATIVE.engine(plan)
    }

    fn arena(&self, bytes: usize) -> Arena {
        // Without so much address space the code's own checks stand alone.
        ob1_rt::reserve(bytes).unwrap_or_else(|_| Arena::new(bytes))
    }

    fn stack_per_block(&self) -> usize {
        NATIVE.stack_per_block()
    }
}

/// The reference engine, with memory and stack for machine code that takes over later.
struct Succeeded;

impl Factory for Succeeded {
    fn engine(&self, plan: &Arc<Plan>) -> Result<Box<dyn Engine>, String> {
        REFERENCE.engine(plan)
    }

    fn arena(&self, bytes: usize) -> Arena {
        // A limit on locked memory counts reserved addresses. Where there is one, locking comes first: the checks of
        // compiled code do not need the reservation.
        if ob1_rt::may_lock_all() { Compiled.arena(bytes) } else { Arena::new(bytes) }
    }

    fn stack_per_block(&self) -> usize {
        NATIVE.stack_per_block()
    }

    fn stack_is_for_later(&self) -> bool {
        true
    }
}

/// The names of all engines, by which [`InUse`] tells them.
const NAMES: [&str; 5] = ["reference", "plain", "both", ob1_native::NAME_FAST, ob1_native::NAME];

/// Which engine runs, as other threads see it.
#[derive(Debug, Default)]
pub struct InUse(AtomicU8);

impl InUse {
    /// This one from now on.
    pub fn set(&self, name: &str) {
        let index = NAMES.iter().position(|known| *known == name).unwrap_or(0);
        self.0.store(index as u8, Ordering::Relaxed);
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        NAMES.get(usize::from(self.0.load(Ordering::Relaxed))).copied().unwrap_or(NAMES[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_engine_is_told_by_its_name() {
        let program = ob1_ir::Program::default();
        let in_use = InUse::default();
        assert_eq!(in_use.name(), "reference");
        let words = EngineChoice::WORDS.iter().map(|(word, _)| *word).chain(["plain"]);
        for choice in words.filter_map(|word| EngineChoice::parse(word).ok()) {
            let config = ob1_cpu::CpuConfig::default();
            let cpu = ob1_cpu::Cpu::new(config, &program, Vec::new(), Vec::new(), choice.factory()).expect("it loads");
            in_use.set(cpu.engine());
            assert_eq!(in_use.name(), cpu.engine());
        }
        in_use.set(ob1_native::NAME_FAST);
        assert_eq!(in_use.name(), ob1_native::NAME_FAST);
    }

    #[test]
    fn every_word_has_its_choice() {
        for (word, choice) in EngineChoice::WORDS {
            assert_eq!(EngineChoice::parse(word), Ok(choice));
        }
        assert_eq!(EngineChoice::parse("plain"), Ok(EngineChoice::Plain));
        assert!(EngineChoice::parse("Reference").is_err_and(|remedy| remedy.contains("reference")));
    }
}
