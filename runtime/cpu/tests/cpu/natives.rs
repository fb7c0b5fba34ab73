//! Native blocks: parameters, areas, calls out of them, faults, STOP; and the system blocks.
#![allow(clippy::disallowed_types, reason = "a native block counts what the test reads, on one thread")]

use std::sync::{Arc, Mutex};

use ob1_cpu::{
    Abort, Cpu, CpuConfig, Module, ModuleSlot, NativeArea, NativeArg, NativeBlock, NativeContext, OperatingState,
    Refused, system_blocks,
};
use ob1_ir::{Arg, CallMode, DbRegister, Jump, Number, Op, Operand, Place, Program, StatusBit, Width};
use ob1_model::{Area, BitAddr, BlockId, BlockKind, DataType, Event, FaultKind, Interface, Section, TimerKind};
use ob1_std::ModuleSize;

use crate::common;
use crate::common::rack::TestModule;
use crate::common::*;

type Body = dyn Fn(&mut dyn NativeContext) -> Result<(), Abort> + Send;

struct Native {
    id: BlockId,
    interface: Interface,
    body: Box<Body>,
    resets: Arc<Mutex<u32>>,
}

impl NativeBlock for Native {
    fn id(&self) -> BlockId {
        self.id
    }
    fn name(&self) -> &str {
        "NATIVE"
    }
    fn interface(&self) -> &Interface {
        &self.interface
    }
    fn reset(&self) {
        *self.resets.lock().expect("one thread") += 1;
    }
    fn call(&self, cx: &mut dyn NativeContext) -> Result<(), Abort> {
        (self.body)(cx)
    }
}

fn native(
    id: BlockId,
    params: &[(&str, Section, DataType)],
    body: impl Fn(&mut dyn NativeContext) -> Result<(), Abort> + Send + 'static,
) -> Box<dyn NativeBlock> {
    let interface = interface(id.kind, params, 0);
    Box::new(Native { id, interface, body: Box::new(body), resets: Arc::default() })
}

fn bench(program: &Program, natives: Vec<Box<dyn NativeBlock>>) -> Bench {
    Bench::with(Cpu::new(CpuConfig::default(), program, natives, vec![], common::engine()).expect("loads"))
}

fn arg(operand: Operand) -> Arg {
    Arg::Operand(operand)
}

#[test]
fn parameters_of_an_fc() {
    on_each_engine(|| {
        let block = native(
            fc(20),
            &[
                ("a", Section::Input, DataType::Int),
                ("b", Section::Input, DataType::Bool),
                ("t", Section::Input, DataType::TimerOrWord),
                ("d", Section::Input, DataType::BlockDb),
                ("s", Section::Input, DataType::String(4)),
                ("q", Section::Output, DataType::Word),
                ("f", Section::InOut, DataType::Bool),
            ],
            |cx| {
                assert_eq!(cx.get(0), Ok(0xFFFE));
                assert_eq!(cx.get(1), Ok(1));
                assert_eq!(cx.get(2), Ok(7));
                assert_eq!(cx.get(3), Ok(10));
                let mut text = [0; 3];
                assert_eq!(cx.read(4, 2, &mut text), Ok(()));
                assert_eq!(&text, b"abc");
                assert_eq!(cx.read(4, 4, &mut text), Err(Refused::Outside));
                assert_eq!(cx.get(4), Err(Refused::NoParam), "wider than 32 bits");
                assert_eq!(cx.get(7), Err(Refused::NoParam));
                assert_eq!(cx.set(0, 1), Err(Refused::NoParam), "an input");
                assert!(cx.given(6) && !cx.given(7));
                cx.set(5, 0x1_1234).unwrap();
                assert_eq!(cx.get(5), Ok(0x1234));
                // In/out by reference: seen in the area at once.
                assert_eq!(cx.bit_get(NativeArea::Memory, 101), Ok(false));
                cx.set(6, 1).unwrap();
                assert_eq!(cx.bit_get(NativeArea::Memory, 101), Ok(true));
                Ok(())
            },
        );
        let code = vec![
            c(0xFFFE),
            transfer(mw(4)),
            call(
                fc(20),
                vec![
                    arg(mw(4)),
                    Arg::Const(1),
                    Arg::Number(Number::Fixed(7)),
                    Arg::Number(Number::Fixed(10)),
                    Arg::Bytes(Box::from(&b"\x04\x03abc\0"[..])),
                    arg(in_db(3, Width::Word, 0, 0)),
                    arg(operand(Width::Bit, m(12, 5))),
                ],
            ),
        ];
        let mut bench = bench(&program(vec![ob1(code)], vec![db(3, &[0; 2])]), vec![block]);
        bench.run();
        assert_eq!((bench.dbw(3, 0), bench.m(12, 5)), (0x1234, true));
    });
}

