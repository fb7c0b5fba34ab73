//! Items as people write them: `M1.0`, `MW 14`, `DB10.DBW20`, `DB10.speed`, `"Motor"`, `T 5`, and their values.
//!
//! Pure text to [`Cell`]; the names come from the program and are kept by the client side of the access port.

use std::fmt;

use ob1_ir::Program;
use ob1_model::{Area, Component, DataType};

use crate::{Cell, CellWidth};

/// A cell with the type it is shown in.
#[derive(Clone, Debug, PartialEq)]
pub struct Item {
    /// Where.
    pub cell: Cell,
    /// How much.
    pub width: CellWidth,
    /// Its declared type, when it has one.
    pub ty: Option<DataType>,
}

/// Why a text is no item.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ItemError {
    /// Neither an address nor a known name.
    Unknown(String),
    /// The bit part is missing, or there is one where none belongs, or it is above 7.
    Bit(String),
    /// A number is missing or too large.
    Number(String),
    /// The data block has no component of this name.
    Component(String),
    /// A type that is not up to 32 bits wide.
    Wide(String),
    /// The value does not fit the item.
    Value(String),
}

impl fmt::Display for ItemError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ItemError::Unknown(text) => write!(f, "{text}: neither an address (M1.0, DB10.DBW20, T5) nor a known name"),
            ItemError::Bit(text) => {
                write!(f, "{text}: a bit is written byte.bit, bit 0 to 7; bytes and words have none")
            }
            ItemError::Number(text) => write!(f, "{text}: a number is missing or too large"),
            ItemError::Component(text) => write!(f, "{text}: the data block has no such component"),
            ItemError::Wide(text) => write!(f, "{text}: wider than 32 bits; name one of its components"),
            ItemError::Value(text) => write!(f, "{text}: not a value of this item"),
        }
    }
}

impl std::error::Error for ItemError {}

/// The names of a program: data blocks with their components, and symbols.
#[derive(Clone, Debug, Default)]
pub struct ItemNames {
    dbs: Vec<(u16, Option<String>, Vec<Component>)>,
    symbols: Vec<(String, String)>,
}

impl ItemNames {
    /// The names of `program`.
    #[must_use]
    pub fn new(program: &Program) -> Self {
        Self {
            dbs: program.data.iter().map(|db| (db.number, db.name.clone(), db.components.clone())).collect(),
            symbols: program.symbols.iter().map(|s| (s.name.clone(), s.address.clone())).collect(),
        }
    }

    fn symbol(&self, name: &str) -> Option<&str> {
        self.symbols.iter().find(|(n, _)| n.eq_ignore_ascii_case(name)).map(|(_, address)| address.as_str())
    }

    fn db_by_name(&self, name: &str) -> Option<u16> {
        let named = |n: &Option<String>| n.as_ref().is_some_and(|n| n.eq_ignore_ascii_case(name));
        self.dbs.iter().find(|(_, n, _)| named(n)).map(|(number, ..)| *number)
    }

    fn component(&self, db: u16, path: &str) -> Option<&Component> {
        let (_, _, components) = self.dbs.iter().find(|(number, ..)| *number == db)?;
        components.iter().find(|c| c.path.eq_ignore_ascii_case(path))
    }
}

/// Parses an item, German or international.
///
/// # Errors
/// The text names nothing.
pub fn parse_item(text: &str, names: &ItemNames) -> Result<Item, ItemError> {
    let trimmed = text.trim();
    // A symbol stands for an address; a component may follow it.
    let (head, tail) = match trimmed.strip_prefix('"') {
        Some(rest) => rest.split_once('"').ok_or_else(|| ItemError::Unknown(trimmed.to_owned()))?,
        None => match trimmed.split_once('.') {
            Some((head, _)) if names.symbol(head).is_some() || names.db_by_name(head).is_some() => {
                (head, &trimmed[head.len()..])
            }
            _ => (trimmed, ""),
        },
    };
    if let Some(address) = names.symbol(head) {
        return parse_address(&format!("{address}{tail}"), names);
    }
    if let Some(number) = names.db_by_name(head) {
        return parse_address(&format!("DB{number}{tail}"), names);
    }
    if trimmed.starts_with('"') {
        return Err(ItemError::Unknown(trimmed.to_owned()));
    }
    parse_address(trimmed, names)
}

