//! What one block's statements are checked with.

use std::collections::BTreeSet;

use ob1_model::{BlockId, DataType, Param, Section};
use ob1_stl::front::{
    Block, Code, Constant, File, Info, NameRef, Reader, Resolver, Sink, Span, Token, Words, World, unquote,
};

use crate::messages;
use crate::options::Options;
use crate::syntax::{Expr, ExprKind};
use crate::tree::{Kind, Typed};
use crate::types::{BOOL, DWORD, INT};

pub(crate) struct Checker<'c> {
    pub(crate) id: BlockId,
    pub(crate) block: &'c Block,
    pub(crate) info: &'c Info,
    pub(crate) file: &'c File<'c>,
    pub(crate) world: &'c World,
    pub(crate) sink: &'c mut Sink,
    pub(crate) words: &'c Words,
    pub(crate) options: Options,
    /// Instance data blocks that calls name and no source declares, with their function block.
    pub(crate) wanted: &'c mut std::collections::BTreeMap<u16, BlockId>,
    /// The line of the statement that is checked.
    pub(crate) line: u32,
    /// Declarations that something was written to, by index.
    pub(crate) written: BTreeSet<usize>,
    /// Temporaries that are read, with the first place.
    pub(crate) read: std::collections::BTreeMap<usize, Span>,
}

impl<'c> Checker<'c> {
    pub(crate) fn report(&mut self, span: Span, code: &'static Code, message: impl Into<String>) {
        self.sink.report(self.block.file, span, code, message);
    }

    pub(crate) fn report_with(&mut self, span: Span, code: &'static Code, message: impl Into<String>, remedy: String) {
        self.sink.report_with(self.block.file, span, code, message, remedy);
    }

    /// The line in which a part of a statement begins.
    pub(crate) fn line_of(&self, span: Span) -> u32 {
        let at = self.file.tokens.partition_point(|token| token.span.start < span.start);
        self.file.tokens.get(at).map_or(self.line, |token| token.line)
    }

    pub(crate) fn text(&self, token: Token) -> &'c str {
        self.file.of(token)
    }

    /// A name without `#` and quotes.
    pub(crate) fn name(&self, token: Token) -> &'c str {
        unquote(self.file.of(token))
    }

    /// What stands in the place of a value with a mistake that is reported.
    pub(crate) const fn bad(&self, span: Span) -> Typed<'c> {
        Typed::new(Kind::Bad, &INT, span)
    }

    /// The declaration of the function's result, with its index among all.
    pub(crate) fn result(&self) -> Option<(usize, &'c Param)> {
        self.info.interface.params.iter().enumerate().find(|(_, p)| p.section == Section::Return)
    }

    /// True for the name of the block itself.
    pub(crate) fn is_own_name(&self, name: &str) -> bool {
        match &self.block.name {
            NameRef::Symbol(own) | NameRef::Bare(own) if own.eq_ignore_ascii_case(name) => true,
            _ => {
                let symbol = match self.world.symbol(name) {
                    Some(ob1_stl::front::Symbolic::Block(word, number)) => {
                        word.kind().map(|k| BlockId::new(k, *number))
                    }
                    _ => None,
                };
                let (letters, digits) = ob1_stl::front::split_digits(name);
                let absolute = ob1_stl::front::BlockWord::parse(letters).and_then(|w| w.kind());
                let absolute = absolute.and_then(|kind| Some(BlockId::new(kind, digits.parse().ok()?)));
                symbol == Some(self.id) || absolute == Some(self.id)
            }
        }
    }

    /// A constant of one or several tokens.
    pub(crate) fn constant(&mut self, expr: &Expr) -> Option<Constant> {
        let range = match &expr.kind {
            ExprKind::Constant(token) => {
                let at = self.file.tokens.partition_point(|t| t.span.start < token.span.start);
                at..at + 1
            }
            ExprKind::Tokens(range) => range.clone(),
            _ => return None,
        };
        let resolver = Resolver::new(self.world, self.words, Some((self.id.kind, self.info)));
        let mut reader = Reader::new(self.block.file, self.file, self.sink, range, expr.span);
        let constant = resolver.constant(&mut reader)?;
        reader.finish(&messages::EXPRESSION).then_some(constant)
    }

    /// The type that a constant has of itself.
    pub(crate) fn own_type(constant: &Constant) -> &'static DataType {
        use crate::types::{BYTE, CHAR, DATE, DINT, DT, REAL, S5TIME, STRING, TIME, TOD, WORD};
        match constant {
            Constant::Bool(_) => &BOOL,
            Constant::Integer(v) if i16::try_from(*v).is_ok() => &INT,
            Constant::Integer(_) | Constant::DInt(_) => &DINT,
            Constant::Bits(_, 8) => &BYTE,
            Constant::Bits(_, 16) => &WORD,
            Constant::Bits(..) => &DWORD,
            Constant::Radix(v) if i16::try_from(*v).is_ok() => &INT,
            Constant::Radix(v) if u16::try_from(*v).is_ok() => &WORD,
            Constant::Radix(_) => &DWORD,
            Constant::Count(_) => &WORD,
            Constant::Real(_) => &REAL,
            Constant::S5Time(_) => &S5TIME,
            Constant::Time(_) => &TIME,
            Constant::Date(_) => &DATE,
            Constant::TimeOfDay(_) => &TOD,
            Constant::DateTime(_) => &DT,
            Constant::Text(text) if text.len() == 1 => &CHAR,
            Constant::Text(_) => &STRING,
            Constant::Pointer(p) if p.any.is_some() => &crate::types::ANY,
            Constant::Pointer(p) if p.db == 0 => &DWORD,
            Constant::Pointer(_) => &crate::types::POINTER,
            Constant::Dtl(_) | Constant::ToParam { .. } => &INT,
        }
    }
}
