//! STL/AWL source text to blocks and diagnostics.
//!
//! The way of a source: bytes -> text ([`Source`]) -> tokens -> blocks with declarations and statements, operands still
//! tokens -> the world (numbers, types, interfaces, data blocks of all sources and the library) -> operations. Each
//! stage goes on after a mistake, so that one run finds all of them; none panics, whatever the bytes; each takes time
//! linear in the input.
//!
//! This crate knows the instruction set ([`ob1_ir`]) and no engine.

mod address;
mod auto;
mod brackets;
mod call;
pub mod codes;
mod constant;
mod data;
mod diagnostic;
mod elaborate;
mod expand;
mod fit;
mod initial;
mod jumps;
mod lexer;
mod library;
mod lint_accu;
mod lint_br;
mod lint_memory;
mod lint_paths;
mod lints;
mod listing;
mod literal;
mod lower;
mod mnemonics;
mod names;
mod operand;
mod parse_code;
mod parse_types;
mod parser;
mod path;
pub mod print;
mod raw_list;
mod reach;
mod reader;
mod source;
mod symbol_rows;
mod symbol_table;
mod symbols;
mod syntax;
mod time;
mod token;
mod types;
mod world;
mod xref;

use std::collections::BTreeMap;

use ob1_ir::{DataBlock, Program, Symbol};
use ob1_model::BlockId;

pub use diagnostic::{Diagnostic, Severity, render, render_all};
pub use library::{Library, LibraryBlock, Missing};
pub use listing::listing;
pub use mnemonics::Mnemonics;
pub use source::Source;
pub use symbol_table::{SymbolTable, TableForm, read_symbol_tables, read_symbols};

pub use xref::{Access, Reference, render_xref, xref, xref_with};

use auto::Sets;
use diagnostic::Sink;
use elaborate::{Elaborator, Named};
use mnemonics::Words;
use token::{File, Span};
use world::{Data, World};

/// How sources are read.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The set of mnemonics the sources are written in.
    pub mnemonics: Mnemonics,
    /// Symbols, from symbol tables.
    pub symbols: Vec<Symbol>,
    /// Look for the classic porting traps as well (S0903 and above).
    pub lints: bool,
}

/// What [`compile`] gives.
#[derive(Clone, Debug)]
pub struct Output {
    /// The program: everything that could be compiled. Run it only when [`Output::is_good`].
    pub program: Program,
    /// What was found, by source and place.
    pub diagnostics: Vec<Diagnostic>,
    /// Elementary steps of work done (tokens looked at, declarations, bytes of start values): grows linearly with the
    /// input.
    pub steps: u64,
}

impl Output {
    /// True when there is no error.
    #[must_use]
    pub fn is_good(&self) -> bool {
        self.diagnostics.iter().all(|d| d.severity != Severity::Error)
    }
}

/// The longest source, in bytes of text.
const LONGEST_SOURCE: usize = 64 << 20;

/// Compiles sources into a program. Blocks may call each other across sources and in any order.
#[must_use]
pub fn compile(sources: &[Source], library: &Library, options: &Options) -> Output {
    let mut sink = Sink::new();
    let decoded: Vec<_> = sources.iter().map(Source::text).collect();
    let files: Vec<File<'_>> = decoded.iter().enumerate().map(|(i, text)| file(i, text, &mut sink)).collect();
    let sets = Sets::new(files.iter().enumerate().map(|(i, file)| set_of(i, file, options, &mut sink)).collect());
    let mut blocks = Vec::new();
    for (index, file) in files.iter().enumerate() {
        blocks.extend(parser::parse(index, file, sets.of(index), &mut sink));
    }
    let symbols = symbols::read(&options.symbols, &Words::of_both());
    let mut elaborator = Elaborator::new(&files, &blocks, &sets, library, symbols, &mut sink);
    elaborator.run();
    let (mut world, names) = (elaborator.world, elaborator.names);
    let mut whole = options.lints.then(lints::Whole::default);
    let code = lower_all(&files, &blocks, &names, &world, &sets, whole.as_mut(), &mut sink);
    if let Some(whole) = whole {
        whole.finish(&mut sink);
    }
    let mut program = Program {
        blocks: code.0,
        data: Vec::new(),
        symbols: options.symbols.clone(),
        sources: sources.iter().map(|s| s.name.clone()).collect(),
    };
    for (number, fb) in code.1 {
        if let Some(data) = data::instance_data(&world, fb) {
            world.data.entry(number).or_insert(data);
        }
    }
    program.data = world.data.into_iter().map(|(number, data)| data_block(number, data)).collect();
    let texts: Vec<&str> = files.iter().map(|f| f.text).collect();
    let steps = sink.steps;
    Output { program, diagnostics: sink.finish(&texts), steps }
}

/// The set of mnemonics a file is written in.
fn set_of(index: usize, file: &File<'_>, options: &Options, sink: &mut Sink) -> Mnemonics {
    match options.mnemonics {
        Mnemonics::Auto => auto::decide(index, file, sink),
        set => set,
    }
}

fn file<'t>(index: usize, text: &'t str, sink: &mut Sink) -> File<'t> {
    if text.len() > LONGEST_SOURCE {
        let message = format!("the source has {} bytes", text.len());
        sink.report(index, Span::default(), &codes::SOURCE_TOO_LONG, message);
        return File { text: "", tokens: Vec::new() };
    }
    File { text, tokens: lexer::lex(index, text, sink) }
}

/// The code blocks, and the instance data blocks that calls name but no source declares.
type Lowered = (Vec<ob1_ir::CodeBlock>, BTreeMap<u16, BlockId>);

fn lower_all(
    files: &[File<'_>],
    blocks: &[syntax::Block],
    names: &[Option<Named>],
    world: &World,
    sets: &Sets,
    lints: Option<&mut lints::Whole>,
    sink: &mut Sink,
) -> Lowered {
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
    let mut found = lower::Found { wanted: BTreeMap::new(), lints };
    for (block, id) in blocks.iter().zip(&ids) {
        let (Some(file), Some(id)) = (files.get(block.file), id) else { continue };
        if id.kind != ob1_model::BlockKind::Db {
            code.extend(lower::lower(*id, block, file, &names, &mut found, sink));
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
    }
}
