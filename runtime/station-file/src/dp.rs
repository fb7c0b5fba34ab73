//! PROFIBUS DP in the station file: the parameters of a bus, and slaves with the modules in their slots as their GSD
//! files have them.

use std::collections::BTreeMap;
use std::ops;
use std::path::Path;

use ob1_backplane::{BUS_AREA_BYTES, BUS_COUPLERS};
use ob1_coupler::dp::{BAUD_RATES, DiagnosisField};
use ob1_coupler::{DpConfig, DpSlave};
use ob1_dp::gsd::{Gsd, Made, Mistake, Parameters, Value, Wanted};
use ob1_dp::master::least_slot_bits;
use ob1_host::bus::{BusModuleConfig, DpStation, OnLoss, Station};
use ob1_time::Span;

use super::building::{Building, BusKind};
use super::dp_master;
use super::findings::{ADDRESS, CONTRADICTION, Findings, MISSING, TWICE, UNREADABLE, VALUE};
use super::line::Line;
use super::remote::{LOST_AFTER, Loss, address, config, loss, substitute};
use super::tables::{BusTable, ModuleTable, Placed, SlotTable};
use super::types::{Bus, ModuleConfig};
use super::values::{name, number, time};
use crate::finding::nearest;

const MS: Span = Span::MILLISECOND;
/// The default baud rate.
const BAUD: u32 = 500_000;
/// The default address of the master: that of the CPU's own DP interface.
const ADDRESS_OF_MASTER: u8 = 2;
/// The highest station address.
const HSA: u8 = 126;
/// The default number of repetitions of a telegram.
const RETRIES: u8 = 3;
/// The default watchdog of the slaves.
const WATCHDOG: Span = Span::from_millis(500);
/// Longest time until data that reached a serial adapter are seen.
const ADAPTER: Span = Span::from_millis(8);
/// TSL, at most: what the standard lets a bus have.
const SLOT_BITS: u16 = 16_383;
/// What a slot time has beyond the slowest answer, in bits.
const SLOT_MARGIN: u16 = 15;
/// The longest diagnosis that is kept of each slave.
const DIAGNOSIS: usize = 244;
/// Maximum bytes of texts of a GSD file in the configuration of its process.
const TEXTS: usize = 2048;

/// The parameters of a PROFIBUS; keys of it at another bus are mistakes.
pub(super) fn bus(f: &mut Findings<'_>, table: &BusTable, kind: BusKind, line: Option<&Line>) -> Option<DpConfig> {
    if kind != BusKind::Dp {
        for (key, at) in table.given() {
            if matches!(key, "address" | "hsa" | "slot_bits" | "retries" | "watchdog") {
                f.error(CONTRADICTION, at, format!("`{key}` belongs to a bus of type \"dp\""), "leave it out here");
            }
        }
        return None;
    }
    let baud = number(f, "baud", table.baud.as_ref(), 9600..=1_500_000, BAUD);
    if let Some(given) = table.baud.as_ref().filter(|_| !BAUD_RATES.contains(&baud)) {
        let rates = BAUD_RATES.map(|rate| rate.to_string()).join(", ");
        f.error(VALUE, given.span(), format!("PROFIBUS has no {baud} bit/s"), rates);
    }
    let address = number(f, "address", table.address.as_ref(), 0..=125, ADDRESS_OF_MASTER);
    let hsa = number(f, "hsa", table.hsa.as_ref(), 1..=126, HSA);
    if hsa <= address {
        let at = table.hsa.as_ref().or(table.address.as_ref()).map_or_else(|| table.kind.span(), Placed::span);
        f.error(
            CONTRADICTION,
            at,
            format!("the master has address {address}, above `hsa`"),
            "hsa = 126 covers all addresses",
        );
    }
    let least = least_slot_bits(baud);
    // A simulated line answers in time; behind an adapter it takes a while until an answer is seen.
    let usual = match line {
        Some(Line::Sim(_)) => least,
        _ => u16::try_from(u64::from(baud) * ADAPTER / Span::SECOND).unwrap_or(SLOT_BITS).clamp(least, SLOT_BITS),
    };
    let slot_bits = number(f, "slot_bits", table.slot_bits.as_ref(), i64::from(least)..=i64::from(SLOT_BITS), usual);
    let watchdog = time(f, table.watchdog.as_ref(), WATCHDOG);
    if let Some(wrong) = table.watchdog.as_ref().filter(|_| !(10 * MS..=650_000 * MS).contains(&watchdog)) {
        f.error(VALUE, wrong.span(), "a slave has no such watchdog time", "\"10ms\" to \"650s\", in steps of 10 ms");
    }
    let retries = number(f, "retries", table.retries.as_ref(), 1..=15, RETRIES);
    Some(DpConfig { baud, address, hsa, slot_bits, retries, watchdog, slaves: Vec::new() })
}

