//! The image of retentive memory for a power cycle.
//!
//! The image is one contiguous piece, all numbers little-endian: magic, version, length, number of pieces; then what
//! each piece is, then their contents in the same order, and a checksum over everything before. It is put back by what
//! the image and the program have in common: a data block that was declared anew takes nothing from the others. Keeping
//! it on a disk is the caller's task. Images of version 1 are read, too (`retentive_v1.rs`).

use crate::arena::Range;
use crate::made_data_blocks::Attributes;
use crate::memory::Memory;
use crate::retentive_ranges::{Hash, Keep, common};
use crate::timers::{Counter, Timer};
use crate::{Cpu, OperatingState, retentive_v1};

const MAGIC: [u8; 8] = *b"ob1 keep";
const VERSION: u32 = 2;
/// Magic, version, length, number of pieces.
const HEAD: usize = 20;
const CHECKSUM: usize = 8;

/// Why an image is not restored. Nothing has been changed then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Why {
    /// Not such an image at all.
    NoImage,
    /// Written by another version of this software.
    Version(u32),
    /// Cut off or changed.
    Damaged,
    /// It has nothing that this program could keep: other ranges, other declarations of data blocks.
    OtherProgram,
    /// The CPU is not in STOP.
    NotInStop,
}

impl std::fmt::Display for Why {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Why::NoImage => f.write_str("this is no image of retentive memory"),
            Why::Version(v) => write!(f, "the image has version {v}; this software reads version {VERSION}"),
            Why::Damaged => f.write_str("the image is cut off or damaged"),
            Why::OtherProgram => f.write_str("the image belongs to a program with other data blocks and ranges"),
            Why::NotInStop => f.write_str("the CPU is not in STOP"),
        }
    }
}

impl std::error::Error for Why {}

/// What a piece of the image holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum What {
    /// Bytes of bit memory.
    Memory,
    /// A part of a data block of the program.
    Data,
    Timers,
    Counters,
    /// A data block that the program made.
    Made,
}

impl What {
    /// In the order of their numbers in the image.
    const ALL: [Self; 5] = [Self::Memory, Self::Data, Self::Timers, Self::Counters, Self::Made];
}

/// What the image says of a piece.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Piece {
    pub(crate) what: What,
    /// Number of the data block.
    pub(crate) number: u32,
    /// First byte, timer or counter.
    pub(crate) at: u32,
    /// Bytes, timers or counters.
    pub(crate) len: u32,
    /// What the bytes of a data block mean (`keep.rs`); attributes of one that the program made.
    pub(crate) meaning: u64,
}

impl Piece {
    /// Its bytes in the head of the image.
    const BYTES: usize = 24;

    fn write(self, into: &mut Vec<u8>) {
        for number in [self.what as u32, self.number, self.at, self.len] {
            into.extend_from_slice(&number.to_le_bytes());
        }
        into.extend_from_slice(&self.meaning.to_le_bytes());
    }

    fn read(reader: &mut Reader<'_>) -> Result<Self, Why> {
        let what = *What::ALL.get(reader.u32()? as usize).ok_or(Why::Damaged)?;
        let [number, at, len, low, high] = [reader.u32()?, reader.u32()?, reader.u32()?, reader.u32()?, reader.u32()?];
        Self { what, number, at, len, meaning: u64::from(high) << 32 | u64::from(low) }.checked()
    }

    /// Nothing of a CPU has more or lies further up.
    pub(crate) fn checked(self) -> Result<Self, Why> {
        let is_there = self.at.checked_add(self.len).is_some_and(|end| end <= i32::MAX as u32);
        if is_there && self.number <= u16::MAX.into() { Ok(self) } else { Err(Why::Damaged) }
    }

    /// Bytes of its content.
    pub(crate) const fn content(self) -> usize {
        let each = match self.what {
            What::Timers => Timer::IMAGE,
            What::Counters => Counter::IMAGE,
            What::Memory | What::Data | What::Made => 1,
        };
        self.len as usize * each
    }
}

impl std::fmt::Display for Piece {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { what, number, at, len, .. } = *self;
        let area = match what {
            What::Data | What::Made => return write!(f, "DB {number}"),
            What::Memory => "MB",
            What::Timers => "T",
            What::Counters => "C",
        };
        match len {
            0 | 1 => write!(f, "{area} {at}"),
            _ => write!(f, "{area} {at} to {}", at + len - 1),
        }
    }
}

