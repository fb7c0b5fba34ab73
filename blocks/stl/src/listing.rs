//! The listing of a program: sources, symbols, blocks with the addresses of their interfaces and their compiled form,
//! data blocks with their layout.

use std::fmt::Write as _;

use ob1_ir::Program;

/// The listing as text. Blocks and data blocks come in the order of their kinds and numbers.
pub fn listing(program: &Program) -> String {
    let mut out = String::new();
    for (index, name) in program.sources.iter().enumerate() {
        let _ = writeln!(out, "source {}: {name}", index + 1);
    }
    let statements: usize = program.blocks.iter().map(|b| b.code.len()).sum();
    let bytes: usize = program.data.iter().map(|d| d.bytes.len()).sum();
    let (blocks, data) = (program.blocks.len(), program.data.len());
    let _ = writeln!(out, "{blocks} blocks with {statements} statements, {data} data blocks with {bytes} bytes\n");
    if !program.symbols.is_empty() {
        for symbol in &program.symbols {
            let ty = symbol.ty.as_ref().map(|ty| format!(" : {}", ty.name())).unwrap_or_default();
            let _ = writeln!(out, "  {:<10} \"{}\"{ty}", symbol.address, symbol.name);
        }
        out.push('\n');
    }
    let mut blocks: Vec<_> = program.blocks.iter().collect();
    blocks.sort_by_key(|b| b.id);
    for block in blocks {
        let source = program.sources.get(block.source as usize).map_or("", String::as_str);
        let _ = writeln!(out, "{source}\n{block}");
    }
    let mut data: Vec<_> = program.data.iter().collect();
    data.sort_by_key(|d| d.number);
    for block in data {
        let _ = writeln!(out, "{block}");
    }
    out
}
