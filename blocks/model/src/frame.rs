//! How the pieces of a snapshot follow each other, in words of eight bytes: what the scan writes and a reader finds.
//!
//! Pieces of one area or data block that follow each other are a run. A run begins with a head word: how many bytes the
//! block has, or why there is no block. After it come the bytes of each piece, each beginning with a whole word. A
//! value is a head word alone: the value, or why there is none.

use crate::{Cell, CellError, Piece, Width};

/// Most entries of a group of writes: as many values as the largest telegram of a link can have.
pub const GROUP_ENTRIES: usize = 1024;
/// Bytes of a group, and bytes of writes that one cycle control point takes from all links together.
pub const WRITE_BYTES: usize = 4096;
/// Bytes a link may watch.
pub const WATCH_BYTES: usize = 64 * 1024;
/// Cache lines a link may watch: scattered cells cost more than their bytes.
pub const WATCH_LINES: usize = 4096;
/// Words of the largest snapshot: all bytes, and for each piece (of two lines at least) a head and a word that is not
/// full.
pub const FRAME_WORDS: usize = WATCH_BYTES / 8 + WATCH_LINES;

/// Bytes of a cache line.
const LINE: u32 = 64;

/// One thing to write.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Put {
    /// A value into a cell; a bit changes no other bit of its byte.
    Value(Cell, Width, u32),
    /// Bytes, from the byte of a cell in an area or a data block on.
    Bytes(Cell, Box<[u8]>),
}

impl Put {
    /// How many bytes it writes; a bit counts as one.
    pub fn bytes(&self) -> usize {
        match self {
            Put::Value(_, width, _) => width.bytes() as usize,
            Put::Bytes(_, bytes) => bytes.len(),
        }
    }

    /// The cell at which it begins to write.
    pub const fn cell(&self) -> Cell {
        match self {
            Put::Value(cell, ..) | Put::Bytes(cell, _) => *cell,
        }
    }
}

/// Whether a link may watch these pieces.
pub fn fits_a_share(pieces: impl IntoIterator<Item = Piece>) -> bool {
    let (mut bytes, mut lines) = (0u64, 0u64);
    for piece in pieces {
        bytes += u64::from(piece.len());
        lines += u64::from(piece.len().div_ceil(LINE)) + 1;
    }
    bytes <= WATCH_BYTES as u64 && lines <= WATCH_LINES as u64
}

/// The head word of a run or a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Head {
    /// Bytes the block has; the value.
    pub number: u32,
    /// Why there is no block or value; `None`: there is one.
    pub error: Option<CellError>,
}

impl Head {
    /// The head of a block with this many bytes, or of a value.
    pub const fn of(found: Result<u32, CellError>) -> Self {
        match found {
            Ok(number) => Self { number, error: None },
            Err(error) => Self { number: 0, error: Some(error) },
        }
    }

    /// As it lies in a snapshot.
    pub const fn word(self) -> u64 {
        let error = match self.error {
            Some(error) => error.code(),
            None => 0,
        };
        (error as u64) << 32 | self.number as u64
    }

    /// Out of a snapshot; an unknown code is [`CellError::Outside`].
    pub const fn from_word(word: u64) -> Self {
        let error = match word >> 32 {
            0 => None,
            code => Some(match CellError::from_code(code as u8) {
                Some(error) => error,
                None => CellError::Outside,
            }),
        };
        Self { number: word as u32, error }
    }
}

/// Pieces of one block that follow each other, or one value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// The word of its head.
    pub head: usize,
    /// The first piece, counted from 0.
    pub first: usize,
    /// The one after the last.
    pub end: usize,
}

/// Where one piece lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Place {
    head: u32,
    at: u32,
}

/// Pieces, and where each lies in a snapshot.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Frame {
    pieces: Box<[Piece]>,
    runs: Box<[Run]>,
    places: Box<[Place]>,
    words: usize,
}

impl Frame {
    /// A frame of these pieces, in this order.
    pub fn of(pieces: impl Into<Box<[Piece]>>) -> Self {
        let pieces: Box<[Piece]> = pieces.into();
        let mut runs: Vec<Run> = Vec::new();
        let mut places = Vec::with_capacity(pieces.len());
        let (mut words, mut open) = (0, None);
        for (index, piece) in pieces.iter().enumerate() {
            let block = match piece {
                Piece::Bytes { at, .. } => at.block(),
                Piece::Value(..) => None,
            };
            match runs.last_mut().filter(|_| block.is_some() && block == open) {
                Some(run) => run.end = index + 1,
                None => {
                    runs.push(Run { head: words, first: index, end: index + 1 });
                    words += 1;
                }
            }
            open = block;
            let head = runs.last().map_or(0, |run| run.head) as u32;
            places.push(Place { head, at: words as u32 });
            if let Piece::Bytes { len, .. } = piece {
                words += len.div_ceil(8) as usize;
            }
        }
        Self { pieces, runs: runs.into(), places: places.into(), words }
    }

    /// The pieces, in the order of their words.
    pub fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// The runs, in the order of their words.
    pub fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// Words of a snapshot.
    pub fn words(&self) -> usize {
        self.words
    }

