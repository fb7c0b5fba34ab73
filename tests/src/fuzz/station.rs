//! The station file.

use std::path::Path;

/// Parses and checks; each finding of a refused file can be printed.
pub fn run(data: &[u8]) {
    let text = String::from_utf8_lossy(data);
    if let Err(findings) = ob1_station_file::parse(&text, "fuzz.toml", Path::new("")) {
        assert!(!findings.is_empty());
        assert!(findings.iter().all(|finding| finding.to_string().contains("fuzz.toml")));
    }
}
