//! What front ends share: places in sources, findings, declarations, constants, and what the statements of a program
//! can name. A front end for another language adds its lexical mode, its statements and their way to operations.

use std::collections::BTreeMap;

use ob1_ir::CodeBlock;
use ob1_model::BlockId;

pub use crate::constant::{Constant, Encoded, PointerConstant};
pub use crate::diagnostic::{Sink, USES};
pub use crate::fields::FieldIndex;
pub use crate::fit::same_layout;
pub use crate::identifiers::{BlockWord, Identifier};
pub use crate::initial::write_default;
pub use crate::messages::Code;
pub use crate::numbering::OF_FUNCTIONS;
pub use crate::operand::Resolver;
pub use crate::parse_types::simple_types;
pub use crate::parser::{split_digits, unquote};
pub use crate::path::slice;
pub use crate::reader::Reader;
pub use crate::source::to_byte;
pub use crate::syntax::{Block, Declaration, Frame, NameRef, Tokens, Type, TypeKind};
pub use crate::tia::{called_with, data_types, dtl, same_instance};
pub use crate::token::{File, Kind, Span, Token};
pub use crate::type_words::with_article;
pub use crate::words::Words;
pub use crate::world::{Data, Info, Symbolic, World, called};

/// What a block's statements are compiled with.
#[derive(Debug)]
pub struct Scope<'s> {
    /// The source that the block stands in.
    pub file: &'s File<'s>,
    /// What can be named.
    pub world: &'s World,
    /// Where findings are reported.
    pub sink: &'s mut Sink,
    /// Instance data blocks that calls name and no source declares, with their function block.
    pub wanted: &'s mut BTreeMap<u16, BlockId>,
}

/// Compiles the statements of blocks that are written in SCL.
pub trait Statements: std::fmt::Debug {
    /// A block's operations; `None` when it has a mistake (reported).
    fn compile(&self, id: BlockId, block: &Block, scope: Scope<'_>) -> Option<CodeBlock>;
}
