//! The file of a control program's tests.

use std::path::Path;

/// Reads the text; each finding of a refused file can be printed.
pub fn run(data: &[u8]) {
    let findings = ob1_command::testing::wrong_with(&String::from_utf8_lossy(data), "fuzz.test.toml", Path::new(""));
    assert!(findings.iter().all(|finding| finding.to_string().contains("fuzz.test.toml")));
}
