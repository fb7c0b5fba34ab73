//! The scan allocates nothing.

mod common;

use std::alloc::System;

use common::rack::TestModule;
use common::window::{Client, Looker};
use common::*;
use ob1_cpu::{
    AlarmJob, Ask, Cell, Cpu, CpuConfig, CyclicInterrupt, Job, Module, ModuleSlot, PassJob, Piece, PointJob, Put,
    system_blocks,
};
use ob1_ir::{AccuOp, Arg, CallMode, Number, NumberFormat, Op, Width};
use ob1_model::{
    AlarmAck, AlarmOrder, AlarmQuery, Area, BlockId, BlockKind, DataType, Displays, Interface, PassEnd, PassOrder,
    Point, PointItem, PointOrder, Section, TimerKind,
};
use ob1_time::Span;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

#[test]
fn ten_thousand_cycles_allocate_nothing() {
    let add = block(
        fc(1),
        interface(BlockKind::Fc, &[("x", Section::Input, DataType::Int), ("q", Section::Output, DataType::Int)], 4),
        vec![
            load(param(0, Width::Word)),
            c(1),
            Op::Arithmetic(NumberFormat::Int, AccuOp::Add),
            transfer(param(1, Width::Word)),
            load(mw(9000)),
        ],
    );
    let any = |byte: u8| Arg::Bytes(Box::from([0x10, 2, 0, 4, 0, 0, 0x83, 0, 0, byte]));
    let code = vec![
        // Long enough for OB 35 to pre-empt it.
        c(1500),
        Op::Loop(1),
        u(m(0, 0)),
        c(0x0010),
        Op::StartTimer(TimerKind::OnDelay, Number::Fixed(1)),
        Op::LoadTimer(Number::Fixed(1)),
        call(fc(1), vec![Arg::Operand(in_db(3, Width::Word, 0, 0)), Arg::Operand(in_db(3, Width::Word, 0, 0))]),
        call(BlockId::new(BlockKind::Sfc, 20), vec![any(0), Arg::Operand(mw(40)), any(80)]),
        load(operand(Width::Word, place(Area::Peripheral, 300, 0))),
        uc(CallMode::Unconditional, BlockId::new(BlockKind::Sfc, 43)),
    ];
    let handlers = [35, 40, 80, 121, 122].map(|n| block(ob(n), Interface::default(), vec![Op::Nop]));
    let mut blocks = vec![ob1(code), add];
    blocks.extend(handlers);
    let program = program(blocks, vec![db(3, &[0; 4])]);
    let modules: Vec<(ModuleSlot, Box<dyn Module>)> = vec![
        (ModuleSlot { output_address: 400, ..ModuleSlot::new("di", 0) }, Box::new(TestModule::new(2))),
        (ModuleSlot::new("cp", 256), Box::new(TestModule::new(16))),
    ];
    let config = CpuConfig { cyclic: vec![CyclicInterrupt::new(35, Span::from_micros(100))], ..CpuConfig::default() };
    let cpu = Cpu::new(config, &program, system_blocks(), modules, common::engine()).expect("loads");
    let mut bench = Bench::with(cpu);
    let mut client = Client::of(&mut bench.cpu);
    client.ask(0, [Ask::State, Ask::Clock]);
    let mut link = Looker::of(&mut bench.cpu).expect("the first");
    let pieces = [Piece::Bytes { at: Cell::Db(3, 0), len: 4 }, Piece::Value(Cell::Counter(1), Width::Word)];
    link.watch(&pieces).expect("little");
    let mut recording = bench.cpu.recording_client().expect("the first");
    let mut rows = recording.record(ob1_cpu::Frame::of(pieces), 10).expect("little");
    bench.run();
    // The counter sees the test harness's own thread too, which allocates now and then: a scan that allocated would do
    // so in every round.
    let mut recorded = 0;
    let quiet = (0..5).any(|_| {
        let region = Region::new(ALLOCATOR);
        for id in 0..10_000 {
            bench.cpu.fire_hardware_interrupt(40, 256, id).expect("room");
            bench.cycle();
            let question = client.take().expect("answered");
            client.0.hand(Job::Question(question)).expect("room");
            while link.link.take().is_some() {}
            recorded += u64::from(rows.take(|row| row.lost == 0).unwrap_or(false));
            while rows.take_run().is_some() {}
        }
        let change = region.change();
        (change.allocations, change.reallocations, change.deallocations) == (0, 0, 0)
    });
    assert!(quiet, "each of five rounds of 10,000 cycles allocated");
    assert!(link.mark().is_some_and(|mark| mark.scan > 9_000), "snapshots were taken all the while");
    assert!(recorded > 9_000, "so was a recording: {recorded}");
    assert_ne!(bench.dbw(3, 0), 0, "the program ran");
    assert_eq!(bench.cpu.state(), ob1_cpu::OperatingState::Run);
    let runs = [35, 40].map(|ob| bench.ob_figures(ob).runs);
    assert!(runs.iter().all(|runs| *runs >= 10_000), "{runs:?}");
}

