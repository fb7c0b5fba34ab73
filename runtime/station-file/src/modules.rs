//! The modules of a station: addresses, parameters in both forms, lines.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::{Path, PathBuf};

use ob1_backplane::io_layout::IO_AREA_BYTES;
use ob1_params::cp240_table::CP240;
use ob1_params::{Cp240, CpKind, Flow, Interface, Protocol};

use super::building::Buses;
use super::cp_keys::{characters_of_modbus, keys_or_bytes, line_of, place_of, stop_bits_of, zeros_of};
use super::findings::{ADDRESS, CONTRADICTION, Findings, MISSING, NO_EFFECT, PARAMETER, TWICE, VALUE};
use super::tables::{ModuleTable, Placed};
use super::types::{AbdUnit, Absent, ModuleConfig, ModuleKind};
use super::values::{choice, name, number};
use super::{connection, coupler, cp040, dp_master, keyed};

/// The type of a CP 342-5 in the station file.
const DP_MASTER: &str = "cp342-5";
/// The last byte of the peripheral area.
const LAST_ADDRESS: i64 = 65_535;

#[derive(Clone, Copy, PartialEq)]
enum Type {
    Cp(CpKind),
    Coupler,
    DpMaster,
    DigitalIn,
    DigitalOut,
    AnalogIn,
    AnalogOut,
}

impl Type {
    const fn is_cp(self) -> bool {
        matches!(self, Self::Cp(_))
    }
}

/// Those besides the communication processors, which are in [`CpKind::TABLE`].
const OTHERS: [(&str, Type); 6] = [
    ("di", Type::DigitalIn),
    ("do", Type::DigitalOut),
    ("ai", Type::AnalogIn),
    ("ao", Type::AnalogOut),
    ("coupler", Type::Coupler),
    (DP_MASTER, Type::DpMaster),
];

pub(super) fn modules(
    f: &mut Findings<'_>,
    tables: &[Placed<ModuleTable>],
    buses: &mut Buses,
    folder: &Path,
) -> Vec<ModuleConfig> {
    let mut modules: Vec<ModuleConfig> = Vec::with_capacity(tables.len());
    let (mut names, mut owners) = (BTreeSet::new(), Owners::default());
    // Slaves behind a CP have no addresses in the CPU, wherever the CP is in the file.
    for table in tables.iter().map(Placed::get_ref).filter(|table| table.kind.get_ref() == DP_MASTER) {
        dp_master::claim(f, table, buses);
    }
    for placed in tables {
        let table = placed.get_ref();
        let cps = CpKind::TABLE.iter().map(|row| (row.name, Type::Cp(row.kind)));
        let types: Vec<(&str, Type)> = cps.chain(OTHERS).collect();
        let Some(ty) = choice(f, "type", Some(&table.kind), &types) else { continue };
        if let Some(given) = table.interface.as_ref().filter(|_| ty != Type::Cp(CpKind::Cp240)) {
            let remedy = "leave it out: a CP 040 has `duplex`, a CP 341 `wiring`, both in `params`";
            f.error(CONTRADICTION, given.span(), "`interface` belongs to a CP 240", remedy);
        }
        // Each with the places that say where its inputs and outputs lie.
        let built: Vec<(ModuleConfig, [Range<usize>; 2])> = match ty {
            Type::Coupler => coupler::modules(f, table, buses, folder),
            _ => {
                coupler::no_keys(f, table, ty == Type::DpMaster);
                let places = [&table.input_address, &table.output_address]
                    .map(|at| table.address.as_ref().or(at.as_ref()).map_or_else(|| table.kind.span(), Placed::span));
                module(f, table, ty, folder, buses).map(|module| (module, places)).into_iter().collect()
            }
        };
        if built.first().is_some_and(|(module, _)| names.contains(&module.name)) {
            let message = format!("there are two modules with the name \"{}\"", table.name.get_ref());
            f.error(TWICE, table.name.span(), message, "give each module a name of its own");
        }
        for (module, places) in built {
            overlaps(f, &places, &module, (&modules, &owners));
            owners.take(&module, modules.len());
            names.insert(module.name.clone());
            modules.push(module);
        }
    }
    modules
}

