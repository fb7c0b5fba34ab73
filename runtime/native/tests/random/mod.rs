//! Random programs of every kind of statement, and two CPUs that must not differ in anything a user can see.

#![allow(dead_code, reason = "each test uses its own part")]

mod edges;
mod maker;

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use ob1_cpu::engine::{Engine, Factory, Plan, REFERENCE};
use ob1_cpu::{
    Cell, Clock, Command, Cpu, CpuConfig, CyclicInterrupt, DebugJob, DiagEntry, Family, Job, Link, Mark, ObFigures,
    OperatingState, PassJob, Window, system_blocks,
};
use ob1_ir::{AddressRegister, CodeBlock, DataBlock, DataKind, Op, Operand, Place, Program, Stmt, Width};
use ob1_model::{
    Area, BREAKPOINTS, BitAddr, BlockId, BlockKind, Breakpoint, DataType, DebugEnd, DebugOrder, Event, HeldBlock,
    Interface, Layout, PASS_JOBS, PASS_WAIT, Param, PassEnd, PassOrder, Resume, Section,
};
use ob1_native::{AtLoad, Compiler, Native, Target, Tier};
use ob1_time::{Instant, Span};

use maker::Maker;

const MS: Span = Span::MILLISECOND;
/// What a statement takes.
const STATEMENT: Span = Span::from_nanos(100);

/// Time that statements take.
struct Charged(Instant, Rc<RefCell<Device>>);

/// A programming device at a CPU: at each hold it goes on, by steps drawn at random. No time passes meanwhile, so that
/// the CPU must show what one without breakpoints shows.
#[derive(Default)]
struct Device {
    link: Option<Link>,
    random: Option<Random>,
    holds: u64,
    /// Holds that are left, before the breakpoints go.
    left: u32,
}

impl Device {
    fn serve(&mut self) {
        let (Some(link), Some(random)) = (&mut self.link, &mut self.random) else { return };
        while let Some(returned) = link.take() {
            let Job::Debug(job) = returned else { continue };
            if job.into_answer().end != DebugEnd::Held {
                continue;
            }
            (self.holds, self.left) = (self.holds + 1, self.left.saturating_sub(1));
            let mut resume = random.of(&[Resume::Run, Resume::Into, Resume::Into, Resume::Over, Resume::Out]);
            if self.left == 0 {
                link.hand(DebugJob::new(2, DebugOrder::Breakpoints(Vec::new()))).expect("room");
                resume = Resume::Run;
            }
            let order = DebugOrder::Hold { resume: Some(resume), wait: PASS_WAIT };
            link.hand(DebugJob::new(3, order)).expect("room");
        }
    }
}

impl Clock for Charged {
    fn now(&mut self) -> Instant {
        self.0
    }
    fn executed(&mut self, statements: u64) {
        self.0 += statements * STATEMENT;
    }
    fn statements_in(&self, time: Span) -> Option<u64> {
        Some(time.div_ceil(STATEMENT))
    }
    fn wait(&mut self, deadline: Instant) {
        self.0 = self.0.max(deadline);
    }
    fn rest(&mut self, _deadline: Instant) {
        self.1.borrow_mut().serve();
    }
}

/// Random numbers of a seed.
pub(crate) struct Random(fastrand::Rng);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(fastrand::Rng::with_seed(seed))
    }

    fn bits(&mut self) -> u64 {
        self.0.u64(..)
    }

    fn next(&mut self, below: u32) -> u32 {
        self.0.u32(..below)
    }

    fn one_in(&mut self, n: u32) -> bool {
        self.next(n) == 0
    }

    fn of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.next(choices.len() as u32) as usize]
    }
}

