//! Programming and access errors, with OB 121/122 and without.

use ob1_cpu::OperatingState;
use ob1_ir::{AddressRegister, CallMode, DbRegister, Number, Op, Operand, Place, Pointer, Target, Width};
use ob1_model::{Area, BitAddr, BlockKind, FaultKind, Interface};
use ob1_time::Span;

use crate::common;
use crate::common::*;

fn ar1(area: Option<Area>, byte: u32) -> Place {
    Place::Register(area, AddressRegister::Ar1, BitAddr::byte_addr(byte))
}

/// Statements whose last one is wrong, the error, the number it is about, and how memory was accessed as OB 121 and OB
/// 122 tell it.
fn table() -> Vec<(Vec<Op>, FaultKind, u32, u32)> {
    let pointer = |byte: u32| Pointer { area: Area::Memory, at: BitAddr::byte_addr(byte) };
    let word = |place| Operand { width: Width::Word, place };
    let by_number = |kind, byte| {
        Op::Call(Box::new(ob1_ir::Call {
            mode: CallMode::Unconditional,
            target: Target::Indirect(kind, Number::Memory(pointer(byte))),
            instance: None,
            args: Vec::new(),
        }))
    };
    vec![
        (vec![load(mw(255))], FaultKind::AreaLengthRead, 255, 0x23),
        (vec![transfer(md(300))], FaultKind::AreaLengthWrite, 300, 0x33),
        (vec![load(dbw(0))], FaultKind::AreaLengthRead, 0, 0x24),
        (vec![Op::OpenDb(DbRegister::Db, Number::Fixed(7)), load(dbw(3))], FaultKind::AreaLengthRead, 3, 0x24),
        (vec![Op::OpenDb(DbRegister::Db, Number::Fixed(7)), transfer(dbw(4))], FaultKind::AreaLengthWrite, 4, 0x24),
        (vec![Op::OpenDb(DbRegister::Db, Number::Fixed(8)), transfer(dbw(0))], FaultKind::WriteProtectedDb, 8, 0),
        (
            vec![Op::OpenDb(DbRegister::Di, Number::Fixed(8)), transfer(word(place(Area::Di, 0, 0)))],
            FaultKind::WriteProtectedDi,
            8,
            0,
        ),
        (vec![transfer(in_db(8, Width::Word, 0, 0))], FaultKind::WriteProtectedDb, 8, 0),
        (vec![load(in_db(7, Width::Word, 100, 0))], FaultKind::AreaLengthRead, 100, 0x24),
        (vec![load(in_db(99, Width::Word, 0, 0))], FaultKind::DbNotLoaded, 99, 0),
        (vec![Op::OpenDb(DbRegister::Db, Number::Fixed(99))], FaultKind::DbNotLoaded, 99, 0),
        // Number 0 opens nothing; an access finds that out.
        (
            vec![Op::OpenDb(DbRegister::Db, Number::Memory(pointer(200))), load(dbw(0))],
            FaultKind::AreaLengthRead,
            0,
            0x24,
        ),
        (
            vec![Op::LoadArConst(AddressRegister::Ar1, 0x8900_0000), load(word(ar1(None, 0)))],
            FaultKind::AreaRead,
            0x89,
            0,
        ),
        (vec![Op::LoadArConst(AddressRegister::Ar1, 0), transfer(word(ar1(None, 0)))], FaultKind::AreaWrite, 0, 0),
        (
            vec![Op::LoadArConst(AddressRegister::Ar1, 3), load(word(ar1(Some(Area::Memory), 8)))],
            FaultKind::AlignmentRead,
            8,
            0x23,
        ),
        (
            vec![Op::LoadArConst(AddressRegister::Ar1, 0x8300_0003), transfer(word(ar1(None, 8)))],
            FaultKind::AlignmentWrite,
            8,
            0x23,
        ),
        (vec![Op::LoadTimer(Number::Fixed(256))], FaultKind::TimerNumber, 256, 0),
        (vec![Op::SetRlo, Op::CountUp(Number::Fixed(1000))], FaultKind::CounterNumber, 1000, 0),
        (vec![by_number(BlockKind::Fc, 200)], FaultKind::FcNotLoaded, 0, 0),
        (vec![by_number(BlockKind::Fb, 200)], FaultKind::FbNotLoaded, 0, 0),
        (vec![load(word(place(Area::Peripheral, 256, 0)))], FaultKind::PeripheralRead, 256, 0x20),
        (vec![transfer(word(place(Area::Peripheral, 256, 0)))], FaultKind::PeripheralWrite, 256, 0x20),
    ]
}

