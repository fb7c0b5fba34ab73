//! The key `engine` in `[cpu]`.

/// The engine that is asked for: `engine` in `[cpu]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EngineChoice {
    /// The reference engine at once, and machine code as soon as a process of its own has made it.
    #[default]
    Auto,
    /// The one that compiles to machine code.
    Native,
    /// The one that defines what a statement means.
    Reference,
    /// The reference engine runs, and the native one is compared with it.
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
    /// The word is none of these: the words there are, in one sentence.
    pub fn parse(word: &str) -> Result<Self, String> {
        let mut words = Self::WORDS.into_iter().chain([("plain", EngineChoice::Plain)]);
        words
            .find(|(name, _)| *name == word)
            .map(|(_, choice)| choice)
            .ok_or_else(|| "one of auto, native, reference, both, plain".to_owned())
    }
}
