//! Names and values of a test, resolved against a program.

use std::ops::Range;

use ob1_cpu::{Cell, Cpu, Width};
use ob1_ir::Program;
use ob1_model::{Area, Component, DataType};

use super::file::{Cells, Placed};
use super::harness::Harness;
use ob1_access::value;
use ob1_access::{Item, Names, Reading};
use ob1_station::station_file::findings::{Findings, VALUE};
use ob1_station::station_file::parse_duration;

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
    /// A STRING in a data block, by byte.
    Text(u16, usize),
}

#[derive(Clone, Debug)]
enum Wanted {
    Bits(u32),
    Near(f64, f64),
    /// A timer's remaining time, in milliseconds.
    Remaining(u64),
    Text(String),
}

/// Process outputs, as the bench holds them.
pub(super) type Outputs<'a> = &'a dyn Fn(usize, &mut [u8]);

impl Expect {
    /// What is wrong, or `None`: expected and found.
    pub(super) fn look(&self, cpu: &mut Cpu, outputs: Outputs<'_>) -> Option<(String, String)> {
        let (found, right) = match &self.place {
            Place::Text(db, at) => {
                let found = cpu.data_block(*db).and_then(|bytes| string_at(bytes, *at)).unwrap_or_default();
                let right = matches!(&self.wanted, Wanted::Text(text) if *text == found);
                (format!("'{found}'"), right)
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
                let found = remaining_ms(bits);
                (format!("{found} ms"), found == *ms)
            }
            Wanted::Text(_) => (show(item, bits), false),
        }
    }

    fn wanted_text(&self) -> String {
        match (&self.wanted, &self.place) {
            (Wanted::Bits(bits), Place::Cell(item) | Place::Output(item, _)) => show(item, *bits),
            (Wanted::Bits(bits), Place::Text(..)) => bits.to_string(),
            (Wanted::Near(value, within), _) => format!("{value} within {within}"),
            (Wanted::Remaining(ms), _) => format!("{ms} ms"),
            (Wanted::Text(text), _) => format!("'{text}'"),
        }
    }
}

/// As STL people read it: the value, and hexadecimal where that says more.
fn show(item: &Item, bits: u32) -> String {
    let value = value::to_json(item, bits);
    match item.reading {
        Reading::Unsigned => {
            let digits = usize::from(item.width.bits()).div_ceil(4);
            format!("{value} (16#{bits:0digits$X})")
        }
        _ => value.to_string(),
    }
}

/// Milliseconds of an S5TIME.
fn remaining_ms(bits: u32) -> u64 {
    let digit = |shift: u32| u64::from(bits >> shift & 0xF);
    (digit(8) * 100 + digit(4) * 10 + digit(0)) * 10u64.pow(1 + (bits >> 12 & 3))
}

/// The text of a STRING at a byte of a data block.
fn string_at(bytes: &[u8], at: usize) -> Option<String> {
    let len = usize::from(*bytes.get(at + 1)?);
    let text = bytes.get(at + 2..)?;
    Some(text.get(..len).unwrap_or(text).iter().map(|byte| char::from(*byte)).collect())
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
        if let (Some((db, byte)), toml::Value::String(text)) = (self.string(&self.full_name(name)), value) {
            return Ok((Place::Text(db, byte), Wanted::Text(text.clone())));
        }
        let mut item = self.item(name)?;
        let is_timer = matches!(item.cell, Cell::Timer(_));
        let wanted = match value {
            toml::Value::Boolean(bit) if is_timer || matches!(item.cell, Cell::Counter(_)) => {
                (item.width, item.reading) = (Width::Bit, Reading::Bool);
                Wanted::Bits(u32::from(*bit))
            }
            toml::Value::String(text) if is_timer && parse_duration(text).is_ok() => {
                Wanted::Remaining(parse_duration(text)?.millis())
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

    /// The data block and byte of a STRING.
    fn string(&self, name: &str) -> Option<(u16, usize)> {
        let (block, path) = name.split_once('.')?;
        let number = |db: &&ob1_ir::DataBlock| {
            let named = db.name.as_deref().is_some_and(|n| n.eq_ignore_ascii_case(block.trim_matches('"')));
            named || format!("DB{}", db.number).eq_ignore_ascii_case(&block.replace(' ', ""))
        };
        let db = self.program.data.iter().find(number)?;
        let component = Component::find(&db.components, path)?;
        matches!(component.ty, DataType::String(_)).then_some((db.number, (component.at.0 / 8) as usize))
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
    let json = match value {
        toml::Value::Boolean(bit) => serde_json::Value::from(*bit),
        toml::Value::Integer(number) => serde_json::Value::from(*number),
        toml::Value::Float(number) => serde_json::Value::from(*number),
        toml::Value::String(text) => serde_json::Value::from(text.as_str()),
        other => return Err(format!("a {} is not a value for {}", other.type_str(), item.name)),
    };
    value::from_json(item, &json)
}

fn wrong(f: &mut Findings<'_>, name: &Placed<String>, value: &Placed<toml::Value>, message: String) {
    let remedy = "cells are named as in STL: \"E 0.0\" = true, \"MW 4\" = 1234, \"DB5.SPEED\" = 1.5";
    f.error(VALUE, name.span().start..value.span().end, message, remedy);
}
