//! The full record of one scan: the flight recorder keeps it, and a late scan is explained from it.

use ob1_model::{BlockId, BlockKind};
use ob1_time::{Instant, Span};

/// What was special about a scan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags {
    /// It began so much after its deadline that it counts as late.
    pub began_late: bool,
    /// It took so long that it counts as late.
    pub took_long: bool,
    /// It had not ended when the next was due.
    pub overran: bool,
    /// The cycle monitoring time expired in it.
    pub watchdog: bool,
}

impl Flags {
    /// Whether the scan has to be explained.
    #[must_use]
    pub const fn is_late(self) -> bool {
        self.began_late || self.took_long || self.overran || self.watchdog
    }
}

/// One scan. Times are those of the runtime's clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScanRecord {
    /// Counts the scans, from 1.
    pub scan: u64,
    /// Its deadline: when it should have begun.
    pub planned: Instant,
    /// When it did begin.
    pub start: Instant,
    /// When it had ended.
    pub end: Instant,
    /// The part of its lateness caused by the previous scan, which had not ended at the deadline.
    pub carried: Span,
    /// The part of its lateness caused by organization blocks that ran between the two scans and had not ended at the
    /// deadline.
    pub between: Span,
    /// The longest organization block that ran between the two scans; 0: none.
    pub between_ob: u16,
    /// Back plane and process image before OB 1.
    pub inputs: Span,
    /// All organization blocks, plugins included.
    pub program: Span,
    /// All blocks of plugins, if the times of their calls are recorded.
    pub plugins: Span,
    /// Process image and back plane after OB 1.
    pub outputs: Span,
    /// Statements executed from its start to its end.
    pub statements: u64,
    /// The organization block that took longest, without higher classes; 0: none.
    pub longest_ob: u16,
    /// How long that block took.
    pub longest_ob_time: Span,
    /// The call of a plugin's block that took longest.
    pub longest_plugin: Option<BlockId>,
    /// How long that call took.
    pub longest_plugin_time: Span,
    /// The block that was running at the first safe point after the scan had become long.
    pub long_in: Option<BlockId>,
    /// The line of its source.
    pub long_at_line: u32,
    /// Deadlines that were skipped after it.
    pub missed: u64,
    /// What was special about it.
    pub flags: Flags,
}

/// Words of a record in the recorder.
pub(crate) const WORDS: usize = 19;

impl ScanRecord {
    /// From the deadline to the start.
    #[must_use]
    pub fn lateness(&self) -> Span {
        self.start.since(self.planned)
    }

    /// From the start to the end.
    #[must_use]
    pub fn execution(&self) -> Span {
        self.end.since(self.start)
    }

    #[inline]
    pub(crate) fn to_words(self) -> [u64; WORDS] {
        let flags = self.flags;
        let bits = [flags.began_late, flags.took_long, flags.overran, flags.watchdog];
        let flags = bits.iter().enumerate().fold(0, |word, (bit, set)| word | u64::from(*set) << bit);
        [
            self.scan,
            self.planned.nanos(),
            self.start.nanos(),
            self.end.nanos(),
            self.carried.nanos(),
            self.between.nanos(),
            self.between_ob.into(),
            self.inputs.nanos(),
            self.program.nanos(),
            self.plugins.nanos(),
            self.outputs.nanos(),
            self.statements,
            self.longest_ob.into(),
            self.longest_ob_time.nanos(),
            of_block(self.longest_plugin),
            self.longest_plugin_time.nanos(),
            of_block(self.long_in) << 32 | u64::from(self.long_at_line),
            self.missed,
            flags,
        ]
    }

    pub(crate) fn from_words(words: &[u64; WORDS]) -> Self {
        let bit = |n: u32| words[18] >> n & 1 == 1;
        Self {
            scan: words[0],
            planned: Instant::from_nanos(words[1]),
            start: Instant::from_nanos(words[2]),
            end: Instant::from_nanos(words[3]),
            carried: Span::from_nanos(words[4]),
            between: Span::from_nanos(words[5]),
            between_ob: words[6] as u16,
            inputs: Span::from_nanos(words[7]),
            program: Span::from_nanos(words[8]),
            plugins: Span::from_nanos(words[9]),
            outputs: Span::from_nanos(words[10]),
            statements: words[11],
            longest_ob: words[12] as u16,
            longest_ob_time: Span::from_nanos(words[13]),
            longest_plugin: to_block(words[14]),
            longest_plugin_time: Span::from_nanos(words[15]),
            long_in: to_block(words[16] >> 32),
            long_at_line: words[16] as u32,
            missed: words[17],
            flags: Flags { began_late: bit(0), took_long: bit(1), overran: bit(2), watchdog: bit(3) },
        }
    }
}

/// Kind and number in 24 bits; the bit above them is set when there is a block.
fn of_block(block: Option<BlockId>) -> u64 {
    block.map_or(0, |id| 1 << 24 | (id.kind as u64) << 16 | u64::from(id.number))
}

fn to_block(word: u64) -> Option<BlockId> {
    if word & 1 << 24 == 0 {
        return None;
    }
    Some(BlockId::new(BlockKind::from_repr((word >> 16) as u8)?, word as u16))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A record with another value in every field.
    pub(crate) fn example(scan: u64) -> ScanRecord {
        ScanRecord {
            scan,
            planned: Instant::from_nanos(2),
            start: Instant::from_nanos(3),
            end: Instant::from_nanos(4),
            carried: Span::from_nanos(5),
            between: Span::from_nanos(6),
            between_ob: 35,
            inputs: Span::from_nanos(7),
            program: Span::from_nanos(8),
            plugins: Span::from_nanos(9),
            outputs: Span::from_nanos(10),
            statements: 11,
            longest_ob: 1,
            longest_ob_time: Span::from_nanos(12),
            longest_plugin: Some(BlockId::new(BlockKind::Fc, 0)),
            longest_plugin_time: Span::from_nanos(13),
            long_in: Some(BlockId::new(BlockKind::Sfb, 65_535)),
            long_at_line: 14,
            missed: 15,
            flags: Flags { overran: true, ..Flags::default() },
        }
    }

    #[test]
    fn a_record_comes_back_from_its_words() {
        for record in [example(7), ScanRecord::default()] {
            assert_eq!(ScanRecord::from_words(&record.to_words()), record);
        }
        assert!(example(1).flags.is_late() && !Flags::default().is_late());
    }
}
