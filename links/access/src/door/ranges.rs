//! The pieces that the clients of a link read: merged, watched as one list, and found again in a snapshot.
//!
//! A piece read for the first time is requested; a piece not read for a while is dropped; if the pieces exceed the
//! link's share, the least recently read are dropped.

use std::collections::{BTreeMap, BTreeSet};

use ob1_model::{Cell, Frame, Piece, Width, fits_a_share};

/// A gap up to this many bytes is copied too: a separate piece would cost more.
const GAP: u32 = 8;
/// Maximum number of remembered pieces; parts of other pieces cost nothing more.
const REMEMBERED: usize = 4096;
/// Pieces not read for this many ticks are dropped.
const IDLE_TICKS: u64 = 30;

/// A contiguous memory: the kind of memory, the number of a data block.
type Block = (u8, u16);

/// When a piece was read last.
#[derive(Clone, Copy, Debug)]
struct Used {
    turn: u64,
    tick: u64,
}

/// A watched piece as in the words of a snapshot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Stretch {
    block: Block,
    from: u32,
    to: u32,
    index: usize,
}

/// Pieces merged into fewer, and the place of each in the merged ones. Adjacent pieces become one.
#[derive(Clone, Debug, Default)]
pub struct Cover {
    generation: u64,
    frame: Frame,
    /// The merged bytes, ascending, not adjacent.
    stretches: Vec<Stretch>,
    values: BTreeMap<(Cell, Width), usize>,
}

/// The place of a piece: the index of the merged piece, and how many of its bytes to skip.
pub type Found = (usize, u32);

impl Cover {
    /// Merges these pieces; values of cells that are no bytes stay single.
    #[must_use]
    pub fn merging<'p>(wanted: impl Iterator<Item = &'p Piece>) -> Self {
        Self::of(0, wanted)
    }

    /// The merged pieces, in the order of their snapshot.
    #[must_use]
    pub fn pieces(&self) -> &[Piece] {
        self.frame.pieces()
    }

    fn of<'p>(generation: u64, wanted: impl Iterator<Item = &'p Piece>) -> Self {
        let mut layout = Self { generation, ..Self::default() };
        let mut pieces = Vec::new();
        let mut memory: Vec<(Block, u32, u32, Cell)> = Vec::new();
        for piece in wanted {
            match *piece {
                Piece::Bytes { at, len } => {
                    if let Some(block) = at.block() {
                        memory.push((block, at.byte(), at.byte().saturating_add(len), at));
                    }
                }
                Piece::Value(cell, width) => {
                    layout.values.entry((cell, width)).or_insert_with(|| {
                        pieces.push(*piece);
                        pieces.len() - 1
                    });
                }
            }
        }
        memory.sort_unstable();
        for (block, from, to, at) in memory {
            match layout.stretches.last_mut().filter(|last| last.block == block && from <= last.to.saturating_add(GAP))
            {
                Some(last) => last.to = last.to.max(to),
                None => {
                    layout.stretches.push(Stretch { block, from, to, index: pieces.len() });
                    pieces.push(Piece::Bytes { at: at.at_bit(from * 8), len: 0 });
                }
            }
        }
        for stretch in &layout.stretches {
            if let Some(Piece::Bytes { len, .. }) = pieces.get_mut(stretch.index) {
                *len = stretch.to - stretch.from;
            }
        }
        layout.frame = Frame::of(pieces);
        layout
    }

    /// Whether a link may watch them all.
    #[must_use]
    pub fn fits(&self) -> bool {
        fits_a_share(self.frame.pieces().iter().copied())
    }

    pub(crate) const fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The place of a piece, if all of it is among the merged ones.
    #[must_use]
    pub fn find(&self, piece: &Piece) -> Option<Found> {
        match *piece {
            Piece::Value(cell, width) => Some((*self.values.get(&(cell, width))?, 0)),
            Piece::Bytes { at, len } => {
                let (block, from) = (at.block()?, at.byte());
                let behind = self.stretches.partition_point(|s| (s.block, s.from) <= (block, from));
                let stretch = self.stretches.get(behind.checked_sub(1)?)?;
                let inside = stretch.block == block && from.checked_add(len)? <= stretch.to;
                inside.then(|| (stretch.index, from - stretch.from))
            }
        }
    }
}

/// All pieces of a link.
#[derive(Debug, Default)]
pub(crate) struct Ranges {
    wanted: BTreeMap<Piece, Used>,
    /// What the broker has refused.
    refused: BTreeSet<Block>,
    refused_values: BTreeSet<Cell>,
    /// The layouts of present and coming snapshots, in ascending order of generations.
    layouts: Vec<Cover>,
    generation: u64,
    in_flight: bool,
    changed: bool,
    turn: u64,
    tick: u64,
}

impl Ranges {
    /// Generations begin above this.
    pub(crate) fn new(generation: u64) -> Self {
        Self { generation, ..Self::default() }
    }

