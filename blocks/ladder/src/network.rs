//! What the crate works on: the statements of one network, each with the texts it is shown by.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use ob1_ir::{CodeBlock, Notation, NumberFormat, Op, Place, Target};
use ob1_model::{BlockId, Interface, Section};
use ob1_stl::Mnemonics;
use ob1_stl::print::{Callees, Listing, Printer, Shown};

/// A network of a block, with the texts it is shown by.
#[derive(Clone, Debug, Default)]
pub struct Network {
    /// Its number, from 1.
    pub number: u16,
    /// Its title; empty without one.
    pub title: String,
    /// Its comment; empty without one.
    pub comment: String,
    /// The label of its first statement.
    pub label: String,
    /// Its statements, in their order.
    pub statements: Vec<Statement>,
    /// The operations that jumps lead to, and how many lead to each. Of the network's own only.
    pub(crate) targets: BTreeMap<u32, u32>,
    /// The first byte of the local data that nobody has declared: the compiler's.
    pub(crate) hidden_local: u32,
}

/// One statement of it.
#[derive(Clone, Debug)]
pub struct Statement {
    /// The operation that does what it says.
    pub op: Op,
    /// All its operations, as indices into the block; [`Statement::op`] is the last one.
    pub ops: Range<u32>,
    /// Its operand: the address, `#name` of a variable, a constant, a label; of a call what is called.
    pub operand: String,
    /// The symbol of the operand.
    pub symbol: String,
    /// The actual parameters that are supplied.
    pub actuals: Vec<Actual>,
    /// A jump leads to the first statement of a network, or to the block's end.
    pub(crate) jumps_to_network: bool,
}

/// An actual parameter of a call, as it is shown.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Actual {
    /// Its place among the call's arguments.
    pub argument: u16,
    /// Name of its formal.
    pub name: String,
    /// The actual: an address, a constant, `#name`.
    pub text: String,
    /// Symbol of the actual; empty without one.
    pub symbol: String,
    /// At the right side of the box.
    pub is_output: bool,
}

/// A block with the names that its networks are shown by.
#[derive(Clone, Copy)]
pub struct View<'v> {
    /// The mnemonics, which are those of operands too: `E 0.0` or `I 0.0`.
    pub mnemonics: Mnemonics,
    /// Interfaces of the blocks that are called.
    pub callees: &'v Callees<'v>,
    /// Symbols by the address they stand for, as the mnemonics write it.
    pub symbols: &'v BTreeMap<String, String>,
    /// Labels, titles, comments, how constants are written.
    pub listing: &'v Listing,
}

impl std::fmt::Debug for View<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("View").field("mnemonics", &self.mnemonics).finish_non_exhaustive()
    }
}

impl View<'_> {
    /// The networks of a block, the empty ones between them too.
    pub fn networks(&self, block: &CodeBlock) -> Vec<Network> {
        let plain = Printer::new(self.mnemonics, self.callees);
        let named = plain.with_symbols(self.symbols);
        let hidden_local = block.interface.declared_temps();
        let mut starts = BTreeSet::from([block.code.len() as u32]);
        let mut last = 0;
        for (at, stmt) in (0u32..).zip(&block.code) {
            if stmt.network != last {
                starts.insert(at);
                last = stmt.network;
            }
        }
        let listing = Listing { notations: notations(block, self.listing), ..self.listing.clone() };
        let shown = plain.shown(block, &listing);
        let symbols = named.shown(block, &listing);
        let count = self.listing.networks.len().max(usize::from(last)).max(1);
        let mut networks: Vec<Network> =
            (1u16..).take(count).map(|number| Network { number, hidden_local, ..Network::default() }).collect();
        for (network, (title, comment)) in networks.iter_mut().zip(&self.listing.networks) {
            (network.title, network.comment) = (title.clone(), comment.clone());
        }
        for (one, symbol) in shown.into_iter().zip(symbols) {
            let (first, end) = (one.at, one.at + one.used);
            let Some(stmt) = end.checked_sub(1).and_then(|last| block.code.get(last as usize)) else { continue };
            let Some(network) = networks.get_mut(usize::from(stmt.network.max(1)) - 1) else { continue };
            if network.statements.is_empty() {
                network.label = one.label.clone();
            }
            let statement = self.statement(&stmt.op, first..end, one, symbol, &starts);
            network.statements.push(statement);
        }
        let mut leads = |to: u32| {
            let network = block.code.get(to as usize).map_or(0, |stmt| stmt.network);
            if let Some(network) = usize::from(network).checked_sub(1).and_then(|at| networks.get_mut(at)) {
                *network.targets.entry(to).or_default() += 1;
            }
        };
        for stmt in &block.code {
            match &stmt.op {
                Op::Jump(_, to) | Op::Loop(to) => leads(*to),
                Op::JumpList { targets, otherwise } => targets.iter().chain([otherwise]).for_each(|to| leads(*to)),
                _ => {}
            }
        }
        networks
    }

    fn statement(&self, op: &Op, ops: Range<u32>, one: Shown, named: Shown, starts: &BTreeSet<u32>) -> Statement {
        let other = |plain: &str, named: &str| if plain == named { String::new() } else { unquoted(named) };
        let target = match op {
            Op::Call(call) => match call.target {
                Target::Block(id) | Target::Local(id, _) => (self.callees)(id).map(|callee| (id, callee)),
                Target::Indirect(..) => None,
            },
            _ => None,
        };
        let symbol = match target {
            Some((id, _)) => self.symbols.get(&id.to_string()).cloned().unwrap_or_default(),
            None => other(&one.operand, &named.operand),
        };
        let actuals = one.actuals.into_iter().zip(named.actuals).map(|((name, text), (_, symbol))| {
            let (argument, is_output) = target.map_or((0, false), |(_, callee)| formal(callee, &name));
            Actual { argument, name: unquoted(&name), symbol: other(&text, &symbol), text, is_output }
        });
        Statement {
            actuals: actuals.collect(),
            op: op.clone(),
            ops,
            operand: one.operand,
            symbol,
            jumps_to_network: matches!(op, Op::Jump(_, to) if starts.contains(to)),
        }
    }
}

