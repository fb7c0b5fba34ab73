//! A cursor over the tokens of one operand, line ends left out.

use crate::diagnostic::Sink;
use crate::messages::Code;
use crate::syntax::Tokens;
use crate::token::{File, Kind, Span, Token};

/// Reads the tokens of a range.
pub struct Reader<'r, 's> {
    pub index: usize,
    pub file: &'r File<'s>,
    pub sink: &'r mut Sink,
    at: usize,
    end: usize,
    /// The place of the statement, for messages about an empty range.
    whole: Span,
}

impl<'r, 's> Reader<'r, 's> {
    pub fn new(index: usize, file: &'r File<'s>, sink: &'r mut Sink, range: Tokens, whole: Span) -> Self {
        let mut reader = Self { index, file, sink, at: range.start, end: range.end, whole };
        reader.settle();
        reader
    }

    /// Skips line ends and attributes.
    fn settle(&mut self) {
        while self.peek().is_some_and(|t| matches!(t.kind, Kind::Newline | Kind::Attributes)) {
            self.at += 1;
        }
    }

    pub fn peek(&self) -> Option<Token> {
        if self.at < self.end { self.file.tokens.get(self.at).copied() } else { None }
    }

    pub fn peek_kind(&self) -> Option<Kind> {
        self.peek().map(|t| t.kind)
    }

    /// The tokens from the next on.
    pub fn ahead(&self) -> impl Iterator<Item = Token> + use<'_, 'r, 's> {
        self.file.tokens.get(self.at..self.end).unwrap_or_default().iter().copied()
    }

    /// The token after the next.
    pub fn peek_second(&self) -> Option<Token> {
        if self.at + 1 < self.end { self.file.tokens.get(self.at + 1).copied() } else { None }
    }

    pub(crate) fn next(&mut self) -> Option<Token> {
        let token = self.peek()?;
        self.at += 1;
        self.sink.steps += 1;
        self.settle();
        Some(token)
    }

    pub fn eat(&mut self, kind: Kind) -> Option<Token> {
        if self.peek_kind() == Some(kind) { self.next() } else { None }
    }

    pub fn text(&self, token: Token) -> &'s str {
        self.file.of(token)
    }

    pub fn is_empty(&self) -> bool {
        self.peek().is_none()
    }

    /// The place of the next token, or of the statement at the end.
    pub fn here(&self) -> Span {
        self.peek().map_or(self.whole, |t| t.span)
    }

    /// From the next token to the last.
    pub fn rest(&self) -> Span {
        match (self.peek(), self.end.checked_sub(1).and_then(|e| self.file.tokens.get(e))) {
            (Some(first), Some(last)) => first.span.to(last.span),
            _ => self.whole,
        }
    }

    /// `4.8` where `4,8` stands here.
    fn decimal_comma(&self) -> Option<String> {
        let at = |at: usize| self.file.tokens.get(at).copied();
        let comma = self.peek().filter(|token| token.kind == Kind::Comma)?;
        let here = self.file.tokens.iter().position(|token| token.span == comma.span)?;
        let (before, behind) = (at(here.checked_sub(1)?)?, at(here + 1)?);
        let joined = before.span.end == comma.span.start && behind.span.start == comma.span.end;
        let numbers = before.kind == Kind::Number && behind.kind == Kind::Number;
        (joined && numbers).then(|| format!("{}.{}", self.text(before), self.text(behind)))
    }

    /// The text of a span.
    pub(crate) fn slice(&self, span: Span) -> &str {
        self.file.slice(span)
    }

    pub fn report(&mut self, span: Span, code: &'static Code, message: impl Into<String>) {
        self.sink.report(self.index, span, code, message);
    }

    /// Reports what is left, unless it has been reported before; true when nothing is left.
    pub fn finish(&mut self, code: &'static Code) -> bool {
        let Some(token) = self.peek() else { return true };
        if token.kind == Kind::Bad {
            return false;
        }
        let text: String = self.text(token).chars().take(32).collect();
        let span = self.rest();
        let message = format!("{text} does not belong here");
        match self.decimal_comma() {
            Some(number) => {
                let remedy = format!("STL writes a decimal point: {number}.");
                self.sink.report_with(self.index, span, code, message, remedy);
            }
            None => self.report(span, code, message),
        }
        false
    }
}
