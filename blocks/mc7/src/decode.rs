//! Machine code to a code block of the instruction set.
//!
//! Each statement becomes one operation, except for what STEP 7's compiler makes of one statement of a source: the
//! frame of a `CALL` ([`crate::fold`]), a data block opened for one access (`L DB10.DBW 2`), a number that a function
//! block has as parameter (`SE #timer`). What does not fold stays as it is, which is always right.

use std::collections::BTreeMap;

use ob1_ir::compose::{KEPT, Placing};
use ob1_ir::{
    AddressRegister, Arg, Call, CallMode, CodeBlock, DbRegister, Notation, Number, Op, Operand, Place, Stmt, Target,
    Width,
};
use ob1_model::{Area, BitAddr, BlockId, DataType};

use crate::block::{Callees, Item, MachineBlock, list_order};
use crate::error::{Mc7Error, Problem};
use crate::segments::Segments;
use crate::statement::{ConstForm, Mc7Op, NoStatement, Statement, Uncond};
use crate::{fold, parts};

/// What [`decode`] gives for a block of machine code.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoded {
    /// The block in the instruction set.
    pub block: CodeBlock,
    /// For each statement of the block, the offset in the code where it begins.
    pub offsets: Vec<u32>,
    /// For each statement of the block, the statement of the listing it belongs to, from 0: what STEP 7 shows as one
    /// statement, a `CALL` for example, may be several operations.
    pub shown: Vec<u32>,
    /// How STEP 7 shows the constants that statements load.
    pub notations: BTreeMap<u32, Notation>,
    /// By the offset of each jump statement, the statement it leads to.
    pub jumps: BTreeMap<u32, u32>,
}

impl Decoded {
    /// The labels of the block by statement: name `k` of `names` is that of the target of jump `k` of the segment
    /// table. Empty names and entries without a jump name nothing.
    pub fn labels(&self, segments: &Segments, names: &[String]) -> BTreeMap<u32, String> {
        let entries = segments.jumps.iter().zip(names).filter(|(_, name)| !name.is_empty());
        entries.filter_map(|(word, name)| Some((*self.jumps.get(&(u32::from(*word) * 2))?, name.clone()))).collect()
    }
}

/// How a constant of this form is shown.
pub const fn notation(form: ConstForm) -> Notation {
    match form {
        ConstForm::Byte => Notation::Byte,
        ConstForm::Word(0x02) | ConstForm::DWord(0x02) => Notation::Binary,
        ConstForm::Word(0x03) => Notation::Int,
        ConstForm::Word(0x05) | ConstForm::DWord(0x05) => Notation::Text,
        ConstForm::Word(0x06) | ConstForm::DWord(0x06) => Notation::Bytes,
        ConstForm::Word(0x08) => Notation::Count,
        ConstForm::Word(0x0A) => Notation::Date,
        ConstForm::Word(0x0C) => Notation::S5Time,
        ConstForm::Word(_) => Notation::Word,
        ConstForm::DWord(0x01) => Notation::Real,
        ConstForm::DWord(0x03) => Notation::DInt,
        ConstForm::DWord(0x04) => Notation::Pointer,
        ConstForm::DWord(0x09) => Notation::Time,
        ConstForm::DWord(0x0B) => Notation::TimeOfDay,
        ConstForm::DWord(_) => Notation::DWord,
    }
}

/// Decodes a block. `callees` gives the interfaces of the blocks it calls; calls of others stay unfolded.
///
/// # Errors
/// The first problem, with its offset and bytes: S1501 to S1506.
pub fn decode<'c>(block: &MachineBlock<'_>, callees: &Callees<'c>) -> Result<Decoded, Mc7Error> {
    let wrong = |error: Mc7Error| error.of(block.id);
    let mut items = statements(block).map_err(wrong)?;
    let targets = targets(block.code, &items).map_err(wrong)?;
    for list in targets.values() {
        for to in list {
            if let Some(item) = items.get_mut(*to as usize) {
                item.target = true;
            }
        }
    }
    let mut lowering = Lowering {
        block,
        callees,
        items: &items,
        order: list_order(block.interface),
        out: Vec::with_capacity(items.len()),
        notations: BTreeMap::new(),
        starts: Vec::with_capacity(items.len()),
        shown: 0,
    };
    lowering.run().map_err(wrong)?;
    lowering.finish(&targets).map_err(wrong)
}

