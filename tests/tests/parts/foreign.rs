//! Programs that nobody here wrote, in the folder that `OB1_STEP7_PROJECTS` names: each project in a folder of its own.
//! Every block is imported, every program checks, and each of its functions is called with random values.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use ob1_cpu::{Cell, Clock, Command, Cpu, CpuConfig, OperatingState, Width};
use ob1_ir::{Arg, Call, CallMode, CodeBlock, DataBlock, DataKind, Number, Op, Operand, Place, Pointer, Stmt, Target};
use ob1_line::sim::SplitMix64;
use ob1_model::{Area, BitAddr, BlockId, BlockKind, DataType, Interface, Layout};
use ob1_project::{Files, Project, Tree, Wanted, translate};
use ob1_station::program;
use ob1_station_file::EngineChoice;
use ob1_stl::Mnemonics;
use ob1_time::{Instant, Span};

/// Calls of each function.
const CALLS: u32 = 20;
/// Where the area lies that a POINTER or ANY is to, in the data block of the actuals.
const BEHIND: u32 = 16_384;
const DATA_BYTES: u32 = 65_534;
/// An area length error when writing.
const LENGTH_WRITE: u16 = 0x2523;

struct Time(Instant);

impl Clock for Time {
    fn now(&mut self) -> Instant {
        self.0
    }
    fn executed(&mut self, statements: u64) {
        self.0 += statements * Span::from_nanos(100);
    }
    fn statements_in(&self, time: Span) -> Option<u64> {
        Some(time.div_ceil(Span::from_nanos(100)))
    }
    fn wait(&mut self, deadline: Instant) {
        self.0 = self.0.max(deadline);
    }
}

fn read(at: &Path, name: &str, out: &mut Files) {
    for entry in std::fs::read_dir(at).into_iter().flatten().flatten() {
        let (path, name) = (entry.path(), format!("{name}{}", entry.file_name().to_string_lossy()));
        if path.is_dir() {
            read(&path, &format!("{name}/"), out);
        } else {
            out.put(&name, std::fs::read(&path).unwrap_or_default());
        }
    }
}

/// A function with the actuals it is called with.
struct Driven {
    id: BlockId,
    /// Bytes of the actuals, from the beginning of their data block.
    bytes: u32,
    /// Where a STRING begins, and its greatest length.
    strings: Vec<(u32, u8)>,
}

fn strings(ty: &DataType, at: BitAddr, out: &mut Vec<(u32, u8)>) {
    let mut parts = Vec::new();
    Layout::components("", ty, at, &mut parts);
    for part in parts {
        if let DataType::String(length) = part.ty {
            out.push((part.at.byte(), length));
        }
    }
}

/// The block was compiled with another block of a number it calls: it hands a bit over where bytes are wanted.
fn calls_another(block: &CodeBlock, interfaces: &BTreeMap<BlockId, Interface>) -> bool {
    block.code.iter().any(|stmt| {
        let Op::Call(call) = &stmt.op else { return false };
        let Target::Block(id) = call.target else { return false };
        let Some(interface) = interfaces.get(&id) else { return false };
        let places = interface.list_places();
        interface.formals().zip(places).any(|(formal, place)| {
            let bit = |arg: &Arg| matches!(arg, Arg::Raw(pointer) if pointer >> 31 == 1 && pointer & 7 != 0);
            formal.ty != DataType::Bool && call.args.get(usize::from(place)).is_some_and(bit)
        })
    })
}

/// Blocks of this kind whose numbers no block has.
fn free(kind: BlockKind, taken: &BTreeSet<BlockId>) -> impl Iterator<Item = BlockId> {
    (1000..u16::MAX).map(move |number| BlockId::new(kind, number)).filter(|id| !taken.contains(id))
}

fn block(id: BlockId, ops: Vec<Op>) -> CodeBlock {
    let code = ops.into_iter().map(|op| Stmt { op, network: 1, line: 1 }).collect();
    CodeBlock { id, name: None, interface: Interface { temp_bytes: 20, ..Interface::default() }, code, source: 0 }
}

