//! Statements: label, mnemonic, operand tokens, and the actual parameters of calls in both written forms.

use ob1_ir::CallMode;

use crate::messages;
use crate::mnemonics::{Row, Shape};
use crate::parser::{Parser, keywords, split_digits};
use crate::syntax::{Actual, Assignment, Block, Statement, Tokens};
use crate::token::{Kind, Span, Token};

impl Parser<'_, '_> {
    /// One statement with its end. `None` when nothing usable stands here (reported).
    pub(crate) fn statement(&mut self, network: u16) -> Option<Statement> {
        let first = self.peek()?;
        let label = self.label();
        if label.is_some() {
            // A label may be on a line of its own before its statement; then it labels an empty one.
            if matches!(self.peek_kind(), None | Some(Kind::Newline | Kind::Semicolon)) {
                return Some(Statement::empty(label, first, self.at, network));
            }
        }
        let head = self.peek()?;
        let assigned = self.peek_at(1).is_some_and(|t| t.kind == Kind::Assign);
        let Some((row, span)) = (if assigned { None } else { self.mnemonic() }) else {
            self.unknown_mnemonic(head);
            self.skip_statement();
            // The statement keeps its place, so that jumps to its label are not reported as well.
            return Some(Statement::empty(label, head, self.at, network));
        };
        let mut statement = Statement {
            label,
            row: Some(row),
            span,
            operand: self.at..self.at,
            args: Vec::new(),
            broken_list: false,
            network,
            line: head.line,
        };
        if matches!(row.shape, Shape::Call(_)) {
            self.calls.push(self.statements.len() as u32);
            statement.operand = self.call_target();
            self.list_behind(&mut statement);
            statement.broken_list = !self.actuals(&mut statement.args);
        } else {
            let from = self.at;
            self.skip_statement();
            statement.operand = from..self.at;
        }
        Some(statement)
    }

    fn label(&mut self) -> Option<usize> {
        let is_label = self.peek_kind() == Some(Kind::Word) && self.peek_at(1).is_some_and(|t| t.kind == Kind::Colon);
        if !is_label {
            return None;
        }
        let at = self.at;
        self.bump();
        self.bump();
        Some(at)
    }

    /// The mnemonic here, of one token or joined from two: `U(`, `+I`, `<=D`, `RND+`, `)MCR`.
    fn mnemonic(&mut self) -> Option<(&'static Row, Span)> {
        let first = self.peek()?;
        if let Some(second) = self.peek_at(1).filter(|t| joins(first, *t))
            && let Some(row) = self.words.mnemonic_of(self.text(first), self.text(second))
        {
            self.bump();
            self.bump();
            return Some((row, first.span.to(second.span)));
        }
        let row = self.words.mnemonic(self.text(first))?;
        self.bump();
        Some((row, first.span))
    }

    fn unknown_mnemonic(&mut self, head: Token) {
        let text = self.text(head);
        let shown: String = text.chars().take(32).collect();
        if head.kind == Kind::Bad {
            return;
        }
        if self.peek_at(1).is_some_and(|t| t.kind == Kind::Assign) {
            let message = format!("{shown} := does not follow a CALL");
            self.report(head.span, &messages::STRAY_ACTUAL, message);
            return;
        }
        let (letters, digits) = split_digits(text);
        let behind = self.peek_at(1).map(|t| t.kind);
        if head.kind == Kind::Word && behind == Some(Kind::Word) && !digits.is_empty() {
            let message = format!("{shown} is not a mnemonic");
            let remedy = format!("If it is a label, write {shown}: with a colon.");
            self.sink.report_with(self.index, head.span, &messages::UNKNOWN_MNEMONIC, message, remedy);
            return;
        }
        let numbered = !digits.is_empty() || behind == Some(Kind::Number);
        if head.kind == Kind::Word && numbered && self.words.identifier(letters).is_some() {
            let message = format!("the mnemonic is missing in front of the operand {shown}");
            let remedy = "Write what is done with it, as L MW 10 or T MW 10.";
            self.sink.report_with(self.index, head.span, &messages::UNKNOWN_MNEMONIC, message, remedy);
            return;
        }
        if head.kind == Kind::Word && self.words.is_foreign(text) {
            let (message, remedy) = self.words.foreign(text);
            self.sink.report_with(self.index, head.span, &messages::FOREIGN_MNEMONIC, message, remedy);
            return;
        }
        let next = self.peek_at(1).filter(|next| next.span.start == head.span.end).map_or("", |next| self.text(next));
        if matches!((text, next.chars().next()), ("/" | "(", Some('*'))) {
            let message = format!("{shown}* does not begin a comment in STL");
            let remedy = "A comment begins with // and ends with its line: one // in each line.";
            self.sink.report_with(self.index, head.span, &messages::UNKNOWN_MNEMONIC, message, remedy);
            return;
        }
        if text.eq_ignore_ascii_case("TITLE") {
            let rest: String = self.peek_at(1).map_or("...", |next| self.text(next)).chars().take(32).collect();
            let message = "the = behind TITLE is missing";
            let remedy = format!("Write TITLE = {rest}.");
            self.sink.report_with(self.index, head.span, &messages::MISPLACED, message, remedy);
            return;
        }
        if keywords().any(|keyword| keyword.eq_ignore_ascii_case(text)) {
            self.report(head.span, &messages::MISPLACED, format!("{shown} has no place among statements"));
            return;
        }
        if self.follows_a_statement() {
            let message = format!("{shown} is not a mnemonic");
            let remedy = "A comment behind ; begins with //.";
            self.sink.report_with(self.index, head.span, &messages::UNKNOWN_MNEMONIC, message, remedy);
            return;
        }
        let known = self.words.mnemonic_words().chain(keywords());
        let message = format!("{shown} is not a mnemonic");
        self.sink.report_unknown(self.index, head.span, &messages::UNKNOWN_MNEMONIC, message, text, known);
    }

