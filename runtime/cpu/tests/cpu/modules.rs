//! Modules: process image, direct access, STOP, diagnostic interrupts, addresses.

use ob1_cpu::{Cell, Command, Cpu, CpuConfig, Module, ModuleEvent, ModuleSlot, OperatingState};
use ob1_ir::{Op, Operand, Program, Width};
use ob1_model::{Area, Event, Interface};

use crate::common;
use crate::common::rack::TestModule;
use crate::common::*;

fn station(program: &Program, modules: &[(u32, &TestModule)]) -> Bench {
    let plugged = modules
        .iter()
        .map(|(address, m)| {
            (ModuleSlot::new(&format!("m{address}"), *address), Box::new((*m).clone()) as Box<dyn Module>)
        })
        .collect();
    Bench::with(Cpu::new(CpuConfig::default(), program, Vec::new(), plugged, common::engine()).expect("loads"))
}

fn io(width: Width, area: Area, byte: u32) -> Operand {
    operand(width, place(area, byte, 0))
}

#[test]
fn a_module_at_0_is_in_the_image_and_one_at_256_is_not() {
    on_each_engine(|| {
        let code = vec![
            load(io(Width::Word, Area::Input, 0)),
            transfer(mw(10)),
            load(io(Width::Word, Area::Peripheral, 256)),
            transfer(mw(12)),
            transfer(io(Width::Word, Area::Output, 2)),
            c(0x5566),
            transfer(io(Width::Word, Area::Peripheral, 258)),
        ];
        let (low, high) = (TestModule::new(16), TestModule::new(16));
        low.look(|s| s.inputs[..2].copy_from_slice(&[0x11, 0x22]));
        high.look(|s| s.inputs[..2].copy_from_slice(&[0x33, 0x44]));
        let mut bench = station(&program(vec![ob1(code)], vec![]), &[(0, &low), (256, &high)]);
        bench.run();
        assert_eq!((bench.mw(10), bench.mw(12)), (0x1122, 0x3344));
        assert_eq!(low.look(|s| s.outputs[..4].to_vec()), [0, 0, 0x33, 0x44]);
        assert_eq!(high.look(|s| s.outputs[..4].to_vec()), [0, 0, 0x55, 0x66]);
        assert_eq!(high.look(|s| s.writes.len()), 1, "no image is written where there is none");
        assert_eq!(
            low.look(|s| s.writes.clone()),
            [(0, s_bytes(&[0, 0, 0x33, 0x44]))],
            "the image reaches it in one piece"
        );
    });
}

fn s_bytes(start: &[u8]) -> Vec<u8> {
    let mut bytes = start.to_vec();
    bytes.resize(16, 0);
    bytes
}

#[test]
fn a_direct_write_inside_the_image_changes_the_image_too() {
    on_each_engine(|| {
        let code = vec![
            c(0x0102),
            transfer(io(Width::Word, Area::Peripheral, 4)),
            load(io(Width::Word, Area::Output, 4)),
            transfer(mw(10)),
        ];
        let low = TestModule::new(16);
        let mut bench = station(&program(vec![ob1(code)], vec![]), &[(0, &low)]);
        bench.run();
        assert_eq!(bench.mw(10), 0x0102);
        let writes = low.look(|s| s.writes.clone());
        assert_eq!(writes, [(4, vec![1, 2]), (0, s_bytes(&[0, 0, 0, 0, 1, 2]))]);
    });
}

#[test]
fn a_word_across_two_modules_is_an_access_error() {
    on_each_engine(|| {
        let (low, high) = (TestModule::new(4), TestModule::new(4));
        for (op, event) in [
            (load(io(Width::Word, Area::Peripheral, 303)), 0x2942),
            (transfer(io(Width::DWord, Area::Peripheral, 302)), 0x2943),
        ] {
            let mut bench = station(&program(vec![ob1(vec![op])], vec![]), &[(300, &low), (304, &high)]);
            assert_eq!(bench.cycle().state, OperatingState::Stop);
            assert_eq!(bench.events()[..2], [0x4563, event]);
        }
    });
}

#[test]
fn stop_drives_zeros_everywhere_and_modules_are_served_on() {
    on_each_engine(|| {
        let code = vec![
            c(0xFFFF_FFFF),
            transfer(io(Width::DWord, Area::Output, 0)),
            transfer(io(Width::DWord, Area::Peripheral, 256)),
        ];
        let (low, high) = (TestModule::new(16), TestModule::new(100));
        let mut bench = station(&program(vec![ob1(code)], vec![]), &[(0, &low), (256, &high)]);
        bench.run();
        assert_eq!(high.look(|s| s.outputs[0]), 0xFF);
        bench.cpu.request(Command::Stop);
        let end = bench.cycle();
        assert_eq!((end.state, end.next_deadline), (OperatingState::Stop, bench.clock.now + 10 * MS));
        for module in [&low, &high] {
            module.look(|s| {
                assert!(s.outputs.iter().all(|b| *b == 0));
                assert_eq!(s.states, [true, false]);
            });
        }
        assert_eq!(bench.cell(Area::Output, 0, Width::DWord), 0);
        let scans = low.look(|s| s.scans);
        bench.cycle();
        assert_eq!(low.look(|s| s.scans), scans + 1);
        bench.cpu.request(Command::Run);
        bench.run();
        assert_eq!(low.look(|s| s.states.clone()), [true, false, true], "parameters are sent again");
        assert_eq!(high.look(|s| s.outputs[0]), 0xFF);
    });
}

