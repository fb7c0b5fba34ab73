//! `ob1 check --listing --native`: the machine code of the statements of each block.

use std::fmt::Write as _;

use ob1_cpu::engine::Plan;
use ob1_native::{Compiler, Target, Tier};

/// The blocks of a program: each statement with the bytes of machine code it takes, and below it that code. The code of
/// a statement need not be contiguous, and some statements need none; code of no statement is listed at the end of its
/// block.
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
        for (stmt, code) in block.stmts.iter().zip(&made.statements) {
            let _ = writeln!(text, "  {:>6} bytes  line {:<6} {}", code.bytes, stmt.line, stmt.op);
            for line in &code.lines {
                let _ = writeln!(text, "        {line}");
            }
        }
        let _ = writeln!(text, "  of no statement");
        for line in &made.rest {
            let _ = writeln!(text, "        {line}");
        }
    }
    Ok(text)
}
