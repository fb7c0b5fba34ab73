//! Statements to operations.

use std::collections::{BTreeMap, BTreeSet};

use ob1_ir::{BitTest, Compare, Jump, Logic, Op, Operand, Place, Width};
use ob1_model::{DataType, Section};
use ob1_stl::front::{Constant, Span, Token};

use crate::check::Checker;
use crate::code::{Code, Label as Mark};
use crate::codes;
use crate::expr::fitted;
use crate::names::Named;
use crate::syntax::{Expr, For, Label, Ref, Stmt, StmtKind};
use crate::tree::{Base, Kind, Side, Typed, Var};
use crate::types::{BOOL, DINT, DWORD, INT, format, is_bits, is_whole};

/// Where EXIT and CONTINUE lead.
struct Loop {
    exit: Mark,
    next: Mark,
}

pub(crate) struct Lowerer<'c> {
    pub(crate) check: Checker<'c>,
    pub(crate) code: Code,
    loops: Vec<Loop>,
    /// Labels of GOTO by name in capitals, with the statement lists that they lie in.
    labels: BTreeMap<String, (Mark, Vec<u32>)>,
    /// The statement lists that are open, by number.
    lists: Vec<u32>,
    next_list: u32,
}

impl<'c> Lowerer<'c> {
    pub(crate) const fn new(check: Checker<'c>, code: Code) -> Self {
        Self { check, code, loops: Vec::new(), labels: BTreeMap::new(), lists: Vec::new(), next_list: 0 }
    }

    /// All statements, with what stands before and behind them.
    pub(crate) fn block(&mut self, statements: &[Stmt], uses_ok: bool, last_line: u32) {
        self.code.line = statements.first().map_or(last_line, |s| s.line);
        if uses_ok {
            let ok = self.code.take_bit();
            self.code.op(Op::SetRlo);
            self.code.op(Op::Assign(ok));
            self.code.ok = Some(ok);
        }
        self.find_labels(statements, &mut vec![0]);
        self.next_list = 0;
        self.list(statements);
        self.code.line = last_line;
        self.end();
    }

    /// OK, or TRUE, into BR.
    fn end(&mut self) {
        match self.code.ok {
            Some(ok) => {
                self.code.op(Op::Scan { logic: Logic::And, negate: false, test: BitTest::Bit(ok) });
            }
            None => self.code.op(Op::SetRlo),
        }
        self.code.op(Op::SaveRlo);
    }

    /// Lists are numbered in the order in which they are lowered.
    fn find_labels(&mut self, statements: &[Stmt], within: &mut Vec<u32>) {
        for statement in statements {
            let mut inner = |this: &mut Self, list: &[Stmt]| {
                this.next_list += 1;
                within.push(this.next_list);
                this.find_labels(list, within);
                within.pop();
            };
            match &statement.kind {
                StmtKind::Label(token) => {
                    let name = self.check.name(*token).to_uppercase();
                    let mark = self.code.label();
                    if self.labels.insert(name, (mark, within.clone())).is_some() {
                        self.check.report(token.span, &codes::GOTO_TARGET, "this label stands twice in the block");
                    }
                }
                StmtKind::If(branches, otherwise) => {
                    branches.iter().for_each(|(_, list)| inner(self, list));
                    inner(self, otherwise);
                }
                StmtKind::Case(_, branches, otherwise) => {
                    branches.iter().for_each(|(_, list)| inner(self, list));
                    inner(self, otherwise);
                }
                StmtKind::For(one) => inner(self, &one.body),
                StmtKind::While(_, list) | StmtKind::Repeat(list, _) => inner(self, list),
                _ => {}
            }
        }
    }

    fn inner(&mut self, statements: &[Stmt]) {
        self.next_list += 1;
        self.lists.push(self.next_list);
        self.list(statements);
        self.lists.pop();
    }

    fn list(&mut self, statements: &[Stmt]) {
        for statement in statements {
            self.code.line = statement.line;
            self.check.line = statement.line;
            let mark = self.code.mark();
            self.statement(statement);
            self.code.release(mark);
        }
    }

