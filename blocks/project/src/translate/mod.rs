//! A block folder becomes a program: STL sources that say the same as the machine code, and machine code for the rest.
//!
//! The sources are checked against the machine code by compiling them: a block whose source does not give the very same
//! statements stays in machine code, so that what runs is always what the project has.

mod data_values;
mod statements;

use std::collections::{BTreeMap, BTreeSet};

use ob1_ir::{DataBlock, DataKind, Program, Symbol};
use ob1_mc7::{BlockFoot, BlockHead, BlockImage, CompiledInterface, Decoded, InterfaceKind};
use ob1_model::{BlockId, BlockKind, Interface};
use ob1_stl::{Library, Mnemonics, Options, Output, Source};

use crate::compiled;
use crate::folder::{Block, Folder};
use crate::note::{Note, Notes};
use crate::overlay::{self, Image};
use crate::source::{self, Declarations};
use crate::text::CodePage;

/// How a folder is translated.
#[derive(Debug)]
pub struct Wanted<'w> {
    /// The code page of its texts.
    pub page: CodePage,
    /// The blocks the program may call besides its own; among them those of [`Wanted::replaced`].
    pub library: &'w Library,
    /// Blocks of the project that are replaced by others.
    pub replaced: &'w BTreeSet<BlockId>,
    /// The symbols, as the symbol table will give them.
    pub symbols: Vec<Symbol>,
    /// The mnemonics of the sources.
    pub mnemonics: Mnemonics,
}

/// A file of the program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProgramFile {
    /// Its name: `FC_5.awl`, `FC_5.mc7`.
    pub name: String,
    /// Its content, as it goes to the disk.
    pub bytes: Vec<u8>,
}

/// The result of translating a folder.
#[derive(Debug, Default)]
pub struct Translation {
    /// STL sources, one for each block.
    pub sources: Vec<ProgramFile>,
    /// Blocks in machine code.
    pub images: Vec<ProgramFile>,
    /// The program those files make.
    pub program: Program,
    /// Blocks of the folder: OB, FB, FC and DB.
    pub blocks: usize,
    /// Of these, the ones that came over.
    pub decoded: usize,
    /// Code blocks whose source gives the very statements of their machine code.
    pub printed: usize,
    /// Blocks that did not come over, with the reason.
    pub left_out: BTreeMap<String, String>,
    /// What there is to say.
    pub notes: Notes,
}

/// Translates a folder, as far as that is possible; the rest is in the notes.
pub fn translate(folder: &Folder, wanted: &Wanted<'_>) -> Translation {
    let mut draft = Draft::new(folder, wanted);
    draft.settle();
    draft.decode();
    if draft.stand_in() {
        // With their interfaces the calls of the stand-ins fold.
        draft.decode();
    }
    draft.reserve();
    draft.write_statements();
    draft.finish()
}

/// Times that declarations are compiled anew: a mistake in a type shows in what is made of it only when the type is
/// gone, and types may lie deep in each other.
const ROUNDS: u32 = 32;

/// What is wrong with the sources: the first mistake of each.
fn errors(output: &Output, files: &[(Of, String)]) -> BTreeMap<Of, String> {
    let mut wrong = BTreeMap::new();
    for diagnostic in output.diagnostics.iter().filter(|d| d.severity == ob1_stl::Severity::Error) {
        for (of, _) in diagnostic.sources().filter_map(|source| files.get(source)) {
            wrong.entry(*of).or_insert_with(|| format!("{} {}", diagnostic.code, diagnostic.message));
        }
    }
    wrong
}

/// A source file on its way.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Of {
    Udt(u16),
    Block(BlockId),
}

impl std::fmt::Display for Of {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Of::Udt(number) => write!(f, "UDT {number}"),
            Of::Block(id) => id.fmt(f),
        }
    }
}

struct Draft<'f> {
    folder: &'f Folder,
    wanted: &'f Wanted<'f>,
    /// The blocks the program may call besides its own, the substitutes for missing ones included.
    library: Library,
    /// Substitutes for missing blocks.
    stand_ins: Vec<Image>,
    compiled: BTreeMap<BlockId, CompiledInterface>,
    udts: BTreeMap<u16, Declarations>,
    declared: BTreeMap<BlockId, Declarations>,
    /// Shapes of data blocks: STRUCT, UDT or FB.
    shapes: BTreeMap<BlockId, String>,
    values: BTreeMap<BlockId, Vec<(String, String)>>,
    statements: BTreeMap<BlockId, String>,
    decoded: BTreeMap<BlockId, Decoded>,
    interfaces: BTreeMap<BlockId, Interface>,
    /// Blocks whose heads say more local data than declarations and statements show.
    reserved: BTreeSet<BlockId>,
    /// Blocks that stay in machine code.
    images: BTreeSet<BlockId>,
    printed: BTreeSet<BlockId>,
    /// Blocks whose declarations have no names in the project.
    nameless: Vec<BlockId>,
    out: Translation,
}

