//! Random trees: statements, machine code and back; drawings in which every operand stands and nothing overlaps;
//! statements that somebody has changed.

#![allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "how long a run is comes from outside; one test measures"
)]

mod common;

use std::collections::BTreeMap;

use common::drawn::check_drawing;
use common::trees::{Maker, bare};
use ob1_ir::{CodeBlock, Op, Stmt};
use ob1_ladder::tree::Tree;
use ob1_ladder::{Form, Made, Network, Options, draw, generate, line, read, read_step7, text};
use ob1_mc7::{MachineBlock, Written, decode, encode};
use ob1_model::{BlockId, BlockKind, Interface};

/// Trees of the short run; `OB1_LADDER_TREES` for a longer one.
fn trees() -> u64 {
    std::env::var("OB1_LADDER_TREES").ok().and_then(|count| count.parse().ok()).unwrap_or(3000)
}

fn block(made: &[Made]) -> CodeBlock {
    let stmt = |made: &Made| {
        let op = match (&made.op, made.to) {
            (Op::Jump(jump, _), Some(to)) => Op::Jump(*jump, to as u32),
            (op, _) => op.clone(),
        };
        Stmt { op, network: 1, line: 1 }
    };
    let mut code: Vec<Stmt> = made.iter().map(stmt).collect();
    // A target behind the last statement is one.
    code.push(Stmt { op: Op::Nop, network: 2, line: 1 });
    let interface = Interface { temp_bytes: CodeBlock::local_bytes(&code), ..Interface::default() };
    CodeBlock { id: BlockId::new(BlockKind::Fc, 1), name: None, interface, code, source: 0 }
}

fn interfaces() -> BTreeMap<BlockId, Interface> {
    common::compiled("NETWORK\nNOP 0;").1
}

fn network(block: &CodeBlock, interfaces: &BTreeMap<BlockId, Interface>) -> Network {
    common::networks(block, interfaces, &[]).swap_remove(0)
}

fn made(seed: u64) -> Tree {
    Maker::new(seed, 4 + (seed % 40) as u32, false).tree(2 + (seed % 4) as u32)
}

#[test]
fn trees_come_back_from_machine_code() {
    let interfaces = interfaces();
    let callees = |id: BlockId| interfaces.get(&id);
    // Taken for another: a coil S and behind it a box of R alone with the same operand; an open box before the logic
    // of a call that begins with its operand; a coil before such logic.
    for seed in (0..trees()).chain([48_381, 379_485, 891_280, 951_069]) {
        let tree = made(seed);
        let block = block(&generate(&tree));
        let encoded = encode(&block, &Written::default(), &callees).unwrap_or_else(|e| panic!("{seed}: {e}"));
        let machine = MachineBlock {
            id: block.id,
            name: None,
            interface: &Interface::default(),
            code: &encoded.code,
            segments: &encoded.segments,
            multi_instance: false,
            local_bytes: 0,
        };
        let decoded = decode(&machine, &callees).unwrap_or_else(|e| panic!("{seed}: {e}"));
        let network = network(&decoded.block, &interfaces);
        match read_step7(&network) {
            Ok(again) => assert_eq!(bare(&tree), bare(&again), "seed {seed}"),
            Err(reason) => {
                let ops: Vec<String> = network.statements.iter().map(|s| s.op.to_string()).collect();
                panic!("seed {seed}: {reason}\n{}", ops.join("; "));
            }
        }
    }
}

#[test]
fn every_operand_is_drawn_and_nothing_overlaps() {
    let interfaces = interfaces();
    for seed in 0..trees() {
        let network = network(&block(&generate(&made(seed))), &interfaces);
        let tree = read_step7(&network).expect("it is drawn");
        for form in [Form::Ladder, Form::Plan] {
            check_drawing(&format!("seed {seed}"), &network, &tree, form);
        }
        assert!(!line(&network, &tree, &Options::default()).contains('\n'));
    }
}

#[test]
fn changed_networks_are_exact_or_statements() {
    let interfaces = interfaces();
    let mut drawn = 0;
    for seed in 0..trees() {
        let mut block = block(&generate(&made(seed)));
        let mut rng = fastrand::Rng::with_seed(seed);
        let last = block.code.len() - 1;
        let at = rng.usize(0..last);
        match rng.u32(0..3) {
            0 => block.code[at].op = block.code[rng.usize(0..last)].op.clone(),
            // What jumps lead to moves with the statements.
            1 => drop(block.code.remove(at)),
            _ => block.code.insert(at, block.code[at].clone()),
        }
        let network = network(&block, &interfaces);
        let Ok(tree) = read(&network) else { continue };
        drawn += 1;
        let counts = |op: &Op| tree.as_step7 || !matches!(op, Op::Nop | Op::Build(_));
        let plain = |op: &Op| match op {
            Op::Jump(ob1_ir::Jump::IfNotRloSaveBr, _) => Op::Jump(ob1_ir::Jump::IfNotRloSaveBr, 0),
            op => op.clone(),
        };
        // A NOP 0 that carries the network's label is no part of the picture.
        let is_plain = network.label.is_empty() || network.statements.first().is_none_or(|s| s.op != Op::Nop);
        let theirs: Vec<Op> =
            network.statements.iter().skip(usize::from(!is_plain)).map(|s| plain(&s.op)).filter(counts).collect();
        let ours: Vec<Op> = generate(&tree).iter().map(|made| plain(&made.op)).filter(counts).collect();
        if !network.is_empty() {
            assert_eq!(theirs, ours, "seed {seed}");
        }
        assert_eq!(draw(&network, &tree, &Options::default()).height == 0, network.is_empty());
    }
    assert!(drawn > 0, "no changed network was drawn");
}

/// A bound that holds on a busy machine too; the time itself is printed.
#[test]
fn five_hundred_networks_are_drawn_at_once() {
    let interfaces = interfaces();
    let networks: Vec<Network> = (0..500).map(|seed| network(&block(&generate(&made(seed))), &interfaces)).collect();
    let begin = std::time::Instant::now();
    let texts = || -> Vec<String> {
        let draw = |network: &Network| {
            let tree = read(network).expect("it is drawn");
            text::lines(&draw(network, &tree, &Options::default()), false).join("\n")
        };
        networks.iter().map(draw).collect()
    };
    let first = texts();
    let took = begin.elapsed();
    println!("500 networks: {took:?}");
    assert_eq!(first, texts(), "other bytes in another run");
    assert!(took.as_secs() < 10, "{took:?}");
}
