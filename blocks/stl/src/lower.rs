//! Statements to operations.

use std::collections::{BTreeMap, BTreeSet};

use ob1_ir::{
    AddressRegister, BitTest, CodeBlock, Compare, DbRegister, Number, NumberFormat, Op, Operand, Place, Stmt, Width,
};
use ob1_model::{Area, BitAddr, BlockId, DataType};

use crate::auto::Sets;
use crate::constant::{Constant, ToParam};
use crate::diagnostic::Sink;
use crate::elaborate::LONGEST;
use crate::expand::{self, Around, Hidden};
use crate::identifiers::{BlockWord, Identifier};
use crate::jumps::Labels;
use crate::lints::Whole;
use crate::messages;
use crate::mnemonics::{Row, Shape};
use crate::operand::Resolver;
use crate::reader::Reader;
use crate::supplied::Use;
use crate::syntax::{Block, Statement};
use crate::token::{File, Kind, Span};
use crate::value::Value;
use crate::world::World;

/// What the statements of all blocks may name.
pub(crate) struct Names<'n> {
    pub(crate) world: &'n World,
    pub(crate) sets: &'n Sets,
    /// The labels of all blocks, each with the first block that has it.
    pub(crate) labels: &'n BTreeMap<&'n str, BlockId>,
}

/// What is found while blocks are lowered.
pub(crate) struct Found<'f> {
    /// Instance data blocks that calls name and no source declares, with their FB.
    pub(crate) wanted: BTreeMap<u16, BlockId>,
    /// Data blocks that are opened, with the first place in each block.
    pub(crate) opened: BTreeSet<(u16, usize, Span)>,
    /// Calls with an instance.
    pub(crate) uses: Vec<Use>,
    /// With lints: findings that concern several blocks.
    pub(crate) lints: Option<&'f mut Whole>,
}

/// What one block's statements are lowered with.
pub(crate) struct Lowerer<'l, 's> {
    pub(crate) resolver: Resolver<'l>,
    pub(crate) file: &'l File<'s>,
    pub(crate) index: usize,
    pub(crate) sink: &'l mut Sink,
    /// Instance data blocks that calls name and no source declares, with their FB.
    pub(crate) wanted: &'l mut BTreeMap<u16, BlockId>,
    pub(crate) hidden: Hidden,
    /// What the present statement needs before and after itself.
    pub(crate) around: Around,
}

/// Lowers a block's statements. Every statement first becomes exactly one operation, wrong ones `Nop`, so that jump
/// targets are statement indices; what some need around them is put in at the end.
pub(crate) fn lower(
    id: BlockId,
    block: &Block,
    file: &File<'_>,
    names: &Names<'_>,
    found: &mut Found<'_>,
    sink: &mut Sink,
) -> Option<CodeBlock> {
    let Names { world, sets, labels: elsewhere } = *names;
    let info = world.blocks.get(&id)?;
    let labels = Labels::collect(block, file, elsewhere, sink);
    let resolver = Resolver::new(world, sets.of(block.file), Some((id.kind, info)));
    let hidden = Hidden::default();
    let wanted = &mut found.wanted;
    let mut lowerer = Lowerer { resolver, file, index: block.file, sink, wanted, hidden, around: Around::default() };
    let mut code = Vec::with_capacity(block.statements.len());
    let mut around = BTreeMap::new();
    let mut opened = BTreeSet::new();
    for (at, statement) in (0u32..).zip(&block.statements) {
        lowerer.hidden.next_statement();
        lowerer.around = Around::default();
        let op = lowerer.statement(statement, &labels).unwrap_or(Op::Nop);
        if op != Op::Nop && !lowerer.around.is_empty() {
            around.insert(at, std::mem::take(&mut lowerer.around));
        }
        if let Op::OpenDb(_, Number::Fixed(n)) = op {
            opened.insert((n, block.file, statement.span));
        }
        if let Op::Call(call) = &op {
            found.uses.extend(Use::of(id, call, block.file, statement.span));
        }
        code.push(Stmt { op, network: statement.network, line: statement.line });
    }
    found.opened.extend(opened);
    let hidden = lowerer.hidden;
    crate::jumps::jump_lists(block, &mut code, sink);
    crate::brackets::check(block, &code, sink);
    if let Some(lints) = &mut found.lints {
        lints.block(id, block, info, &code, file, sink);
    }
    let mut interface = info.interface.clone();
    let used = interface.temp_bytes.max(CodeBlock::local_bytes(&code));
    let own = used.next_multiple_of(2);
    if own + hidden.bytes() > LONGEST {
        sink.report(
            block.file,
            block.span,
            &messages::TOO_LONG,
            format!("the local data is longer than {LONGEST} bytes"),
        );
        return None;
    }
    let is_whole = around.is_empty() && info.initial_call.is_none();
    let mut code = expand::expand(code, around, &hidden, own);
    if let Some(at) = info.initial_call {
        code = expand::begin_with(initial_call(at), code);
    }
    interface.temp_bytes = if is_whole { used } else { used.max(CodeBlock::local_bytes(&code)) };
    let name = block.shown_name();
    Some(CodeBlock { id, name, interface, code, source: block.file as u32 })
}