fn data() -> Vec<ob1_ir::DataBlock> {
    let mut protected = db(8, &[0; 4]);
    protected.read_only = true;
    vec![db(7, &[0; 4]), protected]
}

#[test]
fn without_its_ob_an_error_is_stop_and_says_where() {
    on_each_engine(|| {
        for (ops, kind, number, _) in table() {
            let line = ops.len() as u32 + 1;
            let name = format!("{ops:?}");
            let mut code = vec![c(0xABCD)];
            code.extend(ops);
            let mut bench = Bench::new(&program(vec![ob1(code)], data()));
            assert_eq!(bench.cycle().state, OperatingState::Stop, "{name}");
            let stop = if kind.ob() == 121 { 0x4562 } else { 0x4563 };
            assert_eq!(bench.events(), [stop, kind.number(), 0x4302, 0x4301], "{name}");
            let entry = *bench.cpu.diagnostics().nth(1).expect("the error");
            let site = entry.site.expect("a place in the program");
            assert_eq!((site.block, site.network, site.line, entry.data), (ob(1), 1, line, number), "{name}");
            assert_eq!(entry.accus[0], 0xABCD, "{name}");
        }
    });
}

#[test]
fn with_its_ob_the_program_goes_on_behind_the_statement() {
    on_each_engine(|| {
        for (ops, kind, number, access) in table() {
            let name = format!("{ops:?}");
            let mut code = ops;
            let line = code.len() as u32;
            code.extend([c(1), transfer(mw(10))]);
            // OB 121/122 keeps its start information.
            let handler = (0..5).flat_map(|i| {
                [
                    load(Operand { width: Width::DWord, place: l(4 * i, 0) }),
                    transfer(Operand { width: Width::DWord, place: m(100 + 4 * i, 0) }),
                ]
            });
            let handler = block(ob(kind.ob()), Interface::default(), handler.collect());
            let mut bench = Bench::new(&program(vec![ob1(code), handler], data()));
            bench.run();
            assert_eq!(bench.mw(10), 1, "{name}");
            assert_eq!(bench.mw(100), u32::from(kind.number()), "{name}: class and error");
            assert_eq!((bench.mb(103), bench.mw(106)), (u32::from(kind.ob()), number), "{name}");
            assert_eq!(
                (bench.mb(102), bench.mb(104), bench.mb(105)),
                (1, 0x88, access),
                "{name}: class, block, access"
            );
            assert_eq!((bench.mw(108), bench.mw(110)), (1, line), "{name}: block number and line");
        }
    });
}

#[test]
fn an_error_in_the_handler_is_stop() {
    on_each_engine(|| {
        let handler = block(ob(121), Interface::default(), vec![load(mw(9000))]);
        let mut bench = Bench::new(&program(vec![ob1(vec![load(mw(9000))]), handler], vec![]));
        assert_eq!(bench.cycle().state, OperatingState::Stop);
        assert_eq!(bench.events()[..3], [0x4562, 0x2522, 0x2522]);
        bench.cpu.request(ob1_cpu::Command::Run);
        assert_eq!(bench.cycle().state, OperatingState::Stop, "and can be tried again");
    });
}