/// A call whose second actual is not there: the block is not called, and the error's organization block and the
/// statement after the call find the data block that was open, not the one of an actual.
#[test]
fn a_call_that_cannot_be_supplied_leaves_the_registers() {
    on_each_engine(|| {
        let params = [("a", Section::Input, DataType::Word), ("b", Section::Input, DataType::Word)];
        for callee in [fc(20), fc(21)] {
            let block_20 = native(fc(20), &params, |cx| cx.area_write(NativeArea::Memory, 0, &[1]).map_err(|_| Abort));
            let open = |to: u32| vec![Op::LoadDbNumber(DbRegister::Db), transfer(mw(to))];
            let mut code = vec![
                Op::OpenDb(DbRegister::Db, Number::Fixed(5)),
                call(callee, vec![arg(in_db(3, Width::Word, 0, 0)), arg(in_db(4, Width::Word, 100, 0))]),
            ];
            code.extend(open(10));
            let blocks = vec![
                ob1(code),
                block(ob(121), Interface::default(), open(12)),
                block(fc(21), interface(BlockKind::Fc, &params, 0), vec![c(1), transfer(mb(0))]),
            ];
            let data = [3, 4, 5].map(|number| db(number, &[0; 2])).to_vec();
            let mut bench = bench(&program(blocks, data), vec![block_20]);
            bench.run();
            assert_eq!((bench.mw(10), bench.mw(12), bench.mb(0)), (5, 5, 0), "{callee}");
        }
    });
}

#[test]
fn a_word_for_a_timer_number() {
    on_each_engine(|| {
        let block = native(fc(20), &[("t", Section::Input, DataType::TimerOrWord)], |cx| {
            let n = cx.get(0).unwrap();
            cx.area_write(NativeArea::Memory, 20, &[n as u8]).unwrap();
            Ok(())
        });
        let code = vec![c(9), transfer(mw(4)), call(fc(20), vec![arg(mw(4))])];
        let mut bench = bench(&program(vec![ob1(code)], vec![]), vec![block]);
        bench.run();
        assert_eq!(bench.mb(20), 9);
    });
}

#[test]
fn an_fb_with_instance_and_open_parameters() {
    on_each_engine(|| {
        let params = [
            ("v", Section::Input, DataType::Int),
            ("q", Section::Output, DataType::Int),
            ("n", Section::Static, DataType::Int),
        ];
        let block = native(fb(20), &params, |cx| {
            let instance = cx.instance().unwrap();
            assert_eq!((instance.offset, instance.len), (0, 6));
            let mut bytes = [0; 2];
            cx.area_read(NativeArea::Instance, 4, &mut bytes).unwrap();
            let sum = u32::from(u16::from_be_bytes(bytes)) + cx.get(0).unwrap();
            cx.area_write(NativeArea::Instance, 4, &(sum as u16).to_be_bytes()).unwrap();
            assert_eq!(cx.area_write(NativeArea::Instance, 5, &[0; 2]), Err(Refused::Outside));
            assert_eq!(cx.given(0), instance.db == 5);
            cx.set(1, sum).unwrap();
            Ok(())
        });
        let code = vec![
            call_fb(fb(20), 5, vec![Arg::Const(7), arg(mw(30))]),
            call_fb(fb(20), 6, vec![Arg::Open, arg(mw(32))]),
        ];
        let data = vec![instance_db(5, fb(20), 6), instance_db(6, fb(20), 6)];
        let mut bench = bench(&program(vec![ob1(code)], data), vec![block]);
        bench.run();
        bench.run();
        assert_eq!((bench.mw(30), bench.mw(32)), (14, 0));
    });
}

