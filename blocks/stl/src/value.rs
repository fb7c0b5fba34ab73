//! What an operand is, once it has been read.

use ob1_ir::{AddressRegister, DbRegister, Number, Operand, StatusBit, Width};
use ob1_model::{BitAddr, BlockId, DataType};

use crate::constant::Constant;
use crate::identifiers::BlockWord;
use crate::type_words::with_article;

/// An operand, once its tokens were read.
#[derive(Clone, Debug)]
pub(crate) enum Value<'w> {
    /// A place in memory; `ty` where a declaration or the symbol table gives one. A composed variable has the width of
    /// a byte.
    Memory {
        operand: Operand,
        ty: Option<&'w DataType>,
    },
    Timer(Number),
    Counter(Number),
    Block(BlockWord, Number),
    Status(StatusBit),
    StatusWord,
    DbLength(DbRegister),
    DbNumber(DbRegister),
    Register(AddressRegister),
    Constant(Constant),
    /// An element of an array whose index is known at run time only: the operand is that of the first element, `terms`
    /// lead from there on. `through`: the operand is reached by the POINTER at this address of the instance.
    Indexed {
        operand: Operand,
        through: Option<BitAddr>,
        terms: Vec<Term>,
        ty: &'w DataType,
    },
    /// A multi-instance: its FB and where it lies within the caller's instance.
    Instance(BlockId, BitAddr),
    /// A composed in/out of a function block, or a component of one. The instance keeps a POINTER to it: the operand
    /// is `[AR1,P#offset]` once the data block is open and AR1 loaded ([`crate::expand`]).
    Through {
        /// Where the POINTER lies in the instance.
        pointer: BitAddr,
        operand: Operand,
        ty: &'w DataType,
        /// The parameter itself, not a component.
        whole: bool,
    },
}

impl Value<'_> {
    /// What it is, for messages.
    pub(crate) fn describe(&self) -> String {
        match self {
            Value::Memory { ty: Some(ty), .. } | Value::Through { ty, .. } | Value::Indexed { ty, .. } => {
                with_article(ty.name())
            }
            Value::Memory { operand, .. } => match operand.width {
                Width::Bit => "a bit".into(),
                Width::Byte => "a byte".into(),
                Width::Word => "a word".into(),
                Width::DWord => "a double word".into(),
            },
            Value::Timer(_) => "a timer".into(),
            Value::Counter(_) => "a counter".into(),
            Value::Block(word, _) => format!("a block ({})", word.name()),
            Value::Status(_) => "a status bit".into(),
            Value::StatusWord => "the status word".into(),
            Value::DbLength(_) | Value::DbNumber(_) => "a length or number of a data block".into(),
            Value::Register(_) => "an address register".into(),
            Value::Constant(_) => "a constant".into(),
            Value::Instance(fb, _) => format!("an instance of {fb}"),
        }
    }
}

/// An index that is known at run time only: `(index - low) * stride` bits are added to the address.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Term {
    pub(crate) index: Operand,
    /// It is a signed integer of 16 bits.
    pub(crate) int: bool,
    pub(crate) low: i32,
    pub(crate) stride: u32,
}
