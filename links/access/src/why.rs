//! Why a bit has its value, or a block is not called: from the question to a pass through the block that decides, and
//! from that pass to its statements.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Deref;

use ob1_ir::why::{Observed, Skipped, Term};
use ob1_ir::{BitTest, Call, CodeBlock, Number, Op, Place, Program, Target};
use ob1_model::{Area, BitAddr, BlockId, Cell, DataType, PASS_STATEMENTS, Pass, PassEnd, PassLine, PassOrder, Section};
use ob1_stl::{CrossReference, Mnemonics, Reference};
use serde::{Deserialize, Serialize};

use crate::Names;

/// A question: why a bit has its value, or a block is not called.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct WhyWanted {
    /// A bit by its name (`A 4.0`, `Q 4.0`, a symbol, `DB20.on`), or a block (`FB 20`).
    pub operand: String,
    /// The value that it has.
    #[serde(default)]
    pub now: bool,
    /// Of a name of a block, `FB 20 #run`: only a pass with this data block, and only one that this block has called.
    #[serde(default, skip_serializing_if = "Inside::is_any")]
    pub inside: Inside,
    /// Of several blocks that write it, this one: by its place among [`WhyStatus::blocks`].
    #[serde(default)]
    pub block: usize,
    /// How long a pass through that block is waited for, in milliseconds.
    pub wait_ms: u64,
}

/// Which pass through a block is meant.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct Inside {
    /// The name there: `FB 20 #run`.
    pub ask: String,
    /// Number of the data block: instance of an FB; `None`: any.
    pub db: Option<u16>,
    /// A block that has called it; `None`: any.
    pub from: Option<String>,
}

impl Inside {
    fn is_any(&self) -> bool {
        *self == Self::default()
    }
}

/// What is known of it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct WhyStatus {
    /// What was asked for, in the mnemonics of the source, with its symbol.
    pub operand: String,
    /// Its value: that of the pass, where a statement gave it one.
    pub now: bool,
    /// The blocks with statements that write it, or call it.
    pub blocks: Vec<String>,
    /// Those statements, each with its place.
    pub writers: Vec<String>,
    /// The block that was watched; empty: nothing writes it.
    pub block: String,
    /// `whole`, `stopped`, `not called`, `other`: the pass has not what is asked for.
    pub outcome: String,
    /// The statement that gave it its value, or the jump that led away from it.
    pub statement: Option<StatementStatus>,
    /// It gave the bit its value, and did not only leave it as it was.
    pub took_effect: bool,
    /// Nothing that writes it ran: the statement is the one that led away.
    pub skipped: bool,
    /// What is scanned in front of the statement.
    pub terms: Vec<TermStatus>,
    /// The scans that decide, each for itself.
    pub decisive: Vec<TermStatus>,
    /// Other bits may decide as well: not everything is known.
    pub is_open: bool,
    /// The statement is a call: what the called block writes there.
    #[serde(default)]
    pub inside: Option<Inside>,
}

/// A statement with its place.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct StatementStatus {
    /// `FB 20, network 2, press.awl:14`.
    pub place: String,
    /// Its text in the source.
    pub text: String,
}

/// A scan that took part in the result.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct TermStatus {
    /// Where, and its text.
    pub statement: StatementStatus,
    /// Its operand with its symbol: `E 1.0 "Guard"`; of a parameter with the actual: `FB 20 #on = E 0.0`.
    pub operand: String,
    /// How to ask for it; empty: nothing more is known of it.
    pub ask: String,
    /// The bit that it found.
    pub bit: bool,
    /// With its bit the other way the result is another one.
    pub turns: bool,
    /// Another statement of the program gives it its value.
    pub is_written: bool,
    /// Of a name of the block: which pass through it is meant.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inside: Option<Inside>,
}

impl WhyStatus {
    /// Of the answers for several blocks that write it the highest counts: the last block that gave the bit the value
    /// it has.
    #[must_use]
    pub fn rank(&self, now: bool) -> (bool, bool, bool) {
        (self.outcome != "not called", !self.skipped, self.took_effect && self.now == now)
    }
}