/// A function that clears the local data of those called after it: programs read what they have never written.
fn wipe(id: BlockId) -> CodeBlock {
    let text = format!(
        "FUNCTION {id} : VOID\nVAR_TEMP a : ARRAY [1..16000] OF BYTE; END_VAR\nBEGIN\nLAR1 P#L 0.0; L 4000;\n\
         next: T MW 2; L 0; T D [AR1,P#0.0]; +AR1 P#4.0; L MW 2; LOOP next;\nEND_FUNCTION\n"
    );
    let sources = [ob1_stl::Source::new("wipe.awl", text)];
    let options = ob1_stl::Options::default();
    let mut blocks = ob1_stl::compile(&sources, &ob1_stl::Library::new(), &options).program.blocks;
    CodeBlock { source: 0, ..blocks.remove(0) }
}

/// The call of a function with actuals in the data block `data`.
fn call(id: BlockId, interface: &Interface, data: u16) -> (Op, Driven) {
    let (mut layout, mut args, mut driven) = (Layout::new(), Vec::new(), Driven { id, bytes: 0, strings: Vec::new() });
    for formal in interface.formals() {
        let behind = 0x8400_0000 | (BEHIND * 8);
        args.push(match &formal.ty {
            ty if ty.is_parameter_type() => Arg::Number(Number::Fixed(1)),
            DataType::Any => {
                let any = [&[0x10, 0x02, 0x01, 0x00][..], &data.to_be_bytes(), &u32::to_be_bytes(behind)].concat();
                Arg::Bytes(any.into())
            }
            DataType::Pointer => Arg::Bytes([&data.to_be_bytes()[..], &u32::to_be_bytes(behind)].concat().into()),
            ty => {
                let at = layout.place(ty);
                strings(ty, at, &mut driven.strings);
                let width = ob1_ir::Width::of(ty).unwrap_or(ob1_ir::Width::Byte);
                Arg::Operand(Operand { width, place: Place::InDb(data, at) })
            }
        });
    }
    driven.bytes = layout.bytes();
    (Op::Call(Box::new(Call { mode: CallMode::Call, target: Target::Block(id), instance: None, args })), driven)
}

