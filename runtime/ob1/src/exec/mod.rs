//! `ob1 exec`: bare sources without a station file, for scripts and conformance suites.
//!
//! The contract: the start OB once, then OB 1 cyclically, until the program stops the CPU (SFC 46), a limit is reached
//! or a fault ends it. There are no modules: peripheral reads answer from the process image of the inputs, peripheral
//! writes land in that of the outputs.

mod args;
mod clock;
mod dump;
mod engines;
mod stats;

use std::path::Path;
use std::sync::Arc;

use ob1_cpu::{Clock as _, Command, Cpu, CpuConfig, DiagEntry, Family, OperatingState};
use ob1_ir::Program;
use ob1_model::Event;
use ob1_time::Instant;

pub use args::{ExecArgs, Start, Switch};
pub use dump::{Dump, DumpArea};
pub use stats::{STATS_SCHEMA, Stats};

use crate::exit::{ExecExit, Exit};
use crate::testing::replay::{Recorded, replay_program, told};
use clock::{ExecClock, WallTime};
use engines::Engines;
use ob1_station::compiling::Request;
use ob1_station::missing_blocks::Unserved;
use ob1_station::program::{self, Loaded};
use ob1_station::program_facts::Places;
use ob1_station_file::EngineChoice;
use ob1_station_file::finding::Finding;
use ob1_station_file::library::Choice;
use ob1_station_file::sources::Sources;
use stats::Meter;

/// Entries of the diagnostic buffer printed after a fault.
const SHOWN: usize = 10;

/// Runs sources; prints what there is to print.
pub fn exec(args: &ExecArgs) -> ExecExit {
    match try_exec(args) {
        Ok(exit) => exit,
        Err((exit, text)) => {
            errs!("{text}");
            exit
        }
    }
}

type Failure = (ExecExit, String);

fn rejected(findings: &[Finding]) -> Failure {
    (ExecExit::Rejected, findings.iter().map(|f| format!("{f}\n")).collect())
}

fn try_exec(args: &ExecArgs) -> Result<ExecExit, Failure> {
    let usage = |text| (ExecExit::Other(Exit::Usage), format!("ob1: {text}\n"));
    args.check().map_err(usage)?;
    let standard = args.standard().map_err(usage)?;
    if let Some(path) = &args.replay {
        return replay(args, path, &standard);
    }
    let (program, standard) = compile(args, &standard)?;
    let (mut cpu, request) = load(args, &standard, &program)?;
    for dump in &args.dump {
        // Before the run: an impossible dump is known at once, not after a minute.
        dump.bytes(&cpu).map_err(|text| (ExecExit::Other(Exit::Usage), format!("ob1: --dump {text}\n")))?;
    }
    let mut clock = ExecClock::new(args, cpu.attention(), WallTime::start());
    let meter = Meter::start();
    let mut engines = Engines::new(args, &cpu, request);
    let exit = ob1_rt::with_stack(cpu.stack_bytes(), || run(&mut cpu, &mut clock, args.start, &mut engines));
    let exit = exit.map_err(|e| (ExecExit::Other(Exit::System), format!("ob1: a thread for the program: {e}\n")))?;
    let stats = meter.stop(&cpu, clock.now(), exit);
    match exit {
        ExecExit::Fault => errs!("{}", fault_text(&cpu, &Places::new(&program))),
        ExecExit::Limit if clock.wall_is_over() => {
            err!(
                "ob1: the wall limit of {} s was reached before the limit of virtual time",
                clock::WALL_LIMIT.as_secs()
            );
        }
        _ => {}
    }
    // One file that cannot be written keeps back no other.
    let mut failed: Vec<String> = args.dump.iter().filter_map(|dump| dump.write(&cpu).err()).collect();
    if let Some(path) = &args.stats
        && let Err(error) = stats.write(path)
    {
        failed.push(format!("{}: {error}", path.display()));
    }
    if !failed.is_empty() {
        let text = failed.iter().map(|text| format!("ob1: {text}\n")).collect();
        return Err((ExecExit::Other(Exit::System), text));
    }
    // It names the exit code, which is certain only now.
    if !args.quiet {
        note!("{}", ended_text(exit, stats.scans, clock.now()));
    }
    Ok(exit)
}

/// Replays a recording with the sources.
fn replay(args: &ExecArgs, path: &Path, standard: &[Choice]) -> Result<ExecExit, Failure> {
    let loaded = Loaded::new(compiled(args, standard)?, Vec::new(), standard);
    let recorded = Recorded { path: path.to_owned(), drive: args.drive.clone(), compare: None };
    let ran = ob1_rt::with_stack(ob1_cpu::MOST_STACK_BYTES, || replay_program(config(args), &loaded, &recorded));
    let ran = ran.map_err(|e| (ExecExit::Other(Exit::System), format!("ob1: a thread for the program: {e}\n")))?;
    let replayed = ran.map_err(|why| (ExecExit::Rejected, format!("ob1: {why}\n")))?;
    let differences = told(&replayed);
    if differences.is_empty() {
        if !args.quiet {
            note!("ob1: {} scans replayed: every value is as recorded", replayed.scans);
        }
        return Ok(ExecExit::Stopped);
    }
    let lines: String = differences.iter().map(|line| format!("ob1: {line}\n")).collect();
    errs!("{lines}ob1: {} scans replayed, {} signals differ\n", replayed.scans, replayed.differences.len());
    Ok(ExecExit::Differs)
}

