//! What every module behind a bus has in the station file: its bus, addresses, what it reads when it is lost.

use std::ops;

use ob1_backplane::BUS_AREA_BYTES;
use ob1_host::bus::{BusModuleConfig, OnLoss};
use ob1_time::Span;

use super::building::Buses;
use super::findings::{ADDRESS, CONTRADICTION, Findings, MISSING, VALUE};
use super::tables::{ModuleTable, Placed};
use super::types::{Absent, ModuleConfig, ModuleKind};
use super::values::{choice, number};
use crate::finding::nearest;

/// Default: a coupler that does not answer for this long is lost.
pub(super) const LOST_AFTER: Span = Span::SECOND;

/// The last byte of the process image's addresses.
pub(super) const LAST: u32 = BUS_AREA_BYTES as u32 - 1;

/// What its inputs are while they cannot be read.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Loss {
    Zero,
    Hold,
    Substitute,
}

pub(super) fn loss(f: &mut Findings<'_>, table: &ModuleTable) -> Loss {
    let losses = [("zero", Loss::Zero), ("hold", Loss::Hold), ("substitute", Loss::Substitute)];
    choice(f, "on_loss", table.on_loss.as_ref(), &losses).unwrap_or(Loss::Zero)
}

impl Loss {
    /// With the values of one piece.
    pub(super) fn with(self, substitute: Vec<u8>) -> OnLoss {
        match self {
            Self::Zero => OnLoss::Zero,
            Self::Hold => OnLoss::Hold,
            Self::Substitute => OnLoss::Substitute(substitute),
        }
    }
}

pub(super) fn bus_of(f: &mut Findings<'_>, table: &ModuleTable, buses: &Buses) -> Option<usize> {
    let Some(wanted) = &table.bus else {
        f.error(MISSING, table.kind.span(), "the module has no bus", "add `bus`: the name of a [[bus]]");
        return None;
    };
    let found = buses.of(wanted.get_ref());
    if found.is_none() {
        let remedy = match nearest(wanted.get_ref(), buses.names()) {
            Some(near) => format!("did you mean \"{near}\"?"),
            None => format!("add a table [[bus]] with name = \"{}\"", wanted.get_ref()),
        };
        f.error(VALUE, wanted.span(), format!("there is no bus \"{}\"", wanted.get_ref()), remedy);
    }
    found
}

/// The substitute values of a piece: `given`, for so many bytes; `at` is the piece.
pub(super) fn substitute(
    f: &mut Findings<'_>,
    given: Option<&Placed<Vec<Placed<i64>>>>,
    at: ops::Range<usize>,
    outputs: bool,
    loss: Loss,
    bytes: usize,
) -> Vec<u8> {
    match given {
        Some(given) if outputs || loss != Loss::Substitute => {
            let remedy = "it belongs in a range of `inputs`, with on_loss = \"substitute\"";
            f.error(CONTRADICTION, given.span(), "`substitute` has no effect here", remedy);
            Vec::new()
        }
        Some(given) => {
            if given.get_ref().len() != bytes {
                let message = format!("`substitute` has {} values for {bytes} bytes", given.get_ref().len());
                f.error(VALUE, given.span(), message, "one for each byte");
            }
            given.get_ref().iter().map(|value| number(f, "substitute", Some(value), 0..=255, 0)).collect()
        }
        None if !outputs && loss == Loss::Substitute => {
            let remedy = "add `substitute`, a byte each, or another `on_loss`";
            f.error(MISSING, at, "the range has no substitute values", remedy);
            Vec::new()
        }
        None => Vec::new(),
    }
}

/// `EB 0`, `EW 4`, `PED 256`: the first byte.
pub(super) fn address(f: &mut Findings<'_>, text: &Placed<String>, outputs: bool) -> Option<u32> {
    const INPUTS: [&str; 12] = ["EB", "EW", "ED", "PEB", "PEW", "PED", "IB", "IW", "ID", "PIB", "PIW", "PID"];
    const OUTPUTS: [&str; 12] = ["AB", "AW", "AD", "PAB", "PAW", "PAD", "QB", "QW", "QD", "PQB", "PQW", "PQD"];
    let (words, example) = if outputs { (&OUTPUTS, "AB 0") } else { (&INPUTS, "EB 0") };
    let written = text.get_ref().trim();
    let digits = written.find(|c: char| c.is_ascii_digit()).unwrap_or(written.len());
    let (word, number) = written.split_at(digits);
    let known = words.contains(&word.trim().to_ascii_uppercase().as_str());
    let number: Option<u32> = number.parse().ok().filter(|number| *number <= LAST);
    if !known || number.is_none() {
        let what = if outputs { "outputs" } else { "inputs" };
        let remedy = format!("the first byte, 0 to {LAST}: \"{example}\"");
        f.error(ADDRESS, text.span(), format!("\"{written}\" is not an address for {what}"), remedy);
    }
    number.filter(|_| known)
}

/// What the CPU sees of a part of a module on a bus.
pub(super) fn config(
    name: String,
    (input_address, output_address): (u32, u32),
    bus: usize,
    module: BusModuleConfig,
) -> ModuleConfig {
    ModuleConfig {
        name,
        input_address,
        output_address,
        absent: Absent::Fault,
        substitute: Vec::new(),
        driver: None,
        kind: ModuleKind::Remote { bus, module },
    }
}
