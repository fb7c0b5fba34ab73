//! Networks of source text, for tests.

#![allow(dead_code, reason = "each test takes what it needs")]

pub(crate) mod drawn;
pub(crate) mod trees;

use std::collections::BTreeMap;

use ob1_ir::CodeBlock;
use ob1_ladder::{Network, View};
use ob1_model::{BlockId, BlockKind, Interface};
use ob1_stl::print::Listing;
use ob1_stl::{Library, Mnemonics, Options, Source, compile};

/// What the statements of tests call: FC 7 with a, b, c in, q and w out; FB 20 with its data block.
const OTHERS: &str = "\
FUNCTION FC 7 : VOID\nVAR_INPUT\n a : BOOL;\n b : BOOL;\n c : INT;\nEND_VAR\nVAR_OUTPUT\n q : BOOL;\n w : INT;\nEND_VAR\n\
BEGIN\nNETWORK\nU #a; = #q; L #c; T #w;\nEND_FUNCTION\n\
FUNCTION FC 8 : VOID\nBEGIN\nNETWORK\nNOP 0;\nEND_FUNCTION\n\
FUNCTION_BLOCK FB 20\nVAR_INPUT\n start : BOOL;\n speed : INT;\nEND_VAR\nVAR_OUTPUT\n runs : BOOL;\nEND_VAR\n\
BEGIN\nNETWORK\nU #start; = #runs;\nEND_FUNCTION_BLOCK\nDATA_BLOCK DB 21\nFB 20\nBEGIN\nEND_DATA_BLOCK\n\
DATA_BLOCK DB 5\nSTRUCT\n a : ARRAY [0 .. 99] OF INT;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n";

/// The statements of FC 1, compiled, with all the blocks around it.
pub(crate) fn compiled(statements: &str) -> (CodeBlock, BTreeMap<BlockId, Interface>) {
    let source = format!("{OTHERS}FUNCTION FC 1 : VOID\nBEGIN\n{statements}\nEND_FUNCTION\n");
    let options = Options { mnemonics: Mnemonics::German, ..Options::default() };
    let output = compile(&[Source::new("test", source)], &Library::new(), &options);
    assert!(output.is_good(), "{statements}: {:?}", output.diagnostics);
    let interfaces = output.program.blocks.iter().map(|block| (block.id, block.interface.clone())).collect();
    let fc = BlockId::new(BlockKind::Fc, 1);
    let block = output.program.blocks.into_iter().find(|block| block.id == fc);
    (block.expect("FC 1"), interfaces)
}

/// The networks of a block.
pub(crate) fn networks(
    block: &CodeBlock,
    interfaces: &BTreeMap<BlockId, Interface>,
    named: &[(&str, &str)],
) -> Vec<Network> {
    let callees = |id: BlockId| interfaces.get(&id);
    let symbols = named.iter().map(|(address, name)| ((*address).to_owned(), (*name).to_owned())).collect();
    let listing = Listing::default();
    View { mnemonics: Mnemonics::German, callees: &callees, symbols: &symbols, listing: &listing }.networks(block)
}

/// One network of statements.
pub(crate) fn network(statements: &str) -> Network {
    let (block, interfaces) = compiled(&format!("NETWORK\n{statements}"));
    networks(&block, &interfaces, &[]).into_iter().next().expect("one network")
}