fn module(f: &mut Findings<'_>, table: &ModuleTable, ty: Type, folder: &Path, buses: &Buses) -> Option<ModuleConfig> {
    let kind = match ty {
        Type::Cp(CpKind::Cp240) => cp240(f, table, folder)?,
        Type::Cp(CpKind::Cp040) => cp040::module(f, table, folder)?,
        Type::Cp(kind @ (CpKind::Cp341 | CpKind::Cp340)) => keyed::module(f, table, folder, kind)?,
        Type::Cp(CpKind::Cp343) => connection::module(f, table)?,
        Type::DpMaster => dp_master::module(f, table, buses)?,
        Type::DigitalIn | Type::AnalogIn => {
            ModuleKind::Inputs { bytes: io_bytes(f, table, ty), analog: ty == Type::AnalogIn }
        }
        Type::DigitalOut | Type::AnalogOut => {
            ModuleKind::Outputs { bytes: io_bytes(f, table, ty), analog: ty == Type::AnalogOut }
        }
        // It is more than one module.
        Type::Coupler => return None,
    };
    let (input_address, output_address) = addresses(f, table, ty)?;
    let words = [("zero", Absent::Zero), ("fault", Absent::Fault)];
    let absent = choice(f, "absent", table.absent.as_ref(), &words).unwrap_or_default();
    let name = name(f, "module", &table.name);
    let substitute = substitute(f, table, ty, &kind);
    let driver = driver(f, table, ty, folder);
    Some(ModuleConfig { name, input_address, output_address, absent, substitute, driver, kind })
}

/// The program that is the driver, from the station file's folder on.
fn driver(f: &mut Findings<'_>, table: &ModuleTable, ty: Type, folder: &Path) -> Option<PathBuf> {
    let given = table.driver.as_ref()?;
    if !ty.is_cp() {
        f.error(CONTRADICTION, given.span(), "`driver` is for communication processors", "leave it out");
        return None;
    }
    let path = folder.join(given.get_ref());
    Some(std::path::absolute(&path).unwrap_or(path))
}

/// What process outputs are while nobody drives them: a byte each of `do`, a word each of `ao`.
fn substitute(f: &mut Findings<'_>, table: &ModuleTable, ty: Type, kind: &ModuleKind) -> Vec<u8> {
    let Some(given) = &table.substitute else { return Vec::new() };
    let (ModuleKind::Outputs { bytes, .. }, true) = (kind, matches!(ty, Type::DigitalOut | Type::AnalogOut)) else {
        f.error(CONTRADICTION, given.span(), "`substitute` is for `do` and `ao`", "leave it out");
        return Vec::new();
    };
    let width = if ty == Type::AnalogOut { 2 } else { 1 };
    let values = given.get_ref();
    if values.len() * width != usize::from(*bytes) {
        let wanted = usize::from(*bytes) / width;
        let message = format!("`substitute` has {} values for {wanted}", values.len());
        f.error(VALUE, given.span(), message, "one for each byte of `do`, one for each channel of `ao`");
        return Vec::new();
    }
    let mut all = Vec::new();
    for value in values {
        if width == 2 {
            all.extend(number::<i16>(f, "substitute", Some(value), -32_768..=32_767, 0).to_be_bytes());
        } else {
            all.push(number::<u8>(f, "substitute", Some(value), 0..=255, 0));
        }
    }
    all
}

/// Where the inputs and the outputs begin.
fn addresses(f: &mut Findings<'_>, table: &ModuleTable, ty: Type) -> Option<(u32, u32)> {
    let last = if ty.is_cp() { LAST_ADDRESS } else { IO_AREA_BYTES as i64 - 1 };
    let inputs = table.input_address.as_ref();
    let outputs = table.output_address.as_ref();
    if let Some(address) = &table.address {
        for other in [inputs, outputs].into_iter().flatten() {
            let remedy = "either `address` for both directions, or `input_address` and `output_address`";
            f.error(CONTRADICTION, other.span(), "the address is given twice", remedy);
        }
        let address = number(f, "address", Some(address), 0..=last, 0);
        return Some((address, address));
    }
    match ty {
        // The blocks of a CP 040 have one address.
        Type::Cp(kind) if kind != CpKind::Cp040 && inputs.is_some() && outputs.is_some() => {
            Some((number(f, "input_address", inputs, 0..=last, 0), number(f, "output_address", outputs, 0..=last, 0)))
        }
        Type::DigitalIn | Type::AnalogIn if inputs.is_some() && outputs.is_none() => {
            let address = number(f, "input_address", inputs, 0..=last, 0);
            Some((address, address))
        }
        Type::DigitalOut | Type::AnalogOut if outputs.is_some() && inputs.is_none() => {
            let address = number(f, "output_address", outputs, 0..=last, 0);
            Some((address, address))
        }
        _ => {
            let remedy = "add `address`: the module's first peripheral byte, such as address = 256";
            f.error(MISSING, table.kind.span(), "the module has no address", remedy);
            None
        }
    }
}

