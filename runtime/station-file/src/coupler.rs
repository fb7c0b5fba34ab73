//! A Modbus coupler in the station file: where its registers and bits lie, and its set-up on connect.

use std::ops;
use std::path::Path;

use ob1_backplane::{BUS_AREA_BYTES, BUS_COUPLERS};
use ob1_coupler::image::RANGES_MAX;
use ob1_coupler::{CouplerConfig, Order, Profile, Proof, Range, Setup, Table};
use ob1_host::bus::{BusModuleConfig, OnLoss, Station};
use ob1_time::Span;

use super::building::{BusKind, Buses};
use super::findings::{ADDRESS, CONTRADICTION, Findings, MISSING, TWICE, VALUE};
use super::remote::{LAST, LOST_AFTER, Loss, address, bus_of, config, loss, substitute};
use super::tables::{ModuleTable, Placed, RangeTable, SetupTable, StationFile};
use super::types::ModuleConfig;
use super::values::{choice, name, number, time};
use super::{dp, gpio};
use crate::finding::{Finding, Level, Text};

const MS: Span = Span::MILLISECOND;
/// Outputs that do not change are written again after this time, or more often where a watchdog wants it.
const REFRESH: Span = Span::from_millis(500);
/// Unit of a coupler with a connection of its own: FFh says that the unit does not matter.
const UNIT_TCP: u8 = 255;
/// One range of the file with its bytes in the process image.
struct Placement {
    range: Range,
    first: u32,
    at: ops::Range<usize>,
    substitute: Vec<u8>,
}

/// Keys of a coupler at another module. `is_behind_bus`: that module has a bus nevertheless.
pub(super) fn no_keys(f: &mut Findings<'_>, table: &ModuleTable, is_behind_bus: bool) {
    for (key, at) in table.given() {
        match key {
            "bus" if is_behind_bus => {}
            "bus" | "unit" | "inputs" | "outputs" | "setup" | "watchdog_reset" | "profile" | "watchdog" | "period"
            | "refresh" | "lost_after" | "on_loss" | "diagnostic" | "station" | "gsd" | "slots" => {
                f.error(CONTRADICTION, at, format!("`{key}` belongs to a coupler"), "leave it out here");
            }
            _ => {}
        }
    }
}

/// The modules of a coupler: its first range of inputs with its first of outputs, and so on.
pub(super) fn modules(
    f: &mut Findings<'_>,
    table: &ModuleTable,
    buses: &mut Buses,
    folder: &Path,
) -> Vec<(ModuleConfig, [ops::Range<usize>; 2])> {
    let Some(bus) = bus_of(f, table, buses) else { return Vec::new() };
    let min_cycle = buses.min_cycle;
    let Some(building) = buses.get_mut(bus) else { return Vec::new() };
    if building.kind == BusKind::Dp {
        return dp::modules(f, table, bus, building, folder);
    }
    if building.kind == BusKind::Gpio {
        return gpio::modules(f, table, bus, building, min_cycle);
    }
    foreign_keys(f, table);
    let name = name(f, "module", &table.name);
    let unit = unit(f, table, building.kind);
    let loss = loss(f, table);
    let (input_bytes, output_bytes) = building.bytes();
    let mut inputs = placements(f, table.inputs.as_ref(), false, loss, input_bytes);
    let outputs = placements(f, table.outputs.as_ref(), true, loss, output_bytes);
    if *input_bytes > BUS_AREA_BYTES || *output_bytes > BUS_AREA_BYTES {
        let message = format!("a bus has at most {BUS_AREA_BYTES} bytes each way");
        f.error(VALUE, table.name.span(), message, "divide its modules among two buses");
    }
    let given = |tables: Option<&Placed<Vec<Placed<RangeTable>>>>| tables.is_some_and(|all| !all.get_ref().is_empty());
    if !given(table.inputs.as_ref()) && !given(table.outputs.as_ref()) {
        let remedy = "inputs = [{ at = \"EB 0\", from = \"holding:0\", registers = 4 }]";
        f.error(MISSING, table.kind.span(), "the coupler has neither inputs nor outputs", remedy);
    }
    if inputs.len() + outputs.len() > RANGES_MAX {
        let message = format!("a coupler has at most {RANGES_MAX} ranges");
        f.error(VALUE, table.name.span(), message, "join adjacent ranges");
    }
    collisions(f, &outputs);
    let times = times(f, table, min_cycle, building.timeout);
    let (setup, proof) = setup(f, table, times.watchdog);
    let config = CouplerConfig {
        name: name.clone(),
        unit,
        period: times.period,
        refresh: times.refresh,
        lost_after: times.lost_after,
        setup,
        proof,
        inputs: inputs.iter().map(|placement| placement.range).collect(),
        outputs: outputs.iter().map(|placement| placement.range).collect(),
    };
    let diagnostic = number(f, "diagnostic", table.diagnostic.as_ref(), 1..=16_383, 0);
    let station = Station {
        diagnostic,
        // On connections of their own, units may be alike.
        number: match building.kind {
            BusKind::ModbusRtu => unit,
            _ => (building.stations() + 1).min(255) as u8,
        },
        lost_after: times.lost_after,
        interrupts: table.diagnostics.as_ref().is_some_and(|switch| *switch.get_ref()),
        dp: None,
    };
    let place = building.stations();
    if place >= BUS_COUPLERS {
        let message = format!("a bus has at most {BUS_COUPLERS} couplers");
        f.error(VALUE, table.name.span(), message, "put it on another bus");
        return Vec::new();
    }
    let Some(line) = building.line_of(f, table.line.as_ref(), table.kind.span(), folder) else { return Vec::new() };
    if !building.add(line, config, station, table.diagnostic.as_ref().map(Placed::span)) {
        let at = table.unit.as_ref().map_or_else(|| table.kind.span(), Placed::span);
        let remedy = "each coupler on a line has a unit of its own";
        f.error(TWICE, at, format!("there is a coupler with unit {unit} on this line already"), remedy);
    }
    let count = inputs.len().max(outputs.len());
    let (mut inputs, mut outputs) = (inputs.drain(..).enumerate(), outputs.iter());
    let one = |n: usize| {
        let (input, output) = (inputs.next(), outputs.next());
        one(&name, n, bus, place, loss, input, output)
    };
    (0..count).map(one).collect()
}