/// How constants are written: as it is known, else as what is done with them tells.
fn notations(block: &CodeBlock, listing: &Listing) -> BTreeMap<u32, Notation> {
    let mut all = listing.notations.clone();
    let op = |at: usize| block.code.get(at).map(|stmt| &stmt.op);
    for (at, stmt) in block.code.iter().enumerate() {
        if !matches!(stmt.op, Op::LoadConst(_)) {
            continue;
        }
        let second = op(at + 1).is_some_and(Op::loads).then(|| op(at + 2)).flatten();
        let notation = match (op(at + 1), second) {
            (Some(Op::StartTimer(..)), _) => Notation::S5Time,
            (Some(Op::SetCounter(_)), _) => Notation::Count,
            (Some(Op::Compare(format, _) | Op::Arithmetic(format, _)), _)
            | (_, Some(Op::Compare(format, _) | Op::Arithmetic(format, _))) => match format {
                NumberFormat::Int => Notation::Int,
                NumberFormat::DInt => Notation::DInt,
                NumberFormat::Real => Notation::Real,
            },
            _ => continue,
        };
        all.entry(at as u32).or_insert(notation);
    }
    all
}

/// A name without its quotes.
fn unquoted(name: &str) -> String {
    name.strip_prefix('"').and_then(|name| name.strip_suffix('"')).unwrap_or(name).to_owned()
}

/// The place of a formal, and whether it gives something back.
fn formal(callee: &Interface, name: &str) -> (u16, bool) {
    let name = unquoted(name);
    let found = (0u16..).zip(callee.formals()).find(|(_, formal)| formal.name == name);
    found.map_or((0, false), |(at, formal)| (at, matches!(formal.section, Section::Output | Section::Return)))
}

impl Network {
    /// A bit of the local data that belongs to the compiler.
    pub(crate) const fn is_hidden(&self, place: &Place) -> bool {
        matches!(place, Place::Fixed(ob1_model::Area::Local, at) if at.byte() >= self.hidden_local)
    }

    /// Nothing but `NOP 0`: somebody has emptied it.
    pub fn is_empty(&self) -> bool {
        self.statements.iter().all(|statement| statement.op == Op::Nop)
    }

    /// The first statement whose operations hold this one of the block.
    pub fn at_op(&self, op: u32) -> Option<u32> {
        let at = self.statements.partition_point(|statement| statement.ops.end <= op);
        self.statements.get(at).filter(|statement| statement.ops.start <= op).map(|_| at as u32)
    }
}

/// A block's name in a title: `FC 5 "Valve"`.
pub fn title(id: BlockId, name: Option<&str>) -> String {
    name.map_or_else(|| id.to_string(), |name| format!("{id} \"{name}\""))
}
