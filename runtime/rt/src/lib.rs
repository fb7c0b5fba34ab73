//! The fenced operating-system calls of the runtime: the clock and the sleep to a deadline, locking memory, scheduling
//! of the scan thread, its stack, the threads beside it, the reservation its memory lies in, what the kernel says about
//! it, when it was continued after a stop, what a process that crashes still does, the limit of files, and the
//! system-call fence.
//!
//! Everything asked of the system answers with what was granted, what was refused and what would grant it ([`Grant`]);
//! nothing here fails a run because a privilege is missing.

// Fenced by the house rules: sched_setscheduler, the signal mask of a thread and an action of
// our own for a signal have no safe wrapper.
#![allow(unsafe_code)]

mod clock;
mod confirmed;
mod continued;
mod crash;
mod exit;
mod file_limit;
mod posture;
mod remedy;
mod reservation;
mod side_thread;
mod stack;
mod system;
mod system_calls;
mod usage;

pub use clock::MonotonicClock;
pub use confirmed::confirmed_bytes;
pub use continued::Continued;
pub use crash::{LastWords, Place, take_handler_stack};
pub use exit::{ExitGuard, end_at_signal, end_now, ended_by_signal, lower_exit_guard};
pub use file_limit::survive_file_limit;
pub use posture::{Grant, Outcome, Posture, lock_memory, may_lock_all, pin_to, raise_priority, set_timer_slack};
pub use remedy::remedy;
pub use reservation::{RESERVED_BYTES, reserve};
pub use side_thread::SideThread;
pub use stack::{
    PREFAULT_BYTES, THREAD_STACK_BYTES, block_signals, prefault_stack, spawn, spawn_with_stack, warm_heap, with_stack,
};
pub use system::{isolated_cores, keep_awake, system_facts};
pub use system_calls::{ALLOWED_SYSTEM_CALLS, FenceError, fence_scan};
pub use usage::{Memory, ProcessState, ThreadLook, ThreadTimes, memory, process_state, thread_id};
