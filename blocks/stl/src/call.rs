//! Calls: the called block and its actual parameters.

use std::collections::BTreeMap;

use ob1_ir::{Arg, Call, CallMode, Number, Op, Operand, Place, Target};
use ob1_model::{Area, BitAddr, BlockId, BlockKind, DataType, Param, Section};

use crate::constant::{Constant, PointerConstant};
use crate::diagnostic::USES;
use crate::expand::Callee;
use crate::fit::{Misfit, fit, misread};
use crate::identifiers::BlockWord;
use crate::lower::{Lowerer, fixed, peripheral_output};
use crate::messages;
use crate::operand::Resolver;
use crate::parser::unquote;
use crate::reach::Reached;
use crate::reader::Reader;
use crate::syntax::{Actual, Statement};
use crate::tia;
use crate::token::{Kind, Span, Token};
use crate::type_words::with_article;
use crate::value::Value;
use crate::world::{Info, called};

impl<'l> Lowerer<'l, '_> {
    /// The operation of `CALL`, `UC` or `CC`.
    pub(crate) fn call(&mut self, mode: CallMode, statement: &Statement) -> Option<Op> {
        let resolver = self.resolver;
        let mut reader = self.reader(statement.operand.clone(), statement.span);
        let span = reader.rest();
        let value = called_value(&resolver, &mut reader)?;
        let of_data = called_data(&resolver, &value, mode);
        let (mut target, mut instance) = match of_data {
            Some((fb, db)) => (Target::Block(fb), Some(Number::Fixed(db))),
            None => (target(&resolver, &mut reader, value, mode, span)?, None),
        };
        if of_data.is_none() && reader.eat(Kind::Comma).is_some() {
            let given = instance_of(&resolver, &mut reader)?;
            if let (Target::Block(id), Some(of)) = (target, given.made_for(&resolver)) {
                target = Target::Block(tia::called_with(id, of));
            }
            match (given, target) {
                (Instance::Data(number), _) => instance = Some(number),
                (Instance::Own(fb, at), Target::Block(id)) if fb == id || same_instance(&resolver, fb, id) => {
                    target = Target::Local(id, at);
                }
                (Instance::Within(fb, db, at), Target::Block(id)) if same_instance(&resolver, fb, id) => {
                    (target, instance) = (Target::Local(id, at), Some(Number::Fixed(db)));
                }
                (Instance::Own(fb, _) | Instance::Within(fb, ..), _) => {
                    reader.report(span, &messages::INSTANCE, format!("this is an instance of {fb}"));
                    return None;
                }
            }
        }
        if !reader.finish(&messages::TOO_MUCH) {
            return None;
        }
        let (Target::Block(id) | Target::Local(id, _)) = target else {
            self.no_actuals(statement, "an indirect call");
            let list = self.raw_list(statement, mode, target)?;
            return Some(call_op(mode, target, None, list));
        };
        let Some(info) = resolver.world.blocks.get(&id) else {
            let names = statement.args.iter().filter_map(|arg| self.file.tokens.get(arg.name));
            let given: Vec<&str> = names.map(|token| self.file.of(*token).trim_matches('"')).collect();
            resolver.world.report_missing(id, &given, self.index, span, self.sink);
            return None;
        };
        self.check_instance(mode, target, id, instance, span)?;
        if mode != CallMode::Call {
            self.no_actuals(statement, "UC and CC");
            let list = self.raw_list(statement, mode, target)?;
            return Some(call_op(mode, target, instance, list));
        }
        self.around.callee = match (target, instance.and_then(fixed)) {
            // The timers and counters that lie within a data block have no composed in/outs.
            (Target::Local(..), Some(_)) => None,
            (Target::Local(_, at), None) => Some(Callee::Own(at)),
            (_, Some(db)) => Some(Callee::Data(db)),
            _ => None,
        };
        let args = self.args(statement, id, info)?;
        let of_open_block = |arg: &Arg| matches!(arg, Arg::Operand(Operand { place: Place::Fixed(Area::Db, _), .. }));
        if self.around.opens_db() && args.iter().any(of_open_block) {
            let message = "another actual of this call changes the DB register, so that DBX, DBB, DBW, DBD mean another data \
                           block; write DB10.DBW 4";
            self.sink.report(self.index, span, &messages::NOT_SUPPORTED, message);
            return None;
        }
        Some(call_op(mode, target, instance, args))
    }

    fn no_actuals(&mut self, statement: &Statement, what: &str) {
        let Some(token) = statement.args.first().and_then(|a| self.file.tokens.get(a.name)).copied() else { return };
        let message = format!("{what} take no parameters");
        self.sink.report(self.index, token.span, &messages::ACTUAL_SYNTAX, message);
    }

    /// Checks the instance data block against the FB called; asks for it when no source declares it.
    fn check_instance(
        &mut self,
        mode: CallMode,
        target: Target,
        id: BlockId,
        instance: Option<Number>,
        span: Span,
    ) -> Option<()> {
        if mode == CallMode::Call && matches!(target, Target::Local(..)) {
            return Some(());
        }
        let needs = id.kind.has_instance() && matches!(target, Target::Block(_)) && mode == CallMode::Call;
        match instance {
            None if needs => {
                let message = format!("{id} needs an instance data block: CALL {id}, DB n");
                self.sink.report(self.index, span, &messages::INSTANCE, message);
                return None;
            }
            Some(_) if !needs => {
                let message = "only a CALL of a function block has an instance data block";
                self.sink.report(self.index, span, &messages::INSTANCE, message);
                return None;
            }
            _ => {}
        }
        let Some(db) = instance.and_then(fixed) else { return Some(()) };
        let wrong = match self.resolver.world.data.get(&db).map(|d| d.kind) {
            None => match self.wanted.get(&db) {
                None => {
                    self.wanted.insert(db, id);
                    let message = format!("DB {db} is in no source; it is created as an instance of {id}");
                    let remedy =
                        format!("Nothing has to be done; or declare it: DATA_BLOCK DB {db} {id} BEGIN END_DATA_BLOCK");
                    self.sink.report_with(self.index, span, &messages::INSTANCE_MADE, message, remedy);
                    None
                }
                Some(other) if *other == id => None,
                Some(other) => Some(format!("DB {db} is already an instance of {other}")),
            },
            Some(ob1_ir::DataKind::Instance(other)) if other == id || same_instance(&self.resolver, other, id) => None,
            Some(ob1_ir::DataKind::Instance(other)) => Some(format!("DB {db} is an instance of {other}, not of {id}")),
            Some(ob1_ir::DataKind::Global) => Some(format!("DB {db} is a global data block, not an instance of {id}")),
        };
        if let Some(message) = wrong {
            self.sink.report(self.index, span, &messages::INSTANCE, message);
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
                self.sink.report_unknown(self.index, token.span, &messages::UNKNOWN_PARAMETER, message, name, known);
                good = false;
                continue;
            };
            if given.insert(formal, actual).is_some() {
                let message = format!("{name} is supplied twice");
                self.sink.report(self.index, token.span, &messages::SUPPLIED_TWICE, message);
                good = false;
            }
        }
        let mut args = Vec::new();
        let mut missing = Vec::new();
        for (at, formal) in (0u16..).zip(info.interface.formals()) {
            self.sink.steps += 1;
            let arg = match given.get(&at) {
                Some(actual) => self.arg(id, info, formal, actual),
                None => Some(Arg::Open),
            };
            let must = !id.kind.has_instance();
            if arg == Some(Arg::Open) && must {
                missing.push(formal.name.as_str());
            }
            good &= arg.is_some();
            args.push(arg.unwrap_or(Arg::Open));
        }
        if !missing.is_empty() && !statement.broken_list {
            let what =
                if missing.len() == 1 { "an actual parameter is missing" } else { "actual parameters are missing" };
            let message = format!("{what} in the call of {}: {}", called(id, info), missing.join(", "));
            self.sink.report(self.index, statement.span, &messages::MISSING_PARAMETER, message);
        }
        (good && missing.is_empty()).then_some(args)
    }

    /// One actual parameter. `None` when it does not fit (reported); `Open` when nothing is written.
    fn arg(&mut self, id: BlockId, info: &Info, formal: &Param, actual: &Actual) -> Option<Arg> {
        let name_span = self.file.tokens.get(actual.name)?.span;
        let resolver = self.resolver;
        let mut reader = self.reader(actual.value.clone(), name_span);
        if reader.is_empty() {
            return Some(Arg::Open);
        }
        let span = reader.rest();
        let peripheral = peripheral_output(resolver, &reader).filter(|_| formal.ty.elementary_bits().is_some());
        let value = resolver.operand(&mut reader)?;
        if !reader.finish(&messages::TOO_MUCH) {
            return None;
        }
        let wrong_side = match (peripheral, formal.section) {
            (Some(false), Section::Output | Section::Return) => Some(("inputs are only read", "written", "an output")),
            (Some(true), Section::Input) => Some(("outputs are only written", "read", "an input")),
            _ => None,
        };
        if let Some((side, used, wanted)) = wrong_side {
            let message = format!("peripheral {side}, and {} of {id} is {used}", formal.name);
            let remedy = format!("Supply {wanted} of the periphery, or a memory word that the program copies.");
            reader.sink.report_with(reader.index, span, &messages::PARAMETER_TYPE, message, remedy);
            return None;
        }
        // A pointer names the place that is written; with every other constant the result is lost.
        let loses = matches!(&value, Value::Constant(c) if !matches!(c, Constant::Pointer(_)));
        if loses && writes(formal.section) {
            let message = format!("{} of {id} is written to; a constant cannot take the value", formal.name);
            reader.report(span, &messages::CONSTANT_FOR_OUTPUT, message);
        }
        let actual_type = match &value {
            Value::Memory { ty, .. } => *ty,
            Value::Through { ty, .. } | Value::Indexed { ty, .. } => Some(*ty),
            _ => None,
        };
        if actual_type.is_some_and(|ty| misread(&formal.ty, ty)) {
            let is = with_article(formal.ty.name());
            let message = format!("{} of {id} is {is}, this is {}", formal.name, value.describe());
            reader.report(span, &messages::MISREAD, message);
        }
        if let Value::Constant(Constant::Pointer(pointer)) = value {
            self.check_end(formal, pointer, span);
        }
        let value = match self.reached(formal, value, id.kind.has_instance(), span)? {
            Reached::Arg(arg) => return Some(arg),
            Reached::Value(value) => value,
        };
        if let Value::Block(BlockWord::Db, Number::Fixed(db)) = value
            && info.find(&formal.name).is_some_and(|declaration| info.db_any.contains(&declaration))
        {
            return Some(Arg::Const(u32::from(db)));
        }
        match fit(formal, value, id.kind.has_instance()) {
            Ok(arg) => Some(arg),
            Err(Misfit::Type(described)) => {
                let message =
                    format!("{} of {id} is {}, this is {described}", formal.name, with_article(formal.ty.name()));
                self.sink.report(self.index, span, &messages::PARAMETER_TYPE, message);
                None
            }
            Err(Misfit::Constant(message)) => {
                self.sink.report(
                    self.index,
                    span,
                    &messages::CONSTANT_TYPE,
                    format!("{} of {id}: {message}", formal.name),
                );
                None
            }
        }
    }
}

