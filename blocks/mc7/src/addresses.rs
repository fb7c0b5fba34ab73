//! Which statement of a block each statement of its machine code is of.

use ob1_ir::{DbRegister, Number, Op};
use ob1_model::CodeAddress;

use crate::statement::{Mc7Op, Statement, Uncond};

/// Bytes in front of a list of pointers: the jump over it, and its length.
const LIST_HEAD: usize = 4;

/// The statements of machine code, in order. `offsets`: where each statement of the block begins, as [`crate::encode`]
/// and [`crate::decode`] give them. What the compiler made of one statement is all of that one; the final `BE` without
/// a statement of its own is the one behind the last.
pub fn addresses(code: &[u8], offsets: &[u32]) -> Vec<CodeAddress> {
    let mut all: Vec<CodeAddress> = Vec::new();
    let mut at = 0;
    while let Some((Statement { op, .. }, length)) = code.get(at..).and_then(|rest| Statement::read(rest).ok()) {
        let begun = offsets.partition_point(|offset| *offset as usize <= at);
        let begins = begun.checked_sub(1).and_then(|last| offsets.get(last)).is_some_and(|begin| *begin as usize == at);
        let is_end = op == Mc7Op::BlockEnd && at + length == code.len();
        let statement = if is_end && !begins { offsets.len() } else { begun.saturating_sub(1) } as u32;
        let opens = matches!(op, Mc7Op::Plain(Op::OpenDb(DbRegister::Db | DbRegister::Di, Number::Fixed(_))));
        all.push(CodeAddress { at: at as u32, statement, opens });
        at += length;
        // The jump over the pointers: programming devices ask there what a call has left.
        if let Mc7Op::Call(Uncond { list: Some(list), .. }) = op {
            let jump = at - LIST_HEAD - 4 * list.len();
            all.push(CodeAddress { at: jump as u32, statement, opens: false });
        }
    }
    // `L DB10.DBW 2` is `AUF DB 10; L DBW 2`. Alone, `AUF` is a statement like others; in the frame of a call it is a
    // part of that.
    for of_one in all.chunk_by_mut(|one, next| one.statement == next.statement) {
        let is_pair = of_one.len() == 2;
        of_one.iter_mut().enumerate().for_each(|(index, one)| one.opens &= is_pair && index == 0);
    }
    all
}
