//! Programming and access errors, with OB 121/122 and without.

mod common;

use common::*;
use ob1_cpu::OperatingState;
use ob1_ir::{AddressRegister, CallMode, DbRegister, Number, Op, Operand, Place, Pointer, Target, Width};
use ob1_model::{Area, BitAddr, BlockKind, FaultKind, Interface};

fn ar1(area: Option<Area>, byte: u32) -> Place {
    Place::Register(area, AddressRegister::Ar1, BitAddr::byte_addr(byte))
}

/// Statements whose last one is wrong, the error, and the number it is about.
fn table() -> Vec<(Vec<Op>, FaultKind, u32)> {
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
        (vec![load(mw(255))], FaultKind::AreaLengthRead, 255),
        (vec![transfer(md(300))], FaultKind::AreaLengthWrite, 300),
        (vec![load(dbw(0))], FaultKind::AreaLengthRead, 0),
        (vec![Op::OpenDb(DbRegister::Db, Number::Fixed(7)), load(dbw(3))], FaultKind::AreaLengthRead, 3),
        (vec![Op::OpenDb(DbRegister::Db, Number::Fixed(7)), transfer(dbw(4))], FaultKind::AreaLengthWrite, 4),
        (vec![Op::OpenDb(DbRegister::Db, Number::Fixed(8)), transfer(dbw(0))], FaultKind::WriteProtectedDb, 8),
        (
            vec![Op::OpenDb(DbRegister::Di, Number::Fixed(8)), transfer(word(place(Area::Di, 0, 0)))],
            FaultKind::WriteProtectedDi,
            8,
        ),
        (vec![transfer(in_db(8, Width::Word, 0, 0))], FaultKind::WriteProtectedDb, 8),
        (vec![load(in_db(7, Width::Word, 100, 0))], FaultKind::AreaLengthRead, 100),
        (vec![load(in_db(99, Width::Word, 0, 0))], FaultKind::DbNotLoaded, 99),
        (vec![Op::OpenDb(DbRegister::Db, Number::Fixed(99))], FaultKind::DbNotLoaded, 99),
        // Number 0 opens nothing; an access finds that out.
        (vec![Op::OpenDb(DbRegister::Db, Number::Memory(pointer(200))), load(dbw(0))], FaultKind::AreaLengthRead, 0),
        (vec![Op::LoadArConst(AddressRegister::Ar1, 0x8900_0000), load(word(ar1(None, 0)))], FaultKind::AreaRead, 0x89),
        (vec![Op::LoadArConst(AddressRegister::Ar1, 0), transfer(word(ar1(None, 0)))], FaultKind::AreaWrite, 0),
        (
            vec![Op::LoadArConst(AddressRegister::Ar1, 3), load(word(ar1(Some(Area::Memory), 8)))],
            FaultKind::AlignmentRead,
            8,
        ),
        (
            vec![Op::LoadArConst(AddressRegister::Ar1, 0x8300_0003), transfer(word(ar1(None, 8)))],
            FaultKind::AlignmentWrite,
            8,
        ),
        (vec![Op::LoadTimer(Number::Fixed(256))], FaultKind::TimerNumber, 256),
        (vec![Op::SetRlo, Op::CountUp(Number::Fixed(1000))], FaultKind::CounterNumber, 1000),
        (vec![by_number(BlockKind::Fc, 200)], FaultKind::FcNotLoaded, 0),
        (vec![by_number(BlockKind::Fb, 200)], FaultKind::FbNotLoaded, 0),
        (vec![load(word(place(Area::Peripheral, 256, 0)))], FaultKind::PeripheralRead, 256),
        (vec![transfer(word(place(Area::Peripheral, 256, 0)))], FaultKind::PeripheralWrite, 256),
    ]
}

fn data() -> Vec<ob1_ir::DataBlock> {
    let mut protected = db(8, &[0; 4]);
    protected.read_only = true;
    vec![db(7, &[0; 4]), protected]
}

#[test]
fn without_its_ob_an_error_is_stop_and_says_where() {
    for (ops, kind, number) in table() {
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
}

#[test]
fn with_its_ob_the_program_goes_on_behind_the_statement() {
    for (ops, kind, number) in table() {
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
        assert_eq!((bench.mb(103), bench.mb(104), bench.mw(106)), (u32::from(kind.ob()), 0x88, number), "{name}");
        assert_eq!((bench.mw(108), bench.mw(110)), (1, line), "{name}: block number and line");
    }
}

#[test]
fn an_error_in_the_handler_is_stop() {
    let handler = block(ob(121), Interface::default(), vec![load(mw(9000))]);
    let mut bench = Bench::new(&program(vec![ob1(vec![load(mw(9000))]), handler], vec![]));
    assert_eq!(bench.cycle().state, OperatingState::Stop);
    assert_eq!(bench.events()[..3], [0x4562, 0x2522, 0x2522]);
    bench.cpu.request(ob1_cpu::Command::Run);
    assert_eq!(bench.cycle().state, OperatingState::Stop, "and can be tried again");
}

#[test]
fn register_indirect_access_reaches_the_last_byte_and_no_further() {
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
}
