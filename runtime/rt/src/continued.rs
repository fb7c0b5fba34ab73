//! When the process was last continued after a stop (SIGSTOP, a debugger, a terminal's job control).

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use ob1_time::Instant;
use signal_hook::consts::SIGCONT;
use signal_hook::low_level;

use crate::MonotonicClock;

/// Notes the time of each SIGCONT. Copies share it.
#[derive(Clone, Debug, Default)]
pub struct Continued(Arc<AtomicU64>);

impl Continued {
    /// Notes from now on, in times of this clock.
    ///
    /// # Errors
    /// The system does not take a handler for SIGCONT.
    pub fn watch(clock: MonotonicClock) -> io::Result<Self> {
        let noted = Self::default();
        let at = Arc::clone(&noted.0);
        // SAFETY: the action reads the clock and stores a number; both may be done in a signal handler.
        unsafe { low_level::register(SIGCONT, move || at.store(clock.time().nanos(), Ordering::Relaxed)) }?;
        Ok(noted)
    }

    /// The time of the last SIGCONT, once. A thread of this process may run a little before it is noted.
    #[must_use]
    pub fn take(&self) -> Option<Instant> {
        Some(Instant::from_nanos(self.0.swap(0, Ordering::Relaxed))).filter(|time| *time > Instant::START)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signal_is_noted_once_with_its_time() {
        let clock = MonotonicClock::start();
        clock.sleep_until(Instant::from_nanos(1));
        let noted = Continued::watch(clock).expect("a signal that may be caught");
        assert_eq!(noted.take(), None);
        let before = clock.time();
        low_level::raise(SIGCONT).expect("a known signal");
        let time = noted.take().expect("it came");
        assert!((before..=clock.time()).contains(&time));
        assert_eq!(noted.take(), None);
    }
}