/// Supplies `Initial_Call`, an input of OB 1 in TIA Portal: OB1_SCAN_1 is 3 in every cycle but the first.
fn initial_call(at: BitAddr) -> Vec<Op> {
    let local = |at| Place::Fixed(Area::Local, at);
    vec![
        Op::Load(Operand { width: Width::Byte, place: local(BitAddr::byte_addr(1)) }),
        Op::LoadConst(3),
        Op::Compare(NumberFormat::Int, Compare::NotEqual),
        Op::Assign(local(at)),
    ]
}

impl Lowerer<'_, '_> {
    pub(crate) fn reader<'r>(&'r mut self, range: std::ops::Range<usize>, span: Span) -> Reader<'r, 'r> {
        Reader::new(self.index, self.file, self.sink, range, span)
    }

    /// One statement; `None` when it has a mistake (reported) or is only a label.
    fn statement(&mut self, statement: &Statement, labels: &Labels<'_>) -> Option<Op> {
        let row = statement.row?;
        match &row.shape {
            Shape::Call(mode) => return self.call(*mode, statement),
            Shape::Jump(jump) => return self.target(statement, labels).map(|to| Op::Jump(*jump, to)),
            Shape::Loop => return self.target(statement, labels).map(Op::Loop),
            Shape::JumpList => {
                let otherwise = self.target(statement, labels)?;
                return Some(Op::JumpList { targets: Box::default(), otherwise });
            }
            _ => {}
        }
        let resolver = self.resolver;
        let mut hidden = std::mem::take(&mut self.hidden);
        let mut reader = self.reader(statement.operand.clone(), statement.span);
        let mut around = Around::default();
        let op = operation(resolver, &mut reader, row, statement.span, &mut hidden, &mut around);
        let complete = op.is_some() && reader.finish(&messages::TOO_MUCH);
        self.hidden = hidden;
        let op = self.pointing(op?, &mut around);
        self.around = around;
        complete.then_some(op)
    }

    /// `L P##name` and `LAR1 P##name` of a function's parameter.
    fn pointing(&mut self, op: Lowered, around: &mut Around) -> Op {
        match op {
            Lowered::Op(op) => op,
            Lowered::LoadPointer(register, index, kind) => {
                around.points = true;
                expand::param_pointer(&mut self.hidden, index, kind, register, around)
            }
        }
    }

    fn target(&mut self, statement: &Statement, labels: &Labels<'_>) -> Option<u32> {
        let mut reader = self.reader(statement.operand.clone(), statement.span);
        let span = reader.here();
        let Some(token) = reader.eat(Kind::Word) else {
            reader.report(span, &messages::UNKNOWN_LABEL, "a jump takes a label");
            return None;
        };
        let name = reader.text(token);
        let to = labels.find(name, &mut reader, span)?;
        reader.finish(&messages::TOO_MUCH).then_some(to)
    }
}

/// What a statement becomes.
enum Lowered {
    Op(Op),
    /// The pointer to a parameter, into ACCU1 or an address register.
    LoadPointer(Option<AddressRegister>, u16, ToParam),
}

