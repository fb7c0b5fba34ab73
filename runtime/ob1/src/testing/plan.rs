//! From a test file to what is to be done: times, words and paths are understood; names of cells are not yet.

use std::ops::Range;
use std::path::{Path, PathBuf};

use ob1_cpu::{Command, OperatingState};
use ob1_model::{BlockId, BlockKind};

use super::file::{Cells, Placed, StepTable, TestFile, TestTable};
use super::replay::Recorded;
use ob1_station_file::finding::{Finding, Text};
use ob1_station_file::findings::{CONTRADICTION, Findings, MISSING, VALUE, of_toml};
use ob1_station_file::sources::{Mnemonics, Sources};
use ob1_station_file::{choice, parse_duration, standard};
use ob1_time::{Instant, Span};

/// Minimum cycle time of a test without a station file.
const CYCLE: Span = Span::from_millis(10);
const DOCUMENT: &str = "docs/testing.md";

/// A test file, understood.
#[derive(Debug)]
pub(super) struct Plan {
    pub(super) program: Tested,
    /// Minimum cycle time, when the file gives one; a station has its own.
    pub(super) cycle: Option<Span>,
    pub(super) tests: Vec<Test>,
}

/// What the tests of a file are about.
#[derive(Debug)]
pub(super) enum Tested {
    Sources(Sources),
    Station(PathBuf),
}

impl Plan {
    /// The minimum cycle time of a CPU of sources alone.
    pub(super) fn bare_cycle(&self) -> Span {
        self.cycle.unwrap_or(CYCLE)
    }
}

/// One test, understood as far as the file alone tells.
#[derive(Debug)]
pub(super) struct Test {
    pub(super) name: String,
    /// Its place in the file.
    pub(super) at: Range<usize>,
    pub(super) start: Command,
    pub(super) call: Option<Call>,
    pub(super) inputs: Cells,
    /// A recording that comes before the steps.
    pub(super) replay: Option<Recorded>,
    pub(super) steps: Vec<Step>,
}

/// The one block under test.
#[derive(Debug)]
pub(super) struct Call {
    pub(super) block: BlockId,
    pub(super) at: Range<usize>,
    pub(super) with: Vec<(Placed<String>, Placed<String>)>,
}

/// One step: run to a time, command, set, run on, expect.
#[derive(Debug)]
pub(super) struct Step {
    pub(super) at: Range<usize>,
    pub(super) until: Option<(Instant, Range<usize>)>,
    pub(super) command: Option<Command>,
    pub(super) set: Cells,
    pub(super) run: Run,
    pub(super) expect: Cells,
    pub(super) state: Option<(OperatingState, Range<usize>)>,
    pub(super) diagnostics: Vec<(u16, Range<usize>)>,
}

/// How long a step runs before it looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Run {
    Scans(u64),
    Time(Span),
    /// Until everything expected holds, at most this long.
    Within(Span),
}

/// Reads the text of a test file.
pub(super) fn parse(text: &str, name: &str, folder: &Path) -> Result<Plan, Vec<Finding>> {
    let source = Text { file: name, text };
    let file: TestFile = toml::from_str(text).map_err(|error| vec![of_toml(source, &error, DOCUMENT, |_, _| None)])?;
    let mut findings = Findings::new(source);
    let f = &mut findings;
    let words = [("de", Mnemonics::German), ("en", Mnemonics::International), ("auto", Mnemonics::Auto)];
    let mnemonics = choice(f, "mnemonics", file.mnemonics.as_ref(), &words).unwrap_or(Mnemonics::Auto);
    let paths = |list: &[Placed<String>]| list.iter().map(|p| folder.join(p.get_ref())).collect();
    let program = match &file.station {
        Some(station) => {
            let others = file.sources.first().or(file.symbols.first()).or(file.mnemonics.as_ref());
            if let Some(other) = others {
                let remedy = "a station names sources, symbols and mnemonics itself: leave them out here";
                f.error(CONTRADICTION, other.span(), "a station and sources", remedy);
            }
            Tested::Station(folder.join(station.get_ref()))
        }
        None => {
            if file.sources.is_empty() {
                f.error(
                    MISSING,
                    0..0,
                    "nothing is tested",
                    "add sources = [\"press.awl\"] or station = \"press.toml\"",
                );
            }
            let (files, symbols) = (paths(&file.sources), paths(&file.symbols));
            let library = standard(f, &file.libraries, &file.library);
            let places = ob1_station_file::places(f, &[&file.sources, &file.symbols], folder);
            Tested::Sources(Sources { files, symbols, mnemonics, library, places, ..Sources::default() })
        }
    };
    let cycle = file.cycle.as_ref().and_then(|cycle| time(f, cycle));
    if let (Some(Span::ZERO), Some(at)) = (cycle, &file.cycle) {
        f.error(VALUE, at.span(), "the cycle time is 0", "virtual time moves with the cycles: at least \"1us\"");
    }
    if file.test.is_empty() {
        f.error(MISSING, 0..0, "there is no test", "add [[test]] with name and [[test.step]]");
    }
    let tests = file.test.into_iter().map(|table| test(f, table, folder)).collect();
    findings.into_result(Plan { program, cycle, tests })
}

