//! S7 data types.

/// A dimension of an ARRAY, bounds included.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Dimension {
    /// Lower bound, may be negative.
    pub low: i32,
    /// Upper bound, at least `low`.
    pub high: i32,
}

impl Dimension {
    /// Number of elements; 0 for bounds that are the wrong way round.
    pub const fn len(self) -> u32 {
        let len = self.high as i64 - self.low as i64 + 1;
        if len > 0 { len as u32 } else { 0 }
    }

    /// True for a dimension whose bounds are the wrong way round.
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }
}

/// A component of a STRUCT or UDT.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// Name of the component.
    pub name: String,
    /// Its S7 data type.
    pub ty: DataType,
    /// The initial value as laid-out bytes, when the source gives one.
    pub initial: Option<Vec<u8>>,
}

/// An S7 data type. UDTs are resolved to `Struct` by the front end.
#[derive(Clone, Debug, PartialEq)]
#[expect(missing_docs, reason = "the names are those of the STL reference")]
pub enum DataType {
    Bool,
    Byte,
    Char,
    Word,
    Int,
    DWord,
    DInt,
    Real,
    S5Time,
    Time,
    Date,
    TimeOfDay,
    DateAndTime,
    /// `STRING[n]`, n from 1 to 254: two length bytes, then n characters.
    String(u8),
    /// Bounds and element type.
    Array(Vec<Dimension>, Box<DataType>),
    Struct(Vec<Field>),
    Pointer,
    Any,
    BlockDb,
    BlockFb,
    BlockFc,
    BlockSdb,
    Timer,
    Counter,
    /// A number that may be written as a timer (`T2`) or as a WORD: `TIMER_NR` of SYNCHRON_RESET, which the manual
    /// declares as WORD and calls with `T2` [S0 L833].
    TimerOrWord,
}

impl DataType {
    /// Size in bits of an elementary type; `None` for composed and parameter types.
    pub const fn elementary_bits(&self) -> Option<u32> {
        Some(match self {
            DataType::Bool => 1,
            DataType::Byte | DataType::Char => 8,
            DataType::Word | DataType::Int | DataType::S5Time | DataType::Date => 16,
            DataType::DWord | DataType::DInt | DataType::Real | DataType::Time | DataType::TimeOfDay => 32,
            _ => return None,
        })
    }

    /// True for types of more than four bytes or of several components.
    pub const fn is_composed(&self) -> bool {
        self.elementary_bits().is_none() && !self.is_parameter_type()
    }

    /// True for types that name a timer, counter or block instead of a value in memory.
    pub const fn is_parameter_type(&self) -> bool {
        matches!(
            self,
            DataType::BlockDb
                | DataType::BlockFb
                | DataType::BlockFc
                | DataType::BlockSdb
                | DataType::Timer
                | DataType::Counter
                | DataType::TimerOrWord
        )
    }

    /// The types that a source writes as one word.
    pub const WORDS: &[Self] = &[
        Self::Bool,
        Self::Byte,
        Self::Char,
        Self::Word,
        Self::Int,
        Self::DWord,
        Self::DInt,
        Self::Real,
        Self::S5Time,
        Self::Time,
        Self::Date,
        Self::TimeOfDay,
        Self::DateAndTime,
        Self::Pointer,
        Self::Any,
        Self::BlockDb,
        Self::BlockFb,
        Self::BlockFc,
        Self::BlockSdb,
        Self::Timer,
        Self::Counter,
    ];

    /// The keyword of the source language.
    pub const fn name(&self) -> &'static str {
        match self {
            DataType::Bool => "BOOL",
            DataType::Byte => "BYTE",
            DataType::Char => "CHAR",
            DataType::Word => "WORD",
            DataType::Int => "INT",
            DataType::DWord => "DWORD",
            DataType::DInt => "DINT",
            DataType::Real => "REAL",
            DataType::S5Time => "S5TIME",
            DataType::Time => "TIME",
            DataType::Date => "DATE",
            DataType::TimeOfDay => "TIME_OF_DAY",
            DataType::DateAndTime => "DATE_AND_TIME",
            DataType::String(_) => "STRING",
            DataType::Array(..) => "ARRAY",
            DataType::Struct(_) => "STRUCT",
            DataType::Pointer => "POINTER",
            DataType::Any => "ANY",
            DataType::BlockDb => "BLOCK_DB",
            DataType::BlockFb => "BLOCK_FB",
            DataType::BlockFc => "BLOCK_FC",
            DataType::BlockSdb => "BLOCK_SDB",
            DataType::Timer => "TIMER",
            DataType::Counter => "COUNTER",
            DataType::TimerOrWord => "TIMER or WORD",
        }
    }
}