/// Formals of the blocks that are called: name, section, type.
const FC: &[(&str, Section, DataType)] = &[
    ("b", Section::Input, DataType::Bool),
    ("i", Section::Input, DataType::Int),
    ("d", Section::Input, DataType::DInt),
    ("p", Section::Output, DataType::Bool),
    ("q", Section::Output, DataType::Int),
    ("x", Section::InOut, DataType::Word),
    ("t", Section::Input, DataType::Timer),
];
const FB: &[(&str, Section, DataType)] = &[
    ("b", Section::Input, DataType::Bool),
    ("i", Section::Input, DataType::Int),
    ("q", Section::Output, DataType::Int),
    ("x", Section::InOut, DataType::DWord),
    ("s", Section::Static, DataType::DInt),
    ("e", Section::Static, DataType::Bool),
];
/// FC 1, 2 and FB 1, 2 have parameters; FC 3 has none. Blocks call those before them only, so that calls end.
const BLOCKS: &[(BlockKind, u16)] =
    &[(BlockKind::Fc, 3), (BlockKind::Fc, 1), (BlockKind::Fb, 1), (BlockKind::Fc, 2), (BlockKind::Fb, 2)];
/// Where FB 2 has an instance of FB 1 within its own.
const SUB_INSTANCE: u32 = 16;
const TEMP: u32 = 44;

fn interface(kind: BlockKind, params: &[(&str, Section, DataType)]) -> Interface {
    let mut layout = Layout::new();
    let mut list: Vec<Param> = Vec::new();
    for (name, section, ty) in params {
        if list.last().is_some_and(|p| p.section != *section) {
            layout.end_section();
        }
        let mut param = Param::new(name, *section, ty.clone());
        if kind == BlockKind::Fb {
            param.at = layout.place(ty);
        }
        list.push(param);
    }
    let bytes = if kind == BlockKind::Fb { layout.bytes() } else { 0 };
    Interface { params: list, instance_bytes: bytes, temp_bytes: TEMP }
}

fn block(id: BlockId, interface: Interface, ops: Vec<Op>) -> CodeBlock {
    let code = (1..).zip(ops).map(|(line, op)| Stmt { op, network: 1, line }).collect();
    CodeBlock { id, name: None, interface, code, source: 0 }
}

/// A program and the settings it runs with.
pub(crate) fn program(r: &mut Random) -> (Program, CpuConfig) {
    let mut blocks = Vec::new();
    for (i, (kind, number)) in BLOCKS.iter().enumerate() {
        let params: &[_] = match (kind, number) {
            (BlockKind::Fb, _) => FB,
            (_, 3) => &[],
            _ => FC,
        };
        let mut interface = interface(*kind, params);
        if (*kind, *number) == (BlockKind::Fb, 2) {
            interface.instance_bytes = 40;
        }
        let small = r.one_in(2);
        let count = if small { 2 + r.next(8) } else { 8 + r.next(40) };
        let mut maker = Maker { kind: *kind, params, interface: interface.clone(), callable: &BLOCKS[..i], r };
        let code = maker.code(count);
        blocks.push(block(BlockId::new(*kind, *number), interface, code));
    }
    for number in [1, 35, 80, 121, 122] {
        if number == 80 && r.one_in(2) || number == 122 && r.one_in(3) || number == 121 && r.one_in(10) {
            continue;
        }
        let plain = Interface { temp_bytes: TEMP, ..Interface::default() };
        let callable = if number == 121 { &BLOCKS[..1] } else { BLOCKS };
        let count = if number == 1 { 30 + r.next(90) } else { 4 + r.next(12) };
        let mut maker = Maker { kind: BlockKind::Ob, params: &[], interface: plain.clone(), callable, r };
        let code = match number {
            // An error in the block for errors is STOP: most have none.
            121 | 122 if !maker.r.one_in(6) => {
                let mb = |byte, width| Operand { width, place: Place::Fixed(Area::Memory, BitAddr::byte_addr(byte)) };
                let local = Operand { width: Width::DWord, place: Place::Fixed(Area::Local, BitAddr::byte_addr(8)) };
                vec![
                    Op::Transfer(mb(112, Width::DWord)),
                    Op::ExchangeAccus,
                    Op::Transfer(mb(116, Width::DWord)),
                    Op::TransferArTo(AddressRegister::Ar1, mb(120, Width::DWord)),
                    Op::Load(local),
                    Op::Transfer(mb(124, Width::DWord)),
                    Op::Load(mb(110, Width::Byte)),
                    Op::Increment(1),
                    Op::Transfer(mb(110, Width::Byte)),
                ]
            }
            _ => maker.code(count),
        };
        blocks.push(block(BlockId::new(BlockKind::Ob, number), plain, code));
    }
    let db = |number, bytes: Vec<u8>, kind, read_only| DataBlock {
        number,
        name: None,
        kind,
        bytes,
        components: Vec::new(),
        read_only,
        non_retain: false,
    };
    let mut bytes = |n: usize| (0..n).map(|_| r.next(256) as u8).collect::<Vec<u8>>();
    let fb = |n| DataKind::Instance(BlockId::new(BlockKind::Fb, n));
    let data = vec![
        db(7, bytes(64), DataKind::Global, false),
        db(8, bytes(32), DataKind::Global, true),
        db(9, bytes(6), DataKind::Global, false),
        db(21, bytes(16), fb(1), false),
        db(22, bytes(40), fb(2), false),
        db(23, bytes(40), fb(2), true),
    ];
    let family = r.of(&[Family::S7_300, Family::S7_300, Family::S7_400]);
    let config = CpuConfig {
        accumulators: r.of(&[2, 2, 4]),
        family,
        watchdog: 2 * MS,
        nesting_depth: r.of(&[2, 3, 8, 24]),
        local_bytes: r.of(&[1024, 1024, 32 * 1024]),
        cyclic: vec![CyclicInterrupt::new(35, r.of(&[MS, 3 * MS, 100 * MS]))],
        peripheral_from_image: r.one_in(2),
        ..CpuConfig::default()
    };
    (Program { blocks, data, sources: vec!["random".into()], ..Program::default() }, config)
}

