//! Project folders, written: for the example of this project, and for tests.
//!
//! What is written is what [`crate::Project`] reads and STEP 7 would find by itself: block folder, program, symbol
//! table, station with CPU and modules. Indexes (`.MDX`) and the editors' private parts are left out.

use ob1_model::BlockKind;

use crate::dbf_writer::{Cell, TableWriter};
use crate::folder::{Block, Head, KINDS, Language, Part, UDT, Udt};
use crate::hardware::{self, Cpu, DpSystem, Module};
use crate::links::{self, Links};
use crate::sources::{self, SourceText};
use crate::symbols::{self, SymbolRow};
use crate::text::CodePage;
use crate::tree::Files;

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

impl NewProject {
    /// The files of the project.
    #[must_use]
    pub fn files(&self) -> Files {
        let mut files = Files::default();
        files.put(&format!("{}.s7p", self.name), self.head());
        let language = format!("1\r\n1031\r\n0\r\n{}\r\n850\r\n", self.page.number());
        files.put("Global/Language", language);
        self.programs(&mut files);
        self.block_folder(&mut files);
        self.symbol_list(&mut files);
        sources::write(&self.sources, SOURCES_ID, self.page, &mut files);
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
        lnk.extend(links::write(512, Links { folder: Some(FOLDER_ID), symbols: list, sources }));
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
            let (heading, stream, info) = block.comments.write(self.page);
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

/// Used by those who describe a block in the language it was made in.
impl Language {
    pub(crate) fn number(self) -> i64 {
        match self {
            Language::Stl => 1,
            Language::Lad => 2,
            Language::Fbd => 3,
            Language::Scl => 4,
            Language::Db => 5,
            Language::Graph => 6,
            Language::Cfc => 7,
            Language::Other(number) => number.into(),
        }
    }
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
            comments: crate::Comments::default(),
            uses: Vec::new(),
            changed: ob1_mc7::Stamp::default(),
            interface_changed: ob1_mc7::Stamp::default(),
        }
    }
}
