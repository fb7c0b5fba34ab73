//! Where the scan is: for those who must report it when the scan itself no longer can.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use ob1_model::{BlockId, BlockKind, Site};

/// A statement in one word: the kind of its block (4 bits, of 1 up), its number (16), network (16), line (28).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) struct Packed(u64);

impl Packed {
    /// No statement at all.
    pub(crate) const NONE: Self = Self(0);

    pub(crate) fn of(site: Site) -> Self {
        Self(
            (site.block.kind as u64 + 1) << 60
                | u64::from(site.block.number) << 44
                | u64::from(site.network) << 28
                | u64::from(site.line) & 0x0FFF_FFFF,
        )
    }

    fn site(self) -> Option<Site> {
        let kind = BlockKind::from_repr(((self.0 >> 60) as u8).checked_sub(1)?)?;
        let block = BlockId::new(kind, (self.0 >> 44) as u16);
        Some(Site { block, network: (self.0 >> 28) as u16, line: (self.0 & 0x0FFF_FFFF) as u32 })
    }
}

/// The running organization block, and the statement that has called the last plugin block. One thread writes, anybody
/// may read at any time, also a signal handler: there is nothing but atomics.
#[derive(Debug, Default)]
pub struct ScanPosition {
    ob: AtomicU32,
    /// The calling statement, as a [`Packed`].
    caller: AtomicU64,
}

impl ScanPosition {
    pub(crate) fn enter(&self, ob: u16) {
        self.ob.store(u32::from(ob), Ordering::Relaxed);
    }

    #[inline]
    pub(crate) fn call(&self, site: Packed) {
        self.caller.store(site.0, Ordering::Relaxed);
    }

    /// The running organization block; `None` between two of them.
    #[must_use]
    pub fn ob(&self) -> Option<u16> {
        Some(self.ob.load(Ordering::Relaxed) as u16).filter(|ob| *ob != 0)
    }

    /// The statement that has called the last block of a plugin.
    #[must_use]
    pub fn caller(&self) -> Option<Site> {
        Packed(self.caller.load(Ordering::Relaxed)).site()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_statement_comes_back_as_it_was() {
        let place = ScanPosition::default();
        assert_eq!((place.ob(), place.caller()), (None, None));
        for kind in [BlockKind::Ob, BlockKind::Fb, BlockKind::Fc] {
            let site = Site { block: BlockId::new(kind, 65_535), network: 65_535, line: 0x0FFF_FFFF };
            place.call(Packed::of(site));
            assert_eq!(place.caller(), Some(site));
        }
        place.call(Packed::NONE);
        place.enter(121);
        assert_eq!((place.ob(), place.caller()), (Some(121), None));
    }
}
