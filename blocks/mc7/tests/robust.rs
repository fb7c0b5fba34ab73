//! Whatever the bytes: nothing panics, and what decodes passes the verifier. Random bytes, and valid blocks with a few
//! bytes changed, through decoder, verifier and printer.
//!
//! `OB1_MC7_CASES=10000000` makes a campaign of it; without it a few thousand cases run.

#![allow(clippy::disallowed_methods, reason = "the number of cases comes from the environment")]

mod common;

use std::collections::BTreeMap;
use std::iter::repeat_with;

use fastrand::Rng;
use ob1_ir::{Defect, Program};
use ob1_mc7::{BlockImage, CompiledInterface, MachineBlock, Segments, Statement, Written, decode, encode};
use ob1_model::{BlockId, Interface};
use ob1_stl::Mnemonics;
use ob1_stl::print::{Listing, Printer};

fn bytes(random: &mut Rng, count: usize) -> Vec<u8> {
    repeat_with(|| random.u8(..)).take(count).collect()
}

fn cases(short: usize) -> usize {
    std::env::var("OB1_MC7_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(short)
}

/// What code that decodes may have wrong, and the verifier finds: brackets, parameters used as what they are not, more
/// local data than there is. Everything else the decoder has to ensure.
const fn allowed(defect: &Defect) -> bool {
    use Defect::{Brackets, LocalBytes, McrBrackets, ParamOverflow, ParamType, UnknownBlock};
    matches!(defect, UnknownBlock(_) | Brackets | McrBrackets | ParamType(_) | ParamOverflow(..) | LocalBytes(_))
}

/// Decoder, verifier, printer. True when it decoded.
fn run(
    id: BlockId,
    interface: &Interface,
    code: &[u8],
    segments: &Segments,
    callees: &BTreeMap<BlockId, Interface>,
) -> bool {
    let known = |id: BlockId| callees.get(&id);
    let machine = MachineBlock { id, name: None, interface, code, segments, multi_instance: true, local_bytes: 0 };
    let Ok(decoded) = decode(&machine, &known) else { return false };
    let listing = Listing { notations: decoded.notations.clone(), ..Listing::default() };
    let _ = Printer::new(Mnemonics::German, &known).statements(&decoded.block, &listing);
    let program = Program { blocks: vec![decoded.block], sources: vec!["a".into()], ..Program::default() };
    for finding in ob1_ir::verify(&program, &known).err().unwrap_or_default() {
        assert!(allowed(&finding.defect), "{finding}: {code:02X?}");
    }
    true
}

#[test]
fn random_bytes() {
    let mut random = Rng::with_seed(0x0B1_5EED);
    let (block, _, callees) = common::block(&[2]);
    let blocks = [common::block(&[0]).0, common::block(&[1]).0, block];
    let mut done = 0;
    let mut decoded = 0;
    // Four of five first bytes begin a statement: short code decodes at times, long code hardly ever.
    while done < cases(400_000) {
        let length = 2 + random.usize(..24) * 2;
        done += length;
        let mut code = bytes(&mut random, length);
        if random.usize(..2) == 0 {
            code.extend([0x65, 0]);
        }
        let segments = Segments::read(&bytes(&mut random, 12)).unwrap_or_default();
        let which = random.usize(..blocks.len());
        decoded += usize::from(run(blocks[which].id, &blocks[which].interface, &code, &segments, &callees));
        let _ = (BlockImage::read(&code), CompiledInterface::read(&code), Statement::read(&code));
    }
    assert!(decoded > 0);
}

#[test]
fn valid_blocks_with_changed_bytes() {
    let mut random = Rng::with_seed(0x00C0_FFEE);
    let mut decoded = 0;
    let mut done = 0;
    let wanted = cases(4_000);
    while done < wanted {
        let (block, _, callees) = common::block(&bytes(&mut random, 8 + done % 120));
        let known = |id: BlockId| callees.get(&id);
        let written = Written { multi_instance: true, ..Written::default() };
        let encoded = encode(&block, &written, &known).expect("valid");
        for _ in 0..40 {
            done += 1;
            let mut code = encoded.code.clone();
            for _ in 0..=random.usize(..3) {
                let at = random.usize(..code.len());
                code[at] = random.u8(..);
            }
            if random.usize(..4) == 0 {
                code.truncate(random.usize(..code.len()));
            }
            decoded += usize::from(run(block.id, &block.interface, &code, &encoded.segments, &callees));
        }
    }
    assert!(decoded * 4 > done, "{decoded} of {done} decode");
}

/// Heads, interfaces and segment tables with changed bytes: what reads writes itself back.
#[test]
fn parts_with_changed_bytes() {
    let mut random = Rng::with_seed(0x00FA_C7ED);
    let interface =
        CompiledInterface::of(7, &common::callees()[&common::FB], &BTreeMap::new(), &|_| None).expect("short");
    let interface = interface.bytes().expect("short");
    let segments = Segments { networks: vec![10, 0, 4], jumps: vec![3, 1], rest: vec![1, 2] }.bytes();
    let mut read = 0;
    for _ in 0..cases(20_000) {
        let mut bytes = interface.clone();
        let at = random.usize(..bytes.len());
        bytes[at] = random.u8(..);
        bytes.truncate(bytes.len() - random.usize(..3));
        if let Ok(compiled) = CompiledInterface::read(&bytes) {
            let _ = (compiled.interface(true), compiled.components(), compiled.instances());
            let again = compiled.bytes().expect("as long as it was");
            assert_eq!(CompiledInterface::read(&again), Ok(compiled));
            read += 1;
        }
        let mut bytes = segments.clone();
        let at = random.usize(..bytes.len());
        bytes[at] = random.u8(..);
        if let Ok(table) = Segments::read(&bytes) {
            assert_eq!(Segments::read(&table.bytes()), Ok(table));
        }
    }
    assert!(read > 100, "{read}");
}
