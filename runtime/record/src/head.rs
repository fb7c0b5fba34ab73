//! The head of a recording: the station, its clocks, the signals.

use ob1_access::{Datum, Item, Names, Reading, Typed};
use ob1_model::{Area, Cell, DataType, Frame, Piece, Width};
use serde::{Deserialize, Serialize};

/// A signal: a single value of up to 32 bits.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Signal {
    /// Its name, as it was given.
    pub name: String,
    /// Where it lies: `M1.0`, `DB10.DBW4`, `T2`.
    pub address: String,
    /// Its S7 type: `BOOL`, `INT`.
    #[serde(rename = "type")]
    pub ty: String,
}

/// Elementary types, by their names.
const TYPES: [DataType; 13] = [
    DataType::Bool,
    DataType::Byte,
    DataType::Char,
    DataType::Word,
    DataType::Int,
    DataType::DWord,
    DataType::DInt,
    DataType::Real,
    DataType::S5Time,
    DataType::Time,
    DataType::Date,
    DataType::TimeOfDay,
    DataType::Counter,
];

impl Signal {
    /// A signal of an item.
    pub fn of(item: &Item) -> Self {
        Self { name: item.name.trim().into(), address: address(item.cell, item.width), ty: item.ty.name().into() }
    }

    /// Where it lies, and how its bits are read.
    ///
    /// # Errors
    /// The address or the type cannot be read: a recording of a newer ob1, or a changed one.
    pub fn item(&self) -> Result<Item, String> {
        let at = Names::default().parse(&self.address)?;
        let ty = TYPES.into_iter().find(|ty| ty.name() == self.ty);
        let ty = ty.ok_or_else(|| format!("{}: the type {} is not known", self.name, self.ty))?;
        let item = Item::of(&Typed { name: self.name.clone(), cell: at.cell, ty }).filter(|i| i.width == at.width);
        item.ok_or_else(|| format!("{}: {} does not hold a {}", self.name, self.address, self.ty))
    }
}

/// What is copied of each; a single value always has a piece.
fn pieces(items: &[Item]) -> impl Iterator<Item = Piece> {
    items.iter().filter_map(|item| item.typed().piece())
}

/// What is copied of a CPU for these items, in their order.
pub(crate) fn frame(items: &[Item]) -> Frame {
    Frame::of(pieces(items).collect::<Vec<_>>())
}

/// Whether one recording can have them all.
pub(crate) fn piece_fits(items: &[Item]) -> bool {
    ob1_model::fits_a_share(pieces(items))
}

/// A cell as [`Names`] reads it.
fn address(cell: Cell, width: Width) -> String {
    let (byte, bit) = (cell.byte(), cell.bit() % 8);
    let letter = match width {
        Width::Bit => "",
        Width::Byte => "B",
        Width::Word => "W",
        Width::DWord => "D",
    };
    let at = |area: &str| match width {
        Width::Bit => format!("{area}{byte}.{bit}"),
        _ => format!("{area}{letter}{byte}"),
    };
    match cell {
        Cell::Area(Area::Input, _) => at("I"),
        Cell::Area(Area::Output, _) => at("Q"),
        Cell::Area(..) => at("M"),
        Cell::Db(number, _) if width == Width::Bit => format!("DB{number}.DBX{byte}.{bit}"),
        Cell::Db(number, _) => format!("DB{number}.DB{letter}{byte}"),
        Cell::Peripheral(_) => at("PI"),
        Cell::Timer(number) => format!("T{number}"),
        Cell::Counter(number) => format!("C{number}"),
    }
}

/// The value of bits as a number, for conditions and diagrams: of times and durations the milliseconds.
pub fn number(item: &Item, bits: u32) -> f64 {
    match (item.reading, item.width) {
        (Reading::Real, _) => f64::from(f32::from_bits(bits)),
        (Reading::Signed, Width::Word) => f64::from(bits as u16 as i16),
        (Reading::Signed, _) => f64::from(bits as i32),
        _ => match datum(item, bits) {
            Some(Datum::Duration(ms)) => ms as f64,
            _ => f64::from(bits),
        },
    }
}

/// The value of bits by its type; `None` for a bit, and for what its type does not have.
pub fn datum(item: &Item, bits: u32) -> Option<Datum> {
    if item.width == Width::Bit {
        return None;
    }
    let bytes = bits.to_be_bytes();
    item.typed().value(bytes.get(4 - item.width.bytes() as usize..)?)
}

/// The clocks of the machine when the clock of the recording showed 0, in nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Clocks {
    /// CLOCK_MONOTONIC.
    pub monotonic_ns: u64,
    /// CLOCK_BOOTTIME.
    pub boottime_ns: u64,
    /// Since 1970 (UTC), as the clock was when the recording began.
    pub unix_ns: u64,
}

/// The head of a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Head {
    /// Name of the station.
    pub station: String,
    /// Process of its runtime; 0: there was none.
    pub pid: u32,
    /// When the recording was asked for, by its clock.
    pub begun_ns: u64,
    /// The clocks at 0.
    pub clocks: Clocks,
    /// The minimum cycle time; 0: none.
    pub min_cycle_ns: u64,
    /// What began its parts; empty: it began at once.
    pub trigger: String,
    /// History before each trigger.
    pub before_ns: u64,
    /// The signals, in the order of their columns.
    pub signals: Vec<Signal>,
}

impl Head {
    /// Where the signals lie, and how they are read.
    ///
    /// # Errors
    /// The first that cannot be read.
    pub fn items(&self) -> Result<Vec<Item>, String> {
        self.signals.iter().map(Signal::item).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_is_found_again() {
        for name in
            ["M1.0", "MB3", "MW10", "MD4", "I0.7", "QW2", "PID256", "DB10.DBX4.3", "DB10.DBW20", "T2", "C3", "DB7.DBD0"]
        {
            let item = Names::default().parse(name).expect(name);
            let signal = Signal::of(&item);
            assert_eq!(signal.item(), Ok(item.clone()), "{name}");
            assert_eq!(signal.address, name);
        }
        let item = Item { ty: DataType::Int, ..Names::default().parse("MW10").expect("a word") };
        let item = Item::of(&Typed { name: item.name, cell: item.cell, ty: DataType::Int }).expect("a number");
        let signal = Signal::of(&item);
        assert_eq!(signal.item().map(|item| item.reading), Ok(Reading::Signed));
        assert_eq!(number(&item, 0xFFFE), -2.0);
        let wrong = Signal { ty: "REAL".into(), ..signal };
        assert!(wrong.item().is_err());
        let bit = Signal { name: "b".into(), address: "M1.5".into(), ty: "BOOL".into() }.item().expect("a bit");
        assert_eq!((bit.bits(&[0x20]), bit.bits(&[0xDF])), (1, 0));
    }
}