/// One module of a coupler.
fn one(
    name: &str,
    n: usize,
    bus: usize,
    station: usize,
    loss: Loss,
    input: Option<(usize, Placement)>,
    output: Option<&Placement>,
) -> (ModuleConfig, [ops::Range<usize>; 2]) {
    let at = |placement: Option<&Placement>| placement.map(|placement| (placement.first, placement.at.clone()));
    let (of_inputs, of_outputs) = (at(input.as_ref().map(|(_, input)| input)), at(output));
    let (first_input, at_input) = of_inputs.clone().or_else(|| of_outputs.clone()).unwrap_or_default();
    let (first_output, at_output) = of_outputs.or(of_inputs).unwrap_or_default();
    let bytes = |range: &Range| (range.at, range.bytes() as u16);
    let module = BusModuleConfig {
        station,
        slot: (n + 1) as u8,
        inputs: input.as_ref().map_or((0, 0), |(_, input)| bytes(&input.range)),
        input_range: input.as_ref().map(|(range, _)| *range),
        outputs: output.map_or((0, 0), |output| bytes(&output.range)),
        on_loss: input.map_or(OnLoss::Zero, |(_, input)| loss.with(input.substitute)),
        speaks: n == 0,
    };
    let name = if n == 0 { name.to_owned() } else { format!("{name}.{}", n + 1) };
    let config = config(name, (first_input, first_output), bus, module);
    (config, [at_input, at_output])
}

fn foreign_keys(f: &mut Findings<'_>, table: &ModuleTable) {
    for (key, at) in table.given() {
        let remedy = match key {
            "address" | "input_address" | "output_address" => "`at` of each range is its address",
            "bytes" => "`registers` or `bits` of each range say how long it is",
            "channels" => "`registers` of each range say how long it is",
            "params" | "raw" => "write the registers to set on connect in `setup`",
            "absent" => "`on_loss` sets the values of its inputs",
            "abd" | "driver" => "leave it out here",
            "substitute" => "write it in each range of `inputs`",
            "station" => "it is the address of a DP slave; a coupler has `unit`",
            "gsd" => "leave it out: only a DP slave has a GSD file",
            "slots" => "leave it out: only a DP slave has slots",
            _ => continue,
        };
        f.error(CONTRADICTION, at, format!("`{key}` does not belong to a coupler"), remedy);
    }
}

fn unit(f: &mut Findings<'_>, table: &ModuleTable, kind: BusKind) -> u8 {
    match kind {
        BusKind::ModbusTcp | BusKind::Dp | BusKind::Gpio => number(f, "unit", table.unit.as_ref(), 0..=255, UNIT_TCP),
        BusKind::ModbusRtu => {
            if table.unit.is_none() {
                f.error(MISSING, table.kind.span(), "the coupler has no address on the line", "add `unit`, 1 to 247");
            }
            number(f, "unit", table.unit.as_ref(), 1..=247, 1)
        }
    }
}

struct Times {
    period: Span,
    refresh: Span,
    lost_after: Span,
    watchdog: Option<(Profile, Span)>,
}

