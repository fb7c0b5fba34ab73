//! Which engine runs the program: `[cpu] engine`, `ob1 exec --engine`.

use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use ob1_arena::Arena;
use ob1_cpu::engine::{ACCOUNTING, Both, Engine, Factory, PLAIN, Plan, REFERENCE};
use ob1_native::{AtLoad, Tier};
use ob1_station_file::EngineChoice;

/// What makes the engine of a program that takes over while the CPU is in RUN: falling back to the reference engine
/// would make it late.
#[must_use]
pub fn factory_in_run(choice: EngineChoice) -> &'static dyn Factory {
    if choice == EngineChoice::Auto { &Quick } else { factory(choice) }
}

/// What makes the engine the CPU begins with.
#[must_use]
pub fn factory(choice: EngineChoice) -> &'static dyn Factory {
    match choice {
        EngineChoice::Auto => &Succeeded,
        EngineChoice::Reference => REFERENCE,
        EngineChoice::Plain => PLAIN,
        EngineChoice::Native => &Compiled,
        EngineChoice::Both => &Both(&Compiled),
    }
}

/// Machine code that is made quickly, for a program that takes over from machine code in RUN.
struct Quick;

const QUICK: AtLoad = AtLoad(Tier::Fast);

impl Factory for Quick {
    fn engine(&self, plan: &Arc<Plan>) -> Result<Box<dyn Engine>, String> {
        QUICK.engine(plan)
    }

    fn arena(&self, bytes: usize) -> Arena {
        Succeeded.arena(bytes)
    }

    fn stack_per_block(&self) -> usize {
        QUICK.stack_per_block()
    }
}

/// Machine code, made when the program is loaded, on memory that covers every offset code can have.
struct Compiled;

const NATIVE: AtLoad = AtLoad(Tier::Optimised);

impl Factory for Compiled {
    fn engine(&self, plan: &Arc<Plan>) -> Result<Box<dyn Engine>, String> {
        NATIVE.engine(plan)
    }

    fn arena(&self, bytes: usize) -> Arena {
        // Without so much address space the code relies on its own checks.
        ob1_rt::reserve(bytes).unwrap_or_else(|_| Arena::new(bytes))
    }

    fn stack_per_block(&self) -> usize {
        NATIVE.stack_per_block()
    }
}

/// The reference engine, with memory and stack for machine code that takes over later, and an account that shows the
/// hottest blocks.
struct Succeeded;

impl Factory for Succeeded {
    fn engine(&self, plan: &Arc<Plan>) -> Result<Box<dyn Engine>, String> {
        ACCOUNTING.engine(plan)
    }

    fn arena(&self, bytes: usize) -> Arena {
        // A limit on locked memory counts reserved addresses. Where there is one, locking comes first: the checks of
        // compiled code do not need the reservation.
        if ob1_rt::may_lock_all() { Compiled.arena(bytes) } else { Arena::new(bytes) }
    }

    fn stack_per_block(&self) -> usize {
        NATIVE.stack_per_block()
    }

    fn stack_is_for_later(&self) -> bool {
        true
    }
}

/// The names of all engines, by which [`InUse`] names them.
const NAMES: [&str; 6] =
    ["reference", "plain", "both", ob1_native::NAME_FAST, ob1_native::NAME_HOTTEST, ob1_native::NAME];

/// Which engine runs, as other threads see it.
#[derive(Debug, Default)]
pub struct InUse(AtomicU8, Mutex<Option<String>>);

impl InUse {
    /// This one from now on.
    pub fn set(&self, name: &str) {
        let index = NAMES.iter().position(|known| *known == name).unwrap_or(0);
        self.0.store(index as u8, Ordering::Relaxed);
    }

    /// Why it is not what was asked for; `None`: it is, or it comes.
    pub fn lack(&self, why: Option<String>) {
        *self.1.lock().unwrap_or_else(PoisonError::into_inner) = why;
    }

