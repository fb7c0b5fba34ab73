//! A block folder: the parts of its blocks, by block.

use std::collections::BTreeMap;

use ob1_mc7::Stamp;
use ob1_model::{BlockId, BlockKind};

use crate::comments::Comments;
use crate::dbf::{Damage, Memos, Row, Table};
use crate::note::{Note, Notes};
use crate::text::CodePage;
use crate::tree::Tree;

/// The language a block was made in. What runs is MC7 in every case.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "named as STEP 7 names them")]
pub enum Language {
    Stl,
    Lad,
    Fbd,
    Scl,
    Db,
    Graph,
    Cfc,
    /// Failsafe languages, empty blocks and what is not known.
    Other(u16),
}

impl Language {
    /// The languages by their numbers, from 1, with their short names.
    const NAMES: [(Self, &'static str); 7] = [
        (Language::Stl, "STL"),
        (Language::Lad, "LAD"),
        (Language::Fbd, "FBD"),
        (Language::Scl, "SCL"),
        (Language::Db, "DB"),
        (Language::Graph, "GRAPH"),
        (Language::Cfc, "CFC"),
    ];

    pub(crate) fn of_number(number: i64) -> Self {
        let known = Self::NAMES.into_iter().zip(1..).find(|(_, of)| *of == number);
        known.map_or_else(|| Language::Other(u16::try_from(number).unwrap_or(0)), |((language, _), _)| language)
    }

    /// As block heads have it.
    pub(crate) fn number(self) -> i64 {
        match self {
            Language::Other(number) => number.into(),
            known => Self::NAMES.into_iter().zip(1..).find(|((of, _), _)| *of == known).map_or(0, |(_, number)| number),
        }
    }

    /// Its short name, as STEP 7 shows it.
    pub fn name(self) -> &'static str {
        match self {
            Language::Other(31..=35) => "failsafe",
            known => Self::NAMES.into_iter().find(|(of, _)| *of == known).map_or("unknown", |(_, name)| name),
        }
    }
}

/// What is in the head of a block.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Head {
    /// AUTHOR; empty without one.
    pub author: String,
    /// FAMILY; empty without one.
    pub family: String,
    /// NAME of the head; empty without one.
    pub name: String,
    /// VERSION, as two nibbles.
    pub version: u8,
}

/// A block as the folder has it: its code part, and what belongs to it.
#[derive(Clone, Debug)]
pub struct Block {
    /// Kind and number of the block.
    pub id: BlockId,
    /// The language it was made in.
    pub language: Language,
    /// Author, family, name, version.
    pub head: Head,
    /// ATTRIBUTE of the record: bit 0 executable, bit 1 standard block, bit 3 system block; of a data block
    /// bit 5 not retentive.
    pub attribute: u8,
    /// KNOW_HOW_PROTECT: its statements are not shown.
    pub know_how: bool,
    /// `CODE_VERSION1`: an FB whose own variables are addressed without AR2.
    pub code_version1: bool,
    /// Bytes of local data, those the compiler added included.
    pub local_bytes: u16,
    /// MC7 code; of a data block the current values.
    pub code: Vec<u8>,
    /// The compiled interface (SSBPART).
    pub interface: Vec<u8>,
    /// Networks and jumps (ADDINFO).
    pub segments: Vec<u8>,
    /// The declarations as text; `None` when there is no such part.
    pub declarations: Option<String>,
    /// Titles, comments and labels.
    pub comments: Comments,
    /// Blocks its code names, as the folder lists them.
    pub uses: Vec<Use>,
    /// When the code was changed.
    pub changed: Stamp,
    /// When the interface was changed.
    pub interface_changed: Stamp,
}

/// A block that another one uses.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Use {
    /// Kind and number: `SFC20`.
    pub name: String,
    /// The time of the interface the user was compiled against.
    pub interface: Stamp,
}

/// A user-defined type (UDT).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Udt {
    /// Its declarations as text.
    pub declarations: String,
    /// Author, family, name, version.
    pub head: Head,
}

/// A block folder: everything of one program.
#[derive(Clone, Debug, Default)]
pub struct Folder {
    /// Code and data blocks, system blocks included.
    pub blocks: BTreeMap<BlockId, Block>,
    /// User-defined types by number.
    pub udts: BTreeMap<u16, Udt>,
    /// Records whose block could not be read, with the reason.
    pub damaged: BTreeMap<String, String>,
    /// What else there is to say.
    pub notes: Notes,
}

/// The parts of one kind of block: code, declarations, comments, dependencies.
pub(crate) struct Kind {
    pub(crate) kind: BlockKind,
    pub(crate) code: i64,
    pub(crate) declarations: i64,
    pub(crate) comments: i64,
    uses: i64,
}

const fn kind(kind: BlockKind, [code, declarations, comments, uses]: [i64; 4]) -> Kind {
    Kind { kind, code, declarations, comments, uses }
}

