//! CASE: its selector once, its values in their order.

use std::collections::BTreeSet;

use ob1_ir::{Compare, Jump, Op};
use ob1_model::DataType;

use crate::check::Checker;
use crate::code::Label as Mark;
use crate::expr::fitted;
use crate::lower::Lowerer;
use crate::messages;
use crate::syntax::{Expr, Label, Stmt};
use crate::tree::{Kind, Typed};
use crate::types::{DINT, INT, format, is_bits};

impl<'c> Lowerer<'c> {
    /// The selector of a CASE as INT or DINT. `None`: reported.
    fn selector(&mut self, selector: &Expr) -> Option<Typed<'c>> {
        let value = self.check.expr(selector).good()?;
        let value = match value.ty {
            DataType::Int | DataType::DInt => value,
            DataType::Char => Typed { ty: &INT, ..value },
            DataType::Byte => crate::convert::explicit(value, &INT)?,
            ty if is_bits(ty) => crate::convert::explicit(value, &DINT)?,
            _ => self.check.coerced(value, &INT)?,
        };
        let ty: &'static DataType = if *value.ty == DataType::Int { &INT } else { &DINT };
        let value = match &value.kind {
            Kind::Flexible(_) => self.check.coerced(value, ty)?,
            _ => Typed { ty, ..value },
        };
        Some(self.kept(value))
    }

    pub(crate) fn case(
        &mut self,
        selector: &Expr,
        branches: &[(Vec<Label>, Vec<Stmt>)],
        otherwise: &[Stmt],
    ) -> Option<()> {
        let Some(value) = self.selector(selector) else {
            // For their mistakes.
            branches.iter().for_each(|(_, list)| self.inner(list));
            self.inner(otherwise);
            return None;
        };
        let ty = value.ty;
        let end = self.code.label();
        let mut seen: Vec<(i64, i64)> = Vec::new();
        let mut known = BTreeSet::new();
        for (labels, list) in branches {
            let (here, next) = (self.code.label(), self.code.label());
            for label in labels {
                self.set_line(self.check.line_of(label.low.span));
                let Some((low, high)) = self.case_label(label, ty, &mut seen, &mut known) else { continue };
                self.case_test(&value, ty, low, high, here);
            }
            self.code.jump(Jump::Always, next);
            self.code.set(here);
            self.inner(list);
            self.code.jump(Jump::Always, end);
            self.code.set(next);
        }
        self.inner(otherwise);
        self.code.set(end);
        Some(())
    }

    /// The values of a label; a value that occurs twice is reported.
    fn case_label(
        &mut self,
        label: &Label,
        ty: &'c DataType,
        seen: &mut Vec<(i64, i64)>,
        known: &mut BTreeSet<i64>,
    ) -> Option<(i64, i64)> {
        let low = self.case_value(&label.low, ty)?;
        let high = match &label.high {
            Some(high) => self.case_value(high, ty)?,
            None => low,
        };
        if low == high && !known.insert(low) {
            self.check.report(label.low.span, &messages::LABEL_TWICE, format!("the value {low} occurs twice"));
            return None;
        }
        if seen.iter().take(4096).any(|(a, b)| *a <= low && high <= *b) {
            let message = format!("{low} lies in a range before it");
            self.check.report(label.low.span, &messages::LABEL_COVERED, message);
        }
        if low != high {
            seen.push((low, high));
        }
        Some((low, high))
    }

    fn case_value(&mut self, expr: &Expr, ty: &'c DataType) -> Option<i64> {
        let value = self.check.expr(expr);
        match &value.kind {
            Kind::Bad => None,
            Kind::Flexible(constant) => {
                let whole = Checker::whole(constant);
                let fits = whole.is_some_and(|v| if *ty == DataType::Int { i16::try_from(v).is_ok() } else { true });
                let fits = fits || fitted(constant, ty, expr.span).is_ok() && whole.is_some();
                if !fits {
                    let message = format!("a value of this CASE is a constant of the type {}", ty.name());
                    self.check.report(expr.span, &messages::CONSTANT_RANGE, message);
                    return None;
                }
                whole
            }
            _ => {
                self.check.report(expr.span, &messages::EXPRESSION, "the values of a CASE are constants");
                None
            }
        }
    }

    fn case_test(&mut self, value: &Typed<'c>, ty: &'c DataType, low: i64, high: i64, here: Mark) {
        let constant = |v: i64| {
            let bits = if *ty == DataType::Int { u32::from(v as u16) } else { v as u32 };
            Op::LoadConst(bits)
        };
        self.code.value(value);
        self.code.op(constant(low));
        if low == high {
            self.code.op(Op::Compare(format(ty), Compare::Equal));
            self.code.jump(Jump::IfRlo, here);
            return;
        }
        let next = self.code.label();
        self.code.op(Op::Compare(format(ty), Compare::GreaterEqual));
        self.code.jump(Jump::IfNotRlo, next);
        self.code.value(value);
        self.code.op(constant(high));
        self.code.op(Op::Compare(format(ty), Compare::LessEqual));
        self.code.jump(Jump::IfRlo, here);
        self.code.set(next);
    }
}
