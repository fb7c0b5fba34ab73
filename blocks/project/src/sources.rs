//! Source texts that lie in a project beside its blocks.

use crate::dbf::Table;
use crate::dbf_writer::{Cell, TableWriter};
use crate::text::CodePage;
use crate::tree::{Files, Tree};

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

/// TYPE of an STL source, and of one in SCL.
const STL: i64 = 1_122_309;
const SCL: i64 = 1_122_310;

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

/// Writes the container with this ID.
pub(crate) fn write(sources: &[SourceText], container: u32, page: CodePage, files: &mut Files) {
    if sources.is_empty() {
        return;
    }
    let folder = format!("s7asrcom/{container:08x}/");
    let mut table = TableWriter::new(&[("NAME", 'C', 24), ("FILENAME", 'C', 16), ("TYPE", 'N', 11)]);
    for (at, source) in sources.iter().enumerate() {
        let file = format!("{at:08x}.src");
        table.row(vec![
            ("NAME", Cell::Bytes(page.bytes(&source.name))),
            ("FILENAME", Cell::Bytes(file.clone().into_bytes())),
            ("TYPE", Cell::Number(if source.stl { STL } else { SCL })),
        ]);
        files.put(&format!("{folder}{file}"), page.bytes(&source.text));
    }
    files.put(&format!("{folder}S7CONTAI.DBF"), table.finish().0);
}
