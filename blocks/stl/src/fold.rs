//! Expressions of constants, as SCL has them in declarations: `N - 1`, `2 * PI`.

use std::collections::BTreeMap;

use crate::constant::Constant;
use crate::messages;
use crate::operand::Resolver;
use crate::parser::unquote;
use crate::reader::Reader;
use crate::token::{Kind, Span};

/// Brackets within each other.
const DEPTH: u32 = 32;

type Names = BTreeMap<String, Constant>;

/// `term + term - term`. `None`: reported.
pub(crate) fn sum(resolver: &Resolver<'_>, names: &Names, reader: &mut Reader<'_, '_>, depth: u32) -> Option<Constant> {
    let span = reader.here();
    let mut value = product(resolver, names, reader, depth)?;
    while let Some(operator) = operator(reader, &["+", "-"]) {
        let right = product(resolver, names, reader, depth)?;
        value = combined(reader, span, operator, &value, &right)?;
    }
    Some(value)
}

fn product(resolver: &Resolver<'_>, names: &Names, reader: &mut Reader<'_, '_>, depth: u32) -> Option<Constant> {
    let span = reader.here();
    let mut value = single(resolver, names, reader, depth)?;
    while let Some(operator) = operator(reader, &["*", "/", "DIV", "MOD", "**"]) {
        let right = single(resolver, names, reader, depth)?;
        value = combined(reader, span, operator, &value, &right)?;
    }
    Some(value)
}

fn operator(reader: &mut Reader<'_, '_>, known: &[&'static str]) -> Option<&'static str> {
    let token = reader.peek().filter(|t| matches!(t.kind, Kind::Operator | Kind::Word))?;
    let found = *known.iter().find(|text| text.eq_ignore_ascii_case(reader.text(token)))?;
    reader.next();
    Some(found)
}

fn single(resolver: &Resolver<'_>, names: &Names, reader: &mut Reader<'_, '_>, depth: u32) -> Option<Constant> {
    let span = reader.here();
    let next = reader.peek_second();
    let negated = reader.peek().is_some_and(|t| t.kind == Kind::Operator && reader.text(t) == "-")
        && next.is_some_and(|t| matches!(t.kind, Kind::Word | Kind::Local | Kind::LeftParen));
    if negated {
        reader.next();
        let value = single(resolver, names, reader, depth)?;
        return combined(reader, span, "-", &Constant::Integer(0), &value);
    }
    if depth < DEPTH && reader.eat(Kind::LeftParen).is_some() {
        let value = sum(resolver, names, reader, depth + 1)?;
        reader.eat(Kind::RightParen);
        return Some(value);
    }
    let name = reader.peek().filter(|t| matches!(t.kind, Kind::Word | Kind::Local | Kind::Symbol));
    if let Some(token) = name
        && let Some(constant) = names.get(&unquote(reader.text(token)).to_uppercase())
    {
        reader.next();
        return Some(constant.clone());
    }
    resolver.single_constant(reader)
}

fn combined(
    reader: &mut Reader<'_, '_>,
    span: Span,
    operator: &str,
    left: &Constant,
    right: &Constant,
) -> Option<Constant> {
    let result = apply(operator, left, right);
    if result.is_none() {
        reader.report(span, &messages::CONSTANT, format!("{operator} gives no constant here"));
    }
    result
}

/// Whole numbers stay whole; with a real number everything is real.
pub fn apply(operator: &str, left: &Constant, right: &Constant) -> Option<Constant> {
    let real = |constant: &Constant| match constant {
        Constant::Real(value) => Some(f64::from(*value)),
        Constant::Integer(value) => Some(*value as f64),
        _ => None,
    };
    if let (Constant::Integer(a), Constant::Integer(b)) = (left, right) {
        let value = match operator {
            "+" => a.checked_add(*b),
            "-" => a.checked_sub(*b),
            "*" => a.checked_mul(*b),
            "/" | "DIV" => a.checked_div(*b),
            "MOD" => a.checked_rem(*b),
            _ => u32::try_from(*b).ok().and_then(|b| a.checked_pow(b)),
        };
        return value.map(Constant::Integer);
    }
    if let (Constant::Time(a), Constant::Time(b)) = (left, right) {
        return if operator == "+" { a.checked_add(*b) } else { a.checked_sub(*b) }.map(Constant::Time);
    }
    if let (Constant::Integer(0), "-", Constant::Time(b)) = (left, operator, right) {
        return b.checked_neg().map(Constant::Time);
    }
    if let (Some(a), Some(b)) = (left.whole(), right.whole())
        && !matches!((left, right), (Constant::Real(_), _) | (_, Constant::Real(_)))
    {
        return apply(operator, &Constant::Integer(i64::from(a)), &Constant::Integer(i64::from(b)));
    }
    let (a, b) = (real(left)?, real(right)?);
    let value = match operator {
        "+" => a + b,
        "-" => a - b,
        "*" => a * b,
        "/" => a / b,
        "**" => a.powf(b),
        _ => return None,
    };
    Some(Constant::Real(value as f32))
}
