//! Figures as people read them: with the unit that suits, and three digits.

/// A time with the unit that suits it: `183 µs`, `2.41 ms`.
pub(crate) fn time(nanos: f64) -> String {
    let (scale, unit) = match nanos.abs() {
        n if n < 1e3 => (1.0, "ns"),
        n if n < 1e6 => (1e3, "µs"),
        n if n < 1e9 => (1e6, "ms"),
        n if n < 120e9 => (1e9, "s"),
        n if n < 7200e9 => (60e9, "min"),
        _ => (3600e9, "h"),
    };
    format!("{} {unit}", figures(nanos / scale))
}

/// Bytes in hexadecimal: `0A FF`.
pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(" ")
}

/// A number with three figures.
fn figures(value: f64) -> String {
    match value.abs() {
        v if v == 0.0 || v >= 99.95 => format!("{value:.0}"),
        v if v >= 9.995 => format!("{value:.1}"),
        _ => format!("{value:.2}"),
    }
}

/// A value of a series: a time, an amount of memory, or a count.
pub(crate) fn amount(series: &str, is_time: bool, value: f64) -> String {
    if is_time {
        return time(value);
    }
    if !series.ends_with("rss") {
        return figures(value);
    }
    let (scale, unit) = match value.abs() {
        v if v < 1024.0 * 1024.0 => (1024.0, "KiB"),
        v if v < 1024.0 * 1024.0 * 1024.0 => (1024.0 * 1024.0, "MiB"),
        _ => (1024.0 * 1024.0 * 1024.0, "GiB"),
    };
    format!("{} {unit}", figures(value / scale))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_and_amounts() {
        let times = [(0.0, "0 ns"), (999.0, "999 ns"), (1500.0, "1.50 µs"), (183_000.0, "183 µs"), (2.41e6, "2.41 ms")];
        for (nanos, text) in times {
            assert_eq!(time(nanos), text);
        }
        assert_eq!(time(8.0 * 3600e9), "8.00 h");
        assert_eq!(amount("rss", false, 1536.0), "1.50 KiB");
        assert_eq!(amount("fds", false, 12.0), "12.0");
        assert_eq!(amount("wake.p99", true, -1500.0), "-1.50 µs");
    }
}
