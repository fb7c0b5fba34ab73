//! Source texts that lie in a project beside its blocks.

use crate::dbf::Table;
use crate::text::CodePage;
use crate::tree::Tree;

/// A source text of a program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceText {
    /// Its name in the project.
    pub name: String,
    /// True for an STL source.
    pub stl: bool,
    /// The text, in Unicode.
    pub text: String,
}

/// TYPE of an STL source.
pub(crate) const STL: i64 = 1_122_309;

/// Reads the container with this ID.
pub(crate) fn read(tree: &Tree<'_>, root: &str, container: u32, page: CodePage) -> Vec<SourceText> {
    let folder = format!("{root}s7asrcom/{container:08x}/");
    let table = tree.read(&format!("{folder}S7CONTAI.DBF")).and_then(|bytes| Table::parse(bytes).ok());
    let Some(table) = table else { return Vec::new() };
    let mut sources = Vec::new();
    for row in table.rows() {
        let file = page.text(row.trimmed("FILENAME"));
        let Some(bytes) = tree.read(&format!("{folder}{file}")) else { continue };
        sources.push(SourceText {
            name: page.text(row.trimmed("NAME")),
            stl: row.number("TYPE") == STL,
            text: page.text(&bytes),
        });
    }
    sources
}