impl Lowerer<'_, '_> {
    /// Warns when an ANY leads beyond the end of a data block of the program.
    fn check_end(&mut self, formal: &Param, pointer: PointerConstant, span: Span) {
        if formal.ty != DataType::Any || OF_PARTNER.contains(&formal.name.as_str()) {
            return;
        }
        let (Some(data), Some(bits)) = (self.resolver.world.data.get(&pointer.db), pointer.any_bits()) else { return };
        let (len, end) = (data.image.len(), (u64::from(pointer.at.0) + bits).div_ceil(8));
        if end > len as u64 {
            let message = format!("DB {} has {len} bytes, this goes on to byte {}", pointer.db, end - 1);
            self.sink.report(self.index, span, &messages::BEYOND_DATA_BLOCK, message);
        }
    }
}

/// Parameters of GET, PUT, I_GET, I_PUT, X_GET and X_PUT that name an area of the partner.
const OF_PARTNER: [&str; 5] = ["ADDR_1", "ADDR_2", "ADDR_3", "ADDR_4", "VAR_ADDR"];

fn call_op(mode: CallMode, target: Target, instance: Option<Number>, args: Vec<Arg>) -> Op {
    Op::Call(Box::new(Call { mode, target, instance, args }))
}

const fn writes(section: Section) -> bool {
    matches!(section, Section::Output | Section::InOut | Section::Return)
}

