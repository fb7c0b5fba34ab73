//! What the parser finds: blocks with their declarations and statements, operands still as tokens.

use std::ops::Range;
use std::rc::Rc;

use ob1_model::{DataType, Section};

use crate::identifiers::BlockWord;
use crate::mnemonics::Row;
use crate::token::Span;

/// Tokens by index into their file.
pub type Tokens = Range<usize>;

/// How a block is named.
#[derive(Clone, Debug, PartialEq)]
pub enum NameRef {
    /// Kind and number: `FC 9`.
    Absolute(BlockWord, u16),
    /// A symbol, kept without its quotes: `"pump"`.
    Symbol(String),
    /// `pump`: a symbol written without its quotes.
    Bare(String),
}

/// The kind of a block's frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Frame {
    Ob,
    Fc,
    Fb,
    Db,
    Udt,
}

/// A block of a source.
#[derive(Debug)]
pub struct Block {
    pub file: usize,
    pub frame: Frame,
    pub name: NameRef,
    /// The place of its name.
    pub span: Span,
    /// The name of the header: `NAME : xyz`.
    pub header_name: Option<String>,
    /// The function value's type; `None` for `VOID`.
    pub result: Option<Type>,
    /// `S7_Optimized_Access := 'TRUE'`: addresses into it are refused.
    pub optimized: bool,
    /// `CODE_VERSION1`: never a multi-instance, so that its instance begins with the data block in the DI register.
    pub code_version1: bool,
    /// The declarations of `VAR CONSTANT`.
    pub constants: Vec<Declaration>,
    /// Its statements are of another language and left out.
    pub foreign: bool,
    /// Its statements are SCL: their tokens.
    pub scl: Option<Tokens>,
    /// The declaration sections in their order.
    pub sections: Vec<(Section, Vec<Declaration>)>,
    /// The structure of a DB or UDT, or the FB or UDT a DB is made from.
    pub shape: Option<Type>,
    /// `x := 5;` after BEGIN of a DB.
    pub assignments: Vec<Assignment>,
    pub statements: Vec<Statement>,
    /// Those of them that are calls.
    pub(crate) calls: Vec<u32>,
    pub read_only: bool,
    /// `NON_RETAIN` in the head, not behind the word of a section.
    pub non_retain: bool,
}

impl Block {
    /// The name of its header, else its symbol.
    pub fn shown_name(&self) -> Option<String> {
        let symbol = match &self.name {
            NameRef::Symbol(name) | NameRef::Bare(name) => Some(name.clone()),
            NameRef::Absolute(..) => None,
        };
        self.header_name.clone().or(symbol)
    }

    /// The statements that are calls.
    pub(crate) fn calls(&self) -> impl Iterator<Item = &Statement> {
        self.calls.iter().filter_map(|at| self.statements.get(*at as usize))
    }

    /// The declarations of `VAR_INPUT`.
    pub fn inputs(&self) -> impl Iterator<Item = &Declaration> {
        self.sections.iter().filter(|(section, _)| *section == Section::Input).flat_map(|(_, list)| list)
    }
}

/// A type as written.
#[derive(Debug)]
pub struct Type {
    pub kind: TypeKind,
    pub span: Span,
}

#[derive(Debug)]
pub enum TypeKind {
    /// A type with a keyword of its own, STRING with its length included.
    Simple(DataType),
    Array(Vec<(Bound, Bound)>, Box<Type>),
    Struct(Vec<Declaration>),
    /// `STRING[n]` whose length is an expression of constants, in SCL.
    Text(Tokens),
    /// `UDT 1`, `FB 5`, `SFB 4` or `"symbol"`.
    Named(NameRef),
    /// A mistake already reported.
    Bad,
}

/// A bound of an array.
#[derive(Clone, Debug, PartialEq)]
pub enum Bound {
    Number(i32),
    /// A constant, by its name.
    Named(String),
    /// An expression of constants, in SCL.
    Value(Tokens),
}

/// A declaration with its place.
#[derive(Debug)]
pub struct Declaration {
    pub name: String,
    pub span: Span,
    pub ty: Rc<Type>,
    /// `AT x`: it is another view of that variable.
    pub over: Option<String>,
    pub initial: Option<Tokens>,
}

/// An assignment in a data block.
#[derive(Debug)]
pub struct Assignment {
    pub path: Tokens,
    pub value: Tokens,
}

/// A statement, its operand still as tokens.
#[derive(Debug)]
pub struct Statement {
    pub label: Option<usize>,
    /// `None` where the mnemonic is not known (reported), or where only a label stands.
    pub(crate) row: Option<&'static Row>,
    /// The mnemonic, or the label if it is alone.
    pub span: Span,
    pub operand: Tokens,
    pub args: Vec<Actual>,
    /// A mistake in the list of actual parameters is reported: those that are missing are its consequence.
    pub broken_list: bool,
    pub network: u16,
    pub line: u32,
}

/// An actual parameter: `ADR := 0`.
#[derive(Debug)]
pub struct Actual {
    pub name: usize,
    pub value: Tokens,
}
