//! Program status as the socket tells it: from a question to a job, and from a pass to the lines of the source.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::UNIX_EPOCH;

use crate::program_facts::KnownProgram;
use ob1_access::why::{find_block, place_of};
use ob1_ir::CodeBlock;
use ob1_model::{BlockId, PASS_STATEMENTS, PASS_WAIT, Pass, PassEnd, PassLine, PassOrder};
use ob1_stl::print::{Listing, Printer};
use ob1_stl::{Mnemonics, Source};
use serde::{Deserialize, Serialize};

/// Which pass is wanted.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct PassWanted {
    /// The block: `FB 20`, or its name.
    pub block: String,
    /// Only a pass that this block has called, directly or through others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<String>,
    /// Only the lines of this network.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub network: Option<u16>,
    /// Only a pass with this data block: the instance of an FB, the opened data block of others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub db: Option<u16>,
    /// How long it is waited for, in milliseconds.
    #[serde(default = "two_seconds")]
    pub wait_ms: u64,
    /// Each statement is wanted too, for drawings.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub statements: bool,
}

fn two_seconds() -> u64 {
    2000
}

/// A pass through a block.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct PassStatus {
    /// Kind and number: `FB 20`.
    pub block: String,
    /// Its name; empty without one.
    pub name: String,
    /// `whole`, `stopped` (the CPU went to STOP in it), `not called` (in time).
    pub outcome: String,
    /// What is missing and why, in words; empty: nothing.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub cut: String,
    /// The organization block in which it ran.
    pub ob: u16,
    /// Who called it: `FC 6, press.awl:14`; empty for an organization block.
    pub caller: String,
    /// When it ended, in nanoseconds since the runtime started.
    pub time_ns: u64,
    /// The file of its source; empty: the lines are printed from the statements.
    pub file: String,
    /// The lines of the source, in its order.
    pub lines: Vec<LineStatus>,
    /// The statements of the block in order, those outside the network that was asked for too; empty: not asked for.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub statements: Vec<Option<Registers>>,
}

/// A line of a source.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct LineStatus {
    /// Its number in the file; 0: it is not of a file.
    pub line: u32,
    /// Text of the line, as it stands in the source.
    pub text: String,
    /// The network of its first statement; 0: it has none.
    pub network: u16,
    /// How many statements it has.
    pub statements: u32,
    /// How often its last statement that ran did so.
    pub times: u32,
    /// The registers behind that; none: nothing of it ran, or it was not recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub registers: Option<Registers>,
}

/// The registers behind a statement.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct Registers {
    /// Result of logic operation.
    pub rlo: bool,
    /// The bit last scanned or written.
    pub sta: bool,
    /// The status word: from bit 0 /FC, RLO, STA, OR, OS, OV, CC0, CC1, BR.
    pub status: u16,
    /// ACCU1, all 32 bits.
    pub accu1: u32,
    /// ACCU2, all 32 bits.
    pub accu2: u32,
    /// Address register 1, as an area pointer.
    pub ar1: u32,
    /// Address register 2, as an area pointer.
    pub ar2: u32,
    /// The number in the DB register; 0: none is open.
    pub db: u16,
    /// The number in the DI register.
    pub di: u16,
}

impl From<&PassLine> for Registers {
    fn from(line: &PassLine) -> Self {
        let ([accu1, accu2], [ar1, ar2], [db, di]) = (line.accus, line.addresses, line.blocks);
        let status = line.status;
        Self { rlo: status >> 1 & 1 == 1, sta: status >> 2 & 1 == 1, status, accu1, accu2, ar1, ar2, db, di }
    }
}