/// What follows `CALL`: a block, an instance, or an instruction of TIA Portal by its bare name, also in a block that
/// has a variable of that name (`CALL TON, #pause`).
fn called_value<'w>(resolver: &Resolver<'w>, reader: &mut Reader<'_, '_>) -> Option<Value<'w>> {
    let Some(token) = reader.peek().filter(|token| token.kind == Kind::Word) else { return resolver.operand(reader) };
    let is_sign = |token: &Token| !matches!(token.kind, Kind::Newline | Kind::Attributes);
    let second = reader.ahead().skip(1).find(is_sign).map(|token| token.kind);
    let name = reader.text(token);
    if let Some(id) = resolver.offered(name).filter(|_| second == Some(Kind::Comma) && resolver.is_declared(name)) {
        reader.next();
        return Some(Value::Block(BlockWord::of(id.kind), Number::Fixed(id.number)));
    }
    if !matches!(second, None | Some(Kind::Comma)) {
        return resolver.operand(reader);
    }
    if let Some(id) = resolver.lacking(name) {
        resolver.world.report_missing(id, &[], reader.index, token.span, reader.sink);
        return None;
    }
    if !resolver.is_unknown(name) {
        return resolver.operand(reader);
    }
    let shown: String = name.chars().take(32).collect();
    let key = format!("CALL {}", name.to_uppercase());
    let symbols = resolver.world.symbols.keys().map(String::as_str);
    reader.sink.missing(&key, reader.index, token.span, &messages::NO_BLOCK, |sink| {
        let message = format!("{shown} is no block here: {USES}, and neither the program nor the library has it");
        let near = sink.nearest(name, symbols).map(|near| format!("Did you mean {near}?"));
        (message, near.unwrap_or_else(|| tia::instead(name).to_owned()))
    });
    None
}

