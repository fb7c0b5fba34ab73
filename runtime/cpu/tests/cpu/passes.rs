//! Program status: what is seen of one pass through a block, on every engine.

use ob1_cpu::{Command, Job, PassJob, Width};
use ob1_model::{BlockId, PASS_JOBS, Pass, PassEnd, PassLine, PassOrder};
use ob1_time::Span;

use crate::common;
use crate::common::window::Looker;
use crate::common::{Bench, MS, fb, fc, on_each_engine};

const FC0: u16 = 1;
const RLO: u16 = 1 << 1;
const STA: u16 = 1 << 2;
const OV: u16 = 1 << 5;
const OS: u16 = 1 << 4;
const CC0: u16 = 1 << 6;

fn order(block: BlockId) -> PassOrder {
    PassOrder { block, from: None, db: 0, first: 0, count: 512, wait: Span::from_secs(2).nanos(), before: false }
}

/// Runs cycles until the job comes back.
fn pass(bench: &mut Bench, looker: &mut Looker, order: PassOrder) -> Pass {
    looker.link.hand(PassJob::new(1, order)).expect("room");
    bench.clock.now += 100 * MS;
    for _ in 0..30 {
        bench.cycle();
        if let Some(Job::Pass(job)) = looker.link.take() {
            return job.into_pass();
        }
        bench.clock.now += 100 * MS;
    }
    panic!("it does not come back");
}

fn watched(source: &str, keys: &[&str], test: impl Fn(&mut Bench, &mut Looker)) {
    on_each_engine(|| {
        let mut bench = common::source::bench(source, keys);
        let mut looker = Looker::of(&mut bench.cpu).expect("the first");
        bench.run();
        test(&mut bench, &mut looker);
    });
}

/// How often each statement ran.
fn times(pass: &Pass) -> Vec<u32> {
    pass.lines.iter().take(pass.statements as usize).map(|line| line.times).collect()
}

fn once(status: u16, accus: [u32; 2]) -> PassLine {
    PassLine { times: 1, status, accus, ..PassLine::default() }
}

#[test]
fn each_line_shows_the_registers_behind_its_statement() {
    let source = "ORGANIZATION_BLOCK OB 1\nBEGIN\nUN M 0.0;\n= M 0.1;\nL 5;\nL 32765;\n+I;\nLAR1 P#M 3.0;\nAUF DB 7;\n\
        T MW 2;\nSPA a;\nL 99;\na: U M 0.1;\nEND_ORGANIZATION_BLOCK\n\
        DATA_BLOCK DB 7\nSTRUCT\n a : INT;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n";
    watched(source, &[], |bench, looker| {
        let pass = pass(bench, looker, order(common::ob(1)));
        assert_eq!((pass.end, pass.ob, pass.caller, pass.statements, pass.cut), (PassEnd::Whole, 1, None, 12, 0));
        let sum = 0x8002;
        let behind = RLO | STA | OV | OS | CC0;
        let ar1 = 0x8300_0018;
        let addressed = PassLine { addresses: [ar1, 0], ..once(behind, [sum, 5]) };
        let opened = PassLine { blocks: [7, 0], ..addressed };
        let expected = [
            once(FC0 | RLO, [0, 0]),
            once(RLO | STA, [0, 0]),
            once(RLO | STA, [5, 0]),
            once(RLO | STA, [32765, 5]),
            once(behind, [sum, 5]),
            addressed,
            opened,
            opened,
            opened,
            PassLine::default(),
            PassLine { status: behind | FC0, ..opened },
            PassLine { status: behind & !OS, ..opened },
        ];
        assert_eq!(pass.lines[..12], expected);
        assert!(pass.lines[12..].iter().all(|line| *line == PassLine::default()));
    });
}

#[test]
fn a_line_of_a_loop_shows_its_last_execution_and_no_line_an_old_value() {
    let source = "FUNCTION FC 5 : VOID\nBEGIN\nL 3;\nn: T MW 10;\nL MW 12;\n+ 1;\nT MW 12;\nL MW 10;\nLOOP n;\nU M 0.0;\nSPB e;\nL 7;\n\
        e: NOP 0;\nEND_FUNCTION\nORGANIZATION_BLOCK OB 1\nBEGIN\nCALL FC 5;\nEND_ORGANIZATION_BLOCK\n";
    watched(source, &[], |bench, looker| {
        let one = pass(bench, looker, order(fc(5)));
        assert_eq!(times(&one), [1, 3, 3, 3, 3, 3, 3, 1, 1, 1, 1, 1]);
        assert_eq!((one.lines[1].accus[0], one.lines[6].accus[0], one.lines[9].accus[0]), (1, 0, 7));
        assert_eq!((one.ob, one.caller), (1, Some((common::ob(1), 0))));
        bench.set_m(0, 0, true);
        let other = pass(bench, looker, order(fc(5)));
        assert_eq!(other.lines[9], PassLine::default(), "jumped over");
        // A window of it.
        let few = pass(bench, looker, PassOrder { first: 6, count: 2, ..order(fc(5)) });
        assert_eq!(few.lines.iter().map(|line| line.times).collect::<Vec<_>>(), [3, 1]);
        // The registers in front: `L 7` was jumped over, behind it is what the jump found.
        let both = pass(bench, looker, PassOrder { before: true, ..order(fc(5)) });
        let before = |at: usize| (both.before[at].accus[0], both.before[at].times);
        assert_eq!(
            [before(1), before(3), before(9), before(10)],
            [(1, 3), (both.lines[2].accus[0], 3), (0, 0), (0, 1)]
        );
    });
}

