//! The files of an imported station.

use std::fmt::Write as _;
use std::path::Path;

use ob1_ir::Symbol;
use ob1_project::{SymbolRow, Translation};
use ob1_stl::Source;

use super::names::{BLOCKS, GSD, SYMBOLS};
use super::station::Made;

/// The symbol table as STEP 7 exports it, and the symbols a program gets from it.
pub(super) fn symbol_table(rows: &[SymbolRow]) -> (String, Vec<Symbol>) {
    let mut text = String::new();
    for row in rows {
        let clean = |text: &str| text.replace(['"', '\r', '\n'], " ");
        let _ = writeln!(
            text,
            "\"{}\",\"{}\",\"{}\",\"{}\"",
            clean(&row.name),
            clean(&row.international),
            clean(&row.ty),
            clean(&row.comment)
        );
    }
    let symbols = ob1_stl::read_symbols(&Source::new(SYMBOLS, text.as_bytes())).symbols;
    (text, symbols)
}

/// Writes the station; gives the files, as paths below `out`.
pub(super) fn write(
    out: &Path,
    overwrite: bool,
    translation: &Translation,
    symbols: &str,
    station: &Made,
    report: &str,
) -> Result<Vec<String>, String> {
    let refused = |path: &Path| {
        let path = path.display().to_string();
        move |error: std::io::Error| format!("{path}: {error}")
    };
    let is_taken = std::fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_some());
    if is_taken && !overwrite {
        return Err(format!("{} is not empty; name another folder, or say --overwrite", out.display()));
    }
    let blocks = out.join(BLOCKS);
    std::fs::create_dir_all(&blocks).map_err(refused(&blocks))?;
    let mut files = Vec::new();
    let mut put = |name: String, bytes: &[u8]| {
        let path = out.join(&name);
        std::fs::write(&path, bytes).map_err(refused(&path))?;
        files.push(name);
        Ok::<(), String>(())
    };
    put("station.toml".to_owned(), station.text.as_bytes())?;
    if !symbols.is_empty() {
        put(SYMBOLS.to_owned(), symbols.as_bytes())?;
    }
    if !station.files.is_empty() {
        let folder = out.join(GSD);
        std::fs::create_dir_all(&folder).map_err(refused(&folder))?;
    }
    for (path, bytes) in &station.files {
        put(path.clone(), bytes)?;
    }
    for file in translation.sources.iter().chain(&translation.images) {
        put(format!("{BLOCKS}/{}", file.name), &file.bytes)?;
    }
    put("report.txt".to_owned(), report.as_bytes())?;
    Ok(files)
}
