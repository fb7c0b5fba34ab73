//! Actual parameters that have no fixed address: instance data for POINTER and ANY, and what the POINTER of a function
//! block's composed in/out leads to.

use ob1_ir::compose::{self, Pointee, any_length};
use ob1_ir::{Arg, Op, Operand, Place, Width};
use ob1_model::{Area, BitAddr, DataType, Param, Section};

use crate::expand;
use crate::fit::same_layout;
use crate::lower::Lowerer;
use crate::messages;
use crate::token::Span;
use crate::type_words::with_article;
use crate::value::Term;
use crate::value::Value;

/// The result for an actual.
pub(crate) enum Reached<'w> {
    /// It is ready to be passed.
    Arg(Arg),
    /// It is an actual like any other.
    Value(Value<'w>),
}

fn hidden_operand(width: Width, byte: u32, bit: u8) -> Arg {
    Arg::Operand(Operand { width, place: Place::Fixed(Area::Local, BitAddr::new(byte, bit)) })
}

impl Lowerer<'_, '_> {
    /// Makes ready an actual that must be reached at run time; `instance`: the callee keeps its parameters in an
    /// instance. `None` when it cannot be reached (reported).
    pub(crate) fn reached<'w>(
        &mut self,
        formal: &Param,
        value: Value<'w>,
        instance: bool,
        span: Span,
    ) -> Option<Reached<'w>> {
        let by_pointer = instance && formal.is_pointer();
        let typed = matches!(formal.ty, DataType::Pointer | DataType::Any);
        let to = match &value {
            Value::Through { pointer, operand, ty, .. } => {
                if !typed && !by_pointer {
                    return self.through(formal, *pointer, *operand, ty, span).map(Reached::Arg);
                }
                let Place::Register(_, _, offset) = operand.place else { return Some(Reached::Value(value)) };
                Pointee::Through(*pointer, offset)
            }
            Value::Indexed { operand, through, terms, ty } => {
                return self.indexed(formal, *operand, *through, terms, ty, span).map(Reached::Arg);
            }
            Value::Memory { operand: Operand { place, .. }, ty } if typed || by_pointer => {
                // A POINTER or ANY of the caller's own is passed on as it is.
                if typed && ty.is_some_and(|ty| *ty == formal.ty) {
                    return Some(Reached::Value(value));
                }
                match place {
                    Place::Instance(at) => Pointee::Instance(*at),
                    Place::Param { .. } => {
                        let message = "the address of a parameter of a function is known only at run time; it cannot be \
                                       supplied to a POINTER, an ANY or a composed in/out";
                        let remedy = "Copy it into a temp and supply that, or declare the parameter as ANY or \
                                      POINTER, which are handed on.";
                        self.sink.report_with(self.index, span, &messages::PARAMETER_TYPE, message, remedy);
                        return None;
                    }
                    _ => return Some(Reached::Value(value)),
                }
            }
            _ => return Some(Reached::Value(value)),
        };
        let (operand, ty) = match &value {
            Value::Through { operand, ty, .. } => (*operand, Some(*ty)),
            Value::Memory { operand, ty } => (*operand, *ty),
            _ => return Some(Reached::Value(value)),
        };
        if by_pointer && !typed && !ty.is_some_and(|ty| same_layout(&formal.ty, ty)) {
            let message =
                format!("{} is {}, this is {}", formal.name, with_article(formal.ty.name()), value.describe());
            self.sink.report(self.index, span, &messages::PARAMETER_TYPE, message);
            return None;
        }
        if let (true, Some(callee)) = (by_pointer && !typed, self.around.callee) {
            // The parameter itself stays open: its POINTER is written before the call.
            let place = |width, byte: u32| callee.operand(width, BitAddr(formal.at.0 + byte * 8));
            compose::pointer(&place, to, None, &mut self.around.before);
            return Some(Reached::Arg(Arg::Open));
        }
        let any = (formal.ty == DataType::Any).then(|| any_length(operand, ty));
        let start = self.hidden.take(if any.is_some() { 10 } else { 6 });
        let place = |width, byte| compose::local(width, start + byte);
        compose::pointer(&place, to, any, &mut self.around.before);
        Some(Reached::Arg(hidden_operand(Width::Byte, start, 0)))
    }

    fn of_other_type(&mut self, formal: &Param, ty: &DataType, span: Span) -> Option<Arg> {
        let message =
            format!("{} is {}, this is {}", formal.name, with_article(formal.ty.name()), with_article(ty.name()));
        self.sink.report(self.index, span, &messages::PARAMETER_TYPE, message);
        None
    }

    /// An element whose index is known at run time only, for a formal that takes its value: by way of the local data.
    fn indexed(
        &mut self,
        formal: &Param,
        operand: Operand,
        through: Option<BitAddr>,
        terms: &[Term],
        ty: &DataType,
        span: Span,
    ) -> Option<Arg> {
        if ty.is_composed() || formal.ty.is_composed() || operand.width == Width::Bit {
            let message = "an element with an index known at run time is supplied as value only: copy it into a temp, and \
                           a bit with U and =";
            self.sink.report(self.index, span, &messages::NOT_SUPPORTED, message);
            return None;
        }
        if Width::of(&formal.ty) != Some(operand.width) {
            return self.of_other_type(formal, ty, span);
        }
        let hidden_at = self.hidden.take(operand.width.bytes());
        let here = compose::local(operand.width, hidden_at);
        let mut move_it = |out: bool, ops: &mut Vec<Op>| {
            let element = expand::index(&mut self.hidden, operand, through, terms, ops);
            ops.push(Op::Load(if out { here } else { element.operand }));
            ops.push(Op::Transfer(if out { element.operand } else { here }));
            ops.extend(element.restore);
        };
        if !matches!(formal.section, Section::Output | Section::Return) {
            move_it(false, &mut self.around.before);
        }
        if matches!(formal.section, Section::Output | Section::InOut | Section::Return) {
            move_it(true, &mut self.around.after);
        }
        Some(hidden_operand(operand.width, hidden_at, 0))
    }

    /// What a POINTER leads to, for a formal that takes the value itself or a reference to it.
    fn through(
        &mut self,
        formal: &Param,
        pointer: BitAddr,
        operand: Operand,
        ty: &DataType,
        span: Span,
    ) -> Option<Arg> {
        let Place::Register(_, _, offset) = operand.place else { return None };
        let refuse = |this: &mut Self, message: &str| {
            this.sink.report(this.index, span, &messages::NOT_SUPPORTED, message);
            None
        };
        if ty.is_composed() && same_layout(&formal.ty, ty) {
            // By reference through AR1, which one actual of a call can have.
            if self.around.reached.replace(pointer).is_some_and(|other| other != pointer) {
                return refuse(
                    self,
                    "one call passes on two complex in/out parameters; only one of them can be accessed at a time",
                );
            }
            return Some(Arg::Operand(operand));
        }
        if ty.is_composed() || Width::of(&formal.ty) != Some(operand.width) {
            return self.of_other_type(formal, ty, span);
        }
        let written = matches!(formal.section, Section::Output | Section::InOut | Section::Return);
        if written && operand.width == Width::Bit {
            return refuse(
                self,
                "a bit of a complex in/out parameter cannot be supplied to a parameter that the block writes",
            );
        }
        let byte = self.hidden.take(operand.width.bytes());
        if formal.section != Section::Output && formal.section != Section::Return {
            expand::move_through(pointer, operand, byte, false, &mut self.around.before);
        }
        if written {
            expand::move_through(pointer, operand, byte, true, &mut self.around.after);
        }
        let bit = if operand.width == Width::Bit { offset.bit() } else { 0 };
        Some(hidden_operand(operand.width, byte, bit))
    }
}
