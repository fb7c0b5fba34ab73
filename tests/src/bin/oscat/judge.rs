//! One block, two ways: random calls of both programs, and what differs afterwards.

use std::collections::BTreeSet;

use ob1_cpu::{
    Cell, Clock, Command, Cpu, CpuConfig, NativeBlock, OperatingState, Width, engine, standard_block, system_blocks,
};
use ob1_ir::{Arg, Call, CallMode, CodeBlock, DataBlock, DataKind, Number, Op, Operand, Place, Program, Stmt, Target};
use ob1_model::{Area, BitAddr, BlockId, BlockKind, DataType, Interface, Layout, Param, Section};
use ob1_time::{Instant, Span};

/// The data block that holds the parameters of a function, and the instance of a function block.
const DATA: u16 = 9000;
/// The data block that pointers lead to, and its bytes.
const REGION: u16 = 9001;
const REGION_BYTES: u32 = 8192;
/// The function that clears the local data which the judged block gets, and its bytes: what a block reads without
/// having written it is 0 on both sides.
const CLEAR: u16 = 9000;
const CLEAR_BYTES: u32 = 6000;
/// Statements of a call after which it counts as endless.
const ENDLESS: u64 = 2_000_000;
/// Endless calls of a block, after which no more are made.
const MOST_ENDLESS: u32 = 20;

/// Why a block is left out that is no failure.
pub const NO_MACHINE_CODE: &str = "its project has no machine code of it";

/// Virtual time: each cycle lasts as long as it is told.
struct Virtual(Instant, u64);

