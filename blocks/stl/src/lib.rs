//! STL/AWL source text to blocks and diagnostics.
//!
//! The way of a source: bytes -> text ([`Source`]) -> tokens -> blocks with declarations and statements, operands still
//! tokens -> the world (numbers, types, interfaces, data blocks of all sources and the library) -> operations. Each
//! stage continues after a mistake, so that one run finds all of them; none panics, whatever the bytes; each takes time
//! linear in the input.
//!
//! This crate knows the instruction set ([`ob1_ir`]) and no engine.

mod address;
mod auto;
mod brackets;
mod call;
#[allow(missing_docs, reason = "what front ends share; the names are those of the language")]
mod constant;
mod data;
#[allow(missing_docs, reason = "what front ends share; the names are those of the language")]
mod diagnostic;
mod elaborate;
mod expand;
#[allow(missing_docs, reason = "what front ends share; the names are those of the language")]
mod fields;
mod fit;
#[allow(missing_docs, reason = "what front ends share; the names are those of the language")]
mod fold;
pub mod front;
#[allow(missing_docs, reason = "what front ends share; the names are those of the language")]
mod identifiers;
mod initial;
mod inspect;
mod jumps;
mod lexer;
mod library;
mod lint_accu;
mod lint_br;
mod lint_constant;
mod lint_memory;
mod lint_paths;
mod lints;
mod listing;
mod literal;
mod lower;
pub mod messages;
mod mnemonics;
mod names;
mod near;
#[allow(missing_docs, reason = "what front ends share; the names are those of the language")]
mod numbering;
#[allow(missing_docs, reason = "what front ends share; the names are those of the language")]
mod operand;
mod parse_code;
mod parse_scl;
mod parse_types;
#[allow(missing_docs, reason = "what front ends share; the names are those of the language")]
mod parser;
#[allow(missing_docs, reason = "what front ends share; the names are those of the language")]
mod path;
pub mod print;
mod raw_list;
mod reach;
#[allow(missing_docs, reason = "what front ends share; the names are those of the language")]
mod reader;
mod recognise;
#[allow(missing_docs, reason = "what front ends share; the names are those of the language")]
mod source;
mod source_lines;
mod supplied;
mod symbol_formats;
mod symbol_table;
mod symbols;
#[allow(missing_docs, reason = "what front ends share; the names are those of the language")]
mod syntax;
#[allow(missing_docs, reason = "what front ends share; the names are those of the language")]
mod tia;
mod time;
#[allow(missing_docs, reason = "what front ends share; the names are those of the language")]
mod token;
#[allow(missing_docs, reason = "what front ends share; the names are those of the language")]
mod type_words;
mod types;
mod value;
mod value_text;
#[allow(missing_docs, reason = "what front ends share; the names are those of the language")]
mod words;
#[allow(missing_docs, reason = "what front ends share; the names are those of the language")]
mod world;
mod xref;

use std::collections::{BTreeMap, BTreeSet};

use ob1_ir::{DataBlock, DataKind, Program, Symbol};
use ob1_model::BlockId;

pub use diagnostic::{Diagnostic, Limit, Rest, USES, excerpt, printable, render, render_all};
pub use library::{CANDIDATES, Candidate, KEY, Library, LibraryBlock, Missing};
pub use listing::listing;
pub use messages::Severity;
pub use mnemonics::Mnemonics;
pub use near::nearest;
pub use numbering::Numbered;
pub use recognise::{EXPORT_TAGS, names_no_symbol};
pub use source::Source;
pub use source_lines::{block_lines, in_other_set, most, sets_of};
pub use symbol_table::{SymbolTable, TableForm, read_symbol_tables, read_symbols};
pub use value_text::{constant_bits, constant_bytes, duration_text};

pub use xref::{
    AREAS, Access, Assignment, ByteUse, CrossReference, Match, Reference, Unknown, Uses, WrittenTwice, address_in_set,
    in_set, render_xref, xref, xref_with,
};

pub use fold::apply as fold_constants;

use auto::Sets;
use diagnostic::Sink;
use elaborate::{Elaborator, Named};
use front::{Scope, Statements};
use parse_scl::Bodies;
use recognise::Other;
use token::{File, Span};
use words::Words;
use world::{Data, World};

/// How sources are read.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The set of mnemonics the sources are written in.
    pub mnemonics: Mnemonics,
    /// Symbols, from symbol tables.
    pub symbols: Vec<Symbol>,
    /// Look for the classic porting traps as well (S0903 to S0911).
    pub lints: bool,
    /// Numbers of blocks that have a name only, as the user has fixed them.
    pub fixed: Vec<Numbered>,
    /// Numbers given to such blocks before.
    pub kept: Vec<Numbered>,
    /// The most findings that are wanted; all without.
    pub limit: Option<Limit>,
}

