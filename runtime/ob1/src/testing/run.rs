//! Running the tests of one file.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::time::Instant;

use ob1_cpu::{Cell, CpuConfig, DiagEntry, OperatingState, Width};
use ob1_ir::Program;
use ob1_record::Replay;
use ob1_stl::{Library, Source};
use ob1_time::Span;

use super::bench::{Bench, bare_config, bare_modules, loaded};
use super::cells::{Expect, Resolver, Set};
use super::harness::{Harness, of_generated};
use super::plan::{self, Plan, Run, Step, Test, Tested};
use super::replay::{Recorded, configured, told};
use super::report::{Failure, FileReport, Outcome};
use ob1_access::Names;
use ob1_station::plugins;
use ob1_station::program::{self, Loaded};
use ob1_station_file::finding::{Finding, Level, Text};
use ob1_station_file::findings::{CALL, Findings, UNREADABLE, VALUE};
use ob1_station_file::sources::Sources;
use ob1_station_file::{self, ModuleConfig};

/// Name of the generated source.
const GENERATED: &str = "(the call under test)";

/// Runs the tests of a file whose names contain `filter`.
pub fn run_file(path: &Path, filter: &str) -> FileReport {
    let file = path.display().to_string();
    let refused = |refused| FileReport { file: file.clone(), refused, outcomes: Vec::new() };
    let text = match ob1_process::files::read_text(path) {
        Ok(text) => text,
        Err(error) => {
            let message = format!("the test file cannot be read: {error}");
            return refused(vec![Finding::whole(
                Level::Error,
                UNREADABLE,
                &file,
                message,
                "name a test file: docs/testing.md",
            )]);
        }
    };
    match run_text(&text, &file, path.parent().unwrap_or(Path::new("")), filter) {
        Ok(outcomes) => FileReport { file, refused: Vec::new(), outcomes },
        Err(findings) => refused(findings),
    }
}

/// What is wrong with the text of a test file, whatever its program.
pub fn wrong_with(text: &str, file: &str, folder: &Path) -> Vec<Finding> {
    plan::parse(text, file, folder).err().unwrap_or_default()
}

fn run_text(text: &str, file: &str, folder: &Path, filter: &str) -> Result<Vec<Outcome>, Vec<Finding>> {
    let source = Text { file, text };
    let plan = plan::parse(text, file, folder)?;
    let subject = Subject::new(&plan)?;
    // All tests are resolved before the first one runs: a wrong name is reported at once.
    let chosen = plan.tests.iter().filter(|test| test.name.contains(filter));
    let mut wrong = Vec::new();
    let mut ready = Vec::new();
    for test in chosen {
        match Ready::new(test, &subject, source) {
            Ok(test) => ready.push(test),
            Err(findings) => wrong.extend(findings),
        }
    }
    if !wrong.is_empty() {
        return Err(wrong);
    }
    ready.into_iter().map(|test| test.run(source)).collect()
}

/// What is tested, compiled.
struct Subject {
    name: String,
    config: CpuConfig,
    modules: Vec<ModuleConfig>,
    wanted: Sources,
    sources: Vec<Source>,
    library: Library,
    loaded: Loaded,
}

impl Subject {
    fn new(plan: &Plan) -> Result<Self, Vec<Finding>> {
        let (name, config, modules, wanted, plugins) = match &plan.program {
            Tested::Sources(sources) => {
                (String::from("test"), bare_config(plan.bare_cycle()), bare_modules(), sources.clone(), Vec::new())
            }
            Tested::Station(path) => {
                let station = ob1_station_file::load(path)?;
                let mut config = station.cpu;
                // Virtual time moves with the cycles.
                config.min_cycle = plan.cycle.unwrap_or(config.min_cycle).max(Span::MICROSECOND);
                (station.name, config, station.modules, station.program, station.plugins)
            }
        };
        let plugins = plugins::load(&plugins)?;
        let library = program::library(&plugins, &wanted.library)?;
        let mut findings = Vec::new();
        let (files, symbols) = ob1_station_file::program_files::expand(&wanted.files, &wanted.symbols);
        let wanted = Sources { files, symbols, ..wanted };
        let sources = program::read_all(&wanted.files, &wanted.places, &mut findings);
        let compiled = program::compile_texts(&sources, &wanted, &library, findings)?;
        let loaded = Loaded::new(compiled, plugins, &wanted.library);
        Ok(Self { name, config, modules, wanted, sources, library, loaded })
    }

