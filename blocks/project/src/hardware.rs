//! Stations, CPUs and modules with their addresses, as the hardware configuration keeps them.
//!
//! Objects lie in tables of their own by kind of module (`hOmSave7/*/HOBJECT1.DBF`), their addresses and parameters in
//! `HATTRME1`, their place in the plant in their unit: module, rack, station. What the attributes mean was found out
//! by comparing projects (`docs/import.md`); what is not known is not used.

use std::collections::BTreeMap;

use crate::cpu_parameters::{self, CpuParameters};
use crate::dbf::{Memos, Table};
use crate::note::{Note, Notes};
use crate::profibus::{self, DpSystem};
use crate::text::CodePage;
use crate::tree::{Files, Tree};
use crate::write::{Cell, TableWriter};

/// The hardware of a project.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Hardware {
    /// The CPUs.
    pub cpus: Vec<Cpu>,
    /// Modules with addresses, CPUs left out.
    pub modules: Vec<Module>,
    /// DP master systems; their modules are among the modules too.
    pub dp: Vec<DpSystem>,
}

/// A CPU.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cpu {
    /// Its name: `CPU 315-2 DP`.
    pub name: String,
    /// The station it is in.
    pub station: String,
    /// The program it has.
    pub program: Option<i64>,
    /// What it is set to.
    pub parameters: CpuParameters,
}

/// A module.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Module {
    /// Its name: `DI16xDC24V`.
    pub name: String,
    /// Its order number, as far as the catalogue's name has it: `6ES7 321-1BH02-0AA`.
    pub order: String,
    /// The station it is in.
    pub station: String,
    /// Rack, slot and submodule; a device on a bus has its number as rack.
    pub place: (i64, i64, i64),
    /// Its areas of inputs: first byte and length.
    pub inputs: Vec<Area>,
    /// Its areas of outputs.
    pub outputs: Vec<Area>,
}

/// Addresses of a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Area {
    /// The first byte.
    pub first: u32,
    /// Bytes.
    pub bytes: u32,
}

/// Attributes of HATTRME1 and HATTRIB1.
pub(crate) const INPUT_ADDRESSES: i64 = 110_981;
pub(crate) const OUTPUT_ADDRESSES: i64 = 110_983;
const CPU_PARAMETERS: i64 = 110_717;
const CATALOGUE: i64 = 4_098;
/// The relation of a CPU to its program, and the object type of a program.
const HAS_PROGRAM: i64 = 16;
const PROGRAM: i64 = 1_327_361;
/// The unit type of stations: the project.
const IN_PROJECT: i64 = 1_122_305;
/// Objects within each other: module, rack, station; a submodule of a device on a bus of a bus has some more.
const DEEPEST: usize = 16;

/// Objects by their type and ID.
pub(crate) type Objects = BTreeMap<(i64, i64), Object>;
/// Of a DP master system the interface of its master.
pub(crate) type Interfaces = BTreeMap<(i64, i64), (i64, i64)>;

/// An object of any kind, with what is known of it.
#[derive(Default)]
pub(crate) struct Object {
    pub(crate) name: String,
    pub(crate) unit: (i64, i64),
    pub(crate) place: (i64, i64, i64),
    pub(crate) order: String,
    program: Option<i64>,
    pub(crate) inputs: Vec<Area>,
    pub(crate) outputs: Vec<Area>,
    /// The first of its diagnostic addresses.
    pub(crate) diagnostic: Option<u16>,
    parameters: Vec<u8>,
    /// Of a slave's module: its name in the GSD file, its identifier.
    pub(crate) gsd: String,
    pub(crate) identifier: Vec<u8>,
    /// Of a slave: its user parameters.
    pub(crate) user: Vec<u8>,
    /// Of a master system: its subnet.
    pub(crate) subnet: String,
}