/// What a user can see of a CPU.
fn seen(cpu: &mut Cpu, program: &Program, now: Instant, beside: Beside) -> Vec<String> {
    let mut list = vec![
        format!("{:?} at {now}", cpu.state()),
        format!("{} statements", cpu.statistics().statements),
        format!("{:02X?}", cpu.bit_memory()),
    ];
    list.extend(program.data.iter().map(|db| format!("DB {}: {:02X?}", db.number, cpu.data_block(db.number))));
    for n in 0..4 {
        list.push(format!("T {n}: {:?}", cpu.read(Cell::Timer(n), Width::Word)));
        list.push(format!("Z {n}: {:?}", cpu.read(Cell::Counter(n), Width::Word)));
    }
    for area in [Area::Input, Area::Output] {
        let words = (0..16).map(|i| cpu.read(Cell::Area(area, i * 32), Width::DWord)).collect::<Vec<_>>();
        list.push(format!("{area:?}: {words:X?}"));
    }
    if beside == Beside::Breakpoints {
        // Its holds stand between them, and have pushed others out.
        let others = cpu.diagnostics().filter(|entry| !matches!(entry.event, Event::HOLD | Event::HOLD_LEFT)).take(5);
        list.extend(others.map(|entry| format!("{:?}", DiagEntry { number: 0, ..*entry })));
    } else {
        list.extend(cpu.diagnostics().map(|entry| format!("{entry:?}")));
    }
    list.extend(cpu.accounts().figures().obs.iter().map(|figures| {
        let ObFigures { ob, priority, runs, overruns, execution, lateness } = figures;
        let (execution, lateness) = (execution.distribution(), lateness.distribution());
        format!("OB {ob}: {priority} {runs} {overruns} {execution:?} {lateness:?}")
    }));
    list
}

/// Optimised code of every other block, quickly made code of the rest: as the hottest blocks come first.
pub(crate) struct Mixed;

impl Factory for Mixed {
    fn engine(&self, plan: &Arc<Plan>) -> Result<Box<dyn Engine>, String> {
        let compiler = |tier| Compiler::new(Target::Host, tier).map_err(|error| error.to_string());
        let mut image = compiler(Tier::Fast)?.image(plan);
        let blocks = (0..plan.blocks.len() as u32).step_by(2);
        compiler(Tier::Optimised)?.compile(plan, blocks, &mut image);
        Ok(Box::new(Native::new(plan, &image)?))
    }