pub(crate) const KINDS: [Kind; 6] = [
    kind(BlockKind::Ob, [8, 3, 17, 67]),
    kind(BlockKind::Fb, [14, 4, 18, 64]),
    kind(BlockKind::Fc, [12, 5, 19, 65]),
    kind(BlockKind::Db, [10, 6, 20, 66]),
    kind(BlockKind::Sfb, [15, 9, 21, 71]),
    kind(BlockKind::Sfc, [13, 7, 22, 70]),
];

/// The declarations of a UDT.
pub(crate) const UDT: i64 = 1;

/// A part as its record has it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Part {
    pub(crate) language: i64,
    pub(crate) attribute: i64,
    pub(crate) reserved: i64,
    pub(crate) local_bytes: i64,
    pub(crate) password: i64,
    pub(crate) head: Head,
    pub(crate) changed: Stamp,
    pub(crate) interface_changed: Stamp,
    pub(crate) code: Vec<u8>,
    pub(crate) interface: Vec<u8>,
    pub(crate) info: Vec<u8>,
    pub(crate) damage: Option<Damage>,
}

type Parts = BTreeMap<(i64, u16), Part>;

impl Folder {
    /// Reads the folder at `path`, which ends in `/`.
    ///
    /// # Errors
    /// Why nothing can be read, in one sentence.
    pub fn read(tree: &Tree<'_>, path: &str, page: CodePage) -> Result<Self, String> {
        let mut folder = Folder::default();
        let mut parts = Parts::new();
        // One old library keeps the parts in BAUSTEIN itself.
        let mut found = false;
        for name in ["SUBBLK", "BAUSTEIN"] {
            let file = format!("{path}{name}.DBF");
            let Some(bytes) = tree.read(&file) else {
                // What is there and cannot be read is not replaced by the other one.
                if tree.has(&file) {
                    return Err(format!("{file}: {}", tree.why_not(&file)));
                }
                continue;
            };
            let table = Table::parse(bytes).map_err(|damage| format!("{path}{name}.DBF: {damage}"))?;
            if !table.has("SUBBLKTYP") {
                continue;
            }
            found = true;
            let memo_file = format!("{path}{name}.DBT");
            let memos = Memos::open(tree, &memo_file);
            folder.notes.extend(table.cut_off().map(|what| Note::warning(format!("{path}{name}.DBF"), what)));
            if let Err(damage) = &memos
                && table.rows().next().is_some()
            {
                let what = format!("{damage}: the blocks of this folder have names and no content");
                folder.notes.push(Note::warning(memo_file, what));
            }
            read_parts(&table, memos.as_ref(), page, &mut parts, &mut folder.notes);
            break;
        }
        if !found {
            return Err(format!("{path} has no table of blocks (SUBBLK.DBF)"));
        }
        folder.assemble(parts, page);
        Ok(folder)
    }

    /// How many code blocks and data blocks the folder at `path` has, by its table alone.
    pub(crate) fn count(tree: &Tree<'_>, path: &str) -> u32 {
        let table = |name: &str| {
            let table = Table::parse(tree.read(&format!("{path}{name}.DBF"))?).ok()?;
            table.has("SUBBLKTYP").then_some(table)
        };
        let Some(table) = ["SUBBLK", "BAUSTEIN"].into_iter().find_map(table) else { return 0 };
        let is_block = |row: &Row<'_>| {
            let part = row.number("SUBBLKTYP");
            KINDS.iter().any(|kind| kind.code == part && !kind.kind.is_system())
        };
        u32::try_from(table.rows().filter(is_block).count()).unwrap_or(u32::MAX)
    }

    fn assemble(&mut self, mut parts: Parts, page: CodePage) {
        let keys: Vec<(i64, u16)> = parts.keys().copied().collect();
        for (part, number) in keys {
            if part == UDT {
                self.udt(number, parts.remove(&(part, number)).unwrap_or_default(), page);
            }
            let Some(kind) = KINDS.iter().find(|kind| kind.code == part) else { continue };
            let id = BlockId::new(kind.kind, number);
            let code = parts.remove(&(kind.code, number)).unwrap_or_default();
            if let Some(damage) = &code.damage {
                self.damaged.insert(id.to_string(), damage.to_string());
                continue;
            }
            let mut text = |part| parts.remove(&(part, number));
            let declarations = text(kind.declarations);
            let comments = text(kind.comments);
            let uses = text(kind.uses);
            for (what, part) in [("declarations", &declarations), ("comments", &comments)] {
                if let Some(damage) = part.as_ref().and_then(|part| part.damage.as_ref()) {
                    self.notes.push(Note::warning(id.to_string(), format!("its {what} are lost: {damage}")));
                }
            }
            let comments = comments.map(|part| Comments::read(&part.interface, &part.code, &part.info, page));
            if comments.as_ref().is_some_and(|comments| comments.damaged) {
                let what = "its comments end in damaged bytes: the comments behind them are lost";
                self.notes.push(Note::warning(id.to_string(), what));
            }
            let block = Block {
                id,
                language: Language::of_number(code.language),
                head: code.head,
                attribute: u8::try_from(code.attribute).unwrap_or(0),
                know_how: code.password == KNOW_HOW && kind.kind != BlockKind::Db,
                code_version1: code.reserved == 0,
                local_bytes: u16::try_from(code.local_bytes).unwrap_or(0),
                code: code.code,
                interface: code.interface,
                segments: code.info,
                declarations: declarations.filter(|part| part.damage.is_none()).map(|part| text_of(&part.code, page)),
                comments: comments.unwrap_or_default(),
                uses: uses.map(|part| read_uses(&part.info)).unwrap_or_default(),
                changed: code.changed,
                interface_changed: code.interface_changed,
            };
            self.blocks.insert(id, block);
        }
    }

    fn udt(&mut self, number: u16, part: Part, page: CodePage) {
        match part.damage {
            Some(damage) => {
                self.damaged.insert(format!("UDT {number}"), damage.to_string());
            }
            None => {
                self.udts.insert(number, Udt { declarations: text_of(&part.code, page), head: part.head });
            }
        }
    }
}