/// The bytes as statements.
fn statements(block: &MachineBlock<'_>) -> Result<Vec<Item>, Mc7Error> {
    let mut items = Vec::new();
    let mut offset = 0;
    while let Some(rest) = block.code.get(offset..).filter(|rest| !rest.is_empty()) {
        let (Statement { op, .. }, length) = Statement::read(rest).map_err(|why| {
            let problem = match why {
                NoStatement::Unknown => Problem::UnknownStatement,
                NoStatement::Cut => Problem::CutOff,
            };
            Mc7Error::at(problem, offset, rest)
        })?;
        items.push(Item { offset, op, target: false, network: block.segments.network_at(offset) });
        offset += length;
    }
    Ok(items)
}

/// For each statement that jumps, by its index, the statements it leads to: one for a jump; for `SPL` those of its list
/// and then the one after it.
fn targets(code: &[u8], items: &[Item]) -> Result<BTreeMap<u32, Vec<u32>>, Mc7Error> {
    let find = |item: &Item, words: i16| {
        let to = item.offset as i64 + 2 * i64::from(words);
        let found = usize::try_from(to).ok().and_then(|to| items.binary_search_by_key(&to, |i| i.offset).ok());
        let rest = code.get(item.offset..).unwrap_or_default();
        found.map(|at| at as u32).ok_or_else(|| Mc7Error::at(Problem::JumpTarget(to), item.offset, rest))
    };
    let mut all = BTreeMap::new();
    for (index, item) in (0u32..).zip(items) {
        match &item.op {
            Mc7Op::Jump(_, words) | Mc7Op::Loop(words) => {
                all.insert(index, vec![find(item, *words)?]);
            }
            Mc7Op::JumpList(entries) => {
                let behind = index as usize + 1 + usize::from(*entries);
                let list = items.get(index as usize + 1..behind).unwrap_or_default();
                let mut to = Vec::with_capacity(list.len() + 1);
                for entry in list {
                    if let Mc7Op::Jump(ob1_ir::Jump::Always, words) = entry.op {
                        to.push(find(entry, words)?);
                    }
                }
                if to.len() != usize::from(*entries) || !(1..=255).contains(entries) || behind >= items.len() {
                    let rest = code.get(item.offset..).unwrap_or_default();
                    return Err(Mc7Error::at(Problem::JumpList(*entries), item.offset, rest));
                }
                to.push(behind as u32);
                all.insert(index, to);
            }
            _ => {}
        }
    }
    Ok(all)
}

/// Stands for a place in the local data that is not known yet: beyond every address a statement can name.
const LATER: BitAddr = BitAddr::byte_addr(KEPT);

/// The statements on their way to operations.
struct Lowering<'l, 'b, 'c> {
    block: &'l MachineBlock<'b>,
    callees: &'l Callees<'c>,
    items: &'l [Item],
    /// The block's own formals in the order of the list.
    order: Vec<u16>,
    out: Vec<Made>,
    notations: BTreeMap<u32, Notation>,
    /// For each item, the operation it begins at.
    starts: Vec<u32>,
    shown: u32,
}

/// An operation with where it came from.
struct Made {
    op: Op,
    item: usize,
    shown: u32,
}