impl<'f> Draft<'f> {
    fn new(folder: &'f Folder, wanted: &'f Wanted<'f>) -> Self {
        let mut draft = Self {
            folder,
            wanted,
            library: wanted.library.clone(),
            stand_ins: Vec::new(),
            compiled: BTreeMap::new(),
            udts: BTreeMap::new(),
            declared: BTreeMap::new(),
            shapes: BTreeMap::new(),
            values: BTreeMap::new(),
            statements: BTreeMap::new(),
            decoded: BTreeMap::new(),
            interfaces: BTreeMap::new(),
            reserved: BTreeSet::new(),
            images: BTreeSet::new(),
            printed: BTreeSet::new(),
            nameless: Vec::new(),
            out: Translation {
                left_out: folder.damaged.clone(),
                notes: folder.notes.clone(),
                ..Translation::default()
            },
        };
        let is_block = |name: &&String| !name.starts_with("SF") && !name.starts_with("UDT");
        draft.out.blocks = folder.damaged.keys().filter(is_block).count();
        for (number, udt) in &folder.udts {
            draft.udts.insert(*number, Declarations::of_text(&udt.declarations, false, wanted.page));
        }
        for (id, block) in &folder.blocks {
            if id.kind.is_system() {
                continue;
            }
            draft.out.blocks += 1;
            if wanted.replaced.contains(id) {
                continue;
            }
            match CompiledInterface::read(&block.interface) {
                Ok(compiled) => drop(draft.compiled.insert(*id, compiled)),
                Err(error) => draft.note(*id, format!("its compiled interface cannot be read: {error}")),
            }
            draft.first_declarations(*id, block);
        }
        draft
    }

    /// Says which names are made up.
    fn tell_nameless(&mut self) {
        const SHOWN: usize = 12;
        let count = self.nameless.len();
        if count == 0 {
            return;
        }
        let list: Vec<String> = self.nameless.iter().take(SHOWN).map(BlockId::to_string).collect();
        let more = if count > SHOWN { ", ..." } else { "" };
        self.out.notes.push(Note::info(
            "names",
            format!(
                "the project has none for the declarations of {count} block(s), IN0, OUT0, STAT0 stand for them ({}{more}); \
                 `--names-from OLD.s7p` takes those of an older project",
                list.join(", ")
            ),
        ));
    }

    fn note(&mut self, of: impl std::fmt::Display, what: impl Into<String>) {
        self.out.notes.push(Note::warning(of.to_string(), what));
    }

    fn leave_out(&mut self, id: BlockId, reason: impl Into<String>) {
        self.out.left_out.insert(id.to_string(), reason.into());
        self.declared.remove(&id);
        self.shapes.remove(&id);
        self.statements.remove(&id);
        self.decoded.remove(&id);
        self.images.remove(&id);
    }

    fn first_declarations(&mut self, id: BlockId, block: &Block) {
        let text = block.declarations.as_deref().unwrap_or_default();
        let has_entries = self.compiled.get(&id).is_some_and(|c| !c.entries.is_empty());
        let is_blank = text.trim_matches(['\0', ' ', '\r', '\n', '\t']).is_empty();
        let is_instance = self.compiled.get(&id).and_then(overlay::instance_of).is_some();
        if is_blank && has_entries && !is_instance {
            self.nameless.push(id);
        }
        if id.kind == BlockKind::Db {
            let shape = self.shape(id, text);
            self.shapes.insert(id, shape);
            return;
        }
        if block.code.is_empty() {
            self.leave_out(id, "it has no machine code");
            return;
        }
        let declarations = if is_blank && has_entries {
            self.made(id, None)
        } else {
            Declarations::of_text(text, id.kind == BlockKind::Fc, self.wanted.page)
        };
        self.declared.insert(id, declarations);
    }

    /// What a data block is made of.
    fn shape(&self, id: BlockId, text: &str) -> String {
        let compiled = self.compiled.get(&id);
        let fb = compiled.and_then(overlay::instance_of).filter(|fb| self.exists(*fb));
        let udt = compiled.filter(|c| c.kind == InterfaceKind::OfUdt && self.udts.contains_key(&c.number));
        let declared = Declarations::of_text(text, false, self.wanted.page).text;
        match (fb, udt, compiled) {
            (Some(fb), ..) => fb.to_string(),
            (_, Some(udt), _) => format!("UDT {}", udt.number),
            // The sections of a missing FB still make a structure.
            (.., Some(compiled)) if !declared.trim_start().starts_with("STRUCT") => {
                compiled::structure(compiled, &[], &|_| false)
            }
            _ => declared,
        }
    }

