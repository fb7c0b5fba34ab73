//! A drawing as text: box characters, or plain ASCII.

use crate::layout::{Drawing, Place, Shape};

const NORTH: u8 = 1;
const EAST: u8 = 2;
const SOUTH: u8 = 4;
const WEST: u8 = 8;

/// A cell of the grid: its character, and what it belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cell {
    /// The character that stands in it.
    pub sign: char,
    /// Where wires leave it, as bits.
    wires: u8,
    /// What it belongs to.
    pub place: Option<Place>,
}

const EMPTY: Cell = Cell { sign: ' ', wires: 0, place: None };

/// The cells of a drawing, row by row.
pub fn cells(drawing: &Drawing, ascii: bool) -> Vec<Vec<Cell>> {
    let mut grid = Grid { rows: vec![vec![EMPTY; drawing.width]; drawing.height], ascii };
    for piece in &drawing.pieces {
        grid.wires(&piece.shape, piece.place);
    }
    for cell in grid.rows.iter_mut().flatten().filter(|cell| cell.wires != 0) {
        cell.sign = wire(cell.wires, ascii);
    }
    for piece in &drawing.pieces {
        grid.signs(&piece.shape, piece.place);
    }
    grid.rows
}

/// The lines of a drawing, without blanks at their ends.
pub fn lines(drawing: &Drawing, ascii: bool) -> Vec<String> {
    let line = |row: Vec<Cell>| row.into_iter().map(|cell| cell.sign).collect::<String>().trim_end().to_owned();
    cells(drawing, ascii).into_iter().map(line).collect()
}

struct Grid {
    rows: Vec<Vec<Cell>>,
    ascii: bool,
}

impl Grid {
    fn cell(&mut self, row: usize, column: usize) -> Option<&mut Cell> {
        self.rows.get_mut(row)?.get_mut(column)
    }

    fn wire(&mut self, row: usize, column: usize, directions: u8, place: Place) {
        if let Some(cell) = self.cell(row, column) {
            cell.wires |= directions;
            cell.place.get_or_insert(place);
        }
    }

    fn sign(&mut self, row: usize, column: usize, sign: char, place: Place) {
        if let Some(cell) = self.cell(row, column) {
            (cell.sign, cell.place) = (sign, Some(place));
        }
    }

    fn wires(&mut self, shape: &Shape, place: Place) {
        match shape {
            Shape::Along { row, from, to } => {
                for half in *from..*to {
                    self.wire(*row, half / 2, if half % 2 == 0 { WEST } else { EAST }, place);
                }
            }
            Shape::Down { column, from, to } => {
                for row in *from..*to {
                    self.wire(row, *column, SOUTH, place);
                    self.wire(row + 1, *column, NORTH, place);
                }
                // A rail has no corners.
                if place == Place::Rail {
                    self.wire(*from, *column, NORTH, place);
                    self.wire(*to, *column, SOUTH, place);
                }
            }
            _ => {}
        }
    }

    fn text(&mut self, row: usize, column: usize, text: &str, place: Place) {
        for (at, sign) in text.chars().enumerate() {
            self.sign(row, column + at, sign, place);
        }
    }

    fn signs(&mut self, shape: &Shape, place: Place) {
        match shape {
            Shape::Sign { row, column, text, .. } if self.ascii => {
                self.text(*row, *column, &text.replace(['┤', '├'], "|"), place);
            }
            Shape::Sign { row, column, text, .. } | Shape::Name { row, column, text, .. } => {
                self.text(*row, *column, text, place);
            }
            Shape::Frame { row, column, width, height, title } => {
                let (right, bottom) = (column + width - 1, row + height - 1);
                for at in column + 1..right {
                    self.sign(*row, at, line(EAST | WEST, self.ascii), place);
                    self.sign(bottom, at, line(EAST | WEST, self.ascii), place);
                }
                for at in row + 1..bottom {
                    for (edge, outside) in [(*column, WEST), (right, EAST)] {
                        let beside = if outside == WEST { edge.checked_sub(1) } else { Some(edge + 1) };
                        let wired = beside
                            .and_then(|beside| self.cell(at, beside))
                            .is_some_and(|cell| cell.wires & (EAST | WEST) != 0 || cell.sign == 'o');
                        let directions = NORTH | SOUTH | if wired { outside } else { 0 };
                        self.sign(at, edge, line(directions, self.ascii), place);
                    }
                }
                let corners = [(*row, *column, EAST | SOUTH), (*row, right, WEST | SOUTH)];
                let below = [(bottom, *column, EAST | NORTH), (bottom, right, WEST | NORTH)];
                for (row, column, directions) in corners.into_iter().chain(below) {
                    self.sign(row, column, line(directions, self.ascii), place);
                }
                let from = column + 1 + (width - 2 - title.chars().count()) / 2;
                self.text(*row, from, title, place);
            }
            Shape::Along { .. } | Shape::Down { .. } => {}
        }
    }
}

/// The character of a wire that leaves its cell this way; one that ends in it is drawn through.
fn wire(directions: u8, ascii: bool) -> char {
    match directions {
        EAST | WEST => line(EAST | WEST, ascii),
        NORTH | SOUTH => line(NORTH | SOUTH, ascii),
        other => line(other, ascii),
    }
}

fn line(directions: u8, ascii: bool) -> char {
    const SIGNS: [char; 16] = [' ', '│', '─', '└', '│', '│', '┌', '├', '─', '┘', '─', '┴', '┐', '┤', '┬', '┼'];
    let sign = SIGNS.get(usize::from(directions)).copied().unwrap_or(' ');
    match sign {
        _ if !ascii => sign,
        ' ' => ' ',
        '─' => '-',
        '│' => '|',
        _ => '+',
    }
}
