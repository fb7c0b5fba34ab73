//! Ladder: contacts in series and parallel between the rail at the left and the coils at the right.

use super::boxes;
use super::frame::{At, Frame, Pin};
use super::names::Names;
use super::signs;
use super::sketch::{Class, Place, Shape, Sketch, columns};
use crate::tree::{Coil, End, Kind, Node, Rung};

use ob1_stl::Mnemonics;

/// A rung or arm; its coils end `target` columns from its begin, or further where it is wider.
pub(crate) fn rung(names: &Names<'_>, rung: &Rung, target: usize, at_rail: bool) -> Sketch {
    let logic = match &rung.logic {
        Some(logic) => node(names, logic, at_rail),
        None => Sketch::new(0, names.rows + 1, names.rows),
    };
    if rung.ends.is_empty() {
        return logic;
    }
    let before = rung.logic.as_ref().map_or(Place::Rail, |node| Place::After(node.id));
    let left = logic.width;
    logic.beside(ends(names, &rung.ends, before, target.saturating_sub(left)))
}

fn ends(names: &Names<'_>, all: &[End], before: Place, target: usize) -> Sketch {
    if let [one] = all {
        return end(names, one, before, target);
    }
    stacked(all.iter().map(|one| end(names, one, before, target.saturating_sub(1))).collect(), before)
}

/// One below the other behind a bar at the left.
fn stacked(parts: Vec<Sketch>, before: Place) -> Sketch {
    let mut bar = Sketch::new(1, 0, 0);
    let mut rows = Vec::new();
    for part in parts {
        let top = bar.height;
        rows.push(top + part.wire);
        bar.insert(part, top, 1);
    }
    bar.wire = rows.first().copied().unwrap_or(0);
    bar.along(before, bar.wire, 0, 1);
    for row in &rows {
        bar.along(before, *row, 1, 2);
    }
    let last = rows.last().copied().unwrap_or(0);
    for pair in rows.windows(2) {
        if let [from, to] = pair {
            bar.down(before, 0, *from, *to);
        }
    }
    bar.height = bar.height.max(last + 1);
    bar
}

fn end(names: &Names<'_>, end: &End, before: Place, target: usize) -> Sketch {
    match end {
        End::Coil(coil) => {
            let sketch = self::coil(names, coil);
            let lead = target.saturating_sub(sketch.width);
            let mut wire = Sketch::new(lead, sketch.height, sketch.wire);
            wire.along(before, sketch.wire, 0, 2 * lead);
            wire.beside(sketch)
        }
        End::Branch { arms, .. } => match arms.as_slice() {
            [arm] => rung(names, arm, target, false),
            arms => stacked(arms.iter().map(|arm| rung(names, arm, target.saturating_sub(1), false)).collect(), before),
        },
    }
}

fn coil(names: &Names<'_>, coil: &Coil) -> Sketch {
    let german = names.options.mnemonics != Mnemonics::International;
    let sign = format!("({:^3})", signs::coil(&coil.op.op, german));
    let mut above = names.above(coil.op.statement);
    if above.iter().all(String::is_empty) {
        above = vec![String::new(); names.rows];
    }
    let value = coil.value.as_ref().map(|value| (names.value(value.statement), value.statement));
    let below = value.as_ref().map_or(0, |(text, _)| columns(text));
    let widest = above.iter().map(|name| columns(name)).max().unwrap_or(0).max(below);
    let width = (widest + 1).max(columns(&sign) + 3);
    let mut sketch = Sketch::new(width, names.rows + 1 + usize::from(value.is_some()), names.rows);
    let column = width - columns(&sign) - (width - columns(&sign)) / 3;
    sketch.along(Place::Before(coil.id), names.rows, 0, 2 * column);
    let shape = Shape::Sign { row: names.rows, column, text: sign.clone(), class: Class::Coil };
    sketch.put(Place::At(coil.id), shape);
    let centred = |text: &str| {
        let middle = column + columns(&sign) / 2;
        middle.saturating_sub(columns(text) / 2).min(width - columns(text))
    };
    for (row, name) in above.iter().enumerate().filter(|(_, name)| !name.is_empty()) {
        let shape = Shape::Name { row, column: centred(name), text: name.clone(), statement: coil.op.statement };
        sketch.put(Place::At(coil.id), shape);
    }
    if let Some((text, statement)) = value {
        let shape = Shape::Name { row: names.rows + 1, column: centred(&text), text, statement };
        sketch.put(Place::At(coil.id), shape);
    }
    sketch
}

