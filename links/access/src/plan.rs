//! Which pieces of memory hold the cells somebody reads, and where in a snapshot of them each cell lies.

use std::collections::BTreeMap;

use ob1_model::{Area, Cell, CellError, CellWidth, Piece};

/// A gap of so many bytes is copied along: a piece of its own costs more.
const GAP: u32 = 8;

/// The pieces that hold a set of cells.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Plan {
    pieces: Vec<Piece>,
    /// Of each cell: its piece, and its first bit counted from the start of the snapshot and of the piece.
    places: BTreeMap<(Cell, CellWidth), Place>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Place {
    piece: usize,
    bit: u32,
    in_piece: u32,
}

/// A cell in memory: its block, its first byte and the one behind its last.
type InMemory = ((u8, u16), u32, u32, Cell, CellWidth);

/// What can lie beside another in memory: the kind of memory, the number of a data block.
fn block_of(cell: Cell) -> Option<(u8, u16, u32)> {
    match cell {
        Cell::Area(Area::Input, at) => Some((0, 0, at)),
        Cell::Area(Area::Output, at) => Some((1, 0, at)),
        Cell::Area(_, at) => Some((2, 0, at)),
        Cell::Db(number, at) => Some((3, number, at)),
        Cell::Peripheral(_) | Cell::Timer(_) | Cell::Counter(_) => None,
    }
}

impl Plan {
    /// For these cells, in any order; cells that lie together become one piece.
    #[must_use]
    pub fn of(cells: impl IntoIterator<Item = (Cell, CellWidth)>) -> Self {
        let mut memory: Vec<InMemory> = Vec::new();
        let mut plan = Self::default();
        let mut start = 0;
        for (cell, width) in cells {
            match block_of(cell) {
                Some((kind, number, bit)) => {
                    memory.push(((kind, number), bit / 8, bit / 8 + u32::from(width.bytes()), cell, width));
                }
                None => {
                    let place = Place { piece: plan.pieces.len(), bit: start * 8, in_piece: 0 };
                    if plan.places.insert((cell, width), place).is_none() {
                        let piece = Piece::Value(cell, width);
                        start += piece.len();
                        plan.pieces.push(piece);
                    }
                }
            }
        }
        memory.sort_by_key(|(block, from, to, ..)| (*block, *from, *to));
        // Of the piece under construction: its block, where it begins in memory and in the snapshot.
        let mut open: Option<((u8, u16), u32, u32)> = None;
        for (block, from, to, cell, width) in memory {
            let joined = open.filter(|(known, first, _)| {
                *known == block && plan.pieces.last().is_some_and(|piece| from <= first + piece.len() + GAP)
            });
            let (first, begin) = match joined {
                Some((_, first, begin)) => (first, begin),
                None => {
                    start = plan.len();
                    open = Some((block, from, start));
                    plan.pieces.push(Piece::Bytes { at: at_byte(cell, from), len: 0 });
                    (from, start)
                }
            };
            if let Some(Piece::Bytes { len, .. }) = plan.pieces.last_mut() {
                *len = (*len).max(to - first);
            }
            let in_piece = (from - first) * 8 + bit_of(cell) % 8;
            let place = Place { piece: plan.pieces.len() - 1, bit: begin * 8 + in_piece, in_piece };
            plan.places.insert((cell, width), place);
        }
        plan
    }

    /// The pieces.
    #[must_use]
    pub fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// Bytes of a snapshot.
    #[must_use]
    pub fn len(&self) -> u32 {
        self.pieces.iter().map(Piece::len).sum()
    }

    /// There is nothing to be read.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.pieces.is_empty()
    }

    /// Whether this cell is among them.
    #[must_use]
    pub fn has(&self, cell: Cell, width: CellWidth) -> bool {
        self.places.contains_key(&(cell, width))
    }

    /// The bits of a cell, right-aligned, out of a snapshot of the pieces. `filled` says of a piece how many of its
    /// bytes there were, and why not all.
    ///
    /// # Errors
    /// Why the CPU does not have the cell.
    pub fn value(
        &self,
        cell: Cell,
        width: CellWidth,
        bytes: &[u8],
        filled: impl Fn(usize) -> (u32, Option<CellError>),
    ) -> Result<u32, CellError> {
        let place = self.places.get(&(cell, width)).ok_or(CellError::Outside)?;
        let (there, error) = filled(place.piece);
        if place.in_piece / 8 + u32::from(width.bytes()) > there {
            return Err(error.unwrap_or(CellError::Outside));
        }
        let at = (place.bit / 8) as usize;
        let bytes = bytes.get(at..at + usize::from(width.bytes())).ok_or(CellError::Outside)?;
        let value = bytes.iter().fold(0, |value, byte| value << 8 | u32::from(*byte));
        Ok(if width == CellWidth::Bit { value >> (place.bit % 8) & 1 } else { value })
    }
}

