//! The blocks of a program as a person reads them: the lines of their source, with its names, comments and titles; a
//! block without a source as it is printed.

use std::collections::BTreeMap;
use std::ops::Deref;

use ob1_ir::{CodeBlock, Program};
use ob1_model::BlockId;
use ob1_stl::print::{Listing, Printer};
use ob1_stl::{CrossReference, Library, Mnemonics, Source};
use serde::Serialize;

/// A program as a person reads it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct SourceView {
    /// The set of mnemonics of most sources: `de` or `en`.
    pub mnemonics: &'static str,
    /// The blocks by name, `FC 1`.
    pub blocks: BTreeMap<String, BlockText>,
}

/// A line: its number, its network, its text, symbols; see [`BlockText::lines`].
pub type TextLine = (u32, u16, String, Vec<String>);

/// The text of a block.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct BlockText {
    /// The file of its source; empty: it is printed from its statements.
    pub file: String,
    /// Its lines: number in the file (0 without one), network (0 without one), text, and the symbols of operands that
    /// the text has by address.
    pub lines: Vec<TextLine>,
}

/// The word of a set of mnemonics in files and on the command line.
#[must_use]
pub const fn word(set: Mnemonics) -> &'static str {
    match set {
        Mnemonics::International => "en",
        Mnemonics::German | Mnemonics::Auto => "de",
    }
}

/// The program; `read` gives the text of a source, `set` another set of mnemonics than that of the sources.
#[must_use]
pub fn view<P: Deref<Target = Program>>(
    all: &CrossReference<P>,
    library: &Library,
    read: &dyn Fn(&str) -> Option<Source>,
    set: Option<Mnemonics>,
) -> SourceView {
    let program = all.program();
    let used: Vec<&String> = program.sources.iter().collect();
    let texts: Vec<Option<Source>> = used.iter().map(|file| read(file)).collect();
    let decoded: Vec<_> = texts.iter().map(|text| text.as_ref().map(Source::text).unwrap_or_default()).collect();
    let sets = ob1_stl::sets_of(&decoded.iter().map(AsRef::as_ref).collect::<Vec<_>>());
    let own = ob1_stl::most(&sets);
    let wanted = set.unwrap_or(own);
    let mut files = Vec::new();
    for (text, of) in decoded.iter().zip(&sets) {
        let shown = match set {
            Some(set) => ob1_stl::in_other_set(text, *of, set),
            None => text.to_string(),
        };
        files.push((ob1_stl::block_lines(text), shown));
    }
    let notes = notes(all, wanted);
    let callees = |id: BlockId| {
        let own = program.blocks.iter().find(|block| block.id == id).map(|block| &block.interface);
        own.or_else(|| library.get(id).map(|block| &block.interface))
    };
    let printer = Printer::new(wanted, &callees);
    let mut blocks = BTreeMap::new();
    for block in &program.blocks {
        let file = files.get(block.source as usize).filter(|(_, text)| !text.is_empty());
        let lines = file.and_then(|(ranges, text)| of_source(block, ranges, text, &notes));
        let name = program.sources.get(block.source as usize).filter(|_| lines.is_some());
        let lines = lines.unwrap_or_else(|| printed(block, &printer));
        blocks.insert(block.id.to_string(), BlockText { file: name.cloned().unwrap_or_default(), lines });
    }
    SourceView { mnemonics: word(wanted), blocks }
}

/// The symbols of operands, by block and line.
type Notes = BTreeMap<(BlockId, u32), Vec<(String, String)>>;

fn notes<P>(all: &CrossReference<P>, set: Mnemonics) -> Notes {
    let mut notes = Notes::new();
    for reference in all.all.iter().filter(|reference| reference.line > 0) {
        let Some(symbol) = &reference.symbol else { continue };
        let one = (symbol.clone(), format!("{} \"{symbol}\"", reference.operand_in(set)));
        let of = notes.entry((reference.block, reference.line)).or_default();
        if !of.contains(&one) {
            of.push(one);
        }
    }
    notes
}

