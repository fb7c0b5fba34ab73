//! Expressions: the type of each, and the conversions that it needs.

use ob1_ir::{AccuOp, Compare, Convert, Logic, MathFn, Op};
use ob1_model::{DataType, Section};
use ob1_stl::front::{Constant, Encoded, Span, with_article};

use crate::check::Checker;
use crate::convert::{by, explicit, function, implicit};
use crate::messages;
use crate::syntax::{Expr, ExprKind, Operator};
use crate::tree::{Check, Kind, Typed, Var};
use crate::types::{
    BOOL, BYTE, DATE, DINT, DWORD, INT, NOTHING, REAL, STRING, TIME, TOD, WORD, is_bits, is_number, is_whole, rank,
    short,
};

impl<'c> Checker<'c> {
    /// An expression as it is. A mistake gives `Kind::Bad`, reported.
    pub(crate) fn expr(&mut self, expr: &Expr) -> Typed<'c> {
        match &expr.kind {
            ExprKind::Bad => self.bad(expr.span),
            ExprKind::Constant(_) | ExprKind::Tokens(_) => match self.constant(expr) {
                Some(constant) => flexible(constant, expr.span),
                None => self.bad(expr.span),
            },
            ExprKind::Ref(reference) => {
                let value = self.reference(reference);
                if *value.ty == NOTHING && !value.is_bad() {
                    self.report(expr.span, &messages::NO_RESULT, "this block gives no value");
                    return self.bad(expr.span);
                }
                if let Kind::Call(call) = &value.kind
                    && call.actuals.iter().any(|actual| actual.formal.section == Section::Return)
                {
                    let message =
                        "the result is supplied among the parameters, and is the value here: leave it out there";
                    self.report(expr.span, &messages::UNKNOWN_PARAMETER, message);
                    return self.bad(expr.span);
                }
                self.mark_read(&value);
                let name = self.text(reference.first);
                let absolute =
                    matches!(value.kind, Kind::Timer(_) | Kind::Counter(_) | Kind::Var(Var { declared: None, .. }));
                if absolute && self.info.declared(name).is_some() && !self.declared_plainly(name) {
                    let message = format!("{name} is the address here, not the variable #{name}");
                    self.report(reference.first.span, &messages::LOOKS_LIKE_ADDRESS, message);
                }
                value
            }
            ExprKind::Not(inner) => self.not(inner, expr.span),
            ExprKind::Negate(inner) => self.negate(inner, expr.span),
            ExprKind::Binary(operator, left, right) => {
                let (left, right) = (self.expr(left), self.expr(right));
                if left.is_bad() || right.is_bad() {
                    return self.bad(expr.span);
                }
                self.binary(*operator, left, right, expr.span)
            }
        }
    }

    /// An expression as a value of a type.
    pub(crate) fn expr_as(&mut self, expr: &Expr, to: &'c DataType) -> Option<Typed<'c>> {
        self.expr(expr).good().and_then(|value| self.coerced(value, to))
    }

    /// A value as one of a wider type of its class. `None`: reported.
    pub(crate) fn coerced(&mut self, value: Typed<'c>, to: &'c DataType) -> Option<Typed<'c>> {
        let span = value.span;
        if let Some(shifted) = reshifted(&value, to) {
            return Some(shifted);
        }
        if let Kind::Flexible(constant) = &value.kind {
            match fitted(constant, to, span) {
                Ok(value) => return Some(value),
                Err(message) => {
                    let code = if is_number(to) || is_bits(to) { &messages::CONSTANT_RANGE } else { &messages::TYPES };
                    self.report(span, code, message);
                    return None;
                }
            }
        }
        match implicit(value, to) {
            Ok(value) => Some(value),
            Err(value) if self.options.tia && crate::unsigned::loses_nothing(value.ty, to) => explicit(value, to),
            Err(value) => {
                self.no_conversion(value.ty, to, span);
                None
            }
        }
    }

    pub(crate) fn no_conversion(&mut self, from: &DataType, to: &DataType, span: Span) {
        let message = format!("{} is needed here, this is {}", with_article(short(to)), with_article(short(from)));
        match function(from, to) {
            Some(name) => self.report_with(span, &messages::TYPES, message, format!("Write {name}(...).")),
            None => self.report(span, &messages::TYPES, message),
        }
    }

    fn not(&mut self, inner: &Expr, span: Span) -> Typed<'c> {
        let value = self.expr(inner);
        if value.is_bad() {
            return value;
        }
        let value = match &value.kind {
            Kind::Flexible(constant) => match constant {
                Constant::Bool(_) => self.coerced(value, &BOOL),
                _ => {
                    let ty = Self::own_type(constant);
                    let ty = if is_bits(ty) { ty } else { &DWORD };
                    self.coerced(value, ty)
                }
            },
            _ => Some(value),
        };
        let Some(value) = value else { return self.bad(span) };
        let ty = value.ty;
        match ty {
            DataType::Bool => Typed::new(Kind::Not(Box::new(value)), &BOOL, span),
            DataType::DWord | DataType::Word | DataType::Byte => inverted(value),
            _ => {
                let message = format!("NOT takes a BOOL or a bit string, this is {}", with_article(short(ty)));
                self.report(span, &messages::OPERANDS, message);
                self.bad(span)
            }
        }
    }

    fn negate(&mut self, inner: &Expr, span: Span) -> Typed<'c> {
        let value = self.expr(inner);
        if value.is_bad() {
            return value;
        }
        if let Kind::Flexible(constant) = &value.kind {
            let zero = Constant::Integer(0);
            let negated = match constant {
                Constant::Real(value) => Some(Constant::Real(-value)),
                _ => ob1_stl::fold_constants("-", &zero, constant),
            };
            if let Some(constant) = negated {
                return flexible(constant, span);
            }
        }
        let ty = value.ty;
        let op = match ty {
            DataType::Int => Convert::Negi,
            DataType::DInt | DataType::Time => Convert::Negd,
            DataType::Real => Convert::Negr,
            _ => {
                let message = format!("- takes a number, this is {}", with_article(short(ty)));
                self.report(span, &messages::OPERANDS, message);
                return self.bad(span);
            }
        };
        let check = if *ty == DataType::Real { Check::Never } else { Check::Overflow };
        Typed { span, ..by(vec![Op::Convert(op)], check, value, ty) }
    }

    pub(crate) fn binary(&mut self, operator: Operator, left: Typed<'c>, right: Typed<'c>, span: Span) -> Typed<'c> {
        let result = match operator {
            Operator::Logic(logic) => self.logic(logic, left, right, span),
            Operator::Compare(relation) => self.compare(relation, left, right, span),
            Operator::Power => self.power(left, right, span),
            Operator::Arithmetic(op) => self.arithmetic(operator, op, left, right, span),
            Operator::Div => self.arithmetic(operator, AccuOp::Div, left, right, span),
        };
        result.unwrap_or_else(|| self.bad(span))
    }

    fn refuse(&mut self, operator: Operator, left: &Typed<'c>, right: &Typed<'c>, span: Span) -> Option<Typed<'c>> {
        let (a, b) = (with_article(short(left.ty)), with_article(short(right.ty)));
        let message = format!("{} does not take {a} and {b}", operator.name());
        let remedy = function(right.ty, left.ty).or_else(|| function(left.ty, right.ty));
        match remedy.filter(|_| left.ty != right.ty) {
            Some(name) => {
                self.report_with(span, &messages::OPERANDS, message, format!("Convert one of them: {name}(...)."));
            }
            None => self.report(span, &messages::OPERANDS, message),
        }
        None
    }

    fn logic(&mut self, logic: Logic, left: Typed<'c>, right: Typed<'c>, span: Span) -> Option<Typed<'c>> {
        let (left, right) = self.adapted(left, right)?;
        if *left.ty == DataType::Bool || *right.ty == DataType::Bool {
            if *left.ty != *right.ty {
                let ty = if *left.ty == DataType::Bool { right.ty } else { left.ty };
                if !is_bits(ty) {
                    return self.refuse(Operator::Logic(logic), &left, &right, span);
                }
                let (left, right) = (self.coerced(left, ty)?, self.coerced(right, ty)?);
                return Some(Typed::new(Kind::Bits(logic, Box::new(left), Box::new(right)), ty, span));
            }
            // A chain of one operator is one node.
            let mut all = match left.kind {
                Kind::Logic(inner, list) if inner == logic => list,
                kind => vec![Typed { kind, ..left }],
            };
            all.push(right);
            return Some(Typed::new(Kind::Logic(logic, all), &BOOL, span));
        }
        if !is_bits(left.ty) || !is_bits(right.ty) {
            return self.refuse(Operator::Logic(logic), &left, &right, span);
        }
        let ty = if rank(left.ty) >= rank(right.ty) { left.ty } else { right.ty };
        let (left, right) = (self.coerced(left, ty)?, self.coerced(right, ty)?);
        Some(Typed::new(Kind::Bits(logic, Box::new(left), Box::new(right)), ty, span))
    }

    /// Both sides, a constant in the type of the other side; two constants in their own.
    pub(crate) fn adapted(&mut self, left: Typed<'c>, right: Typed<'c>) -> Option<(Typed<'c>, Typed<'c>)> {
        match (&left.kind, &right.kind) {
            (Kind::Flexible(a), Kind::Flexible(b)) => {
                let (a, b) = (Self::own_type(a), Self::own_type(b));
                let ty = if rank(a) >= rank(b) { a } else { b };
                let (a, b) = if is_number(a) == is_number(b) { (ty, ty) } else { (a, b) };
                Some((self.coerced(left, a)?, self.coerced(right, b)?))
            }
            (Kind::Flexible(constant), _) => {
                let ty = beside(constant, right.ty);
                Some((self.coerced(left, ty)?, right))
            }
            (_, _) if reshifted(&right, left.ty).is_some() => reshifted(&right, left.ty).map(|right| (left, right)),
            (_, _) if reshifted(&left, right.ty).is_some() => reshifted(&left, right.ty).map(|left| (left, right)),
            (_, Kind::Flexible(constant)) => {
                let ty = beside(constant, left.ty);
                let right = self.coerced(right, ty)?;
                Some((left, right))
            }
            _ => Some((left, right)),
        }
    }

    fn compare(&mut self, relation: Compare, left: Typed<'c>, right: Typed<'c>, span: Span) -> Option<Typed<'c>> {
        let equality = matches!(relation, Compare::Equal | Compare::NotEqual);
        let mixed = is_number(left.ty) || is_number(right.ty);
        if self.is_unsigned(&left, &right) && (!equality || mixed) {
            return self.compare_unsigned(relation, left, right, span);
        }
        let (left, right) = self.adapted(left, right)?;
        let is_string = |ty: &DataType| matches!(ty, DataType::String(_));
        let is_text = |ty: &DataType| is_string(ty) || *ty == DataType::Char;
        if (is_string(left.ty) || is_string(right.ty)) && is_text(left.ty) && is_text(right.ty) {
            return self.library(&format!("{}_STRNG", word(relation)), vec![left, right], span);
        }
        if *left.ty == DataType::DateAndTime && *right.ty == DataType::DateAndTime {
            return self.library(&format!("{}_DT", word(relation)), vec![left, right], span);
        }
        if *left.ty == DataType::Bool && *right.ty == DataType::Bool && equality {
            let unequal = Typed::new(Kind::Logic(Logic::Xor, vec![left, right]), &BOOL, span);
            return Some(match relation {
                Compare::NotEqual => unequal,
                _ => Typed::new(Kind::Not(Box::new(unequal)), &BOOL, span),
            });
        }
        let common: &'static DataType = match (left.ty, right.ty) {
            (a, b) if is_number(a) && is_number(b) => wider(a, b),
            (a, b) if is_bits(a) && is_bits(b) && equality => wider(a, b),
            // Shorter than the numbers they are compared as.
            (DataType::Byte, DataType::Byte) => &BYTE,
            (DataType::Char, DataType::Char) => &crate::types::CHAR,
            (DataType::Time, DataType::Time) => &TIME,
            (DataType::TimeOfDay, DataType::TimeOfDay) => &TOD,
            (DataType::Date, DataType::Date) => &DATE,
            (DataType::S5Time, DataType::S5Time) if equality => &crate::types::S5TIME,
            (DataType::BlockDb, DataType::BlockDb) if equality => &crate::types::BLOCK_DB,
            _ => return self.refuse(Operator::Compare(relation), &left, &right, span),
        };
        if *common == DataType::Real && equality {
            self.report(span, &messages::REAL_EQUAL, "real numbers are compared for equality");
        }
        let (left, right) = (self.coerced(left, common)?, self.coerced(right, common)?);
        Some(Typed::new(Kind::Compare(relation, Box::new(left), Box::new(right)), &BOOL, span))
    }

    fn power(&mut self, left: Typed<'c>, right: Typed<'c>, span: Span) -> Option<Typed<'c>> {
        let (left, right) = (self.coerced(left, &REAL)?, self.coerced(right, &REAL)?);
        // Siemens' compiler does these two without a logarithm.
        match right.kind {
            Kind::Constant(one) if one == 1f32.to_bits() => return Some(Typed { span, ..left }),
            Kind::Constant(two) if two == 2f32.to_bits() => return self.math(MathFn::Sqr, left),
            _ => {}
        }
        Some(Typed::new(Kind::Power(Box::new(left), Box::new(right)), &REAL, span))
    }

    fn arithmetic(
        &mut self,
        operator: Operator,
        op: AccuOp,
        left: Typed<'c>,
        right: Typed<'c>,
        span: Span,
    ) -> Option<Typed<'c>> {
        if let (Kind::Flexible(a), Kind::Flexible(b)) = (&left.kind, &right.kind)
            && let Some(constant) = ob1_stl::fold_constants(operator.name(), a, b)
        {
            return Some(flexible(constant, span));
        }
        let zero = matches!(&right.kind, Kind::Flexible(Constant::Integer(0) | Constant::DInt(0)));
        if matches!(op, AccuOp::Div | AccuOp::Mod) && zero {
            self.report(right.span, &messages::DIVISION_BY_ZERO, "this divides by 0");
        }
        if let Some(result) = self.time_arithmetic(op, &left, &right, span) {
            return result;
        }
        if self.is_unsigned(&left, &right) {
            return self.unsigned(operator, left, right, span);
        }
        let (left, right) = self.adapted(left, right)?;
        if !is_number(left.ty) || !is_number(right.ty) {
            return self.refuse(operator, &left, &right, span);
        }
        let ty: &'static DataType = wider(left.ty, right.ty);
        if (op == AccuOp::Mod || operator == Operator::Div) && !is_whole(ty) {
            return self.refuse(operator, &left, &right, span);
        }
        let (left, right) = (self.coerced(left, ty)?, self.coerced(right, ty)?);
        if let Some(product) = one_factor(op, &left, &right, span) {
            return Some(product);
        }
        if op == AccuOp::Mod && *ty == DataType::Int {
            let (left, right) = (self.coerced(left, &DINT)?, self.coerced(right, &DINT)?);
            return Some(Typed::new(Kind::Arithmetic(op, Box::new(left), Box::new(right)), &INT, span));
        }
        Some(Typed::new(Kind::Arithmetic(op, Box::new(left), Box::new(right)), ty, span))
    }

    /// Sums, differences and multiples of times and dates; `None` where no side is one.
    fn time_arithmetic(
        &mut self,
        op: AccuOp,
        left: &Typed<'c>,
        right: &Typed<'c>,
        span: Span,
    ) -> Option<Option<Typed<'c>>> {
        use DataType::{Date, DateAndTime, Time, TimeOfDay};
        let node = |op, ty: &'static DataType, left: Typed<'c>, right: Typed<'c>| {
            Typed::new(Kind::Arithmetic(op, Box::new(left), Box::new(right)), ty, span)
        };
        let (a, b) = (left.ty, right.ty);
        // Both sides in their types.
        let mut both = |a, b| self.coerced(left.clone(), a).zip(self.coerced(right.clone(), b));
        let result = match (a, op, b) {
            (Time, AccuOp::Add | AccuOp::Sub, Time) => both(&TIME, &TIME).map(|(l, r)| node(op, &TIME, l, r)),
            (Time, AccuOp::Add | AccuOp::Sub, DataType::DInt) | (Time, AccuOp::Mul | AccuOp::Div, _)
                if is_whole(b) || matches!(right.kind, Kind::Flexible(_)) =>
            {
                both(&TIME, &DINT).map(|(l, r)| node(op, &TIME, l, r))
            }
            (_, AccuOp::Mul, Time) if is_whole(a) => both(&DINT, &TIME).map(|(l, r)| node(op, &TIME, l, r)),
            (TimeOfDay, AccuOp::Add | AccuOp::Sub, Time) => {
                both(&TOD, &TIME).map(|(l, r)| Typed::new(Kind::WithinDay(op, Box::new(l), Box::new(r)), &TOD, span))
            }
            (TimeOfDay, AccuOp::Sub, TimeOfDay) => both(&TOD, &TOD).map(|(l, r)| node(op, &TIME, l, r)),
            (Date, AccuOp::Sub, Date) => both(&DATE, &DATE).and_then(|(l, r)| {
                let days = node(op, &DINT, explicit(l, &DINT)?, explicit(r, &DINT)?);
                let day = Typed::new(Kind::Constant(86_400_000), &DINT, span);
                Some(node(AccuOp::Mul, &TIME, days, day))
            }),
            (DateAndTime, AccuOp::Add, Time) => self.library("AD_DT_TM", vec![left.clone(), right.clone()], span),
            (DateAndTime, AccuOp::Sub, Time) => self.library("SB_DT_TM", vec![left.clone(), right.clone()], span),
            (DateAndTime, AccuOp::Sub, DateAndTime) => {
                self.library("SB_DT_DT", vec![left.clone(), right.clone()], span)
            }
            _ => return None,
        };
        Some(result)
    }

    /// A function of ACCU1 as a REAL.
    pub(crate) fn math(&mut self, function: MathFn, value: Typed<'c>) -> Option<Typed<'c>> {
        let value = self.coerced(value, &REAL)?;
        Some(by(vec![Op::Math(function)], Check::Overflow, value, &REAL))
    }
}

