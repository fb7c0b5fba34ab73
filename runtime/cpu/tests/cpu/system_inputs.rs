//! Whatever a program passes to a standard block, the scan continues or the CPU is in STOP: nothing panics. Every block
//! of the CPU and of its libraries with random parameters, random instances and a clock that jumps; the wall clock at
//! every date.
#![allow(clippy::disallowed_methods, reason = "a thread with a stack of a given size")]

use ob1_cpu::{Cell, Command, Cpu, CpuConfig, CyclicInterrupt, OperatingState, TimeOfDay};
use ob1_ir::{Arg, Call, CallMode, Number, Op, Place, Target, Width};
use ob1_model::calendar::DAY_MS;
use ob1_model::moment::Moment;
use ob1_model::{BitAddr, DataType, Interface, Layout};
use ob1_std::services::Period;
use ob1_std::{StandardBlock, standard_blocks};
use ob1_time::{Instant, Span};

use crate::common;
use crate::common::random::Random;
use crate::common::source::{bench_with, blocks};
use crate::common::{
    Bench, MS, block, db, instance_db, is_reference, mw, ob, ob1, on_each_engine, operand, program, transfer,
};

/// Calls of each block.
const CALLS: usize = 2000;
/// The data block of the parameters.
const PARAMETERS: u16 = 10;
/// That of the instance.
const INSTANCE: u16 = 11;

/// Every block that is served here.
fn all() -> Vec<StandardBlock> {
    standard_blocks().into_iter().filter(|block| !block.origin.is_declared_only()).collect()
}

/// OB 1 with a call of `block`, all of whose parameters lie in a data block: the program and the bytes of the block.
fn caller(of: &StandardBlock) -> (ob1_ir::Program, usize) {
    let has_instance = of.id.kind.has_instance();
    let mut at = 0;
    let mut args = Vec::new();
    for formal in of.interface.formals() {
        let bits = Layout::bits(&formal.ty);
        let width = match bits {
            1 => Width::Bit,
            9..=16 => Width::Word,
            17..=32 => Width::DWord,
            _ => Width::Byte,
        };
        let operand = Arg::Operand(operand(width, Place::InDb(PARAMETERS, BitAddr::new(at, 0))));
        args.push(match &formal.ty {
            ty if ty.is_parameter_type() => Arg::Number(Number::Fixed(1)),
            // The instance holds the pointer; the test fills it.
            _ if has_instance && (formal.is_pointer() || matches!(formal.ty, DataType::Any | DataType::Pointer)) => {
                Arg::Open
            }
            _ => operand,
        });
        at += bits.div_ceil(8).next_multiple_of(2);
    }
    let instance = has_instance.then_some(Number::Fixed(INSTANCE));
    let call = Call { mode: CallMode::Call, target: Target::Block(of.id), instance, args };
    let mut data = vec![db(PARAMETERS, &vec![0; at as usize]), db(12, &[0; 40])];
    if has_instance {
        data.push(instance_db(INSTANCE, of.id, of.interface.instance_bytes as usize));
    }
    let mut list = vec![ob1(vec![Op::Call(Box::new(call)), transfer(mw(0))])];
    list.extend([10, 20, 35, 80, 121, 122].map(|n| block(ob(n), Interface::default(), vec![transfer(mw(2))])));
    (program(list, data), at as usize)
}

/// Bytes as programs have them: anything; small numbers; the edges; pointers to what there is; dates; strings.
fn fill(random: &mut Random, bytes: &mut [u8]) {
    const PATTERNS: [&[u8]; 12] = [
        &[0x10, 2, 0, 8, 0, 0, 0x83, 0, 0, 0],
        &[0x10, 2, 0, 20, 0, 12, 0x84, 0, 0, 8],
        &[0x10, 4, 0xFF, 0xFF, 0, 12, 0x84, 0, 0, 0],
        &[0x10, 0x13, 0, 10, 0, 12, 0x84, 0, 0, 0],
        &[0x10, 2, 0, 4, 0, 0, 0x83, 7, 0xFF, 0xF8],
        &[0x90, 1, 1, 0, 0, 0, 0, 2],
        &[0x89, 0x12, 0x31, 0x23, 0x59, 0x59, 0x99, 0x97],
        &[0x24, 0x02, 0x29, 0x12, 0x30, 0x15, 0, 0x05],
        &[254, 254],
        &[4, 200],
        &[0x7F, 0xFF, 0xFF, 0xFF],
        &[0x80, 0, 0, 0],
    ];
    let mut at = 0;
    while at < bytes.len() {
        let rest = &mut bytes[at..];
        let len = match random.next(6) {
            0 => {
                rest[0] = random.bits() as u8;
                1
            }
            1 => {
                rest[0] = random.next(130) as u8;
                1
            }
            2 => {
                rest[0] = random.of(&[0, 1, 0x7F, 0x80, 0xFF]);
                1
            }
            3 => {
                let len = rest.len().min(2 + random.next(7) as usize);
                rest[..len].fill(0);
                len
            }
            _ => {
                let pattern = random.of(&PATTERNS);
                let len = pattern.len().min(rest.len());
                rest[..len].copy_from_slice(&pattern[..len]);
                len
            }
        };
        at += len;
    }
}