/// A bus whose slaves are known: a round must be over well before a watchdog expires.
pub(super) fn check_bus(f: &mut Findings<'_>, bus: &Bus, at: ops::Range<usize>) {
    for dp in bus.config.lines.iter().filter_map(|line| line.dp.as_ref()) {
        let bits = |slave: &DpSlave| 11 * (slave.inputs.1 + slave.outputs.1 + 18) as u64 + 100;
        let round = dp.slaves.iter().map(bits).sum::<u64>() * Span::SECOND / u64::from(dp.baud.max(1));
        if dp.watchdog < 3 * round {
            let message = format!(
                "a round of the bus takes at least {} ms, and `watchdog` is shorter than three rounds",
                round.millis()
            );
            f.error(CONTRADICTION, at.clone(), message, "a longer `watchdog`, or a higher `baud`");
        }
    }
}

/// The modules of a slave: itself, at its diagnostic address, and one for each slot with data.
pub(super) fn modules(
    f: &mut Findings<'_>,
    table: &ModuleTable,
    bus: usize,
    building: &mut Building,
    folder: &Path,
) -> Vec<(ModuleConfig, [ops::Range<usize>; 2])> {
    foreign_keys(f, table);
    let name = name(f, "module", &table.name);
    let loss = loss(f, table);
    let Some(number_of) = &table.station else {
        f.error(MISSING, table.kind.span(), "the slave has no address", "add `station`, 0 to 125");
        return Vec::new();
    };
    let station: u8 = number(f, "station", Some(number_of), 0..=125, 0);
    let Some(gsd) = gsd(f, table, folder) else { return Vec::new() };
    let slots = slots(f, table);
    let Some(made) = made(f, table, &gsd, &slots) else { return Vec::new() };
    let Some(config) = building.dp.clone() else { return Vec::new() };
    let Some(answer_bits) = gsd.answer_bits(config.baud) else {
        let message = format!("{} cannot have {} bit/s", gsd.name(), config.baud);
        f.error(CONTRADICTION, number_of.span(), message, "another `baud` for the bus, or another slave");
        return Vec::new();
    };
    if answer_bits.saturating_add(SLOT_MARGIN) > config.slot_bits {
        let message = format!("{} may answer after {answer_bits} bits, later than `slot_bits` of the bus", gsd.name());
        f.error(CONTRADICTION, number_of.span(), message, format!("slot_bits = {}", answer_bits + SLOT_MARGIN));
    }
    let place = building.stations();
    if place >= BUS_COUPLERS {
        f.error(VALUE, table.name.span(), format!("a bus has at most {BUS_COUPLERS} modules"), "use another bus");
        return Vec::new();
    }
    let sum = |of: fn(&ob1_dp::gsd::Placed) -> usize| made.slots.iter().map(of).sum::<usize>();
    let (inputs, outputs) = (sum(|slot| slot.inputs), sum(|slot| slot.outputs));
    let (input_bytes, output_bytes) = building.bytes();
    let (first_input, first_output) = (*input_bytes, *output_bytes);
    let diagnosis = (first_input + inputs, gsd.diagnosis_bytes().min(DIAGNOSIS));
    *input_bytes += inputs + DpSlave::diagnosis_area(diagnosis.1);
    *output_bytes += outputs;
    if *input_bytes > BUS_AREA_BYTES || *output_bytes > BUS_AREA_BYTES {
        let message = format!("a bus has at most {BUS_AREA_BYTES} bytes each way, diagnoses included");
        f.error(VALUE, table.name.span(), message, "divide its modules among two buses");
    }
    let lost_after = time(f, table.lost_after.as_ref(), LOST_AFTER);
    if let Some(short) = table.lost_after.as_ref().filter(|_| lost_after < 100 * MS) {
        f.error(
            VALUE,
            short.span(),
            "`lost_after` is too short: a slave that works would be reported lost",
            "at least \"100ms\"",
        );
    }
    let (texts, fields) = texts(&gsd);
    let slave = DpSlave {
        name: name.clone(),
        station,
        ident: gsd.ident(),
        answer_bits,
        config: made.config.clone(),
        parameters: made.parameters.clone(),
        lost_after,
        inputs: (first_input, inputs),
        outputs: (first_output, outputs),
        diagnosis,
        texts,
        fields,
    };
    let diagnostic = number(f, "diagnostic", table.diagnostic.as_ref(), 1..=16_383, 0);
    let of_program = Station {
        diagnostic,
        number: station,
        lost_after,
        // Module faults of a DP slave raise OB 82, unless `diagnostics = false`.
        interrupts: building.cp.is_none() && table.diagnostics.as_ref().is_none_or(|switch| *switch.get_ref()),
        dp: Some(DpStation { diagnosis, ident: gsd.ident(), master: config.address }),
    };
    let Some(line) = building.line_of(f, table.line.as_ref(), table.kind.span(), folder) else { return Vec::new() };
    if !building.add_slave(line, slave, of_program, table.diagnostic.as_ref().map(Placed::span)) {
        let message = format!("the address {station} is taken on this bus");
        f.error(TWICE, number_of.span(), message, "each slave has an address of its own, and the master its `address`");
    }
    let behind_cp = building.cp.is_some();
    if behind_cp {
        dp_master::no_addresses(f, table);
    }
    let mut all = vec![(itself(&name, bus, place), [table.name.span(), table.name.span()])];
    let (mut input_at, mut output_at) = (first_input, first_output);
    for (slot, placed) in slots.iter().zip(&made.slots) {
        let at = Pieces { inputs: (input_at, placed.inputs), outputs: (output_at, placed.outputs) };
        (input_at, output_at) = (input_at + placed.inputs, output_at + placed.outputs);
        all.extend(of_slot(f, &name, slot, &at, (bus, place), loss));
    }
    if let Some(areas) = &mut building.cp {
        dp_master::add(f, areas, all);
        return Vec::new();
    }
    all
}

