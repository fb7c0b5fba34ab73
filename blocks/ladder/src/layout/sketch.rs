//! Parts of a drawing: cells of a text grid, from which text and SVG are made alike.

/// What a node's wire or sign belongs to, for colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Place {
    /// The left power rail.
    Rail,
    /// What leads to a node.
    Before(u32),
    /// The node with this number.
    At(u32),
    /// What leads away from it.
    After(u32),
}

/// The kind of a sign or text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Class {
    /// `┤ ├`, `┤/├`, `┤NOT├`.
    Contact,
    /// A coil: `(   )`.
    Coil,
    /// A frame, and what stands in it.
    Box,
    /// The end of a row that goes on below, and its begin there.
    Cut,
}

/// A piece of a drawing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Piece {
    /// What it belongs to, for its colour.
    pub place: Place,
    /// Shape and position of the piece.
    pub shape: Shape,
}

/// The shapes, in cells: rows from the top, columns from the left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Shape {
    /// A wire along a row, from one edge of a cell to another: `2 * column` is the left edge of a cell, one more its
    /// middle.
    Along {
        /// Row of the wire, from the top.
        row: usize,
        /// Half cell at which it begins.
        from: usize,
        /// Where it ends, behind that.
        to: usize,
    },
    /// A wire down a column, from the middle of one row to that of another.
    Down {
        /// Column of the wire, from the left.
        column: usize,
        /// The upper row, where it begins.
        from: usize,
        /// The lower row, where it ends.
        to: usize,
    },
    /// A sign on a wire row, or the name of a pin.
    Sign {
        /// Row of the sign, from the top.
        row: usize,
        /// Column of its first character.
        column: usize,
        /// Its characters, one a cell.
        text: String,
        /// Kind of the sign, for its colour.
        class: Class,
    },
    /// A name or a value.
    Name {
        /// Row of the name, from the top.
        row: usize,
        /// Column of its first character.
        column: usize,
        /// As it is shown, perhaps cut.
        text: String,
        /// Whose operand it is, as the index of the statement.
        statement: u32,
    },
    /// The frame of a box, its title in the upper edge.
    Frame {
        /// Row of the upper edge.
        row: usize,
        /// Column of the left edge.
        column: usize,
        /// Columns with both edges.
        width: usize,
        /// Rows with both edges.
        height: usize,
        /// What the box is.
        title: String,
    },
}

impl Shape {
    fn shift(&mut self, rows: usize, columns: usize) {
        match self {
            Shape::Along { row, from, to } => {
                *row += rows;
                *from += 2 * columns;
                *to += 2 * columns;
            }
            Shape::Down { column, from, to } => {
                *column += columns;
                *from += rows;
                *to += rows;
            }
            Shape::Sign { row, column, .. } | Shape::Name { row, column, .. } | Shape::Frame { row, column, .. } => {
                *row += rows;
                *column += columns;
            }
        }
    }
}

/// A rectangle with a wire row, which enters at the left edge and leaves at the right.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sketch {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// The row of the wire.
    pub(crate) wire: usize,
    pub(crate) pieces: Vec<Piece>,
}

impl Sketch {
    pub(crate) fn new(width: usize, height: usize, wire: usize) -> Self {
        Self { width, height, wire, pieces: Vec::new() }
    }

    pub(crate) fn put(&mut self, place: Place, shape: Shape) {
        self.pieces.push(Piece { place, shape });
    }

    /// A wire along a row, if it is one.
    pub(crate) fn along(&mut self, place: Place, row: usize, from: usize, to: usize) {
        if from < to {
            self.put(place, Shape::Along { row, from, to });
        }
    }

    pub(crate) fn down(&mut self, place: Place, column: usize, from: usize, to: usize) {
        if from < to {
            self.put(place, Shape::Down { column, from, to });
        }
    }

    /// Puts another one into this one.
    pub(crate) fn insert(&mut self, mut other: Self, row: usize, column: usize) {
        for piece in &mut other.pieces {
            piece.shape.shift(row, column);
        }
        self.pieces.append(&mut other.pieces);
        self.width = self.width.max(column + other.width);
        self.height = self.height.max(row + other.height);
    }

    /// Another one at the right of this one, wire to wire.
    pub(crate) fn beside(mut self, mut other: Self) -> Self {
        if self.wire < other.wire {
            let down = other.wire - self.wire;
            self.pieces.iter_mut().for_each(|piece| piece.shape.shift(down, 0));
            self.wire += down;
            self.height += down;
        }
        let down = self.wire - other.wire;
        for piece in &mut other.pieces {
            piece.shape.shift(down, self.width);
        }
        self.pieces.append(&mut other.pieces);
        self.width += other.width;
        self.height = self.height.max(other.height + down);
        self
    }
}

/// The columns a text takes.
pub(crate) fn columns(text: &str) -> usize {
    text.chars().count()
}
