//! Boxes: a frame with pins. Its wire row is that of its first input and its first output.

use super::names::Names;
use super::sketch::{Class, Place, Shape, Sketch, columns};

/// What is at a pin.
pub(crate) enum At {
    /// Nothing: the pin stays open.
    Open,
    /// A text, and whose operand it is.
    Value(String, u32),
    /// Logic; its number, and whether there is a bubble at the pin.
    Logic(Sketch, u32, bool),
    /// An operand that is asked for its state, of a function plan; its number and whether it is negated.
    Operand(String, u32, u32, bool),
}

/// A pin of a box.
pub(crate) struct Pin {
    pub(crate) name: String,
    pub(crate) at: At,
}

impl Pin {
    pub(crate) fn new(name: &str, at: At) -> Self {
        Self { name: name.to_owned(), at }
    }
}

/// A box on its way.
pub(crate) struct Frame {
    /// The frame, what leads to it, what leads away.
    pub(crate) places: [Place; 3],
    pub(crate) title: String,
    /// Names above it, and the statement they are the operand of.
    pub(crate) above: Vec<String>,
    pub(crate) statement: u32,
    pub(crate) inputs: Vec<Pin>,
    /// The first one is on the wire row.
    pub(crate) outputs: Vec<Pin>,
    /// The first output goes on.
    pub(crate) used: bool,
    /// Logic at other inputs reaches the left rail; else it has a rail of its own.
    pub(crate) at_rail: bool,
    /// Logic begins at rails: ladder, not function plan.
    pub(crate) rails: bool,
}

impl Frame {
    /// A frame without anything.
    pub(crate) fn new(id: u32, title: String) -> Self {
        Self {
            places: [Place::At(id), Place::Before(id), Place::After(id)],
            title,
            above: Vec::new(),
            statement: 0,
            inputs: Vec::new(),
            outputs: Vec::new(),
            used: false,
            at_rail: false,
            rails: true,
        }
    }

    pub(crate) fn draw(self, names: &Names<'_>) -> Sketch {
        let above = self.above.iter().skip_while(|name| name.is_empty()).cloned().collect::<Vec<_>>();
        let left = self.inputs.iter().map(|pin| pin.left(self.rails)).max().unwrap_or(0);
        let inner =
            [&self.inputs, &self.outputs].map(|pins| pins.iter().map(|pin| columns(&pin.name)).max().unwrap_or(0));
        let title = columns(&self.title) + 2;
        let widest = above.iter().map(|name| columns(name)).max().unwrap_or(0);
        let inside = (inner[0] + inner[1] + 1).max(title).max(widest.saturating_sub(2));
        let width = inside + 2;
        let right = self.outputs.iter().map(Pin::right).max().unwrap_or(0).max(usize::from(self.used));
        let first_wire = match self.inputs.first().map(|pin| &pin.at) {
            Some(At::Logic(sketch, ..)) => sketch.wire,
            _ => 0,
        };
        let wire = first_wire.max(1 + above.len()).max(names.rows);
        let mut sketch = Sketch::new(left + width + right, wire + 1, wire);
        let rows = pin_rows(&self.inputs, wire);
        self.draw_inputs(&mut sketch, &rows, left);
        let mut row = rows.iter().copied().max().unwrap_or(wire);
        for (at, pin) in self.outputs.iter().enumerate() {
            pin.draw_right(&mut sketch, self.places[0], wire + at, left + width);
            row = row.max(wire + at);
        }
        let edge = left + width;
        for (row, pin) in rows.iter().zip(&self.inputs) {
            self.name(&mut sketch, *row, left + 1, &pin.name);
        }
        for (at, pin) in self.outputs.iter().enumerate() {
            self.name(&mut sketch, wire + at, edge - 1 - columns(&pin.name), &pin.name);
        }
        if self.used {
            sketch.along(self.places[2], wire, 2 * edge, 2 * (edge + right));
        }
        let frame =
            Shape::Frame { row: wire - 1, column: left, width, height: row + 3 - wire, title: self.title.clone() };
        sketch.put(self.places[0], frame);
        sketch.height = sketch.height.max(row + 2);
        for (at, name) in above.iter().enumerate().filter(|(_, name)| !name.is_empty()) {
            let column = left + (width - columns(name)) / 2;
            let row = wire - 1 - above.len() + at;
            let shape = Shape::Name { row, column, text: name.clone(), statement: self.statement };
            sketch.put(self.places[0], shape);
        }
        sketch
    }