/// The word of a comparison in the name of a block of the library.
const fn word(relation: Compare) -> &'static str {
    match relation {
        Compare::Equal => "EQ",
        Compare::NotEqual => "NE",
        Compare::Greater => "GT",
        Compare::Less => "LT",
        Compare::GreaterEqual => "GE",
        Compare::LessEqual => "LE",
    }
}

/// The wider of two types of a class.
pub(crate) const fn wider(a: &DataType, b: &DataType) -> &'static DataType {
    let ty = if rank(a) >= rank(b) { a } else { b };
    match ty {
        DataType::Int => &INT,
        DataType::DInt => &DINT,
        DataType::Byte => &BYTE,
        DataType::Word => &WORD,
        DataType::DWord => &DWORD,
        _ => &REAL,
    }
}

/// The type that a constant takes beside a value of another type: that one where it fits, else its own.
fn beside<'c>(constant: &Constant, other: &'c DataType) -> &'c DataType {
    let own: &'static DataType = Checker::own_type(constant);
    if let (Constant::Text(_), DataType::Char | DataType::String(_)) = (constant, other) {
        return if matches!(other, DataType::String(_)) || *own != DataType::Char { &STRING } else { other };
    }
    let whole = matches!(constant, Constant::Integer(_) | Constant::Radix(_) | Constant::DInt(_) | Constant::Bits(..));
    match other {
        // A longer number stays what it is: the other side is widened.
        DataType::Int if whole && fitted(constant, other, Span::default()).is_err() => own,
        DataType::Int | DataType::DInt if matches!(constant, Constant::Real(_)) => own,
        DataType::Byte | DataType::Word if whole && fitted(constant, other, Span::default()).is_err() => {
            if is_bits(own) { own } else { &DWORD }
        }
        _ => other,
    }
}