fn io_bytes(f: &mut Findings<'_>, table: &ModuleTable, ty: Type) -> u16 {
    for (key, at) in table.given() {
        if matches!(key, "params" | "raw" | "line" | "absent" | "abd" | "diagnostics") {
            f.error(CONTRADICTION, at, format!("`{key}` belongs to a communication processor"), "leave it out here");
        }
    }
    let analog = matches!(ty, Type::AnalogIn | Type::AnalogOut);
    let (key, value, other, max) = if analog {
        ("channels", &table.channels, &table.bytes, IO_AREA_BYTES as i64 / 2)
    } else {
        ("bytes", &table.bytes, &table.channels, IO_AREA_BYTES as i64)
    };
    if let Some(other) = other {
        let message = format!("the length of a module of this type is given by `{key}`");
        f.error(
            CONTRADICTION,
            other.span(),
            message,
            "digital modules have `bytes`, analog ones `channels` of one word",
        );
    }
    if value.is_none() {
        f.error(MISSING, table.kind.span(), format!("`{key}` is missing"), format!("add `{key}`, 1 to {max}"));
    }
    let count: u16 = number(f, key, value.as_ref(), 1..=max, 1);
    if analog { count.saturating_mul(2) } else { count }
}

fn cp240(f: &mut Findings<'_>, table: &ModuleTable, folder: &Path) -> Option<ModuleKind> {
    for (key, at) in table.given().filter(|(key, _)| matches!(*key, "bytes" | "channels")) {
        let message = format!("`{key}` cannot be chosen for a CP 240");
        f.error(CONTRADICTION, at, message, "leave it out: a CP 240 has 16 bytes each way");
    }
    let mut params = keys_or_bytes(f, table, ("CP 240", CP240), |keys| Cp240::from_keys(keys), Cp240::of_bytes)?;
    params.interface = interface_of(f, table, &params);
    characters_of_modbus(f, table, &params);
    zeros_of(f, table, CpKind::Cp240, &params);
    let line = line_of(f, table, folder, "the CP 240")?;
    stop_bits_of(f, table, &line, params.stop_bits);
    let bytes = params.encode();
    let units = [("byte", AbdUnit::Byte), ("word", AbdUnit::Word)];
    let abd = choice(f, "abd", table.abd.as_ref(), &units).unwrap_or_default();
    let diagnostics = diagnostics_of_240(f, table, &params);
    Some(ModuleKind::Cp240 { params: Box::new(params), bytes, line, abd, diagnostics })
}

/// The interface of a CP 240, and what it cannot do.
fn interface_of(f: &mut Findings<'_>, table: &ModuleTable, params: &Cp240) -> Interface {
    let Some(given) = &table.interface else { return Interface::Rs232 };
    let interface = choice(f, "interface", Some(given), &Interface::NAMES).unwrap_or_default();
    if matches!(params.protocol, Protocol::MBus | Protocol::EnOcean) {
        let message = format!("a CP 240 with \"{}\" has no RS 232, 422 or 485", params.protocol_name());
        f.error(CONTRADICTION, given.span(), message, "leave `interface` out");
    }
    match params.line_settings().flow {
        // "Hardware flow control employs the RTS and CTS lines" [S0 L2007], and here is no CTS. [S0 L1504], [S0 L1526]
        Flow::Hardware if !interface.has_modem_lines() => {
            let message = format!("`flow = \"hardware\"` needs CTS, and {} has RTS alone", interface.name());
            f.error(PARAMETER, place_of(table, "flow"), message, "`flow = \"none\"`, or `interface = \"rs232\"`");
        }
        Flow::XonXoff if interface.is_half_duplex() => {
            let message = "XON and XOFF are not heard while this CP sends: two wires are half duplex";
            f.warning(PARAMETER, place_of(table, "flow"), message, "`flow = \"none\"`, or `interface = \"rs422\"`");
        }
        _ => {}
    }
    interface
}

