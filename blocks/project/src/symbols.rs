//! The symbol table of a program.

use crate::dbf::Table;
use crate::note::{Note, Notes};
use crate::text::CodePage;
use crate::tree::Tree;

/// A row of the symbol table.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SymbolRow {
    /// The symbol itself, without quotes.
    pub name: String,
    /// The address with German letters: `E 1.0`.
    pub german: String,
    /// The address with international letters: `I 1.0`.
    pub international: String,
    /// The type, or the block it stands for: `BOOL`, `FB 12`.
    pub ty: String,
    /// The comment; empty without one.
    pub comment: String,
}

/// Object type of an S7 program, and the relation of its symbol list, in YLNKLIST.
pub(crate) const PROGRAM: i64 = 1_327_361;
pub(crate) const SYMBOLS: i64 = 25;

/// The symbol list of a program, as YLNKLIST has it.
pub(crate) fn list_of_program(table: &Table, program: i64) -> Option<i64> {
    let of_program = |row: &crate::dbf::Row<'_>| {
        row.number("TOT") == PROGRAM && row.number("TOI") == program && row.number("RID") == SYMBOLS
    };
    table.rows().find(of_program).map(|row| row.number("SOI")).filter(|id| *id > 0)
}

/// The table of all lists.
fn lists(tree: &Tree<'_>, root: &str) -> Option<Table> {
    tree.read(&format!("{root}YDBs/SYMLISTS.DBF")).and_then(|bytes| Table::parse(bytes).ok())
}

/// The file of a list.
fn path_of(lists: Option<&Table>, root: &str, list: i64, page: CodePage) -> String {
    let named = lists.and_then(|table| {
        let row = table.rows().find(|row| row.number("_ID") == list)?;
        Some(page.text(row.trimmed("_DBPATH"))).filter(|path| !path.is_empty())
    });
    format!("{root}YDBs/{}/SYMLIST.DBF", named.unwrap_or_else(|| list.to_string()))
}

/// The lists whose files are there.
pub(crate) fn all(tree: &Tree<'_>, root: &str, page: CodePage) -> Vec<i64> {
    let lists = lists(tree, root);
    let ids = lists.iter().flat_map(Table::rows).map(|row| row.number("_ID"));
    ids.filter(|id| tree.has(&path_of(lists.as_ref(), root, *id, page))).collect()
}

/// Reads the list with this ID.
pub(crate) fn read(tree: &Tree<'_>, root: &str, list: i64, page: CodePage, notes: &mut Notes) -> Vec<SymbolRow> {
    let path = path_of(lists(tree, root).as_ref(), root, list, page);
    let Some(bytes) = tree.read(&path) else {
        let why = if tree.has(&path) { tree.why_not(&path) } else { "the symbol table is missing".to_owned() };
        notes.push(Note::warning(path, why));
        return Vec::new();
    };
    let table = match Table::parse(bytes) {
        Ok(table) => {
            notes.extend(table.cut_off().map(|what| Note::warning(path, what)));
            table
        }
        Err(damage) => {
            notes.push(Note::warning(path, format!("the symbol table cannot be read: {damage}")));
            return Vec::new();
        }
    };
    let row = |row: crate::dbf::Row<'_>| {
        let text = |field| page.text(row.trimmed(field));
        // Blanks within addresses are padding.
        let address = |field| text(field).split_whitespace().collect::<Vec<_>>().join(" ");
        // Where one of both is missing the other stands for it: either is an address in a symbol table.
        let (german, international) = (address("_OPHIST"), address("_OPIEC"));
        SymbolRow {
            name: text("_SKZ").trim().to_owned(),
            german: if german.is_empty() { international.clone() } else { german.clone() },
            international: if international.is_empty() { german } else { international },
            ty: address("_DATATYP"),
            comment: text("_COMMENT"),
        }
    };
    let mut rows: Vec<SymbolRow> =
        table.rows().map(row).filter(|row| !row.name.is_empty() && !row.german.is_empty()).collect();
    rows.sort_by(|a, b| a.name.cmp(&b.name));
    rows
}