/// Reads the hardware of the project at `root`.
pub(crate) fn read(tree: &Tree<'_>, root: &str, page: CodePage, notes: &mut Notes) -> Hardware {
    let base = format!("{root}hOmSave7/");
    let (mut objects, mut interfaces) = (Objects::new(), Interfaces::new());
    for part in tree.list(&base) {
        read_kind(tree, &format!("{base}{part}/"), page, (&mut objects, &mut interfaces), notes);
    }
    let station = |object: &Object| {
        let mut unit = object.unit;
        for _ in 0..DEEPEST {
            match objects.get(&unit) {
                Some(above) if above.unit.0 == IN_PROJECT => return above.name.clone(),
                Some(above) => unit = above.unit,
                None => break,
            }
        }
        String::new()
    };
    let mut hardware = Hardware::default();
    for object in objects.values() {
        if object.program.is_some() || !object.parameters.is_empty() {
            hardware.cpus.push(Cpu {
                name: object.name.clone(),
                station: station(object),
                program: object.program,
                parameters: cpu_parameters::read(&object.parameters),
            });
        } else if !object.inputs.is_empty() || !object.outputs.is_empty() {
            hardware.modules.push(Module {
                name: object.name.clone(),
                order: object.order.clone(),
                station: station(object),
                place: object.place,
                inputs: object.inputs.clone(),
                outputs: object.outputs.clone(),
            });
        }
    }
    hardware.dp = profibus::systems(&objects, &interfaces, station);
    hardware.modules.sort_by(|a, b| (&a.station, a.place).cmp(&(&b.station, b.place)));
    hardware
}

fn read_kind(
    tree: &Tree<'_>,
    folder: &str,
    page: CodePage,
    (objects, interfaces): (&mut Objects, &mut Interfaces),
    notes: &mut Notes,
) {
    let table = |name: &str, notes: &mut Notes| {
        let path = format!("{folder}{name}.DBF");
        match Table::parse(tree.read(&path)?) {
            Ok(table) => Some(table),
            Err(damage) => {
                notes.push(Note::warning(path, damage.to_string()));
                None
            }
        }
    };
    let Some(list) = table("HOBJECT1", notes) else { return };
    // The attribute tables name an object by its ID alone: those of one folder.
    let mut here: Vec<(i64, (i64, i64))> = Vec::new();
    for row in list.rows() {
        let (id, ty) = (row.number("ID"), row.number("OBJTYP"));
        here.push((id, (ty, id)));
        let object = Object {
            name: page.text(row.trimmed("NAME")),
            unit: (row.number("UNITTYP"), row.number("UNITID")),
            place: (row.number("SUBSTATN"), row.number("MODULN"), row.number("SUBMODN")),
            ..Object::default()
        };
        objects.insert((ty, id), object);
    }
    let key = |id: i64| here.iter().find(|(of, _)| *of == id).map(|(_, key)| *key);
    for row in table("HRELATI1", notes).iter().flat_map(Table::rows) {
        if (row.number("RELID"), row.number("TOBJTYP")) == (HAS_PROGRAM, PROGRAM)
            && let Some(object) = objects.get_mut(&(row.number("SOBJTYP"), row.number("SOBJID")))
        {
            object.program = Some(row.number("TOBJID"));
        }
        if row.number("RELID") == profibus::HAS_INTERFACE {
            let interface = (row.number("TOBJTYP"), row.number("TOBJID"));
            interfaces.insert((row.number("SOBJTYP"), row.number("SOBJID")), interface);
        }
    }
    for row in table("HATTRIB1", notes).iter().flat_map(Table::rows) {
        let attribute = row.number("ATTRIID");
        if ![CATALOGUE, profibus::GSD_NAME, profibus::SUBNET].contains(&attribute) {
            continue;
        }
        let Some(object) = key(row.number("IDA")).and_then(|key| objects.get_mut(&key)) else { continue };
        let text = page.text(row.trimmed("STRINGVAL"));
        match attribute {
            CATALOGUE => object.order = order_number(&text),
            profibus::GSD_NAME => object.gsd = text,
            _ => object.subnet = text,
        }
    }
    let Some(attributes) = table("HATTRME1", notes) else { return };
    let memos = tree.read(&format!("{folder}HATTRME1.DBT")).map(Memos::parse);
    for row in attributes.rows() {
        let attribute = row.number("ATTRIIDM");
        let wanted =
            [INPUT_ADDRESSES, OUTPUT_ADDRESSES, CPU_PARAMETERS, profibus::IDENTIFIER, profibus::USER_PARAMETERS];
        if !wanted.contains(&attribute) {
            continue;
        }
        let Some(object) = key(row.number("IDM")).and_then(|key| objects.get_mut(&key)) else { continue };
        match Memos::get(memos.as_ref(), &row, "MEMOARRAYM", usize::MAX) {
            Ok(bytes) if attribute == INPUT_ADDRESSES => {
                (object.inputs, object.diagnostic) = (areas(&bytes), diagnostic(&bytes));
            }
            Ok(bytes) if attribute == OUTPUT_ADDRESSES => object.outputs = areas(&bytes),
            Ok(bytes) if attribute == profibus::IDENTIFIER => object.identifier = profibus::counted(&bytes),
            Ok(bytes) if attribute == profibus::USER_PARAMETERS => object.user = profibus::counted(&bytes),
            Ok(bytes) => object.parameters = bytes,
            Err(damage) => notes.push(Note::warning(object.name.clone(), format!("its addresses are lost: {damage}"))),
        }
    }
}