    fn stack_per_block(&self) -> usize {
        AtLoad(Tier::Fast).stack_per_block()
    }
}

/// Runs the program of a seed on the reference engine and on others, which take over from one another between two
/// scans: `Ok(false)` when it does not load.
///
/// # Errors
/// The first difference, with the program.
pub(crate) fn compare(seed: u64, scans: u32, others: &[&dyn Factory]) -> Result<bool, String> {
    compared(seed, scans, others, Beside::Nothing, &mut |_, _, _| {})
}

/// Nothing looks through it.
struct NoWindow;

impl Window for NoWindow {
    fn put(&mut self, _: Mark, _: &mut dyn FnMut(&[AtomicU64])) {}
}

/// The same with jobs on the other CPU that watch one block or another: watching changes nothing. The answer is how
/// many passes were seen.
///
/// # Errors
/// As of [`compare`].
pub(crate) fn compare_watched(seed: u64) -> Result<(bool, u64), String> {
    // What is watched runs on the reference engine; making machine code of the rest takes most of the time.
    let others: &[&dyn Factory] = match seed % 32 {
        0..30 => &[REFERENCE],
        30 => &[&AtLoad(Tier::Fast)],
        _ => &[&AtLoad(Tier::Optimised), &Mixed, REFERENCE],
    };
    let (mut link, mut passes, mut random) = (None, 0, Random::new(!seed));
    let ran = compared(seed, 10, others, Beside::Passes, &mut |cpu, scan, _| {
        let link = match &mut link {
            Some(link) => link,
            none => none.insert(cpu.link(Box::new(NoWindow)).expect("the first")),
        };
        while let Some(Job::Pass(job)) = link.take() {
            passes += u64::from(job.pass().end == PassEnd::Whole);
        }
        let block = |random: &mut Random| {
            let (kind, number) =
                random.of(&[BLOCKS, &[(BlockKind::Ob, 1), (BlockKind::Ob, 1), (BlockKind::Ob, 35)]].concat());
            BlockId::new(kind, number)
        };
        for id in 0..PASS_JOBS as u64 {
            // The second one has conditions that are met now and then.
            let from = (id == 1 && random.one_in(2)).then(|| block(&mut random));
            let db = if id == 1 { random.of(&[0, 21, 22]) } else { 0 };
            let (block, first) = (block(&mut random), random.next(4));
            let order = PassOrder { block, from, db, first, count: 512, wait: 350_000_000, before: true };
            link.hand(PassJob::new(u64::from(scan) * 10 + id, order)).expect("room");
        }
    })?;
    Ok((ran, passes))
}

/// The same with breakpoints and steps on the other CPU: but for the time it takes, HOLD changes nothing. The answer is
/// how often it held.
///
/// # Errors
/// As of [`compare`].
pub(crate) fn compare_held(seed: u64) -> Result<(bool, u64), String> {
    let others: &[&dyn Factory] = match seed % 8 {
        0..=3 => &[REFERENCE],
        4..=6 => &[&AtLoad(Tier::Fast)],
        _ => &[&AtLoad(Tier::Optimised), &Mixed, REFERENCE],
    };
    let (mut random, mut holds) = (Random::new(!seed), 0);
    let ran = compared(seed, 6, others, Beside::Breakpoints, &mut |cpu, _, device| {
        let mut device = device.borrow_mut();
        device.serve();
        let Device { link, random: own, left, .. } = &mut *device;
        own.get_or_insert_with(|| Random::new(seed.rotate_left(32)));
        let link = link.get_or_insert_with(|| cpu.link(Box::new(NoWindow)).expect("the first"));
        *left = 30;
        let count = 1 + random.next(BREAKPOINTS as u32);
        let list = (0..count).map(|_| {
            let blocks = [BLOCKS, &[(BlockKind::Ob, 1), (BlockKind::Ob, 1), (BlockKind::Ob, 35)]].concat();
            let (kind, number) = random.of(&blocks);
            Breakpoint { block: BlockId::new(kind, number), statement: random.next(6) }
        });
        link.hand(DebugJob::new(1, DebugOrder::Breakpoints(list.collect()))).expect("room");
        link.hand(DebugJob::new(1, DebugOrder::Hold { resume: None, wait: PASS_WAIT })).expect("room");
        holds = device.holds;
    })?;
    Ok((ran, holds))
}

