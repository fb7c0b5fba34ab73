//! Real projects: every code block of every block folder below `OB1_STEP7_PROJECTS` decodes, passes the verifier,
//! prints in both sets of mnemonics, compiles to the same statements, and comes back from machine code as it was.
//! Without the variable there is nothing to do: projects belong to their owners, and none is kept here.

#![allow(clippy::disallowed_methods, reason = "the test reads projects from the disk")]

use std::collections::BTreeMap;
use std::path::Path;

use ob1_ir::{CodeBlock, Defect, Op, Program};
use ob1_mc7::{CompiledInterface, Decoded, MachineBlock, Mc7Op, Segments, Statement, Written, decode, encode};
use ob1_model::{BlockId, Interface, Section};
use ob1_project::{Block, CodePage, Files, Folder, Tree};
use ob1_stl::print::{Declared, Heading, Listing, Printer};
use ob1_stl::{Library, Mnemonics, Options, Source, compile};

/// What was found.
#[derive(Debug, Default, PartialEq, Eq)]
struct Figures {
    blocks: usize,
    statements: usize,
    frames: usize,
    folded: usize,
    same_length: usize,
    wrong: Vec<String>,
}

/// The files of block folders below a folder of the disk.
fn files(at: &Path, name: &str, out: &mut Files) {
    for entry in std::fs::read_dir(at).into_iter().flatten().flatten() {
        let (path, name) = (entry.path(), format!("{name}{}", entry.file_name().to_string_lossy()));
        let wanted = ["SUBBLK.DBF", "SUBBLK.DBT", "BAUSTEIN.DBF", "BAUSTEIN.DBT"];
        if path.is_dir() {
            files(&path, &format!("{name}/"), out);
        } else if wanted.iter().any(|w| name.to_ascii_uppercase().ends_with(w)) {
            out.put(&name, std::fs::read(&path).unwrap_or_default());
        }
    }
}

/// The declarations in the order of our compiler.
fn interface(block: &Block, compiled: &CompiledInterface) -> Interface {
    let order = [Section::Input, Section::Output, Section::InOut, Section::Return, Section::Static, Section::Temp];
    let mut interface = compiled.interface(block.id.kind.has_instance());
    if !block.id.kind.has_instance() {
        interface.params.sort_by_key(|p| order.iter().position(|s| *s == p.section));
    }
    interface
}

fn bare(block: &CodeBlock) -> CodeBlock {
    let mut block = CodeBlock { source: 0, name: None, ..block.clone() };
    block.code.iter_mut().for_each(|stmt| stmt.line = 0);
    block
}

fn frames(code: &[u8]) -> usize {
    let (mut at, mut count) = (0, 0);
    while let Ok((statement, length)) = Statement::read(code.get(at..).unwrap_or_default()) {
        count += usize::from(matches!(statement.op, Mc7Op::Build(1 | 3 | 7 | 9 | 14 | 16)));
        at += length;
    }
    count
}

struct Known {
    interfaces: BTreeMap<BlockId, Interface>,
    instances: BTreeMap<BlockId, BTreeMap<usize, BlockId>>,
}

/// Everything a block has to pass; the error says what it did not.
fn check(block: &Block, known: &Known, figures: &mut Figures) -> Result<(), String> {
    let callees = |id: BlockId| known.interfaces.get(&id);
    let interface = callees(block.id).ok_or("no interface")?;
    let segments = Segments::read(&block.segments).map_err(|e| e.to_string())?;
    if segments.bytes() != block.segments {
        return Err("the segment table writes other bytes".to_owned());
    }
    let machine = |code| MachineBlock {
        id: block.id,
        name: None,
        interface,
        code,
        segments: &segments,
        multi_instance: !block.code_version1,
        local_bytes: 0,
    };
    let decoded = decode(&machine(&block.code), &callees).map_err(|e| e.to_string())?;
    figures.blocks += 1;
    figures.statements += decoded.block.code.len();
    figures.frames += frames(&block.code);
    figures.folded +=
        decoded.block.code.iter().filter(|s| matches!(&s.op, Op::Call(c) if c.mode == ob1_ir::CallMode::Call)).count();
    let program = Program { blocks: vec![decoded.block.clone()], sources: vec!["a".into()], ..Program::default() };
    for finding in ob1_ir::verify(&program, &callees).err().unwrap_or_default() {
        if !matches!(finding.defect, Defect::UnknownBlock(_)) {
            return Err(finding.to_string());
        }
    }
    let written = Written { multi_instance: !block.code_version1, notations: decoded.notations.clone() };
    let encoded = encode(&decoded.block, &written, &callees).map_err(|e| e.to_string())?;
    figures.same_length += usize::from(encoded.code.len() == block.code.len());
    let again = MachineBlock { segments: &encoded.segments, ..machine(&encoded.code) };
    let again = decode(&again, &callees).map_err(|e| e.to_string())?;
    if bare(&again.block) != bare(&decoded.block) {
        return Err("machine code of ours decodes to another block".to_owned());
    }
    [Mnemonics::German, Mnemonics::International].into_iter().try_for_each(|m| text(block, known, &decoded, m))
}