/// What is known of a program.
pub struct Known<'k, P> {
    /// Who reads and writes what.
    pub all: &'k CrossReference<P>,
    /// The names of its cells.
    pub names: &'k Names,
    /// The line of a block's source, where it is at hand.
    pub line: &'k dyn Fn(BlockId, u32) -> Option<String>,
    /// The set of mnemonics of a block's source.
    pub set: &'k dyn Fn(BlockId) -> Mnemonics,
}

impl<P> std::fmt::Debug for Known<'_, P> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Known").finish_non_exhaustive()
    }
}

impl<P: Deref<Target = Program>> Known<'_, P> {
    fn program(&self) -> &Program {
        self.all.program()
    }
}

/// A block of a program.
#[must_use]
pub fn find_block(program: &Program, id: BlockId) -> Option<&CodeBlock> {
    program.blocks.iter().find(|block| block.id == id)
}

/// A statement: `FC 6, press.awl:14`.
#[must_use]
pub fn place_of(program: &Program, id: BlockId, statement: u32) -> String {
    let block = find_block(program, id);
    let line = block.and_then(|code| code.code.get(statement as usize)).map(|stmt| stmt.line).filter(|line| *line > 0);
    match block.and_then(|block| program.sources.get(block.source as usize)).zip(line) {
        Some((file, line)) => format!("{id}, {file}:{line}"),
        None => id.to_string(),
    }
}

/// A question, resolved against a program.
#[derive(Debug)]
pub struct Question {
    operand: String,
    symbol: Option<String>,
    now: bool,
    subject: Subject,
    /// Block, and the statements in it that write the bit or call the block.
    sites: Vec<(BlockId, Vec<usize>)>,
    writers: Vec<String>,
    /// The parameters by which calls write it: block, line, `FB 20.run`.
    via: Vec<(BlockId, u32, String)>,
    chosen: usize,
    /// The first statement of the pass.
    first: usize,
}

#[derive(Debug)]
enum Subject {
    Bit(BitTest),
    /// A name of a block.
    Own(BlockId, Place),
    Block(BlockId),
}

/// The question, and the pass that it needs; none: nothing writes the bit.
///
/// # Errors
/// The operand is unknown, or cannot be followed; in words for who has asked.
pub fn order<P: Deref<Target = Program>>(
    known: &Known<'_, P>,
    wanted: &WhyWanted,
) -> Result<(Question, Option<PassOrder>), String> {
    let (all, program) = (known.all, known.program());
    let (operand, symbol, subject) = subject(program, known.names, &wanted.operand)?;
    let references = match &subject {
        Subject::Bit(test) => all.writers(test),
        Subject::Block(id) => all.callers(*id),
        Subject::Own(..) => Vec::new(),
    };
    let mut sites: Vec<(BlockId, Vec<usize>)> = Vec::new();
    let mut own = Vec::new();
    if let Subject::Own(id, place) = subject
        && let Some(block) = find_block(program, id)
    {
        let writes = |at: &usize| matches!(&block.code[*at].op, op if op.writes() && op.operand().is_some_and(|o| o.place == place));
        let statements: Vec<usize> = (0..block.code.len()).filter(writes).collect();
        own = statements.iter().map(|at| place_of(program, id, *at as u32)).collect();
        sites.push((id, statements));
    }
    for reference in &references {
        let Some(block) = find_block(program, reference.block) else { continue };
        let of_line = (0..block.code.len()).filter(|at| is_site(block, *at, reference, &subject));
        let at = sites.iter().position(|(id, _)| *id == block.id).unwrap_or_else(|| {
            sites.push((block.id, Vec::new()));
            sites.len() - 1
        });
        if let Some((_, statements)) = sites.get_mut(at) {
            statements.extend(of_line);
            statements.sort_unstable();
            statements.dedup();
        }
    }
    sites.retain(|(_, statements)| !statements.is_empty());
    let via = references.iter().filter_map(|r| Some((r.block, r.line, r.via.clone()?))).collect();
    let writers = references.iter().map(|r| {
        let via = r.via.as_ref().map(|via| format!(", as {via}")).unwrap_or_default();
        format!("{}{via}", r.place(program))
    });
    let mut question = Question {
        operand,
        symbol,
        now: wanted.now,
        subject,
        writers: writers.chain(own).collect(),
        via,
        chosen: wanted.block,
        sites,
        first: 0,
    };
    let Some((id, statements)) = question.sites.get(wanted.block) else { return Ok((question, None)) };
    let length = find_block(program, *id).map_or(0, |block| block.code.len());
    // The part of a long block that ends with the last of these statements.
    let end = statements.last().map_or(0, |last| last + 1).min(length);
    let first = end.saturating_sub(PASS_STATEMENTS);
    let order = PassOrder {
        block: *id,
        from: wanted.inside.from.as_deref().and_then(BlockId::parse),
        db: wanted.inside.db.unwrap_or(0),
        first: first as u32,
        count: (length - first).min(PASS_STATEMENTS) as u32,
        wait: wanted.wait_ms.saturating_mul(1_000_000).min(ob1_model::PASS_WAIT),
        before: false,
    };
    question.first = first;
    Ok((question, Some(order)))
}

