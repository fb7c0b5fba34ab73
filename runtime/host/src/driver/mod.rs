//! Real driver processes: started, watched and stopped by one thread that runs the supervisor machines.
//!
//! The thread is an ordinary one (SCHED_OTHER), so a start costs the scan nothing. It sees a death by pidfd and a hang
//! by heartbeat. A driver is started with `--segment /proc/PID/fd/N` and its doorbell as stdin, in a process group of
//! its own so that Ctrl-C at the terminal reaches the runtime alone.

mod doorbell;
mod fleet;
mod process;

pub use doorbell::Doorbell;
pub use fleet::{DriverPort, DriverStatus, Fleet, HandOver, RunningFleet, STOP_WAIT};
pub use process::{DriverCommand, Process, kept_environment};
