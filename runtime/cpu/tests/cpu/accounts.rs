//! The accounts of every scan, in virtual time: how a delay shows in them, and what happens to missed deadlines.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ob1_cpu::{
    Abort, AccountsConfig, Clock, Command, Cpu, CpuConfig, CyclicInterrupt, ImageErrors, MissedCycle, Module,
    ModuleError, ModuleEvent, ModuleSlot, ModuleStatus, NativeBlock, NativeContext, OperatingState, ScanRecord,
};
use ob1_ir::{CallMode, Op};
use ob1_model::{BlockId, BlockKind, Interface};
use ob1_time::{Instant, Span};

use crate::common;
use crate::common::*;

fn start(config: CpuConfig, blocks: Vec<ob1_ir::CodeBlock>, natives: Vec<Box<dyn NativeBlock>>) -> Bench {
    let program = program(blocks, Vec::new());
    Bench::with(Cpu::new(config, &program, natives, Vec::new(), common::engine()).expect("loads"))
}

fn every_ms(missed: MissedCycle) -> CpuConfig {
    CpuConfig { min_cycle: MS, watchdog: Span::ZERO, missed, ..CpuConfig::default() }
}

/// `count` statements: 100 ns each. Short ones, to leave the rest of the cycle free.
fn busy(count: u32) -> Vec<Op> {
    vec![c(count), Op::Loop(1)]
}

#[test]
fn a_missed_deadline_is_skipped_caught_up_or_begins_a_new_schedule_and_is_counted() {
    on_each_engine(|| {
        // The scan of the deadline at 1 ms begins at 4.5 ms: those at 2, 3 and 4 ms have passed.
        let cases = [
            // The scan of 4.5 ms stands for the deadline of 2 ms.
            (MissedCycle::Now, 4 * MS + MS / 2, 2, vec![MS / 2, 3 * MS / 2]),
            (MissedCycle::Skip, 5 * MS, 3, vec![MS, 2 * MS, 3 * MS]),
            (MissedCycle::CatchUp, 2 * MS, 0, vec![]),
        ];
        for (missed, next, count, lost) in cases {
            let mut bench = start(every_ms(missed), vec![ob1(Vec::new())], Vec::new());
            bench.clock.per_statement = Span::ZERO;
            bench.run();
            bench.clock.now = at(4 * MS + MS / 2);
            assert_eq!(bench.cycle().next_deadline, at(next), "{missed:?}");
            let figures = bench.cpu.accounts().figures();
            assert_eq!((figures.overruns, figures.missed), (1, count), "{missed:?}");
            assert_eq!((figures.wake.count(), figures.wake.max()), (2, 7 * MS / 2), "one a scan");
            let mut late: Vec<Span> = figures.deadlines.buckets().map(|(value, _)| value).collect();
            assert_eq!((late.remove(0), late.pop()), (Span::ZERO, Some(7 * MS / 2)));
            let near = late.iter().zip(&lost).all(|(a, b)| a.abs_diff(*b) <= *b / 256);
            assert!(near && late.len() == lost.len(), "{missed:?}: {late:?}");
        }
    });
}

#[test]
fn a_schedule_that_is_caught_up_stays_where_it_was() {
    on_each_engine(|| {
        let mut bench = start(every_ms(MissedCycle::CatchUp), vec![ob1(Vec::new())], Vec::new());
        bench.clock.per_statement = Span::ZERO;
        bench.run();
        bench.clock.now = at(4 * MS + MS / 2);
        let deadlines: Vec<_> = (0..4).map(|_| bench.cycle().next_deadline).collect();
        assert_eq!(deadlines, [2, 3, 4, 5].map(Instant::from_millis));
        assert_eq!(bench.cpu.accounts().figures().overruns, 3);
        // A pause beyond all bounds is not caught up with.
        bench.clock.now = at(3_600_005 * MS);
        bench.run();
        let figures = bench.cpu.accounts().figures();
        assert_eq!((figures.scans, figures.missed), (6, 3_600_000 - 1000));
        assert_eq!(figures.deadlines.count(), 6 + figures.missed);
    });
}

