//! Data blocks that the program makes and deletes (SFC 22, SFC 23), in a part of the arena reserved for them.
//!
//! A deleted block's bytes are given to another only between two scans: until then data block registers may still point
//! there.

use crate::arena::{ArenaByte, Db};
use crate::memory::{Made, Memory};

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
    pub(crate) fn make_db(&mut self, low: u16, high: u16, len: u32, read_only: bool) -> Result<u16, NoDb> {
        let number =
            (low.max(1)..=high).find(|n| self.by_number.get(usize::from(*n)) == Some(&0)).ok_or(NoDb::Number)?;
        let place = self.made.iter().position(|made| made.db.number == 0).ok_or(NoDb::Room)?;
        let at = self.gap(len.next_multiple_of(8)).ok_or(NoDb::Room)?;
        let db = Db { at, len, writable: if read_only { 0 } else { len }, number };
        self.bytes[db.range().bytes()].fill(0);
        self.made[place] = Made { db, freed: false };
        let index = self.program_dbs + place;
        self.dbs[index] = db;
        self.by_number[usize::from(number)] = index as u16 + 1;
        Ok(number)
    }

    /// The first gap in the pool that is large enough.
    fn gap(&self, len: u32) -> Option<ArenaByte> {
        let end = |db: Db| db.at.plus(db.len.next_multiple_of(8).max(8));
        let mut at = self.pool.at;
        loop {
            if at.plus(len) > self.pool.end() {
                return None;
            }
            let wanted = at..at.plus(len.max(1));
            let taken = self
                .made
                .iter()
                .map(|made| made.db)
                .filter(|db| db.number != 0)
                .find(|db| db.at < wanted.end && wanted.start < end(*db));
            match taken {
                Some(db) => at = end(db),
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
            if self.make_db(was.number, was.number, was.len, was.writable == 0).is_err() {
                continue;
            }
            if let Some(db) = self.db(was.number) {
                self.bytes[db.range().bytes()].copy_from_slice(before.slice(was.range()));
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
    pub(crate) fn made_dbs(&self) -> impl Iterator<Item = Db> {
        self.made.iter().filter(|made| made.db.number != 0 && !made.freed).map(|made| made.db)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CpuConfig;

    #[test]
    fn deleted_bytes_are_reused_between_scans_only() {
        let config = CpuConfig { db_pool_bytes: 64, ..CpuConfig::default() };
        let mut memory = Memory::new(&config, &[], &[], &ob1_arena::Arena::new).unwrap();
        assert_eq!(memory.make_db(5, 6, 20, false), Ok(5));
        assert_eq!(memory.make_db(5, 6, 30, true), Ok(6));
        assert_eq!(memory.make_db(5, 6, 2, false), Err(NoDb::Number));
        assert_eq!(memory.make_db(1, 9, 20, false), Err(NoDb::Room));
        let first = memory.db(5).unwrap();
        memory.write_bits(first.at.bit(0), 32, u32::MAX);
        assert_eq!((memory.db(6).map(|db| db.writable), memory.db(6).map(|db| db.len)), (Some(0), Some(30)));
        assert!(memory.delete_db(5) && !memory.delete_db(5) && !memory.delete_db(99));
        assert_eq!(memory.db(5), None);
        assert_eq!(memory.make_db(5, 5, 20, false), Err(NoDb::Room), "registers may still point there");
        memory.reuse_deleted();
        assert_eq!(memory.make_db(5, 5, 24, false), Ok(5));
        assert_eq!((memory.db(5).unwrap().at, memory.read_bits(first.at.bit(0), 32)), (first.at, 0));
        memory.delete_made();
        assert_eq!((memory.db(5), memory.db(6), memory.made_dbs().count()), (None, None, 0));
        assert_eq!(memory.make_db(1, 1, 64, false), Ok(1));
    }
}
