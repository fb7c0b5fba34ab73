//! Calls: who is called, and with which actual parameters.

use std::collections::BTreeMap;

use ob1_ir::{Arg, Call, CallMode, Number, Op, Operand, Place, Target, Width};
use ob1_model::{Area, BlockId, BlockKind, DataType, Param, Section};

use crate::codes;
use crate::constant::{Constant, Encoded, PointerConstant, any_of_number};
use crate::expand::Callee;
use crate::lower::{Lowerer, called, fixed};
use crate::mnemonics::BlockWord;
use crate::operand::{Value, width_of, with_article};
use crate::parser::unquote;
use crate::reach::Reached;
use crate::reader::Reader;
use crate::syntax::{Actual, Statement};
use crate::token::{Kind, Span};
use crate::world::Info;

impl<'l> Lowerer<'l, '_> {
    /// `CALL`, `UC`, `CC`.
    pub(crate) fn call(&mut self, mode: CallMode, statement: &Statement) -> Option<Op> {
        let resolver = self.resolver;
        let mut reader = self.reader(statement.operand.clone(), statement.span);
        let span = reader.rest();
        let value = resolver.operand(&mut reader)?;
        let target = target(&mut reader, value, mode, span)?;
        let instance =
            if reader.eat(Kind::Comma).is_some() { Some(instance_number(&resolver, &mut reader)?) } else { None };
        if !reader.finish(&codes::TOO_MUCH) {
            return None;
        }
        let (Target::Block(id) | Target::Local(id, _)) = target else {
            self.no_actuals(statement, "an indirect call");
            return Some(call_op(mode, target, None, Vec::new()));
        };
        let Some(info) = resolver.world.blocks.get(&id) else {
            self.unknown_block(id, span);
            return None;
        };
        self.check_instance(mode, target, id, instance, span)?;
        if mode != CallMode::Call {
            self.no_actuals(statement, "UC and CC");
            return Some(call_op(mode, target, instance, Vec::new()));
        }
        self.around.callee = match (target, instance.and_then(fixed)) {
            (Target::Local(_, at), _) => Some(Callee::Own(at)),
            (_, Some(db)) => Some(Callee::Data(db)),
            _ => None,
        };
        let args = self.args(statement, id, info)?;
        let of_open_block = |arg: &Arg| matches!(arg, Arg::Operand(Operand { place: Place::Fixed(Area::Db, _), .. }));
        if self.around.opens_db() && args.iter().any(of_open_block) {
            let message = "another actual of this call changes the DB register, so that DBX, DBB, DBW, DBD mean another data \
                           block; write DB10.DBW 4";
            self.sink.report(self.index, span, &codes::NOT_SUPPORTED, message);
            return None;
        }
        Some(call_op(mode, target, instance, args))
    }

    fn no_actuals(&mut self, statement: &Statement, what: &str) {
        let Some(token) = statement.args.first().and_then(|a| self.file.tokens.get(a.name)).copied() else { return };
        let message = format!("{what} take no parameters");
        self.sink.report(self.index, token.span, &codes::ACTUAL_SYNTAX, message);
    }

    fn unknown_block(&mut self, id: BlockId, span: Span) {
        let message = format!("{id} is neither in the program nor in the library");
        let remedy = match id.kind {
            BlockKind::Sfc | BlockKind::Sfb => {
                format!(
                    "Name the library that has it in the station file, or with --library; {id} may also not exist here."
                )
            }
            _ => "Add its source, or load the plugin that has it, e.g. --plugin libob1_cp240.so".to_owned(),
        };
        self.sink.report_with(self.index, span, &codes::NO_BLOCK, message, remedy);
    }

    /// Holds the instance data block against the FB called; asks for it when no source declares it.
    fn check_instance(
        &mut self,
        mode: CallMode,
        target: Target,
        id: BlockId,
        instance: Option<Number>,
        span: Span,
    ) -> Option<()> {
        let needs = id.kind.has_instance() && matches!(target, Target::Block(_)) && mode == CallMode::Call;
        match instance {
            None if needs => {
                let message = format!("{id} needs an instance data block: CALL {id}, DB n");
                self.sink.report(self.index, span, &codes::INSTANCE, message);
                return None;
            }
            Some(_) if !needs => {
                let message = "only a CALL of a function block has an instance data block";
                self.sink.report(self.index, span, &codes::INSTANCE, message);
                return None;
            }
            _ => {}
        }
        let Some(db) = instance.and_then(fixed) else { return Some(()) };
        let wrong = match self.resolver.world.data.get(&db).map(|d| d.kind) {
            None => match self.wanted.get(&db) {
                None => {
                    self.wanted.insert(db, id);
                    let message = format!("DB {db} is in no source; it is made as an instance of {id}");
                    let remedy = format!("Nothing, or declare it: DATA_BLOCK DB {db} {id} BEGIN END_DATA_BLOCK");
                    self.sink.report_with(self.index, span, &codes::INSTANCE_MADE, message, remedy);
                    None
                }
                Some(other) if *other == id => None,
                Some(other) => Some(format!("DB {db} is already an instance of {other}")),
            },
            Some(ob1_ir::DataKind::Instance(other)) if other == id => None,
            Some(ob1_ir::DataKind::Instance(other)) => Some(format!("DB {db} is an instance of {other}, not of {id}")),
            Some(ob1_ir::DataKind::Global) => Some(format!("DB {db} is a global data block, not an instance of {id}")),
        };
        if let Some(message) = wrong {
            self.sink.report(self.index, span, &codes::INSTANCE, message);
            return None;
        }
        Some(())
    }

    /// The actual parameters in the order of the formals.
    fn args(&mut self, statement: &Statement, id: BlockId, info: &'l Info) -> Option<Vec<Arg>> {
        let mut given: BTreeMap<u16, &Actual> = BTreeMap::new();
        let mut good = true;
        for actual in &statement.args {
            let Some(token) = self.file.tokens.get(actual.name).copied() else { continue };
            let name = unquote(self.file.of(token));
            let Some(formal) = info.find(name).and_then(|declaration| info.formal(declaration)) else {
                let known = info.interface.formals().map(|p| p.name.as_str());
                let message = format!("{} has no parameter {name}", called(id, info));
                self.sink.report_unknown(self.index, token.span, &codes::UNKNOWN_PARAMETER, message, name, known);
                good = false;
                continue;
            };
            if given.insert(formal, actual).is_some() {
                let message = format!("{name} is supplied twice");
                self.sink.report(self.index, token.span, &codes::SUPPLIED_TWICE, message);
                good = false;
            }
        }
        let mut args = Vec::new();
        let mut missing = Vec::new();
        for (at, formal) in (0u16..).zip(info.interface.formals()) {
            self.sink.steps += 1;
            let arg = match given.get(&at) {
                Some(actual) => self.arg(id, formal, actual),
                None => Some(Arg::Open),
            };
            let must = !id.kind.has_instance();
            if arg == Some(Arg::Open) && must {
                missing.push(formal.name.as_str());
            }
            good &= arg.is_some();
            args.push(arg.unwrap_or(Arg::Open));
        }
        if !missing.is_empty() {
            let what =
                if missing.len() == 1 { "an actual parameter is missing" } else { "actual parameters are missing" };
            let message = format!("{what} in the call of {}: {}", called(id, info), missing.join(", "));
            self.sink.report(self.index, statement.span, &codes::MISSING_PARAMETER, message);
            return None;
        }
        good.then_some(args)
    }

    /// One actual parameter. `None` when it does not fit (reported); `Open` when nothing is written.
    fn arg(&mut self, id: BlockId, formal: &Param, actual: &Actual) -> Option<Arg> {
        let name_span = self.file.tokens.get(actual.name)?.span;
        let resolver = self.resolver;
        let mut reader = self.reader(actual.value.clone(), name_span);
        if reader.is_empty() {
            return Some(Arg::Open);
        }
        let span = reader.rest();
        let value = resolver.operand(&mut reader)?;
        if !reader.finish(&codes::TOO_MUCH) {
            return None;
        }
        // A pointer names the place that is written; every other constant loses what comes.
        let loses = matches!(&value, Value::Constant(c) if !matches!(c, Constant::Pointer(_)));
        if loses && writes(formal.section) {
            let message = format!("{} of {id} is written to, a constant takes nothing from it", formal.name);
            reader.report(span, &codes::CONSTANT_FOR_OUTPUT, message);
        }
        let value = match self.reached(formal, value, id.kind.has_instance(), span)? {
            Reached::Arg(arg) => return Some(arg),
            Reached::Value(value) => value,
        };
        match fit(formal, value, id.kind.has_instance()) {
            Ok(arg) => Some(arg),
            Err(Misfit::Type(described)) => {
                let message =
                    format!("{} of {id} is {}, this is {described}", formal.name, with_article(formal.ty.name()));
                self.sink.report(self.index, span, &codes::PARAMETER_TYPE, message);
                None
            }
            Err(Misfit::Constant(message)) => {
                self.sink.report(
                    self.index,
                    span,
                    &codes::CONSTANT_TYPE,
                    format!("{} of {id}: {message}", formal.name),
                );
                None
            }
        }
    }
}

