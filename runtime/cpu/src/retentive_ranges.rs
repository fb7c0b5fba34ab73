//! What a warm restart and a power cycle keep, found in the arena.

use ob1_ir::{DataBlock, DataKind, Program};
use ob1_model::Section;

use crate::arena::Range;
use crate::memory::Memory;
use crate::timers::{Counter, Timer};
use crate::{CpuConfig, LoadError, RetentiveData, retentive_v1};

/// The ranges, found in the arena.
#[derive(Debug, Default)]
pub(crate) struct Keep {
    pub(crate) memory: Vec<Range>,
    pub(crate) timers: Vec<std::ops::Range<usize>>,
    pub(crate) counters: Vec<std::ops::Range<usize>>,
    /// Parts of data blocks of the program, in ascending order, each within one block.
    pub(crate) data: Vec<Range>,
    /// Data blocks that the program makes, too.
    pub(crate) made: bool,
    /// What the bytes of each data block of the program mean, in the order of [`Memory::dbs`].
    pub(crate) meanings: Vec<u64>,
    /// The declarations of the whole program, as images of version 1 name them (`retentive_v1.rs`).
    pub(crate) declarations: u64,
    /// What the image says of all these: its pieces (`retentive.rs`), but for the data blocks that the program makes.
    pub(crate) pieces: Vec<u8>,
}

impl Keep {
    pub(crate) fn new(config: &CpuConfig, program: &Program, memory: &Memory, errors: &mut Vec<LoadError>) -> Self {
        let r = &config.retentive;
        let mut keep = Self::default();
        for range in &r.memory {
            let found = inside(range.start, range.end, config.memory_bytes, "retentive.memory", errors);
            keep.memory.extend(found.map(|len| Range { at: memory.memory.at.plus(range.start), len }));
        }
        for (ranges, all, field, to) in [
            (&r.timers, config.timers, "retentive.timers", &mut keep.timers),
            (&r.counters, config.counters, "retentive.counters", &mut keep.counters),
        ] {
            for range in ranges {
                if inside(range.start.into(), range.end.into(), all.into(), field, errors).is_some() {
                    to.push(usize::from(range.start)..usize::from(range.end));
                }
            }
        }
        match &r.data {
            RetentiveData::All => {
                keep.made = true;
                keep.data.push(memory.all_dbs);
            }
            RetentiveData::Only(list) => {
                for part in list {
                    let Some(db) = memory.db(part.db) else {
                        errors.push(LoadError::Retentive(part.db));
                        continue;
                    };
                    let bytes = part.bytes.clone().unwrap_or(0..db.len);
                    let found = inside(bytes.start, bytes.end, db.len, "retentive.data", errors);
                    keep.data.extend(found.map(|len| Range { at: db.at.plus(bytes.start), len }));
                }
            }
        }
        keep.memory = merged(keep.memory);
        keep.data = merged(keep.data);
        for block in program.data.iter().filter(|block| block.non_retain) {
            let Some(db) = memory.program_db(block.number) else { continue };
            keep.data = without(&keep.data, Range { at: db.at, len: db.len.next_multiple_of(8) });
        }
        let blocks = &memory.dbs[..memory.program_dbs];
        let parts = blocks.iter().filter(|db| db.len > 0).flat_map(|db| common(&keep.data, db.range()));
        keep.data = parts.collect();
        let mut data: Vec<&DataBlock> = program.data.iter().collect();
        data.sort_unstable_by_key(|db| db.number);
        keep.meanings = data.into_iter().map(|db| meaning(db, program)).collect();
        keep.declarations = retentive_v1::declarations(program);
        keep.pieces = keep.described(memory);
        keep
    }

    /// Areas, timers and counters that are not retentive become as after loading.
    pub(crate) fn clear_areas(&self, memory: &mut Memory, timers: &mut [Timer], counters: &mut [Counter]) {
        memory.clear_areas(&self.memory);
        clear_gaps(timers, &self.timers);
        clear_gaps(counters, &self.counters);
    }

    /// The same of data blocks.
    pub(crate) fn reload_dbs(&self, memory: &mut Memory) {
        memory.reload_dbs(&self.data);
        memory.reload_made();
    }
}

/// The same bytes in ascending order, none twice.
fn merged(mut ranges: Vec<Range>) -> Vec<Range> {
    ranges.sort_unstable_by_key(|range| range.at);
    let mut merged: Vec<Range> = Vec::with_capacity(ranges.len());
    for range in ranges {
        match merged.last_mut().filter(|last| range.at <= last.end()) {
            Some(last) => last.len = last.end().max(range.end()).0 - last.at.0,
            None => merged.push(range),
        }
    }
    merged
}

/// What `ranges`, in ascending order and apart from each other, have in common with `part`.
pub(crate) fn common(ranges: &[Range], part: Range) -> impl Iterator<Item = Range> {
    let first = ranges.partition_point(|range| range.end() <= part.at);
    let near = ranges[first..].iter().take_while(move |range| range.at < part.end());
    near.map(move |range| {
        let at = range.at.max(part.at);
        Range { at, len: range.end().min(part.end()).0 - at.0 }
    })
}

/// The parts of `ranges` outside `hole`.
fn without(ranges: &[Range], hole: Range) -> Vec<Range> {
    let around = |range: &Range| [(range.at, range.end().min(hole.at)), (range.at.max(hole.end()), range.end())];
    let parts = ranges.iter().flat_map(around).filter(|(at, end)| at < end);
    parts.map(|(at, end)| Range { at, len: end.0 - at.0 }).collect()
}

fn inside(start: u32, end: u32, all: u32, field: &'static str, errors: &mut Vec<LoadError>) -> Option<u32> {
    if start <= end && end <= all {
        return Some(end - start);
    }
    errors.push(LoadError::Config { field, value: start.max(end).into(), max: all.into() });
    None
}

fn clear_gaps<T: Default>(list: &mut [T], keep: &[std::ops::Range<usize>]) {
    for (i, item) in list.iter_mut().enumerate() {
        if !keep.iter().any(|range| range.contains(&i)) {
            *item = T::default();
        }
    }
}

/// What gives the retained bytes of a data block their meaning: its declarations, and of an instance those of its
/// function block. Statements are no part of it, so that a program keeps its data when a statement changes.
fn meaning(db: &DataBlock, program: &Program) -> u64 {
    use std::fmt::Write;
    let mut hash = Hash::default();
    // Writing into the hash cannot fail.
    let _ = write!(hash, "{:?} {} {:?};", db.kind, db.bytes.len(), db.components);
    if let DataKind::Instance(id) = db.kind {
        let block = program.blocks.iter().find(|block| block.id == id);
        let params = block.iter().flat_map(|block| &block.interface.params);
        for param in params.filter(|param| param.section != Section::Temp) {
            let _ = write!(hash, "{param:?};");
        }
    }
    hash.0
}

/// FNV-1a over words of eight bytes.
pub(crate) struct Hash(pub(crate) u64);

impl Default for Hash {
    fn default() -> Self {
        Self(0xCBF2_9CE4_8422_2325)
    }
}

impl Hash {
    pub(crate) fn add(&mut self, bytes: &[u8]) {
        for chunk in bytes.chunks(8) {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            self.0 = (self.0 ^ u64::from_le_bytes(word)).wrapping_mul(0x0100_0000_01B3).rotate_left(29);
        }
        self.0 = (self.0 ^ bytes.len() as u64).wrapping_mul(0x0100_0000_01B3);
    }
}

impl std::fmt::Write for Hash {
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        self.add(text.as_bytes());
        Ok(())
    }
}
