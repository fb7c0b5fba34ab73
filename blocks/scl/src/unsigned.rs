//! Unsigned whole numbers of TIA Portal. USINT, UINT and UDINT are declared as bit strings of their size; in a block of
//! TIA Portal bit strings are calculated with and compared as numbers without sign.

use ob1_ir::{Compare, Op, WordLogic};
use ob1_model::DataType;
use ob1_stl::front::{Constant, Span};

use crate::check::Checker;
use crate::codes;
use crate::convert::{by, explicit};
use crate::syntax::Operator;
use crate::tree::{Check, Kind, Typed};
use crate::types::{DINT, DWORD, is_bits, rank};

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
        let (left, right) = (self.number(left, operator)?, self.number(right, operator)?);
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
        operator: Operator,
        left: Typed<'c>,
        right: Typed<'c>,
        span: Span,
    ) -> Option<Typed<'c>> {
        let long = |v: &Typed<'c>| matches!(v.kind, Kind::Flexible(_)) || is_bits(v.ty);
        if widest(&left, &right) == Some(&DWORD) && long(&left) && long(&right) {
            // With the highest bit turned over they stand in the order of signed numbers.
            let sides = [left, right].map(|v| self.coerced(v, &DWORD).map(|v| by(vec![SIGN], Check::Never, v, &DINT)));
            let [Some(left), Some(right)] = sides else { return None };
            let kind = Kind::Compare(relation, Box::new(left), Box::new(right));
            return Some(Typed::new(kind, &crate::types::BOOL, span));
        }
        let (left, right) = (self.number(left, operator)?, self.number(right, operator)?);
        Some(self.binary(operator, left, right, span)).filter(|v| !v.is_bad())
    }

    /// An unsigned number as a DINT; anything else as it is.
    fn number(&mut self, value: Typed<'c>, operator: Operator) -> Option<Typed<'c>> {
        let Some(ty) = bits(&value) else { return Some(value) };
        let whole = matches!(operator, Operator::Add | Operator::Subtract | Operator::Multiply);
        if *ty == DataType::DWord && !whole {
            let message = "UDINT and DWORD have no division and no order beside signed numbers here";
            self.report_with(value.span, &codes::NOT_SUPPORTED, message, "Convert it: UDINT_TO_DINT(...).".to_owned());
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
        let values: Option<Vec<_>> = values.into_iter().map(|v| self.number(v, Operator::Less)).collect();
        Some((values?, &DINT))
    }
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