fn call_op(mode: CallMode, target: Target, instance: Option<Number>, args: Vec<Arg>) -> Op {
    Op::Call(Box::new(Call { mode, target, instance, args }))
}

const fn writes(section: Section) -> bool {
    matches!(section, Section::Output | Section::InOut | Section::Return)
}

/// Who is called.
fn target(reader: &mut Reader<'_, '_>, value: Value<'_>, mode: CallMode, span: Span) -> Option<Target> {
    let wrong = match value {
        Value::Instance(fb, at) if mode == CallMode::Call => return Some(Target::Local(fb, at)),
        Value::Block(word, number) => {
            let kind = word.kind().filter(|k| !matches!(k, BlockKind::Db | BlockKind::Ob));
            match (kind, number) {
                (Some(kind), Number::Fixed(n)) => return Some(Target::Block(BlockId::new(kind, n))),
                (Some(kind @ (BlockKind::Fc | BlockKind::Fb)), number) if mode != CallMode::Call => {
                    return Some(Target::Indirect(kind, number));
                }
                (Some(_), _) => "CALL takes a block by its number; UC and CC take it indirectly".to_owned(),
                (None, _) => format!("a {} cannot be called", word.name()),
            }
        }
        Value::Instance(fb, _) => format!("an instance of {fb} is called with CALL, not with UC or CC"),
        other => format!("{} cannot be called", other.describe()),
    };
    reader.report(span, &codes::CALL_TARGET, wrong);
    None
}