fn text(block: &Block, known: &Known, decoded: &Decoded, mnemonics: Mnemonics) -> Result<(), String> {
    let callees = |id: BlockId| known.interfaces.get(&id);
    let declared = Declared { instances: known.instances[&block.id].clone(), ..Declared::default() };
    let listing = Listing { notations: decoded.notations.clone(), ..Listing::default() };
    let printed = Printer::new(mnemonics, &callees).block(&decoded.block, &Heading::default(), &declared, &listing);
    let printed = printed.map_err(|e| e.to_string())?;
    let mut library = Library::new();
    for (id, interface) in known.interfaces.iter().filter(|(id, _)| **id != block.id) {
        library.insert(*id, "called", interface.clone());
    }
    let options = Options { mnemonics, ..Options::default() };
    let output = compile(&[Source::new("printed", printed)], &library, &options);
    match output.program.blocks.first() {
        Some(compiled) if output.is_good() && bare(compiled) == bare(&decoded.block) => Ok(()),
        _ => Err(format!("its text compiles to another block: {:?}", output.diagnostics.first())),
    }
}

fn folder(name: &str, folder: &Folder, figures: &mut Figures) {
    let mut known = Known { interfaces: BTreeMap::new(), instances: BTreeMap::new() };
    for block in folder.blocks.values() {
        match CompiledInterface::read(&block.interface) {
            Ok(compiled) => {
                if compiled.bytes().as_ref() != Ok(&block.interface) {
                    figures.wrong.push(format!("{name} {}: its interface writes other bytes", block.id));
                }
                known.interfaces.insert(block.id, interface(block, &compiled));
                known.instances.insert(block.id, compiled.instances());
            }
            Err(_) if block.interface.is_empty() => {}
            Err(error) => figures.wrong.push(format!("{name} {}: {error}", block.id)),
        }
    }
    use ob1_model::BlockKind::{Fb, Fc, Ob};
    for block in folder.blocks.values().filter(|b| matches!(b.id.kind, Ob | Fb | Fc)) {
        if let Err(why) = check(block, &known, figures) {
            figures.wrong.push(format!("{name} {}: {why}", block.id));
        }
    }
}

#[test]
fn every_block_of_every_project() {
    let Some(root) = std::env::var_os("OB1_STEP7_PROJECTS") else {
        println!("skipped: OB1_STEP7_PROJECTS names no folder of projects");
        return;
    };
    let mut all = Files::default();
    files(Path::new(&root), "", &mut all);
    let tree = Tree::new(&all);
    let mut folders: Vec<&str> =
        all.0.keys().filter_map(|path| path.rsplit_once('/').map(|(folder, _)| folder)).collect();
    folders.dedup();
    let mut figures = Figures::default();
    for path in folders {
        match Folder::read(&tree, &format!("{path}/"), CodePage::default()) {
            Ok(found) => folder(path, &found, &mut figures),
            Err(why) => println!("{path}: {why}"),
        }
    }
    println!("{figures:#?}");
    assert_eq!(figures.wrong, Vec::<String>::new());
    assert!(figures.blocks > 0, "no block folder below {}", Path::new(&root).display());
}
