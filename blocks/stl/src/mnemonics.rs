//! The mnemonics and operand identifiers, German and international side by side.
//!
//! Meaning and spelling: "Statement List (STL) for S7-300 and S7-400", Appendix A.

use ob1_ir::{
    AccuOp, AddressRegister, CallMode, Compare, Convert, DbRegister, Jump, Logic, MathFn, NumberFormat, Op, Shift,
    StatusBit, Width, WordLogic,
};
use ob1_model::{Area, BlockKind, TimerKind};

/// Which set of mnemonics a source is written in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Mnemonics {
    /// `U E 1.0`, `SPB`, `AUF DB`.
    #[default]
    German,
    /// `A I 1.0`, `JC`, `OPN DB`.
    International,
    /// Decided for each file by the words that exist in one set only.
    Auto,
}

/// What stands behind a mnemonic: the operation, and what kind of operand it takes.
#[derive(Clone, Debug)]
pub(crate) enum Shape {
    /// A bit, timer, counter or status bit; `O` also without operand.
    Scan(Logic, bool),
    /// An operation without operand.
    Plain(Op),
    /// `=`.
    Assign,
    /// `S`: bits and counters.
    Set,
    /// `R`: bits, timers and counters.
    Reset,
    /// `FP` (true) and `FN`.
    Edge(bool),
    Load,
    LoadBcd,
    Transfer,
    /// `UW OW XOW`: perhaps a constant.
    WordLogic(WordLogic),
    DWordLogic(WordLogic),
    /// Perhaps a constant count up to the number given.
    Shift(Shift, u8),
    /// `+`.
    AddConst,
    Increment,
    Decrement,
    LoadAr(AddressRegister),
    TransferAr(AddressRegister),
    AddAr(AddressRegister),
    /// `AUF`.
    OpenDb,
    /// `AUFDI` of TIA Portal: the data block into the DI register.
    OpenDi,
    StartTimer(TimerKind),
    /// `FR`: timers and counters.
    Enable,
    CountUp,
    CountDown,
    Jump(Jump),
    Loop,
    JumpList,
    Call(CallMode),
    /// `NOP n`, `BLD n`.
    Numbered,
}

/// A mnemonic.
#[derive(Debug)]
pub(crate) struct Row {
    pub(crate) german: &'static str,
    pub(crate) international: &'static str,
    pub(crate) shape: Shape,
}

impl Row {
    /// Its word in one set.
    fn word(&self, set: Mnemonics) -> &'static str {
        if set == Mnemonics::International { self.international } else { self.german }
    }
}

const fn both(word: &'static str, shape: Shape) -> Row {
    Row { german: word, international: word, shape }
}

const fn row(german: &'static str, international: &'static str, shape: Shape) -> Row {
    Row { german, international, shape }
}

const fn open(logic: Logic, negate: bool) -> Shape {
    Shape::Plain(Op::Open { logic, negate })
}

const fn convert(to: Convert) -> Shape {
    Shape::Plain(Op::Convert(to))
}

const fn math(function: MathFn) -> Shape {
    Shape::Plain(Op::Math(function))
}

const fn accu(format: NumberFormat, op: AccuOp) -> Shape {
    Shape::Plain(Op::Arithmetic(format, op))
}

const fn compare(format: NumberFormat, how: Compare) -> Shape {
    Shape::Plain(Op::Compare(format, how))
}

use NumberFormat::{DInt, Int, Real};