#[test]
fn a_call_shows_what_it_has_left() {
    let source = "FUNCTION FC 5 : VOID\nVAR_INPUT\n a : INT;\nEND_VAR\nBEGIN\nL #a;\nL 100;\n+I;\nSET;\nSAVE;\nEND_FUNCTION\n\
        FUNCTION FC 6 : VOID\nBEGIN\nL MW 20;\nCALL FC 5 (a := 11);\nU BIE;\n= M 0.7;\nBEB;\nL 1;\nEND_FUNCTION\n\
        ORGANIZATION_BLOCK OB 1\nBEGIN\nCALL FC 6;\nCALL FC 5 (a := 3);\nEND_ORGANIZATION_BLOCK\n";
    watched(source, &[], |bench, looker| {
        let outer = pass(bench, looker, order(fc(6)));
        assert_eq!(times(&outer), [1, 1, 1, 1, 1, 0, 0]);
        assert_eq!(outer.lines[1].accus[0], 111);
        assert_eq!(outer.lines[2].status & RLO, RLO);
        // The first pass of a scan is that from FC 6.
        let first = pass(bench, looker, order(fc(5)));
        assert_eq!((first.lines[2].accus[0], first.caller), (111, Some((fc(6), 1))));
        // Both at once.
        let called = PassOrder { from: Some(fc(6)), ..order(fc(5)) };
        let from = pass(bench, looker, called);
        assert_eq!(from.lines[2].accus[0], 111);
        let from_ob = pass(bench, looker, PassOrder { from: Some(common::ob(1)), ..order(fc(5)) });
        assert_eq!(from_ob.end, PassEnd::Whole);
        let never = pass(bench, looker, PassOrder { from: Some(fc(5)), ..order(fc(6)) });
        assert_eq!((never.end, times(&never)), (PassEnd::NotCalled, vec![0; 7]));
    });
}

#[test]
fn a_pass_through_one_instance() {
    let source = "FUNCTION_BLOCK FB 20\nVAR_INPUT\n a : INT;\nEND_VAR\nBEGIN\nL #a;\nNOP 0;\nEND_FUNCTION_BLOCK\n\
        DATA_BLOCK DB 21\nFB 20\nBEGIN\nEND_DATA_BLOCK\nDATA_BLOCK DB 22\nFB 20\nBEGIN\nEND_DATA_BLOCK\n\
        ORGANIZATION_BLOCK OB 1\nBEGIN\nCALL FB 20, DB 21 (a := 1);\nCALL FB 20, DB 22 (a := 2);\nEND_ORGANIZATION_BLOCK\n";
    watched(source, &[], |bench, looker| {
        for (db, a) in [(0, 1), (21, 1), (22, 2)] {
            let pass = pass(bench, looker, PassOrder { db, ..order(fb(20)) });
            assert_eq!((pass.end, pass.lines[0].accus[0]), (PassEnd::Whole, a), "DB {db}");
            assert_eq!(pass.lines[0].blocks[1], 20 + a as u16);
        }
        let none = pass(bench, looker, PassOrder { db: 23, ..order(fb(20)) });
        assert_eq!((none.end, times(&none)), (PassEnd::NotCalled, vec![0; 3]));
    });
}

