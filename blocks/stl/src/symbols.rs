//! Symbols: names for addresses and blocks, as symbol tables give them.

use std::collections::BTreeMap;

use ob1_ir::{Number, Symbol};

use crate::diagnostic::Sink;
use crate::lexer;
use crate::operand::Resolver;
use crate::reader::Reader;
use crate::token::{File, Span};
use crate::value::Value;
use crate::words::Words;
use crate::world::{Symbolic, World};

/// Reads the addresses of a symbol table. An invalid one is kept and reported where it is used.
pub(crate) fn read(symbols: &[Symbol], words: &Words) -> BTreeMap<String, Symbolic> {
    symbols.iter().map(|s| (s.name.to_uppercase(), address(s, words))).collect()
}

/// The symbols of the peripheral area, in capitals: true for outputs, which are only written.
pub(crate) fn peripheral(symbols: &[Symbol]) -> BTreeMap<String, bool> {
    let output = |s: &Symbol| {
        let address = s.address.to_ascii_uppercase();
        let is = |words: [&str; 2]| words.iter().any(|w| address.starts_with(w));
        if is(["PA", "PQ"]) { Some(true) } else { is(["PE", "PI"]).then_some(false) }
    };
    symbols.iter().filter_map(|s| Some((s.name.to_uppercase(), output(s)?))).collect()
}

/// What a symbol stands for.
pub(crate) fn address(symbol: &Symbol, words: &Words) -> Symbolic {
    let empty = World::default();
    let resolver = Resolver::new(&empty, words, None);
    // A wrong address is reported where the symbol is used, not here.
    let mut sink = Sink::new();
    let tokens = lexer::lex(0, &symbol.address, &mut sink);
    let all = 0..tokens.len();
    let file = File { text: &symbol.address, tokens };
    let mut reader = Reader::new(0, &file, &mut sink, all, Span::default());
    let value = resolver.operand(&mut reader);
    let complete = reader.is_empty();
    match value.filter(|_| complete && !sink.has_errors()) {
        Some(Value::Memory { operand, .. }) => Symbolic::Memory(operand, symbol.ty.clone()),
        Some(Value::Timer(Number::Fixed(n))) => Symbolic::Timer(n),
        Some(Value::Counter(Number::Fixed(n))) => Symbolic::Counter(n),
        Some(Value::Block(word, Number::Fixed(n))) => Symbolic::Block(word, n),
        _ => Symbolic::Unknown(symbol.address.clone()),
    }
}
