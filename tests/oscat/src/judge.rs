//! One block, two ways: random calls of both programs, and what differs afterwards.

use ob1_cpu::{
    Cell, Clock, Command, Cpu, CpuConfig, NativeBlock, OperatingState, Width, engine, standard_block, system_blocks,
};
use ob1_ir::{Arg, Call, CallMode, CodeBlock, DataBlock, DataKind, Number, Op, Operand, Place, Program, Stmt, Target};
use ob1_model::{Area, BitAddr, BlockId, BlockKind, DataType, Interface, Layout, Param, Section};
use ob1_time::{Instant, Span};

/// The data block that holds the parameters of a function, and the instance of a function block.
const DATA: u16 = 9000;

/// Virtual time: each cycle lasts as long as it is told.
struct Virtual(Instant, u64);

impl Clock for Virtual {
    fn now(&mut self) -> Instant {
        self.0
    }
    fn executed(&mut self, statements: u64) {
        self.1 += statements;
        // A loop without end is found by the monitoring of the cycle.
        if self.1 > 2_000_000 {
            self.0 += Span::from_millis(1000);
        }
    }
    fn wait(&mut self, deadline: Instant) {
        self.0 = self.0.max(deadline);
    }
}

/// What was found for a block.
#[derive(Debug, PartialEq, Eq)]
pub enum Verdict {
    Equal(u32),
    /// The number of the call, and what differs.
    Differs(u32, String),
    /// Why it was not judged.
    Left(String),
}

/// A parameter with its place in the data block.
struct Slot {
    at: BitAddr,
    ty: DataType,
    section: Section,
}

/// Components of a type that are elementary or texts.
fn slots(interface: &Interface, id: BlockId) -> (Vec<Slot>, u32) {
    let mut out = Vec::new();
    if id.kind.has_instance() {
        for p in interface.params.iter().filter(|p| p.section != Section::Temp) {
            out.push(Slot { at: p.at, ty: p.ty.clone(), section: p.section });
        }
        return (out, interface.instance_bytes);
    }
    let mut layout = Layout::new();
    for p in interface.formals() {
        layout.end_section();
        out.push(Slot { at: layout.place(&p.ty), ty: p.ty.clone(), section: p.section });
    }
    layout.end_section();
    (out, layout.bytes().max(2))
}

fn simple(ty: &DataType) -> bool {
    ty.elementary_bits().is_some() || matches!(ty, DataType::String(_) | DataType::DateAndTime)
}

/// True for a block whose parameters can be drawn.
fn drawable(interface: &Interface, id: BlockId) -> Result<(), String> {
    for p in interface.formals() {
        let data = |ty: &DataType| {
            let mut all = Vec::new();
            Layout::components("", ty, BitAddr(0), &mut all);
            all.iter().all(|c| simple(&c.ty))
        };
        if p.ty.is_parameter_type() || matches!(p.ty, DataType::Any | DataType::Pointer) || !data(&p.ty) {
            return Err(format!("{} is {}", p.name, p.ty.name()));
        }
        if id.kind.has_instance() && p.is_pointer() {
            return Err(format!("{} is a composed in/out", p.name));
        }
    }
    Ok(())
}

fn operand(slot: &Slot) -> Arg {
    let width = Width::of(&slot.ty).unwrap_or(Width::Byte);
    Arg::Operand(Operand { width, place: Place::InDb(DATA, slot.at) })
}

/// The program with an OB 1 that calls the block, and keeps BR in M 0.0.
fn with_call(program: &Program, id: BlockId, interface: &Interface) -> Program {
    let (slots, bytes) = slots(interface, id);
    let mut program = program.clone();
    program.blocks.retain(|b| b.id.kind != BlockKind::Ob);
    program.data.retain(|d| d.number != DATA);
    let instance = id.kind.has_instance();
    let (args, number) = match instance {
        true => (interface.formals().map(|_| Arg::Open).collect(), Some(Number::Fixed(DATA))),
        false => (slots.iter().map(operand).collect(), None),
    };
    let call = Call { mode: CallMode::Call, target: Target::Block(id), instance: number, args };
    let test = ob1_ir::BitTest::Status(ob1_ir::StatusBit::BinaryResult);
    let bit = Place::Fixed(Area::Memory, BitAddr(0));
    let ops = vec![
        Op::SetRlo,
        Op::SaveRlo,
        Op::Call(Box::new(call)),
        Op::Scan { logic: ob1_ir::Logic::And, negate: false, test },
        Op::Assign(bit),
    ];
    let block = |number, ops: Vec<Op>| CodeBlock {
        id: BlockId::new(BlockKind::Ob, number),
        name: None,
        interface: Interface { temp_bytes: 20, ..Interface::default() },
        code: ops.into_iter().map(|op| Stmt { op, network: 1, line: 1 }).collect(),
        source: 0,
    };
    program.blocks.push(block(1, ops));
    program.blocks.push(block(121, Vec::new()));
    program.blocks.push(block(122, Vec::new()));
    program.blocks.push(block(80, Vec::new()));
    let kind = if instance { DataKind::Instance(id) } else { DataKind::Global };
    let mut image = vec![0; bytes as usize];
    for (p, slot) in interface.params.iter().filter(|p| p.section != Section::Temp).zip(&slots) {
        prepare(p, slot, &mut image);
    }
    program.data.push(DataBlock {
        number: DATA,
        name: None,
        kind,
        bytes: image,
        components: Vec::new(),
        read_only: false,
        non_retain: false,
    });
    if program.sources.is_empty() {
        program.sources.push("machine code".to_owned());
    }
    program
}

