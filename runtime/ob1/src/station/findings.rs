//! What can be wrong with a station file, by number, and the collector of findings.

use std::ops::Range;

use crate::finding::{Finding, Level, Text, nearest};

/// The file cannot be read.
pub(super) const UNREADABLE: &str = "C001";
/// It is no TOML, or a value has the wrong type.
pub(super) const SYNTAX: &str = "C002";
/// A key that does not exist.
pub(super) const UNKNOWN_KEY: &str = "C003";
/// A key that must be there is missing.
pub(super) const MISSING: &str = "C004";
/// A value that cannot be.
pub(super) const VALUE: &str = "C005";
/// A name that is there twice.
pub(super) const TWICE: &str = "C006";
/// Two modules at one address, or a module outside the address space.
pub(super) const ADDRESS: &str = "C007";
/// A parameter of a CP that cannot be.
pub(super) const PARAMETER: &str = "C008";
/// A line that cannot be.
pub(super) const LINE: &str = "C009";
/// Two keys that do not go together.
pub(super) const CONTRADICTION: &str = "C010";

/// Collects findings of one file.
pub(super) struct Findings<'a> {
    source: Text<'a>,
    found: Vec<Finding>,
}

impl<'a> Findings<'a> {
    pub(super) fn new(source: Text<'a>) -> Self {
        Self { source, found: Vec::new() }
    }

    pub(super) fn error(
        &mut self,
        code: &str,
        at: Range<usize>,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) {
        self.found.push(self.source.finding(Level::Error, code, at, message.into(), remedy.into()));
    }

    /// The station if nothing was found, else the findings in the order of the file.
    pub(super) fn into_result<T>(mut self, value: T) -> Result<T, Vec<Finding>> {
        if self.found.is_empty() {
            return Ok(value);
        }
        self.found.sort_by_key(|f| (f.line, f.column));
        Err(self.found)
    }
}

/// What the TOML reader says, as a finding: an unknown key with the nearest known one.
pub(super) fn of_toml(source: Text<'_>, error: &toml::de::Error) -> Finding {
    let at = error.span().unwrap_or(0..0);
    let message = error.message();
    let quoted: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    match (message.split_whitespace().next(), quoted.as_slice()) {
        (Some("unknown"), [key, known @ ..]) if message.starts_with("unknown field") => {
            let remedy = match nearest(key, known.iter().copied()) {
                Some(near) => format!("did you mean `{near}`?"),
                None => format!("known here: {}", known.join(", ")),
            };
            source.finding(Level::Error, UNKNOWN_KEY, at, format!("unknown key `{key}`"), remedy)
        }
        (Some("missing"), [key]) => {
            let remedy = format!("add `{key}`; docs/station-file.md says what it means");
            source.finding(Level::Error, MISSING, at.start..at.start, format!("the key `{key}` is missing"), remedy)
        }
        _ => {
            let remedy = "docs/station-file.md lists every key with its type".to_owned();
            source.finding(Level::Error, SYNTAX, at, message.replace('\n', ", "), remedy)
        }
    }
}