/// Everything but calls and jumps.
fn operation(
    resolver: Resolver<'_>,
    reader: &mut Reader<'_, '_>,
    row: &Row,
    head: Span,
    hidden: &mut Hidden,
    around: &mut Around,
) -> Option<Lowered> {
    if let Shape::Plain(op) = &row.shape {
        return Some(Lowered::Op(op.clone()));
    }
    if reader.is_empty()
        && let Some(op) = without_operand(&row.shape)
    {
        return Some(Lowered::Op(op));
    }
    match &row.shape {
        Shape::AddConst | Shape::Increment | Shape::Decrement | Shape::Shift(..) | Shape::Nothing | Shape::Build => {
            return counted(resolver, reader, &row.shape).map(Lowered::Op);
        }
        _ => {}
    }
    let span = reader.rest();
    refuse_periphery(resolver, reader, &row.shape, span)?;
    let value = match (resolver.operand(reader)?, &row.shape) {
        (Value::Constant(Constant::ToParam { index, kind }), Shape::Load) => {
            return Some(Lowered::LoadPointer(None, index, kind));
        }
        (Value::Constant(Constant::ToParam { index, kind }), Shape::LoadAr(register)) => {
            return Some(Lowered::LoadPointer(Some(*register), index, kind));
        }
        (Value::Indexed { .. }, Shape::LoadAr(AddressRegister::Ar1))
        | (Value::Through { .. } | Value::Indexed { .. }, Shape::TransferAr(AddressRegister::Ar1)) => {
            let message = "reaching this needs AR1, so the value of AR1 is lost; use a temp in between";
            reader.report(span, &messages::NOT_SUPPORTED, message);
            return None;
        }
        (Value::Indexed { operand, through, terms, ty }, _) => {
            let element = expand::index(hidden, operand, through, &terms, &mut around.before);
            around.after.extend(element.restore);
            Value::Memory { operand: element.operand, ty: Some(ty) }
        }
        (Value::Through { pointer, operand, ty, .. }, _) => {
            around.before.extend(expand::open(pointer));
            Value::Memory { operand, ty: Some(ty) }
        }
        (value, _) => value,
    };
    match with_operand(&row.shape, value.clone()) {
        Ok(op) => Some(Lowered::Op(op)),
        Err(Wrong::Operand) => {
            let mnemonic = reader.file.slice(head);
            let message = format!("{mnemonic} takes {}, this is {}", takes(&row.shape), value.describe());
            reader.report(span, &messages::WRONG_OPERAND, message);
            None
        }
        Err(Wrong::Constant(message)) => {
            reader.report(span, &messages::CONSTANT, message);
            None
        }
    }
}

/// Peripheral inputs are only read, peripheral outputs only written. `None`: reported.
fn refuse_periphery(resolver: Resolver<'_>, reader: &mut Reader<'_, '_>, shape: &Shape, span: Span) -> Option<()> {
    let write = match shape {
        Shape::Load => false,
        Shape::Transfer => true,
        _ => return Some(()),
    };
    if peripheral_output(resolver, reader).is_none_or(|output| output == write) {
        return Some(());
    }
    let message = if write {
        "peripheral inputs are only read: T takes a peripheral output"
    } else {
        "peripheral outputs are only written: L takes a peripheral input"
    };
    reader.report(span, &messages::WRONG_OPERAND, message);
    None
}

/// True where the next operand names peripheral outputs, false where it names peripheral inputs. Both are one area of
/// the intermediate code.
pub(crate) fn peripheral_output(resolver: Resolver<'_>, reader: &Reader<'_, '_>) -> Option<bool> {
    let token = reader.peek()?;
    let text = reader.text(token);
    match token.kind {
        Kind::Word if text.starts_with(['P', 'p']) => {
            let (letters, _) = crate::parser::split_digits(text);
            let Some(Identifier::Memory(Area::Peripheral, _)) = resolver.words.identifier(letters) else { return None };
            Some(letters.get(1..2).is_some_and(|l| l.eq_ignore_ascii_case("A") || l.eq_ignore_ascii_case("Q")))
        }
        Kind::Symbol if !resolver.world.peripheral.is_empty() => {
            resolver.world.peripheral.get(&crate::parser::unquote(text).to_uppercase()).copied()
        }
        _ => None,
    }
}

/// Mnemonics whose operand may be left out.
fn without_operand(shape: &Shape) -> Option<Op> {
    Some(match shape {
        Shape::Scan(ob1_ir::Logic::Or, false) => Op::OrBranch,
        Shape::WordLogic(logic) => Op::WordLogic(*logic, None),
        Shape::DWordLogic(logic) => Op::DWordLogic(*logic, None),
        Shape::Shift(shift, _) => Op::Shift(*shift, None),
        Shape::LoadAr(register) => Op::LoadAr(*register),
        Shape::TransferAr(register) => Op::TransferAr(*register),
        Shape::AddAr(register) => Op::AddAr(*register),
        Shape::Nothing | Shape::Build => Op::Nop,
        _ => return None,
    })
}

