//! Loading: program, native blocks and modules become a CPU, or a list of reasons why not.

use std::sync::Arc;

use ob1_ir::{Op, Program, Verified};
use ob1_model::{BlockId, BlockKind, Interface};
use ob1_time::{Instant, Span};

use crate::accounts::{Accounts, Trace, plugin_blocks};
use crate::alarms::Alarms;
use crate::context::Blocks;
use crate::engine::{
    Callee, Constants, Engine, Executed, Factory, Hot, Lowering, Plan, Signature, Signatures, collect, lower,
    mark_safe_points, writes_param,
};
use crate::force::Force;
use crate::holding::Debugging;
use crate::interrupts::{Diagnoses, Interrupts};
use crate::log::LogWriter;
use crate::machine::{Attention, Machine, Watchdog};
use crate::natives::Native;
use crate::nesting::Nesting;
use crate::organization_blocks::ObRecords;
use crate::points::Points;
use crate::retentive_ranges::Keep;
use crate::service_state::ServiceState;
use crate::stacks::Stacks;
use crate::standstill::Standstill;
use crate::timers::{Counter, Timer};
use crate::wall_clock::{Shown, Wall};
use crate::watching::Watching;
use crate::{
    Cpu, CpuConfig, DiagBuffer, LoadError, MOST_STACK_BYTES, Memory, Module, ModuleSlot, Modules, NativeBlock, Natives,
    ObInfo,
};

/// Most bytes of a data block.
const DB_BYTES: usize = 65_534;
/// Longest interval and phase offset of a cyclic interrupt.
const LONGEST_PERIOD: Span = Span::from_secs(60);
/// References to actual parameters, for all nested calls together.
const REFERENCES: usize = 8 * 1024;

/// What a program is loaded into: the rules of the CPU and the native blocks.
#[derive(Clone, Debug)]
pub struct Surroundings {
    config: CpuConfig,
    natives: Vec<(BlockId, Interface)>,
    plugins: bool,
}

/// A program that was loaded, without the machine it runs on.
pub(crate) struct Prepared {
    pub(crate) memory: Memory,
    pub(crate) keep: Keep,
    pub(crate) plan: Arc<Plan>,
    pub(crate) engine: Box<dyn Engine>,
    pub(crate) stack: usize,
}

impl Surroundings {
    /// The surroundings that a CPU with these rules and native blocks gives a program.
    #[must_use]
    pub fn new(config: &CpuConfig, natives: &Natives) -> Self {
        Self {
            config: config.clone(),
            natives: natives.iter().map(|native| (native.id(), native.interface().clone())).collect(),
            plugins: natives.iter().any(NativeBlock::is_plugin),
        }
    }

    /// Whether a native block has this number.
    #[must_use]
    pub fn has(&self, id: BlockId) -> bool {
        self.natives.iter().any(|(native, _)| *native == id)
    }

