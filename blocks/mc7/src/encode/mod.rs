//! A code block of the instruction set to machine code, as STEP 7's compiler makes it: a `CALL` becomes its frame,
//! `L DB10.DBW 2` opens the data block first, components of composed parameters go through AR1.

mod frame;
mod function;
mod instance;
mod parameter;

use std::collections::BTreeMap;

use ob1_ir::{
    AddressRegister, Arg, Call, CallMode, CodeBlock, DbRegister, Jump, Notation, Number, Op, Operand, Place, Target,
};
use ob1_model::{Area, BlockId};

use crate::block::Callees;
use crate::error::{Mc7Error, Problem};
use crate::segments::Segments;
use crate::statement::{ConstForm, Mc7Op, Statement, Uncond};

/// How a block is encoded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Written {
    /// A function block of code version 2: its instance is addressed through AR2.
    pub multi_instance: bool,
    /// How constants are shown, by the index of the statement.
    pub notations: BTreeMap<u32, Notation>,
}

/// What [`encode`] gives for a block.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Encoded {
    /// The code with its final `BE`.
    pub code: Vec<u8>,
    /// For each statement of the block, the offset in the code where it begins.
    pub offsets: Vec<u32>,
    /// The segment table that belongs to the code.
    pub segments: Segments,
    /// Bytes of local data: the block's own and what the frames of its calls use.
    pub local_bytes: u32,
}

/// Encodes a block. `callees` gives the interfaces of the blocks it calls.
///
/// # Errors
/// S1510 with the index of the first statement the machine has no code for.
pub fn encode<'c>(block: &CodeBlock, written: &Written, callees: &Callees<'c>) -> Result<Encoded, Mc7Error> {
    let mut encoder = Encoder {
        block,
        written,
        callees,
        places: block.interface.list_places(),
        pieces: Vec::new(),
        local: block.interface.temp_bytes,
        most: block.interface.temp_bytes,
    };
    let mut starts = Vec::with_capacity(block.code.len());
    let mut at = 0;
    while let Some(stmt) = block.code.get(at) {
        let rest = block.code.get(at..).unwrap_or_default();
        let wrong = |what: String| Mc7Error {
            problem: Problem::NoCode(what),
            block: Some(block.id),
            offset: at,
            bytes: Vec::new(),
        };
        encoder.local = block.interface.temp_bytes;
        let first = encoder.pieces.len();
        let used = encoder.statement(at as u32, rest).ok_or_else(|| wrong(format!("`{}`", stmt.op)))?;
        starts.extend(std::iter::repeat_n(first, used));
        for piece in encoder.pieces.get_mut(first..).unwrap_or_default() {
            piece.network = stmt.network;
            piece.from = at as u32;
        }
        at += used;
    }
    let local_bytes = encoder.most.next_multiple_of(2);
    let pieces = encoder.pieces;
    let (code, segments, places) = finish(block, &pieces, &starts)?;
    let end = code.len().saturating_sub(2);
    let offsets = starts.iter().map(|first| places.get(*first).copied().unwrap_or(end) as u32).collect();
    Ok(Encoded { code, offsets, segments, local_bytes })
}

/// A statement on its way: jumps still know the statement they lead to.
#[derive(Clone, Debug)]
struct Piece {
    op: Mc7Op,
    to: Option<u32>,
    network: u16,
    from: u32,
}

/// Distances, bytes, networks, and the offset of each piece.
fn finish(block: &CodeBlock, pieces: &[Piece], starts: &[usize]) -> Result<(Vec<u8>, Segments, Vec<usize>), Mc7Error> {
    let wrong = |piece: &Piece, what: &str| {
        let problem = Problem::NoCode(what.to_owned());
        Mc7Error { problem, block: Some(block.id), offset: piece.from as usize, bytes: Vec::new() }
    };
    let mut offsets = Vec::with_capacity(pieces.len());
    let mut end = 0usize;
    for piece in pieces {
        offsets.push(end);
        let statement = Statement::from(piece.op.clone());
        end += statement.bytes().ok_or_else(|| wrong(piece, &statement.to_string()))?.len();
    }
    let mut code = Vec::with_capacity(end + 2);
    let mut segments = Segments::default();
    for (piece, offset) in pieces.iter().zip(&offsets) {
        let mut op = piece.op.clone();
        if let Some(to) = piece.to {
            let target = starts.get(to as usize).and_then(|first| offsets.get(*first)).copied();
            // A statement of which nothing is left, the last `BE` among them, ends the code.
            let target = target.unwrap_or(end) as i64;
            let words = i16::try_from((target - *offset as i64) / 2);
            let words = words.map_err(|_| wrong(piece, "a jump over more than 65,534 bytes"))?;
            match &mut op {
                Mc7Op::Jump(_, distance) | Mc7Op::Loop(distance) => *distance = words,
                _ => {}
            }
        }
        if matches!(op, Mc7Op::Jump(..) | Mc7Op::Loop(_) | Mc7Op::JumpList(_)) {
            let word = u16::try_from(offset / 2).map_err(|_| wrong(piece, "a block of this length"))?;
            segments.jumps.push(word);
        }
        let bytes = Statement::from(op).bytes().unwrap_or_default();
        while segments.networks.len() < usize::from(piece.network.max(1)) {
            segments.networks.push(0);
        }
        if let Some(length) = segments.networks.last_mut() {
            *length = u16::try_from(usize::from(*length) + bytes.len())
                .map_err(|_| wrong(piece, "a network of more than 65,535 bytes"))?;
        }
        code.extend_from_slice(&bytes);
    }
    if segments.networks.is_empty() {
        segments.networks.push(0);
    }
    code.extend_from_slice(&[0x65, 0x00]);
    Ok((code, segments, offsets))
}

