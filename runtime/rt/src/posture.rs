//! The posture of the scan thread: what was asked of the system, what it granted, and what would grant the rest.

use std::num::NonZeroU64;

use rustix::io::Errno;
use rustix::mm::{MlockAllFlags, mlockall};
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
/// Without CAP_IPC_LOCK and with a limit, only what is mapped now is locked: a lock on the future would make later
/// mappings (threads, logs) fail as soon as the limit is reached.
#[must_use]
pub fn lock_memory() -> Grant {
    let what = "lock memory".to_owned();
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
