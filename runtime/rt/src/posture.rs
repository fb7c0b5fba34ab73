//! The posture of the scan thread: what was asked of the system, what it granted, and what would grant the rest.

use std::num::NonZeroU64;

use rustix::io::Errno;
use rustix::mm::{Advice, MlockAllFlags, madvise, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, CpuSet, capabilities, sched_setaffinity, set_current_timer_slack};

/// What became of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Granted as it was requested.
    Granted,
    /// In part; see the text.
    Partly,
    /// Refused; the run continues without it.
    Refused,
    /// A fact about the system, which needs nothing.
    Noted,
    /// A fact about the system that costs something; see the text.
    Costs,
}

/// One request and its outcome.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Grant {
    /// What was requested: `lock memory`, `SCHED_FIFO priority 50`.
    pub what: String,
    /// What became of it.
    pub outcome: Outcome,
    /// What that means, or the fact, in one sentence; empty when granted without remark.
    pub detail: String,
    /// The command or setting that would grant it.
    pub remedy: Option<&'static str>,
}

impl Grant {
    fn granted(what: String) -> Self {
        Self { what, outcome: Outcome::Granted, detail: String::new(), remedy: None }
    }

    fn refused(what: String, why: Errno, remedy: &'static str) -> Self {
        Self { what, outcome: Outcome::Refused, detail: why.to_string(), remedy: Some(remedy) }
    }
}

/// All grants of a run, in the order of the requests.
pub type Posture = Vec<Grant>;

const LOCK_REMEDY: &str =
    "start as root, or with CAP_IPC_LOCK (systemd: LimitMEMLOCK=infinity; shell: ulimit -l unlimited)";
const PRIORITY_REMEDY: &str =
    "start as root, or with CAP_SYS_NICE (systemd: LimitRTPRIO=99; /etc/security/limits.d: 'USER - rtprio 99')";
const AFFINITY_REMEDY: &str =
    "name cores that exist and that the cpuset of this process contains (see: taskset -p PID)";

/// Locks the memory of the process, pages as they are first touched (MCL_ONFAULT), so that stacks cost what they use.
///
/// What only the start has touched is given back before.
///
/// Without CAP_IPC_LOCK and with a limit, only what is mapped now is locked: a lock on the future would make later
/// mappings (threads, logs) fail as soon as the limit is reached.
#[must_use]
pub fn lock_memory() -> Grant {
    let what = "lock memory".to_owned();
    give_back();
    let may_lock_all = may_lock_all();
    let now = MlockAllFlags::CURRENT | MlockAllFlags::ONFAULT;
    let flags = if may_lock_all { now | MlockAllFlags::FUTURE } else { now };
    match mlockall(flags) {
        Ok(()) if may_lock_all => Grant::granted(what),
        Ok(()) => Grant {
            what,
            outcome: Outcome::Partly,
            detail:
                "memory mapped at the start is locked, later mappings are not: the limit on locked memory is finite"
                    .into(),
            remedy: Some(LOCK_REMEDY),
        },
        Err(why) => Grant::refused(what, why, LOCK_REMEDY),
    }
}

/// Gives back freed memory, and the pages of programs and libraries: those that are still needed come back from the
/// page cache in the first scans. Half of the code is for reading and compiling a station.
fn give_back() {
    #[cfg(target_env = "gnu")]
    // SAFETY: it has no preconditions.
    unsafe {
        libc::malloc_trim(0);
    }
    for (from, len) in clean_files(&std::fs::read_to_string("/proc/self/smaps").unwrap_or_default()) {
        // SAFETY: a private mapping of a file none of whose pages was written shows the same content when it is read
        // again. Nothing is written there meanwhile: it is not writable.
        let _ = unsafe { madvise(std::ptr::with_exposed_provenance_mut(from), len, Advice::LinuxDontNeed) };
    }
}

/// First address and length of each private mapping of a file that cannot be written and was not, as relocations and
/// breakpoints do.
fn clean_files(smaps: &str) -> Vec<(usize, usize)> {
    let mut found: Vec<(usize, usize)> = Vec::new();
    let mut last = None;
    for line in smaps.lines() {
        let mut words = line.split_ascii_whitespace();
        let (first, second) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
        if let Some((from, to)) = first.split_once('-').filter(|_| second.len() == 4) {
            let address = |text| usize::from_str_radix(text, 16).ok();
            let is_file = words.nth(3).is_some_and(|path| path.starts_with('/'));
            let is_read = matches!(second, "r-xp" | "r--p");
            last = address(from).zip(address(to)).filter(|_| is_file && is_read);
        } else if let ("Anonymous:", "0", Some((from, to))) = (first, second, last) {
            found.push((from, to - from));
        }
    }
    found
}

/// No limit on locked memory holds for this process: it has CAP_IPC_LOCK, or the limit is infinite.
#[must_use]
pub fn may_lock_all() -> bool {
    capabilities(None).is_ok_and(|c| c.effective.contains(CapabilitySet::IPC_LOCK))
        || getrlimit(Resource::Memlock).current.is_none()
}

