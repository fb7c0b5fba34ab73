//! Addresses in the arena: bytes and bits are two types, so that one cannot be taken for the other.

/// A byte of the arena, counted from its first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct ArenaByte(pub u32);

impl ArenaByte {
    /// The bit `bits` bits after this byte's first.
    #[inline]
    #[must_use]
    pub const fn bit(self, bits: u32) -> ArenaBit {
        ArenaBit(self.0 * 8 + bits)
    }

    /// The byte `bytes` further on.
    #[inline]
    #[must_use]
    pub const fn plus(self, bytes: u32) -> Self {
        Self(self.0 + bytes)
    }

    /// As index of the arena's bytes.
    #[inline]
    #[must_use]
    pub const fn index(self) -> usize {
        self.0 as usize
    }
}

/// A bit of the arena: byte x 8 + bit. It fits 31 bits, because the arena is limited to 256 MiB.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct ArenaBit(pub u32);

impl ArenaBit {
    /// The byte it lies in.
    #[inline]
    #[must_use]
    pub const fn byte(self) -> ArenaByte {
        ArenaByte(self.0 / 8)
    }

    /// Its place in that byte, 0 to 7.
    #[inline]
    #[must_use]
    pub const fn in_byte(self) -> u32 {
        self.0 % 8
    }

    /// The mask of the bit in its byte.
    #[inline]
    #[must_use]
    pub const fn mask(self) -> u8 {
        1 << self.in_byte()
    }

    /// The bit `bits` further on.
    #[inline]
    #[must_use]
    pub const fn plus(self, bits: u32) -> Self {
        Self(self.0 + bits)
    }
}

/// A piece of the arena.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(C)]
pub struct Range {
    /// Its first byte in the arena.
    pub at: ArenaByte,
    /// Its length in bytes.
    pub len: u32,
}

impl Range {
    /// The arena byte at offset `at` of this range, if `len` bytes from there lie inside.
    #[inline]
    #[must_use]
    pub fn locate(self, at: u32, len: u32) -> Option<ArenaByte> {
        (u64::from(at) + u64::from(len) <= u64::from(self.len)).then(|| self.at.plus(at))
    }

    /// The byte after the last.
    #[must_use]
    pub const fn end(self) -> ArenaByte {
        self.at.plus(self.len)
    }

    /// As indices of the arena's bytes.
    #[must_use]
    pub const fn bytes(self) -> std::ops::Range<usize> {
        self.at.index()..self.end().index()
    }
}

/// A data block's place; also what a data block register holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(C)]
pub struct Db {
    /// First byte in the arena.
    pub at: ArenaByte,
    /// Its length in bytes.
    pub len: u32,
    /// Bytes that may be written: `len`, or 0 when write-protected.
    pub writable: u32,
    /// The number, 0 for none.
    pub number: u16,
}

impl Db {
    /// All bytes of the data block, those that cannot be written too.
    #[inline]
    #[must_use]
    pub const fn range(self) -> Range {
        Range { at: self.at, len: self.len }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_check_their_end() {
        let range = Range { at: ArenaByte(100), len: 4 };
        assert_eq!(range.locate(2, 2), Some(ArenaByte(102)));
        assert_eq!(range.locate(3, 2), None);
        assert_eq!(range.locate(u32::MAX, 2), None);
    }

    #[test]
    fn bytes_and_bits() {
        let bit = ArenaByte(10).bit(13);
        assert_eq!((bit, bit.byte(), bit.in_byte(), bit.mask()), (ArenaBit(93), ArenaByte(11), 5, 0x20));
    }
}
