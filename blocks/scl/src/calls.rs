//! Calls of blocks: which one, and its actual parameters.

use ob1_ir::{DataKind, Number, Target};
use ob1_model::{BlockId, BlockKind, DataType, Param, Section};
use ob1_stl::front::{
    Info, Span, Symbolic, Token, called, called_with, same_instance, same_layout, split_digits, with_article,
};

use crate::check::Checker;
use crate::convert::implicit;
use crate::messages;
use crate::names::Named;
use crate::syntax::{Arg, Step};
use crate::tree::{Actual, Base, Call, Kind, Side, Typed, Var};
use crate::types::{BOOL, NOTHING, short};

impl<'c> Checker<'c> {
    /// A block that a name means: a symbol, or a block of the library.
    pub(crate) fn block_called(&self, name: &str) -> Option<BlockId> {
        let symbol = match self.world.symbol(name) {
            Some(Symbolic::Block(word, number)) => word.kind().map(|kind| BlockId::new(kind, *number)),
            _ => None,
        };
        symbol.filter(|id| self.world.blocks.contains_key(id)).or_else(|| self.library_block(name))
    }

    /// A call of a library function that an operator or conversion becomes.
    pub(crate) fn library(&mut self, name: &str, values: Vec<Typed<'c>>, span: Span) -> Option<Typed<'c>> {
        let Some(id) = self.block_called(name) else {
            self.lacks(name, span);
            return None;
        };
        let info = self.world.blocks.get(&id)?;
        let formals: Vec<&'c Param> = info.interface.formals().collect();
        let mut actuals = Vec::new();
        let inputs = formals.iter().enumerate().filter(|(_, p)| p.section == Section::Input);
        for ((index, formal), value) in inputs.zip(values) {
            let value = self.input(id, formal, value)?;
            actuals.push(Actual { index, formal, value });
        }
        Some(self.call_node(id, Target::Block(id), None, None, actuals, span))
    }

    /// A statement needs a block of the library that is not there.
    pub(crate) fn lacks(&mut self, name: &str, span: Span) {
        let key = format!("{name}(");
        self.sink.missing(&key, self.block.file, span, &messages::UNKNOWN_NAME, |_| {
            let message = format!("this needs the block {name} of the IEC library, and it is not there");
            (message, format!("Load {name}, or the IEC library (docs/standard-blocks.md)."))
        });
    }

    fn call_node(
        &self,
        id: BlockId,
        target: Target,
        instance: Option<Number>,
        place: Option<Var<'c>>,
        actuals: Vec<Actual<'c>>,
        span: Span,
    ) -> Typed<'c> {
        let formals: Vec<&'c Param> =
            self.world.blocks.get(&id).map(|info| info.interface.formals().collect()).unwrap_or_default();
        let ty = match formals.iter().find(|p| p.section == Section::Return) {
            Some(result) if !id.kind.has_instance() => &result.ty,
            _ => &NOTHING,
        };
        let copies = self.world.own.contains(&id);
        let line = self.line;
        let (enable, enabled) = (None, None);
        let call = Call { target, instance, place, actuals, enable, enabled, copies, formals, line };
        Typed::new(Kind::Call(Box::new(call)), ty, span)
    }

    fn missing_block(&mut self, id: BlockId, args: &[Arg], span: Span) {
        let given: Vec<&str> = args.iter().filter_map(|arg| arg.name).map(|name| self.name(name)).collect();
        self.world.report_missing(id, &given, self.block.file, span, self.sink);
    }

