//! The deepest nesting of every kind at once, on a stack as large as the CPU says: priority classes, errors in each,
//! OB 82, OB 80 and OB 88 on top, and in every one of them as many plugin blocks as may be nested, each with all the
//! stack it may use.
#![allow(clippy::disallowed_methods, clippy::disallowed_types, reason = "a thread with a stack of a given size")]

use std::hint::black_box;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock};

use ob1_cpu::{
    Abort, Attention, Clock, Command, Cpu, CpuConfig, CyclicInterrupt, Family, Module, ModuleSlot, NativeBlock,
    NativeContext, OperatingState, PLUGIN_STACK_BYTES, Refused, TimeOfDay,
};
use ob1_ir::{Arg, Call, CallMode, Op, Target};
use ob1_model::moment::Moment;
use ob1_model::{BlockId, BlockKind, FaultKind, Interface};
use ob1_std::services::Period;
use ob1_time::Instant;

use crate::common;
use crate::common::rack::TestModule;
use crate::common::{MS, block, call, fc, ob, on_each_engine, program};

/// Seconds at which the interrupts come: OB 10, OB 20 to 23, OB 30 to 38.
const TIMES_MS: [u64; 14] =
    [500, 1000, 2000, 3000, 4000, 65_000, 66_000, 67_000, 68_000, 69_000, 70_000, 71_000, 72_000, 73_000];
/// When the cycle is too long.
const WATCHDOG_MS: u64 = 100_000;

/// What the deepest block does next.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Next {
    /// Time continues to here.
    Time(u64),
    Diagnosis,
    Error,
}

#[derive(Debug, Default)]
struct Shared {
    now_ms: AtomicU64,
    attention: OnceLock<Attention>,
    next: Mutex<Vec<Next>>,
    /// Organization blocks whose deepest block has run, outermost first.
    seen: Mutex<Vec<u16>>,
    /// The lowest address of a block's stack.
    lowest: AtomicUsize,
    depth: AtomicUsize,
}

struct SharedClock(Arc<Shared>);

impl Clock for SharedClock {
    fn now(&mut self) -> Instant {
        Instant::from_millis(self.0.now_ms.load(Ordering::Relaxed))
    }
    fn executed(&mut self, _statements: u64) {}
}

/// A plugin block that calls itself as deep as it may, and at the bottom does what comes next.
struct Deep {
    interface: Interface,
    shared: Arc<Shared>,
    most: usize,
}

impl Deep {
    fn bottom(&self, cx: &mut dyn NativeContext) -> Result<(), Abort> {
        let ob = cx.ob_info().number;
        self.shared.seen.lock().expect("one thread").push(ob);
        if ob != 121 {
            return cx.raise_fault(FaultKind::AreaLengthRead, 1);
        }
        let next = self.shared.next.lock().expect("one thread").pop();
        match next {
            Some(Next::Time(ms)) => {
                self.shared.now_ms.store(ms, Ordering::Relaxed);
                self.shared.attention.get().expect("set").attend();
                cx.attend()
            }
            Some(Next::Diagnosis) => match cx.diagnostic_interrupt(256, &[1]) {
                Err(Refused::Abort) => Err(Abort),
                other => {
                    other.expect("the module is there");
                    Ok(())
                }
            },
            Some(Next::Error) => cx.raise_fault(FaultKind::AreaLengthRead, 2),
            None => Ok(()),
        }
    }
}

impl NativeBlock for Deep {
    fn id(&self) -> BlockId {
        fc(100)
    }
    fn name(&self) -> &str {
        "DEEP"
    }
    fn interface(&self) -> &Interface {
        &self.interface
    }
    fn is_plugin(&self) -> bool {
        true
    }
    fn reset(&self) {}
    fn call(&self, cx: &mut dyn NativeContext) -> Result<(), Abort> {
        // Nearly all it may use; the rest is for this function itself.
        let mut room = [0u8; PLUGIN_STACK_BYTES - 2048];
        black_box(&mut room);
        self.shared.lowest.fetch_min(room.as_ptr() as usize, Ordering::Relaxed);
        let depth = self.shared.depth.load(Ordering::Relaxed);
        if depth + 1 < self.most {
            self.shared.depth.store(depth + 1, Ordering::Relaxed);
            let called = cx.call_block(fc(100), 0, &[]);
            self.shared.depth.store(depth, Ordering::Relaxed);
            return match called {
                Err(Refused::Abort) => Err(Abort),
                other => {
                    other.expect("it may be called");
                    Ok(())
                }
            };
        }
        // Each organization block counts from 0 again.
        self.shared.depth.store(0, Ordering::Relaxed);
        let result = self.bottom(cx);
        self.shared.depth.store(depth, Ordering::Relaxed);
        black_box(&mut room);
        result
    }
}