/// What a name means: the operand in German mnemonics, its symbol, and what it is.
fn subject(program: &Program, names: &Names, text: &str) -> Result<(String, Option<String>, Subject), String> {
    if let Some(id) = BlockId::parse(text) {
        return Ok((id.to_string(), None, Subject::Block(id)));
    }
    if let Some((block, name)) = text.split_once('#')
        && let Some(id) = BlockId::parse(block)
    {
        let place = find_block(program, id).and_then(|block| own(block, name.trim()));
        let place = place.ok_or_else(|| format!("{id} has no bit #{}", name.trim()))?;
        return Ok((format!("{id} #{}", name.trim()), None, Subject::Own(id, place)));
    }
    let typed = names.typed(text)?;
    let test = match (typed.cell, &typed.ty) {
        (Cell::Area(area, bit), DataType::Bool) => BitTest::Bit(Place::Fixed(area, BitAddr(bit))),
        (Cell::Db(db, bit), DataType::Bool) => BitTest::Bit(Place::InDb(db, BitAddr(bit))),
        (Cell::Timer(n), _) => BitTest::Timer(ob1_ir::Number::Fixed(n)),
        (Cell::Counter(n), _) => BitTest::Counter(ob1_ir::Number::Fixed(n)),
        (_, ty) => {
            return Err(format!(
                "{} is a {}: only of bits, timers, counters and blocks it can be said why\n  = ob1 xref shows who writes it",
                text.trim(),
                ty.name()
            ));
        }
    };
    let operand = test.to_string();
    let is_it = |symbol: &&ob1_ir::Symbol| names.typed(&symbol.name).is_ok_and(|of| of.cell == typed.cell);
    let symbol = program.symbols.iter().find(is_it).map(|symbol| symbol.name.clone());
    Ok((operand, symbol, Subject::Bit(test)))
}

/// The place of a name of a block.
fn own(block: &CodeBlock, name: &str) -> Option<Place> {
    let interface = &block.interface;
    let param = interface.find(name).filter(|param| param.ty == DataType::Bool)?;
    Some(match param.section {
        Section::Temp => Place::Fixed(Area::Local, param.at),
        _ if block.id.kind.has_instance() => Place::Instance(param.at),
        _ => Place::Param { index: interface.formal(name)?.0 as u16, at: BitAddr(0) },
    })
}

/// Whether a statement is the one that a reference is about.
fn is_site(block: &CodeBlock, at: usize, reference: &Reference, subject: &Subject) -> bool {
    let Some(stmt) = block.code.get(at).filter(|stmt| stmt.line == reference.line) else { return false };
    match (&stmt.op, subject) {
        (Op::Call(call), Subject::Block(id)) => match call.target {
            Target::Block(of) | Target::Local(of, _) => of == *id,
            Target::Indirect(kind, _) => kind == id.kind,
        },
        (Op::Call(_), Subject::Bit(_)) => reference.via.is_some(),
        (op, Subject::Bit(_)) => op.writes() || op.number().is_some(),
        _ => false,
    }
}

