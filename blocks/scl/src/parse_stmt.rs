//! Statements. After a mistake the parser goes on at the next statement, so that each mistake is one finding.

use ob1_ir::AccuOp;
use ob1_stl::front::{Kind, Span, Token};

use crate::cursor::{Cursor, DEPTH};
use crate::messages;
use crate::parse_expr::is_reserved;
use crate::syntax::{Expr, ExprKind, For, Label, Operator, Ref, Stmt, StmtKind};

/// Words that end a list of statements.
const ENDS: [&str; 9] =
    ["ELSE", "ELSIF", "END_IF", "END_CASE", "END_FOR", "END_WHILE", "UNTIL", "END_REPEAT", "END_REGION"];

/// Words that begin a statement.
const BEGINS: [&str; 9] = ["IF", "CASE", "FOR", "WHILE", "REPEAT", "EXIT", "CONTINUE", "RETURN", "GOTO"];

impl Cursor<'_, '_> {
    /// All statements of a block.
    pub(crate) fn statements_of_block(&mut self) -> Vec<Stmt> {
        let mut out = Vec::new();
        loop {
            out.extend(self.statements(false));
            let Some(token) = self.peek() else { return out };
            let text = self.text(token);
            self.report(token.span, &messages::STATEMENT, format!("{text} ends nothing here"));
            self.bump();
            self.eat(Kind::Semicolon);
        }
    }

    /// Statements up to a word that ends a list; in a CASE also up to the next label.
    fn statements(&mut self, in_case: bool) -> Vec<Stmt> {
        let mut out = Vec::new();
        self.depth += 1;
        if self.depth > DEPTH {
            let here = self.here();
            self.report(here, &messages::DEPTH, format!("statements are nested more than {DEPTH} deep"));
            // The rest is left out, so that this is said once.
            self.at = self.end;
        }
        while let Some(token) = self.peek() {
            if token.kind == Kind::Semicolon || token.kind == Kind::Region {
                self.bump();
                continue;
            }
            let ends = token.kind == Kind::Word && ENDS.iter().any(|w| w.eq_ignore_ascii_case(self.text(token)));
            if ends || in_case && self.is_label() {
                break;
            }
            let (before, said) = (self.at, self.said());
            let line = token.line;
            let kind = self.statement(token);
            let span = token.span.to(self.behind());
            if kind.is_none() && self.said() == said {
                self.report(span, &messages::LOST, messages::LOST.title);
            }
            let reported = self.said() > said;
            out.extend(kind.map(|kind| Stmt { kind, span, line, reported }));
            if self.at == before {
                self.bump();
            }
        }
        self.depth -= 1;
        out
    }

    fn statement(&mut self, token: Token) -> Option<StmtKind> {
        let text = self.text(token);
        let keyword = BEGINS.iter().find(|w| token.kind == Kind::Word && w.eq_ignore_ascii_case(text));
        match keyword.copied() {
            Some("IF") => Some(self.if_statement()),
            Some("CASE") => Some(self.case_statement()),
            Some("FOR") => self.for_statement(),
            Some("WHILE") => Some(self.while_statement()),
            Some("REPEAT") => Some(self.repeat_statement()),
            Some(word) => {
                self.bump();
                let kind = match word {
                    "EXIT" => StmtKind::Exit,
                    "CONTINUE" => StmtKind::Continue,
                    "RETURN" => StmtKind::Return,
                    _ => StmtKind::Goto(self.goto_label()?),
                };
                self.semicolon();
                Some(kind)
            }
            None => self.simple(token),
        }
    }

    fn goto_label(&mut self) -> Option<Token> {
        let label = self.peek().filter(|t| matches!(t.kind, Kind::Word | Kind::Symbol | Kind::Local));
        match label {
            Some(_) => self.bump(),
            None => {
                let here = self.here();
                self.report(here, &messages::EXPECTED, "GOTO is followed by a label");
                self.skip_statement();
            }
        }
        label
    }

    /// An assignment, a call, or a label.
    fn simple(&mut self, token: Token) -> Option<StmtKind> {
        let is_name = matches!(token.kind, Kind::Word | Kind::Symbol | Kind::Local);
        if !is_name || token.kind == Kind::Word && is_reserved(self.text(token)) {
            if token.kind != Kind::Bad {
                let shown: String = self.text(token).chars().take(32).collect();
                self.report(token.span, &messages::STATEMENT, format!("a statement cannot begin with {shown}"));
            }
            self.skip_statement();
            return None;
        }
        if self.peek_at(1).is_some_and(|t| t.kind == Kind::Colon) && !self.periphery_follows() {
            self.bump();
            self.bump();
            return Some(StmtKind::Label(token));
        }
        let target = self.reference();
        match self.kind() {
            Some(Kind::Assign) => {
                self.bump();
                let value = self.expression();
                self.semicolon();
                Some(StmtKind::Assign(target, value))
            }
            Some(Kind::AssignWith) => self.assign_with(target),
            _ if target.steps.iter().any(|s| matches!(s, crate::syntax::Step::Call(_))) => {
                self.semicolon();
                Some(StmtKind::Call(target))
            }
            _ => {
                let here = self.here();
                self.report(here, &messages::EXPECTED, "an assignment := or the parameters of a call are missing");
                self.skip_statement();
                None
            }
        }
    }

