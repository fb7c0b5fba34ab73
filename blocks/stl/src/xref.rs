//! The cross-reference: who reads and writes what.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use ob1_ir::{
    AddressRegister, Arg, BitTest, Call, CallMode, CodeBlock, DataBlock, Number, Op, Operand, Place, Program, Stmt,
    Symbol, Target, Width,
};
use ob1_model::{Area, BitAddr, BlockId, BlockKind, DataType, Interface, Layout, Param, Section};

use crate::library::Library;
use crate::names;
use crate::symbols;
use crate::words::Words;
use crate::world::Symbolic;

/// What a statement does to an operand.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Access {
    /// It reads.
    Read,
    /// It writes.
    Write,
    /// Both: edge bits, in/outs, parameters of blocks that are not known.
    ReadWrite,
    /// It calls the block.
    Call,
    /// It opens the data block, or runs a function block on it.
    Open,
}

impl Access {
    /// `R`, `W`, `RW`, `call`, `open`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Access::Read => "R",
            Access::Write => "W",
            Access::ReadWrite => "RW",
            Access::Call => "call",
            Access::Open => "open",
        }
    }
}

/// One use of an operand.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Reference {
    /// Puts operands in the order of a cross-reference: E, A, M, peripheral, T, Z, DB, blocks, then what is indirect,
    /// then the names of single blocks; by number and address within.
    order: (u8, u32, u32, u8),
    /// The operand in German mnemonics: `M 1.0`, `DB10.DBW 20`, `T 5`, `FC 9`; `FB 3 #speed` for a name of a block;
    /// `DBW [MD 184]` where it is known at run time only.
    pub operand: String,
    /// Its symbol, or the component's name in a data block.
    pub symbol: Option<String>,
    /// The address is known at run time only.
    pub indirect: bool,
    /// Where: the block.
    pub block: BlockId,
    /// The network, from 1.
    pub network: u16,
    /// The line, from 1.
    pub line: u32,
    /// What is done.
    pub access: Access,
    /// The formal it is supplied to, for actual parameters: `FC 9.ANL`.
    pub via: Option<String>,
}

/// The cross-reference of a program, sorted by operand, then by place. Parameters of blocks outside the program count
/// as read and written; [`xref_with`] is more exact.
#[must_use]
pub fn xref(program: &Program) -> Vec<Reference> {
    xref_with(program, &Library::new())
}

/// The cross-reference of a program that calls blocks of a library.
#[must_use]
pub fn xref_with(program: &Program, library: &Library) -> Vec<Reference> {
    let interfaces: BTreeMap<BlockId, &Interface> = library
        .iter()
        .map(|(id, block)| (id, &block.interface))
        .chain(program.blocks.iter().map(|b| (b.id, &b.interface)))
        .collect();
    let data = program.data.iter().map(|d| (d.number, d)).collect();
    let symbols = symbol_names(&program.symbols);
    let mut collector = Collector { data, interfaces, symbols, found: Vec::new() };
    for block in &program.blocks {
        for (at, stmt) in block.code.iter().enumerate() {
            let through = reached(block.code.get(at.saturating_sub(2)..at).unwrap_or_default());
            Seen { block, stmt, through, all: &mut collector }.statement();
        }
    }
    let mut found = collector.found;
    found.sort_unstable();
    found.dedup();
    found
}

/// Symbols by the operand they stand for.
fn symbol_names(symbols: &[Symbol]) -> BTreeMap<String, String> {
    let words = Words::of_both();
    let key = |symbol: &Symbol| match symbols::address(symbol, &words) {
        Symbolic::Memory(operand, _) => Some(operand.to_string()),
        Symbolic::Timer(n) => Some(format!("T {n}")),
        Symbolic::Counter(n) => Some(format!("Z {n}")),
        Symbolic::Block(word, n) => Some(format!("{} {n}", word.name())),
        Symbolic::Unknown(_) | Symbolic::Nameless => None,
    };
    symbols.iter().filter_map(|s| Some((key(s)?, s.name.clone()))).collect()
}

struct Collector<'c> {
    data: BTreeMap<u16, &'c DataBlock>,
    interfaces: BTreeMap<BlockId, &'c Interface>,
    symbols: BTreeMap<String, String>,
    found: Vec<Reference>,
}

const INDIRECT: u8 = 40;
const LOCAL: u8 = 50;

/// One statement.
struct Seen<'s, 'c> {
    block: &'c CodeBlock,
    stmt: &'c Stmt,
    /// The POINTER of a composed in/out that AR1 and the DB register come from.
    through: Option<BitAddr>,
    all: &'s mut Collector<'c>,
}