/// A variable table: two values, and one of a data block that is not there.
fn table() -> PointOrder {
    let read = |at, len| PointItem::Read(Piece::Bytes { at, len });
    let memory = Cell::Area(Area::Memory, 0);
    let write = PointItem::Write(Put::Value(memory, ob1_cpu::Width::Word, 7));
    PointOrder { point: Point::Start, stays: false, items: vec![write, read(memory, 40), read(Cell::Db(99, 0), 40)] }
}

/// Nor while jobs of program status are armed: what they need comes with them.
#[test]
fn a_watched_scan_allocates_nothing() {
    let sub = block(fc(1), Interface::default(), vec![c(30), transfer(mw(10)), load(mw(10)), Op::Loop(1)]);
    let small = block(fc(2), Interface::default(), vec![load(mw(10)), transfer(mw(12))]);
    let uc = |block| uc(CallMode::Unconditional, block);
    let program = program(vec![ob1(vec![uc(fc(1)), uc(fc(2))]), sub, small], Vec::new());
    on_each_engine(|| {
        let cpu = Cpu::new(CpuConfig::default(), &program, Vec::new(), Vec::new(), common::engine()).expect("loads");
        // It records everything anew in each scan.
        if cpu.engine() == "both" {
            return;
        }
        let mut bench = Bench::with(cpu);
        let mut link = Looker::of(&mut bench.cpu).expect("the first");
        bench.run();
        let mut round = || {
            let mut seen = 0;
            for block in [fc(1), fc(2), ob(1), fc(9)].repeat(50) {
                let order = PassOrder { block, from: None, db: 0, first: 0, count: 9, wait: 50_000_000, before: true };
                link.link.hand(PassJob::new(1, order)).expect("room");
                link.link.hand(PassJob::new(2, PassOrder { from: Some(ob(1)), ..order })).expect("room");
                link.link.hand(PointJob::new(3, table())).expect("room");
                let region = Region::new(ALLOCATOR);
                for _ in 0..4 {
                    bench.clock.now += 30 * MS;
                    bench.cycle();
                }
                let change = region.change();
                if (change.allocations, change.reallocations, change.deallocations) != (0, 0, 0) {
                    return None;
                }
                while let Some(back) = link.link.take() {
                    if let Job::Point(job) = &back {
                        assert_eq!(job.outcomes().filter(Result::is_ok).count(), 2);
                    }
                    seen += u32::from(matches!(back, Job::Pass(job) if job.pass().end == PassEnd::Whole));
                }
            }
            Some(seen)
        };
        let seen = (0..5).find_map(|_| round()).expect("each of five rounds allocated");
        assert!(seen > 100, "{seen} passes");
    });
}

/// Alarms come and go, are acknowledged, asked for and locked, and nobody fetches them for a while.
#[test]
fn alarms_allocate_nothing() {
    let source = "
        DATA_BLOCK DB 35 SFB 35 BEGIN END_DATA_BLOCK
        ORGANIZATION_BLOCK OB 1 BEGIN
        UN M 0.0; = M 0.0;
        CALL SFC 17 (SIG := M 0.0, ID := W#16#EEEE, EV_ID := DW#16#11, SD := MW 10, RET_VAL := MW 20);
        CALL SFB 35, DB 35 (EN_R := TRUE, SIG_1 := M 0.0, EV_ID := DW#16#23, SD_1 := MW 10, STATUS := MW 22);
        END_ORGANIZATION_BLOCK";
    on_each_engine(|| {
        let mut bench = common::source::bench(source, &[]);
        if bench.cpu.engine() == "both" {
            return;
        }
        let mut link = Looker::of(&mut bench.cpu).expect("the first");
        let mut alarms = bench.cpu.alarm_client().expect("the first");
        alarms.set_displays(Displays(Displays::ALARMS));
        bench.run();
        let mut codes = [0; 2];
        for turn in 0..1600 {
            let order = match turn % 4 {
                0 => AlarmOrder::Query(AlarmQuery::Standing),
                1 => AlarmOrder::Query(AlarmQuery::Number(0x11)),
                2 => AlarmOrder::Acknowledge(vec![AlarmAck { id: 0x11, coming: 1, going: 1 }; 3]),
                _ => AlarmOrder::Lock { ids: vec![0x23], locked: turn % 8 == 3 },
            };
            link.link.hand(AlarmJob::new(turn, order).expect("few")).expect("room");
            let region = Region::new(ALLOCATOR);
            bench.clock.now += 30 * MS;
            bench.cycle();
            let change = region.change();
            assert_eq!((change.allocations, change.reallocations, change.deallocations), (0, 0, 0), "{turn}");
            assert!(matches!(link.link.take(), Some(Job::Alarms(job)) if job.id() == turn));
            codes[0] += u32::from(bench.mw(20) == 0x8083);
            codes[1] += u32::from(bench.mw(22) == 11);
        }
        assert!(codes.iter().all(|count| *count > 0), "the way out was full: {codes:?}");
        assert!(std::iter::from_fn(|| alarms.take()).count() > 1000);
    });
}
