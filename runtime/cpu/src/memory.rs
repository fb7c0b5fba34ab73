//! The memory arena: every area and data block of the CPU in one flat piece with stable offsets.
//!
//! Order: inputs, outputs, bit memory, local data stack, call scratch, constants, data blocks. A bit address in the
//! arena (byte * 8 + bit) fits 32 bits; references to actual parameters are such addresses.

use ob1_arena::Arena;
use ob1_ir::DataBlock;
use ob1_model::cells;

use crate::arena::{ArenaBit, ArenaByte, Db, Range};
use crate::engine::Areas;
use crate::made_data_blocks::Made;
use crate::{CpuConfig, LoadError};

/// Bytes for operands that calls copy in and out, for all nested calls together.
pub(crate) const SCRATCH_BYTES: u32 = 16 * 1024;
/// Most data blocks made by the program that can exist at one time.
const MADE: usize = 256;
/// Bytes after the last data block, so that a double word at the last byte of an area stays inside the arena.
const TAIL: usize = 8;
const MAX_BYTES: usize = 256 << 20;

/// The areas and their offsets.
#[derive(Debug)]
pub(crate) struct Memory {
    pub(crate) bytes: Arena,
    pub(crate) inputs: Range,
    pub(crate) outputs: Range,
    pub(crate) memory: Range,
    pub(crate) local: Range,
    pub(crate) scratch: Range,
    pub(crate) constants: Range,
    /// Data blocks: those of the program in ascending order of their numbers, then places for those it makes itself.
    pub(crate) dbs: Box<[Db]>,
    pub(crate) program_dbs: usize,
    /// Number to index in `dbs`, +1; 0: not loaded.
    pub(crate) by_number: Box<[u16]>,
    /// Room for data blocks the program makes itself, see [`crate::db_pool`].
    pub(crate) pool: Range,
    pub(crate) made: Box<[Made]>,
    /// One of them has been deleted in this scan.
    pub(crate) freed: bool,
    /// Load values of all data blocks, for a cold restart.
    load_values: Box<[u8]>,
    /// All data blocks of the program.
    pub(crate) all_dbs: Range,
}

impl Memory {
    /// Lays out all areas; `constants` are the constants of calls, `arena` gives so many bytes of 0.
    pub(crate) fn new(
        config: &CpuConfig,
        data: &[DataBlock],
        constants: &[u8],
        arena: &dyn Fn(usize) -> Arena,
    ) -> Result<Self, LoadError> {
        let mut next = 0u32;
        let mut area = |len: u32| {
            let range = Range { at: ArenaByte(next), len };
            next += len.next_multiple_of(8);
            range
        };
        let inputs = area(config.input_bytes);
        let outputs = area(config.output_bytes);
        let memory = area(config.memory_bytes);
        let local = area(config.local_bytes);
        let scratch = area(SCRATCH_BYTES);
        let constants_range = area(u32::try_from(constants.len()).unwrap_or(u32::MAX / 2));
        let first_db = next;

        let mut sorted: Vec<&DataBlock> = data.iter().collect();
        sorted.sort_by_key(|db| db.number);
        let need = first_db as usize + sorted.iter().map(|db| db.bytes.len().next_multiple_of(8)).sum::<usize>();
        let pool_len = config.db_pool_bytes.next_multiple_of(8);
        let whole = need + pool_len as usize;
        if whole + TAIL > MAX_BYTES {
            return Err(LoadError::Memory { bytes: whole });
        }
        let last =
            if pool_len > 0 { usize::from(u16::MAX) } else { sorted.last().map_or(0, |db| usize::from(db.number)) };
        let mut by_number = vec![0u16; last + 1];
        let mut dbs = Vec::with_capacity(sorted.len());
        let mut load_values = Vec::with_capacity(need - first_db as usize);
        for block in sorted {
            let len = u32::try_from(block.bytes.len()).unwrap_or(0);
            let at = ArenaByte(first_db + u32::try_from(load_values.len()).unwrap_or(0));
            dbs.push(Db { at, len, writable: if block.read_only { 0 } else { len }, number: block.number });
            by_number[usize::from(block.number)] = u16::try_from(dbs.len()).unwrap_or(0);
            load_values.extend_from_slice(&block.bytes);
            load_values.resize(load_values.len().next_multiple_of(8), 0);
        }
        let program_dbs = dbs.len();
        let made = if pool_len > 0 { MADE } else { 0 };
        dbs.resize(program_dbs + made, Db::default());
        let mut bytes = arena(whole + TAIL);
        bytes[constants_range.bytes()].copy_from_slice(constants);
        let all_dbs = Range { at: ArenaByte(first_db), len: u32::try_from(load_values.len()).unwrap_or(0) };
        bytes[all_dbs.bytes()].copy_from_slice(&load_values);
        Ok(Self {
            bytes,
            inputs,
            outputs,
            memory,
            local,
            scratch,
            constants: constants_range,
            dbs: dbs.into_boxed_slice(),
            program_dbs,
            pool: Range { at: ArenaByte(need as u32), len: pool_len },
            made: vec![Made::default(); made].into_boxed_slice(),
            freed: false,
            by_number: by_number.into_boxed_slice(),
            load_values: load_values.into_boxed_slice(),
            all_dbs,
        })
    }

