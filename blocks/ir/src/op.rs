//! The operations, each one STL statement. Meaning: "Statement List (STL) for S7-300 and S7-400" reference.

use ob1_model::{BitAddr, TimerKind, named};

use crate::call::Call;
use crate::place::{AddressRegister, DbRegister, Number, Operand, Place};

/// Combination of a bit with the result of logic operation (RLO).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "the names say it")]
pub enum Logic {
    And,
    Or,
    Xor,
}

impl Logic {
    /// Every combination, each once.
    pub const ALL: [Self; 3] = [Self::And, Self::Or, Self::Xor];
}

named! {
    /// A condition of the status word, as an operand of `U O X`.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    #[expect(missing_docs, reason = "named as the reference names them")]
    pub enum StatusBit {
        Zero = "==0",
        Positive = ">0",
        Negative = "<0",
        NotZero = "<>0",
        NotNegative = ">=0",
        NotPositive = "<=0",
        Unordered = "UO",
        Overflow = "OV",
        StoredOverflow = "OS",
        BinaryResult = "BIE",
    }
}

/// What a bit statement scans.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BitTest {
    /// A bit in memory.
    Bit(Place),
    /// A timer's state, as a scan gives it.
    Timer(Number),
    /// A counter's state: 1 when its value is not 0.
    Counter(Number),
    /// A condition of the status word.
    Status(StatusBit),
}

named! {
    /// The number formats of arithmetic and comparison.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    #[expect(missing_docs, reason = "the letters of the reference: I, D, R")]
    pub enum NumberFormat {
        Int = "I",
        DInt = "D",
        Real = "R",
    }
}

named! {
    /// Comparison of ACCU2 with ACCU1.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    #[expect(missing_docs, reason = "the names say it")]
    pub enum Compare {
        Equal = "==",
        NotEqual = "<>",
        Greater = ">",
        Less = "<",
        GreaterEqual = ">=",
        LessEqual = "<=",
    }
}

named! {
    /// Arithmetic of ACCU2 with ACCU1.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    #[expect(missing_docs, reason = "the names say it")]
    pub enum AccuOp {
        Add = "+",
        Sub = "-",
        Mul = "*",
        Div = "/",
        /// `MOD`: the rest of a division, DINT only.
        Mod = "MOD",
    }
}

named! {
    /// Word logic, bit by bit, of words and double words, named by their German mnemonics without the width.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    #[expect(missing_docs, reason = "the names say it")]
    pub enum WordLogic {
        And = "U",
        Or = "O",
        Xor = "XO",
    }
}

named! {
    /// Shifts and rotates of ACCU1, named by their mnemonics.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    pub enum Shift {
        /// Left, word, zeros come in.
        LeftWord = "SLW",
        /// Right, word, zeros come in.
        RightWord = "SRW",
        /// Right with sign, integer.
        RightInt = "SSI",
        /// Left, double word, zeros come in.
        LeftDWord = "SLD",
        /// Right, double word, zeros come in.
        RightDWord = "SRD",
        /// Right with sign, double integer.
        RightDInt = "SSD",
        /// Left around, double word.
        RotateLeft = "RLD",
        /// Right around, double word.
        RotateRight = "RRD",
    }
}

named! {
    /// Conversions of the value in ACCU1, named by their German mnemonics.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    #[expect(missing_docs, reason = "mnemonics of the reference")]
    pub enum Convert {
        Bti = "BTI",
        Itb = "ITB",
        Btd = "BTD",
        Dtb = "DTB",
        Itd = "ITD",
        Dtr = "DTR",
        Rnd = "RND",
        RndPlus = "RND+",
        RndMinus = "RND-",
        Trunc = "TRUNC",
        Invi = "INVI",
        Invd = "INVD",
        Negi = "NEGI",
        Negd = "NEGD",
        Negr = "NEGR",
        Abs = "ABS",
        /// Swap the two bytes of ACCU1-L.
        Taw = "TAW",
        /// Reverse the four bytes of ACCU1.
        Tad = "TAD",
    }
}

named! {
    /// Floating-point functions of ACCU1. The mnemonics are the same in both sets, and the names of the boxes.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    #[expect(missing_docs, reason = "mnemonics of the reference")]
    pub enum MathFn {
        Sqr = "SQR",
        Sqrt = "SQRT",
        Ln = "LN",
        Exp = "EXP",
        Sin = "SIN",
        Cos = "COS",
        Tan = "TAN",
        Asin = "ASIN",
        Acos = "ACOS",
        Atan = "ATAN",
    }
}

