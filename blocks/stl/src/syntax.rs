//! What the parser finds: blocks with their declarations and statements, operands still as tokens.

use std::ops::Range;
use std::rc::Rc;

use ob1_model::{DataType, Section};

use crate::identifiers::BlockWord;
use crate::mnemonics::Row;
use crate::token::Span;

/// Tokens by index into their file.
pub(crate) type Tokens = Range<usize>;

/// How a block is named.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum NameRef {
    /// `FC 9`.
    Absolute(BlockWord, u16),
    /// `"pump"`, without quotes.
    Symbol(String),
    /// `pump`: a symbol written without its quotes.
    Bare(String),
}

/// The kind of a block's frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Frame {
    Ob,
    Fc,
    Fb,
    Db,
    Udt,
}

/// A block of a source.
#[derive(Debug)]
pub(crate) struct Block {
    pub(crate) file: usize,
    pub(crate) frame: Frame,
    pub(crate) name: NameRef,
    /// The place of its name.
    pub(crate) span: Span,
    /// `NAME : xyz`.
    pub(crate) header_name: Option<String>,
    /// The function value's type; `None` for `VOID`.
    pub(crate) result: Option<Type>,
    /// `S7_Optimized_Access := 'TRUE'`: addresses into it are refused.
    pub(crate) optimized: bool,
    /// `CODE_VERSION1`: never a multi-instance, so that its instance begins with the data block in the DI register.
    pub(crate) code_version1: bool,
    /// `VAR CONSTANT`.
    pub(crate) constants: Vec<Declaration>,
    /// Its statements are of another language and left out.
    pub(crate) foreign: bool,
    /// The declaration sections in their order.
    pub(crate) sections: Vec<(Section, Vec<Declaration>)>,
    /// The structure of a DB or UDT, or the FB or UDT a DB is made from.
    pub(crate) shape: Option<Type>,
    /// `x := 5;` after BEGIN of a DB.
    pub(crate) assignments: Vec<Assignment>,
    pub(crate) statements: Vec<Statement>,
    pub(crate) read_only: bool,
    /// `NON_RETAIN` in the head, not behind the word of a section.
    pub(crate) non_retain: bool,
}

impl Block {
    /// The name of its header, else its symbol.
    pub(crate) fn shown_name(&self) -> Option<String> {
        let symbol = match &self.name {
            NameRef::Symbol(name) | NameRef::Bare(name) => Some(name.clone()),
            NameRef::Absolute(..) => None,
        };
        self.header_name.clone().or(symbol)
    }

    /// The declarations of `VAR_INPUT`.
    pub(crate) fn inputs(&self) -> impl Iterator<Item = &Declaration> {
        self.sections.iter().filter(|(section, _)| *section == Section::Input).flat_map(|(_, list)| list)
    }
}

/// A type as written.
#[derive(Debug)]
pub(crate) struct Type {
    pub(crate) kind: TypeKind,
    pub(crate) span: Span,
}

#[derive(Debug)]
pub(crate) enum TypeKind {
    /// A type with a keyword of its own, STRING with its length included.
    Simple(DataType),
    Array(Vec<(Bound, Bound)>, Box<Type>),
    Struct(Vec<Declaration>),
    /// `UDT 1`, `FB 5`, `SFB 4` or `"symbol"`.
    Named(NameRef),
    /// A mistake already reported.
    Bad,
}

/// A bound of an array.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Bound {
    Number(i32),
    /// A constant, by its name.
    Named(String),
}

/// A declaration.
#[derive(Debug)]
pub(crate) struct Declaration {
    pub(crate) name: String,
    pub(crate) span: Span,
    pub(crate) ty: Rc<Type>,
    /// `AT x`: it is another view of that variable.
    pub(crate) over: Option<String>,
    pub(crate) initial: Option<Tokens>,
}

/// An assignment in a data block.
#[derive(Debug)]
pub(crate) struct Assignment {
    pub(crate) path: Tokens,
    pub(crate) value: Tokens,
}

/// A statement.
#[derive(Debug)]
pub(crate) struct Statement {
    pub(crate) label: Option<usize>,
    /// `None` where the mnemonic is not known (reported), or where only a label stands.
    pub(crate) row: Option<&'static Row>,
    /// The mnemonic, or the label if it is alone.
    pub(crate) span: Span,
    pub(crate) operand: Tokens,
    pub(crate) args: Vec<Actual>,
    /// A mistake in the list of actual parameters is reported: those that are missing are its consequence.
    pub(crate) broken_list: bool,
    pub(crate) network: u16,
    pub(crate) line: u32,
}

/// An actual parameter: `ADR := 0`.
#[derive(Debug)]
pub(crate) struct Actual {
    pub(crate) name: usize,
    pub(crate) value: Tokens,
}