/// PASSWORD of a block with KNOW_HOW_PROTECT.
pub(crate) const KNOW_HOW: i64 = 3;

/// A time of a record; what is not 6 bytes is unset.
fn stamp(bytes: &[u8]) -> Stamp {
    bytes.first_chunk().map_or_else(Stamp::default, |bytes| Stamp::read(*bytes))
}

fn text_of(bytes: &[u8], page: CodePage) -> String {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    page.text(&bytes[..end])
}

fn read_parts(table: &Table, memos: Result<&Memos, &Damage>, page: CodePage, parts: &mut Parts, notes: &mut Notes) {
    for row in table.rows() {
        let Ok(number) = u16::try_from(row.number("BLKNUMBER")) else { continue };
        let key = (row.number("SUBBLKTYP"), number);
        let wanted =
            key.0 == UDT || KINDS.iter().any(|k| [k.code, k.declarations, k.comments, k.uses].contains(&key.0));
        if !wanted {
            continue;
        }
        let mut part = Part {
            language: row.number("BLKLANG"),
            attribute: row.number("ATTRIBUTE"),
            reserved: row.number("AGRESERVED"),
            local_bytes: row.number("LOCDATALEN"),
            password: row.number("PASSWORD"),
            head: Head {
                author: page.text(row.trimmed("USERNAME")),
                family: page.text(row.trimmed("BLOCKFNAME")),
                name: page.text(row.trimmed("BLOCKNAME")),
                version: u8::try_from(row.number("VERSION")).unwrap_or(0),
            },
            changed: stamp(row.bytes("TIMESTAMP1")),
            interface_changed: stamp(row.bytes("TIMESTAMP2")),
            ..Part::default()
        };
        for (field, length, into) in [
            ("MC5CODE", "MC5LEN", &mut part.code),
            ("SSBPART", "SSBLEN", &mut part.interface),
            ("ADDINFO", "ADDLEN", &mut part.info),
        ] {
            let length = usize::try_from(row.number(length)).unwrap_or(0);
            match Memos::get(memos, &row, field, length) {
                Ok(bytes) => *into = bytes,
                Err(damage) => part.damage = Some(part.damage.take().unwrap_or(damage)),
            }
        }
        match parts.get(&key) {
            // A row that a crash left: the later one counts.
            Some(before) if before.changed > part.changed => notes.push(twice(key)),
            Some(_) => {
                notes.push(twice(key));
                parts.insert(key, part);
            }
            None => {
                parts.insert(key, part);
            }
        }
    }
}

fn twice((part, number): (i64, u16)) -> Note {
    let of = KINDS.iter().find(|k| [k.code, k.declarations, k.comments, k.uses].contains(&part));
    let name = of.map_or_else(|| format!("UDT {number}"), |k| BlockId::new(k.kind, number).to_string());
    Note::warning(name, format!("its part {part} occurs twice; the later one counts"))
}

/// `SFC20,` and two times of 6 bytes and `;`, again and again, to a NUL.
fn read_uses(bytes: &[u8]) -> Vec<Use> {
    let mut uses = Vec::new();
    let mut rest = bytes;
    while let Some(comma) = rest.iter().position(|b| *b == b',') {
        let (name, tail) = rest.split_at(comma);
        let (Some(stamp), Ok(name)) = (tail.get(1..7), std::str::from_utf8(name)) else { break };
        if name.is_empty() || !name.bytes().all(|b| b.is_ascii_alphanumeric()) {
            break;
        }
        uses.push(Use { name: name.to_owned(), interface: self::stamp(stamp) });
        rest = tail.get(14..).unwrap_or_default();
    }
    uses
}