named! {
    /// Jump conditions, named by their German mnemonics.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    pub enum Jump {
        /// Always, whatever the RLO is.
        Always = "SPA",
        /// RLO = 1.
        IfRlo = "SPB",
        /// RLO = 0.
        IfNotRlo = "SPBN",
        /// RLO = 1, and RLO into BR.
        IfRloSaveBr = "SPBB",
        /// RLO = 0, and RLO into BR.
        IfNotRloSaveBr = "SPBNB",
        /// BR = 1.
        IfBr = "SPBI",
        /// BR = 0.
        IfNotBr = "SPBIN",
        /// OV = 1.
        IfOverflow = "SPO",
        /// OS = 1, and OS := 0.
        IfStoredOverflow = "SPS",
        /// Result = 0.
        IfZero = "SPZ",
        /// Result <> 0.
        IfNotZero = "SPN",
        /// Result > 0.
        IfPositive = "SPP",
        /// Result < 0.
        IfNegative = "SPM",
        /// Result >= 0.
        IfNotNegative = "SPPZ",
        /// Result <= 0.
        IfNotPositive = "SPMZ",
        /// Unordered, overflow in a division.
        IfUnordered = "SPU",
    }
}

impl Op {
    /// The numbers of [`Op::Build`].
    pub const BUILDS: std::ops::RangeInclusive<u8> = 100..=103;

    /// `BLD n`: a mark of a graphical network, or no operation.
    pub fn build(number: u8) -> Self {
        if Self::BUILDS.contains(&number) { Op::Build(number) } else { Op::Nop }
    }
}

/// One statement's operation. Jump targets are statement indices in the same block.
#[derive(Clone, Debug, PartialEq, Hash)]
pub enum Op {
    /// `U UN O ON X XN operand`.
    Scan {
        /// And, or, exclusive or.
        logic: Logic,
        /// The scan is for 0: `UN`, `ON`, `XN`.
        negate: bool,
        /// The bit, timer, counter or condition that is scanned.
        test: BitTest,
    },
    /// `U( UN( O( ON( X( XN(`.
    Open {
        /// How the bracket's result will be combined.
        logic: Logic,
        /// The bracket's result is negated: `UN(`, `ON(`, `XN(`.
        negate: bool,
    },
    /// `)`: ends the bracket opened last.
    Close,
    /// `O` without operand: and before or.
    OrBranch,
    /// `=`: the bit gets the RLO.
    Assign(Place),
    /// `S`: with RLO 1 the bit becomes 1.
    Set(Place),
    /// `R`: with RLO 1 the bit becomes 0.
    Reset(Place),
    /// `FP` with its edge memory bit.
    EdgePositive(Place),
    /// `FN` with its edge memory bit.
    EdgeNegative(Place),
    /// `SET`: the RLO becomes 1.
    SetRlo,
    /// `CLR`: the RLO becomes 0.
    ClearRlo,
    /// `NOT`: the RLO becomes its opposite.
    NotRlo,
    /// `SAVE`: the RLO goes into BR.
    SaveRlo,

    /// `L operand`: into ACCU1, the old ACCU1 into ACCU2.
    Load(Operand),
    /// `L constant`: the 32 bits loaded into ACCU1.
    LoadConst(u32),
    /// `L P##name` of a function's parameter: the pointer to its actual into ACCU1. With `at` the actual is a composed
    /// one: its POINTER (6 bytes) is put there in the local data, and the pointer to it loaded.
    LoadParamPointer {
        /// Index among the block's formals.
        index: u16,
        /// Where in the local data the POINTER goes.
        at: Option<BitAddr>,
    },
    /// `L P##name` of a function's parameter of the type POINTER (6 bytes) or ANY (10): the actual is copied into the
    /// local data, since the caller's bytes may have no address here, and the pointer to the copy loaded.
    LoadParamCopy {
        /// Index among the block's formals.
        index: u16,
        /// Bytes of the actual.
        bytes: u8,
        /// Where in the local data the copy goes.
        at: BitAddr,
    },
    /// `T operand`: ACCU1 into memory, by its width.
    Transfer(Operand),
    /// `L STW`: the status word into ACCU1.
    LoadStatus,
    /// `T STW`: ACCU1 into the status word.
    TransferStatus,
    /// `L T n`: the time as integer in units of its base.
    LoadTimer(Number),
    /// `LC T n`: as BCD with its base.
    LoadTimerBcd(Number),
    /// `L Z n`: the count as integer.
    LoadCounter(Number),
    /// `LC Z n`: the count as BCD.
    LoadCounterBcd(Number),
    /// `L DBLG`, `L DILG`.
    LoadDbLength(DbRegister),
    /// `L DBNO`, `L DINO`.
    LoadDbNumber(DbRegister),

