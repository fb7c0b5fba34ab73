//! Where the scan is, for whoever has to say so when it can no longer say anything itself.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use ob1_model::{BlockId, BlockKind, Site};

/// The running organization block, and the statement that has called the last plugin block. One thread writes, anybody
/// may read at any time, also a signal handler: there is nothing but atomics.
#[derive(Debug, Default)]
pub struct Whereabouts {
    ob: AtomicU32,
    /// A `Site`: kind (4 bits, of 1 up), number (16), network (16), line (28).
    caller: AtomicU64,
}

impl Whereabouts {
    pub(crate) fn enter(&self, ob: u16) {
        self.ob.store(u32::from(ob), Ordering::Relaxed);
    }

    pub(crate) fn call(&self, site: Option<Site>) {
        let packed = site.map_or(0, |site| {
            (site.block.kind as u64 + 1) << 60
                | u64::from(site.block.number) << 44
                | u64::from(site.network) << 28
                | u64::from(site.line) & 0x0FFF_FFFF
        });
        self.caller.store(packed, Ordering::Relaxed);
    }

    /// The running organization block; `None` between two of them.
    #[must_use]
    pub fn ob(&self) -> Option<u16> {
        Some(self.ob.load(Ordering::Relaxed) as u16).filter(|ob| *ob != 0)
    }

    /// The statement that has called the last block of a plugin.
    #[must_use]
    pub fn caller(&self) -> Option<Site> {
        let packed = self.caller.load(Ordering::Relaxed);
        let kind = BlockKind::from_repr(((packed >> 60) as u8).checked_sub(1)?)?;
        let block = BlockId::new(kind, (packed >> 44) as u16);
        Some(Site { block, network: (packed >> 28) as u16, line: (packed & 0x0FFF_FFFF) as u32 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_statement_comes_back_as_it_was() {
        let place = Whereabouts::default();
        assert_eq!((place.ob(), place.caller()), (None, None));
        for kind in [BlockKind::Ob, BlockKind::Fb, BlockKind::Fc] {
            let site = Site { block: BlockId::new(kind, 65_535), network: 65_535, line: 0x0FFF_FFFF };
            place.call(Some(site));
            assert_eq!(place.caller(), Some(site));
        }
        place.call(None);
        place.enter(121);
        assert_eq!((place.ob(), place.caller()), (Some(121), None));
    }
}
