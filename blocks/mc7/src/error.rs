//! What can be wrong with the bytes of a block, each with its number, place and bytes.

use std::fmt;

use ob1_model::BlockId;

/// What can be wrong with machine code.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Problem {
    /// No statement begins with these bytes.
    UnknownStatement,
    /// The code ends within a statement or a list of pointers.
    CutOff,
    /// A jump that leads out of the code or into a statement.
    JumpTarget(i64),
    /// `SPL` whose number of `SPA`s does not follow it.
    JumpList(u16),
    /// A parameter that the interface does not have.
    Parameter(u16),
    /// The copies of `L P##parameter` find no room after the local data the code uses.
    LocalData,
    /// A count of the segment table leads beyond its bytes.
    SegmentTable,
    /// The compiled interface is cut off, nested too deep, larger than a data block, or has an unknown type.
    Interface(&'static str),
    /// The head of a block is invalid, or its lengths do not fit together.
    Head(&'static str),
    /// A statement of the instruction set for which the machine has no code.
    NoCode(String),
}

/// A problem with its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mc7Error {
    /// What is wrong there.
    pub problem: Problem,
    /// The block, where it is known.
    pub block: Option<BlockId>,
    /// The byte it is about; for [`Problem::NoCode`] the index of the statement.
    pub offset: usize,
    /// The bytes there, at most eight.
    pub bytes: Vec<u8>,
}

impl Mc7Error {
    /// A problem at an offset; `from` are the bytes from there on.
    pub(crate) fn at(problem: Problem, offset: usize, from: &[u8]) -> Self {
        Self { problem, block: None, offset, bytes: from.iter().copied().take(8).collect() }
    }

    /// The same, of a block.
    #[must_use]
    pub(crate) fn of(self, block: BlockId) -> Self {
        Self { block: Some(block), ..self }
    }

    /// The number of the message, as in `docs/mc7.md`.
    pub const fn code(&self) -> &'static str {
        match self.problem {
            Problem::UnknownStatement => "S1501",
            Problem::CutOff => "S1502",
            Problem::JumpTarget(_) => "S1503",
            Problem::JumpList(_) => "S1504",
            Problem::Parameter(_) => "S1505",
            Problem::LocalData => "S1506",
            Problem::SegmentTable => "S1507",
            Problem::Interface(_) => "S1508",
            Problem::Head(_) => "S1509",
            Problem::NoCode(_) => "S1510",
        }
    }
}

impl fmt::Display for Mc7Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", self.code())?;
        if let Some(block) = self.block {
            write!(f, "{block}, ")?;
        }
        if let Problem::NoCode(what) = &self.problem {
            return write!(f, "statement {}: the machine has no code for {what}", self.offset);
        }
        write!(f, "offset {}", self.offset)?;
        if !self.bytes.is_empty() {
            f.write_str(" (")?;
            for (at, byte) in self.bytes.iter().enumerate() {
                write!(f, "{}{byte:02X}", if at > 0 { " " } else { "" })?;
            }
            f.write_str(")")?;
        }
        f.write_str(": ")?;
        match &self.problem {
            Problem::UnknownStatement => f.write_str("no statement of MC7 begins with these bytes"),
            Problem::CutOff => f.write_str("the code ends within this statement"),
            Problem::JumpTarget(to) => write!(f, "the jump leads to {to}, where no statement begins"),
            Problem::JumpList(entries) => write!(f, "the {entries} SPA of this SPL do not follow it"),
            Problem::Parameter(index) => write!(f, "the block's interface has no parameter {}", index + 1),
            Problem::LocalData => f.write_str("the local data reaches beyond 65,535 bytes"),
            Problem::SegmentTable => f.write_str("the segment table is shorter than its counts say"),
            Problem::Interface(what) | Problem::Head(what) => f.write_str(what),
            Problem::NoCode(_) => Ok(()),
        }
    }
}

impl std::error::Error for Mc7Error {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_documentation_has_each_number() {
        let page = include_str!("../../../docs/mc7.md");
        let all = [
            Problem::UnknownStatement,
            Problem::CutOff,
            Problem::JumpTarget(0),
            Problem::JumpList(0),
            Problem::Parameter(0),
            Problem::LocalData,
            Problem::SegmentTable,
            Problem::Interface(""),
            Problem::Head(""),
            Problem::NoCode(String::new()),
        ];
        let numbers: Vec<&str> = all.map(|problem| Mc7Error::at(problem, 0, &[]).code()).into();
        let rows: Vec<&str> = page.lines().filter_map(|l| l.strip_prefix("| S15")?.get(..2)).collect();
        assert_eq!(numbers.iter().map(|n| &n[3..]).collect::<Vec<_>>(), rows);
    }
}