/// Where the data of a slot lie in the image of the bus.
struct Pieces {
    inputs: (usize, usize),
    outputs: (usize, usize),
}

/// The slave as a whole: nothing to read or write, but a diagnosis; [`super::building::Buses::finish`] gives its
/// address.
fn itself(name: &str, bus: usize, station: usize) -> ModuleConfig {
    let module = BusModuleConfig { station, speaks: true, ..BusModuleConfig::default() };
    config(name.to_owned(), (0, 0), bus, module)
}

fn of_slot(
    f: &mut Findings<'_>,
    name: &str,
    slot: &Placed<SlotTable>,
    at: &Pieces,
    (bus, station): (usize, usize),
    loss: Loss,
) -> Option<(ModuleConfig, [ops::Range<usize>; 2])> {
    let table = slot.get_ref();
    let mut place = |key: &str, given: Option<&Placed<String>>, bytes: usize, outputs: bool| match given {
        Some(given) if bytes == 0 => {
            let message = format!("\"{}\" has no {key}", table.module.get_ref());
            f.error(CONTRADICTION, given.span(), message, format!("leave `{key}` out"));
            None
        }
        Some(given) => {
            let first = address(f, given, outputs)?;
            if first as usize + bytes > BUS_AREA_BYTES {
                let message = format!("the {key} reach to byte {}", first as usize + bytes - 1);
                f.error(ADDRESS, given.span(), message, format!("the last byte is {}", BUS_AREA_BYTES - 1));
            }
            Some((first, given.span()))
        }
        None if bytes > 0 => {
            let example = if outputs { "AB 0" } else { "EB 0" };
            let message = format!("\"{}\" has {bytes} bytes of {key}, and no place for them", table.module.get_ref());
            f.error(MISSING, slot.span(), message, format!("add `{key} = \"{example}\"`: the first byte"));
            None
        }
        None => None,
    };
    let inputs = place("inputs", table.inputs.as_ref(), at.inputs.1, false);
    let outputs = place("outputs", table.outputs.as_ref(), at.outputs.1, true);
    let has_inputs = at.inputs.1 > 0;
    let loss_here = if has_inputs { loss } else { Loss::Zero };
    let values = substitute(f, table.substitute.as_ref(), slot.span(), !has_inputs, loss_here, at.inputs.1);
    let (first_input, at_input) = inputs.clone().or_else(|| outputs.clone())?;
    let (first_output, at_output) = outputs.or(inputs)?;
    let module = BusModuleConfig {
        station,
        slot: u8::try_from(*table.slot.get_ref()).unwrap_or(u8::MAX),
        inputs: (at.inputs.0, at.inputs.1 as u16),
        input_range: None,
        outputs: (at.outputs.0, at.outputs.1 as u16),
        on_loss: if has_inputs { loss.with(values) } else { OnLoss::Zero },
        speaks: false,
    };
    let name = format!("{name}.{}", table.slot.get_ref());
    Some((config(name, (first_input, first_output), bus, module), [at_input, at_output]))
}

