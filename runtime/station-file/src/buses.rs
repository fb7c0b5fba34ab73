//! Buses with remote modules: `[[bus]]`, and what their couplers add to them.

use std::collections::BTreeSet;
use std::path::Path;

use ob1_coupler::config::Parity;
use ob1_coupler::{BusConfig, Serial};
use ob1_cpu::{CpuConfig, Family};
use ob1_host::bus::{Station as BusStation, StationRules};
use ob1_time::Span;

use super::building::{Building, BusKind, Buses, REMEDY, line};
use super::findings::{CONTRADICTION, Findings, MISSING, TWICE, VALUE};
use super::tables::{BusTable, ModuleTable, Placed};
use super::types::{Bus, ModuleConfig, ModuleKind};
use super::values::{choice, name, number, time};
use super::{dp, gpio};

/// The default for the longest wait for an answer.
const TIMEOUT: Span = Span::from_millis(200);
/// The patience for a scan without a watchdog.
const PATIENCE_WITHOUT_WATCHDOG: Span = Span::from_secs(60);
impl Buses {
    pub(super) fn new(f: &mut Findings<'_>, tables: &[BusTable], cpu: &CpuConfig, folder: &Path) -> Self {
        let patience = match cpu.watchdog {
            Span::ZERO => PATIENCE_WITHOUT_WATCHDOG,
            watchdog => watchdog.times(2).max(Span::SECOND),
        };
        let scan_timeout = patience.saturating_add(cpu.min_cycle.times(2));
        let mut list: Vec<Building> = Vec::new();
        for table in tables {
            let Some(bus) = bus(f, table, folder, list.len(), scan_timeout) else { continue };
            if list.iter().any(|other| other.bus.name == bus.bus.name) {
                let message = format!("there are two buses with the name \"{}\"", bus.bus.name);
                f.error(TWICE, table.name.span(), message, "give each bus a name of its own");
            }
            list.push(bus);
        }
        Self { list, min_cycle: cpu.min_cycle, family: cpu.family }
    }

    /// All modules are known: a bus without one is an error, and diagnostic addresses that were left open are given.
    pub(super) fn finish(
        self,
        f: &mut Findings<'_>,
        tables: &[Placed<ModuleTable>],
        modules: &mut [ModuleConfig],
    ) -> Vec<Bus> {
        let of_inputs = modules.iter().flat_map(|m| m.input_address..m.input_address + u32::from(m.input_bytes()));
        let mut taken: BTreeSet<u32> = of_inputs.collect();
        let mut given: BTreeSet<u16> = BTreeSet::new();
        for (address, at) in self.list.iter().flat_map(|bus| &bus.diagnostics) {
            if !given.insert(*address) || taken.contains(&u32::from(*address)) {
                let message = format!("the diagnostic address {address} belongs to something else already");
                f.error(
                    TWICE,
                    at.clone(),
                    message,
                    "use an address that no input byte has, or leave it out: then one is chosen",
                );
            }
        }
        taken.extend(given.into_iter().map(u32::from));
        // From the top of what such a CPU has, as STEP 7 gives them.
        let top: u16 = if self.family == Family::S7_400 { 16_383 } else { 2047 };
        let mut free = (0..=top).rev().filter(|address| !taken.contains(&u32::from(*address)));
        let mut next = || free.next().unwrap_or(0);
        let mut buses = Vec::new();
        for mut building in self.list {
            building.bus.rules.diagnostic = next();
            let unnamed = building.bus.stations.iter_mut().filter(|station| station.diagnostic == 0);
            // Behind a CP no slave has an address.
            for station in unnamed.filter(|_| building.cp.is_none()) {
                station.diagnostic = next();
            }
            // A module with a mistake is not among them, and that has been said.
            let is_of = |table: &Placed<ModuleTable>| {
                table.get_ref().bus.as_ref().is_some_and(|bus| *bus.get_ref() == building.bus.name)
            };
            if building.bus.stations.is_empty() && !tables.iter().any(is_of) {
                let message = format!("the bus \"{}\" has no modules", building.bus.name);
                f.error(CONTRADICTION, building.at.clone(), message, "give it a [[module]] with `type = \"coupler\"`");
            }
            let order = building.by_line();
            for config in modules.iter_mut() {
                if let ModuleKind::DpMaster { bus, areas } = &mut config.kind
                    && *bus == buses.len()
                {
                    *areas = building.cp.take().unwrap_or_default();
                    areas.inputs.iter_mut().chain(&mut areas.outputs).for_each(|piece| {
                        piece.station = order.get(piece.station).copied().unwrap_or(piece.station);
                    });
                }
                if let ModuleKind::Remote { bus, module } = &mut config.kind
                    && *bus == buses.len()
                    && let Some(place) = order.get(module.station)
                {
                    // A slave itself lies at its diagnostic address.
                    if let Some(station) = building.bus.stations.get(module.station)
                        && station.dp.is_some()
                        && module.speaks
                    {
                        config.input_address = u32::from(station.diagnostic);
                        config.output_address = config.input_address;
                    }
                    module.station = *place;
                }
            }
            dp::check_bus(f, &building.bus, building.at.clone());
            let stations = building.bus.stations.drain(..).zip(order);
            let mut stations: Vec<(usize, BusStation)> = stations.map(|(station, place)| (place, station)).collect();
            stations.sort_by_key(|(place, _)| *place);
            building.bus.stations = stations.into_iter().map(|(_, station)| station).collect();
            buses.push(building.bus);
        }
        buses
    }
}

