//! A line of an audit log: one JSON object for each thing that somebody does over a link.

use ob1_model::calendar::date_of;
use serde_json::json;

/// Milliseconds since 1970 as `2026-11-22T18:00:00.123Z`.
#[must_use]
pub fn iso(unix_ms: u64) -> String {
    let (seconds, ms) = (unix_ms / 1000, unix_ms % 1000);
    let (year, month, day) = date_of(u32::try_from(seconds / 86_400).unwrap_or(u32::MAX));
    let (hour, minute, second) = (seconds / 3600 % 24, seconds / 60 % 60, seconds % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}.{ms:03}Z")
}

/// The line, with its end: `user` (`-` without one) at `client` has done `what` over `link`, at this many milliseconds
/// since 1970.
#[must_use]
pub fn line(unix_ms: u64, [link, user, client, what, outcome]: [&str; 5]) -> String {
    let line = json!({
        "time": iso(unix_ms), "link": link, "user": user, "client": client, "what": what, "outcome": outcome,
    });
    format!("{line}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments() {
        assert_eq!(iso(0), "1970-01-01T00:00:00.000Z");
        assert_eq!(iso(1_795_370_399_007), "2026-11-22T17:59:59.007Z");
        assert_eq!(iso(951_782_400_000), "2000-02-29T00:00:00.000Z");
    }
}
