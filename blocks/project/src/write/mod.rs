//! Project folders, written: for the example of this project, and for tests.
//!
//! What is written is what [`crate::Project`] reads and STEP 7 would find by itself: block folder, program, symbol
//! table, station with CPU and modules. Indexes (`.MDX`) and the editors' private parts are left out.

mod hardware;
mod table;

use ob1_model::BlockKind;

use crate::comments::Comments;
use crate::folder::{Block, Head, KINDS, Language, Part, UDT, Udt};
use crate::hardware::{Cpu, DpSystem, Module};
use crate::links::{self, Links};
use crate::sources::{STL, SourceText};
use crate::symbols::{self, SymbolRow};
use crate::text::CodePage;
use crate::tree::Files;
use table::{Cell, TableWriter};

/// A project with one station, one CPU and one program.
#[derive(Clone, Debug, Default)]
pub struct NewProject {
    /// Its name: that of the folder's `.s7p` too.
    pub name: String,
    /// The code page of its texts.
    pub page: CodePage,
    /// The name of the program.
    pub program: String,
    /// The blocks of the program.
    pub blocks: Vec<Block>,
    /// Its user-defined types, by number.
    pub udts: Vec<(u16, Udt)>,
    /// Rows of its symbol table.
    pub symbols: Vec<SymbolRow>,
    /// Its source texts.
    pub sources: Vec<SourceText>,
    /// The CPU and its station; none: a program by itself.
    pub cpu: Option<Cpu>,
    /// The modules of the station.
    pub modules: Vec<Module>,
    /// Its DP master systems, behind the interface of the CPU.
    pub dp: Vec<DpSystem>,
}

/// IDs in the projects written here: each there once.
const PROGRAM_ID: u32 = 1;
const FOLDER_ID: u32 = 1;
const LIST_ID: u32 = 101;
const SOURCES_ID: u32 = 1;

/// TYPE of an SCL source.
const SCL: i64 = 1_122_310;

impl NewProject {
    /// The files of the project.
    pub fn files(&self) -> Files {
        let mut files = Files::default();
        files.put(&format!("{}.s7p", self.name), self.head());
        let language = format!("1\r\n1031\r\n0\r\n{}\r\n850\r\n", self.page.number());
        files.put("Global/Language", language);
        self.programs(&mut files);
        self.block_folder(&mut files);
        self.symbol_list(&mut files);
        write_sources(&self.sources, SOURCES_ID, self.page, &mut files);
        hardware::write(self.cpu.as_ref(), &self.modules, &self.dp, i64::from(PROGRAM_ID), self.page, &mut files);
        files
    }

    fn head(&self) -> Vec<u8> {
        let name = self.page.bytes(&self.name);
        let mut out = vec![0, 0, 0, 0, name.len().min(255) as u8];
        out.extend(&name[..name.len().min(255)]);
        out.extend([0; 4]);
        out
    }

    fn programs(&self, files: &mut Files) {
        let mut table =
            TableWriter::new(&[("ID", 'N', 11), ("NAME", 'C', 24), ("HWTYPE", 'C', 24), ("RSRVD4_L", 'N', 11)]);
        table.row(vec![
            ("ID", Cell::Number(PROGRAM_ID.into())),
            ("NAME", Cell::Bytes(self.page.bytes(&self.program))),
            ("HWTYPE", Cell::Bytes(b"S7 CPU".to_vec())),
            ("RSRVD4_L", Cell::Number(512)),
        ]);
        files.put("hrs/S7RESOFF.DBF", table.finish().0);
        let mut lnk = vec![0u8; 512];
        let list = (!self.symbols.is_empty()).then_some(i64::from(LIST_ID));
        let sources = (!self.sources.is_empty()).then_some(SOURCES_ID);
        lnk.extend(link_record(512, Links { folder: Some(FOLDER_ID), symbols: list, sources }));
        files.put("hrs/linkhrs.lnk", lnk);
    }