/// What [`compile`] gives for all sources together.
#[derive(Clone, Debug)]
pub struct Output {
    /// The program: everything that could be compiled. Run it only when [`Output::is_good`].
    pub program: Program,
    /// What was found, by source and place.
    pub diagnostics: Vec<Diagnostic>,
    /// What was found beyond [`Options::limit`].
    pub rest: Rest,
    /// The blocks that had a name only, with the numbers they were given.
    pub numbers: Vec<Numbered>,
    /// The blocks of [`Library::offer`] that the program calls, with their names and numbers.
    pub demanded: Vec<Numbered>,
    /// The set of mnemonics of each source.
    pub mnemonics: Vec<Mnemonics>,
    /// Elementary steps of work done (tokens read, declarations, bytes of start values): grows linearly with the
    /// input.
    pub steps: u64,
}

impl Output {
    /// True when there is no error.
    pub fn is_good(&self) -> bool {
        self.rest.errors == 0 && self.diagnostics.iter().all(|d| d.severity != Severity::Error)
    }
}

/// The longest source, in bytes of text.
const LONGEST_SOURCE: usize = 64 << 20;

/// Compiles sources into a program. Blocks may call each other across sources and in any order.
pub fn compile(sources: &[Source], library: &Library, options: &Options) -> Output {
    compile_with(sources, library, options, None)
}

/// The same; blocks written in SCL are compiled by `scl`, where one is given.
pub fn compile_with(sources: &[Source], library: &Library, options: &Options, scl: Option<&dyn Statements>) -> Output {
    let mut sink = Sink::of(sources.iter().map(|source| source.name.clone()).collect());
    let decoded: Vec<_> = sources.iter().map(Source::text).collect();
    let words = [Mnemonics::German, Mnemonics::International].map(Words::new);
    let words = [&words[0], &words[1]];
    let foreign: Vec<_> =
        sources.iter().zip(&decoded).map(|(source, text)| recognise::other(&source.name, text, words)).collect();
    let is_scl: Vec<bool> = foreign.iter().map(|other| *other == Some(Other::Scl) && scl.is_some()).collect();
    let mut files = Vec::with_capacity(sources.len());
    for (index, ((text, other), scl)) in decoded.iter().zip(&foreign).zip(&is_scl).enumerate() {
        files.push(file(index, text, other.filter(|_| !scl), *scl, &mut sink));
    }
    let ours: Vec<_> = files.iter().zip(&foreign).map(|(file, other)| other.is_none().then_some(file)).collect();
    let sets = Sets::new(
        match options.mnemonics {
            Mnemonics::Auto => auto::decide(&ours, words, &mut sink),
            set => ours.iter().map(|file| file.map_or(Mnemonics::German, |_| set)).collect(),
        },
        is_scl,
    );
    let mut blocks = Vec::new();
    for (index, (file, other)) in files.iter().zip(&foreign).enumerate() {
        // Mistakes in another language are not reported.
        let mut unheard = Sink::new();
        let (bodies, sink) = match other {
            None => (Bodies::Stl, &mut sink),
            Some(_) if sets.is_scl(index) => (Bodies::Scl, &mut sink),
            Some(_) => (Bodies::LeftOut, &mut unheard),
        };
        blocks.extend(parser::parse(index, file, sets.of(index), bodies, sink));
    }
    let symbols = symbols::read(&options.symbols, &Words::of_both());
    let mut elaborator = Elaborator::new(&files, &blocks, &sets, library, symbols, &mut sink);
    elaborator.world.peripheral = symbols::peripheral(&options.symbols);
    let numbers = elaborator.number_names(&options.fixed, &options.kept);
    let demanded = elaborator.run();
    let (mut world, names) = (elaborator.world, elaborator.names);
    let mut whole = options.lints.then(lints::Whole::default);
    let extras = Extras { whole: whole.as_mut(), scl };
    let code = lower_all(&files, &blocks, &names, &world, &sets, extras, &mut sink);
    if let Some(whole) = whole {
        whole.finish(&mut sink);
    }
    let mut program = Program {
        blocks: code.0,
        data: Vec::new(),
        symbols: options.symbols.iter().cloned().chain(numbers.iter().map(Numbered::symbol)).collect(),
        sources: sources.iter().map(|s| s.name.clone()).collect(),
    };
    for (number, fb) in code.1 {
        if let Some(data) = data::instance_data(&world, fb) {
            world.data.entry(number).or_insert(data);
        }
    }
    let compiled: BTreeSet<BlockId> = program.blocks.iter().map(|block| block.id).collect();
    // An FB in another language is not compiled; an instance of it is left out with it.
    let own = &world.own;
    world.data.retain(|_, data| match data.kind {
        DataKind::Instance(fb) => compiled.contains(&fb) || !own.contains(&fb),
        _ => true,
    });
    program.data = world.data.into_iter().map(|(number, data)| data_block(number, data)).collect();
    let texts: Vec<&str> = files.iter().map(|f| f.text).collect();
    let steps = sink.steps;
    let (diagnostics, rest) = sink.finish_within(&texts, options.limit);
    Output { program, diagnostics, rest, numbers, demanded, mnemonics: sets.all(), steps }
}

