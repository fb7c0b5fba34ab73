//! The real clock: CLOCK_MONOTONIC, counted from the start of the runtime.

use ob1_time::{Clock, Instant, Span};
use rustix::io::Errno;
use rustix::thread::{ClockId as SleepClock, clock_nanosleep_absolute};
use rustix::time::{ClockId, Timespec, clock_gettime};

/// CLOCK_MONOTONIC since an origin. Copies share the origin, so that all threads speak of the same
/// times.
#[derive(Clone, Copy, Debug)]
pub struct MonotonicClock {
    /// What CLOCK_MONOTONIC shows when this clock shows 0.
    origin: Instant,
}

impl MonotonicClock {
    /// A clock that shows 0 now.
    #[must_use]
    pub fn start() -> Self {
        Self { origin: monotonic() }
    }

    /// What CLOCK_MONOTONIC shows when this clock shows 0.
    #[must_use]
    pub fn origin(&self) -> Instant {
        self.origin
    }

    /// The time now: [`Instant::START`] was at [`MonotonicClock::start`].
    #[must_use]
    pub fn time(&self) -> Instant {
        Instant::START + monotonic().since(self.origin)
    }

    /// What CLOCK_MONOTONIC and CLOCK_BOOTTIME showed when this clock showed 0.
    #[must_use]
    pub fn at_zero(&self) -> [Instant; 2] {
        let now = self.time();
        let boot = clock_gettime(ClockId::Boottime);
        let boot = Instant::from_secs(boot.tv_sec as u64).saturating_add(Span::from_nanos(boot.tv_nsec as u64));
        [self.origin, boot.saturating_sub(now.since_start())]
    }

    /// Sleeps until this clock shows `deadline`; returns at once when that is past. The deadline is absolute, so a late
    /// wake-up does not move the next one, and a signal in between only makes it sleep on.
    pub fn sleep_until(&self, deadline: Instant) {
        sleep_until(self.origin.saturating_add(deadline.since_start()));
    }

    /// The same, but sleeps `spin` less and polls the clock until the deadline: the core
    /// is awake then, and the time the kernel needs to wake a thread has passed.
    pub fn spin_until(&self, deadline: Instant, spin: Span) {
        self.sleep_until(deadline.saturating_sub(spin));
        while self.time() < deadline {
            std::hint::spin_loop();
        }
    }
}

impl Clock for MonotonicClock {
    fn now(&mut self) -> Instant {
        self.time()
    }

    fn executed(&mut self, _statements: u64) {}

    fn rest(&mut self, deadline: Instant) {
        self.sleep_until(deadline);
    }
}

/// CLOCK_MONOTONIC, through the vDSO: no system call.
fn monotonic() -> Instant {
    let now = clock_gettime(ClockId::Monotonic);
    Instant::from_secs(now.tv_sec as u64).saturating_add(Span::from_nanos(now.tv_nsec as u64))
}

/// Sleeps until CLOCK_MONOTONIC shows `absolute`.
fn sleep_until(absolute: Instant) {
    let since = absolute.since_start();
    let deadline = Timespec { tv_sec: since.secs() as i64, tv_nsec: since.subsec_nanos() as i64 };
    while clock_nanosleep_absolute(SleepClock::Monotonic, &deadline) == Err(Errno::INTR) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_never_goes_back_and_a_sleep_is_never_short() {
        let clock = MonotonicClock::start();
        let deadline = clock.time() + 2 * Span::MILLISECOND;
        clock.sleep_until(deadline);
        let woke = clock.time();
        assert!(woke >= deadline, "woke {} early", deadline - woke);
        let deadline = clock.time() + Span::MILLISECOND;
        clock.spin_until(deadline, Span::from_micros(200));
        assert!(clock.time() >= deadline);
        clock.sleep_until(Instant::START);
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