    /// Loads a program; `stack` is the most that the thread which runs it may have.
    pub(crate) fn prepare(
        &self,
        program: &Program,
        engine: &dyn Factory,
        stack: usize,
    ) -> Result<Prepared, Vec<LoadError>> {
        let config = &self.config;
        let mut errors = Vec::new();
        check_data(program, &mut errors);
        let interface = |id| self.natives.iter().find(|(native, _)| *native == id).map(|(_, interface)| interface);
        let verified = ob1_ir::verify(program, &interface);
        if let Err(findings) = &verified {
            errors.extend(findings.iter().map(|finding| LoadError::of(finding, program)));
        }
        let Ok(program) = verified else { return Err(errors) };
        let signatures = signatures(program, &self.natives, &mut errors);
        if !errors.is_empty() {
            return Err(errors);
        }

        let mut constants = Constants::default();
        for stmt in program.blocks.iter().flat_map(|b| &b.code) {
            if let Op::Call(call) = &stmt.op {
                collect(call, &signatures, &mut constants);
            }
        }
        let arena = |bytes| engine.arena(bytes);
        let memory = Memory::new(config, &program.data, &constants.bytes, &arena).map_err(|error| vec![error])?;
        let keep = Keep::new(config, &program, &memory, &mut errors);
        let lowering = Lowering { config, memory: &memory, program, signatures: &signatures, constants: &constants };
        let mut blocks: Box<[_]> = program.blocks.iter().map(|block| lower(block, &lowering, &mut errors)).collect();
        mark_safe_points(&mut blocks);
        if !errors.is_empty() {
            return Err(errors);
        }

        let loaded = |id| signatures.find(id).is_some();
        let mut stack_per_block = engine.stack_per_block();
        let nested = |per_block| Nesting::new(config, &loaded, self.plugins, per_block, stack);
        let mut nesting = nested(stack_per_block);
        if nesting.is_err() && engine.stack_is_for_later() {
            stack_per_block = 0;
            nesting = nested(stack_per_block);
        }
        let nesting = nesting.map_err(|error| vec![error])?;
        let plan = Arc::new(Plan {
            executed: Executed::new(program.blocks.len()),
            blocks,
            ob1: signatures.find(BlockId::new(BlockKind::Ob, 1)).map(|signature| signature.callee),
            signatures,
            areas: memory.areas(),
            data: memory.dbs[..memory.program_dbs].into(),
            arena_reserved: memory.bytes.reserved(),
            accumulators: config.accumulators,
            timers: config.timers,
            counters: config.counters,
            nesting_depth: config.nesting_depth,
            stack_per_block,
            frames: usize::from(config.nesting_depth) * nesting.obs,
        });
        let engine = engine.engine(&plan).map_err(|reason| vec![LoadError::Engine { reason }])?;
        Ok(Prepared { memory, keep, plan, engine, stack: nesting.stack })
    }
}

impl Cpu {
    /// Loads a program. The CPU is in STOP; [`crate::Command::Run`] starts it.
    ///
    /// # Errors
    /// Everything that is wrong, not only the first.
    pub fn new(
        config: CpuConfig,
        program: &Program,
        natives: impl Into<Natives>,
        modules: Vec<(ModuleSlot, Box<dyn Module>)>,
        engine: &dyn Factory,
    ) -> Result<Self, Vec<LoadError>> {
        let natives = natives.into();
        let mut errors = Vec::new();
        check_config(&config, &mut errors);
        let modules = Modules::new(modules, &mut errors);
        let surroundings = Surroundings::new(&config, &natives);
        let prepared = surroundings.prepare(program, engine, MOST_STACK_BYTES);
        let Prepared { memory, keep, plan, engine, stack } = match prepared {
            Ok(prepared) if errors.is_empty() => prepared,
            Ok(_) => return Err(errors),
            Err(others) => {
                errors.extend(others);
                return Err(errors);
            }
        };
        let attention = Attention::default();
        let obs: Vec<u16> = plan
            .signatures
            .0
            .iter()
            .filter(|s| s.id.kind == BlockKind::Ob && s.id.number < 128)
            .map(|s| s.id.number)
            .collect();
        let timed = natives.iter().filter(|_| config.accounts.blocks);
        let accounts = Accounts::new(&config.accounts, config.min_cycle, &obs, plugin_blocks(timed));
        let accounts = Arc::new(accounts);
        let blocks = Blocks {
            engine,
            plan,
            natives: Native::all(natives, config.accounts.blocks),
            running: Arc::default(),
            attention: attention.clone(),
        };
        let (alarms, alarm_client) = Alarms::new();
        let (log, reader) = LogWriter::new();
        let wall = Wall::new(config.date_at_start);
        let machine = Machine {
            memory,
            timers: vec![Timer::default(); usize::from(config.timers)].into_boxed_slice(),
            counters: vec![Counter::default(); usize::from(config.counters)].into_boxed_slice(),
            modules,
            diag: DiagBuffer::new(),
            log,
            attention,
            wall,
            shown: Shown::default(),
            seen_from_outside: None,
            statements: 0,
            hot: Hot::default(),
            pace: Span::ZERO,
            watchdog: Watchdog::default(),
            standstill: Standstill::default(),
            wanted: None,
            refs: vec![0; REFERENCES].into_boxed_slice(),
            stack,
            ob: ObInfo::default(),
            class_ob: 0,
            position: Arc::default(),
            active: 0,
            aborted: false,
            diagnoses: Diagnoses::default(),
            started: wall.bytes(Instant::START),
            inside: Span::ZERO,
            interrupts: Interrupts::new(&config.cyclic, |ob| blocks.ob(ob).is_some()),
            obs: ObRecords::new(&accounts),
            trace: Trace::new(accounts),
            alarms,
            services: ServiceState::new(|ob| blocks.ob(ob).is_some()),
            cycle_start: Instant::START,
            stopped_at: Instant::START,
            keep,
            native_caller: None,
            interrupted: None,
            substitute: None,
            outputs_disabled: true,
            at: None,
            tape: None,
            watching: Watching::default(),
            debugging: Debugging::new(),
            stacks: Stacks::new(),
            held: Span::ZERO,
            followers: Vec::new(),
            points: Points::default(),
            force: Force::default(),
            config,
        };
        Ok(Cpu::assemble(machine, blocks, alarm_client, reader))
    }
}

