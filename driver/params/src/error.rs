//! Errors of a parameter record, in words that name the place and the remedy.

use std::fmt;

/// An invalid parameter: which, why, and what to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParamError {
    /// Parameter byte (0..15), if the mistake has one.
    pub byte: Option<usize>,
    /// Key of the station file; empty for a reserved byte.
    pub key: String,
    /// What was found; empty: the key does not exist with this protocol, or `protocol` is missing.
    pub value: String,
    /// What is allowed instead, in words.
    pub allowed: String,
    /// What to do about it.
    pub remedy: String,
}

impl ParamError {
    /// What is wrong, without what is allowed and what to do.
    pub fn what(&self) -> String {
        let value = &self.value;
        match (self.byte, self.key.as_str()) {
            (_, "protocol") if value.is_empty() => "the parameter `protocol` is missing".into(),
            (_, key) if value.is_empty() => format!("there is no parameter `{key}` here"),
            (Some(byte), "") => format!("parameter byte {byte}: {value} is not allowed"),
            (Some(byte), key) => format!("parameter `{key}` (byte {byte}): {value} is not allowed"),
            (None, key) => format!("parameter `{key}`: {value} is not allowed"),
        }
    }

    /// True if it only follows from a wrong value of that key: it would not be there, or be another one, with a right
    /// value.
    pub fn follows_from(&self, key: &str) -> bool {
        // Of a key that does not exist, `allowed` lists all that do.
        self.remedy.contains(key) || (!self.value.is_empty() && self.allowed.contains(key))
    }
}

impl fmt::Display for ParamError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}; allowed: {}; {}", self.what(), self.allowed, self.remedy)
    }
}

impl std::error::Error for ParamError {}
