//! SCL sources of a project beside the blocks that were made of them.
//!
//! What runs is the machine code. A source may stand in its place where it compiles in the program and declares the
//! very interface that the block was compiled with: callers and instances then fit. Whether its statements are those of
//! the block cannot be proven from the machine code, and is not claimed.

use std::collections::{BTreeMap, BTreeSet};

use ob1_ir::{Op, Program, Symbol};
use ob1_model::{BlockId, BlockKind, DataType, Interface, Param, Section};
use ob1_stl::{Library, Mnemonics, Options, Severity, Source};

use crate::compiled::alike;
use crate::sources::SourceText;
use crate::translate::Translation;

/// Stands before a source whose blocks were compiled with the option *set OK flag*.
pub const OK_FLAG: &str = "{SCL_SetOKFlag := 'y'} ";

/// Compilations until each source that is left is good: one that is refused may be missed by others.
const ROUNDS: usize = 16;

/// An SCL source of a project.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SclSource {
    /// The name of its file: `EASTER.scl`.
    pub name: String,
    /// Its text, with the option in front that its blocks were compiled with.
    pub text: String,
    /// The code blocks that it makes.
    pub blocks: Vec<BlockId>,
    /// Why it cannot stand in the place of the machine code. `None`: it can.
    pub why_not: Option<String>,
}

/// The SCL sources of a program, and which of them may stand in the place of its machine code.
pub fn scl_sources(
    texts: &[SourceText],
    translation: &Translation,
    library: &Library,
    symbols: &[Symbol],
    mnemonics: Mnemonics,
) -> Vec<SclSource> {
    let mut all = listed(texts, &translation.program, symbols);
    let options = Options { symbols: symbols.to_vec(), mnemonics, ..Options::default() };
    for round in 0.. {
        let open: Vec<usize> = (0..all.len()).filter(|at| all[*at].why_not.is_none()).collect();
        let refused = match round {
            ROUNDS => open.iter().map(|at| (*at, "too many of the sources that it needs are refused".into())).collect(),
            _ => judged(&all, &open, translation, library, &options),
        };
        if refused.is_empty() {
            break;
        }
        for (at, why) in refused {
            all[at].why_not.get_or_insert(why);
        }
    }
    all
}

/// All sources with what they make; those that cannot be taken by what they are have a reason.
fn listed(texts: &[SourceText], program: &Program, symbols: &[Symbol]) -> Vec<SclSource> {
    let addresses: BTreeMap<String, &str> =
        symbols.iter().map(|s| (s.name.to_uppercase(), s.address.as_str())).collect();
    let (mut out, mut names, mut taken) = (Vec::new(), BTreeSet::new(), BTreeSet::new());
    for text in texts.iter().filter(|text| !text.stl) {
        let heads = heads(&text.text);
        // A list of sources to compile has none.
        if heads.is_empty() {
            continue;
        }
        let made: Vec<Option<BlockId>> = heads
            .iter()
            .map(|(_, name)| BlockId::parse(addresses.get(&name.to_uppercase()).unwrap_or(&&**name)))
            .collect();
        let blocks: Vec<BlockId> = made.iter().flatten().copied().collect();
        let data = |id: &BlockId| id.kind == BlockKind::Db;
        let there = |id: &BlockId| program.blocks.iter().any(|block| block.id == *id);
        let why_not = match blocks.iter().find(|id| !there(id)) {
            _ if made.iter().any(Option::is_none) || blocks.iter().any(data) => {
                Some("it declares types or data: what the project has counts".to_owned())
            }
            Some(id) => Some(format!("{id} is not in the program")),
            None => blocks.iter().find(|id| taken.contains(*id)).map(|id| format!("{id} has another source")),
        };
        if why_not.is_none() {
            taken.extend(blocks.iter().copied());
        }
        let option = if blocks.iter().any(|id| has_ok(program, *id)) { OK_FLAG } else { "" };
        let stem: String = text.name.chars().map(|c| if c.is_alphanumeric() || c == '_' { c } else { '_' }).collect();
        let mut numbered = (1..).map(|n| if n == 1 { format!("{stem}.scl") } else { format!("{stem}_{n}.scl") });
        let Some(name) = numbered.find(|name| names.insert(name.to_uppercase())) else { continue };
        out.push(SclSource { name, text: format!("{option}{}", text.text), blocks, why_not });
    }
    out
}