    fn periphery_follows(&self) -> bool {
        let p = self.peek_at(2).is_some_and(|t| t.kind == Kind::Word && self.text(t).eq_ignore_ascii_case("P"));
        p && self.peek_at(3).is_some_and(|t| matches!(t.kind, Kind::Assign | Kind::AssignWith))
    }

    /// `x += e`.
    fn assign_with(&mut self, target: Ref) -> Option<StmtKind> {
        let sign = self.peek()?;
        let op = match self.text(sign) {
            "+=" => AccuOp::Add,
            "-=" => AccuOp::Sub,
            "*=" => AccuOp::Mul,
            "/=" => AccuOp::Div,
            _ => {
                self.report(sign.span, &messages::NOT_SUPPORTED, "?= needs VARIANT, which this CPU does not have");
                self.skip_statement();
                return None;
            }
        };
        // The target is read once more: its steps are parsed anew for the expression.
        let behind = self.at;
        let start = self.position(target.first)?;
        self.at = start;
        let again = self.reference();
        self.at = behind;
        self.bump();
        let value = self.expression();
        self.semicolon();
        let (left, span) = (again.span, again.span.to(value.span));
        let left = Expr { kind: ExprKind::Ref(again), span: left };
        let value = Expr { kind: ExprKind::Binary(Operator::Arithmetic(op), Box::new(left), Box::new(value)), span };
        Some(StmtKind::Assign(target, value))
    }

    /// The index of a token that was read already.
    fn position(&self, token: Token) -> Option<usize> {
        let tokens = self.file.tokens.get(..self.at)?;
        tokens.iter().rposition(|t| t.span == token.span)
    }

    fn if_statement(&mut self) -> StmtKind {
        let start = self.here();
        self.bump();
        let mut branches = Vec::new();
        let condition = self.expression();
        self.word("THEN");
        branches.push((condition, self.statements(false)));
        let mut otherwise = Vec::new();
        loop {
            if self.eat_word("ELSIF") {
                let condition = self.expression();
                self.word("THEN");
                branches.push((condition, self.statements(false)));
            } else if self.eat_word("ELSE") {
                // Siemens' compiler takes a colon here.
                self.eat(Kind::Colon);
                otherwise.extend(self.statements(false));
                if self.is_word("ELSE") || self.is_word("ELSIF") {
                    let here = self.here();
                    self.report(here, &messages::EXPECTED, "ELSE is the last branch of an IF: END_IF is missing here");
                }
            } else {
                break;
            }
        }
        self.end("END_IF", start);
        StmtKind::If(branches, otherwise)
    }

    fn case_statement(&mut self) -> StmtKind {
        let start = self.here();
        self.bump();
        let selector = self.expression();
        self.word("OF");
        let mut branches = Vec::new();
        let mut otherwise = Vec::new();
        loop {
            while self.eat(Kind::Semicolon) || self.eat(Kind::Region) {}
            if self.eat_word("ELSE") {
                self.eat(Kind::Colon);
                otherwise = self.statements(false);
                break;
            }
            if !self.is_label() {
                break;
            }
            let labels = self.labels();
            branches.push((labels, self.statements(true)));
        }
        self.end("END_CASE", start);
        StmtKind::Case(selector, branches, otherwise)
    }

    fn labels(&mut self) -> Vec<Label> {
        let mut labels = Vec::new();
        let (before, said) = (self.at, self.said());
        loop {
            let low = self.expression();
            let high = self.eat(Kind::DotDot).then(|| self.expression());
            labels.push(Label { low, high });
            if !self.eat(Kind::Comma) {
                break;
            }
        }
        if self.eat(Kind::Colon) {
            return labels;
        }
        if self.said() == said {
            let here = self.here();
            self.report(here, &messages::EXPECTED, "between the values of a CASE stands a comma, behind them a colon");
        }
        if self.at == before {
            self.bump();
        }
        labels
    }

