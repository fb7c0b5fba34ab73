//! `ob1 check --listing --native`: what becomes of the statements of each block.

use std::fmt::Write as _;

use ob1_cpu::engine::Plan;
use ob1_native::{Compiler, Target, Tier};

/// The blocks of a program: each statement with the bytes of machine code it takes, and that code. The code of a
/// statement need not stand together, and some need none.
///
/// # Errors
/// There is no code for this processor.
pub fn listing(plan: &Plan) -> Result<String, String> {
    let compiler = Compiler::new(Target::Host, Tier::Optimised).map_err(|error| error.to_string())?;
    let mut text = String::new();
    for (index, block) in plan.blocks.iter().enumerate() {
        let made = match compiler.listing(plan, index as u32) {
            Ok(made) => made,
            Err(why) => {
                let _ = writeln!(text, "{}: no machine code, the reference engine runs it: {why}", block.id);
                continue;
            }
        };
        let _ = writeln!(
            text,
            "{}: {} statements, {} bytes of machine code, {} bytes of stack",
            block.id,
            block.stmts.len(),
            made.bytes,
            made.stack
        );
        for (stmt, bytes) in block.stmts.iter().zip(&made.statements) {
            let _ = writeln!(text, "  {bytes:>6} bytes  line {:<6} {}", stmt.line, stmt.op);
        }
        for line in made.code.lines() {
            let _ = writeln!(text, "    {line}");
        }
    }
    Ok(text)
}
