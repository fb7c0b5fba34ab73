//! The date: from the clock of the machine to that of a CPU.

/// Nanoseconds from 1990-01-01 to now, UTC: what start information calls the date.
pub fn date_now() -> u64 {
    date_of(unix_now())
}

/// Nanoseconds from 1970-01-01 to now, UTC.
pub(crate) fn unix_now() -> u64 {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    now.as_nanos() as u64
}

/// Nanoseconds from 1990-01-01, out of those from 1970-01-01.
pub fn date_of(unix: u64) -> u64 {
    const TO_1990: u64 = 7305 * 86_400;
    unix.saturating_sub(TO_1990 * 1_000_000_000)
}