    fn statement(&mut self, statement: &Stmt) {
        match &statement.kind {
            StmtKind::Assign(target, value) => self.assign(target, value, statement.span),
            StmtKind::Call(reference) => self.call(reference),
            StmtKind::If(branches, otherwise) => self.if_statement(branches, otherwise),
            StmtKind::Case(selector, branches, otherwise) => self.case(selector, branches, otherwise),
            StmtKind::For(one) => self.for_statement(one, statement.line),
            StmtKind::While(condition, body) => self.while_statement(condition, body),
            StmtKind::Repeat(body, condition) => self.repeat(body, condition),
            StmtKind::Exit => self.leave(statement.span, |one| one.exit),
            StmtKind::Continue => self.leave(statement.span, |one| one.next),
            StmtKind::Return => {
                self.end();
                self.code.op(Op::End);
            }
            StmtKind::Goto(token) => self.goto(*token),
            StmtKind::Label(token) => {
                if let Some((mark, _)) = self.labels.get(&self.check.name(*token).to_uppercase()) {
                    self.code.set(*mark);
                }
            }
        }
    }

    fn leave(&mut self, span: Span, to: impl Fn(&Loop) -> Mark) {
        match self.loops.last().map(to) {
            Some(label) => self.code.jump(Jump::Always, label),
            None => self.check.report(span, &codes::NO_LOOP, "there is no loop here to leave or go on with"),
        }
    }

    fn goto(&mut self, token: Token) {
        let name = self.check.name(token);
        let mut open = vec![0];
        open.extend(&self.lists);
        match self.labels.get(&name.to_uppercase()) {
            Some((mark, within)) if open.starts_with(within) => self.code.jump(Jump::Always, *mark),
            Some(_) => {
                let message = format!("{name} stands within a loop or branch that GOTO is not in");
                self.check.report(token.span, &codes::GOTO_TARGET, message);
            }
            None => {
                let message = format!("{name} stands before no statement of this block");
                self.check.report(token.span, &codes::GOTO_TARGET, message);
            }
        }
    }

