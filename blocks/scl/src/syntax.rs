//! Statements and expressions as written.

use ob1_ir::{AccuOp, Compare, Logic};

use ob1_stl::front::{Span, Token};

/// A statement with its place.
#[derive(Debug)]
pub(crate) struct Stmt {
    pub(crate) kind: StmtKind,
    pub(crate) span: Span,
    pub(crate) line: u32,
    /// It has a mistake, which is reported.
    pub(crate) reported: bool,
}

#[derive(Debug)]
pub(crate) enum StmtKind {
    /// `x := e;`
    Assign(Ref, Expr),
    /// `f(a := 1);`
    Call(Ref),
    /// Conditions with what follows THEN, and what follows ELSE.
    If(Vec<(Expr, Vec<Stmt>)>, Vec<Stmt>),
    Case(Expr, Vec<(Vec<Label>, Vec<Stmt>)>, Vec<Stmt>),
    For(Box<For>),
    While(Expr, Vec<Stmt>),
    Repeat(Vec<Stmt>, Expr),
    Continue,
    Exit,
    Return,
    Goto(Token),
    Label(Token),
}

#[derive(Debug)]
pub(crate) struct For {
    pub(crate) variable: Ref,
    pub(crate) start: Expr,
    pub(crate) end: Expr,
    pub(crate) step: Option<Expr>,
    pub(crate) body: Vec<Stmt>,
}

/// One value or a range of a CASE.
#[derive(Debug)]
pub(crate) struct Label {
    pub(crate) low: Expr,
    pub(crate) high: Option<Expr>,
}

#[derive(Clone, Debug)]
pub(crate) struct Expr {
    pub(crate) kind: ExprKind,
    pub(crate) span: Span,
}

#[derive(Clone, Debug)]
pub(crate) enum ExprKind {
    /// A constant that is one token.
    Constant(Token),
    /// A constant of several tokens, by their indices: `P#DB10.DBX0.0 BYTE 4`, `B#(1, 2)`.
    Tokens(std::ops::Range<usize>),
    Ref(Ref),
    Not(Box<Expr>),
    Negate(Box<Expr>),
    Binary(Operator, Box<Expr>, Box<Expr>),
    /// A mistake already reported.
    Bad,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Operator {
    Logic(Logic),
    Compare(Compare),
    Arithmetic(AccuOp),
    /// A division of whole numbers.
    Div,
    Power,
}

impl Operator {
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Logic(Logic::And) => "AND",
            Self::Logic(Logic::Or) => "OR",
            Self::Logic(Logic::Xor) => "XOR",
            Self::Compare(Compare::Equal) => "=",
            Self::Compare(relation) => relation.name(),
            Self::Arithmetic(op) => op.name(),
            Self::Div => "DIV",
            Self::Power => "**",
        }
    }
}

/// A variable, address or call: a name and what follows it.
#[derive(Clone, Debug)]
pub(crate) struct Ref {
    pub(crate) first: Token,
    pub(crate) steps: Vec<Step>,
    pub(crate) span: Span,
}

#[derive(Clone, Debug)]
pub(crate) enum Step {
    /// `.name`, `.5`.
    Dot(Token),
    /// A number apart: `MW 20`.
    Number(Token),
    Index(Vec<Expr>),
    Call(Vec<Arg>),
    /// `:P`.
    Periphery,
    /// `^`.
    Follow,
}

/// An actual parameter.
#[derive(Clone, Debug)]
pub(crate) struct Arg {
    pub(crate) name: Option<Token>,
    /// Written with `=>`.
    pub(crate) out: bool,
    pub(crate) value: Option<Expr>,
    pub(crate) span: Span,
}
