//! Machine code that reads a data block through the DB register behind a `CALL`.
//!
//! STEP 7 makes a `CALL` of statements that open data blocks. Behind that of a function the register holds the data
//! block of the last actual that was copied. A `CALL` of ours leaves the register as it was, so a block in which that
//! shows keeps the statements its calls are made of. Behind that of a function block both hold the instance.

use ob1_ir::{Arg, Call, CallMode, DbRegister, Op, Operand, Place, Stmt, Target};
use ob1_mc7::{Decoded, MachineBlock, Mc7Error, decode};
use ob1_model::{Area, BlockId, Interface};

/// Decodes a block so that the DB register holds at each statement what it holds on the CPU.
///
/// # Errors
/// What is wrong with the machine code, as with [`decode`].
pub(crate) fn decode_block<'i>(
    machine: &MachineBlock<'_>,
    callees: &(dyn Fn(BlockId) -> Option<&'i Interface> + 'i),
) -> Result<Decoded, Mc7Error> {
    let decoded = decode(machine, callees)?;
    // Calls of blocks that are not known stay the statements they are made of.
    if is_read_behind_call(&decoded.block.code) { decode(machine, &|_| None) } else { Ok(decoded) }
}

/// True when a statement behind a `CALL` reads through the DB register before a data block is opened. Statements are
/// taken in their order; jumps are not followed.
fn is_read_behind_call(code: &[Stmt]) -> bool {
    let mut other = false;
    for (at, stmt) in code.iter().enumerate() {
        if other && reads(&stmt.op) {
            return true;
        }
        match &stmt.op {
            Op::Call(call) if call.mode == CallMode::Call => other = opens(call).unwrap_or(other),
            Op::OpenDb(DbRegister::Db, _) | Op::End => other = false,
            Op::ExchangeDbs => {
                // What the register held goes into the other one, and is lost where that is opened next.
                let next = code.get(at + 1).map(|stmt| &stmt.op);
                if other && !matches!(next, Some(Op::OpenDb(DbRegister::Di, _))) {
                    return true;
                }
                other = false;
            }
            op => {
                op.places(&mut |place, _| other = other && !matches!(place, Place::InDb(..)));
            }
        }
    }
    false
}

/// Whether the statements of a `CALL` leave another data block in the DB register than ours; `None`: they leave it
/// alone.
fn opens(call: &Call) -> Option<bool> {
    let copied = |arg: &Arg| matches!(arg, Arg::Operand(Operand { place: Place::InDb(..), .. }));
    match call.target {
        Target::Block(id) if !id.kind.has_instance() => call.args.iter().any(copied).then_some(true),
        _ => Some(false),
    }
}

/// True when an operation reads the DB register, or through it.
fn reads(op: &Op) -> bool {
    let mut found = matches!(op, Op::LoadDbNumber(DbRegister::Db) | Op::LoadDbLength(DbRegister::Db));
    op.places(&mut |place, _| {
        found |= matches!(
            place,
            Place::Fixed(Area::Db, _) | Place::Memory(Area::Db, _) | Place::Register(Some(Area::Db), ..)
        );
    });
    if let Op::Call(call) = op {
        let by_register = |arg: &Arg| matches!(arg, Arg::Raw(pointer) if is_db(*pointer));
        found |= call.args.iter().any(by_register);
    }
    found
}

/// True for a pointer into the data block of the DB register.
fn is_db(pointer: u32) -> bool {
    Area::from_pointer_code((pointer >> 24) as u8) == Some(Area::Db)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::overlay;

    /// The statements of FC 5 as they come back from its machine code.
    fn through_machine_code(statements: &str) -> Vec<Op> {
        let source = format!(
            "FUNCTION_BLOCK FB 1\nVAR_INPUT\n  a : INT;\nEND_VAR\nBEGIN\nEND_FUNCTION_BLOCK\n\
             DATA_BLOCK DB 1\nFB 1\nBEGIN\nEND_DATA_BLOCK\n\
             DATA_BLOCK DB 2\nSTRUCT\n  b : ARRAY [0 .. 3] OF INT;\nEND_STRUCT;\nBEGIN\nEND_DATA_BLOCK\n\
             FUNCTION FC 1 : VOID\nVAR_INPUT\n  a : INT;\nEND_VAR\nBEGIN\nEND_FUNCTION\n\
             FUNCTION FC 5 : VOID\nBEGIN\nNETWORK\n{statements}\nEND_FUNCTION\n"
        );
        let sources = [ob1_stl::Source::new("a.awl", source)];
        let output = ob1_stl::compile(&sources, &ob1_stl::Library::new(), &ob1_stl::Options::default());
        assert!(output.is_good(), "{:?}", output.diagnostics);
        let id = BlockId::new(ob1_model::BlockKind::Fc, 5);
        let image = ob1_mc7::image(&output.program, id, &|_| None).expect("an image");
        let interface = |id: BlockId| output.program.blocks.iter().find(|b| b.id == id).map(|b| &b.interface);
        let block = overlay::code(id, &image, interface(id).expect("FC 5"), &interface).expect("it decodes");
        block.code.into_iter().map(|stmt| stmt.op).collect()
    }

    #[test]
    fn a_call_keeps_its_statements_where_the_register_shows() {
        let is_call = |op: &Op| matches!(op, Op::Call(call) if call.mode == CallMode::Call);
        for (behind, folds) in [
            ("CALL FB 1, DB 1 (a := 5); L DBW 0;", true),
            ("L DB1.DBW 0; CALL FC 1 (a := DB2.DBW 0); L DBNO;", false),
            ("CALL FC 1 (a := DB2.DBW 0); CALL FB 1, DB 1 (a := 5); L DBW 0;", true),
            ("CALL FB 1, DB 1 (a := 5); L MW 2;", true),
            ("CALL FB 1, DB 1 (a := 5); L DB2.DBW 0; L DBW 2;", true),
            ("CALL FB 1, DB 1 (a := 5); CALL FB 1, DB 1 (a := 6); L DB1.DBW 0;", true),
            ("L DB1.DBW 0; CALL FC 1 (a := DB2.DBW 0); L DBW 0;", false),
            ("L DB1.DBW 0; CALL FC 1 (a := MW 0); L DBW 0;", true),
        ] {
            let ops = through_machine_code(&format!("{behind} T MW 4;"));
            assert_eq!(ops.iter().any(is_call), folds, "{behind}: {ops:?}");
        }
    }
}
