//! The mnemonics of statements, German and international side by side.
//!
//! Meaning and spelling: "Statement List (STL) for S7-300 and S7-400", Appendix A.

use std::sync::LazyLock;

use ob1_ir::{
    AccuOp, AddressRegister, CallMode, Compare, Convert, Jump, Logic, MathFn, NumberFormat, Op, Shift, WordLogic,
};
use ob1_model::TimerKind;

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

/// What a mnemonic means: the operation, and what kind of operand it takes.
#[derive(Clone, Debug)]
pub(crate) enum Shape {
    /// A bit, timer, counter or status bit; `O` also without operand.
    Scan(Logic, bool),
    /// An operation without operand.
    Plain(Op),
    /// `=`, with a bit.
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
    /// `+`, with a constant.
    AddConst,
    Increment,
    Decrement,
    LoadAr(AddressRegister),
    TransferAr(AddressRegister),
    AddAr(AddressRegister),
    /// `AUF`, with a data block.
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
    /// `NOP n`, without effect.
    Nothing,
    /// `BLD n`, a mark of a graphical network.
    Build,
}

/// A mnemonic in both sets.
#[derive(Debug)]
pub(crate) struct Row {
    pub(crate) german: &'static str,
    pub(crate) international: &'static str,
    pub(crate) shape: Shape,
}

impl Row {
    /// Its word in one set.
    pub(crate) fn word(&self, set: Mnemonics) -> &'static str {
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

const fn accu(format: NumberFormat, op: AccuOp) -> Shape {
    Shape::Plain(Op::Arithmetic(format, op))
}

const fn compare(format: NumberFormat, how: Compare) -> Shape {
    Shape::Plain(Op::Compare(format, how))
}

use NumberFormat::{DInt, Int, Real};

#[rustfmt::skip]
pub(crate) static ROWS: LazyLock<Vec<Row>> = LazyLock::new(|| {
    let mut rows = vec![
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
    ];
    let most = |shift| if matches!(shift, Shift::LeftWord | Shift::RightWord | Shift::RightInt) { 15 } else { 32 };
    rows.extend(Shift::ALL.map(|shift| both(shift.name(), Shape::Shift(shift, most(shift)))));
    rows.extend([
        both("RLDA", Shape::Plain(Op::RotateLeftCc1)),
        both("RRDA", Shape::Plain(Op::RotateRightCc1)),
    ]);
    rows.extend(Convert::ALL.map(|to| {
        let international = match to {
            Convert::Taw => "CAW",
            Convert::Tad => "CAD",
            _ => to.name(),
        };
        row(to.name(), international, Shape::Plain(Op::Convert(to)))
    }));
    rows.extend(MathFn::ALL.map(|function| both(function.name(), Shape::Plain(Op::Math(function)))));
    rows.extend([
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
        both("BLD", Shape::Build),
        both("NOP", Shape::Nothing),
    ]);
    rows
});
