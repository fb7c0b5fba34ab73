//! Timers and counters in virtual time.

use ob1_cpu::{Cell, Width};
use ob1_ir::{BitTest, Logic, Number, Op};
use ob1_model::TimerKind;
use ob1_time::Span;

use crate::common::*;

const T: Number = Number::Fixed(5);

/// M 0.0 starts, M 0.1 resets, M 0.2 enables; MB 1 bit 0 the output, MW 2 `L T`, MW 4 `LC T`.
fn timer(kind: TimerKind) -> Bench {
    let test = BitTest::Timer(T);
    Bench::new(&program(
        vec![ob1(vec![
            u(m(0, 2)),
            Op::EnableTimer(T),
            u(m(0, 0)),
            c(0x0010), // S5T#100MS
            Op::StartTimer(kind, T),
            u(m(0, 1)),
            Op::ResetTimer(T),
            Op::Scan { logic: Logic::And, negate: false, test },
            Op::Assign(m(1, 0)),
            Op::LoadTimer(T),
            transfer(mw(2)),
            Op::LoadTimerBcd(T),
            transfer(mw(4)),
        ])],
        Vec::new(),
    ))
}

const S: u8 = 1;
const R: u8 = 2;
const F: u8 = 4;

/// Rows: time in ms, inputs (S start, R reset, F enable), output, remaining tens of milliseconds.
#[track_caller]
fn play(kind: TimerKind, rows: &[(u64, u8, bool, u32)]) {
    let mut bench = timer(kind);
    bench.clock.per_statement = Span::ZERO;
    bench.run();
    for (ms, inputs, output, left) in rows {
        bench.clock.now = at(*ms * MS);
        bench.set(0, Width::Byte, u32::from(*inputs));
        bench.run();
        assert_eq!((bench.m(1, 0), bench.mw(2)), (*output, *left), "{kind:?} at {ms} ms");
        assert_eq!(bench.mw(4) & 0xFFF, ((left / 10 % 10) << 4) | (left % 10), "BCD at {ms} ms");
    }
}

#[test]
fn pulse() {
    on_each_engine(|| {
        play(
            TimerKind::Pulse,
            &[
                (10, 0, false, 0),
                (20, S, true, 10),
                (60, S, true, 6),
                (119, S, true, 1),
                (120, S, false, 0),
                (130, 0, false, 0),
                (200, S, true, 10),
                (250, 0, false, 5),
                (260, 0, false, 5),
                (300, S, true, 10),
                (310, S | R, false, 0),
                (320, S, false, 0),
            ],
        );
    });
}

#[test]
fn extended_pulse_runs_on_and_restarts() {
    on_each_engine(|| {
        play(
            TimerKind::ExtendedPulse,
            &[
                (20, S, true, 10),
                (40, 0, true, 8),
                (60, S, true, 10),
                (159, 0, true, 1),
                (160, 0, false, 0),
                (170, S, true, 10),
                (180, R, false, 0),
            ],
        );
    });
}

#[test]
fn on_delay() {
    on_each_engine(|| {
        play(
            TimerKind::OnDelay,
            &[
                (20, S, false, 10),
                (119, S, false, 1),
                (120, S, true, 0),
                (500, S, true, 0),
                (510, 0, false, 0),
                (600, S, false, 10),
                (650, 0, false, 5),
                (800, 0, false, 5),
                (900, S, false, 10),
                (1000, S, true, 0),
                (1010, S | R, false, 0),
                (1020, S, false, 0),
            ],
        );
    });
}

#[test]
fn retentive_on_delay() {
    on_each_engine(|| {
        play(
            TimerKind::RetentiveOnDelay,
            &[
                (20, S, false, 10),
                (40, 0, false, 8),
                (60, S, false, 10),
                (70, 0, false, 9),
                (160, 0, true, 0),
                (170, S, true, 0),
                (500, 0, true, 0),
                (510, R, false, 0),
                (520, 0, false, 0),
                (530, S, false, 10),
            ],
        );
    });
}

