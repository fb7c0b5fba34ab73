//! What the kernel counts for the scan thread and its cores, read from `/proc` by the observer.

use std::fs;
use std::path::{Path, PathBuf};

use ob1_rt::ThreadTimes;
use ob1_time::Span;

/// Time of a tick of `/proc/stat` (USER_HZ is 100 on every Linux).
const TICK: Span = Span::from_millis(10);
/// Where control groups are.
const CGROUPS: &str = "/sys/fs/cgroup";

/// What is read: the thread and what it runs on.
#[derive(Clone, Debug)]
pub(super) struct Sources {
    /// Cores the scan is bound to; empty: all.
    cores: Vec<usize>,
    /// `cpu.stat` of the process's control group and of those above it.
    quotas: Vec<PathBuf>,
}

/// Counters at one moment. 0 where `/proc` does not say.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Counters {
    /// Time the host has taken from the cores, since the boot.
    pub(super) steal: Span,
    /// Time the cores were at interrupts, since the boot.
    pub(super) interrupts: Span,
    /// Time the quotas of the control groups have held back their threads.
    pub(super) throttled: Span,
    pub(super) switches: u64,
    pub(super) minor_faults: u64,
    pub(super) major_faults: u64,
}

impl Sources {
    /// For a scan on these cores.
    pub(super) fn find(cores: Vec<usize>) -> Self {
        let groups = fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
        let limits = |path: &PathBuf| fs::read_to_string(path).is_ok_and(|text| throttled(&text).is_some());
        Self { cores, quotas: quotas(&groups).into_iter().filter(limits).collect() }
    }

    /// The times of a thread of this process; `None` without `schedstat`.
    pub(super) fn times(thread: u32) -> Option<ThreadTimes> {
        ThreadTimes::parse(&fs::read(format!("/proc/self/task/{thread}/schedstat")).ok()?)
    }

    /// Reads the counters of a thread of this process.
    pub(super) fn read(&self, thread: u32) -> Counters {
        let read = |name: &str| fs::read_to_string(format!("/proc/self/task/{thread}/{name}")).unwrap_or_default();
        let (minor_faults, major_faults) = faults(&read("stat"));
        let of_cores = fs::read_to_string("/proc/stat").unwrap_or_default();
        let held = |path: &PathBuf| throttled(&fs::read_to_string(path).ok()?);
        Counters {
            steal: of_the_cores(&of_cores, &self.cores, &[STEAL]),
            interrupts: of_the_cores(&of_cores, &self.cores, &[IRQ, SOFTIRQ]),
            throttled: self.quotas.iter().filter_map(held).fold(Span::ZERO, Span::saturating_add),
            switches: switches(&read("status")),
            minor_faults,
            major_faults,
        }
    }
}

/// Where the limits of the groups in `/proc/self/cgroup` may stand: of each group, and of all above it. A namespace may
/// show its own group as the root.
fn quotas(groups: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for line in groups.lines() {
        let mut parts = line.splitn(3, ':').skip(1);
        let (Some(controllers), Some(group)) = (parts.next(), parts.next()) else { continue };
        if !controllers.is_empty() && !controllers.split(',').any(|controller| controller == "cpu") {
            continue;
        }
        let root = Path::new(CGROUPS).join(controllers);
        let group = Path::new(group.trim_start_matches('/'));
        found.extend(group.ancestors().map(|above| root.join(above).join("cpu.stat")));
    }
    found
}

/// From a `cpu.stat`: microseconds in version 2, nanoseconds in version 1.
fn throttled(stat: &str) -> Option<Span> {
    let figure = |key: &str| stat.lines().find_map(|line| line.strip_prefix(key)?.trim().parse::<u64>().ok());
    let (micros, nanos) = (figure("throttled_usec "), figure("throttled_time "));
    micros.map(Span::from_micros).or_else(|| nanos.map(Span::from_nanos))
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

/// Figures of a core's line in `/proc/stat`.
const IRQ: usize = 5;
const SOFTIRQ: usize = 6;
const STEAL: usize = 7;

/// The sum of these figures over the cores' lines, or of the line of all cores when none are named.
fn of_the_cores(stat: &str, cores: &[usize], figures: &[usize]) -> Span {
    let ticks = |name: &str| -> u64 {
        let line = stat.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' ')).unwrap_or_default();
        let all: Vec<u64> = line.split_whitespace().map(|figure| figure.parse().unwrap_or(0)).collect();
        figures.iter().filter_map(|&figure| all.get(figure)).sum()
    };
    let sum: u64 =
        if cores.is_empty() { ticks("cpu") } else { cores.iter().map(|core| ticks(&format!("cpu{core}"))).sum() };
    TICK.times(sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_proc() {
        let stat = "77 (ob1 (x) scan) S 1 77 77 0 -1 4194368 210 0 3 0 5 6 0 0 20 0 1 0 99 0 0\n";
        assert_eq!((faults(stat), faults("nonsense")), ((210, 3), (0, 0)));
        assert_eq!(switches("Name:\tx\nvoluntary_ctxt_switches:\t5\nnonvoluntary_ctxt_switches:\t7\n"), 7);
        let stat = "cpu  8 0 2 1 6 2 1 30 0 0\ncpu0 4 0 1 1 3 0 1 10 0 0\ncpu1 4 0 1 0 3 2 0 20 0 0\n";
        let steal = |cores: &[usize]| of_the_cores(stat, cores, &[STEAL]);
        assert_eq!([steal(&[]), steal(&[1]), steal(&[0, 1])], [30 * TICK, 20 * TICK, 30 * TICK]);
        assert_eq!(steal(&[7]), Span::ZERO);
        assert_eq!(of_the_cores(stat, &[], &[IRQ, SOFTIRQ]), 3 * TICK);
        assert_eq!(of_the_cores(stat, &[1], &[IRQ, SOFTIRQ]), 2 * TICK);
    }

    #[test]
    fn quotas_of_control_groups() {
        let paths = |text: &str| quotas(text).iter().map(|path| path.display().to_string()).collect::<Vec<_>>();
        let unified =
            ["/sys/fs/cgroup/a.slice/b/cpu.stat", "/sys/fs/cgroup/a.slice/cpu.stat", "/sys/fs/cgroup/cpu.stat"];
        assert_eq!(paths("0::/a.slice/b\n"), unified);
        let first = ["/sys/fs/cgroup/cpu,cpuacct/docker/cpu.stat", "/sys/fs/cgroup/cpu,cpuacct/cpu.stat"];
        assert_eq!(paths("4:memory:/docker\n3:cpu,cpuacct:/docker\n2:cpuset:/\nnonsense\n"), first);
        assert_eq!(throttled("usage_usec 9\nnr_throttled 2\nthrottled_usec 1500\n"), Some(Span::from_micros(1_500)));
        assert_eq!(throttled("nr_periods 1\nthrottled_time 77\n"), Some(Span::from_nanos(77)));
        assert_eq!(throttled("usage_usec 9\n"), None, "a group without the controller");
    }

    #[test]
    fn this_thread_has_counters() {
        // Pages that nobody has touched before.
        let mut fresh = vec![0u8; 4 << 20];
        fresh.iter_mut().step_by(4096).for_each(|byte| *byte = 1);
        assert_eq!(std::hint::black_box(&fresh)[4096], 1);
        let counters = Sources::find(Vec::new()).read(ob1_rt::thread_id());
        assert!(counters.minor_faults > 0, "{counters:?}");
    }
}