impl Keep {
    /// The pieces of the image, as it begins with them.
    pub(crate) fn described(&self, memory: &Memory) -> Vec<u8> {
        let mut pieces = Vec::new();
        let mut piece = |what, number: u16, at: usize, len: usize, meaning| {
            Piece { what, number: number.into(), at: at as u32, len: len as u32, meaning }.write(&mut pieces);
        };
        for range in &self.memory {
            piece(What::Memory, 0, range.at.index() - memory.memory.at.index(), range.len as usize, 0);
        }
        let blocks = &memory.dbs[..memory.program_dbs];
        for range in &self.data {
            let index = blocks.partition_point(|db| db.range().end() <= range.at);
            let (Some(db), Some(meaning)) = (blocks.get(index), self.meanings.get(index)) else { continue };
            piece(What::Data, db.number, range.at.index() - db.at.index(), range.len as usize, *meaning);
        }
        for (what, ranges) in [(What::Timers, &self.timers), (What::Counters, &self.counters)] {
            ranges.iter().for_each(|range| piece(what, 0, range.start, range.len(), 0));
        }
        pieces
    }
}

fn checksum(bytes: &[u8]) -> [u8; CHECKSUM] {
    let mut hash = Hash::default();
    hash.add(bytes);
    hash.0.to_le_bytes()
}

/// Takes the image apart.
pub(crate) struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    pub(crate) fn take(&mut self, len: usize) -> Result<&'a [u8], Why> {
        let (head, rest) = self.0.split_at_checked(len).ok_or(Why::Damaged)?;
        self.0 = rest;
        Ok(head)
    }

    pub(crate) fn u32(&mut self) -> Result<u32, Why> {
        self.take(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
    }
}

impl Cpu {
    /// Bytes of the image of retentive memory now. More only when the program makes data blocks.
    #[must_use]
    pub fn retentive_len(&self) -> usize {
        let keep = &self.machine.keep;
        let made = self.machine.memory.made_dbs().filter(|_| keep.made);
        let made: usize = made.map(|made| Piece::BYTES + made.db.len as usize).sum();
        let ranges: usize = keep.memory.iter().chain(&keep.data).map(|r| r.len as usize).sum();
        let timers: usize = keep.timers.iter().map(|r| r.len() * Timer::IMAGE).sum();
        let counters: usize = keep.counters.iter().map(|r| r.len() * Counter::IMAGE).sum();
        HEAD + keep.pieces.len() + made + ranges + timers + counters + CHECKSUM
    }

    /// Replaces what `into` holds by the image of retentive memory as it is between two cycles. Allocates only when
    /// `into` has no room for [`Cpu::retentive_len`] bytes.
    pub fn retentive_image(&self, into: &mut Vec<u8>) {
        let m = &self.machine;
        let len = self.retentive_len();
        into.clear();
        into.reserve(len);
        let made = || m.memory.made_dbs().filter(|_| m.keep.made);
        let pieces = m.keep.pieces.len() / Piece::BYTES + made().count();
        into.extend_from_slice(&MAGIC);
        for number in [VERSION, len as u32, pieces as u32] {
            into.extend_from_slice(&number.to_le_bytes());
        }
        into.extend_from_slice(&m.keep.pieces);
        for made in made() {
            let (number, meaning) = (made.db.number.into(), made.attributes.bits().into());
            Piece { what: What::Made, number, at: 0, len: made.db.len, meaning }.write(into);
        }
        for range in m.keep.memory.iter().chain(&m.keep.data) {
            into.extend_from_slice(m.memory.slice(*range));
        }
        for timer in m.keep.timers.iter().flat_map(|r| &m.timers[r.clone()]) {
            // Time stands still in STOP.
            let now = if self.state == OperatingState::Stop { m.stopped_at } else { m.hot.now };
            into.extend_from_slice(&timer.image(now));
        }
        for counter in m.keep.counters.iter().flat_map(|r| &m.counters[r.clone()]) {
            into.extend_from_slice(&counter.image());
        }
        for made in made() {
            // Of one that is not retentive: what it begins with again.
            into.extend_from_slice(m.memory.slice(made.load_values()));
        }
        let sum = checksum(into);
        into.extend_from_slice(&sum);
    }

    /// Puts an image back, in STOP, as far as the program has the same ranges and data blocks; the next warm or hot
    /// restart keeps it. Gives what of the image has no place, as `DB 10` or `MB 4 to 7`.
    ///
    /// # Errors
    /// Why not; nothing has been changed then, but that data blocks made by the program are gone.
    pub fn restore_retentive(&mut self, image: &[u8]) -> Result<Vec<String>, Why> {
        if self.state != OperatingState::Stop {
            return Err(Why::NotInStop);
        }
        let now = self.machine.hot.now;
        let m = &mut self.machine;
        let pieces = pieces(image, now, &m.keep, &m.memory)?;
        m.memory.delete_made();
        let (mut left, mut taken) = (Vec::new(), pieces.is_empty());
        for (piece, content) in pieces {
            let some = match content {
                Content::Bytes(bytes) => m.keep.put_bytes(&mut m.memory, piece, bytes),
                Content::Timers(all) => put(&mut m.timers, &m.keep.timers, piece, all),
                Content::Counters(all) => put(&mut m.counters, &m.keep.counters, piece, all),
            };
            if some < piece.len {
                left.push(piece.to_string());
            }
            taken |= some > 0 || piece.len == 0;
        }
        if !taken {
            return Err(Why::OtherProgram);
        }
        left.dedup();
        m.stopped_at = now;
        self.has_run = true;
        Ok(left)
    }
}

