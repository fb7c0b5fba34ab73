//! Hardware configurations, written: a station, its CPU, modules and DP master systems.

use super::table::{Cell, TableWriter};
use crate::cpu_parameters::{CLOCK, CYCLE, CYCLIC, CpuParameters, Cyclic};
use crate::hardware::objects::{
    CATALOGUE, CPU_PARAMETERS, CPUS_400, GSD_NAME, HAS_INTERFACE, HAS_PROGRAM, IDENTIFIER, INPUT_ADDRESSES,
    OUTPUT_ADDRESSES, PROGRAM, SUBNET, USER_PARAMETERS,
};
use crate::hardware::profibus::{GOES_ON, SYSTEM};
use crate::hardware::{Area, Cpu, DpSystem, IN_PROJECT, Module};
use crate::text::CodePage;
use crate::tree::Files;

/// Object types in the projects written here: a station, a CPU, a module, and the ID of the project.
const STATION: i64 = 1_314_969;
const CPU_OBJECT: i64 = 2_364_508;
const INTERFACE_OBJECT: i64 = 2_364_509;
const MODULE_OBJECT: i64 = 1_315_991;
const PROJECT_OBJECT: i64 = 43;
/// Object types of the slaves and modules written here, and their places in a slave without a subslot.
const SLAVE: i64 = 1_314_988;
const DP_MODULE: i64 = 1_314_995;
const HEAD: i64 = 1_315_030;

/// The tables of one kind of module, on their way to files.
struct Tables {
    objects: TableWriter,
    relations: TableWriter,
    attributes: TableWriter,
    memos: TableWriter,
}

impl Tables {
    fn new() -> Self {
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

    fn attribute(&mut self, id: i64, attribute: i64, text: Vec<u8>) {
        self.attributes.row(vec![
            ("IDA", Cell::Number(id)),
            ("ATTRIID", Cell::Number(attribute)),
            ("STRINGVAL", Cell::Bytes(text)),
        ]);
    }

    /// The catalogue's name of an order number.
    fn catalogue(&mut self, id: i64, order: &str) {
        let name = format!("_S7H_{}~", order.replace([' ', '-'], "_"));
        self.attribute(id, CATALOGUE, name.into_bytes());
    }

    fn object(&mut self, id: i64, ty: i64, unit: (i64, i64), place: (i64, i64, i64), name: Vec<u8>) {
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

    fn memo(&mut self, id: i64, attribute: i64, bytes: Vec<u8>) {
        self.memos.row(vec![
            ("IDM", Cell::Number(id)),
            ("ATTRIIDM", Cell::Number(attribute)),
            ("MEMOARRAYM", Cell::Memo(bytes)),
        ]);
    }

    fn put(self, folder: &str, files: &mut Files) {
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

/// Writes a station with one CPU, in rack 0, and its modules.
pub(super) fn write(
    cpu: Option<&Cpu>,
    modules: &[Module],
    dp: &[DpSystem],
    program: i64,
    page: CodePage,
    files: &mut Files,
) {
    let Some(cpu) = cpu else { return };
    systems(dp, (1, STATION), (1, INTERFACE_OBJECT), page, files);
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
    cpus.memo(1, CPU_PARAMETERS, parameters(&cpu.parameters));
    cpus.put(if cpu.s7_400 { CPUS_400 } else { "s7hk31ax" }, files);
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

/// Writes master systems of the station `station`, whose interface is `interface`.
fn systems(systems: &[DpSystem], station: (i64, i64), interface: (i64, i64), page: CodePage, files: &mut Files) {
    if systems.is_empty() {
        return;
    }
    let (mut heads, mut slots) = (Tables::new(), Tables::new());
    let mut next = 0;
    let mut id = || {
        next += 1;
        next
    };
    for system in systems {
        let own = id();
        heads.object(own, SYSTEM, station, (0, 0, 0), page.bytes("DP master system"));
        heads.attribute(own, SUBNET, page.bytes(&system.name));
        heads.relations.row(vec![
            ("SOBJID", Cell::Number(own)),
            ("SOBJTYP", Cell::Number(SYSTEM)),
            ("RELID", Cell::Number(HAS_INTERFACE)),
            ("TOBJID", Cell::Number(interface.0)),
            ("TOBJTYP", Cell::Number(interface.1)),
        ]);
        for slave in &system.slaves {
            let (of, address) = (id(), i64::from(slave.address));
            slots.object(of, SLAVE, (own, SYSTEM), (address, 0, 0), page.bytes(&slave.name));
            slots.memo(of, USER_PARAMETERS, with_count(&slave.parameters));
            if let Some(diagnostic) = slave.diagnostic {
                let head = id();
                slots.object(head, HEAD, (of, SLAVE), (address, 2, 0), page.bytes(&slave.name));
                let address = Area { first: diagnostic.into(), bytes: 0 };
                slots.memo(head, INPUT_ADDRESSES, area_bytes(&[address]));
            }
            for module in &slave.modules {
                let at = id();
                slots.object(at, DP_MODULE, (of, SLAVE), (address, module.slot, 0), page.bytes(&module.name));
                if !module.order.is_empty() {
                    slots.catalogue(at, &module.order);
                }
                if !module.gsd.is_empty() {
                    let mark = if module.goes_on { format!("{GOES_ON} ") } else { String::new() };
                    slots.attribute(at, GSD_NAME, page.bytes(&format!("{mark}{}", module.gsd)));
                    slots.memo(at, IDENTIFIER, with_count(&module.identifier));
                }
                for (attribute, areas) in [(INPUT_ADDRESSES, &module.inputs), (OUTPUT_ADDRESSES, &module.outputs)] {
                    slots.memo(at, attribute, area_bytes(areas));
                }
            }
        }
    }
    heads.put("S7HDPSSX", files);
    slots.put("s7hslntx", files);
}

/// The records of some parameters.
fn parameters(parameters: &CpuParameters) -> Vec<u8> {
    let mut out = Vec::new();
    let mut record = |number: u8, content: &[u8]| {
        out.extend([content.len() as u8 + 2, number]);
        out.extend(content);
    };
    if let Some(ms) = parameters.monitoring_ms {
        let [high, low] = ms.to_be_bytes();
        record(CYCLE, &[20, 1, high, low, 0, 0, 0, 0]);
    }
    if let Some(byte) = parameters.clock_memory {
        record(CLOCK, &[0, 1, 0, byte, 0xFF, 0xFF]);
    }
    if !parameters.cyclic.is_empty() {
        let entry = |c: &Cyclic| {
            let ([a, b], [d, e]) = (c.period_ms.to_be_bytes(), c.phase_ms.to_be_bytes());
            [c.ob - 23, 0, a, b, d, e]
        };
        record(CYCLIC, &parameters.cyclic.iter().flat_map(entry).collect::<Vec<u8>>());
    }
    out.push(0);
    out
}

/// The bytes of addresses.
fn area_bytes(areas: &[Area]) -> Vec<u8> {
    let mut out = Vec::new();
    for area in areas {
        for word in [area.first, 0, area.bytes, 0, 1, 1, 1, area.first + 1, 0] {
            out.extend(word.to_le_bytes());
        }
    }
    out.push(0);
    out
}

/// Bytes after their number, a word.
fn with_count(bytes: &[u8]) -> Vec<u8> {
    let mut out = (bytes.len() as u16).to_le_bytes().to_vec();
    out.extend(bytes);
    out.push(0);
    out
}
