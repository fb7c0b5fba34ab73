//! Blocks and the whole program.

use ob1_model::{Area, BitAddr, BlockId, Component, DataType, Interface, Layout};

use crate::call::Arg;
use crate::op::Op;
use crate::place::Place;

/// A statement with its place in the source.
#[derive(Clone, Debug, PartialEq, Hash)]
pub struct Stmt {
    /// The operation that it does.
    pub op: Op,
    /// Network number, from 1.
    pub network: u16,
    /// Source line, from 1.
    pub line: u32,
}

/// A block of statements.
#[derive(Clone, Debug, PartialEq)]
pub struct CodeBlock {
    /// Kind and number of the block.
    pub id: BlockId,
    /// The name of its header or symbol, when it has one.
    pub name: Option<String>,
    /// Parameters and variables. `temp_bytes` counts the declared local data, and beyond it what absolute operands
    /// (`LW 20`) reach into.
    pub interface: Interface,
    /// The statements; running past the last one ends the block.
    pub code: Vec<Stmt>,
    /// Its source: an index into [`Program::sources`].
    pub source: u32,
}

impl CodeBlock {
    /// The same statements and declarations: names and lines of the source do not count.
    pub fn means(&self, other: &Self) -> bool {
        self.id == other.id
            && self.interface == other.interface
            && self.code.len() == other.code.len()
            && self.code.iter().zip(&other.code).all(|(one, two)| (&one.op, one.network) == (&two.op, two.network))
    }

    /// Bytes of local data, an even number, that absolute operands (`L 10.0`, `LW 20`) and the pointers behind a
    /// `UC` or `CC` (`P#V 20.0`) reach into. What such a pointer leads to is at most an ANY.
    pub fn local_bytes(code: &[Stmt]) -> u32 {
        let any = Layout::bits(&DataType::Any).div_ceil(8);
        let mut bytes = 0;
        for stmt in code {
            if let Op::Call(call) = &stmt.op {
                for arg in &call.args {
                    if let Arg::Raw(pointer) = arg
                        && Area::from_pointer_code((pointer >> 24) as u8) == Some(Area::PreviousLocal)
                    {
                        bytes = bytes.max(BitAddr::of_pointer(*pointer).byte() + any);
                    }
                }
            }
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

/// A data block with its load values.
#[derive(Clone, Debug, PartialEq)]
pub struct DataBlock {
    /// The number, from 1.
    pub number: u16,
    /// The name of its header or symbol.
    pub name: Option<String>,
    /// Whether it is global, or the instance of a function block.
    pub kind: DataKind,
    /// The load values; its length is the data block's length.
    pub bytes: Vec<u8>,
    /// The declarations, composed types whole; [`Component::find`] leads into them, for `DB10.sub[3].name` in tools.
    pub components: Vec<Component>,
    /// `READ_ONLY`: the program cannot write it.
    pub read_only: bool,
    /// `NON_RETAIN`: no restart and no power cycle keeps its values.
    pub non_retain: bool,
}

/// A name of the symbol table, for tools.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Symbol {
    /// The name without quotes.
    pub name: String,
    /// What it stands for, as written: `M 1.0`, `DB 10`.
    pub address: String,
    /// Its type, when the table gives one.
    pub ty: Option<DataType>,
    /// What the table says of it.
    pub comment: String,
}

/// A compiled program, not verified yet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Program {
    /// Code blocks, any order, each id once.
    pub blocks: Vec<CodeBlock>,
    /// Data blocks, any order, each number once.
    pub data: Vec<DataBlock>,
    /// Symbols of the symbol tables.
    pub symbols: Vec<Symbol>,
    /// Names of the source files.
    pub sources: Vec<String>,
}
