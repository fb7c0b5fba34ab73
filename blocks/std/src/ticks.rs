//! SFC 64 TIME_TCK: the system time in milliseconds, 0 to 2147483647, then again from 0.

/// The value of RET_VAL at `now` nanoseconds since the start.
#[must_use]
pub const fn time_tick(now: u64) -> u32 {
    (now / 1_000_000 % 0x8000_0000) as u32
}

#[cfg(test)]
mod tests {
    use super::time_tick;

    #[test]
    fn wraps_after_24_days() {
        assert_eq!(time_tick(1_999_999), 1);
        assert_eq!(time_tick(0x7FFF_FFFF * 1_000_000), 0x7FFF_FFFF);
        assert_eq!(time_tick(0x8000_0000 * 1_000_000), 0);
    }
}
