//! The tokens of a block's statements, line ends and attributes left out.

use ob1_stl::front::{Code, File, Kind, Sink, Span, Token, Tokens};

/// Statements and brackets within each other.
pub(crate) const DEPTH: u32 = 64;

pub(crate) struct Cursor<'c, 's> {
    pub(crate) index: usize,
    pub(crate) file: &'c File<'s>,
    pub(crate) sink: &'c mut Sink,
    /// Indices of the tokens that count.
    pub(crate) at: usize,
    pub(crate) end: usize,
    pub(crate) depth: u32,
    /// The end of the last token that was read, for messages about something missing behind it.
    last: Span,
    /// Tokens that are none, which the lexer has reported.
    bad: u64,
}

impl<'c, 's> Cursor<'c, 's> {
    pub(crate) fn new(index: usize, file: &'c File<'s>, sink: &'c mut Sink, range: Tokens) -> Self {
        let mut cursor =
            Self { index, file, sink, at: range.start, end: range.end, depth: 0, last: Span::default(), bad: 0 };
        cursor.settle();
        cursor
    }

    fn settle(&mut self) {
        while self.at < self.end
            && self.file.tokens.get(self.at).is_some_and(|t| matches!(t.kind, Kind::Newline | Kind::Attributes))
        {
            self.at += 1;
        }
    }

    pub(crate) fn peek(&self) -> Option<Token> {
        if self.at < self.end { self.file.tokens.get(self.at).copied() } else { None }
    }

    /// The token `ahead` after the next.
    pub(crate) fn peek_at(&self, ahead: usize) -> Option<Token> {
        let tokens = self.file.tokens.get(self.at..self.end)?;
        tokens.iter().filter(|t| !matches!(t.kind, Kind::Newline | Kind::Attributes)).nth(ahead).copied()
    }

    pub(crate) fn kind(&self) -> Option<Kind> {
        self.peek().map(|t| t.kind)
    }

    pub(crate) fn bump(&mut self) {
        if let Some(token) = self.peek() {
            self.last = token.span;
            self.bad += u64::from(token.kind == Kind::Bad);
        }
        self.at += 1;
        self.sink.steps += 1;
        self.settle();
    }

    pub(crate) fn eat(&mut self, kind: Kind) -> bool {
        let found = self.kind() == Some(kind);
        if found {
            self.bump();
        }
        found
    }

    pub(crate) fn text(&self, token: Token) -> &'s str {
        self.file.of(token)
    }

    /// True when the next token is this word.
    pub(crate) fn is_word(&self, word: &str) -> bool {
        self.peek().is_some_and(|t| t.kind == Kind::Word && self.text(t).eq_ignore_ascii_case(word))
    }

    pub(crate) fn eat_word(&mut self, word: &str) -> bool {
        let found = self.is_word(word);
        if found {
            self.bump();
        }
        found
    }

    /// The place of the next token, or of the end.
    pub(crate) fn here(&self) -> Span {
        self.peek().map_or(self.last, |t| t.span)
    }

    /// Behind the last token.
    pub(crate) fn behind(&self) -> Span {
        self.last
    }

    /// Grows with each error that was reported about what was read.
    pub(crate) const fn said(&self) -> u64 {
        self.sink.said() + self.bad
    }

    pub(crate) fn report(&mut self, span: Span, code: &'static Code, message: impl Into<String>) {
        self.sink.report(self.index, span, code, message);
    }
}