fn prepare(param: &Param, slot: &Slot, image: &mut [u8]) {
    let start = slot.at.byte() as usize;
    match (&param.initial, &slot.ty) {
        (Some(bytes), DataType::Bool) => {
            if bytes.first().is_some_and(|b| b & 1 == 1) {
                image[start] |= 1 << slot.at.bit();
            }
        }
        (Some(bytes), _) => image[start..start + bytes.len()].copy_from_slice(bytes),
        (None, ty) => {
            let mut all = Vec::new();
            Layout::components("", ty, slot.at, &mut all);
            for c in all {
                if let DataType::String(max) = c.ty {
                    image[c.at.byte() as usize] = max;
                }
            }
        }
    }
}

/// A CPU with its clock.
struct Side {
    cpu: Cpu,
    clock: Virtual,
}

impl Side {
    fn new(program: &Program, natives: Vec<Box<dyn NativeBlock>>) -> Result<Self, String> {
        let config = CpuConfig { memory_bytes: 1024, ..CpuConfig::default() };
        let cpu = Cpu::new(config, program, natives, Vec::new(), engine::REFERENCE);
        let mut cpu = cpu.map_err(|e| format!("{e:?}"))?;
        cpu.request(Command::Run);
        Ok(Self { cpu, clock: Virtual(Instant::START, 0) })
    }

    fn cycle(&mut self, step: Span) -> OperatingState {
        self.clock.0 += step;
        self.clock.1 = 0;
        self.cpu.cycle(&mut self.clock).state
    }

    fn write(&mut self, at: BitAddr, width: Width, value: u32) {
        let _ = self.cpu.write(Cell::Db(DATA, at.0), width, value);
    }

    fn why(&self) -> String {
        self.cpu.diagnostics().next().map(ToString::to_string).unwrap_or_default()
    }
}

/// Values that are drawn before all others.
fn edges(ty: &DataType) -> &'static [u32] {
    match ty {
        DataType::Bool => &[0, 1],
        DataType::Byte | DataType::Char => &[0, 1, 0x7F, 0x80, 0xFF],
        DataType::Int => &[0, 1, 0xFFFF, 0x7FFF, 0x8000, 10, 100],
        DataType::Word | DataType::S5Time | DataType::Date => &[0, 1, 0xFFFF, 0x7FFF, 0x8000, 0x1234],
        DataType::Real => &[
            0,
            0x3F80_0000,
            0xBF80_0000,
            0x8000_0000,
            0x7F80_0000,
            0x7FC0_0000,
            0x3F00_0000,
            0x4120_0000,
            0x0080_0000,
            0x7F7F_FFFF,
        ],
        DataType::TimeOfDay => &[0, 1, 43_200_000, 86_399_999],
        _ => &[0, 1, u32::MAX, 0x7FFF_FFFF, 0x8000_0000, 1000],
    }
}

fn draw(rng: &mut fastrand::Rng, ty: &DataType, call: u32) -> u32 {
    let list = edges(ty);
    if call < 200 || rng.u8(..) < 40 {
        return list[rng.usize(..list.len())];
    }
    match ty {
        DataType::Bool => u32::from(rng.bool()),
        DataType::Byte | DataType::Char => u32::from(rng.u8(..)),
        DataType::Int => match rng.u8(..3) {
            0 => rng.i16(-20..60) as u16 as u32,
            1 => rng.i16(-400..2400) as u16 as u32,
            _ => u32::from(rng.u16(..)),
        },
        DataType::Word | DataType::S5Time | DataType::Date => u32::from(rng.u16(..)),
        DataType::Real => match rng.u8(..4) {
            0 => (rng.f32() * 4.0 - 2.0).to_bits(),
            1 => ((rng.f32() - 0.5) * 200.0).to_bits(),
            2 => ((rng.f32() - 0.5) * 2e6).to_bits(),
            _ => (rng.i32(-50..50) as f32).to_bits(),
        },
        DataType::TimeOfDay => rng.u32(..86_400_000),
        DataType::Time => match rng.u8(..3) {
            0 => rng.u32(..5000),
            _ => rng.i32(-100_000..10_000_000) as u32,
        },
        DataType::DInt | DataType::DWord => match rng.u8(..3) {
            0 => rng.i32(-100..3000) as u32,
            1 => rng.i32(-1_000_000..1_000_000) as u32,
            _ => rng.u32(..),
        },
        _ => rng.u32(..),
    }
}