#[test]
fn every_part_of_a_scan_is_accounted_for() {
    on_each_engine(|| {
        let config = CpuConfig { cyclic: vec![CyclicInterrupt::new(35, 3 * MS / 2)], ..every_ms(MissedCycle::Skip) };
        let interrupt = block(ob(35), Interface::default(), busy(2000));
        let mut bench = start(config, vec![ob1(busy(1000)), interrupt], Vec::new());
        for _ in 0..3 {
            bench.run();
            bench.clock.now = bench.clock.now.next_tick(MS);
        }
        // OB 1 takes 0.1 ms; OB 35 of 0.2 ms is due at 1.5 ms and runs before OB 1 of the scan at 2 ms.
        let scan = *bench.cpu.last_scan();
        let none = Span::ZERO;
        let second = at(2 * MS);
        assert_eq!((scan.scan, scan.planned, scan.start, scan.inputs, scan.outputs), (3, second, second, none, none));
        assert_eq!((scan.longest_ob, scan.program, scan.execution()), (35, scan.end - scan.start, scan.program));
        assert!(scan.longest_ob_time >= MS / 5 && scan.program >= 3 * MS / 10, "{scan:?}");
        assert!((3000..3020).contains(&scan.statements), "{scan:?}");
        let figures = bench.cpu.accounts().figures();
        assert_eq!((figures.scans, figures.cycle.count(), figures.late), (3, 2, 0));
        assert_eq!(figures.obs.iter().map(|ob| (ob.ob, ob.runs)).collect::<Vec<_>>(), [(1, 3), (35, 1)]);
        assert_eq!(figures.obs[1].lateness.max(), MS / 2);
        assert_eq!(figures.statements, bench.cpu.statistics().statements);
        assert_eq!(bench.cpu.accounts().flight().len(), 3);
        assert_eq!(bench.cpu.accounts().flight()[2], scan);
    });
}

#[test]
fn a_long_scan_names_its_block_and_freezes_the_recorder() {
    on_each_engine(|| {
        let long = block(fc(7), Interface::default(), busy(30_000));
        let call = |m| vec![u(m), uc(CallMode::Conditional, fc(7))];
        let mut bench = start(every_ms(MissedCycle::Skip), vec![ob1(call(common::m(0, 0))), long], Vec::new());
        bench.run();
        bench.clock.now = at(MS);
        bench.run();
        assert_eq!((bench.cpu.last_scan().flags.is_late(), bench.cpu.accounts().take_frozen()), (false, None));
        bench.set_m(0, 0, true);
        bench.clock.now = at(2 * MS);
        assert!(bench.cycle().late);
        let scan = *bench.cpu.last_scan();
        assert!(scan.flags.took_long && scan.flags.overran && !scan.flags.began_late, "{scan:?}");
        assert_eq!((scan.long_in, scan.long_at_line, scan.longest_ob, scan.missed), (Some(fc(7)), 2, 1, 3));
        assert!((3 * MS..4 * MS).contains(&scan.longest_ob_time));
        let frozen = bench.cpu.accounts().take_frozen().expect("an overrun");
        assert_eq!((frozen.scans.len(), frozen.scans.last()), (3, Some(&scan)));
        let figures = bench.cpu.accounts().figures();
        assert_eq!((figures.late, figures.overruns), (1, 1));
    });
}

#[test]
fn lateness_by_an_interrupt_between_two_scans_and_by_the_scan_before_is_told_apart() {
    on_each_engine(|| {
        let config = CpuConfig {
            min_cycle: 2 * MS,
            cyclic: vec![CyclicInterrupt::new(35, 21 * MS + MS / 2)],
            ..every_ms(MissedCycle::CatchUp)
        };
        let interrupt = block(ob(35), Interface::default(), busy(10_000));
        let mut bench = start(config, vec![ob1(Vec::new()), interrupt], Vec::new());
        while bench.clock.now < at(21 * MS) {
            bench.clock.now = bench.cycle().next_deadline;
        }
        assert!(!bench.cycle().whole, "1 ms of OB 35, to 22.5 ms");
        bench.run();
        let late: ScanRecord = *bench.cpu.last_scan();
        assert!((MS / 2..MS / 2 + MS / 10).contains(&late.lateness()), "{late:?}");
        assert_eq!((late.between, late.between_ob, late.carried), (late.lateness(), 35, Span::ZERO));
        // The scan of 24 ms begins at 27 ms: the next one is late because of it.
        bench.clock.now = at(27 * MS);
        bench.run();
        bench.run();
        let carried = *bench.cpu.last_scan();
        assert_eq!((carried.planned, carried.carried, carried.between), (at(26 * MS), carried.lateness(), Span::ZERO));
    });
}

/// Passes time as a plugin's block would take it, in which another one may run.
struct Takes {
    id: BlockId,
    plugin: bool,
    time: Span,
    calls: Option<BlockId>,
}

impl NativeBlock for Takes {
    fn id(&self) -> BlockId {
        self.id
    }

    fn name(&self) -> &str {
        "TAKES"
    }

    fn interface(&self) -> &Interface {
        static NONE: std::sync::LazyLock<Interface> = std::sync::LazyLock::new(Interface::default);
        &NONE
    }

    fn is_plugin(&self) -> bool {
        self.plugin
    }

    fn reset(&self) {}

    fn call(&self, cx: &mut dyn NativeContext) -> Result<(), Abort> {
        if let Some(other) = self.calls {
            cx.call_block(other, 0, &[]).expect("it exists");
        }
        // Virtual time passes by statements: a tick of the clock for each.
        for _ in 0..self.time / Span::from_nanos(100) {
            cx.attend()?;
        }
        Ok(())
    }
}