impl Lowering<'_, '_, '_> {
    fn run(&mut self) -> Result<(), Mc7Error> {
        while let Some(item) = self.items.get(self.starts.len()) {
            let at = self.starts.len();
            let rest = self.items.get(at..).unwrap_or_default();
            // The block's own end adds nothing, unless a jump leads to it.
            if item.op == Mc7Op::BlockEnd && at + 1 == self.items.len() && !item.target {
                self.starts.push(self.out.len() as u32);
                break;
            }
            if let Some((ops, used)) = self.folded(rest) {
                self.push(ops, used);
                self.shown += 1;
                continue;
            }
            let frame = fold::frame_length(rest);
            for _ in 0..frame.max(1) {
                self.plain()?;
            }
            self.shown += 1;
        }
        Ok(())
    }

    fn push(&mut self, ops: Vec<Op>, used: usize) {
        let (item, shown) = (self.starts.len(), self.shown);
        self.starts.extend(std::iter::repeat_n(self.out.len() as u32, used));
        self.out.extend(ops.into_iter().map(|op| Made { op, item, shown }));
    }

    /// The operations for one statement of a source, and how many statements of the code they take.
    fn folded(&self, rest: &[Item]) -> Option<(Vec<Op>, usize)> {
        let (ops, used) = self
            .call(rest)
            .or_else(|| self.in_data_block(rest))
            .or_else(|| self.number_parameter(rest))
            .or_else(|| self.component(rest))?;
        // If a jump leads into the middle, the single statements are meant, not what they stand for together.
        let whole = rest.get(1..used)?.iter().all(|item| !item.target);
        let network = rest.first()?.network;
        (whole && rest.get(..used)?.iter().all(|item| item.network == network)).then_some((ops, used))
    }

    fn call(&self, rest: &[Item]) -> Option<(Vec<Op>, usize)> {
        let length = fold::frame_length(rest);
        let frame = rest.get(1..length.checked_sub(1)?)?;
        let Mc7Op::Build(kind) = rest.first()?.op else { return None };
        let own = fold::Caller { block: self.block, order: &self.order };
        fold::call(kind, frame, &own, self.callees).map(|ops| (ops, length))
    }

    /// `AUF DB 10; L DBW 2` is `L DB10.DBW 2`.
    fn in_data_block(&self, rest: &[Item]) -> Option<(Vec<Op>, usize)> {
        let [Item { op: Mc7Op::Plain(Op::OpenDb(DbRegister::Db, Number::Fixed(n))), .. }, access, ..] = rest else {
            return None;
        };
        let Mc7Op::Plain(op) = &access.op else { return None };
        let mut op = op.clone();
        let place = op.place_mut()?;
        match *place {
            Place::Fixed(Area::Db, at) if *n > 0 => *place = Place::InDb(*n, at),
            _ => return None,
        }
        Some((vec![op], 2))
    }

    /// `T LD a; TAK; T LD b; L DIW [AR2,P#x]; T LW c; L LD b; L LD a; SE T [LW c]` is `SE #x` of a function block.
    fn number_parameter(&self, rest: &[Item]) -> Option<(Vec<Op>, usize)> {
        let [a, tak, b, load, c, back, again, last, ..] = rest else { return None };
        let accu1 = parts::local_transfer(&a.op, Width::DWord)?;
        let accu2 = parts::local_transfer(&b.op, Width::DWord)?;
        let word = parts::local_transfer(&c.op, Width::Word)?;
        let exchanged = tak.op == Mc7Op::Plain(Op::ExchangeAccus)
            && parts::local_load(&back.op, Width::DWord) == Some(accu2)
            && parts::local_load(&again.op, Width::DWord) == Some(accu1);
        let Mc7Op::Plain(Op::Load(Operand { width: Width::Word, place: from })) = load.op else { return None };
        let Place::Register(Some(Area::Di), AddressRegister::Ar2, at) = from else { return None };
        let mut op = match &last.op {
            Mc7Op::Plain(op) => op.clone(),
            _ => return None,
        };
        let number = op.number_mut()?;
        let named = self.declared(at).is_some_and(|ty| ty.is_parameter_type());
        let pointer = ob1_ir::Pointer { area: Area::Local, at: word };
        if !exchanged || !named || !self.own_temporaries(&[accu1, accu2, word]) || *number != Number::Memory(pointer) {
            return None;
        }
        *number = Number::Instance(at);
        Some((vec![op], 8))
    }

    /// The frames around a component of a composed parameter: `BLD 5` in a function, `BLD 18` in a function block.
    fn component(&self, rest: &[Item]) -> Option<(Vec<Op>, usize)> {
        let Some(Mc7Op::Build(kind @ (5 | 18))) = rest.first().map(|i| &i.op) else { return None };
        let found = fold::component(*kind, rest.get(1..)?)?;
        if !self.own_temporaries(&found.locals) {
            return None;
        }
        match found.base {
            fold::Base::Param(place) => {
                let index = *self.order.get(usize::from(place))?;
                let formal = self.block.interface.formals().nth(usize::from(index))?;
                let mut op = found.last?;
                let at = op.place_mut()?;
                let Place::Register(None, AddressRegister::Ar1, offset) = *at else { return None };
                let bits = u32::from(op.operand()?.width.bits());
                if !self.block.id.kind.is_function() || parts::component_at(&formal.ty, offset.0, bits).is_none() {
                    return None;
                }
                *op.place_mut()? = Place::Param { index, at: offset };
                Some((vec![op], found.used + 1))
            }
            fold::Base::Instance(pointer) => {
                let declared = self.block.interface.params.iter().any(|p| p.is_pointer() && p.at == pointer);
                let operand = Operand { width: Width::DWord, place: Place::Instance(BitAddr(pointer.0 + 16)) };
                let open = Op::OpenDb(DbRegister::Db, Number::Instance(pointer));
                let load = Op::LoadArFrom(AddressRegister::Ar1, operand);
                // The statement itself follows these two as it is.
                (declared && self.block.id.kind.has_instance()).then(|| (vec![open, load], found.used))
            }
        }
    }

    /// True when these lie after the temporaries that are declared: the compiler's own.
    fn own_temporaries(&self, at: &[BitAddr]) -> bool {
        at.iter().all(|at| at.byte() >= self.block.interface.declared_temps())
    }

    /// The type declared at an address of the instance.
    fn declared(&self, at: BitAddr) -> Option<&DataType> {
        if !self.block.id.kind.has_instance() || !self.block.multi_instance {
            return None;
        }
        self.block.interface.in_instance(at).filter(|(_, offset)| *offset == 0).map(|(param, _)| &param.ty)
    }

    /// One statement as one operation.
    fn plain(&mut self) -> Result<(), Mc7Error> {
        let Some(item) = self.items.get(self.starts.len()) else { return Ok(()) };
        let rest = self.block.code.get(item.offset..).unwrap_or_default();
        let index = self.out.len() as u32;
        let op = match &item.op {
            Mc7Op::Plain(op) => {
                let mut op = op.clone();
                self.own_names(&mut op).map_err(|p| Mc7Error::at(p, item.offset, rest))?;
                op
            }
            Mc7Op::Constant(form, value) => {
                self.notations.insert(index, notation(*form));
                Op::LoadConst(*value)
            }
            Mc7Op::ParamPointer { index, .. } => {
                let formal = self.formal(*index).map_err(|p| Mc7Error::at(p, item.offset, rest))?;
                self.param_pointer(formal)
            }
            // The targets come when all statements have their indices.
            Mc7Op::Jump(jump, _) => Op::Jump(*jump, 0),
            Mc7Op::Loop(_) => Op::Loop(0),
            Mc7Op::JumpList(_) => Op::JumpList { targets: Box::default(), otherwise: 0 },
            Mc7Op::Call(call) => {
                let call = self.uncond(call).map_err(|p| Mc7Error::at(p, item.offset, rest))?;
                Op::Call(Box::new(call))
            }
            Mc7Op::Nop0 | Mc7Op::Nop1 => Op::Nop,
            Mc7Op::Build(n) => Op::build(*n),
            Mc7Op::BlockEnd | Mc7Op::End => Op::End,
        };
        self.push(vec![op], 1);
        Ok(())
    }

    /// The index of a formal by its place in the list.
    fn formal(&self, place: u16) -> Result<u16, Problem> {
        // Only functions have parameters in a list.
        let found = self.order.get(usize::from(place)).copied().filter(|_| self.block.id.kind.is_function());
        found.ok_or(Problem::Parameter(place))
    }

    fn number(&self, number: Number) -> Result<Number, Problem> {
        match number {
            Number::Param(place) => self.formal(place).map(Number::Param),
            other => Ok(other),
        }
    }

    /// Parameters by their index; what the block's own instance has at that address as its variable.
    fn own_names(&self, op: &mut Op) -> Result<(), Problem> {
        if let Some(number) = op.number_mut() {
            *number = self.number(*number)?;
        }
        let Some(bits) = op.operand().map(|operand| u32::from(operand.width.bits())) else { return Ok(()) };
        let Some(place) = op.place_mut() else { return Ok(()) };
        match *place {
            Place::Param { index, at } => *place = Place::Param { index: self.formal(index)?, at },
            Place::Register(Some(Area::Di), AddressRegister::Ar2, at)
                if self.block.multi_instance
                    && self.block.id.kind.has_instance()
                    && parts::variable_at(self.block.interface, at, bits) =>
            {
                *place = Place::Instance(at);
            }
            _ => {}
        }
        Ok(())
    }

    /// `L P##parameter`: where the copy of a composed one goes is known when all statements are.
    fn param_pointer(&self, index: u16) -> Op {
        match self.block.interface.formals().nth(usize::from(index)).map(|p| &p.ty) {
            Some(DataType::Any) => Op::LoadParamCopy { index, bytes: 10, at: LATER },
            Some(DataType::Pointer) => Op::LoadParamCopy { index, bytes: 6, at: LATER },
            Some(ty) if ty.is_composed() => Op::LoadParamPointer { index, at: Some(LATER) },
            _ => Op::LoadParamPointer { index, at: None },
        }
    }

    fn uncond(&self, call: &Uncond) -> Result<Call, Problem> {
        let mode = if call.conditional { CallMode::Conditional } else { CallMode::Unconditional };
        let target = match self.number(call.number)? {
            Number::Fixed(n) => Target::Block(BlockId::new(call.kind, n)),
            number => Target::Indirect(call.kind, number),
        };
        let args = call.list.iter().flatten().map(|pointer| Arg::Raw(*pointer)).collect();
        Ok(Call { mode, target, instance: None, args })
    }

    /// Jump targets, local data, and the block.
    fn finish(self, targets: &BTreeMap<u32, Vec<u32>>) -> Result<Decoded, Mc7Error> {
        let start = |item: u32| self.starts.get(item as usize).copied().unwrap_or(0);
        let mut jumps = BTreeMap::new();
        let mut code = Vec::with_capacity(self.out.len());
        let mut offsets = Vec::with_capacity(self.out.len());
        let mut shown = Vec::with_capacity(self.out.len());
        for made in self.out {
            let Some(item) = self.items.get(made.item) else { continue };
            let mut op = made.op;
            if let Some(to) = targets.get(&(made.item as u32)) {
                let to: Vec<u32> = to.iter().map(|t| start(*t)).collect();
                let last = to.last().copied().unwrap_or(0);
                jumps.insert(item.offset as u32, last);
                match &mut op {
                    Op::Jump(_, at) | Op::Loop(at) => *at = last,
                    Op::JumpList { targets, otherwise } => {
                        *otherwise = last;
                        *targets = to.get(..to.len() - 1).unwrap_or_default().into();
                    }
                    _ => {}
                }
            }
            code.push(Stmt { op, network: item.network, line: made.shown + 1 });
            offsets.push(item.offset as u32);
            shown.push(made.shown);
        }
        let mut interface = self.block.interface.clone();
        let declared = interface.declared_temps().next_multiple_of(2);
        // Pointers made at run time reach what no statement names.
        let declared = declared.max(self.block.local_bytes.next_multiple_of(2));
        let own = declared.max(CodeBlock::local_bytes(&code));
        let end = place_copies(&mut code, own);
        if end > own && end > BitAddr::MAX_BYTE {
            return Err(Mc7Error::at(Problem::LocalData, 0, &[]));
        }
        // What one call uses alone lies behind that.
        let place = Placing { kept: own, shared: end };
        for stmt in &mut code {
            stmt.op = place.op(std::mem::replace(&mut stmt.op, Op::Nop), false);
        }
        interface.temp_bytes = declared.max(CodeBlock::local_bytes(&code));
        let block = CodeBlock { id: self.block.id, name: self.block.name.clone(), interface, code, source: 0 };
        Ok(Decoded { block, offsets, shown, notations: self.notations, jumps })
    }
}

/// Gives the copies of `L P##parameter` their places: after the block's own local data, in the order of their first
/// use, as the compiler of the source does. Gives where the last one ends.
fn place_copies(code: &mut [Stmt], own: u32) -> u32 {
    let mut places: BTreeMap<u16, u32> = BTreeMap::new();
    let mut next = own.next_multiple_of(2);
    for stmt in code {
        let (index, bytes, at) = match &mut stmt.op {
            Op::LoadParamPointer { index, at: Some(at) } => (*index, 6, at),
            Op::LoadParamCopy { index, bytes, at } => (*index, u32::from(*bytes), at),
            _ => continue,
        };
        let byte = *places.entry(index).or_insert_with(|| {
            let at = next;
            next += bytes;
            at
        });
        *at = BitAddr::byte_addr(byte);
    }
    next
}
