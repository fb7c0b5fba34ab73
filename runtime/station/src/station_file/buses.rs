//! Buses with remote modules: `[[bus]]`, and what their couplers add to them.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::Path;

use ob1_coupler::config::Parity;
use ob1_coupler::gpio::GpioConfig;
use ob1_coupler::{BusConfig, CouplerConfig, DpConfig, DpSlave, LineConfig, Serial};
use ob1_cpu::{CpuConfig, Family};
use ob1_host::bus::{DpAreas, Station as BusStation, StationRules};
use ob1_time::Span;

use super::check::{choice, name, number, time};
use super::findings::{CONTRADICTION, Findings, LINE, MISSING, TWICE, VALUE};
use super::line::Line;
use super::tables::{BusTable, Placed};
use super::types::{Bus, ModuleConfig, ModuleKind};
use super::{dp, gpio};

/// The default for the longest wait for an answer.
const TIMEOUT: Span = Span::from_millis(200);
/// The patience for a scan without a watchdog.
const PATIENCE_WITHOUT_WATCHDOG: Span = Span::from_secs(60);
/// The remedy for a wrong line.
const REMEDY: &str = "the line of a bus is \"tcp:HOST:PORT\", \"serial:DEVICE\" or \"sim:NAME\"";

/// A kind of bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BusKind {
    ModbusTcp,
    ModbusRtu,
    Dp,
    Gpio,
}

/// A bus that is being put together.
pub(super) struct Building {
    pub(super) kind: BusKind,
    serial: Option<Serial>,
    /// Bus parameters of PROFIBUS, without slaves.
    pub(super) dp: Option<DpConfig>,
    pub(super) timeout: Span,
    /// Its line, where all modules share it.
    line: Option<Line>,
    at: Range<usize>,
    bus: Bus,
    /// For each coupler, in the order of the file: its line, and its place there.
    places: Vec<(usize, usize)>,
    diagnostics: Vec<(u16, Range<usize>)>,
    /// Where the data of its slaves lie at the CP 342-5 that it is behind.
    pub(super) cp: Option<DpAreas>,
}

