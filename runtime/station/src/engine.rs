//! Which engine runs the program: `[cpu] engine`, `ob1 exec --engine`.

use std::sync::Arc;

use ob1_arena::Arena;
use ob1_cpu::engine::{Both, Engine, Factory, PLAIN, Plan, REFERENCE};
use ob1_native::{AtLoad, Tier};

/// The engine asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EngineChoice {
    /// What the house takes: the reference engine, as long as a program would wait for its machine code at load.
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

    /// What makes the engine.
    #[must_use]
    pub fn factory(self) -> &'static dyn Factory {
        match self {
            EngineChoice::Auto | EngineChoice::Reference => REFERENCE,
            EngineChoice::Plain => PLAIN,
            EngineChoice::Native => &Compiled,
            EngineChoice::Both => &Both(&Compiled),
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_word_has_its_choice() {
        for (word, choice) in EngineChoice::WORDS {
            assert_eq!(EngineChoice::parse(word), Ok(choice));
        }
        assert_eq!(EngineChoice::parse("plain"), Ok(EngineChoice::Plain));
        assert!(EngineChoice::parse("Reference").is_err_and(|remedy| remedy.contains("reference")));
    }
}