    /// The program with a generated call of one block as OB 1.
    fn with_call(&self, call: &plan::Call, source: Text<'_>) -> Result<(Program, Harness), Vec<Finding>> {
        let mut findings = Findings::new(source);
        let harness = Harness::new(call, &self.loaded.program, &self.library, self.wanted.mnemonics, &mut findings);
        let harness = findings.into_result(harness)?.ok_or_else(|| {
            let message = "no number is left for a generated block";
            vec![source.finding(Level::Error, CALL, call.at.clone(), message.into(), String::new())]
        })?;
        let mut sources = self.sources.clone();
        sources.push(Source::new(GENERATED, harness.source.clone().into_bytes()));
        let compiled = program::compile_texts(&sources, &self.wanted, &self.library, Vec::new());
        let mut compiled = compiled.map_err(|found| {
            let errors: Vec<Finding> = found.into_iter().filter(|f| f.level == Level::Error).collect();
            of_generated(&errors, call, source)
        })?;
        harness.install(&mut compiled.program);
        Ok((compiled.program, harness))
    }
}

/// A test whose names are resolved, with its CPU.
struct Ready<'p> {
    test: &'p Test,
    bench: Bench,
    inputs: Vec<Set>,
    /// The bit that opens the call of one block.
    opening: Option<Cell>,
    replay: Option<Replay<BufReader<File>>>,
    steps: Vec<ReadyStep<'p>>,
}

struct ReadyStep<'p> {
    step: &'p Step,
    set: Vec<Set>,
    expect: Vec<Expect>,
}

impl<'p> Ready<'p> {
    fn new(test: &'p Test, subject: &Subject, source: Text<'_>) -> Result<Self, Vec<Finding>> {
        let (program, harness) = match &test.call {
            Some(call) => {
                let (program, harness) = subject.with_call(call, source)?;
                (program, Some(harness))
            }
            None => (Program::clone(&subject.loaded.program), None),
        };
        let names = Names::new(&program);
        let resolver = Resolver { names: &names, program: &program, harness: harness.as_ref() };
        let mut findings = Findings::new(source);
        let f = &mut findings;
        let inputs = resolver.sets(&test.inputs, true, f);
        let steps = test.steps.iter().map(|step| ReadyStep {
            step,
            set: resolver.sets(&step.set, false, f),
            expect: resolver.expects(&step.expect, f),
        });
        let steps = steps.collect();
        let (inputs, steps) = findings.into_result((inputs, steps))?;
        let loaded = loaded(program, &subject.loaded);
        let unusable = |why| vec![source.finding(Level::Error, VALUE, test.at.clone(), why, String::new())];
        let replay = test.replay.as_ref().map(Recorded::open).transpose().map_err(unusable)?;
        let config = match &replay {
            Some(replay) => configured(subject.config.clone(), replay.head().min_cycle_ns),
            None => subject.config.clone(),
        };
        let bench = Bench::new(&subject.name, config, &subject.modules, &loaded)?;
        Ok(Self { test, bench, inputs, opening: harness.map(|h| h.opening()), replay, steps })
    }

    fn run(mut self, source: Text<'_>) -> Result<Outcome, Vec<Finding>> {
        let begin = Instant::now();
        let unusable = |at: &std::ops::Range<usize>, message| {
            vec![source.finding(Level::Error, VALUE, at.clone(), message, String::new())]
        };
        for set in &self.inputs {
            self.bench.set(set).map_err(|message| unusable(&self.test.at, message))?;
        }
        let mut failures = Vec::new();
        match self.replay.take() {
            Some(replay) => {
                let replayed =
                    replay.run(&mut self.bench).map_err(|error| unusable(&self.test.at, error.to_string()))?;
                self.bench.charge(None);
                let line = source.finding(Level::Error, "", self.test.at.clone(), String::new(), String::new()).line;
                failures.extend(told(&replayed).into_iter().map(|text| Failure { line: Some(line), text }));
            }
            None => self.bench.start(self.test.start),
        }
        if let Some(cell) = self.opening {
            let opened = self.bench.cpu.write(cell, Width::Bit, 1);
            opened.map_err(|error| unusable(&self.test.at, error.to_string()))?;
        }
        for (number, ready) in (1..).zip(&self.steps) {
            if !failures.is_empty() {
                // What follows would only be its consequence.
                break;
            }
            let found = ready.run(&mut self.bench).map_err(|message| unusable(&ready.step.at, message))?;
            let place = format!(
                "step {number}, {:.3} s, scan {}",
                self.bench.now.since_start().as_secs_f64(),
                self.bench.scans
            );
            failures.extend(found.into_iter().map(|(at, text)| {
                let line = source.finding(Level::Error, "", at, String::new(), String::new()).line;
                Failure { line: Some(line), text: format!("{text} ({place})") }
            }));
        }
        Ok(Outcome {
            name: self.test.name.clone(),
            failures,
            plc_seconds: self.bench.now.since_start().as_secs_f64(),
            wall_seconds: begin.elapsed().as_secs_f64(),
        })
    }
}