    fn name(&self, sketch: &mut Sketch, row: usize, column: usize, name: &str) {
        if !name.is_empty() {
            let text = name.to_owned();
            sketch.put(self.places[0], Shape::Sign { row, column, text, class: Class::Box });
        }
    }

    /// What is at the left.
    fn draw_inputs(&self, sketch: &mut Sketch, rows: &[usize], left: usize) {
        for (at, (pin, row)) in self.inputs.iter().zip(rows.iter().copied()).enumerate() {
            match &pin.at {
                At::Open if at == 0 && self.rails => {
                    sketch.along(self.places[1], row, 0, 2 * left);
                }
                At::Open => {}
                At::Value(text, statement) => {
                    let column = left - 1 - columns(text);
                    let shape = Shape::Name { row, column, text: text.clone(), statement: *statement };
                    sketch.put(self.places[0], shape);
                    sketch.along(self.places[0], row, 2 * (left - 1), 2 * left);
                }
                At::Operand(text, statement, id, negate) => {
                    let column = left - 1 - columns(text);
                    let shape = Shape::Name { row, column, text: text.clone(), statement: *statement };
                    sketch.put(Place::At(*id), shape);
                    if *negate {
                        bubble(sketch, *id, row, left - 1);
                    } else {
                        sketch.along(Place::After(*id), row, 2 * (left - 1), 2 * left);
                    }
                }
                At::Logic(logic, id, negate) => {
                    let (up, ends) = (row - logic.wire, logic.width);
                    let rail = self.rails && at > 0 && !self.at_rail;
                    // In a function plan nothing comes from the left.
                    let from = if self.rails { usize::from(rail) } else { left - usize::from(*negate) - ends };
                    let from = if at == 0 { 0 } else { from };
                    sketch.insert(logic.clone(), up, from);
                    if rail {
                        sketch.put(Place::Rail, Shape::Along { row, from: 1, to: 2 });
                        sketch.put(Place::Rail, Shape::Down { column: 0, from: row - 1, to: row });
                    }
                    if *negate {
                        bubble(sketch, *id, row, left - 1);
                    }
                    sketch.along(Place::After(*id), row, 2 * (from + ends), 2 * (left - usize::from(*negate)));
                }
            }
        }
    }
}

fn bubble(sketch: &mut Sketch, id: u32, row: usize, column: usize) {
    let sign = Shape::Sign { row, column, text: "o".to_owned(), class: Class::Box };
    sketch.put(Place::At(id), sign);
}

/// The rows of the pins at the left.
fn pin_rows(pins: &[Pin], wire: usize) -> Vec<usize> {
    let mut next = wire;
    let row_of = |(at, pin): (usize, &Pin)| {
        let row = if at == 0 { wire } else { pin.row(next) };
        next = pin.bottom(row);
        row
    };
    pins.iter().enumerate().map(row_of).collect()
}

impl Pin {
    /// Columns at the left of the frame.
    fn left(&self, rails: bool) -> usize {
        match &self.at {
            At::Open => usize::from(rails),
            At::Value(text, _) | At::Operand(text, ..) => columns(text) + 1,
            At::Logic(sketch, _, negate) => sketch.width + 1 + usize::from(*negate),
        }
    }

    /// The row, when this one is free.
    fn row(&self, next: usize) -> usize {
        match &self.at {
            At::Logic(sketch, ..) => next + sketch.wire,
            _ => next,
        }
    }

    /// The first row that is free behind it.
    fn bottom(&self, row: usize) -> usize {
        match &self.at {
            At::Logic(sketch, ..) => row + (sketch.height - sketch.wire).max(1),
            _ => row + 1,
        }
    }

    fn right(&self) -> usize {
        match &self.at {
            At::Value(text, _) => columns(text) + 1,
            _ => 0,
        }
    }

    fn draw_right(&self, sketch: &mut Sketch, place: Place, row: usize, edge: usize) {
        if let At::Value(text, statement) = &self.at {
            sketch.along(place, row, 2 * edge, 2 * edge + 2);
            let shape = Shape::Name { row, column: edge + 1, text: text.clone(), statement: *statement };
            sketch.put(place, shape);
        }
    }
}