/// Raises the calling thread, and it alone, to SCHED_FIFO with `priority` (1 to 99). Threads and processes it starts
/// fall back to the ordinary scheduler (SCHED_RESET_ON_FORK).
#[must_use]
pub fn raise_priority(priority: u8) -> Grant {
    let what = format!("SCHED_FIFO priority {priority}");
    // SAFETY: an all-zero sched_param is valid (it is one integer, with padding on some systems).
    let mut param: libc::sched_param = unsafe { std::mem::zeroed() };
    param.sched_priority = i32::from(priority);
    // SAFETY: thread 0 is the calling thread, and the parameter outlives the call.
    let answer = unsafe { libc::sched_setscheduler(0, libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK, &raw const param) };
    if answer == 0 {
        return Grant::granted(what);
    }
    let why = std::io::Error::last_os_error().raw_os_error().map_or(Errno::PERM, Errno::from_raw_os_error);
    Grant::refused(what, why, PRIORITY_REMEDY)
}

/// Binds the calling thread to the given cores.
#[must_use]
pub fn pin_to(cores: &[usize]) -> Grant {
    let what = format!("cores {cores:?}");
    let mut set = CpuSet::new();
    for &core in cores {
        if core >= CpuSet::MAX_CPU {
            return Grant::refused(what, Errno::INVAL, AFFINITY_REMEDY);
        }
        set.set(core);
    }
    match sched_setaffinity(None, &set) {
        Ok(()) => Grant::granted(what),
        Err(why) => Grant::refused(what, why, AFFINITY_REMEDY),
    }
}

/// Sets the timer slack of the calling thread to 1 ns: without it the kernel may wake an ordinary thread 50 µs late to
/// save power.
#[must_use]
pub fn set_timer_slack() -> Grant {
    let what = "timer slack 1 ns".to_owned();
    match set_current_timer_slack(NonZeroU64::new(1)) {
        Ok(()) => Grant::granted(what),
        Err(why) => Grant::refused(what, why, "the kernel has no PR_SET_TIMERSLACK"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A thread of its own, because what is granted stays.
    fn on_a_thread(ask: impl FnOnce() -> Grant + Send + 'static) -> Grant {
        crate::spawn("ob1-posture", ask).expect("a thread").join().expect("no panic")
    }

    #[test]
    fn every_refusal_names_its_remedy() {
        let asked = [
            on_a_thread(|| raise_priority(1)),
            on_a_thread(|| raise_priority(100)),
            on_a_thread(|| pin_to(&[CpuSet::MAX_CPU])),
            on_a_thread(|| pin_to(&[])),
            on_a_thread(set_timer_slack),
        ];
        for grant in &asked {
            assert_eq!(grant.outcome == Outcome::Granted, grant.remedy.is_none(), "{grant:?}");
        }
        assert_eq!(asked[1].outcome, Outcome::Refused, "there is no priority 100");
        assert_eq!(asked[2].outcome, Outcome::Refused, "there is no such core");
        assert_eq!(asked[3].outcome, Outcome::Refused, "a thread needs a core");
        assert_eq!(asked[4].outcome, Outcome::Granted, "the slack needs no privilege");
    }

    #[test]
    fn only_files_that_nobody_has_written_are_given_back() {
        let smaps = "1000-3000 r-xp 00000000 00:01 7  /usr/bin/ob1\nRss: 8 kB\nAnonymous:             0 kB\n\
                     3000-4000 r--p 00002000 00:01 7  /usr/bin/ob1\nAnonymous:             4 kB\n\
                     4000-5000 rw-p 00003000 00:01 7  /usr/bin/ob1\nAnonymous:             0 kB\n\
                     5000-6000 r--p 00000000 00:00 0 \nAnonymous:             0 kB\n\
                     6000-7000 r-xs 00000000 00:01 9  /memfd:ob1-code\nAnonymous:             0 kB\n\
                     7000-9000 r--p 00000000 00:01 8  /lib/libm.so.6\nAnonymous:             0 kB\n";
        assert_eq!(clean_files(smaps), [(0x1000, 0x2000), (0x7000, 0x2000)]);
        let mine = std::fs::read_to_string("/proc/self/smaps").expect("smaps");
        assert!(clean_files(&mine).len() > 2, "{mine}");
        // The code that runs comes back.
        give_back();
    }

    #[test]
    fn a_raised_thread_passes_nothing_on() {
        let inherited = on_a_thread(|| {
            let grant = raise_priority(1);
            let child = crate::spawn("ob1-process", || {
                // SAFETY: asks for the policy of the calling thread.
                unsafe { libc::sched_getscheduler(0) }
            });
            let policy = child.expect("a thread").join().expect("no panic");
            assert_eq!(policy & !libc::SCHED_RESET_ON_FORK, libc::SCHED_OTHER, "after {grant:?}");
            grant
        });
        assert!(inherited.what.contains("SCHED_FIFO"));
    }
}
