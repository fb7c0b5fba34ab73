//! Expressions by precedence, and references with their steps.

use ob1_ir::{AccuOp, Compare, Logic};
use ob1_stl::front::{Kind, Token};

use crate::cursor::{Cursor, DEPTH};
use crate::messages;
use crate::syntax::{Arg, Expr, ExprKind, Operator, Ref, Step};

/// Words of the grammar, which no expression begins with.
#[rustfmt::skip]
pub(crate) const RESERVED: [&str; 38] = [
    "IF", "THEN", "ELSE", "ELSIF", "END_IF", "CASE", "OF", "END_CASE",
    "FOR", "TO", "BY", "DO", "END_FOR", "WHILE", "END_WHILE", "REPEAT", "UNTIL", "END_REPEAT",
    "EXIT", "CONTINUE", "RETURN", "GOTO",
    "BEGIN", "VAR", "VAR_INPUT", "VAR_OUTPUT", "VAR_IN_OUT", "VAR_TEMP", "END_VAR", "CONST", "END_CONST", "END_STRUCT",
    "AND", "OR", "XOR", "NOT", "MOD", "DIV",
];

pub(crate) fn is_reserved(word: &str) -> bool {
    RESERVED.iter().any(|reserved| reserved.eq_ignore_ascii_case(word))
}

/// The operators of each level, the weakest first.
const LEVELS: [&[(&str, Operator)]; 7] = [
    &[("OR", Operator::Logic(Logic::Or))],
    &[("XOR", Operator::Logic(Logic::Xor))],
    &[("AND", Operator::Logic(Logic::And)), ("&", Operator::Logic(Logic::And))],
    &[("=", Operator::Compare(Compare::Equal)), ("<>", Operator::Compare(Compare::NotEqual))],
    &[
        ("<=", Operator::Compare(Compare::LessEqual)),
        (">=", Operator::Compare(Compare::GreaterEqual)),
        ("<", Operator::Compare(Compare::Less)),
        (">", Operator::Compare(Compare::Greater)),
    ],
    &[("+", Operator::Arithmetic(AccuOp::Add)), ("-", Operator::Arithmetic(AccuOp::Sub))],
    &[
        ("*", Operator::Arithmetic(AccuOp::Mul)),
        ("/", Operator::Arithmetic(AccuOp::Div)),
        ("DIV", Operator::Div),
        ("MOD", Operator::Arithmetic(AccuOp::Mod)),
    ],
];

impl Cursor<'_, '_> {
    pub(crate) fn expression(&mut self) -> Expr {
        let span = self.here();
        self.depth += 1;
        let expr = if self.depth > DEPTH {
            self.report(span, &messages::DEPTH, format!("brackets are nested more than {DEPTH} deep"));
            self.skip_statement();
            Expr { kind: ExprKind::Bad, span }
        } else {
            self.level(0)
        };
        self.depth -= 1;
        expr
    }

    fn level(&mut self, level: usize) -> Expr {
        let Some(operators) = LEVELS.get(level) else { return self.unary() };
        let mut left = self.level(level + 1);
        while let Some(operator) = self.operator(operators) {
            let right = self.level(level + 1);
            let span = left.span.to(right.span);
            left = Expr { kind: ExprKind::Binary(operator, Box::new(left), Box::new(right)), span };
        }
        left
    }

    fn operator(&mut self, known: &[(&str, Operator)]) -> Option<Operator> {
        let token = self.peek().filter(|t| matches!(t.kind, Kind::Operator | Kind::Word))?;
        let text = self.text(token);
        let (_, operator) = known.iter().find(|(word, _)| word.eq_ignore_ascii_case(text))?;
        self.bump();
        Some(*operator)
    }

