//! Function plan: boxes that feed boxes, from the same tree. The wire row of a box is that of its first input, so that
//! what begins at a branch comes straight from it.

use ob1_stl::Mnemonics;

use super::boxes;
use super::frame::{At, Frame, Pin};
use super::names::Names;
use super::signs;
use super::sketch::{Class, Place, Shape, Sketch, columns};
use crate::tree::{Coil, End, Kind, Node, Rung};

/// A rung or arm.
pub(crate) fn rung(names: &Names<'_>, rung: &Rung) -> Sketch {
    let lead = rung.logic.as_ref().map_or(At::Open, |logic| at(names, logic));
    let before = rung.logic.as_ref().map_or(Place::Rail, |logic| Place::After(logic.id));
    match rung.ends.as_slice() {
        [] => match lead {
            At::Logic(sketch, ..) => sketch,
            lead => as_sketch(lead),
        },
        [End::Coil(coil)] => self::coil(names, coil, lead),
        ends => {
            let mut bar = Sketch::new(1, 0, 0);
            let mut rows = Vec::new();
            let mut parts: Vec<Sketch> = Vec::new();
            for end in ends {
                match end {
                    End::Coil(coil) => parts.push(self::coil(names, coil, wire(before))),
                    End::Branch { arms, .. } => parts.extend(arms.iter().map(|arm| self::rung(names, arm))),
                }
            }
            for part in parts {
                let top = bar.height;
                rows.push(top + part.wire);
                bar.along(before, top + part.wire, 1, 2);
                bar.insert(part, top, 1);
            }
            bar.wire = rows.first().copied().unwrap_or(0);
            bar.along(before, bar.wire, 0, 1);
            for pair in rows.windows(2) {
                if let [from, to] = pair {
                    bar.down(before, 0, *from, *to);
                }
            }
            as_sketch(lead).beside(bar)
        }
    }
}

/// A wire of one cell.
fn wire(place: Place) -> At {
    let id = match place {
        Place::Before(id) | Place::At(id) | Place::After(id) => id,
        Place::Rail => u32::MAX,
    };
    let mut wire = Sketch::new(1, 1, 0);
    wire.along(place, 0, 0, 2);
    At::Logic(wire, id, false)
}

fn coil(names: &Names<'_>, coil: &Coil, lead: At) -> Sketch {
    let german = names.options.mnemonics != Mnemonics::International;
    let title = match signs::coil(&coil.op.op, german) {
        "" => "=",
        other => other,
    };
    let mut inputs = vec![Pin::new("", lead)];
    if let Some(value) = &coil.value {
        let pin = match coil.op.op {
            ob1_ir::Op::SetCounter(_) => signs::counter_pins(german)[3],
            _ => signs::timer_pins(german)[0],
        };
        inputs.push(Pin::new(pin, At::Value(names.value(value.statement), value.statement)));
    }
    let (above, statement) = (names.above(coil.op.statement), coil.op.statement);
    Frame { above, statement, inputs, rails: false, ..Frame::new(coil.id, title.to_owned()) }.draw(names)
}

/// What leads to a pin, drawn without the pin.
fn as_sketch(at: At) -> Sketch {
    match at {
        At::Open | At::Value(..) => Sketch::new(0, 1, 0),
        At::Operand(text, statement, id, negate) => {
            let width = columns(&text);
            let mut sketch = Sketch::new(width + 1, 1, 0);
            sketch.put(Place::At(id), Shape::Name { row: 0, column: 0, text, statement });
            end_of(&mut sketch, id, negate, width);
            sketch
        }
        At::Logic(mut sketch, id, negate) => {
            let width = sketch.width;
            end_of(&mut sketch, id, negate, width);
            sketch
        }
    }
}

fn end_of(sketch: &mut Sketch, id: u32, negate: bool, column: usize) {
    let row = sketch.wire;
    sketch.width = column + 1;
    if negate {
        let text = "o".to_owned();
        sketch.put(Place::At(id), Shape::Sign { row, column, text, class: Class::Box });
    } else {
        sketch.along(Place::After(id), row, 2 * column, 2 * column + 2);
    }
}