/// Prepares the other CPU for a scan.
type BeforeScan<'a> = dyn FnMut(&mut Cpu, u32, &Rc<RefCell<Device>>) + 'a;

/// What happens on the other CPU besides.
#[derive(Clone, Copy, PartialEq)]
enum Beside {
    Nothing,
    Passes,
    Breakpoints,
}

fn compared(
    seed: u64,
    scans: u32,
    others: &[&dyn Factory],
    beside: Beside,
    before_scan: &mut BeforeScan<'_>,
) -> Result<bool, String> {
    let mut random = Random::new(seed);
    let (program, config) = program(&mut random);
    let load = |factory| Cpu::new(config.clone(), &program, system_blocks(), Vec::new(), factory);
    let Ok(mut one) = load(REFERENCE) else { return Ok(false) };
    let mut two = load(others[0]).map_err(|why| format!("seed {seed}: does not load: {why:?}"))?;
    // With jobs: time enough for the next one.
    let pause = if beside == Beside::Passes { 103 * MS } else { 7 * MS };
    let mut clocks = [(); 2].map(|()| Charged(Instant::START, Rc::default()));
    one.request(Command::Run);
    two.request(Command::Run);
    for scan in 0..scans {
        before_scan(&mut two, scan, &clocks[1].1);
        let (end, other_end) = (one.cycle(&mut clocks[0]), two.cycle(&mut clocks[1]));
        let (left, right) =
            (seen(&mut one, &program, clocks[0].0, beside), seen(&mut two, &program, clocks[1].0, beside));
        if left != right || end.next_deadline != other_end.next_deadline {
            let short = |line: &String| line.chars().take(400).collect::<String>();
            let differ = left.iter().zip(&right).filter(|(a, b)| a != b);
            let mut lines: Vec<_> = differ.map(|(a, b)| (short(a), short(b))).collect();
            // The oldest entries of the diagnostic buffer tell where it began.
            let last = lines.split_off(lines.len().saturating_sub(3));
            lines.truncate(4);
            lines.extend(last);
            let blocks: Vec<_> = program.blocks.iter().map(|b| format!("{}\n{}", b.id, listing(b))).collect();
            return Err(format!(
                "seed {seed}, scan {scan}: reference, then the other:\n{lines:#?}\n{config:?}\n{}",
                blocks.join("\n")
            ));
        }
        if end.state != OperatingState::Run {
            let level = random.next(4) as u8;
            let left = stacks(&mut one, &mut clocks[0], level);
            let right = stacks(&mut two, &mut clocks[1], level);
            if beside == Beside::Nothing && left != right {
                return Err(format!("seed {seed}: stacks: {left:#?}, the other: {right:#?}"));
            }
            break;
        }
        for clock in &mut clocks {
            clock.0 += pause;
        }
        if others.len() > 1 {
            let next = others[(scan as usize + 1) % others.len()].engine(two.plan())?;
            two.exchange_engine(next).map_err(|_| format!("seed {seed}: no engine of this program"))?;
        }
    }
    Ok(true)
}

/// In what the CPU has stopped: blocks, and local data of one.
fn stacks(cpu: &mut Cpu, clock: &mut Charged, level: u8) -> Option<(Vec<HeldBlock>, Vec<u8>)> {
    let mut link = cpu.link(Box::new(NoWindow))?;
    link.hand(DebugJob::new(7, DebugOrder::Stack { level })).expect("room");
    cpu.cycle(clock);
    while let Some(returned) = link.take() {
        if let Job::Debug(job) = returned {
            let held = job.into_answer().held;
            return Some((held.stack, held.local));
        }
    }
    None
}

fn listing(block: &CodeBlock) -> String {
    let line = |(i, stmt): (usize, &Stmt)| format!("{i:4}  {:?}", stmt.op);
    block.code.iter().enumerate().map(line).collect::<Vec<_>>().join("\n")
}