fn times(f: &mut Findings<'_>, table: &ModuleTable, min_cycle: Span, timeout: Span) -> Times {
    let lost_after = time(f, table.lost_after.as_ref(), LOST_AFTER);
    if let Some(short) = table.lost_after.as_ref().filter(|_| lost_after < 100 * MS || lost_after < timeout) {
        let remedy = "at least \"100ms\", and longer than the `timeout` of the bus";
        f.error(VALUE, short.span(), "`lost_after` is too short: a coupler that works would be reported lost", remedy);
    }
    let period = time(f, table.period.as_ref(), min_cycle.clamp(MS, (lost_after / 4).max(MS)));
    if let Some(long) = table.period.as_ref().filter(|_| period.is_zero() || period > lost_after / 2) {
        let remedy = "more than 0, and at most half of `lost_after`";
        f.error(CONTRADICTION, long.span(), "the inputs cannot be read in this period", remedy);
    }
    let watchdog = watchdog(f, table);
    let longest = watchdog.map_or(lost_after, |(_, watchdog)| watchdog.min(lost_after));
    let refresh = time(f, table.refresh.as_ref(), REFRESH.min(longest / 3));
    if let Some(long) = table.refresh.as_ref().filter(|_| refresh < MS || refresh > longest / 2) {
        let remedy = "at least \"1ms\", and at most half of `watchdog` and of `lost_after`";
        f.error(CONTRADICTION, long.span(), "`refresh` is out of range", remedy);
    }
    Times { period, refresh: refresh.max(MS), lost_after, watchdog }
}

fn profile(f: &mut Findings<'_>, table: &ModuleTable) -> Option<Profile> {
    choice(f, "profile", table.profile.as_ref(), &Profile::ALL)
}

fn watchdog(f: &mut Findings<'_>, table: &ModuleTable) -> Option<(Profile, Span)> {
    let given = table.watchdog.as_ref()?;
    let wanted = time(f, Some(given), Span::ZERO);
    let Some(profile) = profile(f, table) else {
        let names = Profile::ALL.map(|(name, _)| format!("\"{name}\"")).join(", ");
        let remedy = format!("`profile` says which registers set it: {names}; for others write them in `setup`");
        f.error(MISSING, given.span(), "the watchdog of an unknown coupler cannot be set", remedy);
        return None;
    };
    match profile.times() {
        Some(times) if times.contains(&wanted) => Some((profile, wanted)),
        Some(times) => {
            let remedy = format!("{} ms to {} ms", times.start().millis(), times.end().millis());
            f.error(VALUE, given.span(), "this coupler has no such watchdog time", remedy);
            None
        }
        None => {
            let remedy = "set it on the coupler itself, and leave `watchdog` out";
            f.error(CONTRADICTION, given.span(), "the watchdog of this coupler cannot be set over Modbus", remedy);
            None
        }
    }
}

/// What is written on connect: the release of the coupler, its watchdog, what the file says; and how to see that the
/// watchdog runs already.
fn setup(f: &mut Findings<'_>, table: &ModuleTable, watchdog: Option<(Profile, Span)>) -> (Vec<Setup>, Option<Proof>) {
    let mut all = match &table.watchdog_reset {
        Some(given) => writes(f, given),
        None if table.watchdog.is_some() && watchdog.is_none() => Vec::new(),
        None => profile(f, table).map(Profile::reset).unwrap_or_default(),
    };
    let mut proof = None;
    if let Some((profile, time)) = watchdog {
        all.extend(profile.watchdog(time));
        proof = profile.proof(time, all.len());
    }
    all.extend(table.setup.as_ref().map(|given| writes(f, given)).unwrap_or_default());
    (all, proof)
}

fn writes(f: &mut Findings<'_>, tables: &Placed<Vec<Placed<SetupTable>>>) -> Vec<Setup> {
    let mut all = Vec::new();
    for table in tables.get_ref().iter().map(Placed::get_ref) {
        let Some((target, at)) = element(f, &table.to) else { continue };
        if !target.can_be_written() {
            f.error(VALUE, table.to.span(), format!("`{}` cannot be written", target.name()), "holding:N or coil:N");
            continue;
        }
        let most = if target.has_bits() { 1 } else { 65_535 };
        all.push(Setup { table: target, at, value: number(f, "value", Some(&table.value), 0..=most, 0) });
    }
    all
}

/// Table and number of an element: `holding:100`.
fn element(f: &mut Findings<'_>, text: &Placed<String>) -> Option<(Table, u16)> {
    let remedy = "holding:N, input:N, coil:N or discrete:N, counted from 0";
    let (word, at) = text.get_ref().split_once(':').unwrap_or((text.get_ref(), ""));
    let table = Table::ALL.iter().find(|(name, _)| *name == word).map(|(_, table)| *table);
    let at = at.trim();
    let number = match at.strip_prefix("16#").or_else(|| at.strip_prefix("0x")) {
        Some(digits) => u16::from_str_radix(digits, 16).ok(),
        None => at.parse().ok(),
    };
    if table.is_none() || number.is_none() {
        f.error(VALUE, text.span(), format!("\"{}\" is not a register or bit of a coupler", text.get_ref()), remedy);
    }
    table.zip(number)
}