fn text(rng: &mut fastrand::Rng, max: u8) -> Vec<u8> {
    let kinds: [&[u8]; 5] = [b"0123456789", b"0123456789+-.,Ee ", b"abcXYZ 09", b"01", b" \r\n:./;#$%&"];
    let kind = kinds[rng.usize(..kinds.len())];
    let length = match rng.u8(..4) {
        0 => 0,
        1 => rng.usize(..=usize::from(max).min(4)),
        2 => rng.usize(..=usize::from(max).min(20)),
        _ => rng.usize(..=usize::from(max)),
    };
    (0..length).map(|_| if rng.u8(..) < 12 { rng.u8(..) } else { kind[rng.usize(..kind.len())] }).collect()
}

/// Draws a value for each place, into both sides.
fn supply(sides: &mut [Side; 2], slot: &Slot, rng: &mut fastrand::Rng, call: u32) {
    let mut all = Vec::new();
    Layout::components("", &slot.ty, slot.at, &mut all);
    for c in all {
        match &c.ty {
            DataType::String(max) => {
                let text = text(rng, *max);
                let bytes = [&[*max, text.len() as u8][..], &text].concat();
                for (at, byte) in (0u32..).zip(bytes) {
                    for side in sides.iter_mut() {
                        side.write(BitAddr(c.at.0 + at * 8), Width::Byte, u32::from(byte));
                    }
                }
            }
            DataType::DateAndTime => {
                let bcd = |v: u32| ((v / 10) << 4) | (v % 10);
                let bytes = [
                    bcd(rng.u32(..100)),
                    bcd(rng.u32(1..13)),
                    bcd(rng.u32(1..29)),
                    bcd(rng.u32(..24)),
                    bcd(rng.u32(..60)),
                    bcd(rng.u32(..60)),
                    bcd(rng.u32(..100)),
                    rng.u32(..10) << 4 | rng.u32(1..8),
                ];
                for (at, byte) in (0u32..).zip(bytes) {
                    for side in sides.iter_mut() {
                        side.write(BitAddr(c.at.0 + at * 8), Width::Byte, byte);
                    }
                }
            }
            ty => {
                let value = draw(rng, ty, call);
                let width = Width::of(ty).unwrap_or(Width::Byte);
                for side in sides.iter_mut() {
                    side.write(c.at, width, value);
                }
            }
        }
    }
}

/// What runs the library of both sides.
fn natives(replaced: &std::collections::BTreeSet<BlockId>) -> Vec<Box<dyn NativeBlock>> {
    let mut natives: Vec<Box<dyn NativeBlock>> = system_blocks();
    for block in ob1_std::standard_blocks() {
        if replaced.contains(&block.id) && block.origin == ob1_std::Origin::Iec {
            natives.push(standard_block(block.id, block));
        }
    }
    natives
}

