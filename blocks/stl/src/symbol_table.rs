//! Symbol tables as STEP 7 exports them: four text formats, one row a symbol.
//!
//! The formats ["Programming with STEP 7", "File Formats for Importing/Exporting a Symbol Table"]: `.SDF` has four
//! texts in quotes, `.ASC` records of 126 characters in fixed columns, `.SEQ` tabulated address, symbol and comment,
//! `.DIF` tuples of typed cells. Each is CP1252 or UTF-8, addresses are in either set of mnemonics, comments stay
//! out.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use ob1_ir::{Symbol, Width};
use ob1_model::named;

use crate::diagnostic::{Diagnostic, Sink};
use crate::messages;
use crate::messages::Severity;
use crate::parse_types::simple_type;
use crate::source::Source;
use crate::symbol_formats::{self, Row};
use crate::symbols;
use crate::words::Words;
use crate::world::Symbolic;

named! {
    /// The form of a symbol table, named by its extension.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum TableForm {
        /// Four texts in quotes: `"name","M 1.0","BOOL","comment"`.
        Sdf = "SDF",
        /// `126,name  M  1.0  BOOL  comment` in columns of 24, 12, 10 and 80 characters.
        Asc = "ASC",
        /// Tab, address, tab, name, tab, comment; no types.
        Seq = "SEQ",
        /// Data interchange format: header, then tuples of four texts.
        Dif = "DIF",
    }
}

impl TableForm {
    /// The form a file name's extension says.
    pub fn of_name(name: &str) -> Option<Self> {
        let (_, extension) = name.rsplit_once('.')?;
        Self::ALL.into_iter().find(|form| form.name().eq_ignore_ascii_case(extension))
    }

    /// The form the first line that is not empty looks like.
    pub fn of_text(text: &str) -> Option<Self> {
        let first = text.lines().find(|l| !l.trim().is_empty())?;
        let trimmed = first.trim();
        Some(match () {
            () if trimmed == "TABLE" => TableForm::Dif,
            () if first.starts_with("126,") => TableForm::Asc,
            () if trimmed.starts_with('"') => TableForm::Sdf,
            () if first.contains('\t') => TableForm::Seq,
            () => return None,
        })
    }
}

/// A symbol table that was read.
#[derive(Clone, Debug)]
pub struct SymbolTable {
    /// Its symbols in their order; rows with a mistake are left out.
    pub symbols: Vec<Symbol>,
    /// What was found. [`Diagnostic::source`] is 0: the one file given.
    pub diagnostics: Vec<Diagnostic>,
    /// Elementary steps of work done: grows linearly with the input.
    pub steps: u64,
}

impl SymbolTable {
    /// True when there is no error.
    pub fn is_good(&self) -> bool {
        self.diagnostics.iter().all(|d| d.severity != Severity::Error)
    }
}

/// The longest table, in bytes of text.
const LONGEST_TABLE: usize = 64 << 20;

/// Reads a symbol table. Its form is that of the name's extension, checked against the first line; where the extension
/// says nothing, the first line decides.
pub fn read_symbols(source: &Source) -> SymbolTable {
    read_one(source, &mut Names::new())
}

/// Reads the symbol tables of one program, in their order. A name that is in two of them is reported in the later
/// one; the first one counts, as within a table.
pub fn read_symbol_tables(sources: &[Source]) -> Vec<SymbolTable> {
    let mut names = Names::new();
    sources.iter().map(|source| read_one(source, &mut names)).collect()
}

/// Names in capitals, with the table that has them, and what it says.
type Names = BTreeMap<String, (String, Symbol)>;

fn read_one(source: &Source, names: &mut Names) -> SymbolTable {
    let mut sink = Sink::new();
    let text = source.text();
    let mut symbols = Vec::new();
    if text.len() > LONGEST_TABLE {
        let message = format!("the symbol table has {} bytes", text.len());
        sink.report(0, crate::token::Span::default(), &messages::SOURCE_TOO_LONG, message);
    } else if let Some(form) = form(&source.name, &text, &mut sink) {
        symbols = table(form, &source.name, &text, names, &mut sink);
    }
    let steps = sink.steps;
    SymbolTable { symbols, diagnostics: sink.finish(&[&text]), steps }
}