/// The form of a constant in its notation; `None` where the value is too wide for it.
fn const_form(notation: Option<Notation>, value: u32) -> ConstForm {
    let narrow = value <= 0xFFFF;
    match notation {
        Some(Notation::Byte) if value <= 0xFF => ConstForm::Byte,
        Some(Notation::Word) if narrow => ConstForm::Word(0x07),
        Some(Notation::Binary) if narrow => ConstForm::Word(0x02),
        Some(Notation::Binary) => ConstForm::DWord(0x02),
        Some(Notation::Int) if narrow => ConstForm::Word(0x03),
        Some(Notation::Text) if narrow => ConstForm::Word(0x05),
        Some(Notation::Text) => ConstForm::DWord(0x05),
        Some(Notation::Bytes) if narrow => ConstForm::Word(0x06),
        Some(Notation::Bytes) => ConstForm::DWord(0x06),
        Some(Notation::Count) if narrow => ConstForm::Word(0x08),
        Some(Notation::Date) if narrow => ConstForm::Word(0x0A),
        Some(Notation::S5Time) if narrow => ConstForm::Word(0x0C),
        Some(Notation::Real) => ConstForm::DWord(0x01),
        Some(Notation::DInt) => ConstForm::DWord(0x03),
        Some(Notation::Pointer) => ConstForm::DWord(0x04),
        Some(Notation::DWord) => ConstForm::DWord(0x07),
        Some(Notation::Time) => ConstForm::DWord(0x09),
        Some(Notation::TimeOfDay) => ConstForm::DWord(0x0B),
        None if value <= 0x7FFF => ConstForm::Word(0x03),
        _ if narrow => ConstForm::Word(0x07),
        _ => ConstForm::DWord(0x07),
    }
}

/// One block on its way.
struct Encoder<'e, 'c> {
    block: &'e CodeBlock,
    written: &'e Written,
    callees: &'e Callees<'c>,
    /// For each of the block's own formals its place in the list.
    places: Vec<u16>,
    pieces: Vec<Piece>,
    /// The next byte of local data the present statement may use, and the most that one used.
    local: u32,
    most: u32,
}

impl Encoder<'_, '_> {
    fn put(&mut self, op: Mc7Op) {
        self.pieces.push(Piece { op, to: None, network: 0, from: 0 });
    }

    fn plain(&mut self, op: Op) {
        self.put(Mc7Op::Plain(op));
    }

    /// Bytes of local data for the present statement.
    fn take(&mut self, bytes: u32) -> u32 {
        let at = self.local;
        self.local += bytes;
        self.most = self.most.max(self.local);
        at
    }

    /// The place of one of the block's own formals in the list.
    fn place(&self, index: u16) -> Option<u16> {
        if self.block.id.kind.has_instance() { None } else { self.places.get(usize::from(index)).copied() }
    }

