//! What every drawing must hold: all operands and no other, nothing over anything else, no wire that ends nowhere.

use std::collections::{BTreeMap, BTreeSet};

use ob1_ir::{CallMode, Op, Target};
use ob1_ladder::tree::Tree;
use ob1_ladder::{Drawing, Form, Network, Options, Shape, draw, svg, text};

/// The names that must stand in a drawing: all operands but the compiler's bits and the labels of its jumps.
fn operands(network: &Network, tree: &Tree) -> BTreeSet<String> {
    let hidden: Vec<_> = ob1_ladder::carried(tree);
    let mut all = BTreeSet::new();
    for statement in &network.statements {
        let carried = statement.op.operand().is_some_and(|operand| hidden.contains(&operand.place));
        let own = matches!(&statement.op, Op::Jump(ob1_ir::Jump::IfNotRloSaveBr, _) | Op::Nop | Op::Build(_));
        // The block itself is the title of its box; the instance stands above it.
        let operand = match &statement.op {
            Op::Call(call) if call.mode == CallMode::Call => match (call.target, &call.instance) {
                (Target::Local(..), _) => statement.operand.rsplit(", ").next().unwrap_or_default(),
                (_, Some(_)) => statement.operand.rsplit(", ").next().unwrap_or_default(),
                _ => "",
            },
            _ => &statement.operand,
        };
        let status = matches!(statement.op, Op::Scan { test: ob1_ir::BitTest::Status(status), .. }
            if matches!(status, ob1_ir::StatusBit::BinaryResult | ob1_ir::StatusBit::Overflow));
        if !carried && !own && !status && !operand.is_empty() {
            all.insert(operand.to_owned());
        }
        for actual in &statement.actuals {
            let at_pin = hidden.iter().any(|place| match place {
                ob1_ir::Place::Fixed(_, at) => actual.text == format!("L {at}"),
                _ => false,
            });
            if !at_pin {
                all.insert(actual.text.clone());
            }
        }
    }
    all
}

/// The drawing of a network holds together.
pub(crate) fn check_drawing(seed: &str, network: &Network, tree: &Tree, form: Form) {
    let drawing = draw(network, tree, &Options { form, ..Options::default() });
    let mut cells: BTreeMap<(usize, usize), String> = BTreeMap::new();
    let mut drawn = BTreeSet::new();
    let mut take = |row: usize, column: usize, what: String| {
        assert!(row < drawing.height && column < drawing.width, "{seed}: {what} outside at {row}:{column}");
        if let Some(other) = cells.insert((row, column), what.clone()) {
            let lines = text::lines(&drawing, false).join("\n");
            panic!("{seed}: {what} over {other} at {row}:{column}\n{lines}");
        }
    };
    // Wires of different ends may share a cell where they meet only: there one has a half of it.
    let mut halves = BTreeSet::new();
    let mut wires = BTreeSet::new();
    for piece in &drawing.pieces {
        match &piece.shape {
            Shape::Along { row, from, to } => {
                for half in *from..*to {
                    assert!(
                        halves.insert((*row, half)),
                        "{seed}: two wires at {row}:{half}\n{}",
                        text::lines(&drawing, false).join("\n")
                    );
                    wires.insert((*row, half / 2));
                }
            }
            Shape::Down { column, from, to } => wires.extend((*from..=*to).map(|row| (row, *column))),
            Shape::Sign { row, column, text, .. } | Shape::Name { row, column, text, .. } => {
                for (at, sign) in text.chars().enumerate() {
                    take(*row, column + at, sign.to_string());
                }
                if matches!(piece.shape, Shape::Name { .. }) {
                    drawn.insert(text.clone());
                }
            }
            Shape::Frame { row, column, width, height, .. } => {
                for at in *column..column + width {
                    take(*row, at, "frame".to_owned());
                    take(row + height - 1, at, "frame".to_owned());
                }
                for at in row + 1..row + height - 1 {
                    take(at, *column, "frame".to_owned());
                    take(at, column + width - 1, "frame".to_owned());
                }
            }
        }
    }
    for cell in &wires {
        assert!(
            !cells.contains_key(cell),
            "{seed}: a wire through {:?}\n{}",
            cells[cell],
            text::lines(&drawing, false).join("\n")
        );
    }
    connected(seed, &drawing);
    let wanted = operands(network, tree);
    drawn.retain(|name| !["BIE", "OV"].contains(&name.as_str()));
    let wanted: BTreeSet<String> = wanted.into_iter().map(|name| cut(&name)).collect();
    assert_eq!(wanted, drawn, "{seed}\n{}", text::lines(&drawing, false).join("\n"));
    let picture = svg::svg(network, tree, &drawing, None);
    assert!(picture.starts_with("<svg") && picture.ends_with("</svg>\n") && !picture.contains("<script"));
}

/// Every wire's both ends touch another wire, a sign or a frame.
fn connected(seed: &str, drawing: &Drawing) {
    let rows = text::cells(drawing, false);
    let sign = |row: usize, column: usize| rows.get(row).and_then(|r| r.get(column)).map_or(' ', |cell| cell.sign);
    for piece in &drawing.pieces {
        let Shape::Along { row, from, to } = piece.shape else { continue };
        for (cell, beside) in [
            (from / 2, (from % 2 == 0).then(|| (from / 2).checked_sub(1)).flatten()),
            ((to - 1) / 2, (to % 2 == 0).then_some(to / 2)),
        ] {
            assert_ne!(sign(row, cell), ' ', "{seed}");
            if let Some(beside) = beside {
                assert_ne!(
                    sign(row, beside),
                    ' ',
                    "{seed}: a wire ends at {row}:{beside}\n{}",
                    text::lines(drawing, false).join("\n")
                );
            }
        }
    }
}

/// A name as it is cut.
fn cut(name: &str) -> String {
    let chars: Vec<char> = name.chars().collect();
    if chars.len() <= 26 {
        return name.to_owned();
    }
    chars[..12].iter().chain(&['.', '.']).chain(&chars[chars.len() - 12..]).collect()
}
