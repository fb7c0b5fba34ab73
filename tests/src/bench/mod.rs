//! The figures of `docs/figures.md`, each with a lower limit (floor) measured in the same run.
//!
//! This machine may be shared and noisy, so a figure and its floor are measured in turns, many short rounds each, and
//! the median of the rounds is printed with the ratio of the medians.

pub mod access;
pub mod alarms;
pub mod backplane;
mod bare;
pub mod causes;
pub mod compile;
pub mod counts;
pub mod disturb;
pub mod driver;
pub mod engines;
pub mod fleet;
#[cfg(feature = "iceoryx")]
pub mod iceoryx;
pub mod io;
pub mod kill_runtime;
pub mod line;
pub mod machine_code;
pub mod memory;
pub mod peer;
pub mod record;
pub mod s7;
pub mod scan;
pub mod start;
pub mod stations;
pub mod stl;
pub mod wake;
pub mod watch;
pub mod written;

use std::borrow::Cow;
use std::time::{Duration, Instant};

/// What `cargo xtask bench` measures without further words.
pub const NAMES: [&str; 9] = ["scan", "pair", "access", "backplane", "driver", "memory", "line", "compile", "start"];

/// One printed line.
#[derive(Debug)]
pub struct Figure {
    /// The measured quantity.
    pub what: Cow<'static, str>,
    /// The figure in nanoseconds (or KiB, see `unit`).
    pub value: f64,
    /// Unit.
    pub unit: &'static str,
    /// The floor: its name and value.
    pub floor: Option<(&'static str, f64)>,
    /// The aim as text, and whether it was met; empty text: no aim.
    pub aim: (&'static str, bool),
}

impl Figure {
    /// The line of the table.
    #[must_use]
    pub fn line(&self) -> String {
        let floor = match self.floor {
            Some((name, floor)) => format!("{floor:>10.1} {:<4} {name:<42} x {:>5.2}", self.unit, self.value / floor),
            None => format!("{:>10} {:<4} {:<42}   {:>5}", "", "", "", ""),
        };
        let aim = match self.aim {
            ("", _) => String::new(),
            (aim, met) => format!("aim {aim:<10} {}", if met { "met" } else { "MISSED" }),
        };
        format!("{:<44} {:>10.1} {:<4} {floor}  {aim}", self.what, self.value, self.unit).trim_end().to_owned()
    }
}

/// Nanoseconds per repetition of `work`, repeated for at least `at_least`.
pub fn time_per_call(at_least: Duration, mut work: impl FnMut()) -> f64 {
    let mut count = 0u64;
    let start = Instant::now();
    loop {
        for _ in 0..64 {
            work();
        }
        count += 64;
        let elapsed = start.elapsed();
        if elapsed >= at_least {
            return elapsed.as_nanos() as f64 / count as f64;
        }
    }
}

/// The median; 0 if there are no values.
#[must_use]
pub fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Measures two things alternately and returns the medians.
///
/// # Errors
/// The first failure of either.
pub fn in_turns(
    rounds: usize,
    mut a: impl FnMut() -> Result<f64, peer::Failure>,
    mut b: impl FnMut() -> Result<f64, peer::Failure>,
) -> Result<(f64, f64), peer::Failure> {
    let (mut of_a, mut of_b) = (Vec::with_capacity(rounds), Vec::with_capacity(rounds));
    for _ in 0..rounds {
        of_a.push(a()?);
        of_b.push(b()?);
    }
    Ok((median(&mut of_a), median(&mut of_b)))
}
