//! The tables of a hardware configuration, written.

use super::objects::CATALOGUE;
use crate::dbf_writer::{Cell, TableWriter};
use crate::tree::Files;

/// The tables of one kind of module, on their way to files.
pub(super) struct Tables {
    objects: TableWriter,
    pub(super) relations: TableWriter,
    attributes: TableWriter,
    memos: TableWriter,
}

impl Tables {
    pub(super) fn new() -> Self {
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

    pub(super) fn attribute(&mut self, id: i64, attribute: i64, text: Vec<u8>) {
        self.attributes.row(vec![
            ("IDA", Cell::Number(id)),
            ("ATTRIID", Cell::Number(attribute)),
            ("STRINGVAL", Cell::Bytes(text)),
        ]);
    }

    /// The catalogue's name of an order number.
    pub(super) fn catalogue(&mut self, id: i64, order: &str) {
        let name = format!("_S7H_{}~", order.replace([' ', '-'], "_"));
        self.attribute(id, CATALOGUE, name.into_bytes());
    }

    pub(super) fn object(&mut self, id: i64, ty: i64, unit: (i64, i64), place: (i64, i64, i64), name: Vec<u8>) {
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

    pub(super) fn memo(&mut self, id: i64, attribute: i64, bytes: Vec<u8>) {
        self.memos.row(vec![
            ("IDM", Cell::Number(id)),
            ("ATTRIIDM", Cell::Number(attribute)),
            ("MEMOARRAYM", Cell::Memo(bytes)),
        ]);
    }

    pub(super) fn put(self, folder: &str, files: &mut Files) {
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
