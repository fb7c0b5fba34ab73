//! How a module reaches its driver: real processes have a doorbell and a supervisor thread, virtual ones neither.

use crate::driver::DriverPort;
use crate::supervisor::Report;

/// A driver from the scan thread. Nothing here blocks or allocates.
pub trait DriverLink: Send {
    /// Wakes a sleeping driver: at most one system call.
    fn ring(&mut self);
    /// False as soon as the driver's end is known, before what it showed in the segment is cleared.
    fn is_running(&self) -> bool;
    /// What the supervisor has to report.
    fn next_report(&mut self) -> Option<Report>;
    /// The supervisor's counts of its starts, which the driver cannot influence.
    fn life(&self) -> Life;
    /// True while a driver runs that was among the first `attempts` started. The scan asks at each access: one call.
    fn is_running_of(&self, attempts: u32) -> bool {
        self.is_running() && self.life().attempts <= attempts
    }
}

/// Which of a module's drivers this is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Life {
    /// Drivers started so far, this one included, whether they came up or not.
    pub attempts: u32,
    /// Incidents so far ([`crate::supervisor::Supervisor::incidents`]).
    pub incidents: u32,
}

impl DriverLink for DriverPort {
    fn ring(&mut self) {
        self.doorbell.ring();
    }

    #[inline]
    fn is_running(&self) -> bool {
        self.status.pid() != 0
    }

    fn next_report(&mut self) -> Option<Report> {
        self.reports.pop().ok()
    }

    #[inline]
    fn life(&self) -> Life {
        Life { attempts: self.status.attempts(), incidents: self.status.incidents() }
    }
}

/// A driver in the same thread, which looks by itself: simulation and tests.
#[derive(Clone, Copy, Debug, Default)]
pub struct AlwaysThere;

impl DriverLink for AlwaysThere {
    fn ring(&mut self) {}

    fn is_running(&self) -> bool {
        true
    }

    fn next_report(&mut self) -> Option<Report> {
        None
    }

    fn life(&self) -> Life {
        Life::default()
    }
}