/// What is told of it.
///
/// # Errors
/// Why there is no answer: the block has changed, or is not watched.
pub fn status<P: Deref<Target = Program>>(
    known: &Known<'_, P>,
    question: &Question,
    pass: Option<&Pass>,
) -> Result<WhyStatus, String> {
    let program = known.program();
    let site = question.sites.get(question.chosen);
    let set = site.map_or(Mnemonics::German, |(id, _)| (known.set)(*id));
    let mut told = WhyStatus {
        operand: named(&question.operand, question.symbol.as_deref(), set),
        now: question.now,
        blocks: question.sites.iter().map(|(id, _)| id.to_string()).collect(),
        writers: question.writers.clone(),
        ..WhyStatus::default()
    };
    let (Some((id, statements)), Some(pass)) = (site, pass) else { return Ok(told) };
    let Some(block) = find_block(program, *id) else { return Err(format!("{id} has been changed meanwhile")) };
    told.block = id.to_string();
    told.outcome = match pass.end {
        PassEnd::Whole => "whole",
        PassEnd::Stopped => "stopped",
        PassEnd::NotCalled => "not called",
        PassEnd::Full => return Err("two jobs of program status are under way already\n  = end one of them".into()),
        PassEnd::TooLong => return Err(format!("{id} is not watched: [cpu] test_load does not allow it")),
        PassEnd::NoBlock => return Err(format!("{id} has been changed meanwhile\n  = ask again")),
    }
    .to_owned();
    if pass.end == PassEnd::NotCalled {
        return Ok(told);
    }
    let memory = RefCell::default();
    let disturbs = |call: &Call, test: &BitTest| disturbs(known.all, &mut memory.borrow_mut(), call, test);
    let code = block.code.get(question.first..).unwrap_or_default();
    let observed = Observed { code, lines: &pass.lines, disturbs: &disturbs };
    let caller = pass.caller.and_then(|(id, at)| Some((id, find_block(program, id)?.code.get(at as usize)?.line)));
    let here = Here { known, block, set, first: question.first, caller, lines: &pass.lines };
    let statements: Vec<usize> = statements.iter().filter_map(|at| at.checked_sub(question.first)).collect();
    here.decide(&mut told, &observed, &statements, question);
    Ok(told)
}

/// An operand with its symbol: `E 1.0 "Guard"`.
fn named(operand: &str, symbol: Option<&str>, set: Mnemonics) -> String {
    let symbol = symbol.map_or_else(String::new, |symbol| format!(" \"{symbol}\""));
    format!("{}{symbol}", ob1_stl::in_set(operand, set))
}

/// What has been found out for a question: a block may call hundreds of others.
#[derive(Default)]
struct Memory {
    reached: BTreeMap<BlockId, BTreeSet<BlockId>>,
    writers: Vec<(BitTest, BTreeSet<BlockId>)>,
}

/// Whether what a call leads to writes what is scanned.
fn disturbs<P: Deref<Target = Program>>(
    all: &CrossReference<P>,
    memory: &mut Memory,
    call: &Call,
    test: &BitTest,
) -> bool {
    let (Target::Block(id) | Target::Local(id, _)) = call.target else { return true };
    let reached = memory.reached.entry(id).or_insert_with(|| all.reached_from(id));
    // A block's own parameters are its caller's operands, which this call may get as well.
    let hidden = matches!(test, BitTest::Bit(Place::Param { .. } | Place::Memory(..) | Place::Register(..)));
    let at = memory.writers.iter().position(|(of, _)| of == test).unwrap_or_else(|| {
        let writers = all.writers(test).into_iter().map(|reference| reference.block).collect();
        memory.writers.push((*test, writers));
        memory.writers.len() - 1
    });
    let writes = |(_, writers): &(BitTest, BTreeSet<BlockId>)| writers.iter().any(|block| reached.contains(block));
    hidden || memory.writers.get(at).is_some_and(writes)
}

