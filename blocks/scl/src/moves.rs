//! MOVE_BLK and FILL_BLK of TIA Portal: elements of one array after the other.

use ob1_ir::{AccuOp, Compare, Jump, NumberFormat, Op, Operand, Place};
use ob1_model::{DataType, Layout};
use ob1_stl::front::{Span, same_layout, with_article};

use crate::check::Checker;
use crate::code::Code;
use crate::emit_copy::in_local;
use crate::messages;
use crate::names::Named;
use crate::syntax::{Arg, Expr, ExprKind, Ref, Step};
use crate::tree::{Kind, Term, Typed, Var};
use crate::types::{DINT, short};

/// Elements of an array of one dimension.
pub(crate) struct Elements<'w> {
    /// The array.
    array: Var<'w>,
    ty: &'w DataType,
    /// How many lie in front of the first that is meant: a DINT.
    first: Typed<'w>,
    length: i32,
}

/// What MOVE_BLK or FILL_BLK does.
pub(crate) struct Moved<'w> {
    from: Taken<'w>,
    count: Typed<'w>,
    to: Elements<'w>,
}

enum Taken<'w> {
    Elements(Elements<'w>),
    Value(Typed<'w>),
}

impl<'c> Checker<'c> {
    /// `MOVE_BLK(IN := a[0], COUNT := n, OUT => b[2])`, `FILL_BLK(IN := value, ...)`. The outer `None`: another name.
    pub(crate) fn moved(&mut self, name: &str, args: &[Arg], span: Span) -> Option<Option<Moved<'c>>> {
        let function = ["MOVE_BLK", "UMOVE_BLK", "FILL_BLK", "UFILL_BLK"];
        let function = function.into_iter().find(|known| known.eq_ignore_ascii_case(name))?;
        Some(self.moved_by(function, args, span))
    }

    fn moved_by(&mut self, function: &str, args: &[Arg], span: Span) -> Option<Moved<'c>> {
        let [from, count, to] = self.arguments(function, ["IN", "COUNT", "OUT"], args, span)?;
        let target = self.elements(function, to);
        let from = if function.contains("FILL") {
            let value = self.expr(from).good();
            let wanted = target.as_ref().map_or(&DINT, |t| t.ty);
            value.and_then(|value| self.fitting(value, wanted)).map(Taken::Value)
        } else {
            self.elements(function, from).map(Taken::Elements)
        };
        let count = self.expr(count);
        let count = self.whole_number(count);
        let (from, count, to) = (from?, count?, target?);
        if let Taken::Elements(Elements { ty, .. }) = &from
            && !same_layout(ty, to.ty)
        {
            let message = format!(
                "{function} moves elements of one type: IN has {}, OUT {}",
                with_article(short(ty)),
                with_article(short(to.ty))
            );
            self.report(span, &messages::TYPES, message);
            return None;
        }
        let moved = Moved { from, count, to };
        if moved.is_beyond() {
            let message = format!("{function} goes beyond the end of an array: nothing would be moved");
            self.report(span, &messages::INDEX, message);
            return None;
        }
        self.written.extend(moved.to.array.declared);
        Some(moved)
    }

    /// An element of an array of one dimension, or the array from its first. `None`: reported.
    fn elements(&mut self, function: &str, expr: &Expr) -> Option<Elements<'c>> {
        let wrong = |this: &mut Self| {
            let message = format!("{function} takes an element of an array of one dimension: #a[0]");
            this.report(expr.span, &messages::FUNCTION_ARGUMENTS, message);
            None
        };
        let ExprKind::Ref(reference) = &expr.kind else {
            // A mistake of its own is reported.
            return self.expr(expr).good().and_then(|_| wrong(self));
        };
        let (steps, index) = match reference.steps.split_last() {
            Some((Step::Index(indices), before)) => (before, Some(indices.as_slice())),
            _ => (reference.steps.as_slice(), None),
        };
        let array = Ref { first: reference.first, steps: steps.to_vec(), span: reference.span };
        let Named::Value(Typed { kind: Kind::Var(array), ty: DataType::Array(dims, ty), .. }) = self.named(&array)?
        else {
            return wrong(self);
        };
        let ([dim], None | Some([_])) = (dims.as_slice(), index) else { return wrong(self) };
        let index = match index.and_then(<[Expr]>::first) {
            Some(index) => self.index(index)?,
            None => Typed::new(Kind::Constant(dim.low as u32), &DINT, expr.span),
        };
        let length = i32::try_from(dim.len()).unwrap_or(i32::MAX);
        let first = match index.kind {
            Kind::Constant(at) => {
                let first = i64::from(at as i32) - i64::from(dim.low);
                if !(0..i64::from(length)).contains(&first) {
                    let message = format!("the index {} is outside the bounds {}..{}", at as i32, dim.low, dim.high);
                    self.report(expr.span, &messages::INDEX, message);
                    return None;
                }
                Typed { kind: Kind::Constant(first as u32), ..index }
            }
            _ => {
                let span = index.span;
                let low = Typed::new(Kind::Constant(dim.low as u32), &DINT, span);
                Typed::new(Kind::Arithmetic(AccuOp::Sub, Box::new(index), Box::new(low)), &DINT, span)
            }
        };
        Some(Elements { array, ty, first, length })
    }
}

