//! Collects the uses of operands from the statements of a program.

use std::collections::BTreeMap;

use ob1_ir::{
    AddressRegister, Arg, BitTest, Call, CallMode, CodeBlock, DataBlock, Number, Op, Operand, Place, Program, Stmt,
    Symbol, Target, Width,
};
use ob1_model::{Area, BitAddr, BlockId, BlockKind, DataType, Interface, Layout, Param, Section};

use super::extent::Extent;
use super::open::Open;
use super::{Access, Reference};
use crate::names;
use crate::symbols;
use crate::words::Words;
use crate::world::Symbolic;

/// Every use in a program; `interfaces` are those of all blocks it calls.
pub(super) fn collect(program: &Program, interfaces: &BTreeMap<BlockId, &Interface>) -> Vec<Reference> {
    let data = program.data.iter().map(|d| (d.number, d)).collect();
    let symbols = symbol_names(&program.symbols);
    let mut collector = Collector { data, interfaces, symbols, found: Vec::new() };
    for block in &program.blocks {
        let open = Open::of(block);
        for (at, stmt) in block.code.iter().enumerate() {
            let through = reached(block.code.get(at.saturating_sub(2)..at).unwrap_or_default());
            Seen { block, stmt, through, open: open.at(at), all: &mut collector }.statement();
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
    interfaces: &'c BTreeMap<BlockId, &'c Interface>,
    symbols: BTreeMap<String, String>,
    found: Vec<Reference>,
}

/// The order of an operand, [`Reference::order`].
type Order = (u8, u32, u32, u8);

/// The name of an operand, and its symbol where that is no name of the symbol table.
type Name = (String, Option<String>);

const INDIRECT: u8 = 40;
const LOCAL: u8 = 50;

/// A statement, with what is known of the registers in front of it.
struct Seen<'s, 'c> {
    block: &'c CodeBlock,
    stmt: &'c Stmt,
    /// The POINTER of a composed in/out that AR1 and the DB register come from.
    through: Option<BitAddr>,
    /// The data blocks that are open for certain, in the DB and the DI register.
    open: [Option<u16>; 2],
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
            Op::LoadConst(bits) | Op::LoadArConst(_, bits) => self.pointer(*bits),
            Op::LoadParamPointer { index, .. } | Op::LoadParamCopy { index, .. } => {
                let place = Place::Param { index: *index, at: BitAddr(0) };
                self.operand(Operand { width: Width::Byte, place }, Access::Point, None);
            }
            _ => {}
        }
    }

    fn add(&mut self, order: Order, (operand, symbol): Name, extent: Extent, access: Access, via: Option<&str>) {
        let symbol = symbol.or_else(|| self.all.symbols.get(&operand).cloned());
        let assigns = matches!(self.stmt.op, Op::Assign(_) | Op::Transfer(_) | Op::TransferArTo(..) | Op::Call(_));
        self.all.found.push(Reference {
            order,
            operand,
            symbol,
            extent,
            indirect: order.0 == INDIRECT,
            source: self.block.source,
            assigns: assigns && access == Access::Write,
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
        let width = operand.width as u8;
        let text = operand.to_string();
        let id = self.block.id;
        let named =
            |name: Option<String>| (name.map_or_else(|| format!("{id} {text}"), |name| format!("{id} {name}")), None);
        let whose = (id.kind as u32) << 16 | u32::from(id.number);
        match operand.place {
            Place::Fixed(Area::Local | Area::PreviousLocal, at) => {
                let name = named(names::in_local(self.block, at, bits));
                self.add((LOCAL, whose, at.0, width), name, Extent::Own, access, via);
            }
            Place::Param { index, at } => {
                let name = named(names::of_param(self.block, index, at, bits));
                self.add((LOCAL + 1, whose, u32::from(index) << 20 | at.0, width), name, Extent::Own, access, via);
            }
            Place::Instance(at) => {
                let name = named(names::in_instance(self.block, at, bits));
                let extent = Extent::Instance { fb: id, at: at.0, bits };
                self.add((LOCAL + 2, whose, at.0, width), name, extent, access, via);
            }
            Place::Fixed(area @ (Area::Db | Area::Di), at) => match self.open[usize::from(area == Area::Di)] {
                Some(db) => self.in_data(db, Operand { place: Place::InDb(db, at), ..operand }, at, bits, access, via),
                None => {
                    let class = if area == Area::Db { 31 } else { 32 };
                    let extent = Extent::Data { db: None, at: at.0, bits };
                    self.add((class, 0, at.0, width), (text, None), extent, access, via);
                }
            },
            Place::Fixed(area, at) => {
                let class = match area {
                    Area::Input => 1,
                    Area::Output => 2,
                    Area::Memory => 3,
                    _ => 4,
                };
                let text = match (area, access) {
                    (Area::Peripheral, Access::Read) => text.replacen('P', "PE", 1),
                    (Area::Peripheral, Access::Write) => text.replacen('P', "PA", 1),
                    _ => text,
                };
                self.add((class, 0, at.0, width), (text, None), Extent::Bits { area, at: at.0, bits }, access, via);
            }
            Place::InDb(db, at) | Place::InDi(db, at) => self.in_data(db, operand, at, bits, access, via),
            Place::Memory(area, pointer) => {
                self.operand(
                    Operand { width: Width::DWord, place: Place::Fixed(pointer.area, pointer.at) },
                    Access::Read,
                    None,
                );
                self.somewhere((INDIRECT, 0, pointer.at.0, width), text, Some(area), access, via);
            }
            Place::Register(None, AddressRegister::Ar1, at)
                if let Some(pointer) = self.through
                    && let Some(name) = names::behind(self.block, pointer, at, bits) =>
            {
                // The caller's operand is in the list by the call that supplies it.
                let name = (format!("{id} {name}"), None);
                self.add((LOCAL + 2, whose, pointer.0, width), name, Extent::Own, access, via);
            }
            Place::Register(area, register, at) => {
                self.somewhere((INDIRECT, 1 + register as u32, at.0, width), text, area, access, via);
            }
        }
    }

    /// A place in a data block that is known.
    fn in_data(&mut self, db: u16, operand: Operand, at: BitAddr, bits: u32, access: Access, via: Option<&str>) {
        let width = operand.width as u8;
        let name = self.all.data.get(&db).and_then(|data| names::in_data(&data.components, at, bits));
        let symbol = name.map(|name| format!("DB{db}.{name}"));
        let extent = Extent::Data { db: Some(db), at: at.0, bits };
        self.add((30, u32::from(db), at.0 + 1, width), (operand.to_string(), symbol), extent, access, via);
    }

    fn somewhere(&mut self, order: Order, text: String, area: Option<Area>, access: Access, via: Option<&str>) {
        // Local data have no wire and no other block's address.
        let extent = if matches!(area, Some(Area::Local)) { Extent::Own } else { Extent::Somewhere(area) };
        self.add(order, (text, None), extent, access, via);
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
            Number::Fixed(n) => {
                let extent = match word {
                    "T" => Extent::Timer(n),
                    "Z" => Extent::Counter(n),
                    _ => Extent::Block(BlockId::new(kind_of(class), n)),
                };
                self.add((class, u32::from(n), 0, 0), (text, None), extent, access, via);
            }
            Number::Memory(pointer) => {
                let place = Place::Fixed(pointer.area, pointer.at);
                self.operand(Operand { width: Width::Word, place }, Access::Read, None);
                let extent = match word {
                    "T" => Extent::SomeTimer,
                    "Z" => Extent::SomeCounter,
                    _ => Extent::SomeBlock(kind_of(class)),
                };
                self.add((INDIRECT, 3, pointer.at.0, class), (text, None), extent, access, via);
            }
            // The number is in the list by the call that supplies it.
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
                let order = (class_of(id.kind), u32::from(id.number), 0, 0);
                self.add(order, (id.to_string(), None), Extent::Block(id), Access::Call, None);
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
            if let (Some(id), Some(formal)) = (id, formal) {
                self.in_instance(call, id, arg, formal, access);
                self.block_by_number(arg, formal, &via);
            }
        }
    }

    /// What a call writes into the instance, or reads from it, for a parameter.
    fn in_instance(&mut self, call: &Call, id: BlockId, arg: &Arg, formal: &Param, access: Access) {
        if *arg == Arg::Open || !id.kind.has_instance() {
            return;
        }
        // What the block reads is written here.
        let access = match access {
            Access::Read => Access::Write,
            Access::Write => Access::Read,
            other => other,
        };
        let bits = formal.passed_bits(true);
        let width = Width::of_bits(bits).unwrap_or(Width::Byte);
        let base = if let Target::Local(_, base) = call.target { base.0 } else { 0 };
        let at = BitAddr(base.saturating_add(formal.at.0));
        let place = match call.instance {
            Some(Number::Fixed(db)) => Place::InDb(db, at),
            None if matches!(call.target, Target::Local(..)) => Place::Instance(at),
            _ => return,
        };
        self.sized(Operand { width, place }, bits, access, Some(&format!("{id}.{}", formal.name)));
    }

    /// The blocks of the CPs take the number of a data block as an integer.
    fn block_by_number(&mut self, arg: &Arg, formal: &Param, via: &str) {
        if !formal.name.eq_ignore_ascii_case("DB_NO") {
            return;
        }
        match arg {
            Arg::Const(number) => {
                if let Some(number) = u16::try_from(*number).ok().filter(|number| *number > 0) {
                    self.number("DB", 30, Number::Fixed(number), Access::ReadWrite, Some(via));
                }
            }
            Arg::Operand(operand) => {
                let text = format!("DB [{operand}]");
                let extent = Extent::SomeBlock(BlockKind::Db);
                self.add((INDIRECT, 4, 0, 0), (text, None), extent, Access::ReadWrite, Some(via));
            }
            _ => {}
        }
    }

    /// A pointer that is loaded: where it points to.
    fn pointer(&mut self, bits: u32) {
        let Some(area) = Area::from_pointer_code((bits >> 24) as u8).filter(|_| bits & 0x00F8_0000 == 0) else {
            return;
        };
        let at = BitAddr::of_pointer(bits);
        let width = if at.bit() == 0 { Width::Byte } else { Width::Bit };
        self.operand(Operand { width, place: Place::Fixed(area, at) }, Access::Point, None);
    }

    fn argument(&mut self, arg: &Arg, formal: Option<&Param>, access: Access, via: &str) {
        let ty = formal.map(|f| &f.ty);
        match arg {
            Arg::Operand(operand) => match ty {
                Some(DataType::Any | DataType::Pointer) => {
                    self.sized(*operand, ty.map_or(0, Layout::bits), Access::Read, Some(via));
                    let order = (INDIRECT, 5, operand_order(*operand), 0);
                    self.somewhere(order, format!("what {operand} points to"), None, access, Some(via));
                }
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

/// The classes of blocks in the order of the references. System data is listed with the data blocks.
const CLASSES: [(BlockKind, u8); 7] = [
    (BlockKind::Db, 30),
    (BlockKind::Sdb, 30),
    (BlockKind::Ob, 33),
    (BlockKind::Fb, 34),
    (BlockKind::Fc, 35),
    (BlockKind::Sfb, 36),
    (BlockKind::Sfc, 37),
];

fn class_of(kind: BlockKind) -> u8 {
    CLASSES.into_iter().find(|(of, _)| *of == kind).map_or(0, |(_, class)| class)
}

fn kind_of(class: u8) -> BlockKind {
    CLASSES.into_iter().find(|(_, of)| *of == class).map_or(BlockKind::Db, |(kind, _)| kind)
}

const fn operand_order(operand: Operand) -> u32 {
    match operand.place {
        Place::Fixed(_, at)
        | Place::InDb(_, at)
        | Place::InDi(_, at)
        | Place::Param { at, .. }
        | Place::Instance(at)
        | Place::Register(_, _, at) => at.0,
        Place::Memory(_, pointer) => pointer.at.0,
    }
}