/// All of them.
pub(super) struct Buses {
    list: Vec<Building>,
    pub(super) min_cycle: Span,
    family: Family,
}

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

    /// One of them.
    pub(super) fn get(&self, bus: usize) -> Option<&Building> {
        self.list.get(bus)
    }

    /// The bus of this name.
    pub(super) fn of(&self, name: &str) -> Option<usize> {
        self.list.iter().position(|bus| bus.bus.name == name)
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &str> + Clone {
        self.list.iter().map(|bus| bus.bus.name.as_str())
    }

    pub(super) fn get_mut(&mut self, bus: usize) -> Option<&mut Building> {
        self.list.get_mut(bus)
    }

    /// All modules are known: a bus without one is an error, and diagnostic addresses that were left open are given.
    pub(super) fn finish(self, f: &mut Findings<'_>, modules: &mut [ModuleConfig]) -> Vec<Bus> {
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
            if building.bus.stations.is_empty() {
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

impl Building {
    /// The line of a module: its own, or that of the bus.
    pub(super) fn line_of(
        &self,
        f: &mut Findings<'_>,
        own: Option<&Placed<String>>,
        at: Range<usize>,
        folder: &Path,
    ) -> Option<Line> {
        if let Some(own) = own {
            if self.kind != BusKind::ModbusTcp {
                f.error(
                    CONTRADICTION,
                    own.span(),
                    "`line` belongs in the [[bus]] table",
                    "all its modules share one line",
                );
                return None;
            }
            return line(f, own, self.kind, folder);
        }
        if self.line.is_none() {
            let remedy = "add `line = \"tcp:HOST:PORT\"` to the bus, or to each of its modules";
            f.error(MISSING, at, "the coupler has no line", remedy);
        }
        self.line.clone()
    }

    /// Puts a coupler on a line of the bus; the result is its place among all of them. False: its unit is taken.
    pub(super) fn add(
        &mut self,
        line: Line,
        coupler: CouplerConfig,
        station: BusStation,
        diagnostic: Option<Range<usize>>,
    ) -> bool {
        let place = self.place_of(line);
        self.keep_diagnostic(&station, diagnostic);
        let Some(on_line) = self.bus.config.lines.get_mut(place) else { return true };
        let free = on_line.couplers.iter().all(|other| other.unit != coupler.unit);
        self.places.push((place, on_line.couplers.len()));
        on_line.couplers.push(coupler);
        self.bus.stations.push(station);
        free
    }

    /// Keeps a diagnostic address of the station file, with its place there.
    fn keep_diagnostic(&mut self, station: &BusStation, diagnostic: Option<Range<usize>>) {
        self.diagnostics.extend(diagnostic.map(|at| (station.diagnostic, at)));
    }

    /// The place of a line among those of the bus.
    fn place_of(&mut self, line: Line) -> usize {
        self.bus.lines.iter().position(|other| *other == line).unwrap_or_else(|| {
            let (text, timeout) = (line.to_string(), self.timeout);
            let (serial, dp) = (self.serial, self.dp.clone());
            self.bus.config.lines.push(LineConfig {
                line: text,
                serial,
                timeout,
                couplers: Vec::new(),
                dp,
                gpio: None,
            });
            self.bus.lines.push(line);
            self.bus.lines.len() - 1
        })
    }

    /// Puts a slave on the line of the bus. False: its address is taken.
    pub(super) fn add_slave(
        &mut self,
        line: Line,
        slave: DpSlave,
        station: BusStation,
        diagnostic: Option<Range<usize>>,
    ) -> bool {
        let place = self.place_of(line);
        self.keep_diagnostic(&station, diagnostic);
        let Some(dp) = self.bus.config.lines.get_mut(place).and_then(|line| line.dp.as_mut()) else { return true };
        let free = dp.slaves.iter().all(|other| other.station != slave.station) && dp.address != slave.station;
        self.places.push((place, dp.slaves.len()));
        dp.slaves.push(slave);
        self.bus.stations.push(station);
        free
    }

    /// Puts the lines of a chip on the bus. False: it has some already.
    pub(super) fn add_chip(&mut self, gpio: GpioConfig, station: BusStation, diagnostic: Option<Range<usize>>) -> bool {
        let Some(line) = self.line.clone() else { return true };
        let place = self.place_of(line);
        self.keep_diagnostic(&station, diagnostic);
        let Some(line) = self.bus.config.lines.get_mut(place) else { return true };
        if line.gpio.is_some() {
            return false;
        }
        line.gpio = Some(gpio);
        self.places.push((place, 0));
        self.bus.stations.push(station);
        true
    }

    /// The device of its chip.
    pub(super) fn chip(&self) -> String {
        match &self.line {
            Some(Line::Serial(path)) => path.display().to_string(),
            _ => String::new(),
        }
    }

    /// The process counts couplers line by line: the place of each, in the order of the file.
    fn by_line(&self) -> Vec<usize> {
        let before =
            |line: usize| self.bus.config.lines.iter().take(line).map(|line| line.stations().count()).sum::<usize>();
        self.places.iter().map(|(line, place)| before(*line) + place).collect()
    }

    /// Bytes of inputs and outputs so far.
    pub(super) const fn bytes(&mut self) -> (&mut usize, &mut usize) {
        (&mut self.bus.config.input_bytes, &mut self.bus.config.output_bytes)
    }

    /// Couplers so far.
    pub(super) const fn stations(&self) -> usize {
        self.bus.stations.len()
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
        for (key, at) in [
            ("baud", table.baud.as_ref().filter(|_| kind != BusKind::Dp).map(Placed::span)),
            ("parity", table.parity.as_ref().map(Placed::span)),
            ("stop_bits", table.stop_bits.as_ref().map(Placed::span)),
        ] {
            if let Some(at) = at {
                f.error(
                    CONTRADICTION,
                    at,
                    format!("`{key}` belongs to a serial line with Modbus"),
                    "leave it out here",
                );
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

fn line(f: &mut Findings<'_>, text: &Placed<String>, kind: BusKind, folder: &Path) -> Option<Line> {
    match Line::parse(text.get_ref(), folder) {
        Ok(line) => {
            let fits = match kind {
                BusKind::ModbusTcp => matches!(line, Line::Tcp(_)),
                BusKind::ModbusRtu | BusKind::Dp => matches!(line, Line::Serial(_) | Line::Sim(_) | Line::Pty(_)),
                BusKind::Gpio => false,
            };
            if !fits {
                f.error(LINE, text.span(), format!("{line} cannot be the line of such a bus"), REMEDY);
            }
            fits.then_some(line)
        }
        Err(error) => {
            f.error(LINE, text.span(), error.to_string(), REMEDY);
            None
        }
    }
}