/// An error in OB 121 or OB 122, of either kind, in the block itself or in one it calls.
#[test]
fn an_error_in_the_other_handler_is_stop_on_an_s7_300() {
    on_each_engine(|| {
        let programming = || Op::OpenDb(DbRegister::Db, Number::Fixed(997));
        let access = || load(Operand { width: Width::Word, place: place(Area::Peripheral, 6000, 0) });
        for (first, second, handler, events) in [
            (programming(), access(), 121, [0x4563, 0x2942, 0x253A]),
            (access(), programming(), 122, [0x4562, 0x253A, 0x2942]),
            (programming(), programming(), 121, [0x4562, 0x253A, 0x253A]),
            (access(), access(), 122, [0x4563, 0x2942, 0x2942]),
        ] {
            let other = if handler == 121 { 122 } else { 121 };
            let endless = |number| block(ob(number), Interface::default(), vec![uc(CallMode::Unconditional, fc(1))]);
            let called = block(fc(1), Interface::default(), vec![second.clone()]);
            let third = block(ob(other), Interface::default(), vec![first.clone()]);
            let mut bench =
                Bench::new(&program(vec![ob1(vec![first.clone()]), endless(handler), third, called], vec![]));
            assert_eq!(bench.cycle().state, OperatingState::Stop, "{first:?}, {second:?}");
            assert_eq!(bench.events()[..3], events, "{first:?}, {second:?}");
            let why = bench.cpu.diagnostics().next().expect("an entry");
            assert_eq!(why.text.as_str(), "an error in the OB for errors");
        }
    });
}

/// Each class has its own errors handled, even while a lower class is handling one.
#[test]
fn an_interrupt_in_the_handler_has_a_handler_of_its_own() {
    on_each_engine(|| {
        let wrong = || Op::OpenDb(DbRegister::Db, Number::Fixed(997));
        let count =
            |byte| [load(mb(byte)), Op::AddConst { format: ob1_ir::NumberFormat::Int, value: 1 }, transfer(mb(byte))];
        let mut handler = count(0).to_vec();
        // Long enough for OB 35 to come inside.
        handler.extend([c(500), transfer(mw(10)), load(mw(10)), Op::Loop(4)]);
        let handler = block(ob(121), Interface::default(), handler);
        let cyclic = block(ob(35), Interface::default(), [vec![wrong()], count(1).to_vec()].concat());
        let mut bench = Bench::new(&program(vec![ob1(vec![wrong()]), handler, cyclic], vec![]));
        bench.run();
        bench.clock.now = at(100 * MS - Span::from_micros(10));
        bench.run();
        assert_eq!((bench.mb(0), bench.mb(1)), (3, 1), "{:04X?}", bench.events());
    });
}

#[test]
fn an_s7_400_aborts_the_handler_and_calls_ob_88() {
    on_each_engine(|| {
        let wrong = || Op::OpenDb(DbRegister::Db, Number::Fixed(997));
        let load_info = |i: u32| {
            let long = |place| Operand { width: Width::DWord, place };
            [load(long(l(4 * i, 0))), transfer(long(m(100 + 4 * i, 0)))]
        };
        let main = || ob1(vec![wrong(), c(7), transfer(mb(0))]);
        let handler = || block(ob(121), Interface::default(), vec![Op::Nop, wrong(), c(8), transfer(mb(1))]);
        let run = |blocks, rest: &[u16]| {
            let config = ob1_cpu::CpuConfig::of(ob1_cpu::Family::S7_400);
            let cpu = ob1_cpu::Cpu::new(config, &program(blocks, vec![]), vec![], vec![], common::engine())
                .expect("it loads");
            let mut bench = Bench::with(cpu);
            let state = bench.cycle().state;
            assert_eq!(bench.events()[..rest.len()], *rest);
            (bench, state)
        };
        let aborted = block(ob(88), Interface::default(), (0..3).flat_map(load_info).collect());
        let (mut bench, state) = run(vec![main(), handler(), aborted], &[0x3573, 0x253A, 0x253A]);
        assert_eq!(state, OperatingState::Run);
        assert_eq!((bench.mb(0), bench.mb(1)), (7, 0), "OB 1 goes on, OB 121 does not");
        assert_eq!((bench.md(100), bench.md(104), bench.md(108)), (0x3573_1C58, 0x8800_0179, 121 << 16 | 2));
        bench.run();

        let (_, state) = run(vec![main(), handler()], &[0x4570, 0x3573]);
        assert_eq!(state, OperatingState::Stop);
        // Aborted in the class of OB 88.
        let wrong_too = block(ob(88), Interface::default(), vec![wrong()]);
        let (_, state) = run(vec![main(), handler(), wrong_too], &[0x4570, 0x3573, 0x253A, 0x253A, 0x3573]);
        assert_eq!(state, OperatingState::Stop);
    });
}