#[test]
fn calls_of_plugins_are_timed_each_for_itself() {
    on_each_engine(|| {
        let takes = |number, plugin, time, calls| {
            let id = BlockId::new(BlockKind::Fc, number);
            Box::new(Takes { id, plugin, time, calls }) as Box<dyn NativeBlock>
        };
        let natives =
            || vec![takes(1, true, MS / 2, Some(fc(2))), takes(3, false, MS, None), takes(2, true, 3 * MS / 10, None)];
        let calls = [fc(1), fc(2), fc(3)].map(|id| uc(CallMode::Unconditional, id)).to_vec();
        let mut bench = start(every_ms(MissedCycle::Skip), vec![ob1(calls.clone())], natives());
        bench.run();
        let figures = bench.cpu.accounts().figures();
        let blocks: Vec<_> =
            figures.blocks.iter().map(|b| (b.block, b.execution.count(), b.execution.max() / (MS / 10))).collect();
        assert_eq!(blocks, [(fc(1), 1, 5), (fc(2), 2, 3)], "without the one within it; FC 3 is of no plugin");
        let scan = bench.cpu.last_scan();
        assert_eq!((scan.longest_plugin, scan.plugins / (MS / 10)), (Some(fc(1)), 11));
        // Not where it is not wanted.
        let accounts = AccountsConfig { blocks: false, ..AccountsConfig::default() };
        let mut bench = start(CpuConfig { accounts, ..every_ms(MissedCycle::Skip) }, vec![ob1(calls)], natives());
        bench.run();
        assert_eq!((bench.cpu.accounts().figures().blocks.len(), bench.cpu.last_scan().plugins), (0, Span::ZERO));
    });
}

/// So is what ends in STOP between two scans: an interrupt that never ends, or takes too long in a plugin.
#[test]
fn an_interrupt_between_two_scans_that_stops_the_cpu_is_in_all_accounts() {
    on_each_engine(|| {
        let cyclic = vec![CyclicInterrupt::new(35, 200 * MS)];
        let accounts = AccountsConfig { long: 100 * MS, ..AccountsConfig::default() };
        let config = CpuConfig { min_cycle: 500 * MS, watchdog: 150 * MS, cyclic, accounts, ..CpuConfig::default() };
        let endless = vec![Op::Jump(ob1_ir::Jump::Always, 0)];
        let interrupt = block(ob(35), Interface::default(), endless);
        let mut bench = start(config, vec![ob1(vec![]), interrupt], ob1_cpu::system_blocks());
        bench.run();
        let before = bench.cpu.last_scan().scan;
        bench.clock.now = at(200 * MS);
        let end = bench.cycle();
        assert_eq!((end.state, bench.events()[0], end.late), (ob1_cpu::OperatingState::Stop, 0x4568, true));
        let (scan, accounts) = (*bench.cpu.last_scan(), bench.cpu.accounts());
        let figures = accounts.figures();
        assert_eq!((scan.scan, figures.scans, figures.execution.count()), (before + 1, before + 1, before + 1));
        assert!((150 * MS..151 * MS).contains(&scan.execution()), "{scan:?}");
        assert!(figures.execution.max() >= 150 * MS);
        assert_eq!((scan.start, scan.longest_ob, scan.long_in), (at(200 * MS), 35, Some(ob(35))), "{scan:?}");
        assert!(scan.flags.watchdog && scan.flags.took_long, "{scan:?}");
        let expired = bench.cpu.diagnostics().find(|entry| entry.event.0 == 0x3501).expect("the watchdog");
        assert!((scan.start..=scan.end).contains(&expired.time), "so it can be explained");
        assert_eq!(accounts.flight().last(), Some(&scan), "recorded");
    });
}

