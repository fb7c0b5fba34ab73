//! Diagnostic entries on their way out of the scan.

use ob1_cpu::{Cpu, DIAG_ENTRIES, DiagEntry};
use rtrb::{Consumer, Producer, RingBuffer};

/// Entries under way. They are fetched every few milliseconds; what does not fit stays in the CPU's buffer until then.
const RING: usize = 4 * DIAG_ENTRIES;

/// The scan's end.
#[derive(Debug)]
pub struct Feed {
    entries: Producer<DiagEntry>,
    sent: u64,
}

/// The other end.
#[derive(Debug)]
pub struct FeedEnd(Consumer<DiagEntry>);

/// Both ends.
#[must_use]
pub fn feed() -> (Feed, FeedEnd) {
    let (entries, end) = RingBuffer::new(RING);
    (Feed { entries, sent: 0 }, FeedEnd(end))
}

impl Feed {
    /// After each cycle: hands over what is new. The number of the newest entry.
    pub fn follow(&mut self, cpu: &Cpu) -> u64 {
        let newest = cpu.diagnostic(0).map_or(0, |entry| entry.number);
        // Older ones are gone.
        self.sent = self.sent.max(newest.saturating_sub(DIAG_ENTRIES as u64));
        while self.sent < newest {
            let back = newest - self.sent - 1;
            let Some(entry) = cpu.diagnostic(back as usize) else { break };
            if self.entries.push(*entry).is_err() {
                break;
            }
            self.sent += 1;
        }
        newest
    }
}

impl FeedEnd {
    /// The next entry that has come.
    pub fn take(&mut self) -> Option<DiagEntry> {
        self.0.pop().ok()
    }
}
