//! Names of cells: `M1.0`, `MW10`, `DB10.DBW20`, `PEW256`, `T2`, `Z3`, `DB20.DONE`, and symbols.

use ob1_ir::{DataBlock, Program, Symbol};
use ob1_model::{Area, Cell, Component, DataType, Layout, Width};
use ob1_stl::nearest;

/// How a cell's bits are read as a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reading {
    /// A bit: 0 or 1.
    Bool,
    /// Bits without a sign.
    Unsigned,
    /// A whole number with sign, in two's complement.
    Signed,
    /// IEEE 754, 32 bits.
    Real,
}

/// A cell by its name.
#[derive(Clone, Debug, PartialEq)]
pub struct Item {
    /// The name as it was given.
    pub name: String,
    /// Where it lies in the CPU.
    pub cell: Cell,
    /// How many bits are read or written.
    pub width: Width,
    /// How its bits are read.
    pub reading: Reading,
    /// Its S7 type, elementary.
    pub ty: DataType,
}

/// A place by its name, with its type: also texts, times, arrays and structures, which are not an [`Item`].
#[derive(Clone, Debug, PartialEq)]
pub struct Typed {
    /// The name as it was given.
    pub name: String,
    /// Where it begins in the CPU.
    pub cell: Cell,
    /// The type of the place.
    pub ty: DataType,
}

impl Item {
    /// An item for a place with a single value of up to 32 bits.
    #[must_use]
    pub fn of(typed: &Typed) -> Option<Self> {
        let (width, reading) = of_type(&typed.ty)?;
        Some(Self { name: typed.name.clone(), cell: typed.cell, width, reading, ty: typed.ty.clone() })
    }

    /// The same place with its type.
    #[must_use]
    pub fn typed(&self) -> Typed {
        Typed { name: self.name.clone(), cell: self.cell, ty: self.ty.clone() }
    }

    /// Its bits in the bytes of [`Typed::piece`].
    #[must_use]
    pub fn bits(&self, bytes: &[u8]) -> u32 {
        let bits = bytes.iter().fold(0, |bits, byte| bits << 8 | u32::from(*byte));
        let in_byte = self.width == Width::Bit && self.cell.block().is_some();
        if in_byte { bits >> (self.cell.bit() % 8) & 1 } else { bits }
    }
}

/// The names of a program: data block components and symbols.
#[derive(Clone, Debug, Default)]
pub struct Names {
    blocks: Vec<NamedBlock>,
    symbols: Vec<Symbol>,
}

/// A data block as the program declares it.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedBlock {
    /// Number of the data block.
    pub number: u16,
    /// The name of its header or symbol.
    pub name: Option<String>,
    /// Its declarations, composed types as a whole.
    pub components: Vec<Component>,
    /// Its length in bytes.
    pub bytes: u32,
    /// `READ_ONLY`: the program cannot write it.
    pub read_only: bool,
}

impl Names {
    /// The names of `program`.
    #[must_use]
    pub fn new(program: &Program) -> Self {
        let block = |data: &DataBlock| NamedBlock {
            number: data.number,
            name: data.name.clone(),
            components: data.components.clone(),
            bytes: data.bytes.len() as u32,
            read_only: data.read_only,
        };
        Self::of(program.data.iter().map(block).collect(), program.symbols.clone())
    }

    /// The names of data blocks and symbols.
    #[must_use]
    pub fn of(blocks: Vec<NamedBlock>, symbols: Vec<Symbol>) -> Self {
        Self { blocks, symbols }
    }

    /// The data blocks, in the order of the program.
    #[must_use]
    pub fn blocks(&self) -> &[NamedBlock] {
        &self.blocks
    }

    /// The symbols, in the order of their tables.
    #[must_use]
    pub fn symbols(&self) -> &[Symbol] {
        &self.symbols
    }

    /// Finds a cell by name.
    ///
    /// # Errors
    /// The error in the name, in one sentence.
    pub fn parse(&self, name: &str) -> Result<Item, String> {
        let typed = self.typed(name)?;
        Item::of(&typed).ok_or_else(|| format!("{} is a {}, which is not a single value", name.trim(), typed.ty.name()))
    }

