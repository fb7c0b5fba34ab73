//! Types as written to types as laid out: arrays, structures, UDTs, instances of function blocks.

use std::collections::BTreeMap;

use ob1_model::{BlockId, BlockKind, DataType, Dimension, Field, Layout};

use crate::constant::Constant;
use crate::diagnostic::USES;
use crate::elaborate::{Elaborator, LONGEST, Resolved, State, declared_type};
use crate::identifiers::BlockWord;
use crate::messages;
use crate::operand::Resolver;
use crate::parse_types::TYPE_DEPTH;
use crate::reader::Reader;
use crate::syntax::{Bound, Declaration, NameRef, Tokens, Type, TypeKind};
use crate::tia;
use crate::token::Span;

impl Elaborator<'_> {
    /// A type as written. `None` when it has a mistake (reported).
    pub(crate) fn ty(&mut self, file: usize, ty: &Type, nesting: u32) -> Option<Resolved> {
        let resolved = match &ty.kind {
            TypeKind::Bad => return None,
            TypeKind::Simple(simple) => Resolved { ty: simple.clone(), fb: None, depth: 0 },
            TypeKind::Text(length) => {
                let length = self.number_of(file, length, ty.span).and_then(|n| u8::try_from(n).ok());
                let Some(length) = length.filter(|n| (1..=254).contains(n)) else {
                    let message = "a STRING has a length from 1 to 254: STRING[20]";
                    self.sink.report(file, ty.span, &messages::STRING_LENGTH, message);
                    return None;
                };
                Resolved { ty: DataType::String(length), fb: None, depth: 0 }
            }
            TypeKind::Array(dims, element) => self.array(file, ty.span, dims, element, nesting)?,
            TypeKind::Struct(declarations) => {
                let (fields, depth) = self.fields(file, declarations, nesting)?;
                if fields.is_empty() {
                    self.sink.report(file, ty.span, &messages::EMPTY_STRUCT, "the structure has no components");
                    return None;
                }
                Resolved { ty: DataType::Struct(fields), fb: None, depth: depth + 1 }
            }
            TypeKind::Named(name) => self.named(file, name, ty.span, nesting)?,
        };
        if resolved.depth > TYPE_DEPTH {
            self.sink.report(
                file,
                ty.span,
                &messages::TYPE_DEPTH,
                format!("types are nested more than {TYPE_DEPTH} deep"),
            );
            return None;
        }
        Some(resolved)
    }

    fn array(
        &mut self,
        file: usize,
        span: Span,
        dims: &[(Bound, Bound)],
        element: &Type,
        nesting: u32,
    ) -> Option<Resolved> {
        let inner = self.ty(file, element, nesting)?;
        if inner.ty.is_parameter_type() {
            let message = format!("there are no arrays of {}", inner.ty.name());
            self.sink.report(file, element.span, &messages::TYPE_NOT_HERE, message);
            return None;
        }
        let mut numbers = Vec::with_capacity(dims.len());
        for (low, high) in dims {
            let (low, high) = (self.bound(file, span, low)?, self.bound(file, span, high)?);
            if low > high {
                let message = format!("an array from {low} to {high} has no elements");
                self.sink.report(file, span, &messages::ARRAY_BOUNDS, message);
                return None;
            }
            numbers.push(Dimension { low, high });
        }
        let dims = numbers;
        let count = dims.iter().fold(1u64, |n, d| n.saturating_mul(u64::from(d.len())));
        // Rows begin on even bytes, so the size is checked against the limit row by row.
        let row = dims.last().map_or(0, |d| u64::from(d.len()).saturating_mul(u64::from(Layout::stride(&inner.ty))));
        let rows = count / dims.last().map_or(1, |d| u64::from(d.len()).max(1));
        let bits = row.saturating_add(15).saturating_mul(rows.max(1));
        if bits > u64::from(LONGEST) * 8 + 15 || count > u64::from(LONGEST) * 8 {
            self.too_long(file, span, "the array");
            return None;
        }
        Some(Resolved { ty: DataType::Array(dims, Box::new(inner.ty)), fb: inner.fb, depth: inner.depth + 1 })
    }

    /// The whole number that an expression of constants gives.
    fn number_of(&mut self, file: usize, tokens: &Tokens, span: Span) -> Option<i32> {
        let resolver = Resolver::new(&self.world, self.sets.of(file), None).with(&self.constants);
        let mut reader = Reader::new(file, self.files.get(file)?, self.sink, tokens.clone(), span);
        let constant = resolver.constant(&mut reader)?;
        reader.finish(&messages::ARRAY_BOUNDS).then(|| constant.whole())?
    }

    /// A bound as a number. `None` when it is the name of no constant of the block (reported).
    fn bound(&mut self, file: usize, span: Span, bound: &Bound) -> Option<i32> {
        let name = match bound {
            Bound::Number(number) => return Some(*number),
            Bound::Value(tokens) => {
                let number = self.number_of(file, tokens, span).filter(|n| i16::try_from(*n).is_ok());
                if number.is_none() {
                    let message = "a bound of an array is a whole number from -32768 to 32767";
                    self.sink.report(file, span, &messages::ARRAY_BOUNDS, message);
                }
                return number;
            }
            Bound::Named(name) => name,
        };
        let number = self.constants.get(&name.to_uppercase()).and_then(Constant::whole);
        let number = number.filter(|n| i16::try_from(*n).is_ok());
        if number.is_none() {
            let key = format!("bound {}", name.to_uppercase());
            let shown: String = name.chars().take(64).collect();
            self.sink.missing(&key, file, span, &messages::ARRAY_BOUNDS, |_| {
                let message = format!("{shown} is not a whole number of VAR CONSTANT in this block: {USES}");
                (message, "Constants of a tag table are not exported with it: write the number instead.".to_owned())
            });
        }
        number
    }

    /// The components of a structure. `None` when one has a mistake: the layout of the others would be wrong.
    pub(crate) fn fields(
        &mut self,
        file: usize,
        declarations: &[Declaration],
        nesting: u32,
    ) -> Option<(Vec<Field>, u32)> {
        let mut fields = Vec::with_capacity(declarations.len());
        let mut layout = Layout::new();
        let mut depth = 0;
        let mut good = true;
        let mut names = BTreeMap::new();
        for declaration in declarations {
            self.sink.steps += 1;
            good &= self.not_twice(file, declaration, &mut names);
            if declaration.over.is_some() {
                let message = "AT lays one variable of a block over another; a structure has none";
                self.sink.report(file, declaration.span, &messages::DECLARATION, message);
                good = false;
                continue;
            }
            let Some(resolved) = self.ty(file, &declaration.ty, nesting) else {
                good = false;
                continue;
            };
            let instance = resolved.fb.is_some_and(|fb| !tia::is_data_type(fb));
            if resolved.ty.is_parameter_type() || instance {
                let message = format!("a structure has no components of the type {}", declared_type(&resolved));
                self.sink.report(file, declaration.span, &messages::TYPE_NOT_HERE, message);
                good = false;
                continue;
            }
            layout.place(&resolved.ty);
            if layout.bytes() > LONGEST {
                self.too_long(file, declaration.span, "the structure");
                return None;
            }
            let initial = self.start_value(file, declaration.initial.as_ref(), declaration.span, &resolved.ty);
            depth = depth.max(resolved.depth);
            fields.push(Field { name: declaration.name.clone(), ty: resolved.ty, initial });
        }
        good.then_some((fields, depth))
    }

    fn named(&mut self, file: usize, name: &NameRef, span: Span, nesting: u32) -> Option<Resolved> {
        let (word, number) = self.resolve_name(file, name, span)?;
        let resolved = match word {
            BlockWord::Udt => match self.udt(number, nesting + 1) {
                Some(resolved) => resolved,
                None => {
                    self.unusable_type(file, span, word, number);
                    return None;
                }
            },
            BlockWord::Fb | BlockWord::Sfb => self.instance(file, span, word, number, nesting)?,
            _ => {
                self.sink.report(
                    file,
                    span,
                    &messages::UNKNOWN_TYPE,
                    format!("{} {number} is not a data type", word.name()),
                );
                return None;
            }
        };
        let cost = nodes(&resolved.ty);
        self.spend(file, span, cost).then_some(resolved)
    }

    fn unusable_type(&mut self, file: usize, span: Span, word: BlockWord, number: u16) {
        let name = format!("{} {number}", word.name());
        match self.udts.get(&number) {
            Some(State::Busy) => {
                self.sink.report(file, span, &messages::UNUSABLE_TYPE, format!("{name} contains itself"));
            }
            // Its mistake has been reported.
            Some(_) => {}
            None => self.sink.missing(&name, file, span, &messages::UNUSABLE_TYPE, |_| {
                (format!("{name}: {USES}, and it is not in the program"), messages::NO_BLOCK.remedy.to_owned())
            }),
        }
    }

    /// A UDT. `None` when it is missing, has a mistake, or is being made.
    pub(crate) fn udt(&mut self, number: u16, nesting: u32) -> Option<Resolved> {
        match self.udts.get(&number) {
            Some(State::Done(resolved)) => return Some(resolved.clone()),
            Some(_) => return None,
            None => {}
        }
        let index = *self.by_name.get(&(BlockWord::Udt, number))?;
        let block = self.blocks.get(index)?;
        self.udts.insert(number, State::Busy);
        let resolved = match &block.shape {
            Some(shape) if nesting <= TYPE_DEPTH => self.ty(block.file, shape, nesting),
            Some(_) => {
                let message = format!("types are nested more than {TYPE_DEPTH} deep");
                self.sink.report(block.file, block.span, &messages::TYPE_DEPTH, message);
                None
            }
            None => {
                self.sink.report(block.file, block.span, &messages::NO_STRUCTURE, "the TYPE has no structure");
                None
            }
        };
        let state = resolved.clone().map_or(State::Bad, State::Done);
        self.udts.insert(number, state);
        resolved
    }

    /// The type of a multi-instance: a structure with the layout of the FB's instance.
    fn instance(&mut self, file: usize, span: Span, word: BlockWord, number: u16, nesting: u32) -> Option<Resolved> {
        let kind = if word == BlockWord::Sfb { BlockKind::Sfb } else { BlockKind::Fb };
        let id = BlockId::new(kind, number);
        if word == BlockWord::Fb
            && !self.function_block(number, nesting + 1)
            && self.by_name.contains_key(&(word, number))
        {
            match self.fbs.get(&number) {
                Some(State::Busy) => {
                    self.sink.report(file, span, &messages::UNUSABLE_TYPE, format!("{id} contains itself"));
                }
                // Its mistake has been reported.
                Some(_) => {}
                None => {
                    self.sink.report(file, span, &messages::UNUSABLE_TYPE, format!("{id} is nested too deep"));
                }
            }
            return None;
        }
        let Some(info) = self.world.blocks.get(&id) else {
            self.world.report_missing(id, &[], file, span, self.sink);
            return None;
        };
        let ty = info.interface.instance_type();
        let depth = depth_of(&ty);
        Some(Resolved { ty, fb: Some(id), depth })
    }
}

