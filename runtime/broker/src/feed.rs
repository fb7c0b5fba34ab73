//! Diagnostic entries on their way out of the scan.

use ob1_cpu::{DIAG_ENTRIES, DIAG_STOPS, DiagBuffer, DiagEntry};
use rtrb::{Consumer, Producer, RingBuffer};

/// Entries under way. They are fetched every few milliseconds; what does not fit stays in the CPU's buffer until then.
const RING: usize = 4 * DIAG_ENTRIES;

/// The scan's end: it hands over entries and never waits.
#[derive(Debug)]
pub struct Feed {
    entries: Producer<DiagEntry>,
    sent: u64,
}

/// The broker's end: it takes the entries in their order.
#[derive(Debug)]
pub struct FeedEnd(Consumer<DiagEntry>);

/// Both ends of a new feed, for one CPU.
#[must_use]
pub fn feed() -> (Feed, FeedEnd) {
    let (entries, end) = RingBuffer::new(RING);
    (Feed { entries, sent: 0 }, FeedEnd(end))
}

impl Feed {
    /// After each cycle, and in HOLD: hands over what is new. The number of the newest entry.
    pub fn follow(&mut self, buffer: &DiagBuffer) -> u64 {
        let newest = buffer.get(0).map_or(0, |entry| entry.number);
        while self.sent < newest {
            let Some(entry) = oldest_after(buffer, self.sent, newest) else { break };
            if self.entries.push(*entry).is_err() {
                break;
            }
            self.sent = entry.number;
        }
        newest
    }
}

/// The oldest entry after number `sent` that the CPU still has. A flood in one cycle may have washed out the ones that
/// follow; the STOPs among them, and what led to them, are kept longer.
fn oldest_after(buffer: &DiagBuffer, sent: u64, newest: u64) -> Option<&DiagEntry> {
    let back = (newest - sent - 1) as usize;
    if back < DIAG_ENTRIES {
        return buffer.get(back);
    }
    let kept = (DIAG_ENTRIES..DIAG_ENTRIES + DIAG_STOPS).rev().filter_map(|back| buffer.get(back));
    kept.into_iter().find(|entry| entry.number > sent).or_else(|| buffer.get(DIAG_ENTRIES - 1))
}

impl FeedEnd {
    /// The next entry that has come.
    pub fn take(&mut self) -> Option<DiagEntry> {
        self.0.pop().ok()
    }
}

#[cfg(test)]
mod tests {
    use ob1_cpu::{Clock, Command, Cpu, CpuConfig};
    use ob1_model::Event;
    use ob1_time::Instant;

    use super::*;

    struct Still;

    impl Clock for Still {
        fn now(&mut self) -> Instant {
            Instant::START
        }
        fn executed(&mut self, _: u64) {}
    }

    #[test]
    fn a_flood_in_one_cycle_hides_no_stop() {
        let program = ob1_stl::compile(&[], &ob1_stl::Library::new(), &ob1_stl::Options::default()).program;
        let made = Cpu::new(CpuConfig::default(), &program, vec![], vec![], ob1_cpu::engine::REFERENCE);
        let mut cpu = made.expect("it loads");
        let (mut feed, mut end) = feed();
        let change = |cpu: &mut Cpu, command| {
            cpu.request(command);
            cpu.cycle(&mut Still);
        };
        change(&mut cpu, Command::Run);
        let started = feed.follow(cpu.diagnostic_buffer());
        assert_eq!(std::iter::from_fn(|| end.take()).last().map(|entry| entry.number), Some(started));
        // To STOP; then, before anybody looks, more than the buffer holds.
        change(&mut cpu, Command::Stop);
        for _ in 0..3 * DIAG_ENTRIES {
            cpu.diagnose(Event::SEGMENT_GARBAGE, 0, "");
        }
        let newest = feed.follow(cpu.diagnostic_buffer());
        let seen: Vec<_> = std::iter::from_fn(|| end.take()).map(|entry| (entry.number, entry.event)).collect();
        assert_eq!(seen.first(), Some(&(started + 1, Event::STOP_OPERATOR)));
        let rest: Vec<u64> = seen.iter().skip(1).map(|(number, _)| *number).collect();
        assert_eq!(rest, (newest - DIAG_ENTRIES as u64 + 1..=newest).collect::<Vec<_>>());
    }
}
