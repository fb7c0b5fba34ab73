//! The opcode pages: what each first byte begins, and the bytes of each statement, exactly invertible. Every page reads
//! and writes.
//!
//! Names of operations are German. Long forms begin with a byte of their own; where an operand also fits the short
//! form, [`Statement::long`] says which one is in the code.

mod bits;
mod blocks;
mod fixed;
mod jumps;
mod loads;
mod operands;
mod registers;
mod shifts;
mod times;

use crate::bytes::Bytes;
use crate::statement::{Mc7Op, NoStatement, Statement};

impl Statement {
    /// Reads the statement at the beginning of `code` and its length in bytes.
    ///
    /// # Errors
    /// [`NoStatement`] where none begins there, or where the code ends within it.
    pub fn read(code: &[u8]) -> Result<(Self, usize), NoStatement> {
        let b = Bytes(code);
        if code.len() < 2 {
            return Err(NoStatement::Cut);
        }
        let op = fixed::read(b.head());
        let found = op.map(|op| (Self { op: Mc7Op::Plain(op), long: false }, 2));
        // Pages that share first bytes tell each other apart by the second.
        let found = found
            .or_else(|| jumps::read(&b))
            .or_else(|| bits::read(&b))
            .or_else(|| loads::read(&b))
            .or_else(|| times::read(&b))
            .or_else(|| shifts::read(&b))
            .or_else(|| registers::read(&b))
            .or_else(|| blocks::read(&b));
        match found {
            None => Err(NoStatement::Unknown),
            Some((_, length)) if length > code.len() => Err(NoStatement::Cut),
            Some(found) => Ok(found),
        }
    }

    /// The bytes of the statement; `None` for what the machine has no form of.
    pub fn bytes(&self) -> Option<Vec<u8>> {
        match &self.op {
            Mc7Op::Plain(op) => fixed::write(op)
                .map(|word| word.to_be_bytes().to_vec())
                .or_else(|| bits::write(op, self.long))
                .or_else(|| loads::write(op, self.long))
                .or_else(|| times::write(op, self.long))
                .or_else(|| shifts::write(op))
                .or_else(|| registers::write(op))
                .or_else(|| blocks::write(op, self.long)),
            Mc7Op::Constant(form, value) => loads::write_constant(*form, *value),
            Mc7Op::ParamPointer { index, other } => blocks::write_pointer(*index, *other),
            Mc7Op::Call(call) => blocks::write_call(call, self.long),
            Mc7Op::Build(n) => Some(vec![0x10, *n]),
            Mc7Op::BlockEnd => Some(vec![0x65, 0]),
            Mc7Op::End => Some(vec![0x65, 1]),
            jump => jumps::write(jump),
        }
    }
}
