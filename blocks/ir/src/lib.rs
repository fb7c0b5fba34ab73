//! The typed instruction set the engines run: the only thing the STL compiler and the engines share.
//!
//! A [`Program`] is a set of code blocks and data blocks. A statement ([`Stmt`]) is one STL statement: its operation,
//! its operand in typed form, and where it came from (network and line). Nothing here remembers mnemonics or source
//! text; nothing here knows how an engine represents memory.

mod access;
mod call;
pub mod compose;
mod file;
mod layout_text;
mod notation;
mod op;
mod place;
mod program;
mod text;
mod verify;
pub mod why;

pub use access::Numbered;
pub use call::{Arg, Call, CallMode, Target};
pub use file::{ParseError, parse, write};
pub use notation::Notation;
pub use ob1_model::Width;
pub use op::{AccuOp, BitTest, Compare, Convert, Jump, Logic, MathFn, NumberFormat, Op, Shift, StatusBit, WordLogic};
pub use place::{AddressRegister, DbRegister, Number, Operand, Place, Pointer};
pub use program::{CodeBlock, DataBlock, DataKind, Program, Stmt, Symbol};
pub use verify::{BRACKETS, Defect, Finding, LOCAL_BYTES, MCR_BRACKETS, Verified, verify};
