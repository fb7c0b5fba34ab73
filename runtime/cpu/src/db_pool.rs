//! Data blocks that the program makes and deletes (SFC 22, SFC 23), in a part of the arena reserved for them.
//!
//! A deleted block's bytes are given to another only between two scans: until then data block registers may still point
//! there.

use crate::arena::{ArenaByte, Db, Range};
use crate::made_data_blocks::{Attributes, Made};
use crate::memory::Memory;

/// Why no data block can be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum NoDb {
    /// Every number is taken.
    Number,
    /// No room in the pool, or too many blocks.
    Room,
}

impl Memory {
    /// Makes a data block of zeros under the lowest free number from `low` to `high`.
    pub(crate) fn make_db(&mut self, low: u16, high: u16, len: u32, attributes: Attributes) -> Result<u16, NoDb> {
        let number =
            (low.max(1)..=high).find(|n| self.by_number.get(usize::from(*n)) == Some(&0)).ok_or(NoDb::Number)?;
        let place = self.made.iter().position(|made| made.db.number == 0).ok_or(NoDb::Room)?;
        let room = attributes.room(len);
        let at = self.gap(room).ok_or(NoDb::Room)?;
        let db = Db { at, len, writable: if attributes.read_only { 0 } else { len }, number };
        self.bytes[Range { at, len: room }.bytes()].fill(0);
        self.made[place] = Made { db, attributes, freed: false };
        let index = self.program_dbs + place;
        self.dbs[index] = db;
        self.by_number[usize::from(number)] = index as u16 + 1;
        Ok(number)
    }

    /// The first gap in the pool that is large enough.
    fn gap(&self, len: u32) -> Option<ArenaByte> {
        let end = |made: &Made| made.db.at.plus(made.taken());
        let mut at = self.pool.at;
        loop {
            if at.plus(len) > self.pool.end() {
                return None;
            }
            let wanted = at..at.plus(len.max(1));
            let taken = self
                .made
                .iter()
                .filter(|made| made.db.number != 0)
                .find(|made| made.db.at < wanted.end && wanted.start < end(made));
            match taken {
                Some(made) => at = end(made),
                None => return Some(at),
            }
        }
    }

    /// Deletes a data block that [`Memory::make_db`] made; `false` when it was not.
    pub(crate) fn delete_db(&mut self, number: u16) -> bool {
        let Some(place) = self.made.iter().position(|made| made.db.number == number && !made.freed) else {
            return false;
        };
        self.made[place].freed = true;
        self.by_number[usize::from(number)] = 0;
        self.freed = true;
        true
    }

    /// Between two scans: the bytes of deleted data blocks are free.
    #[inline]
    pub(crate) fn reuse_deleted(&mut self) {
        if std::mem::take(&mut self.freed) {
            for made in self.made.iter_mut().filter(|made| made.freed) {
                *made = Made::default();
            }
        }
    }

    /// Takes over the data blocks another program has made, where their numbers are free and there is room.
    pub(crate) fn adopt_made(&mut self, before: &Self) {
        for was in before.made_dbs() {
            if self.make_db(was.db.number, was.db.number, was.db.len, was.attributes).is_err() {
                continue;
            }
            if let Some(made) = self.made_db(was.db.number) {
                self.slice_mut(made.db.range()).copy_from_slice(before.slice(was.db.range()));
                self.slice_mut(made.load_values()).copy_from_slice(before.slice(was.load_values()));
            }
        }
    }

    /// Deletes every data block the program has made.
    pub(crate) fn delete_made(&mut self) {
        for made in &mut self.made {
            if made.db.number != 0 && !made.freed {
                self.by_number[usize::from(made.db.number)] = 0;
            }
            *made = Made::default();
        }
        self.freed = false;
    }

    /// The data blocks the program has made.
    pub(crate) fn made_dbs(&self) -> impl Iterator<Item = Made> {
        self.made.iter().copied().filter(|made| made.db.number != 0 && !made.freed)
    }

    /// Bytes of the pool that data blocks take, with those deleted in the running scan.
    pub(crate) fn taken_of_pool(&self) -> u32 {
        let taken: u32 = self.made.iter().filter(|made| made.db.number != 0).map(Made::taken).sum();
        taken.min(self.pool.len)
    }

