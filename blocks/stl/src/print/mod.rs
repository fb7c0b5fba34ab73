//! Blocks of the instruction set as STL source text, which compiles to the same operations again.
//!
//! [`Printer`] prints the statements of a block, a whole block, data blocks and programs. Labels, comments, titles and
//! the way constants are written come in a [`Listing`]; without one they are made up or left out. What no source can
//! express is [`Unprintable`], with the statement: such a block is left as it is.
//!
//! The words are those of the compiler's own tables.

mod call;
mod constant;
mod declare;
mod labels;
mod operand;
mod printer;
mod statement;

pub use constant::constant;
pub use declare::{Declared, Heading};
pub use printer::{Callees, Listing, Printer, Unprintable};
pub use statement::Shown;