/// Bits that a view reaches into: the filling at the end of a structure or array does not count.
pub(crate) fn needed(ty: &DataType) -> u32 {
    match ty {
        DataType::Array(dims, element) => {
            let last = dims.last().map_or(0, |d| d.len());
            let before = Layout::bits(ty) - ob1_model::align_to(last.saturating_mul(Layout::stride(element)), 16);
            before + last.saturating_sub(1).saturating_mul(Layout::stride(element)) + needed(element)
        }
        DataType::Struct(fields) => {
            let mut layout = Layout::new();
            fields.iter().map(|f| layout.place(&f.ty).0 + needed(&f.ty)).max().unwrap_or(0)
        }
        _ => Layout::bits(ty),
    }
}

fn depth_of(ty: &DataType) -> u32 {
    match ty {
        DataType::Struct(fields) => 1 + fields.iter().map(|f| depth_of(&f.ty)).max().unwrap_or(0),
        DataType::Array(_, element) => 1 + depth_of(element),
        _ => 0,
    }
}

/// What a copy of the type costs.
fn nodes(ty: &DataType) -> u64 {
    match ty {
        DataType::Struct(fields) => fields.iter().map(|f| 1 + nodes(&f.ty)).sum::<u64>() + 1,
        DataType::Array(_, element) => 1 + nodes(element),
        _ => 1,
    }
}