#[test]
fn areas_timers_counters_registers_and_br() {
    on_each_engine(|| {
        let block = native(fc(20), &[], |cx| {
            assert_eq!(cx.area_len(NativeArea::Memory), Ok(256));
            assert_eq!(cx.area_len(NativeArea::Db(3)), Ok(4));
            assert_eq!(cx.area_len(NativeArea::Db(0)), Err(Refused::DbNumber));
            assert_eq!(cx.area_len(NativeArea::Db(99)), Err(Refused::NoDb));
            assert_eq!(cx.area_len(NativeArea::Instance), Err(Refused::NoParam));
            assert_eq!(cx.area_read(NativeArea::Db(3), 3, &mut [0; 2]), Err(Refused::Outside));
            assert_eq!(cx.area_write(NativeArea::Db(4), 0, &[0]), Err(Refused::ReadOnly));
            let mut local = [0; 2];
            cx.area_read(NativeArea::CallerLocal, 20, &mut local).unwrap();
            assert_eq!(local, [0, 77]);
            assert_eq!(cx.registers(), (3, 4));
            assert_eq!((cx.ob_info().number, cx.ob_info().priority, cx.ob_info().start[0]), (1, 1, 0x11));
            cx.timer_run(2, TimerKind::ExtendedPulse, true, 0x0010).unwrap();
            let timer = cx.timer_get(2).unwrap();
            assert_eq!((timer.output, timer.running, timer.remaining), (true, true, 0x0010));
            cx.timer_reset(2).unwrap();
            assert!(!cx.timer_get(2).unwrap().output);
            assert_eq!(cx.timer_get(256), Err(Refused::NoTimer));
            cx.counter_set(1, 999).unwrap();
            assert_eq!((cx.counter_get(1), cx.counter_set(1, 1000)), (Ok(999), Err(Refused::Outside)));
            cx.set_br(false);
            Ok(())
        });
        let mut protected = db(4, &[0; 2]);
        protected.read_only = true;
        let br = Op::Scan {
            logic: ob1_ir::Logic::And,
            negate: true,
            test: ob1_ir::BitTest::Status(StatusBit::BinaryResult),
        };
        let code = vec![
            Op::OpenDb(DbRegister::Db, Number::Fixed(3)),
            Op::OpenDb(DbRegister::Di, Number::Fixed(4)),
            c(77),
            transfer(lw(20)),
            call(fc(20), vec![]),
            br,
            Op::Assign(m(10, 0)),
        ];
        let mut bench = bench(&program(vec![ob1(code)], vec![db(3, &[0; 4]), protected]), vec![block]);
        bench.run();
        assert!(bench.m(10, 0));
    });
}

#[test]
fn modules_by_address() {
    on_each_engine(|| {
        let block = native(fc(20), &[], |cx| {
            let (status, ModuleSize { inputs, outputs }) = (cx.module_status(256).unwrap(), cx.module(256).unwrap());
            assert_eq!((status.generation, inputs, outputs), (3, 16, 16));
            assert_eq!(cx.module(257), Err(Refused::NoModule), "only at its base");
            cx.io_write(260, &[1, 2, 3]).unwrap();
            let mut bytes = [0; 2];
            cx.io_read(256, &mut bytes).unwrap();
            assert_eq!(bytes, [8, 9]);
            assert_eq!(cx.io_read(271, &mut bytes), Err(Refused::NoModule));
            assert_eq!(cx.record_read(256, 1, &mut bytes), Ok(1));
            assert_eq!(cx.record_of_block_write(256, 9, &bytes), Err(Refused::NoRecord));
            assert_eq!(cx.diagnostic_interrupt(1, &[]), Err(Refused::NoModule));
            Ok(())
        });
        let cp = TestModule::new(16);
        cp.look(|s| s.inputs[..2].copy_from_slice(&[8, 9]));
        let modules = vec![(ModuleSlot::new("cp", 256), Box::new(cp.clone()) as Box<dyn Module>)];
        let program = program(vec![ob1(vec![call(fc(20), vec![])])], vec![]);
        let mut bench = Bench::with(
            Cpu::new(CpuConfig::default(), &program, vec![block], modules, common::engine()).expect("loads"),
        );
        bench.run();
        assert_eq!(cp.look(|s| s.outputs[4..7].to_vec()), [1, 2, 3]);
    });
}