    /// Whether the broker has refused this piece.
    pub(crate) fn is_refused(&self, piece: &Piece) -> bool {
        match piece {
            Piece::Bytes { at, .. } => at.block().is_some_and(|block| self.refused.contains(&block)),
            Piece::Value(cell, _) => self.refused_values.contains(cell),
        }
    }

    pub(crate) fn layout(&self, generation: u64) -> Option<&Cover> {
        self.layouts.iter().find(|layout| layout.generation == generation)
    }

    /// These pieces have been read.
    pub(crate) fn used(&mut self, pieces: &[Piece]) {
        self.turn += 1;
        let used = Used { turn: self.turn, tick: self.tick };
        for piece in pieces {
            if let Some(before) = self.wanted.get_mut(piece) {
                *before = used;
            } else if self.wanted.len() < REMEMBERED && !self.is_refused(piece) {
                self.wanted.insert(*piece, used);
            }
        }
    }

    /// Adds these pieces to the watched ones. False: they alone exceed the share.
    pub(crate) fn want(&mut self, pieces: &[Piece]) -> bool {
        let allowed: Vec<Piece> = pieces.iter().filter(|piece| !self.is_refused(piece)).copied().collect();
        if !Cover::of(0, allowed.iter()).fits() {
            return false;
        }
        self.turn += 1;
        let used = Used { turn: self.turn, tick: self.tick };
        for piece in allowed {
            self.wanted.insert(piece, used);
            self.changed |= self.layouts.last().is_none_or(|layout| layout.find(&piece).is_none());
        }
        true
    }

    /// The next list to watch, if it has changed and the previous one has been answered.
    pub(crate) fn next(&mut self) -> Option<(u64, Vec<Piece>)> {
        if !self.changed || self.in_flight {
            return None;
        }
        self.fit();
        self.generation += 1;
        let layout = Cover::of(self.generation, self.wanted.keys());
        let pieces = layout.frame.pieces().to_vec();
        self.layouts.push(layout);
        (self.changed, self.in_flight) = (false, true);
        Some((self.generation, pieces))
    }

    /// Drops the least recently read pieces until the rest fits.
    fn fit(&mut self) {
        if self.wanted.len() <= REMEMBERED && Cover::of(0, self.wanted.keys()).fits() {
            return;
        }
        let mut newest: Vec<(Piece, Used)> = self.wanted.iter().map(|(piece, used)| (*piece, *used)).collect();
        newest.sort_by_key(|(_, used)| std::cmp::Reverse(used.turn));
        newest.truncate(REMEMBERED);
        // How many of the newest fit: more pieces never take less room.
        let (mut fits, mut not) = (0, newest.len() + 1);
        while fits + 1 < not {
            let middle = usize::midpoint(fits, not);
            match Cover::of(0, newest.iter().take(middle).map(|(piece, _)| piece)).fits() {
                true => fits = middle,
                false => not = middle,
            }
        }
        self.wanted = newest.into_iter().take(fits).collect();
    }

    /// A snapshot of this generation is there.
    pub(crate) fn watching(&mut self, generation: u64) {
        self.in_flight &= generation != self.generation;
        self.layouts.retain(|layout| layout.generation >= generation);
    }

    /// Nothing of this generation is watched, because these of its pieces are not allowed.
    pub(crate) fn unwatched(&mut self, generation: u64, refused: &[u32]) {
        let Some(place) = self.layouts.iter().position(|layout| layout.generation == generation) else { return };
        let layout = self.layouts.remove(place);
        for index in refused {
            match layout.frame.pieces().get(*index as usize) {
                Some(Piece::Bytes { at, .. }) => self.refused.extend(at.block()),
                Some(Piece::Value(cell, _)) => drop(self.refused_values.insert(*cell)),
                None => {}
            }
        }
        let wanted = std::mem::take(&mut self.wanted);
        self.wanted = wanted.into_iter().filter(|(piece, _)| !self.is_refused(piece)).collect();
        (self.in_flight, self.changed) = (false, true);
    }