fn file<'t>(index: usize, text: &'t str, other: Option<Other>, scl: bool, sink: &mut Sink) -> File<'t> {
    if let Some(other) = other {
        let (message, remedy) = other.says();
        sink.foreign(index, message, remedy);
        if other != Other::Scl || text.len() > LONGEST_SOURCE {
            return File { text: "", tokens: Vec::new() };
        }
        return File { text, tokens: lexer::lex(index, text, &mut Sink::new()) };
    }
    if text.len() > LONGEST_SOURCE {
        let message = format!("the source has {} bytes", text.len());
        sink.report(index, Span::default(), &messages::SOURCE_TOO_LONG, message);
        return File { text: "", tokens: Vec::new() };
    }
    let tokens = if scl { lexer::lex_scl(index, text, sink) } else { lexer::lex(index, text, sink) };
    File { text, tokens }
}

/// What statements are compiled with besides names.
struct Extras<'e> {
    whole: Option<&'e mut lints::Whole>,
    scl: Option<&'e dyn Statements>,
}

/// The code blocks, and the instance data blocks that calls name but no source declares.
type Lowered = (Vec<ob1_ir::CodeBlock>, BTreeMap<u16, BlockId>);

fn lower_all(
    files: &[File<'_>],
    blocks: &[syntax::Block],
    names: &[Option<Named>],
    world: &World,
    sets: &Sets,
    extras: Extras<'_>,
    sink: &mut Sink,
) -> Lowered {
    let Extras { whole: lints, scl } = extras;
    let ids: Vec<Option<BlockId>> =
        names.iter().map(|n| n.and_then(|(w, n)| Some(BlockId::new(w.kind()?, n)))).collect();
    let mut labels = BTreeMap::new();
    for (block, id) in blocks.iter().zip(&ids) {
        let (Some(file), Some(id)) = (files.get(block.file), id) else { continue };
        for label in block.statements.iter().filter_map(|s| file.tokens.get(s.label?)) {
            labels.entry(file.of(*label)).or_insert(*id);
        }
    }
    let names = lower::Names { world, sets, labels: &labels };
    let mut code = Vec::new();
    let mut found = lower::Found { wanted: BTreeMap::new(), opened: BTreeSet::new(), uses: Vec::new(), lints };
    for (block, id) in blocks.iter().zip(&ids) {
        let (Some(file), Some(id)) = (files.get(block.file), id) else { continue };
        if block.scl.is_some()
            && let Some(scl) = scl
        {
            let scope = Scope { file, world, sink, wanted: &mut found.wanted };
            code.extend(scl.compile(*id, block, scope));
        } else if id.kind != ob1_model::BlockKind::Db && !block.foreign {
            code.extend(lower::lower(*id, block, file, &names, &mut found, sink));
        }
    }
    // Behind a mistake it may be the call with the mistake that supplies them.
    if !sink.has_errors() {
        supplied::report(&found.uses, &code, world, sink);
    }
    for (db, file, span) in found.opened {
        let id = BlockId::new(ob1_model::BlockKind::Db, db);
        if !world.data.contains_key(&db) && !found.wanted.contains_key(&db) && !world.own.contains(&id) {
            sink.missing(&format!("AUF DB {db}"), file, span, &messages::DB_NOT_THERE, |_| {
                let message = format!("DB {db} is opened, but is in no source: {}", diagnostic::USES);
                (message, messages::DB_NOT_THERE.remedy.to_owned())
            });
        }
    }
    (code, found.wanted)
}

fn data_block(number: u16, data: Data) -> DataBlock {
    DataBlock {
        number,
        name: data.name,
        kind: data.kind,
        bytes: data.image,
        components: data.components,
        read_only: data.read_only,
        non_retain: data.non_retain,
    }
}
