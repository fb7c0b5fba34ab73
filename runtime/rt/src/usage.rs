//! What the kernel knows about this process and its threads, for reports, and about a driver's, for its supervisor.

use std::fs;

use ob1_cpu::Nanos;

/// Time of a tick in `/proc/PID/stat` (USER_HZ is 100 on every Linux).
const TICK: Nanos = 10_000_000;

/// Memory of the process, in KiB, from `/proc/self/status`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Memory {
    /// Resident (`VmRSS`).
    pub resident_kib: u64,
    /// Highest resident so far (`VmHWM`).
    pub peak_kib: u64,
    /// Locked (`VmLck`).
    pub locked_kib: u64,
    /// Threads.
    pub threads: u64,
}

/// Reads the memory figures; zeros where `/proc` is not there.
#[must_use]
pub fn memory() -> Memory {
    fs::read_to_string("/proc/self/status").map(|text| parse_status(&text)).unwrap_or_default()
}

fn parse_status(text: &str) -> Memory {
    let figure = |key: &str| {
        text.lines()
            .find_map(|line| line.strip_prefix(key)?.strip_prefix(':'))
            .and_then(|rest| rest.split_whitespace().next()?.parse().ok())
            .unwrap_or(0)
    };
    Memory {
        resident_kib: figure("VmRSS"),
        peak_kib: figure("VmHWM"),
        locked_kib: figure("VmLck"),
        threads: figure("Threads"),
    }
}

/// What a process is at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ProcessState {
    /// `R` runs or waits for a core, `S` sleeps, `D` is held by the kernel, `T` is stopped; and others, as in proc(5).
    pub state: char,
    /// Time it has had on a core, in steps of 10 ms.
    pub ran: Nanos,
}

/// Looks at a process; `None` where it or `/proc` is not there.
#[must_use]
pub fn process_state(pid: u32) -> Option<ProcessState> {
    parse_stat(&fs::read_to_string(format!("/proc/{pid}/stat")).ok()?)
}

/// Fields 3, 14 and 15; the name in field 2 may hold blanks and brackets.
fn parse_stat(stat: &str) -> Option<ProcessState> {
    let (_, rest) = stat.rsplit_once(')')?;
    let mut fields = rest.split_whitespace();
    let state = fields.next()?.chars().next()?;
    let user: u64 = fields.nth(10)?.parse().ok()?;
    let system: u64 = fields.next()?.parse().ok()?;
    Some(ProcessState { state, ran: user.saturating_add(system).saturating_mul(TICK) })
}

/// The kernel's number of the calling thread.
#[must_use]
pub fn thread_id() -> u32 {
    rustix::thread::gettid().as_raw_nonzero().get().unsigned_abs()
}

/// Kernel counters of one thread.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ThreadUsage {
    /// Page faults that needed no disk.
    pub minor_faults: u64,
    /// Page faults that did.
    pub major_faults: u64,
    /// Times it went to sleep by itself.
    pub voluntary_switches: u64,
    /// Times it was taken off its core.
    pub involuntary_switches: u64,
}

/// The kernel counters of the calling thread: one `getrusage`.
#[must_use]
pub fn thread_usage() -> ThreadUsage {
    let mut usage = std::mem::MaybeUninit::<libc::rusage>::zeroed();
    // SAFETY: getrusage writes one rusage; all-zero is a valid one should the call fail.
    let usage = unsafe {
        libc::getrusage(libc::RUSAGE_THREAD, usage.as_mut_ptr());
        usage.assume_init()
    };
    ThreadUsage {
        minor_faults: usage.ru_minflt as u64,
        major_faults: usage.ru_majflt as u64,
        voluntary_switches: usage.ru_nvcsw as u64,
        involuntary_switches: usage.ru_nivcsw as u64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn status_lines_are_found_by_their_whole_name() {
        let text = "Name:\tob1\nVmHWM:\t   5000 kB\nVmLck:\t     12 kB\nVmRSS:\t   4321 kB\nThreads:\t4\n";
        let expected = Memory { resident_kib: 4321, peak_kib: 5000, locked_kib: 12, threads: 4 };
        assert_eq!(parse_status(text), expected);
        assert_eq!(parse_status("VmRSS without a number"), Memory::default());
    }

    #[test]
    fn state_and_time_of_a_process() {
        let stat = "5035 (ob1) cp) D 1 5035 1 0 -1 4194304 120 0 3 0 7 12 0 0 20 0 1 0 99 1 2 3";
        assert_eq!(parse_stat(stat), Some(ProcessState { state: 'D', ran: 19 * TICK }));
        assert_eq!((parse_stat(""), parse_stat("1 (x) S 1 2")), (None, None));
        assert_eq!(process_state(std::process::id()).map(|process| process.state == 'Z'), Some(false));
        assert_eq!(process_state(u32::MAX), None);
    }

    #[test]
    fn this_process_has_memory_and_this_thread_faults() {
        assert!(memory().resident_kib > 0);
        let before = thread_usage();
        let fresh = vec![1u8; 4 << 20];
        let after = thread_usage();
        assert!(after.minor_faults >= before.minor_faults && fresh.len() == 4 << 20);
    }
}