/// Writes a station with one CPU, in rack 0, and its modules.
pub(crate) fn write(
    cpu: Option<&Cpu>,
    modules: &[Module],
    dp: &[DpSystem],
    program: i64,
    page: CodePage,
    files: &mut Files,
) {
    let Some(cpu) = cpu else { return };
    profibus::write(dp, (1, STATION), (1, INTERFACE_OBJECT), page, files);
    if !dp.is_empty() {
        let mut interfaces = Tables::new();
        interfaces.object(1, INTERFACE_OBJECT, (1, CPU_OBJECT), (0, 2, 1), page.bytes("DP"));
        interfaces.put("s7hkdmax", files);
    }
    let mut station = Tables::new();
    station.object(1, STATION, (PROJECT_OBJECT, IN_PROJECT), (-1, -1, -1), page.bytes(&cpu.station));
    station.put("s7hstatx", files);
    let mut cpus = Tables::new();
    cpus.object(1, CPU_OBJECT, (1, STATION), (0, 2, 0), page.bytes(&cpu.name));
    cpus.relations.row(vec![
        ("SOBJID", Cell::Number(1)),
        ("SOBJTYP", Cell::Number(CPU_OBJECT)),
        ("RELID", Cell::Number(HAS_PROGRAM)),
        ("TOBJID", Cell::Number(program)),
        ("TOBJTYP", Cell::Number(PROGRAM)),
    ]);
    cpus.memo(1, CPU_PARAMETERS, cpu_parameters::write(&cpu.parameters));
    cpus.put("s7hk31ax", files);
    let mut slots = Tables::new();
    for (id, module) in (1..).zip(modules) {
        slots.object(id, MODULE_OBJECT, (1, STATION), module.place, page.bytes(&module.name));
        if !module.order.is_empty() {
            slots.catalogue(id, &module.order);
        }
        for (attribute, areas) in [(INPUT_ADDRESSES, &module.inputs), (OUTPUT_ADDRESSES, &module.outputs)] {
            slots.memo(id, attribute, area_bytes(areas));
        }
    }
    slots.put("s7hk32ax", files);
}

/// Object types in the projects written here: a station, a CPU, a module, and the ID of the project.
const STATION: i64 = 1_314_969;
const CPU_OBJECT: i64 = 2_364_508;
const INTERFACE_OBJECT: i64 = 2_364_509;
const MODULE_OBJECT: i64 = 1_315_991;
const PROJECT_OBJECT: i64 = 43;

/// The tables of one kind of module, on their way to files.
pub(crate) struct Tables {
    objects: TableWriter,
    pub(crate) relations: TableWriter,
    attributes: TableWriter,
    memos: TableWriter,
}

impl Tables {
    pub(crate) fn new() -> Self {
        let numbers = |names: &[&'static str]| names.iter().map(|name| (*name, 'N', 11)).collect::<Vec<_>>();
        let with = |names: &[&'static str], last: &[(&'static str, char, u8)]| {
            TableWriter::new(&[numbers(names).as_slice(), last].concat())
        };
        Self {
            objects: with(
                &["ID", "OBJTYP", "UNITID", "UNITTYP", "SUBSTATN", "MODULN", "SUBMODN"],
                &[("NAME", 'C', 80)],
            ),
            relations: with(&["SOBJID", "SOBJTYP", "RELID", "TOBJID", "TOBJTYP"], &[]),
            attributes: with(&["IDA", "ATTRIID"], &[("STRINGVAL", 'C', 250)]),
            memos: with(&["IDM", "ATTRIIDM"], &[("MEMOARRAYM", 'M', 10)]),
        }
    }

    pub(crate) fn attribute(&mut self, id: i64, attribute: i64, text: Vec<u8>) {
        self.attributes.row(vec![
            ("IDA", Cell::Number(id)),
            ("ATTRIID", Cell::Number(attribute)),
            ("STRINGVAL", Cell::Bytes(text)),
        ]);
    }

