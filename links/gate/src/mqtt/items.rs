//! The values a link publishes: those of the names in the station file, and which of them have changed.

use ob1_access::door::{Cover, Reading};
use ob1_access::{Allowed, Datum, NamedBlock, Names, Piece, Typed};
use ob1_model::{DataType, Layout};

/// Maximum of values per link.
const MOST: usize = 10_000;

/// A published value.
#[derive(Clone, Debug)]
pub(crate) struct Item {
    /// Its published name: `MW10`, `DB10.Motor.Speed`, `Start`.
    pub(crate) name: String,
    pub(crate) typed: Typed,
    place: (usize, u32, u32),
    last: Option<Vec<u8>>,
}

/// All values of a link.
#[derive(Debug, Default)]
pub(crate) struct Items {
    pub(crate) list: Vec<Item>,
    /// The pieces to watch.
    pub(crate) pieces: Vec<Piece>,
}

impl Items {
    /// Builds the values from the names of the station file: values, structures, whole data blocks. With `flat` each
    /// element of an array is a separate value.
    ///
    /// # Errors
    /// Which name is wrong and why, in one sentence.
    pub(crate) fn of(wanted: &[String], names: &Names, allowed: &Allowed, flat: bool) -> Result<Self, String> {
        let mut found = Vec::new();
        for name in wanted {
            match names.typed(name) {
                Ok(typed) => spread(&plain(name), &typed, flat, &mut found)?,
                Err(why) => {
                    let block = block(names, name).ok_or_else(|| format!("`publish`: {why}"))?;
                    for component in &block.components {
                        let name = format!("DB{}.{}", block.number, component.path);
                        let typed = names.typed(&name).map_err(|why| format!("`publish`: {why}"))?;
                        spread(&name, &typed, flat, &mut found)?;
                    }
                }
            }
        }
        if let Some((name, _)) = found.iter().find(|(_, typed)| !allowed.has(typed.cell)) {
            return Err(format!("`publish`: {name} is not among the `areas` and `blocks` of this link"));
        }
        let pieces: Vec<Piece> = found.iter().filter_map(|(_, typed)| typed.piece()).collect();
        let cover = Cover::merging(pieces.iter());
        if !cover.fits() {
            return Err("`publish` is more than a link may watch: 64 KiB; divide it among several links".into());
        }
        let place = |piece: &Piece| cover.find(piece).map_or((0, 0, 0), |(index, skip)| (index, skip, piece.len()));
        let list: Vec<Item> = found
            .into_iter()
            .zip(&pieces)
            .map(|((name, typed), piece)| Item { name, typed, place: place(piece), last: None })
            .collect();
        let mut topics: Vec<String> = list.iter().map(|item| topic(&item.name)).collect();
        topics.sort_unstable();
        if let Some(twice) = topics.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(format!("`publish`: {} would be published twice", twice[0]));
        }
        Ok(Self { list, pieces: cover.pieces().to_vec() })
    }

    /// The values of a reading that differ from the previous one, by their places; the first time all of them. `None`:
    /// there is no value now.
    pub(crate) fn changes(&mut self, reading: &Reading) -> Vec<(usize, Option<Datum>)> {
        let mut changes = Vec::new();
        for (index, item) in self.list.iter_mut().enumerate() {
            let (piece, skip, len) = item.place;
            let (from, to) = (skip as usize, (skip + len) as usize);
            // An empty slice means that the CPU does not have the cell: every value has at least one byte.
            let bytes = reading.piece(piece).ok().and_then(|bytes| bytes.get(from..to)).unwrap_or_default();
            if item.last.as_deref() == Some(bytes) {
                continue;
            }
            let before = item.value();
            let first = item.last.is_none();
            item.last = Some(bytes.to_vec());
            let now = item.value();
            // Only neighbouring bits may have changed.
            if first || before != now {
                changes.push((index, now));
            }
        }
        changes
    }
}

impl Item {
    /// Its newest value.
    pub(crate) fn value(&self) -> Option<Datum> {
        self.typed.value(self.last.as_deref()?)
    }
}

/// A name as a part of a topic.
pub(crate) fn topic(name: &str) -> String {
    name.chars().map(|c| if matches!(c, '/' | '+' | '#') || c.is_control() { '_' } else { c }).collect()
}

/// A name without quotes.
pub(crate) fn plain(name: &str) -> String {
    name.trim().trim_matches('"').to_owned()
}

