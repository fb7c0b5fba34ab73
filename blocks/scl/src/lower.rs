//! Statements to operations.

use std::collections::BTreeMap;

use ob1_ir::{BitTest, Compare, Jump, Logic, Op, Operand, Place, Width};
use ob1_model::{BlockKind, DataType, Layout, Section};
use ob1_stl::front::{Constant, Span, Token, same_layout, write_default};

use crate::check::Checker;
use crate::code::{Code, Label as Mark};
use crate::messages;
use crate::names::Named;
use crate::syntax::{Expr, For, Ref, Stmt, StmtKind};
use crate::tree::{Base, Kind, Side, Typed, Var};
use crate::types::{BOOL, DINT, INT, format, is_bits, is_whole};

/// Bytes of local data in which an organization block finds how it was started.
const START_INFORMATION: u32 = 20;

/// Where EXIT and CONTINUE lead.
struct Loop {
    exit: Mark,
    next: Mark,
}

/// The head of a FOR: its variable with its own type, and what is calculated with.
struct Counted<'c> {
    var: Var<'c>,
    own: &'c DataType,
    counter: Typed<'c>,
    start: Typed<'c>,
    end: Typed<'c>,
    step: Typed<'c>,
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
        if self.check.options.tia {
            self.clear_temporaries();
        }
        self.find_labels(statements, &mut vec![0]);
        self.next_list = 0;
        self.list(statements);
        self.code.line = last_line;
        self.end();
    }

    /// A block of TIA Portal finds its temporaries with their default values; an organization block has its start
    /// information in front of them.
    fn clear_temporaries(&mut self) {
        let interface = &self.check.info.interface;
        let mut image = vec![0; interface.temp_bytes as usize];
        let mut bytes = 0;
        for param in interface.params.iter().filter(|p| p.section == Section::Temp) {
            write_default(&param.ty, param.at, &mut image);
            bytes = bytes.max((param.at.0 + Layout::bits(&param.ty)).div_ceil(8));
        }
        let first = if self.check.id.kind == BlockKind::Ob { START_INFORMATION } else { 0 };
        if let Some(image) = image.get(first as usize..bytes as usize) {
            self.code.fill_local(first, image);
        }
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
                        self.check.report(token.span, &messages::GOTO_TARGET, "this label stands twice in the block");
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

    pub(crate) fn inner(&mut self, statements: &[Stmt]) {
        self.next_list += 1;
        self.lists.push(self.next_list);
        self.list(statements);
        self.lists.pop();
    }

    fn list(&mut self, statements: &[Stmt]) {
        for statement in statements {
            self.set_line(statement.line);
            let (mark, said) = (self.code.mark(), self.check.sink.said());
            let done = self.statement(statement);
            self.code.release(mark);
            if std::mem::take(&mut self.code.lacks_texts) {
                self.check.lacks("CONCAT", statement.span);
            }
            let lost = std::mem::take(&mut self.code.lost) || done.is_none();
            if lost && !statement.reported && self.check.sink.said() == said {
                self.check.report(statement.span, &messages::LOST, messages::LOST.title);
            }
        }
    }

    /// `None`: it has a mistake of its own, which is reported.
    fn statement(&mut self, statement: &Stmt) -> Option<()> {
        match &statement.kind {
            StmtKind::Assign(target, value) => self.assign(target, value),
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
                Some(())
            }
            StmtKind::Goto(token) => self.goto(*token),
            StmtKind::Label(token) => {
                let (mark, _) = self.labels.get(&self.check.name(*token).to_uppercase())?;
                self.code.set(*mark);
                Some(())
            }
        }
    }

    fn leave(&mut self, span: Span, to: impl Fn(&Loop) -> Mark) -> Option<()> {
        let Some(label) = self.loops.last().map(to) else {
            self.check.report(span, &messages::NO_LOOP, "there is no loop here to leave or go on with");
            return None;
        };
        self.code.jump(Jump::Always, label);
        Some(())
    }

    fn goto(&mut self, token: Token) -> Option<()> {
        let name = self.check.name(token);
        let mut open = vec![0];
        open.extend(&self.lists);
        let message = match self.labels.get(&name.to_uppercase()) {
            Some((mark, within)) if open.starts_with(within) => {
                self.code.jump(Jump::Always, *mark);
                return Some(());
            }
            Some(_) => format!("{name} stands within a loop or branch that GOTO is not in"),
            None => format!("{name} stands before no statement of this block"),
        };
        self.check.report(token.span, &messages::GOTO_TARGET, message);
        None
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
        self.check.report(span, &messages::NOT_WRITABLE, message);
        None
    }

    fn assign(&mut self, target: &Ref, value: &Expr) -> Option<()> {
        // The value is read before the target is written.
        let value = self.check.expr(value);
        let target = self.target(target)?;
        let value = value.good()?;
        let var = match target.kind {
            Kind::Var(var) => var,
            _ => {
                let Place::Fixed(area, at) = self.code.ok? else { return None };
                Var { base: Base::Fixed(area), at, terms: Vec::new(), declared: None, side: Side::Both }
            }
        };
        let value = self.check.fitting(value, target.ty)?;
        self.code.assign(&var, target.ty, &value);
        Some(())
    }

    fn call(&mut self, reference: &Ref) -> Option<()> {
        let name = self.check.name(reference.first);
        if let [crate::syntax::Step::Call(args)] = reference.steps.as_slice()
            && self.check.block_called(name).is_none()
        {
            if let Some(poked) = self.check.poke(name, args, reference.span) {
                let (place, value) = poked?;
                self.code.assign(&place, value.ty, &value);
                return Some(());
            }
            if let Some(moved) = self.check.moved(name, args, reference.span) {
                self.code.move_elements(&moved?);
                return Some(());
            }
        }
        match self.check.named(reference)? {
            Named::Value(Typed { kind: Kind::Call(call), .. }) => {
                self.code.call(&call, None);
            }
            // A function whose value is not used.
            Named::Value(value) if value.ty.elementary_bits().is_some() => self.code.value(&value.good()?),
            _ => {
                self.check.report(reference.span, &messages::NOT_CALLABLE, "this is no call");
                return None;
            }
        }
        Some(())
    }

    /// The operations of a part of a statement have its line.
    pub(crate) const fn set_line(&mut self, line: u32) {
        self.code.line = line;
        self.check.line = line;
    }

    fn condition(&mut self, condition: &Expr) -> Option<()> {
        self.set_line(self.check.line_of(condition.span));
        let value = self.check.expr_as(condition, &BOOL)?;
        self.code.bits(&value);
        Some(())
    }

    fn if_statement(&mut self, branches: &[(Expr, Vec<Stmt>)], otherwise: &[Stmt]) -> Option<()> {
        let end = self.code.label();
        let mut done = Some(());
        for (at, (condition, list)) in branches.iter().enumerate() {
            let next = self.code.label();
            done = done.and(self.condition(condition));
            self.code.jump(Jump::IfNotRlo, next);
            self.inner(list);
            if at + 1 < branches.len() || !otherwise.is_empty() {
                self.code.jump(Jump::Always, end);
            }
            self.code.set(next);
        }
        self.inner(otherwise);
        self.code.set(end);
        done
    }

    fn while_statement(&mut self, condition: &Expr, body: &[Stmt]) -> Option<()> {
        let (next, exit) = (self.code.label(), self.code.label());
        self.code.set(next);
        let done = self.condition(condition);
        self.code.jump(Jump::IfNotRlo, exit);
        let line = self.code.line;
        self.body(body, exit, next);
        self.set_line(line);
        self.code.jump(Jump::Always, next);
        self.code.set(exit);
        done
    }

    fn repeat(&mut self, body: &[Stmt], condition: &Expr) -> Option<()> {
        let (begin, next, exit) = (self.code.label(), self.code.label(), self.code.label());
        self.code.set(begin);
        self.body(body, exit, next);
        self.code.set(next);
        let done = self.condition(condition);
        self.code.jump(Jump::IfNotRlo, begin);
        self.code.set(exit);
        done
    }

    fn body(&mut self, body: &[Stmt], exit: Mark, next: Mark) {
        self.loops.push(Loop { exit, next });
        self.inner(body);
        self.loops.pop();
    }

    fn for_statement(&mut self, one: &For, line: u32) -> Option<()> {
        let Some(Counted { var, own, counter, start, end, step }) = self.counted(one) else {
            // For its mistakes.
            let nowhere = self.code.label();
            self.body(&one.body, nowhere, nowhere);
            return None;
        };
        let (ty, span) = (counter.ty, counter.span);
        let largest = if *ty == DataType::Int { i16::MAX as u32 } else { i32::MAX as u32 };
        if end.is_constant() && matches!(end.kind, Kind::Constant(v) if v == largest) && one.step.is_none() {
            self.check.report(one.end.span, &messages::ENDLESS_LOOP, "the loop goes on for ever: its variable wraps");
        }
        let end = self.kept(end);
        let step = self.kept(step);
        self.code.assign(&var, own, &start);
        let (again, next, exit) = (self.code.label(), self.code.label(), self.code.label());
        self.code.set(again);
        self.for_test(&counter, &end, &step, exit);
        self.body(&one.body, exit, next);
        self.set_line(line);
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
        Some(())
    }

    /// The head of a FOR. `None`: reported.
    fn counted(&mut self, one: &For) -> Option<Counted<'c>> {
        let variable = self.target(&one.variable);
        let (own, span) = variable.as_ref().map_or((&INT, one.variable.span), |v| (v.ty, v.span));
        let unsigned = self.check.options.tia && is_bits(own);
        if !is_whole(own) && !unsigned {
            let message = format!("the variable of a FOR is an INT or DINT, this is {}", own.name());
            self.check.report(span, &messages::LOOP_VARIABLE, message);
            return None;
        }
        let ty: &'static DataType = if *own == DataType::Int { &INT } else { &DINT };
        let (start, end) = (self.bound(&one.start, own), self.bound(&one.end, own));
        let step = match &one.step {
            Some(step) => self.bound(step, ty),
            None => Some(Typed::new(Kind::Constant(1), ty, span)),
        };
        let Some(Typed { kind: Kind::Var(var), .. }) = variable else { return None };
        let counter = Typed::new(Kind::Var(var.clone()), own, span);
        // Unsigned numbers are counted as DINT.
        let counted = |value: Typed<'c>| if unsigned { crate::convert::explicit(value, &DINT) } else { Some(value) };
        Some(Counted { var, own, counter: counted(counter)?, start: start?, end: counted(end?)?, step: step? })
    }

    fn bound(&mut self, expr: &Expr, ty: &'c DataType) -> Option<Typed<'c>> {
        self.check.expr_as(expr, ty)
    }

    /// A constant as it is; anything else evaluated once.
    pub(crate) fn kept(&mut self, value: Typed<'c>) -> Typed<'c> {
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
                self.check.report(step.span, &messages::STEP_ZERO, "with BY 0 the loop never ends");
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

    /// What only the whole block shows.
    pub(crate) fn finish_checks(&mut self) {
        let params = &self.check.info.interface.params;
        if let Some((index, _)) = self.check.result()
            && !self.check.written.contains(&index)
        {
            let span = self.check.block.span;
            self.check.report(span, &messages::RESULT_UNASSIGNED, "nothing assigns to the result of this function");
        }
        let read: Vec<(usize, Span)> = self.check.read.iter().map(|(at, span)| (*at, *span)).collect();
        for (index, span) in read {
            let Some(param) = params.get(index).filter(|p| p.section == Section::Temp) else { continue };
            if !self.check.written.contains(&index) && param.ty.elementary_bits().is_some() {
                let message = format!("{} is read, and nothing in the block assigns it", param.name);
                self.check.report(span, &messages::TEMP_UNASSIGNED, message);
            }
        }
    }
}

impl<'c> Checker<'c> {
    /// A value as what a variable of this type takes.
    pub(crate) fn fitting(&mut self, value: Typed<'c>, ty: &'c DataType) -> Option<Typed<'c>> {
        if let (Kind::Flexible(Constant::Text(text)), DataType::String(max)) = (&value.kind, ty)
            && text.len() > usize::from(*max)
        {
            let message = format!("the text has {} characters, the STRING takes {max}", text.len());
            self.report(value.span, &messages::LONG_TEXT, message);
        }
        let composed = match (ty, value.ty) {
            (DataType::String(_), DataType::String(_)) => true,
            (DataType::String(_), DataType::Char) => !matches!(value.kind, Kind::Flexible(_)),
            (DataType::Any | DataType::Pointer, _) if matches!(value.kind, Kind::Var(_)) => {
                // The pointer itself, or a pointer to what is assigned.
                *ty == *value.ty
            }
            (a, b) => a.is_composed() && same_layout(a, b),
        };
        if composed && !matches!(value.kind, Kind::Flexible(_)) {
            return Some(value);
        }
        self.coerced(value, ty)
    }

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