type Wrong = (std::ops::Range<usize>, String);

impl ReadyStep<'_> {
    /// Returns what does not hold. `Err`: the step itself is impossible.
    fn run(&self, bench: &mut Bench) -> Result<Vec<Wrong>, String> {
        let step = self.step;
        if let Some((until, at)) = &step.until {
            if *until < bench.now {
                let text =
                    format!("this time has already passed: it is {:.3} s", bench.now.since_start().as_secs_f64());
                return Ok(vec![(at.clone(), text)]);
            }
            bench.run_until(*until);
        }
        if let Some(command) = step.command {
            bench.cpu.request(command);
        }
        for set in &self.set {
            bench.set(set)?;
        }
        match step.run {
            Run::Scans(scans) => (0..scans).for_each(|_| bench.scan()),
            Run::Time(time) => bench.run_until(bench.now.saturating_add(time)),
            Run::Within(time) => {
                let end = bench.now.saturating_add(time);
                while !self.look(bench).is_empty() && bench.is_due_until(end) {
                    bench.cycle();
                }
            }
        }
        let mut wrong = self.look(bench);
        wrong.extend(self.look_at_state(bench));
        wrong.extend(self.look_at_diagnostics(bench));
        Ok(wrong)
    }

    fn look(&self, bench: &mut Bench) -> Vec<Wrong> {
        let field = bench.field();
        let outputs = |at: usize, into: &mut [u8]| {
            field.read_outputs(at, into);
        };
        let mut wrong = Vec::new();
        for expect in &self.expect {
            if let Some((wanted, found)) = expect.look(&mut bench.cpu, &outputs) {
                wrong.push((expect.at.clone(), format!("{}: expected {wanted}, found {found}", expect.name)));
            }
        }
        wrong
    }

    /// STOP is a failure unless the step is about it.
    fn look_at_state(&self, bench: &Bench) -> Option<Wrong> {
        let found = bench.state();
        match &self.step.state {
            Some((wanted, _)) if *wanted == found => None,
            Some((wanted, at)) => {
                let text = format!("state: expected {}, found {}{}", wanted.name(), found.name(), why(bench));
                Some((at.clone(), text))
            }
            None if found == OperatingState::Stop => {
                Some((self.step.at.clone(), format!("the CPU is in STOP{}", why(bench))))
            }
            None => None,
        }
    }

    fn look_at_diagnostics(&self, bench: &Bench) -> Vec<Wrong> {
        let is_there = |number: u16| bench.cpu.diagnostics().any(|entry| entry.event.0 == number);
        let missing = self.step.diagnostics.iter().filter(|(number, _)| !is_there(*number));
        let found: Vec<String> = bench.cpu.diagnostics().take(5).map(|e| format!("{:04X}h", e.event.0)).collect();
        let text = |number: u16| format!("no diagnostic entry {number:04X}h; the newest are {}", found.join(" "));
        missing.map(|(number, at)| (at.clone(), text(*number))).collect()
    }
}

/// The newest entries, when the CPU has stopped: what for, and what it came from.
fn why(bench: &Bench) -> String {
    if bench.state() != OperatingState::Stop {
        return String::new();
    }
    let entries: Vec<&DiagEntry> = bench.cpu.diagnostics().take(2).collect();
    entries.iter().map(|entry| format!("; {entry}")).collect()
}