fn form(name: &str, text: &str, sink: &mut Sink) -> Option<TableForm> {
    if text.trim().is_empty() {
        return None;
    }
    let message = match (TableForm::of_name(name), TableForm::of_text(text)) {
        (Some(said), Some(looks)) if said != looks => {
            format!("the file is named .{} and looks like {}", said.name(), looks.name())
        }
        // A first row with a mistake is reported as such.
        (said, looks) if said.or(looks).is_some() => return said.or(looks),
        _ => "the file is not a symbol table: its first line is neither SDF nor ASC, SEQ or DIF".to_owned(),
    };
    sink.report(0, crate::token::Span { start: 0, end: 1 }, &messages::TABLE_FORM, message);
    None
}

fn table(form: TableForm, file: &str, text: &str, names: &mut Names, sink: &mut Sink) -> Vec<Symbol> {
    let rows = match form {
        TableForm::Sdf => symbol_formats::sdf(text, sink),
        TableForm::Asc => symbol_formats::asc(text, sink),
        TableForm::Seq => symbol_formats::seq(text, sink),
        TableForm::Dif => symbol_formats::dif(text, sink),
    };
    let words = Words::of_both();
    let mut symbols = Vec::with_capacity(rows.len());
    for row in &rows {
        sink.steps += 1;
        let Some(symbol) = symbol(row, form, &words, sink) else { continue };
        match names.entry(symbol.name.to_uppercase()) {
            Entry::Vacant(free) => {
                free.insert((file.to_owned(), symbol.clone()));
                symbols.push(symbol);
            }
            // The same line twice means nothing else.
            Entry::Occupied(first) if first.get().0 != file && is_same(&first.get().1, &symbol) => {}
            Entry::Occupied(first) => {
                let first = &first.get().0;
                let first = if first == file { String::new() } else { format!(", first in {first}") };
                let message = format!("the symbol {} occurs twice{first}; the first one counts", symbol.name);
                sink.report(0, row.span, &messages::SYMBOL_TWICE, message);
            }
        }
    }
    symbols
}

/// Whether two tables say the same of a symbol; blanks in addresses do not count.
fn is_same(one: &Symbol, other: &Symbol) -> bool {
    let address = |symbol: &Symbol| -> String { symbol.address.chars().filter(|c| !c.is_whitespace()).collect() };
    address(one).eq_ignore_ascii_case(&address(other)) && one.ty == other.ty
}

/// One row. `None` when it names nothing a program can use, or has a mistake (reported).
fn symbol(row: &Row, form: TableForm, words: &Words, sink: &mut Sink) -> Option<Symbol> {
    let (name, address) = (row.name.trim(), row.address.split_whitespace().collect::<Vec<_>>().join(" "));
    // A row of blanks carries a comment only, one without an address a plan; a VAT is a table of variables for the
    // programming device.
    let is_table = address.get(..3).is_some_and(|w| w.eq_ignore_ascii_case("VAT"));
    if is_table || address.is_empty() {
        return None;
    }
    // The quotes that TIA Portal leaves around a name are not part of it.
    let name = name.strip_prefix('"').and_then(|n| n.strip_suffix('"')).unwrap_or(name);
    if name.is_empty() || name.contains('"') {
        sink.report(0, row.span, &messages::TABLE_ROW, format!("the address {} has no usable name", clip(&address)));
        return None;
    }
    let comment = row.comment.trim().to_owned();
    let mut symbol = Symbol { name: name.to_owned(), address, ty: None, comment };
    let found = symbols::address(&symbol, words);
    let width = match &found {
        Symbolic::Unknown(_) => {
            let mut message = format!("{} of {} is not an address", clip(&symbol.address), clip(name));
            if form == TableForm::Asc {
                // Whoever edits such a file by hand easily moves a column.
                message += "; an ASC file has columns of 24, 12, 10 and 80 characters after 126,";
            }
            sink.report(0, row.span, &messages::TABLE_ADDRESS, message);
            return None;
        }
        Symbolic::Memory(operand, _) => Some(operand.width),
        _ => None,
    };
    let written = row.ty.trim().trim_matches('"').to_ascii_uppercase();
    let ty = simple_type(&written).or_else(|| crate::tia::simple(&written)).filter(|ty| ty.elementary_bits().is_some());
    if let (Some(width), false) = (width, row.ty.trim().is_empty()) {
        if ty.as_ref().and_then(Width::of) == Some(width) {
            symbol.ty = ty;
        } else {
            let message = format!("the type {} of {} does not fit {}", clip(&row.ty), clip(name), symbol.address);
            sink.report(0, row.span, &messages::TABLE_TYPE, message);
        }
    }
    Some(symbol)
}

fn clip(text: &str) -> String {
    text.trim().chars().take(40).collect()
}