    fn block_folder(&self, files: &mut Files) {
        let count = |kind| self.blocks.iter().filter(|b| b.id.kind == kind).count() as i64;
        let fields = ["ANZOB", "ANZFC", "ANZFB", "ANZDB"];
        let mut all = vec![("ID", 'N', 11), ("NAME", 'C', 24)];
        all.extend(fields.map(|field| (field, 'N', 11)));
        let mut table = TableWriter::new(&all);
        let mut row = vec![("ID", Cell::Number(FOLDER_ID.into())), ("NAME", Cell::Bytes(b"Blocks".to_vec()))];
        let kinds = [BlockKind::Ob, BlockKind::Fc, BlockKind::Fb, BlockKind::Db];
        row.extend(fields.into_iter().zip(kinds).map(|(field, kind)| (field, Cell::Number(count(kind)))));
        table.row(row);
        files.put("ombstx/offline/BSTCNTOF.DBF", table.finish().0);

        let mut table = parts_table();
        let mut object = 0;
        for block in &self.blocks {
            object += 1;
            let Some(kind) = KINDS.iter().find(|kind| kind.kind == block.id.kind) else { continue };
            let bytes = |text: &str| self.page.bytes(text);
            let (heading, stream, info) = comment_memos(&block.comments, self.page);
            let code = Part {
                code: block.code.clone(),
                interface: block.interface.clone(),
                info: block.segments.clone(),
                ..head_of(block)
            };
            let text = Part { code: block.declarations.as_deref().map(bytes).unwrap_or_default(), ..head_of(block) };
            let comments = Part { code: stream, interface: heading, info, ..head_of(block) };
            let declared = block.declarations.as_ref().map(|_| (kind.declarations, text));
            for (ty, part) in [Some((kind.code, code)), declared, Some((kind.comments, comments))].into_iter().flatten()
            {
                part_row(&mut table, object, ty, block.id.number, part, self.page);
            }
        }
        for (number, udt) in &self.udts {
            object += 1;
            let part = Part { code: self.page.bytes(&udt.declarations), head: udt.head.clone(), ..Part::default() };
            part_row(&mut table, object, UDT, *number, part, self.page);
        }
        let (dbf, dbt) = table.finish();
        files.put(&format!("ombstx/offline/{FOLDER_ID:08x}/SUBBLK.DBF"), dbf);
        files.put(&format!("ombstx/offline/{FOLDER_ID:08x}/SUBBLK.DBT"), dbt.unwrap_or_default());
    }

    fn symbol_list(&self, files: &mut Files) {
        if self.symbols.is_empty() {
            return;
        }
        let mut lists = TableWriter::new(&[("_ID", 'N', 11), ("_DBPATH", 'C', 64)]);
        let path = LIST_ID.to_string();
        lists.row(vec![("_ID", Cell::Number(LIST_ID.into())), ("_DBPATH", Cell::Bytes(path.clone().into_bytes()))]);
        files.put("YDBs/SYMLISTS.DBF", lists.finish().0);
        let mut table = TableWriter::new(&[("SOI", 'N', 11), ("RID", 'N', 11), ("TOI", 'N', 11), ("TOT", 'N', 11)]);
        table.row(vec![
            ("SOI", Cell::Number(LIST_ID.into())),
            ("RID", Cell::Number(symbols::SYMBOLS)),
            ("TOI", Cell::Number(PROGRAM_ID.into())),
            ("TOT", Cell::Number(symbols::PROGRAM)),
        ]);
        files.put("YDBs/YLNKLIST.DBF", table.finish().0);
        let fields = [
            ("_SKZ", 'C', 24),
            ("_OPHIST", 'C', 12),
            ("_OPIEC", 'C', 12),
            ("_DATATYP", 'C', 10),
            ("_COMMENT", 'C', 80),
        ];
        let mut table = TableWriter::new(&fields);
        for row in &self.symbols {
            let bytes = |text: &str| Cell::Bytes(self.page.bytes(text));
            table.row(vec![
                ("_SKZ", bytes(&row.name)),
                ("_OPHIST", bytes(&row.german)),
                ("_OPIEC", bytes(&row.international)),
                ("_DATATYP", bytes(&row.ty)),
                ("_COMMENT", bytes(&row.comment)),
            ]);
        }
        files.put(&format!("YDBs/{path}/SYMLIST.DBF"), table.finish().0);
    }
}