/// Judges one block over so many calls.
pub fn judge(
    reference: &Program,
    ours: &Program,
    id: BlockId,
    replaced: &std::collections::BTreeSet<BlockId>,
    calls: u32,
) -> Verdict {
    let find = |p: &Program| p.blocks.iter().find(|b| b.id == id).map(|b| b.interface.clone());
    let (Some(theirs), Some(own)) = (find(reference), find(ours)) else {
        return Verdict::Left("it is not in both programs".to_owned());
    };
    if let Err(why) = drawable(&own, id) {
        return Verdict::Left(why);
    }
    let kinds = |i: &Interface| i.formals().map(|p| p.ty.name()).collect::<Vec<_>>();
    if kinds(&theirs) != kinds(&own) || theirs.instance_bytes != own.instance_bytes {
        return Verdict::Left("the interfaces differ".to_owned());
    }
    if std::env::var_os("OB1_SHOW").is_some() {
        for (name, p) in [("theirs", reference), ("ours", ours)] {
            let mut one = p.clone();
            one.blocks.retain(|b| b.id == id);
            one.data.clear();
            one.symbols.clear();
            println!(
                "--- {name}\n{}",
                ob1_stl::listing(&one).lines().filter(|l| !l.starts_with("source")).collect::<Vec<_>>().join("\n")
            );
        }
    }
    let sides = [reference, ours].map(|p| Side::new(&with_call(p, id, &own), natives(replaced)));
    let [Ok(one), Ok(two)] = sides else {
        let why: Vec<String> = sides.into_iter().filter_map(Result::err).collect();
        return Verdict::Left(format!("it does not load: {}", why.join(", ")));
    };
    let mut sides = [one, two];
    let (slots, _) = slots(&own, id);
    let mut rng = fastrand::Rng::with_seed(u64::from(id.number) << 8 | id.kind as u64);
    let mut stops = 0;
    for call in 0..calls {
        let sections = |s: Section| !matches!(s, Section::Static | Section::Temp);
        for slot in slots.iter().filter(|s| sections(s.section)) {
            let input = matches!(slot.section, Section::Input | Section::InOut);
            // Outputs of a function have what the caller left there: the same on both sides.
            if input && (!id.kind.has_instance() || call < 20 || rng.u8(..) < 90) {
                supply(&mut sides, slot, &mut rng, call);
            }
        }
        let step = match rng.u8(..4) {
            0 => Span::from_millis(1),
            1 => Span::from_millis(rng.u64(1..50)),
            2 => Span::from_millis(rng.u64(1..2000)),
            _ => Span::from_millis(10),
        };
        let states = [sides[0].cycle(step), sides[1].cycle(step)];
        if states[0] != states[1] {
            let why = [sides[0].why(), sides[1].why()];
            return Verdict::Differs(
                call,
                format!("theirs {:?} ({}), ours {:?} ({})", states[0], why[0], states[1], why[1]),
            );
        }
        if states[0] != OperatingState::Run {
            stops += 1;
            if stops > 20 {
                return Verdict::Left(format!("both stop: {}", sides[0].why()));
            }
            sides.iter_mut().for_each(|s| s.cpu.request(Command::Run));
            continue;
        }
        if let Some(what) = difference(&sides, reference, &own, id) {
            return Verdict::Differs(call, what);
        }
    }
    Verdict::Equal(calls)
}

/// What differs after a call.
fn difference(sides: &[Side; 2], reference: &Program, interface: &Interface, id: BlockId) -> Option<String> {
    let [one, two] = sides;
    let (a, b) = (one.cpu.data_block(DATA)?, two.cpu.data_block(DATA)?);
    if a != b {
        let (slots, _) = slots(interface, id);
        let params: Vec<&Param> = interface.params.iter().filter(|p| p.section != Section::Temp).collect();
        let at = a.iter().zip(b).position(|(a, b)| a != b).unwrap_or(0);
        let named = |p: &&Param, s: &Slot| {
            let bytes = Layout::bits(&s.ty).div_ceil(8).max(1);
            let from = s.at.byte() as usize;
            if matches!(s.ty, DataType::String(_)) {
                // What lies behind the actual length of a text means nothing.
                let end = from + 2 + usize::from(*a.get(from + 1).unwrap_or(&0));
                return (a.get(from..end) != b.get(from..end)).then(|| {
                    format!(
                        "{} {:?} {:?}",
                        p.name,
                        String::from_utf8_lossy(&a[from..end]),
                        String::from_utf8_lossy(&b[from..end])
                    )
                });
            }
            let range = from..from + bytes as usize;
            let (x, y) = (a.get(range.clone())?, b.get(range)?);
            if s.ty == DataType::Real {
                let real = |x: &[u8]| Some(f32::from_be_bytes(x.try_into().ok()?));
                let (x, y) = (real(x)?, real(y)?);
                return (!(x.is_nan() && y.is_nan()) && x.to_bits() != y.to_bits())
                    .then(|| format!("{} {x} {y}", p.name));
            }
            (x != y).then(|| format!("{} ({}) {x:02x?} {y:02x?}", p.name, p.ty.name()))
        };
        let list: Vec<String> = params.iter().zip(&slots).filter_map(|(p, s)| named(p, s)).collect();
        if !list.is_empty() {
            return Some(format!("byte {at}: {}", list.join("; ")));
        }
    }
    if one.cpu.bit_memory() != two.cpu.bit_memory() {
        return Some(format!("BR or memory: {:02x?} {:02x?}", &one.cpu.bit_memory()[..4], &two.cpu.bit_memory()[..4]));
    }
    for db in reference.data.iter().filter(|d| d.number != DATA) {
        if one.cpu.data_block(db.number) != two.cpu.data_block(db.number) {
            return Some(format!("DB {}", db.number));
        }
    }
    None
}
