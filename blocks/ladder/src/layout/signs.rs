//! What STEP 7 writes in coils, boxes and at their pins.

use ob1_ir::{AccuOp, Compare, Convert, Jump, NumberFormat, Op, Shift, WordLogic};
use ob1_model::TimerKind;

/// The letters of a number format in the name of a box.
const fn letters(format: NumberFormat) -> &'static str {
    match format {
        NumberFormat::DInt => "DI",
        other => other.name(),
    }
}

/// The title of a comparison: `CMP >I`.
pub(crate) fn compare(format: NumberFormat, how: Compare) -> String {
    format!("CMP {}{}", how.name(), format.name())
}

/// The box or sign of an edge.
pub(crate) const fn edge(boxed: bool, rising: bool) -> &'static str {
    match (boxed, rising) {
        (false, true) => "P",
        (false, false) => "N",
        (true, true) => "POS",
        (true, false) => "NEG",
    }
}

/// The box of an operation on values: `ADD_I`.
pub(crate) fn operation(op: &Op) -> String {
    match op {
        Op::Arithmetic(format, how) => {
            let name = match how {
                AccuOp::Add => "ADD",
                AccuOp::Sub => "SUB",
                AccuOp::Mul => "MUL",
                AccuOp::Div => "DIV",
                AccuOp::Mod => "MOD",
            };
            format!("{name}_{}", letters(*format))
        }
        Op::AddConst { format, .. } => format!("ADD_{}", letters(*format)),
        Op::WordLogic(how, _) => format!("{}_W", word_logic(*how)),
        Op::DWordLogic(how, _) => format!("{}_DW", word_logic(*how)),
        Op::Shift(how, _) => shift(*how).to_owned(),
        Op::Convert(how) => convert(*how).to_owned(),
        Op::Math(how) => how.name().to_owned(),
        other => other.to_string(),
    }
}

const fn word_logic(how: WordLogic) -> &'static str {
    match how {
        WordLogic::And => "WAND",
        WordLogic::Or => "WOR",
        WordLogic::Xor => "WXOR",
    }
}

const fn shift(how: Shift) -> &'static str {
    match how {
        Shift::LeftWord => "SHL_W",
        Shift::RightWord => "SHR_W",
        Shift::RightInt => "SHR_I",
        Shift::LeftDWord => "SHL_DW",
        Shift::RightDWord => "SHR_DW",
        Shift::RightDInt => "SHR_DI",
        Shift::RotateLeft => "ROL_DW",
        Shift::RotateRight => "ROR_DW",
    }
}

const fn convert(how: Convert) -> &'static str {
    match how {
        Convert::Bti => "BCD_I",
        Convert::Itb => "I_BCD",
        Convert::Btd => "BCD_DI",
        Convert::Dtb => "DI_BCD",
        Convert::Itd => "I_DI",
        Convert::Dtr => "DI_R",
        Convert::Rnd => "ROUND",
        Convert::RndPlus => "CEIL",
        Convert::RndMinus => "FLOOR",
        Convert::Trunc => "TRUNC",
        Convert::Invi => "INV_I",
        Convert::Invd => "INV_DI",
        Convert::Negi => "NEG_I",
        Convert::Negd => "NEG_DI",
        Convert::Negr => "NEG_R",
        Convert::Abs => "ABS",
        // The ladder has no box for these two.
        Convert::Taw => "TAW",
        Convert::Tad => "TAD",
    }
}

/// The box and the coil of a timer; the words follow the mnemonics.
pub(crate) const fn timer(kind: TimerKind, german: bool) -> [&'static str; 2] {
    match (kind, german) {
        (TimerKind::Pulse, false) => ["S_PULSE", "SP"],
        (TimerKind::Pulse, true) => ["S_IMPULS", "SI"],
        (TimerKind::ExtendedPulse, false) => ["S_PEXT", "SE"],
        (TimerKind::ExtendedPulse, true) => ["S_VIMP", "SV"],
        (TimerKind::OnDelay, false) => ["S_ODT", "SD"],
        (TimerKind::OnDelay, true) => ["S_EVERZ", "SE"],
        (TimerKind::RetentiveOnDelay, false) => ["S_ODTS", "SS"],
        (TimerKind::RetentiveOnDelay, true) => ["S_SEVERZ", "SS"],
        (TimerKind::OffDelay, false) => ["S_OFFDT", "SF"],
        (TimerKind::OffDelay, true) => ["S_AVERZ", "SA"],
    }
}

/// The pins of a timer behind S: the time, reset, the two values.
pub(crate) const fn timer_pins(german: bool) -> [&'static str; 4] {
    if german { ["TW", "R", "DUAL", "DEZ"] } else { ["TV", "R", "BI", "BCD"] }
}

/// The pins of a counter: up, down, set, its value, reset, the two values.
pub(crate) const fn counter_pins(german: bool) -> [&'static str; 7] {
    if german { ["ZV", "ZR", "S", "ZW", "R", "DUAL", "DEZ"] } else { ["CU", "CD", "S", "PV", "R", "CV", "CV_BCD"] }
}

/// The box of a counter that counts up, down, or both.
pub(crate) const fn counter(up: bool, both: bool, german: bool) -> &'static str {
    match (up, both, german) {
        (true, true, false) => "S_CUD",
        (true, false, false) => "S_CU",
        (false, false, false) => "S_CD",
        (true, true, true) => "ZAEHLER",
        (true, false, true) => "Z_VORW",
        (false, false, true) => "Z_RUECK",
        // Down first: no box of STEP 7.
        (false, true, _) => "ZR/ZV",
    }
}

/// What stands in a coil.
pub(crate) fn coil(op: &Op, german: bool) -> &'static str {
    match op {
        Op::Set(_) => "S",
        Op::Reset(_) | Op::ResetTimer(_) | Op::ResetCounter(_) => "R",
        Op::StartTimer(kind, _) => timer(*kind, german)[1],
        Op::SetCounter(_) => ["SC", "SZ"][usize::from(german)],
        Op::CountUp(_) => ["CU", "ZV"][usize::from(german)],
        Op::CountDown(_) => ["CD", "ZR"][usize::from(german)],
        Op::SaveRlo => "SAVE",
        Op::Jump(Jump::IfNotRlo, _) => "JMPN",
        Op::Jump(..) => "JMP",
        Op::EndIf | Op::End => "RET",
        Op::Call(_) => "CALL",
        Op::OpenDb(..) => "OPN",
        Op::McrActivate => "MCRA",
        Op::McrDeactivate => "MCRD",
        Op::McrOpen => "MCR<",
        Op::McrClose => "MCR>",
        _ => "",
    }
}