#[test]
fn what_cannot_be_watched_is_told() {
    let source = "FUNCTION FC 9 : VOID\nBEGIN\nNOP 0;\nEND_FUNCTION\nORGANIZATION_BLOCK OB 1\nBEGIN\nL MW 0;\nL 0;\n<>I;\nSPB f;\nBEA;\n\
        f: L DBW 5000;\nNOP 1;\nEND_ORGANIZATION_BLOCK\n";
    watched(source, &[], |bench, looker| {
        assert_eq!(pass(bench, looker, order(fc(77))).end, PassEnd::NoBlock);
        assert_eq!(pass(bench, looker, order(fc(9))).end, PassEnd::NotCalled);
        // More jobs than there are places, and one that is given up.
        for id in 0..=PASS_JOBS as u64 {
            looker.link.hand(PassJob::new(id, order(fc(9)))).expect("room");
        }
        bench.cycle();
        let Some(Job::Pass(full)) = looker.link.take() else { panic!("one too many") };
        assert_eq!((full.id(), full.pass().end), (PASS_JOBS as u64, PassEnd::Full));
        looker.link.forget(0).expect("room");
        bench.cycle();
        let Some(Job::Pass(gone)) = looker.link.take() else { panic!("given up") };
        assert_eq!(gone.id(), 0);
        let place = pass(bench, looker, order(common::ob(1)));
        assert_eq!(place.end, PassEnd::Whole, "its place is free again");
        looker.link.forget(1).expect("room");
        bench.cycle();
        // The CPU goes to STOP in the pass: what ran until then is there.
        bench.set(0, Width::Word, 1);
        looker.link.hand(PassJob::new(8, order(common::ob(1)))).expect("room");
        bench.clock.now += 100 * MS;
        let mut stopped = None;
        for _ in 0..6 {
            bench.set(0, Width::Word, 1);
            bench.cycle();
            if let Some(Job::Pass(job)) = looker.link.take()
                && job.id() == 8
            {
                stopped = Some(job.into_pass());
            }
            bench.clock.now += 100 * MS;
            if bench.cpu.state() == ob1_cpu::OperatingState::Stop && stopped.is_none() {
                bench.cpu.request(Command::Run);
            }
        }
        let stopped = stopped.expect("it comes back");
        assert_eq!((stopped.end, &times(&stopped)[..5]), (PassEnd::Stopped, &[1, 1, 1, 1, 0][..]));
    });
}

/// What takes too long without machine code is not watched; what can only be recorded in part says so.
#[test]
fn the_load_of_a_job_is_bounded() {
    let source =
        "ORGANIZATION_BLOCK OB 1\nBEGIN\nL 5000;\nn: T MW 0;\nL MW 0;\nLOOP n;\nL 1;\nEND_ORGANIZATION_BLOCK\n";
    on_each_engine(|| {
        let config = ob1_cpu::CpuConfig { test_load: 0, ..ob1_cpu::CpuConfig::default() };
        let mut bench = common::source::bench_with(source, &[], config, vec![]);
        let mut looker = Looker::of(&mut bench.cpu).expect("the first");
        bench.run();
        let pass = pass(&mut bench, &mut looker, order(common::ob(1)));
        match bench.cpu.engine() {
            "native" | "native, fast tier" => {
                assert_eq!((pass.end, pass.lines[0].times), (PassEnd::TooLong, 0));
                assert!(pass.cut > 15_000, "{}", pass.cut);
            }
            _ => {
                assert_eq!((pass.end, pass.cut, pass.lines[0].times), (PassEnd::Whole, 1000, 1));
                assert_eq!(pass.lines[4].times, 0);
            }
        }
    });
}

#[test]
fn behind_an_end_the_chain_has_ended() {
    let conditional = "FUNCTION FC 1 : VOID\nBEGIN\nSET;\n= M 0.0;\nU M 0.0;\nO;\nU M 0.1;\nBEB;\nL 1;\nEND_FUNCTION\n\
        FUNCTION FC 2 : VOID\nBEGIN\nL 32767;\nL 1;\n+I;\nU M 0.0;\nSPBN no;\nBEA;\nno: NOP 0;\nEND_FUNCTION\n\
        ORGANIZATION_BLOCK OB 1\nBEGIN\nCALL FC 1;\nCALL FC 2;\nEND_ORGANIZATION_BLOCK\n";
    watched(conditional, &[], |bench, looker| {
        let seen = pass(bench, looker, order(fc(1)));
        assert_eq!((seen.lines[5].times, seen.lines[5].status), (1, RLO | STA), "BEB");
        assert_eq!(seen.lines[6].times, 0);
        let seen = pass(bench, looker, order(fc(2)));
        assert_eq!((seen.lines[5].times, seen.lines[5].status & !CC0), (1, RLO | STA | OV), "BEA clears OS");
    });
}

#[test]
fn the_jump_that_a_list_takes_has_run() {
    let source = "FUNCTION FC 3 : VOID\nBEGIN\nL 1;\nSPL over;\nSPA a;\nSPA b;\nover: SPA e;\na: L 7;\nb: L 5;\ne: NOP 0;\n\
        END_FUNCTION\nORGANIZATION_BLOCK OB 1\nBEGIN\nCALL FC 3;\nEND_ORGANIZATION_BLOCK\n";
    watched(source, &[], |bench, looker| {
        let seen = pass(bench, looker, order(fc(3)));
        assert_eq!(times(&seen), [1, 1, 0, 1, 0, 0, 1, 1, 1]);
        assert_eq!(seen.lines[3].accus[0], 1);
    });
}
