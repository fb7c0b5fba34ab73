//! Forcing: whatever writes, the forced value stands.

use super::common::rack::TestModule;
use super::common::random::Random;
use super::common::source::bench_with;
use super::common::window::{Client, Looker};
use super::common::*;
use ob1_cpu::{
    Ask, Cell, CpuConfig, CyclicInterrupt, DebugJob, Family, ForceStep, Group, Job, Module, ModuleSlot, Put,
};
use ob1_model::{Area, CellError, Command, DebugEnd, DebugOrder, Forced, ForcedArea, Width};

/// A statement that writes somewhere in the first 8 bytes of an area, in one of the ways there are.
fn write(random: &mut Random) -> String {
    let area = random.of(&["E", "A", "M"]);
    let (byte, bit, value) = (random.next(7), random.next(8), random.next(65_536));
    match random.next(11) {
        0 => format!("SET;\n= {area} {byte}.{bit};\n"),
        1 => format!("SET;\nR {area} {byte}.{bit};\n"),
        2 => format!("CLR;\nS {area} {byte}.{bit};\nSET;\nS {area} {byte}.{bit};\n"),
        3 => format!("L {value};\nT {area}B {byte};\n"),
        4 => format!("L W#16#{value:X};\nT {area}W {};\n", byte.min(6)),
        5 => format!("L DW#16#{value:X}{value:04X};\nT {area}D {};\n", byte.min(4)),
        6 => format!("L P#{byte}.0;\nLAR1 ;\nL {value};\nT {area}B [AR1,P#0.0];\n"),
        7 => format!("CALL FC 1 (x := {area}W {}, y := {area} {byte}.{bit});\n", byte.min(6)),
        8 => format!(
            "CALL SFC 20 (SRCBLK := P#M 100.0 BYTE 4, RET_VAL := MW 120, DSTBLK := P#{area} {}.0 BYTE 4);\n",
            byte.min(4)
        ),
        9 => format!("L B#16#{:X};\nT PAB {};\n", value & 0xFF, random.of(&[byte, 256 + byte])),
        _ => random
            .of(&[
                "CALL SFC 26 (PART := B#16#0, RET_VAL := MW 120, FLADDR := MW 122);\n",
                "CALL SFC 27 (PART := B#16#0, RET_VAL := MW 120, FLADDR := MW 122);\n",
            ])
            .to_owned(),
    }
}

/// The statements that count in MW 50 when a forced cell has another value.
fn check(cell: &Forced, label: u32) -> String {
    let (byte, bit) = (cell.bit / 8, cell.bit % 8);
    let area = match cell.area {
        ForcedArea::Input => "E",
        ForcedArea::Output => "A",
        ForcedArea::Memory => "M",
        ForcedArea::PeripheralInput => "PE",
        ForcedArea::PeripheralOutput => return String::new(),
    };
    let differs = match cell.width {
        Width::Bit if cell.value == 1 => format!("UN {area} {byte}.{bit};\n"),
        Width::Bit => format!("U {area} {byte}.{bit};\n"),
        Width::Byte => format!("L {area}B {byte};\nL B#16#{:X};\n<>I;\n", cell.value),
        Width::Word => format!("L {area}W {byte};\nL W#16#{:X};\n<>I;\n", cell.value),
        Width::DWord => format!("L {area}D {byte};\nL DW#16#{:X};\n<>D;\n", cell.value),
    };
    format!("{differs}SPBN l{label:03};\nL MW 50;\n+ 1;\nT MW 50;\nl{label:03}: NOP 0;\n")
}

/// Sets what is forced, as a station does it for its operator.
fn force(bench: &mut Bench, client: &mut Client, cells: &[Forced]) -> Vec<ob1_cpu::Answer> {
    let adds = cells.iter().map(|cell| ForceStep::Add(*cell));
    let steps = [ForceStep::New].into_iter().chain(adds).chain([ForceStep::Take]);
    client.ask(1, steps.map(Ask::Force).collect::<Vec<_>>());
    bench.cycle();
    client.take().expect("answered").answers().to_vec()
}

