//! Block kinds and numbers.

use std::fmt;

named! {
    /// What a block is, named by the letters in front of its number.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
    #[repr(u8)]
    pub enum BlockKind {
        /// Organization block: called by the operating system.
        Ob = "OB",
        /// Function block: has an instance data block.
        Fb = "FB",
        /// Function: no memory of its own.
        Fc = "FC",
        /// System function block: an FB within the CPU.
        Sfb = "SFB",
        /// System function: an FC within the CPU.
        Sfc = "SFC",
        /// Data block: memory without statements.
        Db = "DB",
        /// System data block: parameters of a CPU and its modules. A station keeps those that come, and uses none.
        Sdb = "SDB",
    }
}

impl BlockKind {
    /// True for blocks that run on an instance data block.
    pub const fn has_instance(self) -> bool {
        matches!(self, BlockKind::Fb | BlockKind::Sfb)
    }

    /// True for functions, which find references to their parameters: a list of pointers follows their calls.
    pub const fn is_function(self) -> bool {
        matches!(self, BlockKind::Fc | BlockKind::Sfc)
    }

    /// True for blocks of the CPU itself, which no program has.
    pub const fn is_system(self) -> bool {
        matches!(self, BlockKind::Sfb | BlockKind::Sfc)
    }

    /// The kind of a repr value, as it comes over a plugin's table.
    pub fn from_repr(value: u8) -> Option<Self> {
        Self::ALL.get(usize::from(value)).copied()
    }
}

/// A block by kind and number: `FC 9`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct BlockId {
    /// Kind of the block.
    pub kind: BlockKind,
    /// The number, 0 to 65535 (data blocks from 1).
    pub number: u16,
}

impl BlockId {
    /// The block with this kind and number.
    pub const fn new(kind: BlockKind, number: u16) -> Self {
        Self { kind, number }
    }

    /// `FC 0`, `fb60`, `DB 10`, with or without blanks. `None`: it is no block that a program has or calls.
    pub fn parse(text: &str) -> Option<Self> {
        const KINDS: [BlockKind; 6] =
            [BlockKind::Ob, BlockKind::Fb, BlockKind::Fc, BlockKind::Sfb, BlockKind::Sfc, BlockKind::Db];
        let text = text.trim();
        let (word, number) = text.split_at(text.find(|c: char| c.is_ascii_digit())?);
        let kind = KINDS.into_iter().find(|kind| kind.name().eq_ignore_ascii_case(word.trim()))?;
        Some(Self::new(kind, number.parse().ok()?))
    }
}

/// True for the number of an organization block that an S7-300 or S7-400 has; the operating system calls no others.
/// ["Organization Blocks" of the system software reference]
pub const fn is_organization_block(number: u16) -> bool {
    matches!(
        number,
        1 | 10..=17 | 20..=23 | 30..=38 | 40..=47 | 55..=57 | 60..=65 | 70 | 72..=73 | 80..=88 | 90 | 100..=102 | 121..=122
    )
}

impl fmt::Display for BlockId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.kind.name(), self.number)
    }
}