    /// True behind the semicolon of a statement in the same line, with nothing but words behind: a comment without //.
    fn follows_a_statement(&self) -> bool {
        let before = self.at.checked_sub(1).and_then(|at| self.file.tokens.get(at));
        let here = self.peek().map(|token| token.line);
        let line = |token: &&Token| Some(token.line) == here && token.kind != Kind::Newline;
        let rest: Vec<_> = self.file.tokens.iter().skip(self.at).take_while(line).collect();
        before.is_some_and(|token| token.kind == Kind::Semicolon && Some(token.line) == here)
            && !rest.iter().any(|token| token.kind == Kind::Semicolon)
    }

    /// The tokens between CALL and its actual parameters.
    fn call_target(&mut self) -> Tokens {
        let from = self.at;
        let mut last = None;
        while let Some(token) = self.peek() {
            let continues = token.kind == Kind::Newline && last == Some(Kind::Comma);
            if matches!(token.kind, Kind::Newline | Kind::Semicolon | Kind::LeftParen) && !continues {
                break;
            }
            if token.kind != Kind::Newline {
                last = Some(token.kind);
            }
            self.bump();
        }
        from..self.at
    }

    /// The list of pointers of `UC` and `CC` may be on the next line.
    fn list_behind(&mut self, statement: &mut Statement) {
        let end_of_target = self.at;
        let listed = statement.row.is_some_and(|r| matches!(r.shape, Shape::Call(mode) if mode != CallMode::Call));
        if listed && self.peek_kind() == Some(Kind::Newline) {
            while self.peek_kind() == Some(Kind::Newline) {
                self.bump();
            }
            if self.eat(Kind::Attributes) {
                statement.operand.end = self.at;
                return;
            }
        }
        self.at = end_of_target;
    }

    /// The actual parameters after a CALL: `( .. )` in the source form, the following lines in the editor form. False
    /// when a mistake in the list is reported.
    fn actuals(&mut self, args: &mut Vec<Actual>) -> bool {
        let end_of_target = self.at;
        self.skip_newlines();
        if self.eat(Kind::LeftParen) {
            return self.actuals_in_parens(args, self.at - 1);
        }
        self.at = end_of_target;
        let mut whole = true;
        // A semicolon ends the call, in whatever form it is written.
        while self.peek_kind() == Some(Kind::Newline) || !args.is_empty() && self.list_goes_on() {
            if self.peek_kind() == Some(Kind::Semicolon) {
                self.semicolon_within();
                whole = false;
            }
            let line_end = self.at;
            self.skip_newlines();
            let Some(name) = self.actual_name() else {
                self.at = line_end;
                return whole;
            };
            let from = self.at;
            while !matches!(self.peek_kind(), None | Some(Kind::Newline | Kind::Semicolon)) {
                self.bump();
            }
            let mut to = self.at;
            if to > from && self.file.tokens[to - 1].kind == Kind::Comma {
                to -= 1;
            }
            args.push(Actual { name, value: from..to });
        }
        whole
    }

    /// At a semicolon with another actual parameter behind it: nothing but a call has them, so that it goes on.
    fn list_goes_on(&self) -> bool {
        if self.peek_kind() != Some(Kind::Semicolon) {
            return false;
        }
        let mut ahead = 1;
        while self.peek_at(ahead).is_some_and(|t| t.kind == Kind::Newline) {
            ahead += 1;
        }
        self.name_follows(ahead)
    }

    /// Reports the semicolon here, and goes behind it.
    fn semicolon_within(&mut self) {
        let span = self.here();
        let message = "the semicolon ends the call, but another actual parameter follows";
        let remedy = "Within brackets separate actual parameters by commas; the semicolon is behind the last one.";
        self.sink.report_with(self.index, span, &messages::ACTUAL_SYNTAX, message, remedy);
        self.bump();
    }

