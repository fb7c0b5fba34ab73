//! The bytes of one statement, and how a page hands back what it found.

use ob1_ir::Op;

use crate::statement::{Mc7Op, Statement};

/// What a page finds: the statement and its length; `None` where the bytes begin none.
pub(crate) type Found = Option<(Statement, usize)>;

/// Code from the first byte of a statement on. What lies beyond the end reads as 0; the caller checks the length found
/// against the bytes there are.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bytes<'c>(pub(crate) &'c [u8]);

impl Bytes<'_> {
    fn at(&self, index: usize) -> u8 {
        self.0.get(index).copied().unwrap_or(0)
    }

    pub(crate) fn first(&self) -> u8 {
        self.at(0)
    }

    pub(crate) fn second(&self) -> u8 {
        self.at(1)
    }

    /// The first two bytes.
    pub(crate) fn head(&self) -> u16 {
        self.word_at(0)
    }

    pub(crate) fn word_at(&self, index: usize) -> u16 {
        u16::from_be_bytes([self.at(index), self.at(index + 1)])
    }

    /// The word operand, behind the two bytes of the statement.
    pub(crate) fn word(&self) -> u16 {
        self.word_at(2)
    }

    /// The double word at an index.
    pub(crate) fn double_at(&self, index: usize) -> u32 {
        u32::from(self.word_at(index)) << 16 | u32::from(self.word_at(index + 2))
    }

    /// The double word operand.
    pub(crate) fn double(&self) -> u32 {
        self.double_at(2)
    }
}

/// A statement of two bytes.
pub(crate) fn short(op: Op) -> Found {
    Some((Statement { op: Mc7Op::Plain(op), long: false }, 2))
}

/// A long form of four bytes; `fits`: the short one would do.
pub(crate) fn long(op: Op, fits: bool) -> Found {
    Some((Statement { op: Mc7Op::Plain(op), long: fits }, 4))
}

/// A statement of four bytes.
pub(crate) fn four(op: Op) -> Found {
    long(op, false)
}

/// A statement of six bytes.
pub(crate) fn six(op: Op) -> Found {
    Some((Statement { op: Mc7Op::Plain(op), long: false }, 6))
}

/// A first and second byte with a word.
pub(crate) fn with_word(first: u8, second: u8, word: u16) -> Vec<u8> {
    let [high, low] = word.to_be_bytes();
    vec![first, second, high, low]
}

/// A first and second byte with a double word.
pub(crate) fn with_double(first: u8, second: u8, value: u32) -> Vec<u8> {
    let mut bytes = vec![first, second];
    bytes.extend_from_slice(&value.to_be_bytes());
    bytes
}