    /// Finds a place and its type by name. A symbol has the type of the symbol table if that is as long as its address.
    ///
    /// # Errors
    /// The error in the name, in one sentence.
    pub fn typed(&self, name: &str) -> Result<Typed, String> {
        let trimmed = name.trim().trim_matches('"');
        let text: String = trimmed.chars().filter(|c| !c.is_whitespace()).collect();
        if text.is_empty() {
            return Err("a name is missing; write it like M1.0, MW10 or DB10.DBW20".into());
        }
        let (cell, ty) = match self.symbols.iter().find(|symbol| symbol.name.eq_ignore_ascii_case(trimmed)) {
            None => self.absolute(&text).map_err(|why| match self.near_symbol(trimmed) {
                Some(near) => format!("{why}; did you mean the symbol \"{near}\"?"),
                None => why,
            })?,
            Some(symbol) => {
                let (cell, ty) =
                    self.absolute(&symbol.address.chars().filter(|c| !c.is_whitespace()).collect::<String>())?;
                let same = |told: &&DataType| of_type(told).is_some() && Layout::bits(told) == Layout::bits(&ty);
                let told = symbol.ty.as_ref().filter(|told| same(told) && ty != DataType::S5Time);
                (cell, told.cloned().unwrap_or(ty))
            }
        };
        Ok(Typed { name: name.to_owned(), cell, ty })
    }

    /// The symbol that a wrong name may mean.
    fn near_symbol(&self, name: &str) -> Option<&str> {
        let known: Vec<String> = self.symbols.iter().map(|symbol| symbol.name.to_uppercase()).collect();
        let near = nearest(&name.to_uppercase(), known.iter().map(String::as_str))?;
        let at = known.iter().position(|symbol| symbol == near)?;
        self.symbols.get(at).map(|symbol| symbol.name.as_str())
    }

    fn absolute(&self, text: &str) -> Result<Place, String> {
        if let Some((block, rest)) = text.split_once('.')
            && let Some(number) = self.block_number(block)
        {
            return self.in_block(number, rest);
        }
        let upper = text.to_ascii_uppercase();
        let digits = upper.find(|c: char| c.is_ascii_digit()).unwrap_or(upper.len());
        let (letters, address) = upper.split_at(digits);
        let area = |name: &str| match name {
            "E" | "I" => Some(Area::Input),
            "A" | "Q" => Some(Area::Output),
            "M" => Some(Area::Memory),
            _ => None,
        };
        match letters {
            "T" => Ok((Cell::Timer(number(address)?), DataType::S5Time)),
            "Z" | "C" => Ok((Cell::Counter(number(address)?), DataType::Counter)),
            _ => {
                if let Some(area) = area(letters) {
                    return Ok((Cell::Area(area, bit_address(address)?), DataType::Bool));
                }
                let (name, ty) = split_width(letters).ok_or_else(|| unknown(text))?;
                let byte: u32 = number(address)?;
                let cell = match (area(name), name) {
                    (Some(area), _) => Cell::Area(area, checked_bits(byte)?),
                    (None, "PE" | "PI" | "PA" | "PQ" | "P") => Cell::Peripheral(checked_bits(byte)?),
                    (None, _) => return Err(unknown(text)),
                };
                Ok((cell, ty))
            }
        }
    }

    /// The number of `DB10` or of a data block with a name.
    fn block_number(&self, text: &str) -> Option<u16> {
        let by_name = self.blocks.iter().find(|b| b.name.as_deref().is_some_and(|n| n.eq_ignore_ascii_case(text)));
        match by_name {
            Some(block) => Some(block.number),
            None => {
                text.get(..2).filter(|kind| kind.eq_ignore_ascii_case("DB")).and_then(|_| text.get(2..)?.parse().ok())
            }
        }
    }

