//! A GPIO chip in the station file: `[[bus]] type = "gpio"`, and its lines as a module.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::PathBuf;

use ob1_backplane::BUS_AREA_BYTES;
use ob1_coupler::gpio::{Bias, Drive, GpioConfig, GpioLine};
use ob1_host::bus::{BusModuleConfig, OnLoss, Station};
use ob1_time::Span;

use super::building::Building;
use super::findings::{ADDRESS, CONTRADICTION, Findings, MISSING, TWICE, VALUE};
use super::line::Line;
use super::remote::{LOST_AFTER, Loss, address, config, loss, substitute};
use super::tables::{BusTable, ModuleTable, Placed, RangeTable};
use super::types::ModuleConfig;
use super::values::{choice, name, number, time};

const MS: Span = Span::MILLISECOND;
/// The kernel's longest debounce period has 32 bits of microseconds; nobody debounces longer than this.
const DEBOUNCE: Span = Span::from_secs(10);
/// Lines of a request of the kernel.
const LINES: usize = 64;

/// The device of a chip: `gpiochip0`, or its path.
pub(super) fn chip(f: &mut Findings<'_>, table: &BusTable) -> Option<Line> {
    for (key, at) in table.given().filter(|(key, _)| matches!(*key, "line" | "timeout")) {
        f.error(CONTRADICTION, at, format!("a GPIO chip has no `{key}`"), "chip = \"gpiochip0\"");
    }
    let Some(chip) = &table.chip else {
        f.error(
            MISSING,
            table.kind.span(),
            "the bus has no chip",
            "add `chip = \"gpiochip0\"` (`gpiodetect` lists them)",
        );
        return None;
    };
    let text = chip.get_ref();
    let path = if text.starts_with('/') { PathBuf::from(text) } else { PathBuf::from("/dev").join(text) };
    if text.is_empty() || !text.starts_with('/') && text.contains('/') {
        f.error(VALUE, chip.span(), format!("\"{text}\" is not a chip"), "\"gpiochip0\", or the path of its device");
        return None;
    }
    Some(Line::Serial(path))
}

/// Keys of a GPIO chip's lines at a coupler.
pub(super) fn no_keys(f: &mut Findings<'_>, table: &RangeTable) {
    for (key, at) in table.given() {
        if matches!(key, "lines" | "active_low" | "bias" | "debounce" | "drive") {
            f.error(CONTRADICTION, at, format!("`{key}` belongs to the lines of a GPIO chip"), "leave it out here");
        }
    }
}

/// A piece of the process image with its lines.
struct Piece {
    first: u32,
    at: Range<usize>,
    /// In the image of the bus.
    image: usize,
    bytes: usize,
    substitute: Vec<u8>,
}

/// The modules of a chip: its first range of inputs, of outputs, and so on.
pub(super) fn modules(
    f: &mut Findings<'_>,
    table: &ModuleTable,
    bus: usize,
    building: &mut Building,
    min_cycle: Span,
) -> Vec<(ModuleConfig, [Range<usize>; 2])> {
    foreign_keys(f, table);
    let name = name(f, "module", &table.name);
    let loss = loss(f, table);
    let (input_bytes, output_bytes) = building.bytes();
    let mut taken = BTreeSet::new();
    let mut gpio = GpioConfig { name: name.clone(), ..GpioConfig::default() };
    let inputs = pieces(f, table, false, loss, (input_bytes, &mut gpio.inputs, &mut taken));
    let outputs = pieces(f, table, true, loss, (output_bytes, &mut gpio.outputs, &mut taken));
    if taken.is_empty() {
        let remedy = "inputs = [{ at = \"EB 0\", lines = [17, 27] }]";
        f.error(MISSING, table.kind.span(), "the chip has neither inputs nor outputs", remedy);
        return Vec::new();
    }
    if taken.len() > LINES {
        f.error(VALUE, table.name.span(), format!("a chip has at most {LINES} lines here"), "another bus for the rest");
    }
    gpio.chip = building.chip();
    gpio.period = time(f, table.period.as_ref(), min_cycle.clamp(MS, 100 * MS));
    if let Some(wrong) = table.period.as_ref().filter(|_| !(MS..=1000 * MS).contains(&gpio.period)) {
        f.error(VALUE, wrong.span(), "the inputs cannot be read in this period", "\"1ms\" to \"1s\"");
    }
    let diagnostic = number(f, "diagnostic", table.diagnostic.as_ref(), 1..=16_383, 0);
    let station = Station { diagnostic, number: 1, lost_after: LOST_AFTER, interrupts: false, dp: None };
    let place = building.stations();
    if !building.add_chip(gpio, station, table.diagnostic.as_ref().map(Placed::span)) {
        f.error(TWICE, table.name.span(), "the chip has a module already", "one module has all lines of a chip");
        return Vec::new();
    }
    let mut all = Vec::new();
    for (pieces, is_output) in [(inputs, false), (outputs, true)] {
        for piece in pieces {
            let name = if all.is_empty() { name.clone() } else { format!("{name}.{}", all.len() + 1) };
            let data = (piece.image, piece.bytes as u16);
            let module = BusModuleConfig {
                station: place,
                slot: (all.len() + 1).min(255) as u8,
                inputs: if is_output { (0, 0) } else { data },
                input_range: None,
                outputs: if is_output { data } else { (0, 0) },
                on_loss: if is_output { OnLoss::Zero } else { loss.with(piece.substitute) },
                speaks: all.is_empty(),
            };
            let config = config(name, (piece.first, piece.first), bus, module);
            all.push((config, [piece.at.clone(), piece.at]));
        }
    }
    all
}