fn write(bench: &mut Bench, db: u16, bytes: &[u8]) {
    for (at, byte) in (0..).zip(bytes) {
        // A block that the program has deleted or protected is not there to be written.
        let _ = bench.cpu.write(Cell::Db(db, at * 8), Width::Byte, u32::from(*byte));
    }
}

/// The stack of a CPU with one organization block is enough for each of them.
#[test]
fn random_parameters_of_every_block() {
    on_each_engine(|| {
        let one = Cpu::new(CpuConfig::default(), &program(vec![ob1(vec![])], vec![]), vec![], vec![], common::engine())
            .expect("it loads");
        let thread = std::thread::Builder::new().stack_size(one.stack_bytes()).spawn(call_every_block);
        thread.expect("a thread").join().expect("no panic");
    });
}

fn call_every_block() {
    let mut random = Random::new(0x0B1_5EED);
    for of in all() {
        let (program, bytes) = caller(&of);
        let keys: Vec<String> = if of.key().starts_with("SYSTEM:") { vec![] } else { vec![of.key()] };
        let keys: Vec<&str> = keys.iter().map(String::as_str).collect();
        let config = CpuConfig {
            cyclic: vec![CyclicInterrupt::new(35, 20 * MS)],
            time_of_day: vec![TimeOfDay { ob: 10, start: Moment::MIN, period: Period::EveryMinute }],
            ..CpuConfig::default()
        };
        let cpu = Cpu::new(config, &program, blocks(&keys), vec![], common::engine()).expect("the program loads");
        let mut bench = Bench::with(cpu);
        let (mut parameters, mut instance) = (vec![0; bytes], vec![0; of.interface.instance_bytes as usize]);
        let mut ran = 0;
        for call in 0..CALLS {
            fill(&mut random, &mut parameters);
            write(&mut bench, PARAMETERS, &parameters);
            if call % 3 == 0 {
                fill(&mut random, &mut instance);
                write(&mut bench, INSTANCE, &instance);
            }
            bench.clock.now += match random.next(8) {
                0 => Span::ZERO,
                1 => 86_400_000 * MS * u64::from(random.next(400)),
                _ => Span::from_nanos(random.bits() % (100 * MS).nanos()),
            };
            if bench.cycle().state == OperatingState::Run {
                ran += 1;
            } else {
                bench.cpu.request(Command::Run);
            }
        }
        assert!(ran > 0 || of.name == "STP", "{of:?} never came to its end: {:04X?}", bench.events());
    }
}

/// SFC 0 sets, SFC 1 reads, the start information shows: at every date, at the edges of the day, whatever the CPU's own
/// time is. OB 10 waits for its minute all the time, OB 80 for one that is skipped. Every date on the reference engine,
/// every 61st on the others.
#[test]
fn the_clock_at_every_date() {
    on_each_engine(|| {
        let source = "
            DATA_BLOCK DB 10
            STRUCT set : DATE_AND_TIME; now : DATE_AND_TIME; shown : DATE_AND_TIME; END_STRUCT
            BEGIN
            END_DATA_BLOCK
            ORGANIZATION_BLOCK OB 10 BEGIN L MW 20; + 1; T MW 20; END_ORGANIZATION_BLOCK
            ORGANIZATION_BLOCK OB 80 BEGIN L MW 22; + 1; T MW 22; END_ORGANIZATION_BLOCK
            ORGANIZATION_BLOCK OB 1
            VAR_TEMP info : ARRAY[0..11] OF BYTE; at : DATE_AND_TIME; END_VAR
            BEGIN
            L LD 12; T DB10.DBD 16; L LD 16; T DB10.DBD 20;
            CALL SFC 0 (PDT := DB10.set, RET_VAL := MW 10);
            CALL SFC 1 (RET_VAL := MW 12, CDT := DB10.now);
            END_ORGANIZATION_BLOCK";
        let config = CpuConfig {
            time_of_day: vec![TimeOfDay { ob: 10, start: Moment::MIN, period: Period::EveryMinute }],
            date_at_start: 1_000_000_000_000_000_000,
            watchdog: Span::ZERO,
            ..CpuConfig::default()
        };
        let mut bench = bench_with(source, &[], config, vec![]);
        bench.clock.per_statement = Span::ZERO;
        bench.clock.now = Instant::from_nanos(12_345_678_901);
        let mut before = None;
        let last = u64::from(Moment::MAX.days());
        // Upwards, and back and forth between the ends of time.
        let step = if is_reference() { 1 } else { 61 };
        for day in (0..=last).step_by(step).flat_map(|day| [day, if day % 2 == 0 { 0 } else { last }]) {
            for ms in [0, 45_296_789, DAY_MS - 1] {
                let moment = Moment::from_ms(day * DAY_MS + ms).expect("a moment");
                write(&mut bench, 10, &moment.to_bytes());
                bench.run();
                let bytes = |at: usize| {
                    let block = bench.cpu.data_block(10).expect("DB 10");
                    <[u8; 8]>::try_from(&block[at..at + 8]).expect("eight bytes")
                };
                assert_eq!((bytes(8), bench.cpu.bit_memory()[10..14].to_vec()), (moment.to_bytes(), vec![0; 4]));
                if let Some(before) = before.replace(moment.to_bytes()) {
                    assert_eq!(bytes(16), before, "the start information, before {moment:?} was set");
                }
            }
        }
        // From the last moment on it stands still, and nothing else does.
        bench.clock.now += 86_400_000 * MS;
        bench.run();
    });
}