    fn in_block(&self, db: u16, rest: &str) -> Result<Place, String> {
        let block = self.blocks.iter().find(|b| b.number == db);
        let components = block.map(|b| b.components.as_slice()).unwrap_or_default();
        if let Some(found) = Component::find(components, rest) {
            return Ok((Cell::Db(db, found.at.0), found.ty));
        }
        let upper = rest.to_ascii_uppercase();
        let digits = upper.find(|c: char| c.is_ascii_digit()).unwrap_or(upper.len());
        let (letters, address) = upper.split_at(digits);
        if letters == "DBX" {
            return Ok((Cell::Db(db, bit_address(address)?), DataType::Bool));
        }
        if let Some(("DB", ty)) = split_width(letters) {
            return Ok((Cell::Db(db, checked_bits(number(address)?)?), ty));
        }
        let hint = nearest(&upper, components.iter().map(|c| c.path.as_str()));
        let hint = hint.map_or_else(String::new, |near| format!("; did you mean DB{db}.{near}?"));
        Err(format!("DB{db} has no component {rest}{hint}"))
    }
}

type Place = (Cell, DataType);

fn unknown(text: &str) -> String {
    format!("\"{text}\" is not the name of a cell; write it like M1.0, MW10, DB10.DBW20, EB4, AW6, PEW256, T2, Z3")
}

/// `MW` -> `M` and a word.
fn split_width(letters: &str) -> Option<(&str, DataType)> {
    let split = letters.len().checked_sub(1)?;
    let ty = match letters.get(split..)? {
        "B" => DataType::Byte,
        "W" => DataType::Word,
        "D" => DataType::DWord,
        _ => return None,
    };
    Some((letters.get(..split)?, ty))
}

fn of_type(ty: &DataType) -> Option<(Width, Reading)> {
    let reading = match ty {
        DataType::Bool => Reading::Bool,
        DataType::Int | DataType::DInt | DataType::Time => Reading::Signed,
        DataType::Real => Reading::Real,
        _ => Reading::Unsigned,
    };
    // A counter's value is a word.
    let bits = if *ty == DataType::Counter { Some(16) } else { ty.elementary_bits() };
    Some((Width::of_bits(bits?)?, reading))
}

fn number<T: std::str::FromStr>(text: &str) -> Result<T, String> {
    text.parse().map_err(|_| format!("\"{text}\" is not a valid number here"))
}

fn checked_bits(byte: u32) -> Result<u32, String> {
    if byte > ob1_model::BitAddr::MAX_BYTE { Err(format!("there is no byte {byte}")) } else { Ok(byte * 8) }
}