fn bit_of(cell: Cell) -> u32 {
    block_of(cell).map_or(0, |(_, _, bit)| bit)
}

/// The same memory from this byte on.
fn at_byte(cell: Cell, byte: u32) -> Cell {
    match cell {
        Cell::Area(area, _) => Cell::Area(area, byte * 8),
        Cell::Db(number, _) => Cell::Db(number, byte * 8),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const M: Area = Area::Memory;

    #[test]
    fn what_lies_together_is_one_piece() {
        use CellWidth::{Bit, Byte, DWord, Word};
        let plan = Plan::of([
            (Cell::Area(M, 8 * 8), Word),
            (Cell::Area(M, 3), Bit),
            (Cell::Area(M, 4 * 8), DWord),
            (Cell::Area(M, 100 * 8), Byte),
            (Cell::Db(7, 0), Word),
            (Cell::Db(8, 0), Word),
            (Cell::Timer(3), Word),
        ]);
        assert_eq!(
            plan.pieces(),
            [
                Piece::Value(Cell::Timer(3), Word),
                Piece::Bytes { at: Cell::Area(M, 0), len: 10 },
                Piece::Bytes { at: Cell::Area(M, 800), len: 1 },
                Piece::Bytes { at: Cell::Db(7, 0), len: 2 },
                Piece::Bytes { at: Cell::Db(8, 0), len: 2 },
            ]
        );
        assert_eq!(plan.len(), 2 + 10 + 1 + 2 + 2);
    }

    /// Each cell is found where it lies, in any order of asking; what is not there is told of that cell alone.
    #[test]
    fn every_cell_finds_its_value() {
        // A memory of 64 bytes: byte n holds n.
        let memory: Vec<u8> = (0..64).collect();
        let widths = [CellWidth::Bit, CellWidth::Byte, CellWidth::Word, CellWidth::DWord];
        let mut cells: Vec<(Cell, CellWidth)> = (0..64u32)
            .flat_map(|byte| {
                widths
                    .map(|width| (Cell::Area(M, byte * 8 + if width == CellWidth::Bit { byte % 8 } else { 0 }), width))
            })
            .collect();
        for round in 0..50usize {
            let len = cells.len();
            cells.rotate_left((round * 37) % len);
            let wanted: Vec<_> = cells.iter().copied().step_by(round + 1).collect();
            let plan = Plan::of(wanted.iter().copied());
            let mut bytes = Vec::new();
            let mut filled = Vec::new();
            for piece in plan.pieces() {
                let Piece::Bytes { at: Cell::Area(_, bit), len } = *piece else { panic!("{piece:?}") };
                let from = (bit / 8) as usize;
                let there = memory.len().saturating_sub(from).min(len as usize);
                bytes.extend_from_slice(&memory[from..from + there]);
                bytes.resize(bytes.len() + len as usize - there, 0);
                filled.push((there as u32, (there < len as usize).then_some(CellError::Outside)));
            }
            for (cell, width) in wanted {
                let Cell::Area(_, bit) = cell else { panic!("{cell:?}") };
                let from = (bit / 8) as usize;
                let expected = match memory.get(from..from + usize::from(width.bytes())) {
                    None => Err(CellError::Outside),
                    Some(bytes) => {
                        let value = bytes.iter().fold(0, |value, byte| value << 8 | u32::from(*byte));
                        Ok(if width == CellWidth::Bit { value >> (bit % 8) & 1 } else { value })
                    }
                };
                assert_eq!(plan.value(cell, width, &bytes, |piece| filled[piece]), expected, "{cell:?} {width:?}");
            }
        }
    }
}
