//! The mnemonics of sources, as commands take them.

use clap::ValueEnum;
use ob1_station_file::sources::Mnemonics;

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

impl Language {
    /// The set that is asked for, or else the program's own.
    pub fn or(self, own: ob1_stl::Mnemonics) -> ob1_stl::Mnemonics {
        self.wanted().unwrap_or(own)
    }

    /// The set that is asked for.
    pub const fn wanted(self) -> Option<ob1_stl::Mnemonics> {
        match self {
            Language::De => Some(ob1_stl::Mnemonics::German),
            Language::En => Some(ob1_stl::Mnemonics::International),
            Language::Auto => None,
        }
    }
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