#[test]
fn a_whole_ob_1_can_be_native_and_call_blocks_of_statements() {
    on_each_engine(|| {
        let main = native(ob(1), &[], |cx| {
            let args = [
                NativeArg::Operand(NativeArea::Memory, 32),
                NativeArg::Value(5),
                NativeArg::Operand(NativeArea::Db(3), 0),
            ];
            cx.call_block(fc(1), 0, &args).map_err(|_| Abort)?;
            let args = [NativeArg::Value(3), NativeArg::Operand(NativeArea::Memory, 80)];
            cx.call_block(fb(1), 5, &args).map_err(|_| Abort)?;
            assert_eq!(cx.call_block(fc(1), 0, &args), Err(Refused::NoBlock), "too few");
            assert_eq!(cx.call_block(fc(77), 0, &[]), Err(Refused::NoBlock));
            assert_eq!(cx.call_block(fb(1), 9, &args), Err(Refused::NoDb));
            assert_eq!(cx.call_block(fb(1), 0, &args), Err(Refused::DbNumber));
            Ok(())
        });
        let int = || DataType::Int;
        let add = block(
            fc(1),
            interface(
                BlockKind::Fc,
                &[("x", Section::Input, int()), ("y", Section::Input, int()), ("q", Section::Output, int())],
                0,
            ),
            vec![
                load(param(0, Width::Word)),
                load(param(1, Width::Word)),
                Op::Arithmetic(ob1_ir::NumberFormat::Int, ob1_ir::AccuOp::Add),
                transfer(param(2, Width::Word)),
            ],
        );
        let at = |byte| operand(Width::Word, Place::Instance(BitAddr::byte_addr(byte)));
        let double = block(
            fb(1),
            interface(BlockKind::Fb, &[("v", Section::Input, int()), ("q", Section::Output, int())], 0),
            vec![
                load(at(0)),
                load(at(0)),
                Op::Arithmetic(ob1_ir::NumberFormat::Int, ob1_ir::AccuOp::Add),
                transfer(at(2)),
            ],
        );
        let data = vec![db(3, &[0; 2]), instance_db(5, fb(1), 4)];
        let mut bench = bench(&program(vec![add, double], data), vec![main]);
        bench.run();
        bench.set(4, ob1_cpu::Width::Word, 37);
        bench.run();
        assert_eq!((bench.dbw(3, 0), bench.mw(10)), (42, 6));
    });
}

#[test]
fn a_block_can_be_called_again_from_a_block_it_called() {
    on_each_engine(|| {
        // Native FC 20 (n) calls FC 2, which calls FC 20 with n - 1, down to 0.
        let recursive = native(fc(20), &[("n", Section::Input, DataType::Int)], |cx| {
            let n = cx.get(0).unwrap();
            let mut count = [0];
            cx.area_read(NativeArea::Memory, 20, &mut count).unwrap();
            cx.area_write(NativeArea::Memory, 20, &[count[0] + 1]).unwrap();
            if n > 0 {
                cx.call_block(fc(2), 0, &[NativeArg::Value(n - 1)]).map_err(|_| Abort)?;
            }
            assert_eq!(cx.get(0), Ok(n), "its own parameter is still there");
            Ok(())
        });
        let between = block(
            fc(2),
            interface(BlockKind::Fc, &[("n", Section::Input, DataType::Int)], 0),
            vec![call(fc(20), vec![arg(param(0, Width::Word))])],
        );
        let mut bench =
            bench(&program(vec![ob1(vec![call(fc(20), vec![Arg::Const(4)])]), between], vec![]), vec![recursive]);
        bench.run();
        assert_eq!(bench.mb(20), 5);
    });
}

