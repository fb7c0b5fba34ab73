//! What the kernel knows about this process and its threads, for reports.

use std::fs;

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
    fn this_process_has_memory_and_this_thread_faults() {
        assert!(memory().resident_kib > 0);
        let before = thread_usage();
        let fresh = vec![1u8; 4 << 20];
        let after = thread_usage();
        assert!(after.minor_faults >= before.minor_faults && fresh.len() == 4 << 20);
    }
}