#[test]
fn an_absent_module_reads_as_zero_in_the_image_and_faults_when_it_says_so() {
    on_each_engine(|| {
        let code = vec![load(io(Width::Byte, Area::Input, 0)), transfer(mb(10))];
        let low = TestModule::new(4);
        low.look(|s| s.inputs[0] = 9);
        let mut bench = station(&program(vec![ob1(code)], vec![]), &[(0, &low)]);
        bench.run();
        assert_eq!(bench.mb(10), 9);
        low.look(|s| s.absent = true);
        bench.run();
        assert_eq!(bench.mb(10), 0);
        assert_eq!(bench.cpu.read(Cell::Peripheral(0), Width::Byte), Err(ob1_cpu::CellError::NoModule));
        assert_eq!(
            bench.cpu.module(0).map(|(slot, status)| (slot.name.clone(), status.present)),
            Some(("m0".into(), false))
        );
    });
}

#[test]
fn events_reach_the_buffer_and_ob_82() {
    on_each_engine(|| {
        let handler = vec![
            load(operand(Width::DWord, l(0, 0))),
            transfer(md(100)),
            load(operand(Width::DWord, l(8, 0))),
            transfer(md(104)),
            load(lw(6)),
            transfer(mw(108)),
        ];
        let blocks = vec![ob1(vec![]), block(ob(82), Interface::default(), handler)];
        let cp = TestModule::new(16);
        let mut bench = station(&program(blocks, vec![]), &[(256, &cp)]);
        bench.run();
        let mut data = [0; 16];
        data[..4].copy_from_slice(&[0x0D, 0x15, 0, 4]);
        let event = ModuleEvent { event: Event::CP_ERROR, diagnostic_interrupt: true, data, len: 4 };
        cp.look(|s| s.events.push(event));
        bench.run();
        assert_eq!((bench.md(100), bench.md(104), bench.mw(108)), (0x3942_1A52, 0x0D15_0004, 256));
        assert_eq!(
            bench.cpu.diagnostics().next().map(|e| e.text.as_str().to_owned()).as_deref(),
            Some("m256: 0D 15 00 04")
        );
        let mut text = event;
        text.diagnostic_interrupt = false;
        text.data[..4].copy_from_slice(b"line");
        cp.look(|s| s.events.push(text));
        bench.run();
        let entry = bench.cpu.diagnostics().next().copied().expect("an entry");
        assert_eq!((entry.event, entry.data, entry.text.as_str()), (Event::CP_ERROR, 256, "m256: line"));
    });
}

#[test]
fn a_diagnostic_interrupt_without_ob_82_is_stop() {
    on_each_engine(|| {
        let cp = TestModule::new(16);
        let mut bench = station(&program(vec![ob1(vec![])], vec![]), &[(256, &cp)]);
        bench.run();
        let event = ModuleEvent { event: Event::CP_ERROR, diagnostic_interrupt: true, data: [0x25; 16], len: 4 };
        cp.look(|s| s.events.push(event));
        bench.cycle();
        assert_eq!(bench.events()[..2], [0x456A, Event::CP_ERROR.0]);
        // In STOP nobody asks for an OB: the next one is an entry and no more.
        cp.look(|s| s.events.push(event));
        bench.cycle();
        assert_eq!(bench.events()[..2], [Event::CP_ERROR.0, 0x456A]);
    });
}

#[test]
fn overlaps_are_refused_by_name() {
    on_each_engine(|| {
        let program = program(vec![], vec![]);
        let plug = |address, bytes| {
            (ModuleSlot::new(&format!("m{address}"), address), Box::new(TestModule::new(bytes)) as Box<dyn Module>)
        };
        let errors = |modules| {
            Cpu::new(CpuConfig::default(), &program, vec![], modules, common::engine()).err().unwrap_or_default()
        };
        let messages: Vec<_> = errors(vec![plug(256, 16), plug(270, 16)]).iter().map(ToString::to_string).collect();
        assert_eq!(messages.len(), 2, "inputs and outputs");
        assert_eq!(
            messages[0],
            "L007: modules m256 and m270 both have input byte 270; give one of them another address"
        );
        assert_eq!(errors(vec![plug(65_530, 16)])[0].number(), 8);
        assert!(errors(vec![plug(256, 16), plug(272, 16)]).is_empty());
    });
}

#[test]
fn without_modules_the_image_can_answer() {
    on_each_engine(|| {
        let code = vec![
            load(io(Width::Word, Area::Peripheral, 2)),
            transfer(mw(10)),
            c(7),
            transfer(io(Width::Byte, Area::Peripheral, 3)),
            Op::Nop,
        ];
        let config = CpuConfig { peripheral_from_image: true, ..CpuConfig::default() };
        let mut bench = Bench::with(
            Cpu::new(config, &program(vec![ob1(code)], vec![]), vec![], vec![], common::engine()).expect("loads"),
        );
        bench.run();
        bench.cpu.write(Cell::Area(Area::Input, 16), Width::Word, 0x1234).expect("an input");
        bench.run();
        assert_eq!((bench.mw(10), bench.cell(Area::Output, 3, Width::Byte)), (0x1234, 7));
    });
}