#[test]
fn stop_and_faults_unwind_through_native_blocks() {
    on_each_engine(|| {
        let outer = || {
            native(fc(20), &[], |cx| match cx.call_block(fc(2), 0, &[]) {
                Err(Refused::Abort) => Err(Abort),
                other => panic!("the call went on: {other:?}"),
            })
        };
        // STOP by a native block two levels down.
        let inner = native(fc(21), &[], |cx| Err(cx.stop(Event::PLUGIN_STOP, "enough")));
        let blocks = || {
            vec![
                ob1(vec![call(fc(20), vec![]), c(1), transfer(mw(10))]),
                block(fc(2), Interface::default(), vec![uc(CallMode::Unconditional, fc(21))]),
            ]
        };
        let mut station = bench(&program(blocks(), vec![]), vec![outer(), inner]);
        assert_eq!(station.cycle().state, OperatingState::Stop);
        let entry = station.cpu.diagnostics().next().copied().expect("an entry");
        assert_eq!((entry.event, entry.text.as_str()), (Event::PLUGIN_STOP, "enough"));
        assert_eq!(entry.site.map(|s| (s.block, s.line)), Some((fc(2), 1)), "the calling statement");
        assert_eq!(station.mw(10), 0);
        // An endless loop below a native block ends by the watchdog.
        let mut endless = blocks();
        endless[1].code[0].op = Op::Jump(Jump::Always, 0);
        let mut station = bench(&program(endless, vec![]), vec![outer()]);
        assert_eq!(station.cycle().state, OperatingState::Stop);
        assert_eq!(station.events()[..2], [0x4568, 0x3501]);
        // A fault a native block raises, with its OB and without.
        let raise = || native(fc(20), &[], |cx| cx.raise_fault(FaultKind::DbNotLoaded, 55));
        let handler = block(ob(121), Interface::default(), vec![load(lw(6)), transfer(mw(12))]);
        let main = || ob1(vec![call(fc(20), vec![]), c(1), transfer(mw(10))]);
        let mut station = bench(&program(vec![main(), handler], vec![]), vec![raise()]);
        station.run();
        assert_eq!((station.mw(10), station.mw(12)), (1, 55));
        let mut station = bench(&program(vec![main()], vec![]), vec![raise()]);
        assert_eq!(station.cycle().state, OperatingState::Stop);
        assert_eq!(station.events()[..2], [0x4562, 0x253A]);
    });
}

#[test]
fn a_native_loop_meets_the_watchdog_when_it_attends() {
    on_each_engine(|| {
        let endless = native(fc(20), &[], |cx| {
            loop {
                cx.attend()?;
            }
        });
        let mut bench = bench(&program(vec![ob1(vec![call(fc(20), vec![])])], vec![]), vec![endless]);
        assert_eq!(bench.cycle().state, OperatingState::Stop);
        assert_eq!(bench.events()[..2], [0x4568, 0x3501]);
    });
}

#[test]
fn entries_logs_and_resets() {
    on_each_engine(|| {
        let resets: Arc<Mutex<u32>> = Arc::default();
        let block = Native {
            id: fc(20),
            interface: Interface::default(),
            body: Box::new(|cx| {
                cx.diag_entry(42, "something");
                cx.log(2, "a line");
                Ok(())
            }),
            resets: resets.clone(),
        };
        let mut bench = bench(&program(vec![ob1(vec![call(fc(20), vec![])])], vec![]), vec![Box::new(block)]);
        let mut log = bench.cpu.log_reader().expect("the first");
        bench.run();
        assert_eq!(*resets.lock().unwrap(), 1);
        let entry = bench.cpu.diagnostics().next().copied().expect("an entry");
        assert_eq!((entry.event, entry.data, entry.text.as_str()), (Event::PLUGIN_ENTRY, 42, "something"));
        let line = log.take().expect("a line");
        assert_eq!((line.level, line.text()), (2, "a line"));
        for _ in 0..200 {
            bench.run();
        }
        assert_eq!(std::iter::from_fn(|| log.take()).count(), 64, "a full ring drops");
    });
}

// ---- system blocks

fn sfc(number: u16) -> BlockId {
    BlockId::new(BlockKind::Sfc, number)
}

/// An ANY pointer to bytes.
fn any(db: u16, area: Area, byte: u16, count: u16) -> Arg {
    let [c0, c1] = count.to_be_bytes();
    let [d0, d1] = db.to_be_bytes();
    let [p0, p1, p2, p3] = ((u32::from(byte) * 8) | (u32::from(area.pointer_code()) << 24)).to_be_bytes();
    Arg::Bytes(Box::from([0x10, 2, c0, c1, d0, d1, p0, p1, p2, p3]))
}

