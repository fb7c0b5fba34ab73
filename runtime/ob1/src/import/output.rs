//! The files of an imported station.

use std::fmt::Write as _;
use std::path::Path;

use ob1_ir::Symbol;
use ob1_project::{Notes, SymbolRow, Translation};
use ob1_station_file::finding::Finding;
use ob1_stl::Source;

use super::names::{BLOCKS, DRAWINGS, REPORT, STATION, SYMBOLS};
use super::report;
use super::station::Made;
use crate::check;
use crate::diff::Side;
use crate::show;

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

/// A station that was written.
pub(super) struct Written {
    /// Its files, as paths below the folder.
    pub(super) files: Vec<String>,
    /// What keeps it from starting.
    pub(super) errors: Vec<Finding>,
}

/// Writes the station, checks it as `ob1 check` does, and writes the report.
pub(super) fn write(
    (out, overwrite): (&Path, bool),
    title: &str,
    translation: &Translation,
    symbols: &str,
    station: &Made,
    notes: &Notes,
) -> Result<Written, String> {
    let mut files = put_all(out, overwrite, translation, symbols, station)?;
    let errors = check::station_errors(&out.join(STATION));
    let report = report::text(title, translation, station, notes, &errors);
    let path = out.join(REPORT);
    std::fs::write(&path, report).map_err(refused(&path))?;
    files.push(REPORT.to_owned());
    Ok(Written { files, errors })
}

fn refused(path: &Path) -> impl FnOnce(std::io::Error) -> String + use<> {
    let path = path.display().to_string();
    move |error| format!("{path}: {error}")
}

/// Writes the drawings of all blocks; they are made anew by each import, and no source.
pub(super) fn draw(out: &Path, side: Side) -> Result<Vec<String>, String> {
    let folder = out.join(DRAWINGS);
    std::fs::create_dir_all(&folder).map_err(refused(&folder))?;
    let mut files = Vec::new();
    for (id, text) in show::pages(side) {
        let name = format!("{DRAWINGS}/{}_{}.txt", id.kind.name(), id.number);
        let path = out.join(&name);
        std::fs::write(&path, text).map_err(refused(&path))?;
        files.push(name);
    }
    Ok(files)
}

fn put_all(
    out: &Path,
    overwrite: bool,
    translation: &Translation,
    symbols: &str,
    station: &Made,
) -> Result<Vec<String>, String> {
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
    put(STATION.to_owned(), station.text.as_bytes())?;
    if !symbols.is_empty() {
        put(SYMBOLS.to_owned(), symbols.as_bytes())?;
    }
    for (path, bytes) in &station.files {
        let folder = out.join(path).parent().map_or_else(|| out.to_owned(), Path::to_owned);
        std::fs::create_dir_all(&folder).map_err(refused(&folder))?;
        put(path.clone(), bytes)?;
    }
    for file in translation.sources.iter().chain(&translation.images) {
        put(format!("{BLOCKS}/{}", file.name), &file.bytes)?;
    }
    Ok(files)
}