fn time(f: &mut Findings<'_>, value: &Placed<String>) -> Option<Span> {
    match parse_duration(value.get_ref()) {
        Ok(time) => Some(time),
        Err(message) => {
            f.error(VALUE, value.span(), message, "a number and a unit, in quotes: \"250ms\"");
            None
        }
    }
}

fn test(f: &mut Findings<'_>, table: Placed<TestTable>, folder: &Path) -> Test {
    let table = table.into_inner();
    let words = [Command::Warm, Command::Cold].map(|command| (command.name(), command));
    let start = choice(f, "start", table.start.as_ref(), &words).unwrap_or(Command::Warm);
    let named = |list: Vec<Placed<String>>| list.into_iter().map(Placed::into_inner).collect();
    let replay = table.replay.as_ref().map(|path| folder.join(path.get_ref()));
    if let (None, Some(first)) = (&replay, table.drive.first()) {
        f.error(CONTRADICTION, first.span(), "`drive` belongs to a replay", "add `replay`, or use `set`");
    }
    if let (Some(_), Some(call)) = (&replay, &table.call) {
        f.error(CONTRADICTION, call.span(), "a replay needs the whole program", "leave out `call` or `replay`");
    }
    let replay = replay.map(|path| Recorded { path, drive: named(table.drive), compare: table.compare });
    if table.step.is_empty() && replay.is_none() {
        f.error(MISSING, table.name.span(), "a test without a step", "add [[test.step]] with `expect`");
    }
    if let (None, Some((name, _))) = (&table.call, table.with.first_key_value()) {
        f.error(CONTRADICTION, name.span(), "`with` belongs to a test of one block", "add `call`, or use `set`");
    }
    let call = table.call.and_then(|call| {
        let block = BlockId::parse(call.get_ref()).filter(|id| !matches!(id.kind, BlockKind::Ob | BlockKind::Db));
        if block.is_none() {
            let message = format!("\"{}\" is not a block that can be called", call.get_ref());
            f.error(VALUE, call.span(), message, "a kind and a number: \"FC 9\", \"FB 41\"");
        }
        Some(Call { block: block?, at: call.span(), with: table.with.into_iter().collect() })
    });
    let steps = table.step.into_iter().map(|table| step(f, table)).collect();
    let (name, at) = (table.name.get_ref().clone(), table.name.span());
    Test { name, at, start, call, inputs: table.inputs, replay, steps }
}

fn step(f: &mut Findings<'_>, table: Placed<StepTable>) -> Step {
    let at = table.span();
    let table = table.into_inner();
    let commands = [Command::Stop, Command::Run, Command::Warm, Command::Cold];
    let commands = commands.map(|command| (command.name(), command));
    let command = choice(f, "command", table.command.as_ref(), &commands);
    let states = [("STOP", OperatingState::Stop), ("RUN", OperatingState::Run)];
    let state = choice(f, "state", table.state.as_ref(), &states);
    let state = state.zip(table.state.as_ref().map(Placed::span));
    let run = table.run.as_ref().and_then(|t| time(f, t)).map(Run::Time);
    let within = table.within.as_ref().and_then(|t| time(f, t)).map(Run::Within);
    let scans = table.scans.as_ref().and_then(|n| match u64::try_from(*n.get_ref()) {
        Ok(scans) if scans <= 1_000_000_000 => Some(Run::Scans(scans)),
        _ => {
            f.error(VALUE, n.span(), "`scans` is out of range", "0 to 1000000000");
            None
        }
    });
    let spans = [table.run.as_ref().map(Placed::span), table.scans.as_ref().map(Placed::span)];
    let spans = spans.into_iter().chain([table.within.as_ref().map(Placed::span)]).flatten();
    if let Some(second) = spans.clone().nth(1) {
        f.error(CONTRADICTION, second, "the time to run is given twice", "one of `run`, `scans` and `within`");
    }
    if table.within.is_some() && table.expect.is_empty() {
        f.error(MISSING, at.clone(), "`within` waits for nothing", "add `expect`, or use `run`");
    }
    let acts = command.is_some() || !table.set.is_empty();
    let run = run.or(scans).or(within).unwrap_or(Run::Scans(u64::from(acts)));
    let diagnostics = table.diagnostics.iter().filter_map(|event| Some((number_of(f, event)?, event.span()))).collect();
    let until = table.at.as_ref().and_then(|t| Some((Instant::START + time(f, t)?, t.span())));
    Step { at, until, command, set: table.set, run, expect: table.expect, state, diagnostics }
}

/// Number of an event, written as `2522h`.
fn number_of(f: &mut Findings<'_>, event: &Placed<String>) -> Option<u16> {
    let text = event.get_ref().trim_end_matches(['h', 'H']);
    let number = (text.len() == 4).then(|| u16::from_str_radix(text, 16).ok()).flatten();
    if number.is_none() {
        let message = format!("\"{}\" is not the number of an event", event.get_ref());
        f.error(VALUE, event.span(), message, "four hexadecimal digits, as `ob1 diag STATION` prints them: \"2522h\"");
    }
    number
}