#[rustfmt::skip]
pub(crate) static ROWS: &[Row] = &[
    // Bit logic
    row("U", "A", Shape::Scan(Logic::And, false)),
    row("UN", "AN", Shape::Scan(Logic::And, true)),
    both("O", Shape::Scan(Logic::Or, false)),
    both("ON", Shape::Scan(Logic::Or, true)),
    both("X", Shape::Scan(Logic::Xor, false)),
    both("XN", Shape::Scan(Logic::Xor, true)),
    row("U(", "A(", open(Logic::And, false)),
    row("UN(", "AN(", open(Logic::And, true)),
    both("O(", open(Logic::Or, false)),
    both("ON(", open(Logic::Or, true)),
    both("X(", open(Logic::Xor, false)),
    both("XN(", open(Logic::Xor, true)),
    both(")", Shape::Plain(Op::Close)),
    both("=", Shape::Assign),
    both("S", Shape::Set),
    both("R", Shape::Reset),
    both("FP", Shape::Edge(true)),
    both("FN", Shape::Edge(false)),
    both("SET", Shape::Plain(Op::SetRlo)),
    both("CLR", Shape::Plain(Op::ClearRlo)),
    both("NOT", Shape::Plain(Op::NotRlo)),
    both("SAVE", Shape::Plain(Op::SaveRlo)),
    // Load and transfer
    both("L", Shape::Load),
    both("LC", Shape::LoadBcd),
    both("T", Shape::Transfer),
    // Arithmetic
    both("+I", accu(Int, AccuOp::Add)),
    both("-I", accu(Int, AccuOp::Sub)),
    both("*I", accu(Int, AccuOp::Mul)),
    both("/I", accu(Int, AccuOp::Div)),
    both("+D", accu(DInt, AccuOp::Add)),
    both("-D", accu(DInt, AccuOp::Sub)),
    both("*D", accu(DInt, AccuOp::Mul)),
    both("/D", accu(DInt, AccuOp::Div)),
    both("MOD", accu(DInt, AccuOp::Mod)),
    both("+R", accu(Real, AccuOp::Add)),
    both("-R", accu(Real, AccuOp::Sub)),
    both("*R", accu(Real, AccuOp::Mul)),
    both("/R", accu(Real, AccuOp::Div)),
    both("+", Shape::AddConst),
    both("INC", Shape::Increment),
    both("DEC", Shape::Decrement),
    // Comparison
    both("==I", compare(Int, Compare::Equal)),
    both("<>I", compare(Int, Compare::NotEqual)),
    both(">I", compare(Int, Compare::Greater)),
    both("<I", compare(Int, Compare::Less)),
    both(">=I", compare(Int, Compare::GreaterEqual)),
    both("<=I", compare(Int, Compare::LessEqual)),
    both("==D", compare(DInt, Compare::Equal)),
    both("<>D", compare(DInt, Compare::NotEqual)),
    both(">D", compare(DInt, Compare::Greater)),
    both("<D", compare(DInt, Compare::Less)),
    both(">=D", compare(DInt, Compare::GreaterEqual)),
    both("<=D", compare(DInt, Compare::LessEqual)),
    both("==R", compare(Real, Compare::Equal)),
    both("<>R", compare(Real, Compare::NotEqual)),
    both(">R", compare(Real, Compare::Greater)),
    both("<R", compare(Real, Compare::Less)),
    both(">=R", compare(Real, Compare::GreaterEqual)),
    both("<=R", compare(Real, Compare::LessEqual)),
    // Word logic, shift and rotate
    row("UW", "AW", Shape::WordLogic(WordLogic::And)),
    both("OW", Shape::WordLogic(WordLogic::Or)),
    both("XOW", Shape::WordLogic(WordLogic::Xor)),
    row("UD", "AD", Shape::DWordLogic(WordLogic::And)),
    both("OD", Shape::DWordLogic(WordLogic::Or)),
    both("XOD", Shape::DWordLogic(WordLogic::Xor)),
    both("SLW", Shape::Shift(Shift::LeftWord, 15)),
    both("SRW", Shape::Shift(Shift::RightWord, 15)),
    both("SSI", Shape::Shift(Shift::RightInt, 15)),
    both("SLD", Shape::Shift(Shift::LeftDWord, 32)),
    both("SRD", Shape::Shift(Shift::RightDWord, 32)),
    both("SSD", Shape::Shift(Shift::RightDInt, 32)),
    both("RLD", Shape::Shift(Shift::RotateLeft, 32)),
    both("RRD", Shape::Shift(Shift::RotateRight, 32)),
    both("RLDA", Shape::Plain(Op::RotateLeftCc1)),
    both("RRDA", Shape::Plain(Op::RotateRightCc1)),
    // Conversion
    both("BTI", convert(Convert::Bti)),
    both("ITB", convert(Convert::Itb)),
    both("BTD", convert(Convert::Btd)),
    both("DTB", convert(Convert::Dtb)),
    both("ITD", convert(Convert::Itd)),
    both("DTR", convert(Convert::Dtr)),
    both("RND", convert(Convert::Rnd)),
    both("RND+", convert(Convert::RndPlus)),
    both("RND-", convert(Convert::RndMinus)),
    both("TRUNC", convert(Convert::Trunc)),
    both("INVI", convert(Convert::Invi)),
    both("INVD", convert(Convert::Invd)),
    both("NEGI", convert(Convert::Negi)),
    both("NEGD", convert(Convert::Negd)),
    both("NEGR", convert(Convert::Negr)),
    both("ABS", convert(Convert::Abs)),
    row("TAW", "CAW", convert(Convert::Taw)),
    row("TAD", "CAD", convert(Convert::Tad)),
    // Floating-point functions
    both("SQR", math(MathFn::Sqr)),
    both("SQRT", math(MathFn::Sqrt)),
    both("LN", math(MathFn::Ln)),
    both("EXP", math(MathFn::Exp)),
    both("SIN", math(MathFn::Sin)),
    both("COS", math(MathFn::Cos)),
    both("TAN", math(MathFn::Tan)),
    both("ASIN", math(MathFn::Asin)),
    both("ACOS", math(MathFn::Acos)),
    both("ATAN", math(MathFn::Atan)),
    // Accumulators and address registers
    both("TAK", Shape::Plain(Op::ExchangeAccus)),
    both("PUSH", Shape::Plain(Op::Push)),
    both("POP", Shape::Plain(Op::Pop)),
    both("ENT", Shape::Plain(Op::Enter)),
    both("LEAVE", Shape::Plain(Op::Leave)),
    both("LAR1", Shape::LoadAr(AddressRegister::Ar1)),
    both("LAR2", Shape::LoadAr(AddressRegister::Ar2)),
    both("TAR1", Shape::TransferAr(AddressRegister::Ar1)),
    both("TAR2", Shape::TransferAr(AddressRegister::Ar2)),
    row("TAR", "CAR", Shape::Plain(Op::ExchangeArs)),
    both("+AR1", Shape::AddAr(AddressRegister::Ar1)),
    both("+AR2", Shape::AddAr(AddressRegister::Ar2)),
    // Data blocks
    row("AUF", "OPN", Shape::OpenDb),
    row("AUFDI", "OPNDI", Shape::OpenDi),
    row("TDB", "CDB", Shape::Plain(Op::ExchangeDbs)),
    // Timers and counters
    row("SI", "SP", Shape::StartTimer(TimerKind::Pulse)),
    row("SV", "SE", Shape::StartTimer(TimerKind::ExtendedPulse)),
    row("SE", "SD", Shape::StartTimer(TimerKind::OnDelay)),
    both("SS", Shape::StartTimer(TimerKind::RetentiveOnDelay)),
    row("SA", "SF", Shape::StartTimer(TimerKind::OffDelay)),
    both("FR", Shape::Enable),
    row("ZV", "CU", Shape::CountUp),
    row("ZR", "CD", Shape::CountDown),
    // Jumps
    row("SPA", "JU", Shape::Jump(Jump::Always)),
    row("SPB", "JC", Shape::Jump(Jump::IfRlo)),
    row("SPBN", "JCN", Shape::Jump(Jump::IfNotRlo)),
    row("SPBB", "JCB", Shape::Jump(Jump::IfRloSaveBr)),
    row("SPBNB", "JNB", Shape::Jump(Jump::IfNotRloSaveBr)),
    row("SPBI", "JBI", Shape::Jump(Jump::IfBr)),
    row("SPBIN", "JNBI", Shape::Jump(Jump::IfNotBr)),
    row("SPO", "JO", Shape::Jump(Jump::IfOverflow)),
    row("SPS", "JOS", Shape::Jump(Jump::IfStoredOverflow)),
    row("SPZ", "JZ", Shape::Jump(Jump::IfZero)),
    row("SPN", "JN", Shape::Jump(Jump::IfNotZero)),
    row("SPP", "JP", Shape::Jump(Jump::IfPositive)),
    row("SPM", "JM", Shape::Jump(Jump::IfNegative)),
    row("SPPZ", "JPZ", Shape::Jump(Jump::IfNotNegative)),
    row("SPMZ", "JMZ", Shape::Jump(Jump::IfNotPositive)),
    row("SPU", "JUO", Shape::Jump(Jump::IfUnordered)),
    both("LOOP", Shape::Loop),
    row("SPL", "JL", Shape::JumpList),
    // Blocks and program control
    both("CALL", Shape::Call(CallMode::Call)),
    both("UC", Shape::Call(CallMode::Unconditional)),
    both("CC", Shape::Call(CallMode::Conditional)),
    both("BE", Shape::Plain(Op::End)),
    row("BEA", "BEU", Shape::Plain(Op::End)),
    row("BEB", "BEC", Shape::Plain(Op::EndIf)),
    both("MCRA", Shape::Plain(Op::McrActivate)),
    both("MCRD", Shape::Plain(Op::McrDeactivate)),
    both("MCR(", Shape::Plain(Op::McrOpen)),
    both(")MCR", Shape::Plain(Op::McrClose)),
    both("BLD", Shape::Numbered),
    both("NOP", Shape::Numbered),
];

