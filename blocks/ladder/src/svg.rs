//! A drawing as SVG, on the cells of the text: 8 by 16 pixels each. Colours come by classes alone, light and dark;
//! there is no script in it, and text stays text.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use crate::flow::{Flow, State};
use crate::layout::{Class, Drawing, Piece, Place, Shape};
use crate::network::Network;
use crate::tree::{End, Node, Rung, Tree};

const ACROSS: usize = 8;
const DOWN: usize = 16;
/// Pixels around the drawing.
const MARGIN: usize = 8;

/// Classes and their colours. A file stands alone; a page may have its own.
pub const STYLE: &str = "\
.ladder{background:#fff;color:#111;font:13px/16px monospace}\
.ladder .wire,.ladder .sign{stroke:currentColor;fill:none;stroke-width:1.5}\
.ladder text{fill:currentColor;stroke:none;white-space:pre}\
.ladder .on{color:#0a8a0a}.ladder .off{color:#2a50c8}.ladder .off .wire{stroke-dasharray:3 3}\
.ladder .added{color:#0a8a0a}.ladder .gone{color:#c02020}\
@media(prefers-color-scheme:dark){.ladder{background:#111;color:#eee}.ladder .on,.ladder .added{color:#4cd964}\
.ladder .off{color:#7aa2ff}.ladder .gone{color:#ff6b6b}}";

/// The drawing of a network. With a flow its parts have the classes `on` and `off`.
pub fn svg(network: &Network, tree: &Tree, drawing: &Drawing, flow: Option<&Flow>) -> String {
    whole(network, tree, drawing, flow, &format!("<style>{STYLE}</style>"))
}

/// The drawing of a network for a page that has its own colours for the classes.
pub fn bare_svg(network: &Network, tree: &Tree, drawing: &Drawing) -> String {
    whole(network, tree, drawing, None, "")
}

fn whole(network: &Network, tree: &Tree, drawing: &Drawing, flow: Option<&Flow>, style: &str) -> String {
    let [width, height] = size(drawing);
    // The parts of a picture are none for a reader of the screen; those of a page can be pointed at.
    let role = if style.is_empty() { "group" } else { "img" };
    let mut out = String::new();
    let _ = writeln!(
        out,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"ladder\" width=\"{width}\" height=\"{height}\" viewBox=\"-{MARGIN} \
         -{MARGIN} {width} {height}\" role=\"{role}\"><title>{}</title>{style}",
        escaped(&heading(network))
    );
    let mut groups: BTreeMap<Place, Vec<&Piece>> = BTreeMap::new();
    for piece in &drawing.pieces {
        groups.entry(piece.place).or_default().push(piece);
    }
    let nodes = nodes(tree);
    for (place, pieces) in groups {
        group(&mut out, network, &nodes, place, &pieces, flow);
    }
    out.push_str("</svg>\n");
    out
}

/// Width and height of a drawing with its margin, in pixels.
pub const fn size(drawing: &Drawing) -> [usize; 2] {
    [drawing.width * ACROSS + 2 * MARGIN, drawing.height * DOWN + 2 * MARGIN]
}

/// Number and title: `Network 3: title`.
pub fn heading(network: &Network) -> String {
    let colon = if network.title.is_empty() { "" } else { ": " };
    format!("Network {}{colon}{}", network.number, network.title)
}

/// Each node's statements, by its number.
fn nodes(tree: &Tree) -> BTreeMap<u32, (u32, u32)> {
    let mut all = BTreeMap::new();
    tree.rungs.iter().for_each(|rung| of_rung(rung, &mut all));
    all
}

fn of_rung(rung: &Rung, all: &mut BTreeMap<u32, (u32, u32)>) {
    if let Some(logic) = &rung.logic {
        of_node(logic, all);
    }
    for end in &rung.ends {
        let (id, range) = match end {
            End::Coil(coil) => (coil.id, &coil.statements),
            End::Branch { id, statements, arms, .. } => {
                arms.iter().for_each(|arm| of_rung(arm, all));
                (*id, statements)
            }
        };
        all.insert(id, (range.start, range.end.saturating_sub(1)));
    }
}

fn of_node(node: &Node, all: &mut BTreeMap<u32, (u32, u32)>) {
    all.insert(node.id, (node.statements.start, node.statements.end.saturating_sub(1)));
    node.children().into_iter().for_each(|child| of_node(child, all));
}