/// Mnemonics that take a plain number: `+ 5`, `INC 1`, `SLW 4`, `BLD 3`.
fn counted(resolver: Resolver<'_>, reader: &mut Reader<'_, '_>, shape: &Shape) -> Option<Op> {
    let span = reader.rest();
    let constant = resolver.constant(reader)?;
    let value = match &constant {
        Constant::Integer(v) => *v,
        Constant::DInt(v) => i64::from(*v),
        Constant::Bits(v, _) | Constant::Radix(v) => i64::from(*v),
        _ => i64::MAX,
    };
    let byte = |max: u8| u8::try_from(value).ok().filter(|v| *v <= max);
    let (op, range) = match shape {
        Shape::AddConst => match constant {
            Constant::DInt(value) => (Some(Op::AddConst { format: NumberFormat::DInt, value }), ""),
            _ => {
                let value = i16::try_from(value).ok().map(i32::from);
                let op = value.map(|value| Op::AddConst { format: NumberFormat::Int, value });
                (op, "an integer from -32768 to 32767, or a double integer L#")
            }
        },
        Shape::Increment => (byte(255).map(Op::Increment), "0 to 255"),
        Shape::Decrement => (byte(255).map(Op::Decrement), "0 to 255"),
        Shape::Shift(shift, max) => {
            let range = if *max == 15 { "0 to 15" } else { "0 to 32" };
            (byte(*max).map(|n| Op::Shift(*shift, Some(n))), range)
        }
        Shape::Build => (byte(255).map(Op::build), "0 to 255"),
        _ => (byte(255).map(|_| Op::Nop), "0 to 255"),
    };
    if op.is_none() {
        reader.report(span, &messages::CONSTANT, format!("the number is {range}"));
    }
    op
}

/// Why an operand does not fit.
enum Wrong {
    Operand,
    Constant(String),
}

