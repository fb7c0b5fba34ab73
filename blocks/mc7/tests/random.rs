//! Random blocks: machine code and back, text and back, give the very same block.

mod common;

use std::collections::BTreeMap;

use ob1_ir::{CodeBlock, Program};
use ob1_mc7::{MachineBlock, Written, addresses, decode, encode};
use ob1_model::{BlockId, Interface};
use ob1_stl::print::{Declared, Heading, Listing, Printer};
use ob1_stl::{Library, Mnemonics, Options, Source, compile};
use proptest::prelude::*;

/// The block without the lines of its source.
fn bare(block: &CodeBlock) -> CodeBlock {
    let mut block = CodeBlock { source: 0, ..block.clone() };
    block.code.iter_mut().for_each(|stmt| stmt.line = 0);
    block
}

/// The declarations as they are before the code says how much local data it reaches.
fn declared(interface: &Interface, has_instance: bool) -> Interface {
    let mut interface = interface.clone();
    interface.lay_out(has_instance);
    interface
}

fn differ(a: &CodeBlock, b: &CodeBlock) -> Option<String> {
    if a == b {
        return None;
    }
    let at = a.code.iter().zip(&b.code).position(|(a, b)| a != b);
    let show = |block: &CodeBlock| at.and_then(|at| block.code.get(at)).map(|s| format!("{} in {}", s.op, s.network));
    let temps = (a.interface.temp_bytes, b.interface.temp_bytes);
    Some(format!(
        "{} of {} and {}: {:?} / {:?}, {temps:?}",
        at.unwrap_or(0),
        a.code.len(),
        b.code.len(),
        show(a),
        show(b)
    ))
}

fn through_machine_code(block: &CodeBlock, callees: &BTreeMap<BlockId, Interface>) -> CodeBlock {
    let known = |id: BlockId| callees.get(&id);
    let written = Written { multi_instance: true, notations: BTreeMap::new() };
    let encoded = encode(block, &written, &known).unwrap_or_else(|e| panic!("{e}"));
    let interface = declared(&block.interface, block.id.kind.has_instance());
    let machine = MachineBlock {
        id: block.id,
        name: None,
        interface: &interface,
        code: &encoded.code,
        segments: &encoded.segments,
        multi_instance: true,
        local_bytes: 0,
    };
    let decoded = decode(&machine, &known).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(decoded.offsets.len(), decoded.block.code.len());
    // Program status finds the same statements, whoever made the code.
    let of = |offsets| addresses(&encoded.code, offsets);
    assert_eq!(of(&encoded.offsets), of(&decoded.offsets));
    assert_eq!(encoded.segments.networks.iter().map(|n| usize::from(*n)).sum::<usize>() + 2, encoded.code.len());
    bare(&decoded.block)
}

fn through_text(
    block: &CodeBlock,
    instances: &BTreeMap<usize, BlockId>,
    callees: &BTreeMap<BlockId, Interface>,
    mnemonics: Mnemonics,
) -> (CodeBlock, String) {
    let known = |id: BlockId| callees.get(&id);
    let printer = Printer::new(mnemonics, &known);
    let declared = Declared { instances: instances.clone(), ..Declared::default() };
    let text = printer.block(block, &Heading::default(), &declared, &Listing::default());
    let text = text.unwrap_or_else(|e| panic!("{e}"));
    let mut library = Library::new();
    callees.iter().for_each(|(id, interface)| drop(library.insert(*id, "called", interface.clone())));
    let options = Options { mnemonics, ..Options::default() };
    let output = compile(&[Source::new("printed", text.clone())], &library, &options);
    assert!(output.is_good(), "{:?}\n{text}", output.diagnostics);
    (bare(&output.program.blocks[0]), text)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1_500, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn blocks_come_back_from_machine_code_and_from_text(choices in prop::collection::vec(any::<u8>(), 1..700)) {
        let (block, instances, callees) = common::block(&choices);
        let program = Program { blocks: vec![block.clone()], sources: vec!["a".into()], ..Program::default() };
        let findings = ob1_ir::verify(&program, &|id| callees.get(&id)).err();
        prop_assert_eq!(findings, None);
        let wanted = bare(&block);
        let decoded = through_machine_code(&block, &callees);
        prop_assert_eq!(differ(&wanted, &decoded), None);
        let mnemonics = if choices.len() % 2 == 0 { Mnemonics::German } else { Mnemonics::International };
        let (compiled, text) = through_text(&block, &instances, &callees, mnemonics);
        prop_assert_eq!(differ(&wanted, &compiled), None, "{}", text);
    }
}
