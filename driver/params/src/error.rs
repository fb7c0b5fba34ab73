//! Errors of a parameter record, in words that name the place and the remedy.

use std::fmt;

/// An invalid parameter.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParamError {
    /// Parameter byte (0..15), if the mistake has one.
    pub byte: Option<usize>,
    /// Key of the station file; empty for a reserved byte.
    pub key: String,
    /// What was found.
    pub value: String,
    /// What is allowed.
    pub allowed: String,
    /// What to do about it.
    pub remedy: String,
}

impl fmt::Display for ParamError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.byte, self.key.as_str()) {
            (Some(byte), "") => write!(f, "parameter byte {byte}")?,
            (Some(byte), key) => write!(f, "parameter `{key}` (byte {byte})")?,
            (None, key) => write!(f, "parameter `{key}`")?,
        }
        write!(f, ": {} is not allowed here; allowed: {}; {}", self.value, self.allowed, self.remedy)
    }
}

impl std::error::Error for ParamError {}
