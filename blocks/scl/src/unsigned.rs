//! Unsigned whole numbers of TIA Portal. USINT, UINT and UDINT are declared as bit strings of their size; in a block of
//! TIA Portal bit strings are calculated with and compared as numbers without sign.

use ob1_ir::{AccuOp, Compare, Op, WordLogic};
use ob1_model::DataType;
use ob1_stl::front::{Constant, Span};

use crate::check::Checker;
use crate::convert::{by, explicit};
use crate::messages;
use crate::syntax::Operator;
use crate::tree::{Check, Kind, Typed, Unsigned};
use crate::types::{DINT, DWORD, REAL, is_bits, rank};

const SIGN: Op = Op::DWordLogic(WordLogic::Xor, Some(0x8000_0000));

/// The type of a bit string that is no constant.
const fn bits<'c>(value: &Typed<'c>) -> Option<&'c DataType> {
    if is_bits(value.ty) && !matches!(value.kind, Kind::Flexible(_)) { Some(value.ty) } else { None }
}

impl<'c> Checker<'c> {
    /// True where one side is an unsigned number.
    pub(crate) const fn is_unsigned(&self, left: &Typed<'c>, right: &Typed<'c>) -> bool {
        self.options.tia && (bits(left).is_some() || bits(right).is_some())
    }

    /// `left operator right` of unsigned numbers: calculated as DINT. The result is of the wider type, beside a signed
    /// number or REAL it is of that class.
    pub(crate) fn unsigned(
        &mut self,
        operator: Operator,
        left: Typed<'c>,
        right: Typed<'c>,
        span: Span,
    ) -> Option<Typed<'c>> {
        let signed = |v: &Typed<'c>| match &v.kind {
            Kind::Flexible(constant) => matches!(constant, Constant::Real(_) | Constant::Time(_)),
            _ => !is_bits(v.ty),
        };
        let back = (!signed(&left) && !signed(&right)).then(|| widest(&left, &right)).flatten();
        let division = match operator {
            Operator::Arithmetic(AccuOp::Div) | Operator::Div => Some(Unsigned::Divide),
            Operator::Arithmetic(AccuOp::Mod) => Some(Unsigned::Mod),
            _ => None,
        };
        if let (Some(division), Some(DataType::DWord)) = (division, back) {
            let (left, right) = (self.long(left)?, self.long(right)?);
            return Some(Typed::new(Kind::Unsigned(division, vec![left, right]), &DWORD, span));
        }
        let (left, right) = self.numbers(left, right, operator)?;
        let result = self.binary(operator, left, right, span);
        match back {
            _ if result.is_bad() => None,
            Some(ty) => explicit(result, ty),
            None => Some(result),
        }
    }

    /// A comparison of unsigned numbers.
    pub(crate) fn compare_unsigned(
        &mut self,
        relation: Compare,
        left: Typed<'c>,
        right: Typed<'c>,
        span: Span,
    ) -> Option<Typed<'c>> {
        let long = |v: &Typed<'c>| matches!(v.kind, Kind::Flexible(_)) || is_bits(v.ty);
        if widest(&left, &right) == Some(&DWORD) && long(&left) && long(&right) {
            let (left, right) = (turned(self.long(left)?, &DINT), turned(self.long(right)?, &DINT));
            let kind = Kind::Compare(relation, Box::new(left), Box::new(right));
            return Some(Typed::new(kind, &crate::types::BOOL, span));
        }
        let operator = Operator::Compare(relation);
        let (left, right) = self.numbers(left, right, operator)?;
        self.binary(operator, left, right, span).good()
    }

    /// An unsigned number, or a constant, as a UDINT.
    fn long(&mut self, value: Typed<'c>) -> Option<Typed<'c>> {
        match &value.kind {
            Kind::Flexible(Constant::Integer(whole)) => match u32::try_from(*whole) {
                Ok(whole) => Some(Typed { kind: Kind::Constant(whole), ty: &DWORD, ..value }),
                Err(_) => self.coerced(value, &DWORD),
            },
            _ => self.coerced(value, &DWORD),
        }
    }

    /// Both sides as signed numbers: beside a REAL a UDINT is one.
    fn numbers(&mut self, left: Typed<'c>, right: Typed<'c>, operator: Operator) -> Option<(Typed<'c>, Typed<'c>)> {
        let real = |v: &Typed<'c>| *v.ty == DataType::Real;
        let beside_real = real(&left) || real(&right);
        Some((self.number(left, operator, beside_real)?, self.number(right, operator, beside_real)?))
    }

    /// An unsigned number as a DINT or REAL; anything else as it is.
    fn number(&mut self, value: Typed<'c>, operator: Operator, beside_real: bool) -> Option<Typed<'c>> {
        let Some(ty) = bits(&value) else { return Some(value) };
        if *ty == DataType::DWord && beside_real {
            return Some(as_real(value));
        }
        let whole = matches!(operator, Operator::Arithmetic(AccuOp::Add | AccuOp::Sub | AccuOp::Mul));
        if *ty == DataType::DWord && !whole {
            let message = "UDINT and DWORD are not divided by signed numbers, and not compared with them";
            self.report_with(
                value.span,
                &messages::NOT_SUPPORTED,
                message,
                "Convert it: UDINT_TO_DINT(...).".to_owned(),
            );
            return None;
        }
        explicit(value, &DINT)
    }

    /// Values that are ordered: unsigned ones as DINT, and the type that the result goes back to.
    pub(crate) fn ordered(
        &mut self,
        values: Vec<Typed<'c>>,
        ty: &'c DataType,
    ) -> Option<(Vec<Typed<'c>>, &'c DataType)> {
        if !self.options.tia || !is_bits(ty) {
            return Some((values, ty));
        }
        let as_number = |v: Typed<'c>| if *ty == DataType::DWord { Some(turned(v, &DINT)) } else { explicit(v, &DINT) };
        let values: Option<Vec<_>> = values.into_iter().map(as_number).collect();
        Some((values?, &DINT))
    }

    /// A result of such values in their type.
    pub(crate) fn back(&self, value: Typed<'c>, ty: &'c DataType) -> Option<Typed<'c>> {
        match ty {
            _ if value.ty == ty => Some(value),
            DataType::DWord => Some(turned(value, ty)),
            _ => explicit(value, ty),
        }
    }
}

/// With the highest bit turned over unsigned numbers stand in the order of signed ones.
fn turned<'c>(value: Typed<'c>, ty: &'c DataType) -> Typed<'c> {
    by(vec![SIGN], Check::Never, value, ty)
}

/// The value of a UDINT as a REAL.
pub(crate) fn as_real(value: Typed<'_>) -> Typed<'_> {
    let span = value.span;
    Typed::new(Kind::Unsigned(Unsigned::ToReal, vec![value]), &REAL, span)
}

fn widest<'c>(left: &Typed<'c>, right: &Typed<'c>) -> Option<&'c DataType> {
    let all = [bits(left), bits(right)];
    all.into_iter().flatten().max_by_key(|ty| rank(ty))
}

/// What loses nothing is implicit in TIA Portal: its attribute IEC check is off by default.
pub(crate) const fn loses_nothing(from: &DataType, to: &DataType) -> bool {
    use DataType::{Byte, Char, DInt, DWord, Int, Time, Word};
    matches!(
        (from, to),
        (Byte, Int | DInt | Char)
            | (Word, Int | DInt)
            | (Int, Word)
            | (DWord, DInt)
            | (DInt, DWord)
            | (Char, Byte | Word)
            | (Time, DInt | DWord)
            | (DInt | DWord, Time)
    )
}
