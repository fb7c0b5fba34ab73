//! One statement as text, in the form of a listing: German mnemonics, distances of jumps in bytes, formal parameters by
//! their number in the list (`#1:X`), floating-point constants as their bits.

use std::fmt::{self, Display, Formatter};

use ob1_ir::{Notation, Number, Op, Place, Width};
use ob1_model::{Area, BitAddr, S5Time};

use crate::decode::notation;
use crate::statement::{ConstForm, Mc7Op, Statement, Uncond};

impl Display for Statement {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match &self.op {
            Mc7Op::Plain(op) => f.write_str(&plain(op)),
            Mc7Op::Constant(form, value) => write!(f, "L {}", constant(*form, *value)),
            Mc7Op::ParamPointer { index, .. } => write!(f, "L P##{}", u32::from(*index) + 1),
            Mc7Op::Jump(jump, words) => {
                let shown = Op::Jump(*jump, 0).to_string();
                write!(f, "{} {:+}", shown.trim_end_matches(" @0"), i32::from(*words) * 2)
            }
            Mc7Op::Loop(words) => write!(f, "LOOP {:+}", i32::from(*words) * 2),
            Mc7Op::JumpList(entries) => write!(f, "SPL +{}", 4 + 4 * u32::from(*entries)),
            Mc7Op::Call(call) => write!(f, "{call}"),
            Mc7Op::Build(n) => write!(f, "BLD {n}"),
            Mc7Op::Nop0 => f.write_str("NOP 0"),
            Mc7Op::Nop1 => f.write_str("NOP 1"),
            Mc7Op::BlockEnd => f.write_str("BE"),
            Mc7Op::End => f.write_str("BEA"),
        }
    }
}

impl Display for Uncond {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let mnemonic = if self.conditional { "CC" } else { "UC" };
        match self.number {
            Number::Param(index) => write!(f, "{mnemonic} #{}:{}", index + 1, self.kind.name())?,
            number => write!(f, "{mnemonic} {} {number}", self.kind.name())?,
        }
        let list = self.list.as_deref().unwrap_or_default();
        for (at, pointer) in list.iter().enumerate() {
            let before = if at == 0 { " (" } else { ", " };
            match pointer >> 24 {
                0 if pointer & 0xFFFF == 0 => write!(f, "{before}N#{}", pointer >> 16)?,
                _ => write!(f, "{before}{}", self::pointer(*pointer))?,
            }
        }
        f.write_str(if list.is_empty() { "" } else { ")" })
    }
}

/// An operation as the instruction set prints it, its parameters by number.
fn plain(op: &Op) -> String {
    let mut text = op.to_string();
    let mut op = op.clone();
    // The periphery is named by the direction.
    if matches!(
        op.place_mut(),
        Some(
            Place::Fixed(Area::Peripheral, _)
                | Place::Memory(Area::Peripheral, _)
                | Place::Register(Some(Area::Peripheral), ..)
        )
    ) {
        text = text.replacen(" P", if matches!(op, Op::Transfer(_)) { " PA" } else { " PE" }, 1);
    }
    let width = op.operand().map(|operand| operand.width);
    if let Some(Place::Param { index, .. }) = op.place_mut() {
        let letter = match width {
            Some(Width::Bit) => 'X',
            Some(Width::Byte) => 'B',
            Some(Width::Word) => 'W',
            Some(Width::DWord) | None => 'D',
        };
        return format!("{} #{}:{letter}", text.split(" PAR").next().unwrap_or_default(), *index + 1);
    }
    if let Some(Number::Param(index)) = op.number_mut() {
        // `SE T PAR3`: its kind comes before its number.
        let mut words = text.split(' ');
        let (mnemonic, what) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
        return format!("{mnemonic} #{}:{what}", *index + 1);
    }
    text
}

/// A pointer: area and address, or its bits where it names no area.
fn pointer(bits: u32) -> String {
    let at = BitAddr(bits & 0x00FF_FFFF);
    match ((bits >> 24) as u8, Area::from_pointer_code((bits >> 24) as u8)) {
        (0, _) => format!("P#{at}"),
        (_, Some(area @ (Area::Db | Area::Di))) => format!("P#{}X {at}", area.name()),
        (_, Some(area)) => format!("P#{} {at}", area.name()),
        _ => format!("DW#16#{bits:X}"),
    }
}

/// A constant in the form that the code has.
fn constant(form: ConstForm, value: u32) -> String {
    let signed = value as i32;
    match notation(form) {
        Notation::Byte => format!("B#16#{value:X}"),
        Notation::Word => format!("W#16#{value:X}"),
        Notation::DWord => format!("DW#16#{value:X}"),
        Notation::Binary => format!("2#{value:b}"),
        Notation::Int => (value as u16 as i16).to_string(),
        Notation::DInt => format!("L#{signed}"),
        Notation::Real => format!("R#{value:08X}"),
        Notation::Text => {
            let characters = value.to_be_bytes().into_iter().skip_while(|b| *b == 0);
            format!("'{}'", characters.map(char::from).collect::<String>())
        }
        Notation::Bytes => {
            let bytes = value.to_be_bytes();
            let bytes = if form == ConstForm::Word(6) { bytes.get(2..).unwrap_or_default() } else { &bytes };
            format!("B#({})", bytes.iter().map(u8::to_string).collect::<Vec<_>>().join(","))
        }
        Notation::Count => format!("C#{value:X}"),
        Notation::Date => format!("D#{value}"),
        Notation::S5Time => match S5Time(value as u16).to_ms() {
            Some(ms) => format!("S5T#{ms}MS"),
            None => format!("W#16#{value:X}"),
        },
        Notation::Time => format!("T#{signed}MS"),
        Notation::TimeOfDay => format!("TOD#{value}MS"),
        Notation::Pointer => pointer(value),
    }
}