/// A constant whose type its place decides.
pub(crate) fn flexible<'c>(constant: Constant, span: Span) -> Typed<'c> {
    let ty = Checker::own_type(&constant);
    Typed::new(Kind::Flexible(constant), ty, span)
}

/// Siemens' compiler calculates with the real constants of a product: `x * 2.0 * 3.0` is `x * 6.0`, `1 / x * 1000` is
/// `1000 / x`, and `c * x * y / 360.0` is `c / 360.0 * y * x`.
fn one_factor<'c>(op: AccuOp, left: &Typed<'c>, right: &Typed<'c>, span: Span) -> Option<Typed<'c>> {
    let Kind::Constant(second) = right.kind else { return None };
    if !matches!(op, AccuOp::Mul | AccuOp::Div) || *left.ty != DataType::Real || *right.ty != DataType::Real {
        return None;
    }
    let node = |op, a: Typed<'c>, b: Typed<'c>| Typed::new(Kind::Arithmetic(op, Box::new(a), Box::new(b)), &REAL, span);
    // A factor with what it is a factor of.
    let parts = |value: &Typed<'c>| match &value.kind {
        Kind::Arithmetic(inner @ (AccuOp::Mul | AccuOp::Div), a, b) => match (&a.kind, &b.kind) {
            (Kind::Constant(factor), _) => Some((*factor, *inner, (**b).clone())),
            (_, Kind::Constant(factor)) if *inner == AccuOp::Mul => Some((*factor, *inner, (**a).clone())),
            _ => None,
        },
        _ => None,
    };
    let folded = |first: u32| {
        let (a, b) = (f64::from(f32::from_bits(first)), f64::from(f32::from_bits(second)));
        let factor = if op == AccuOp::Mul { a * b } else { a / b };
        Typed::new(Kind::Constant((factor as f32).to_bits()), &REAL, right.span)
    };
    if let Some((factor, inner, value)) = parts(left) {
        return Some(node(inner, folded(factor), value));
    }
    let Kind::Arithmetic(AccuOp::Mul, inner, last) = &left.kind else { return None };
    let (factor, AccuOp::Mul, value) = parts(inner)? else { return None };
    Some(node(AccuOp::Mul, node(AccuOp::Mul, folded(factor), (**last).clone()), value))
}