/// The scan that ends in STOP is in all accounts, whatever led to it.
#[test]
fn the_scan_that_stops_the_cpu_is_in_all_accounts() {
    on_each_engine(|| {
        let long = |then: Vec<Op>| [busy(50_000), then].concat();
        let stop = uc(CallMode::Unconditional, BlockId::new(BlockKind::Sfc, 46));
        let endless = vec![Op::Jump(ob1_ir::Jump::Always, 0)];
        // 50,000 times round at 100 ns, or the watchdog's 150 ms.
        for (name, code, least, watchdog, event) in [
            ("watchdog", endless, 150, true, 0x4568),
            ("SFC 46", long(vec![stop]), 5, false, 0x4543),
            ("an error", long(vec![load(mw(9000))]), 5, false, 0x4562),
        ] {
            let config = CpuConfig { watchdog: 150 * MS, ..every_ms(MissedCycle::Now) };
            let mut bench = start(config, vec![ob1(code)], ob1_cpu::system_blocks());
            let end = bench.cycle();
            assert_eq!((end.state, bench.events()[0]), (ob1_cpu::OperatingState::Stop, event), "{name}");
            let (scan, figures) = (*bench.cpu.last_scan(), bench.cpu.accounts().figures());
            assert!((least * MS..(least + 1) * MS).contains(&scan.execution()), "{name}: {scan:?}");
            assert_eq!((scan.scan, figures.scans, figures.execution.count(), figures.overruns), (1, 1, 1, 1), "{name}");
            assert!(figures.execution.max() >= least * MS, "{name}");
            assert_eq!((scan.flags.took_long, scan.flags.watchdog, end.late), (true, watchdog, true), "{name}");
            assert_eq!(scan.outputs, Span::ZERO, "{name}: there were none");
            let organization = &figures.obs[0];
            assert_eq!((organization.ob, organization.runs), (1, 1), "{name}");
            assert!(organization.execution.max() >= least * MS, "{name}");
            let flight = bench.cpu.accounts().take_frozen().expect("an overrun freezes it");
            assert_eq!(flight.scans.last(), Some(&scan), "{name}: recorded");
            // And the next RUN begins with a schedule of its own.
            bench.cpu.request(ob1_cpu::Command::Run);
            bench.cycle();
            assert_eq!(bench.cpu.last_scan().lateness(), Span::ZERO, "{name}");
        }
    });
}

/// A clock that the test's module moves, too.
#[derive(Clone, Debug, Default)]
struct SharedClock(Arc<AtomicU64>);

impl SharedClock {
    fn pass(&self, time: Span) {
        self.0.fetch_add(time.nanos(), Ordering::Relaxed);
    }
}

impl Clock for SharedClock {
    fn now(&mut self) -> Instant {
        at(Span::from_nanos(self.0.load(Ordering::Relaxed)))
    }
    fn executed(&mut self, _statements: u64) {}
}

/// A module that takes its time for the process image, and then does not answer.
#[derive(Debug)]
struct Slow {
    clock: SharedClock,
    reads: bool,
    module: rack::TestModule,
}

impl Module for Slow {
    fn input_bytes(&self) -> u16 {
        2
    }
    fn output_bytes(&self) -> u16 {
        2
    }
    fn begin_scan(&mut self, _now: Instant) {}
    fn read(&mut self, at: u16, into: &mut [u8]) -> Result<(), ModuleError> {
        if !self.reads {
            return self.module.read(at, into);
        }
        self.clock.pass(7 * MS);
        Err(ModuleError::Absent)
    }
    fn write(&mut self, _at: u16, _from: &[u8]) -> Result<(), ModuleError> {
        self.clock.pass(7 * MS);
        Err(ModuleError::Absent)
    }
    fn end_scan(&mut self, _now: Instant) {}
    fn cpu_state(&mut self, _run: bool) {}
    fn poll_event(&mut self) -> Option<ModuleEvent> {
        None
    }
    fn status(&self) -> ModuleStatus {
        self.module.status()
    }
    fn record_read(&mut self, record: u8, into: &mut [u8]) -> Result<usize, ModuleError> {
        self.module.record_read(record, into)
    }
    fn record_write(&mut self, record: u8, from: &[u8]) -> Result<(), ModuleError> {
        self.module.record_write(record, from)
    }
}

/// The time after the last safe point is in the accounts, too: the process image that leads to STOP took seven
/// milliseconds.
#[test]
fn the_time_of_a_transfer_that_stops_the_cpu_is_in_all_accounts() {
    on_each_engine(|| {
        for reads in [true, false] {
            let clock = SharedClock::default();
            let slow = Slow { clock: clock.clone(), reads, module: rack::TestModule::new(2) };
            let config = CpuConfig { image_errors: ImageErrors::Each, ..every_ms(MissedCycle::Now) };
            let program = program(vec![ob1(Vec::new())], Vec::new());
            let modules: Vec<(ModuleSlot, Box<dyn Module>)> = vec![(ModuleSlot::new("slow", 0), Box::new(slow))];
            let mut cpu = Cpu::new(config, &program, Vec::new(), modules, common::engine()).expect("loads");
            cpu.request(Command::Run);
            let end = cpu.cycle(&mut clock.clone());
            assert_eq!((end.state, end.late), (OperatingState::Stop, true), "OB 85 is not loaded");
            let (scan, figures) = (*cpu.last_scan(), cpu.accounts().figures());
            assert_eq!((scan.execution(), scan.end), (7 * MS, at(7 * MS)), "{scan:?}");
            assert_eq!(scan.outputs, if reads { Span::ZERO } else { 7 * MS }, "{scan:?}");
            assert_eq!((figures.scans, figures.overruns, figures.execution.max()), (1, 1, 7 * MS));
        }
    });
}