    fn exists(&self, id: BlockId) -> bool {
        // One that stays in machine code without declarations is in no source.
        let own = |block: &Block| !block.code.is_empty() && id.kind == BlockKind::Fb && !self.images.contains(&id);
        self.library.get(id).is_some() || self.folder.blocks.get(&id).is_some_and(own)
    }

    fn made(&self, id: BlockId, text: Option<&Interface>) -> Declarations {
        let known = |id| self.exists(id);
        self.compiled.get(&id).map(|c| compiled::declarations(c, text, &known)).unwrap_or_default()
    }

    /// The sources as they are now, in an order that stays.
    fn files(&self) -> Vec<(Of, String)> {
        let mut files = Vec::new();
        for (number, declarations) in &self.udts {
            let head = self.folder.udts.get(number).map(|udt| udt.head.clone()).unwrap_or_default();
            files.push((Of::Udt(*number), source::udt_source(*number, &head, declarations)));
        }
        for (id, block) in &self.folder.blocks {
            if let Some(shape) = self.shapes.get(id) {
                let values = self.values.get(id).map(Vec::as_slice).unwrap_or_default();
                files.push((Of::Block(*id), source::data_source(block, shape, values)));
            } else if let Some(declarations) = self.declared.get(id) {
                let statements = self.statements.get(id).map_or("", String::as_str);
                files.push((Of::Block(*id), source::code_source(block, declarations, statements)));
            }
        }
        files
    }

    fn compile(&self, files: &[(Of, String)]) -> Output {
        let sources: Vec<Source> =
            files.iter().map(|(of, text)| Source::new(of.to_string(), text.as_bytes())).collect();
        let options =
            Options { mnemonics: self.wanted.mnemonics, symbols: self.wanted.symbols.clone(), ..Options::default() };
        ob1_stl::compile(&sources, &self.library, &options)
    }

    /// Declarations that compile and say what the compiled interfaces say.
    fn settle(&mut self) {
        // From the texts; from the compiled interface where a text has a mistake or says something else.
        let mut from_compiled = BTreeSet::new();
        for _ in 0..ROUNDS {
            let files = self.files();
            let output = self.compile(&files);
            let mut wrong = errors(&output, &files);
            for block in &output.program.blocks {
                let id = block.id;
                let agrees = self.compiled.get(&id).is_none_or(|c| compiled::agree(c, &block.interface));
                if agrees || from_compiled.contains(&id) || wrong.contains_key(&Of::Block(id)) {
                    continue;
                }
                let made = self.made(id, Some(&block.interface));
                self.declared.insert(id, made);
                from_compiled.insert(id);
                self.note(id, "its text declares something else than it was compiled with; the compiled form counts");
                wrong.insert(Of::Block(id), String::new());
            }
            for data in &output.program.data {
                let id = BlockId::new(BlockKind::Db, data.number);
                let Some(compiled) = self.compiled.get(&id).filter(|c| !compiled::agree_data(c, &data.components))
                else {
                    continue;
                };
                if wrong.contains_key(&Of::Block(id)) || !from_compiled.insert(id) {
                    continue;
                }
                let shape = compiled::structure(compiled, &data.components, &|_| false);
                self.shapes.insert(id, shape);
                self.note(id, "its text declares something else than it was compiled with; the compiled form counts");
                wrong.insert(Of::Block(id), String::new());
            }
            if wrong.is_empty() {
                return;
            }
            let texts = self.without_missing_types(&wrong);
            for (of, why) in wrong.into_iter().filter(|(_, why)| !why.is_empty()) {
                self.mend(of, &why, &texts, &mut from_compiled);
            }
        }
    }

    /// The program with a stand-in for each UDT that is not there, in blocks with a mistake: it has the names of their
    /// texts.
    fn without_missing_types(&self, wrong: &BTreeMap<Of, String>) -> Program {
        let mut files = self.files();
        let is_there = |number: u16| self.udts.contains_key(&number);
        for (of, text) in &mut files {
            if matches!(of, Of::Block(_)) && wrong.contains_key(of) {
                *text = compiled::with_unknown_types(text, &is_there);
            }
        }
        self.compile(&files).program
    }