    /// Time passes: drops pieces that have been idle for long.
    pub(crate) fn tick(&mut self) {
        self.tick += 1;
        let (before, tick) = (self.wanted.len(), self.tick);
        self.wanted.retain(|_, used| tick - used.tick <= IDLE_TICKS);
        self.changed |= self.wanted.len() != before;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_model::{Area, WATCH_BYTES};

    fn m(from: u32, len: u32) -> Piece {
        Piece::Bytes { at: Cell::Area(Area::Memory, from * 8), len }
    }

    fn db(number: u16, from: u32, len: u32) -> Piece {
        Piece::Bytes { at: Cell::Db(number, from * 8), len }
    }

    const TIMER: Piece = Piece::Value(Cell::Timer(3), Width::Word);

    #[test]
    fn what_lies_together_is_one_piece_and_parts_are_found() {
        let mut ranges = Ranges::new(10);
        assert!(ranges.want(&[m(8, 2), db(7, 0, 2), m(0, 1), TIMER, m(4, 4), m(100, 1), db(8, 0, 2), TIMER]));
        let (generation, pieces) = ranges.next().expect("changed");
        assert_eq!(generation, 11);
        assert_eq!(pieces, [TIMER, m(0, 10), m(100, 1), db(7, 0, 2), db(8, 0, 2)]);
        let layout = ranges.layout(11).expect("made");
        for (piece, found) in [
            (m(0, 10), Some((1, 0))),
            (m(3, 5), Some((1, 3))),
            (m(100, 1), Some((2, 0))),
            (m(100, 2), None),
            (m(9, 2), None),
            (m(50, 1), None),
            (db(7, 1, 1), Some((3, 1))),
            (db(9, 0, 1), None),
            (TIMER, Some((0, 0))),
            (Piece::Value(Cell::Timer(3), Width::Bit), None),
        ] {
            assert_eq!(layout.find(&piece), found, "{piece:?}");
        }
    }

    #[test]
    fn one_list_at_a_time_and_old_layouts_until_the_new_one_is_there() {
        let mut ranges = Ranges::new(0);
        assert!(ranges.next().is_none(), "nothing is wanted");
        ranges.want(&[m(0, 2)]);
        assert_eq!(ranges.next().map(|(generation, _)| generation), Some(1));
        ranges.want(&[m(0, 2)]);
        ranges.want(&[m(50, 2)]);
        assert!(ranges.next().is_none(), "one is under way");
        ranges.watching(1);
        assert_eq!(ranges.next(), Some((2, vec![m(0, 2), m(50, 2)])));
        assert!(ranges.layout(1).is_some() && ranges.layout(2).is_some());
        ranges.watching(2);
        assert!(ranges.layout(1).is_none() && ranges.layout(2).is_some());
        ranges.want(&[m(1, 1)]);
        assert!(ranges.next().is_none(), "a part of what is watched is no change");
    }

    #[test]
    fn what_is_not_read_is_let_go() {
        let mut ranges = Ranges::new(0);
        ranges.want(&[m(0, 2), m(50, 2)]);
        ranges.next();
        ranges.watching(1);
        for _ in 0..=IDLE_TICKS {
            ranges.used(&[m(0, 2)]);
            ranges.tick();
        }
        assert_eq!(ranges.next(), Some((2, vec![m(0, 2)])));
        ranges.watching(2);
        (0..=IDLE_TICKS).for_each(|_| ranges.tick());
        assert_eq!(ranges.next(), Some((3, vec![])), "and then nothing is copied any more");
    }

    /// Beyond the share the oldest are dropped; a piece requested now is always kept.
    #[test]
    fn beyond_the_share_the_least_recently_used_go() {
        let mut ranges = Ranges::new(0);
        let quarter = WATCH_BYTES as u32 / 4;
        for number in 0..6 {
            assert!(ranges.want(&[db(number, 0, quarter)]));
            let (generation, pieces) = ranges.next().expect("changed");
            assert!(fits_a_share(pieces.iter().copied()), "{number}");
            let numbers: Vec<u16> = pieces
                .iter()
                .filter_map(|p| match p {
                    Piece::Bytes { at, .. } => at.block().map(|block| block.1),
                    Piece::Value(..) => None,
                })
                .collect();
            assert_eq!(numbers.last(), Some(&number));
            assert_eq!(numbers.len(), usize::from(number + 1).min(4), "{numbers:?}");
            ranges.watching(generation);
            ranges.used(&[db(0, 0, quarter)]);
            assert!(numbers.contains(&0), "DB0 is read all the time");
        }
        assert!(!ranges.want(&[m(0, WATCH_BYTES as u32 + 1)]), "more than a share at once");
        assert!(ranges.next().is_none());
    }

    #[test]
    fn what_is_refused_is_not_asked_for_again() {
        let mut ranges = Ranges::new(0);
        ranges.want(&[m(0, 2), db(7, 0, 2), TIMER]);
        let (generation, pieces) = ranges.next().expect("changed");
        assert_eq!(pieces, [TIMER, m(0, 2), db(7, 0, 2)]);
        ranges.unwatched(generation, &[0, 2, 99]);
        assert!(ranges.is_refused(&db(7, 100, 5)) && ranges.is_refused(&TIMER) && !ranges.is_refused(&m(0, 2)));
        assert_eq!(ranges.next(), Some((2, vec![m(0, 2)])));
        ranges.watching(2);
        ranges.want(&[db(7, 0, 4), m(0, 1)]);
        assert!(ranges.next().is_none());
    }

    /// Clients that read another place each time do not fill up memory.
    #[test]
    fn memory_is_bounded() {
        let mut ranges = Ranges::new(0);
        for place in 0..12_000u32 {
            ranges.want(&[db((place % 60_000) as u16, place % 7, 1)]);
            if let Some((generation, pieces)) = ranges.next() {
                assert!(fits_a_share(pieces));
                ranges.watching(generation);
            }
            if place == 400 {
                // From here on only sometimes, because each list is work.
                ranges.in_flight = true;
            }
        }
        ranges.in_flight = false;
        let (_, pieces) = ranges.next().expect("changed");
        assert!(pieces.len() <= REMEMBERED && ranges.wanted.len() <= REMEMBERED && ranges.layouts.len() <= 2);
    }
}