    /// Where the areas lie.
    pub(crate) fn areas(&self) -> Areas {
        let Self { inputs, outputs, memory, local, scratch, constants, .. } = *self;
        Areas { inputs, outputs, memory, local, scratch, constants }
    }

    /// The data block of a number.
    #[inline]
    pub(crate) fn db(&self, number: u16) -> Option<Db> {
        let index = usize::from(*self.by_number.get(usize::from(number))?);
        self.dbs.get(index.checked_sub(1)?).copied()
    }

    pub(crate) fn slice(&self, range: Range) -> &[u8] {
        &self.bytes[range.bytes()]
    }

    pub(crate) fn slice_mut(&mut self, range: Range) -> &mut [u8] {
        &mut self.bytes[range.bytes()]
    }

    /// Clears both process images, bit memory except `keep` (ascending), and local data.
    pub(crate) fn clear_areas(&mut self, keep: &[Range]) {
        let (inputs, outputs) = (self.inputs, self.outputs);
        self.slice_mut(inputs).fill(0);
        self.slice_mut(outputs).fill(0);
        for gap in gaps(self.memory, keep) {
            self.bytes[gap.bytes()].fill(0);
        }
        let (from, to) = (self.local.at.index(), self.scratch.end().index());
        self.bytes[from..to].fill(0);
    }

    /// Gives the data blocks of the program their load values, except `keep` (ascending).
    pub(crate) fn reload_dbs(&mut self, keep: &[Range]) {
        let all = self.all_dbs;
        for gap in gaps(all, keep) {
            let from = gap.at.index() - all.at.index();
            self.bytes[gap.bytes()].copy_from_slice(&self.load_values[from..from + gap.len as usize]);
        }
    }

    /// The load values of a data block.
    pub(crate) fn load_values_mut(&mut self, number: u16) -> Option<&mut [u8]> {
        let index = usize::from(*self.by_number.get(usize::from(number))?).checked_sub(1)?;
        let Some(db) = self.dbs[..self.program_dbs].get(index) else {
            let values = self.made.get(index - self.program_dbs)?.load_values();
            return self.bytes.get_mut(values.bytes());
        };
        let at = db.at.index() - self.all_dbs.at.index();
        self.load_values.get_mut(at..at + db.len as usize)
    }

    /// A data block of the program.
    pub(crate) fn program_db(&self, number: u16) -> Option<Db> {
        let index = usize::from(*self.by_number.get(usize::from(number))?).checked_sub(1)?;
        self.dbs[..self.program_dbs].get(index).copied()
    }

    /// Another program's load values of a data block of the same length.
    pub(crate) fn take_load_values(&mut self, before: &Self, number: u16) {
        let of = |memory: &Self| {
            let db = memory.program_db(number)?;
            let at = db.at.index() - memory.all_dbs.at.index();
            Some(at..at + db.len as usize)
        };
        let (Some(from), Some(to)) = (of(before), of(self)) else { return };
        if from.len() == to.len() {
            self.load_values[to].copy_from_slice(&before.load_values[from]);
        }
    }