/// What an operand identifier names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Identifier {
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

/// A word before a block number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum BlockWord {
    Ob,
    Fc,
    Fb,
    Sfc,
    Sfb,
    Db,
    Di,
    Udt,
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
    pub(crate) fn parse(word: &str) -> Option<Self> {
        Some(match word.to_ascii_uppercase().as_str() {
            "OB" => BlockWord::Ob,
            "FC" => BlockWord::Fc,
            "FB" => BlockWord::Fb,
            "SFC" => BlockWord::Sfc,
            "SFB" => BlockWord::Sfb,
            "DB" => BlockWord::Db,
            "DI" => BlockWord::Di,
            "UDT" => BlockWord::Udt,
            _ => return None,
        })
    }

    /// The word of a kind of block.
    pub(crate) const fn of(kind: BlockKind) -> Option<Self> {
        Some(match kind {
            BlockKind::Ob => BlockWord::Ob,
            BlockKind::Fc => BlockWord::Fc,
            BlockKind::Fb => BlockWord::Fb,
            BlockKind::Sfc => BlockWord::Sfc,
            BlockKind::Sfb => BlockWord::Sfb,
            BlockKind::Db => BlockWord::Db,
        })
    }

    /// As written.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            BlockWord::Ob => "OB",
            BlockWord::Fc => "FC",
            BlockWord::Fb => "FB",
            BlockWord::Sfc => "SFC",
            BlockWord::Sfb => "SFB",
            BlockWord::Db => "DB",
            BlockWord::Di => "DI",
            BlockWord::Udt => "UDT",
        }
    }

    /// The block kind; none for UDTs, which are no blocks of the CPU. `DI 5` is data block 5.
    pub(crate) const fn kind(self) -> Option<BlockKind> {
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

/// A word of at most eight letters in capitals, as one number: words are looked up far more often than anything else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Packed(u64);

impl Packed {
    /// `None` for a word longer than any of ours, and for none.
    fn new(word: &str) -> Option<Self> {
        Self::joined(word, "")
    }

    /// Two parts as one word.
    fn joined(first: &str, second: &str) -> Option<Self> {
        let length = first.len() + second.len();
        if length > 8 || length == 0 {
            return None;
        }
        let all = first.bytes().chain(second.bytes());
        Some(Self(all.fold(0, |word, byte| word << 8 | u64::from(byte.to_ascii_uppercase()))))
    }

    /// Where the search for it begins in a table.
    const fn slot(self) -> usize {
        (self.0.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> (64 - Table::<()>::BITS)) as usize
    }
}

/// Words with what they mean.
#[derive(Debug)]
struct Table<T> {
    /// Two words that want one place lie side by side.
    slots: Vec<Option<(Packed, T)>>,
}

impl<T: Copy> Table<T> {
    fn new(words: impl Iterator<Item = (&'static str, T)>) -> Self {
        let mut slots = vec![None; 1 << Table::<()>::BITS];
        for (word, meaning) in words {
            let Some(packed) = Packed::new(word) else { continue };
            let place = (packed.slot()..slots.len())
                .chain(0..packed.slot())
                .find(|at| slots.get(*at).is_some_and(|slot: &Option<(Packed, T)>| slot.is_none_or(|s| s.0 == packed)));
            if let Some(slot) = place.and_then(|at| slots.get_mut(at)) {
                *slot = Some((packed, meaning));
            }
        }
        Self { slots }
    }

    fn get(&self, word: Packed) -> Option<T> {
        let mut at = word.slot();
        // There are far more places than words, so that an empty one ends the search.
        while let Some((known, meaning)) = self.slots.get(at)? {
            if *known == word {
                return Some(*meaning);
            }
            at = (at + 1) % self.slots.len();
        }
        None
    }
}

impl Table<()> {
    const BITS: u32 = 9;
}

/// The words of one set.
#[derive(Debug)]
pub(crate) struct Words {
    mnemonics: Table<&'static Row>,
    identifiers: Table<Identifier>,
    set: Mnemonics,
}

impl Words {
    pub(crate) fn new(set: Mnemonics) -> Self {
        let mnemonics = Table::new(ROWS.iter().map(|r| (r.word(set), r)));
        let identifiers = IDENTIFIERS.iter().map(|row| (identifier_word(row, set), row.2));
        Self { mnemonics, identifiers: Table::new(identifiers), set }
    }

    /// The mnemonics of one set with the identifiers of both, for addresses of symbol tables: an identifier that both
    /// sets have names the same in both.
    pub(crate) fn of_both() -> Self {
        let identifiers = Table::new(IDENTIFIERS.iter().flat_map(|(de, en, i)| [(*de, *i), (*en, *i)]));
        Self { identifiers, ..Self::new(Mnemonics::German) }
    }

    /// The mnemonic written `word`, whatever its case.
    pub(crate) fn mnemonic(&self, word: &str) -> Option<&'static Row> {
        self.mnemonics.get(Packed::new(word)?)
    }

    /// The mnemonic that two parts make together.
    pub(crate) fn mnemonic_of(&self, first: &str, second: &str) -> Option<&'static Row> {
        self.mnemonics.get(Packed::joined(first, second)?)
    }

    /// The operand identifier written `word`, whatever its case.
    pub(crate) fn identifier(&self, word: &str) -> Option<Identifier> {
        self.identifiers.get(Packed::new(word)?)
    }

    pub(crate) fn mnemonic_words(&self) -> impl Iterator<Item = &'static str> {
        let set = self.set;
        ROWS.iter().map(move |r| r.word(set))
    }

    pub(crate) fn identifier_words(&self) -> impl Iterator<Item = &'static str> {
        let set = self.set;
        IDENTIFIERS.iter().map(move |row| identifier_word(row, set))
    }

    /// True when `word` is a mnemonic or identifier of the other set only; the caller already knows it is not of this
    /// one.
    pub(crate) fn is_foreign(&self, word: &str) -> bool {
        let german = self.set != Mnemonics::International;
        let other =
            |de: &str, en: &str| if german { en.eq_ignore_ascii_case(word) } else { de.eq_ignore_ascii_case(word) };
        ROWS.iter().any(|r| other(r.german, r.international)) || IDENTIFIERS.iter().any(|(de, en, _)| other(de, en))
    }
}