/// OB 121 has no part in it, and the caller of the block that was aborted continues.
#[test]
fn an_s7_400_calls_ob_88_when_there_is_no_room_for_one_block_more() {
    on_each_engine(|| {
        let long = |place| Operand { width: Width::DWord, place };
        let keep = (0..3).flat_map(|i| [load(long(l(4 * i, 0))), transfer(long(m(100 + 4 * i, 0)))]);
        let handler = block(ob(88), Interface::default(), keep.collect());
        let other = block(ob(121), Interface::default(), vec![c(8), transfer(mb(1))]);
        let main = ob1(vec![uc(CallMode::Unconditional, fc(1)), c(7), transfer(mb(0))]);
        let deep = block(fc(1), Interface::default(), vec![uc(CallMode::Unconditional, fc(1))]);
        // So many bytes each that OB 88 has room where one more has not.
        let long_local =
            vec![load(Operand { width: Width::Byte, place: l(129, 0) }), uc(CallMode::Unconditional, fc(1))];
        let wide = block(fc(1), Interface::default(), long_local);
        let small = ob1_cpu::CpuConfig { local_bytes: 1024, ..ob1_cpu::CpuConfig::of(ob1_cpu::Family::S7_400) };
        let large = ob1_cpu::CpuConfig::of(ob1_cpu::Family::S7_400);
        for (config, called, event, line) in [(large, deep, 0x3575, 1), (small, wide, 0x3576, 2)] {
            let run = |blocks| {
                let cpu = ob1_cpu::Cpu::new(config.clone(), &program(blocks, vec![]), vec![], vec![], common::engine());
                let mut bench = Bench::with(cpu.expect("it loads"));
                let state = bench.cycle().state;
                (bench, state)
            };
            let (mut bench, state) = run(vec![main.clone(), called.clone(), other.clone(), handler.clone()]);
            assert_eq!((state, bench.events()[0]), (OperatingState::Run, event));
            assert_eq!((bench.mb(0), bench.mb(1)), (7, 0));
            assert_eq!(
                (bench.md(100), bench.md(104), bench.md(108)),
                (u32::from(event) << 16 | 0x1C58, 0x8C00_0101, 1 << 16 | line)
            );
            let (bench, state) = run(vec![main.clone(), called, other.clone()]);
            assert_eq!((state, &bench.events()[..2]), (OperatingState::Stop, &[0x4570, event][..]));
        }
    });
}

#[test]
fn register_indirect_access_reaches_the_last_byte_and_no_further() {
    on_each_engine(|| {
        let word = |place| Operand { width: Width::Word, place };
        let code = vec![
            Op::LoadArConst(AddressRegister::Ar1, 0x8300_0000 + 250 * 8),
            c(0x1234),
            transfer(word(ar1(None, 4))),
            load(word(ar1(None, 5))),
        ];
        let mut bench = Bench::new(&program(vec![ob1(code)], vec![]));
        assert_eq!(bench.cycle().state, OperatingState::Stop);
        assert_eq!(bench.mw(254), 0x1234);
        assert_eq!(bench.cpu.diagnostics().nth(1).map(|e| (e.event.0, e.data)), Some((0x2522, 255)));
    });
}