/// Logic as it is at the pin of a box.
fn at(names: &Names<'_>, node: &Node) -> At {
    let first = node.statements.start;
    match &node.kind {
        Kind::Contact { negate, .. } => At::Operand(names.value(first), first, node.id, *negate),
        Kind::Wire { negate, .. } => At::Logic(Sketch::new(0, 1, 0), node.id, *negate),
        Kind::Series { items, .. } => series(names, node.id, items),
        Kind::Parallel(legs) => At::Logic(gate(names, node.id, ">=1", legs), node.id, false),
        Kind::Xor(legs) => At::Logic(gate(names, node.id, "XOR", legs), node.id, false),
        Kind::Negated(inner) => match at(names, inner) {
            At::Operand(text, statement, id, negate) => At::Operand(text, statement, id, !negate),
            At::Logic(sketch, _, false) => At::Logic(sketch, node.id, true),
            other => At::Logic(single(names, inner.id, other), node.id, true),
        },
        Kind::Compare { values, format, how } => {
            let pins = values.iter().zip(["IN1", "IN2"]);
            let value = |at: u32| At::Value(names.value(at), at);
            let inputs = pins.map(|(one, pin)| Pin::new(pin, value(one.statement))).collect();
            let frame = Frame { statement: first, ..sign(node.id, &signs::compare(*format, *how), inputs) };
            At::Logic(frame.draw(names), node.id, false)
        }
        Kind::Box(inner) => {
            let frame = boxes::frame(names, node, inner, &|input| at(names, input));
            At::Logic(Frame { rails: false, ..frame }.draw(names), node.id, false)
        }
        // Alone they are never.
        Kind::Not | Kind::Edge { .. } | Kind::Connector(_) => unary(names, node, At::Open),
    }
}

/// `&` or another gate with any number of inputs.
fn gate(names: &Names<'_>, id: u32, title: &str, legs: &[Node]) -> Sketch {
    sign(id, title, legs.iter().map(|leg| Pin::new("", at(names, leg))).collect()).draw(names)
}

fn single(names: &Names<'_>, id: u32, lead: At) -> Sketch {
    sign(id, "&", vec![Pin::new("", lead)]).draw(names)
}

/// A box with one output that feeds the next.
fn sign(id: u32, title: &str, inputs: Vec<Pin>) -> Frame {
    let outputs = vec![Pin::new("", At::Open)];
    Frame { inputs, outputs, used: true, rails: false, ..Frame::new(id, title.to_owned()) }
}

/// NOT, edges and connectors act on all that stands before them: `&`, then they.
fn series(names: &Names<'_>, id: u32, items: &[Node]) -> At {
    let mut lead: Vec<At> = Vec::new();
    for item in items {
        if matches!(item.kind, Kind::Not | Kind::Edge { .. } | Kind::Connector(_)) {
            let before = joined(names, Place::Before(item.id), item.id, std::mem::take(&mut lead));
            lead.push(unary(names, item, before));
        } else {
            lead.push(at(names, item));
        }
    }
    joined(names, Place::At(id), id, lead)
}

/// What `&` gives of these; one alone needs none.
fn joined(names: &Names<'_>, place: Place, id: u32, mut lead: Vec<At>) -> At {
    if lead.len() == 1 {
        return lead.pop().unwrap_or(At::Open);
    }
    let mut frame = sign(id, "&", lead.into_iter().map(|at| Pin::new("", at)).collect());
    if matches!(place, Place::Before(_)) {
        frame.places = [place; 3];
    }
    let mut sketch = frame.draw(names);
    // The wire behind it is that of the pin it leads to.
    sketch.pieces.retain(|piece| !matches!(piece.shape, Shape::Along { from, to, .. } if from == to));
    At::Logic(sketch, id, false)
}

fn unary(names: &Names<'_>, node: &Node, before: At) -> At {
    let (title, statement) = match &node.kind {
        Kind::Not => {
            return match before {
                At::Operand(text, statement, _, false) => At::Operand(text, statement, node.id, true),
                At::Logic(sketch, _, false) => At::Logic(sketch, node.id, true),
                other => At::Logic(single(names, node.id, other), node.id, true),
            };
        }
        Kind::Edge { rising, boxed, .. } => (signs::edge(*boxed, *rising), node.statements.end.saturating_sub(1)),
        _ => ("#", node.statements.start),
    };
    let frame = Frame { above: names.above(statement), statement, ..sign(node.id, title, vec![Pin::new("", before)]) };
    At::Logic(frame.draw(names), node.id, false)
}
