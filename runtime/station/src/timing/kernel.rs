//! What the kernel counts for the scan thread and its cores, read from `/proc` by the observer.

use std::fs;

use ob1_cpu::Nanos;

/// Time of a tick of `/proc/stat` (USER_HZ is 100 on every Linux).
const TICK: Nanos = 10_000_000;

/// One look.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Sample {
    /// When.
    pub(super) time: Nanos,
    /// Time the thread has waited for a core, since its start.
    pub(super) wait: Nanos,
    /// Time the host has taken from the cores, since the boot.
    pub(super) steal: Nanos,
    pub(super) switches: u64,
    pub(super) minor_faults: u64,
    pub(super) major_faults: u64,
    /// SIGCONT came since the sample before, at this time.
    pub(super) continued: Option<Nanos>,
    /// So much later than planned.
    pub(super) late: Nanos,
}

impl Sample {
    /// Reads the counters of a thread of this process; 0 where `/proc` does not say.
    pub(super) fn read(thread: u32, cores: &[usize], time: Nanos) -> Self {
        let read = |name: &str| fs::read_to_string(format!("/proc/self/task/{thread}/{name}")).unwrap_or_default();
        let (minor_faults, major_faults) = faults(&read("stat"));
        Self {
            time,
            wait: wait(&read("schedstat")),
            steal: steal(&fs::read_to_string("/proc/stat").unwrap_or_default(), cores),
            switches: switches(&read("status")),
            minor_faults,
            major_faults,
            continued: None,
            late: 0,
        }
    }
}

/// The second figure of `schedstat`: time on a run queue, in nanoseconds.
fn wait(schedstat: &str) -> Nanos {
    schedstat.split_whitespace().nth(1).and_then(|figure| figure.parse().ok()).unwrap_or(0)
}

/// Fields 10 and 12 of `stat`; the name in field 2 may hold blanks and brackets.
fn faults(stat: &str) -> (u64, u64) {
    let fields: Vec<&str> =
        stat.rsplit_once(')').map(|(_, rest)| rest.split_whitespace().collect()).unwrap_or_default();
    let figure = |index: usize| fields.get(index).and_then(|field| field.parse().ok()).unwrap_or(0);
    (figure(7), figure(9))
}

fn switches(status: &str) -> u64 {
    let line = status.lines().find_map(|line| line.strip_prefix("nonvoluntary_ctxt_switches:"));
    line.and_then(|figure| figure.trim().parse().ok()).unwrap_or(0)
}

/// The eighth figure of each core's line, or of all cores when none are named.
fn steal(stat: &str, cores: &[usize]) -> Nanos {
    let ticks = |name: &str| {
        let line = stat.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
        line.and_then(|line| line.split_whitespace().nth(7)?.parse::<u64>().ok()).unwrap_or(0)
    };
    let sum = if cores.is_empty() { ticks("cpu") } else { cores.iter().map(|core| ticks(&format!("cpu{core}"))).sum() };
    sum.saturating_mul(TICK)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_proc() {
        assert_eq!((wait("166022 6820 2\n"), wait("")), (6820, 0));
        let stat = "77 (ob1 (x) scan) S 1 77 77 0 -1 4194368 210 0 3 0 5 6 0 0 20 0 1 0 99 0 0\n";
        assert_eq!((faults(stat), faults("nonsense")), ((210, 3), (0, 0)));
        assert_eq!(switches("Name:\tx\nvoluntary_ctxt_switches:\t5\nnonvoluntary_ctxt_switches:\t7\n"), 7);
        let stat = "cpu  8 0 2 1 6 0 1 30 0 0\ncpu0 4 0 1 1 3 0 1 10 0 0\ncpu1 4 0 1 0 3 0 0 20 0 0\n";
        assert_eq!([steal(stat, &[]), steal(stat, &[1]), steal(stat, &[0, 1])], [30 * TICK, 20 * TICK, 30 * TICK]);
        assert_eq!(steal(stat, &[7]), 0);
    }

    #[test]
    fn this_thread_has_counters() {
        // Pages that nobody has touched before.
        let mut fresh = vec![0u8; 4 << 20];
        fresh.iter_mut().step_by(4096).for_each(|byte| *byte = 1);
        assert_eq!(std::hint::black_box(&fresh)[4096], 1);
        let sample = Sample::read(ob1_rt::thread_id(), &[], 5);
        assert_eq!(sample.time, 5);
        assert!(sample.minor_faults > 0, "{sample:?}");
    }
}
