//! SFC 64 TIME_TCK: the system time in milliseconds, 0 to 2147483647, then again from 0.

use ob1_time::Instant;

/// The value of RET_VAL.
pub const fn time_tick(now: Instant) -> u32 {
    (now.millis() % 0x8000_0000) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wraps_after_24_days() {
        assert_eq!(time_tick(Instant::from_nanos(1_999_999)), 1);
        assert_eq!(time_tick(Instant::from_millis(0x7FFF_FFFF)), 0x7FFF_FFFF);
        assert_eq!(time_tick(Instant::from_millis(0x8000_0000)), 0);
    }
}