pub(super) fn named(known: &KnownProgram, text: &str) -> Result<BlockId, String> {
    let by_name = || known.blocks.iter().find(|fact| !fact.name.is_empty() && fact.name.eq_ignore_ascii_case(text));
    let id = BlockId::parse(text).or_else(|| by_name().map(|fact| fact.id));
    let id = id.ok_or_else(|| {
        format!("\"{text}\" is no block\n  = write OB 1, FC 5 or FB 20, or the name of a block of the program")
    })?;
    if find_block(&known.program, id).is_some() {
        return Ok(id);
    }
    let mut there: Vec<BlockId> = known.program.blocks.iter().map(|block| block.id).collect();
    there.sort_unstable();
    let list: Vec<String> = there.iter().take(20).map(BlockId::to_string).collect();
    let more = if there.len() > list.len() { ", ..." } else { "" };
    let what =
        if id.kind.is_system() { "is a block of the CPU: it has no statements" } else { "is not in the program" };
    Err(format!("{id} {what}\n  = blocks of statements: {}{more}", list.join(", ")))
}

/// The job for a question.
pub(super) fn order(known: &KnownProgram, wanted: &PassWanted) -> Result<PassOrder, String> {
    let id = named(known, &wanted.block)?;
    let from = wanted.from.as_deref().map(|from| named(known, from)).transpose()?;
    let stmts = find_block(&known.program, id).map_or(&[][..], |block| &block.code);
    let of_network = |network| {
        let first = stmts.iter().position(|stmt| stmt.network == network)?;
        Some((first, stmts.iter().rposition(|stmt| stmt.network == network)? + 1 - first))
    };
    let (first, count) = match wanted.network {
        None => (0, stmts.len()),
        Some(network) => of_network(network).ok_or_else(|| {
            let last = stmts.iter().map(|stmt| stmt.network).max().unwrap_or(0);
            format!("{id} has no statement in network {network}\n  = its last network with statements is {last}")
        })?,
    };
    Ok(PassOrder {
        block: id,
        from,
        db: wanted.db.unwrap_or(0),
        first: first as u32,
        count: count.min(PASS_STATEMENTS) as u32,
        wait: wanted.wait_ms.saturating_mul(1_000_000).min(PASS_WAIT),
        before: false,
    })
}

/// The registers behind each statement of a block; none where it did not run, or was not watched.
pub(super) fn statements(order: &PassOrder, pass: &Pass) -> Vec<Option<Registers>> {
    let (first, count) = (order.first as usize, order.count as usize);
    let watched = pass.lines.iter().take(count).map(|line| (line.times > 0).then(|| Registers::from(line)));
    let all = std::iter::repeat_n(None, first).chain(watched).chain(std::iter::repeat(None));
    // The one behind the last is the end.
    all.take(pass.statements.saturating_sub(1) as usize).collect()
}

/// What is told of a pass. `started`: when the runtime started, in nanoseconds since 1970.
pub(super) fn status(known: &KnownProgram, order: &PassOrder, pass: &Pass, started: u64) -> Result<PassStatus, String> {
    let id = order.block;
    let outcome = match pass.end {
        PassEnd::Whole => "whole",
        PassEnd::Stopped => "stopped",
        PassEnd::NotCalled => "not called",
        PassEnd::TooLong => {
            return Err(format!(
                "{id} is not watched: a pass of about {} statements without machine code would make the scan longer than \
                 [cpu] test_load allows\n  = raise test_load, or run it with engine = \"reference\" on a desk",
                pass.cut
            ));
        }
        PassEnd::Full => {
            return Err("two jobs of program status are under way already\n  = end one of them, then ask again".into());
        }
        PassEnd::NoBlock => return Err(changed(id)),
    };
    let block = find_block(&known.program, id).ok_or_else(|| changed(id))?;
    if pass.end != PassEnd::NotCalled && pass.statements as usize != block.code.len() + 1 {
        return Err(changed(id));
    }
    let caller =
        pass.caller.map_or_else(String::new, |(caller, statement)| place_of(&known.program, caller, statement));
    let text = known.places.file(id).and_then(|file| source(file, started));
    let mut cut = Vec::new();
    if pass.cut > 0 {
        cut.push(format!("cut: after {} statements of the pass nothing more was recorded ([cpu] test_load)", pass.cut));
    }
    if order.count as usize == PASS_STATEMENTS && block.code.len() > PASS_STATEMENTS {
        cut.push(format!(
            "cut: {PASS_STATEMENTS} of {} statements are shown; --network shows others",
            block.code.len()
        ));
    }
    let lines = match &text {
        Some(text) => of_source(block, order, pass, text),
        None => of_statements(known, block, order, pass),
    };
    Ok(PassStatus {
        block: id.to_string(),
        name: block.name.clone().unwrap_or_default(),
        outcome: outcome.to_owned(),
        cut: cut.join("; "),
        ob: pass.ob,
        caller,
        time_ns: pass.time,
        file: if text.is_some() { known.places.file(id).unwrap_or_default().to_owned() } else { String::new() },
        lines,
        statements: Vec::new(),
    })
}