impl Seen<'_, '_> {
    fn statement(&mut self) {
        use Access::{Open, Read, ReadWrite, Write};
        match &self.stmt.op {
            Op::Scan { test: BitTest::Bit(p), .. } => self.bit(*p, Read),
            Op::Scan { test: BitTest::Timer(n), .. } | Op::LoadTimer(n) | Op::LoadTimerBcd(n) => self.timer(*n, Read),
            Op::Scan { test: BitTest::Counter(n), .. } | Op::LoadCounter(n) | Op::LoadCounterBcd(n) => {
                self.counter(*n, Read);
            }
            Op::Assign(p) | Op::Set(p) | Op::Reset(p) => self.bit(*p, Write),
            Op::EdgePositive(p) | Op::EdgeNegative(p) => self.bit(*p, ReadWrite),
            Op::Load(o) | Op::LoadArFrom(_, o) => self.operand(*o, Read, None),
            Op::Transfer(o) | Op::TransferArTo(_, o) => self.operand(*o, Write, None),
            Op::StartTimer(_, n) | Op::ResetTimer(n) | Op::EnableTimer(n) => self.timer(*n, Write),
            Op::CountUp(n) | Op::CountDown(n) | Op::SetCounter(n) | Op::ResetCounter(n) | Op::EnableCounter(n) => {
                self.counter(*n, Write);
            }
            Op::OpenDb(_, n) => self.number("DB", 30, *n, Open, None),
            Op::Call(call) => self.call(call),
            _ => {}
        }
    }

    fn add(
        &mut self,
        order: (u8, u32, u32, u8),
        operand: String,
        symbol: Option<String>,
        access: Access,
        via: Option<&str>,
    ) {
        let symbol = symbol.or_else(|| self.all.symbols.get(&operand).cloned());
        self.all.found.push(Reference {
            order,
            operand,
            symbol,
            indirect: order.0 == INDIRECT,
            block: self.block.id,
            network: self.stmt.network,
            line: self.stmt.line,
            access,
            via: via.map(str::to_owned),
        });
    }

    fn bit(&mut self, place: Place, access: Access) {
        self.operand(Operand { width: Width::Bit, place }, access, None);
    }

    fn operand(&mut self, operand: Operand, access: Access, via: Option<&str>) {
        let bits = u32::from(operand.width.bits());
        self.sized(operand, bits, access, via);
    }

    /// An operand with the size of what lies there: more than the operand's width for composed types.
    fn sized(&mut self, operand: Operand, bits: u32, access: Access, via: Option<&str>) {
        let width = match operand.width {
            Width::Bit => 0,
            Width::Byte => 1,
            Width::Word => 2,
            Width::DWord => 3,
        };
        let text = operand.to_string();
        let id = self.block.id;
        let named = |name: Option<String>| name.map_or_else(|| format!("{id} {text}"), |name| format!("{id} {name}"));
        let whose = (id.kind as u32) << 16 | u32::from(id.number);
        match operand.place {
            Place::Fixed(Area::Local, at) => {
                self.add((LOCAL, whose, at.0, width), named(names::in_local(self.block, at, bits)), None, access, via);
            }
            Place::Param { index, at } => {
                let name = named(names::of_param(self.block, index, at, bits));
                self.add((LOCAL + 1, whose, u32::from(index) << 20 | at.0, width), name, None, access, via);
            }
            Place::Instance(at) => {
                self.add(
                    (LOCAL + 2, whose, at.0, width),
                    named(names::in_instance(self.block, at, bits)),
                    None,
                    access,
                    via,
                );
            }
            Place::Fixed(area, at) => {
                let class = match area {
                    Area::Input => 1,
                    Area::Output => 2,
                    Area::Memory => 3,
                    Area::Peripheral => 4,
                    Area::Db => 31,
                    _ => 32,
                };
                self.add((class, 0, at.0, width), text, None, access, via);
            }
            Place::InDb(db, at) | Place::InDi(db, at) => {
                let data = self.all.data.get(&db);
                let name = data.and_then(|d| names::in_data(&d.components, at, bits));
                let symbol = name.map(|name| format!("DB{db}.{name}"));
                self.add((30, u32::from(db), at.0 + 1, width), text, symbol, access, via);
            }
            Place::Memory(_, pointer) => {
                self.operand(
                    Operand { width: Width::DWord, place: Place::Fixed(pointer.area, pointer.at) },
                    Access::Read,
                    None,
                );
                self.add((INDIRECT, 0, pointer.at.0, width), text, None, access, via);
            }
            Place::Register(None, AddressRegister::Ar1, at)
                if let Some(pointer) = self.through
                    && let Some(name) = names::behind(self.block, pointer, at, bits) =>
            {
                self.add((LOCAL + 2, whose, pointer.0, width), format!("{id} {name}"), None, access, via);
            }
            Place::Register(_, register, at) => {
                self.add((INDIRECT, 1 + register as u32, at.0, width), text, None, access, via);
            }
        }
    }

