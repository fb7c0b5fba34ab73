//! A CP 342-5 in the station file: a bus whose slaves lie in the areas of DP_SEND and DP_RECV instead of the address
//! space of the CPU.

use std::ops::Range as Span;

use ob1_host::bus::{DP_AREA_BYTES, DpAreas, DpPiece, area_bytes};

use super::building::{BusKind, Buses};
use super::findings::{ADDRESS, CONTRADICTION, Findings, TWICE, VALUE};
use super::remote::bus_of;
use super::tables::ModuleTable;
use super::types::{ModuleConfig, ModuleKind};

/// A CP takes its bus, before its slaves are read.
pub(super) fn claim(f: &mut Findings<'_>, table: &ModuleTable, buses: &mut Buses) {
    let Some(name) = &table.bus else { return };
    let Some(building) = buses.of(name.get_ref()).and_then(|bus| buses.get_mut(bus)) else { return };
    if building.kind != BusKind::Dp {
        let message = format!("the bus \"{}\" is not a PROFIBUS", name.get_ref());
        f.error(VALUE, name.span(), message, "a CP 342-5 has a [[bus]] with type = \"dp\"");
        return;
    }
    if building.cp.replace(DpAreas::default()).is_some() {
        let message = format!("\"{}\" is the bus of another CP 342-5 already", name.get_ref());
        f.error(TWICE, name.span(), message, "give each CP a bus of its own");
    }
}

/// The module of the CP, which must belong to one bus.
pub(super) fn module(f: &mut Findings<'_>, table: &ModuleTable, buses: &Buses) -> Option<ModuleKind> {
    for (key, at) in table.given() {
        match key {
            "line" | "params" | "raw" | "bytes" | "channels" | "absent" | "abd" | "diagnostics" | "link" => {
                let remedy = "leave it out: line and parameters belong in its [[bus]] table";
                f.error(CONTRADICTION, at, format!("a CP 342-5 has no `{key}`"), remedy);
            }
            _ => {}
        }
    }
    let bus = bus_of(f, table, buses)?;
    buses.get(bus)?.cp.as_ref()?;
    Some(ModuleKind::DpMaster { bus, areas: DpAreas::default() })
}

/// Refuses keys that only a slave of the CPU itself has.
pub(super) fn no_addresses(f: &mut Findings<'_>, table: &ModuleTable) {
    for (key, at) in table.given().filter(|(key, _)| matches!(*key, "diagnostic" | "diagnostics")) {
        let message = format!("`{key}` does not belong to a slave behind a CP 342-5");
        f.error(CONTRADICTION, at, message, "leave it out: DP_DIAG reads its diagnosis");
    }
}

/// The modules of a slave become pieces of the areas.
pub(super) fn add(f: &mut Findings<'_>, areas: &mut DpAreas, modules: Vec<(ModuleConfig, [Span<usize>; 2])>) {
    for (config, [at_input, at_output]) in modules {
        let ModuleKind::Remote { module, .. } = config.kind else { continue };
        for (pieces, (image, len), first, at) in [
            (&mut areas.inputs, module.inputs, config.input_address, at_input),
            (&mut areas.outputs, module.outputs, config.output_address, at_output),
        ] {
            if len == 0 {
                continue;
            }
            let (station, on_loss) = (module.station, module.on_loss.clone());
            let piece = DpPiece { station, area: first as usize, image, len: usize::from(len), on_loss };
            let end = piece.area + piece.len;
            if end > DP_AREA_BYTES {
                let message = format!("{} reaches to byte {} of the area of its CP 342-5", config.name, end - 1);
                f.error(ADDRESS, at, message, format!("the last byte is {}", DP_AREA_BYTES - 1));
                continue;
            }
            if let Some(other) = pieces.iter().find(|other| other.area < end && piece.area < other.area + other.len) {
                let message = format!(
                    "{} overlaps bytes {} to {} of the area of its CP 342-5, which are taken",
                    config.name,
                    other.area,
                    other.area + other.len - 1
                );
                f.error(ADDRESS, at, message, format!("the first free byte is {}", area_bytes(pieces)));
                continue;
            }
            pieces.push(piece);
        }
    }
}