#[test]
fn off_delay() {
    on_each_engine(|| {
        play(
            TimerKind::OffDelay,
            &[
                (10, 0, false, 0),
                (20, S, true, 0),
                (500, S, true, 0),
                (510, 0, true, 10),
                (560, 0, true, 5),
                (570, S, true, 0),
                (600, 0, true, 10),
                (700, 0, false, 0),
                (710, S, true, 0),
                (720, 0, true, 10),
                (730, R, false, 0),
            ],
        );
    });
}

/// `SA` with the RLO from 0 to 1 while the time runs. STEP 7's manuals for ladder and for statements do not say the
/// same: reset, or stopped; and both are one statement in machine code (SA T). **Decided**: the timer is reset, as
/// the ladder manual says of S_OFFDT and of the coil SF. What a program can see of it is `L T` and `LC T` alone,
/// while the RLO stays 1: 0 here, the time that was left if it stopped (as awlsim has it). The output is 1 in both
/// readings, and the next edge to 0 begins the whole time. A rest that does not run would mislead who shows it as
/// the time that is left.
#[test]
fn an_off_delay_that_begins_again_while_it_runs_is_reset() {
    on_each_engine(|| {
        let runs = [(10, S, true, 0), (20, 0, true, 10), (60, 0, true, 6)];
        let again = [(70, S, true, 0), (300, S, true, 0), (310, 0, true, 10), (400, 0, true, 1), (410, 0, false, 0)];
        play(TimerKind::OffDelay, &[&runs[..], &again].concat());
    });
}

#[test]
fn enable_starts_again_without_an_edge_of_the_start() {
    on_each_engine(|| {
        play(
            TimerKind::Pulse,
            &[
                (20, S, true, 10),
                (50, S | F, true, 10),
                (60, S | F, true, 9),
                (70, S, true, 8),
                (80, S | F, true, 10),
                (180, S, false, 0),
                (190, S | F, true, 10),
            ],
        );
    });
}

#[test]
fn a_loop_on_a_timer_ends_in_virtual_time() {
    on_each_engine(|| {
        let mut bench = Bench::new(&program(
            vec![ob1(vec![
                Op::SetRlo,
                c(0x0005),
                Op::StartTimer(TimerKind::OnDelay, T),
                Op::Scan { logic: Logic::And, negate: true, test: BitTest::Timer(T) },
                Op::Jump(ob1_ir::Jump::IfRlo, 3),
            ])],
            Vec::new(),
        ));
        bench.run();
        assert!((50 * MS..51 * MS).contains(&bench.clock.now.since_start()), "{}", bench.clock.now);
    });
}

#[test]
fn counters() {
    on_each_engine(|| {
        let z = Number::Fixed(3);
        let test = BitTest::Counter(z);
        let mut bench = Bench::new(&program(
            vec![ob1(vec![
                u(m(0, 4)),
                Op::EnableCounter(z),
                u(m(0, 0)),
                Op::CountUp(z),
                u(m(0, 1)),
                Op::CountDown(z),
                u(m(0, 2)),
                c(0x998),
                Op::SetCounter(z),
                u(m(0, 3)),
                Op::ResetCounter(z),
                Op::LoadCounter(z),
                transfer(mw(2)),
                Op::LoadCounterBcd(z),
                transfer(mw(4)),
                Op::Scan { logic: Logic::And, negate: false, test },
                Op::Assign(m(1, 0)),
            ])],
            Vec::new(),
        ));
        bench.run();
        let (up, down, set, reset, enable) = (1, 2, 4, 8, 16);
        for (inputs, value) in [
            (0, 0),
            (down, 0),
            (0, 0),
            (up, 1),
            (up, 1),
            (0, 1),
            (up | down, 1),
            (0, 1),
            (set, 998),
            (set | up, 999),
            (set, 999),
            (set | up, 999),
            (set | up | enable, 998),
            (down, 997),
            (reset, 0),
            (reset | up, 0),
        ] {
            bench.set(0, Width::Byte, inputs);
            bench.run();
            assert_eq!((bench.mw(2), bench.m(1, 0)), (value, value > 0), "inputs {inputs:05b}");
            assert_eq!(bench.mw(4), (value / 100) << 8 | (value / 10 % 10) << 4 | (value % 10));
        }
        assert_eq!(bench.cpu.read(Cell::Counter(3), Width::Word), Ok(0));
    });
}
