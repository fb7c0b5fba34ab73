//! A CP 341 or a CP 340 in the station file: its parameters are keys, there is no raw form.

use std::path::Path;

use ob1_params::{Cp341, CpKind};

use super::cp_keys::{from_keys, line_of};
use super::findings::{CONTRADICTION, Findings, MISSING};
use super::tables::ModuleTable;
use super::types::ModuleKind;

pub(super) fn module(f: &mut Findings<'_>, table: &ModuleTable, folder: &Path, kind: CpKind) -> Option<ModuleKind> {
    let cp = kind.row().text;
    let bytes = format!("leave it out: a {cp} has 16 bytes each way");
    for (key, at) in table.given() {
        let remedy = match key {
            "bytes" | "channels" => bytes.as_str(),
            "abd" => "leave it out: DBB_NO of its blocks counts bytes",
            "raw" => "write `params` instead: its parameters have no other form",
            _ => continue,
        };
        f.error(CONTRADICTION, at, format!("`{key}` cannot be chosen for a {cp}"), remedy);
    }
    let Some(given) = &table.params else {
        let remedy = "params = { protocol = \"3964r\", baud = 9600 }";
        f.error(MISSING, table.kind.span(), format!("the {cp} has no parameters"), remedy);
        return None;
    };
    let params = from_keys(f, given, |keys| Cp341::of_kind(kind, keys))?;
    let line = line_of(f, table, folder, &format!("the {cp}"))?;
    let diagnostics = table.diagnostics.as_ref().is_some_and(|switch| *switch.get_ref());
    Some(ModuleKind::Keyed { params: Box::new(params), line, diagnostics })
}