fn block<'n>(names: &'n Names, name: &str) -> Option<&'n NamedBlock> {
    let bare = plain(name);
    let number = bare.get(..2).filter(|kind| kind.eq_ignore_ascii_case("DB")).and_then(|_| bare[2..].parse().ok());
    names.blocks().iter().find(|block| {
        Some(block.number) == number || block.name.as_deref().is_some_and(|own| own.eq_ignore_ascii_case(&bare))
    })
}

/// The values in a place.
fn spread(name: &str, typed: &Typed, flat: bool, found: &mut Vec<(String, Typed)>) -> Result<(), String> {
    let array = matches!(typed.ty, DataType::Array(..));
    if typed.has_value() && !(flat && array) {
        if found.len() >= MOST {
            return Err(format!("`publish` are more than {MOST} values; divide them among several links"));
        }
        found.push((name.to_owned(), typed.clone()));
        return Ok(());
    }
    let below = |name: String, bit: u32, ty: &DataType| {
        (name.clone(), Typed { name, cell: typed.cell.at_bit(typed.cell.bit() + bit), ty: ty.clone() })
    };
    let parts: Vec<(String, Typed)> = match &typed.ty {
        DataType::Struct(fields) => {
            let mut layout = Layout::new();
            fields
                .iter()
                .map(|field| below(format!("{name}.{}", field.name), layout.place(&field.ty).0, &field.ty))
                .collect()
        }
        DataType::Array(dims, element) => {
            let places = Layout::places(dims, element).into_iter().zip(0..);
            places.map(|(at, flat)| below(format!("{name}{}", Layout::index_text(dims, flat)), at.0, element)).collect()
        }
        other => return Err(format!("`publish`: {name} is a {}, which has no value", other.name())),
    };
    parts.iter().try_for_each(|(name, typed)| spread(name, typed, flat, found))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_ir::Symbol;
    use ob1_model::{BitAddr, Component, Dimension, Field};

    fn names() -> Names {
        let field = |name: &str, ty| Field { name: name.into(), ty, initial: None };
        let motor = DataType::Struct(vec![field("Speed", DataType::Int), field("On", DataType::Bool)]);
        let ramp = DataType::Array(vec![Dimension { low: 1, high: 3 }], Box::new(DataType::Int));
        let motors = DataType::Array(vec![Dimension { low: 0, high: 1 }], Box::new(motor));
        let components = vec![
            Component { path: "Motors".into(), ty: motors, at: BitAddr(0) },
            Component { path: "Ramp".into(), ty: ramp, at: BitAddr(64) },
        ];
        let block = NamedBlock { number: 10, name: Some("Press".into()), components, bytes: 14, read_only: false };
        let symbol = Symbol { name: "Start/Stop".into(), address: "M 1.0".into(), ..Symbol::default() };
        Names::of(vec![block], vec![symbol])
    }

    fn items(wanted: &[&str], flat: bool) -> Result<Vec<String>, String> {
        let wanted: Vec<String> = wanted.iter().map(|name| (*name).to_owned()).collect();
        let items = Items::of(&wanted, &names(), &Allowed::default(), flat)?;
        Ok(items.list.into_iter().map(|item| item.name).collect())
    }

    #[test]
    fn blocks_and_structures_are_their_values() {
        let whole =
            ["DB10.Motors[0].Speed", "DB10.Motors[0].On", "DB10.Motors[1].Speed", "DB10.Motors[1].On", "DB10.Ramp"];
        assert_eq!(items(&["DB10"], false).expect("right"), whole);
        assert_eq!(items(&["press"], false).expect("right"), whole);
        let flat = ["DB10.Ramp[1]", "DB10.Ramp[2]", "DB10.Ramp[3]"];
        assert_eq!(items(&["DB10.Ramp"], true).expect("right"), flat);
        assert_eq!(items(&["\"Start/Stop\"", "MW10"], false).expect("right"), ["Start/Stop", "MW10"]);
        assert_eq!(topic("Start/Stop"), "Start_Stop");
    }

    #[test]
    fn wrong_names_say_why() {
        for (wanted, why) in [
            (&["DB11"][..], "DB11"),
            (&["MW10", "MW10"], "twice"),
            (&["X"], "not the name of a cell"),
            (&["DB10.Motors[7]"], "no component"),
        ] {
            let told = items(wanted, false).expect_err("wrong");
            assert!(told.contains(why), "{wanted:?}: {told}");
        }
    }
}
