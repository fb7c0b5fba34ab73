//! The real clock: CLOCK_MONOTONIC, counted from the start of the runtime.

use ob1_cpu::{Clock, Nanos};
use rustix::io::Errno;
use rustix::thread::{ClockId as SleepClock, clock_nanosleep_absolute};
use rustix::time::{ClockId, Timespec, clock_gettime};

const NANOS_PER_SECOND: u64 = 1_000_000_000;

/// CLOCK_MONOTONIC in nanoseconds since an origin. Copies share the origin, so that all threads speak of the same
/// times.
#[derive(Clone, Copy, Debug)]
pub struct MonotonicClock {
    origin: Nanos,
}

impl MonotonicClock {
    /// A clock that shows 0 now.
    #[must_use]
    pub fn start() -> Self {
        Self { origin: monotonic() }
    }

    /// The time since [`MonotonicClock::start`], in nanoseconds.
    #[must_use]
    pub fn time(&self) -> Nanos {
        monotonic().saturating_sub(self.origin)
    }

    /// Sleeps until this clock shows `deadline`; returns at once when that is past. See [`sleep_until`].
    pub fn sleep_until(&self, deadline: Nanos) {
        sleep_until(self.origin.saturating_add(deadline));
    }

    /// The same, but sleeps `spin` nanoseconds less and looks at the clock without pause until the deadline: the core
    /// is awake then, and the time the kernel needs to wake a thread has passed.
    pub fn spin_until(&self, deadline: Nanos, spin: Nanos) {
        self.sleep_until(deadline.saturating_sub(spin));
        while self.time() < deadline {
            std::hint::spin_loop();
        }
    }
}

impl Clock for MonotonicClock {
    fn now(&mut self) -> Nanos {
        self.time()
    }

    fn executed(&mut self, _statements: u64) {}
}

/// CLOCK_MONOTONIC, through the vDSO: no system call.
fn monotonic() -> Nanos {
    let now = clock_gettime(ClockId::Monotonic);
    (now.tv_sec as u64).saturating_mul(NANOS_PER_SECOND).saturating_add(now.tv_nsec as u64)
}

/// Sleeps until CLOCK_MONOTONIC shows `absolute` nanoseconds. The deadline is absolute, so a late wake-up does not move
/// the next one, and a signal in between only makes it sleep on.
pub fn sleep_until(absolute: Nanos) {
    let deadline =
        Timespec { tv_sec: (absolute / NANOS_PER_SECOND) as i64, tv_nsec: (absolute % NANOS_PER_SECOND) as i64 };
    while clock_nanosleep_absolute(SleepClock::Monotonic, &deadline) == Err(Errno::INTR) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_never_goes_back_and_a_sleep_is_never_short() {
        let clock = MonotonicClock::start();
        let deadline = clock.time() + 2_000_000;
        clock.sleep_until(deadline);
        let woke = clock.time();
        assert!(woke >= deadline, "woke {} ns early", deadline - woke);
        let deadline = clock.time() + 1_000_000;
        clock.spin_until(deadline, 200_000);
        assert!(clock.time() >= deadline);
        clock.sleep_until(0);
        assert!(clock.time() >= woke);
    }

    #[test]
    fn copies_share_their_origin() {
        let a = MonotonicClock::start();
        let b = a;
        let first = a.time();
        assert!(b.time() >= first);
    }
}