/// Calls every function of a program; gives what it found.
fn drive(program: &ob1_ir::Program, seed: u64) -> Result<(usize, BTreeMap<String, String>), String> {
    let mut program = program.clone();
    let taken: BTreeSet<BlockId> = program.blocks.iter().map(|block| block.id).collect();
    let data_taken: BTreeSet<BlockId> =
        program.data.iter().map(|data| BlockId::new(BlockKind::Db, data.number)).collect();
    let data = free(BlockKind::Db, &data_taken).next().ok_or("no number is free")?.number;
    let mut numbers = free(BlockKind::Fc, &taken);
    let interfaces = program.blocks.iter().map(|block| (block.id, block.interface.clone())).collect();
    let functions: Vec<(BlockId, Interface)> = program
        .blocks
        .iter()
        .filter(|block| block.id.kind == BlockKind::Fc && !calls_another(block, &interfaces))
        .map(|block| (block.id, block.interface.clone()))
        .collect();
    let mut driven = Vec::new();
    for (id, interface) in functions {
        let own = numbers.next().ok_or("no number is free")?;
        let (op, called) = call(id, &interface, data);
        program.blocks.push(block(own, vec![op]));
        driven.push((own, called));
    }
    program.blocks.retain(|block| block.id.kind != BlockKind::Ob);
    let by_number = Number::Memory(Pointer { area: Area::Memory, at: BitAddr(0) });
    let target = Target::Indirect(BlockKind::Fc, by_number);
    let indirect = Call { mode: CallMode::Unconditional, target, instance: None, args: Vec::new() };
    let wiper = numbers.next().ok_or("no number is free")?;
    program.blocks.push(wipe(wiper));
    let first = Call { target: Target::Block(wiper), ..indirect.clone() };
    let main = [first, indirect].map(|call| Op::Call(Box::new(call))).to_vec();
    for (number, ops) in [(1, main), (121, Vec::new()), (122, Vec::new())] {
        program.blocks.push(block(BlockId::new(BlockKind::Ob, number), ops));
    }
    program.data.push(DataBlock {
        number: data,
        name: None,
        kind: DataKind::Global,
        bytes: vec![0; DATA_BYTES as usize],
        components: Vec::new(),
        read_only: false,
        non_retain: false,
    });
    let natives = program::native_standard_blocks(&[]);
    let engine = ob1_station::engine::factory(EngineChoice::Reference);
    let mut cpu = Cpu::new(CpuConfig::default(), &program, natives, Vec::new(), engine)
        .map_err(|errors| format!("it does not load: {}", errors[0]))?;
    let (mut random, mut clock, mut found) = (SplitMix64::new(seed), Time(Instant::START), BTreeMap::new());
    let mut seen = 0;
    for (own, called) in &driven {
        for _ in 0..CALLS {
            if cpu.state() != OperatingState::Run {
                cpu.request(Command::Run);
                let _ = cpu.write(Cell::Area(Area::Memory, 0), Width::Word, 0);
            }
            let mut put = |byte: u32, width, value| cpu.write(Cell::Db(data, byte * 8), width, value);
            for at in (0..called.bytes.min(BEHIND)).chain(BEHIND..BEHIND + 256) {
                put(at, Width::Byte, random.next_u64() as u32 & 0xFF).map_err(|e| format!("{e:?}"))?;
            }
            for (at, length) in &called.strings {
                let used = random.next_u64() as u32 % (u32::from(*length) + 1);
                put(*at, Width::Word, u32::from(*length) << 8 | used).map_err(|e| format!("{e:?}"))?;
            }
            cpu.write(Cell::Area(Area::Memory, 0), Width::Word, u32::from(own.number)).map_err(|e| format!("{e:?}"))?;
            cpu.cycle(&mut clock);
            let new: Vec<_> = cpu.diagnostics().take_while(|entry| entry.number > seen).collect();
            for entry in new.iter().filter(|entry| entry.event.0 == LENGTH_WRITE) {
                found.insert(called.id.to_string(), entry.to_string());
            }
            seen = new.first().map_or(seen, |entry| entry.number);
        }
    }
    Ok((driven.len(), found))
}

#[test]
fn every_function_takes_random_values() {
    let Some(root) = std::env::var_os("OB1_STEP7_PROJECTS") else {
        println!("skipped: OB1_STEP7_PROJECTS names no folder of projects");
        return;
    };
    let (mut programs, mut functions, mut wrong) = (0, 0, Vec::new());
    for entry in std::fs::read_dir(&root).expect("a folder").flatten().filter(|entry| entry.path().is_dir()) {
        let mut files = Files::default();
        read(&entry.path(), "", &mut files);
        let tree = Tree::new(&files);
        for root in tree.roots() {
            let project = Project::read(&tree, &root);
            for choice in project.choices() {
                let name = format!("{} {}", entry.file_name().display(), project.title(choice));
                let Ok(folder) = project.blocks(&tree, choice) else { continue };
                let library = program::library(&[], &[]).expect("the system blocks");
                let wanted = Wanted {
                    page: project.page,
                    library: &library,
                    replaced: &BTreeSet::new(),
                    symbols: Vec::new(),
                    mnemonics: Mnemonics::International,
                };
                let translation = translate(&folder, &wanted);
                wrong.extend(translation.left_out.iter().map(|(block, why)| format!("{name} {block}: {why}")));
                programs += 1;
                match drive(&translation.program, programs) {
                    Ok((count, found)) => {
                        functions += count;
                        wrong.extend(found.into_iter().map(|(block, why)| format!("{name} {block}: {why}")));
                    }
                    Err(why) => wrong.push(format!("{name}: {why}")),
                }
            }
        }
    }
    println!("{programs} programs, {functions} functions");
    assert!(programs > 0, "no program below {}", Path::new(&root).display());
    assert_eq!(wrong, Vec::<String>::new());
}
