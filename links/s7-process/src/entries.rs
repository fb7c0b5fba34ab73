//! Entries of the diagnostic buffer for those who have subscribed to them. An event reports each entry; the entry
//! itself, with the date and time of the CPU, is read from a status list.

/// Bytes of an entry.
const ENTRY: usize = 20;
/// Maximum of reported entries that have not been read; beyond that the oldest are dropped.
const REPORTED: usize = 64;
/// Entries that may come between a question and its answer.
const LATER: usize = 16;

/// Entries that were reported and not read yet.
#[derive(Debug, Default)]
pub(crate) struct Entries {
    /// Their events, oldest first.
    reported: Vec<u16>,
    /// The question is about so many of them.
    asked: usize,
}

impl Entries {
    /// There is a new entry with this event.
    pub(crate) fn report(&mut self, event: u16) {
        if self.reported.len() >= REPORTED {
            self.reported.remove(0);
            self.asked = self.asked.saturating_sub(1);
        }
        self.reported.push(event);
    }

    /// How many of the newest entries must be read; `None`: none.
    pub(crate) fn ask(&mut self) -> Option<u16> {
        self.asked = self.reported.len();
        (self.asked > 0).then_some((self.asked + LATER) as u16)
    }

    /// The newest entries have been read, newest first. Returns those that the question was about, oldest first.
    pub(crate) fn read(&mut self, newest: &[u8]) -> Vec<[u8; ENTRY]> {
        let wanted: Vec<u16> = self.reported.drain(..self.asked).collect();
        self.asked = 0;
        let (newest, _) = newest.as_chunks::<ENTRY>();
        let len = wanted.len().min(newest.len());
        if len == 0 {
            return Vec::new();
        }
        let event = |entry: &[u8; ENTRY]| u16::from_be_bytes([entry[0], entry[1]]);
        let is_it = |some: &&[[u8; ENTRY]]| some.iter().map(event).eq(wanted.iter().rev().take(len).copied());
        let found = newest.windows(len).find(is_it).or_else(|| newest.get(..len)).unwrap_or_default();
        found.iter().rev().copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(event: u16, mark: u8) -> [u8; ENTRY] {
        let mut entry = [mark; ENTRY];
        entry[..2].copy_from_slice(&event.to_be_bytes());
        entry
    }

    #[test]
    fn each_reported_entry_comes_once_and_in_order() {
        let mut entries = Entries::default();
        assert_eq!(entries.ask(), None);
        entries.report(0x4301);
        assert_eq!(entries.ask(), Some(17));
        // The next one is reported before the answer, which has it already.
        entries.report(0x4302);
        let buffer = [entry(0x4302, 3), entry(0x4301, 2), entry(0x4304, 1)].concat();
        assert_eq!(entries.read(&buffer), [entry(0x4301, 2)]);
        assert_eq!(entries.ask(), Some(17));
        assert_eq!(entries.read(&buffer), [entry(0x4302, 3)]);
        assert_eq!(entries.ask(), None);
        // Two at once, and a third is in the answer before it is reported.
        entries.report(0x4304);
        entries.report(0x4301);
        assert_eq!(entries.ask(), Some(18));
        let buffer = [entry(0x4302, 6), entry(0x4301, 5), entry(0x4304, 4), entry(0x4302, 3)].concat();
        assert_eq!(entries.read(&buffer), [entry(0x4304, 4), entry(0x4301, 5)]);
        assert_eq!(entries.ask(), None);
    }

    #[test]
    fn what_cannot_be_read_is_dropped() {
        let mut entries = Entries::default();
        entries.report(0x4304);
        assert_eq!(entries.ask(), Some(17));
        assert!(entries.read(&[]).is_empty());
        assert_eq!(entries.ask(), None);
        // A flood: the oldest are dropped, those of the question too.
        entries.report(0x2521);
        assert_eq!(entries.ask(), Some(17));
        (0..100).for_each(|_| entries.report(0x2522));
        assert!(entries.read(&entry(0x2522, 7)).is_empty());
        assert_eq!(entries.ask(), Some(80));
        assert_eq!(entries.read(&entry(0x2522, 7)), [entry(0x2522, 7)]);
    }
}