/// Which block is called.
fn target(
    resolver: &Resolver<'_>,
    reader: &mut Reader<'_, '_>,
    value: Value<'_>,
    mode: CallMode,
    span: Span,
) -> Option<Target> {
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
        other if data_type(resolver, &other).is_some() => {
            "an IEC timer or counter within other data is called by its block: CALL TON, and then this".to_owned()
        }
        other => format!("{} cannot be called", other.describe()),
    };
    reader.report(span, &messages::CALL_TARGET, wrong);
    None
}

/// True for two blocks with instances of the same declarations, as the timers of IEC have them.
fn same_instance(resolver: &Resolver<'_>, one: BlockId, other: BlockId) -> bool {
    let params = |id| resolver.world.blocks.get(&id).map(|info| &info.interface.params);
    one.kind == BlockKind::Sfb && params(one) == params(other) || tia::same_instance(one, other)
}

/// `CALL "data"`: the function block that a data block is an instance of, as TIA Portal calls it.
fn called_data(resolver: &Resolver<'_>, value: &Value<'_>, mode: CallMode) -> Option<(BlockId, u16)> {
    let Value::Block(BlockWord::Db, Number::Fixed(db)) = value else { return None };
    match resolver.world.data.get(db)?.kind {
        ob1_ir::DataKind::Instance(fb) if mode == CallMode::Call => Some((fb, *db)),
        _ => None,
    }
}