/// The instance data block after the comma.
fn instance_number(resolver: &crate::operand::Resolver<'_>, reader: &mut Reader<'_, '_>) -> Option<Number> {
    let span = reader.here();
    match resolver.operand(reader)? {
        Value::Block(BlockWord::Db, number @ Number::Fixed(_)) => Some(number),
        _ => {
            reader.report(span, &codes::INSTANCE, "after the comma stands the instance data block: DB 50");
            None
        }
    }
}

/// Why an actual parameter does not fit.
enum Misfit {
    /// What it is instead.
    Type(String),
    /// What is wrong with the constant.
    Constant(String),
}

/// The actual as the formal takes it; `instance`: the callee keeps its parameters in an instance data block.
fn fit(formal: &Param, value: Value<'_>, instance: bool) -> Result<Arg, Misfit> {
    let ty = &formal.ty;
    let described = value.describe();
    let misfit = || Misfit::Type(described.clone());
    if ty.is_parameter_type() {
        return by_number(ty, value, misfit);
    }
    match value {
        Value::Constant(Constant::Pointer(p))
            if ty.is_composed() && !matches!(ty, DataType::Pointer | DataType::Any) =>
        {
            // P#DB10.DBX0.0 names the place of a structure, an array or a string.
            composed_place(p).map(Arg::Operand).ok_or_else(misfit)
        }
        Value::Constant(constant) => match constant.encode(ty).map_err(Misfit::Constant)? {
            Encoded::Bits(bits) => Ok(Arg::Const(bits)),
            Encoded::Bytes(bytes) => Ok(Arg::Bytes(bytes.into())),
        },
        Value::Memory { operand, ty: actual } => match ty {
            DataType::Pointer | DataType::Any => pointer_to(ty, operand, actual).ok_or_else(misfit),
            _ if ty.is_composed() => {
                let same = actual.is_some_and(|actual| same_layout(ty, actual));
                match same {
                    // The instance keeps a POINTER to the actual.
                    true if instance && formal.is_pointer() => {
                        pointer_to(&DataType::Pointer, operand, actual).ok_or_else(misfit)
                    }
                    true => Ok(Arg::Operand(operand)),
                    false => Err(misfit()),
                }
            }
            _ => {
                let fits = width_of(ty) == Some(operand.width) && actual.is_none_or(|a| !a.is_composed());
                if fits { Ok(Arg::Operand(operand)) } else { Err(misfit()) }
            }
        },
        Value::Timer(Number::Fixed(n)) if *ty == DataType::Any => Ok(Arg::Bytes(any_of_number(0x1D, n).into())),
        Value::Counter(Number::Fixed(n)) if *ty == DataType::Any => Ok(Arg::Bytes(any_of_number(0x1C, n).into())),
        Value::Block(word, Number::Fixed(n)) if *ty == DataType::Any => match word {
            BlockWord::Db => Ok(Arg::Bytes(any_of_number(0x19, n).into())),
            BlockWord::Fc => Ok(Arg::Bytes(any_of_number(0x18, n).into())),
            BlockWord::Fb => Ok(Arg::Bytes(any_of_number(0x17, n).into())),
            _ => Err(misfit()),
        },
        Value::Block(BlockWord::Db, Number::Fixed(db)) if *ty == DataType::Pointer => {
            let pointer = PointerConstant { area: Some(Area::Db), at: ob1_model::BitAddr(0), db, any: None };
            Ok(Arg::Bytes(pointer.pointer_bytes().into()))
        }
        _ => Err(misfit()),
    }
}