fn delay(ob: u32, ms: u32) -> Op {
    let args = vec![Arg::Const(ob), Arg::Const(ms), Arg::Const(0), Arg::Operand(common::mw(0))];
    let target = Target::Block(BlockId::new(BlockKind::Sfc, 32));
    Op::Call(Box::new(Call { mode: CallMode::Call, target, instance: None, args }))
}

#[test]
fn the_deepest_nesting_fits_the_stack() {
    on_each_engine(|| {
        let shared = Arc::new(Shared { lowest: AtomicUsize::new(usize::MAX), ..Shared::default() });
        let mut config = CpuConfig {
            watchdog: WATCHDOG_MS * MS,
            // The minute of OB 10 is full when its time comes.
            date_at_start: (60_000 * MS - TIMES_MS[0] * MS).nanos(),
            time_of_day: vec![TimeOfDay {
                ob: 10,
                start: Moment::from_ms(60_000).expect("a moment"),
                period: Period::Once,
            }],
            ..CpuConfig::of(Family::S7_400)
        };
        for (ob, ms) in (30..39).zip(&TIMES_MS[5..]) {
            let phase = (ms - 60_000) * MS;
            config.cyclic.push(CyclicInterrupt { phase, ..CyclicInterrupt::new(ob, 60_000 * MS) });
        }
        let mut next: Vec<Next> = TIMES_MS.iter().map(|ms| Next::Time(*ms)).collect();
        next.extend([Next::Diagnosis, Next::Time(WATCHDOG_MS + 1000), Next::Error, Next::Error]);
        next.reverse();
        *shared.next.lock().expect("one thread") = next;

        let interrupts: Vec<u16> = std::iter::once(10).chain(20..24).chain(30..39).collect();
        let deep = || call(fc(100), vec![]);
        let mut first: Vec<Op> = (20..24).zip(&TIMES_MS[1..5]).map(|(ob, ms)| delay(ob, *ms as u32)).collect();
        first.push(deep());
        let mut blocks = vec![block(ob(1), Interface::default(), first)];
        let others = interrupts.iter().copied().chain([80, 82, 88, 121]);
        blocks.extend(others.map(|number| block(ob(number), Interface::default(), vec![deep()])));
        let most = usize::from(config.nesting_depth);
        let native = Deep { interface: Interface::default(), shared: Arc::clone(&shared), most: most - 1 };
        let mut natives = ob1_cpu::system_blocks();
        natives.push(Box::new(native));
        let modules: Vec<(ModuleSlot, Box<dyn Module>)> =
            vec![(ModuleSlot::new("io", 256), Box::new(TestModule::new(4)))];
        let mut cpu = Cpu::new(config, &program(blocks, vec![]), natives, modules, common::engine()).expect("it loads");
        let _ = shared.attention.set(cpu.attention());
        let stack = cpu.stack_bytes();
        let clock = SharedClock(Arc::clone(&shared));

        let run = std::thread::Builder::new().stack_size(stack).spawn(move || {
            let mut clock = clock;
            let top = std::ptr::from_ref(&clock) as usize;
            cpu.request(Command::Run);
            let state = cpu.cycle(&mut clock).state;
            (top, state, cpu.diagnostics().map(|entry| entry.event.0).take(4).collect::<Vec<_>>())
        });
        let (top, state, events) = run.expect("a thread").join().expect("no panic");

        let mut expected: Vec<u16> = std::iter::once(1).chain(interrupts).chain([82, 80, 88]).collect();
        expected = expected.into_iter().flat_map(|ob| [ob, 121]).collect();
        assert_eq!(*shared.seen.lock().expect("one thread"), expected);
        assert_eq!((state, &events[..3]), (OperatingState::Stop, &[0x4570, 0x3573, 0x2522][..]));
        let used = top - shared.lowest.load(Ordering::Relaxed);
        // With room to spare, for compilers to come.
        assert!(used + used / 16 < stack, "{used} of {stack} bytes");
        // And not twice what is needed: the blocks themselves take the most.
        assert!(used > stack / 2, "{used} of {stack} bytes");
        println!("{used} of {stack} bytes");
    });
}