    fn unary(&mut self) -> Expr {
        let span = self.here();
        // Signs in a row are counted, so that they do not nest.
        let mut signs = Vec::new();
        while let Some(token) = self.peek() {
            match self.text(token) {
                "+" if token.kind == Kind::Operator => {}
                "-" if token.kind == Kind::Operator => signs.push(true),
                word if token.kind == Kind::Word && word.eq_ignore_ascii_case("NOT") => signs.push(false),
                _ => break,
            }
            if signs.len() > DEPTH as usize {
                self.report(span, &messages::DEPTH, "there are too many signs in a row");
                signs.clear();
            }
            self.bump();
        }
        let mut expr = self.power();
        for negate in signs.into_iter().rev() {
            let whole = span.to(expr.span);
            let inner = Box::new(expr);
            expr = Expr { kind: if negate { ExprKind::Negate(inner) } else { ExprKind::Not(inner) }, span: whole };
        }
        expr
    }

    fn power(&mut self) -> Expr {
        let mut left = self.primary();
        while self.peek().is_some_and(|t| t.kind == Kind::Operator && self.text(t) == "**") {
            self.bump();
            let mut negate = false;
            let sign = self.here();
            while let Some(token) = self.peek().filter(|t| t.kind == Kind::Operator) {
                match self.text(token) {
                    "-" => negate = !negate,
                    "+" => {}
                    _ => break,
                }
                self.bump();
            }
            let mut right = self.primary();
            if negate {
                let span = sign.to(right.span);
                right = Expr { kind: ExprKind::Negate(Box::new(right)), span };
            }
            let span = left.span.to(right.span);
            left = Expr { kind: ExprKind::Binary(Operator::Power, Box::new(left), Box::new(right)), span };
        }
        left
    }

    fn primary(&mut self) -> Expr {
        let span = self.here();
        let Some(token) = self.peek() else { return self.no_value() };
        match token.kind {
            Kind::LeftParen => {
                self.bump();
                let mut inner = self.expression();
                if !self.eat(Kind::RightParen) && !matches!(inner.kind, ExprKind::Bad) {
                    let behind = self.behind();
                    self.report(behind, &messages::EXPECTED, "the bracket is not closed with )");
                    inner.kind = ExprKind::Bad;
                }
                inner.span = span.to(self.behind());
                inner
            }
            Kind::Number | Kind::Text => {
                self.bump();
                Expr { kind: ExprKind::Constant(token), span }
            }
            Kind::Typed if self.text(token).ends_with('#') => self.tokens(Kind::RightParen),
            Kind::Typed => {
                self.bump();
                Expr { kind: ExprKind::Constant(token), span }
            }
            Kind::PointerSign => self.pointer(),
            Kind::Word if self.is_truth(token) => {
                self.bump();
                Expr { kind: ExprKind::Constant(token), span }
            }
            Kind::Word if is_reserved(self.text(token)) => self.no_value(),
            Kind::Word | Kind::Symbol | Kind::Local => {
                let reference = self.reference();
                let span = reference.span;
                Expr { kind: ExprKind::Ref(reference), span }
            }
            Kind::Bad => {
                self.bump();
                Expr { kind: ExprKind::Bad, span }
            }
            _ => self.no_value(),
        }
    }

    fn is_truth(&self, token: Token) -> bool {
        let text = self.text(token);
        text.eq_ignore_ascii_case("TRUE") || text.eq_ignore_ascii_case("FALSE")
    }

    fn no_value(&mut self) -> Expr {
        let span = self.here();
        self.report(span, &messages::EXPRESSION, "a value is expected here");
        Expr { kind: ExprKind::Bad, span }
    }

    /// Tokens up to one of a kind, that one included.
    fn tokens(&mut self, last: Kind) -> Expr {
        let (from, span) = (self.at, self.here());
        while self.kind().is_some_and(|kind| kind != last && kind != Kind::Semicolon) {
            self.bump();
        }
        self.eat(last);
        Expr { kind: ExprKind::Tokens(from..self.at), span: span.to(self.behind()) }
    }

    /// `P#DB10.DBX0.0 BYTE 4`.
    fn pointer(&mut self) -> Expr {
        let (from, span) = (self.at, self.here());
        self.bump();
        loop {
            let goes_on = match self.peek() {
                Some(t) if t.kind == Kind::Word => !is_reserved(self.text(t)),
                Some(t) => matches!(t.kind, Kind::Number | Kind::Dot | Kind::Local | Kind::Symbol),
                None => false,
            };
            if !goes_on {
                return Expr { kind: ExprKind::Tokens(from..self.at), span: span.to(self.behind()) };
            }
            self.bump();
        }
    }