    fn timer(&mut self, number: Number, access: Access) {
        self.number("T", 10, number, access, None);
    }

    fn counter(&mut self, number: Number, access: Access) {
        self.number("Z", 11, number, access, None);
    }

    /// A timer, counter or block.
    fn number(&mut self, word: &str, class: u8, number: Number, access: Access, via: Option<&str>) {
        let text = format!("{word} {number}");
        match number {
            Number::Fixed(n) => self.add((class, u32::from(n), 0, 0), text, None, access, via),
            Number::Memory(pointer) => {
                let place = Place::Fixed(pointer.area, pointer.at);
                self.operand(Operand { width: Width::Word, place }, Access::Read, None);
                self.add((INDIRECT, 3, pointer.at.0, class), text, None, access, via);
            }
            Number::Param(index) => {
                let place = Place::Param { index, at: BitAddr(0) };
                self.operand(Operand { width: Width::Word, place }, access, via);
            }
            Number::Instance(at) => {
                self.operand(Operand { width: Width::Word, place: Place::Instance(at) }, access, via);
            }
        }
    }

    fn call(&mut self, call: &Call) {
        let id = match call.target {
            Target::Block(id) | Target::Local(id, _) => {
                self.add((class_of(id.kind), u32::from(id.number), 0, 0), id.to_string(), None, Access::Call, None);
                Some(id)
            }
            Target::Indirect(kind, number) => {
                self.number(kind.name(), class_of(kind), number, Access::Call, None);
                None
            }
        };
        if let Some(instance) = call.instance {
            self.number("DB", 30, instance, Access::Open, None);
        }
        let interface = id.and_then(|id| self.all.interfaces.get(&id).copied());
        let mut formals: Vec<&Param> = interface.map(|i| i.formals().collect()).unwrap_or_default();
        if let Some(interface) = interface.filter(|_| call.mode != CallMode::Call) {
            let mut listed: Vec<_> = interface.list_places().into_iter().zip(formals).collect();
            listed.sort_by_key(|(place, _)| *place);
            formals = listed.into_iter().map(|(_, formal)| formal).collect();
        }
        for (index, arg) in call.args.iter().enumerate() {
            let formal = formals.get(index).copied();
            let via = match (id, formal) {
                (Some(id), Some(formal)) => format!("{id}.{}", formal.name),
                (Some(id), None) => format!("{id}, parameter {}", index + 1),
                _ => String::new(),
            };
            let access = match formal.map(|f| f.section) {
                Some(Section::Input) => Access::Read,
                Some(Section::Output | Section::Return) => Access::Write,
                _ => Access::ReadWrite,
            };
            self.argument(arg, formal, access, &via);
        }
    }

