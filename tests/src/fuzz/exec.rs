//! Every program that compiles can run: some thousand statements on the reference engine and on its plain form, with
//! the same memory after each cycle.

use ob1_cpu::{Attention, Clock, Command, Cpu, CpuConfig, OperatingState};
use ob1_ir::Program;
use ob1_stl::{Mnemonics, Options, Source, compile};
use ob1_time::{Instant, Span};

/// Approximate number of statements a program may execute: a loop is stopped at a safe point.
const STATEMENTS: u64 = 5_000;
const CYCLES: usize = 3;

/// Compiles, and runs the program if this succeeds.
pub fn run(data: &[u8]) {
    let options = Options { mnemonics: Mnemonics::Auto, ..Options::default() };
    let output = compile(&[Source::new("fuzz.awl", data)], &super::stl::LIBRARY, &options);
    if output.is_good() {
        both(&output.program);
    }
}

/// Runs a program both ways.
pub(super) fn both(program: &Program) {
    let config = CpuConfig {
        watchdog: Span::ZERO,
        min_cycle: Span::MILLISECOND,
        peripheral_from_image: true,
        db_pool_bytes: 4_096,
        accumulators: if program.blocks.len().is_multiple_of(2) { 4 } else { 2 },
        ..CpuConfig::default()
    };
    let fast = Cpu::new(config.clone(), program, ob1_cpu::system_blocks(), Vec::new(), ob1_cpu::engine::REFERENCE);
    let plain = Cpu::new(config, program, ob1_cpu::system_blocks(), Vec::new(), ob1_cpu::engine::PLAIN);
    let (Ok(mut fast), Ok(mut plain)) = (fast, plain) else { return };
    let (mut of_fast, mut of_plain) = (Budget::of(&fast), Budget::of(&plain));
    fast.request(Command::Cold);
    plain.request(Command::Cold);
    for _ in 0..CYCLES {
        let (end, other) = (fast.cycle(&mut of_fast), plain.cycle(&mut of_plain));
        assert_eq!(end.state, other.state);
        assert_eq!(fast.bit_memory(), plain.bit_memory());
        assert_eq!(of_fast.now, of_plain.now);
        for db in &program.data {
            assert_eq!(fast.data_block(db.number), plain.data_block(db.number));
        }
        if end.state == OperatingState::Stop {
            return;
        }
        of_fast.now = end.next_deadline;
        of_plain.now = other.next_deadline;
    }
}

/// Virtual time, and a limited number of statements.
struct Budget {
    now: Instant,
    left: u64,
    attention: Attention,
}

impl Budget {
    fn of(cpu: &Cpu) -> Self {
        Self { now: Instant::START, left: STATEMENTS, attention: cpu.attention() }
    }
}

impl Clock for Budget {
    fn now(&mut self) -> Instant {
        self.now
    }

    fn executed(&mut self, statements: u64) {
        self.now += statements * Span::from_nanos(100);
        self.left = self.left.saturating_sub(statements);
        if self.left == 0 {
            self.attention.halt();
        }
    }
}