fn group(
    out: &mut String,
    network: &Network,
    nodes: &BTreeMap<u32, (u32, u32)>,
    place: Place,
    pieces: &[&Piece],
    flow: Option<&Flow>,
) {
    // The part is the place among the states of a node, see `Flow::nodes`.
    let id = match place {
        Place::Before(id) => Some((id, 0)),
        Place::At(id) => Some((id, 1)),
        Place::After(id) => Some((id, 2)),
        Place::Rail => None,
    };
    let class = match place {
        Place::At(_) => pieces.iter().find_map(|piece| class_of(&piece.shape)).unwrap_or("wire"),
        _ => "wire",
    };
    let state = match flow.map(|flow| flow.of(place)) {
        Some(State::On) => " on",
        Some(State::Off) => " off",
        _ => "",
    };
    let _ = write!(out, "<g class=\"{class}{state}\"");
    if let Some((id, part)) = id {
        let _ = write!(out, " data-node=\"{id}\" data-part=\"{part}\"");
        if let Some((first, last)) = nodes.get(&id) {
            let _ = write!(out, " data-stmt=\"{first}-{last}\"");
        }
    }
    let named = pieces.iter().find_map(|piece| match &piece.shape {
        Shape::Name { statement, .. } => network.statements.get(*statement as usize),
        _ => None,
    });
    match named {
        Some(named) => {
            let _ = write!(out, " data-operand=\"{}\">", escaped(&named.operand));
            let words = [&named.operand, &named.symbol];
            let words: Vec<&str> = words.into_iter().filter(|w| !w.is_empty()).map(String::as_str).collect();
            let _ = write!(out, "<title>{}</title>", escaped(&words.join(" ")));
        }
        None => out.push('>'),
    }
    let mut path = String::new();
    for piece in pieces {
        shape(out, &mut path, &piece.shape);
    }
    if !path.is_empty() {
        let _ = write!(out, "<path class=\"wire\" d=\"{}\"/>", path.trim_end());
    }
    out.push_str("</g>\n");
}

const fn class_of(shape: &Shape) -> Option<&'static str> {
    match shape {
        Shape::Sign { class: Class::Contact, .. } => Some("contact"),
        Shape::Sign { class: Class::Coil, .. } => Some("coil"),
        Shape::Sign { class: Class::Cut, .. } => Some("cut"),
        Shape::Frame { .. } | Shape::Sign { class: Class::Box, .. } => Some("box"),
        _ => None,
    }
}

fn shape(out: &mut String, path: &mut String, shape: &Shape) {
    match shape {
        Shape::Along { row, from, to } => {
            let _ = write!(path, "M{} {}H{} ", from * ACROSS / 2, row * DOWN + DOWN / 2, to * ACROSS / 2);
        }
        Shape::Down { column, from, to } => {
            let x = column * ACROSS + ACROSS / 2;
            let _ = write!(path, "M{x} {}V{} ", from * DOWN + DOWN / 2, to * DOWN + DOWN / 2);
        }
        Shape::Sign { row, column, text, class: Class::Contact } => contact(out, *row, *column, text),
        Shape::Sign { row, column, text, .. } | Shape::Name { row, column, text, .. } => {
            words(out, *row, *column, text);
        }
        Shape::Frame { row, column, width, height, title } => {
            let (x, y) = (column * ACROSS + ACROSS / 2, row * DOWN + DOWN / 2);
            let (w, h) = ((width - 1) * ACROSS, (height - 1) * DOWN);
            let _ = write!(out, "<rect class=\"sign\" x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\"/>");
            let from = column + 1 + (width - 2 - title.chars().count()) / 2;
            // Small, on the upper edge: below a name above the box, and above the pins.
            let _ = write!(
                out,
                "<text x=\"{}\" y=\"{}\" font-size=\"11\">{}</text>",
                from * ACROSS,
                row * DOWN + DOWN / 2 - 2,
                escaped(title)
            );
        }
    }
}

fn words(out: &mut String, row: usize, column: usize, text: &str) {
    let length = text.chars().count() * ACROSS;
    let (x, y) = (column * ACROSS, row * DOWN + DOWN - 4);
    let _ = write!(out, "<text x=\"{x}\" y=\"{y}\" textLength=\"{length}\">{}</text>", escaped(text));
}

/// Two bars, and what stands between them.
fn contact(out: &mut String, row: usize, column: usize, text: &str) {
    let (last, top) = (column + text.chars().count() - 1, row * DOWN + 1);
    let middle = |column: usize| column * ACROSS + ACROSS / 2;
    let y = row * DOWN + DOWN / 2;
    let _ = write!(
        out,
        "<path class=\"sign\" d=\"M{0} {y}H{1}V{top}V{2} M{3} {y}H{4}V{top}V{2}\"/>",
        column * ACROSS,
        middle(column),
        top + DOWN - 2,
        (last + 1) * ACROSS,
        middle(last)
    );
    let inside: String = text.chars().skip(1).take(last - column - 1).collect();
    if !inside.trim().is_empty() {
        words(out, row, column + 1, &inside);
    }
}

/// A text between tags or quotes.
pub fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            // No document of XML has them.
            c if c < ' ' && c != '\t' => out.push(' '),
            c => out.push(c),
        }
    }
    out
}