fn cell(text: &str) -> Forced {
    Forced::parse(text).expect("a cell and its value")
}

fn outputs_of(module: &TestModule, cell: &Forced, first: u32) -> u32 {
    let bytes = usize::from(cell.width.bits().div_ceil(8));
    let at = (cell.bit / 8 - first) as usize;
    let value =
        module.look(|seen| seen.outputs[at..at + bytes].iter().fold(0, |value, byte| value << 8 | u32::from(*byte)));
    if cell.width == Width::Bit { value >> (cell.bit % 8) & 1 } else { value }
}

/// In every scan: after each statement on an S7-400, at the beginning of OB 1 and at the modules on both.
#[test]
fn nothing_gets_past_it() {
    on_each_engine(|| {
        for seed in 0..if is_reference() { 40 } else { 8 } {
            for family in [Family::S7_300, Family::S7_400] {
                all_ways(seed, family);
            }
        }
    });
}

fn all_ways(seed: u64, family: Family) {
    let large = family == Family::S7_400;
    let mut random = Random::new(seed);
    let mut cells = vec![cell("I0.3=1"), cell("QB2=16#5A"), cell("Q5.1=1"), cell("IW6=16#1234")];
    if large {
        cells.extend(["MW2=16#BEEF", "M6.6=1", "PIB257=16#77", "PQB258=16#99"].map(cell));
    }
    // Each check stands once, and behind any write.
    let (mut text, mut label) = (String::new(), 0);
    let mut checks = |text: &mut String, cells: &[Forced]| {
        for cell in cells {
            label += 1;
            *text += &check(cell, label);
        }
    };
    checks(&mut text, &cells);
    for _ in 0..30 {
        text += &write(&mut random);
        if large {
            checks(&mut text, &[random.of(&cells), random.of(&cells)]);
        }
    }
    // On an S7-300 an interrupt may overwrite the image between its reading and OB 1.
    let interrupt: String = (0..if large { 5 } else { 0 }).map(|_| write(&mut random)).collect();
    let source = format!(
        "FUNCTION FC 1 : VOID\nVAR_OUTPUT\n x : WORD;\nEND_VAR\nVAR_IN_OUT\n y : BOOL;\nEND_VAR\nBEGIN\nL W#16#5555;\nT #x;\n\
         SET;\n= #y;\nEND_FUNCTION\nORGANIZATION_BLOCK OB 35\nBEGIN\n{interrupt}NOP 0;\nEND_ORGANIZATION_BLOCK\n\
         ORGANIZATION_BLOCK OB 1\nBEGIN\n{text}END_ORGANIZATION_BLOCK\n"
    );
    let (near, far) = (TestModule::new(8), TestModule::new(8));
    let modules: Vec<(ModuleSlot, Box<dyn Module>)> = vec![
        (ModuleSlot::new("near", 0), Box::new(near.clone())),
        (ModuleSlot::new("far", 256), Box::new(far.clone())),
    ];
    let config = CpuConfig { cyclic: vec![CyclicInterrupt::new(35, MS)], min_cycle: 2 * MS, ..CpuConfig::of(family) };
    let mut bench = bench_with(&source, &[], config, modules);
    let mut client = Client::of(&mut bench.cpu);
    let mut link = Looker::of(&mut bench.cpu).expect("the first");
    bench.run();
    assert!(force(&mut bench, &mut client, &cells).iter().all(|answer| *answer == ob1_cpu::Answer::Done));
    bench.set(50, Width::Word, 0);
    for round in 0..10 {
        for module in [&near, &far] {
            module.look(|seen| seen.inputs.iter_mut().for_each(|byte| *byte = random.next(256) as u8));
        }
        let area = random.of(&[Area::Input, Area::Output, Area::Memory]);
        let puts = vec![
            Put::Bytes(Cell::Area(area, 0), vec![random.next(256) as u8; 8].into()),
            Put::Value(Cell::Peripheral(258 * 8), Width::Byte, random.next(256)),
        ];
        link.link.hand(Group::new(round, puts).expect("small")).expect("room");
        // The interrupt between two cycles, and a cycle.
        for _ in 0..2 {
            bench.clock.now += MS;
            bench.run();
        }
        while link.link.take().is_some() {}
        let told = || format!("seed {seed}, {family:?}, round {round}");
        assert_eq!(bench.cell(Area::Memory, 50, Width::Word), 0, "{}: the program saw another value\n{source}", told());
        for forced in &cells {
            let seen = match forced.area {
                ForcedArea::Output => outputs_of(&near, forced, 0),
                ForcedArea::PeripheralOutput => outputs_of(&far, forced, 256),
                ForcedArea::Memory => {
                    bench.cpu.read(Cell::Area(Area::Memory, forced.bit), forced.width).expect("there")
                }
                ForcedArea::Input => bench.cpu.read(Cell::Area(Area::Input, forced.bit), forced.width).expect("there"),
                ForcedArea::PeripheralInput => continue,
            };
            // A program may overwrite an image in its scan on an S7-300; what comes out and in is forced.
            if large || forced.area == ForcedArea::Output {
                assert_eq!(seen, forced.value, "{}: {forced}", told());
            }
        }
    }
}

