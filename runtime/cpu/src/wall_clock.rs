//! The wall clock: the only place where the CPU's own time and a date meet.
//!
//! It shows what DATE_AND_TIME can show. Whatever it is set to and however long it runs, it stays inside: it stands
//! still at the last moment of 2089, and a time before the first moment of 1990 is shown as that.

use std::cell::Cell;

use ob1_model::bcd::to_bcd;
use ob1_model::moment::Moment;
use ob1_time::{Instant, Span};

const NANOS_PER_MS: u64 = Span::MILLISECOND.nanos();

/// The date at a time of the CPU.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wall {
    /// Nanoseconds from 1990-01-01 to the CPU's time 0; below 0 when the clock was set to an earlier date than the CPU
    /// has been running for.
    at_zero: i128,
}

impl Wall {
    /// A clock that shows `date_at_zero` (nanoseconds since 1990-01-01) at the CPU's time 0.
    pub(crate) fn new(date_at_zero: u64) -> Self {
        Self { at_zero: i128::from(date_at_zero) }
    }

    /// What it shows at `now`.
    pub(crate) fn moment(self, now: Instant) -> Moment {
        let nanos = (self.at_zero + i128::from(now.nanos())).clamp(0, i128::from(u64::MAX)) as u64;
        moment(nanos)
    }

    /// The same as the eight bytes of a DATE_AND_TIME.
    pub(crate) fn bytes(self, now: Instant) -> [u8; 8] {
        self.moment(now).to_bytes()
    }

    /// The CPU's time has stood still for so long; the date has not.
    pub(crate) fn goes_on(&mut self, passed: Span) {
        self.at_zero += i128::from(passed.nanos());
    }

    /// The same for times outside, by which the CPU's time is behind by so much.
    pub(crate) fn outside(self, behind: Span) -> Self {
        Self { at_zero: self.at_zero - i128::from(behind.nanos()) }
    }

    /// Sets it: at `now` it shows `moment`.
    pub(crate) fn set(&mut self, moment: Moment, now: Instant) {
        self.at_zero = nanos(moment) - i128::from(now.nanos());
    }

    /// The CPU's time at which it shows `moment`; 0 when that lies before the CPU's time 0.
    pub(crate) fn when(self, moment: Moment) -> Instant {
        Instant::from_nanos((nanos(moment) - self.at_zero).clamp(0, i128::from(u64::MAX)) as u64)
    }
}

/// The second that was shown last: every scan asks for the date, and only the milliseconds have changed.
#[derive(Debug, Default)]
pub(crate) struct Shown(Cell<Second>);

#[derive(Clone, Copy, Debug, Default)]
struct Second {
    /// [`Wall::at_zero`] then.
    at_zero: i128,
    /// Its first instant.
    from: Instant,
    bytes: [u8; 8],
}

impl Shown {
    /// What `wall` shows at `now`, as the eight bytes of a DATE_AND_TIME.
    pub(crate) fn bytes(&self, wall: Wall, now: Instant) -> [u8; 8] {
        let Second { at_zero, from, mut bytes } = self.0.get();
        let since = now.since(from);
        if at_zero != wall.at_zero || now < from || since >= Span::SECOND || bytes == [0; 8] {
            return self.anew(wall, now);
        }
        let ms = since.millis() as u32;
        bytes[6] = to_bcd(ms / 10) as u8;
        bytes[7] = bytes[7] & 0x0F | ((ms % 10) << 4) as u8;
        bytes
    }

    #[cold]
    fn anew(&self, wall: Wall, now: Instant) -> [u8; 8] {
        let bytes = wall.bytes(now);
        let date = wall.at_zero + i128::from(now.nanos());
        let within = date.rem_euclid(i128::from(Span::SECOND.nanos())) as u64;
        // Outside the years of a DATE_AND_TIME the clock stands still.
        if date >= 0 && date < nanos(Moment::MAX) && now.nanos() >= within {
            self.0.set(Second { at_zero: wall.at_zero, from: now - Span::from_nanos(within), bytes });
        }
        bytes
    }
}

