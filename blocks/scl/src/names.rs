//! References: a name and its steps to a place, a constant, or what is called.

use ob1_ir::{Number, Target, Width};
use ob1_model::{Area, BitAddr, BlockId, BlockKind, DataType, Layout, Section};
use ob1_stl::front::{
    BlockWord, Constant, Data, Kind as TokenKind, Span, Symbolic, Token, called_with, data_types, slice, with_article,
};

use crate::address::{add_index, db_address, of_width};
use crate::check::Checker;
use crate::functions::is_standard;
use crate::messages;
use crate::syntax::{Expr, Ref, Step};
use crate::tree::{Base, Kind, Side, Typed, Var};
use crate::types::{BLOCK_DB, BOOL, CHAR, COUNTER, TIMER};

/// What a name or a name with some of its steps is.
#[derive(Clone, Debug)]
pub(crate) enum Named<'w> {
    Value(Typed<'w>),
    Block(BlockId),
    /// A data block as a whole, by its number.
    Db(u16),
    /// An instance of a function block.
    Instance(BlockId, Var<'w>),
    /// A standard function, to be called.
    Function,
}

impl<'c> Checker<'c> {
    /// A reference as a value.
    pub(crate) fn reference(&mut self, reference: &Ref) -> Typed<'c> {
        match self.named(reference) {
            Some(Named::Value(value)) => value,
            Some(Named::Db(number)) => Typed::new(Kind::Block(Number::Fixed(number)), &BLOCK_DB, reference.span),
            Some(Named::Block(id)) => Typed::new(Kind::Block(Number::Fixed(id.number)), block_type(id), reference.span),
            Some(Named::Instance(_, var)) => {
                let ty = self.instance_struct(&var);
                match ty {
                    Some(ty) => Typed::new(Kind::Var(var), ty, reference.span),
                    None => self.no_value(reference),
                }
            }
            Some(Named::Function) => self.no_value(reference),
            None => self.bad(reference.span),
        }
    }

    fn no_value(&mut self, reference: &Ref) -> Typed<'c> {
        let shown: String = self.text(reference.first).chars().take(64).collect();
        self.report(
            reference.span,
            &messages::NOT_A_VALUE,
            format!("{shown} has no value: its parameters are missing"),
        );
        self.bad(reference.span)
    }

    /// The structure of an instance that was declared.
    fn instance_struct(&self, var: &Var<'c>) -> Option<&'c DataType> {
        let declared = var.declared?;
        let mut ty = &self.info.interface.params.get(declared)?.ty;
        while let DataType::Array(_, element) = ty {
            ty = element;
        }
        Some(ty)
    }

    /// A reference with all its steps. `None`: reported.
    pub(crate) fn named(&mut self, reference: &Ref) -> Option<Named<'c>> {
        let (mut named, taken) = self.first(reference)?;
        let mut steps = reference.steps.get(taken..).unwrap_or_default();
        while let Some((step, rest)) = steps.split_first() {
            let (next, used) = self.step(named, step, rest, reference)?;
            named = next;
            steps = rest.get(used..).unwrap_or_default();
        }
        Some(named)
    }

    /// What the name itself means, and how many steps belong to it.
    fn first(&mut self, reference: &Ref) -> Option<(Named<'c>, usize)> {
        let token = reference.first;
        let name = self.name(token);
        let called = matches!(reference.steps.first(), Some(Step::Call(_)));
        if token.kind == TokenKind::Local {
            if let Some(named) = self.local(name, token.span, called) {
                return Some((named, 0));
            }
            return self.unknown(token).map(|named| (named, 0));
        }
        if token.kind == TokenKind::Word {
            if let Some((named, used)) = self.absolute(reference)? {
                return Some((named, used));
            }
            // A variable may be called like the function that gives its value.
            let local = self.local(name, token.span, called);
            if let Some(named) = local.filter(|named| !called || !matches!(named, Named::Value(_))) {
                return Some((named, 0));
            }
        }
        if token.kind == TokenKind::Symbol
            && self.is_own_name(name)
            && !called
            && let Some(named) = self.own_result(token.span)
        {
            return Some((named, 0));
        }
        // A block of the library does not stand before the function of the same name; one of the program does.
        let is_own = |checker: &Self| checker.block_called(name).is_some_and(|id| checker.world.own.contains(&id));
        if called && token.kind == TokenKind::Word && is_standard(name) && !is_own(self) {
            return Some((Named::Function, 0));
        }
        if let Some(named) = self.symbol(name, token.span)? {
            return Some((named, 0));
        }
        if token.kind == TokenKind::Word {
            if name.eq_ignore_ascii_case("OK") {
                return Some((Named::Value(Typed::new(Kind::Ok, &BOOL, token.span)), 0));
            }
            if name.eq_ignore_ascii_case("ENO") {
                return Some((Named::Value(Typed::new(Kind::Eno, &BOOL, token.span)), 0));
            }
        }
        if called {
            return Some((Named::Function, 0));
        }
        if let Some(id) = self.library_block(name) {
            return Some((Named::Block(id), 0));
        }
        self.unknown(token).map(|named| (named, 0))
    }

    fn unknown(&mut self, token: Token) -> Option<Named<'c>> {
        let name = self.name(token);
        if token.kind == TokenKind::Symbol {
            self.world.report_unknown_symbol(name, self.block.file, token.span, self.sink);
            return None;
        }
        let shown: String = name.chars().take(64).collect();
        let params = &self.info.interface.params;
        let known: Vec<&str> = params.iter().map(|p| p.name.as_str()).collect();
        let key = format!("{} {}", self.block.file, name.to_uppercase());
        let symbols = self.world.symbols.keys().map(String::as_str);
        self.sink.missing(&key, self.block.file, token.span, &messages::UNKNOWN_NAME, |sink| {
            let near = sink.nearest(name, known.into_iter().chain(symbols));
            let remedy =
                near.map_or_else(|| messages::UNKNOWN_NAME.remedy.to_owned(), |near| format!("Did you mean {near}?"));
            (format!("{shown} is not known here"), remedy)
        });
        None
    }

    /// A declaration of the block, its own result, or one of its constants.
    fn local(&mut self, name: &str, span: Span, called: bool) -> Option<Named<'c>> {
        let info = self.info;
        if let Some((index, overlay)) = info.declared(name) {
            let param = info.interface.params.get(index)?;
            // A function called like its own result calls itself.
            if param.section != Section::Return {
                return Some(self.declaration(index, overlay.unwrap_or(&param.ty), span));
            }
        }
        if self.is_own_name(name)
            && !called
            && let Some(named) = self.own_result(span)
        {
            return Some(named);
        }
        let constant = info.constants.get(&name.to_uppercase())?;
        let ty = Self::own_type(constant);
        Some(Named::Value(Typed::new(Kind::Flexible(constant.clone()), ty, span)))
    }

    pub(crate) fn own_result(&self, span: Span) -> Option<Named<'c>> {
        let (index, param) = self.result()?;
        Some(self.declaration(index, &param.ty, span))
    }

    fn declaration(&self, index: usize, ty: &'c DataType, span: Span) -> Named<'c> {
        let info = self.info;
        let Some(param) = info.interface.params.get(index) else { return Named::Function };
        let has_instance = self.id.kind.has_instance();
        let formal = info.formal(index);
        let base = match formal {
            _ if param.section == Section::Temp => Base::Fixed(Area::Local),
            _ if has_instance && param.is_pointer() => Base::Through(param.at),
            _ if has_instance => Base::Instance,
            Some(formal) => Base::Param(formal),
            None => Base::Fixed(Area::Local),
        };
        let at = match base {
            Base::Param(_) | Base::Through(_) => BitAddr(0),
            _ => param.at,
        };
        if param.ty.is_parameter_type() {
            let number = if has_instance { Number::Instance(param.at) } else { Number::Param(formal.unwrap_or(0)) };
            let (kind, ty) = match param.ty {
                DataType::Timer | DataType::TimerOrWord => (Kind::Timer(number), &TIMER),
                DataType::Counter => (Kind::Counter(number), &COUNTER),
                _ => (Kind::Block(number), &param.ty),
            };
            return Named::Value(Typed::new(kind, ty, span));
        }
        let var = Var { base, at, terms: Vec::new(), declared: Some(index), side: Side::Both };
        match info.instances.get(&index) {
            Some(fb) if !matches!(param.ty, DataType::Array(..)) => Named::Instance(*fb, var),
            _ => Named::Value(Typed::new(Kind::Var(var), ty, span)),
        }
    }

    /// What a symbol stands for. The outer `None`: reported.
    fn symbol(&mut self, name: &str, span: Span) -> Option<Option<Named<'c>>> {
        let world = self.world;
        Some(Some(match world.symbol(name) {
            Some(Symbolic::Block(BlockWord::Db | BlockWord::Di, number)) => Named::Db(*number),
            Some(Symbolic::Block(word, number)) => {
                let Some(kind) = word.kind() else { return Some(None) };
                Named::Block(BlockId::new(kind, *number))
            }
            Some(Symbolic::Memory(operand, ty)) => {
                let ob1_ir::Place::Fixed(area, at) = operand.place else { return Some(None) };
                let ty =
                    ty.as_ref().filter(|ty| Width::of(ty) == Some(operand.width)).unwrap_or(of_width(operand.width));
                let side = match world.peripheral.get(&name.to_uppercase()) {
                    Some(true) => Side::Write,
                    Some(false) => Side::Read,
                    None => Side::Both,
                };
                let var = Var { base: Base::Fixed(area), at, terms: Vec::new(), declared: None, side };
                Named::Value(Typed::new(Kind::Var(var), ty, span))
            }
            Some(Symbolic::Timer(n)) => Named::Value(Typed::new(Kind::Timer(Number::Fixed(*n)), &TIMER, span)),
            Some(Symbolic::Counter(n)) => Named::Value(Typed::new(Kind::Counter(Number::Fixed(*n)), &COUNTER, span)),
            Some(Symbolic::Unknown(address)) => {
                let message = format!("the symbol table gives {name} the address {address}, which is not valid");
                self.report(span, &messages::UNKNOWN_NAME, message);
                return None;
            }
            Some(Symbolic::Nameless) => return None,
            None => return Some(None),
        }))
    }

    /// A block of the library or the program by its usual name.
    pub(crate) fn library_block(&self, name: &str) -> Option<BlockId> {
        let id = self.world.names.get(&name.to_uppercase()).copied();
        id.filter(|id| self.world.blocks.contains_key(id))
    }

    /// One step further. Gives how many of the steps behind it were used, too.
    fn step(&mut self, named: Named<'c>, step: &Step, rest: &[Step], reference: &Ref) -> Option<(Named<'c>, usize)> {
        let span = reference.span;
        match (named, step) {
            (Named::Db(number), Step::Dot(token)) => self.in_data(number, *token, rest, reference),
            (Named::Db(number), Step::Call(args)) => {
                let Some(ob1_ir::DataKind::Instance(fb)) = self.world.data.get(&number).map(|d| d.kind) else {
                    self.report(
                        span,
                        &messages::NOT_CALLABLE,
                        format!("DB {number} is no instance of a function block"),
                    );
                    return None;
                };
                let place = whole_db(number);
                let target = Target::Block(fb);
                self.call_instance(fb, target, Some(Number::Fixed(number)), place, args, span).map(|v| (v, 0))
            }
            (Named::Block(id), Step::Dot(token)) if id.kind.has_instance() => {
                self.block_with_data(id, *token, rest, span)
            }
            (Named::Block(id), Step::Call(args)) => self.call_block(id, args, span).map(|v| (v, 0)),
            (Named::Function, Step::Call(args)) => {
                let value = self.function(reference.first, args, span);
                (!value.is_bad()).then_some((Named::Value(value), 0))
            }
            (Named::Instance(fb, var), Step::Call(args)) => {
                let target = Target::Local(fb, var.at);
                self.call_instance(fb, target, None, var, args, span).map(|v| (v, 0))
            }
            (Named::Instance(fb, var), Step::Dot(token)) => {
                let ty = self.instance_struct(&var)?;
                if let Some(Step::Call(args)) = rest.first()
                    && let Some(id) = self.called_on(ty, *token)
                {
                    return self.call_place(id, fb, var, args, span).map(|v| (v, 1));
                }
                self.component(var, ty, *token, span).map(|v| (v, 0))
            }
            (Named::Value(value), step) => self.value_step(value, step, rest, span),
            (_, step) => {
                let what = match step {
                    Step::Index(_) => "it has no elements",
                    Step::Call(_) => "it cannot be called",
                    _ => "it has no components",
                };
                self.report(span, &messages::COMPONENT, format!("{}: {what}", self.text(reference.first)));
                None
            }
        }
    }

    fn value_step(&mut self, value: Typed<'c>, step: &Step, rest: &[Step], span: Span) -> Option<(Named<'c>, usize)> {
        match (value.kind, step) {
            (Kind::Bad, _) => None,
            (Kind::Var(var), Step::Dot(token)) => {
                if let Some(Step::Call(args)) = rest.first()
                    && let Some((id, fb)) = self.called_on(value.ty, *token).zip(self.data_type_of(value.ty))
                {
                    return self.call_place(id, fb, var, args, span).map(|v| (v, 1));
                }
                self.component(var, value.ty, *token, span).map(|v| (v, 0))
            }
            (Kind::Var(var), Step::Index(indices)) => self.element(var, value.ty, indices, span).map(|v| (v, 0)),
            (Kind::Var(var), Step::Periphery) => {
                let Base::Fixed(Area::Input | Area::Output) = var.base else {
                    self.report(span, &messages::ADDRESS, ":P stands behind inputs and outputs only");
                    return None;
                };
                let side = if matches!(var.base, Base::Fixed(Area::Input)) { Side::Read } else { Side::Write };
                let var = Var { base: Base::Fixed(Area::Peripheral), side, ..var };
                Some((Named::Value(Typed::new(Kind::Var(var), value.ty, value.span)), 0))
            }
            (Kind::Var(var), Step::Call(args)) => {
                // An IEC timer or counter within other data.
                let Some(fb) = self.data_type_of(value.ty) else {
                    self.report(
                        span,
                        &messages::NOT_CALLABLE,
                        format!("{} cannot be called", with_article(value.ty.name())),
                    );
                    return None;
                };
                self.call_place(fb, fb, var, args, span).map(|v| (v, 0))
            }
            (Kind::Block(number), Step::Dot(token)) if *value.ty == DataType::BlockDb => {
                let number = match number {
                    Number::Fixed(n) => {
                        return self.in_data(n, *token, rest, &Ref { first: *token, steps: Vec::new(), span });
                    }
                    other => Typed::new(Kind::Block(other), value.ty, value.span),
                };
                self.db_element(Base::DbAt(Box::new(number)), *token, rest, span)
            }
            (kind @ (Kind::Call(_) | Kind::Convert(..)), Step::Dot(token)) if *value.ty == DataType::BlockDb => {
                let number = Typed::new(kind, value.ty, value.span);
                self.db_element(Base::DbAt(Box::new(number)), *token, rest, span)
            }
            (_, Step::Follow) => {
                self.report(
                    span,
                    &messages::NOT_SUPPORTED,
                    "REF_TO and ^ need references, which this CPU does not have",
                );
                None
            }
            (_, step) => {
                let what = match step {
                    Step::Index(_) => "has no elements",
                    Step::Call(_) => "cannot be called",
                    _ => "has no component",
                };
                self.report(span, &messages::COMPONENT, format!("{} {what}", with_article(value.ty.name())));
                None
            }
        }
    }

    /// The block of an IEC timer or counter that is a data type.
    fn data_type_of(&self, ty: &DataType) -> Option<BlockId> {
        let is_one = |id: &BlockId| self.world.blocks.get(id).is_some_and(|b| b.interface.instance_type() == *ty);
        if matches!(ty, DataType::Struct(_)) { data_types().find(is_one) } else { None }
    }

    /// `timer.TON(...)`: the function block behind an instance that has no component of this name.
    fn called_on(&self, ty: &DataType, token: Token) -> Option<BlockId> {
        let name = self.name(token);
        let DataType::Struct(fields) = ty else { return None };
        let is_field = self.world.fields.find(fields, name).is_some();
        self.library_block(name).filter(|id| !is_field && id.kind.has_instance())
    }

    /// `.name` of a structure, `.%X3` of a bit string.
    fn component(&mut self, var: Var<'c>, ty: &'c DataType, token: Token, span: Span) -> Option<Named<'c>> {
        let name = self.name(token);
        if let DataType::Struct(fields) = ty {
            if let Some((inner, at)) = self.world.fields.find(fields, name) {
                return Some(value_at(var, at.0, inner, span));
            }
            let known: Vec<&str> = fields.iter().map(|f| f.name.as_str()).collect();
            let shown: String = name.chars().take(64).collect();
            let message = format!("the structure has no component {shown}");
            self.sink.report_unknown(self.block.file, token.span, &messages::COMPONENT, message, name, known);
            return None;
        }
        let sliced = ty.elementary_bits().and_then(|bits| slice(bits, name));
        match sliced {
            Some((inner, at)) => Some(value_at(var, at.0, inner, span)),
            None => {
                let shown: String = name.chars().take(64).collect();
                let message = format!("{} has no component {shown}", with_article(ty.name()));
                self.report(token.span, &messages::COMPONENT, message);
                None
            }
        }
    }

    /// `[i, j]` of an array, `[i]` of a STRING.
    fn element(&mut self, mut var: Var<'c>, ty: &'c DataType, indices: &[Expr], span: Span) -> Option<Named<'c>> {
        if let (DataType::String(max), [index]) = (ty, indices) {
            let index = self.index(index)?;
            let high = i32::from(*max);
            var.at.0 += 16;
            add_index(&mut var, index, (1, high), 8);
            return Some(Named::Value(Typed::new(Kind::Var(var), &CHAR, span)));
        }
        let DataType::Array(dims, inner) = ty else {
            self.report(span, &messages::INDEX, format!("{} has no elements", with_article(ty.name())));
            return None;
        };
        if dims.len() != indices.len() {
            let message = format!("the array has {} dimensions, this is {} indices", dims.len(), indices.len());
            self.report(span, &messages::INDEX, message);
            return None;
        }
        let mut rows: Vec<u32> = Vec::new();
        // Siemens' compiler counts elements, though the room of an array has rows that begin on even bytes.
        for (at, _) in dims.iter().enumerate().rev() {
            let stride = match (rows.last(), dims.get(at + 1)) {
                (Some(stride), Some(next)) => next.len().saturating_mul(*stride),
                _ => Layout::stride(inner),
            };
            rows.push(stride);
        }
        rows.reverse();
        for ((dim, expr), stride) in dims.iter().zip(indices).zip(rows) {
            let index = self.index(expr)?;
            if let Kind::Constant(value) = index.kind {
                let value = value as i32;
                if !(dim.low..=dim.high).contains(&value) {
                    let message = format!("the index {value} is outside the bounds {}..{}", dim.low, dim.high);
                    self.report(expr.span, &messages::INDEX, message);
                    return None;
                }
            }
            add_index(&mut var, index, (dim.low, dim.high), stride);
        }
        let instance = var.declared.and_then(|d| self.info.instances.get(&d));
        Some(match instance {
            Some(fb)
                if var.terms.is_empty() && !matches!(**inner, DataType::Array(..)) && self.is_instance(*fb, inner) =>
            {
                Named::Instance(*fb, var)
            }
            _ => Named::Value(Typed::new(Kind::Var(var), inner, span)),
        })
    }

    fn is_instance(&self, fb: BlockId, ty: &DataType) -> bool {
        self.world.blocks.get(&fb).is_some_and(|info| info.interface.instance_type() == *ty)
    }

    /// An index as a DINT.
    pub(crate) fn index(&mut self, expr: &Expr) -> Option<Typed<'c>> {
        let value = self.expr(expr);
        self.whole_number(value)
    }

    /// What follows the point behind a data block.
    fn in_data(&mut self, number: u16, token: Token, rest: &[Step], reference: &Ref) -> Option<(Named<'c>, usize)> {
        let name = self.name(token);
        let world = self.world;
        let data: Option<&'c Data> = world.data.get(&number);
        if let Some(component) = data.and_then(|data| data.find(name)) {
            let var = Var { at: component.at, ..whole_db(number) };
            let value = Typed::new(Kind::Var(var), &component.ty, reference.span);
            return Some((Named::Value(value), 0));
        }
        // An instance that a call before has asked for.
        let wanted = self.wanted.get(&number).and_then(|fb| world.blocks.get(fb));
        let member = wanted.filter(|_| data.is_none()).and_then(|info| info.interface.find(name));
        if let Some(param) = member.filter(|p| p.section != Section::Temp && !p.is_pointer()) {
            let var = Var { at: param.at, ..whole_db(number) };
            return Some((Named::Value(Typed::new(Kind::Var(var), &param.ty, reference.span)), 0));
        }
        // `"DB".TON(...)`: the data block is an instance of that block.
        if let Some(Step::Call(args)) = rest.first()
            && let Some(id) = self.library_block(name).or_else(|| self.symbol_block(name))
        {
            let made_for = match data.map(|d| d.kind) {
                Some(ob1_ir::DataKind::Instance(fb)) => fb,
                _ => id,
            };
            let id = called_with(id, made_for);
            let place = whole_db(number);
            let value =
                self.call_instance(id, Target::Block(id), Some(Number::Fixed(number)), place, args, reference.span)?;
            return Some((value, 1));
        }
        let absolute = db_address(name).is_some();
        if !absolute || matches!(token.kind, TokenKind::Symbol) {
            if data.is_none() {
                world.report_missing_data(number, name, self.block.file, token.span, self.sink);
                return None;
            }
            let known: Vec<&str> = data.into_iter().flat_map(|d| &d.components).map(|c| c.path.as_str()).collect();
            let shown: String = name.chars().take(64).collect();
            let message = format!("DB {number} has no component {shown}");
            self.sink.report_unknown(self.block.file, token.span, &messages::COMPONENT, message, name, known);
            return None;
        }
        self.db_element(Base::Db(number), token, rest, reference.span)
    }

    fn symbol_block(&self, name: &str) -> Option<BlockId> {
        match self.world.symbol(name)? {
            Symbolic::Block(word, number) => Some(BlockId::new(word.kind()?, *number)),
            _ => None,
        }
    }

    /// A constant that a token names or is, as an index or label needs it.
    pub(crate) fn whole(constant: &Constant) -> Option<i64> {
        match constant {
            Constant::Integer(v) => Some(*v),
            Constant::Text(text) if text.len() == 1 => text.first().map(|b| i64::from(*b)),
            other => other.whole().map(i64::from),
        }
    }
}

fn value_at<'c>(var: Var<'c>, bits: u32, ty: &'c DataType, span: Span) -> Named<'c> {
    let var = Var { at: BitAddr(var.at.0 + bits), ..var };
    Named::Value(Typed::new(Kind::Var(var), ty, span))
}

const fn whole_db<'c>(number: u16) -> Var<'c> {
    Var { base: Base::Db(number), at: BitAddr(0), terms: Vec::new(), declared: None, side: Side::Both }
}

const fn block_type(id: BlockId) -> &'static DataType {
    match id.kind {
        BlockKind::Fb | BlockKind::Sfb => &DataType::BlockFb,
        BlockKind::Fc | BlockKind::Sfc => &DataType::BlockFc,
        _ => &BLOCK_DB,
    }
}
