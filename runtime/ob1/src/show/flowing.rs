//! Power flow: a pass of program status on the drawing of its block.

use std::io::IsTerminal as _;

use ob1_ladder::flow::flow;
use ob1_ladder::{Form, draw, read};
use ob1_model::PassLine;
use ob1_station::access::pass::{PassStatus, Registers};

use super::{Shown, head, open, paint};
use crate::import::Unit;
use crate::language::Language;
use crate::status::{StatusArgs, heading, text};

/// The station's program as its files are now, to draw it.
pub(crate) struct Picture {
    shown: Shown,
    form: Form,
    network: Option<u16>,
}

impl Picture {
    /// # Errors
    /// Why the program cannot be read.
    pub(crate) fn of(args: &StatusArgs) -> Result<Self, String> {
        let path = std::path::Path::new(&args.station);
        let side = open(path, None, &Unit { rack: 0, slot: 2, password: None }).map_err(|why| {
            format!("a drawing needs the station's file: {why}\n  = name it: ob1 status press.toml FB 20 --lad")
        })?;
        let form = if args.lad { Form::Ladder } else { Form::Plan };
        Ok(Self { shown: Shown::new(side, Language::Auto), form, network: args.network })
    }

    /// The networks of the pass; what is no network to draw, as a table.
    pub(crate) fn text(&self, pass: &PassStatus, coloured: bool) -> String {
        let Ok(block) = self.shown.block(&pass.block) else { return text(pass) };
        let changed = pass.file.is_empty() && self.shown.side.sources.contains_key(&block.id);
        if changed || pass.statements.len() != block.code.len() {
            return format!("its source has been changed since it was loaded: no drawing\n{}", text(pass));
        }
        let line = |op: u32| pass.statements.get(op as usize).copied().flatten().map(of_registers);
        let mut out = heading(pass);
        for network in self.shown.ready(block).networks {
            if self.network.is_some_and(|wanted| wanted != network.number) || network.is_empty() {
                continue;
            }
            let mut lines = head(&network);
            match read(&network) {
                Ok(tree) => {
                    let drawing = draw(&network, &tree, &self.shown.options(self.form));
                    let flow = flow(&network, &tree, drawing.is_plan, &line);
                    lines.extend(paint::flowing(&drawing, &flow, coloured));
                }
                Err(why) => {
                    let rows = pass.lines.iter().filter(|line| line.network == network.number).cloned().collect();
                    lines.push(format!("(as statements: {why})"));
                    lines.extend(text(&PassStatus { lines: rows, ..pass.clone() }).lines().skip(1).map(str::to_owned));
                }
            }
            out.push('\n');
            out.push_str(&lines.join("\n"));
            out.push('\n');
        }
        if !coloured && std::io::stdout().is_terminal() {
            out.push_str("\n━ has power, ╌ has none, ─ did not run or is not known\n");
        }
        out
    }
}

fn of_registers(registers: Registers) -> PassLine {
    let Registers { status, accu1, accu2, ar1, ar2, db, di, .. } = registers;
    PassLine { times: 1, status, accus: [accu1, accu2], addresses: [ar1, ar2], blocks: [db, di] }
}
