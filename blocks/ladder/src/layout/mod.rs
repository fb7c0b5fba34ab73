//! Trees to drawings: one grid of cells for text and SVG.

pub(crate) mod boxes;
pub(crate) mod frame;
mod ladder;
mod names;
mod plan;
pub(crate) mod signs;
mod sketch;
mod suits;

use std::collections::BTreeSet;

use ob1_stl::Mnemonics;

pub use sketch::{Class, Piece, Place, Shape};
pub use suits::is_ladder;

use crate::network::Network;
use crate::tree::{Kind, Node, Tree};
pub(crate) use names::Names;
use sketch::{Sketch, columns};

/// Which view a network is drawn in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// LAD, where the network has one; else FBD.
    Ladder,
    /// FBD, whatever the network was made in.
    Plan,
}

/// What stands at an element.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NamesShown {
    /// The address, also where there is a symbol.
    Address,
    /// The symbol, where there is one.
    Symbol,
    /// Both, one above the other.
    Both,
}

/// How a network is drawn.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// The view: LAD or FBD.
    pub form: Form,
    /// What stands at an element.
    pub names: NamesShown,
    /// Columns of a name; longer ones are cut in the middle.
    pub longest_name: usize,
    /// Columns of the whole drawing, beyond which a row goes on below; as wide as it is without.
    pub wrap: Option<usize>,
    /// The words of boxes, coils and pins.
    pub mnemonics: Mnemonics,
}

impl Default for Options {
    fn default() -> Self {
        Self { form: Form::Ladder, names: NamesShown::Both, longest_name: 26, wrap: None, mnemonics: Mnemonics::German }
    }
}

/// A network as a drawing of cells.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Drawing {
    /// Cells in a row.
    pub width: usize,
    /// Number of rows of cells.
    pub height: usize,
    /// What stands in the cells.
    pub pieces: Vec<Piece>,
    /// The form it has: a ladder that was wanted may be none.
    pub is_plan: bool,
}

/// The drawing of a network.
pub fn draw(network: &Network, tree: &Tree, options: &Options) -> Drawing {
    let names = Names::new(network, *options);
    let is_plan = options.form == Form::Plan || !is_ladder(tree);
    let (mut whole, mut wires) = (Sketch::default(), Vec::new());
    // The rail.
    let left = usize::from(!is_plan);
    let widest = if is_plan { 0 } else { target(&names, tree) };
    for rung in &tree.rungs {
        let parts = match (is_plan, options.wrap) {
            (true, _) => vec![plan::rung(&names, rung)],
            (false, Some(most)) if widest + 1 > most => wrapped(&names, rung, most.saturating_sub(1)),
            (false, _) => vec![ladder::rung(&names, rung, widest, true)],
        };
        for part in parts {
            let top = if whole.height == 0 { 0 } else { whole.height + usize::from(is_plan) };
            wires.push(top + part.wire);
            whole.insert(part, top, left);
        }
    }
    if !is_plan && !wires.is_empty() {
        // Every wire that begins beside the rail comes from it.
        let begins = |piece: &Piece| match piece.shape {
            Shape::Along { row, from: 2, .. } => Some(row),
            _ => None,
        };
        let rows: BTreeSet<usize> = whole.pieces.iter().filter_map(begins).collect();
        for row in rows {
            whole.put(Place::Rail, Shape::Along { row, from: 1, to: 2 });
        }
        whole.down(Place::Rail, 0, 0, whole.height.saturating_sub(1));
    }
    Drawing { width: whole.width, height: whole.height, pieces: whole.pieces, is_plan }
}

/// The column in which the coils of all rungs end.
fn target(names: &Names<'_>, tree: &Tree) -> usize {
    tree.rungs.iter().map(|rung| ladder::rung(names, rung, 0, true).width).max().unwrap_or(0)
}

/// A rung in pieces that fit: cut in its series, between two elements.
fn wrapped(names: &Names<'_>, rung: &crate::tree::Rung, most: usize) -> Vec<Sketch> {
    let one = || vec![ladder::rung(names, rung, 0, true)];
    let Some(Node { kind: Kind::Series { items, .. }, .. }) = &rung.logic else { return one() };
    let ends = ladder::rung(names, &crate::tree::Rung { logic: None, ends: rung.ends.clone() }, 0, true);
    let (mut rows, mut row): (Vec<Sketch>, Option<Sketch>) = (Vec::new(), None);
    // Room for the mark at either end.
    let room = most.saturating_sub(2 * CUT);
    let mut parts: Vec<(Place, Sketch)> = Vec::new();
    for (at, item) in items.iter().enumerate() {
        parts.push((Place::Before(item.id), ladder::node(names, item, at == 0)));
    }
    parts.push((rung.logic.as_ref().map_or(Place::Rail, |node| Place::After(node.id)), ends));
    for (before, part) in parts {
        row = Some(match row {
            Some(full) if full.width + part.width > room => {
                rows.push(full.beside(mark(names, before, rows.len() + 1, false)));
                mark(names, before, rows.len(), true).beside(part)
            }
            Some(open) => open.beside(part),
            None => part,
        });
    }
    rows.extend(row);
    rows
}

/// The names of a network for the one-line form.
pub(crate) fn names<'n>(network: &'n Network, options: Options) -> Names<'n> {
    Names::new(network, options)
}

/// Columns that the mark `─>1` takes.
const CUT: usize = 4;

/// Where a row goes on below, or where it comes from.
fn mark(names: &Names<'_>, place: Place, number: usize, begins: bool) -> Sketch {
    let text = if begins { format!("{number}>") } else { format!(">{number}") };
    let width = columns(&text) + 1;
    let mut sketch = Sketch::new(width, names.rows + 1, names.rows);
    let column = usize::from(!begins);
    let (from, to) = if begins { (2 * width - 2, 2 * width) } else { (0, 2) };
    sketch.put(place, Shape::Sign { row: names.rows, column, text, class: Class::Cut });
    sketch.along(place, names.rows, from, to);
    sketch
}