fn parts_table() -> TableWriter {
    TableWriter::new(&[
        ("OBJECTID", 'N', 11),
        ("SUBBLKTYP", 'C', 5),
        ("BLKNUMBER", 'C', 5),
        ("BLKLANG", 'C', 5),
        ("ATTRIBUTE", 'N', 3),
        ("AGRESERVED", 'N', 3),
        ("BLKTOTLEN", 'N', 11),
        ("MC5LEN", 'N', 11),
        ("SSBLEN", 'N', 11),
        ("ADDLEN", 'N', 11),
        ("LOCDATALEN", 'N', 5),
        ("TIMESTAMP1", 'C', 6),
        ("TIMESTAMP2", 'C', 6),
        ("PASSWORD", 'N', 11),
        ("USERNAME", 'C', 8),
        ("BLOCKFNAME", 'C', 8),
        ("BLOCKNAME", 'C', 8),
        ("VERSION", 'N', 3),
        ("CHECKSUM", 'N', 5),
        ("MC5CODE", 'M', 10),
        ("SSBPART", 'M', 10),
        ("ADDINFO", 'M', 10),
    ])
}

fn head_of(block: &Block) -> Part {
    Part {
        language: block.language.number(),
        attribute: block.attribute.into(),
        reserved: i64::from(!block.code_version1),
        local_bytes: block.local_bytes.into(),
        password: if block.know_how { crate::folder::KNOW_HOW } else { 0 },
        head: block.head.clone(),
        changed: block.changed,
        interface_changed: block.interface_changed,
        ..Part::default()
    }
}

/// Bytes a block takes besides its three parts: its head, and that of its record.
const AROUND: usize = 78;

fn part_row(table: &mut TableWriter, object: i64, ty: i64, number: u16, part: Part, page: CodePage) {
    let text = |text: &str| Cell::Bytes(page.bytes(text).into_iter().take(8).collect());
    let length = |bytes: &[u8]| Cell::Number(bytes.len() as i64);
    let total = part.code.len() + part.interface.len() + part.info.len() + AROUND;
    table.row(vec![
        ("OBJECTID", Cell::Number(object)),
        ("SUBBLKTYP", Cell::Bytes(format!("{ty:05}").into_bytes())),
        ("BLKNUMBER", Cell::Bytes(format!("{number:05}").into_bytes())),
        ("BLKLANG", Cell::Bytes(format!("{:05}", part.language).into_bytes())),
        ("ATTRIBUTE", Cell::Number(part.attribute)),
        ("AGRESERVED", Cell::Number(part.reserved)),
        ("BLKTOTLEN", Cell::Number(total as i64)),
        ("MC5LEN", length(&part.code)),
        ("SSBLEN", length(&part.interface)),
        ("ADDLEN", length(&part.info)),
        ("LOCDATALEN", Cell::Number(part.local_bytes)),
        ("TIMESTAMP1", Cell::Bytes(part.changed.bytes().to_vec())),
        ("TIMESTAMP2", Cell::Bytes(part.interface_changed.bytes().to_vec())),
        ("PASSWORD", Cell::Number(part.password)),
        ("USERNAME", text(&part.head.author)),
        ("BLOCKFNAME", text(&part.head.family)),
        ("BLOCKNAME", text(&part.head.name)),
        ("VERSION", Cell::Number(part.head.version.into())),
        ("MC5CODE", Cell::Memo(part.code)),
        ("SSBPART", Cell::Memo(part.interface)),
        ("ADDINFO", Cell::Memo(part.info)),
    ]);
}