fn with_operand(shape: &Shape, value: Value<'_>) -> Result<Op, Wrong> {
    let bit = |value: Value<'_>| match value {
        Value::Memory { operand, .. } if operand.width == Width::Bit => Ok(operand.place),
        _ => Err(Wrong::Operand),
    };
    Ok(match (shape, value) {
        (Shape::Scan(logic, negate), value) => {
            let test = match value {
                Value::Timer(n) => BitTest::Timer(n),
                Value::Counter(n) => BitTest::Counter(n),
                Value::Status(status) => BitTest::Status(status),
                other => BitTest::Bit(bit(other)?),
            };
            Op::Scan { logic: *logic, negate: *negate, test }
        }
        (Shape::Assign, value) => Op::Assign(bit(value)?),
        (Shape::Set, Value::Counter(n)) => Op::SetCounter(n),
        (Shape::Set, value) => Op::Set(bit(value)?),
        (Shape::Reset, Value::Timer(n)) => Op::ResetTimer(n),
        (Shape::Reset, Value::Counter(n)) => Op::ResetCounter(n),
        (Shape::Reset, value) => Op::Reset(bit(value)?),
        (Shape::Edge(true), value) => Op::EdgePositive(bit(value)?),
        (Shape::Edge(false), value) => Op::EdgeNegative(bit(value)?),
        (Shape::Load, Value::Constant(constant)) => Op::LoadConst(constant.load().map_err(Wrong::Constant)?),
        (Shape::Load, Value::Timer(n)) => Op::LoadTimer(n),
        (Shape::Load, Value::Counter(n)) => Op::LoadCounter(n),
        (Shape::Load, Value::StatusWord) => Op::LoadStatus,
        (Shape::Load, Value::DbLength(register)) => Op::LoadDbLength(register),
        (Shape::Load, Value::DbNumber(register)) => Op::LoadDbNumber(register),
        (Shape::Load, value) => Op::Load(wide(&value)?),
        (Shape::LoadBcd, Value::Timer(n)) => Op::LoadTimerBcd(n),
        (Shape::LoadBcd, Value::Counter(n)) => Op::LoadCounterBcd(n),
        (Shape::Transfer, Value::StatusWord) => Op::TransferStatus,
        (Shape::Transfer, value) => Op::Transfer(wide(&value)?),
        (Shape::WordLogic(logic), Value::Constant(constant)) => match constant.encode(&DataType::Word) {
            Ok(crate::constant::Encoded::Bits(bits)) => Op::WordLogic(*logic, Some(bits as u16)),
            Ok(_) => return Err(Wrong::Operand),
            Err(message) => return Err(Wrong::Constant(message)),
        },
        (Shape::DWordLogic(logic), Value::Constant(constant)) => match constant.encode(&DataType::DWord) {
            Ok(crate::constant::Encoded::Bits(bits)) => Op::DWordLogic(*logic, Some(bits)),
            Ok(_) => return Err(Wrong::Operand),
            Err(message) => return Err(Wrong::Constant(message)),
        },
        (Shape::LoadAr(register), value) => match (value, register) {
            (Value::Constant(Constant::Pointer(p)), _) if p.any.is_none() && p.db == 0 => {
                Op::LoadArConst(*register, p.bits())
            }
            (Value::Constant(Constant::Pointer(_)), _) => {
                let message = "an address register takes a pointer without data block and length: P#DBX 0.0";
                return Err(Wrong::Constant(message.to_owned()));
            }
            (Value::Register(ob1_ir::AddressRegister::Ar2), ob1_ir::AddressRegister::Ar1) => Op::CopyAr2ToAr1,
            (value, _) => Op::LoadArFrom(*register, double_word(&value)?),
        },
        (Shape::TransferAr(register), value) => match (value, register) {
            (Value::Register(ob1_ir::AddressRegister::Ar2), ob1_ir::AddressRegister::Ar1) => Op::CopyAr1ToAr2,
            (value, _) => Op::TransferArTo(*register, double_word(&value)?),
        },
        (Shape::AddAr(register), Value::Constant(Constant::Pointer(p))) if p.area.is_none() => {
            Op::AddArConst(*register, p.at)
        }
        (Shape::OpenDb, Value::Block(BlockWord::Db, n)) => Op::OpenDb(DbRegister::Db, n),
        (Shape::OpenDb | Shape::OpenDi, Value::Block(BlockWord::Di, n))
        | (Shape::OpenDi, Value::Block(BlockWord::Db, n)) => Op::OpenDb(DbRegister::Di, n),
        (Shape::StartTimer(kind), Value::Timer(n)) => Op::StartTimer(*kind, n),
        (Shape::Enable, Value::Timer(n)) => Op::EnableTimer(n),
        (Shape::Enable, Value::Counter(n)) => Op::EnableCounter(n),
        (Shape::CountUp, Value::Counter(n)) => Op::CountUp(n),
        (Shape::CountDown, Value::Counter(n)) => Op::CountDown(n),
        _ => return Err(Wrong::Operand),
    })
}

/// A byte, word or double word of memory.
fn wide(value: &Value<'_>) -> Result<Operand, Wrong> {
    match value {
        Value::Memory { ty: Some(ty), .. } if ty.is_composed() => Err(Wrong::Operand),
        Value::Memory { operand, .. } if operand.width != Width::Bit => Ok(*operand),
        _ => Err(Wrong::Operand),
    }
}

fn double_word(value: &Value<'_>) -> Result<Operand, Wrong> {
    wide(value).and_then(|operand| if operand.width == Width::DWord { Ok(operand) } else { Err(Wrong::Operand) })
}

/// What a mnemonic takes, for messages.
fn takes(shape: &Shape) -> &'static str {
    match shape {
        Shape::Scan(..) => "a bit, timer, counter or status bit",
        Shape::Assign | Shape::Edge(_) => "a bit",
        Shape::Set => "a bit or counter",
        Shape::Reset => "a bit, timer or counter",
        Shape::Load => "a byte, word, double word, timer, counter or constant",
        Shape::LoadBcd | Shape::Enable => "a timer or counter",
        Shape::Transfer => "a byte, word or double word",
        Shape::WordLogic(_) | Shape::DWordLogic(_) => "a constant or nothing",
        Shape::LoadAr(_) => "a pointer P#, a double word or nothing",
        Shape::TransferAr(_) => "a double word or nothing",
        Shape::AddAr(_) => "a pointer without area, P#2.0, or nothing",
        Shape::OpenDb | Shape::OpenDi => "a data block",
        Shape::StartTimer(_) => "a timer",
        Shape::CountUp | Shape::CountDown => "a counter",
        _ => "another operand",
    }
}

/// A block number that is known when compiling.
pub(crate) fn fixed(number: Number) -> Option<u16> {
    match number {
        Number::Fixed(n) => Some(n),
        _ => None,
    }
}