fn foreign_keys(f: &mut Findings<'_>, table: &ModuleTable) {
    for (key, at) in table.given() {
        let remedy = match key {
            "unit" => "the address of a slave is `station`",
            "inputs" | "outputs" => "write them in `slots`",
            "setup" => "write the parameters of the slave in `params`",
            "watchdog_reset" | "abd" | "driver" => "leave it out here",
            "profile" => "its GSD file says what it is",
            "watchdog" => "write it in the [[bus]] table",
            "period" | "refresh" => "a slave is asked in each round of the bus",
            "address" => "`inputs` and `outputs` of each slot are its addresses",
            "input_address" => "`inputs` of each slot are its addresses",
            "output_address" => "`outputs` of each slot are its addresses",
            "bytes" | "channels" => "the GSD file says how long a module is",
            "absent" => "`on_loss` sets the values of its inputs",
            "substitute" => "write it in each slot with inputs",
            _ => continue,
        };
        f.error(CONTRADICTION, at, format!("`{key}` does not belong to a DP slave"), remedy);
    }
}

fn gsd(f: &mut Findings<'_>, table: &ModuleTable, folder: &Path) -> Option<Gsd> {
    let Some(file) = &table.gsd else {
        f.error(MISSING, table.kind.span(), "the slave has no GSD file", "add `gsd`: the file its maker gives");
        return None;
    };
    let path = folder.join(file.get_ref());
    let bytes = match ob1_process::files::read(&path, ob1_process::files::LONGEST) {
        Ok(bytes) => bytes,
        Err(error) => {
            let message = format!("the GSD file {} cannot be read: {error}", path.display());
            f.error(UNREADABLE, file.span(), message, "the path counts from the folder of the station file");
            return None;
        }
    };
    match ob1_process::log::quietly(|| Gsd::read(&bytes)) {
        Ok(gsd) => Some(gsd),
        Err(error) => {
            let message = format!("{} is not a valid GSD file: {error}", path.display());
            f.error(VALUE, file.span(), message, "get the file from the maker of the slave, in a language you read");
            None
        }
    }
}

/// The slots in their order; those that are missing or twice are mistakes.
fn slots<'a>(f: &mut Findings<'_>, table: &'a ModuleTable) -> Vec<&'a Placed<SlotTable>> {
    let mut slots: Vec<&Placed<SlotTable>> = table.slots.iter().flat_map(|slots| slots.get_ref()).collect();
    slots.sort_by_key(|slot| *slot.get_ref().slot.get_ref());
    if slots.is_empty() {
        let remedy = "slots = [{ slot = 1, module = \"its name in the GSD file\", inputs = \"EB 0\" }]";
        f.error(MISSING, table.kind.span(), "the slave has no modules", remedy);
    }
    for (slot, wanted) in slots.iter().zip(1_i64..) {
        let number = &slot.get_ref().slot;
        if *number.get_ref() != wanted {
            let message = match *number.get_ref() < wanted {
                true => format!("slot {} occurs twice, or is less than 1", number.get_ref()),
                false => format!("slot {wanted} has no module"),
            };
            let remedy = "slots count from 1 without a gap; many GSD files have a module for an empty slot";
            f.error(CONTRADICTION, number.span(), message, remedy);
            break;
        }
    }
    slots
}

