//! Names and values of a test, resolved against a program.

use std::ops::Range;

use ob1_cpu::{Cell, Cpu, Width};
use ob1_ir::Program;
use ob1_model::{Area, DataType, S5Time};

use super::file::{Cells, Placed};
use super::harness::Harness;
use ob1_access::{Datum, Item, Names, Reading, Typed, text, value};
use ob1_station_file::findings::{Findings, VALUE};
use ob1_station_file::parse_duration;

/// A value to be written.
#[derive(Clone, Debug)]
pub(super) struct Set {
    pub(super) item: Item,
    pub(super) value: u32,
}

/// A value to be found.
#[derive(Clone, Debug)]
pub(super) struct Expect {
    pub(super) name: String,
    /// Its place in the file.
    pub(super) at: Range<usize>,
    place: Place,
    wanted: Wanted,
}

#[derive(Clone, Debug)]
enum Place {
    Cell(Item),
    /// Process outputs as the modules have them, by byte.
    Output(Item, u32),
    /// What is more than a single value, in a data block: a STRING, a DATE_AND_TIME.
    Block(Typed),
}

#[derive(Clone, Debug)]
enum Wanted {
    Bits(u32),
    Near(f64, f64),
    /// A timer's remaining time, in milliseconds.
    Remaining(u64),
    Datum(Datum),
}

/// Process outputs, as the bench holds them.
pub(super) type Outputs<'a> = &'a dyn Fn(usize, &mut [u8]);

impl Expect {
    /// What is wrong, or `None`: expected and found.
    pub(super) fn look(&self, cpu: &mut Cpu, outputs: Outputs<'_>) -> Option<(String, String)> {
        let (found, right) = match &self.place {
            Place::Block(typed) => {
                let found = in_block(cpu, typed);
                let right = matches!((&self.wanted, &found), (Wanted::Datum(wanted), Some(found)) if wanted == found);
                let text = found.map_or_else(|| "nothing".to_owned(), |found| text::text(&typed.ty, &found));
                (text, right)
            }
            Place::Cell(item) => match cpu.read(item.cell, item.width) {
                Ok(bits) => self.judge(item, bits),
                Err(error) => (format!("nothing: {}", error), false),
            },
            Place::Output(item, byte) => {
                let mut bytes = [0; 4];
                let len = usize::from(item.width.bits().div_ceil(8));
                outputs(*byte as usize, &mut bytes[4 - len..]);
                self.judge(item, u32::from_be_bytes(bytes))
            }
        };
        (!right).then(|| (self.wanted_text(), found))
    }

    fn judge(&self, item: &Item, bits: u32) -> (String, bool) {
        let number = || value::to_json(item, bits).as_f64().unwrap_or(f64::NAN);
        match &self.wanted {
            Wanted::Bits(wanted) => (show(item, bits), *wanted == bits),
            Wanted::Near(value, within) => (show(item, bits), (number() - value).abs() <= *within),
            Wanted::Remaining(ms) => {
                (show(item, bits), S5Time(bits as u16).to_ms().is_some_and(|found| u64::from(found) == *ms))
            }
            Wanted::Datum(_) => (show(item, bits), false),
        }
    }

    fn wanted_text(&self) -> String {
        match (&self.wanted, &self.place) {
            (Wanted::Bits(bits), Place::Cell(item) | Place::Output(item, _)) => show(item, *bits),
            (Wanted::Bits(bits), Place::Block(_)) => bits.to_string(),
            (Wanted::Near(value, within), _) => format!("{value} within {within}"),
            (Wanted::Remaining(ms), _) => format!("S5T#{}", ob1_stl::duration_text(*ms as i64)),
            (Wanted::Datum(datum), Place::Block(typed)) => text::text(&typed.ty, datum),
            (Wanted::Datum(datum), _) => datum.to_string(),
        }
    }
}

/// As STL people read it: the value, and hexadecimal where that says more.
fn show(item: &Item, bits: u32) -> String {
    let value = text::of_bits(item, bits);
    match item.ty {
        DataType::Bool => (bits & 1 == 1).to_string(),
        DataType::Byte | DataType::Word | DataType::DWord => format!("{value} (16#{})", value::to_hex(item, bits)),
        _ => value,
    }
}

/// The value of a place in a data block.
fn in_block(cpu: &mut Cpu, typed: &Typed) -> Option<Datum> {
    let Cell::Db(db, bit) = typed.cell else { return None };
    typed.value(cpu.data_block(db)?.get((bit / 8) as usize..)?)
}

/// Resolves the names of one test.
pub(super) struct Resolver<'a> {
    pub(super) names: &'a Names,
    pub(super) program: &'a Program,
    pub(super) harness: Option<&'a Harness>,
}