    /// A call of a function.
    pub(crate) fn call_block(&mut self, id: BlockId, args: &[Arg], span: Span) -> Option<Named<'c>> {
        if id.kind.has_instance() {
            let message = format!("{id} is a function block: it is called with an instance");
            self.report(span, &messages::NO_INSTANCE, message);
            return None;
        }
        if !id.kind.is_function() {
            self.report(span, &messages::NOT_CALLABLE, format!("{id} cannot be called"));
            return None;
        }
        let Some(info) = self.world.blocks.get(&id) else {
            self.missing_block(id, args, span);
            return None;
        };
        self.call(id, info, (Target::Block(id), None, None), args, span).map(Named::Value)
    }

    /// `FB.DB(...)`: a function block with its instance data block.
    pub(crate) fn block_with_data(
        &mut self,
        id: BlockId,
        token: Token,
        rest: &[Step],
        span: Span,
    ) -> Option<(Named<'c>, usize)> {
        let name = self.name(token);
        let (letters, digits) = split_digits(name);
        let number = match self.world.symbol(name) {
            Some(Symbolic::Block(word, number)) if word.kind() == Some(BlockKind::Db) => Some(*number),
            _ if letters.eq_ignore_ascii_case("DB") => digits.parse().ok().filter(|n| *n > 0),
            _ => None,
        };
        let (Some(db), Some(Step::Call(args))) = (number, rest.first()) else {
            let message = format!("behind {id} stands its instance data block with parameters: FB.DB(...)");
            self.report(span, &messages::NO_INSTANCE, message);
            return None;
        };
        let place =
            Var { base: Base::Db(db), at: ob1_model::BitAddr(0), terms: Vec::new(), declared: None, side: Side::Both };
        let value = self.call_instance(id, Target::Block(id), Some(Number::Fixed(db)), place, args, span)?;
        Some((value, 1))
    }

    /// A call of an instance that lies anywhere: within data or the own instance.
    pub(crate) fn call_place(
        &mut self,
        id: BlockId,
        made_for: BlockId,
        var: Var<'c>,
        args: &[Arg],
        span: Span,
    ) -> Option<Named<'c>> {
        let id = called_with(id, made_for);
        if id != made_for && !same_instance(id, made_for) {
            let message = format!("this is an instance of {made_for}, not of {id}");
            self.report(span, &messages::NO_INSTANCE, message);
            return None;
        }
        match var.base {
            Base::Db(db) if var.terms.is_empty() => {
                let target = Target::Local(id, var.at);
                self.call_instance(id, target, Some(Number::Fixed(db)), var, args, span)
            }
            Base::Instance if var.terms.is_empty() => {
                self.call_instance(id, Target::Local(id, var.at), None, var, args, span)
            }
            _ => {
                let message =
                    "an instance is called where its address is known: in VAR or a data block, with a fixed index";
                self.report(span, &messages::NOT_SUPPORTED, message);
                None
            }
        }
    }

    /// A call of a function block with an instance.
    pub(crate) fn call_instance(
        &mut self,
        id: BlockId,
        target: Target,
        instance: Option<Number>,
        place: Var<'c>,
        args: &[Arg],
        span: Span,
    ) -> Option<Named<'c>> {
        let Some(info) = self.world.blocks.get(&id) else {
            self.missing_block(id, args, span);
            return None;
        };
        if let (Some(Number::Fixed(db)), Target::Block(_)) = (instance, target) {
            self.instance_data(id, db, span)?;
        }
        self.call(id, info, (target, instance, Some(place)), args, span).map(Named::Value)
    }

    /// Checks the instance data block; asks for it where no source declares it.
    fn instance_data(&mut self, id: BlockId, db: u16, span: Span) -> Option<()> {
        let wrong = match self.world.data.get(&db).map(|d| d.kind) {
            Some(DataKind::Instance(other)) if other == id || same_instance(other, id) => None,
            Some(DataKind::Instance(other)) => Some(format!("DB {db} is an instance of {other}, not of {id}")),
            Some(DataKind::Global) => Some(format!("DB {db} is a global data block, not an instance of {id}")),
            None => match self.wanted.insert(db, id) {
                Some(other) if other != id => Some(format!("DB {db} is already an instance of {other}")),
                _ => None,
            },
        };
        if let Some(message) = wrong {
            self.report(span, &messages::NO_INSTANCE, message);
            return None;
        }
        Some(())
    }

    fn call(
        &mut self,
        id: BlockId,
        info: &'c Info,
        (target, instance, place): (Target, Option<Number>, Option<Var<'c>>),
        args: &[Arg],
        span: Span,
    ) -> Option<Typed<'c>> {
        let formals: Vec<&'c Param> = info.interface.formals().collect();
        let mut given: Vec<usize> = Vec::new();
        let mut actuals = Vec::new();
        let (mut enable, mut enabled) = (None, None);
        let mut good = true;
        for (at, arg) in args.iter().enumerate() {
            if let Some(name) = arg.name
                && info.interface.formal(self.name(name)).is_none()
            {
                let called = self.name(name);
                let is_enable = called.eq_ignore_ascii_case("EN");
                if is_enable || called.eq_ignore_ascii_case("ENO") {
                    let Some(value) = &arg.value else { continue };
                    let value = if is_enable { self.expr_as(value, &BOOL) } else { self.eno(value) };
                    good &= value.is_some();
                    *(if is_enable { &mut enable } else { &mut enabled }) = value;
                    continue;
                }
            }
            let Some((index, formal)) = self.formal(id, info, &formals, arg, at) else {
                good = false;
                continue;
            };
            if given.contains(&index) {
                self.report(arg.span, &messages::UNKNOWN_PARAMETER, format!("{} is supplied twice", formal.name));
                good = false;
                continue;
            }
            let Some(value) = &arg.value else {
                // `=>` with nothing behind it; an input of a function is missing then.
                given.extend((id.kind.has_instance() || formal.section == Section::Output).then_some(index));
                continue;
            };
            given.push(index);
            let value = self.expr(value);
            match self.actual(id, formal, value, arg) {
                Some(value) => actuals.push(Actual { index, formal, value }),
                None => good = false,
            }
        }
        if !id.kind.has_instance() {
            let missing: Vec<&str> = formals
                .iter()
                .enumerate()
                .filter(|(at, p)| !given.contains(at) && p.section != Section::Return)
                .filter(|(_, p)| !(self.options.tia && p.section == Section::Output))
                .map(|(_, p)| p.name.as_str())
                .collect();
            if !missing.is_empty() && good {
                let message = format!("the call of {} lacks {}", called(id, info), missing.join(", "));
                self.report(span, &messages::MISSING_PARAMETER, message);
                good = false;
            }
        }
        if !good {
            return None;
        }
        let mut node = self.call_node(id, target, instance, place, actuals, span);
        if let Kind::Call(call) = &mut node.kind {
            (call.enable, call.enabled) = (enable, enabled);
        }
        Some(node)
    }

    /// The variable behind `ENO =>`.
    fn eno(&mut self, value: &crate::syntax::Expr) -> Option<Typed<'c>> {
        let value = self.expr(value).good()?;
        let fits = *value.ty == DataType::Bool && matches!(value.kind, Kind::Var(_) | Kind::Ok | Kind::Eno);
        if !fits {
            self.report(value.span, &messages::ACTUAL, "ENO gives a BOOL: it takes a variable of this type");
            return None;
        }
        self.mark_written(&value);
        Some(value)
    }

    /// The formal that an argument is for.
    fn formal(
        &mut self,
        id: BlockId,
        info: &'c Info,
        formals: &[&'c Param],
        arg: &Arg,
        at: usize,
    ) -> Option<(usize, &'c Param)> {
        let Some(token) = arg.name else {
            let inputs = formals.iter().enumerate().filter(|(_, p)| p.section != Section::Return);
            let found = inputs.map(|(index, formal)| (index, *formal)).nth(at);
            if found.is_none() {
                self.report(
                    arg.span,
                    &messages::UNKNOWN_PARAMETER,
                    format!("{} has no parameter more", called(id, info)),
                );
            }
            return found;
        };
        let name = self.name(token);
        let mut all = formals.iter().enumerate().map(|(index, formal)| (index, *formal));
        let mut found = all.clone().find(|(_, p)| p.is_called(name));
        // TIA Portal calls the only input of LEN so.
        if found.is_none() && name.eq_ignore_ascii_case("IN") && !self.world.own.contains(&id) {
            found = all.find(|_| formals.iter().filter(|p| p.section != Section::Return).count() == 1);
        }
        if found.is_none() {
            let known: Vec<&str> = formals.iter().map(|p| p.name.as_str()).collect();
            let message = format!("{} has no parameter {name}", called(id, info));
            self.sink.report_unknown(self.block.file, token.span, &messages::UNKNOWN_PARAMETER, message, name, known);
        }
        found
    }

    fn actual(&mut self, id: BlockId, formal: &'c Param, value: Typed<'c>, arg: &Arg) -> Option<Typed<'c>> {
        if value.is_bad() {
            return None;
        }
        match formal.section {
            Section::Input if arg.out => {
                let message = format!("{} of {id} is an input: it takes :=", formal.name);
                self.report(arg.span, &messages::PARAMETER_SIDE, message);
                None
            }
            Section::Input => self.input(id, formal, value),
            section => {
                if section == Section::InOut && arg.out {
                    let message = format!("{} of {id} is an in/out: it takes :=", formal.name);
                    self.report(arg.span, &messages::PARAMETER_SIDE, message);
                    return None;
                }
                self.variable(id, formal, value)
            }
        }
    }

    /// The value of an input.
    fn input(&mut self, id: BlockId, formal: &'c Param, value: Typed<'c>) -> Option<Typed<'c>> {
        let to = &formal.ty;
        if let Kind::Flexible(_) = value.kind {
            return self.coerced(value, to);
        }
        let fits = match (to, value.ty) {
            (DataType::Any | DataType::Pointer, _) => {
                if !matches!(value.kind, Kind::Var(_) | Kind::Bytes(_) | Kind::Block(Number::Fixed(_))) {
                    let message = format!("{} of {id} leads to a variable: it takes one, and no value", formal.name);
                    self.report(value.span, &messages::ACTUAL, message);
                    return None;
                }
                true
            }
            (DataType::String(_), DataType::String(_) | DataType::Char) => true,
            (a, b) if a.is_parameter_type() => a == b || matches!(a, DataType::TimerOrWord),
            (a, b) if a.is_composed() => same_layout(a, b),
            _ => return self.coerced(value, to),
        };
        if !fits {
            let message = format!(
                "{} of {id} is {}, this is {}",
                formal.name,
                with_article(short(to)),
                with_article(short(value.ty))
            );
            self.report(value.span, &messages::ACTUAL, message);
            return None;
        }
        Some(value)
    }

    /// The variable of an output or in/out.
    fn variable(&mut self, id: BlockId, formal: &'c Param, value: Typed<'c>) -> Option<Typed<'c>> {
        let pointer = matches!(formal.ty, DataType::Any | DataType::Pointer);
        if !(matches!(value.kind, Kind::Var(_)) || pointer && value.is_constant()) {
            let message = format!("{} of {id} is written: it takes a variable", formal.name);
            self.report(value.span, &messages::ACTUAL, message);
            return None;
        }
        if pointer && value.is_constant() {
            return self.coerced(value, &formal.ty);
        }
        let fits = pointer
            || same_layout(&formal.ty, value.ty)
            || formal.section != Section::InOut && {
                let back = Typed::new(Kind::Ok, &formal.ty, value.span);
                implicit(back, value.ty).is_ok()
            };
        if !fits {
            let ty = with_article(short(&formal.ty));
            let message = format!("{} of {id} is {ty}, this is {}", formal.name, with_article(short(value.ty)));
            self.report(value.span, &messages::ACTUAL, message);
            return None;
        }
        self.mark_written(&value);
        Some(value)
    }
}