fn check_config(config: &CpuConfig, errors: &mut Vec<LoadError>) {
    let mut check = |field: &'static str, value: u64, max: u64| {
        if value > max {
            errors.push(LoadError::Config { field, value, max });
        }
    };
    check("input_bytes", u64::from(config.input_bytes), 8192);
    check("output_bytes", u64::from(config.output_bytes), 8192);
    check("memory_bytes", u64::from(config.memory_bytes), 65_536);
    check("timers", u64::from(config.timers), 2048);
    check("counters", u64::from(config.counters), 2048);
    check("local_bytes", u64::from(config.local_bytes), 1 << 20);
    check("nesting_depth", u64::from(config.nesting_depth), 64);
    check("db_pool_bytes", u64::from(config.db_pool_bytes), 64 << 20);
    check("test_load", u64::from(config.test_load), 1000);
    if let Some(byte) = config.clock_memory {
        check("clock_memory", u64::from(byte), u64::from(config.memory_bytes).saturating_sub(1));
    }
    for (i, c) in config.cyclic.iter().enumerate() {
        check("cyclic.ob", u64::from(c.ob), 38);
        check("cyclic.period", c.period.nanos(), LONGEST_PERIOD.nanos());
        check("cyclic.phase", c.phase.nanos(), LONGEST_PERIOD.nanos());
        check("cyclic interrupts of one OB", config.cyclic[..=i].iter().filter(|b| b.ob == c.ob).count() as u64, 1);
    }
    let mut wrong = |field, value, max| errors.push(LoadError::Config { field, value, max });
    if config.accumulators != 2 && config.accumulators != 4 {
        wrong("accumulators", u64::from(config.accumulators), 4);
    }
    // Below these a CPU cannot run at all; the message names the largest value, the documentation the smallest.
    if config.local_bytes < 1024 {
        wrong("local_bytes", u64::from(config.local_bytes), 1 << 20);
    }
    for interrupt in config.time_of_day.iter().filter(|interrupt| !(10..=17).contains(&interrupt.ob)) {
        wrong("time_of_day.ob", u64::from(interrupt.ob), 17);
    }
    for c in &config.cyclic {
        if c.ob < 30 {
            wrong("cyclic.ob", u64::from(c.ob), 38);
        }
        if c.period.is_zero() {
            wrong("cyclic.period", 0, LONGEST_PERIOD.nanos());
        }
    }
    if config.nesting_depth == 0 {
        wrong("nesting_depth", 0, 64);
    }
}

fn check_data(program: &Program, errors: &mut Vec<LoadError>) {
    for db in &program.data {
        if db.bytes.len() > DB_BYTES {
            errors.push(LoadError::DbTooLarge { number: db.number, bytes: db.bytes.len() });
        }
    }
}

fn signatures(
    program: Verified<&Program>,
    natives: &[(BlockId, Interface)],
    errors: &mut Vec<LoadError>,
) -> Signatures {
    let mut list = Vec::with_capacity(program.blocks.len() + natives.len());
    for (i, block) in (0u32..).zip(&program.blocks) {
        let written = |formal: usize| writes_param(block, formal);
        list.push(Signature::new(block.id, Callee::Code(i), &block.interface, &written));
    }
    for (i, (id, interface)) in (0u32..).zip(natives) {
        list.push(Signature::new(*id, Callee::Native(i), interface, &|_| false));
    }
    list.sort_by_key(|s| s.id);
    for pair in list.windows(2).filter(|pair| pair[0].id == pair[1].id) {
        errors.push(LoadError::BlockTwice(pair[0].id));
    }
    Signatures(list)
}
