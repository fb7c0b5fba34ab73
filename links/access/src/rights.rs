//! What the clients of a link may do. The station file decides it, the broker enforces it.

use std::collections::BTreeSet;
use std::ops::RangeInclusive;

use ob1_model::{Area, Cell};
use serde::{Deserialize, Serialize};

/// What a client may do; each right includes the previous ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Right {
    /// Read cells and documents.
    #[default]
    Read,
    /// Write cells, besides reading.
    Write,
    /// Change the operating state, set the clock.
    Operate,
}

impl Right {
    /// By its name in a station file.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "read" => Some(Self::Read),
            "write" => Some(Self::Write),
            "operate" => Some(Self::Operate),
            _ => None,
        }
    }
}

/// The areas of a CPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
enum Place {
    Inputs,
    Outputs,
    Memory,
    Peripheral,
    Timers,
    Counters,
    Blocks,
}

impl Place {
    fn of(cell: Cell) -> Option<Self> {
        Some(match cell {
            Cell::Area(Area::Input, _) => Self::Inputs,
            Cell::Area(Area::Output, _) => Self::Outputs,
            Cell::Area(Area::Memory, _) => Self::Memory,
            Cell::Area(..) => return None,
            Cell::Peripheral(_) => Self::Peripheral,
            Cell::Timer(_) => Self::Timers,
            Cell::Counter(_) => Self::Counters,
            Cell::Db(..) => Self::Blocks,
        })
    }

    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "E" | "I" => Self::Inputs,
            "A" | "Q" => Self::Outputs,
            "M" => Self::Memory,
            "P" => Self::Peripheral,
            "T" => Self::Timers,
            "Z" | "C" => Self::Counters,
            "DB" => Self::Blocks,
            _ => return None,
        })
    }
}

/// Which cells a link's clients may touch at all.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Allowed {
    /// Areas that may be touched; `None`: all.
    areas: Option<BTreeSet<Place>>,
    /// Data blocks that may be touched; `None`: all.
    blocks: Option<Vec<RangeInclusive<u16>>>,
    /// `None`: unless cells are limited.
    program: Option<bool>,
}

impl Allowed {
    /// From the keys `areas` (`"M"`, `"DB"`, ...) and `blocks` (`"DB10"`, `"DB20-29"`); a missing key allows all.
    ///
    /// # Errors
    /// The error in an entry, in one sentence.
    pub fn of(areas: Option<&[String]>, blocks: Option<&[String]>) -> Result<Self, String> {
        let area = |name: &String| {
            Place::named(name).ok_or_else(|| format!("\"{name}\" is not an area; there are E, A, M, P, T, Z and DB"))
        };
        let block = |text: &String| {
            range(text).ok_or_else(|| format!("\"{text}\" names no data blocks; write \"DB10\" or \"DB20-29\""))
        };
        Ok(Self {
            areas: areas.map(|names| names.iter().map(area).collect()).transpose()?,
            blocks: blocks.map(|texts| texts.iter().map(block).collect()).transpose()?,
            program: None,
        })
    }

    /// With the key `program` of the link.
    #[must_use]
    pub fn with_program(self, program: Option<bool>) -> Self {
        Self { program, ..self }
    }

    /// Whether a client may see the statements of the program and, if it has the right to operate, change them. They
    /// tell and reach every cell: a link that is limited to some of them has the program only if its file says so.
    #[must_use]
    pub fn has_program(&self) -> bool {
        self.program.unwrap_or(self.areas.is_none() && self.blocks.is_none())
    }

    /// Whether a client may read this cell and, if it has the right to write, write it.
    #[must_use]
    pub fn has(&self, cell: Cell) -> bool {
        let Some(place) = Place::of(cell) else { return false };
        let area = self.areas.as_ref().is_none_or(|areas| areas.contains(&place));
        let block = match (cell, &self.blocks) {
            (Cell::Db(number, _), Some(blocks)) => blocks.iter().any(|range| range.contains(&number)),
            _ => true,
        };
        area && block
    }
}

fn range(text: &str) -> Option<RangeInclusive<u16>> {
    let numbers = text.strip_prefix("DB")?;
    let (from, to) = numbers.split_once('-').unwrap_or((numbers, numbers));
    let range = from.parse().ok()?..=to.parse().ok()?;
    (!range.is_empty()).then_some(range)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(list: &[&str]) -> Vec<String> {
        list.iter().map(|text| (*text).to_owned()).collect()
    }

    #[test]
    fn rights_include_those_below() {
        assert!(Right::Read < Right::Write && Right::Write < Right::Operate);
        let names = ["read", "write", "operate", "Operate", ""].map(Right::named);
        assert_eq!(names, [Some(Right::Read), Some(Right::Write), Some(Right::Operate), None, None]);
    }

    #[test]
    fn only_what_is_named_is_allowed() {
        let cells = [
            Cell::Area(Area::Input, 0),
            Cell::Area(Area::Output, 0),
            Cell::Area(Area::Memory, 0),
            Cell::Peripheral(0),
            Cell::Timer(1),
            Cell::Counter(1),
            Cell::Db(10, 0),
            Cell::Db(20, 0),
            Cell::Db(25, 0),
        ];
        let all = Allowed::default();
        assert!(cells.iter().all(|cell| all.has(*cell)));
        assert!(!all.has(Cell::Area(Area::Local, 0)));
        for (areas, blocks, allowed) in [
            (Some(&["M"][..]), None, vec![2]),
            (Some(&["E", "A", "T"]), None, vec![0, 1, 4]),
            (Some(&["I", "Q", "C", "P"]), None, vec![0, 1, 3, 5]),
            (Some(&["DB"]), Some(&["DB10", "DB24-26"][..]), vec![6, 8]),
            (None, Some(&["DB20"]), vec![0, 1, 2, 3, 4, 5, 7]),
            (Some(&[]), None, vec![]),
        ] {
            let made = Allowed::of(areas.map(texts).as_deref(), blocks.map(texts).as_deref()).expect("right");
            let has: Vec<usize> = (0..cells.len()).filter(|at| made.has(cells[*at])).collect();
            assert_eq!(has, allowed, "{areas:?} {blocks:?}");
        }
        let has_program = |areas: Option<&[&str]>, blocks: Option<&[&str]>, program| {
            let made = Allowed::of(areas.map(texts).as_deref(), blocks.map(texts).as_deref()).expect("right");
            made.with_program(program).has_program()
        };
        for (areas, blocks, program, has) in [
            (None, None, None, true),
            (None, None, Some(false), false),
            (Some(&["M"][..]), None, None, false),
            (None, Some(&["DB10"][..]), None, false),
            (Some(&["DB"]), Some(&["DB10"]), Some(true), true),
        ] {
            assert_eq!(has_program(areas, blocks, program), has, "{areas:?} {blocks:?} {program:?}");
        }
        for wrong in ["L", "m", "", "DB1"] {
            assert!(Allowed::of(Some(&texts(&[wrong])), None).is_err(), "{wrong}");
        }
        for wrong in ["10", "DB", "DB5-4", "DB70000", "DB1-", "M"] {
            assert!(Allowed::of(None, Some(&texts(&[wrong]))).is_err(), "{wrong}");
        }
    }
}
