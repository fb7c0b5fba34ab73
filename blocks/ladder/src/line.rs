//! A network on one line, for differences, logs and searching: `E0.0 & !E0.1 & (M1.0 | M1.1) -> A4.0, S M2.0`.

use ob1_stl::Mnemonics;

use crate::layout::frame::{At, Pin};
use crate::layout::{Names, Options, boxes, names, signs};
use crate::network::Network;
use crate::tree::{Coil, End, Kind, Node, Rung, Saves, Tree};

/// The rungs of a network, each on a line.
pub fn line(network: &Network, tree: &Tree, options: &Options) -> String {
    let options = Options { longest_name: usize::MAX, ..*options };
    let writer = Writer { names: names(network, options), german: options.mnemonics != Mnemonics::International };
    tree.rungs.iter().map(|rung| writer.rung(rung)).collect::<Vec<_>>().join("; ")
}

/// The texts of parts of a network.
pub(crate) struct Writer<'n> {
    names: Names<'n>,
    german: bool,
}

/// Without the blank of an address; names keep theirs.
fn close(text: &str) -> String {
    let address = text.split_once(' ').is_some_and(|(letters, number)| {
        letters.len() <= 8 && !letters.starts_with('#') && number.starts_with(|c: char| c.is_ascii_digit())
    });
    if address { text.replace(' ', "") } else { text.to_owned() }
}

impl<'n> Writer<'n> {
    pub(crate) fn new(network: &'n Network) -> Self {
        let names_shown = crate::layout::NamesShown::Address;
        let options = Options { longest_name: usize::MAX, names: names_shown, ..Options::default() };
        Self { names: names(network, options), german: true }
    }

    fn value(&self, statement: u32) -> String {
        let symbol = self.names.network.statements.get(statement as usize).is_some_and(|s| !s.symbol.is_empty());
        let text = self.names.value(statement);
        let named = symbol && self.names.options.names != crate::layout::NamesShown::Address;
        if named { format!("\"{text}\"") } else { close(&text) }
    }

    pub(crate) fn rung(&self, rung: &Rung) -> String {
        let logic = rung.logic.as_ref().map(|logic| self.logic(logic));
        let ends: Vec<String> = rung.ends.iter().map(|end| self.end(end)).collect();
        match (logic, ends.is_empty()) {
            (Some(logic), true) => logic,
            (Some(logic), false) => format!("{logic} -> {}", ends.join(", ")),
            (None, _) => format!("-> {}", ends.join(", ")),
        }
    }

    pub(crate) fn end(&self, end: &End) -> String {
        match end {
            End::Coil(coil) => self.coil(coil),
            End::Branch { arms, .. } => {
                format!("{{{}}}", arms.iter().map(|arm| self.rung(arm)).collect::<Vec<_>>().join("; "))
            }
        }
    }

    fn coil(&self, coil: &Coil) -> String {
        let sign = signs::coil(&coil.op.op, self.german);
        let saves = if coil.saves == Saves::Nothing && sign == "RET" { "RET without SAVE" } else { sign };
        let operand = self.value(coil.op.statement);
        let value = coil.value.as_ref().map(|value| self.value(value.statement));
        let words = [saves.to_owned(), operand, value.unwrap_or_default()];
        words.into_iter().filter(|word| !word.is_empty()).collect::<Vec<_>>().join(" ")
    }

    /// In brackets where it binds less than what stands around it.
    fn inner(&self, node: &Node) -> String {
        let text = self.logic(node);
        match node.kind {
            Kind::Series { .. } | Kind::Parallel(_) | Kind::Xor(_) | Kind::Compare { .. } => format!("({text})"),
            _ => text,
        }
    }

    fn joined(&self, nodes: &[Node], by: &str) -> String {
        nodes.iter().map(|node| self.inner(node)).collect::<Vec<_>>().join(by)
    }

    pub(crate) fn logic(&self, node: &Node) -> String {
        let first = node.statements.start;
        match &node.kind {
            Kind::Contact { negate, .. } => format!("{}{}", if *negate { "!" } else { "" }, self.value(first)),
            Kind::Wire { negate, .. } => if *negate { "!_" } else { "_" }.to_owned(),
            Kind::Series { items, .. } => self.series(items),
            Kind::Parallel(legs) => {
                let leg = |leg: &Node| match leg.kind {
                    Kind::Series { .. } => self.logic(leg),
                    _ => self.inner(leg),
                };
                legs.iter().map(leg).collect::<Vec<_>>().join(" | ")
            }
            Kind::Xor(legs) => self.joined(legs, " ^ "),
            Kind::Negated(inner) => format!("!({})", self.logic(inner)),
            Kind::Compare { values: [one, other], format, how } => {
                let sign = signs::compare(*format, *how);
                let sign = sign.strip_prefix("CMP ").unwrap_or(&sign);
                format!("{} {sign} {}", self.value(one.statement), self.value(other.statement))
            }
            Kind::Box(inner) => self.boxed(node, inner),
            Kind::Not | Kind::Edge { .. } | Kind::Connector(_) => self.acting(node, ""),
        }
    }

    /// What acts on all that stands before it is a function of that.
    fn series(&self, items: &[Node]) -> String {
        let mut before: Vec<String> = Vec::new();
        for item in items {
            if matches!(item.kind, Kind::Not | Kind::Edge { .. } | Kind::Connector(_)) {
                before = vec![self.acting(item, &before.join(" & "))];
            } else {
                before.push(self.inner(item));
            }
        }
        before.join(" & ")
    }

    fn acting(&self, node: &Node, before: &str) -> String {
        let last = node.statements.end.saturating_sub(1);
        match &node.kind {
            Kind::Edge { rising, boxed, .. } => {
                format!("{}({}; {before})", signs::edge(*boxed, *rising), self.value(last))
            }
            Kind::Connector(_) => format!("#({}; {before})", self.value(node.statements.start)),
            _ => format!("NOT({before})"),
        }
    }

    fn boxed(&self, node: &Node, inner: &crate::tree::BoxNode) -> String {
        let frame = boxes::frame(&self.names, node, inner, &|input| At::Value(self.logic(input), u32::MAX));
        let pin = |pin: &Pin| match &pin.at {
            At::Value(text, statement) => {
                let text = if *statement == u32::MAX { text.clone() } else { close(text) };
                Some(format!("{}: {text}", pin.name))
            }
            _ => None,
        };
        let above = frame.above.last().filter(|name| !name.is_empty()).map(|name| close(name));
        let pins: Vec<String> = frame.inputs.iter().chain(&frame.outputs).filter_map(pin).collect();
        let inside: Vec<String> = above.into_iter().chain((!pins.is_empty()).then(|| pins.join(", "))).collect();
        format!("{}({})", frame.title, inside.join("; "))
    }
}
