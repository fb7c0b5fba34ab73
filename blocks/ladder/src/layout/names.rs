//! Names of elements: symbol and address, cut where they are too long.

use super::Options;
use super::sketch::{Class, Place, Shape, Sketch, columns};
use crate::network::{Actual, Network, Statement};

/// What names are shown, and how many rows they take.
pub(crate) struct Names<'n> {
    pub(crate) network: &'n Network,
    pub(crate) options: Options,
    /// Rows above each element.
    pub(crate) rows: usize,
}

impl<'n> Names<'n> {
    pub(crate) fn new(network: &'n Network, options: Options) -> Self {
        let has_symbols = network.statements.iter().any(|s| !s.symbol.is_empty());
        let rows = if options.names == super::NamesShown::Both && has_symbols { 2 } else { 1 };
        Self { network, options, rows }
    }

    fn statement(&self, at: u32) -> Option<&'n Statement> {
        self.network.statements.get(at as usize)
    }

    /// The rows above an element, from the top.
    pub(crate) fn above(&self, statement: u32) -> Vec<String> {
        let Some(found) = self.statement(statement) else { return vec![String::new(); self.rows] };
        let (address, symbol) = (self.cut(&found.operand), self.cut(&found.symbol));
        match (self.rows, symbol.is_empty()) {
            (2, true) => vec![String::new(), address],
            (2, false) => vec![symbol, address],
            (_, false) if self.options.names != super::NamesShown::Address => vec![symbol],
            _ => vec![address],
        }
    }

    /// A value on a line of its own: the symbol, else the address.
    pub(crate) fn value(&self, statement: u32) -> String {
        let Some(found) = self.statement(statement) else { return String::new() };
        // An addend, a number of places: what the operation says itself.
        self.one(&found.operand, &found.symbol)
    }

    pub(crate) fn actual(&self, actual: &Actual) -> String {
        self.one(&actual.text, &actual.symbol)
    }

    fn one(&self, address: &str, symbol: &str) -> String {
        let named = self.options.names != super::NamesShown::Address && !symbol.is_empty();
        self.cut(if named { symbol } else { address })
    }

    /// A text that fits the longest name: its middle goes.
    fn cut(&self, text: &str) -> String {
        let (long, most) = (columns(text), self.options.longest_name.max(6));
        if long <= most {
            return text.to_owned();
        }
        let (head, tail) = ((most - 2).div_ceil(2), (most - 2) / 2);
        let start: String = text.chars().take(head).collect();
        let end: String = text.chars().skip(long - tail).collect();
        format!("{start}..{end}")
    }

    pub(crate) fn actuals(&self, statement: u32) -> &'n [Actual] {
        self.statement(statement).map_or(&[], |found| found.actuals.as_slice())
    }

    /// A sign on the wire with names above it, and wire at both sides.
    pub(crate) fn element(&self, id: u32, above: &[String], statement: u32, sign: &str, class: Class) -> Sketch {
        let widest = above.iter().map(|name| columns(name)).max().unwrap_or(0);
        let width = (widest + 2).max(columns(sign) + 4);
        let mut sketch = Sketch::new(width, self.rows + 1, self.rows);
        let column = (width - columns(sign)) / 2;
        sketch.along(Place::Before(id), self.rows, 0, 2 * column);
        sketch.put(Place::At(id), Shape::Sign { row: self.rows, column, text: sign.to_owned(), class });
        sketch.along(Place::After(id), self.rows, 2 * (column + columns(sign)), 2 * width);
        for (row, name) in above.iter().enumerate().filter(|(_, name)| !name.is_empty()) {
            let column = (width - columns(name)) / 2;
            sketch.put(Place::At(id), Shape::Name { row, column, text: name.clone(), statement });
        }
        sketch
    }
}