    /// New bytes for a data block of the program, which are also its new load values; only if the length is the same.
    pub(crate) fn set_db(&mut self, number: u16, bytes: &[u8]) {
        let Some(db) = self.program_db(number).filter(|db| db.len as usize == bytes.len()) else { return };
        self.bytes[db.range().bytes()].copy_from_slice(bytes);
        if let Some(values) = self.load_values_mut(number) {
            values.copy_from_slice(bytes);
        }
    }

    /// Reads 1, 8, 16 or 32 bits at a bit address of the arena; 0 outside.
    #[inline]
    pub(crate) fn read_bits(&self, at: ArenaBit, bits: u8) -> u32 {
        let byte = at.byte().index();
        let value = match bits {
            1 => self.bytes.get(byte).map(|b| u32::from(b >> at.in_byte() & 1)),
            8 => self.bytes.get(byte).map(|b| u32::from(*b)),
            16 => cells::word(&self.bytes, byte).map(u32::from),
            _ => cells::dword(&self.bytes, byte),
        };
        value.unwrap_or(0)
    }

    /// Writes 1, 8, 16 or 32 bits at a bit address of the arena; nothing outside.
    #[inline]
    pub(crate) fn write_bits(&mut self, at: ArenaBit, bits: u8, value: u32) {
        let byte = at.byte().index();
        // Outside is impossible for references, which were checked when they were made; ignoring it is harmless.
        let _ = match bits {
            1 => cells::set_bit(&mut self.bytes, at.0 as usize, value & 1 == 1),
            8 => cells::set(&mut self.bytes, byte, 1, value),
            16 => cells::set(&mut self.bytes, byte, 2, value),
            _ => cells::set(&mut self.bytes, byte, 4, value),
        };
    }

    /// Copies whole bytes within the arena.
    pub(crate) fn copy(&mut self, from: ArenaByte, to: ArenaByte, len: u32) {
        let (from, to, len) = (from.index(), to.index(), len as usize);
        if from + len <= self.bytes.len() && to + len <= self.bytes.len() {
            self.bytes.copy_within(from..from + len, to);
        }
    }
}

/// The parts of `all` that lie outside `keep`, which is in ascending order.
fn gaps(all: Range, keep: &[Range]) -> impl Iterator<Item = Range> {
    let starts = std::iter::once(all.at).chain(keep.iter().map(|range| range.end()));
    let ends = keep.iter().map(|range| range.at).chain(std::iter::once(all.end()));
    starts.zip(ends).map(|(at, end)| Range { at, len: end.0.saturating_sub(at.0) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ob1_ir::DataKind;

    fn db(number: u16, bytes: &[u8], read_only: bool) -> DataBlock {
        let (kind, components) = (DataKind::Global, Vec::new());
        DataBlock { number, name: None, kind, bytes: bytes.to_vec(), components, read_only, non_retain: false }
    }

    #[test]
    fn areas_do_not_touch_and_dbs_get_their_load_values() {
        let config = CpuConfig { input_bytes: 3, ..CpuConfig::default() };
        let mut memory =
            Memory::new(&config, &[db(20, &[1, 2, 3], true), db(3, &[9; 10], false)], &[0xAA, 0xBB], &Arena::new)
                .unwrap();
        assert_eq!(memory.outputs.at, ArenaByte(8), "areas begin on multiples of 8");
        let (d3, d20) = (memory.db(3).unwrap(), memory.db(20).unwrap());
        assert_eq!((d3.len, d3.writable, d20.len, d20.writable), (10, 10, 3, 0));
        assert_eq!(d20.at, d3.at.plus(16));
        assert_eq!(memory.db(4), None);
        assert_eq!(memory.db(60_000), None);
        assert_eq!(memory.slice(memory.constants), [0xAA, 0xBB]);
        memory.write_bits(d3.at.bit(0), 32, 0);
        memory.reload_dbs(&[]);
        assert_eq!(memory.read_bits(d3.at.bit(0), 32), 0x0909_0909);
    }
}
