//! The stacks of a CPU in STOP, on every engine.

use ob1_cpu::{Command, DebugJob, Job, OperatingState, Width};
use ob1_model::{DebugAnswer, DebugEnd, DebugOrder};

use ob1_time::Span;

use crate::common::window::Looker;
use crate::common::{self, Bench, fb, fc, ob, on_each_engine};

/// FC 5 writes to a data block that is not there; with OB 121 the program goes on until MW 2 is set.
const PROGRAM: &str = "FUNCTION FC 5 : VOID\nVAR_TEMP\n x : DWORD;\nEND_VAR\nBEGIN\nL DW#16#55AA55AA;\nT #x;\n\
    L 3;\nL 4;\nAUF DB [MW 100];\nT DBW 0;\nL 5;\nEND_FUNCTION\n\
    FUNCTION_BLOCK FB 6\nVAR_INPUT\n a : INT;\nEND_VAR\nVAR_TEMP\n y : INT;\nEND_VAR\nBEGIN\nL #a;\nT #y;\n\
    CALL FC 5;\nL 9;\nEND_FUNCTION_BLOCK\n\
    FUNCTION_BLOCK FB 7\nVAR\n inner : FB 6;\nEND_VAR\nBEGIN\nCALL #inner (a := 77);\nEND_FUNCTION_BLOCK\n\
    DATA_BLOCK DB 7\nFB 7\nBEGIN\nEND_DATA_BLOCK\nDATA_BLOCK DB 9\nSTRUCT\n w : WORD;\nEND_STRUCT\nBEGIN\nEND_DATA_BLOCK\n\
    ORGANIZATION_BLOCK OB 100\nBEGIN\nL 9;\nT MW 100;\nEND_ORGANIZATION_BLOCK\n\
    ORGANIZATION_BLOCK OB 1\nBEGIN\nAUF DB 9;\nCALL FB 7, DB 7;\nL 1;\nEND_ORGANIZATION_BLOCK\n";

fn stack(bench: &mut Bench, looker: &mut Looker, level: u8) -> DebugAnswer {
    looker.link.hand(DebugJob::new(1, DebugOrder::Stack { level })).expect("room");
    bench.cycle();
    loop {
        if let Some(Job::Debug(job)) = looker.link.take() {
            return job.into_answer();
        }
    }
}

fn stopped(source: &str, number: u32) -> (Bench, Looker) {
    let mut bench = common::source::bench(source, &[]);
    let looker = Looker::of(&mut bench.cpu).expect("the first");
    bench.run();
    bench.clock.per_statement = Span::from_nanos(100);
    bench.set(100, Width::Word, number);
    bench.cycle();
    (bench, looker)
}

#[test]
fn every_block_that_was_under_way_is_shown_with_its_local_data() {
    on_each_engine(|| {
        let (mut bench, mut looker) = stopped(PROGRAM, 99);
        let answer = stack(&mut bench, &mut looker, 0);
        assert_eq!(answer.end, DebugEnd::Stopped);
        let way: Vec<_> = answer.held.stack.iter().map(|at| (at.block, at.statement, at.blocks, at.ob)).collect();
        let expected = [(fc(5), 4, [7, 7], 1), (fb(6), 2, [7, 7], 1), (fb(7), 0, [0, 7], 1), (ob(1), 1, [9, 0], 1)];
        assert_eq!(way, expected);
        assert_eq!((answer.held.accus[..2].to_vec(), answer.held.stack[0].priority), (vec![4, 3], 1));
        assert_eq!(answer.held.start[..3], [0x11, 3, 1], "the start information of OB 1");
        assert_eq!(answer.held.local, [0x55, 0xAA, 0x55, 0xAA]);
        assert_eq!(stack(&mut bench, &mut looker, 1).held.local, [0, 77], "of its caller");
        let outermost = stack(&mut bench, &mut looker, 3).held.local;
        assert_eq!(outermost[..3], [0x11, 3, 1], "an organization block begins with its start information");
        assert_eq!(stack(&mut bench, &mut looker, 4).held.local, []);

        bench.cpu.request(Command::Warm);
        bench.cycle();
        assert_eq!(bench.cycle().state, OperatingState::Run);
        let answer = stack(&mut bench, &mut looker, 0);
        assert_eq!((answer.end, answer.held.stack.len()), (DebugEnd::Runs, 0));
        bench.cpu.request(Command::Stop);
        bench.cycle();
        let answer = stack(&mut bench, &mut looker, 0);
        assert_eq!((answer.end, answer.held.stack.len()), (DebugEnd::Stopped, 0), "between two scans");
    });
}

#[test]
fn an_error_organization_block_that_stops_stands_above_what_it_interrupted() {
    let source =
        format!("{PROGRAM}ORGANIZATION_BLOCK OB 121\nBEGIN\nL 8;\nCALL SFC 46;\nL 2;\nEND_ORGANIZATION_BLOCK\n");
    on_each_engine(|| {
        let (mut bench, mut looker) = stopped(&source, 99);
        let answer = stack(&mut bench, &mut looker, 0);
        let way: Vec<_> = answer.held.stack.iter().map(|at| (at.block, at.statement, at.ob)).collect();
        assert_eq!(way, [(ob(121), 1, 121), (fc(5), 4, 1), (fb(6), 2, 1), (fb(7), 0, 1), (ob(1), 1, 1)]);
        assert_eq!(answer.held.accus[0], 8);
    });
}

/// A loop that does not end: the cycle monitoring stops it at its jump.
#[test]
fn a_scan_that_took_too_long_shows_its_loop() {
    let source = "FUNCTION FC 5 : VOID\nBEGIN\nn: L 1;\nL 2;\nSPA n;\nEND_FUNCTION\n\
        ORGANIZATION_BLOCK OB 1\nBEGIN\nCALL FC 5;\nEND_ORGANIZATION_BLOCK\n";
    on_each_engine(|| {
        let mut bench = common::source::bench(source, &[]);
        let mut looker = Looker::of(&mut bench.cpu).expect("the first");
        bench.clock.per_statement = Span::from_nanos(100);
        bench.cpu.request(Command::Warm);
        bench.cycle();
        bench.cycle();
        let answer = stack(&mut bench, &mut looker, 0);
        let way: Vec<_> = answer.held.stack.iter().map(|at| (at.block, at.statement)).collect();
        assert_eq!(way, [(fc(5), 0), (ob(1), 0)]);
    });
}