/// A block that was watched.
struct Here<'h, P> {
    known: &'h Known<'h, P>,
    block: &'h CodeBlock,
    set: Mnemonics,
    /// The first statement that was recorded.
    first: usize,
    /// Who called it, and the line.
    caller: Option<(BlockId, u32)>,
    /// What was recorded of its statements.
    lines: &'h [PassLine],
}

impl<P: Deref<Target = Program>> Here<'_, P> {
    fn decide(&self, told: &mut WhyStatus, observed: &Observed<'_>, statements: &[usize], question: &Question) {
        let ran = |at: &usize| observed.lines.get(*at).is_some_and(|line| line.times > 0);
        let last = statements.iter().rev().copied().find(ran);
        let Some(at) = last else {
            told.skipped = true;
            // The last of them: it would have decided.
            if let Some(Skipped::By(jump)) = statements.last().map(|at| observed.skipped(*at)) {
                told.statement = Some(self.statement(jump));
                told.terms = self.terms(&observed.terms(jump));
            }
            return;
        };
        let place = observed.code.get(at).and_then(|stmt| match &stmt.op {
            Op::Assign(place) | Op::Set(place) | Op::Reset(place) => Some(*place),
            _ => None,
        });
        let why = place.filter(|_| !matches!(question.subject, Subject::Block(_))).and_then(|place| {
            // Its value behind the pass: what the last statement with an effect gave it.
            let first = observed.why(place, question.now)?;
            let now = first.writer.filter(|_| first.took_effect).map(|writer| self.gave(observed, writer));
            let why =
                if now.is_some_and(|now| now != question.now) { observed.why(place, !question.now)? } else { first };
            Some((why, now.unwrap_or(question.now)))
        });
        match why {
            Some((why, now)) => {
                (told.now, told.took_effect, told.is_open) = (now, why.took_effect, why.is_open);
                told.statement = why.writer.map(|writer| self.statement(writer));
                told.terms = self.terms(&why.terms);
                told.decisive = self.terms(&why.decisive);
            }
            // A call, a timer, a word: what is scanned in front of it is what can be said.
            None => {
                told.outcome = "other".to_owned();
                told.statement = Some(self.statement(at));
                told.terms = self.terms(&observed.terms(at));
                told.took_effect = true;
                told.inside = self.inside(self.first + at, question);
            }
        }
    }

    /// The bit that a statement gave.
    fn gave(&self, observed: &Observed<'_>, at: usize) -> bool {
        match observed.code.get(at).map(|stmt| &stmt.op) {
            Some(Op::Set(_)) => true,
            Some(Op::Reset(_)) => false,
            _ => observed.lines.get(at).is_some_and(|line| line.status & 1 << 2 != 0),
        }
    }

    /// Where a called block of the program writes it.
    fn inside(&self, at: usize, question: &Question) -> Option<Inside> {
        let stmt = self.block.code.get(at)?;
        let Op::Call(call) = &stmt.op else { return None };
        let is_here = |(id, line, _): &&(BlockId, u32, String)| (*id, *line) == (self.block.id, stmt.line);
        let (block, name) = question.via.iter().find(is_here)?.2.split_once('.')?;
        find_block(self.known.program(), BlockId::parse(block)?)?;
        let db = if let Some(Number::Fixed(db)) = call.instance { Some(db) } else { None };
        Some(Inside { ask: format!("{block} #{name}"), db, from: Some(self.block.id.to_string()) })
    }

    /// The actual parameter behind a formal one of this block, in the call of the pass.
    fn actual(&self, place: Place) -> Option<&Reference> {
        let param = match place {
            Place::Instance(at) => self.block.interface.formals().find(|param| param.at == at)?,
            Place::Param { index, .. } => self.block.interface.formals().nth(usize::from(index))?,
            _ => return None,
        };
        let (caller, line) = self.caller?;
        let via = format!("{}.{}", self.block.id, param.name);
        let is_it = |r: &&Reference| (r.block, r.line) == (caller, line) && r.via.as_ref() == Some(&via);
        // The cell of the instance is written by the same call.
        self.known.all.all.iter().filter(is_it).find(|r| !r.operand.contains('#') && !r.operand.starts_with("DB"))
    }

    fn statement(&self, at: usize) -> StatementStatus {
        let Some(stmt) = self.block.code.get(self.first + at) else { return StatementStatus::default() };
        let text = (self.known.line)(self.block.id, stmt.line).map(|line| line.trim().to_owned());
        let network = format!("{}, network {}", self.block.id, stmt.network);
        let file = self.known.program().sources.get(self.block.source as usize);
        let place = match file.filter(|_| stmt.line > 0) {
            Some(file) => format!("{network}, {file}:{}", stmt.line),
            None => network,
        };
        StatementStatus { place, text: text.unwrap_or_else(|| stmt.op.to_string()) }
    }

    /// A name of this block that the block itself writes, in the instance and from the caller of this pass.
    fn own_name(&self, test: &BitTest, statement: usize, operand: &str) -> Option<Inside> {
        let BitTest::Bit(place @ (Place::Instance(_) | Place::Param { .. })) = test else { return None };
        let writes = |stmt: &ob1_ir::Stmt| stmt.op.writes() && stmt.op.operand().is_some_and(|of| of.place == *place);
        let is_named = operand.starts_with(&format!("{} #", self.block.id));
        (is_named && self.block.code.iter().any(writes)).then(|| Inside {
            ask: operand.to_owned(),
            db: self
                .lines
                .get(statement)
                .map(|line| line.blocks[1])
                .filter(|db| *db > 0 && self.block.id.kind.has_instance()),
            from: self.caller.map(|(id, _)| id.to_string()),
        })
    }

    fn terms(&self, terms: &[Term]) -> Vec<TermStatus> {
        terms.iter().filter_map(|term| self.term(term)).collect()
    }

    fn term(&self, term: &Term) -> Option<TermStatus> {
        let stmt = self.block.code.get(self.first + term.statement)?;
        let Op::Scan { test, .. } = &stmt.op else { return None };
        let operand = test.to_string();
        let reference = self.known.all.named_at(self.block.id, stmt.line, &operand);
        let operand = reference.map_or(operand, |reference| reference.operand.clone());
        let symbol = reference.and_then(|reference| reference.symbol.as_deref());
        if let BitTest::Bit(place) = test
            && let Some(actual) = self.actual(*place)
        {
            let test = self.known.names.typed(&actual.operand).ok().and_then(|typed| match typed.cell {
                Cell::Area(area, bit) => Some(BitTest::Bit(Place::Fixed(area, BitAddr(bit)))),
                _ => None,
            });
            let outer = named(&actual.operand, actual.symbol.as_deref(), self.set);
            return Some(TermStatus {
                statement: self.statement(term.statement),
                operand: format!("{operand} = {outer}"),
                ask: ob1_stl::in_set(&actual.operand, self.set),
                bit: term.bit,
                turns: term.turns,
                is_written: test.is_some_and(|test| !self.known.all.writers(&test).is_empty()),
                inside: None,
            });
        }
        let inside = self.own_name(test, term.statement, &operand);
        let is_written = inside.is_some() || term.written_by.is_some() || !self.known.all.writers(test).is_empty();
        let known = matches!(
            test,
            BitTest::Bit(Place::Fixed(Area::Input | Area::Output | Area::Memory, _) | Place::InDb(..))
                | BitTest::Timer(_)
                | BitTest::Counter(_)
        );
        Some(TermStatus {
            statement: self.statement(term.statement),
            ask: match &inside {
                Some(inside) => inside.ask.clone(),
                None if known && is_written => ob1_stl::in_set(&operand, self.set),
                None => String::new(),
            },
            inside,
            operand: named(&operand, symbol, self.set),
            bit: term.bit,
            turns: term.turns,
            is_written,
        })
    }
}
