//! What a warm restart and a power cycle keep, found in the arena.

use ob1_ir::Program;
use ob1_model::BlockKind;

use crate::arena::{ArenaByte, Range};
use crate::memory::Memory;
use crate::timers::{Counter, Timer};
use crate::{CpuConfig, LoadError, RetentiveData};

/// The ranges, found in the arena.
#[derive(Debug, Default)]
pub(crate) struct Keep {
    pub(crate) memory: Vec<Range>,
    pub(crate) timers: Vec<std::ops::Range<usize>>,
    pub(crate) counters: Vec<std::ops::Range<usize>>,
    pub(crate) data: Vec<Range>,
    /// Data blocks that the program makes, too.
    pub(crate) made: bool,
    /// The part of the image's header that has to be the same.
    pub(crate) same: Vec<u8>,
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
        keep.memory.sort_unstable_by_key(|range| range.at);
        keep.data.sort_unstable_by_key(|range| range.at);
        for block in program.data.iter().filter(|block| block.non_retain) {
            let Some(db) = memory.program_db(block.number) else { continue };
            keep.data = without(&keep.data, Range { at: db.at, len: db.len.next_multiple_of(8) });
        }
        let mut same = declarations(program).to_le_bytes().to_vec();
        let numbers = |list: &[std::ops::Range<usize>]| -> Vec<(u32, u32)> {
            list.iter().map(|r| (r.start as u32, r.len() as u32)).collect()
        };
        // Offsets in their area: offsets in the arena move with the program's constants.
        let places = |list: &[Range], base: ArenaByte| -> Vec<(u32, u32)> {
            list.iter().map(|r| (r.at.0 - base.0, r.len)).collect()
        };
        for list in [
            places(&keep.memory, memory.memory.at),
            places(&keep.data, memory.all_dbs.at),
            numbers(&keep.timers),
            numbers(&keep.counters),
        ] {
            same.extend_from_slice(&(list.len() as u32).to_le_bytes());
            for (at, len) in list {
                same.extend_from_slice(&at.to_le_bytes());
                same.extend_from_slice(&len.to_le_bytes());
            }
        }
        keep.same = same;
        keep
    }

    /// Everything else becomes as after loading.
    pub(crate) fn clear_rest(&self, memory: &mut Memory, timers: &mut [Timer], counters: &mut [Counter]) {
        memory.clear_areas(&self.memory);
        memory.reload_dbs(&self.data);
        memory.reload_made();
        clear_gaps(timers, &self.timers);
        clear_gaps(counters, &self.counters);
    }
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

/// What gives the retained bytes their meaning: the declarations of data blocks and function blocks. Statements are not
/// part of it, so that a program keeps its data when a statement changes.
fn declarations(program: &Program) -> u64 {
    use std::fmt::Write;
    let mut hash = Hash::default();
    // Writing into the hash cannot fail.
    for db in &program.data {
        let _ = write!(hash, "{} {:?} {} {:?};", db.number, db.kind, db.bytes.len(), db.components);
    }
    for fb in program.blocks.iter().filter(|block| block.id.kind == BlockKind::Fb) {
        let _ = write!(hash, "{} {:?};", fb.id, fb.interface);
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