/// The instance after the comma.
enum Instance {
    Data(Number),
    /// A multi-instance of this block: `CALL TON, #timer` of TIA Portal.
    Own(BlockId, BitAddr),
    /// The same within a data block: `CALL TON, "Data".timer`.
    Within(BlockId, u16, BitAddr),
}

impl Instance {
    /// The function block it is an instance of, where that is known.
    fn made_for(&self, resolver: &Resolver<'_>) -> Option<BlockId> {
        match self {
            Instance::Own(fb, _) | Instance::Within(fb, ..) => Some(*fb),
            Instance::Data(Number::Fixed(db)) => match resolver.world.data.get(db)?.kind {
                ob1_ir::DataKind::Instance(fb) => Some(fb),
                ob1_ir::DataKind::Global => None,
            },
            Instance::Data(_) => None,
        }
    }
}

/// The instance after the comma.
fn instance_of(resolver: &Resolver<'_>, reader: &mut Reader<'_, '_>) -> Option<Instance> {
    let span = reader.here();
    match resolver.operand(reader)? {
        Value::Block(BlockWord::Db, number @ Number::Fixed(_)) => Some(Instance::Data(number)),
        Value::Instance(fb, at) => Some(Instance::Own(fb, at)),
        value => match data_type(resolver, &value) {
            Some(fb) => within(reader, fb, &value, span),
            None => {
                reader.report(span, &messages::INSTANCE, "the instance data block should follow the comma: DB 50");
                None
            }
        },
    }
}

/// The block of a variable that is an IEC timer or counter of an S7-1500, in a structure, a data block, a parameter.
fn data_type(resolver: &Resolver<'_>, value: &Value<'_>) -> Option<BlockId> {
    let ty = match value {
        Value::Memory { ty: Some(ty), .. } | Value::Through { ty, .. } | Value::Indexed { ty, .. } => *ty,
        _ => return None,
    };
    let is_one = |id: &BlockId| resolver.world.blocks.get(id).is_some_and(|b| b.interface.instance_type() == *ty);
    tia::data_types().find(is_one)
}

/// Where such an instance lies. `None`: it has no address that is known when the program is loaded (reported).
fn within(reader: &mut Reader<'_, '_>, fb: BlockId, value: &Value<'_>, span: Span) -> Option<Instance> {
    let (message, remedy) = match value {
        Value::Memory { operand, .. } => match operand.place {
            Place::InDb(db, at) => return Some(Instance::Within(fb, db, at)),
            Place::Instance(at) => return Some(Instance::Own(fb, at)),
            Place::Fixed(Area::Local, _) => (
                "an instance in the local data loses its state at the end of the block",
                "Declare it in VAR of a function block, or in a data block.",
            ),
            _ => OF_PARAMETER,
        },
        Value::Indexed { .. } => (
            "an instance can be called with a fixed index only, not with one that is known at run time",
            "Write one call for each element.",
        ),
        _ => OF_PARAMETER,
    };
    reader.sink.report_with(reader.index, span, &messages::NOT_SUPPORTED, message, remedy);
    None
}

/// What is said of an instance that the caller supplies.
const OF_PARAMETER: (&str, &str) = (
    "an instance that is a parameter has no address here: the caller supplies it",
    "Call the timer or counter where its instance is declared, in VAR or a data block, and hand over Q, ET or CV.",
);