/// Logic. `at_rail`: it begins at the left rail.
pub(crate) fn node(names: &Names<'_>, node: &Node, at_rail: bool) -> Sketch {
    let first = node.statements.start;
    match &node.kind {
        Kind::Contact { negate, .. } => {
            let sign = if *negate { "┤/├" } else { "┤ ├" };
            names.element(node.id, &names.above(first), first, sign, Class::Contact)
        }
        Kind::Wire { negate: false, .. } => {
            let mut wire = Sketch::new(1, names.rows + 1, names.rows);
            wire.along(Place::After(node.id), names.rows, 0, 2);
            wire
        }
        Kind::Not | Kind::Wire { .. } => names.element(node.id, &[], first, "┤NOT├", Class::Contact),
        Kind::Edge { rising, boxed, .. } => {
            let last = node.statements.end.saturating_sub(1);
            let sign = match (boxed, rising) {
                (false, true) => "( P )",
                (false, false) => "( N )",
                (true, true) => "┤POS├",
                (true, false) => "┤NEG├",
            };
            names.element(node.id, &names.above(last), last, sign, Class::Coil)
        }
        Kind::Connector(_) => names.element(node.id, &names.above(first), first, "( # )", Class::Coil),
        Kind::Series { items, .. } => {
            let mut all = Sketch::default();
            for (at, item) in items.iter().enumerate() {
                let next = self::node(names, item, at_rail && at == 0);
                all = if at == 0 { next } else { all.beside(next) };
            }
            all
        }
        Kind::Parallel(legs) | Kind::Xor(legs) => parallel(names, node.id, legs),
        // A ladder has no sign for these; the function plan has.
        Kind::Negated(inner) => {
            self::node(names, inner, at_rail).beside(names.element(node.id, &[], first, "┤NOT├", Class::Contact))
        }
        Kind::Compare { values, format, how } => {
            let pins = values.iter().zip(["IN1", "IN2"]);
            let value = |at: u32| At::Value(names.value(at), at);
            let mut inputs = vec![Pin::new("", At::Open)];
            inputs.extend(pins.map(|(one, pin)| Pin::new(pin, value(one.statement))));
            let title = signs::compare(*format, *how);
            let outputs = vec![Pin::new("", At::Open)];
            let base = Frame::new(node.id, title);
            let frame = Frame { inputs, outputs, used: true, statement: first, ..base };
            frame.draw(names)
        }
        Kind::Box(inner) => {
            let logic = |input: &Node| At::Logic(self::node(names, input, at_rail), input.id, false);
            let mut frame = boxes::frame(names, node, inner, &logic);
            frame.at_rail = at_rail;
            frame.draw(names)
        }
    }
}

/// Legs between two bars. Where the first one goes on from a branch, the others begin at a rail of their own.
fn parallel(names: &Names<'_>, id: u32, legs: &[Node]) -> Sketch {
    let leads = legs.first().and_then(Node::leftmost).is_some_and(|node| matches!(node.kind, Kind::Wire { .. }));
    let legs: Vec<(u32, Sketch)> = legs.iter().map(|leg| (leg.id, node(names, leg, false))).collect();
    let widest = legs.iter().map(|(_, leg)| leg.width).max().unwrap_or(0);
    let mut all = Sketch::new(widest + 2, 0, 0);
    let mut rows = Vec::new();
    for (leg_id, leg) in legs {
        let (top, width) = (all.height, leg.width);
        let row = top + leg.wire;
        rows.push(row);
        all.insert(leg, top, 1);
        all.along(Place::Before(leg_id), row, 1, 2);
        all.along(Place::After(leg_id), row, 2 * (width + 1), 2 * (widest + 1) + 1);
    }
    let first = rows.first().copied().unwrap_or(0);
    all.wire = first;
    all.along(Place::Before(id), first, 0, 1);
    all.along(Place::After(id), first, 2 * (widest + 1) + 1, 2 * (widest + 2));
    for pair in rows.windows(2) {
        if let [from, to] = pair {
            if leads {
                all.down(Place::Rail, 0, *to - 1, *to);
            } else {
                all.down(Place::Before(id), 0, *from, *to);
            }
            all.down(Place::After(id), widest + 1, *from, *to);
        }
    }
    all
}
