//! Statements of two bytes without operand.

use ob1_ir::{
    AccuOp, AddressRegister, BitTest, Compare, Convert, DbRegister, Logic, MathFn, NumberFormat, Op, Shift, StatusBit,
    WordLogic,
};

use Convert::{
    Abs, Btd, Bti, Dtb, Dtr, Invd, Invi, Itb, Itd, Negd, Negi, Negr, Rnd, RndMinus, RndPlus, Tad, Taw, Trunc,
};
use MathFn::{Acos, Asin, Atan, Cos, Exp, Ln, Sin, Sqr, Sqrt, Tan};
use NumberFormat::{DInt, Int, Real};

const fn open(logic: Logic, negate: bool) -> Op {
    Op::Open { logic, negate }
}

/// The two bytes and the operation.
#[rustfmt::skip]
static FIXED: &[(u16, Op)] = &[
    // Brackets, RLO, status word, master control relay
    (0xBA00, open(Logic::And, false)), (0xBB00, open(Logic::Or, false)), (0xBF00, Op::Close), (0xFB00, Op::OrBranch),
    (0xFFF1, open(Logic::And, true)), (0xFFF3, open(Logic::Or, true)),
    (0xFFF4, open(Logic::Xor, false)), (0xFFF5, open(Logic::Xor, true)),
    (0x681C, Op::ClearRlo), (0x681D, Op::SetRlo), (0x682C, Op::SaveRlo), (0x682D, Op::NotRlo),
    (0x7006, Op::LoadStatus), (0x7007, Op::TransferStatus),
    (0x683A, Op::McrActivate), (0x683B, Op::McrDeactivate), (0x683C, Op::McrOpen), (0x683D, Op::McrClose),
    // Arithmetic
    (0x7900, Op::Arithmetic(Int, AccuOp::Add)), (0x5900, Op::Arithmetic(Int, AccuOp::Sub)),
    (0x6004, Op::Arithmetic(Int, AccuOp::Mul)), (0x6000, Op::Arithmetic(Int, AccuOp::Div)),
    (0x600D, Op::Arithmetic(DInt, AccuOp::Add)), (0x6009, Op::Arithmetic(DInt, AccuOp::Sub)),
    (0x600A, Op::Arithmetic(DInt, AccuOp::Mul)), (0x600E, Op::Arithmetic(DInt, AccuOp::Div)),
    (0x6001, Op::Arithmetic(DInt, AccuOp::Mod)),
    (0x600F, Op::Arithmetic(Real, AccuOp::Add)), (0x600B, Op::Arithmetic(Real, AccuOp::Sub)),
    (0x6007, Op::Arithmetic(Real, AccuOp::Mul)), (0x6003, Op::Arithmetic(Real, AccuOp::Div)),
    // Comparison
    (0x2120, Op::Compare(Int, Compare::Greater)), (0x2140, Op::Compare(Int, Compare::Less)),
    (0x2160, Op::Compare(Int, Compare::NotEqual)), (0x2180, Op::Compare(Int, Compare::Equal)),
    (0x21A0, Op::Compare(Int, Compare::GreaterEqual)), (0x21C0, Op::Compare(Int, Compare::LessEqual)),
    (0x3120, Op::Compare(Real, Compare::Greater)), (0x3140, Op::Compare(Real, Compare::Less)),
    (0x3160, Op::Compare(Real, Compare::NotEqual)), (0x3180, Op::Compare(Real, Compare::Equal)),
    (0x31A0, Op::Compare(Real, Compare::GreaterEqual)), (0x31C0, Op::Compare(Real, Compare::LessEqual)),
    (0x3920, Op::Compare(DInt, Compare::Greater)), (0x3940, Op::Compare(DInt, Compare::Less)),
    (0x3960, Op::Compare(DInt, Compare::NotEqual)), (0x3980, Op::Compare(DInt, Compare::Equal)),
    (0x39A0, Op::Compare(DInt, Compare::GreaterEqual)), (0x39C0, Op::Compare(DInt, Compare::LessEqual)),
    // Functions and conversions
    (0x6002, Op::Convert(Abs)), (0x6006, Op::Convert(Negr)),
    (0x6010, Op::Math(Sin)), (0x6011, Op::Math(Cos)), (0x6012, Op::Math(Tan)), (0x6013, Op::Math(Ln)),
    (0x6014, Op::Math(Sqrt)), (0x6018, Op::Math(Asin)), (0x6019, Op::Math(Acos)), (0x601A, Op::Math(Atan)),
    (0x601B, Op::Math(Exp)), (0x601C, Op::Math(Sqr)),
    (0x0100, Op::Convert(Invi)), (0x0900, Op::Convert(Negi)), (0x680D, Op::Convert(Invd)), (0x6807, Op::Convert(Negd)),
    (0x6806, Op::Convert(Dtr)), (0x6808, Op::Convert(Itb)), (0x680A, Op::Convert(Dtb)), (0x680C, Op::Convert(Bti)),
    (0x680E, Op::Convert(Btd)), (0x681E, Op::Convert(Itd)),
    (0x685C, Op::Convert(Rnd)), (0x685D, Op::Convert(RndMinus)), (0x685E, Op::Convert(RndPlus)),
    (0x685F, Op::Convert(Trunc)), (0x681A, Op::Convert(Taw)), (0x681B, Op::Convert(Tad)),
    // Word logic and shifts by ACCU2
    (0x4100, Op::WordLogic(WordLogic::And, None)), (0x4900, Op::WordLogic(WordLogic::Or, None)),
    (0x5100, Op::WordLogic(WordLogic::Xor, None)),
    (0x6837, Op::DWordLogic(WordLogic::And, None)), (0x6847, Op::DWordLogic(WordLogic::Or, None)),
    (0x6857, Op::DWordLogic(WordLogic::Xor, None)),
    (0x6812, Op::Shift(Shift::LeftWord, None)), (0x6813, Op::Shift(Shift::LeftDWord, None)),
    (0x6822, Op::Shift(Shift::RightWord, None)), (0x6823, Op::Shift(Shift::RightDWord, None)),
    (0x6824, Op::Shift(Shift::RightInt, None)), (0x6825, Op::Shift(Shift::RightDInt, None)),
    (0x6817, Op::Shift(Shift::RotateLeft, None)), (0x6827, Op::Shift(Shift::RotateRight, None)),
    (0x6818, Op::RotateLeftCc1), (0x6828, Op::RotateRightCc1),
    // Accumulators and address registers
    (0x7002, Op::ExchangeAccus), (0x682E, Op::Push), (0x683E, Op::Pop), (0x6008, Op::Enter), (0x684E, Op::Leave),
    (0xFE04, Op::LoadAr(AddressRegister::Ar1)), (0xFE0C, Op::LoadAr(AddressRegister::Ar2)),
    (0xFE05, Op::TransferAr(AddressRegister::Ar1)), (0xFE0D, Op::TransferAr(AddressRegister::Ar2)),
    (0xFE01, Op::CopyAr2ToAr1), (0xFE09, Op::CopyAr1ToAr2), (0xFE08, Op::ExchangeArs),
    (0xFE06, Op::AddAr(AddressRegister::Ar1)), (0xFE0E, Op::AddAr(AddressRegister::Ar2)),
    // Data blocks, ends
    (0xFB3C, Op::LoadDbLength(DbRegister::Db)), (0xFB3D, Op::LoadDbLength(DbRegister::Di)),
    (0xFB4C, Op::LoadDbNumber(DbRegister::Db)), (0xFB4D, Op::LoadDbNumber(DbRegister::Di)),
    (0xFB7C, Op::ExchangeDbs), (0x0500, Op::EndIf),
];

