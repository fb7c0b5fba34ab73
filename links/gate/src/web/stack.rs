//! In what the program was interrupted: blocks, registers and local data of a CPU in STOP or HOLD.

use crate::shared::Client;
use ob1_access::door::{Answer, Ask};
use ob1_ir::Program;
use ob1_model::{DebugOrder, Held, HeldBlock};
use serde_json::{Value, json};

use super::Page;

impl Page {
    /// `null` if the link does not show the program, or no block was interrupted.
    pub(super) async fn stack(&self, client: &Client) -> Value {
        let Ok(Answer::Debug(answer)) = client.ask(Ask::Debug(DebugOrder::Stack { level: 0 })).await else {
            return Value::Null;
        };
        match self.station.catalog().await {
            Ok(catalog) if !answer.held.stack.is_empty() => told(&catalog.program, &answer.held),
            _ => Value::Null,
        }
    }
}

fn told(program: &Program, held: &Held) -> Value {
    let block = |at: &HeldBlock| {
        let code = program.blocks.iter().find(|block| block.id == at.block);
        let stmt = code.and_then(|code| code.code.get(at.statement as usize).or(code.code.last()));
        json!({
            "block": at.block.to_string(),
            "name": code.and_then(|code| code.name.as_deref()),
            "network": stmt.map(|stmt| stmt.network),
            "line": stmt.map(|stmt| stmt.line),
            "source": code.and_then(|code| program.sources.get(code.source as usize)),
            "db": at.blocks[0],
            "di": at.blocks[1],
        })
    };
    let digits: Vec<String> = held.local.iter().map(|byte| format!("{byte:02X}")).collect();
    json!({
        "blocks": held.stack.iter().map(block).collect::<Vec<_>>(),
        "status": held.status,
        "accus": held.accus,
        "addresses": held.addresses,
        "local": digits.join(" "),
    })
}

#[cfg(test)]
mod tests {
    use ob1_ir::{CodeBlock, Op, Stmt};
    use ob1_model::{BlockId, BlockKind, Interface};

    use super::*;

    #[test]
    fn a_block_is_told_with_its_place_in_the_source() {
        let id = BlockId::new(BlockKind::Fc, 5);
        let stmt = |network, line| Stmt { op: Op::Nop, network, line };
        let code = CodeBlock {
            id,
            name: Some("Pump".into()),
            interface: Interface::default(),
            code: vec![stmt(1, 7), stmt(2, 9)],
            source: 0,
        };
        let program = Program { sources: vec!["p.awl".into()], blocks: vec![code], ..Program::default() };
        let at = |statement| HeldBlock {
            block: id,
            statement,
            blocks: [10, 0],
            ob: 1,
            priority: 1,
            began: [0; 8],
            address: None,
        };
        let held = Held { stack: vec![at(1), at(2)], local: vec![0, 0xAB], ..Held::default() };
        let told = told(&program, &held);
        assert_eq!(told["blocks"][0]["network"], 2);
        assert_eq!((&told["blocks"][0]["line"], &told["blocks"][0]["name"]), (&json!(9), &json!("Pump")));
        assert_eq!(told["blocks"][1]["line"], 9, "the end stands behind the last statement");
        assert_eq!((&told["local"], &told["blocks"][0]["db"]), (&json!("00 AB"), &json!(10)));
    }
}