    /// The place that is assigned to, with its type.
    fn target(&mut self, reference: &Ref) -> Option<Typed<'c>> {
        let named = self.check.named(reference)?;
        let (message, span) = match named {
            Named::Value(value) => match value.kind {
                Kind::Var(Var { side: Side::Read, .. }) => ("peripheral inputs are only read".to_owned(), value.span),
                Kind::Var(_) | Kind::Ok | Kind::Eno => {
                    self.check.mark_written(&value);
                    return Some(value);
                }
                Kind::Flexible(_) => ("a constant cannot be assigned to".to_owned(), value.span),
                Kind::Timer(_) | Kind::Counter(_) => {
                    let shown = self.check.text(reference.first);
                    (format!("{shown} is a timer or counter: for a variable of this name write #{shown}"), value.span)
                }
                _ => ("this cannot be assigned to".to_owned(), value.span),
            },
            _ => ("a block cannot be assigned to".to_owned(), reference.span),
        };
        self.check.report(span, &codes::NOT_WRITABLE, message);
        None
    }

    fn assign(&mut self, target: &Ref, value: &Expr, _span: Span) {
        // The value is read before the target is written.
        let value = self.check.expr(value);
        let Some(target) = self.target(target) else { return };
        if value.is_bad() {
            return;
        }
        let var = match target.kind {
            Kind::Var(var) => var,
            _ => match self.code.ok {
                Some(Place::Fixed(area, at)) => {
                    let base = Base::Fixed(area);
                    Var { base, at, terms: Vec::new(), declared: None, side: Side::Both }
                }
                _ => return,
            },
        };
        if let Some(value) = self.fitting(value, target.ty) {
            self.code.assign(&var, target.ty, &value);
        }
    }

    /// A value as what a variable of this type takes.
    fn fitting(&mut self, value: Typed<'c>, ty: &'c DataType) -> Option<Typed<'c>> {
        if let (Kind::Flexible(Constant::Text(text)), DataType::String(max)) = (&value.kind, ty)
            && text.len() > usize::from(*max)
        {
            let message = format!("the text has {} characters, the STRING takes {max}", text.len());
            self.check.report(value.span, &codes::LONG_TEXT, message);
        }
        let composed = match (ty, value.ty) {
            (DataType::String(_), DataType::String(_)) => true,
            (DataType::String(_), DataType::Char) => !matches!(value.kind, Kind::Flexible(_)),
            (DataType::Any | DataType::Pointer, _) if matches!(value.kind, Kind::Var(_)) => {
                // The pointer itself, or a pointer to what is assigned.
                *ty == *value.ty
            }
            (a, b) => a.is_composed() && crate::calls::same(a, b),
        };
        if composed && !matches!(value.kind, Kind::Flexible(_)) {
            return Some(value);
        }
        self.check.coerced(value, ty)
    }

    fn call(&mut self, reference: &Ref) {
        let name = self.check.name(reference.first);
        if let [crate::syntax::Step::Call(args)] = reference.steps.as_slice()
            && self.check.block_called(name).is_none()
            && let Some(poked) = self.check.poke(name, args, reference.span)
        {
            if let Some((place, value)) = poked {
                self.code.assign(&place, value.ty, &value);
            }
            return;
        }
        match self.check.named(reference) {
            Some(Named::Value(value)) => match &value.kind {
                Kind::Call(call) => {
                    self.code.call(call, None);
                }
                Kind::Bad => {}
                // A function whose value is not used.
                _ if value.ty.elementary_bits().is_some() => self.code.value(&value),
                _ => {}
            },
            Some(_) => self.check.report(reference.span, &codes::NOT_CALLABLE, "this is no call"),
            None => {}
        }
    }

    fn condition(&mut self, condition: &Expr) {
        if let Some(value) = self.check.expr_as(condition, &BOOL) {
            self.code.bits(&value);
        }
    }

    fn if_statement(&mut self, branches: &[(Expr, Vec<Stmt>)], otherwise: &[Stmt]) {
        let end = self.code.label();
        for (at, (condition, list)) in branches.iter().enumerate() {
            let next = self.code.label();
            self.condition(condition);
            self.code.jump(Jump::IfNotRlo, next);
            self.inner(list);
            if at + 1 < branches.len() || !otherwise.is_empty() {
                self.code.jump(Jump::Always, end);
            }
            self.code.set(next);
        }
        self.inner(otherwise);
        self.code.set(end);
    }

    fn while_statement(&mut self, condition: &Expr, body: &[Stmt]) {
        let (next, exit) = (self.code.label(), self.code.label());
        self.code.set(next);
        self.condition(condition);
        self.code.jump(Jump::IfNotRlo, exit);
        self.body(body, exit, next);
        self.code.jump(Jump::Always, next);
        self.code.set(exit);
    }

    fn repeat(&mut self, body: &[Stmt], condition: &Expr) {
        let (begin, next, exit) = (self.code.label(), self.code.label(), self.code.label());
        self.code.set(begin);
        self.body(body, exit, next);
        self.code.set(next);
        self.condition(condition);
        self.code.jump(Jump::IfNotRlo, begin);
        self.code.set(exit);
    }

    fn body(&mut self, body: &[Stmt], exit: Mark, next: Mark) {
        self.loops.push(Loop { exit, next });
        self.inner(body);
        self.loops.pop();
    }

    fn for_statement(&mut self, one: &For, line: u32) {
        let variable = self.target(&one.variable);
        let Some(Typed { kind: Kind::Var(var), ty, span }) = variable else {
            self.next_list += 1;
            return;
        };
        let unsigned = self.check.options.tia && is_bits(ty);
        if !is_whole(ty) && !unsigned {
            let message = format!("the variable of a FOR is an INT or DINT, this is {}", ty.name());
            self.check.report(span, &codes::LOOP_VARIABLE, message);
            self.next_list += 1;
            return;
        }
        let own = ty;
        let ty: &'static DataType = if *ty == DataType::Int { &INT } else { &DINT };
        let counter = Typed::new(Kind::Var(var.clone()), own, span);
        let (start, end) = (self.bound(&one.start, own), self.bound(&one.end, own));
        // Unsigned numbers are counted as DINT.
        let counted = |value: Typed<'c>| if unsigned { crate::convert::explicit(value, &DINT) } else { Some(value) };
        let (Some(counter), end) = (counted(counter), end.and_then(counted)) else { return };
        let step = match &one.step {
            Some(step) => self.bound(step, ty),
            None => Some(Typed::new(Kind::Constant(1), ty, span)),
        };
        let (Some(start), Some(end), Some(step)) = (start, end, step) else {
            self.next_list += 1;
            return;
        };
        let largest = if *ty == DataType::Int { i16::MAX as u32 } else { i32::MAX as u32 };
        if end.is_constant() && matches!(end.kind, Kind::Constant(v) if v == largest) && one.step.is_none() {
            self.check.report(one.end.span, &codes::ENDLESS_LOOP, "the loop goes on for ever: its variable wraps");
        }
        let end = self.kept(end);
        let step = self.kept(step);
        self.code.assign(&var, own, &start);
        let (again, next, exit) = (self.code.label(), self.code.label(), self.code.label());
        self.code.set(again);
        self.for_test(&counter, &end, &step, exit);
        self.body(&one.body, exit, next);
        self.code.line = line;
        self.code.set(next);
        let sum = Typed::new(Kind::Arithmetic(ob1_ir::AccuOp::Add, Box::new(counter), Box::new(step)), ty, span);
        self.code.value(&sum);
        let operand = self.code.temp(Width::of(own).unwrap_or(Width::Word));
        if var.is_direct() {
            let place = self.code.place(&var);
            self.code.op(Op::Transfer(Operand { place, ..operand }));
        } else {
            self.code.op(Op::Transfer(operand));
            let place = self.code.place(&var);
            self.code.op(Op::Load(operand));
            self.code.op(Op::Transfer(Operand { place, ..operand }));
        }
        self.code.jump(Jump::Always, again);
        self.code.set(exit);
    }

    fn bound(&mut self, expr: &Expr, ty: &'c DataType) -> Option<Typed<'c>> {
        let value = self.check.expr(expr);
        if value.is_bad() {
            return None;
        }
        self.check.coerced(value, ty)
    }

    /// A constant as it is; anything else evaluated once.
    fn kept(&mut self, value: Typed<'c>) -> Typed<'c> {
        if value.is_constant() {
            return value;
        }
        self.code.value(&value);
        let operand = self.code.temp(Width::of(value.ty).unwrap_or(Width::Word));
        self.code.op(Op::Transfer(operand));
        let Place::Fixed(area, at) = operand.place else { return value };
        let var = Var { base: Base::Fixed(area), at, terms: Vec::new(), declared: None, side: Side::Both };
        Typed::new(Kind::Var(var), value.ty, value.span)
    }

    /// Leaves the loop when the variable has passed the end. A step that is no constant decides by its sign.
    fn for_test(&mut self, counter: &Typed<'c>, end: &Typed<'c>, step: &Typed<'c>, exit: Mark) {
        let compare = |code: &mut Code, relation| {
            code.two(counter, end);
            code.op(Op::Compare(format(counter.ty), relation));
            code.jump(Jump::IfNotRlo, exit);
        };
        if let Kind::Constant(value) = step.kind {
            let value = if *counter.ty == DataType::Int { i32::from(value as i16) } else { value as i32 };
            if value == 0 {
                self.check.report(step.span, &codes::STEP_ZERO, "with BY 0 the loop never ends");
            }
            compare(&mut self.code, if value < 0 { Compare::GreaterEqual } else { Compare::LessEqual });
            return;
        }
        let (down, body) = (self.code.label(), self.code.label());
        self.code.value(step);
        self.code.op(Op::LoadConst(0));
        self.code.op(Op::Compare(format(counter.ty), Compare::Less));
        self.code.jump(Jump::IfRlo, down);
        compare(&mut self.code, Compare::LessEqual);
        self.code.jump(Jump::Always, body);
        self.code.set(down);
        compare(&mut self.code, Compare::GreaterEqual);
        self.code.set(body);
    }

    fn case(&mut self, selector: &Expr, branches: &[(Vec<Label>, Vec<Stmt>)], otherwise: &[Stmt]) {
        let value = self.check.expr(selector);
        let value = match value.ty {
            _ if value.is_bad() => None,
            DataType::Int | DataType::DInt => Some(value),
            DataType::Char => Some(Typed { ty: &INT, ..value }),
            ty if is_bits(ty) => crate::convert::explicit(value, if *ty == DataType::DWord { &DINT } else { wide(ty) }),
            _ => self.check.coerced(value, &INT),
        };
        let Some(value) = value else {
            self.next_list += branches.len() as u32 + 1;
            return;
        };
        let ty: &'static DataType = if *value.ty == DataType::Int { &INT } else { &DINT };
        let value = match &value.kind {
            Kind::Flexible(_) => match self.check.coerced(value, ty) {
                Some(value) => value,
                None => return,
            },
            _ => Typed { ty, ..value },
        };
        let value = self.kept(value);
        let end = self.code.label();
        let mut seen: Vec<(i64, i64)> = Vec::new();
        let mut known = BTreeSet::new();
        for (labels, list) in branches {
            let (here, next) = (self.code.label(), self.code.label());
            for label in labels {
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
            self.check.report(label.low.span, &codes::LABEL_TWICE, format!("the value {low} occurs twice"));
            return None;
        }
        if seen.iter().take(4096).any(|(a, b)| *a <= low && high <= *b) {
            let message = format!("{low} lies in a range before it");
            self.check.report(label.low.span, &codes::LABEL_COVERED, message);
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
                    self.check.report(expr.span, &codes::CONSTANT_RANGE, message);
                    return None;
                }
                whole
            }
            _ => {
                self.check.report(expr.span, &codes::EXPRESSION, "the values of a CASE are constants");
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

    /// What only the whole block shows.
    pub(crate) fn finish_checks(&mut self) {
        let params = &self.check.info.interface.params;
        if let Some((index, _)) = self.check.result()
            && !self.check.written.contains(&index)
        {
            let span = self.check.block.span;
            self.check.report(span, &codes::RESULT_UNASSIGNED, "nothing assigns to the result of this function");
        }
        let read: Vec<(usize, Span)> = self.check.read.iter().map(|(at, span)| (*at, *span)).collect();
        for (index, span) in read {
            let Some(param) = params.get(index).filter(|p| p.section == Section::Temp) else { continue };
            if !self.check.written.contains(&index) && param.ty.elementary_bits().is_some() {
                let message = format!("{} is read, and nothing in the block assigns it", param.name);
                self.check.report(span, &codes::TEMP_UNASSIGNED, message);
            }
        }
    }
}

const fn wide(ty: &DataType) -> &'static DataType {
    let _ = &DWORD;
    match ty {
        DataType::Byte => &INT,
        _ => &DINT,
    }
}

impl<'c> Checker<'c> {
    /// A declaration that is written, wholly or in part.
    pub(crate) fn mark_written(&mut self, value: &Typed<'c>) {
        if let Kind::Var(Var { declared: Some(index), .. }) = &value.kind {
            self.written.insert(*index);
        }
    }

    /// A declaration that is read.
    pub(crate) fn mark_read(&mut self, value: &Typed<'c>) {
        if let Kind::Var(Var { declared: Some(index), .. }) = &value.kind {
            self.read.entry(*index).or_insert(value.span);
        }
    }
}