    /// True where labels of a CASE begin: constants, ranges and commas up to a colon.
    fn is_label(&self) -> bool {
        let tokens = self.file.tokens.get(self.at..self.end).unwrap_or_default();
        let mut counted = 0;
        for token in tokens.iter().filter(|t| !matches!(t.kind, Kind::Newline | Kind::Attributes)) {
            counted += 1;
            match token.kind {
                Kind::Colon => return counted > 1,
                Kind::Word if is_reserved(self.text(*token)) => return false,
                Kind::Word
                | Kind::Number
                | Kind::Typed
                | Kind::Text
                | Kind::Local
                | Kind::Symbol
                | Kind::Comma
                | Kind::DotDot => {}
                Kind::Operator if matches!(self.text(*token), "+" | "-" | "*") => {}
                Kind::LeftParen | Kind::RightParen if counted == 1 => {}
                _ => return false,
            }
            if counted > 4096 {
                return false;
            }
        }
        false
    }

    fn for_statement(&mut self) -> Option<StmtKind> {
        let start = self.here();
        self.bump();
        let is_name = self.peek().is_some_and(|t| matches!(t.kind, Kind::Word | Kind::Symbol | Kind::Local));
        if !is_name {
            self.report(start, &messages::EXPECTED, "FOR is followed by a variable: FOR i := 1 TO 10 DO");
            self.skip_statement();
            return None;
        }
        let variable = self.reference();
        if !self.eat(Kind::Assign) {
            let here = self.here();
            self.report(here, &messages::EXPECTED, "FOR is followed by an assignment: FOR i := 1 TO 10 DO");
        }
        let first = self.expression();
        self.word("TO");
        let end = self.expression();
        let step = self.eat_word("BY").then(|| self.expression());
        self.word("DO");
        let body = self.statements(false);
        self.end("END_FOR", start);
        Some(StmtKind::For(Box::new(For { variable, start: first, end, step, body })))
    }

    fn while_statement(&mut self) -> StmtKind {
        let start = self.here();
        self.bump();
        let condition = self.expression();
        self.word("DO");
        let body = self.statements(false);
        self.end("END_WHILE", start);
        StmtKind::While(condition, body)
    }

    fn repeat_statement(&mut self) -> StmtKind {
        let start = self.here();
        self.bump();
        let body = self.statements(false);
        self.word("UNTIL");
        let condition = self.expression();
        self.eat(Kind::Semicolon);
        self.end("END_REPEAT", start);
        StmtKind::Repeat(body, condition)
    }

    /// A word that must stand here.
    fn word(&mut self, word: &str) {
        if self.eat_word(word) {
            return;
        }
        let here = self.here();
        self.report(here, &messages::EXPECTED, format!("{word} is missing"));
        // What is left of the head is skipped, as far as the word or the statement goes.
        while let Some(token) = self.peek() {
            let reserved = token.kind == Kind::Word && is_reserved(self.text(token));
            if self.eat_word(word) || token.kind == Kind::Semicolon || reserved {
                return;
            }
            self.bump();
        }
    }

    /// The word that ends a statement, and its semicolon.
    fn end(&mut self, word: &str, start: Span) {
        if self.eat_word(word) {
            // Siemens' compiler does without this one.
            self.eat(Kind::Semicolon);
            return;
        }
        let message = format!("{word} is missing for the statement that begins here");
        self.report(start, &messages::EXPECTED, message);
    }

    fn semicolon(&mut self) {
        if self.eat(Kind::Semicolon) {
            return;
        }
        let ended = match self.peek() {
            None => true,
            Some(token) if token.kind == Kind::Word => {
                let text = self.text(token);
                let word = |list: &[&str]| list.iter().any(|w| w.eq_ignore_ascii_case(text));
                word(&ENDS) || word(&BEGINS) || self.peek_at(1).is_some_and(|t| t.kind == Kind::Assign)
            }
            Some(_) => self.peek_at(1).is_some_and(|t| t.kind == Kind::Assign),
        };
        let behind = self.behind();
        if ended {
            self.report(behind, &messages::MISSING_SEMICOLON, "a semicolon is missing after this");
            return;
        }
        let here = self.here();
        self.report(here, &messages::MISSING_SEMICOLON, "the statement should end here with a semicolon");
        self.skip_statement();
    }

    /// Behind the next semicolon, or to a word that a statement begins or ends with.
    pub(crate) fn skip_statement(&mut self) {
        while let Some(token) = self.peek() {
            if self.eat(Kind::Semicolon) {
                return;
            }
            let text = self.text(token);
            let word = |list: &[&str]| token.kind == Kind::Word && list.iter().any(|w| w.eq_ignore_ascii_case(text));
            if word(&ENDS) || word(&BEGINS[..5]) {
                return;
            }
            self.bump();
        }
    }
}