/// Byte and bit as a bit address: `1.0` is 8.
fn bit_address(text: &str) -> Result<u32, String> {
    let (byte, bit) = text.split_once('.').ok_or_else(|| format!("\"{text}\" needs a bit, like 1.0"))?;
    let bit: u32 = number(bit)?;
    if bit > 7 {
        return Err(format!("there is no bit {bit}; bits count from 0 to 7"));
    }
    Ok(checked_bits(number(byte)?)? + bit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_ir::{DataKind, Symbol};
    use ob1_model::BitAddr;

    fn names() -> Names {
        let component = |path: &str, ty, at| Component { path: path.into(), ty, at: BitAddr(at) };
        Names::new(&Program {
            data: vec![DataBlock {
                number: 20,
                name: Some("LEDGER".into()),
                kind: DataKind::Global,
                bytes: vec![0; 64],
                components: vec![
                    component("DONE", DataType::DInt, 96),
                    component("PAUSE", DataType::Bool, 480),
                    component("WHEN", DataType::DateAndTime, 488),
                ],
                read_only: false,
                non_retain: false,
            }],
            symbols: [
                ("Ready lamp", "A 4.0", None),
                ("Level", "MW 20", Some(DataType::Int)),
                ("Odd", "MW 22", Some(DataType::Real)),
            ]
            .map(|(name, address, ty)| Symbol { name: name.into(), address: address.into(), ty, ..Symbol::default() })
            .into(),
            ..Program::default()
        })
    }

    fn parse(name: &str) -> Result<(Cell, Width, Reading), String> {
        names().parse(name).map(|i| (i.cell, i.width, i.reading))
    }

    #[test]
    fn cells_by_address() {
        use Reading::{Bool, Unsigned};
        use Width::{Bit, Byte, DWord, Word};
        let table = [
            ("M1.0", Cell::Area(Area::Memory, 8), Bit, Bool),
            ("m 1.7", Cell::Area(Area::Memory, 15), Bit, Bool),
            ("MB12", Cell::Area(Area::Memory, 96), Byte, Unsigned),
            ("MW 10", Cell::Area(Area::Memory, 80), Word, Unsigned),
            ("MD4", Cell::Area(Area::Memory, 32), DWord, Unsigned),
            ("E0.3", Cell::Area(Area::Input, 3), Bit, Bool),
            ("IW2", Cell::Area(Area::Input, 16), Word, Unsigned),
            ("AB5", Cell::Area(Area::Output, 40), Byte, Unsigned),
            ("Q4.1", Cell::Area(Area::Output, 33), Bit, Bool),
            ("PEW256", Cell::Peripheral(2048), Word, Unsigned),
            ("PAB 3", Cell::Peripheral(24), Byte, Unsigned),
            ("T2", Cell::Timer(2), Word, Unsigned),
            ("Z3", Cell::Counter(3), Word, Unsigned),
            ("DB10.DBW20", Cell::Db(10, 160), Word, Unsigned),
            ("db10.dbx20.7", Cell::Db(10, 167), Bit, Bool),
            ("DB10.DBD 0", Cell::Db(10, 0), DWord, Unsigned),
        ];
        for (name, cell, width, reading) in table {
            assert_eq!(parse(name), Ok((cell, width, reading)), "{name}");
        }
    }

    #[test]
    fn cells_by_name() {
        let done = Ok((Cell::Db(20, 96), Width::DWord, Reading::Signed));
        assert_eq!(parse("DB20.DONE"), done);
        assert_eq!(parse("ledger.done"), done);
        assert_eq!(parse("DB20.PAUSE").map(|p| p.1), Ok(Width::Bit));
        assert_eq!(parse("\"Ready lamp\""), Ok((Cell::Area(Area::Output, 32), Width::Bit, Reading::Bool)));
    }

    #[test]
    fn symbols_have_the_type_of_their_table_where_it_fits_the_address() {
        let typed = |name: &str| names().typed(name).map(|t| (t.cell, t.ty));
        assert_eq!(typed("\"Level\""), Ok((Cell::Area(Area::Memory, 160), DataType::Int)));
        assert_eq!(parse("Level").map(|p| p.2), Ok(Reading::Signed));
        assert_eq!(typed("Odd"), Ok((Cell::Area(Area::Memory, 176), DataType::Word)));
        assert_eq!(typed("DB20.WHEN"), Ok((Cell::Db(20, 488), DataType::DateAndTime)));
        assert_eq!(typed("Z3"), Ok((Cell::Counter(3), DataType::Counter)));
        assert_eq!(typed("T3"), Ok((Cell::Timer(3), DataType::S5Time)));
    }

    #[test]
    fn wrong_names_say_why() {
        let table = [
            ("", "missing"),
            ("X1.0", "not the name of a cell"),
            ("M1", "needs a bit"),
            ("M1.8", "no bit 8"),
            ("MW70000", "no byte 70000"),
            ("MWx", "not the name of a cell"),
            ("MW1x", "not a valid number"),
            ("levl", "not the name of a cell"),
            ("levl", "did you mean the symbol \"Level\"?"),
            ("DB20.DON", "did you mean DB20.DONE?"),
            ("DB20.WHEN", "not a single value"),
            ("DB7.DONE", "DB7 has no component"),
            ("ä", "not the name of a cell"),
            ("Tä", "not the name of a cell"),
        ];
        for (name, part) in table {
            let error = parse(name).expect_err(name);
            assert!(error.contains(part), "{name}: {error}");
        }
    }
}