    /// What was said last.
    #[must_use]
    pub fn lacks(&self) -> Option<String> {
        self.1.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Name of the engine that runs the program now.
    #[must_use]
    pub fn name(&self) -> &'static str {
        NAMES.get(usize::from(self.0.load(Ordering::Relaxed))).copied().unwrap_or(NAMES[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_engine_is_told_by_its_name() {
        let program = ob1_ir::Program::default();
        let in_use = InUse::default();
        assert_eq!(in_use.name(), "reference");
        let words = EngineChoice::WORDS.iter().map(|(word, _)| *word).chain(["plain"]);
        for choice in words.filter_map(|word| EngineChoice::parse(word).ok()) {
            let config = ob1_cpu::CpuConfig::default();
            let cpu = ob1_cpu::Cpu::new(config, &program, Vec::new(), Vec::new(), factory(choice)).expect("it loads");
            in_use.set(cpu.engine());
            assert_eq!(in_use.name(), cpu.engine());
        }
        for name in [ob1_native::NAME_FAST, ob1_native::NAME_HOTTEST] {
            in_use.set(name);
            assert_eq!(in_use.name(), name);
        }
    }

    /// A STRING may be shorter than its formal parameter, and the arena may end after it, where nothing is mapped: what
    /// is read there is 0 on every engine.
    #[test]
    fn nothing_is_read_behind_the_arena() {
        use ob1_cpu::{Cpu, CpuConfig, Still};
        use ob1_ir::{Arg, BitTest, Call, CallMode, CodeBlock, Logic, Op, Operand, Place, Stmt, Target, Width};
        use ob1_model::{Area, BitAddr, BlockId, BlockKind, DataType, Interface, Param, Section};

        const PAGE: u32 = 64 * 1024;

        let memory = |width, byte| Operand { width, place: Place::Fixed(Area::Memory, BitAddr::byte_addr(byte)) };
        let formal = |byte| Place::Param { index: 0, at: BitAddr::byte_addr(byte) };
        let code = |id, interface, ops: Vec<Op>| CodeBlock {
            id,
            name: None,
            interface,
            code: ops.into_iter().map(|op| Stmt { op, network: 1, line: 1 }).collect(),
            source: 0,
        };
        // A short block is inlined into its caller, a long one is called.
        for (rest, bit_first) in [(0, false), (60, false), (60, true)] {
            let mut ops = vec![
                Op::Load(Operand { width: Width::DWord, place: formal(200) }),
                Op::Transfer(memory(Width::DWord, 0)),
                Op::Scan { logic: Logic::And, negate: true, test: BitTest::Bit(formal(250)) },
                Op::Assign(Place::Fixed(Area::Memory, BitAddr::byte_addr(4))),
                Op::Load(Operand { width: Width::Byte, place: formal(2) }),
                Op::Transfer(memory(Width::Byte, 5)),
            ];
            // After a check that fails, the reference continues.
            if bit_first {
                ops.rotate_left(2);
            }
            ops.resize(ops.len() + rest, Op::Nop);
            let s = Param::new("s", Section::Input, DataType::String(254));
            let fc = BlockId::new(BlockKind::Fc, 1);
            let args = vec![Arg::Bytes(vec![4, 2, b'o', b'b', b'1', 0, 0, 0].into())];
            let call = Call { mode: CallMode::Call, target: Target::Block(fc), instance: None, args };
            let blocks = vec![
                code(fc, Interface { params: vec![s], ..Interface::default() }, ops),
                code(BlockId::new(BlockKind::Ob, 1), Interface::default(), vec![Op::Call(Box::new(call))]),
            ];
            let program = ob1_ir::Program { blocks, sources: vec!["p".into()], ..ob1_ir::Program::default() };
            let load = |choice: EngineChoice, memory_bytes| {
                let config = CpuConfig { memory_bytes, db_pool_bytes: 0, ..CpuConfig::default() };
                Cpu::new(config, &program, Vec::new(), Vec::new(), factory(choice)).expect("it loads")
            };
            // The constant is the last of the arena; with so much bit memory the largest pages end there.
            let end = |cpu: &Cpu| cpu.plan().areas.constants.at.0 + cpu.plan().areas.constants.len;
            let behind = end(&load(EngineChoice::Reference, 256)) % PAGE;
            let padding = (2 * PAGE - 8 - behind) % PAGE;
            for choice in [EngineChoice::Reference, EngineChoice::Native] {
                let mut cpu = load(choice, 256 + padding);
                assert_eq!((end(&cpu) + 8) % PAGE, 0);
                cpu.request(ob1_model::Command::Run);
                cpu.cycle(&mut Still);
                assert_eq!(cpu.bit_memory()[..6], [0, 0, 0, 0, 1, b'o'], "{choice:?}, {rest} more");
            }
        }
    }

    #[test]
    fn every_word_has_its_choice() {
        for (word, choice) in EngineChoice::WORDS {
            assert_eq!(EngineChoice::parse(word), Ok(choice));
        }
        assert_eq!(EngineChoice::parse("plain"), Ok(EngineChoice::Plain));
        assert!(EngineChoice::parse("Reference").is_err_and(|remedy| remedy.contains("reference")));
    }
}
