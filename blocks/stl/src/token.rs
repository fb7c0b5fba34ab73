//! Tokens of STL source text.

/// A range of bytes in a source's text.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Span {
    pub start: u32,
    pub end: u32,
}

impl Span {
    /// From the start of one to the end of another.
    pub fn to(self, other: Span) -> Span {
        Span { start: self.start, end: other.end.max(self.end) }
    }
}

/// What a token is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A word: mnemonic, keyword, operand (`MW10`), name.
    Word,
    /// A number without sign: `10`, `1.0`, `1.5e-3`, `2#0101`, `16#FF`.
    Number,
    /// A symbol: `"symbol"`, quotes included.
    Symbol,
    /// `#name`, `#"name"`, the sign included.
    Local,
    /// A text: `'text'`, quotes included.
    Text,
    /// A constant with prefix: `W#16#14`, `S5T#2S`, `L#-5`; `B#` alone before `(`.
    Typed,
    /// `P#`; what it points to follows as tokens.
    PointerSign,
    /// `TITLE = ...` up to the end of the line.
    Title,
    /// `{ S7_attr := 'x' }`.
    Attributes,
    /// The sign `:` of declarations and labels.
    Colon,
    /// The assignment sign: `:=`.
    Assign,
    /// The sign `;` that ends a statement.
    Semicolon,
    /// The sign `,` between operands.
    Comma,
    /// An opening parenthesis: `(`.
    LeftParen,
    /// A closing parenthesis: `)`.
    RightParen,
    /// An opening bracket: `[`.
    LeftBracket,
    /// A closing bracket: `]`.
    RightBracket,
    /// A single dot: `.`.
    Dot,
    /// Two dots, of a range: `..`.
    DotDot,
    /// An operator: `= == <> < > <= >= + - * /`; in SCL also `** & ^`.
    Operator,
    /// `=>` of SCL: where an output goes.
    Arrow,
    /// `+=`, `-=`, `*=`, `/=`, `?=` of SCL.
    AssignWith,
    /// `REGION name` or `END_REGION` of SCL, to the end of the line.
    Region,
    /// The end of a line.
    Newline,
    /// Characters that belong to nothing.
    Bad,
}

/// A token with its place.
#[derive(Clone, Copy, Debug)]
pub struct Token {
    pub kind: Kind,
    pub span: Span,
    /// Line in the source, from 1.
    pub line: u32,
    /// White space, or the start of a line, precedes it.
    pub spaced: bool,
}

/// A source's text with its tokens.
#[derive(Debug)]
pub struct File<'s> {
    pub text: &'s str,
    pub tokens: Vec<Token>,
}

impl<'s> File<'s> {
    /// The text of a span.
    pub fn slice(&self, span: Span) -> &'s str {
        self.text.get(span.start as usize..span.end as usize).unwrap_or("")
    }

    /// The line that a span begins in, from 1.
    pub(crate) fn line_of(&self, span: Span) -> u32 {
        self.text.bytes().take(span.start as usize).filter(|byte| *byte == b'\n').count() as u32 + 1
    }

    /// The text of a token.
    pub fn of(&self, token: Token) -> &'s str {
        self.slice(token.span)
    }
}
