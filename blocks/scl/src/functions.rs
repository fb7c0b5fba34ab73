//! Standard functions: those that are no blocks.

use ob1_ir::{AccuOp, Compare, Convert, MathFn, Op};
use ob1_model::DataType;
use ob1_stl::front::{Constant, OF_FUNCTIONS, Span, Token, with_article};

use crate::check::Checker;
use crate::convert::{by, explicit};
use crate::expr::wider;
use crate::messages;
use crate::syntax::{Arg, Expr, Operator};
use crate::tree::{Check, Kind, Shifted, Typed, Unsigned};
use crate::types::{self, BLOCK_DB, BOOL, DINT, DWORD, INT, REAL, WORD, is_bits, is_number, is_whole, rank, short};

/// LN(10), as Siemens' compiler divides by it.
const LN_10: f32 = std::f32::consts::LN_10;

/// The type that `NAME_TYPE` says, and the place of the call.
type Wanted = (Option<&'static DataType>, Span);

/// Whether `NAME_TYPE` is a function: what gives a REAL gives no other type, what rounds gives numbers.
fn is_result(plain: &str, ty: &DataType) -> bool {
    match plain {
        "ROUND" | "TRUNC" | "CEIL" | "FLOOR" | "ABS" | "SCALE_X" => is_number(ty) || is_bits(ty),
        "SHL" | "SHR" | "ROL" | "ROR" | "SWAP" => is_bits(ty),
        "SEL" | "MUX" | "MIN" | "MAX" | "LIMIT" => ty.elementary_bits().is_some(),
        _ => *ty == DataType::Real,
    }
}

/// Whether a standard function has this name.
pub(crate) fn is_standard(name: &str) -> bool {
    let is = |known: &str| known.eq_ignore_ascii_case(name);
    MathFn::ALL.iter().any(|known| is(known.name())) || NAMES.iter().any(|known| is(known))
}

impl<'c> Checker<'c> {
    /// A call of what is neither declared nor a symbol: a standard function, or a block of the library.
    pub(crate) fn function(&mut self, name: Token, args: &[Arg], span: Span) -> Typed<'c> {
        let text = self.name(name);
        let upper = text.to_ascii_uppercase();
        let result = match self.standard(&upper, args, span) {
            Some(result) => result,
            None => self.by_name(text, name.span, args, span),
        };
        result.unwrap_or_else(|| self.bad(span))
    }

    /// A block of the library, or nothing that is known.
    fn by_name(&mut self, name: &str, at: Span, args: &[Arg], span: Span) -> Option<Typed<'c>> {
        let usual = OF_FUNCTIONS.iter().find(|(function, _)| function.eq_ignore_ascii_case(name)).map_or(name, |f| f.1);
        if let Some(id) = self.block_called(usual) {
            return match self.call_block(id, args, span)? {
                crate::names::Named::Value(value) => Some(value),
                _ => None,
            };
        }
        let shown: String = name.chars().take(64).collect();
        let key = format!("{shown}(");
        let symbols = self.world.symbols.keys().map(String::as_str);
        let known = MathFn::ALL.map(MathFn::name).into_iter().chain(NAMES);
        self.sink.missing(&key, self.block.file, at, &messages::UNKNOWN_NAME, |sink| {
            let message = format!("{shown} is called, and no block or function has this name");
            let near = sink.nearest(name, known.chain(symbols)).map(|near| format!("Did you mean {near}?"));
            (message, near.unwrap_or_else(|| messages::UNKNOWN_NAME.remedy.to_owned()))
        });
        None
    }

    /// A standard function by its name in capitals; `None`: there is none of this name.
    fn standard(&mut self, name: &str, args: &[Arg], span: Span) -> Option<Option<Typed<'c>>> {
        let other = self.peek(name, args, span).or_else(|| self.timed(name, args, span));
        if let Some(result) = other.or_else(|| self.dated(name, args, span)) {
            return Some(result);
        }
        // `NAME_TYPE` of TIA Portal says the type of the result.
        let (plain, ty) = match name.rsplit_once('_') {
            Some((plain, ty)) if is_standard(plain) => match types::named(ty) {
                Some(ty) if is_result(plain, ty) => (plain, Some(ty)),
                _ => (name, None),
            },
            _ => (name, None),
        };
        if MathFn::ALL.iter().any(|known| known.name() == plain) || OF_ONE_VALUE.contains(&plain) {
            let [value] = self.values(plain, ["IN"], args, span)?;
            return Some(self.of_one_value(plain, value, ty, span));
        }
        let result = match plain {
            "NORM_X" => {
                let [min, value, max] = self.values(plain, ["MIN", "VALUE", "MAX"], args, span)?;
                let all = [min, value, max].map(|v| v.good().and_then(|v| self.coerced(v, &REAL)));
                let [Some(min), Some(value), Some(max)] = all else { return Some(None) };
                let above = self.binary(Operator::Arithmetic(AccuOp::Sub), value, min.clone(), span);
                let range = self.binary(Operator::Arithmetic(AccuOp::Sub), max, min, span);
                Some(self.binary(Operator::Arithmetic(AccuOp::Div), above, range, span))
            }
            "SCALE_X" => {
                let [min, value, max] = self.values(plain, ["MIN", "VALUE", "MAX"], args, span)?;
                self.scaled(min, value, max, ty, span)
            }
            "SEL" => {
                let [g, zero, one] = self.values(plain, ["G", "IN0", "IN1"], args, span)?;
                self.selected(g, zero, one, (ty, span))
            }
            "MUX" => self.mux(args, (ty, span)),
            "MIN" => self.extreme(Compare::LessEqual, args, (ty, span)),
            "MAX" => self.extreme(Compare::GreaterEqual, args, (ty, span)),
            "LIMIT" => {
                let [low, value, high] = self.values(plain, ["MN", "IN", "MX"], args, span)?;
                let common = self.common(vec![low, value, high], (ty, span));
                common.and_then(|(all, ty)| {
                    let (all, by) = self.ordered(all, ty)?;
                    let all: [Typed<'c>; 3] = all.try_into().ok()?;
                    self.back(Typed::new(Kind::Limit(Box::new(all)), by, span), ty)
                })
            }
            "SHL" => self.shift(Shifted::Left, args, span, ty),
            "SHR" => self.shift(Shifted::Right, args, span, ty),
            "ROL" => self.shift(Shifted::RotateLeft, args, span, ty),
            "ROR" => self.shift(Shifted::RotateRight, args, span, ty),
            "LOWER_BOUND" | "UPPER_BOUND" => self.bound_of(plain, args, span),
            "BCD_TO_INT" | "WORD_BCD_TO_INT" => self.bcd(Convert::Bti, args, &WORD, &INT, span),
            "INT_TO_BCD" | "INT_TO_BCD_WORD" => self.bcd(Convert::Itb, args, &INT, &WORD, span),
            "BCD_TO_DINT" | "DWORD_BCD_TO_DINT" => self.bcd(Convert::Btd, args, &DWORD, &DINT, span),
            "DINT_TO_BCD" | "DINT_TO_BCD_DWORD" => self.bcd(Convert::Dtb, args, &DINT, &DWORD, span),
            _ => return self.conversion(name, args, span),
        };
        Some(result)
    }

    /// A function of [`OF_ONE_VALUE`], or of [`MathFn`].
    fn of_one_value(
        &mut self,
        name: &str,
        value: Typed<'c>,
        ty: Option<&'static DataType>,
        span: Span,
    ) -> Option<Typed<'c>> {
        let as_it_is = |value, ty| Typed::new(Kind::Convert(Vec::new(), Check::Never, Box::new(value)), ty, span);
        match (name, value.ty) {
            ("LOG", _) => {
                let ln = self.math(MathFn::Ln, value)?;
                let ten = Typed::new(Kind::Constant(LN_10.to_bits()), &REAL, span);
                self.binary(Operator::Arithmetic(AccuOp::Div), ln, ten, span).good()
            }
            ("EXPD", _) => {
                let ten = Typed::new(Kind::Constant(10f32.to_bits()), &REAL, span);
                self.binary(Operator::Power, ten, value, span).good()
            }
            ("ABS", _) => self.abs(value, ty, span),
            ("ROUND" | "TRUNC" | "CEIL" | "FLOOR", _) => self.rounded(name, value, ty),
            ("FRAC", _) => {
                let whole = self.rounded("TRUNC", value.clone(), None)?;
                Some(self.binary(Operator::Arithmetic(AccuOp::Sub), value, whole, span))
            }
            ("SWAP", _) => self.swapped(value),
            ("MAX_LEN", DataType::String(max)) => Some(Typed::new(Kind::Constant(u32::from(*max)), &INT, span)),
            ("MAX_LEN", _) => self.wrong(name, &value, "a STRING"),
            // A CHAR is taken wherever a STRING is.
            ("CHAR_TO_STRING", _) => value.good().and_then(|value| self.coerced(value, &types::CHAR)),
            ("WORD_TO_BLOCK_DB", _) => self.coerced(value, &WORD).map(|value| as_it_is(value, &BLOCK_DB)),
            ("BLOCK_DB_TO_WORD", DataType::BlockDb) => Some(as_it_is(value, &WORD)),
            ("BLOCK_DB_TO_WORD", _) => self.wrong(name, &value, "a BLOCK_DB"),
            _ => self.math(MathFn::ALL.into_iter().find(|known| known.name() == name)?, value),
        }
    }

    /// `X_TO_Y` of elementary types.
    fn conversion(&mut self, name: &str, args: &[Arg], span: Span) -> Option<Option<Typed<'c>>> {
        let (from, to) = name.split_once("_TO_")?;
        // Those that are blocks.
        if OF_FUNCTIONS.iter().any(|(function, _)| *function == name) {
            return None;
        }
        // The bits of a REAL are those of a DWORD; of a UDINT the value is meant.
        let of_udint = match (from, to) {
            ("UDINT", "REAL") => Some(Unsigned::ToReal),
            ("REAL", "UDINT") => Some(Unsigned::OfReal),
            _ => None,
        };
        let (from, to) = (types::named(from)?, types::named(to)?);
        let text = |ty: &DataType| matches!(ty, DataType::String(_));
        if text(from) && *to == DataType::Char {
            return None;
        }
        let elementary = from.elementary_bits().is_some() && to.elementary_bits().is_some();
        if !elementary {
            return None;
        }
        let [Arg { value: Some(value), .. }] = args else {
            self.report(span, &messages::FUNCTION_ARGUMENTS, format!("{name} takes one value"));
            return Some(None);
        };
        let Some(value) = self.expr_as(value, from) else { return Some(None) };
        if let Some(operation) = of_udint {
            return Some(Some(Typed::new(Kind::Unsigned(operation, vec![value]), to, span)));
        }
        match explicit(value, to) {
            Some(value) => Some(Some(Typed { span, ..value })),
            None => {
                self.report(span, &messages::UNKNOWN_NAME, format!("there is no conversion {name}"));
                Some(None)
            }
        }
    }

    /// The parameters of a function, by name or in their order. `None`: reported.
    pub(crate) fn arguments<'a, const N: usize>(
        &mut self,
        function: &str,
        names: [&str; N],
        args: &'a [Arg],
        span: Span,
    ) -> Option<[&'a Expr; N]> {
        let mut out: [Option<&'a Expr>; N] = [None; N];
        let mut good = args.len() == N;
        for (at, arg) in args.iter().enumerate() {
            let place = match arg.name {
                Some(name) => names.iter().position(|n| n.eq_ignore_ascii_case(self.name(name))),
                None => Some(at),
            };
            match place.and_then(|at| out.get_mut(at)) {
                Some(slot @ None) => *slot = arg.value.as_ref(),
                _ => good = false,
            }
        }
        if !good || out.iter().any(Option::is_none) {
            let message =
                format!("{function} is called {function}({})", names.map(|n| format!("{n} := ...")).join(", "));
            self.report(span, &messages::FUNCTION_ARGUMENTS, message);
            return None;
        }
        let mut all = out.into_iter().flatten();
        let first = all.next()?;
        let mut rest = [first; N];
        rest.iter_mut().skip(1).zip(all).for_each(|(slot, expr)| *slot = expr);
        Some(rest)
    }

    /// Their values. A mistake is reported, and the function stays known.
    pub(crate) fn values<const N: usize>(
        &mut self,
        function: &str,
        names: [&str; N],
        args: &[Arg],
        span: Span,
    ) -> Option<[Typed<'c>; N]> {
        let Some(all) = self.arguments(function, names, args, span) else {
            return Some(std::array::from_fn(|_| self.bad(span)));
        };
        Some(all.map(|value| self.expr(value)))
    }

    /// The values of a function that takes any number of them, without names or with any.
    fn list(&mut self, function: &str, least: usize, args: &[Arg], span: Span) -> Option<Vec<Typed<'c>>> {
        let values: Option<Vec<Typed<'c>>> = args.iter().map(|arg| Some(self.expr(arg.value.as_ref()?))).collect();
        match values.filter(|values| values.len() >= least) {
            Some(values) if values.iter().any(Typed::is_bad) => None,
            Some(values) => Some(values),
            None => {
                let how = if function == "MUX" { "K := ..., IN0 := ..., IN1 := ..." } else { "IN1 := ..., IN2 := ..." };
                self.report(span, &messages::FUNCTION_ARGUMENTS, format!("{function} is called {function}({how})"));
                None
            }
        }
    }

    pub(crate) fn wrong(&mut self, function: &str, value: &Typed<'c>, takes: &str) -> Option<Typed<'c>> {
        if !value.is_bad() {
            let message = format!("{function} takes {takes}, this is {}", with_article(short(value.ty)));
            self.report(value.span, &messages::OPERANDS, message);
        }
        None
    }

    fn abs(&mut self, value: Typed<'c>, ty: Option<&'static DataType>, span: Span) -> Option<Typed<'c>> {
        let value = self.plain(value)?;
        let value = match ty {
            Some(ty) => self.coerced(value, ty)?,
            None => value,
        };
        let ty = value.ty;
        match ty {
            DataType::Real => Some(by(vec![Op::Convert(Convert::Abs)], Check::Never, value, ty)),
            DataType::Int | DataType::DInt | DataType::Time => Some(Typed::new(Kind::Abs(Box::new(value)), ty, span)),
            _ => self.wrong("ABS", &value, "a number"),
        }
    }

    /// A constant in its own type; anything else as it is.
    fn plain(&mut self, value: Typed<'c>) -> Option<Typed<'c>> {
        match &value.kind {
            Kind::Bad => None,
            Kind::Flexible(constant) => {
                let ty = Self::own_type(constant);
                self.coerced(value, ty)
            }
            _ => Some(value),
        }
    }

    fn rounded(&mut self, name: &str, value: Typed<'c>, ty: Option<&'static DataType>) -> Option<Typed<'c>> {
        let value = self.coerced(value.good()?, &REAL)?;
        let op = match name {
            "ROUND" => Convert::Rnd,
            "TRUNC" => Convert::Trunc,
            "CEIL" => Convert::RndPlus,
            _ => Convert::RndMinus,
        };
        let whole = by(vec![Op::Convert(op)], Check::Overflow, value, &DINT);
        match ty {
            Some(DataType::Real) => self.coerced(whole, &REAL),
            Some(ty) => explicit(whole, ty),
            None => Some(whole),
        }
    }

    fn scaled(
        &mut self,
        min: Typed<'c>,
        value: Typed<'c>,
        max: Typed<'c>,
        ty: Option<&'static DataType>,
        span: Span,
    ) -> Option<Typed<'c>> {
        let ty = ty.or_else(|| is_whole(min.ty).then(|| wider(min.ty, max.ty)));
        let all = [min, value, max].map(|v| v.good().and_then(|v| self.coerced(v, &REAL)));
        let [Some(min), Some(value), Some(max)] = all else { return None };
        let range = self.binary(Operator::Arithmetic(AccuOp::Sub), max, min.clone(), span);
        let above = self.binary(Operator::Arithmetic(AccuOp::Mul), value, range, span);
        let sum = self.binary(Operator::Arithmetic(AccuOp::Add), above, min, span);
        match ty {
            Some(ty) => explicit(sum, ty),
            None => Some(sum),
        }
    }

    fn selected(&mut self, g: Typed<'c>, zero: Typed<'c>, one: Typed<'c>, at: Wanted) -> Option<Typed<'c>> {
        let g = self.coerced(g.good()?, &BOOL)?;
        let (all, ty) = self.common(vec![zero, one], at)?;
        let [zero, one]: [Typed<'c>; 2] = all.try_into().ok()?;
        Some(Typed::new(Kind::Select(Box::new([g, zero, one])), ty, at.1))
    }

    fn mux(&mut self, args: &[Arg], at: Wanted) -> Option<Typed<'c>> {
        let mut values = self.list("MUX", 3, args, at.1)?;
        let k = values.remove(0);
        let k = self.coerced(k, &INT)?;
        let (all, ty) = self.common(values, at)?;
        Some(Typed::new(Kind::Mux(Box::new(k), all), ty, at.1))
    }

    fn extreme(&mut self, relation: Compare, args: &[Arg], at: Wanted) -> Option<Typed<'c>> {
        let values = self.list(if relation == Compare::LessEqual { "MIN" } else { "MAX" }, 2, args, at.1)?;
        let (all, ty) = self.common(values, at)?;
        let (all, by) = self.ordered(all, ty)?;
        self.back(Typed::new(Kind::Extreme(relation, all), by, at.1), ty)
    }

    /// Values in one type that takes all of them.
    fn common(&mut self, values: Vec<Typed<'c>>, (wanted, span): Wanted) -> Option<(Vec<Typed<'c>>, &'c DataType)> {
        if values.iter().any(Typed::is_bad) {
            return None;
        }
        if let Some(ty) = wanted {
            let all: Option<Vec<Typed<'c>>> = values.into_iter().map(|value| self.coerced(value, ty)).collect();
            return Some((all?, ty));
        }
        let fixed: Vec<&'c DataType> =
            values.iter().filter(|v| !matches!(v.kind, Kind::Flexible(_))).map(|v| v.ty).collect();
        let types: Vec<&'c DataType> = if fixed.is_empty() { values.iter().map(|v| v.ty).collect() } else { fixed };
        let mut ty: &'c DataType = types.first()?;
        for other in types {
            let classes = is_number(ty) && is_number(other) || is_bits(ty) && is_bits(other);
            if classes && rank(other) > rank(ty) {
                ty = other;
            }
        }
        // A real constant makes all of them real.
        let real = values.iter().any(|v| matches!(&v.kind, Kind::Flexible(ob1_stl::front::Constant::Real(_))));
        if real && is_whole(ty) {
            ty = &REAL;
        }
        if ty.elementary_bits().is_none() && !matches!(ty, DataType::String(_) | DataType::DateAndTime) {
            self.report(span, &messages::OPERANDS, format!("this does not take {}", with_article(short(ty))));
            return None;
        }
        if ty.elementary_bits().is_none() {
            let message = format!("{} cannot be chosen by a function", with_article(short(ty)));
            self.report_with(span, &messages::NOT_SUPPORTED, message, "Write IF ... THEN ... ELSE.".to_owned());
            return None;
        }
        let all: Option<Vec<Typed<'c>>> = values.into_iter().map(|value| self.coerced(value, ty)).collect();
        Some((all?, ty))
    }

    fn shift(
        &mut self,
        shifted: Shifted,
        args: &[Arg],
        span: Span,
        ty: Option<&'static DataType>,
    ) -> Option<Typed<'c>> {
        let [value, count] = self.values("SHL, SHR, ROL, ROR", ["IN", "N"], args, span)?;
        let (value, count) = (value.good()?, count.good()?);
        let value = match (ty, &value.kind) {
            (Some(ty), _) => self.coerced(value, ty)?,
            (None, Kind::Flexible(constant)) => {
                let own = Self::own_type(constant);
                let ty = if is_bits(own) {
                    own
                } else if *own == DataType::Int {
                    &WORD
                } else {
                    &DWORD
                };
                // Its place may want another type.
                if matches!(constant, Constant::Radix(_) | Constant::Integer(_)) {
                    Typed { ty, ..value }
                } else {
                    self.coerced(value, ty)?
                }
            }
            _ => value,
        };
        if !is_bits(value.ty) {
            return self.wrong("a shift", &value, "a bit string");
        }
        let count = match count.ty {
            DataType::Byte | DataType::Word => explicit(count, &INT)?,
            _ => self.coerced(count, &INT)?,
        };
        let ty = value.ty;
        Some(Typed::new(Kind::Shift(shifted, Box::new(value), Box::new(count)), ty, span))
    }

    /// `LOWER_BOUND(ARR := a, DIM := 1)`: known, since no array comes with bounds of its own.
    fn bound_of(&mut self, function: &str, args: &[Arg], span: Span) -> Option<Typed<'c>> {
        let [array, dimension] = self.values(function, ["ARR", "DIM"], args, span)?;
        let (array, dimension) = (array.good()?, dimension.good()?);
        let DataType::Array(dims, _) = array.ty else { return self.wrong(function, &array, "an array") };
        let at = match &dimension.kind {
            Kind::Flexible(constant) => Self::whole(constant).and_then(|n| usize::try_from(n - 1).ok()),
            _ => None,
        };
        let Some(dim) = at.and_then(|at| dims.get(at)) else {
            let message = format!("DIM of {function} is a constant, 1 to {}", dims.len());
            self.report(dimension.span, &messages::FUNCTION_ARGUMENTS, message);
            return None;
        };
        let bound = if function == "LOWER_BOUND" { dim.low } else { dim.high };
        Some(Typed::new(Kind::Flexible(Constant::Integer(i64::from(bound))), &DINT, span))
    }

    fn swapped(&mut self, value: Typed<'c>) -> Option<Typed<'c>> {
        let value = self.plain(value)?;
        let ty = value.ty;
        match ty {
            DataType::Word => Some(by(vec![Op::Convert(Convert::Taw)], Check::Never, value, ty)),
            DataType::DWord => Some(by(vec![Op::Convert(Convert::Tad)], Check::Never, value, ty)),
            _ => self.wrong("SWAP", &value, "a WORD or DWORD"),
        }
    }

    fn bcd(
        &mut self,
        op: Convert,
        args: &[Arg],
        from: &'static DataType,
        to: &'static DataType,
        span: Span,
    ) -> Option<Typed<'c>> {
        let [value] = self.values("a BCD conversion", ["IN"], args, span)?;
        let value = self.coerced(value.good()?, from)?;
        Some(by(vec![Op::Convert(op)], Check::Overflow, value, to))
    }
}

/// Functions of one value besides those of [`MathFn`].
#[rustfmt::skip]
const OF_ONE_VALUE: [&str; 13] = [
    "LOG", "EXPD", "ABS", "ROUND", "TRUNC", "CEIL", "FLOOR", "FRAC", "SWAP", "MAX_LEN", "CHAR_TO_STRING",
    "WORD_TO_BLOCK_DB", "BLOCK_DB_TO_WORD",
];

/// Functions besides those of [`MathFn`] and the conversions.
#[rustfmt::skip]
const NAMES: [&str; 23] = [
    "LOG", "EXPD", "ABS", "ROUND", "TRUNC", "CEIL", "FLOOR", "FRAC", "NORM_X", "SCALE_X",
    "SEL", "MUX", "MIN", "MAX", "LIMIT",
    "SHL", "SHR", "ROL", "ROR", "SWAP",
    "MAX_LEN", "BCD_TO_INT", "INT_TO_BCD",
];