    /// Appends `len` bytes of a piece from its byte `skip` on, out of a snapshot that `word` reads; of a value all of
    /// them, big-endian. Nothing is appended when not all are there.
    ///
    /// # Errors
    /// [`CellError`]: there is no such block or value, or `skip` and `len` reach beyond it.
    pub fn read(
        &self,
        index: usize,
        skip: u32,
        len: u32,
        word: impl Fn(usize) -> u64,
        into: &mut Vec<u8>,
    ) -> Result<(), CellError> {
        let (piece, place) = self.pieces.get(index).zip(self.places.get(index)).ok_or(CellError::Outside)?;
        let head = Head::from_word(word(place.head as usize));
        if let Some(error) = head.error {
            return Err(error);
        }
        match *piece {
            Piece::Value(_, width) => {
                let bytes = head.number.to_be_bytes();
                into.extend_from_slice(&bytes[bytes.len() - width.bytes() as usize..]);
            }
            Piece::Bytes { at, len: whole } => {
                let end = skip.checked_add(len).filter(|end| *end <= whole).ok_or(CellError::Outside)?;
                if at.byte().checked_add(end).is_none_or(|end| end > head.number) {
                    return Err(CellError::Outside);
                }
                let (mut at, mut skip, mut left) =
                    (place.at as usize + (skip / 8) as usize, (skip % 8) as usize, len as usize);
                while left > 0 {
                    let bytes = word(at).to_ne_bytes();
                    let take = left.min(8 - skip);
                    into.extend_from_slice(&bytes[skip..skip + take]);
                    (at, skip, left) = (at + 1, 0, left - take);
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Area;

    const M: Area = Area::Memory;

    fn bytes(at: Cell, len: u32) -> Piece {
        Piece::Bytes { at, len }
    }

    #[test]
    fn runs_share_a_head() {
        let frame = Frame::of([
            Piece::Value(Cell::Timer(3), Width::Word),
            Piece::Value(Cell::Timer(4), Width::Word),
            bytes(Cell::Area(M, 0), 10),
            bytes(Cell::Area(M, 800), 1),
            bytes(Cell::Db(7, 0), 8),
            bytes(Cell::Db(8, 0), 0),
        ]);
        let runs: Vec<_> = frame.runs().iter().map(|run| (run.head, run.first, run.end)).collect();
        assert_eq!(runs, [(0, 0, 1), (1, 1, 2), (2, 2, 4), (6, 4, 5), (8, 5, 6)]);
        assert_eq!(frame.words(), 9);
    }

    /// Each part of each piece is found, and what the block does not have is reported.
    #[test]
    fn parts_are_found() {
        let frame = Frame::of([bytes(Cell::Db(1, 16 * 8), 20), Piece::Value(Cell::Counter(2), Width::Word)]);
        let memory: Vec<u8> = (0..64).collect();
        let mut words = vec![Head::of(Ok(30)).word()];
        words.extend(memory[16..40].chunks(8).map(|c| u64::from_ne_bytes(c.try_into().expect("eight"))));
        words.push(Head::of(Ok(0x1234)).word());
        assert_eq!(words.len(), frame.words());
        for skip in 0..22 {
            for len in 0..22 {
                let mut into = Vec::new();
                let read = frame.read(0, skip, len, |at| words[at], &mut into);
                if skip + len <= 14 {
                    let from = 16 + skip as usize;
                    assert_eq!((read, &into[..]), (Ok(()), &memory[from..from + len as usize]), "{skip} {len}");
                } else {
                    assert_eq!((read, into.len()), (Err(CellError::Outside), 0), "{skip} {len}");
                }
            }
        }
        let mut into = Vec::new();
        assert_eq!(frame.read(1, 0, 2, |at| words[at], &mut into), Ok(()));
        assert_eq!(into, [0x12, 0x34]);
        assert_eq!(frame.read(2, 0, 1, |at| words[at], &mut into), Err(CellError::Outside));
    }

    #[test]
    fn heads_and_shares() {
        for error in CellError::ALL {
            assert_eq!(Head::from_word(Head::of(Err(error)).word()).error, Some(error));
        }
        assert_eq!(Head::from_word(u64::MAX).error, Some(CellError::Outside));
        let cell = Cell::Db(1, 0);
        assert!(fits_a_share([bytes(cell, WATCH_BYTES as u32)]));
        assert!(!fits_a_share([bytes(cell, WATCH_BYTES as u32 + 1)]));
        assert!(!fits_a_share([bytes(cell, u32::MAX), bytes(cell, u32::MAX)]));
        let many = |count| std::iter::repeat_n(Piece::Value(Cell::Timer(0), Width::Word), count);
        assert!(fits_a_share(many(WATCH_LINES / 2)) && !fits_a_share(many(WATCH_LINES / 2 + 1)));
        // The largest that fits has room in a window.
        let worst: Vec<Piece> = (0..WATCH_LINES as u16 / 2).map(|n| bytes(Cell::Db(n, 0), 25)).collect();
        assert!(fits_a_share(worst.iter().copied()) && Frame::of(worst).words() <= FRAME_WORDS);
    }
}
