//! One scan, in full: what the flight recorder keeps, and what a late scan is explained from.

use ob1_model::{BlockId, BlockKind};

use crate::Nanos;

/// What was special about a scan.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Flags {
    /// It began so much after its deadline that it counts as late.
    pub began_late: bool,
    /// It took so long that it counts as late.
    pub took_long: bool,
    /// It had not ended when the next was due.
    pub overran: bool,
    /// The watchdog expired.
    pub watchdog: bool,
}

impl Flags {
    /// Whether the scan has to be explained.
    #[must_use]
    pub const fn is_late(self) -> bool {
        self.began_late || self.took_long || self.overran || self.watchdog
    }
}

/// One scan. Times are those of the runtime's clock, in nanoseconds since its start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ScanRecord {
    /// Counts the scans, from 1.
    pub scan: u64,
    /// Its deadline.
    pub planned: Nanos,
    /// When it began.
    pub start: Nanos,
    /// When it had ended.
    pub end: Nanos,
    /// How much of its lateness is the scan before, which had not ended at the deadline.
    pub carried: Nanos,
    /// How much of its lateness are organization blocks that ran between the two scans and had not ended at the
    /// deadline.
    pub between: Nanos,
    /// The longest organization block that ran between the two scans; 0: none.
    pub between_ob: u16,
    /// Back plane and process image before OB 1.
    pub inputs: Nanos,
    /// All organization blocks, plugins included.
    pub program: Nanos,
    /// All blocks of plugins, where their times are taken.
    pub plugins: Nanos,
    /// Process image and back plane after OB 1.
    pub outputs: Nanos,
    /// Statements executed.
    pub statements: u64,
    /// The organization block that took longest, without higher classes; 0: none.
    pub longest_ob: u16,
    /// Its time.
    pub longest_ob_time: Nanos,
    /// The call of a plugin's block that took longest.
    pub longest_plugin: Option<BlockId>,
    /// Its time.
    pub longest_plugin_time: Nanos,
    /// The block that ran when the scan had become long, as seen at the first safe point after that.
    pub long_in: Option<BlockId>,
    /// The line of its source.
    pub long_at_line: u32,
    /// Deadlines that were skipped after it.
    pub missed: u64,
    /// What was special about it.
    pub flags: Flags,
}

/// Words of a record in the recorder.
pub(super) const WORDS: usize = 19;

impl ScanRecord {
    /// From the deadline to the start.
    #[must_use]
    pub fn lateness(&self) -> Nanos {
        self.start.saturating_sub(self.planned)
    }

    /// From the start to the end.
    #[must_use]
    pub fn execution(&self) -> Nanos {
        self.end.saturating_sub(self.start)
    }

    pub(super) fn to_words(self) -> [u64; WORDS] {
        let flags = self.flags;
        let bits = [flags.began_late, flags.took_long, flags.overran, flags.watchdog];
        let flags = bits.iter().enumerate().fold(0, |word, (bit, set)| word | u64::from(*set) << bit);
        [
            self.scan,
            self.planned,
            self.start,
            self.end,
            self.carried,
            self.between,
            self.between_ob.into(),
            self.inputs,
            self.program,
            self.plugins,
            self.outputs,
            self.statements,
            self.longest_ob.into(),
            self.longest_ob_time,
            of_block(self.longest_plugin),
            self.longest_plugin_time,
            of_block(self.long_in) << 32 | u64::from(self.long_at_line),
            self.missed,
            flags,
        ]
    }

    pub(super) fn from_words(words: &[u64; WORDS]) -> Self {
        let bit = |n: u32| words[18] >> n & 1 == 1;
        Self {
            scan: words[0],
            planned: words[1],
            start: words[2],
            end: words[3],
            carried: words[4],
            between: words[5],
            between_ob: words[6] as u16,
            inputs: words[7],
            program: words[8],
            plugins: words[9],
            outputs: words[10],
            statements: words[11],
            longest_ob: words[12] as u16,
            longest_ob_time: words[13],
            longest_plugin: to_block(words[14]),
            longest_plugin_time: words[15],
            long_in: to_block(words[16] >> 32),
            long_at_line: words[16] as u32,
            missed: words[17],
            flags: Flags { began_late: bit(0), took_long: bit(1), overran: bit(2), watchdog: bit(3) },
        }
    }
}

/// Kind and number in 24 bits, with a bit above them that tells a block from none.
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
            planned: 2,
            start: 3,
            end: 4,
            carried: 5,
            between: 6,
            between_ob: 35,
            inputs: 7,
            program: 8,
            plugins: 9,
            outputs: 10,
            statements: 11,
            longest_ob: 1,
            longest_ob_time: 12,
            longest_plugin: Some(BlockId::new(BlockKind::Fc, 0)),
            longest_plugin_time: 13,
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