/// Whether its errors raise diagnostic interrupts.
fn diagnostics_of_240(f: &mut Findings<'_>, table: &ModuleTable, params: &Cp240) -> bool {
    let Some(switch) = table.diagnostics.as_ref().filter(|switch| *switch.get_ref()) else { return false };
    if !params.protocol.has_diagnostics() {
        let message = format!("`diagnostics` has no effect: a CP 240 with \"{}\" has none", params.protocol_name());
        let remedy = "leave it out; errors are in its LEDs, its counters and the answers of its handling blocks";
        f.warning(NO_EFFECT, switch.span(), message, remedy);
    }
    params.protocol.has_diagnostics()
}

/// Whose each byte of the peripheral area is: inputs, outputs.
struct Owners([Vec<Option<usize>>; 2]);

impl Default for Owners {
    fn default() -> Self {
        Self([(); 2].map(|()| vec![None; LAST_ADDRESS as usize + 1]))
    }
}

impl Owners {
    fn bytes(&self, module: &ModuleConfig, outputs: bool) -> Range<usize> {
        let (first, len) = range(module, outputs);
        let all = self.0[usize::from(outputs)].len();
        (first as usize).min(all)..(first as usize + len as usize).min(all)
    }

    /// Of the modules that have bytes of this one, the first in the file, and the first byte.
    fn shared(&self, module: &ModuleConfig, outputs: bool) -> Option<(usize, usize)> {
        let of = &self.0[usize::from(outputs)];
        self.bytes(module, outputs).filter_map(|byte| Some((of[byte]?, byte))).min()
    }

    /// The bytes that nobody has are this module's.
    fn take(&mut self, module: &ModuleConfig, index: usize) {
        for outputs in [false, true] {
            for byte in self.bytes(module, outputs) {
                self.0[usize::from(outputs)][byte].get_or_insert(index);
            }
        }
    }
}

/// Refuses a module that shares bytes with an earlier one or reaches beyond its area. The same fault of inputs and
/// outputs, at one place of the file, is told once.
fn overlaps(
    f: &mut Findings<'_>,
    places: &[Range<usize>; 2],
    module: &ModuleConfig,
    (earlier, owners): (&[ModuleConfig], &Owners),
) {
    let mut before: Option<(Range<usize>, Option<&str>)> = None;
    for outputs in [false, true] {
        let (first, len) = range(module, outputs);
        let end = first + len;
        let word = if outputs { "output" } else { "input" };
        let at = places[usize::from(outputs)].clone();
        let area = if module.kind.cp().is_some() { LAST_ADDRESS as u32 + 1 } else { IO_AREA_BYTES as u32 };
        let beyond = (len > 0 && end > area).then(|| {
            let message = format!("{} reaches from byte {first} to {}", module.name, end - 1);
            (message, format!("the last {word} byte such a module can have is {}", area - 1), None)
        });
        let shared = || {
            let (other, common) = owners.shared(module, outputs)?;
            let other = earlier.get(other)?;
            let (begin, other_len) = range(other, outputs);
            let message = format!("{word} byte {common} belongs to {} already", other.name);
            let remedy = format!("{} occupies {begin} to {}", other.name, begin + other_len - 1);
            Some((message, remedy, Some(other.name.as_str())))
        };
        let Some((message, remedy, owner)) = beyond.or_else(shared) else { continue };
        let fault = (at.clone(), owner);
        if before.as_ref() != Some(&fault) {
            f.error(ADDRESS, at, message, remedy);
        }
        before = Some(fault);
    }
}

fn range(module: &ModuleConfig, outputs: bool) -> (u32, u32) {
    if outputs {
        (module.output_address, u32::from(module.output_bytes()))
    } else {
        (module.input_address, u32::from(module.input_bytes()))
    }
}