    /// `NAME :=` so many tokens ahead.
    fn name_follows(&self, ahead: usize) -> bool {
        let kind = |at| self.peek_at(at).map(|t| t.kind);
        let named = matches!(kind(ahead), Some(Kind::Word | Kind::Symbol | Kind::Local));
        named && kind(ahead + 1) == Some(Kind::Assign)
    }

    /// `NAME :=`: the formal of an actual, as its token.
    fn actual_name(&mut self) -> Option<usize> {
        if !self.name_follows(0) {
            return None;
        }
        let name = self.at;
        self.bump();
        self.bump();
        Some(name)
    }

    /// Behind the opening bracket; false when a mistake is reported.
    fn actuals_in_parens(&mut self, args: &mut Vec<Actual>, open: usize) -> bool {
        let mut whole = true;
        loop {
            while matches!(self.peek_kind(), Some(Kind::Newline | Kind::Comma)) {
                self.bump();
            }
            match self.peek_kind() {
                Some(Kind::RightParen) => {
                    self.bump();
                    return whole;
                }
                Some(Kind::Semicolon) if self.list_goes_on() => {
                    self.semicolon_within();
                    whole = false;
                    continue;
                }
                None | Some(Kind::Semicolon) => break,
                _ => {}
            }
            if self.ends_call() {
                break;
            }
            let Some(name) = self.actual_name() else {
                let span = self.here();
                self.report(span, &messages::ACTUAL_SYNTAX, "an actual parameter is written NAME := operand");
                whole = false;
                self.skip_actual();
                continue;
            };
            let from = self.at;
            self.skip_actual();
            args.push(Actual { name, value: from..self.at });
            if self.name_follows(0) {
                let next = self.here();
                let message = "a comma is missing in front of this actual parameter";
                let remedy = "Separate actual parameters by commas.";
                self.sink.report_with(self.index, next, &messages::ACTUAL_SYNTAX, message, remedy);
                whole = false;
            }
        }
        let span = self.file.tokens[open].span;
        self.report(span, &messages::NOT_CLOSED, "the parameter list is not closed with )");
        false
    }

    /// True where no actual parameter can stand any more: a keyword begins the line.
    fn ends_call(&self) -> bool {
        let keyword = self.keyword().is_some_and(|w| w.starts_with("END_") || &*w == "NETWORK");
        keyword && self.peek_at(1).is_none_or(|t| t.kind != Kind::Assign)
    }

    /// Skips the value of an actual parameter, brackets included, up to its comma, the closing bracket or the next
    /// name.
    fn skip_actual(&mut self) {
        let from = self.at;
        let mut depth = 0u32;
        while let Some(token) = self.peek() {
            match token.kind {
                _ if depth == 0 && self.at > from && self.name_follows(0) => return,
                Kind::LeftParen | Kind::LeftBracket => depth += 1,
                Kind::RightBracket => depth = depth.saturating_sub(1),
                Kind::RightParen if depth == 0 => return,
                Kind::RightParen => depth -= 1,
                Kind::Comma if depth == 0 => return,
                Kind::Semicolon => return,
                Kind::Newline if self.next_line_ends_actual() => return,
                _ => {}
            }
            self.bump();
        }
    }

    /// At the end of a line: true when the next one begins with `NAME :=` or ends the block.
    fn next_line_ends_actual(&self) -> bool {
        let Some(next) = self.peek_at(1) else { return true };
        if next.kind != Kind::Word {
            return false;
        }
        let word = self.text(next);
        let ends =
            word.get(..4).is_some_and(|w| w.eq_ignore_ascii_case("END_")) || word.eq_ignore_ascii_case("NETWORK");
        ends || self.peek_at(2).is_some_and(|t| t.kind == Kind::Assign)
    }

    /// `path := value;` of a data block.
    pub(crate) fn assignment(&mut self, block: &mut Block) {
        let from = self.at;
        while !matches!(self.peek_kind(), None | Some(Kind::Newline | Kind::Semicolon | Kind::Assign)) {
            self.bump();
        }
        let path = from..self.at;
        if path.is_empty() || !self.eat(Kind::Assign) {
            let span = self.file.tokens.get(from).map_or(Span::default(), |t| t.span);
            self.report(span, &messages::ASSIGNMENT, "a data block's body assigns start values: name := constant;");
            self.skip_statement();
            if self.at == from {
                self.bump();
            }
            return;
        }
        let from = self.at;
        self.skip_statement();
        block.assignments.push(Assignment { path, value: from..self.at });
    }
}

/// True for two tokens that may make one mnemonic together.
fn joins(first: Token, second: Token) -> bool {
    match (first.kind, second.kind) {
        (Kind::Word, Kind::LeftParen) | (Kind::Operator | Kind::RightParen, Kind::Word) => true,
        (Kind::Word, Kind::Operator) => !second.spaced,
        _ => false,
    }
}