/// The lines of a block in its source; none: its statements are not of a source.
fn of_source(
    block: &CodeBlock,
    ranges: &[std::ops::RangeInclusive<u32>],
    text: &str,
    notes: &Notes,
) -> Option<Vec<TextLine>> {
    let first = block.code.first().map(|stmt| stmt.line).filter(|line| *line > 0)?;
    let range = ranges.iter().find(|range| range.contains(&first))?;
    let networks: BTreeMap<u32, u16> = block.code.iter().rev().map(|stmt| (stmt.line, stmt.network)).collect();
    let line = |number: u32, text: &str| {
        let told = |(symbol, note): &(String, String)| (!text.contains(symbol.as_str())).then(|| note.clone());
        let of = notes.get(&(block.id, number)).into_iter().flatten().filter_map(told).collect();
        (number, networks.get(&number).copied().unwrap_or(0), text.trim_end().to_owned(), of)
    };
    let skip = (range.start() - 1) as usize;
    let count = (range.end() - range.start() + 1) as usize;
    let texts = text.lines().skip(skip).take(count);
    Some(range.clone().zip(texts).map(|(number, text)| line(number, text)).collect())
}

/// A block without its source.
fn printed(block: &CodeBlock, printer: &Printer<'_>) -> Vec<TextLine> {
    let each = || block.code.iter().enumerate().map(|(at, stmt)| (at, stmt.op.to_string())).collect();
    let texts: Vec<(usize, String)> = printer.lines(block, &Listing::default()).unwrap_or_else(|_| each());
    let network = |at: usize| block.code.get(at).map_or(0, |stmt| stmt.network);
    texts.into_iter().map(|(at, text)| (0, network(at), text, Vec::new())).collect()
}

/// As text, in the order of the blocks.
#[must_use]
pub fn text(view: &SourceView, program: &Program) -> String {
    let mut ids: Vec<BlockId> = program.blocks.iter().map(|block| block.id).collect();
    ids.sort_unstable();
    let mut out = String::new();
    for id in ids {
        let Some(block) = view.blocks.get(&id.to_string()) else { continue };
        let from = if block.file.is_empty() { "without a source, printed from its statements" } else { &block.file };
        out += &format!("{id}  {from}\n");
        for (number, _, text, notes) in &block.lines {
            let number = if *number > 0 { number.to_string() } else { String::new() };
            let notes = if notes.is_empty() { String::new() } else { format!("    [{}]", notes.join(", ")) };
            out += format!("{number:>6}  {text}{notes}").trim_end();
            out.push('\n');
        }
        out.push('\n');
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "// before\nFUNCTION FC 1 : VOID\nTITLE = The lamp\nBEGIN\nNETWORK\nTITLE = On\nm1: U E 0.0; // the start button\n\
        = A 4.0;\nSPA m1;\nEND_FUNCTION\n";

    #[test]
    fn a_block_is_shown_as_its_source_in_its_own_set_and_in_the_other() {
        let symbol = |name: &str, address: &str| ob1_ir::Symbol {
            name: name.into(),
            address: address.into(),
            ..ob1_ir::Symbol::default()
        };
        let options = ob1_stl::Options { symbols: vec![symbol("Start", "I 0.0")], ..ob1_stl::Options::default() };
        let output = ob1_stl::compile(&[Source::new("lamp.awl", TEXT)], &Library::new(), &options);
        assert!(output.is_good(), "{:?}", output.diagnostics);
        let read = |file: &str| (file == "lamp.awl").then(|| Source::new(file, TEXT));
        let all = CrossReference::new(&output.program, &Library::new());
        let own = view(&all, &Library::new(), &read, None);
        assert_eq!(own.mnemonics, "de");
        let said = text(&own, &output.program);
        for part in
            ["FC 1  lamp.awl", "TITLE = The lamp", "     7  m1: U E 0.0; // the start button    [E 0.0 \"Start\"]"]
        {
            assert!(said.contains(part), "{part}\n{said}");
        }
        assert!(!said.contains("before"));
        let other = view(&all, &Library::new(), &read, Some(Mnemonics::International));
        let said = text(&other, &output.program);
        assert!(said.contains("m1: A I 0.0; // the start button    [I 0.0 \"Start\"]"), "{said}");
        let without = view(&all, &Library::new(), &|_| None, Some(Mnemonics::International));
        assert!(text(&without, &output.program).contains("A I 0.0"), "{}", text(&without, &output.program));
    }
}
