//! Symbol tables in their four formats, and in an unknown format.

use ob1_stl::{Library, Options, Source, compile, read_symbols};

/// Reads the bytes in each format, and compiles a program that uses a symbol.
pub fn run(data: &[u8]) {
    for name in ["a.sdf", "a.asc", "a.seq", "a.dif", "a"] {
        let source = Source::new(name, data);
        let table = read_symbols(&source);
        let lines = source.text().matches('\n').count() as u32 + 1;
        assert!(table.diagnostics.iter().all(|d| (1..=lines).contains(&d.line) && d.column >= 1));
        let options = Options { symbols: table.symbols, ..Options::default() };
        let source = Source::new("a.awl", *b"FUNCTION FC 1 : VOID\nBEGIN\nU \"Motor\";\nEND_FUNCTION\n");
        assert_eq!(compile(&[source], &Library::new(), &options).program.blocks.len(), 1);
    }
}
