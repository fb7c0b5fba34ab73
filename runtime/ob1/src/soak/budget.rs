//! What a soak has to keep: `cycle.p99.9=200us,missed=0,rss.slope=1MiB/h`.

use std::fmt;
use std::str::FromStr;

use ob1_station_file::parse_duration;
use ob1_timing::Class;

use crate::statistics::PERCENTILES;

/// One limit. Printed and parsed in the same form.
#[derive(Clone, Debug, PartialEq)]
pub struct Budget {
    /// As it was written.
    pub text: String,
    /// The figure that is limited.
    pub what: What,
    /// The limit: nanoseconds, a count, a share (0 to 1), or something an hour.
    pub limit: f64,
}

/// What can be limited.
#[derive(Clone, Debug, PartialEq)]
pub enum What {
    /// A percentile of a distribution: its name, and the share.
    Percentile(String, f64),
    /// The greatest value of a distribution.
    Max(String),
    /// The mean of a distribution.
    Mean(String),
    /// Something counted: the station's sum.
    Count(Counted),
    /// Growth of a cell of the program from the beginning to the end.
    Cell(String),
    /// Share of the late scans without an explanation.
    Unexplained,
    /// Growth of a series an hour.
    Slope(String),
}

/// What is counted, over the whole measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counted {
    /// Deadlines no cycle began for.
    Missed,
    /// Cycles that had not ended when the next was due.
    Overruns,
    /// Expiries of the watchdog.
    Watchdog,
    /// Late scans, all or of a class.
    Late(Option<Class>),
    /// Send orders that lay in a CP that died.
    TelegramsLost,
    /// Send orders that ended with an error.
    TelegramErrors,
    /// Send orders dropped by a reset of the CP.
    TelegramsAborted,
    /// Telegrams that arrived twice, as the program counts them.
    TelegramsDoubled,
    /// Telegrams that arrived with another content, as the program counts them.
    TelegramsWrong,
    /// Received telegrams that lay in a CP that died.
    ReceiveLost,
    /// Attempts of partners that failed.
    ReceiveErrors,
    /// Driver processes that ended without being asked to.
    DriversLost,
}

const COUNTS: [(&str, Counted); 12] = [
    ("missed", Counted::Missed),
    ("overruns", Counted::Overruns),
    ("watchdog", Counted::Watchdog),
    ("late", Counted::Late(None)),
    ("telegrams.lost", Counted::TelegramsLost),
    ("telegrams.errors", Counted::TelegramErrors),
    ("telegrams.aborted", Counted::TelegramsAborted),
    ("telegrams.doubled", Counted::TelegramsDoubled),
    ("telegrams.wrong", Counted::TelegramsWrong),
    ("receive.lost", Counted::ReceiveLost),
    ("receive.errors", Counted::ReceiveErrors),
    ("drivers.lost", Counted::DriversLost),
];

const CLASSES: [(&str, Class); 8] = [
    ("kernel", Class::Kernel),
    ("stopped", Class::Stopped),
    ("program", Class::Program),
    ("plugin", Class::Plugin),
    ("driver", Class::Driver),
    ("carried", Class::Carried),
    ("timer", Class::Timer),
    ("unexplained", Class::Unexplained),
];

/// The series that have slopes: name, and whether the values are times.
pub(super) const SERIES: [(&str, bool); 9] = [
    ("rss", false),
    ("fds", false),
    ("drivers.rss", false),
    ("cycle.p50", true),
    ("cycle.p99", true),
    ("wake.p50", true),
    ("wake.p99", true),
    ("execution.p50", true),
    ("execution.p99", true),
];

impl FromStr for Budget {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim();
        let Some((name, limit)) = text.split_once('=') else {
            return Err(format!("\"{text}\" has no limit; write it like wake.p99=200us or missed=0"));
        };
        let (name, limit) = (name.trim(), limit.trim());
        let (what, limit) = parse(name, limit).map_err(|why| format!("\"{text}\": {why}"))?;
        Ok(Self { text: format!("{name}={}", text.split_once('=').map_or("", |(_, l)| l.trim())), what, limit })
    }
}

