//! What a program is compiled of.

use std::path::PathBuf;

use ob1_model::BlockId;

use crate::finding::Spot;
use crate::library::Choice;

/// What is compiled together, and how it is read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Sources {
    /// Source files, in the order in which they are compiled.
    pub files: Vec<PathBuf>,
    /// Symbol tables, by their files.
    pub symbols: Vec<PathBuf>,
    /// Blocks in machine code.
    pub mc7: Vec<PathBuf>,
    /// Mnemonics of the sources.
    pub mnemonics: Mnemonics,
    /// Standard blocks of libraries.
    pub library: Vec<Choice>,
    /// Look for the classic porting traps too.
    pub lints: bool,
    /// Numbers of blocks that have a name only, as the user fixes them.
    pub fixed: Vec<(String, BlockId)>,
    /// Where the numbers given to other such blocks are kept.
    pub numbers: Option<PathBuf>,
    /// Show every finding, not the first of each file and of all.
    pub all_messages: bool,
    /// For files that may be missing: the place that names each.
    pub places: Vec<(PathBuf, Spot)>,
}

/// The language of the mnemonics.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mnemonics {
    /// `U UN O ON E A Z`.
    German,
    /// `A AN O ON I Q C`.
    International,
    /// Found for each file by the words that exist in one set only.
    #[default]
    Auto,
}

impl From<Mnemonics> for ob1_stl::Mnemonics {
    fn from(mnemonics: Mnemonics) -> Self {
        match mnemonics {
            Mnemonics::German => Self::German,
            Mnemonics::International => Self::International,
            Mnemonics::Auto => Self::Auto,
        }
    }
}
