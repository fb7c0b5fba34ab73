//! A data block that the program makes itself (SFC 22, SFC 82, SFC 85): its place, and what it is made with.

use crate::arena::{Db, Range};

/// A place for a data block that the program makes itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Made {
    pub(crate) db: Db,
    pub(crate) attributes: Attributes,
    /// Deleted in the running scan.
    pub(crate) freed: bool,
}

impl Made {
    /// Bytes of the pool that are no others' while it is there.
    pub(crate) fn taken(&self) -> u32 {
        self.attributes.room(self.db.len).max(8)
    }

    /// Where its load values lie: behind its bytes if it is not retentive, else they are its bytes.
    pub(crate) const fn load_values(&self) -> Range {
        let Range { at, len } = self.db.range();
        let behind = if self.attributes.non_retain { len.next_multiple_of(8) } else { 0 };
        Range { at: at.plus(behind), len }
    }
}

/// What a data block is made with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Attributes {
    pub(crate) read_only: bool,
    /// A warm restart gives it its load values.
    pub(crate) non_retain: bool,
}

impl Attributes {
    /// As the image of retentive memory has them.
    pub(crate) const fn bits(self) -> u32 {
        self.read_only as u32 | (self.non_retain as u32) << 1
    }

    pub(crate) const fn of_bits(bits: u32) -> Self {
        Self { read_only: bits & 1 != 0, non_retain: bits & 2 != 0 }
    }

    /// Bytes of the pool that a data block of this length takes.
    pub(crate) const fn room(self, len: u32) -> u32 {
        len.next_multiple_of(8) * if self.non_retain { 2 } else { 1 }
    }
}
