//! Blocks, calls and the whole program.

use ob1_model::{Area, BitAddr, BlockId, Component, DataType, Interface};

use crate::{Number, Op, Operand, Place};

/// One statement.
#[derive(Clone, Debug, PartialEq)]
pub struct Stmt {
    /// What it does.
    pub op: Op,
    /// Network number, from 1.
    pub network: u16,
    /// Source line, from 1.
    pub line: u32,
}

/// Who is called.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// A block known by number.
    Block(BlockId),
    /// `UC FC [MW 2]`, `UC FB [..]`, or a block given by parameter.
    Indirect(ob1_model::BlockKind, Number),
    /// A multi-instance: `CALL #pump`: the FB and where its instance begins within the caller's.
    Local(BlockId, ob1_model::BitAddr),
}

/// How it is called.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CallMode {
    /// `CALL`: with parameters.
    Call,
    /// `UC`: with the pointers of [`Arg::Raw`], or nothing.
    Unconditional,
    /// `CC`: the same, when RLO = 1.
    Conditional,
}

/// An actual parameter.
#[derive(Clone, Debug, PartialEq)]
pub enum Arg {
    /// Not supplied (allowed for an FB's parameters: the instance keeps its value).
    Open,
    /// A constant of an elementary type, right-aligned in 32 bits.
    Const(u32),
    /// A constant of a composed type (STRING, DATE_AND_TIME, POINTER, ANY), as laid-out bytes. Operands supplied to
    /// POINTER and ANY come as such a constant; so does the actual of an FB's composed in/out, whose instance keeps a
    /// POINTER (`ob1_model::Param::is_pointer`). What is known at run time only comes otherwise: a POINTER or ANY to
    /// instance data is put together in the local data and handed over as an operand, and the POINTER of a composed
    /// in/out is written into the instance before the call, whose argument then is `Open`.
    Bytes(Box<[u8]>),
    /// An operand. M, E, A, L and DBX through the DB register go by reference; fully qualified data operands (`InDb`),
    /// peripheral, indirect and instance operands are copied before and after the call, as STEP 7 does. An operand of a
    /// composed type has the width of a byte and names its first; its length is that of the formal's type.
    Operand(Operand),
    /// A timer, counter or block number.
    Number(Number),
    /// `UC FC 5 { P#M 1.0 }`: one double word of the list that follows the call in machine code: the pointer to an
    /// elementary actual, the pointer to the POINTER or ANY of a composed one, or the number of a timer, counter or
    /// block in the high word. Area V is the caller's local data.
    Raw(u32),
}

/// A call statement.
#[derive(Clone, Debug, PartialEq)]
pub struct Call {
    /// `CALL`, `UC`, `CC`.
    pub mode: CallMode,
    /// Who.
    pub target: Target,
    /// Instance data block of an FB.
    pub instance: Option<Number>,
    /// One entry per formal of the callee's interface, in its order. For `UC`/`CC` of an FC or SFC any number of
    /// [`Arg::Raw`], in the order of [`list_places`](ob1_model::Interface::list_places); else none.
    pub args: Vec<Arg>,
}

/// A block of statements.
#[derive(Clone, Debug, PartialEq)]
pub struct CodeBlock {
    /// Kind and number.
    pub id: BlockId,
    /// The name of its header or symbol, when it has one.
    pub name: Option<String>,
    /// Parameters and variables. `temp_bytes` counts the declared local data, and beyond it what absolute operands
    /// (`LW 20`) reach into.
    pub interface: Interface,
    /// The statements; running past the last one ends the block.
    pub code: Vec<Stmt>,
    /// Index into [`Program::sources`].
    pub source: u32,
}

impl CodeBlock {
    /// Bytes of local data, an even number, that absolute operands (`L 10.0`, `LW 20`) reach into.
    #[must_use]
    pub fn local_bytes(code: &[Stmt]) -> u32 {
        let mut bytes = 0;
        for stmt in code {
            stmt.op.places(&mut |place, width| {
                if let Place::Fixed(Area::Local, at) = place
                    && at.byte() <= BitAddr::MAX_BYTE
                {
                    bytes = bytes.max(at.byte() + width.bytes());
                }
            });
        }
        bytes.next_multiple_of(2)
    }
}

/// What a data block is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataKind {
    /// A global data block.
    Global,
    /// The instance of a function block.
    Instance(BlockId),
}

/// A data block.
#[derive(Clone, Debug, PartialEq)]
pub struct DataBlock {
    /// The number, from 1.
    pub number: u16,
    /// The name of its header or symbol.
    pub name: Option<String>,
    /// Global or instance.
    pub kind: DataKind,
    /// The load values; its length is the data block's length.
    pub bytes: Vec<u8>,
    /// The declarations, composed types whole; [`Component::find`] leads into them, for `DB10.sub[3].name` in tools.
    pub components: Vec<Component>,
    /// `READ_ONLY`.
    pub read_only: bool,
}

/// A name of the symbol table, for tools.
#[derive(Clone, Debug, PartialEq)]
pub struct Symbol {
    /// The name without quotes.
    pub name: String,
    /// What it stands for, as written: `M 1.0`, `DB 10`.
    pub address: String,
    /// Its type, when the table gives one.
    pub ty: Option<DataType>,
}

/// A compiled program.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Program {
    /// Code blocks, any order, each id once.
    pub blocks: Vec<CodeBlock>,
    /// Data blocks, any order, each number once.
    pub data: Vec<DataBlock>,
    /// Symbols.
    pub symbols: Vec<Symbol>,
    /// Names of the source files.
    pub sources: Vec<String>,
}