/// The status bits and the high nibble of their scans.
const STATUS: [(u8, StatusBit); 10] = [
    (0x0, StatusBit::StoredOverflow),
    (0x1, StatusBit::Overflow),
    (0x2, StatusBit::Positive),
    (0x4, StatusBit::Negative),
    (0x5, StatusBit::Unordered),
    (0x6, StatusBit::NotZero),
    (0x8, StatusBit::Zero),
    (0xA, StatusBit::NotNegative),
    (0xC, StatusBit::NotPositive),
    (0xE, StatusBit::BinaryResult),
];

/// Logic and negation of the scans' low codes, 0 to 5: `U UN O ON X XN`.
pub(crate) const SCANS: [(Logic, bool); 6] = [
    (Logic::And, false),
    (Logic::And, true),
    (Logic::Or, false),
    (Logic::Or, true),
    (Logic::Xor, false),
    (Logic::Xor, true),
];

/// The code of a scan.
pub(crate) fn scan_code(logic: Logic, negate: bool) -> Option<u8> {
    SCANS.iter().position(|s| *s == (logic, negate)).map(|at| at as u8)
}

/// The operation of two bytes.
pub(crate) fn read(word: u16) -> Option<Op> {
    if let Some((_, op)) = FIXED.iter().find(|(code, _)| *code == word) {
        return Some(op.clone());
    }
    let [page, second] = word.to_be_bytes();
    if page != 0xFF {
        return None;
    }
    let (_, status) = STATUS.iter().find(|(code, _)| *code == second >> 4)?;
    let (logic, negate) = *SCANS.get(usize::from(second & 15))?;
    Some(Op::Scan { logic, negate, test: BitTest::Status(*status) })
}

/// The two bytes of an operation without operand.
pub(crate) fn write(op: &Op) -> Option<u16> {
    if let Op::Scan { logic, negate, test: BitTest::Status(status) } = op {
        let (code, _) = STATUS.iter().find(|(_, s)| s == status)?;
        return Some(0xFF00 | u16::from(*code) << 4 | u16::from(scan_code(*logic, *negate)?));
    }
    FIXED.iter().find(|(_, fixed)| fixed == op).map(|(code, _)| *code)
}