    /// A name with its steps. The next token is a name.
    pub(crate) fn reference(&mut self) -> Ref {
        let span = self.here();
        let first = self.peek().unwrap_or(Token { kind: Kind::Bad, span, line: 0, spaced: true });
        self.bump();
        let mut steps = Vec::new();
        while let Some(token) = self.peek() {
            match token.kind {
                Kind::Dot => {
                    self.bump();
                    match self
                        .peek()
                        .filter(|t| matches!(t.kind, Kind::Word | Kind::Symbol | Kind::Number | Kind::Local))
                    {
                        Some(name) => {
                            self.bump();
                            steps.push(Step::Dot(name));
                        }
                        None => {
                            let here = self.here();
                            self.report(here, &messages::EXPECTED, "a name is missing after the point");
                            break;
                        }
                    }
                }
                Kind::Number if first.kind == Kind::Word && steps.iter().all(|s| matches!(s, Step::Dot(_))) => {
                    self.bump();
                    steps.push(Step::Number(token));
                }
                Kind::LeftBracket => {
                    self.bump();
                    steps.push(Step::Index(self.indices()));
                }
                Kind::LeftParen => {
                    self.bump();
                    steps.push(Step::Call(self.arguments()));
                }
                Kind::Operator if self.text(token) == "^" => {
                    self.bump();
                    steps.push(Step::Follow);
                }
                Kind::Colon if self.is_periphery() => {
                    self.bump();
                    self.bump();
                    steps.push(Step::Periphery);
                }
                _ => break,
            }
        }
        Ref { first, steps, span: span.to(self.behind()) }
    }

    fn is_periphery(&self) -> bool {
        let p = self.peek_at(1).filter(|t| t.kind == Kind::Word && !t.spaced);
        p.is_some_and(|t| self.text(t).eq_ignore_ascii_case("P"))
    }

    fn indices(&mut self) -> Vec<Expr> {
        let mut out = vec![self.expression()];
        while self.eat(Kind::Comma) {
            out.push(self.expression());
        }
        if !self.eat(Kind::RightBracket) {
            let here = self.here();
            self.report(here, &messages::EXPECTED, "the index is not closed with ]");
        }
        out
    }

    fn arguments(&mut self) -> Vec<Arg> {
        let mut out = Vec::new();
        while self.kind().is_some_and(|kind| !matches!(kind, Kind::RightParen | Kind::Semicolon)) {
            let before = self.at;
            out.push(self.argument());
            if !self.eat(Kind::Comma) && self.kind() != Some(Kind::RightParen) {
                // `f(a := 1 b := 2)`: the comma is missing.
                let named = self.peek_at(1).is_some_and(|t| matches!(t.kind, Kind::Assign | Kind::Arrow));
                if !named || self.at == before {
                    break;
                }
                let behind = self.behind();
                self.report(behind, &messages::EXPECTED, "a comma is missing between two parameters");
            }
        }
        if !self.eat(Kind::RightParen) {
            let here = self.here();
            self.report(here, &messages::EXPECTED, "the list of parameters is not closed with )");
        }
        out
    }

    fn argument(&mut self) -> Arg {
        let span = self.here();
        let sign = self.peek_at(1).filter(|t| matches!(t.kind, Kind::Assign | Kind::Arrow));
        let name = self.peek().filter(|t| sign.is_some() && matches!(t.kind, Kind::Word | Kind::Symbol | Kind::Local));
        let (Some(name), Some(sign)) = (name, sign) else {
            return Arg { name: None, out: false, value: Some(self.expression()), span };
        };
        self.bump();
        self.bump();
        let out = sign.kind == Kind::Arrow;
        let value = match self.kind() {
            Some(Kind::Comma | Kind::RightParen) => None,
            _ => Some(self.expression()),
        };
        Arg { name: Some(name), out, value, span }
    }
}