/// Compiles the open sources beside those of the other blocks. Gives the ones to refuse, with their reasons.
fn judged(
    all: &[SclSource],
    open: &[usize],
    translation: &Translation,
    library: &Library,
    options: &Options,
) -> Vec<(usize, String)> {
    if open.is_empty() {
        return Vec::new();
    }
    let mut sources: Vec<Source> =
        open.iter().map(|at| Source::new(all[*at].name.clone(), all[*at].text.as_bytes())).collect();
    let replaced: BTreeSet<String> = open.iter().flat_map(|at| all[*at].blocks.iter().map(|id| awl(*id))).collect();
    let rest = translation.sources.iter().filter(|file| !replaced.contains(&file.name));
    sources.extend(rest.map(|file| Source::new(file.name.clone(), file.bytes.clone())));
    let output = ob1_scl::compile(&sources, library, options);
    let mut refused = BTreeMap::new();
    let mut beside = None;
    for d in output.diagnostics.iter().filter(|d| d.severity == Severity::Error) {
        for source in d.sources() {
            match open.get(source) {
                Some(at) => drop(refused.entry(*at).or_insert_with(|| {
                    format!("it does not compile here: line {}: {} ({})", d.line, d.message, d.code)
                })),
                None => beside = Some(format!("a block beside it does not fit: {} ({})", d.message, d.code)),
            }
        }
    }
    if refused.is_empty()
        && let Some(why) = beside
    {
        return open.iter().map(|at| (*at, why.clone())).collect();
    }
    let interface = |program: &Program, id: BlockId| -> Option<Interface> {
        program.blocks.iter().find(|block| block.id == id).map(|block| block.interface.clone())
    };
    for at in open {
        let fits = |id: &BlockId| {
            let both = interface(&output.program, *id).zip(interface(&translation.program, *id));
            both.is_some_and(|(mine, theirs)| same(&mine, &theirs))
        };
        if let Some(id) = all[*at].blocks.iter().find(|id| !fits(id)) {
            refused.entry(*at).or_insert_with(|| format!("it declares other parameters than {id} was compiled with"));
        }
    }
    refused.into_iter().collect()
}

/// The file of a block's statements.
pub fn awl(id: BlockId) -> String {
    format!("{}_{}.awl", id.kind.name(), id.number)
}

/// The same names, types and addresses in all but the temporaries.
fn same(mine: &Interface, theirs: &Interface) -> bool {
    let lasting = |interface: &'_ Interface| -> Vec<Param> {
        interface.params.iter().filter(|p| p.section != Section::Temp).cloned().collect()
    };
    let (a, b) = (lasting(mine), lasting(theirs));
    // The length of a STRING that a function gets is none of the compiled interface.
    let text = |p: &Param| mine.instance_bytes == 0 && matches!(p.ty, DataType::String(_));
    let alike = |a: &Param, b: &Param| {
        let types = alike(&a.ty, &b.ty) || text(a) && text(b);
        (a.section, a.at) == (b.section, b.at) && a.is_called(&b.name) && types
    };
    mine.instance_bytes == theirs.instance_bytes && a.len() == b.len() && a.iter().zip(&b).all(|(a, b)| alike(a, b))
}

/// What a source makes: the first words of its blocks and the names behind them.
pub fn heads(text: &str) -> Vec<(&'static str, String)> {
    const WORDS: [&str; 5] = ["FUNCTION_BLOCK", "FUNCTION", "TYPE", "DATA_BLOCK", "ORGANIZATION_BLOCK"];
    let mut out = Vec::new();
    for line in without_comments(text).lines() {
        let line = line.trim_start_matches('\u{feff}').trim();
        let begins = |word: &&str| {
            line.get(..word.len()).is_some_and(|start| start.eq_ignore_ascii_case(word))
                && line[word.len()..].starts_with([' ', '\t'])
        };
        if let Some(word) = WORDS.into_iter().find(begins) {
            let name = line[word.len()..].trim().trim_start_matches('"');
            out.push((word, name.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()));
        }
    }
    out
}

/// A text without its comments, which lie within each other; lines stay.
fn without_comments(text: &str) -> String {
    let mut kept = String::with_capacity(text.len());
    let (mut depth, mut to_the_end) = (0u32, false);
    let mut rest = text.chars().peekable();
    while let Some(c) = rest.next() {
        match (c, rest.peek()) {
            ('\n', _) => {
                to_the_end = false;
                kept.push(c);
            }
            _ if to_the_end => {}
            ('/', Some('/')) if depth == 0 => to_the_end = true,
            ('(', Some('*')) => {
                depth += 1;
                rest.next();
            }
            ('*', Some(')')) if depth > 0 => {
                depth -= 1;
                rest.next();
            }
            _ if depth == 0 => kept.push(c),
            _ => {}
        }
    }
    kept
}

/// Whether a block was compiled with the option of the OK flag: it clears the bit that it sets at its beginning.
pub fn has_ok(program: &Program, id: BlockId) -> bool {
    let Some(block) = program.blocks.iter().find(|b| b.id == id) else { return false };
    let ops: Vec<&Op> = block.code.iter().map(|s| &s.op).collect();
    let [Op::SetRlo, Op::SaveRlo, Op::Assign(ok), ..] = ops.as_slice() else { return false };
    ops.windows(2).any(|pair| matches!(pair, [Op::ClearRlo, Op::Assign(bit)] if bit == ok))
}