/// What a piece holds.
enum Content<'a> {
    Bytes(&'a [u8]),
    Timers(Vec<Timer>),
    Counters(Vec<Counter>),
}

/// The pieces of an image, all of them checked.
fn pieces<'a>(
    image: &'a [u8],
    now: ob1_time::Instant,
    keep: &Keep,
    memory: &Memory,
) -> Result<Vec<(Piece, Content<'a>)>, Why> {
    let mut reader = Reader(image);
    if reader.take(MAGIC.len()).map_err(|_| Why::NoImage)? != MAGIC {
        return Err(Why::NoImage);
    }
    let version = reader.u32()?;
    if version != VERSION && version != retentive_v1::VERSION {
        return Err(Why::Version(version));
    }
    let (len, count) = (reader.u32()?, reader.u32()?);
    let end = image.len().checked_sub(CHECKSUM).ok_or(Why::Damaged)?;
    if len as usize != image.len() || image[end..] != checksum(&image[..end]) {
        return Err(Why::Damaged);
    }
    let pieces = match version {
        retentive_v1::VERSION => retentive_v1::pieces(&mut reader, count, keep, memory)?,
        _ => {
            let mut heads = Reader(reader.take((count as usize).checked_mul(Piece::BYTES).ok_or(Why::Damaged)?)?);
            let mut piece = || {
                let piece = Piece::read(&mut heads)?;
                Ok((piece, reader.take(piece.content())?))
            };
            (0..count).map(|_| piece()).collect::<Result<_, _>>()?
        }
    };
    if reader.0.len() != CHECKSUM {
        return Err(Why::Damaged);
    }
    pieces.into_iter().map(|(piece, bytes)| Ok((piece, Content::read(piece, bytes, now)?))).collect()
}

impl<'a> Content<'a> {
    fn read(piece: Piece, bytes: &'a [u8], now: ob1_time::Instant) -> Result<Self, Why> {
        Ok(match piece.what {
            What::Memory | What::Data | What::Made => Content::Bytes(bytes),
            What::Timers => {
                let all = bytes.chunks_exact(Timer::IMAGE).map(|b| Timer::from_image(b, now));
                Content::Timers(all.collect::<Option<_>>().ok_or(Why::Damaged)?)
            }
            What::Counters => {
                let all = bytes.chunks_exact(Counter::IMAGE).map(Counter::from_image);
                Content::Counters(all.collect::<Option<_>>().ok_or(Why::Damaged)?)
            }
        })
    }
}

/// Puts timers or counters where they are retentive; how many.
fn put<T>(all: &mut [T], keep: &[std::ops::Range<usize>], piece: Piece, contents: Vec<T>) -> u32 {
    let mut taken = 0;
    for (at, content) in (piece.at as usize..).zip(contents) {
        if keep.iter().any(|range| range.contains(&at)) {
            all[at] = content;
            taken += 1;
        }
    }
    taken
}

impl Keep {
    /// Puts the bytes of a piece where they are retentive and mean the same; how many.
    fn put_bytes(&self, memory: &mut Memory, piece: Piece, bytes: &[u8]) -> u32 {
        let Piece { what, number, at, len, meaning } = piece;
        let number = number as u16;
        let blocks = &memory.dbs[..memory.program_dbs];
        let (ranges, all) = match what {
            What::Made => return if self.made && make(memory, piece, bytes) { len } else { 0 },
            What::Data => {
                let index = blocks.binary_search_by_key(&number, |db| db.number).ok();
                let same = index.filter(|index| self.meanings.get(*index) == Some(&meaning));
                let Some(db) = same.and_then(|index| blocks.get(index)) else { return 0 };
                (&self.data, db.range())
            }
            What::Memory | What::Timers | What::Counters => (&self.memory, memory.memory),
        };
        let part = Range { at: all.at.plus(at), len: len.min(all.len.saturating_sub(at)) };
        let mut taken = 0;
        for range in common(ranges, part) {
            let from = (range.at.0 - part.at.0) as usize;
            memory.bytes[range.bytes()].copy_from_slice(&bytes[from..from + range.len as usize]);
            taken += range.len;
        }
        taken
    }
}

/// Makes a data block the program had made, if its number is free and there is room.
fn make(memory: &mut Memory, piece: Piece, bytes: &[u8]) -> bool {
    let (number, attributes) = (piece.number as u16, Attributes::of_bits(piece.meaning as u32));
    if memory.make_db(number, number, piece.len, attributes).is_err() {
        return false;
    }
    if let Some(made) = memory.made_db(number) {
        memory.slice_mut(made.db.range()).copy_from_slice(bytes);
        memory.slice_mut(made.load_values()).copy_from_slice(bytes);
    }
    true
}