fn compile(args: &ExecArgs, standard: &[Choice]) -> Result<(Program, Vec<Choice>), Failure> {
    let compiled = compiled(args, standard)?;
    let standard = program::in_use(&compiled.program, standard, &compiled.demanded);
    Ok((compiled.program, standard))
}

fn compiled(args: &ExecArgs, standard: &[Choice]) -> Result<program::Compiled, Failure> {
    let library = program::library(&[], standard).map_err(|findings| rejected(&findings))?;
    let sources = Sources {
        files: args.files.clone(),
        symbols: args.symbols.clone(),
        mnemonics: args.mnemonics.into(),
        library: standard.to_vec(),
        numbers: args.numbers.clone(),
        all_messages: args.all_messages,
        ..Sources::default()
    };
    let compiled = program::compile(&sources, &library).map_err(|findings| rejected(&findings))?;
    let without_ob1 = program::without_ob1(&compiled.program, []);
    let findings = compiled.findings.iter().chain(&without_ob1);
    for finding in findings.filter(|finding| !args.quiet || finding.code == program::NO_OB1) {
        err!("{finding}");
    }
    Ok(compiled)
}

/// The CPU, and what is to be compiled in a process of its own.
fn load(args: &ExecArgs, standard: &[Choice], program: &Program) -> Result<(Cpu, Option<Request>), Failure> {
    let config = config(args);
    let natives = program::native_standard_blocks(standard);
    let request =
        (args.engine == EngineChoice::Auto).then(|| Request::new(&config, Arc::new(program.clone()), &natives));
    let cpu = Cpu::new(config, program, natives, Vec::new(), ob1_station::engine::factory(args.engine));
    let cpu = cpu.map_err(|errors| rejected(&Unserved::new(standard, &[]).findings(&errors, program)))?;
    Ok((cpu, request))
}

fn config(args: &ExecArgs) -> CpuConfig {
    CpuConfig {
        input_bytes: args.inputs,
        output_bytes: args.outputs,
        memory_bytes: args.bit_memory,
        accumulators: args.accumulators,
        // Only this family starts hot.
        family: if args.start == Start::Hot { Family::S7_400 } else { Family::S7_300 },
        clock_memory: args.clock_memory,
        min_cycle: args.min_cycle,
        watchdog: args.watchdog,
        peripheral_from_image: true,
        ob_start_info: args.ob_start_info == Switch::On,
        // Virtual time begins at a fixed date: the same run gives the same start information.
        date_at_start: if args.real_time { ob1_station::wall_clock::date_now() } else { 0 },
        ..CpuConfig::default()
    }
}

/// Cycles until the end.
fn run(cpu: &mut Cpu, clock: &mut ExecClock, start: Start, engines: &mut Engines) -> ExecExit {
    if start == Start::Hot {
        cpu.assume_run();
    }
    cpu.request(match start {
        Start::Cold => Command::Cold,
        Start::Warm => Command::Warm,
        Start::Hot => Command::Hot,
    });
    loop {
        let end = cpu.cycle(clock);
        if end.state == OperatingState::Stop {
            return ending(cpu, clock);
        }
        engines.attend(cpu);
        clock.wait_until(end.next_deadline);
        if clock.is_over() {
            return ExecExit::Limit;
        }
    }
}

/// What led to STOP.
fn ending(cpu: &Cpu, clock: &ExecClock) -> ExecExit {
    match cpu.diagnostics().next().map(|entry| entry.event) {
        Some(Event::STOP_PROGRAM) => ExecExit::Stopped,
        // The clock has halted a scan that would not have ended in time.
        Some(Event::STOP_OPERATOR) if clock.has_halted() => ExecExit::Limit,
        _ => ExecExit::Fault,
    }
}

/// How it ended, in a line.
fn ended_text(exit: ExecExit, scans: u64, now: Instant) -> String {
    let how = match exit {
        ExecExit::Stopped => "the program stopped the CPU (SFC 46)",
        ExecExit::Limit => "the limit was reached in RUN",
        _ => "a fault stopped the CPU",
    };
    let scans = if scans == 1 { "1 scan".to_owned() } else { format!("{scans} scans") };
    format!("ob1: {how} after {scans}, {:.3} s; exit code {}", now.since_start().as_secs_f64(), exit.code())
}

/// The entries that led to STOP, newest first: the reason for STOP and what it came from.
fn fault_text(cpu: &Cpu, places: &Places) -> String {
    let beginning = [Event::STARTUP, Event::RUN];
    let entries = cpu.diagnostics().take_while(|entry| !beginning.contains(&entry.event)).take(SHOWN);
    let line =
        |entry: &DiagEntry| format!("ob1: {:.6} s  {}\n", entry.time.since_start().as_secs_f64(), places.told(entry));
    entries.map(line).collect()
}