impl Resolver<'_> {
    pub(super) fn sets(&self, cells: &Cells, only_inputs: bool, f: &mut Findings<'_>) -> Vec<Set> {
        let mut sets = Vec::with_capacity(cells.len());
        for (name, value) in cells {
            let item = self.item(name.get_ref()).and_then(|item| {
                let is_input = matches!(item.cell, Cell::Area(Area::Input, _) | Cell::Peripheral(_));
                if only_inputs && !is_input { Err(format!("{} is not an input", name.get_ref())) } else { Ok(item) }
            });
            match item.and_then(|item| Ok(Set { value: bits(&item, value.get_ref())?, item })) {
                Ok(set) => sets.push(set),
                Err(message) => wrong(f, name, value, message),
            }
        }
        sets
    }

    pub(super) fn expects(&self, cells: &Cells, f: &mut Findings<'_>) -> Vec<Expect> {
        let mut expects = Vec::with_capacity(cells.len());
        for (name, value) in cells {
            let at = name.span().start..value.span().end;
            match self.expect(name.get_ref(), value.get_ref()) {
                Ok((place, wanted)) => expects.push(Expect { name: name.get_ref().clone(), at, place, wanted }),
                Err(message) => wrong(f, name, value, message),
            }
        }
        expects.sort_by_key(|expect| expect.at.start);
        expects
    }

    fn full_name(&self, name: &str) -> String {
        self.harness.and_then(|h| h.cell(name, self.program)).unwrap_or_else(|| name.to_owned())
    }

    fn item(&self, name: &str) -> Result<Item, String> {
        let item = self.names.parse(&self.full_name(name))?;
        Ok(Item { name: name.to_owned(), ..item })
    }

    fn expect(&self, name: &str, value: &toml::Value) -> Result<(Place, Wanted), String> {
        if let Ok(typed) = self.names.typed(&self.full_name(name))
            && Item::of(&typed).is_none()
            && typed.has_value()
            && matches!(typed.cell, Cell::Db(..))
        {
            let datum = typed.datum_of(&json(name, value)?)?;
            return Ok((Place::Block(typed), Wanted::Datum(datum)));
        }
        let mut item = self.item(name)?;
        let is_timer = matches!(item.cell, Cell::Timer(_));
        let wanted = match value {
            toml::Value::Boolean(bit) if is_timer || matches!(item.cell, Cell::Counter(_)) => {
                (item.width, item.reading) = (Width::Bit, Reading::Bool);
                Wanted::Bits(u32::from(*bit))
            }
            toml::Value::String(text) if item.ty == DataType::S5Time && parse_duration(text).is_ok() => {
                Wanted::Remaining(parse_duration(text)?.millis())
            }
            // The same time may be kept in another base.
            toml::Value::String(text) if item.ty == DataType::S5Time && text.contains('#') && !text.contains("16#") => {
                Wanted::Remaining(S5Time(bits(&item, value)? as u16).to_ms().unwrap_or_default().into())
            }
            toml::Value::Table(table) => near(table)?,
            other => Wanted::Bits(bits(&item, other)?),
        };
        let letters = name.trim().to_ascii_uppercase();
        let place = match item.cell {
            Cell::Peripheral(bit) if letters.starts_with("PA") || letters.starts_with("PQ") => {
                Place::Output(item, bit / 8)
            }
            _ => Place::Cell(item),
        };
        Ok((place, wanted))
    }
}

/// `{ near = 1.5, within = 0.01 }`.
fn near(table: &toml::Table) -> Result<Wanted, String> {
    let number = |key: &str| match table.get(key) {
        Some(toml::Value::Float(number)) => Some(*number),
        Some(toml::Value::Integer(number)) => Some(*number as f64),
        _ => None,
    };
    match (number("near"), number("within"), table.len()) {
        (Some(value), Some(within), 2) => Ok(Wanted::Near(value, within)),
        _ => Err("a range is written { near = 1.5, within = 0.01 }".into()),
    }
}

fn bits(item: &Item, value: &toml::Value) -> Result<u32, String> {
    if let toml::Value::String(text) = value
        && let (DataType::S5Time | DataType::Time, Ok(time)) = (&item.ty, parse_duration(text))
    {
        let short = || text::s5time(time.millis()).ok_or_else(|| format!("{text} is longer than an S5TIME can be"));
        let long = || u32::try_from(time.millis()).map_err(|_| format!("{text} is longer than a TIME can be"));
        return if item.ty == DataType::Time { long() } else { short() };
    }
    value::from_json(item, &json(&item.name, value)?)
}

fn json(name: &str, value: &toml::Value) -> Result<serde_json::Value, String> {
    Ok(match value {
        toml::Value::Boolean(bit) => serde_json::Value::from(*bit),
        toml::Value::Integer(number) => serde_json::Value::from(*number),
        toml::Value::Float(number) => serde_json::Value::from(*number),
        toml::Value::String(text) => serde_json::Value::from(text.as_str()),
        other => return Err(format!("a {} is not a value for {name}", other.type_str())),
    })
}

fn wrong(f: &mut Findings<'_>, name: &Placed<String>, value: &Placed<toml::Value>, message: String) {
    let remedy = "cells are named as in STL: \"E 0.0\" = true, \"MW 4\" = 1234, \"DB5.SPEED\" = 1.5";
    f.error(VALUE, name.span().start..value.span().end, message, remedy);
}
