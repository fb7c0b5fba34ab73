//! The system-call fence: proof that the scan thread makes only the system calls the house rules allow.
//!
//! A seccomp filter on the calling thread. Any call that is not on the list kills the whole process with SIGSYS, so a
//! run that ends well is a proof. Allowed is what invariant 8 allows: the sleep, a doorbell, one look at kernel
//! counters after a late scan (pread64 of a file that is open). The clock is read through the vDSO; its system call is
//! allowed for machines whose clock source has no vDSO.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

use seccompiler::{SeccompAction, SeccompFilter};
use thiserror::Error;

/// What the fenced thread may do: name and number.
pub const ALLOWED_SYSTEM_CALLS: [(&str, i64); 6] = [
    ("clock_nanosleep", libc::SYS_clock_nanosleep),
    ("write", libc::SYS_write),
    ("pread64", libc::SYS_pread64),
    ("clock_gettime", libc::SYS_clock_gettime),
    // The kernel's own way to continue a sleep after SIGSTOP and SIGCONT.
    ("restart_syscall", libc::SYS_restart_syscall),
    // The end of a process that has crashed (`LastWords`).
    ("exit_group", libc::SYS_exit_group),
];

/// A thread of this process is fenced.
static UP: AtomicBool = AtomicBool::new(false);

/// Whether a thread of this process is fenced.
pub(crate) fn is_up() -> bool {
    UP.load(Ordering::Relaxed)
}

/// The fence could not be built.
#[derive(Debug, Error)]
#[error("the system-call fence could not be built: {0}")]
pub struct FenceError(String);

/// Fences the calling thread, for ever: from here on it makes the calls of [`ALLOWED_SYSTEM_CALLS`] or the process dies
/// of SIGSYS. The thread can then neither return nor exit; it ends with the process.
///
/// # Errors
/// When the kernel has no seccomp or the machine is of an unknown kind.
pub fn fence_scan() -> Result<(), FenceError> {
    let rules: BTreeMap<i64, Vec<seccompiler::SeccompRule>> =
        ALLOWED_SYSTEM_CALLS.iter().map(|&(_, number)| (number, Vec::new())).collect();
    let machine = std::env::consts::ARCH.try_into().map_err(|e| FenceError(format!("{e}")))?;
    let filter = SeccompFilter::new(rules, SeccompAction::KillProcess, SeccompAction::Allow, machine)
        .map_err(|e| FenceError(e.to_string()))?;
    let program: seccompiler::BpfProgram =
        filter.try_into().map_err(|e: seccompiler::BackendError| FenceError(e.to_string()))?;
    UP.store(true, Ordering::Relaxed);
    seccompiler::apply_filter(&program).map_err(|e| FenceError(e.to_string()))
}