fn nanos(moment: Moment) -> i128 {
    i128::from(moment.ms() * NANOS_PER_MS)
}

fn moment(nanos: u64) -> Moment {
    Moment::from_ms(nanos / NANOS_PER_MS).unwrap_or(Moment::MAX)
}

/// The eight bytes of a DATE_AND_TIME for `nanos` since 1990-01-01; later than 2089 they are its last moment.
#[must_use]
pub fn date_and_time(nanos: u64) -> [u8; 8] {
    moment(nanos).to_bytes()
}

#[cfg(test)]
mod tests {
    use ob1_model::calendar::DAY_MS;

    use super::*;

    #[test]
    fn it_shows_what_it_was_set_to_whatever_the_time() {
        let days = [0, 1, 59, 3652 + 59, 14_610, 36_523, 36_524];
        let times = [0, 1, NANOS_PER_MS, 999_999_999, 86_400 * 1_000_000_000, u64::MAX / 2, u64::MAX];
        let times = times.map(Instant::from_nanos);
        for date_at_zero in [0, 1_000_000_000_000_000_000, u64::MAX] {
            for now in times {
                for ms in days.map(|day| day * DAY_MS + 45_296_789).into_iter().chain([0, Moment::MAX.ms()]) {
                    let mut wall = Wall::new(date_at_zero);
                    let set = Moment::from_ms(ms).expect("a moment");
                    wall.set(set, now);
                    assert_eq!((wall.moment(now), wall.bytes(now)), (set, set.to_bytes()));
                    assert_eq!(wall.when(set), now);
                    // Before and after, also far outside of what it can show.
                    for other in times {
                        let shown = wall.moment(other);
                        let expected = nanos(set) - i128::from(now.nanos()) + i128::from(other.nanos());
                        let expected = expected.clamp(0, nanos(Moment::MAX)) as u64 / NANOS_PER_MS;
                        assert_eq!(shown.ms(), expected, "{ms} at {now}, {other}");
                        assert_eq!(Moment::from_bytes(wall.bytes(other)), Ok(shown), "{ms} at {now}, {other}");
                        let _ = wall.when(shown);
                    }
                }
            }
        }
    }

    #[test]
    fn dates() {
        let day = 86_400_000_000_000;
        for (nanos, bytes) in [
            (0, [0x90, 0x01, 0x01, 0, 0, 0, 0, 0x02]),
            (59 * day, [0x90, 0x03, 0x01, 0, 0, 0, 0, 0x05]),
            (
                (3652 + 59) * day + 13 * 3_600_000_000_000 + 5 * 60_000_000_000 + 59_123_000_000,
                [0x00, 0x02, 0x29, 0x13, 0x05, 0x59, 0x12, 0x33],
            ),
            (u64::MAX, [0x89, 0x12, 0x31, 0x23, 0x59, 0x59, 0x99, 0x97]),
        ] {
            assert_eq!(date_and_time(nanos), bytes, "{nanos}");
        }
    }

    /// Whatever is asked in whatever order, and however the clock is set between: the same as without what is kept.
    #[test]
    fn the_second_that_is_kept_is_the_one_shown() {
        const SECOND: u64 = Span::SECOND.nanos();
        let shown = Shown::default();
        let mut state = 1_u64;
        let mut draw = |below: u64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 20) % below
        };
        let end = Moment::MAX.ms() * NANOS_PER_MS;
        for _ in 0..200 {
            let zero = [draw(SECOND), draw(end), end - draw(3 * SECOND), u64::MAX / 2][draw(4) as usize];
            let wall = Wall { at_zero: i128::from(zero) - i128::from(draw(2) * draw(4 * SECOND)) };
            let mut now = draw(2) * draw(1 << 40);
            for _ in 0..100 {
                let back = draw(20) == 0;
                now = if back { now.saturating_sub(draw(3 * SECOND)) } else { now + draw(SECOND / 4) };
                let at = Instant::from_nanos(now);
                assert_eq!(shown.bytes(wall, at), wall.bytes(at), "{wall:?} {at:?}");
            }
        }
    }
}