#[test]
fn it_ends_with_an_empty_list_or_a_memory_reset_and_outlasts_a_restart() {
    let modules: Vec<(ModuleSlot, Box<dyn Module>)> = vec![(ModuleSlot::new("io", 0), Box::new(TestModule::new(8)))];
    let source = "ORGANIZATION_BLOCK OB 1\nBEGIN\nL EB 0;\nT MB 0;\nEND_ORGANIZATION_BLOCK\n";
    let mut bench = bench_with(source, &[], CpuConfig::default(), modules);
    let mut client = Client::of(&mut bench.cpu);
    let count = bench.cpu.forced();
    let count = || count.load(std::sync::atomic::Ordering::Relaxed);
    bench.run();
    force(&mut bench, &mut client, &[cell("IB0=16#11")]);
    bench.run();
    assert_eq!((bench.mb(0), count()), (0x11, 1));
    for command in [Command::Stop, Command::Warm, Command::Stop, Command::Cold] {
        bench.cpu.request(command);
        bench.cycle();
    }
    bench.run();
    assert_eq!((bench.mb(0), count()), (0x11, 1));
    // What this CPU cannot force is refused, and nothing changes.
    for wrong in ["MB0=1", "PIB0=1", "IB60000=1", "IB1=16#100", "PQW0=1"] {
        let answers = force(&mut bench, &mut client, &[cell("IB0=16#22"), cell(wrong)]);
        assert!(matches!(answers[2], ob1_cpu::Answer::Refused(_)), "{wrong}: {answers:?}");
        bench.run();
        assert_eq!(bench.mb(0), 0x11, "{wrong}");
    }
    let many: Vec<Forced> = (0..11).map(|bit| Forced { bit, value: 1, ..Forced::NONE }).collect();
    let refused = ob1_cpu::Answer::Refused(CellError::Value);
    assert_eq!(force(&mut bench, &mut client, &many)[11], refused, "ten on an S7-300");
    force(&mut bench, &mut client, &[]);
    bench.run();
    assert_eq!((bench.mb(0), count()), (0, 0));
    force(&mut bench, &mut client, &[cell("IB0=16#33")]);
    bench.cpu.request(Command::Reset);
    bench.cycle();
    assert_eq!(count(), 0);
    bench.cpu.request(Command::Run);
    bench.run();
    bench.run();
    assert_eq!(bench.mb(0), 0);
    // A station that starts puts back what it has kept.
    assert_eq!(bench.cpu.force(&[cell("IB0=16#44"), cell("MB1=1")]), 1);
    bench.run();
    assert_eq!(bench.mb(0), 0x44);
}