impl Clock for Virtual {
    fn now(&mut self) -> Instant {
        self.0
    }
    fn executed(&mut self, statements: u64) {
        self.1 += statements;
        // A loop without end is found by the monitoring of the cycle.
        if self.1 > ENDLESS {
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
pub struct Slot {
    at: BitAddr,
    ty: DataType,
    pub section: Section,
    /// Of what a pointer leads to: its place in [`REGION`].
    region: Option<BitAddr>,
}

/// The parameters of a block in its data block, and the bytes of that.
fn slots(interface: &Interface, id: BlockId) -> (Vec<Slot>, u32) {
    let mut out = Vec::new();
    let mut region = Layout::new();
    let mut layout = Layout::new();
    let has_instance = id.kind.has_instance();
    for p in interface.params.iter().filter(|p| p.section != Section::Temp) {
        if p.section == Section::Static && !has_instance {
            continue;
        }
        let pointed = has_instance && p.is_pointer();
        let region = pointed.then(|| {
            region.end_section();
            region.place(&p.ty)
        });
        layout.end_section();
        let at = if has_instance { p.at } else { layout.place(&p.ty) };
        out.push(Slot { at, ty: p.ty.clone(), section: p.section, region });
    }
    layout.end_section();
    (out, if has_instance { interface.instance_bytes } else { layout.bytes().max(2) })
}

const fn is_pointer(ty: &DataType) -> bool {
    matches!(ty, DataType::Any | DataType::Pointer)
}

/// Why the parameters of a block cannot be drawn, if they cannot.
fn undrawable(interface: &Interface) -> Option<String> {
    let simple =
        |ty: &DataType| ty.elementary_bits().is_some() || matches!(ty, DataType::String(_) | DataType::DateAndTime);
    let data = |ty: &DataType| {
        let mut all = Vec::new();
        Layout::components("", ty, BitAddr(0), &mut all);
        all.iter().all(|c| simple(&c.ty))
    };
    let known = |p: &&Param| !p.ty.is_parameter_type() && (is_pointer(&p.ty) || data(&p.ty));
    interface.formals().find(|p| !known(p)).map(|p| format!("{} is {}", p.name, p.ty.name()))
}

fn operand(slot: &Slot) -> Arg {
    if is_pointer(&slot.ty) {
        return Arg::Bytes(pointer(&slot.ty, BitAddr(0)).into());
    }
    let width = Width::of(&slot.ty).unwrap_or(Width::Byte);
    Arg::Operand(Operand { width, place: Place::InDb(DATA, slot.at) })
}

/// A POINTER or ANY to a place in [`REGION`].
fn pointer(ty: &DataType, at: BitAddr) -> Vec<u8> {
    let mut out = Vec::new();
    if *ty == DataType::Any {
        out.extend([0x10, 2]);
        out.extend((REGION_BYTES as u16).to_be_bytes());
    }
    out.extend(REGION.to_be_bytes());
    out.extend((u32::from(Area::Db.pointer_code()) << 24 | at.0).to_be_bytes());
    out
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
    let clear = Call {
        mode: CallMode::Call,
        target: Target::Block(BlockId::new(BlockKind::Fc, CLEAR)),
        instance: None,
        args: Vec::new(),
    };
    let ops = vec![
        Op::Call(Box::new(clear)),
        Op::SetRlo,
        Op::SaveRlo,
        Op::Call(Box::new(call)),
        Op::Scan { logic: ob1_ir::Logic::And, negate: false, test },
        Op::Assign(bit),
    ];
    let block = |kind, number, temp_bytes, ops: Vec<Op>| CodeBlock {
        id: BlockId::new(kind, number),
        name: None,
        interface: Interface { temp_bytes, ..Interface::default() },
        code: ops.into_iter().map(|op| Stmt { op, network: 1, line: 1 }).collect(),
        source: 0,
    };
    program.blocks.push(block(BlockKind::Ob, 1, 20, ops));
    let local = |at| Operand { width: Width::DWord, place: Place::Fixed(Area::Local, BitAddr::byte_addr(at)) };
    let clears = (0..CLEAR_BYTES).step_by(4).map(|at| Op::Transfer(local(at)));
    program.blocks.push(block(
        BlockKind::Fc,
        CLEAR,
        CLEAR_BYTES,
        std::iter::once(Op::LoadConst(0)).chain(clears).collect(),
    ));
    // What an area or number error calls: both sides go on.
    for number in [121, 122, 80] {
        program.blocks.push(block(BlockKind::Ob, number, 20, Vec::new()));
    }
    let kind = if instance { DataKind::Instance(id) } else { DataKind::Global };
    let mut image = vec![0; bytes as usize];
    if instance {
        let params = interface.params.iter().filter(|p| p.section != Section::Temp);
        params.zip(&slots).for_each(|(p, slot)| prepare(p, slot, &mut image));
    } else {
        slots.iter().for_each(|slot| lengths(&slot.ty, slot.at, &mut image));
    }
    let mut region = vec![0; REGION_BYTES as usize];
    for slot in slots.iter().filter_map(|s| Some((s.region?, &s.ty))) {
        lengths(slot.1, slot.0, &mut region);
    }
    let data = |number, kind, bytes| DataBlock {
        number,
        name: None,
        kind,
        bytes,
        components: Vec::new(),
        read_only: false,
        non_retain: false,
    };
    program.data.retain(|d| d.number != REGION);
    program.data.push(data(DATA, kind, image));
    program.data.push(data(REGION, DataKind::Global, region));
    if program.sources.is_empty() {
        program.sources.push("machine code".to_owned());
    }
    program
}

/// The start value of a parameter or variable of an instance.
fn prepare(param: &Param, slot: &Slot, image: &mut [u8]) {
    let start = slot.at.byte() as usize;
    match (&param.initial, &slot.ty) {
        _ if slot.region.is_some() || is_pointer(&slot.ty) => {
            let bytes = pointer(
                if slot.region.is_some() { &DataType::Pointer } else { &slot.ty },
                slot.region.unwrap_or(BitAddr(0)),
            );
            image[start..start + bytes.len()].copy_from_slice(&bytes);
        }
        (Some(bytes), DataType::Bool) => {
            if bytes.first().is_some_and(|b| b & 1 == 1) {
                image[start] |= 1 << slot.at.bit();
            }
        }
        (Some(bytes), _) => image[start..start + bytes.len()].copy_from_slice(bytes),
        (None, ty) => lengths(ty, slot.at, image),
    }
}

/// The maximum length of each STRING.
fn lengths(ty: &DataType, at: BitAddr, image: &mut [u8]) {
    let mut all = Vec::new();
    Layout::components("", ty, at, &mut all);
    for c in all {
        if let DataType::String(max) = c.ty {
            image[c.at.byte() as usize] = max;
        }
    }
}

/// A CPU with its clock.
pub struct Side {
    cpu: Cpu,
    clock: Virtual,
}

impl Side {
    pub fn new(
        program: &Program,
        natives: Vec<Box<dyn NativeBlock>>,
        engine: &dyn engine::Factory,
    ) -> Result<Self, String> {
        let config = CpuConfig { memory_bytes: 1024, ..CpuConfig::default() };
        let cpu = Cpu::new(config, program, natives, Vec::new(), engine);
        let mut cpu = cpu.map_err(|e| format!("{e:?}"))?;
        cpu.request(Command::Run);
        Ok(Self { cpu, clock: Virtual(Instant::START, 0) })
    }

    pub fn cycle(&mut self, step: Span) -> OperatingState {
        self.clock.0 += step;
        self.clock.1 = 0;
        self.cpu.cycle(&mut self.clock).state
    }

    fn write(&mut self, db: u16, at: BitAddr, width: Width, value: u32) {
        let _ = self.cpu.write(Cell::Db(db, at.0), width, value);
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

/// Draws a value for each place of a parameter, into both sides. `short`: whole numbers are small.
pub fn supply(sides: &mut [Side; 2], slot: &Slot, rng: &mut fastrand::Rng, call: u32, short: bool) {
    if is_pointer(&slot.ty) {
        return;
    }
    let (db, at) = slot.region.map_or((DATA, slot.at), |at| (REGION, at));
    let mut all = Vec::new();
    Layout::components("", &slot.ty, at, &mut all);
    let mut write = |at: u32, width, value| sides.iter_mut().for_each(|side| side.write(db, BitAddr(at), width, value));
    for c in all {
        let bytes = match &c.ty {
            DataType::String(max) => {
                let text = text(rng, *max);
                [&[*max, text.len() as u8][..], &text].concat()
            }
            DataType::DateAndTime => date(rng),
            ty => {
                let value = draw(rng, ty, call);
                let value = if short && matches!(ty, DataType::Int | DataType::Word) { value % 1500 } else { value };
                write(c.at.0, Width::of(ty).unwrap_or(Width::Byte), value);
                continue;
            }
        };
        for (at, byte) in (0u32..).zip(bytes) {
            write(c.at.0 + at * 8, Width::Byte, u32::from(byte));
        }
    }
}

/// A DATE_AND_TIME.
fn date(rng: &mut fastrand::Rng) -> Vec<u8> {
    let bcd = |v: u8| ((v / 10) << 4) | (v % 10);
    let [year, month, day] = [rng.u8(..100), rng.u8(1..13), rng.u8(1..29)].map(bcd);
    let [hour, minute, second] = [rng.u8(..24), rng.u8(..60), rng.u8(..60)].map(bcd);
    vec![year, month, day, hour, minute, second, bcd(rng.u8(..100)), rng.u8(..10) << 4 | rng.u8(1..8)]
}

/// Draws what pointers lead to: the beginning each time, and some of the rest.
fn fill(sides: &mut [Side; 2], rng: &mut fastrand::Rng, call: u32) {
    let ty = [DataType::Real, DataType::Byte, DataType::DWord][rng.usize(..3)].clone();
    let width = Width::of(&ty).unwrap_or(Width::Byte);
    let from = rng.u32(..REGION_BYTES / 4 - 16) * 4;
    let step = width.bytes() as usize;
    for at in (0..64).chain(from..from + 64).step_by(step) {
        let value = draw(rng, &ty, call);
        sides.iter_mut().for_each(|side| side.write(REGION, BitAddr::byte_addr(at), width, value));
    }
}

/// Both programs, prepared for the calls of one block.
pub struct Pair<'p> {
    pub id: BlockId,
    interface: Interface,
    pub programs: [Program; 2],
    replaced: &'p BTreeSet<BlockId>,
}

impl<'p> Pair<'p> {
    /// # Errors
    /// Why the block cannot be judged.
    pub fn new(
        reference: &Program,
        ours: &Program,
        id: BlockId,
        replaced: &'p BTreeSet<BlockId>,
    ) -> Result<Self, String> {
        let find = |p: &Program| p.blocks.iter().find(|b| b.id == id).map(|b| b.interface.clone());
        let theirs = find(reference).ok_or(NO_MACHINE_CODE)?;
        let interface = find(ours).ok_or("it is not compiled")?;
        if let Some(why) = undrawable(&interface) {
            return Err(why);
        }
        let kinds = |i: &Interface| i.formals().map(|p| p.ty.name()).collect::<Vec<_>>();
        if kinds(&theirs) != kinds(&interface) || theirs.instance_bytes != interface.instance_bytes {
            return Err("the interfaces differ".to_owned());
        }
        let programs = [reference, ours].map(|p| with_call(p, id, &interface));
        Ok(Self { id, interface, programs, replaced })
    }

    /// The statements of both.
    pub fn listing(&self) -> String {
        let one = |name: &str, program: &Program| {
            let mut one = program.clone();
            one.blocks.retain(|b| b.id == self.id);
            one.data.clear();
            one.symbols.clear();
            format!("--- {name}\n{}", ob1_stl::listing(&one))
        };
        let [theirs, ours] = &self.programs;
        one("theirs", theirs) + &one("ours", ours)
    }

    /// What runs the library of both sides.
    pub fn natives(&self) -> Vec<Box<dyn NativeBlock>> {
        let mut natives: Vec<Box<dyn NativeBlock>> = system_blocks();
        for block in ob1_std::standard_blocks() {
            if self.replaced.contains(&block.id) && block.origin == ob1_std::Origin::Iec {
                natives.push(standard_block(block.id, block));
            }
        }
        natives
    }

    pub fn slots(&self) -> Vec<Slot> {
        slots(&self.interface, self.id).0
    }

    fn sides(&self) -> Result<[Side; 2], String> {
        let side = |program| {
            Side::new(program, self.natives(), engine::REFERENCE).map_err(|why| format!("it does not load: {why}"))
        };
        Ok([side(&self.programs[0])?, side(&self.programs[1])?])
    }

    /// Judges the block over so many calls.
    pub fn judge(&self, calls: u32) -> Verdict {
        let mut sides = match self.sides() {
            Ok(sides) => sides,
            Err(why) => return Verdict::Left(why),
        };
        let slots = self.slots();
        let instance = self.id.kind.has_instance();
        let pointers = slots.iter().any(|s| is_pointer(&s.ty));
        let mut rng = fastrand::Rng::with_seed(u64::from(self.id.number) << 8 | self.id.kind as u64);
        let mut endless = 0;
        for call in 0..calls {
            // Outputs of a function have what the caller left there: the same on both sides.
            for slot in slots.iter().filter(|s| matches!(s.section, Section::Input | Section::InOut)) {
                if !instance || call < 20 || rng.u8(..) < 90 {
                    supply(&mut sides, slot, &mut rng, call, pointers);
                }
            }
            if pointers {
                fill(&mut sides, &mut rng, call);
            }
            let step = match rng.u8(..4) {
                0 => Span::from_millis(1),
                1 => Span::from_millis(rng.u64(1..50)),
                2 => Span::from_millis(rng.u64(1..2000)),
                _ => Span::from_millis(10),
            };
            let states = sides.each_mut().map(|side| side.cycle(step));
            let stopped = states.map(|state| state != OperatingState::Run);
            // The statements of both differ, so that one may come to the end of a call that is endless for the other.
            let late = sides.each_ref().map(|side| side.clock.1 > ENDLESS / 4);
            if stopped == [true, true] || stopped.contains(&true) && late == [true, true] {
                endless += 1;
                if endless >= MOST_ENDLESS {
                    return Verdict::Equal(call);
                }
                sides = match self.sides() {
                    Ok(sides) => sides,
                    Err(why) => return Verdict::Left(why),
                };
                continue;
            }
            if stopped != [false, false] {
                let [theirs, ours] = sides.each_ref().map(Side::why);
                return Verdict::Differs(
                    call,
                    format!("theirs {:?} ({theirs}), ours {:?} ({ours})", states[0], states[1]),
                );
            }
            if let Some(what) = difference(&sides, &self.programs[0], &self.interface, self.id) {
                return Verdict::Differs(call, what);
            }
        }
        Verdict::Equal(calls)
    }
}

/// What differs after a call: what lies behind the actual length of a text means nothing, and a NaN is a NaN.
fn difference(sides: &[Side; 2], reference: &Program, interface: &Interface, id: BlockId) -> Option<String> {
    let [one, two] = sides;
    let data = |number| one.cpu.data_block(number).zip(two.cpu.data_block(number));
    let mut list = Vec::new();
    let (instance, region) = (data(DATA)?, data(REGION)?);
    let params = interface.params.iter().filter(|p| p.section != Section::Temp);
    for (param, slot) in params.zip(slots(interface, id).0) {
        match slot.region {
            Some(at) => compare(&param.name, &param.ty, at, region, &mut list),
            None => compare(&param.name, &param.ty, slot.at, instance, &mut list),
        }
    }
    if let Some(first) = list.first() {
        return Some(first.clone() + if list.len() > 1 { " and more" } else { "" });
    }
    if one.cpu.bit_memory() != two.cpu.bit_memory() {
        return Some(format!("BR or memory: {:02x?} {:02x?}", &one.cpu.bit_memory()[..4], &two.cpu.bit_memory()[..4]));
    }
    let pointed = slots(interface, id).0.iter().any(|s| s.region.is_some());
    let others = reference.data.iter().map(|d| d.number).filter(|n| *n != DATA && !(pointed && *n == REGION));
    others.filter(|n| data(*n).is_some_and(|(a, b)| a != b)).map(|n| format!("DB {n}")).next()
}

/// The components of one variable that differ.
fn compare(name: &str, ty: &DataType, at: BitAddr, (a, b): (&[u8], &[u8]), list: &mut Vec<String>) {
    let mut all = Vec::new();
    Layout::components(name, ty, at, &mut all);
    for c in all {
        let from = c.at.byte() as usize;
        if c.ty == DataType::Bool {
            let bit = |x: &[u8]| x.get(from).map(|byte| byte >> c.at.bit() & 1);
            if bit(a) != bit(b) {
                list.push(format!("{} {:?} {:?}", c.path, bit(a), bit(b)));
            }
            continue;
        }
        let bytes = match c.ty {
            DataType::String(_) => 2 + usize::from(a.get(from + 1).copied().unwrap_or(0)),
            _ => Layout::bits(&c.ty).div_ceil(8) as usize,
        };
        let (x, y) = (a.get(from..from + bytes).unwrap_or_default(), b.get(from..from + bytes).unwrap_or_default());
        let real = |x: &[u8]| x.try_into().map(f32::from_be_bytes).unwrap_or(0.0);
        match c.ty {
            _ if x == y => {}
            DataType::Real if real(x).is_nan() && real(y).is_nan() => {}
            DataType::Real => list.push(format!("{} {} {}", c.path, real(x), real(y))),
            DataType::String(_) => {
                list.push(format!("{} {:?} {:?}", c.path, String::from_utf8_lossy(x), String::from_utf8_lossy(y)));
            }
            _ => list.push(format!("{} {x:02x?} {y:02x?}", c.path)),
        }
    }
}
