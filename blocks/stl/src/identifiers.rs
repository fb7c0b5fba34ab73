//! The words of operands, German and international side by side: identifiers, words before a block number, relations.
//!
//! Meaning and spelling: "Statement List (STL) for S7-300 and S7-400", Appendix A.

use ob1_ir::{AddressRegister, DbRegister, StatusBit, Width};
use ob1_model::{Area, BlockKind, named};

/// What an operand identifier names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Identifier {
    /// `M MB MW MD`, `DBX`, `PEW`, ...
    Memory(Area, Width),
    /// Width without area, for area-crossing register-indirect access: `B [AR1,P#0.0]`.
    Crossing(Width),
    Timer,
    Counter,
    /// `DB DI` as a block, `FC FB SFC SFB OB UDT`.
    Block(BlockWord),
    Status(StatusBit),
    StatusWord,
    DbLength(DbRegister),
    DbNumber(DbRegister),
    Register(AddressRegister),
}

named! {
    /// A word before a block number.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
    pub enum BlockWord {
        Ob = "OB",
        Fc = "FC",
        Fb = "FB",
        Sfc = "SFC",
        Sfb = "SFB",
        Db = "DB",
        Di = "DI",
        Udt = "UDT",
    }
}

#[rustfmt::skip]
pub(crate) static IDENTIFIERS: &[(&str, &str, Identifier)] = &{
    use Identifier::{Block, Counter, Crossing, DbLength, DbNumber, Memory, Register, Status, StatusWord, Timer};
    use Width::{Bit, Byte, DWord, Word};
    [
        ("E", "I", Memory(Area::Input, Bit)),
        ("EB", "IB", Memory(Area::Input, Byte)),
        ("EW", "IW", Memory(Area::Input, Word)),
        ("ED", "ID", Memory(Area::Input, DWord)),
        ("A", "Q", Memory(Area::Output, Bit)),
        ("AB", "QB", Memory(Area::Output, Byte)),
        ("AW", "QW", Memory(Area::Output, Word)),
        ("AD", "QD", Memory(Area::Output, DWord)),
        ("M", "M", Memory(Area::Memory, Bit)),
        ("MB", "MB", Memory(Area::Memory, Byte)),
        ("MW", "MW", Memory(Area::Memory, Word)),
        ("MD", "MD", Memory(Area::Memory, DWord)),
        ("L", "L", Memory(Area::Local, Bit)),
        ("LB", "LB", Memory(Area::Local, Byte)),
        ("LW", "LW", Memory(Area::Local, Word)),
        ("LD", "LD", Memory(Area::Local, DWord)),
        ("DBX", "DBX", Memory(Area::Db, Bit)),
        ("DBB", "DBB", Memory(Area::Db, Byte)),
        ("DBW", "DBW", Memory(Area::Db, Word)),
        ("DBD", "DBD", Memory(Area::Db, DWord)),
        ("DIX", "DIX", Memory(Area::Di, Bit)),
        ("DIB", "DIB", Memory(Area::Di, Byte)),
        ("DIW", "DIW", Memory(Area::Di, Word)),
        ("DID", "DID", Memory(Area::Di, DWord)),
        ("PEB", "PIB", Memory(Area::Peripheral, Byte)),
        ("PEW", "PIW", Memory(Area::Peripheral, Word)),
        ("PED", "PID", Memory(Area::Peripheral, DWord)),
        ("PAB", "PQB", Memory(Area::Peripheral, Byte)),
        ("PAW", "PQW", Memory(Area::Peripheral, Word)),
        ("PAD", "PQD", Memory(Area::Peripheral, DWord)),
        ("B", "B", Crossing(Byte)),
        ("W", "W", Crossing(Word)),
        ("D", "D", Crossing(DWord)),
        ("T", "T", Timer),
        ("Z", "C", Counter),
        ("OB", "OB", Block(BlockWord::Ob)),
        ("FC", "FC", Block(BlockWord::Fc)),
        ("FB", "FB", Block(BlockWord::Fb)),
        ("SFC", "SFC", Block(BlockWord::Sfc)),
        ("SFB", "SFB", Block(BlockWord::Sfb)),
        ("DB", "DB", Block(BlockWord::Db)),
        ("DI", "DI", Block(BlockWord::Di)),
        ("UDT", "UDT", Block(BlockWord::Udt)),
        ("BIE", "BR", Status(StatusBit::BinaryResult)),
        ("OV", "OV", Status(StatusBit::Overflow)),
        ("OS", "OS", Status(StatusBit::StoredOverflow)),
        ("UO", "UO", Status(StatusBit::Unordered)),
        ("STW", "STW", StatusWord),
        ("DBLG", "DBLG", DbLength(DbRegister::Db)),
        ("DILG", "DILG", DbLength(DbRegister::Di)),
        ("DBNO", "DBNO", DbNumber(DbRegister::Db)),
        ("DINO", "DINO", DbNumber(DbRegister::Di)),
        ("AR1", "AR1", Register(AddressRegister::Ar1)),
        ("AR2", "AR2", Register(AddressRegister::Ar2)),
    ]
};

impl BlockWord {
    /// The word of a block operand, `FC` in `FC 9`; these are the same in both sets.
    pub fn parse(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|known| known.name().eq_ignore_ascii_case(word))
    }

    /// The word of a kind of block. No source names system data.
    pub const fn of(kind: BlockKind) -> Self {
        match kind {
            BlockKind::Ob => BlockWord::Ob,
            BlockKind::Fc => BlockWord::Fc,
            BlockKind::Fb => BlockWord::Fb,
            BlockKind::Sfc => BlockWord::Sfc,
            BlockKind::Sfb => BlockWord::Sfb,
            BlockKind::Db | BlockKind::Sdb => BlockWord::Db,
        }
    }

    /// The block kind; none for UDTs, which are no blocks of the CPU. `DI 5` is data block 5.
    pub const fn kind(self) -> Option<BlockKind> {
        Some(match self {
            BlockWord::Ob => BlockKind::Ob,
            BlockWord::Fc => BlockKind::Fc,
            BlockWord::Fb => BlockKind::Fb,
            BlockWord::Sfc => BlockKind::Sfc,
            BlockWord::Sfb => BlockKind::Sfb,
            BlockWord::Db | BlockWord::Di => BlockKind::Db,
            BlockWord::Udt => return None,
        })
    }
}

/// The relations to zero that `U O X` scan: `U ==0`.
pub(crate) const RELATIONS: [(&str, StatusBit); 6] = [
    ("==", StatusBit::Zero),
    (">", StatusBit::Positive),
    ("<", StatusBit::Negative),
    ("<>", StatusBit::NotZero),
    (">=", StatusBit::NotNegative),
    ("<=", StatusBit::NotPositive),
];
