//! The flight recorder: the last scans in full, in two rings. An overrun freezes the ring that is being written, and
//! the scan continues in the other one. Taking the frozen ring releases it.

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering, fence};

use super::record::{ScanRecord, WORDS};

/// Records of the last scans up to an overrun, oldest first.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Flight {
    /// The scans; the last is the one that overran.
    pub scans: Vec<ScanRecord>,
}

#[derive(Debug)]
struct Ring {
    slots: Box<[[AtomicU64; WORDS]]>,
    /// Records written since the ring was begun.
    written: AtomicU64,
    /// How many of them are kept.
    kept: u64,
}

impl Ring {
    /// At least one slot more than scans: the one after the newest may be half written. A power of two: a division in
    /// each scan would cost more than the slots.
    fn new(scans: usize) -> Self {
        let slots = (0..(scans + 1).next_power_of_two()).map(|_| [const { AtomicU64::new(0) }; WORDS]).collect();
        Self { slots, written: AtomicU64::new(0), kept: scans as u64 }
    }

    fn slot(&self, index: u64) -> &[AtomicU64; WORDS] {
        &self.slots[index as usize & (self.slots.len() - 1)]
    }

    fn push(&self, record: &ScanRecord) {
        let written = self.written.load(Ordering::Relaxed);
        // Pairs with the fence in `read`: a reader that sees a word of this record also sees that its slot is being
        // written again.
        fence(Ordering::Release);
        let slot = self.slot(written);
        for (cell, word) in slot.iter().zip(record.to_words()) {
            cell.store(word, Ordering::Relaxed);
        }
        self.written.store(written + 1, Ordering::Release);
    }

    fn read(&self) -> Vec<ScanRecord> {
        let len = self.slots.len() as u64;
        let end = self.written.load(Ordering::Acquire);
        let copied: Vec<(u64, ScanRecord)> = (end.saturating_sub(self.kept)..end)
            .map(|index| {
                let slot = self.slot(index);
                let words = std::array::from_fn(|i| slot[i].load(Ordering::Relaxed));
                (index, ScanRecord::from_words(&words))
            })
            .collect();
        fence(Ordering::Acquire);
        let now = self.written.load(Ordering::Relaxed);
        if now < end {
            // A freeze has restarted this ring.
            return Vec::new();
        }
        copied.into_iter().filter(|(index, _)| index + len > now).map(|(_, record)| record).collect()
    }
}

#[derive(Debug)]
pub(super) struct Recorder {
    rings: [Ring; 2],
    active: AtomicUsize,
    frozen: AtomicBool,
    skipped: AtomicU64,
}

impl Recorder {
    pub(super) fn new(len: usize) -> Self {
        let len = len.clamp(1, 65_536);
        Self {
            rings: [Ring::new(len), Ring::new(len)],
            active: AtomicUsize::new(0),
            frozen: AtomicBool::new(false),
            skipped: AtomicU64::new(0),
        }
    }

    /// Enters a scan; `freeze`: it is the last of its flight.
    pub(super) fn push(&self, record: &ScanRecord, freeze: bool) {
        let active = self.active.load(Ordering::Relaxed);
        self.rings[active & 1].push(record);
        if !freeze {
            return;
        }
        if self.frozen.load(Ordering::Acquire) {
            self.skipped.store(self.skipped() + 1, Ordering::Relaxed);
            return;
        }
        self.rings[(active + 1) & 1].written.store(0, Ordering::Release);
        self.active.store((active + 1) & 1, Ordering::Release);
        self.frozen.store(true, Ordering::Release);
    }

    pub(super) fn read(&self) -> Vec<ScanRecord> {
        self.rings[self.active.load(Ordering::Acquire) & 1].read()
    }

    pub(super) fn take_frozen(&self) -> Option<Flight> {
        if !self.frozen.load(Ordering::Acquire) {
            return None;
        }
        let scans = self.rings[(self.active.load(Ordering::Acquire) + 1) & 1].read();
        // Release: the scan may write this ring again only after it has been read.
        self.frozen.store(false, Ordering::Release);
        Some(Flight { scans })
    }

    pub(super) fn skipped(&self) -> u64 {
        self.skipped.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use ob1_time::Instant;

    use super::super::record::tests::example;
    use super::*;

    fn numbers(scans: &[ScanRecord]) -> Vec<u64> {
        scans.iter().map(|record| record.scan).collect()
    }

    #[test]
    fn the_last_scans_are_kept_and_an_overrun_freezes_them() {
        let recorder = Recorder::new(4);
        (1..=6).for_each(|scan| recorder.push(&example(scan), false));
        assert_eq!(numbers(&recorder.read()), [3, 4, 5, 6]);
        assert_eq!(recorder.read()[0], example(3));
        assert_eq!(recorder.take_frozen(), None);
        recorder.push(&example(7), true);
        (8..=9).for_each(|scan| recorder.push(&example(scan), false));
        recorder.push(&example(10), true);
        assert_eq!((numbers(&recorder.read()), recorder.skipped()), (vec![8, 9, 10], 1));
        assert_eq!(recorder.take_frozen().map(|flight| numbers(&flight.scans)), Some(vec![4, 5, 6, 7]));
        recorder.push(&example(11), true);
        assert_eq!(recorder.take_frozen().map(|flight| numbers(&flight.scans)), Some(vec![8, 9, 10, 11]));
        assert_eq!(recorder.read(), []);
    }

    #[test]
    #[expect(clippy::disallowed_methods, reason = "a reader beside the writer, as in a station")]
    fn a_reader_beside_the_scan_sees_whole_records_only() {
        const SCANS: u64 = 200_000;
        let recorder = Recorder::new(8);
        let whole =
            |scan: u64| ScanRecord { planned: Instant::from_nanos(scan * 3), missed: scan * 7, ..example(scan) };
        std::thread::scope(|scope| {
            scope.spawn(|| (1..=SCANS).for_each(|scan| recorder.push(&whole(scan), scan % 1000 == 0)));
            let mut last = 0;
            while last < SCANS {
                let mut seen = recorder.read();
                seen.extend(recorder.take_frozen().into_iter().flat_map(|flight| flight.scans));
                for record in seen {
                    assert_eq!(record, whole(record.scan));
                    last = last.max(record.scan);
                }
            }
        });
    }
}