fn placements(
    f: &mut Findings<'_>,
    tables: Option<&Placed<Vec<Placed<RangeTable>>>>,
    outputs: bool,
    loss: Loss,
    bytes: &mut usize,
) -> Vec<Placement> {
    let mut all = Vec::new();
    for placed in tables.into_iter().flat_map(|tables| tables.get_ref()) {
        if let Some(mut placement) = placement(f, placed, outputs, loss) {
            placement.range.at = *bytes;
            *bytes += placement.range.bytes();
            all.push(placement);
        }
    }
    all
}

fn placement(f: &mut Findings<'_>, placed: &Placed<RangeTable>, outputs: bool, loss: Loss) -> Option<Placement> {
    let table = placed.get_ref();
    gpio::no_keys(f, table);
    let (key, wanted, other) = if outputs { ("to", &table.to, &table.from) } else { ("from", &table.from, &table.to) };
    if let Some(other) = other {
        f.error(CONTRADICTION, other.span(), "inputs come `from`, outputs go `to`", format!("write `{key}`"));
    }
    let Some(wanted) = wanted else {
        f.error(MISSING, placed.span(), format!("`{key}` is missing"), format!("{key} = \"holding:0\""));
        return None;
    };
    let (source, first) = element(f, wanted)?;
    if outputs && !source.can_be_written() {
        f.error(VALUE, wanted.span(), format!("`{}` cannot be written", source.name()), "holding:N or coil:N");
        return None;
    }
    let bits = source.has_bits();
    let (key, count, other) =
        if bits { ("bits", &table.bits, &table.registers) } else { ("registers", &table.registers, &table.bits) };
    if let Some(other) = other {
        let message = format!("`{}` is counted in `{key}`", source.name());
        f.error(CONTRADICTION, other.span(), message, "`bits` for coil and discrete, `registers` for the others");
    }
    let Some(count) = count else {
        f.error(MISSING, placed.span(), format!("`{key}` is missing"), format!("add `{key}`: how many"));
        return None;
    };
    let most = 65_536 - i64::from(first);
    let count = number(f, key, Some(count), 1..=most.min(65_535), 1_u16);
    let order = choice(f, "order", table.order.as_ref(), &Order::ALL).unwrap_or_default();
    if let Some(order) = table.order.as_ref().filter(|_| bits) {
        f.error(CONTRADICTION, order.span(), "bits have no order of bytes", "leave it out here");
    }
    let range = Range { table: source, first, count, order, at: 0 };
    let first = address(f, &table.at, outputs)?;
    if first + range.bytes() as u32 > LAST + 1 {
        let message = format!("the range reaches to byte {}", first + range.bytes() as u32 - 1);
        f.error(ADDRESS, table.at.span(), message, format!("the last byte is {LAST}"));
        return None;
    }
    let given = placed.get_ref().substitute.as_ref();
    let substitute = substitute(f, given, placed.span(), outputs, loss, range.bytes());
    Some(Placement { range, first, at: table.at.span(), substitute })
}

/// Two outputs that would be written to one element.
fn collisions(f: &mut Findings<'_>, outputs: &[Placement]) {
    for (n, output) in outputs.iter().enumerate() {
        let meets = |other: &&Placement| {
            let (a, b) = (&output.range, &other.range);
            a.table == b.table && u32::from(a.first) < b.end() && u32::from(b.first) < a.end()
        };
        if let Some(other) = outputs.iter().take(n).find(meets) {
            let (table, first) = (output.range.table.name(), output.range.first.max(other.range.first));
            let remedy = "each register and coil is written from one place";
            f.error(TWICE, output.at.clone(), format!("{table}:{first} is written by two outputs"), remedy);
        }
    }
}

/// A warning for each coupler with outputs and without a watchdog that is known to be set.
pub(super) fn unwatched(file: &StationFile, source: Text<'_>) -> Vec<Finding> {
    let couplers = file.module.iter().map(Placed::get_ref).filter(|table| table.kind.get_ref() == "coupler");
    let open = couplers.filter(|table| {
        table.outputs.as_ref().is_some_and(|outputs| !outputs.get_ref().is_empty()) && table.watchdog.is_none()
    });
    open.map(|table| {
        let message =
            format!("nothing switches the outputs of {} off when its connection to ob1 is lost", table.name.get_ref());
        let remedy = "add `profile` and `watchdog` (docs/io.md), or set a watchdog on the coupler itself";
        source.finding(Level::Warning, VALUE, table.name.span(), message, remedy.to_owned())
    })
    .collect()
}