    /// `+I -I *I /I +D .. +R .. MOD`.
    Arithmetic(NumberFormat, AccuOp),
    /// `+ constant`: to ACCU1 as INT (word constant) or DINT (`L#`); no flags.
    AddConst {
        /// Width of the addition: Int or DInt.
        format: NumberFormat,
        /// The constant that is added.
        value: i32,
    },
    /// `==I <>D >=R ...`.
    Compare(NumberFormat, Compare),
    /// `UW OW XOW`; the constant form combines with ACCU1 instead of ACCU2.
    WordLogic(WordLogic, Option<u16>),
    /// `UD OD XOD`: the same with double words.
    DWordLogic(WordLogic, Option<u32>),
    /// Shift or rotate by a constant or, without one, by ACCU2-L-L.
    Shift(Shift, Option<u8>),
    /// `RLDA`: rotate left through CC1 by one.
    RotateLeftCc1,
    /// `RRDA`: rotate right through CC1 by one.
    RotateRightCc1,
    /// A conversion of ACCU1: `BTI`, `ITD`, `RND` and so on.
    Convert(Convert),
    /// A floating-point function of ACCU1: `SQRT`, `SIN` and so on.
    Math(MathFn),
    /// `TAK`: exchange ACCU1 and ACCU2.
    ExchangeAccus,
    /// `PUSH`: values move one accumulator up; ACCU1 keeps its own.
    Push,
    /// `POP`: values move one accumulator down.
    Pop,
    /// `ENT`: ACCU2 and ACCU3 move one up (four accumulators).
    Enter,
    /// `LEAVE`: ACCU3 and ACCU4 move one down (four accumulators).
    Leave,
    /// `INC n`: adds to ACCU1-L-L, without flags.
    Increment(u8),
    /// `DEC n`: subtracts from ACCU1-L-L, without flags.
    Decrement(u8),

    /// `LAR1`, `LAR2` from ACCU1.
    LoadAr(AddressRegister),
    /// `LAR1 P#..`: the whole 32-bit pointer.
    LoadArConst(AddressRegister, u32),
    /// `LAR1 MD 20`: an address register from memory.
    LoadArFrom(AddressRegister, Operand),
    /// `LAR1 AR2`: AR1 gets AR2.
    CopyAr2ToAr1,
    /// `TAR1`, `TAR2` into ACCU1.
    TransferAr(AddressRegister),
    /// `TAR1 MD 20`: an address register into memory.
    TransferArTo(AddressRegister, Operand),
    /// `TAR1 AR2`: AR2 gets AR1.
    CopyAr1ToAr2,
    /// `TAR`: exchange AR1 and AR2.
    ExchangeArs,
    /// `+AR1`: adds ACCU1-L to an address register.
    AddAr(AddressRegister),
    /// `+AR1 P#..`: adds an offset to an address register.
    AddArConst(AddressRegister, BitAddr),

    /// `AUF DB n`, `AUF DI n`.
    OpenDb(DbRegister, Number),
    /// `TDB`: exchange the data block registers.
    ExchangeDbs,

    /// `SI SV SE SS SA T n`, time in ACCU1-L.
    StartTimer(TimerKind, Number),
    /// `R T n`: with RLO 1 the timer stops.
    ResetTimer(Number),
    /// `FR T n`: an edge of the RLO lets the timer start anew.
    EnableTimer(Number),
    /// `ZV Z n`: an edge of the RLO counts up.
    CountUp(Number),
    /// `ZR Z n`: an edge of the RLO counts down.
    CountDown(Number),
    /// `S Z n`, BCD value in ACCU1-L.
    SetCounter(Number),
    /// `R Z n`: with RLO 1 the count becomes 0.
    ResetCounter(Number),
    /// `FR Z n`: an edge of the RLO lets the counter see its edges anew.
    EnableCounter(Number),

    /// A jump to the statement with this index.
    Jump(Jump, u32),
    /// `LOOP`: ACCU1-L := ACCU1-L - 1, jump when not 0.
    Loop(u32),
    /// `SPL`: jump over ACCU1-LL into the list of `SPA`s that follows; beyond the list to this statement.
    JumpList {
        /// Targets of the list, in order.
        targets: Box<[u32]>,
        /// Where a number beyond the list goes.
        otherwise: u32,
    },

    /// A call: `CALL`, `UC` or `CC`.
    Call(Box<Call>),
    /// The block ends: `BE` or `BEA`.
    End,
    /// `BEB`: end when RLO = 1.
    EndIf,
    /// `MCRA`: the master control relay is in force from here.
    McrActivate,
    /// `MCRD`: it is in force no more.
    McrDeactivate,
    /// `MCR(`: begins a zone that the RLO switches.
    McrOpen,
    /// `)MCR`: ends the zone begun last.
    McrClose,
    /// `NOP 0`, `NOP 1`, and every `BLD n` that is no [`Op::Build`].
    Nop,
    /// `BLD 100` to `BLD 103`, [`Op::BUILDS`]: no operation. STEP 7's ladder and function plan are drawn by them.
    Build(u8),
}
