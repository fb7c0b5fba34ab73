//! A CP 040 in the station file: parameters in both forms, and its IO size.

use std::path::Path;

use ob1_params::cp040::table::CP040;
use ob1_params::{Cp040, CpKind};

use super::cp_keys::{characters_of_modbus, keys_or_bytes, line_of, stop_bits_of, zeros_of};
use super::findings::{CONTRADICTION, Findings};
use super::tables::ModuleTable;
use super::types::ModuleKind;
use super::values::number;

/// IO size: bytes each way.
const IO_SIZES: std::ops::RangeInclusive<i64> = 8..=60;

pub(super) fn module(f: &mut Findings<'_>, table: &ModuleTable, folder: &Path) -> Option<ModuleKind> {
    for (key, at) in table.given() {
        let remedy = match key {
            "channels" => "leave it out: `bytes` is the IO size",
            "abd" => "leave it out: DBB_NO of its blocks counts bytes",
            _ => continue,
        };
        f.error(CONTRADICTION, at, format!("`{key}` cannot be chosen for a CP 040"), remedy);
    }
    let params = keys_or_bytes(f, table, ("CP 040", CP040), |keys| Cp040::from_keys(keys), Cp040::of_bytes)?;
    characters_of_modbus(f, table, &params.common);
    zeros_of(f, table, CpKind::Cp040, &params.common);
    let line = line_of(f, table, folder, "the CP 040")?;
    stop_bits_of(f, table, &line, params.common.stop_bits);
    let most = *IO_SIZES.end() as u16;
    let io_size = number(f, "bytes", table.bytes.as_ref(), IO_SIZES, most);
    let diagnostics = table.diagnostics.as_ref().is_some_and(|switch| *switch.get_ref());
    let bytes = params.encode();
    Some(ModuleKind::Cp040 { params: Box::new(params), bytes, io_size, line, diagnostics })
}