/// The word of an identifier in one set.
fn identifier_word(row: &(&'static str, &'static str, Identifier), set: Mnemonics) -> &'static str {
    if set == Mnemonics::International { row.1 } else { row.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_word_of_a_set_is_there_once() {
        for set in [Mnemonics::German, Mnemonics::International] {
            let words = Words::new(set);
            for row in ROWS {
                let found = words.mnemonic(&row.word(set).to_lowercase());
                assert!(found.is_some_and(|found| std::ptr::eq(found, row)), "{}", row.word(set));
            }
            for row in IDENTIFIERS {
                assert_eq!(words.identifier(identifier_word(row, set)), Some(row.2), "{}", row.0);
            }
            assert!(words.mnemonic_words().chain(words.identifier_words()).all(|w| w.len() <= 8));
            assert!(words.mnemonic("").is_none() && words.mnemonic("RESETTING").is_none());
            assert!(words.mnemonic_of("x", "(").is_some() && words.mnemonic_of("RND", "*").is_none());
        }
    }

    /// What TIA Portal has beyond the reference.
    const OF_TIA: [(&str, &str); 1] = [("AUFDI", "OPNDI")];

    /// Appendix A of the reference, "STL Instructions Sorted According to the German Mnemonics": German, then
    /// international where it differs.
    const APPENDIX: &str = "+ = ) +AR1 +AR2 +D -D *D /D ==D <>D >D <D >=D <=D +I -I *I /I ==I <>I >I <I >=I <=I \
        +R -R *R /R ==R <>R >R <R >=R <=R ABS ACOS ASIN ATAN AUF:OPN BE BEA:BEU BEB:BEC BLD BTD BTI CALL CC CLR COS \
        DEC DTB DTR ENT EXP FN FP FR INC INVD INVI ITB ITD L LAR1 LAR2 LC LEAVE LN LOOP MCR( )MCR MCRA MCRD MOD \
        NEGD NEGI NEGR NOP NOT O O( OD ON ON( OW POP PUSH R RLD RLDA RND RND- RND+ RRD RRDA S SA:SF SAVE SE:SD SET \
        SI:SP SIN SLD SLW SPA:JU SPB:JC SPBB:JCB SPBI:JBI SPBIN:JNBI SPBN:JCN SPBNB:JNB SPL:JL SPM:JM SPMZ:JMZ \
        SPN:JN SPO:JO SPP:JP SPPZ:JPZ SPS:JOS SPU:JUO SPZ:JZ SQR SQRT SRD SRW SS SSD SSI SV:SE T TAD:CAD TAK TAN \
        TAR:CAR TAR1 TAR2 TAW:CAW TDB:CDB TRUNC U:A U(:A( UC UD:AD UN:AN UN(:AN( UW:AW X X( XN XN( XOD XOW ZR:CD ZV:CU";

    #[test]
    fn the_table_is_that_of_the_reference() {
        let mut expected: Vec<_> = APPENDIX.split_whitespace().map(|w| w.split_once(':').unwrap_or((w, w))).collect();
        let mut rows: Vec<_> = ROWS.iter().map(|r| (r.german, r.international)).collect();
        expected.extend(OF_TIA);
        expected.sort_unstable();
        rows.sort_unstable();
        assert_eq!(rows, expected);
    }

    #[test]
    fn se_differs() {
        let shape = |set| match Words::new(set).mnemonic("se").map(|r| &r.shape) {
            Some(Shape::StartTimer(kind)) => Some(*kind),
            _ => None,
        };
        assert_eq!(shape(Mnemonics::German), Some(TimerKind::OnDelay));
        assert_eq!(shape(Mnemonics::International), Some(TimerKind::ExtendedPulse));
    }

    #[test]
    fn words_of_the_other_set_are_known_as_such() {
        let words = Words::new(Mnemonics::German);
        assert!(words.mnemonic("JC").is_none() && words.is_foreign("jc"));
        assert!(words.mnemonic("SPB").is_some() && !words.is_foreign("FOO"));
    }
}