fn changed(id: BlockId) -> String {
    format!("{id} has been changed or deleted meanwhile\n  = ask again")
}

/// The text of a source, if it is as it was when the program was loaded.
pub(super) fn source(file: &str, started: u64) -> Option<Source> {
    let path = Path::new(file);
    let modified = std::fs::metadata(path).ok()?.modified().ok()?.duration_since(UNIX_EPOCH).ok()?;
    if modified.as_nanos() > u128::from(started) {
        return None;
    }
    Some(Source::new(file, ob1_process::files::read(path, ob1_process::files::LONGEST).ok()?))
}

/// The line of some statements, by their indices in order.
fn line(
    order: &PassOrder,
    pass: &Pass,
    statements: impl DoubleEndedIterator<Item = usize>,
) -> (u32, Option<Registers>) {
    let of = |at: usize| pass.lines.get(at.checked_sub(order.first as usize)?);
    let ran = statements.filter_map(of).rfind(|line| line.times > 0);
    (ran.map_or(0, |line| line.times), ran.map(Registers::from))
}

/// The lines of the source, those between two statements too.
fn of_source(block: &CodeBlock, order: &PassOrder, pass: &Pass, source: &Source) -> Vec<LineStatus> {
    let text = source.text();
    let texts: Vec<&str> = text.lines().collect();
    let all = order.first as usize..(order.first + order.count) as usize;
    // The step of a FOR of SCL lies behind what stands in it.
    let mut by_line: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (at, stmt) in block.code.iter().enumerate().take(all.end).skip(all.start) {
        by_line.entry(stmt.line).or_default().push(at);
    }
    let (Some((first, _)), Some((last, _))) = (by_line.first_key_value(), by_line.last_key_value()) else {
        return Vec::new();
    };
    let one = |number: u32| {
        let text = texts.get((number as usize).wrapping_sub(1)).map_or("", |text| text.trim_end()).to_owned();
        let Some(statements) = by_line.get(&number) else {
            return LineStatus { line: number, text, ..LineStatus::default() };
        };
        let first = statements.first().and_then(|at| block.code.get(*at));
        let network = first.map_or(0, |stmt| stmt.network);
        let (times, registers) = line(order, pass, statements.iter().copied());
        LineStatus { line: number, text, network, statements: statements.len() as u32, times, registers }
    };
    (*first..=*last).map(one).collect()
}

/// A block without its source: as it is printed, else its operations.
fn of_statements(known: &KnownProgram, block: &CodeBlock, order: &PassOrder, pass: &Pass) -> Vec<LineStatus> {
    let callees = |id| match find_block(&known.program, id) {
        Some(block) => Some(&block.interface),
        None => known.library.get(id).map(|block| &block.interface),
    };
    let printer = Printer::new(Mnemonics::Auto, &callees);
    let each = || block.code.iter().enumerate().map(|(at, stmt)| (at, stmt.op.to_string())).collect();
    let texts: Vec<(usize, String)> = printer.lines(block, &Listing::default()).unwrap_or_else(|_| each());
    let all = order.first as usize..(order.first + order.count) as usize;
    let ends = texts.iter().map(|(at, _)| *at).skip(1).chain([block.code.len()]);
    let shown = texts.iter().zip(ends).filter(|((at, _), _)| all.contains(at));
    shown
        .map(|((at, text), end)| {
            let (times, registers) = line(order, pass, *at..end);
            let network = block.code.get(*at).map_or(0, |stmt| stmt.network);
            LineStatus { line: 0, text: text.clone(), network, statements: (end - at) as u32, times, registers }
        })
        .collect()
}