    fn argument(&mut self, arg: &Arg, formal: Option<&Param>, access: Access, via: &str) {
        let ty = formal.map(|f| &f.ty);
        match arg {
            Arg::Operand(operand) => match ty {
                Some(ty) if ty.is_composed() => self.sized(*operand, Layout::bits(ty), access, Some(via)),
                _ => self.operand(*operand, access, Some(via)),
            },
            Arg::Raw(bits) => match ty {
                Some(ty) if ty.is_parameter_type() => {
                    self.argument(&Arg::Number(Number::Fixed((bits >> 16) as u16)), formal, access, via);
                }
                Some(ty) => {
                    let at = BitAddr(bits & 0x0007_FFFF);
                    let area = match Area::from_pointer_code((bits >> 24) as u8) {
                        Some(Area::PreviousLocal) => Some(Area::Local),
                        area => area,
                    };
                    if let (Some(area), width) = (area, Width::of(ty).unwrap_or(Width::Byte)) {
                        self.operand(Operand { width, place: Place::Fixed(area, at) }, access, Some(via));
                    }
                }
                None => {}
            },
            Arg::Number(number) => match ty {
                Some(DataType::Timer | DataType::TimerOrWord) => {
                    self.number("T", 10, *number, Access::ReadWrite, Some(via));
                }
                Some(DataType::Counter) => self.number("Z", 11, *number, Access::ReadWrite, Some(via)),
                Some(DataType::BlockFc) => self.number("FC", class_of(BlockKind::Fc), *number, Access::Call, Some(via)),
                Some(DataType::BlockFb) => self.number("FB", class_of(BlockKind::Fb), *number, Access::Call, Some(via)),
                Some(DataType::BlockDb) => self.number("DB", 30, *number, Access::Open, Some(via)),
                _ => {}
            },
            Arg::Bytes(bytes) => {
                if let [0x10, code @ 0x17..=0x1D, 0, 1, 0, 0, again, 0, high, low] = **bytes
                    && code == again
                {
                    let (word, class) = match code {
                        0x1D => ("T", 10),
                        0x1C => ("Z", 11),
                        0x19 => ("DB", 30),
                        0x18 => ("FC", class_of(BlockKind::Fc)),
                        _ => ("FB", class_of(BlockKind::Fb)),
                    };
                    let number = Number::Fixed(u16::from_be_bytes([high, low]));
                    return self.number(word, class, number, Access::ReadWrite, Some(via));
                }
                let pointer =
                    matches!(ty, Some(DataType::Pointer | DataType::Any)) || formal.is_some_and(Param::is_pointer);
                if let Some((operand, any)) = pointer.then(|| pointed(bytes)).flatten() {
                    let whole = ty.filter(|ty| !matches!(ty, DataType::Pointer | DataType::Any)).map(Layout::bits);
                    self.sized(operand, whole.unwrap_or(any), access, Some(via));
                }
            }
            Arg::Open | Arg::Const(_) => {}
        }
    }
}

/// The POINTER in the instance that the two statements before the present one reach through, when they do.
fn reached(before: &[Stmt]) -> Option<BitAddr> {
    match before {
        [
            Stmt { op: Op::OpenDb(_, Number::Instance(pointer)), .. },
            Stmt { op: Op::LoadArFrom(AddressRegister::Ar1, o), .. },
        ] if o.place == Place::Instance(BitAddr(pointer.0 + 16)) => Some(*pointer),
        _ => None,
    }
}

/// What a constant POINTER or ANY names: the first of its elements, and the bits of all.
fn pointed(bytes: &[u8]) -> Option<(Operand, u32)> {
    let (width, count, pointer) = match bytes {
        [0x10, code, high, low, rest @ ..] => {
            let width = match code {
                1 => Width::Bit,
                4 | 5 | 9 | 12 => Width::Word,
                6..=8 | 10 | 11 => Width::DWord,
                _ => Width::Byte,
            };
            (width, u32::from(u16::from_be_bytes([*high, *low])), rest)
        }
        rest => (Width::Byte, 1, rest),
    };
    let [db_high, db_low, area, a, b, c] = *<&[u8; 6]>::try_from(pointer).ok()?;
    let at = BitAddr(u32::from_be_bytes([0, a, b, c]));
    let width = if at.bit() == 0 { width } else { Width::Bit };
    let place = match (Area::from_pointer_code(area)?, u16::from_be_bytes([db_high, db_low])) {
        (Area::Db, db) if db > 0 => Place::InDb(db, at),
        (Area::PreviousLocal, _) => Place::Fixed(Area::Local, at),
        (area, _) => Place::Fixed(area, at),
    };
    let bits = u32::from(width.bits());
    Some((Operand { width, place }, count * bits))
}

const fn class_of(kind: BlockKind) -> u8 {
    match kind {
        BlockKind::Db | BlockKind::Sdb => 30,
        BlockKind::Ob => 33,
        BlockKind::Fb => 34,
        BlockKind::Fc => 35,
        BlockKind::Sfb => 36,
        BlockKind::Sfc => 37,
    }
}

/// The cross-reference as text: each operand with its symbol, below it one line for each place.
#[must_use]
pub fn render_xref(references: &[Reference]) -> String {
    let mut out = String::new();
    let mut last: Option<&str> = None;
    for reference in references {
        let Reference { operand, symbol, indirect, block, network, line, access, via, .. } = reference;
        if last != Some(operand.as_str()) {
            let symbol = symbol.as_ref().map(|s| format!("  \"{s}\"")).unwrap_or_default();
            let indirect = if *indirect { "  (indirect)" } else { "" };
            let _ = writeln!(out, "{operand}{symbol}{indirect}");
            last = Some(operand);
        }
        let via = via.as_ref().map(|v| format!("  as {v}")).unwrap_or_default();
        let _ = writeln!(out, "    {:<4}  {block}, network {network}, line {line}{via}", access.name());
    }
    out
}