    /// The operations from here on; gives how many were taken.
    fn statement(&mut self, index: u32, rest: &[ob1_ir::Stmt]) -> Option<usize> {
        let op = &rest.first()?.op;
        match op {
            Op::LoadConst(value) => {
                let form = const_form(self.written.notations.get(&index).copied(), *value);
                self.put(Mc7Op::Constant(form, *value));
            }
            Op::LoadParamPointer { index, .. } | Op::LoadParamCopy { index, .. } => {
                let op = Mc7Op::ParamPointer { index: self.place(*index)?, other: false };
                self.put(op);
            }
            Op::Jump(jump, to) => {
                self.pieces.push(Piece { op: Mc7Op::Jump(*jump, 0), to: Some(*to), network: 0, from: 0 });
            }
            Op::Loop(to) => {
                self.pieces.push(Piece { op: Mc7Op::Loop(0), to: Some(*to), network: 0, from: 0 });
            }
            Op::JumpList { targets, otherwise } => {
                let list = rest.get(1..).unwrap_or_default().iter().zip(targets);
                let stands = list.filter(|(s, to)| s.op == Op::Jump(Jump::Always, **to)).count() == targets.len();
                let behind = index as usize + 1 + targets.len();
                if !stands || !(1..=255).contains(&targets.len()) || *otherwise as usize != behind {
                    return None;
                }
                self.put(Mc7Op::JumpList(targets.len() as u16));
            }
            Op::Call(call) => self.call(call)?,
            Op::Nop => self.put(Mc7Op::Nop0),
            Op::Build(n) => self.put(Mc7Op::Build(*n)),
            Op::End => self.put(Mc7Op::End),
            Op::OpenDb(DbRegister::Db, Number::Instance(pointer)) if self.is_pointer(*pointer) => {
                return self.through(*pointer, rest);
            }
            other => self.operation(other)?,
        }
        Some(1)
    }

    /// An operation with perhaps one place or number.
    fn operation(&mut self, op: &Op) -> Option<()> {
        let mut op = op.clone();
        if let Some(number) = op.number_mut() {
            match *number {
                Number::Param(index) => *number = Number::Param(self.place(index)?),
                Number::Instance(at) => return self.number_of_instance(at, op),
                Number::Fixed(_) | Number::Memory(_) => {}
            }
        }
        if let Some(place) = op.place_mut() {
            match *place {
                Place::InDb(db, at) => {
                    *place = Place::Fixed(Area::Db, at);
                    self.plain(Op::OpenDb(DbRegister::Db, Number::Fixed(db)));
                }
                Place::InDi(db, at) => {
                    *place = Place::Fixed(Area::Di, at);
                    self.plain(Op::OpenDb(DbRegister::Di, Number::Fixed(db)));
                }
                Place::Instance(at) => *place = self.own(at)?,
                Place::Param { index, at } => {
                    let formal = self.block.interface.formals().nth(usize::from(index))?;
                    let whole = at.0 == 0 && !formal.ty.is_composed();
                    let list = self.place(index)?;
                    if !whole {
                        return self.component(list, at, op);
                    }
                    *place = Place::Param { index: list, at };
                }
                Place::Fixed(..) | Place::Memory(..) | Place::Register(..) => {}
            }
        }
        self.plain(op);
        Some(())
    }

    /// A variable of the block's own instance.
    fn own(&self, at: ob1_model::BitAddr) -> Option<Place> {
        if !self.block.id.kind.has_instance() {
            return None;
        }
        Some(if self.written.multi_instance {
            Place::Register(Some(Area::Di), AddressRegister::Ar2, at)
        } else {
            Place::Fixed(Area::Di, at)
        })
    }

    fn call(&mut self, call: &Call) -> Option<()> {
        if call.mode == CallMode::Call {
            return match call.target {
                Target::Block(id) if id.kind.has_instance() => self.instance_call(id, None, call),
                Target::Local(id, at) => self.instance_call(id, Some(at), call),
                Target::Block(id) => self.function_call(id, call),
                Target::Indirect(..) => None,
            };
        }
        let (kind, number) = match call.target {
            Target::Block(BlockId { kind, number }) => (kind, Number::Fixed(number)),
            Target::Indirect(kind, Number::Param(index)) => (kind, Number::Param(self.place(index)?)),
            Target::Indirect(kind, number @ (Number::Fixed(_) | Number::Memory(_))) => (kind, number),
            Target::Indirect(..) | Target::Local(..) => return None,
        };
        let list: Option<Vec<u32>> = call
            .args
            .iter()
            .map(|arg| match arg {
                Arg::Raw(bits) => Some(*bits),
                _ => None,
            })
            .collect();
        let list = if kind.has_instance() { None } else { Some(list?) };
        if call.instance.is_some() || kind.has_instance() && !call.args.is_empty() {
            return None;
        }
        let conditional = call.mode == CallMode::Conditional;
        self.put(Mc7Op::Call(Uncond { kind, number, conditional, list }));
        Some(())
    }
}

/// An operand of a width at a place.
const fn operand(width: ob1_ir::Width, place: Place) -> Operand {
    Operand { width, place }
}