/// In STOP: a peripheral output is written, and what becomes of it.
fn write_output(bench: &mut Bench, link: &mut Looker) -> Result<(), CellError> {
    let put = Put::Value(Cell::Peripheral(3 * 8), Width::Byte, 0x7E);
    link.link.hand(Group::new(1, vec![put]).expect("small")).expect("room");
    bench.cycle();
    let Some(Job::Group(group)) = link.link.take() else { panic!("the group") };
    group.outcome().map_err(|(_, why)| why)
}

fn debug(bench: &mut Bench, link: &mut Looker, order: DebugOrder) -> DebugEnd {
    link.link.hand(DebugJob::new(2, order)).expect("room");
    bench.cycle();
    let Some(Job::Debug(job)) = link.link.take() else { panic!("an answer") };
    job.into_answer().end
}

#[test]
fn in_stop_it_works_and_outputs_are_written_only_while_they_are_enabled() {
    for family in [Family::S7_300, Family::S7_400] {
        let io = TestModule::new(8);
        let modules: Vec<(ModuleSlot, Box<dyn Module>)> = vec![(ModuleSlot::new("io", 0), Box::new(io.clone()))];
        let source = "ORGANIZATION_BLOCK OB 1\nBEGIN\nNOP 0;\nEND_ORGANIZATION_BLOCK\n";
        let mut bench = bench_with(source, &[], CpuConfig::of(family), modules);
        let mut client = Client::of(&mut bench.cpu);
        let mut link = Looker::of(&mut bench.cpu).expect("the first");
        let outputs = |at: usize| io.look(|seen| seen.outputs[at]);
        let disabled = || io.look(|seen| std::mem::take(&mut seen.disabled));

        // Before the first start as after a STOP.
        bench.cpu.request(Command::Stop);
        assert_eq!(write_output(&mut bench, &mut link), Err(CellError::OutputsOff));
        bench.cpu.request(Command::Run);
        bench.cycle();
        bench.run();
        assert_eq!(debug(&mut bench, &mut link, DebugOrder::Outputs(true)), DebugEnd::Runs);
        let mut cells = vec![cell("Q1.2=1"), cell("QW6=16#1234")];
        if family == Family::S7_400 {
            cells.push(cell("PQB4=16#99"));
        }
        force(&mut bench, &mut client, &cells);
        let forced = || [outputs(1), outputs(6), outputs(7), outputs(4)];
        let wanted = [4, 0x12, 0x34, if family == Family::S7_400 { 0x99 } else { 0 }];
        assert_eq!(forced(), wanted, "in RUN");
        let rounds = [Some(DebugOrder::Outputs(false)), Some(DebugOrder::End), None]
            .into_iter()
            .flat_map(|end| [end.clone(), end]);
        for end in rounds {
            bench.cpu.request(Command::Stop);
            bench.cycle();
            bench.cycle();
            assert_eq!((forced(), write_output(&mut bench, &mut link)), ([0; 4], Err(CellError::OutputsOff)));
            assert_eq!(debug(&mut bench, &mut link, DebugOrder::Outputs(true)), DebugEnd::Done);
            bench.cycle();
            assert_eq!((forced(), outputs(3)), (wanted, 0));
            assert_eq!((write_output(&mut bench, &mut link), outputs(3)), (Ok(()), 0x7E));
            assert_eq!(disabled(), [false]);
            match end {
                Some(end) => {
                    assert_eq!(debug(&mut bench, &mut link, end), DebugEnd::Done);
                    assert_eq!(disabled(), [true]);
                    assert_eq!(write_output(&mut bench, &mut link), Err(CellError::OutputsOff));
                }
                // The start takes it back by itself.
                None => assert!(disabled().is_empty()),
            }
            bench.cpu.request(Command::Warm);
            bench.cycle();
            bench.run();
        }
        bench.cpu.request(Command::Stop);
        bench.cycle();
        assert_eq!(debug(&mut bench, &mut link, DebugOrder::Outputs(true)), DebugEnd::Done);
        bench.cpu.request(Command::Reset);
        bench.cycle();
        assert_eq!((disabled(), write_output(&mut bench, &mut link)), (vec![false, true], Err(CellError::OutputsOff)));
    }
}