/// What the GSD file makes of the slots.
fn made(f: &mut Findings<'_>, table: &ModuleTable, gsd: &Gsd, slots: &[&Placed<SlotTable>]) -> Option<Made> {
    let mut wanted = Vec::new();
    for slot in slots.iter().map(|slot| slot.get_ref()) {
        let parameters = parameters(f, slot.params.as_ref(), slot.raw.as_ref())?;
        wanted.push(Wanted { module: slot.module.get_ref().clone(), parameters });
    }
    let own = parameters(f, table.params.as_ref(), table.raw.as_ref())?;
    match gsd.slave(&wanted, &own) {
        Ok(made) => Some(made),
        Err(mistake) => {
            tell(f, table, gsd, slots, mistake);
            None
        }
    }
}

fn tell(f: &mut Findings<'_>, table: &ModuleTable, gsd: &Gsd, slots: &[&Placed<SlotTable>], mistake: Mistake) {
    let slot = mistake.slot.and_then(|n| slots.get(n)).map(|slot| slot.get_ref());
    let params = slot.map_or(table.params.as_ref(), |slot| slot.params.as_ref());
    let parameter = mistake
        .parameter
        .as_ref()
        .and_then(|name| params?.get_ref().keys().find(|key| key.get_ref() == name).map(Placed::span));
    let module = slot.map(|slot| slot.module.span());
    let at = parameter.or(module).unwrap_or_else(|| table.name.span());
    let near =
        slot.filter(|_| mistake.remedy.is_empty()).and_then(|slot| nearest(slot.module.get_ref(), gsd.modules()));
    let remedy = match near {
        Some(near) => format!("did you mean \"{near}\"?"),
        None if mistake.remedy.is_empty() => {
            let names: Vec<&str> = gsd.modules().take(12).collect();
            format!("there are {} modules in it: {}", gsd.modules().count(), names.join("; "))
        }
        None => mistake.remedy,
    };
    f.error(VALUE, at, mistake.message, remedy);
}

/// `params` by name, or all bytes as hexadecimal text.
fn parameters(
    f: &mut Findings<'_>,
    named: Option<&Placed<BTreeMap<Placed<String>, Placed<toml::Value>>>>,
    raw: Option<&Placed<String>>,
) -> Option<Parameters> {
    if let (Some(_), Some(raw)) = (named, raw) {
        f.error(
            CONTRADICTION,
            raw.span(),
            "the parameters are given twice, as `params` and as `raw`",
            "keep one of them",
        );
    }
    if let Some(raw) = raw {
        let digits = raw.get_ref().split_whitespace();
        let bytes: Option<Vec<u8>> = digits.map(|digits| u8::from_str_radix(digits, 16).ok()).collect();
        if bytes.is_none() {
            f.error(
                VALUE,
                raw.span(),
                "`raw` is not a list of bytes",
                "two hexadecimal digits each: raw = \"C0 00 08\"",
            );
        }
        return bytes.map(Parameters::Raw);
    }
    let mut all = Vec::new();
    for (name, value) in named.into_iter().flat_map(|named| named.get_ref()) {
        let value = match value.get_ref() {
            toml::Value::Integer(number) => Value::Number(*number),
            toml::Value::Boolean(on) => Value::Number(i64::from(*on)),
            toml::Value::String(text) => Value::Text(text.clone()),
            _ => {
                let remedy = "a number, or a text of the GSD file";
                f.error(
                    VALUE,
                    value.span(),
                    format!("\"{}\" cannot have a value of this type", name.get_ref()),
                    remedy,
                );
                return None;
            }
        };
        all.push((name.get_ref().clone(), value));
    }
    Some(Parameters::Named(all))
}

/// The texts of a GSD file, as many as a process can be told.
fn texts(gsd: &Gsd) -> (BTreeMap<u32, String>, Vec<DiagnosisField>) {
    let mut room = TEXTS;
    let mut fits = |bytes: usize| {
        room = room.saturating_sub(bytes + 8);
        room > 0
    };
    let texts = gsd.texts().into_iter().take_while(|(_, text)| fits(text.len())).collect();
    let bytes = |field: &DiagnosisField| 32 + field.texts.values().map(|text| text.len() + 8).sum::<usize>();
    let fields = gsd.fields().into_iter().take_while(|field| fits(bytes(field))).collect();
    (texts, fields)
}
