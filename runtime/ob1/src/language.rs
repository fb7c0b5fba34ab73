//! The mnemonics of sources, as commands take them.

use clap::ValueEnum;
use ob1_station::sources::Mnemonics;

/// The mnemonics of sources.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Language {
    /// German: U, UN, O, E, A, Z
    De,
    /// International: A, AN, O, I, Q, C
    En,
    /// Found for each source by the words that exist in one set only
    Auto,
}

impl From<Language> for Mnemonics {
    fn from(language: Language) -> Self {
        match language {
            Language::De => Self::German,
            Language::En => Self::International,
            Language::Auto => Self::Auto,
        }
    }
}
