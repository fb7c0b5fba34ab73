//! What a runner of tests says at its end: how many ran.

use std::fmt;

use crate::failure::{Outcome, step};

/// The last line of a runner: libtest's `test result:` or nextest's `Summary [...]`.
pub(crate) fn is_closing_line(line: &str) -> bool {
    line.starts_with("test result: ") || line.trim_start().starts_with("Summary [")
}

/// The number of tests that ran, summed over closing lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Tally {
    pub(crate) passed: u64,
    pub(crate) left_out: u64,
}

impl Tally {
    /// Reads closing lines of libtest (`3 passed; 0 failed; 1 ignored; ...`) and nextest (`3 passed, 1 skipped`).
    pub(crate) fn of(lines: &[String]) -> Self {
        let mut tally = Self::default();
        for line in lines {
            let mut before = 0;
            for word in line.split([' ', ';', ',']) {
                match word {
                    "passed" => tally.passed += before,
                    "ignored" | "skipped" => tally.left_out += before,
                    _ => {}
                }
                before = word.parse().unwrap_or(0);
            }
        }
        tally
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} passed", self.passed)?;
        if self.left_out > 0 { write!(f, ", {} left out", self.left_out) } else { Ok(()) }
    }
}

/// The count as text; a run without any test is an error.
pub(crate) fn count(closing: &[String], what: &str) -> Outcome<String> {
    let tally = Tally::of(closing);
    if tally.passed == 0 {
        return Err(step(format!("{what}: no test ran")));
    }
    Ok(tally.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_runners_are_understood() {
        let lines = [
            "test result: ok. 5 passed; 0 failed; 1 ignored; 0 measured; 0 filtered out; finished in 0.00s".to_owned(),
            "     Summary [   1.234s] 12 tests run: 12 passed (1 slow), 3 skipped".to_owned(),
        ];
        assert!(lines.iter().all(|line| is_closing_line(line)));
        assert_eq!(Tally::of(&lines), Tally { passed: 17, left_out: 4 });
        assert!(!is_closing_line("test a_summary ... ok"));
    }

    #[test]
    fn no_test_at_all_is_a_failure() {
        assert!(count(&["test result: ok. 0 passed; 0 failed".to_owned()], "loom").is_err());
        assert_eq!(
            count(&["test result: ok. 2 passed; 0 failed".to_owned()], "loom").ok().as_deref(),
            Some("2 passed")
        );
    }
}