#[test]
fn sfc_20_and_21_copy_and_fill() {
    on_each_engine(|| {
        let code = vec![
            call(sfc(20), vec![any(3, Area::Db, 0, 4), arg(mw(10)), any(0, Area::Memory, 20, 3)]),
            call(sfc(21), vec![any(3, Area::Db, 0, 2), arg(mw(12)), any(0, Area::Memory, 30, 5)]),
            call(sfc(20), vec![any(9, Area::Db, 0, 4), arg(mw(14)), any(0, Area::Memory, 20, 3)]),
            call(sfc(20), vec![any(3, Area::Db, 0, 4), arg(mw(16)), any(0, Area::Memory, 254, 3)]),
        ];
        let mut bench = bench(&program(vec![ob1(code)], vec![db(3, &[1, 2, 3, 4])]), system_blocks());
        bench.run();
        assert_eq!((bench.mw(10), bench.mw(12), bench.mw(14), bench.mw(16)), (0, 0, 0x813A, 0x8323));
        assert_eq!((bench.md(20), bench.md(30), bench.mb(34)), (0x0102_0300, 0x0102_0102, 1));
    });
}

#[test]
fn sfc_46_stops_and_64_tells_the_time() {
    on_each_engine(|| {
        let code = vec![call(sfc(64), vec![arg(md(10))]), u(m(0, 0)), uc(CallMode::Conditional, sfc(46))];
        let mut bench = bench(&program(vec![ob1(code)], vec![]), system_blocks());
        bench.clock.now = at(5 * MS);
        bench.run();
        assert_eq!(bench.md(10), 5);
        bench.set_m(0, 0, true);
        assert_eq!(bench.cycle().state, OperatingState::Stop);
        assert_eq!(bench.events()[0], 0x4543);
    });
}

#[test]
fn sfc_43_restarts_the_watchdog() {
    on_each_engine(|| {
        // 200 ms of loop, with SFC 43 at each turn of the outer loop.
        let nested = |retrigger| {
            let mut code = vec![c(4), transfer(mw(4)), c(10_000), Op::Loop(3)];
            code.push(if retrigger { uc(CallMode::Unconditional, sfc(43)) } else { Op::Nop });
            code.extend([load(mw(4)), Op::Loop(1)]);
            program(vec![ob1(code)], vec![])
        };
        let config = CpuConfig { watchdog: 3 * MS, ..CpuConfig::default() };
        let mut with = Bench::with(
            Cpu::new(config.clone(), &nested(true), system_blocks(), vec![], common::engine()).expect("loads"),
        );
        with.run();
        let mut without =
            Bench::with(Cpu::new(config, &nested(false), system_blocks(), vec![], common::engine()).expect("loads"));
        assert_eq!(without.cycle().state, OperatingState::Stop);
    });
}

/// A plugin block that reports a diagnosis from within OB 82, and an OB 80 that never ends but restarts the cycle
/// monitoring: neither nests for ever.
#[test]
fn error_obs_do_not_nest_in_themselves() {
    on_each_engine(|| {
        let count = Arc::new(Mutex::new(0));
        let counted = Arc::clone(&count);
        let report = native(fc(20), &[], move |cx| {
            let mut count = counted.lock().expect("one thread");
            *count += 1;
            // OB 82 asks for two more of itself, a few times.
            let times = if *count < 5 { 2 } else { 0 };
            drop(count);
            for _ in 0..times {
                cx.diagnostic_interrupt(256, &[1]).expect("it waits or runs");
            }
            Ok(())
        });
        let calls = || vec![call(fc(20), vec![])];
        let blocks = vec![ob1(calls()), block(ob(82), Interface::default(), calls())];
        let slots: Vec<(ModuleSlot, Box<dyn Module>)> =
            vec![(ModuleSlot::new("io", 256), Box::new(TestModule::new(4)))];
        let cpu = Cpu::new(CpuConfig::default(), &program(blocks, vec![]), vec![report], slots, common::engine())
            .expect("loads");
        let mut bench = Bench::with(cpu);
        bench.run();
        // OB 1, its two, and two for each of the three that asked.
        assert_eq!(*count.lock().expect("one thread"), 9);

        let retrigger = uc(CallMode::Unconditional, BlockId::new(BlockKind::Sfc, 43));
        let endless = block(ob(80), Interface::default(), vec![retrigger.clone(), Op::Jump(Jump::Always, 1)]);
        let main = ob1(vec![Op::Jump(Jump::Always, 0)]);
        let mut bench = bench_of(&program(vec![main, endless], vec![]));
        assert_eq!(bench.cycle().state, OperatingState::Stop);
        assert_eq!(bench.events()[..3], [0x4568, 0x3501, 0x3501]);
    });
}

fn bench_of(program: &Program) -> Bench {
    bench(program, system_blocks())
}