fn parse_address(text: &str, names: &ItemNames) -> Result<Item, ItemError> {
    let compact: String = text.chars().filter(|c| !c.is_whitespace()).collect();
    let upper = compact.to_ascii_uppercase();
    let unknown = || ItemError::Unknown(text.to_owned());
    if let Some(rest) = upper.strip_prefix("DB") {
        if let Some((number, inner)) = rest.split_once('.') {
            let number: u16 = number.parse().map_err(|_| unknown())?;
            let path = &compact[compact.len() - inner.len()..];
            return in_db(text, number, inner, path, names);
        }
        return Err(unknown());
    }
    let digits = upper.find(|c: char| c.is_ascii_digit()).ok_or_else(unknown)?;
    let (letters, address) = upper.split_at(digits);
    let number = |max: u32| match address.parse::<u32>() {
        Ok(n) if n <= max => Ok(n),
        _ => Err(ItemError::Number(text.to_owned())),
    };
    let item = |cell, width| Ok(Item { cell, width, ty: None });
    match letters {
        "T" => return item(Cell::Timer(number(65_535)? as u16), CellWidth::Word),
        "Z" | "C" => return item(Cell::Counter(number(65_535)? as u16), CellWidth::Word),
        _ => {}
    }
    let (prefix, width) = match letters.char_indices().next_back() {
        Some((at, 'B')) if at > 0 => (&letters[..at], CellWidth::Byte),
        Some((at, 'W')) if at > 0 => (&letters[..at], CellWidth::Word),
        Some((at, 'D')) if at > 0 => (&letters[..at], CellWidth::DWord),
        _ => (letters, CellWidth::Bit),
    };
    let at = bit_address(text, address, width)?;
    let cell = match prefix {
        "E" | "I" => Cell::Area(Area::Input, at),
        "A" | "Q" => Cell::Area(Area::Output, at),
        "M" => Cell::Area(Area::Memory, at),
        "PE" | "PI" | "PA" | "PQ" if width != CellWidth::Bit => Cell::Peripheral(at),
        _ => return Err(unknown()),
    };
    item(cell, width)
}

fn in_db(text: &str, number: u16, inner: &str, path: &str, names: &ItemNames) -> Result<Item, ItemError> {
    let width = match inner.get(..3) {
        Some("DBX") => Some(CellWidth::Bit),
        Some("DBB") => Some(CellWidth::Byte),
        Some("DBW") => Some(CellWidth::Word),
        Some("DBD") => Some(CellWidth::DWord),
        _ => None,
    };
    if let Some(width) = width
        && inner[3..].starts_with(|c: char| c.is_ascii_digit())
    {
        let at = bit_address(text, &inner[3..], width)?;
        return Ok(Item { cell: Cell::Db(number, at), width, ty: None });
    }
    let component = names.component(number, path).ok_or_else(|| ItemError::Component(text.to_owned()))?;
    let width = match component.ty.elementary_bits() {
        Some(1) => CellWidth::Bit,
        Some(8) => CellWidth::Byte,
        Some(16) => CellWidth::Word,
        Some(32) => CellWidth::DWord,
        _ => return Err(ItemError::Wide(text.to_owned())),
    };
    Ok(Item { cell: Cell::Db(number, component.at.0), width, ty: Some(component.ty.clone()) })
}

/// `byte.bit` for bits, `byte` for the rest, as a bit address.
fn bit_address(text: &str, address: &str, width: CellWidth) -> Result<u32, ItemError> {
    let byte = |digits: &str| match digits.parse::<u32>() {
        Ok(byte) if byte <= 65_535 => Ok(byte),
        _ => Err(ItemError::Number(text.to_owned())),
    };
    match (address.split_once('.'), width) {
        (Some((head, bit)), CellWidth::Bit) => match bit.parse::<u32>() {
            Ok(bit) if bit <= 7 => Ok(byte(head)? * 8 + bit),
            _ => Err(ItemError::Bit(text.to_owned())),
        },
        (None, CellWidth::Bit) | (Some(_), _) => Err(ItemError::Bit(text.to_owned())),
        (None, _) => Ok(byte(address)? * 8),
    }
}

impl Item {
    /// The value a text stands for: `1`, `TRUE`, `-5`, `16#FF`, `W#16#14`, `2#101`, and `1.5` for a REAL.
    ///
    /// # Errors
    /// It is no number, or does not fit.
    pub fn parse_value(&self, text: &str) -> Result<u32, ItemError> {
        let wrong = || ItemError::Value(text.to_owned());
        let trimmed = text.trim();
        let upper = trimmed.to_ascii_uppercase();
        if self.width == CellWidth::Bit {
            return match upper.as_str() {
                "1" | "TRUE" => Ok(1),
                "0" | "FALSE" => Ok(0),
                _ => Err(wrong()),
            };
        }
        let is_real = matches!(self.ty, Some(DataType::Real)) || self.ty.is_none() && upper.contains('.');
        if is_real && self.width == CellWidth::DWord {
            return trimmed.parse::<f32>().map(f32::to_bits).map_err(|_| wrong());
        }
        let radix = |digits: &str, radix| i64::from_str_radix(&digits.replace('_', ""), radix).map_err(|_| wrong());
        let value = match upper.split_once("16#").filter(|(head, _)| matches!(*head, "" | "B#" | "W#" | "DW#")) {
            Some((_, digits)) => radix(digits, 16)?,
            None => match (upper.strip_prefix("2#"), upper.strip_prefix("0X")) {
                (Some(digits), _) => radix(digits, 2)?,
                (_, Some(digits)) => radix(digits, 16)?,
                _ => upper.trim_start_matches("L#").parse::<i64>().map_err(|_| wrong())?,
            },
        };
        let bits = self.width.bits();
        let (low, high) = (-(1i64 << (bits - 1)), (1i64 << bits) - 1);
        if !(low..=high).contains(&value) {
            return Err(wrong());
        }
        Ok((value & high) as u32)
    }