    /// The catalogue's name of an order number.
    pub(crate) fn catalogue(&mut self, id: i64, order: &str) {
        let name = format!("_S7H_{}~", order.replace([' ', '-'], "_"));
        self.attribute(id, CATALOGUE, name.into_bytes());
    }

    pub(crate) fn object(&mut self, id: i64, ty: i64, unit: (i64, i64), place: (i64, i64, i64), name: Vec<u8>) {
        self.objects.row(vec![
            ("ID", Cell::Number(id)),
            ("OBJTYP", Cell::Number(ty)),
            ("UNITID", Cell::Number(unit.0)),
            ("UNITTYP", Cell::Number(unit.1)),
            ("SUBSTATN", Cell::Number(place.0)),
            ("MODULN", Cell::Number(place.1)),
            ("SUBMODN", Cell::Number(place.2)),
            ("NAME", Cell::Bytes(name)),
        ]);
    }

    pub(crate) fn memo(&mut self, id: i64, attribute: i64, bytes: Vec<u8>) {
        self.memos.row(vec![
            ("IDM", Cell::Number(id)),
            ("ATTRIIDM", Cell::Number(attribute)),
            ("MEMOARRAYM", Cell::Memo(bytes)),
        ]);
    }

    pub(crate) fn put(self, folder: &str, files: &mut Files) {
        let tables = [
            ("HOBJECT1", self.objects),
            ("HRELATI1", self.relations),
            ("HATTRIB1", self.attributes),
            ("HATTRME1", self.memos),
        ];
        for (name, table) in tables {
            let (dbf, dbt) = table.finish();
            files.put(&format!("hOmSave7/{folder}/{name}.DBF"), dbf);
            if let Some(dbt) = dbt {
                files.put(&format!("hOmSave7/{folder}/{name}.DBT"), dbt);
            }
        }
    }
}

pub(crate) fn area_bytes(areas: &[Area]) -> Vec<u8> {
    let mut out = Vec::new();
    for area in areas {
        for word in [area.first, 0, area.bytes, 0, 1, 1, 1, area.first + 1, 0] {
            out.extend(word.to_le_bytes());
        }
    }
    out.push(0);
    out
}

/// Addresses: entries of 36 bytes, of which the first word is the first byte and the third the number of bytes. An
/// entry without bytes is a diagnostic address.
pub(crate) fn areas(bytes: &[u8]) -> Vec<Area> {
    let entries = entries(bytes);
    // Logical addresses have 16 bits, an area at most some thousand bytes.
    entries.filter(|a| a.bytes > 0 && a.bytes <= 8192 && a.first <= 65_535).collect()
}

fn entries(bytes: &[u8]) -> impl Iterator<Item = Area> + '_ {
    let word =
        |entry: &[u8], at: usize| entry.get(at..at + 4).and_then(|b| b.try_into().ok()).map_or(0, u32::from_le_bytes);
    bytes.chunks_exact(36).map(move |entry| Area { first: word(entry, 0), bytes: word(entry, 8) })
}

/// The first diagnostic address among them.
fn diagnostic(bytes: &[u8]) -> Option<u16> {
    entries(bytes).find(|area| area.bytes == 0).and_then(|area| u16::try_from(area.first).ok())
}

/// `_S7H_6ES7_321_1BH02_0AA~` is the catalogue's name of 6ES7 321-1BH02-0AA.
fn order_number(catalogue: &str) -> String {
    let Some(name) = catalogue.strip_prefix("_S7H_") else { return String::new() };
    if !name.starts_with("6ES7_") && !name.starts_with("6GK7_") && !name.starts_with("6ES5_") {
        return String::new();
    }
    let parts: Vec<&str> = name.trim_end_matches('~').split('_').collect();
    match parts.split_first() {
        Some((head, tail)) => format!("{head} {}", tail.join("-")),
        None => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_entry_of_addresses() {
        let mut entry = vec![0u8; 37];
        entry[1] = 1;
        entry[8] = 16;
        assert_eq!(areas(&entry), [Area { first: 256, bytes: 16 }]);
        entry[8] = 0;
        assert_eq!(areas(&entry), []);
        assert_eq!(areas(&[0x78, 0]), []);
        assert_eq!(order_number("_S7H_6ES7_321_1BH02_0AA~"), "6ES7 321-1BH02-0AA");
        assert_eq!(order_number("_S7H_RACK300_CT"), "");
    }
}
