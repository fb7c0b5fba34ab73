//! A bus that is being built.

use std::ops::Range;
use std::path::Path;

use ob1_coupler::gpio::GpioConfig;
use ob1_coupler::{CouplerConfig, DpConfig, DpSlave, LineConfig, Serial};
use ob1_cpu::Family;
use ob1_host::bus::{DpAreas, Station as BusStation};
use ob1_time::Span;

use super::findings::{CONTRADICTION, Findings, LINE, MISSING};
use super::line::Line;
use super::tables::Placed;
use super::types::Bus;

/// The remedy for a wrong line.
pub(super) const REMEDY: &str = "the line of a bus is \"tcp:HOST:PORT\", \"serial:DEVICE\" or \"sim:NAME\"";

/// A kind of bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BusKind {
    ModbusTcp,
    ModbusRtu,
    Dp,
    Gpio,
}

/// A bus that is being built.
pub(super) struct Building {
    pub(super) kind: BusKind,
    pub(super) serial: Option<Serial>,
    /// Bus parameters of PROFIBUS, without slaves.
    pub(super) dp: Option<DpConfig>,
    pub(super) timeout: Span,
    /// Its line, where all modules share it.
    pub(super) line: Option<Line>,
    pub(super) at: Range<usize>,
    pub(super) bus: Bus,
    /// For each coupler, in the order of the file: its line, and its place there.
    pub(super) places: Vec<(usize, usize)>,
    pub(super) diagnostics: Vec<(u16, Range<usize>)>,
    /// Where the data of its slaves lie at the CP 342-5 that it is behind.
    pub(super) cp: Option<DpAreas>,
}

/// All buses of a station file.
pub(super) struct Buses {
    pub(super) list: Vec<Building>,
    pub(super) min_cycle: Span,
    pub(super) family: Family,
}

impl Buses {
    /// The bus with this index.
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
    pub(super) fn by_line(&self) -> Vec<usize> {
        let before =
            |line: usize| self.bus.config.lines.iter().take(line).map(|line| line.stations().count()).sum::<usize>();
        self.places.iter().map(|(line, place)| before(*line) + place).collect()
    }

    /// Bytes of inputs and outputs so far.
    pub(super) const fn bytes(&mut self) -> (&mut usize, &mut usize) {
        (&mut self.bus.config.input_bytes, &mut self.bus.config.output_bytes)
    }

    /// Number of couplers and slaves so far.
    pub(super) const fn stations(&self) -> usize {
        self.bus.stations.len()
    }
}

pub(super) fn line(f: &mut Findings<'_>, text: &Placed<String>, kind: BusKind, folder: &Path) -> Option<Line> {
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
