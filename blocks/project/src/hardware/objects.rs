//! The objects of a hardware configuration, as the tables of one kind of module keep them: names, places, attributes,
//! addresses.

use std::collections::BTreeMap;

use crate::dbf::{Memos, Table};
use crate::note::{Note, Notes};
use crate::text::CodePage;
use crate::tree::Tree;

/// Addresses of a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Area {
    /// The first byte of the addresses.
    pub first: u32,
    /// How many bytes there are.
    pub bytes: u32,
}

/// Attributes of HATTRME1 and HATTRIB1.
pub(crate) const INPUT_ADDRESSES: i64 = 110_981;
pub(crate) const OUTPUT_ADDRESSES: i64 = 110_983;
pub(crate) const CPU_PARAMETERS: i64 = 110_717;
pub(crate) const CATALOGUE: i64 = 4_098;
/// Attributes: the module's name in the GSD file, its identifier; the slave's user parameters; the subnet's name.
pub(crate) const GSD_NAME: i64 = 110_970;
pub(crate) const IDENTIFIER: i64 = 110_752;
pub(crate) const USER_PARAMETERS: i64 = 110_800;
pub(crate) const SUBNET: i64 = 110_955;
/// The relation of a CPU to its program, and the object type of a program.
pub(crate) const HAS_PROGRAM: i64 = 16;
pub(crate) const PROGRAM: i64 = 1_327_361;
/// The relation of a DP master system to the interface of its master.
pub(crate) const HAS_INTERFACE: i64 = 1_315_834;

/// Objects by their type and ID.
pub(super) type Objects = BTreeMap<(i64, i64), Object>;
/// Of a DP master system the interface of its master.
pub(super) type Interfaces = BTreeMap<(i64, i64), (i64, i64)>;

/// An object of any kind, with what is known of it.
#[derive(Default)]
pub(super) struct Object {
    pub(super) name: String,
    /// It lies among the CPUs of an S7-400.
    pub(super) s7_400: bool,
    pub(super) unit: (i64, i64),
    pub(super) place: (i64, i64, i64),
    pub(super) order: String,
    pub(super) program: Option<i64>,
    pub(super) inputs: Vec<Area>,
    pub(super) outputs: Vec<Area>,
    /// The first of its diagnostic addresses.
    pub(super) diagnostic: Option<u16>,
    pub(super) parameters: Vec<u8>,
    /// Of a slave's module: its name in the GSD file, its identifier.
    pub(super) gsd: String,
    pub(super) identifier: Vec<u8>,
    /// Of a slave: its user parameters.
    pub(super) user: Vec<u8>,
    /// Of a master system: its subnet.
    pub(super) subnet: String,
}

/// The folder of the CPUs of an S7-400.
pub(crate) const CPUS_400: &str = "s7hk41ax";

/// Reads the objects of one folder: those of one kind of module.
pub(super) fn read_kind(
    tree: &Tree<'_>,
    folder: &str,
    page: CodePage,
    (objects, interfaces): (&mut Objects, &mut Interfaces),
    notes: &mut Notes,
) {
    let table = |name: &str, notes: &mut Notes| {
        let path = format!("{folder}{name}.DBF");
        match Table::parse(tree.read(&path)?) {
            Ok(table) => {
                notes.extend(table.cut_off().map(|what| Note::warning(path, what)));
                Some(table)
            }
            Err(damage) => {
                notes.push(Note::warning(path, damage.to_string()));
                None
            }
        }
    };
    let Some(list) = table("HOBJECT1", notes) else { return };
    let s7_400 = folder.trim_end_matches('/').to_ascii_lowercase().ends_with(CPUS_400);
    // The attribute tables name an object by its ID alone: those of one folder.
    let mut here: Vec<(i64, (i64, i64))> = Vec::new();
    for row in list.rows() {
        let (id, ty) = (row.number("ID"), row.number("OBJTYP"));
        here.push((id, (ty, id)));
        let object = Object {
            name: page.text(row.trimmed("NAME")),
            s7_400,
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
        if row.number("RELID") == HAS_INTERFACE {
            let interface = (row.number("TOBJTYP"), row.number("TOBJID"));
            interfaces.insert((row.number("SOBJTYP"), row.number("SOBJID")), interface);
        }
    }
    for row in table("HATTRIB1", notes).iter().flat_map(Table::rows) {
        let attribute = row.number("ATTRIID");
        if ![CATALOGUE, GSD_NAME, SUBNET].contains(&attribute) {
            continue;
        }
        let Some(object) = key(row.number("IDA")).and_then(|key| objects.get_mut(&key)) else { continue };
        let text = page.text(row.trimmed("STRINGVAL"));
        match attribute {
            CATALOGUE => object.order = order_number(&text),
            GSD_NAME => object.gsd = text,
            _ => object.subnet = text,
        }
    }
    let Some(attributes) = table("HATTRME1", notes) else { return };
    let memos = Memos::open(tree, &format!("{folder}HATTRME1.DBT"));
    for row in attributes.rows() {
        let attribute = row.number("ATTRIIDM");
        let wanted = [INPUT_ADDRESSES, OUTPUT_ADDRESSES, CPU_PARAMETERS, IDENTIFIER, USER_PARAMETERS];
        if !wanted.contains(&attribute) {
            continue;
        }
        let Some(object) = key(row.number("IDM")).and_then(|key| objects.get_mut(&key)) else { continue };
        match Memos::get(memos.as_ref(), &row, "MEMOARRAYM", usize::MAX) {
            Ok(bytes) if attribute == INPUT_ADDRESSES => {
                (object.inputs, object.diagnostic) = (areas(&bytes), diagnostic(&bytes));
            }
            Ok(bytes) if attribute == OUTPUT_ADDRESSES => object.outputs = areas(&bytes),
            Ok(bytes) if attribute == IDENTIFIER => object.identifier = counted(&bytes),
            Ok(bytes) if attribute == USER_PARAMETERS => object.user = counted(&bytes),
            Ok(bytes) => object.parameters = bytes,
            Err(damage) => notes.push(Note::warning(object.name.clone(), format!("its addresses are lost: {damage}"))),
        }
    }
}

/// Addresses: entries of 36 bytes, of which the first word is the first byte and the third the number of bytes. An
/// entry without bytes is a diagnostic address.
fn areas(bytes: &[u8]) -> Vec<Area> {
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

/// The bytes after their number: a word, low byte first. None unless all are there.
fn counted(bytes: &[u8]) -> Vec<u8> {
    let Some((count, rest)) = bytes.split_first_chunk::<2>() else { return Vec::new() };
    rest.get(..usize::from(u16::from_le_bytes(*count))).unwrap_or_default().to_vec()
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

    #[test]
    fn bytes_are_counted_and_a_count_is_not_believed() {
        assert_eq!(counted(&[2, 0, 0x40, 0x9F, 0]), [0x40, 0x9F]);
        for wrong in [&[][..], &[1], &[1, 0], &[3, 0, 1, 2], &[0xFF, 0xFF, 1]] {
            assert_eq!(counted(wrong), [], "{wrong:?}");
        }
    }
}
