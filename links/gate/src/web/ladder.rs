//! Networks of blocks as drawings, and power flow in them.

use hyper::StatusCode;
use ob1_ladder::flow::{Flow, State, flow};
use ob1_ladder::svg::bare_svg;
use ob1_ladder::{Drawing, Form, Network, Options, draw};
use ob1_model::{PASS_STATEMENTS, Pass, PassEnd, PassLine, PassOrder};
use ob1_stl::Mnemonics;
use serde_json::{Value, json};

use super::Page;
use super::insight::{Drawable, Insight};
use super::program::hidden;
use crate::http::{Reply, plain, query, reply};

/// The networks of a block, and whether they can be drawn.
pub(super) fn heads(networks: &[Drawable]) -> Vec<Value> {
    let head = |(network, tree): &Drawable| {
        json!({
            "number": network.number, "title": network.title, "comment": network.comment, "label": network.label,
            "empty": network.is_empty(), "left": tree.as_ref().err().map(ToString::to_string),
        })
    };
    networks.iter().map(head).collect()
}

/// The form of this name: `lad`, `fbd`.
fn form(name: &str) -> Form {
    if name == "fbd" { Form::Plan } else { Form::Ladder }
}

fn drawing(network: &Network, tree: &ob1_ladder::tree::Tree, form: Form, mnemonics: Mnemonics) -> Drawing {
    draw(network, tree, &Options { form, mnemonics, ..Options::default() })
}

impl Page {
    /// `?id=FC 1&network=3&form=lad`: a network as SVG.
    pub(super) async fn drawing(&self, asked: &str) -> Reply {
        if !self.allowed.has_program() {
            return hidden();
        }
        let insight = match self.insight.get(&self.station).await {
            Ok(insight) => insight,
            Err(why) => return super::api::trouble(&why),
        };
        let number = query(asked, "network").and_then(|number| number.parse::<u16>().ok());
        let block = query(asked, "id").and_then(|id| insight.block(&id));
        let (Some(block), Some(number)) = (block, number) else {
            return plain(StatusCode::NOT_FOUND, "there is no such network");
        };
        let networks = insight.networks(block);
        match networks.iter().find(|(network, _)| network.number == number) {
            None => plain(StatusCode::NOT_FOUND, "there is no such network"),
            Some((_, Err(why))) => plain(StatusCode::CONFLICT, format!("it stays statements: {why}")),
            Some((network, Ok(tree))) => {
                let form = form(&query(asked, "form").unwrap_or_default());
                let drawing = drawing(network, tree, form, insight.set);
                reply(StatusCode::OK, "image/svg+xml", bare_svg(network, tree, &drawing))
            }
        }
    }
}

/// What a page shows of a block while it runs: `FB 20|1,2|lad|21`, the last one a data block or nothing.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Shown {
    block: String,
    networks: Vec<u16>,
    plan: bool,
    db: u16,
}

/// Networks watched at a time.
const NETWORKS: usize = 64;

impl Shown {
    pub(super) fn parse(text: &str) -> Option<Self> {
        let mut parts = text.split('|');
        let block = parts.next()?.to_owned();
        let mut networks: Vec<u16> = parts.next()?.split(',').filter_map(|n| n.parse().ok()).take(NETWORKS).collect();
        networks.sort_unstable();
        networks.dedup();
        let plan = parts.next() == Some("fbd");
        let db = parts.next().and_then(|db| db.parse().ok()).unwrap_or(0);
        (!networks.is_empty()).then_some(Self { block, networks, plan, db })
    }

    /// The statements that are watched, waiting `wait` nanoseconds for a pass; none: there is no such block.
    pub(super) fn order(&self, insight: &Insight, wait: u64) -> Option<PassOrder> {
        let block = insight.block(&self.block)?;
        let shown = |stmt: &ob1_ir::Stmt| self.networks.contains(&stmt.network);
        let first = block.code.iter().position(shown)?;
        let end = block.code.iter().rposition(shown)? + 1;
        let count = (end - first).min(PASS_STATEMENTS) as u32;
        Some(PassOrder { block: block.id, from: None, db: self.db, first: first as u32, count, wait, before: false })
    }

    /// A pass as the page shows it: for each network the states of its parts, and the registers of lines.
    pub(super) fn told(&self, insight: &Insight, order: &PassOrder, pass: &Pass) -> Value {
        let Some(block) = insight.block(&self.block) else { return told_end("changed") };
        match pass.end {
            PassEnd::Whole | PassEnd::Stopped if pass.statements as usize != block.code.len() + 1 => {
                return told_end("changed");
            }
            PassEnd::Whole | PassEnd::Stopped => {}
            PassEnd::NotCalled => return told_end("not called"),
            PassEnd::TooLong => return told_end("too long"),
            PassEnd::Full => return told_end("full"),
            PassEnd::NoBlock => return told_end("changed"),
        }
        let line = |op: u32| {
            let at = op.checked_sub(order.first)? as usize;
            pass.lines.get(at).copied().filter(|line: &PassLine| line.times > 0)
        };
        let mut networks = serde_json::Map::new();
        for (network, tree) in insight.networks(block).iter().filter(|(n, _)| self.networks.contains(&n.number)) {
            let Ok(tree) = tree else { continue };
            let form = if self.plan { Form::Plan } else { Form::Ladder };
            let is_plan = drawing(network, tree, form, insight.set).is_plan;
            networks.insert(network.number.to_string(), Value::String(letters(&flow(network, tree, is_plan, &line))));
        }
        let mut lines = std::collections::BTreeMap::new();
        for (at, stmt) in (0u32..).zip(&block.code) {
            if self.networks.contains(&stmt.network)
                && stmt.line > 0
                && let Some(record) = line(at)
            {
                let bit = |n: u16| record.status >> n & 1;
                lines.insert(stmt.line, json!([stmt.line, bit(1), bit(2), record.accus[0]]));
            }
        }
        let caller = pass.caller.map(|(id, at)| ob1_access::why::place_of(insight.all.program(), id, at));
        json!({
            "outcome": if pass.end == PassEnd::Stopped { "stopped" } else { "whole" },
            "ob": pass.ob, "caller": caller, "cut": pass.cut > 0 || order.count as usize == PASS_STATEMENTS,
            "networks": networks, "lines": lines.into_values().collect::<Vec<_>>(),
        })
    }
}

fn told_end(outcome: &str) -> Value {
    json!({ "outcome": outcome, "networks": {}, "lines": [] })
}

/// The states: the rail, then three letters a node. `1` has power, `0` has none, `-` did not run or is not known.
fn letters(flow: &Flow) -> String {
    let letter = |state: &State| match state {
        State::On => '1',
        State::Off => '0',
        State::Unknown => '-',
    };
    std::iter::once(&flow.rail).chain(flow.nodes.iter().flatten()).map(letter).collect()
}