    /// Other declarations for a block whose present ones have a mistake. Those of the compiled interface, which
    /// `from_compiled` tells, are tried once; they have the names of `texts`.
    fn mend(&mut self, of: Of, why: &str, texts: &Program, from_compiled: &mut BTreeSet<BlockId>) {
        let id = match of {
            Of::Udt(number) => {
                self.udts.remove(&number);
                self.out.left_out.insert(of.to_string(), why.to_owned());
                return;
            }
            Of::Block(id) => id,
        };
        let made = self.compiled.contains_key(&id) && from_compiled.insert(id);
        match (id.kind, made) {
            (BlockKind::Db, true) => {
                let text = texts.data.iter().find(|data| data.number == id.number);
                let names = text.map_or(&[][..], |data| &data.components);
                let shape = compiled::structure(&self.compiled[&id], names, &|_| false);
                self.shapes.insert(id, shape);
                self.note(id, format!("its text cannot be used ({why}); the compiled form counts"));
            }
            (BlockKind::Db, false) => {
                // Its values need no declarations.
                self.shapes.remove(&id);
                self.images.insert(id);
                self.note(id, format!("its declarations cannot be used ({why}); it has values without names"));
            }
            (_, true) => {
                let text = texts.blocks.iter().find(|block| block.id == id);
                let made = self.made(id, text.map(|block| &block.interface));
                self.declared.insert(id, made);
                self.note(id, format!("its text cannot be used ({why}); the compiled form counts"));
            }
            (_, false) => {
                self.declared.remove(&id);
                self.images.insert(id);
                self.note(
                    id,
                    format!("its declarations cannot be used ({why}); it stays in machine code without names"),
                );
            }
        }
    }

    /// Values of data blocks, the files, and the program they make.
    fn finish(mut self) -> Translation {
        self.tell_nameless();
        self.data_values();
        let files = self.files();
        let mut output = self.compile(&files);
        let mut images = std::mem::take(&mut self.stand_ins);
        for id in &self.images {
            let Some(block) = self.folder.blocks.get(id) else { continue };
            let mut image = image_of(block);
            let made_for = |db: &&DataBlock| {
                id.kind == BlockKind::Db && db.number == id.number && matches!(db.kind, DataKind::Instance(_))
            };
            // No CPU here takes an instance that is shorter than its block.
            if let Some(db) = output.program.data.iter().find(made_for) {
                image.code.extend_from_slice(db.bytes.get(image.code.len()..).unwrap_or_default());
            }
            images.push(Image { file: format!("{}.mc7", source::file_stem(*id)), block: image });
        }
        let refused = overlay::overlay(&mut output.program, &images, &self.library).err().unwrap_or_default();
        for refused in refused {
            if let Some(id) = refused.block {
                self.leave_out(id, refused.reason);
            }
        }
        let verified = {
            let external = |id: BlockId| self.library.get(id).map(|block| &block.interface);
            ob1_ir::verify(&output.program, &external)
        };
        for finding in verified.err().unwrap_or_default() {
            if let Some(id) = finding.block.filter(|id| self.decoded.contains_key(id)) {
                self.out.left_out.insert(id.to_string(), format!("its statements do not hold together: {finding}"));
            }
        }
        let mut out = self.out;
        for image in images {
            match image.block.bytes() {
                Ok(bytes) => out.images.push(ProgramFile { name: image.file, bytes }),
                Err(error) => drop(
                    out.left_out.insert(image.id().map_or_else(String::new, |id| id.to_string()), error.to_string()),
                ),
            }
        }
        for (of, text) in files {
            let name = match of {
                Of::Udt(number) => format!("UDT_{number}.awl"),
                Of::Block(id) => format!("{}.awl", source::file_stem(id)),
            };
            out.sources.push(ProgramFile { name, bytes: text.into_bytes() });
        }
        out.printed = self.printed.len();
        let is_block = |name: &&String| !name.starts_with("UDT") && !name.starts_with("SF");
        out.decoded = out.blocks - out.left_out.keys().filter(is_block).count().min(out.blocks);
        out.program = output.program;
        out
    }
}

/// A block of a folder as a CPU would hold it.
pub fn image_of(block: &Block) -> BlockImage {
    let text = |text: &str| {
        let mut out = [0u8; 8];
        out.iter_mut().zip(text.bytes()).for_each(|(to, from)| *to = from);
        out
    };
    BlockImage {
        head: BlockHead {
            version: u8::from(!block.code_version1),
            attribute: block.attribute | if block.know_how { 8 } else { 0 },
            language: block.language.number() as u8,
            kind: BlockHead::kind_byte(block.id.kind),
            number: block.id.number,
            password: if block.know_how { crate::folder::KNOW_HOW as u32 } else { 0 },
            code_changed: block.changed,
            interface_changed: block.interface_changed,
            local_bytes: block.local_bytes,
        },
        code: block.code.clone(),
        interface: block.interface.clone(),
        segments: block.segments.clone(),
        foot: BlockFoot {
            author: text(&block.head.author),
            family: text(&block.head.family),
            name: text(&block.head.name),
            version: block.head.version,
            ..BlockFoot::default()
        },
    }
}