impl<'w> Elements<'w> {
    /// The element whose number lies here in the local data.
    fn at(&self, number: Operand) -> Option<Var<'w>> {
        let Place::Fixed(_, at) = number.place else { return None };
        let index = Typed::new(Kind::Var(in_local(at)), &DINT, self.first.span);
        let mut var = self.array.clone();
        var.terms.push(Term { index, low: 0, high: self.length - 1, stride: Layout::stride(self.ty) });
        Some(var)
    }
}

impl Moved<'_> {
    /// True where constants say that it leads beyond an array.
    fn is_beyond(&self) -> bool {
        let constant = |value: &Typed<'_>| match value.kind {
            Kind::Constant(value) => Some(i64::from(value as i32)),
            _ => None,
        };
        let beyond = |side: &Elements<'_>| {
            let last = constant(&side.first).zip(constant(&self.count));
            last.is_some_and(|(first, count)| count < 0 || first + count > i64::from(side.length))
        };
        beyond(&self.to) || matches!(&self.from, Taken::Elements(side) if beyond(side))
    }
}

impl Code {
    /// Moves one element after the other; what would lead beyond an array moves none, and BR is 0.
    pub(crate) fn move_elements(&mut self, moved: &Moved<'_>) {
        let (beyond, again, end, out) = (self.label(), self.label(), self.label(), self.label());
        let number = |code: &mut Self, value: &Typed<'_>| {
            code.value(value);
            code.keep()
        };
        let left = number(self, &moved.count);
        self.below_zero(left, beyond);
        let mut sides = Vec::new();
        let from = match &moved.from {
            Taken::Elements(side) => Some(side),
            Taken::Value(_) => None,
        };
        for side in from.into_iter().chain([&moved.to]) {
            let at = number(self, &side.first);
            self.below_zero(at, beyond);
            self.op(Op::Load(at));
            self.op(Op::Load(left));
            self.op(Op::Arithmetic(NumberFormat::DInt, AccuOp::Add));
            self.op(Op::LoadConst(side.length as u32));
            self.op(Op::Compare(NumberFormat::DInt, Compare::Greater));
            self.jump(Jump::IfRlo, beyond);
            sides.push(at);
        }
        let value = match &moved.from {
            Taken::Elements(side) => sides
                .first()
                .and_then(|at| side.at(*at))
                .map(|var| Typed::new(Kind::Var(var), side.ty, side.first.span)),
            Taken::Value(value) => self.evaluated(value, moved.to.ty),
        };
        let target = sides.last().and_then(|at| moved.to.at(*at));
        let (Some(value), Some(target)) = (value, target) else { return self.lose() };
        self.set(again);
        self.op(Op::Load(left));
        self.op(Op::LoadConst(0));
        self.op(Op::Compare(NumberFormat::DInt, Compare::Greater));
        self.jump(Jump::IfNotRlo, end);
        self.assign(&target, moved.to.ty, &value);
        for (number, by) in sides.into_iter().map(|at| (at, 1)).chain([(left, -1)]) {
            self.op(Op::Load(number));
            self.op(Op::AddConst { format: NumberFormat::DInt, value: by });
            self.op(Op::Transfer(number));
        }
        self.jump(Jump::Always, again);
        self.set(end);
        self.op(Op::SetRlo);
        self.jump(Jump::Always, out);
        self.set(beyond);
        self.op(Op::ClearRlo);
        self.set(out);
        self.op(Op::SaveRlo);
    }

    /// A value that is needed several times: calculated once, into the local data.
    fn evaluated<'w>(&mut self, value: &Typed<'w>, ty: &'w DataType) -> Option<Typed<'w>> {
        if value.is_constant() {
            return Some(value.clone());
        }
        let kept = in_local(self.take(Layout::bits(ty).div_ceil(8)));
        self.assign(&kept, ty, value);
        Some(Typed::new(Kind::Var(kept), ty, value.span))
    }
}
