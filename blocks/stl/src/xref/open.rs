//! Which data blocks are open at a statement, where that is certain.

use ob1_ir::{CodeBlock, DbRegister, Number, Op, Place};

use crate::lints::jump_targets;

/// The numbers in the DB and the DI register, where every way to a statement agrees.
type Registers = [Option<u16>; 2];

/// For each statement of a block what is open in front of it.
pub(super) struct Open(Vec<Registers>);

impl Open {
    /// A statement that a jump leads to knows nothing; nor does one behind a call.
    pub(super) fn of(block: &CodeBlock) -> Self {
        let targets = jump_targets(&block.code);
        let mut now: Registers = [None; 2];
        let mut all = Vec::with_capacity(block.code.len());
        for (at, stmt) in block.code.iter().enumerate() {
            if targets.contains(&(at as u32)) {
                now = [None; 2];
            }
            all.push(now);
            match &stmt.op {
                Op::OpenDb(register, number) => {
                    let opened = if let Number::Fixed(number) = number { Some(*number) } else { None };
                    match register {
                        DbRegister::Db => now[0] = opened,
                        DbRegister::Di => now[1] = opened,
                    }
                }
                Op::ExchangeDbs => now.swap(0, 1),
                Op::Call(_) => now = [None; 2],
                op => match op.operand().map(|operand| operand.place) {
                    Some(Place::InDb(db, _)) => now[0] = Some(db),
                    Some(Place::InDi(db, _)) => now[1] = Some(db),
                    // Reached through a parameter or a pointer, which may open another one.
                    Some(Place::Param { .. } | Place::Register(None, ..)) => now = [None; 2],
                    _ => {}
                },
            }
        }
        Self(all)
    }

    pub(super) fn at(&self, statement: usize) -> Registers {
        self.0.get(statement).copied().unwrap_or_default()
    }
}