impl Default for Block {
    fn default() -> Self {
        Self {
            id: ob1_model::BlockId::new(BlockKind::Fc, 1),
            language: Language::Stl,
            head: Head { version: 0x10, ..Head::default() },
            attribute: 1,
            know_how: false,
            code_version1: false,
            local_bytes: 0,
            code: Vec::new(),
            interface: Vec::new(),
            segments: Vec::new(),
            declarations: None,
            comments: Comments::default(),
            uses: Vec::new(),
            changed: ob1_mc7::Stamp::default(),
            interface_changed: ob1_mc7::Stamp::default(),
        }
    }
}

/// Writes the container with this ID.
fn write_sources(sources: &[SourceText], container: u32, page: CodePage, files: &mut Files) {
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

/// A record with these links.
fn link_record(offset: u32, links: Links) -> Vec<u8> {
    let symbols = links.symbols.and_then(|id| u32::try_from(id).ok());
    let entries = [(links::FOLDER, links.folder), (links::SYMBOLS, symbols), (links::SOURCES, links.sources)];
    let entries: Vec<((u32, u32), u32)> = entries.into_iter().filter_map(|(kind, id)| Some((kind, id?))).collect();
    let mut record = Vec::with_capacity(links::RECORD);
    record.extend(offset.to_le_bytes());
    record.extend(0u32.to_le_bytes());
    record.extend((entries.len() as u32).to_le_bytes());
    record.resize(links::HEAD, 0);
    for ((ty, relation), id) in entries {
        for word in [0, 0, ty, id, relation, 2] {
            record.extend(word.to_le_bytes());
        }
    }
    record.resize(links::RECORD, 0);
    record
}

/// The three memos of a comment part: heading, stream and labels. What is longer than its field is cut.
fn comment_memos(comments: &Comments, page: CodePage) -> (Vec<u8>, Vec<u8>, Vec<u8>) {
    let title = nul(page.bytes(&comments.title));
    let mut heading = vec![3];
    heading.extend(word(3 + title.len()));
    heading.extend(title);
    heading.extend(nul(page.bytes(&comments.comment)));
    let (mut stream, mut info) = (Vec::new(), word(comments.networks.len()).to_vec());
    for network in &comments.networks {
        let before = stream.len();
        let (title, comment) = (nul(page.bytes(&network.title)), nul(page.bytes(&network.comment)));
        stream.push(6);
        stream.extend(word(6 + title.len()));
        stream.extend(word(6 + title.len() + comment.len()));
        stream.push(6);
        stream.extend(title.into_iter().chain(comment));
        let mut at = 0;
        for line in &network.lines {
            let mut text = page.bytes(&line.text);
            text.truncate(255);
            stream.extend([text.len() as u8, 0]);
            stream.extend(word(line.statement.saturating_sub(at) as usize));
            stream.extend([if line.behind { 0x80 } else { 0 }, COLUMN]);
            stream.extend(text);
            at = line.statement;
        }
        info.extend(word(stream.len() - before));
    }
    info.extend(word(comments.labels.len()));
    for label in &comments.labels {
        let mut name = page.bytes(label);
        name.resize(4, 0);
        info.extend(name);
        info.push(0);
    }
    (heading, stream, info)
}

/// The column of the comments where STEP 7 prints a block.
const COLUMN: u8 = 28;

fn word(value: usize) -> [u8; 2] {
    u16::try_from(value).unwrap_or(u16::MAX).to_le_bytes()
}

fn nul(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.push(0);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_is_read_as_it_was_written() {
        let links = Links { folder: Some(3), symbols: Some(638), sources: None };
        let mut bytes = vec![0xAA; 512];
        bytes.extend(link_record(512, links));
        assert_eq!(links::read(&bytes, 512), links);
        for offset in [-1, 0, 513, 900, 1024, i64::MAX] {
            assert_eq!(links::read(&bytes, offset).folder, None, "{offset}");
        }
    }
}