    /// A data block the program has made.
    pub(crate) fn made_db(&self, number: u16) -> Option<Made> {
        self.made_dbs().find(|made| made.db.number == number)
    }

    /// Gives those that are not retentive their load values.
    pub(crate) fn reload_made(&mut self) {
        for made in self.made.iter().filter(|made| made.attributes.non_retain) {
            self.bytes.copy_within(made.load_values().bytes(), made.db.at.index());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CpuConfig;

    const PLAIN: Attributes = Attributes { read_only: false, non_retain: false };
    const READ_ONLY: Attributes = Attributes { read_only: true, non_retain: false };
    const NON_RETAIN: Attributes = Attributes { read_only: false, non_retain: true };

    #[test]
    fn deleted_bytes_are_reused_between_scans_only() {
        let config = CpuConfig { db_pool_bytes: 64, ..CpuConfig::default() };
        let mut memory = Memory::new(&config, &[], &[], &ob1_arena::Arena::new).unwrap();
        assert_eq!(memory.make_db(5, 6, 20, PLAIN), Ok(5));
        assert_eq!(memory.make_db(5, 6, 30, READ_ONLY), Ok(6));
        assert_eq!(memory.make_db(5, 6, 2, PLAIN), Err(NoDb::Number));
        assert_eq!(memory.make_db(1, 9, 20, PLAIN), Err(NoDb::Room));
        let first = memory.db(5).unwrap();
        memory.write_bits(first.at.bit(0), 32, u32::MAX);
        assert_eq!((memory.db(6).map(|db| db.writable), memory.db(6).map(|db| db.len)), (Some(0), Some(30)));
        assert!(memory.delete_db(5) && !memory.delete_db(5) && !memory.delete_db(99));
        assert_eq!(memory.db(5), None);
        assert_eq!(memory.make_db(5, 5, 20, PLAIN), Err(NoDb::Room), "registers may still point there");
        memory.reuse_deleted();
        assert_eq!(memory.make_db(5, 5, 24, PLAIN), Ok(5));
        assert_eq!((memory.db(5).unwrap().at, memory.read_bits(first.at.bit(0), 32)), (first.at, 0));
        memory.delete_made();
        assert_eq!((memory.db(5), memory.db(6), memory.made_dbs().count()), (None, None, 0));
        assert_eq!(memory.make_db(1, 1, 64, PLAIN), Ok(1));
    }

    #[test]
    fn one_that_is_not_retentive_has_its_load_values_behind_its_bytes() {
        let config = CpuConfig { db_pool_bytes: 64, ..CpuConfig::default() };
        let mut memory = Memory::new(&config, &[], &[], &ob1_arena::Arena::new).unwrap();
        assert_eq!(memory.make_db(5, 5, 36, NON_RETAIN), Err(NoDb::Room), "it would take 80 bytes");
        assert_eq!(memory.make_db(5, 5, 18, NON_RETAIN), Ok(5));
        assert_eq!(memory.taken_of_pool(), 48);
        assert_eq!(memory.make_db(6, 6, 24, PLAIN), Err(NoDb::Room));
        assert_eq!(memory.make_db(6, 6, 16, PLAIN), Ok(6));
        assert_eq!(memory.taken_of_pool(), 64);
        let (five, six) = (memory.db(5).unwrap(), memory.db(6).unwrap());
        memory.load_values_mut(5).unwrap().fill(7);
        memory.slice_mut(five.range()).fill(1);
        memory.slice_mut(six.range()).fill(2);
        let mut next = Memory::new(&config, &[], &[], &ob1_arena::Arena::new).unwrap();
        next.adopt_made(&memory);
        for memory in [&mut memory, &mut next] {
            assert_eq!((memory.slice(five.range()), memory.slice(six.range())), (&[1; 18][..], &[2; 16][..]));
            memory.reload_made();
            assert_eq!((memory.slice(five.range()), memory.slice(six.range())), (&[7; 18][..], &[2; 16][..]));
        }
        let all = [PLAIN, READ_ONLY, NON_RETAIN];
        assert_eq!(all.map(|one| Attributes::of_bits(one.bits())), all);
    }
}