fn bus(f: &mut Findings<'_>, table: &BusTable, folder: &Path, index: usize, scan_timeout: Span) -> Option<Building> {
    let kinds = [
        ("modbus-tcp", BusKind::ModbusTcp),
        ("modbus-rtu", BusKind::ModbusRtu),
        ("dp", BusKind::Dp),
        ("gpio", BusKind::Gpio),
    ];
    let name = name(f, "bus", &table.name);
    let kind = choice(f, "type", Some(&table.kind), &kinds)?;
    if let Some(chip) = table.chip.as_ref().filter(|_| kind != BusKind::Gpio) {
        f.error(CONTRADICTION, chip.span(), "`chip` belongs to a bus of type \"gpio\"", "leave it out here");
    }
    let serial = serial(f, table, kind);
    let line = match &table.line {
        _ if kind == BusKind::Gpio => Some(gpio::chip(f, table)?),
        Some(text) => Some(line(f, text, kind, folder)?),
        None if kind != BusKind::ModbusTcp => {
            f.error(MISSING, table.kind.span(), "the bus has no line", format!("add `line`: {REMEDY}"));
            return None;
        }
        None => None,
    };
    let dp = dp::bus(f, table, kind, line.as_ref());
    let timeout = time(f, table.timeout.as_ref(), TIMEOUT);
    if let Some(short) = table.timeout.as_ref().filter(|_| timeout < Span::MILLISECOND) {
        f.error(VALUE, short.span(), "no coupler answers within so short a time", "at least \"1ms\"");
    }
    let config = BusConfig { name: name.clone(), scan_timeout, ..BusConfig::default() };
    // Numbers of master systems begin at 1.
    let rules = StationRules { diagnostic: 0, number: (index + 1).min(255) as u8 };
    let bus = Bus { name, rules, config, lines: Vec::new(), stations: Vec::new() };
    let (places, diagnostics) = (Vec::new(), Vec::new());
    Some(Building { kind, serial, dp, timeout, line, at: table.name.span(), bus, places, diagnostics, cp: None })
}

fn serial(f: &mut Findings<'_>, table: &BusTable, kind: BusKind) -> Option<Serial> {
    if kind != BusKind::ModbusRtu {
        for (key, at) in table.given() {
            if matches!(key, "parity" | "stop_bits") || key == "baud" && kind != BusKind::Dp {
                let message = format!("`{key}` belongs to a serial line with Modbus");
                f.error(CONTRADICTION, at, message, "leave it out here");
            }
        }
        return None;
    }
    let words = [("none", Parity::None), ("even", Parity::Even), ("odd", Parity::Odd)];
    let parity = choice(f, "parity", table.parity.as_ref(), &words).unwrap_or(Parity::Even);
    // Without a parity bit there are two stop bits: a character has 11 bits by the specification.
    let stop_bits = if parity == Parity::None { 2 } else { 1 };
    Some(Serial {
        baud: number(f, "baud", table.baud.as_ref(), 300..=4_000_000, 19_200),
        parity,
        stop_bits: number(f, "stop_bits", table.stop_bits.as_ref(), 1..=2, stop_bits),
    })
}