impl fmt::Display for Budget {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

fn parse(name: &str, limit: &str) -> Result<(What, f64), String> {
    if let Some(cell) = name.strip_prefix("cell.") {
        return Ok((What::Cell(cell.to_owned()), count(limit)?));
    }
    if name == "unexplained" {
        return Ok((What::Unexplained, share(limit)?));
    }
    if let Some(series) = name.strip_suffix(".slope") {
        let Some((_, time)) = SERIES.iter().find(|(known, _)| *known == series) else {
            return Err(format!("no series has that name; there are {}", SERIES.map(|(name, _)| name).join(", ")));
        };
        return Ok((What::Slope(series.to_owned()), per_hour(limit, *time)?));
    }
    if let Some((_, counted)) = COUNTS.iter().find(|(known, _)| *known == name) {
        return Ok((What::Count(*counted), count(limit)?));
    }
    if let Some(class) = name.strip_prefix("late.") {
        let Some((_, class)) = CLASSES.iter().find(|(known, _)| *known == class) else {
            return Err(format!("no class has that name; there are {}", CLASSES.map(|(name, _)| name).join(", ")));
        };
        return Ok((What::Count(Counted::Late(Some(*class))), count(limit)?));
    }
    let (distribution, what) = distribution(name).ok_or_else(|| {
        "nothing is called that; DISTRIBUTION.p99.9=TIME (p50 p90 p99 p99.9 p99.99 p99.999 max mean; cycle wake deadlines execution inputs \
         outputs links ob1 ob35 ob35.late fc0), a count (missed overruns watchdog late late.CLASS telegrams.lost telegrams.errors \
         telegrams.aborted telegrams.doubled telegrams.wrong receive.lost receive.errors drivers.lost cell.NAME), unexplained=5%, or SERIES.slope (rss fds drivers.rss wake.p99)"
            .to_owned()
    })?;
    if !is_distribution(&distribution) {
        return Err(format!(
            "\"{distribution}\" is no distribution; there are cycle, wake, deadlines, execution, inputs, outputs, links, ob1 (any OB), ob35.late \
             and the blocks of plugins (fc0, fb65)"
        ));
    }
    let nanos = parse_duration(limit)?.nanos() as f64;
    Ok((what, nanos))
}

fn distribution(name: &str) -> Option<(String, What)> {
    for (percentile, share) in PERCENTILES {
        if let Some(of) = name.strip_suffix(percentile).and_then(|rest| rest.strip_suffix('.')) {
            return Some((of.to_owned(), What::Percentile(of.to_owned(), share)));
        }
    }
    if let Some(of) = name.strip_suffix(".max") {
        return Some((of.to_owned(), What::Max(of.to_owned())));
    }
    name.strip_suffix(".mean").map(|of| (of.to_owned(), What::Mean(of.to_owned())))
}

fn is_distribution(name: &str) -> bool {
    let numbered = |rest: &str| !rest.is_empty() && rest.bytes().all(|b| b.is_ascii_digit());
    let ob = name.strip_prefix("ob").map(|rest| rest.strip_suffix(".late").unwrap_or(rest));
    let block = ["sfc", "sfb", "fc", "fb"].iter().find_map(|kind| name.strip_prefix(kind));
    ["cycle", "wake", "deadlines", "execution", "inputs", "outputs", "links"].contains(&name)
        || ob.is_some_and(numbered)
        || block.is_some_and(numbered)
}

fn count(text: &str) -> Result<f64, String> {
    text.parse::<u64>().map(|n| n as f64).map_err(|_| format!("\"{text}\" is not a count; write it like 0 or 25"))
}

fn share(text: &str) -> Result<f64, String> {
    let number = text.strip_suffix('%').and_then(|n| n.trim().parse::<f64>().ok());
    number
        .filter(|n| (0.0..=100.0).contains(n))
        .map(|n| n / 100.0)
        .ok_or_else(|| format!("\"{text}\" is not a share; write it like 5%"))
}

/// Growth an hour: of times in nanoseconds, of memory in bytes, of counts.
fn per_hour(text: &str, time: bool) -> Result<f64, String> {
    let wrong = || {
        let example = if time { "10us/h" } else { "1MiB/h or 0/h" };
        format!("\"{text}\" is not a growth; write it like {example}")
    };
    let amount = text.strip_suffix("/h").ok_or_else(wrong)?.trim();
    if time {
        return parse_duration(amount).map(|time| time.nanos() as f64).map_err(|_| wrong());
    }
    bytes(amount).map(|n| n as f64).ok_or_else(wrong)
}

/// `64MiB`, `512KiB`, `1GiB`, or a plain number.
pub(super) fn bytes(text: &str) -> Option<u64> {
    let units = [("KiB", 1u64 << 10), ("MiB", 1 << 20), ("GiB", 1 << 30)];
    let (number, scale) =
        units.iter().find_map(|(unit, scale)| Some((text.strip_suffix(unit)?, *scale))).unwrap_or((text, 1));
    number.trim().parse::<u64>().ok()?.checked_mul(scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits() {
        let parse = |text: &str| text.parse::<Budget>().map(|b| (b.what, b.limit));
        let of = |name: &str| name.to_owned();
        assert_eq!(parse("cycle.p99.9=200us"), Ok((What::Percentile(of("cycle"), 0.999), 200_000.0)));
        assert_eq!(parse(" ob35.late.p99 = 1ms "), Ok((What::Percentile(of("ob35.late"), 0.99), 1e6)));
        assert_eq!(parse("fc0.max=50us"), Ok((What::Max(of("fc0")), 50_000.0)));
        assert_eq!(parse("execution.mean=50us"), Ok((What::Mean(of("execution")), 50_000.0)));
        assert_eq!(parse("missed=0"), Ok((What::Count(Counted::Missed), 0.0)));
        assert_eq!(parse("late.kernel=25"), Ok((What::Count(Counted::Late(Some(Class::Kernel))), 25.0)));
        assert_eq!(parse("unexplained=5%"), Ok((What::Unexplained, 0.05)));
        assert_eq!(parse("rss.slope=2MiB/h"), Ok((What::Slope(of("rss")), 2_097_152.0)));
        assert_eq!(parse("wake.p99.slope=10us/h"), Ok((What::Slope(of("wake.p99")), 10_000.0)));
        assert_eq!(parse("cell.DB20.WRONG=0"), Ok((What::Cell(of("DB20.WRONG")), 0.0)));
        assert_eq!("a.p99=1".parse::<Budget>().map_err(|e| e.contains("no distribution")), Err(true));
    }

    #[test]
    fn wrong_limits_say_how_to_write_them() {
        for (text, hint) in [
            ("missed", "missed=0"),
            ("missed=few", "0 or 25"),
            ("cycle.p99=200", "unit"),
            ("cycle.p98=200us", "p99.9"),
            ("late.host=0", "unexplained"),
            ("unexplained=101%", "5%"),
            ("rss.slope=1MiB", "1MiB/h"),
            ("cpu.slope=1/h", "drivers.rss"),
            ("wake.p99.slope=1/h", "10us/h"),
            ("obx.p99=1ms", "ob1"),
        ] {
            let error = text.parse::<Budget>().expect_err(text);
            assert!(error.contains(hint) && error.contains(text), "{error}");
        }
    }
}