    /// The value as text, by its type: decimal for numbers, hexadecimal without a type.
    #[must_use]
    pub fn format_value(&self, value: u32) -> String {
        match (&self.ty, self.width) {
            (_, CellWidth::Bit) => (value & 1).to_string(),
            (Some(DataType::Int), _) => (value as i16).to_string(),
            (Some(DataType::DInt | DataType::Time), _) => (value as i32).to_string(),
            (Some(DataType::Real), _) => f32::from_bits(value).to_string(),
            (_, CellWidth::Byte) => format!("16#{value:02X}"),
            (_, CellWidth::Word) if matches!(self.cell, Cell::Counter(_)) => value.to_string(),
            (_, CellWidth::Word) => format!("16#{value:04X}"),
            (_, CellWidth::DWord) => format!("16#{value:08X}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_ir::{DataBlock, DataKind, Symbol};
    use ob1_model::BitAddr;

    fn names() -> ItemNames {
        let component = |path: &str, ty, bit| Component { path: path.into(), ty, at: BitAddr(bit) };
        ItemNames::new(&Program {
            data: vec![DataBlock {
                number: 10,
                name: Some("Tank".into()),
                kind: DataKind::Global,
                bytes: vec![0; 20],
                components: vec![
                    component("speed", DataType::Int, 16),
                    component("valve[2].open", DataType::Bool, 35),
                    component("text", DataType::String(10), 64),
                ],
                read_only: false,
            }],
            symbols: vec![
                Symbol { name: "Motor".into(), address: "A 4.1".into(), ty: None },
                Symbol { name: "Recipe".into(), address: "DB 10".into(), ty: None },
            ],
            ..Program::default()
        })
    }

    #[test]
    fn addresses() {
        use CellWidth::{Bit, Byte, DWord, Word};
        for (text, cell, width) in [
            ("M1.0", Cell::Area(Area::Memory, 8), Bit),
            ("mw 14", Cell::Area(Area::Memory, 112), Word),
            ("EB3", Cell::Area(Area::Input, 24), Byte),
            ("I 3.7", Cell::Area(Area::Input, 31), Bit),
            ("QD 4", Cell::Area(Area::Output, 32), DWord),
            ("A0.1", Cell::Area(Area::Output, 1), Bit),
            ("DB10.DBW20", Cell::Db(10, 160), Word),
            ("DB 10.DBX 2.3", Cell::Db(10, 19), Bit),
            ("PEW 256", Cell::Peripheral(2048), Word),
            ("PQB0", Cell::Peripheral(0), Byte),
            ("T5", Cell::Timer(5), Word),
            ("Z 7", Cell::Counter(7), Word),
            ("Motor", Cell::Area(Area::Output, 33), Bit),
            ("\"Motor\"", Cell::Area(Area::Output, 33), Bit),
            ("DB10.Speed", Cell::Db(10, 16), Word),
            ("Tank.speed", Cell::Db(10, 16), Word),
            ("\"Recipe\".valve[2].open", Cell::Db(10, 35), Bit),
        ] {
            let item = parse_item(text, &names()).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!((item.cell, item.width), (cell, width), "{text}");
        }
    }

    #[test]
    fn refusals() {
        for text in
            ["", "M1", "M1.8", "MW1.0", "MW", "X1.0", "DB10", "DB10.nothing", "DB10.text", "M65536.0", "\"a", "PE1.0"]
        {
            assert!(parse_item(text, &names()).is_err(), "{text}");
        }
    }

    #[test]
    fn values_go_both_ways() {
        let item = |text: &str| parse_item(text, &names()).unwrap();
        for (at, text, value, back) in [
            ("M1.0", "TRUE", 1, "1"),
            ("MW1", "-1", 0xFFFF, "16#FFFF"),
            ("MW1", "W#16#14", 0x14, "16#0014"),
            ("MB1", "2#1010_1010", 0xAA, "16#AA"),
            ("MD1", "1.5", 0x3FC0_0000, "16#3FC00000"),
            ("DB10.speed", "-7", 0xFFF9, "-7"),
        ] {
            assert_eq!(item(at).parse_value(text), Ok(value), "{at} {text}");
            assert_eq!(item(at).format_value(value), back, "{at} {text}");
        }
        for (at, text) in [("M1.0", "2"), ("MB1", "256"), ("MW1", "x"), ("MW1", "1.5"), ("MB1", "-129")] {
            assert!(item(at).parse_value(text).is_err(), "{at} {text}");
        }
    }
}