/// NOT of a bit string.
fn inverted(value: Typed<'_>) -> Typed<'_> {
    let ty = value.ty;
    let mut ops = vec![Op::Convert(if *ty == DataType::DWord { Convert::Invd } else { Convert::Invi })];
    if *ty == DataType::Byte {
        ops.push(Op::WordLogic(ob1_ir::WordLogic::And, Some(0xFF)));
    }
    by(ops, Check::Never, value, ty)
}

/// The shift of a constant without a type of its own, in the type its place wants.
fn reshifted<'c>(value: &Typed<'c>, to: &'c DataType) -> Option<Typed<'c>> {
    if let Kind::Convert(ops, _, inner) = &value.kind
        && matches!(ops.first(), Some(Op::Convert(Convert::Invi | Convert::Invd)))
    {
        return reshifted(inner, to).map(inverted);
    }
    let Kind::Shift(shifted, inner, count) = &value.kind else { return None };
    let Kind::Flexible(constant) = &inner.kind else { return None };
    let inner = fitted(constant, to, inner.span).ok().filter(|_| is_bits(to))?;
    Some(Typed::new(Kind::Shift(*shifted, Box::new(inner), count.clone()), to, value.span))
}

/// A constant as a value of a type; the error says why it is none.
pub(crate) fn fitted<'c>(constant: &Constant, to: &'c DataType, span: Span) -> Result<Typed<'c>, String> {
    let number = |value: f32| Ok(Typed::new(Kind::Constant(value.to_bits()), to, span));
    match (constant, to) {
        (Constant::Integer(v), DataType::Real) => return number(*v as f32),
        (Constant::DInt(v), DataType::Real) => return number(*v as f32),
        (Constant::Radix(v), DataType::Real) => return number(*v as f32),
        (Constant::Text(text), DataType::String(_)) => {
            let length = text.len().min(254);
            let mut bytes = vec![length.max(1) as u8, length as u8];
            bytes.extend(text.iter().take(length));
            bytes.resize((length.max(1) + 2).next_multiple_of(2), 0);
            return Ok(Typed::new(Kind::Bytes(bytes), to, span));
        }
        (Constant::Radix(v), DataType::DInt) => return Ok(Typed::new(Kind::Constant(*v), to, span)),
        (Constant::Bits(v, _), DataType::Byte) if *v <= 0xFF => return Ok(Typed::new(Kind::Constant(*v), to, span)),
        (Constant::Bits(v, _), DataType::Word) if *v <= 0xFFFF => return Ok(Typed::new(Kind::Constant(*v), to, span)),
        _ => {}
    }
    match constant.encode(to)? {
        Encoded::Bits(bits) => Ok(Typed::new(Kind::Constant(bits), to, span)),
        Encoded::Bytes(bytes) => Ok(Typed::new(Kind::Bytes(bytes), to, span)),
    }
}