#[test]
fn the_source_of_an_error_by_its_kind() {
    on_each_engine(|| {
        // Bits, areas of every kind, digits above 9, through functions and function blocks.
        let bit = |area| u(place(area, 9000, 1));
        for (ops, event, access, source) in [
            (vec![bit(Area::Input)], 0x2522, 0x01, 9000),
            (vec![Op::SetRlo, Op::Assign(place(Area::Output, 9000, 1))], 0x2523, 0x02, 9000),
            (vec![load(Operand { width: Width::Byte, place: place(Area::Input, 9000, 0) })], 0x2522, 0x11, 9000),
            (vec![load(Operand { width: Width::DWord, place: place(Area::Di, 9000, 0) })], 0x2522, 0x35, 9000),
            (
                vec![
                    Op::LoadArConst(AddressRegister::Ar1, 0x8600_0000 + 8 * 9000),
                    load(Operand { width: Width::Word, place: ar1(None, 0) }),
                ],
                0x2522,
                0x26,
                9000,
            ),
            (
                vec![
                    Op::LoadArConst(AddressRegister::Ar1, 0x8700_0000 + 8 * 9000),
                    load(Operand { width: Width::Byte, place: ar1(None, 0) }),
                ],
                0x2522,
                0x17,
                9000,
            ),
            (vec![c(0xABC), Op::Convert(ob1_ir::Convert::Bti)], 0x2521, 0, 0),
            (vec![load(Operand { width: Width::Byte, place: place(Area::Peripheral, 7, 0) })], 0x2942, 0x10, 7),
            (vec![transfer(Operand { width: Width::DWord, place: place(Area::Peripheral, 7, 0) })], 0x2943, 0x30, 7),
        ] {
            for (block_type, id) in [(0x8C, fc(7)), (0x8E, fb(7))] {
                let called = block(id, Interface::default(), ops.clone());
                let ob = if event >> 8 == 0x25 { 121 } else { 122 };
                let keep = (0..3).flat_map(|i| {
                    [load(Operand { width: Width::DWord, place: l(4 * i, 0) }), transfer(md(100 + 4 * i))]
                });
                let handler = block(common::ob(ob), Interface::default(), keep.collect());
                let mut bench =
                    Bench::new(&program(vec![ob1(vec![uc(CallMode::Unconditional, id)]), called, handler], data()));
                bench.run();
                let name = format!("{ops:?} in {id}");
                assert_eq!(
                    (bench.md(100), bench.md(104)),
                    (event << 16 | 0x0100 | u32::from(ob), block_type << 24 | access << 16 | source),
                    "{name}"
                );
                assert_eq!(bench.md(108), 7 << 16 | ops.len() as u32, "{name}: block number and line");
            }
        }
    });
}

/// OB 121 and OB 122 find the registers of the interrupted block; it gets them back whatever they do. A load that fails
/// gives 0.
#[test]
fn the_registers_of_the_interrupted_block() {
    on_each_engine(|| {
        let code = vec![
            Op::OpenDb(DbRegister::Db, Number::Fixed(7)),
            Op::LoadArConst(AddressRegister::Ar1, 0x8300_0123),
            c(0x1111_1111),
            c(0x2222_2222),
            load(Operand { width: Width::Word, place: place(Area::Peripheral, 256, 0) }),
            transfer(md(40)),
            Op::ExchangeAccus,
            transfer(md(44)),
            c(0x3333_3333),
            transfer(Operand { width: Width::Word, place: place(Area::Peripheral, 256, 0) }),
            transfer(md(48)),
            Op::TransferAr(AddressRegister::Ar1),
            transfer(md(52)),
            Op::LoadDbNumber(DbRegister::Db),
            transfer(mw(56)),
        ];
        let handler = vec![
            transfer(md(20)),
            Op::ExchangeAccus,
            transfer(md(24)),
            Op::TransferAr(AddressRegister::Ar1),
            transfer(md(28)),
            Op::LoadDbNumber(DbRegister::Db),
            transfer(mw(32)),
            Op::LoadArConst(AddressRegister::Ar1, 0),
            Op::OpenDb(DbRegister::Db, Number::Fixed(8)),
            c(0xFFFF_FFFF),
            c(0xFFFF_FFFF),
        ];
        let handler = block(ob(122), Interface::default(), handler);
        let mut bench = Bench::new(&program(vec![ob1(code), handler], data()));
        bench.run();
        // The second error, of the transfer, is what the handler has seen last.
        assert_eq!((bench.md(20), bench.md(24)), (0x3333_3333, 0x2222_2222));
        assert_eq!((bench.md(28), bench.mw(32)), (0x8300_0123, 7));
        assert_eq!((bench.md(40), bench.md(44)), (0, 0x2222_2222), "a load that fails loads 0");
        assert_eq!(bench.md(48), 0x3333_3333, "a transfer that fails changes nothing");
        assert_eq!((bench.md(52), bench.mw(56)), (0x8300_0123, 7));
    });
}