/// Timers, counters and blocks.
fn by_number(ty: &DataType, value: Value<'_>, misfit: impl Fn() -> Misfit) -> Result<Arg, Misfit> {
    match (ty, value) {
        (DataType::Timer | DataType::TimerOrWord, Value::Timer(n)) => Ok(Arg::Number(n)),
        (DataType::Counter, Value::Counter(n)) => Ok(Arg::Number(n)),
        (DataType::BlockDb, Value::Block(BlockWord::Db, n)) => Ok(Arg::Number(n)),
        (DataType::BlockFb, Value::Block(BlockWord::Fb, n)) => Ok(Arg::Number(n)),
        (DataType::BlockFc, Value::Block(BlockWord::Fc, n)) => Ok(Arg::Number(n)),
        (DataType::TimerOrWord, Value::Constant(constant)) => match constant.encode(ty) {
            Ok(Encoded::Bits(bits)) => Ok(Arg::Const(bits)),
            Ok(Encoded::Bytes(_)) => Err(misfit()),
            Err(message) => Err(Misfit::Constant(message)),
        },
        (DataType::TimerOrWord, Value::Memory { operand, .. }) if operand.width == Width::Word => {
            Ok(Arg::Operand(operand))
        }
        _ => Err(misfit()),
    }
}

/// The place that `P#DB10.DBX0.0` names.
fn composed_place(pointer: PointerConstant) -> Option<Operand> {
    let place = match (pointer.area?, pointer.db) {
        (Area::Db, db) if db > 0 => Place::InDb(db, pointer.at),
        (area, 0) => Place::Fixed(area, pointer.at),
        _ => return None,
    };
    Some(Operand { width: Width::Byte, place })
}

/// A POINTER or ANY to an operand. Own parameters of these types are handed on as they are.
fn pointer_to(ty: &DataType, operand: Operand, actual: Option<&DataType>) -> Option<Arg> {
    if actual.is_some_and(|a| a == ty) {
        return Some(Arg::Operand(operand));
    }
    let (area, at, db) = match operand.place {
        // The callee sees the caller's local data as the area V.
        Place::Fixed(Area::Local, at) => (Area::PreviousLocal, at, 0),
        Place::Fixed(area, at) => (area, at, 0),
        Place::InDb(db, at) => (Area::Db, at, db),
        _ => return None,
    };
    let pointer = PointerConstant { area: Some(area), at, db, any: Some(any_length(operand, actual)) };
    Some(Arg::Bytes(if *ty == DataType::Any { pointer.any_bytes() } else { pointer.pointer_bytes() }.into()))
}

/// Type code and number of elements of an ANY to an operand; composed variables count in bytes.
pub(crate) fn any_length(operand: Operand, actual: Option<&DataType>) -> (u8, u16) {
    use crate::constant::ANY_TYPES;
    if let Some(code) = actual
        .filter(|ty| ty.elementary_bits().is_some())
        .and_then(|ty| ANY_TYPES.iter().find(|(name, _)| *name == ty.name()))
    {
        return (code.1, 1);
    }
    if let Some(ty) = actual {
        return (2, (ob1_model::Layout::bits(ty) / 8).min(u32::from(u16::MAX)) as u16);
    }
    match operand.width {
        Width::Bit => (1, 1),
        Width::Byte => (2, 1),
        Width::Word => (4, 1),
        Width::DWord => (6, 1),
    }
}

/// True for types that mean the same bytes: names and start values do not count, the length of a STRING neither.
pub(crate) fn same_layout(a: &DataType, b: &DataType) -> bool {
    match (a, b) {
        (DataType::Struct(a), DataType::Struct(b)) => {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same_layout(&a.ty, &b.ty))
        }
        (DataType::Array(da, a), DataType::Array(db, b)) => da == db && same_layout(a, b),
        (DataType::String(_), DataType::String(_)) => true,
        _ => a == b,
    }
}