/// The ranges of a direction, each with whole bytes of the image; and their lines.
fn pieces(
    f: &mut Findings<'_>,
    table: &ModuleTable,
    outputs: bool,
    loss: Loss,
    (bytes, all, taken): (&mut usize, &mut Vec<GpioLine>, &mut BTreeSet<u32>),
) -> Vec<Piece> {
    let ranges = if outputs { &table.outputs } else { &table.inputs };
    let mut pieces = Vec::new();
    for placed in ranges.iter().flat_map(|ranges| ranges.get_ref()) {
        let range = placed.get_ref();
        wrong_keys(f, range, outputs);
        let Some(lines) = range.lines.as_ref().filter(|lines| !lines.get_ref().is_empty()) else {
            f.error(MISSING, placed.span(), "`lines` is missing", "lines = [17, 27]: their numbers on the chip");
            continue;
        };
        let Some(first) = address(f, &range.at, outputs) else { continue };
        let len = lines.get_ref().len().div_ceil(8);
        if first as usize + len > BUS_AREA_BYTES {
            let message = format!("the range reaches to byte {}", first as usize + len - 1);
            f.error(ADDRESS, range.at.span(), message, format!("the last byte is {}", BUS_AREA_BYTES - 1));
            continue;
        }
        let bias = choice(f, "bias", range.bias.as_ref(), &Bias::ALL).unwrap_or_default();
        let drive = choice(f, "drive", range.drive.as_ref(), &Drive::ALL).unwrap_or_default();
        let debounce = time(f, range.debounce.as_ref(), Span::ZERO);
        if let Some(wrong) = range.debounce.as_ref().filter(|_| debounce > DEBOUNCE) {
            f.error(VALUE, wrong.span(), "`debounce` is too long", "at most \"10s\"");
        }
        let active_low = range.active_low.as_ref().is_some_and(|low| *low.get_ref());
        for (n, given) in lines.get_ref().iter().enumerate() {
            let line = number(f, "lines", Some(given), 0..=1023, 0_u32);
            if !taken.insert(line) {
                f.error(TWICE, given.span(), format!("line {line} occurs twice"), "each line is one bit");
            }
            let (at, bit) = (*bytes + n / 8, (n % 8) as u8);
            all.push(GpioLine { line, at, bit, active_low, bias, debounce, drive });
        }
        let substitute = substitute(f, range.substitute.as_ref(), placed.span(), outputs, loss, len);
        pieces.push(Piece { first, at: range.at.span(), image: *bytes, bytes: len, substitute });
        *bytes += len;
    }
    pieces
}

fn wrong_keys(f: &mut Findings<'_>, range: &RangeTable, outputs: bool) {
    let what = if outputs { "outputs" } else { "inputs" };
    for (key, at) in range.given() {
        let is_foreign = match key {
            "from" | "to" | "registers" | "bits" | "order" => true,
            "bias" | "debounce" => outputs,
            "drive" => !outputs,
            _ => false,
        };
        if is_foreign {
            let message = format!("`{key}` does not belong to {what} of a GPIO chip");
            f.error(CONTRADICTION, at, message, "leave it out here");
        }
    }
}

fn foreign_keys(f: &mut Findings<'_>, table: &ModuleTable) {
    for (key, at) in table.given() {
        match key {
            "type" | "name" | "bus" | "link" | "interface" | "inputs" | "outputs" | "period" | "on_loss"
            | "diagnostic" => {}
            _ => f.error(CONTRADICTION, at, format!("`{key}` does not belong to a GPIO chip"), "leave it out here"),
        }
    }
}
