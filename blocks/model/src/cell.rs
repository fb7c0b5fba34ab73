//! A place in a CPU that the outside reads and writes, and how much of it.

use std::fmt;

use crate::{Area, DataType};

/// A place the outside can read and write.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Cell {
    /// Inputs, outputs or bit memory, by bit address; `Area::Input`, `Output`, `Memory`.
    Area(Area, u32),
    /// A data block and a bit address in it.
    Db(u16, u32),
    /// Peripheral byte, by bit address: read from the module's inputs, written to its outputs.
    Peripheral(u32),
    /// A timer's remaining time as S5TIME (read only).
    Timer(u16),
    /// A counter, 0 to 999.
    Counter(u16),
}

impl Cell {
    /// The kind of memory and the number of the data block: the same for cells that lie beside each other in memory.
    /// `None` for cells that are not plain memory.
    pub const fn block(self) -> Option<(u8, u16)> {
        match self {
            Cell::Area(Area::Input, _) => Some((0, 0)),
            Cell::Area(Area::Output, _) => Some((1, 0)),
            Cell::Area(Area::Memory, _) => Some((2, 0)),
            Cell::Db(number, _) => Some((3, number)),
            Cell::Area(..) | Cell::Peripheral(_) | Cell::Timer(_) | Cell::Counter(_) => None,
        }
    }

    /// Its bit address; 0 for a timer or counter.
    pub const fn bit(self) -> u32 {
        match self {
            Cell::Area(_, bit) | Cell::Db(_, bit) | Cell::Peripheral(bit) => bit,
            Cell::Timer(_) | Cell::Counter(_) => 0,
        }
    }

    /// Its byte address; 0 for a timer or counter.
    pub const fn byte(self) -> u32 {
        self.bit() / 8
    }

    /// The same area or block at another bit address; a timer or counter stays what it is.
    #[must_use]
    pub const fn at_bit(self, bit: u32) -> Self {
        match self {
            Cell::Area(area, _) => Cell::Area(area, bit),
            Cell::Db(number, _) => Cell::Db(number, bit),
            Cell::Peripheral(_) => Cell::Peripheral(bit),
            Cell::Timer(_) | Cell::Counter(_) => self,
        }
    }
}

/// How much of it: the width of an access.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[expect(missing_docs, reason = "the names say it")]
pub enum Width {
    Bit,
    Byte,
    Word,
    DWord,
}

impl Width {
    /// The width in bits, 1 to 32.
    pub const fn bits(self) -> u8 {
        match self {
            Width::Bit => 1,
            Width::Byte => 8,
            Width::Word => 16,
            Width::DWord => 32,
        }
    }

    /// Bytes that hold it; a bit lies in one byte.
    pub const fn bytes(self) -> u32 {
        self.bits().div_ceil(8) as u32
    }

    /// The width of so many bits: 1, 8, 16 or 32.
    pub const fn of_bits(bits: u32) -> Option<Width> {
        Some(match bits {
            1 => Width::Bit,
            8 => Width::Byte,
            16 => Width::Word,
            32 => Width::DWord,
            _ => return None,
        })
    }

    /// The width of a variable of an elementary type.
    pub fn of(ty: &DataType) -> Option<Width> {
        Width::of_bits(ty.elementary_bits()?)
    }
}

/// A piece of what the outside watches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Piece {
    /// Bytes of an area or a data block.
    Bytes {
        /// The cell whose byte is the first.
        at: Cell,
        /// How many bytes follow.
        len: u32,
    },
    /// A value that is not plain memory: a timer, a counter, a peripheral input.
    Value(Cell, Width),
}

impl Piece {
    /// Bytes it takes in a snapshot, big-endian.
    #[expect(clippy::len_without_is_empty, reason = "a piece is never empty")]
    pub const fn len(&self) -> u32 {
        match self {
            Piece::Bytes { len, .. } => *len,
            Piece::Value(_, width) => width.bytes(),
        }
    }
}

named! {
    /// Why a cell cannot be read or written.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum CellError {
        /// The address lies outside its area.
        Outside = "outside the area",
        /// The data block is not loaded.
        NoDb = "the data block is not loaded",
        /// The data block is write-protected, or the cell cannot be written.
        ReadOnly = "cannot be written",
        /// No such timer or counter.
        NoTimer = "no such timer or counter",
        /// No module answers there.
        NoModule = "no module answers there",
        /// No such diagnostic entry.
        NoEntry = "no such entry",
        /// A value that does not fit the cell.
        Value = "the value does not fit",
        /// In STOP peripheral outputs are disabled, unless somebody has enabled them.
        OutputsOff = "peripheral outputs are disabled in STOP: `ob1 debug`, `outputs on`",
    }
}

impl CellError {
    /// A number for a snapshot or a message, from 1.
    pub const fn code(self) -> u8 {
        self as u8 + 1
    }

    /// The error with that number.
    pub const fn from_code(code: u8) -> Option<Self> {
        match code {
            1..=8 => Some(Self::ALL[code as usize - 1]),
            _ => None,
        }
    }
}

impl fmt::Display for CellError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl std::error::Error for CellError {}
